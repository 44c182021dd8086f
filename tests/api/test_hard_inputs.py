"""Bytes, threads, numbers and arrays that nobody means well: an error that says what, never a crash, never a wrong state."""

import copy
import functools
import hashlib
import pickle
import re
import struct
import subprocess
import sys
import textwrap
import threading
import time

import numpy as np
import pytest
import stepper
from checks import raises
from models import mjcf, simulate, stepper_model

HOPPER, ANT = "dm_control/hopper", "gymnasium/ant"
SCENE = mjcf("inputs")
OPEN = {"tendon_range", "jnt_actfrcrange", "actuator_ctrlrange", "actuator_forcerange"}
"""Whose lower bound may be -inf and upper inf."""
RIGID = {"eq_stiffness", "geom_stiffness", "pair_stiffness"}
"""Whose infinity is rigid."""
MODEL = stepper.load(SCENE)


# Bytes


def run(sim, steps=20):
    for k in range(steps):
        sim.step(np.full(sim.model.nu, np.sin(k)))
    return sim


def test_every_cut_and_every_flipped_byte_of_a_state_is_refused():
    sim = run(simulate(stepper_model(HOPPER), 3))
    state = sim.get_state()
    before, data = sim.qpos, state.bytes
    assert stepper.State(data) == state
    assert len(data) == state.nbytes
    for at in {*range(0, len(data), 7), len(data) - 1}:
        raises(ValueError, r"not a state: (the bytes do not begin|cut off|damaged)", stepper.State, data[:at])
        wrong = bytearray(data)
        wrong[at] ^= 0x10
        with pytest.raises(ValueError, match=r"not a state: (the bytes do not begin|format version|damaged)"):
            stepper.State(bytes(wrong))
    raises(ValueError, "damaged", stepper.State, data + b"\0")
    raises(ValueError, r"format version 9, this stepper reads \d+", lambda: stepper.State(data[:8] + struct.pack("<I", 9) + data[12:]))
    raises(ValueError, "do not begin as those of a state", lambda: stepper.State(sim.model.to_bytes()))
    raises(stepper.ModelError, "not a saved stepper model", stepper.Model.from_bytes, data)
    assert np.array_equal(sim.qpos, before)


def signed(data):
    """The checksum that bytes of a state should have: what a damaged disk does not know, and who means ill does."""
    return data[:45] + hashlib.sha256(data[:45] + data[77:]).digest() + data[77:]


def test_a_state_says_which_model_it_belongs_to_and_another_one_refuses_it():
    sim = simulate(stepper_model(HOPPER))
    state = stepper.State(sim.get_state().bytes)
    assert state.digest.hex() == sim.model.digest
    other = simulate(sim.model.replace(timestep=0.001))
    with pytest.raises(ValueError, match=f"belongs to another model, {sim.model.digest[:12]}; this one is .*{other.model.digest[:12]}"):
        other.set_state(state)
    narrow = simulate(sim.model, precision="f32")
    raises(ValueError, "numbers in F64, this stepper in F32", narrow.set_state, state)


def test_states_with_a_true_checksum_and_nonsense_in_them_are_refused_or_taken_but_never_crash():
    """Every byte that parses differently: what comes of it is an error, or a state that steps."""
    sim = run(simulate(stepper_model(ANT), 3))
    data, refused = sim.get_state().bytes, 0
    rng = np.random.default_rng(0)
    for _ in range(400):
        wrong = bytearray(data)
        for at in rng.integers(77, len(data), rng.integers(1, 4)):
            wrong[at] = rng.choice([0, 1, 0x7F, 0x80, 0xF0, 0xFF, rng.integers(256)])
        state = stepper.State(signed(bytes(wrong)))
        try:
            sim.set_state(state)
        except ValueError as error:
            assert "does not fit" in str(error)
            refused += 1
            continue
        sim.step(nstep=2)
        assert np.isfinite(sim.qpos).all()
    assert refused > 3
    for payload in (b"", b"\xff" * 40, data[77:] + b"\0"):
        with pytest.raises(ValueError, match="does not fit"):
            sim.set_state(stepper.State(signed(data[:77] + payload)))
    sim.set_state(qpos=np.where(np.arange(sim.model.nq) == 2, 0.5, sim.model.qpos0), time=0.0)
    good = sim.get_state().bytes
    for number in (np.nan, np.inf):
        wrong = good.replace(struct.pack("<d", 0.5), struct.pack("<d", number))
        assert wrong != good
        with pytest.raises(ValueError, match="a number of qpos, qvel, act or time is not finite"):
            sim.set_state(stepper.State(signed(wrong)))


@pytest.mark.parametrize(("name", "value", "what"), [
    ("state", b"", "not a state"),
    ("state", 5, "state is not bytes"),
    ("randomized", [], "randomized is not a dict"),
    ("randomized", {"body_weight": 1}, "no field 'body_weight'"),
    ("applied", [None], "has 1 arrays, must have 5"),
    ("applied", 5, "applied is not a list"),
    ("applied", [np.zeros(3), None, None, None, None], r"qfrc_applied has shape \(3,\), must be \(2, 8\)"),
    ("applied", [None, "x", None, None, None], "xfrc_applied is .*, must be an array of numbers"),
])  # fmt: skip
def test_a_crafted_pickle_is_refused_in_words(name, value, what):
    sim = simulate(MODEL, 2)
    state = sim.__getstate__()
    sim.__setstate__(state)
    raises((TypeError, ValueError), f"(?s){what}", sim.__setstate__, state | {name: value})
    del state[name]
    raises(ValueError, f"{name} is missing", sim.__setstate__, state)
    sim.step()


def test_a_copy_shares_nothing_that_is_written_to():
    sim = simulate(MODEL, 2)
    sim.xfrc_applied[:] = 1.0
    sim.mocap_pos[:] = 2.0
    for other in (copy.copy(sim), copy.deepcopy(sim), pickle.loads(pickle.dumps(sim))):
        other.xfrc_applied[:] = 7.0
        assert np.all(sim.xfrc_applied == 1.0)
        assert np.all(other.mocap_pos == 2.0)
        other.step()
        assert np.all(sim.time == 0.0)


# Threads


def test_whatever_is_asked_of_a_stepper_at_work_says_so():
    """Every attribute and every method without arguments, also one that was looked up before, copies and pickles."""
    sim = simulate(stepper_model(ANT), 64)
    names = [name for name in dir(type(sim)) if not name.startswith("_")]
    calls = {name: functools.partial(getattr, sim, name) for name in names}
    calls |= {f"{name}()": found for name in names if callable(found := getattr(sim, name))}
    calls |= {"repr": sim.__repr__, "assignment": functools.partial(setattr, sim, "qfrc_applied", 0.0)}
    copies = {call.__name__: functools.partial(call, sim) for call in (pickle.dumps, copy.copy, copy.deepcopy)}
    calls |= copies
    busy, done = threading.Event(), threading.Event()

    def work():
        while not done.is_set():
            busy.set()
            sim.step(nstep=4000)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    busy.wait()
    time.sleep(0.05)
    wrong, met = {}, set()
    for name, call in calls.items():
        try:
            call()
        except TypeError:
            continue  # Arguments are missing.
        except RuntimeError as error:
            met.add(name)
            if "another thread uses this Stepper; wait until its call has returned" not in str(error):
                wrong[name] = str(error)
        except ValueError:
            continue
    done.set()
    thread.join()
    assert not wrong
    assert met >= {"qpos", "get_state()", *copies}


def test_threads_are_no_more_than_there_is_to_do():
    sim = simulate(stepper_model(HOPPER), 20, threads=10**18, steps=3)
    assert sim.threads == 10**18
    assert sim.memory()["threads"] <= 3
    assert np.array_equal(sim.qpos, simulate(stepper_model(HOPPER), 20, steps=3).qpos)


def printed_by(code: str) -> str:
    """Output of a process of its own that can leave itself little memory. It has the module `stepper` and a model."""
    start = f"""
        import os, resource, sys
        sys.path[:0] = {sys.path!r}
        import stepper
        from models import stepper_model
        model = stepper_model({HOPPER!r})

        def leave(room):  # MiB
            size = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
            resource.setrlimit(resource.RLIMIT_AS, (size + (room << 20),) * 2)
    """
    code = textwrap.dedent(start) + textwrap.dedent(code)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_threads_that_the_system_refuses_are_an_error():
    """So little room is left that no stack of a thread fits."""
    printed = printed_by("""
        sim = stepper.Stepper(model, 4096, threads=300)
        leave(64)
        try:
            sim.step()
        except RuntimeError as error:
            print(error)
        assert sim.time.max() == 0.0
    """)
    assert re.search(r"\d+ threads cannot be started .*make threads smaller", printed)


def test_too_little_memory_is_an_error_whatever_of_it_is_too_little():
    """From no room at all to enough of it: for the state, for what actuators and for what sensors remember."""
    ends = printed_by("""
        actuators = stepper.ActuatorModel(default=stepper.Drive(delay=0.02, lag=0.01))
        sensors = stepper.SensorModel(default=stepper.Transfer(noise_std=0.01, delay=0.02))
        for room in range(10, 320, 15):
            child = os.fork()
            if not child:
                leave(room)
                try:
                    stepper.Stepper(model, 30_000, actuators=actuators, sensors=sensors)
                except MemoryError:
                    os._exit(3)
                os._exit(0)
            print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
    """).split()
    assert set(ends) == {"0", "3"}
    assert ends == sorted(ends, reverse=True), "more room is never worse"


# Numbers


def fields():
    """Names of the fields that `Model.replace` takes: each is a property."""
    return [name for name in dir(stepper.Model) if isinstance(getattr(stepper.Model, name), property)]


def test_every_field_refuses_what_is_no_number():
    names = fields()
    assert len(names) > 40
    for name in names:
        given = np.array(getattr(MODEL, name))
        assert given.size, f"{name} has nothing in this scene"
        for at in {0, given.size // 2, given.size - 1}:
            for number in (np.nan, np.inf, -np.inf):
                wrong = given.copy()
                wrong.flat[at] = number
                is_no_bound = name in OPEN and number == (np.inf if at % 2 else -np.inf)
                if is_no_bound or (name in RIGID and number == np.inf) or np.array_equal(wrong, given):
                    MODEL.replace(**{name: wrong})
                    continue
                with pytest.raises(stepper.ModelError):
                    MODEL.replace(**{name: wrong})
                    pytest.fail(f"{name}[{at}] = {number} was taken")


def test_every_field_of_environments_refuses_what_is_no_number():
    sim = simulate(MODEL, 2)
    tried = 0
    for name in fields():
        given = np.stack([getattr(MODEL, name)] * 2)
        for at in {0, given.size // 2, given.size - 1}:
            for number in (np.nan, np.inf, -np.inf):
                wrong = given.copy()
                wrong.flat[at] = number
                if np.array_equal(wrong, given):
                    continue
                with pytest.raises(stepper.ModelError) as error:
                    sim.randomize(**{name: wrong})
                tried += "all environments share" not in str(error.value)
        assert not sim.randomized
    assert tried > 60
    sim.step()


@pytest.mark.parametrize("text", [
    SCENE.replace('density="1.2"', 'density="nan"'), SCENE.replace('wind="0 0 1"', 'wind="0 inf 1"'),
    SCENE.replace('viscosity="1e-5"', 'viscosity="-1"'), SCENE.replace('gravcomp=".5"', 'gravcomp="inf"'),
    SCENE.replace('<motor tendon="belt"/>', '<motor joint="a" gear="1e200"/>'),
    SCENE.replace('<motor tendon="belt"/>', '<motor joint="a" gear="1e200" armature="1"/>'),
])  # fmt: skip
def test_a_source_with_a_number_that_is_none_is_a_model_error(text):
    assert text != SCENE
    with pytest.raises(stepper.ModelError):
        stepper.load(text)


def test_a_state_beyond_the_numbers_of_the_lanes_is_refused():
    sim = simulate(stepper_model(HOPPER), 2, precision="f32")
    with pytest.raises(ValueError, match=r"qvel\[0\] of environment 0 is 1e39, must be at most 3.4e38 in 32 bits|32 bits"):
        sim.set_state(qvel=np.full(sim.model.nv, 1e39))
    simulate(stepper_model(HOPPER), 2).set_state(qvel=np.full(sim.model.nv, 1e39))


def test_a_model_beyond_the_numbers_of_the_lanes_is_refused():
    far = MODEL.replace(qpos0=np.where(np.arange(MODEL.nq) == 1, 1e200, MODEL.qpos0))
    raises(stepper.ModelError, 'field "qpos0": number 1 is 1e200, which is too large for 32 bits', simulate, far, precision="f32")
    simulate(far).step()
    with pytest.raises(ValueError, match="body_mass has 1e200, which 32 bits cannot hold"):
        simulate(MODEL, 1, precision="f32").randomize(body_mass=[[0, 1e200, 1, 1, 1]])


@pytest.mark.parametrize("env", [5, -3, 10**30, -(10**30)])
def test_an_environment_that_is_not_there_is_an_index_error(env):
    sim = simulate(stepper_model(HOPPER), 2)
    for call, said in ((sim.get_state, "must be below 2"), (sim.worst_row, "must be below 2"), (sim.contacts, "environments 0 to 1")):
        raises(IndexError, said, call, env)


# Arrays


def test_what_another_thread_writes_meanwhile_is_not_read():
    """A step reads what was applied when it was called, whole."""
    sim, other = simulate(MODEL, 64), simulate(MODEL, 64)
    mine, written = sim.xfrc_applied, []
    mine[:], other.xfrc_applied[:] = 0.25, 0.25

    def write():
        deadline = time.monotonic() + 60
        while not written and time.monotonic() < deadline:
            try:
                _ = sim.time
            except RuntimeError:
                # The step has begun, and is at work.
                mine[:] = 50.0
                written.append(True)

    thread = threading.Thread(target=write, daemon=True)
    thread.start()
    while not written:
        mine[:] = 0.25
        sim.step(nstep=100)
        other.step(nstep=100)
    thread.join()
    assert np.array_equal(sim.qpos, other.qpos)


@pytest.mark.parametrize(("attribute", "value"), [("dtype", "f4"), ("dtype", "i8"), ("dtype", "c16"), ("shape", (-1,))])
def test_an_array_that_was_made_something_else_is_an_error_and_not_a_crash(attribute, value):
    sim = simulate(MODEL, 2)
    setattr(sim.xfrc_applied, attribute, value)
    for call in (
        sim.step,
        sim.reset,
        sim.energy,
        lambda: sim.sensordata_ideal,
        lambda: sim.xpos,
        lambda: setattr(sim, "xfrc_applied", np.inf),
    ):
        raises(ValueError, r"xfrc_applied was changed in place to .*, must stay a float64 array \(2, 5, 6\)", call)


def test_a_rollout_too_large_for_memory_is_a_memory_error():
    quiet = stepper.load("<mujoco><worldbody><body><joint/><geom size='.1'/></body></worldbody></mujoco>")
    sim = simulate(quiet, 2)
    with pytest.raises(MemoryError):
        sim.rollout(np.zeros((10**13, 2, 0)))
