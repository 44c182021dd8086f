"""Steps that keep an error (`Options.error`): local errors, superposition, bits, and what they leave as it is."""

import functools
from dataclasses import dataclass, field

import numpy as np
import pytest
import stepper
from checks import raises
from hypothesis import given, settings, strategies as st
from models import simulate, stepper_model
from stepper import Options, Status

E = 1e-3
"""Error of a step in these tests, m or rad."""
BOX = """<mujoco><option timestep="{h}"/><worldbody><geom type="plane" size="5 5 1"/>
  <body pos="0 0 1"><freejoint/><geom type="box" size=".1 .15 .2" mass="1" {more}/></body></worldbody></mujoco>"""
timesteps = st.sampled_from([1e-3, 2e-3, 5e-3, 1e-2])
run_settings = st.tuples(st.sampled_from(["midpoint", "euler", "implicit", "rk4"]), st.sampled_from(["f64", "f32"]))


def chain(links: int = 20, tip: float = 5.0) -> stepper.Model:
    """Chain of light links with a heavy end, which whips."""
    body = f'<geom type="sphere" size=".03" pos="0 0 -.1" mass="{tip}"/>'
    for _ in range(links):
        body = f'<body pos="0 0 -.1"><joint axis="0 1 0"/><geom type="capsule" size=".01" fromto="0 0 0 0 0 -.1" mass=".02"/>{body}</body>'
    return stepper.load(
        f'<mujoco><option timestep=".002"/><default><geom contype="0" conaffinity="0"/></default><worldbody>{body}</worldbody></mujoco>'
    )


def thrown(n: int, seed: int = 0) -> dict:
    """States of `n` bodies on free joints that fly and tumble."""
    rng = np.random.default_rng(seed)
    quat = rng.normal(size=(n, 4))
    pos = np.stack([rng.uniform(-1, 1, n), rng.uniform(-1, 1, n), rng.uniform(0.4, 1.0, n)], axis=1)
    return {
        "qpos": np.concatenate([pos, quat / np.linalg.norm(quat, axis=1, keepdims=True)], axis=1),
        "qvel": np.concatenate([rng.normal(size=(n, 3)), 6 * rng.normal(size=(n, 3))], axis=1),
    }


def local_errors(model, states, *, steps: int, finer: int = 64, **options) -> tuple[np.ndarray, stepper.Stepper]:
    """Distances of steps that keep an error from `finer` small steps from the same state, in coordinates, along a run."""
    n, h = len(states["qpos"]), model.timestep
    sim = stepper.Stepper(model, n, options=Options(error=E, **options))
    fine = stepper.Stepper(model, n, options=Options(timestep=h / finer, tolerance=1e-10, **options))
    sim.set_state(**states)
    errors = []
    for _ in range(steps):
        fine.set_state(qpos=sim.qpos, qvel=sim.qvel)
        sim.step()
        fine.step(nstep=finer)
        errors.append(np.abs(sim.qpos - fine.qpos).max(axis=1))
    return np.array(errors), sim


@pytest.mark.parametrize("integrator", ["midpoint", "implicit", "euler"])
def test_the_error_of_a_step_of_a_whipping_chain_is_kept(integrator):
    """Without it, some steps of this chain are wrong by 0.1 rad."""
    model, rng = chain(), np.random.default_rng(0)
    states = {"qpos": rng.uniform(-0.5, 0.5, (4, model.nq)) + np.pi / 2 / model.nq, "qvel": np.zeros((4, model.nv))}
    errors, sim = local_errors(model, states, steps=150, integrator=integrator)
    assert np.mean(errors <= E) >= 0.95
    assert (sim.status & Status.INACCURATE == 0).all()


def test_the_error_of_a_step_with_an_elastic_impact_is_kept():
    model = stepper.load(BOX.format(h=0.01, more='friction="0"'))
    model = model.replace(geom_restitution=np.ones(model.ngeom))
    errors, _ = local_errors(model, thrown(32), steps=60)
    assert np.mean(errors <= E) >= 0.95
    plain = stepper.Stepper(model, 32)
    plain.set_state(**thrown(32))
    assert np.isnan(plain.error_estimate).all() and (plain.substeps == 0).all()


SPRUNG = 'stiffness="1" damping=".2"'


@pytest.mark.parametrize(
    ("integrator", "order", "joint"), [("midpoint", 3, ""), ("midpoint", 3, SPRUNG), ("implicit", 2, SPRUNG), ("euler", 2, "")]
)
def test_smooth_motion_has_one_order_more_than_the_rule(integrator, order, joint):
    """Trees without constraints get the extrapolation of whole intervals and their halves. The box falls too, and spins."""
    body = BOX.format(h=0.004, more='contype="0" conaffinity="0"').replace(
        "</worldbody>",
        f"""<body pos="0 0 3"><joint axis="0 1 0" {joint}/><geom type="capsule" size=".05" fromto="0 0 0 0 0 -.5"/>
        <body pos="0 0 -.5"><joint axis="1 .5 0" {joint}/>
        <geom type="capsule" size=".05" fromto="0 0 0 .4 0 0"/></body></body></worldbody>""",
    )
    model = stepper.load(body)
    qpos, qvel = model.qpos0 + np.eye(1, model.nq, 7)[0] * 0.7, np.array([1, 0.5, 2, 3, 1, 4, 1, -2.0])

    def end(h: float) -> np.ndarray:
        # One interval a step: no estimate exceeds the error.
        sim = simulate(model, timestep=h, error=10.0, integrator=integrator, qpos=qpos, qvel=qvel, steps=round(0.4 / h))
        assert sim.substeps == 2 * round(0.4 / h)
        return np.concatenate([sim.qpos, sim.qvel])

    exact = end(0.004 / 32)
    errors = [np.abs(end(h) - exact).max() for h in (0.008, 0.004)]
    # Half of the time step divides the error by 2^order in the limit. The rules themselves have an order less.
    assert errors[1] * 2 ** (order - 0.4) < errors[0]


@given(
    st.floats(0.01, 1000),
    st.sampled_from([0.0, 0.05, 1.0]),
    st.sampled_from(["midpoint", "implicit"]),
    st.sampled_from(["spring", "servo"]),
)
@settings(max_examples=40, deadline=None)
def test_vibrations_of_springs_and_servos_do_not_grow(rate, ratio, integrator, kind):
    """The amplitude is at most that of the start, at any stiffness. `rate` is the time step times the frequency."""
    # The midpoint rule is extrapolated where its extrapolation is stable: where vibrations are slow and damped.
    h = 0.01
    stiffness, damping = (rate / h) ** 2, 2 * ratio * rate / h
    spring = f'stiffness="{stiffness}" damping="{damping}"' if kind == "spring" else ""
    servo = f'<actuator><position joint="x" kp="{stiffness}" kv="{damping}"/></actuator>' if kind == "servo" else ""
    model = stepper.load(
        f"""<mujoco><option timestep="{h}" gravity="0 0 0"/><worldbody><body><joint name="x" type="slide" {spring}/>
        <geom size=".1" mass="1"/></body></worldbody>{servo}</mujoco>"""
    )
    sim = stepper.Stepper(model, options=Options(error=E, integrator=integrator))
    start = 1e-8
    sim.set_state([start])
    for _ in range(100):
        sim.step()
        assert abs(sim.qpos[0]) <= start * (1 + 1e-9)  # Rounding of 600 substeps.
        assert abs(sim.qvel[0]) <= start * rate / h * (1 + 1e-9)


@given(st.sampled_from([1, 4, 10]), st.floats(1e-3, 1e3), st.sampled_from([0.0, 0.01]), st.sampled_from([None, 0.05, 1.0]))
@settings(max_examples=40, deadline=None)
def test_chains_with_dampers_gain_no_energy(links, rate, ratio, hub):
    """The modes of a chain move less inertia than its joints. `rate` is the damping of a joint, times the time step by m l^2."""
    h, body = 0.01, ""
    for _ in range(links):
        joint = f'<joint axis="0 1 0" damping="{rate / h}" stiffness="{ratio * rate / h}"/>'
        body = f'<body pos="1 0 0">{joint}<inertial pos="1 0 0" mass="1" diaginertia=".01 .01 .01"/>{body}</body>'
    free = "" if hub is None else f'<joint type="slide" axis="0 0 1"/><inertial pos="0 0 0" mass="{hub}" diaginertia="1 1 1"/>'
    model = stepper.load(f'<mujoco><option timestep="{h}" gravity="0 0 0"/><worldbody><body>{free}{body}</body></worldbody></mujoco>')
    qvel = 1e-6 * np.random.default_rng(0).normal(size=model.nv)
    sim = simulate(model, error=E, qvel=qvel)
    start = float(np.sum(sim.energy()))
    for _ in range(100):
        sim.step()
        assert np.sum(sim.energy()) <= start * (1 + 1e-9)  # Rounding.


def test_extrapolated_activations_stay_in_their_range():
    """A filter with a time constant of two thirds of the step, whose halves and whole differ by a tenth of its range."""
    general = '<general joint="x" dyntype="filter" dynprm=".01" actlimited="true" actrange="-.3 .3"/>'
    model = stepper.load(f"""<mujoco><option timestep=".015"/><worldbody><body><joint name="x" type="slide"/><geom size=".1"/></body>
      </worldbody><actuator>{general}</actuator></mujoco>""")
    sim, rng = stepper.Stepper(model, 16, options=Options(error=0.1)), np.random.default_rng(0)
    for _ in range(50):
        sim.step(rng.uniform(-1, 1, (16, 1)))
        assert np.abs(sim.act).max() <= 0.3


def test_trees_in_contact_are_not_extrapolated():
    """A box slides. Its step is two steps of half the length, to the tolerance of the solver: 1e-6 m/s, 20 times."""
    model = stepper.load(BOX.format(h=0.01, more=""))
    kept, plain = (stepper.Stepper(model, options=Options(timestep=h, tolerance=1e-6, error=e)) for h, e in ((0.01, 10.0), (0.005, None)))
    for sim, steps in ((kept, 20), (plain, 40)):
        sim.set_state([0, 0, 0.2, 1, 0, 0, 0], [2, 0.3, 0, 0, 0, 1])
        sim.step(nstep=steps)
    assert np.abs(kept.qvel[:2]).max() > 0.1
    np.testing.assert_allclose(kept.qvel, plain.qvel, atol=2e-5)


def test_forces_are_those_of_the_whole_step():
    """A box at rest presses on the floor with its weight, and a moving arm has the impulses of its limits, whatever the substeps."""
    model = stepper.load(BOX.format(h=0.01, more=""))
    sim = simulate(model, 1, error=1e-5, tolerance=1e-6, qpos=[[0, 0, 0.2, 1, 0, 0, 0]], qvel=[[0.5, 0, 0, 0, 0, 0]])
    before = sim.qvel[0].copy()
    for _ in range(20):
        sim.step()
        change = 1.0 * (sim.qvel[0] - before)[:3] / 0.01 + [0, 0, 9.81]
        before = sim.qvel[0].copy()
        # The body has a mass of 1 kg: its momentum changes by gravity and by the contact force. Forces have the solver's error, 1e-6 m/s in
        # each of up to 512 substeps of a step of 10 ms.
        assert sim.body_contact_force[0, 1, :3] == pytest.approx(change, abs=0.05)
        assert sim.qfrc_constraint[0, :3] == pytest.approx(change, abs=0.05)
    assert sim.time[0] == pytest.approx(0.2, abs=1e-12)


def test_smooth_motion_takes_the_fewest_substeps():
    """A step that is accurate enough at once has two substeps: the halves that were compared with it."""
    sim = simulate(stepper_model("gymnasium/hopper"), 3, error=0.1, steps=5)
    assert (sim.substeps == 10).all() and (sim.error_estimate < 0.1).all()


def test_an_error_that_cannot_be_kept_is_flagged():
    """In f32, positions of 1 km are rounded to 6e-5 m."""
    sim = simulate(BOX.format(h=0.01, more=""), 1, error=1e-7, precision="f32", qpos=[[1e3, 0, 5, 1, 0, 0, 0]], qvel=[[30, 0, 0, 1, 2, 3]])
    sim.step(nstep=20)
    assert sim.status[0] & Status.INACCURATE and sim.error_estimate[0] > 1e-7
    # A step divided by 256 has no more substeps.
    assert 40 <= sim.substeps[0] <= 20 * 256


def test_a_step_is_flagged_if_and_only_if_its_estimate_exceeds_the_error():
    """Several impacts in a step have a quarter of the error each, so that their sum may exceed it."""
    sim = stepper.Stepper(stepper_model("gymnasium/ant"), 64, options=Options(error=E))
    rng, flagged = np.random.default_rng(0), 0
    for _ in range(60):
        sim.step(rng.uniform(-1, 1, (64, sim.model.nu)))
        exceeds = sim.error_estimate > E
        assert np.array_equal((sim.status & Status.INACCURATE) != 0, exceeds)
        flagged += exceeds.sum()
    assert 0 < flagged < 60 * 64


@pytest.mark.parametrize(("options", "must"), [({"contact": "mujoco"}, "None with"), ({"integrator": "rk4"}, "None with")])
def test_methods_without_a_step_that_keeps_an_error_are_refused(options, must):
    raises(ValueError, rf"error is 0\.001.*{must}", Options, error=E, **options)


@pytest.mark.parametrize("method", ["fd", "implicit"])
def test_derivatives_are_refused(method):
    sim = stepper.Stepper(stepper_model("gymnasium/hopper"), 1, options=Options(error=E))
    raises(ValueError, r"error is 0\.001", sim.linearize, method=method)


# The accuracy of a mechanism depends on nothing that it does not touch: it moves as in a model of its own.

# Mechanisms do not share a number, so that both runs round alike. What is left is the position of a mechanism among the others, on which
# sums over all degrees of freedom depend: a few units in the last place of positions up to 500 m.
ROUNDING = {"f64": 1e-9, "f32": 1e-3}

BAR = '<geom type="capsule" size=".02" fromto="0 0 0 .5 0 0" contype="0" conaffinity="0"/>'
SHORT_BAR = '<geom type="capsule" size=".02" fromto="0 0 0 .1 0 0" contype="0" conaffinity="0"/>'
HINGE = '<joint axis="0 1 0"/>'


@dataclass(frozen=True)
class Mechanism:
    """Bodies, their velocity, and what else the model and the run need for them."""

    bodies: str
    qvel: tuple[float, ...]
    nq: int = 0
    equality: str = ""
    actuator: str = ""
    restitution: float = 0.0
    force: tuple[float, ...] = field(default=())


# Mechanisms without contacts: with contacts, the solver's tolerance would decide how alike two runs are.
WATCHED = {
    "falling body": Mechanism(
        '<body pos="0 0 500"><freejoint/><inertial pos="0 0 0" mass="1" diaginertia=".1 .1 .1"/></body>', (0.0,) * 6, 7
    ),
    "tumbling body": Mechanism(
        '<body pos="0 0 500"><freejoint/><inertial pos="0 0 0" mass="1" diaginertia=".1 .2 .3"/></body>', (1, 0, 0, 1, 3, 0.1), 7
    ),
    "pendulum": Mechanism(f'<body pos="0 0 50">{HINGE}{BAR}</body>', (1.0,), 1),
    "double pendulum": Mechanism(f'<body pos="0 0 50">{HINGE}{BAR}<body pos=".5 0 0">{HINGE}{BAR}</body></body>', (1.0, -2.0), 2),
    "servo arm": Mechanism(
        f'<body pos="0 0 50"><joint name="shoulder" axis="0 1 0" damping=".1"/>{BAR}</body>',
        (2.0,),
        1,
        actuator='<position joint="shoulder" kp="20" kv="1"/>',
    ),
    "arm at its limit": Mechanism(f'<body pos="0 0 50"><joint axis="0 1 0" limited="true" range="-90 30"/>{BAR}</body>', (1.0,), 1),
}

SPHERES = "".join(f'<body pos="{10 + 0.2 * i} 0 {0.5 + 0.1 * i}"><freejoint/><geom size=".05" mass=".1"/></body>' for i in range(4))

OTHERS = {
    "rotor beside a plate": Mechanism(
        '<geom type="box" size=".2 .2 .01" pos="10 0 .28"/><body pos="10 0 .3"><joint axis="0 0 1"/><geom type="box" size=".1 .01 .002"/></body>',  # noqa: E501
        (314.0,),
    ),
    "bullet at a thin wall": Mechanism(
        '<geom type="box" size=".001 1 1" pos="12 0 2"/><body pos="10 0 2"><freejoint/><geom size=".02" mass=".1"/></body>',
        (300, 0, 0, 0, 0, 0),
    ),
    "elastic balls": Mechanism(f'<geom type="plane" size="1 1 1"/>{SPHERES}', (0.0,) * 24, restitution=1.0),
    "whipping chain": Mechanism(
        f'<body pos="10 0 50">{HINGE}{SHORT_BAR}<body pos=".1 0 0">{HINGE}{SHORT_BAR}</body></body>', (300.0, -500.0)
    ),
    "weld out of reach": Mechanism(
        '<body name="held" pos="10 0 5"><joint type="slide" axis="1 0 0"/><geom size=".1" mass="1" contype="0" conaffinity="0"/></body>'
        '<body name="holder" mocap="true" pos="10 1 5"/>',
        (0.0,),
        equality='<weld body1="held" body2="holder"/>',
    ),
    "force that is not a number": Mechanism('<body pos="10 0 5"><joint/><geom size=".1" mass="1"/></body>', (0.0,), force=(np.nan,)),
    "jam": Mechanism(
        '<geom type="box" size=".1 .1 .1" pos="10 0 5"/><geom type="box" size=".1 .1 .1" pos="10.25 0 5"/>'
        '<body pos="10.125 0 5"><freejoint/><geom type="box" size=".05 .05 .05" mass="1"/></body>',
        (0.0,) * 6,
    ),
}


def trajectory(mechanisms: list[Mechanism], timestep: float, integrator: str, precision: str) -> np.ndarray:
    """Positions of the first mechanism during 0.5 s, (steps, nq)."""
    part = lambda name: "".join(getattr(m, name) for m in mechanisms)  # noqa: E731
    model = stepper.load(
        f'<mujoco><option timestep="{timestep}"/><worldbody>{part("bodies")}</worldbody><equality>{part("equality")}</equality>'
        f"<actuator>{part('actuator')}</actuator></mujoco>"
    )
    model = model.replace(geom_restitution=np.full(model.ngeom, max(m.restitution for m in mechanisms)))
    sim = simulate(model, timestep=timestep, integrator=integrator, precision=precision, qvel=np.concatenate([m.qvel for m in mechanisms]))
    force = np.concatenate([m.force or np.zeros(len(m.qvel)) for m in mechanisms])
    path = []
    for _ in range(round(0.5 / timestep)):
        sim.qfrc_applied[...] = force
        sim.step()
        path.append(sim.qpos[: mechanisms[0].nq].copy())
    return np.array(path)


@functools.cache
def path_alone(watched: str, timestep: float, integrator: str, precision: str) -> np.ndarray:
    """Positions of a mechanism in a model of its own."""
    return trajectory([WATCHED[watched]], timestep, integrator, precision)


@pytest.mark.parametrize("other", sorted(OTHERS))
@given(st.sampled_from(sorted(WATCHED)), timesteps, run_settings)
def test_a_mechanism_moves_as_in_a_model_of_its_own(other, watched, timestep, setting):
    beside = trajectory([WATCHED[watched], OTHERS[other]], timestep, *setting)
    assert np.isfinite(beside).all()
    assert np.abs(beside - path_alone(watched, timestep, *setting)).max() <= ROUNDING[setting[1]]
