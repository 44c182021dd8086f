"""Steps that make energy by their own error say UNRESOLVED, and those that do not are not accused of it."""

import re

import numpy as np
import pytest
import stepper
from hypothesis import given, settings
from hypothesis import strategies as st
from models import simulate, stepper_model

UNRESOLVED = stepper.Status.UNRESOLVED
WINDOW = 0.1
"""s"""


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


@pytest.mark.parametrize("integrator", ["midpoint", "implicit"])
@pytest.mark.parametrize("precision", ["f64", "f32"])
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


@pytest.mark.parametrize("start", range(4))
@pytest.mark.parametrize("timestep", [2e-3, 3e-3])
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
@pytest.mark.parametrize("precision", ["f64", "f32"])
@pytest.mark.parametrize("integrator", ["midpoint", "implicit"])
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


SPINNING = """<mujoco><option gravity="0 0 0"/><worldbody><body><freejoint/><geom type="box" size=".1 .2 .05" mass="1"/></body>
  <body pos="2 0 0"><joint type="ball"/><geom type="box" size=".1 .02 .05" pos=".1 0 .05" mass="1"/></body></worldbody></mujoco>"""


@given(st.integers(0, 2**32 - 1), st.sampled_from(["f64", "f32"]))
def test_bodies_that_tumble_alone_are_not_flagged(seed, precision):
    """Up to a third of a radian a step: the midpoint rule keeps their energy, which the balance of a corrector would not know."""
    sim = simulate(SPINNING, precision=precision, timestep=5e-3)
    rng = np.random.default_rng(seed)
    sim.set_state(qvel=rng.uniform(-30, 30, sim.model.nv))
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
