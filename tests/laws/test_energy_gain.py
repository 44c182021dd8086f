"""Energy: steps that make energy by their own error say UNRESOLVED, and no others do; impossible demands add no energy."""

import re

import mujoco
import numpy as np
import pytest
import stepper
from checks import every
from hypothesis import given, settings, strategies as st
from models import samples, simulate, stepper_model
from scenes import OVERLAP, SLOT
from stepper import Options, Status

UNRESOLVED = stepper.Status.UNRESOLVED
WINDOW = 0.1
"""s"""
SPINNING = """<mujoco><option gravity="0 0 0"/><worldbody><body><freejoint/><geom type="box" size=".1 .2 .05" mass="1"/></body>
  <body pos="2 0 0"><joint type="ball"/><geom type="box" size=".1 .02 .05" pos=".1 0 .05" mass="1"/></body></worldbody></mujoco>"""
RANGE = """<mujoco><option gravity="0 0 0" timestep=".01"/><worldbody><body><joint axis="0 1 0" range="-60 0"/>
<geom type="capsule" size=".02" fromto="0 0 0 .3 0 0"/></body></worldbody></mujoco>"""


def chain(links: int, length: float, mass: float, weight: float, joint: str = '<joint axis="0 1 0"/>') -> str:
    """Links in a row that nothing touches, held at one end, with a weight at the other."""
    ghost = 'contype="0" conaffinity="0"'
    text = ""
    for k in range(links):
        text += f'<body pos="{length if k else 0} 0 0">{joint}'
        text += f'<geom type="capsule" size=".01" fromto="0 0 0 {length} 0 0" mass="{mass}" {ghost}/>'
    weight = f'<geom type="sphere" size=".1" pos="{length} 0 0" mass="{weight}" {ghost}/>'
    return f"<mujoco><worldbody>{text}{weight}{'</body>' * links}</worldbody></mujoco>"


def swing(text: str, timestep: float, seconds: float, precision: str = "f64", integrator: str = "midpoint") -> tuple[float, bool]:
    """Largest growth of the energy of a falling chain within 0.1 s, relative to the largest kinetic energy of that time, and the flag."""
    sim = simulate(text, precision=precision, timestep=timestep, integrator=integrator)
    energies, kinetic, flagged = [sum(sim.energy())], [0.0], False
    for _ in range(round(seconds / timestep)):
        sim.step()
        potential, moving = sim.energy()
        energies.append(potential + moving)
        kinetic.append(moving)
        flagged |= bool(sim.status & UNRESOLVED)
    width = round(WINDOW / timestep)
    grown = [energies[k + width] - energies[k] for k in range(len(energies) - width)]
    most = [max(kinetic[k : k + width + 1]) for k in range(len(grown))]
    return max(g / max(m, 1e-3 * max(kinetic)) for g, m in zip(grown, most, strict=True)), flagged


@every(integrator=["midpoint", "implicit"], precision=["f64", "f32"])
@pytest.mark.parametrize(("links", "timestep", "seconds"), [
    ((40, 0.05, 0.02), 2e-3, 5.0),
    ((40, 0.05, 0.05), 2e-3, 4.5),
    ((40, 0.025, 0.05), 2e-3, 3.0),
    ((20, 0.05, 0.02), 2e-3, 2.0),
    ((30, 0.05, 0.02), 3e-3, 3.0),
])  # fmt: skip
def test_a_whipping_chain_that_gains_energy_says_so(links, timestep, seconds, precision, integrator):
    """With 5 kg at its end; before, it gained up to its whole kinetic energy with status 0."""
    grown, flagged = swing(chain(*links, 5.0), timestep, seconds, precision, integrator)
    assert grown > 0.1
    assert flagged


@every(start=range(4), timestep=[2e-3, 3e-3])
def test_the_implicit_rule_is_flagged_before_a_chain_has_a_third_more_energy(start, timestep):
    """The error of the energy is less than a third of that of the fall: 40 links of 0.1 m with 5 kg at the end."""
    sim = simulate(chain(40, 0.1, 0.02, 5.0), timestep=timestep, integrator="implicit")
    sim.set_state(np.random.default_rng(start).uniform(-0.2, 0.2, sim.model.nq))
    before, fall = sum(sim.energy()), 9.81 * 5 * 4
    for _ in range(round(2 / timestep)):
        sim.step()
        if sim.status & UNRESOLVED:
            assert re.fullmatch(r"fastest joint \d+", sim.worst_row())
            return
        assert sum(sim.energy()) - before < fall / 3


def test_an_error_prevents_a_gain_that_is_too_slow_for_the_flag():
    """A chain of 40 links gains more than 5 % of the energy of its fall before the flag, with error=1e-3 less than 0.1 %."""
    gains = {}
    for error in (None, 1e-3):
        sim = simulate(chain(40, 0.05, 0.02, 5.0), timestep=3e-3, error=error)
        start, fall, most, flagged_at = sum(sim.energy()), 9.81 * 5.0 * 2.0, 0.0, np.inf
        while sim.time < 2.5 and sim.time < flagged_at:
            sim.step()
            most = max(most, (sum(sim.energy()) - start) / fall)
            flagged_at = sim.time if sim.status & UNRESOLVED else np.inf
        gains[error] = most
    # Last bits decide when the chain whips, and how much it gains by then.
    assert gains[None] > 0.05
    assert gains[1e-3] < 1e-3


@pytest.mark.parametrize(("text", "timestep"), [
    (chain(3, 0.3, 1.0, 1.0), 2e-3),
    (chain(40, 0.1, 0.1, 5.0), 2e-3),
    (chain(40, 0.05, 0.1, 5.0), 5e-4),
    (chain(2, 0.3, 1.0, 1.0, '<joint type="ball"/>'), 2e-3),
])  # fmt: skip
def test_a_chain_whose_energy_is_right_is_not_flagged(text, timestep):
    """Right: it grows by less than a fiftieth of the kinetic energy within 0.1 s, and by less than that again at a tenth of the step."""
    grown, flagged = swing(text, timestep, 2.0)
    assert grown < 0.02
    assert not flagged


@pytest.mark.parametrize("name", [
    "gymnasium/walker2d", "gymnasium/humanoid", "gymnasium/ant", "dm_control/humanoid", "dm_control/quadruped",
])  # fmt: skip
@every(precision=["f64", "f32"], integrator=["midpoint", "implicit"])
def test_robots_under_random_control_are_not_flagged(name, integrator, precision):
    """At 2 ms, a tenth of which changes their energy by less than 1 %: walkers that fall, limbs that strike their limits."""
    model = stepper_model(name)
    sim = stepper.Stepper(model, 8, precision=precision, options=stepper.Options(timestep=2e-3, integrator=integrator))
    rng = np.random.default_rng(2)
    for _ in range(40):
        sim.step(rng.uniform(-1, 1, (8, model.nu)), nstep=25)
        assert not (sim.status & UNRESOLVED).any()


@pytest.mark.parametrize("integrator", ["midpoint", "implicit", "euler"])
def test_every_step_that_is_too_long_names_a_joint(integrator):
    """Humanoids with random, high velocities: joints whose constraint is the cause are named by it, others as the fastest."""
    model = stepper_model("gymnasium/humanoid")
    sim = stepper.Stepper(model, 32, options=stepper.Options(timestep=0.02, integrator=integrator))
    rng, flagged = np.random.default_rng(0), 0
    sim.set_state(qvel=rng.normal(scale=20, size=(32, model.nv)))
    for _ in range(20):
        sim.step()
        for env in np.flatnonzero(sim.status & UNRESOLVED):
            assert sim.worst_row(int(env)) is not None
            flagged += 1
    assert flagged > 10


@pytest.mark.parametrize(("links", "timestep"), [(5, 1e-2), (10, 5e-3)])
def test_a_chain_by_runge_kutta_has_the_flags_that_it_has_alone(links, timestep):
    """Also if a box rests on the floor: the step of the midpoint rule, which Runge-Kutta replaces, is not judged."""
    flags = []
    for box in (
        "",
        '<geom type="plane" size="9 9 1" pos="0 0 -9"/><body pos="9 0 -8.9"><freejoint/><geom type="box" size=".1 .1 .1"/></body>',
    ):
        text = chain(links, 1.0 / links, 0.02, 5.0).replace("<worldbody>", f"<worldbody>{box}")
        sim = simulate(text, timestep=timestep, integrator="rk4")
        flags.append([])
        for _ in range(round(0.8 / timestep)):
            sim.step()
            flags[-1].append(bool(sim.status & UNRESOLVED))
    assert flags[0] == flags[1]
    assert any(flags[0])


@given(st.integers(0, 2**32 - 1), st.sampled_from(["f64", "f32"]))
def test_bodies_that_tumble_alone_are_not_flagged(seed, precision):
    """Up to a third of a radian a step: the midpoint rule keeps their energy, which the balance of a corrector would not know."""
    sim = simulate(SPINNING, precision=precision, timestep=5e-3)
    sim.set_state(qvel=np.random.default_rng(seed).uniform(-30, 30, sim.model.nv))
    start = sum(sim.energy())
    sim.step(nstep=100)
    assert not sim.status & UNRESOLVED
    # The rule's energy oscillates by (h omega)^2 / 10.
    assert sum(sim.energy()) == pytest.approx(start, rel=0.05)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=10)
def test_work_that_somebody_does_is_no_gain(seed):
    """A double pendulum driven by user forces, a motor and a servo, thrown against its limits: energy comes from these alone."""
    model = stepper.load("""<mujoco><worldbody><body pos="0 0 1"><joint name="a" axis="0 1 0" limited="true" range="-120 120"/>
      <geom type="capsule" size=".02" fromto="0 0 0 .3 0 0"/><body pos=".3 0 0"><joint name="b" axis="0 1 0" damping=".1"/>
      <geom type="capsule" size=".02" fromto="0 0 0 .3 0 0"/></body></body></worldbody>
      <actuator><motor joint="a" gear="3"/><position joint="b" kp="2"/></actuator></mujoco>""")
    sim, rng = stepper.Stepper(model, options=stepper.Options(timestep=2e-3)), np.random.default_rng(seed)
    for _ in range(100):
        sim.qfrc_applied[:] = rng.normal(scale=0.5, size=2)
        sim.step(rng.uniform(-1, 1, 2), nstep=5)
        assert not sim.status & UNRESOLVED


# Positions that cannot be corrected, or only by absurd motion: what is moved stays bounded, no energy comes of it, and a flag says so.

HINGE, BALL = 'axis="0 1 0" damping=".01"', 'type="ball" damping=".01"'


def solved(sim: stepper.Stepper) -> int:
    """What the solver says of a step. That these scenes are deep in one another, and beyond limits, is how they begin."""
    return int(sim.status) & ~(Status.DEEP | Status.OVER_LIMIT | Status.EQUALITY_VIOLATED)


@every(stabilization=["split", "baumgarte", "none"], integrator=["midpoint", "euler", "implicit"])
@pytest.mark.parametrize("joint", [HINGE, BALL], ids=["hinge", "ball"])
@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_a_normal_that_passes_a_joint_moves_nothing(joint, integrator, stabilization, precision):
    xml = OVERLAP.format(joint=joint)
    sim = stepper.Stepper(stepper.load(xml), options=Options(integrator=integrator, stabilization=stabilization), precision=precision)
    model = mujoco.MjModel.from_xml_string(xml)
    data, flags, fastest, peer = mujoco.MjData(model), 0, 0.0, 0.0
    for _ in range(500):
        sim.step()
        mujoco.mj_step(model, data)
        flags |= solved(sim)
        fastest, peer = max(fastest, float(np.abs(sim.qvel).max())), max(peer, float(np.abs(data.qvel).max()))
    # A damped pendulum of the same swing in both: time integration differs by some h w^2 of the speed, 2 %.
    assert fastest == pytest.approx(peer, rel=0.05)
    assert not flags & ~Status.INFEASIBLE
    assert bool(flags & Status.INFEASIBLE) == (stabilization != "none")


@pytest.mark.parametrize("angle", [10, 20, 30])
def test_what_cannot_move_along_its_normal_is_said(angle):
    """A hip that is turned: the lever of the normal is rounding, of another size in every pose."""
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    xml = f"""<mujoco><worldbody><geom size=".05"/><body euler="{angle} {angle} 0"><joint axis="0 {c} {s}"/>
    <geom type="capsule" size=".02" fromto="0 0 0 .3 0 0"/></body></worldbody></mujoco>"""
    sim = simulate(xml, steps=1)
    # Gravity alone moves it: h^2 g / (2 / 3 of the rod's length) at the most.
    assert abs(float(sim.qpos[0])) < 2e-3**2 * 9.81 / 0.2
    assert solved(sim) == Status.INFEASIBLE


@pytest.mark.parametrize(("shape", "seed"), [("box", 3), ("capsule", 3)])
def test_an_unloaded_gripper_that_begins_jammed_is_solved(shape, seed):
    """Fingers coupled as those of a Panda begin within the palm: impulses and velocities of what rests are rounding."""
    rng = np.random.default_rng(seed)

    def geom(size: str) -> str:
        return f'<geom type="{shape}" size="{size}" quat="{" ".join(map(str, rng.normal(size=4)))}" pos="{{at}}"/>'

    palm, left, right = geom(".03 .02 .03"), geom(".012 .013 .03"), geom(".012 .011 .03")
    sim = stepper.Stepper(
        stepper.load(f"""<mujoco><worldbody><body>{palm.format(at="0 0 0")}
      <body pos="0 0 .05"><joint name="l" type="slide" axis="0 1 0" range="0 .04"/>{left.format(at="0 .01 0")}</body>
      <body pos="0 0 .05"><joint name="r" type="slide" axis="0 -1 0" range="0 .04"/>{right.format(at="0 -.01 0")}</body>
      </body></worldbody><equality><joint joint1="r" joint2="l"/></equality></mujoco>""")
    )
    sim.set_state(qvel=[0.01, -0.02])
    # Before that positions give way where they can.
    assert set(samples(sim, 300, lambda: solved(sim))[100:]) == {int(Status.INFEASIBLE)}
    assert np.abs(sim.qvel).max() < 1e-12


def test_a_feasible_overlap_is_no_witness():
    xml = """<mujoco><worldbody><geom type="plane" size="1 1 .1"/><body pos="0 0 .04"><freejoint/>
    <geom size=".05"/></body></worldbody></mujoco>"""
    sim = stepper.Stepper(stepper.load(xml))
    for _ in range(500):
        sim.step()
        assert solved(sim) == Status.OK
    assert sim.qpos[2] == pytest.approx(0.05, abs=2e-5)  # the slop, twice


@every(solver=["auto", "pgs", "newton"], precision=["f64", "f32"])
def test_a_contact_that_moves_along_its_normal_alone_stays_finite(solver, precision):
    """A flap lies level with its axis on a block: its contacts have no tangential mobility, which the update of late sweeps divides by."""
    xml = """<mujoco><worldbody><geom type="box" size=".1 .1 .05" pos=".2 0 -.05"/>
    <body><joint axis="0 1 0"/><geom size=".01" pos=".2 0 .01" contype="0" conaffinity="0"/>
    <geom type="sphere" size=".02" pos=".15 0 .02"/><geom type="sphere" size=".02" pos=".25 0 .02"/></body></worldbody></mujoco>"""
    options = Options(solver=solver, tolerance=1e-300 if precision == "f64" else 1e-30, stabilization="none")
    sim = stepper.Stepper(stepper.load(xml), options=options, precision=precision)
    for _ in range(10):
        sim.step()
        assert not sim.status & Status.NON_FINITE
    assert np.abs(sim.qvel).max() < 1e-6


def test_baumgarte_gives_a_contradiction_no_more_than_the_capped_speed():
    options = Options(stabilization="baumgarte")
    sim = stepper.Stepper(stepper.load(SLOT.format(half=0.101)), options=options)
    sim.reset(qpos=[4e-4])
    for _ in range(500):
        sim.step()
        assert abs(float(sim.qvel[0])) <= options.max_correction_speed * (1 + 1e-9)
    assert abs(float(sim.qpos[0])) < 2e-3


def welded_arm() -> str:
    """Seven hinges like those of Fetch's arm, stretched and welded to where its tip is, on a slide that is 39 mm below its range."""
    links = [(0.117, 0.06, 2.6), (0.219, 0, 2.7), (0.133, 0, 2.3), (0.197, 0, 2.1), (0.1245, 0, 1.7), (0.1385, 0, 1.7), (0.1665, 0, 1.7)]
    axes = ["0 0 1", "0 1 0", "1 0 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0"]
    starts, tip = [(0.12, 0.35), *((x, z) for x, z, _ in links[:-1])], links[-1][0]
    arm = f'<body name="tip" pos="{tip} 0 0"><geom size=".01"/></body>'
    for (x, z, mass), axis, (at, up) in zip(reversed(links), reversed(axes), reversed(starts), strict=True):
        geom = f'<geom type="capsule" size=".05" fromto="0 0 0 {x} 0 {z}" mass="{mass}"/>'
        arm = f'<body pos="{at} 0 {up}"><joint axis="{axis}" armature="1" damping="50"/>{geom}{arm}</body>'
    slide = '<joint type="slide" axis="0 0 1" range=".0386 .386" armature="1" damping="1e7"/><geom size=".1" mass="10"/>'
    hand = f'<body name="hand" mocap="true" pos="{sum(x for x, _ in starts) + tip} 0 {sum(z for _, z in starts)}"/>'
    weld = '<equality><weld body1="hand" body2="tip"/></equality>'
    return f"""<mujoco><default><geom contype="0" conaffinity="0"/></default>
    <worldbody>{hand}<body>{slide}{arm}</body></worldbody>{weld}</mujoco>"""


def test_a_stretched_arm_that_a_weld_holds_stands_still():
    """What is left of the weld, which is out of reach, must not walk through the arm's motions that leave its tip in place."""
    sim = stepper.Stepper(stepper.load(welded_arm()))
    start = np.array([0, 0, 0, 1e-3, 0, -1e-3, 0, 0])
    sim.set_state(qpos=start)
    sim.step(nstep=1000)
    rolls = (sim.qpos - start)[[3, 5, 7]]
    # rad in 2 s: gravity turns it too, by some N m against dampers of 50 N m s.
    assert np.abs(rolls).max() < 0.03
    assert sim.qpos[0] == pytest.approx(0.0386, abs=1e-4)


def test_islands_keep_their_loops_closed_when_a_correction_is_bounded():
    """A loop whose limit is far outside moves as one: its gap stays what a correction of one step can leave."""
    xml = """<mujoco><option gravity="0 0 0"/><worldbody>
    <body><joint axis="0 1 0" range="-100 -60"/><geom type="capsule" size=".01" fromto="0 0 0 0 0 .2" contype="0"/>
    <body pos="0 0 .2"><joint axis="0 1 0"/><geom type="capsule" size=".01" fromto="0 0 0 .3 0 0" contype="0"/>
    <body pos=".3 0 0"><joint axis="0 1 0"/><geom type="capsule" size=".01" fromto="0 0 0 0 0 -.2" contype="0"/></body></body></body>
    </worldbody><equality><connect body1="world" body2="3" anchor="0 0 0"/></equality></mujoco>"""
    xml = xml.replace('<body pos=".3 0 0">', '<body name="3" pos=".3 0 0">').replace('anchor="0 0 0"', 'anchor=".3 0 0"')
    sim = stepper.Stepper(stepper.load(xml))
    gap = 0.0
    for _ in range(200):
        sim.step()
        a, b, c = np.asarray(sim.qpos)
        end = np.array([0.2 * np.sin(a), 0.2 * np.cos(a)])
        end += 0.3 * np.array([np.cos(a + b), -np.sin(a + b)])
        end -= 0.2 * np.array([np.sin(a + b + c), np.cos(a + b + c)])
        gap = max(gap, float(np.linalg.norm(end - [0.3, 0])))
    # 10 rad/s over 2 ms turn by 0.02 rad: half of its square on 0.3 m is 6e-5 m a step, of which a fifth is removed in every step.
    assert gap < 1e-3
    assert sim.qpos[0] == pytest.approx(np.radians(-60), abs=1e-3)


def test_explain_lists_overlaps_and_violated_limits_at_the_reference_pose():
    title = "Overlaps and violated limits at the reference pose:"
    section = stepper.load(OVERLAP.format(joint=HINGE)).explain().split(title)[1]
    assert "overlap by 70.00 mm" in section
    assert "Remedy" in section
    outside = stepper.load(RANGE.replace('range="-60 0"', 'range="30 60"')).explain().split(title)[1]
    assert "outside its range by 0.524" in outside
    assert "nothing" in stepper.load(RANGE).explain().split(title)[1]
