"""Contacts push only bodies that touch, and the broad phase finds all of them."""

import math

import numpy as np
import pytest
import stepper
from checks import every
from hypothesis import example, given, strategies as st
from models import simulate
from near_misses import ASSETS, MOVERS, OBSTACLES, ROUNDING, Floor, fly, scene_xml

INTEGRATORS = ["midpoint", "euler", "implicit", "rk4"]
movers = st.sampled_from(sorted(MOVERS))
obstacles = st.sampled_from(sorted(OBSTACLES))
timesteps = st.sampled_from([1e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2])
settings = st.tuples(st.sampled_from(INTEGRATORS), st.sampled_from(["f64", "f32"]))
flybys = st.tuples(timesteps, settings, st.floats(5e-4, 2e-2), st.floats(1.0, 6.0))
"""Time step, s; integrator and precision; gap, m; speed, m/s."""
Step = tuple[float, float, str]
"""Time step, s; first position, m; integrator."""

SLIDERS = [name for name in MOVERS if name not in ("upright capsule", "ellipsoid")]
"""Movers that slide without tipping over."""
KINDS = ["boxes", "meshes", "fields", "mixed"]
floors = st.builds(Floor, st.sampled_from(KINDS), st.floats(0.03, 0.2), st.floats(-40.0, 40.0) | st.just(0.0))
steps = st.tuples(st.sampled_from([1e-3, 2e-3, 5e-3, 1e-2]), st.floats(-0.05, 0.05), st.sampled_from(INTEGRATORS))
UPRIGHT = ["sphere", "box", "capsule", "cylinder", "hull", "mesh box"]
"""Movers that a central impact on their lowest side does not turn."""
falls = st.tuples(st.floats(3.0, 30.0), st.sampled_from([2e-3, 5e-3, 1e-2, 2e-2]), st.floats(0.05, 0.5))
"""Speed, m/s; time step, s; gap, m."""
# 24 free bodies of four balls: 96 moving geoms are too many to list their pairs, and few enough joints for groups of the most lanes.
BALLS = "".join(f'<geom size=".06" pos="{x} {y} 0"/>' for x in (-0.1, 0.1) for y in (-0.1, 0.1))
LOOSE = "".join(f'<body pos="{0.275 * (k % 5)} {0.275 * (k // 5)} .12"><freejoint/>{BALLS}</body>' for k in range(24))
CROWD = f'<mujoco><worldbody><geom type="plane" size="9 9 .1"/>{LOOSE}</worldbody></mujoco>'


def stepper_of(world: str, timestep: float, solver: tuple[str, str], *, restitution: float = 0.0) -> stepper.Stepper:
    """Stepper of a world without gravity and friction. `solver` is the integrator and the precision."""
    integrator, precision = solver
    model = stepper.load(scene_xml(world, timestep=timestep, assets=ASSETS))
    if restitution:
        model = model.replace(geom_restitution=np.full(model.ngeom, restitution))
    return stepper.Stepper(model, precision=precision, options=stepper.Options(integrator=integrator))


@given(movers, obstacles, flybys, st.sampled_from([0.0, 0.5, 1.0]))
def test_a_body_that_passes_above_another_keeps_its_velocity(mover, obstacle, flyby, restitution):
    timestep, solver, gap, speed = flyby
    geom, height = MOVERS[mover]
    world = OBSTACLES[obstacle] + f'<body pos="-.2 0 {height + gap}"><freejoint/>{geom}</body>'
    assert fly(stepper_of(world, timestep, solver, restitution=restitution), [speed, 0, 0, 0, 0, 0], 0.6) < ROUNDING[solver[1]]


@given(movers, movers, flybys)
def test_two_flying_bodies_pass_each_other(first, second, flyby):
    timestep, solver, gap, speed = flyby
    (geom, height), (other, _) = MOVERS[first], MOVERS[second]
    # The second is upside down below the first, so that their lowest points face each other.
    world = (
        f'<body pos="-.2 0 {height + gap / 2}"><freejoint/>{geom}</body>'
        f'<body pos=".2 0 {-MOVERS[second][1] - gap / 2}"><freejoint/><body euler="180 0 0">{other}</body></body>'
    )
    v = [speed, 0, 0, 0, 0, 0, -speed, 0, 0, 0, 0, 0]
    assert fly(stepper_of(world, timestep, solver), v, 0.4) < ROUNDING[solver[1]]


def slide(floor: Floor, mover: str, speed: float, step: Step):
    """Slide over 1.2 m of tiles. Return the final speed relative to the first, and the largest distance from the floor, m."""
    timestep, start, integrator = step
    geom, height = MOVERS[mover]
    world = floor.tiles(1.2) + f'<body pos="{start} 0 {height}"><freejoint/>{geom}</body>'
    model = stepper.load(scene_xml(world, timestep=timestep, gravity=9.81, assets=floor.assets()))
    sim = simulate(model, integrator=integrator, steps=round(0.1 / timestep))
    sim.set_state(qvel=[speed, 0, 0, 0, 0, 0])
    away = 0.0
    for _ in range(round(1.2 / speed / timestep)):
        sim.step()
        away = max(away, abs(sim.qpos[2] - height))
        assert not sim.status
    return sim.qvel[0] / speed, away


@given(floors, st.sampled_from(SLIDERS), steps, st.floats(0.5, 4.0))
@example(Floor("mixed"), "lying cylinder", (5e-3, 0.0, "midpoint"), 0.5)  # The predicted motion sinks by 15 um: 94 % were kept.
def test_a_body_slides_over_tiles_of_any_width_and_direction(floor, mover, step, speed):
    """The body keeps its speed and its height. Bounds of atlas scenes 21 and 44."""
    # With the rows of the next tile active: an upright cylinder kept 4 % of its speed and rose by 5.6 mm.
    kept, away = slide(floor, mover, speed, step)
    assert abs(kept - 1) < 1e-3
    assert away < 1e-5


@every(precision=["f64", "f32"], mover=["sphere", "box", "capsule"])
def test_a_body_leaves_the_edge_of_a_floor_as_a_projectile(mover, precision):
    """The speed along the floor does not change."""
    geom, height = MOVERS[mover]
    world = '<geom type="box" size=".5 1 .05" pos="-.5 0 -.05"/><geom type="box" size=".5 1 .05" pos=".5 0 -.55"/>'
    model = stepper.load(scene_xml(world + f'<body pos="-.2 0 {height}"><freejoint/>{geom}</body>', timestep=1e-3, gravity=9.81))
    sim = simulate(model, precision=precision, qvel=[2, 0, 0, 0, 0, 0], steps=250)
    assert not sim.status
    assert sim.qpos[2] < height - 0.05
    assert abs(sim.qvel[0] - 2) < 1e-2  # A box rotates at the edge, which takes part of its speed.


@given(st.sampled_from(["sphere", "box", "capsule", "cylinder", "hull"]), obstacles, timesteps, settings, st.floats(1.0, 6.0))
def test_a_body_that_hits_another_stops(mover, obstacle, timestep, solver, speed):
    """A central impact without restitution: neither penetration nor rebound."""
    geom, height = MOVERS[mover]
    world = OBSTACLES[obstacle] + f'<body pos=".1 0 {height + 0.1}"><freejoint/>{geom}</body>'
    sim = stepper_of(world, timestep, solver)
    sim.set_state(qvel=[0, 0, -speed, 0, 0, 0])
    for _ in range(int(np.ceil(0.2 / speed / timestep)) + 2):
        sim.step()
        assert sim.max_penetration < 2e-5  # Twice the slop.
    assert sim.qvel[2] > -1e-3 * speed


def drop(mover: str, obstacle: str, fall: tuple[float, float, float], integrator: str) -> list[float]:
    """Let a body strike another; `fall` is as in `falls`. Return its upward velocity after each step until it has stopped."""
    speed, timestep, gap = fall
    geom, height = MOVERS[mover]
    world = OBSTACLES[obstacle] + f'<body pos=".1 0 {height + gap}"><freejoint/>{geom}</body>'
    sim = stepper_of(world, timestep, (integrator, "f64"))
    sim.set_state(qvel=[0, 0, -speed, 0, 0, 0])
    velocities = []
    while len(velocities) < 50 and (not velocities or velocities[-1] < -1e-3 * speed):
        sim.step()
        assert sim.max_penetration < 2e-5  # Twice the slop.
        velocities.append(sim.qvel[2])
    return velocities


@every(mover=UPRIGHT, integrator=INTEGRATORS)
def test_a_fast_body_keeps_its_speed_until_it_strikes_a_thin_field(mover, integrator):
    """The gap of 0.1 m takes one step. The body must not slow down ahead of the field: a hull once took five steps."""
    first, *rest = drop(mover, "field", (5.0, 2e-2, 0.1), integrator)
    assert first == pytest.approx(-5.0, rel=1e-6)  # Height fields are kept in single precision.
    assert len(rest) == 1


@given(st.sampled_from(UPRIGHT), obstacles, falls, st.sampled_from(INTEGRATORS))
def test_a_fast_body_stops_soon_after_it_strikes(mover, obstacle, fall, integrator):
    """A gap closes at full speed, but for its last part: two more steps."""
    speed, timestep, gap = fall
    steps = math.ceil(gap / (speed * timestep))
    if steps <= 40:
        assert len(drop(mover, obstacle, fall, integrator)) <= steps + 2


def test_a_ball_that_lands_before_a_flush_seam_does_not_hit_it():
    """A ball lands on one tile. The path without that impact would hit the side of the next, flush tile."""
    ledge = '<geom type="box" size=".5 .5 .05" pos="-.5 0 -.05"/><geom type="box" size=".5 .5 .05" pos=".5 0 -.05"/>'
    world = ledge + '<body pos="-.012 0 .03"><freejoint/><geom type="sphere" size=".02" mass="1"/></body>'
    sim = simulate(scene_xml(world, timestep=5e-3), qvel=[2, 0, -4, 0, 0, 0], steps=4)
    np.testing.assert_allclose(sim.qvel[[0, 2]], [2, 0], atol=1e-9)  # Rounding: both tiles are flush.


# Scenes with too many pairs of geoms to list, fixed or loose: the pairs of each environment are found, and lanes share no result.

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


@every(precision=["f64", "f32"], count=[40, 700])
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
        alone = simulate(model, 1, precision=precision, qpos=places[k : k + 1], steps=60)
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
