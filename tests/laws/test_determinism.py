"""Reproducibility: the same model, options, seed and actions give the same bits, however they are run. Raw bytes are compared.

`tests/golden` compares CPU levels.
"""

import dataclasses
import functools
import multiprocessing
import os
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import stepper
from golden import scenes
from golden.record import READINGS, Random
from golden.trajectories import HUMANOID, IMPLICIT, NEWTON, RK4, SOFT, TRAJECTORIES, robot, scene
from models import contact_bits, simulate, stepper_model
from reference.test_mujoco_actuators import text as adhesion
from scenes import arms

# One thread steps groups of sixteen lanes, two threads groups of eight, and some lanes of the last group are none.
N, CALLS, NSTEP = 19, 16, 3
ELLIPTIC, NOSLIP = (scenes.document(scenes.PIT + scenes.loose(scenes.SHAPES), option=option) for option in (
    'cone="elliptic"', 'cone="elliptic" noslip_iterations="5"'))  # fmt: skip
GOLDEN = (
    "humanoids humanoids-euler humanoids-rk4 humanoids-f32 humanoids-soft humanoids-soft-f32 ants-soft-rk4 stackers-f32 pile pile-newton "
    "pile-f32 pile-soft pile-soft-f32 tower sprung sprung-soft bouncing elastic hills-f32 ravine gems gems-f32 shell belts marbles tendons "
    "quadrupeds quadrupeds-f32 tendons-driven equalities equalities-soft equalities-soft-law fluid actuators actuators-bounded sensors "
    "sensors-with-errors arm arm-implicit-f32 everything everything-soft meadow-within-an-error meadow-randomized meadow-randomized-f32 "
    "whirl"
)
CASES = {name: TRAJECTORIES[name] for name in GOLDEN.split()} | {
    "arm-rk4-f32": dataclasses.replace(TRAJECTORIES["arm"], options=RK4, precision="f32"),
    "meadow-randomized-rk4": dataclasses.replace(TRAJECTORIES["meadow-randomized"], options=RK4),
    "servos-at-their-bounds": scene(scenes.ARM, offset=0.3, speed=20, control=3),
    "jammed-arms": scene(arms(3), offset=2),
    "pile-elliptic": scene(ELLIPTIC, options=SOFT, nstep=4),
    "pile-elliptic-f32": scene(ELLIPTIC, options=SOFT, precision="f32", nstep=4),
    "pile-noslip": scene(NOSLIP, options=SOFT, nstep=4),
    "pile-noslip-f32": scene(NOSLIP, options=SOFT, precision="f32", nstep=4),
    "humanoids-implicit-newton": robot(HUMANOID, options=IMPLICIT | NEWTON),
    "adhesion": scene(adhesion(reach="margin and gap"), offset=0.01, control=2),
    "adhesion-soft": scene(adhesion(reach="margin and gap"), options=SOFT, offset=0.01, control=2),
}
"""Scenes of the golden trajectories, and settings that these lack. Their starts and controls are those of `inputs`."""
READ = (
    *READINGS, "substeps", "error_estimate", "qacc", "qacc_smooth", "qfrc_bias", "qfrc_constraint",
    "actuator_force", "body_contact_force", "xipos", "cinert", "cvel", "cfrc_ext", "subtree_com", "site_xpos", "geom_xquat", "body_angvel",
)  # fmt: skip
ALL = list(range(N))
ROBOTS = "humanoids"
_HERE = Path(__file__).parent
HELPERS = os.pathsep.join(map(str, (_HERE, _HERE.parent, _HERE.parent / "helpers")))
"""Search path of another process that imports this module."""


@functools.cache
def model_of(name: str) -> stepper.Model:
    return CASES[name].model()


@functools.cache
def inputs(name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Configurations, velocities and controls, different ones for every environment."""
    case, model, random = CASES[name], model_of(name), Random(17)
    qpos = model.qpos0 + random.uniform(-case.offset, case.offset, (N, model.nq))
    qvel = random.uniform(-case.speed, case.speed, (N, model.nv))
    return qpos, qvel, random.uniform(-case.control, case.control, (CALLS, N, model.nu))


@functools.cache
def parameters(name: str) -> dict:
    """Parameters of the environments of a case that randomizes them."""
    sim = stepper.Stepper(model_of(name), N)
    if CASES[name].prepare is not None:
        CASES[name].prepare(sim, Random(5))
    return sim.randomized


def stepper_of(name: str, envs, **settings) -> stepper.Stepper:
    """Environments `envs` of a case, or the single one of a stepper without a leading axis."""
    case, single = CASES[name], isinstance(envs, int)
    index = np.arange(case.num_envs or 1).repeat(N)[:N][envs if not single else [envs]]
    own = {key: value.chosen(index) if hasattr(value, "chosen") else value for key, value in case.settings.items()}
    sim = stepper.Stepper(
        model_of(name), None if single else len(envs), options=stepper.Options(**case.options), precision=case.precision, **own | settings
    )
    sim.randomize(**{field: values[envs] for field, values in parameters(name).items()})
    return sim


def begin(sim: stepper.Stepper, name: str, envs) -> stepper.Stepper:
    qpos, qvel, _ = inputs(name)
    sim.set_state(qpos[envs], qvel[envs])
    return sim


def roll(sim: stepper.Stepper, name: str, envs, calls=slice(None), nstep: int = NSTEP) -> stepper.Stepper:
    for ctrl in inputs(name)[2][calls]:
        sim.step(ctrl[envs], nstep=nstep)
    return sim


def run(name: str, envs, calls=slice(None), **settings) -> stepper.Stepper:
    return roll(begin(stepper_of(name, envs, **settings), name, envs), name, envs, calls)


def bits(sim: stepper.Stepper, env: int | None = None) -> dict[str, bytes]:
    """Raw bytes of all that can be read of an environment; None is the only one."""
    own = {read: np.asarray(getattr(sim, read)) for read in READ}
    own |= {count: np.asarray(own[count], np.uint32) for count in ("status", "iterations", "substeps")}
    own |= {"mass_matrix": sim.mass_matrix()} | {f"energy {k}": np.asarray(part) for k, part in enumerate(sim.energy())}
    found = {read: (value if env is None else value[env]).tobytes() for read, value in own.items()}
    return found | {"contacts": contact_bits(sim.contacts(env or 0))}


@pytest.fixture(scope="module", params=CASES)
def case(request):
    """Name of a case, and its whole batch after all calls."""
    whole = run(request.param, ALL)
    assert np.isfinite(whole.qpos).all()
    return request.param, whole


def test_an_environment_has_the_same_bits_alone_and_anywhere_in_a_batch(case):
    """Errors of sensors depend on the environment's number: with these, smaller batches have the first environments."""
    name, whole = case
    errs = "sensors" in CASES[name].settings
    for envs in [ALL[:1], ALL[:3], 0] if errs else [[5], [18, 7, 2], ALL[::-1], 7]:
        part = run(name, envs)
        if isinstance(envs, int):
            assert bits(part) == bits(whole, envs)
            continue
        for here, there in enumerate(envs):
            assert bits(part, here) == bits(whole, there), (envs, there)


def test_threads_change_no_bit(case):
    name, whole = case
    for threads in (2, 3):
        other = run(name, ALL, threads=threads)
        assert other.get_state() == whole.get_state()
        assert bits(other) == bits(whole)


def test_a_call_of_many_steps_is_as_many_calls(case):
    name, whole = case
    other = begin(stepper_of(name, ALL), name, ALL)
    for ctrl in inputs(name)[2]:
        status = np.zeros(N, np.uint32)
        for _ in range(NSTEP):
            other.step(ctrl)
            status |= other.status
    assert status.tolist() == whole.status.tolist()
    for read in ("qpos", "qvel", "act", "residual", "sensordata"):
        assert getattr(other, read).tobytes() == getattr(whole, read).tobytes(), read


def test_a_rollout_is_as_many_calls(case):
    name, whole = case
    other = begin(stepper_of(name, ALL), name, ALL)
    out = other.rollout(inputs(name)[2], nstep=NSTEP, fields=["qvel", "sensordata"])
    for read, rows in list(out.items())[:2]:
        assert rows[-1].tobytes() == getattr(whole, read).tobytes(), read
    last = slice(3)
    assert roll(other, name, ALL, last).get_state() == roll(run(name, ALL), name, ALL, last).get_state()


def test_a_saved_state_and_a_pickle_go_on_with_the_same_bits(case):
    """The state is all that a step reads: also in a stepper that did something else before, and after going back."""
    name, whole = case
    first, rest = slice(CALLS // 2), slice(CALLS // 2, None)
    sim = run(name, ALL, first)
    state, copy = pickle.loads(pickle.dumps(sim.get_state())), pickle.loads(pickle.dumps(sim))
    other = roll(stepper_of(name, ALL, threads=2), name, ALL, slice(3))
    other.set_state(state)
    assert other.get_state() == state
    for one in (sim, copy, other):
        assert bits(roll(one, name, ALL, rest)) == bits(whole)
        assert one.get_state() == whole.get_state()
    sim.set_state(state)
    assert roll(sim, name, ALL, rest).get_state() == whole.get_state()


def test_a_masked_reset_leaves_nothing_behind_and_others_alone(case):
    """Under the same seed an environment goes on as a new one, and those that were not reset as if nothing had happened."""
    name, whole = case
    first, rest, mask = slice(CALLS // 2), slice(CALLS // 2, None), np.arange(N) % 3 == 1
    sim, new = run(name, ALL, first), stepper_of(name, ALL)
    for one in (sim, new):
        one.reset(mask, qpos=inputs(name)[0], seed=7)
    roll(sim, name, ALL, rest)
    roll(new, name, ALL, rest)
    for env in ALL:
        assert bits(sim, env) == bits(new if mask[env] else whole, env), env


def test_a_recording_replays_bit_for_bit(case, tmp_path):
    """From the middle of an episode, with a reset of some environments and parameters that change."""
    name, _ = case
    sim, mask = run(name, ALL, slice(3)), np.arange(N) % 2 == 0
    with sim.record(tmp_path / "run"):
        roll(sim, name, ALL, slice(3, 6))
        sim.reset(mask, seed=11)
        if model_of(name).nbody > 1:
            sim.randomize(mask, gravity=np.linspace(-9, 0, N)[:, None] * [0.0, 0.0, 1.0])
        roll(sim, name, ALL, slice(6, 9))
        sim.randomize()
        roll(sim, name, ALL, slice(9, 11))
    assert stepper.recording.verify(tmp_path / "run", threads=2).difference is None


def digest(threads: int) -> str:
    """What a child process answers."""
    return run(ROBOTS, ALL, threads=threads).get_state().bytes.hex()


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_other_processes(method):
    """A fork of a process whose thread pool is running makes its own pool; bits do not change."""
    expected = digest(threads=2)
    with multiprocessing.get_context(method).Pool(1) as pool:
        assert pool.apply_async(digest, (2,)).get(timeout=120) == expected


def test_a_simulation_with_a_running_pool_survives_a_fork():
    sim = run(ROBOTS, ALL, threads=2)
    expected = roll(pickle.loads(pickle.dumps(sim)), ROBOTS, ALL).qpos.tobytes()
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.write(writer, b"same" if roll(sim, ROBOTS, ALL).qpos.tobytes() == expected else b"other")
        finally:
            os._exit(0)
    os.close(writer)
    assert os.read(reader, 64) == b"same"
    os.waitpid(child, 0)
    assert roll(sim, ROBOTS, ALL).qpos.tobytes() == expected


def test_an_unknown_cpu_level_is_refused():
    code = "from models import *; simulate('<mujoco/>')"
    env = os.environ | {"STEPPER_CPU_LEVEL": "sse9", "PYTHONPATH": HELPERS}
    done = subprocess.run([sys.executable, "-c", code], env=env, check=False, capture_output=True, text=True)
    assert done.returncode != 0
    assert "sse9" in done.stderr
    assert "ValueError" in done.stderr


def test_f32_stays_near_f64():
    """A tenth of a second in the air: single precision rounds by 6e-8 of positions of order 1 m, 20 times."""
    ends = []
    for precision in ("f64", "f32"):
        sim = stepper.Stepper(model_of(ROBOTS), N, precision=precision)
        qpos, qvel, _ = inputs(ROBOTS)
        sim.set_state(qpos + np.eye(qpos.shape[1])[2] * 10, qvel)
        ends.append(roll(sim, ROBOTS, ALL, slice(4), nstep=5))
    assert ends[1].qpos.dtype == np.float32
    assert np.abs(ends[0].qpos - ends[1].qpos).max() < 1e-3
    assert not np.array_equal(ends[0].qpos, ends[1].qpos)


def test_the_times_that_neighbours_are_solved_again_change_no_bits():
    """Elastic impacts of an arm deep in the floor: some environments need several passes of the velocity solve, others one."""
    scene = """<mujoco><worldbody><geom name="floor" type="plane" size="5 5 .1"/>
    <body quat="0.149223 -0.808812 0.612246 0.574431"><joint/><joint axis="-0.758578 0.493296 -0.910144"/>
    <geom size="0.0768836" pos="0.02843 -0.142308 3.112267"/></body></worldbody></mujoco>"""
    model = stepper.load(scene).replace(geom_restitution=[0.625, 0.0])
    rng = np.random.default_rng(4)
    qpos, qvel = 0.3 * rng.normal(size=(400, 2)), rng.normal(size=(400, 2))
    together, alone = (stepper.Stepper(model, n) for n in (400, 1))
    together.set_state(qpos=qpos, qvel=qvel)
    together.step()
    for env in range(400):
        alone.set_state(qpos=qpos[env], qvel=qvel[env])
        alone.step()
        assert np.array_equal(together.qvel[env], alone.qvel[0])
        assert together.iterations[env] == alone.iterations[0]


@pytest.mark.parametrize("other", [0.0, 0.45])
def test_damping_of_neighbours_changes_no_bits_with_mujocos_law(other):
    """With Euler's rule, lanes without damping need no solve with an implicit matrix."""
    scene = """<mujoco><worldbody><body><joint axis="-.07 2.88 .55" damping=".45"/><geom size=".1" pos=".086 -.117 -.095"/></body>
    </worldbody></mujoco>"""
    model, options = stepper.load(scene), stepper.Options(contact="mujoco", integrator="euler")
    rng = np.random.default_rng(0)
    for _ in range(20):
        q, v = 0.2 * rng.normal(), rng.normal()
        sims = [stepper.Stepper(model.replace(dof_damping=[0.0]), 1, options=options)]
        for n in (1, 2, 9):
            sims.append(stepper.Stepper(model, n, options=options))
            sims[-1].randomize(dof_damping=[[0.0], *[[other]] * (n - 1)])
        for sim in sims:
            sim.set_state(qpos=[q], qvel=[v])
            sim.step(nstep=50)
        assert len({float(sim.qvel[0, 0]) for sim in sims}) == 1


@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_the_largest_overlap_of_a_touch_is_positive_zero(precision):
    """The sign of the largest of two zeros depends on their order, and so on neighbours."""
    model = stepper.load(
        '<mujoco><worldbody><geom type="plane" size="5 5 1"/><body pos="0 0 .5"><freejoint/><geom size=".5"/></body></worldbody></mujoco>'
    )
    sim = simulate(model, precision=precision, steps=1)
    assert sim.contacts()["distance"].tolist() == [0]
    assert (sim.max_penetration, np.signbit(sim.max_penetration)) == (0, False)


# The next state follows from the state that a user can see: configuration, velocity, activation and controls.

PERTURBED_ROBOTS = ["dm_control/walker", "dm_control/humanoid", "gymnasium/ant", "gymnasium/half_cheetah"]


@pytest.mark.parametrize("integrator", ["midpoint", "implicit", "euler"])
@pytest.mark.parametrize("robot", PERTURBED_ROBOTS)
def test_a_simulator_that_is_told_the_state_goes_on_like_one_that_came_there(robot, integrator):
    model, n = stepper_model(robot), 32
    plant, told = (stepper.Stepper(model, num_envs=n, options=stepper.Options(integrator=integrator, tolerance=1e-6)) for _ in range(2))
    rng, differences = np.random.default_rng(0), []
    for _ in range(20):
        plant.step(rng.uniform(-1, 1, (n, model.nu)), nstep=20)
        told.set_state(qpos=plant.qpos, qvel=plant.qvel)
        ctrl = rng.uniform(-1, 1, (n, model.nu))
        plant.step(ctrl)
        told.step(ctrl)
        solved = (plant.status == 0) & (told.status == 0)
        differences.extend(np.abs(plant.qvel - told.qvel)[solved].max(axis=1))
    assert len(differences) > 0.9 * 20 * n
    # Rows are solved to 1e-6 m/s (the option `tolerance`), most of them far better.
    assert np.median(differences) < 1e-7
    if integrator != "euler":
        # What a solve starts from follows from the state, too, unless the impulses before are a better start.
        assert np.mean(np.asarray(differences) == 0.0) > 0.8
    # Joints of light feet move by some sixty times that. Coulomb's law can have two solutions (Painleve), both of them solved, and the
    # impulses before choose. Contacts that bore load in the step before are not deferred, and a simulator that is told the state does not
    # know the load. That changes 1.8 % of the steps of dm_control's humanoid, and at most 0.3 % of those of other robots.
    assert np.mean(np.asarray(differences) > 1e-4) <= (0.025 if robot == "dm_control/humanoid" else 0.01)
