"""Contacts push only bodies that touch: not bodies that pass each other, nor sliders at the seams of a flat floor."""

import numpy as np
import pytest
import stepper
from hypothesis import given
from hypothesis import strategies as st
from near_misses import MESHES, MOVERS, cuboid, scene_xml

INTEGRATORS = ["midpoint", "euler", "implicit", "rk4"]
# Rounding error of a velocity after some hundred steps, relative to the speed.
ROUNDING = {"f64": 1e-9, "f32": 1e-5}

OBSTACLES = {
    "box": '<geom type="box" size=".3 .3 .3" pos=".3 0 -.3"/>',
    "capsule": '<geom type="capsule" size=".03 .2" pos=".1 0 -.23"/>',
    "cylinder": '<geom type="cylinder" size=".05 .1" pos=".1 0 -.1"/>',
    "sphere": '<geom type="sphere" size=".1" pos=".1 0 -.1"/>',
    "hull": '<geom type="mesh" mesh="brick" pos=".1 0 -.02"/>',
    "field": '<geom type="hfield" hfield="flat" pos=".1 0 0"/>',
}
FIELD = '<hfield name="flat" nrow="3" ncol="3" size=".05 1 .1 .05" elevation="0 0 0 0 0 0 0 0 0"/>'
TILE = f'<mesh name="tile" vertex="{cuboid(0.05, 1, 0.05)}"/>'
ASSETS = MESHES + FIELD + TILE

movers = st.sampled_from(sorted(MOVERS))
obstacles = st.sampled_from(sorted(OBSTACLES))
timesteps = st.sampled_from([1e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2])
settings = st.tuples(st.sampled_from(INTEGRATORS), st.sampled_from(["f64", "f32"]))


def fly(world: str, v: list[float], timestep: float, distance: float, solver: tuple[str, str], *, restitution: float = 0.0):
    """Let bodies fly for a distance in m. Return the simulation and the largest change of their velocity."""
    integrator, precision = solver
    model = stepper.load(scene_xml(world, timestep=timestep, assets=ASSETS))
    if restitution:
        model = model.replace(geom_restitution=np.full(model.ngeom, restitution))
    sim = stepper.Stepper(model, precision=precision, options=stepper.Options(integrator=integrator))
    sim.set_state(qvel=v)
    largest_change, speed = 0.0, np.abs(v).max()
    for _ in range(int(np.ceil(distance / speed / timestep))):
        sim.step()
        largest_change = max(largest_change, np.abs(sim.qvel - v).max())
        assert not sim.status
    return sim, largest_change


flybys = st.tuples(timesteps, settings, st.floats(5e-4, 2e-2), st.floats(1.0, 6.0))
"""Time step, s; integrator and precision; gap, m; speed, m/s."""


@given(movers, obstacles, flybys, st.sampled_from([0.0, 0.5, 1.0]))
def test_a_body_that_passes_above_another_keeps_its_velocity(mover, obstacle, flyby, restitution):
    timestep, solver, gap, speed = flyby
    geom, height = MOVERS[mover]
    world = OBSTACLES[obstacle] + f'<body pos="-.2 0 {height + gap}"><freejoint/>{geom}</body>'
    _, change = fly(world, [speed, 0, 0, 0, 0, 0], timestep, 0.6, solver, restitution=restitution)
    assert change < ROUNDING[solver[1]] * speed


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
    _, change = fly(world, v, timestep, 0.4, solver)
    assert change < ROUNDING[solver[1]] * speed


HALF_CUBE = '<geom type="box" size=".5 .5 .5" pos=".5 0 -.5"/>'


def test_a_ball_keeps_its_speed_a_millimetre_above_a_box():
    # With the row of the nearest edge active: 2.71 m/s, and 0.57 m/s upwards.
    world = HALF_CUBE + '<body pos="-.3 0 .021"><freejoint/><geom type="sphere" size=".02" mass="1"/></body>'
    sim, _ = fly(world, [4, 0, 0, 0, 0, 0], 5e-3, 1.2, ("midpoint", "f64"))
    np.testing.assert_allclose(sim.qvel, [4, 0, 0, 0, 0, 0], atol=1e-12)  # Rounding.


def test_a_box_does_not_turn_above_a_box():
    # With the rows of the nearest edges active: 2.06 m/s and 72 rad/s.
    world = HALF_CUBE + '<body pos="-.3 0 .0215"><freejoint/><geom type="box" size=".02 .02 .02" mass="1"/></body>'
    sim, _ = fly(world, [4, 0, 0, 0, 0, 0], 1e-3, 1.2, ("midpoint", "f64"))
    np.testing.assert_allclose(sim.qvel, [4, 0, 0, 0, 0, 0], atol=1e-12)  # Rounding.


def floor_of(kind: str) -> str:
    """Flat floor of tiles of 10 cm, as MJCF."""
    tiles = {
        "boxes": '<geom type="box" size=".05 1 .05" pos="{} 0 {}"/>',
        "meshes": '<geom type="mesh" mesh="tile" pos="{} 0 {}"/>',
        "fields": '<geom type="hfield" hfield="flat" pos="{} 0 {}"/>',
    }
    kinds = list(tiles) if kind == "mixed" else [kind]
    chosen = [kinds[k % len(kinds)] for k in range(28)]
    below = {"boxes": 0.05, "meshes": 0.05, "fields": 0.0}
    return "".join(tiles[name].format(0.1 * (k - 4), -below[name]) for k, name in enumerate(chosen))


SLIDERS = [name for name in MOVERS if name not in ("upright capsule", "ellipsoid")]
"""Movers that slide without tipping over."""


def slide(kind: str, mover: str, speed: float, timestep: float, start: float = 0.0):
    """Slide over 1.2 m of tiles. Return the final speed relative to the first, and the largest distance from the floor, m."""
    geom, height = MOVERS[mover]
    world = floor_of(kind) + f'<body pos="{start} 0 {height}"><freejoint/>{geom}</body>'
    model = stepper.load(scene_xml(world, timestep=timestep, gravity=9.81, assets=ASSETS))
    sim = stepper.Stepper(model)
    sim.step(nstep=round(0.1 / timestep))
    sim.set_state(qvel=[speed, 0, 0, 0, 0, 0])
    away = 0.0
    for _ in range(round(1.2 / speed / timestep)):
        sim.step()
        away = max(away, abs(sim.qpos[2] - height))
        assert not sim.status
    return sim.qvel[0] / speed, away


@pytest.mark.parametrize("mover", SLIDERS)
@pytest.mark.parametrize("kind", ["boxes", "meshes", "fields", "mixed"])
@pytest.mark.parametrize("timestep", [1e-3, 5e-3])
@pytest.mark.parametrize("speed", [1.0, 2.0])
def test_a_body_slides_over_the_seams_of_tiles(mover, kind, timestep, speed):
    # With the rows of the next tile active: an upright cylinder kept 4 % of its speed and rose by 5.6 mm. Bounds of atlas scene 21.
    kept, away = slide(kind, mover, speed, timestep)
    assert abs(kept - 1) < 1e-3
    assert away < 1e-5


@given(st.sampled_from(SLIDERS), st.sampled_from(["boxes", "meshes", "fields", "mixed"]), st.floats(0.5, 3.0), st.floats(-0.05, 0.05))
def test_a_body_slides_over_the_seams_from_anywhere(mover, kind, speed, start):
    kept, away = slide(kind, mover, speed, 5e-3, start)
    assert abs(kept - 1) < 1e-3
    assert away < 1e-5


@pytest.mark.parametrize("precision", ["f64", "f32"])
@pytest.mark.parametrize("mover", ["sphere", "box", "capsule"])
def test_a_body_leaves_the_edge_of_a_floor_as_a_projectile(mover, precision):
    """The speed along the floor does not change."""
    geom, height = MOVERS[mover]
    world = '<geom type="box" size=".5 1 .05" pos="-.5 0 -.05"/><geom type="box" size=".5 1 .05" pos=".5 0 -.55"/>'
    model = stepper.load(scene_xml(world + f'<body pos="-.2 0 {height}"><freejoint/>{geom}</body>', timestep=1e-3, gravity=9.81))
    sim = stepper.Stepper(model, precision=precision)
    sim.set_state(qvel=[2, 0, 0, 0, 0, 0])
    sim.step(nstep=250)
    assert not sim.status
    assert sim.qpos[2] < height - 0.05
    assert abs(sim.qvel[0] - 2) < 1e-2  # A box rotates at the edge, which takes part of its speed.


@given(st.sampled_from(["sphere", "box", "capsule", "cylinder", "hull"]), obstacles, timesteps, settings, st.floats(1.0, 6.0))
def test_a_body_that_hits_another_stops(mover, obstacle, timestep, solver, speed):
    """A central impact without restitution: neither penetration nor rebound."""
    geom, height = MOVERS[mover]
    world = OBSTACLES[obstacle] + f'<body pos=".1 0 {height + 0.1}"><freejoint/>{geom}</body>'
    model = stepper.load(scene_xml(world, timestep=timestep, assets=ASSETS))
    sim = stepper.Stepper(model, precision=solver[1], options=stepper.Options(integrator=solver[0]))
    sim.set_state(qvel=[0, 0, -speed, 0, 0, 0])
    for _ in range(int(np.ceil(0.2 / speed / timestep)) + 2):
        sim.step()
        assert sim.max_penetration < 2e-5  # Twice the slop.
    assert sim.qvel[2] > -1e-3 * speed


def test_a_ball_that_lands_before_a_flush_seam_does_not_hit_it():
    """A ball lands on one tile. The path without that impact would hit the side of the next, flush tile."""
    ledge = '<geom type="box" size=".5 .5 .05" pos="-.5 0 -.05"/><geom type="box" size=".5 .5 .05" pos=".5 0 -.05"/>'
    world = ledge + '<body pos="-.012 0 .03"><freejoint/><geom type="sphere" size=".02" mass="1"/></body>'
    sim = stepper.Stepper(stepper.load(scene_xml(world, timestep=5e-3)))
    sim.set_state(qvel=[2, 0, -4, 0, 0, 0])
    sim.step(nstep=4)
    np.testing.assert_allclose(sim.qvel[[0, 2]], [2, 0], atol=1e-9)  # Rounding: both tiles are flush.
