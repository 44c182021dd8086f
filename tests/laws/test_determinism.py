"""The same model, options, seed and actions give the same bits: comparisons are of raw bytes."""

import hashlib
import itertools
import multiprocessing
import os
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import stepper
from models import contact_bits, mujoco_model, random_state, stepper_model
from stepper.doctor import cpu_levels

ROBOT = "dm_control/humanoid"
# One thread steps groups of sixteen lanes, two threads groups of eight, and some lanes of the last group are none.
ENVS, CALLS, NSTEP = 42, 32, 5


def start(envs: int = ENVS):
    """Different states and controls for every environment: in the air at first, on the floor and moving after 32 calls."""
    model, rng = mujoco_model(ROBOT), np.random.default_rng(1)
    qpos, qvel = map(np.array, zip(*(random_state(model, rng, 1.0) for _ in range(envs)), strict=True))
    qpos[:, 2] = rng.uniform(0.9, 1.3, envs)
    return qpos, qvel, rng.uniform(-1, 1, (CALLS, envs, model.nu))


def roll(sim: stepper.Stepper, controls, nstep: int = NSTEP):
    for ctrl in controls:
        sim.step(ctrl, nstep=nstep)
    return sim


def bits(*arrays) -> str:
    """Digest of raw bytes."""
    return hashlib.sha256(b"".join(np.ascontiguousarray(a).tobytes() for a in arrays)).hexdigest()


def everything(sim: stepper.Stepper, env=slice(None)) -> str:
    """Bits of all that a step leaves behind."""
    return bits(*(np.asarray(x)[env] for x in (sim.qpos, sim.qvel, sim.time, sim.residual, sim.iterations)))


def batch(envs=slice(None), *, integrator: str = "midpoint", precision: str = "f64", threads: int = 1) -> stepper.Stepper:
    """The environments `envs` of the start, after all calls."""
    qpos, qvel, controls = start()
    options = stepper.Options(integrator=integrator)
    sim = stepper.Stepper(stepper_model(ROBOT), len(qpos[envs]), options=options, precision=precision, threads=threads)
    sim.set_state(qpos[envs], qvel[envs])
    return roll(sim, controls[:, envs])


@pytest.fixture(scope="module", params=[("f64", "midpoint"), ("f64", "euler"), ("f64", "rk4"), ("f32", "midpoint")], ids="-".join)
def whole(request):
    """Precision, integrator and the whole batch."""
    precision, integrator = request.param
    sim = batch(precision=precision, integrator=integrator)
    assert sum(len(sim.contacts(env)) > 0 for env in range(ENVS)) > ENVS // 2
    return precision, integrator, sim


@pytest.mark.parametrize("envs", [[0], [5, 31, 2], list(range(8)), list(range(20, 29)), list(range(ENVS))[::-1]], ids=len)
def test_batch_size_and_place_in_the_batch(whole, envs):
    precision, integrator, sim = whole
    part = batch(envs, precision=precision, integrator=integrator)
    for here, there in enumerate(envs):
        assert everything(part, here) == everything(sim, there)
        assert contact_bits(part.contacts(here)) == contact_bits(sim.contacts(there))


def test_one_environment_alone(whole):
    precision, integrator, sim = whole
    qpos, qvel, controls = start()
    alone = stepper.Stepper(stepper_model(ROBOT), options=stepper.Options(integrator=integrator), precision=precision)
    alone.set_state(qpos[7], qvel[7])
    roll(alone, controls[:, 7])
    assert bits(alone.qpos, alone.qvel) == bits(sim.qpos[7], sim.qvel[7])
    assert contact_bits(alone.contacts()) == contact_bits(sim.contacts(7))


def test_threads(whole):
    precision, integrator, sim = whole
    assert everything(batch(precision=precision, integrator=integrator, threads=2)) == everything(sim)


def test_nstep_is_as_many_calls(whole):
    precision, integrator, sim = whole
    qpos, qvel, controls = start()
    single = stepper.Stepper(stepper_model(ROBOT), ENVS, options=stepper.Options(integrator=integrator), precision=precision)
    single.set_state(qpos, qvel)
    roll(single, np.repeat(controls, NSTEP, axis=0), nstep=1)
    assert everything(single) == everything(sim)


def continuing(copy, sim: stepper.Stepper):
    """Goes on with a simulation and with a copy of it made by `copy`; both must end with the same bits."""
    other = copy(sim)
    more = start()[2][::-1]
    assert everything(roll(other, more)) == everything(roll(sim, more))


def from_state(sim: stepper.Stepper) -> stepper.Stepper:
    other = stepper.Stepper(sim.model, sim.num_envs, options=sim.options, precision=sim.precision)
    other.step(np.ones(sim.model.nu), nstep=20)
    other.set_state(pickle.loads(pickle.dumps(sim.get_state())))
    return other


@pytest.mark.parametrize("copy", [from_state, lambda sim: pickle.loads(pickle.dumps(sim))], ids=["state", "pickle"])
def test_a_copy_continues_with_the_same_bits(whole, copy):
    precision, integrator, _ = whole
    continuing(copy, batch(precision=precision, integrator=integrator))


def test_the_saved_state_is_all_that_a_step_reads(whole):
    """Going back and repeating gives the same bits, and the same saved state."""
    precision, integrator, _ = whole
    sim, more = batch(precision=precision, integrator=integrator), start()[2][::-1]
    saved = sim.get_state()
    first = roll(sim, more).get_state()
    sim.set_state(saved)
    assert sim.get_state() == saved
    assert roll(sim, more).get_state() == first


def digest(threads: int) -> str:
    """What a child process answers."""
    return everything(batch(threads=threads))


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_other_processes(method):
    """A fork of a process whose thread pool is running makes its own pool; bits do not change."""
    expected = digest(threads=2)
    with multiprocessing.get_context(method).Pool(1) as pool:
        assert pool.apply_async(digest, (2,)).get(timeout=120) == expected


def test_a_simulation_with_a_running_pool_survives_a_fork():
    sim, more = batch(threads=2), start()[2][::-1]
    expected = everything(roll(pickle.loads(pickle.dumps(sim)), more))
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.write(writer, everything(roll(sim, more)).encode())
        finally:
            os._exit(0)
    os.close(writer)
    assert os.read(reader, 64).decode() == expected
    os.waitpid(child, 0)
    assert everything(roll(sim, more)) == expected


_HERE = Path(__file__).parent
HELPERS = os.pathsep.join(map(str, (_HERE, _HERE.parent, _HERE.parent / "helpers")))
"""Search path of another process that imports this module."""
LEVELS = """
import stepper
from test_determinism import batch, bits
print(bits(*(x for p, i in [("f64", "midpoint"), ("f64", "rk4"), ("f32", "midpoint")]
    for sim in [batch(precision=p, integrator=i)] for x in (sim.qpos, sim.qvel))))
"""


@pytest.mark.parametrize("levels", itertools.pairwise(["baseline", "avx2", "avx512"]), ids="-".join)
def test_cpu_levels(levels):
    """Each has the bits of the next; those that are kept (`tests/golden`) hold whichever levels a machine has."""
    if missing := set(levels) - set(cpu_levels()):
        pytest.skip(f"this machine has no {' and no '.join(missing)}, it has {', '.join(cpu_levels())}")
    found = []
    for asked in levels:
        env = os.environ | {"STEPPER_CPU_LEVEL": asked, "PYTHONPATH": HELPERS}
        found.append(subprocess.run([sys.executable, "-c", LEVELS], env=env, check=True, capture_output=True, text=True).stdout)
    assert found[0] == found[1] != ""


def test_an_unknown_cpu_level_is_refused():
    code = "from models import *; simulate('<mujoco/>')"
    env = os.environ | {"STEPPER_CPU_LEVEL": "sse9", "PYTHONPATH": HELPERS}
    done = subprocess.run([sys.executable, "-c", code], env=env, check=False, capture_output=True, text=True)
    assert done.returncode != 0
    assert "sse9" in done.stderr
    assert "ValueError" in done.stderr


def test_f32_stays_near_f64():
    """A tenth of a second in the air: single precision rounds by 6e-8 of positions of order 1 m, 20 times."""
    qpos, qvel, controls = start()
    ends = []
    for precision in ("f64", "f32"):
        sim = stepper.Stepper(stepper_model(ROBOT), ENVS, precision=precision)
        sim.set_state(qpos + np.eye(qpos.shape[1])[2] * 10, qvel)
        ends.append(roll(sim, controls[:4]))
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
