"""Scenes with too many pairs of geoms to list: the broad phase finds the pairs of each environment in every step."""

import numpy as np
import pytest
import stepper

# 24 free bodies of four balls: 96 moving geoms are too many to list their pairs, and few enough joints for groups of the most lanes.
BALLS = "".join(f'<geom size=".06" pos="{x} {y} 0"/>' for x in (-0.1, 0.1) for y in (-0.1, 0.1))
BODIES = "".join(f'<body pos="{0.275 * (k % 5)} {0.275 * (k // 5)} .12"><freejoint/>{BALLS}</body>' for k in range(24))
SCENE = f'<mujoco><worldbody><geom type="plane" size="9 9 .1"/>{BODIES}</worldbody></mujoco>'


@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_every_lane_of_a_group_finds_its_own_pairs(precision):
    """With 32 lanes (single precision, AVX-512), the pairs of lanes 16 to 31 were once those of other geoms."""
    model, num_envs = stepper.load(SCENE), 32
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
