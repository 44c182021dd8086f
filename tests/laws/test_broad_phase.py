"""Scenes with too many pairs of geoms to list, fixed or loose: the pairs of each environment are found, and lanes share no result."""

import numpy as np
import pytest
import stepper

BODIES = (
    '<geom type="capsule" size=".03 .12"/>',
    '<geom size=".05"/><geom type="capsule" size=".02 .1" pos=".1 0 0" quat="1 .3 .2 .1"/>',
    '<geom type="box" size=".05 .08 .03"/>',
    '<geom type="cylinder" size=".05 .06" pos="0 0 .1"/><geom type="ellipsoid" size=".05 .08 .04" pos="0 .1 0"/>',
    '<geom type="mesh" mesh="rock"/>',
)
ASSET = '<asset><mesh name="rock" vertex="0 0 -.1  .1 .02 0  -.09 .01 .01  .01 .11 .02  0 -.1 -.02  .02 .01 .12"/></asset>'


def scene(boxes, bodies=BODIES):
    """Loose bodies over boxes that are fixed to the world."""
    world = ""
    for x, y, z, a, b, c, turn in boxes:
        place = f'pos="{x:.4f} {y:.4f} {z:.4f}" quat="{np.cos(turn):.9f} 0 {np.sin(turn) / 2:.9f} {np.sin(turn):.9f}"'
        world += f'<geom type="box" size="{a:.4f} {b:.4f} {c:.4f}" {place}/>'
    for k, geoms in enumerate(bodies):
        world += f'<body name="body{k}" pos="{0.35 * (k - 2)} 0 .3"><freejoint/>{geoms}</body>'
    return stepper.load(f'<mujoco><option timestep=".004"/>{ASSET}<worldbody>{world}</worldbody></mujoco>')


@pytest.mark.parametrize("precision", ["f64", "f32"])
@pytest.mark.parametrize("count", [40, 700])
def test_environments_over_many_boxes_are_those_that_are_alone(precision, count):
    """40 boxes are listed pair by pair, the pairs of 700 are found anew in every step."""
    rng = np.random.default_rng(5)
    side = 1.2 if count == 40 else 2.0
    boxes = np.column_stack([rng.uniform(-side, side, (count, 2)), rng.uniform(-0.3, 0, count), rng.uniform(0.05, 0.2, (count, 4))])
    model = scene(boxes)
    many = stepper.Stepper(model, 13, precision=precision)
    places = np.tile(many.qpos[0], (13, 1))
    places.reshape(13, -1, 7)[:, :, :2] += rng.uniform(-1.5, 1.5, (13, 1, 2))
    many.set_state(qpos=places)
    many.step(nstep=60)
    assert np.mean([len(many.contacts(envs=[k])) for k in range(13)]) > 0.5
    for k in (0, 5, 12):
        alone = stepper.Stepper(model, 1, precision=precision)
        alone.set_state(qpos=places[k : k + 1])
        alone.step(nstep=60)
        np.testing.assert_array_equal(alone.qpos[0], many.qpos[k])


def test_boxes_of_an_environments_own_are_where_it_has_them():
    """Bounds of the tree hold the boxes of all environments of a group."""
    model = scene([(0, 0, -0.1, 0.2, 0.2, 0.1, 0)], bodies=BODIES[2:3])
    sims = stepper.Stepper(model, 9)
    pos = np.tile(model.geom_pos, (9, 1, 1))
    pos[:, 0, 2] = -0.1 - 0.1 * np.arange(9)
    pos[:, 0, 0] = -0.7
    sims.randomize(geom_pos=pos)
    sims.step(nstep=600)
    heights = sims.qpos[:, 2]
    np.testing.assert_allclose(np.diff(heights), -0.1, atol=1e-6)  # each rests on its own box; the settled motion is a millionth


# 24 free bodies of four balls: 96 moving geoms are too many to list their pairs, and few enough joints for groups of the most lanes.
BALLS = "".join(f'<geom size=".06" pos="{x} {y} 0"/>' for x in (-0.1, 0.1) for y in (-0.1, 0.1))
LOOSE = "".join(f'<body pos="{0.275 * (k % 5)} {0.275 * (k // 5)} .12"><freejoint/>{BALLS}</body>' for k in range(24))
CROWD = f'<mujoco><worldbody><geom type="plane" size="9 9 .1"/>{LOOSE}</worldbody></mujoco>'


@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_every_lane_of_a_group_finds_its_own_pairs(precision):
    """With 32 lanes (single precision, AVX-512), the pairs of lanes 16 to 31 were once those of other geoms."""
    model, num_envs = stepper.load(CROWD), 32
    qpos = np.tile(model.qpos0.reshape(24, 7), (num_envs, 1, 1))
    qpos[..., :3] += np.random.default_rng(1).uniform(-0.05, 0.05, (num_envs, 24, 3))
    batch = stepper.Stepper(model, num_envs, precision=precision)
    batch.reset(qpos=qpos.reshape(num_envs, -1))
    batch.step(nstep=150)
    assert len(batch.contacts()) > 48 * num_envs  # Most balls touch the floor, and some touch others.
    for env in (0, 15, 16, 31):
        alone = stepper.Stepper(model, precision=precision)
        alone.reset(qpos=qpos[env].reshape(-1))
        alone.step(nstep=150)
        np.testing.assert_array_equal(alone.qpos, batch.qpos[env])
