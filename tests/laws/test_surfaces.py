"""Surfaces of triangles, moving surfaces, holes and thin hulls: seams take no energy, and a mesh rests on a plane."""

from functools import cache

import numpy as np
import pytest
import stepper
from checks import every
from geometry import cuboid, prism, vertices
from hypothesis import example, given, settings, strategies as st
from models import simulate

HALF, BEND, RADIUS, G = 0.5, 0.5, 0.1, 9.81
"""m, 1/m, m, m/s^2."""
KINDS = ("hfield", "mesh", "mesh, other diagonals")
GROUNDS = [("hfield", 11), ("hfield", 41), ("hfield", 161), *((kind, points) for kind in KINDS[1:] for points in (11, 41))]
FREE = '<freejoint/><geom type="sphere" size=".1" condim="1"/>'
SLIDES = '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>'
GLIDERS = {
    "ball": (FREE, RADIUS),
    "capsule along": (SLIDES + '<geom type="capsule" size=".05 .08" euler="0 90 0" condim="1"/>', 0.05),
    "capsule across": (SLIDES + '<geom type="capsule" size=".05 .08" euler="90 0 0" condim="1"/>', 0.05),
    "box": (SLIDES + '<geom type="box" size=".06 .05 .04" condim="1"/>', 0.04),
    "turned box": (SLIDES + '<geom type="box" size=".06 .05 .04" euler="0 0 30" condim="1"/>', 0.04),
    "cylinder": (SLIDES + '<geom type="cylinder" size=".05 .04" condim="1"/>', 0.04),
    "hull": (SLIDES + '<geom type="mesh" mesh="octahedron" condim="1"/>', 0.05),
}
"""Joints and geom, and how far it reaches below its centre."""
PYRAMID = 'vertex="-.1 -.1 0 .1 -.1 0 .1 .1 0 -.1 .1 0 0 0 .1" face="0 2 1 0 3 2 0 1 4 1 2 4 2 3 4 3 0 4"'  # a square base and four sides


@cache
def model(kind: str, points: int, glider: str) -> stepper.Model:
    line = np.linspace(-HALF, HALF, points)
    x, y = np.meshgrid(line, line)
    z = BEND * (HALF**2 - y**2)
    if kind == "hfield":
        # MuJoCo reads rows from the far side.
        numbers = " ".join(map(repr, (z[::-1] / z.max()).ravel().tolist()))
        size = f"{HALF} {HALF} {float(z.max())!r} .1"
        asset = f'<hfield name="ground" nrow="{points}" ncol="{points}" size="{size}" elevation="{numbers}"/>'
    else:
        corner = np.arange(points**2).reshape(points, points)
        p, q, s, t = corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]
        faces = [p, q, s, p, s, t] if kind == "mesh" else [p, q, t, q, s, t]
        vertices = " ".join(map(repr, np.stack([x, y, z], axis=-1).ravel().tolist()))
        asset = f'<mesh name="ground" inertia="shell" vertex="{vertices}" face="{" ".join(map(str, np.stack(faces, axis=-1).ravel()))}"/>'
    ground = '<geom type="hfield" hfield="ground" condim="1"/>' if kind == "hfield" else '<geom type="mesh" mesh="ground" condim="1"/>'
    octahedron = '<mesh name="octahedron" vertex=".05 0 0 -.05 0 0 0 .05 0 0 -.05 0 0 0 .05 0 0 -.05"/>'
    loaded = stepper.load(f"""<mujoco><asset>{asset}{octahedron}</asset><worldbody>{ground}
        <body><inertial pos="0 0 0" mass="1" diaginertia=".004 .004 .004"/>{GLIDERS[glider][0]}</body></worldbody></mujoco>""")
    return loaded if kind == "hfield" else loaded.replace(geom_concave=[1.0, 0.0])


def along_the_crest(ground: tuple[str, int], glider: str, timestep: float, integrator: str, speed: float) -> float:
    """Share of the kinetic energy that is left after 0.3 s."""
    options = stepper.Options(timestep=timestep, integrator=integrator)
    sim = stepper.Stepper(model(*ground, glider), options=options)
    top = BEND * HALF**2 + GLIDERS[glider][1]
    if sim.model.nv == 6:
        sim.set_state([-0.3, 0, top, 1, 0, 0, 0], [speed, 0, 0, 0, 0, 0])
    else:
        sim.set_state([-0.3, top], [speed, 0])
    sim.step(nstep=round(0.3 / timestep))
    assert not np.any(sim.status)
    up, v = sim.qpos[2 if sim.model.nv == 6 else 1] - top, sim.qvel[: 3 if sim.model.nv == 6 else 2]
    return float(v @ v / 2 + G * up) / (speed**2 / 2)


@every(integrator=["euler", "midpoint"], ground=GROUNDS)
def test_a_ball_glides_along_a_crest_for_ever(ground, integrator):
    for timestep in (1e-3, 2e-3, 5e-3, 1e-2):
        for speed in (0.1, 0.5, 1.0):
            # Heights of assets are in single precision, and a ball on a crest is in no stable balance.
            assert along_the_crest(ground, "ball", timestep, integrator, speed) == pytest.approx(1, abs=1e-5)


@every(glider=GLIDERS, kind=KINDS)
def test_whatever_glides_along_a_crest_is_not_braked(kind, glider):
    for timestep in (2e-3, 1e-2):
        # Where it rests, assets in single precision decide; the energy of 1e-7 m of height is 1e-5 of the kinetic.
        assert along_the_crest((kind, 41), glider, timestep, "midpoint", 0.5) == pytest.approx(1, abs=1e-4)


@every(concave=[False, True], joint=["<freejoint/>", '<joint type="slide" axis="0 0 1"/>'])
def test_a_mesh_that_does_not_rotate_stays_on_a_plane(joint, concave):
    """Without rotation a plane's infinite size must not spoil the bound on the approach: 0 times infinity is NaN."""
    model = stepper.load(f"""
    <mujoco><option timestep=".005"/><asset><mesh name="pyramid" {PYRAMID}/></asset><worldbody>
      <geom type="plane" size="5 5 .1"/>
      <body pos="0 0 .1">{joint}<inertial pos="0 0 .03" mass="1" diaginertia=".01 .01 .01"/><geom type="mesh" mesh="pyramid"/></body>
    </worldbody></mujoco>""")
    sim = stepper.Stepper(model.replace(geom_concave=[False, concave]), 2)
    for _ in range(100):
        sim.step()
    height = sim.qpos[:, 2] if "free" in joint else sim.qpos[:, 0] + 0.1
    np.testing.assert_allclose(height, 0.0, atol=1e-6)  # of 1 m after a fall of 0.5 s
    assert not np.any(sim.status)


# Surfaces that no degree of freedom moves: bodies that the user carries, and conveyors.

DT = 2e-3
PADDLE = """<mujoco><option gravity="0 0 0"/><worldbody>
  <body name="paddle" mocap="true" pos="-1 0 0"><geom type="box" size=".1 .5 .5" friction="0 0 0"/></body>
  <body name="ball" pos="0 0 0"><freejoint/><geom type="sphere" size=".2" mass="2" friction="0 0 0"/></body></worldbody></mujoco>"""


@every(nstep=[1, 5], integrator=["midpoint", "euler", "implicit"])
def test_a_paddle_pushes_a_ball_with_its_own_speed(integrator, nstep):
    """It is never overlapped, not even when the user moves it at a control's rate of five steps, and the ball moves as it does."""
    sim = simulate(PADDLE, timestep=DT, integrator=integrator)
    speed = 0.8
    sim.step(nstep=nstep)
    for k in range(1, 1000 // nstep):
        sim.mocap_pos[0, 0] = -1 + speed * k * nstep * DT
        sim.step(nstep=nstep)
        assert sim.qpos[0] - sim.mocap_pos[0, 0] > 0.3 - 2e-5  # m: the slop and what is left of an impact.
    assert sim.qvel[0] == pytest.approx(speed, rel=1e-9)
    assert np.abs(np.delete(sim.qvel, 0)).max() < 1e-12


def test_a_tray_carries_by_friction():
    """A tray that starts with a < mu g carries a box without slip; one that starts with a > mu g gives it mu g."""
    text = """<mujoco><worldbody><body mocap="true"><geom type="plane" size="1 1 1" friction=".5 0 0"/></body>
      <body pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" friction=".5 0 0"/></body></worldbody></mujoco>"""
    for acceleration, expected in [(2.0, 2.0), (9.0, 0.5 * 9.81)]:
        sim = simulate(text, timestep=DT)
        sim.step(nstep=100)  # Settle.
        start, count = sim.qvel[0], 100
        for k in range(1, count + 1):
            sim.mocap_pos[0, 0] = acceleration * (k * DT) ** 2 / 2
            sim.step()
        # The finite difference is the velocity of the middle of the step: half a step of acceleration is not there yet.
        assert sim.qvel[0] - start == pytest.approx(expected * (count - 0.5) * DT, rel=6e-3)


@pytest.mark.parametrize("integrator", ["midpoint", "euler"])
def test_a_conveyor_transports_at_belt_speed(integrator):
    text = """<mujoco><worldbody><geom type="plane" size="1 1 1" surfacevel=".7 .2 5 0 0 0" friction=".6 0 0"/>
      <body pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" friction=".6 0 0"/></body></worldbody></mujoco>"""
    sim = simulate(text, timestep=DT, integrator=integrator, steps=1000)
    assert sim.qvel[:2] == pytest.approx([0.7, 0.2], abs=1e-9)
    # The normal part of a surface velocity pushes nothing.
    assert abs(sim.qvel[2]) < 1e-9
    assert sim.qpos[2] == pytest.approx(0.1, abs=2e-5)


def test_after_a_reset_a_mocap_body_is_where_it_is_put():
    """The jump from the old episode to the new is no motion."""
    sim = simulate(PADDLE, timestep=DT, steps=1)
    sim.reset()
    sim.mocap_pos[0, 0] = -0.3
    sim.step()
    assert abs(sim.qvel[0]) < 1e-9


def test_the_last_pose_is_state():
    """Continuing from a saved state repeats the push of a paddle in motion, bit for bit."""

    def run(sim, first, last):
        for k in range(first, last):
            sim.mocap_pos[0, 0] = -0.5 + 0.8 * k * DT
            sim.step()
        return sim.qpos.copy(), sim.qvel.copy()

    sim, other = simulate(PADDLE, timestep=DT), simulate(PADDLE, timestep=DT)
    run(sim, 0, 150)
    other.set_state(sim.get_state())
    for a, b in zip(run(sim, 150, 300), run(other, 150, 300), strict=True):
        assert np.array_equal(a, b)


# A box in a square hole of a concave mesh: it slides down along the walls, whatever touches.

PEG, HEIGHT, DEPTH, OUTER = 0.02, 0.04, 0.05, 0.06
"""Half width and half height of the peg, depth of the hole, half width of the block, m."""


def block(hole: float) -> tuple[list, list]:
    """Vertices and faces of a square block with a square hole of a half width through it; its top is at z = 0."""
    square = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    vertices = [(half * x, half * y, z) for z in (0.0, -DEPTH) for half in (OUTER, hole) for x, y in square]
    faces = []
    for k in range(4):
        n = (k + 1) % 4
        top, bottom = ([k, n, 4 + n, 4 + k], [12 + k, 12 + n, 8 + n, 8 + k])
        for a, b, c, d in (top, bottom, [8 + k, 8 + n, n, k], [4 + k, 4 + n, 12 + n, 12 + k]):
            faces += [(a, b, c), (a, c, d)]
    return vertices, faces


@cache
def block_and_peg(clearance: float, friction: float = 0.1, timestep: float = 5e-3) -> stepper.Model:
    """The block over a floor, and a peg with this much room on each side."""
    vertices, faces = block(PEG + clearance)
    numbers = [" ".join(repr(float(x)) for v in vertices for x in v), " ".join(str(k) for f in faces for k in f)]
    text = f"""<mujoco><option timestep="{timestep}"/><asset><mesh name="block" vertex="{numbers[0]}" face="{numbers[1]}"/></asset>
      <default><geom friction="{friction}"/></default><worldbody><geom type="plane" size="2 2 1" pos="0 0 {-DEPTH}"/>
      <geom type="mesh" mesh="block"/><body pos="0 0 .02"><freejoint/>
      <geom type="box" size="{PEG} {PEG} {HEIGHT}" mass=".2"/></body></worldbody></mujoco>"""
    return stepper.load(text).replace(geom_concave=[0.0, 1.0, 0.0])


@given(
    st.floats(0.0, 1e-4),
    st.floats(-1e-3, 1e-3),
    st.sampled_from([0.0, 0.5 * np.pi, np.pi, 1.5 * np.pi]),
    st.floats(0.005, 0.03),
    st.sampled_from(["f64", "f32"]),
)
def test_a_peg_that_overlaps_a_wall_is_no_deeper_in_the_block_than_that(overlap, yaw, side, below, precision):
    """Not in the face around the hole, under which its lower end is by centimetres."""
    clearance = 1e-3
    sim = stepper.Stepper(block_and_peg(clearance), precision=precision, options=stepper.Options(integrator="euler", timestep=1e-6))
    # A turned peg reaches further by the half of its side times the angle.
    reach = clearance + overlap - PEG * abs(yaw)
    qpos = [reach * np.cos(side), reach * np.sin(side), HEIGHT - below, np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)]
    sim.set_state(qpos=qpos)
    sim.step()
    # Rounding of positions of 0.05 m in 32 bits, and the cosine of the angle.
    assert sim.max_penetration <= overlap + 2e-8 + 0.5 * PEG * yaw**2


@every(precision=["f64", "f32"], clearance=[1e-4, 5e-4, 1e-3])
def test_a_peg_that_slides_along_the_walls_reaches_the_floor(precision, clearance):
    """From random places in the hole, turned and pushed to a side: before, a third of them jammed at the face around the hole."""
    n, rng = 128, np.random.default_rng(0)
    sim = stepper.Stepper(block_and_peg(clearance), n, precision=precision)
    qpos = np.tile(sim.model.qpos0, (n, 1))
    qpos[:, :2] += rng.uniform(-0.6, 0.6, (n, 2)) * clearance
    yaw = rng.uniform(-0.3, 0.3, n) * clearance / PEG
    qpos[:, 3], qpos[:, 6] = np.cos(yaw / 2), np.sin(yaw / 2)
    qvel = np.zeros((n, 6))
    qvel[:, :2] = rng.uniform(-0.1, 0.1, (n, 2))
    sim.set_state(qpos=qpos, qvel=qvel)
    sim.step(nstep=200)
    # On the floor to the slop of contacts.
    np.testing.assert_allclose(sim.qpos[:, 2], HEIGHT - DEPTH, atol=2e-5)


def test_a_block_of_its_size_stands_flush_on_the_mesh():
    """Its sides are in the planes of the outer walls: the corners at the edge of the top carry it all the same."""
    text = f"""<mujoco><asset><mesh name="block" vertex="{{}}" face="{{}}"/></asset><worldbody><geom type="mesh" mesh="block"/>
      <body pos="0 0 {OUTER}"><freejoint/><geom type="box" size="{OUTER} {OUTER} {OUTER}" mass="1"/></body></worldbody></mujoco>"""
    vertices, faces = block(PEG)
    text = text.format(" ".join(repr(float(x)) for v in vertices for x in v), " ".join(str(k) for f in faces for k in f))
    loaded = stepper.load(text).replace(geom_concave=[1.0, 0.0])
    for precision in ("f64", "f32"):
        sim = simulate(loaded, precision=precision, steps=500)
        assert not sim.status
        np.testing.assert_allclose(sim.qpos[:3], [0, 0, OUTER], atol=2e-5)  # The slop of contacts.


# Contact points of convex hulls: fast motion adds far points and removes none of those that touch, and thin hulls lie on the floor.

HULL_HALF = 0.01
"""Half the height of the hulls, m."""

HULL_GROUNDS = {
    "plane": '<geom type="plane" size="0 0 .1"/>',
    "box": '<geom type="box" size="1 1 .1" pos="0 0 -.1"/>',
    "field": '<geom type="hfield" hfield="field"/>',
    "mesh": '<geom type="mesh" mesh="slab" pos="0 0 -.1"/>',
}
ASSETS = """<hfield name="field" nrow="9" ncol="9" size="1 1 .1 .1"/>
<mesh name="slab" vertex="-1 -1 -.1 1 -1 -.1 1 1 -.1 -1 1 -.1 -1 -1 .1 1 -1 .1 1 1 .1 -1 1 .1"/>"""


def lying(sides: int) -> np.ndarray:
    """Corners of a regular prism along the y axis, which lies on a side face, (2 sides, 3)."""
    x, y, z = prism(sides, HULL_HALF, faces_at_half=True).T
    return np.stack([y, z, -x], axis=1)


def scene(corners: np.ndarray, ground: str, options: str) -> stepper.Model:
    return stepper.load(
        f"""<mujoco><option {options}/><default><geom friction="1.2"/></default>
        <asset>{ASSETS}<mesh name="hull" vertex="{vertices(corners)}"/></asset>
        <worldbody>{HULL_GROUNDS[ground]}
        <body pos="0 0 {HULL_HALF}"><freejoint/><geom type="mesh" mesh="hull" mass=".01"/></body></worldbody></mujoco>"""
    )


def touching_points(sim: stepper.Stepper, qpos: np.ndarray, velocity: list[float], depth: float) -> np.ndarray:
    """Contact points at this pose and velocity with a gap of at most `depth`, m, relative to the body."""
    sim.reset()
    sim.set_state(qpos=qpos, qvel=[*velocity, 0.0, 0.0, 0.0])
    sim.step()
    contacts = sim.contacts()
    return contacts["pos"][contacts["distance"] <= depth] - qpos[:3]


@settings(max_examples=60, deadline=None)
@given(
    sides=st.integers(3, 12),
    upright=st.booleans(),
    ground=st.sampled_from(sorted(HULL_GROUNDS)),
    tilt=st.sampled_from([0.0, 1e-9, 1e-6, 1e-3, 0.03, 0.3, 0.7]),
    turn=st.floats(0.0, 3.0),
    step=st.sampled_from([1e-3, 2e-3, 5e-3]),
    speed=st.floats(1.0, 20.0),
    fall=st.floats(0.0, 10.0),
)
@example(sides=6, upright=False, ground="plane", tilt=1e-3, turn=0.0, step=2e-3, speed=8.0, fall=0.0)
@example(sides=6, upright=True, ground="box", tilt=0.3, turn=0.0, step=2e-3, speed=8.0, fall=5.0)
@example(sides=6, upright=True, ground="field", tilt=0.3, turn=0.0, step=2e-3, speed=8.0, fall=5.0)
def test_a_fast_hull_has_the_contact_points_of_a_resting_one(*, sides, upright, ground, tilt, turn, step, speed, fall):
    """Contacts within the search distance at rest are contacts at any velocity, because the pose alone determines what touches."""
    # Euler's rule detects contacts at the pose before the step, which is the same for both velocities.
    corners = prism(sides, HULL_HALF) if upright else lying(sides)
    model = scene(corners, ground, f'timestep="{step}"')
    sim = stepper.Stepper(model, options=stepper.Options(timestep=step, integrator="euler"))
    # Tilted about the horizontal axis y of the body, then turned about the vertical.
    quat = np.array([np.cos(turn / 2) * np.cos(tilt / 2), -np.sin(turn / 2) * np.sin(tilt / 2), np.cos(turn / 2) * np.sin(tilt / 2), 0.0])
    quat[3] = np.sin(turn / 2) * np.cos(tilt / 2)
    w, x, y, z = quat
    rows = np.array([[2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])
    lowest = (corners @ rows.T).min()
    # A micrometre of overlap.
    qpos = np.array([0.003, 0.001, -lowest - 1e-6, *quat])
    # Half of what gravity covers in a step. Points that are listed at rest have a gap of up to all of it.
    depth = 0.5 * 9.81 * step**2
    at_rest = touching_points(sim, qpos, [0.0, 0.0, 0.0], depth)
    moving = touching_points(sim, qpos, [speed, 0.3 * speed, -fall], depth)
    assert len(at_rest) >= 1
    # Positions of contacts round by 1e-9 m.
    distances = np.linalg.norm(at_rest[:, None] - moving[None], axis=2)
    assert (distances.min(axis=1) < 1e-8).all(), (at_rest, moving)


@every(ground=sorted(HULL_GROUNDS), speed=[2.0, 8.0, 30.0])
def test_a_prism_that_falls_on_an_edge_touches_with_both_ends_of_it(ground, speed):
    """Both ends of the lowest edge are contacts, however far the body moves in the step."""
    corners = prism(6, HULL_HALF)
    sim = stepper.Stepper(scene(corners, ground, 'timestep=".002"'), options=stepper.Options(timestep=2e-3, integrator="euler"))
    tilt = 0.2
    lowest = (corners @ [0.0, np.sin(tilt), np.cos(tilt)]).min()
    sim.set_state(qpos=[0, 0, -lowest + 1e-4, np.cos(tilt / 2), np.sin(tilt / 2), 0, 0], qvel=[0, 0, -speed, 0, 0, 0])
    sim.step()
    contacts = sim.contacts()
    ends = contacts["pos"][contacts["distance"] < 1.1e-4]
    # Each end is at half the length of an edge of the hexagon, which is the radius.
    assert sorted(round(float(x), 6) for x in np.unique(ends[:, 0].round(7))) == [-HULL_HALF / 2, HULL_HALF / 2]


@every(step=[1e-3, 2e-3, 5e-3], shape=["box", "mesh"])
def test_the_rotation_of_a_cube_that_slides_does_not_depend_on_its_speed(shape, step):
    """A cube of 2 cm with friction 1.2 tips while it slides: friction is mu times the normal force at every speed."""
    geom = f'type="box" size="{HULL_HALF} {HULL_HALF} {HULL_HALF}"' if shape == "box" else 'type="mesh" mesh="cube"'
    model = stepper.load(
        f"""<mujoco><option timestep="{step}"/><default><geom friction="1.2"/></default>
        <asset><mesh name="cube" vertex="{cuboid(HULL_HALF, HULL_HALF, HULL_HALF)}"/></asset><worldbody><geom type="plane" size="0 0 .1"/>
        <body pos="0 0 {HULL_HALF}"><freejoint/><geom {geom} mass=".01"/></body></worldbody></mujoco>"""
    )
    angles = []
    for speed in (2.0, 4.0, 8.0, 16.0):
        sim = simulate(model, tolerance=1e-6, qvel=[speed, 0, 0, 0, 0, 0], steps=round(0.06 / step))
        angles.append(2 * np.arccos(abs(float(sim.qpos[3]))))
    assert min(angles) > 0.1
    # A solver residual of 1e-6 m/s, over 60 ms and an arm of 1 cm, is an angle of 6e-6.
    np.testing.assert_allclose(angles, angles[0], atol=2e-5)


@pytest.mark.parametrize("thickness", [1.0, 1e-2, 3e-4, 1e-4, 1e-5, 1e-6, 1e-8, 1e-12])
def test_a_hull_of_any_thickness_lies_on_the_floor(thickness):
    points = np.random.default_rng(0).uniform(-1, 1, (250, 3)) * [thickness, 1, 1]
    vertices = " ".join(map(repr, points.ravel().tolist()))
    sim = stepper.Stepper(
        stepper.load(f"""
    <mujoco>
      <asset><mesh name="leaf" vertex="{vertices}"/></asset>
      <worldbody>
        <geom type="plane" size="1 1 1"/>
        <body euler="0 90 0" pos="0 0 {thickness + 0.01}"><freejoint/><inertial pos="0 0 0" mass="1" diaginertia=".5 .3 .3"/>
          <geom type="mesh" mesh="leaf"/></body>
      </worldbody>
    </mujoco>""")
    )
    sim.step(nstep=1000)
    assert not sim.status
    assert len(sim.contacts()) >= 3
    # It lies on its flat side, its centre no further from the floor than it is thick, up to MuJoCo's vertices in single precision.
    assert abs(sim.qpos[2]) < thickness + 1e-5
    assert np.abs(sim.qvel).max() < 1e-3
