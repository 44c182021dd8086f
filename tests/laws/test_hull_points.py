"""Contact points of convex hulls: fast motion adds far points and removes none of those that touch, and thin hulls lie on the floor."""

import numpy as np
import pytest
import stepper
from hypothesis import example, given, settings
from hypothesis import strategies as st
from meshes import cuboid, prism, vertices

HALF = 0.01
"""Half the height of the hulls, m."""

GROUNDS = {
    "plane": '<geom type="plane" size="0 0 .1"/>',
    "box": '<geom type="box" size="1 1 .1" pos="0 0 -.1"/>',
    "field": '<geom type="hfield" hfield="field"/>',
    "mesh": '<geom type="mesh" mesh="slab" pos="0 0 -.1"/>',
}
ASSETS = """<hfield name="field" nrow="9" ncol="9" size="1 1 .1 .1"/>
<mesh name="slab" vertex="-1 -1 -.1 1 -1 -.1 1 1 -.1 -1 1 -.1 -1 -1 .1 1 -1 .1 1 1 .1 -1 1 .1"/>"""


def lying(sides: int) -> np.ndarray:
    """Corners of a regular prism along the y axis, which lies on a side face, (2 sides, 3)."""
    x, y, z = prism(sides, HALF, faces_at_half=True).T
    return np.stack([y, z, -x], axis=1)


def scene(corners: np.ndarray, ground: str, options: str) -> stepper.Model:
    return stepper.load(
        f"""<mujoco><option {options}/><default><geom friction="1.2"/></default>
        <asset>{ASSETS}<mesh name="hull" vertex="{vertices(corners)}"/></asset>
        <worldbody>{GROUNDS[ground]}
        <body pos="0 0 {HALF}"><freejoint/><geom type="mesh" mesh="hull" mass=".01"/></body></worldbody></mujoco>"""
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
    ground=st.sampled_from(sorted(GROUNDS)),
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
    """Contacts within the search distance at rest are contacts at any velocity, because the pose alone determines what touches.

    Euler's rule detects contacts at the pose before the step, which is the same for both velocities.
    """
    corners = prism(sides, HALF) if upright else lying(sides)
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


@pytest.mark.parametrize("ground", sorted(GROUNDS))
@pytest.mark.parametrize("speed", [2.0, 8.0, 30.0])
def test_a_prism_that_falls_on_an_edge_touches_with_both_ends_of_it(ground, speed):
    """Both ends of the lowest edge are contacts, however far the body moves in the step."""
    corners = prism(6, HALF)
    sim = stepper.Stepper(scene(corners, ground, 'timestep=".002"'), options=stepper.Options(timestep=2e-3, integrator="euler"))
    tilt = 0.2
    lowest = (corners @ [0.0, np.sin(tilt), np.cos(tilt)]).min()
    sim.set_state(qpos=[0, 0, -lowest + 1e-4, np.cos(tilt / 2), np.sin(tilt / 2), 0, 0], qvel=[0, 0, -speed, 0, 0, 0])
    sim.step()
    contacts = sim.contacts()
    ends = contacts["pos"][contacts["distance"] < 1.1e-4]
    # Each end is at half the length of an edge of the hexagon, which is the radius.
    assert sorted(round(float(x), 6) for x in np.unique(ends[:, 0].round(7))) == [-HALF / 2, HALF / 2]


@pytest.mark.parametrize("step", [1e-3, 2e-3, 5e-3])
@pytest.mark.parametrize("shape", ["box", "mesh"])
def test_the_rotation_of_a_cube_that_slides_does_not_depend_on_its_speed(shape, step):
    """A cube of 2 cm with friction 1.2 tips while it slides: friction is mu times the normal force at every speed."""
    geom = f'type="box" size="{HALF} {HALF} {HALF}"' if shape == "box" else 'type="mesh" mesh="cube"'
    model = stepper.load(
        f"""<mujoco><option timestep="{step}"/><default><geom friction="1.2"/></default>
        <asset><mesh name="cube" vertex="{cuboid(HALF, HALF, HALF)}"/></asset><worldbody><geom type="plane" size="0 0 .1"/>
        <body pos="0 0 {HALF}"><freejoint/><geom {geom} mass=".01"/></body></worldbody></mujoco>"""
    )
    angles = []
    for speed in (2.0, 4.0, 8.0, 16.0):
        sim = stepper.Stepper(model, options=stepper.Options(tolerance=1e-6))
        sim.set_state(qvel=[speed, 0, 0, 0, 0, 0])
        sim.step(nstep=round(0.06 / step))
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
