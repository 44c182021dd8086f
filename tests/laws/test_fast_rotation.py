"""Bodies that turn by 0.5 to 20 rad in a step are pushed by what their surfaces touch, and by nothing else.

A body of revolution that turns about its axis stays where it is. Other bodies stay inside their solid of revolution about the axis.
"""

import math

import near_misses
import numpy as np
import pytest
import stepper
from checks import every
from geometry import cuboid
from hypothesis import example, given, strategies as st
from models import simulate
from near_misses import ROUNDING, Floor, fly, scene_xml

INTEGRATORS = ["midpoint", "implicit"]
OBSTACLES = near_misses.OBSTACLES | {
    "plane": '<geom type="plane" size="1 1 1"/>',
    "mesh": '<geom type="mesh" mesh="cubes" pos=".1 0 -.02"/>',
}
ASSETS = near_misses.ASSETS + f'<mesh name="cubes" vertex="{cuboid(0.03, 0.02, 0.02)}"/>'

SPINNERS = {
    "ball": ('type="sphere" size=".02"', {"x": 0.02, "y": 0.02, "z": 0.02}),
    "capsule": ('type="capsule" size=".02 .03" euler="90 0 0"', {"y": 0.02, "x": 0.05, "z": 0.02}),
    "wheel": ('type="cylinder" size=".03 .01" euler="90 0 0"', {"y": 0.03, "x": math.hypot(0.03, 0.01), "z": 0.03}),
    "drill": ('type="cylinder" size=".01 .03"', {"z": 0.03, "x": math.hypot(0.03, 0.01)}),
    "ellipsoid": ('type="ellipsoid" size=".02 .03 .02"', {"y": 0.02, "x": 0.03, "z": 0.02}),
    "blade": ('type="box" size=".03 .005 .002"', {"z": 0.002, "x": math.hypot(0.005, 0.002)}),
    "cube": ('type="box" size=".02 .02 .02"', {"z": 0.02, "y": math.hypot(0.02, 0.02)}),
    "hull": ('type="mesh" mesh="brick"', {"z": 0.02, "y": math.hypot(0.03, 0.02)}),
}
"""Geom of each spinning body. For axes about which its rotation is steady, the depth of its solid of revolution below its centre, m."""
AXES = sorted((name, axis) for name, (_, depths) in SPINNERS.items() for axis in depths)
turns = st.floats(0.5, 20.0)
"""Rotation in a step, rad."""
timesteps = st.sampled_from([5e-4, 1e-3, 2e-3, 5e-3, 1e-2])
precisions = st.sampled_from(["f64", "f32"])
flights = st.tuples(st.sampled_from([2e-4, 1e-3, 1e-2]), st.floats(1.0, 6.0), st.booleans())
"""Gap, m; speed, m/s; whether the body turns backwards."""
TOPS = ['type="capsule" size=".02 .1"', 'type="cylinder" size=".1 .02"', 'type="ellipsoid" size=".05 .05 .03"']
ROLLERS = {
    "ball": ('type="sphere" size=".02"', 0.02),
    "wheel": ('type="cylinder" size=".02 .01" euler="90 0 0"', 0.02),
    "lying capsule": ('type="capsule" size=".02 .03" euler="90 0 0"', 0.02),
}
BLADES = {
    "box": ('type="box" size=".1 .01 .002"', math.hypot(0.1, 0.01), 0.002),
    "capsule": ('type="capsule" size=".005 .08" euler="0 90 0"', 0.085, 0.005),
    "rod": ('type="cylinder" size=".005 .08" euler="0 90 0"', math.hypot(0.08, 0.005), 0.005),
    "ellipsoid": ('type="ellipsoid" size=".08 .01 .005"', 0.08, 0.005),
    "arm": ('type="sphere" size=".01" pos=".08 0 0"', 0.09, 0.01),
}
"""Blades that turn about the z axis: geom, radius and half height of the disc that they sweep, m."""


def stepper_of(
    world: str, timestep: float, precision: str = "f64", integrator: str = "midpoint", *, gravity: float = 0.0, assets: str = ASSETS
) -> stepper.Stepper:
    """Stepper of a world without friction, in which the mesh "cubes" collides as its triangles."""
    model = stepper.load(scene_xml(world, timestep=timestep, gravity=gravity, assets=assets))
    if 'mesh="cubes"' in world:
        model = model.replace(geom_concave=[True] + [False] * (model.ngeom - 1))
    return stepper.Stepper(model, precision=precision, options=stepper.Options(integrator=integrator))


@given(st.sampled_from(AXES), st.sampled_from(sorted(OBSTACLES)), turns, timesteps, flights, precisions, st.sampled_from(INTEGRATORS))
@example(("wheel", "y"), "plane", 2.0, 5e-3, (2e-4, 4.0, False), "f64", "midpoint")
def test_a_spinning_body_that_passes_another_keeps_its_velocity(spinner, obstacle, turn, timestep, flight, precision, integrator):  # noqa: PLR0917
    (name, axis), (gap, speed, backwards) = spinner, flight
    geom, depths = SPINNERS[name]
    world = OBSTACLES[obstacle] + f'<body pos="-.2 0 {depths[axis] + gap}"><freejoint/><geom {geom} mass="1"/></body>'
    v = np.array([speed, 0, 0, 0, 0, 0])
    # The implicit rule takes the gyroscopic torque from a prediction. Above a radian in a step, rounding errors grow, until the step is
    # flagged UNRESOLVED.
    turn = min(turn, 1.0) if integrator == "implicit" and name in ("capsule", "wheel") else turn
    v[3 + "xyz".index(axis)] = (-turn if backwards else turn) / timestep
    assert fly(stepper_of(world, timestep, precision, integrator), v, 0.5) < ROUNDING[precision]


@given(st.sampled_from(TOPS), st.sampled_from(["free", "ball"]), turns, st.floats(0.0, 0.01), timesteps, precisions)
def test_a_top_precesses_with_a_constant_spin(top, kind, turn, wobble, timestep, precision):  # noqa: PLR0917
    """A body of revolution keeps its angular velocity about its axis, and the magnitude of that across the axis."""
    # With a fixed-point iteration in place of Newton's method, the wobble of the capsule was 1e-16 after 2,000 steps of 1.5 rad.
    sim = stepper_of(f'<body pos="0 0 9"><joint type="{kind}"/><geom {top} mass="1"/></body>', timestep, precision)
    v = np.zeros(sim.model.nv)
    v[-3:] = np.array([wobble, 0.0, 1.0]) * turn / timestep
    sim.set_state(qvel=v)
    for _ in range(200):
        sim.step()
        assert not sim.status
    w = sim.qvel[-3:] * timestep / turn
    # Rounding of 200 steps of up to 20 rad, times the capsule's ratio of inertias, 30.
    rounding = 200 * 20 * 30 * np.finfo({"f64": np.float64, "f32": np.float32}[precision]).eps
    assert abs(w[2] - 1) < rounding
    assert abs(np.hypot(w[0], w[1]) - wobble) < rounding


def test_a_ball_that_grazes_a_conveyor_keeps_its_velocity():
    """The velocity of the conveyor's surface moves neither geom."""
    roller = '<geom type="capsule" size=".1 .2" pos=".1 0 -.1" euler="90 0 0" surfacevel="0 40 0 0 0 0"/>'
    world = roller + '<body pos="-.2 0 .0202"><freejoint/><geom size=".02" mass="1"/></body>'
    assert fly(stepper_of(world, 2e-3), [4, 0, 0, 0, 0, 0], 0.6) < 1e-12  # Rounding.


@every(precision=["f64", "f32"], tiles=["boxes", "meshes", "fields"], roller=ROLLERS, turn=[0.5, 1.0, 2.5])
def test_a_round_body_rolls_over_the_seams_of_flush_tiles(roller, tiles, precision, turn):
    """A body that spins while it slides over flush tiles keeps its speed, its spin and its height."""
    # At 1 rad a step and more, the ball was thrown up by 77 mm.
    (geom, radius), timestep = ROLLERS[roller], 5e-3
    floor = Floor(tiles)
    world = floor.tiles(0.5) + f'<body pos="0 0 {radius}"><freejoint/><geom {geom} mass="1"/></body>'
    sim = stepper_of(world, timestep, precision, gravity=9.81, assets=floor.assets())
    sim.step(nstep=20)
    sim.set_state(qvel=[2, 0, 0, 0, turn / timestep, 0])
    for _ in range(50):
        sim.step()
        assert not sim.status
        assert abs(sim.qpos[2] - radius) < 2e-5  # Twice the slop.
        assert abs(sim.qvel[0] / 2 - 1) < 1e-3  # Bound of `tests/laws/test_near_misses.py` for sliders.
    # Normals of the contacts meet the axis, so that no torque acts. Measured: no change at all.
    assert abs(sim.qvel[4] * timestep / turn - 1) < ROUNDING[precision]


def test_a_turning_wheel_of_a_yawing_cart_rolls_over_seams():
    """The axle of a wheel moves with the cart, not about the axis of the wheel's whole angular velocity."""
    wheel = '<joint axis="0 1 0"/><geom type="cylinder" size=".03 .01" euler="90 0 0" mass=".1"/>'
    wheels = "".join(f'<body pos="{x} {y} 0">{wheel}</body>' for x in (-0.1, 0.1) for y in (-0.08, 0.08))
    cart = f'<body pos="0 0 .03"><freejoint/><geom type="box" size=".1 .05 .01" pos="0 0 .01" mass="1"/>{wheels}</body>'
    sim = stepper_of(Floor("boxes").tiles(0.4) + cart, 5e-3, gravity=9.81)
    sim.step(nstep=20)
    sim.set_state(qvel=[1, 0, 0, 0, 0, 1.5, *[300.0] * 4])
    for _ in range(80):
        sim.step()
        assert not sim.status
        assert abs(sim.qpos[2] - 0.03) < 2e-5  # Twice the slop.
    # The seams neither brake the cart nor its yaw: energy is kept up to the work of the slop.
    assert np.hypot(*sim.qvel[:2]) == pytest.approx(1.0, rel=1e-2)
    assert sim.qvel[5] == pytest.approx(1.5, rel=1e-2)


def rotor(geom: str, around: str, spin: float, timestep: float, precision: str = "f64") -> stepper.Stepper:
    """Rotor on a vertical hinge, with an angular velocity in rad/s, among geoms `around`."""
    sim = stepper_of(around + f'<body pos="0 0 0"><joint axis="0 0 1"/><geom {geom} mass=".1"/></body>', timestep, precision)
    sim.set_state(qvel=[spin])
    return sim


@given(st.sampled_from(sorted(BLADES)), turns, timesteps, st.sampled_from([2e-4, 1e-3, 1e-2]), precisions)
def test_a_rotor_whose_disc_touches_nothing_keeps_its_velocity(blade, turn, timestep, gap, precision):
    """The disc of the blades is between a plate above, a ball below, and walls around it."""
    geom, radius, height = BLADES[blade]
    around = (
        f'<geom type="box" size=".2 .2 .01" pos="0 0 {height + gap + 0.01}"/>'
        f'<geom type="sphere" size=".05" pos=".06 0 {-height - gap - 0.05}"/>'
        f'<geom type="box" size=".01 .2 .05" pos="{radius + gap + 0.01} 0 0"/>'
        f'<geom type="capsule" size=".02 .1" pos="0 {radius + gap + 0.02} 0"/>'
        f'<geom type="cylinder" size=".02 .1" pos="{-radius - gap - 0.02} 0 0"/>'
    )
    sim = rotor(geom, around, turn / timestep, timestep, precision)
    for _ in range(20):
        sim.step()
        assert not sim.status
        assert abs(sim.qvel[0] * timestep / turn - 1) < ROUNDING[precision]


@given(st.sampled_from(sorted(BLADES)), turns, timesteps, st.floats(0.0, 6.28))
def test_a_rotor_whose_disc_meets_a_post_stops_or_is_flagged(blade, turn, timestep, angle):
    """A blade that turns into a post does not pass through it unseen."""
    geom, radius, _ = BLADES[blade]
    x, y = 0.8 * radius * math.cos(angle), 0.8 * radius * math.sin(angle)
    sim = rotor(geom, f'<geom type="capsule" size=".02 .1" pos="{x} {y} 0"/>', 0.0, timestep)
    # Start as far from the post as possible.
    sim.set_state(qpos=[angle + (math.pi if blade == "arm" else math.pi / 2)], qvel=[turn / timestep])
    turned, flags = 0.0, stepper.Status.OK
    while turned < 2 * math.pi + 2 * turn and not flags & stepper.Status.TUNNELLED and sim.qvel[0] > 0.5 * turn / timestep:
        before = sim.qpos[0]
        sim.step()
        turned, flags = turned + sim.qpos[0] - before, flags | stepper.Status(int(sim.status))
    assert sim.qvel[0] < 0.5 * turn / timestep or flags & stepper.Status.TUNNELLED


@given(st.sampled_from([("box", 0.01), ("cylinder", 0.03), ("drill", 0.01)]), turns, timesteps, st.sampled_from([2e-4, 1e-3]), precisions)
def test_a_part_that_turns_in_a_hole_keeps_its_velocity(part, turn, timestep, gap, precision):
    """A square hole of four walls, as wide as the circle of the part."""
    name, size = part
    geom, radius = {
        "box": (f'type="box" size="{size} {size} .03"', math.hypot(size, size)),
        "cylinder": (f'type="cylinder" size="{size} .01"', size),
        "drill": (f'type="cylinder" size="{size} .05"', size),
    }[name]
    at = radius + gap + 0.02
    sizes = [(at, 0, 0.02, 0.1), (-at, 0, 0.02, 0.1), (0, at, 0.1, 0.02), (0, -at, 0.1, 0.02)]
    walls = "".join(f'<geom type="box" size="{a} {b} .05" pos="{x} {y} 0"/>' for x, y, a, b in sizes)
    world = walls + f'<body pos="0 0 .08"><freejoint/><geom {geom} mass="1"/></body>'
    assert fly(stepper_of(world, timestep, precision), [0, 0, -1.0, 0, 0, turn / timestep], 0.16) < ROUNDING[precision]


@pytest.mark.parametrize("turn", [0.6, 1.5, 4.0])
def test_a_door_with_a_hinge_beside_its_origin_swings_past_a_post(turn):
    """The body's origin moves on a circle about the anchor of its hinge."""
    door = '<body pos=".1 0 0"><joint axis="0 0 1" pos="-.1 0 0"/><geom type="box" size=".1 .005 .05" mass=".1"/></body>'
    far = math.hypot(0.2, 0.005) + 1e-3
    posts = "".join(
        f'<geom type="capsule" size=".01 .1" pos="{(far + 0.01) * math.cos(a)} {(far + 0.01) * math.sin(a)} 0"/>' for a in range(6)
    )
    timestep = 5e-3
    sim = stepper_of(posts + door, timestep)
    sim.set_state(qvel=[turn / timestep])
    for _ in range(30):
        sim.step()
        assert not sim.status
    assert sim.qvel[0] == pytest.approx(turn / timestep, rel=1e-9)  # Rounding.


def test_a_spinning_ball_near_a_box_falls_as_a_projectile():
    """The spin of a ball does not move the time at which its step is evaluated: the midpoint rule is exact for a parabola."""
    world = '<geom type="box" size=".3 .3 .01" pos="0 0 -.01"/><body pos="-.2 0 .05"><freejoint/><geom size=".02" mass="1"/></body>'
    timestep, spin = 2e-3, 5000.0
    sim = stepper_of(world, timestep, gravity=9.81)
    sim.set_state(qvel=[4, 0, 0.2, 0, spin, 0])
    for k in range(1, 21):
        sim.step()
        t = k * timestep
        assert not sim.status
        np.testing.assert_allclose(sim.qpos[:3], [-0.2 + 4 * t, 0, 0.05 + 0.2 * t - 9.81 / 2 * t * t], atol=1e-12)  # Rounding.


@given(st.sampled_from(AXES), st.sampled_from(sorted(OBSTACLES)), turns, timesteps, st.floats(1.0, 6.0), precisions)
def test_a_spinning_body_that_hits_another_does_not_pass_through_it(spinner, obstacle, turn, timestep, speed, precision):  # noqa: PLR0917
    """A body that flies down at the middle of another is stopped, or a step is flagged as TUNNELLED or, while it sinks in, as DEEP."""
    (name, axis), height = spinner, 0.1
    geom, depths = SPINNERS[name]
    world = OBSTACLES[obstacle] + f'<body pos=".1 0 {depths[axis] + height}"><freejoint/><geom {geom} mass="1"/></body>'
    sim = stepper_of(world, timestep, precision)
    v = np.array([0, 0, -speed, 0, 0, 0])
    v[3 + "xyz".index(axis)] = turn / timestep
    sim.set_state(qvel=v)
    flags = stepper.Status.OK
    for _ in range(math.ceil(0.2 / speed / timestep) + 2):
        sim.step()
        flags |= stepper.Status(int(sim.status))
    # Without an impact, the body would be 0.1 m below the surface.
    assert sim.qpos[2] > -0.02 or flags & (stepper.Status.TUNNELLED | stepper.Status.DEEP)


@every(precision=["f64", "f32"], turn=[0.9, 1.4, 2.0, 4.0, 20.0], friction=[0.0, 1.0])
def test_a_wheel_that_rolls_fast_stays_on_a_plane(turn, friction, precision):
    """A cylinder that rolls by any angle in a step keeps its velocity: only the lowest line of its surface touches the plane."""
    radius, timestep, tolerance = 0.03, 5e-3, {"f64": 1e-6, "f32": 1e-4}[precision]
    wheel = f'<body pos="0 0 {radius}"><freejoint/><geom type="cylinder" size="{radius} .01" euler="90 0 0" mass="1"/></body>'
    defaults = f'<default><geom friction="{friction} 0 0"/></default>'
    xml = f'<mujoco>{defaults}<worldbody><geom type="plane" size="1 1 1"/>{wheel}</worldbody></mujoco>'
    sim = stepper.Stepper(stepper.load(xml), precision=precision, options=stepper.Options(timestep=timestep, tolerance=tolerance))
    spin = turn / timestep
    sim.set_state(qvel=[spin * radius, 0, 0, 0, spin, 0])
    sim.step(nstep=40)
    assert not sim.status
    # The tolerance of the solver, m/s; in f32 the speed is rounded too.
    error = tolerance + (1e-5 * spin * radius if precision == "f32" else 0)
    assert sim.qvel[[0, 2]] == pytest.approx([spin * radius, 0], abs=error)
    assert sim.qpos[2] == pytest.approx(radius, abs=1e-5)


@pytest.mark.parametrize("tilt", [0.0, 0.02, 0.3])
def test_a_tilted_cylinder_comes_to_stand_on_a_plane(tilt):
    """A cylinder that falls on the rim of an end face tips onto the face, and stands on three or four points."""
    world = (
        f'<geom type="plane" size="1 1 1"/><body pos="0 0 .06" euler="0 {tilt} 0"><freejoint/><geom type="cylinder" size=".03 .02"/></body>'
    )
    compiler = '<compiler angle="radian"/>'
    sim = simulate(f"<mujoco>{compiler}<worldbody>{world}</worldbody></mujoco>", timestep=2e-3, steps=1000)
    assert sim.qpos[2] == pytest.approx(0.02, abs=1e-4)  # The slop of a contact.
    assert np.abs(sim.qvel).max() < 1e-6  # The tolerance of the solver.
    assert len(sim.contacts()) >= 3


@pytest.mark.parametrize("turn", [5.0, 11.0, 20.0])
def test_two_rotors_side_by_side_keep_their_velocity(turn):
    """Rotors that turn in opposite senses, 8 cm apart, do not push each other."""
    timestep = 2e-3
    rotor = '<joint axis="0 0 1"/><geom type="box" size=".06 .008 .001" mass=".005"/>'
    world = f'<body>{rotor}</body><body pos=".2 0 0">{rotor}</body>'
    xml = f'<mujoco><option gravity="0 0 0"/><worldbody>{world}</worldbody></mujoco>'
    sim = simulate(xml, timestep=timestep, qvel=[turn / timestep, -turn / timestep], steps=20)
    assert not sim.status
    np.testing.assert_allclose(sim.qvel * timestep, [turn, -turn], rtol=1e-12)  # Rounding.
