"""Contact forces of what rests are its weight, at every time step, in both precisions and by both laws of contact.

A solver that leaves a velocity in every step leaves a force error of the mass times that velocity over the time step; so do positions that
are rounded, where a gap that is rounding closes within a step.
"""

import mujoco
import numpy as np
import pytest
import stepper
from hypothesis import given
from hypothesis import strategies as st
from models import SOURCES, force_of_world

G = 9.81
BOUND = 0.01  # Of the weight: what the tolerance of a short step may leave is 0.6 % of it.
TIMESTEPS = [1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2]
FREE = "<body pos='{pos}'><freejoint/>{geoms}</body>"
LEG = """<body pos="{x} {y} 0"><joint axis="0 1 0" damping="5" stiffness="3e3"/>
  <geom type="capsule" size=".02" fromto="0 0 0 0 0 -.2" mass=".5"/>
  <body pos="0 0 -.2"><geom size=".023" mass=".25"/></body></body>"""


TRIPOD = [".2 0 -.28", "-.1 .17 -.28", "-.1 -.17 -.28"]


def box(mass, half=0.1, pos="0 0 0"):
    return f'<geom type="box" size="{half} {half} {half}" mass="{mass}" pos="{pos}"/>'


# Name: bodies, and the mass that the world carries.
SCENES = {
    "sphere": (FREE.format(pos="0 0 .1", geoms='<geom size=".1" mass="10"/>'), 10),
    "cube": (FREE.format(pos="0 0 .1", geoms=box(10)), 10),
    "cube far away": (FREE.format(pos="8 -7 .1", geoms=box(10)), 10),
    "capsule": (FREE.format(pos="0 0 .1", geoms='<geom type="capsule" size=".1 .2" euler="0 90 0" mass="10"/>'), 10),
    "cylinder": (FREE.format(pos="0 0 .1", geoms='<geom type="cylinder" size=".1 .1" mass="10"/>'), 10),
    "welded foot": (FREE.format(pos="0 0 .5", geoms=box(9) + f'<body pos="0 0 -.45">{box(1, 0.05)}</body>'), 10),
    "three balls as feet": (
        FREE.format(pos="0 0 .3", geoms=box(9) + "".join(f'<geom size=".02" pos="{p}" mass=".1"/>' for p in TRIPOD)),
        9.3,
    ),
    "stacked boxes": ("".join(FREE.format(pos=f"0 0 {z}", geoms=box(10)) for z in (0.1, 0.3, 0.5)), 30),
    "box on a box": ('<geom type="box" size="1 1 .1" pos="0 0 .1"/>' + FREE.format(pos="0 0 .3", geoms=box(10)), 10),
    "ball in a groove": (
        '<geom type="box" size="1 .05 .5" euler="45 0 0" pos="0 .4 .2"/><geom type="box" size="1 .05 .5" euler="-45 0 0" pos="0 -.4 .2"/>'
        + FREE.format(pos="0 0 .11", geoms='<geom size=".1" mass="10"/>'),
        10,
    ),
    "sprung legs": (FREE.format(pos="0 0 .223", geoms=box(6) + "".join(LEG.format(x=x, y=y) for x in (-0.2, 0.2) for y in (-0.1, 0.1))), 9),
}  # fmt: skip


def stepping(bodies, contact, precision, timestep, gravity=G):
    source = f'<mujoco><option gravity="0 0 {-gravity}"/><worldbody><geom type="plane" size="9 9 1"/>{bodies}</worldbody></mujoco>'
    options = stepper.Options(contact=contact, timestep=timestep)
    return stepper.Stepper(stepper.load(source), options=options, precision=precision)


def errors(sim, weight, steps):
    """Largest relative errors of what the world carries, by the sum of its contacts and by its contact force, over some steps."""
    worst = np.zeros(2)
    for _ in range(steps):
        sim.step()
        carried = np.array([force_of_world(sim.contacts())[2], -sim.body_contact_force[0, 2]])
        worst = np.maximum(worst, np.abs(carried / weight - 1))
    return worst


@pytest.mark.parametrize("precision", ["f32", "f64"])
@pytest.mark.parametrize("contact", ["hard", "mujoco"])
@pytest.mark.parametrize("name", SCENES)
def test_what_rests_is_carried_with_its_weight(name, contact, precision):
    bodies, mass = SCENES[name]
    for timestep in TIMESTEPS:
        sim = stepping(bodies, contact, precision, timestep)
        sim.step(nstep=round(0.8 / timestep))
        assert (errors(sim, mass * G, 100) < BOUND).all(), timestep


@pytest.mark.parametrize(("name", "contact"), [("ant", "hard"), ("ant", "mujoco"), ("humanoid", "mujoco")])
def test_robots_that_lie_are_carried_with_their_weight_at_short_steps(name, contact):
    """Many links on the floor: what closes a gap of rounding within a step of 0.1 ms would be a fifth of the weight.

    The humanoid comes to rest by MuJoCo's law alone within the time; by hard contact it still rolls.
    """
    compiled = mujoco.MjModel.from_xml_path(str(SOURCES[f"gymnasium/{name}"]))
    compiled.dof_damping[:] *= 3
    model, weight = stepper.load(compiled, strict=False), compiled.body_mass.sum() * G
    settled = stepper.Stepper(model, options=stepper.Options(contact=contact, timestep=2e-3), precision="f32")
    settled.step(nstep=4000)
    for timestep in (1e-4, 5e-4):
        sim = stepper.Stepper(model, options=stepper.Options(contact=contact, timestep=timestep), precision="f32")
        sim.set_state(qpos=settled.qpos, qvel=settled.qvel)
        sim.step(nstep=round(1.0 / timestep))
        assert (errors(sim, weight, 300) < BOUND).all(), timestep


@given(
    shape=st.sampled_from(["sphere", "box", "capsule"]),
    mass=st.floats(0.01, 100),
    size=st.floats(0.02, 0.3),
    x=st.floats(-20, 20),
    gravity=st.floats(1.5, 25),
    timestep=st.floats(-4, -2).map(lambda e: 10**e),
    contact=st.sampled_from(["hard", "mujoco"]),
)
def test_whatever_rests_is_carried_with_its_weight(shape, contact, **numbers):
    mass, size, x, gravity, timestep = (numbers[name] for name in ("mass", "size", "x", "gravity", "timestep"))
    sizes = {"sphere": f"{size}", "box": f"{size} {size} {size}", "capsule": f"{size} {size}"}
    turned = 'euler="0 90 0"' if shape == "capsule" else ""
    geom = f'<geom type="{shape}" size="{sizes[shape]}" mass="{mass}" {turned}/>'
    for precision in ("f32", "f64"):
        sim = stepping(FREE.format(pos=f"{x} {-x / 2} {size}", geoms=geom), contact, precision, timestep, gravity)
        # MuJoCo's default contact has a time constant of 20 ms.
        sim.step(nstep=round(0.5 / timestep))
        assert (errors(sim, mass * gravity, 40) < BOUND).all()


def test_the_default_tolerance_of_short_steps_is_a_share_of_gravity():
    def tolerance(precision, timestep, **options):
        model = stepper.load("<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>")
        return stepper.Stepper(model, options=stepper.Options(timestep=timestep, **options), precision=precision).tolerance

    assert tolerance("f32", 1e-4, contact="mujoco") == pytest.approx(6e-3 * 9.81 * 1e-4)
    assert tolerance("f32", 5e-3, contact="mujoco") == 1e-4
    assert tolerance("f64", 1e-4, contact="mujoco") == 1e-6
    assert tolerance("f64", 1e-5, contact="mujoco") == 1e-6
    assert tolerance("f32", 1e-4, contact="mujoco", tolerance=1e-3) == 1e-3
