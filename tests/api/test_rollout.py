"""`Stepper.rollout` is that many calls of `step`, to the bit; and memory, per environment and per thread."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import stepper
from checks import every, raises
from models import stepper_model

ROBOT = "dm_control/humanoid"
T, ENVS = 12, 19
NSTEP = 3
SHARED = np.zeros((T, ENVS, 28))
AFFINITY = """
import os
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
import stepper
from models import stepper_model
sim = stepper.Stepper(stepper_model("dm_control/humanoid"), 64, threads=0)
assert len(os.listdir("/proc/self/task")) == 1, "no thread before the first step"
sim.step()
print(sim.memory()["threads"], len(os.listdir("/proc/self/task")))
"""


def controls(shape=(T, ENVS)):
    return np.random.default_rng(3).uniform(-1, 1, (*shape, stepper_model(ROBOT).nu))


def stepper_of(num_envs=ENVS, **settings):
    sim = stepper.Stepper(stepper_model(ROBOT), num_envs, **settings)
    qpos = np.array(sim.qpos)
    qpos[..., 2] -= 0.2  # feet are near the floor, so that contacts come and go
    sim.set_state(qpos)
    return sim


def step_by_step(sim, ctrl, nstep):
    """What a rollout must write down, by calls of `step`; status and residual step by step."""
    rows = {name: [] for name in ("qpos", "qvel", "act", "sensordata", "status", "residual")}
    for row in ctrl:
        status, residual = np.uint32(0), 0.0
        for _ in range(nstep):
            sim.step(row)
            status, residual = status | sim.status, np.maximum(residual, sim.residual)
        for name in ("qpos", "qvel", "act", "sensordata"):
            rows[name].append(getattr(sim, name))
        rows["status"].append(status)
        rows["residual"].append(residual)
    return {name: np.array(values) for name, values in rows.items()}


@every(precision=["f64", "f32"], threads=[1, 3], num_envs=[ENVS, 1, None])
def test_the_bits_of_that_many_steps(precision, threads, num_envs):
    ctrl = controls((T,) if num_envs is None else (T, num_envs))
    settings = {"precision": precision, "threads": threads}
    one, other = stepper_of(num_envs, **settings), stepper_of(num_envs, **settings)
    expected = step_by_step(one, ctrl, NSTEP)
    found = other.rollout(ctrl, NSTEP, fields=("qpos", "qvel", "act", "sensordata"))
    assert set(found) == set(expected)
    for name, values in found.items():
        assert values.shape == expected[name].shape, name
        assert values.tobytes() == expected[name].tobytes(), name
        assert values.dtype == {"status": np.uint32, "residual": np.float64}.get(name, np.dtype(f"float{precision[1:]}"))
    assert found["residual"].max() > 0
    assert np.array_equal(other.status, np.bitwise_or.reduce(expected["status"]))
    assert np.array_equal(one.residual, other.residual)
    assert np.array_equal(one.time, other.time)
    assert np.array_equal(one.ctrl, other.ctrl)
    # And nothing of how it came about remains.
    one.step(ctrl[0])
    other.step(ctrl[0])
    assert one.get_state() == other.get_state()


def test_one_row_for_all():
    ctrl = controls((T,))
    one, other = stepper_of(), stepper_of()
    everybody = np.repeat(ctrl[:, None], ENVS, axis=1)
    assert np.array_equal(one.rollout(ctrl)["qpos"], other.rollout(everybody)["qpos"])
    assert np.array_equal(one.ctrl, other.ctrl)


def test_arrays_of_the_caller():
    ctrl = controls()
    expected = stepper_of().rollout(ctrl)
    out = {"qvel": np.full((T, ENVS, 27), np.nan), "residual": np.full((T, ENVS), np.nan)}
    found = stepper_of().rollout(ctrl, out=out)
    assert set(found) == {"qvel", "status", "residual"}
    for name, array in out.items():
        assert found[name] is array
        assert np.array_equal(array, expected[name])
    assert set(stepper_of().rollout(ctrl, fields=["qpos"], out=out)) == {"qpos", "qvel", "status", "residual"}
    assert set(expected) == {"qpos", "qvel", "sensordata", "status", "residual"}


def test_an_array_to_be_filled_stays_as_it_is_until_the_end():
    """Nothing of Python's is written to while other threads of Python run."""
    sim, other = stepper_of(), stepper_of()
    looks = 0
    # On a busy machine, a whole call may pass before this thread looks.
    for _ in range(100):
        out = np.full((400, ENVS, 27), 7.0)
        with ThreadPoolExecutor(1) as pool:
            call = pool.submit(sim.rollout, controls((400, ENVS)), out={"qvel": out})
            while not call.done():
                if out[0, 0, 0] == 7.0:
                    assert np.all(out[-1] == 7.0) or call.done()
                    looks += 1
                other.step(out.reshape(-1)[: ENVS * 21].reshape(ENVS, 21), nstep=0)
        assert np.array_equal(call.result()["qvel"], out)
        assert not np.any(out == 7.0)
        if looks:
            break
    assert looks


def test_no_control_and_no_step():
    sim = stepper_of()
    before = sim.get_state()
    found = sim.rollout(controls()[:0])
    assert found["qpos"].shape == (0, ENVS, 28)
    found = sim.rollout(controls(), nstep=0)
    assert np.array_equal(found["qpos"], np.broadcast_to(sim.qpos, (T, ENVS, 28)))
    assert sim.get_state() == before


def test_nothing_is_silent():
    """What happens once, in one environment, is in its own place, and in `status` of the whole call."""
    ctrl = controls()
    ctrl[4, 7, 2] = np.nan
    sim = stepper_of()
    found = sim.rollout(ctrl, NSTEP)
    assert np.argwhere((found["status"] & stepper.Status.NON_FINITE) != 0).tolist() == [[4, 7]]
    assert np.array_equal(found["qpos"][4, 7], found["qpos"][3, 7])
    assert np.argwhere(sim.status & stepper.Status.NON_FINITE).tolist() == [[7]]


def test_forces_and_mocap_are_held():
    one, other = stepper_of(), stepper_of()
    for sim in (one, other):
        sim.qfrc_applied[:, 2] = 300.0
        sim.xfrc_applied[3, 1, 0] = 50.0
    expected = step_by_step(one, controls(), 1)
    assert np.array_equal(other.rollout(controls())["qpos"], expected["qpos"])


@pytest.mark.parametrize(("change", "error", "message"), [
    (lambda out: out.update(qpos=np.zeros((T, ENVS, 27))), ValueError, r'out\["qpos"\] has shape \(12, 19, 27\), must be \(12, 19, 28\)'),
    (lambda out: out.update(qpos=np.zeros((T, ENVS, 28), "f4")), TypeError, r'out\["qpos"\] is of float32, must be an array of float64'),
    (lambda out: out.update(qpos=[1.0]), TypeError, r'out\["qpos"\] is .*list'),
    (lambda out: out.update(qpos=np.zeros((T, ENVS, 56))[:, :, ::2]), ValueError, "not C-contiguous"),
    (lambda out: out.update(qpos=np.zeros((28, ENVS, T)).T), ValueError, "not C-contiguous"),
    (lambda out: out.update(speed=np.zeros(3)), ValueError, 'rollout field is "speed", must be one of: qpos, qvel'),
    (lambda out: out.update({3: np.zeros(3)}), TypeError, "a key of out is 3"),
    (lambda out: out.update(qpos=np.frombuffer(bytes(8 * T * ENVS * 28)).reshape(T, ENVS, 28)), ValueError, "qpos"),  # Read-only.
    (lambda out: out.update(qpos=SHARED, residual=SHARED.reshape(-1)[: T * ENVS].reshape(T, ENVS)), ValueError, "residual"),
])  # fmt: skip
def test_wrong_outputs_are_named(change, error, message):
    out = {}
    change(out)
    sim = stepper_of()
    before = sim.get_state()
    raises(error, message, lambda: sim.rollout(controls(), out=out))
    assert sim.get_state() == before


@pytest.mark.parametrize("shape", [(), (21,), (T, ENVS, 20), (T, 3, 21), (ENVS, T, 21)])
def test_wrong_controls_show_both_shapes(shape):
    raises(ValueError, r"must be \(T, 19, 21\) or \(T, 21\) for T controls", stepper_of().rollout, np.zeros(shape))


def test_memory():
    few, some, large = stepper_of(8).memory(), stepper_of(64).memory(), stepper_of(4096)
    many = large.memory()
    # Groups of one width are all alike, so a batch costs what its groups cost.
    assert some["per_env"] == many["per_env"]
    assert some["per_thread"] == many["per_thread"] > 10_000
    # Groups of eight lanes may be stepped by fewer registers than groups of sixteen; what a group has once is some hundred bytes.
    assert many["per_env"] <= few["per_env"] < many["per_env"] + 100
    # Twice the lanes take twice the room, and the solver has that of half of them beside it.
    assert few["per_thread"] <= many["per_thread"] < 3 * few["per_thread"]
    assert many["total"] == many["state"] + many["inputs"] + many["threads"] * many["per_thread"]
    assert many["inputs"] == 8 * 4096 * 21
    assert 100_000 * many["per_env"] < 2**30
    large.qfrc_applied[:] = 1.0
    assert large.memory()["inputs"] == 8 * 4096 * (21 + 27)
    assert stepper_of(4096, precision="f32").memory()["state"] < 0.6 * many["state"]
    assert stepper_of(4096, threads=3).memory()["threads"] == 3
    assert stepper_of(8, threads=3).memory()["threads"] == 1


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="this system has no CPU affinity to honour")
def test_all_threads_are_those_that_the_process_may_use():
    env = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run([sys.executable, "-c", AFFINITY], env=env, check=True, capture_output=True, text=True)
    assert done.stdout.split() == ["1", "1"]
