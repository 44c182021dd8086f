"""Kinds of inputs: how one is made of random numbers, what is done with it, and which exceptions are documented for that."""

import functools
import hashlib
import io
import json
import pickle
import re
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import stepper
from recordings import edit_file, edit_header

from fuzz import calls
from fuzz.scenes import ROBOT, SCENES

Random = np.random.Generator
NUMBERS = [0.0, -0.0, 1.0, -1.0, 1e-9, 1e9, 1e-300, 1e300, -1e300, 5e-324, np.nan, np.inf, -np.inf]


@dataclass(frozen=True)
class Case:
    """A kind of inputs.

    Attributes:
        run: Makes an input of random numbers, keeps it in the folder, and tries it.
        documented: What it may raise.
    """

    run: Callable[[Random, Path], None]
    documented: tuple[type[BaseException], ...]


@functools.cache
def model_of(name: str) -> stepper.Model:
    """The model of a scene."""
    return stepper.load(SCENES[name], strict=False)


def any_model(rng: Random) -> stepper.Model:
    """One of the scenes."""
    return model_of(str(rng.choice(list(SCENES))))


def mutated(rng: Random, data: bytes, first: int = 0) -> bytes:
    """Bytes with some changes from `first` on."""
    wrong = bytearray(data)
    for _ in range(int(rng.choice([1, 1, 1, 2, 3, 8]))):
        at = int(rng.integers(first, max(len(wrong), first + 1)))
        match int(rng.integers(8)):
            case 0 | 1 if at < len(wrong):
                wrong[at] ^= 1 << int(rng.integers(8))
            case 2 | 3 if at < len(wrong):
                wrong[at] = int(rng.choice([0, 1, 2, 0x7F, 0x80, 0xFF]))
            case 4:
                wrong[at : at + 8] = struct.pack("<d", rng.choice(NUMBERS))
            case 5:
                wrong[at : at + int(rng.integers(1, 30))] = b""
            case 6:
                wrong[at:at] = wrong[at : at + int(rng.integers(1, 30))]
            case _:
                wrong[at : at + 5] = b"\xff\xff\xff\xff\x0f"
    return bytes(wrong)


def try_stepping(rng: Random, model: stepper.Model) -> None:
    """What a model that was accepted has to do: step, and flag what it cannot."""
    precision = str(rng.choice(["f64", "f32"]))
    integrator = str(rng.choice(["midpoint", "implicit", "euler", "rk4"]))
    sim = stepper.Stepper(model, int(rng.integers(1, 4)), precision=precision, options=stepper.Options(integrator=integrator))
    sim.step(rng.uniform(-1, 1, model.nu), nstep=3)
    assert np.isfinite(sim.qpos).all() and np.isfinite(sim.qvel).all(), "a state that is not finite"
    _ = sim.sensordata, sim.sensordata_ideal, sim.xpos, sim.contacts(), sim.energy(), sim.mass_matrix()
    _ = sim.qfrc_constraint, sim.actuator_force
    model.explain()
    other = pickle.loads(pickle.dumps(sim))
    assert other.get_state() == sim.get_state()


def try_model(rng: Random, folder: Path) -> None:
    """A saved model, with a true checksum most of the time."""
    data = mutated(rng, any_model(rng).to_bytes(), 44)
    if rng.random() < 0.9:
        data = data[:12] + hashlib.sha256(data[44:]).digest() + data[44:]
    (folder / "input.stepper").write_bytes(data)
    try_stepping(rng, stepper.load(folder / "input.stepper"))


def simulation(rng: Random) -> stepper.Stepper:
    """A batch that remembers something."""
    model = any_model(rng)
    sensors = stepper.SensorModel(default=stepper.Transfer(delay=0.01, noise_std=0.1)) if rng.random() < 0.5 else None
    actuators = stepper.ActuatorModel(default=stepper.Drive(delay=0.01, lag=0.01)) if rng.random() < 0.5 else None
    num_envs = [None, 1, 3, 11][int(rng.integers(4))]
    sim = stepper.Stepper(model, num_envs, precision=str(rng.choice(["f64", "f32"])), sensors=sensors, actuators=actuators)
    sim.step(rng.uniform(-1, 1, model.nu), nstep=int(rng.integers(1, 20)))
    return sim


def signed_state(data: bytes) -> bytes:
    """Bytes of a state with a true checksum."""
    return data[:45] + hashlib.sha256(data[:45] + data[77:]).digest() + data[77:]


def try_state(rng: Random, folder: Path) -> None:
    """Bytes of a state, with a true checksum most of the time."""
    sim = simulation(rng)
    data = mutated(rng, sim.get_state().bytes, 77)
    if rng.random() < 0.9:
        data = signed_state(data)
    (folder / "input.state").write_bytes(data)
    sim.set_state(stepper.State(data))
    sim.step(nstep=3)
    assert np.isfinite(sim.qpos).all(), "a state that is not finite"
    _ = sim.sensordata, sim.sensordata_ideal, sim.contacts(), sim.sensor_faults, sim.actuator_saturation
    assert stepper.State(sim.get_state().bytes) == sim.get_state()


class Unpickler(pickle.Unpickler):
    """Finds what pickles of stepper name, and nothing else."""

    def find_class(self, module: str, name: str):
        """As `pickle.Unpickler`."""
        if module.split(".", maxsplit=1)[0] in ("stepper", "numpy") or (module, name) in [("functools", "partial"), ("_codecs", "encode")]:
            return super().find_class(module, name)
        raise pickle.UnpicklingError(f"{module}.{name}")


def try_pickle(rng: Random, folder: Path) -> None:
    """A pickle of a model, state or stepper. What `pickle` itself may raise is anything."""
    sim = simulation(rng)
    if sim.num_envs and rng.random() < 0.5:
        _ = sim.xfrc_applied, sim.qfrc_applied
    whole = [sim, sim.model, sim.get_state(), sim.get_state(0), sim.options, sim.sensors][int(rng.integers(6))]
    data = mutated(rng, pickle.dumps(whole))
    (folder / "input.pickle").write_bytes(data)
    found = Unpickler(io.BytesIO(data)).load()
    if isinstance(found, stepper.Stepper):
        found.step(nstep=2)
    elif isinstance(found, stepper.State):
        sim.set_state(found)
        sim.step(nstep=2)
    elif isinstance(found, stepper.Model):
        try_stepping(rng, found)


def try_recording(rng: Random, folder: Path) -> None:
    """A recording: bytes of a file, numbers of its arrays or of its header, behind true checksums or not."""
    sim = simulation(rng)
    with sim.record(folder / "run", chunk=int(rng.choice([1, 1 << 20]))):
        for k in range(3):
            if sim.num_envs and k == 1:
                sim.xfrc_applied[..., 2] = 1.0
            sim.step(nstep=2)
            if k == 1:
                sim.reset(seed=3)
    match int(rng.integers(3)):
        case 0:
            file = sorted((folder / "run").iterdir())[int(rng.integers(len(list((folder / "run").iterdir()))))]
            file.write_bytes(mutated(rng, file.read_bytes()))
        case 1:
            edit_file(folder / "run", functools.partial(_change_arrays, rng))
        case _:
            edit_header(folder / "run", functools.partial(_change_header, rng))
    str(stepper.recording.verify(folder / "run"))


def _change_arrays(rng: Random, arrays: dict[str, np.ndarray]) -> None:
    name = str(rng.choice(list(arrays)))
    array = np.array(arrays[name])
    match int(rng.integers(6)):
        case 0:
            del arrays[name]
        case 1 if array.size and array.dtype.kind == "f":
            array.flat[int(rng.integers(array.size))] = rng.choice(NUMBERS)
            arrays[name] = array
        case 2 if array.size and array.dtype.kind in "ui":
            array.flat[int(rng.integers(array.size))] = rng.choice([0, 1, 9, np.iinfo(array.dtype).max])
            arrays[name] = array
        case 3:
            arrays[name] = array[..., :-1] if array.ndim else np.array([array, array])
        case 4:
            arrays[str(rng.choice(["0/mask", "0/randomized/body_mass", "1/seed", "9/qpos", "x", "0/keyframe"]))] = array
        case _:
            arrays[name] = array.astype(str(rng.choice(["f4", "i8", "U9", "c16", "?"])))


def _change_header(rng: Random, head: dict) -> None:
    place: dict | list = head
    for _ in range(4):
        keys = list(place) if isinstance(place, dict) else list(range(len(place)))
        if not keys:
            return
        key = keys[int(rng.integers(len(keys)))]
        if isinstance(place[key], (dict, list)) and rng.random() < 0.7:
            place = place[key]
            continue
        values = [None, -1, 0, 1, 2.5, 1e300, 10**30, "", "x", [], {}, True, float("nan"), json.loads("[[[]]]"), 3]
        place[key] = values[int(rng.integers(len(values)))]
        return


def try_mjcf(rng: Random, folder: Path) -> None:
    """MJCF with other numbers and words, as far as MuJoCo's compiler takes it."""
    text = SCENES[str(rng.choice(list(SCENES)))]
    words = ["0", "1", "-1", "1e-9", "1e9", "1e200", "-1e200", "nan", "inf", "1e-200", "3", "true", "x", "", "0 0 0", "1 1 1"]
    for _ in range(int(rng.choice([1, 1, 2, 4]))):
        found = list(re.finditer(r'"([^"]*)"', text))
        span = found[int(rng.integers(len(found)))].span(1)
        old = text[slice(*span)].split()
        if old and rng.random() < 0.7:
            old[int(rng.integers(len(old)))] = str(rng.choice(words))
        else:
            old = [str(rng.choice(words))]
        text = text[: span[0]] + " ".join(old) + text[span[1] :]
    if rng.random() < 0.1:
        text = text[: int(rng.integers(len(text)))]
    (folder / "input.xml").write_text(text)
    try:
        compiled = mujoco.MjModel.from_xml_string(text)
    except (ValueError, mujoco.FatalError):
        return stepper.load(text) and None
    try_stepping(rng, stepper.load(compiled, strict=bool(rng.random() < 0.5)))


def try_calls(rng: Random, folder: Path) -> None:
    """A few public calls with arguments that are right, wrong, or out of all measure; after them the stepper still works."""
    calls.misuse(rng, model_of(ROBOT), folder)


WRONG = (ValueError, MemoryError)
KINDS = {
    "model": Case(try_model, WRONG),
    "state": Case(try_state, WRONG),
    "pickle": Case(try_pickle, (Exception,)),
    "recording": Case(try_recording, (stepper.recording.RecordingError, OSError, MemoryError)),
    "mjcf": Case(try_mjcf, (*WRONG, OSError)),
    "call": Case(try_calls, ()),
}
