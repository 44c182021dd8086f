"""Misuse of every public call: arguments that are right, of a wrong shape or type, or out of all measure."""

import copy
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import stepper

Random = np.random.Generator

DOCUMENTED = (ValueError, TypeError, IndexError, KeyError, MemoryError, OSError)
"""What a call may raise for its arguments."""
EXPECTED = ("recorded", "cannot be started", "cannot be assigned", "has no attribute", "must be a stepper.")
"""Words of the other errors that misuse leads to: a rollout of a recorded stepper, threads refused, attributes that nothing has."""


def nonsense(rng: Random, sim: stepper.Stepper) -> Any:
    """A value that hardly any argument takes."""
    values: list[Callable[[], Any]] = [
        lambda: None,
        lambda: -1,
        lambda: 0,
        lambda: 2.5,
        lambda: 10**30,
        lambda: -(10**30),
        lambda: 2**64 - 1,
        lambda: 2**63,
        lambda: float("nan"),
        lambda: float("inf"),
        lambda: "x",
        lambda: "",
        lambda: "\0",
        lambda: "\ud800",
        lambda: b"x",
        lambda: [],
        lambda: {},
        lambda: (),
        lambda: [[1, 2], [3]],
        object,
        lambda: Exception,
        lambda: sim,
        lambda: sim.model,
        sim.get_state,
        lambda: True,
        lambda: np.float32(1.5),
        lambda: np.int64(-3),
        lambda: np.zeros(0),
        lambda: np.zeros((0, 3)),
        lambda: np.array(3.0),
        lambda: np.array("x"),
        lambda: np.array([None, 1], dtype=object),
        lambda: np.zeros(3, dtype="c16"),
        lambda: np.zeros(3, dtype=[("a", "f8")]),
        lambda: np.full((3, 3), "2026-01-01", dtype="M8[D]"),
        lambda: np.broadcast_to(0.0, (10**6, 10**6)),
        lambda: np.broadcast_to(np.float64(1.0), (3, sim.model.nv)),
        lambda: np.ma.masked_all(3),
        lambda: memoryview(b"12345678"),
    ]
    return values[int(rng.integers(len(values)))]()


def array(rng: Random, shape: tuple[int, ...]) -> Any:
    """Numbers of a shape, or of one near it, laid out in some way."""
    if rng.random() < 0.15:
        shape = tuple(max(n + int(rng.integers(-1, 2)), 0) for n in shape)
    if rng.random() < 0.1:
        shape = shape[1:]
    numbers: Any = rng.normal(size=shape)
    if numbers.size and rng.random() < 0.3:
        numbers.flat[int(rng.integers(numbers.size))] = rng.choice([np.nan, np.inf, -np.inf, 1e300, -1e300, 1e-300, 0.0, 1e9])
    ways: list[Callable[[Any], Any]] = [
        np.ndarray.tolist,
        np.asfortranarray,
        lambda x: x.astype(">f8"),
        lambda x: x.astype("f4"),
        _frozen,
        _unaligned,
        lambda x: np.repeat(x, 2, axis=-1)[..., ::2] if x.ndim else x,
    ]
    return ways[int(rng.integers(len(ways)))](numbers) if rng.random() < 0.7 else numbers


def _frozen(numbers: Any) -> Any:
    numbers.flags.writeable = False
    return numbers


def _unaligned(numbers: Any) -> Any:
    raw = np.zeros(numbers.nbytes + 1, np.uint8)
    found = raw[1 : 1 + numbers.nbytes].view("f8").reshape(numbers.shape)
    found[...] = numbers
    return found


class Attempts:
    """Makes calls and writes down which, for whoever wants to make them again."""

    def __init__(self, folder: Path):
        self._file, self._lines = folder / "calls.txt", list[str]()

    def __call__(self, name: str, call: Callable[..., Any], *arguments: Any, **keywords: Any) -> None:
        """Makes a call; what it may raise is written down too."""
        shown = ", ".join([*map(_shown, arguments), *(f"{key}={_shown(value)}" for key, value in keywords.items())])
        self._write(f"{name}({shown})")
        try:
            call(*arguments, **keywords)
        except DOCUMENTED as error:
            assert str(error), "an error without a word"
            self._write(f"    {type(error).__name__}: {error}"[:200])
        except (RuntimeError, AttributeError) as error:
            if not any(word in str(error) for word in EXPECTED):
                raise

    def _write(self, line: str) -> None:
        self._lines.append(line)
        self._file.write_text("\n".join(self._lines) + "\n", errors="replace")


def misuse(rng: Random, model: stepper.Model, folder: Path) -> None:
    """Makes a stepper, misuses it a few times, and looks whether it still works."""
    attempt = Attempts(folder)
    num_envs = [None, 1, 2, 3, 9][int(rng.integers(5))]
    sim = stepper.Stepper(model, num_envs, precision=str(rng.choice(["f64", "f32"])), threads=int(rng.integers(1, 3)))
    for _ in range(int(rng.integers(1, 7))):
        name = list(CALLS)[int(rng.integers(len(CALLS)))]
        arguments, keywords = CALLS[name](rng, sim, folder)
        places = [*range(len(arguments)), *keywords]
        if places and rng.random() < 0.4:
            place = places[int(rng.integers(len(places)))]
            given: Any = arguments if isinstance(place, int) else keywords
            given[place] = nonsense(rng, sim)
        if name in ("step", "rollout") and _endless(keywords.get("nstep")):
            keywords["nstep"] = -1
        owner, _, method = name.rpartition(".")
        where: Any = {"": sim, "Model": model, "stepper": stepper, "stepper.recording": stepper.recording}[owner]
        if method.startswith("set "):
            attempt(name, setattr, where, method.removeprefix("set "), *arguments)
        elif method in FUNCTIONS:
            attempt(name, FUNCTIONS[method], where, *arguments, **keywords)
        else:
            attempt(name, getattr(where, method), *arguments, **keywords)
    look(sim, attempt)


def look(sim: stepper.Stepper, attempt: Attempts) -> None:
    """Whether a stepper that was misused works, and says what was made of its arrays."""
    if isinstance(sim.recorder, stepper.Recorder):
        sim.recorder.close()
    sim.recorder = None
    for name in ("qfrc_applied", "xfrc_applied", "mocap_pos", "mocap_quat"):
        own = getattr(sim, name)
        if own.dtype != float or not own.flags.c_contiguous or own.shape != _shape_of(sim, name):
            attempt("step", sim.step)
            attempt("reset", sim.reset)
            return
    sim.randomize()
    sim.reset()
    sim.step(np.zeros(sim.model.nu), nstep=2)
    assert np.isfinite(sim.qpos).all(), "a state that is not finite"
    _ = sim.sensordata, sim.sensordata_ideal, sim.qfrc_bias, sim.qacc_smooth, sim.xpos, sim.contacts(), sim.memory(), repr(sim)
    _ = sim.qacc, sim.body_contact_force, sim.subtree_com


def _endless(nstep: Any) -> bool:
    """Whether so many steps are right, and would not end."""
    try:
        return int(nstep) > 1000
    except (TypeError, ValueError, OverflowError):
        return False


def _shown(value: Any) -> str:
    try:
        text = repr(value)
    except Exception:
        text = object.__repr__(value)
    return text if len(text) < 300 else f"{text[:200]} ... {getattr(value, 'shape', '')} {getattr(value, 'dtype', '')}"


def _tail(sim: stepper.Stepper, *tail: int) -> tuple[int, ...]:
    return tail if sim.num_envs is None else (sim.num_envs, *tail)


def _shape_of(sim: stepper.Stepper, name: str) -> tuple[int, ...]:
    """Of a writable array."""
    tails = {"qfrc_applied": (sim.model.nv,), "xfrc_applied": (sim.model.nbody, 6), "mocap_pos": (1, 3), "mocap_quat": (1, 4)}
    return _tail(sim, *tails[name])


def _envs(rng: Random, sim: stepper.Stepper) -> Any:
    n = sim.num_envs or 1
    mask, order = rng.random(n) < 0.5, rng.permutation(n)[: int(rng.integers(0, n + 1))]
    given = [None, mask, mask.tolist(), np.arange(n), np.zeros(n, bool), order, order.tolist(), [-1], [n], [0, 0], [0.5], "x"]
    return given[int(rng.integers(len(given)))]


def _state(rng: Random, sim: stepper.Stepper) -> dict[str, Any]:
    m = sim.model
    shapes = {"qpos": _tail(sim, m.nq), "qvel": _tail(sim, m.nv), "act": _tail(sim, m.na), "time": _tail(sim)}
    return {name: array(rng, shape) for name, shape in shapes.items() if rng.random() < 0.5}


def _fields(rng: Random, sim: stepper.Stepper, lead: tuple[int, ...]) -> dict[str, Any]:
    names = ["gravity", "body_mass", "body_ipos", "body_inertia", "geom_friction", "geom_restitution", "geom_size", "geom_pos"]
    names += ["jnt_stiffness", "jnt_range", "dof_damping", "dof_armature", "dof_frictionloss", "actuator_gainprm", "actuator_biasprm"]
    names += ["timestep", "qpos0", "wind", "density", "body_quat", "geom_condim", "eq_data", "tendon_range", "colour"]
    fields: dict[str, Any] = {}
    for name in rng.choice(names, int(rng.integers(0, 3))):
        now = np.asarray(getattr(sim.model, str(name), np.zeros(3)))
        given = np.broadcast_to(now, lead + now.shape).copy()
        if given.size and rng.random() < 0.7:
            given.flat[int(rng.integers(given.size))] *= rng.choice([0.0, -1.0, 2.0, 1e300, np.nan, np.inf, 1.1])
        fields[str(name)] = None if rng.random() < 0.1 else given if rng.random() < 0.8 else array(rng, given.shape)
    return fields


def _rollout(rng: Random, sim: stepper.Stepper, _: Path) -> tuple[list[Any], dict[str, Any]]:
    m, calls = sim.model, int(rng.integers(0, 4))
    keywords: dict[str, Any] = {"nstep": int(rng.integers(0, 3))}
    if rng.random() < 0.3:
        keywords["fields"] = list(rng.choice(["qpos", "qvel", "act", "sensordata", "x"], int(rng.integers(0, 4))).tolist())
    if rng.random() < 0.4:
        real = "f8" if sim.precision == "f64" else "f4"
        shared = np.zeros((calls, *_tail(sim, m.nq)), real)
        out = {"qpos": shared, "qvel": np.zeros((calls, *_tail(sim, m.nv)), real), "status": np.zeros((calls, *_tail(sim)), "u4")}
        if rng.random() < 0.2:
            out["sensordata"] = shared
        if rng.random() < 0.2:
            out["qvel"] = nonsense(rng, sim)
        keywords["out"] = out
    return [array(rng, (calls, *_tail(sim, m.nu)))], keywords


def _reset(rng: Random, sim: stepper.Stepper, _: Path) -> tuple[list[Any], dict[str, Any]]:
    keywords = {name: values for name, values in _state(rng, sim).items() if name in ("qpos", "qvel")}
    keywords["seed"] = [None, 3, -1, 2**64][int(rng.integers(4))]
    keywords["keyframe"] = [None, "up", 0, -1, 7, "x"][int(rng.integers(6))]
    return [_envs(rng, sim)], keywords


def _randomize(rng: Random, sim: stepper.Stepper, _: Path) -> tuple[list[Any], dict[str, Any]]:
    fields = _fields(rng, sim, _tail(sim))
    if rng.random() < 0.2:
        fields["actuators"] = _actuator_model(rng)
    return [_envs(rng, sim)], fields


def _make(rng: Random, sim: stepper.Stepper, _: Path) -> tuple[list[Any], dict[str, Any]]:
    options = {
        "timestep": [None, 0.001, -1.0, 0.0, 1e300, 1e-300, float("nan"), "x"],
        "integrator": ["midpoint", "rk4", "x", None],
        "solver": ["auto", "newton", "pgs", 3],
        "iterations": [1, 0, -1, 10**30, 2**32, 2.5],
        "tolerance": [None, 1e-6, 0.0, -1.0, float("nan"), float("inf")],
        "slop": [0.0, -1.0, 1e300, float("nan")],
        "baumgarte": [0.0, 1.0, 2.0, -1.0],
        "max_contacts": [None, 0, 1, 10**9, 2**32, -1],
    }
    chosen = {name: values[int(rng.integers(len(values)))] for name, values in options.items() if rng.random() < 0.2}
    counts = [None, 1, 3, 0, -1, 10**6, 10**9, 10**15, 2**63, 2**64 - 1]
    keywords: dict[str, Any] = {
        "options": chosen,
        "precision": str(rng.choice(["f64", "f32", "f16"])),
        "threads": [0, 1, 5, -1, 10**9, 2**64 - 1, 2**63][int(rng.integers(7))],
        "seed": [0, 2**64 - 1, 2**64, -1][int(rng.integers(4))],
    }
    if rng.random() < 0.3:
        keywords["sensors"] = _sensor_model(rng)
    if rng.random() < 0.3:
        keywords["actuators"] = _actuator_model(rng)
    return [sim.model, counts[int(rng.integers(len(counts)))]], keywords


def _sensor_model(rng: Random) -> Any:
    names = ["delay", "noise_std", "bias", "bias_std", "dropout", "period", "drift_std", "drift_time", "quantization", "jitter"]
    numbers = [0.0, 1e-3, 0.02, -1.0, 1e9, 1e300, float("nan"), float("inf"), [0.01, 0.02, 0.03], None]
    given = {str(name): numbers[int(rng.integers(len(numbers)))] for name in rng.choice(names, 2)}
    try:
        return stepper.SensorModel(default=stepper.Transfer(**given))
    except DOCUMENTED:
        return None


def _actuator_model(rng: Random) -> Any:
    numbers = [0.0, 1e-3, 0.02, -1.0, 1e9, 1e300, float("nan"), float("inf"), [0.01, 0.02, 0.03], None]
    given = {str(name): numbers[int(rng.integers(len(numbers)))] for name in rng.choice(["delay", "lag", "delay_steps", "friction"], 2)}
    try:
        return stepper.ActuatorModel(default=stepper.Drive(**given))
    except DOCUMENTED:
        return None


def _new(model: Any, *arguments: Any, options: dict[str, Any], **keywords: Any) -> None:
    """Makes options and another stepper, and steps it."""
    other = stepper.Stepper(*arguments, options=stepper.Options(**options), **keywords)
    if (other.num_envs or 1) <= 1000:
        other.step(nstep=2)
        _ = other.sensordata
        pickle.loads(pickle.dumps(other))


def _replaced(model: Any, **fields: Any) -> None:
    """Makes another model and steps it."""
    stepper.Stepper(model.replace(**fields), 2).step(nstep=2)


def _all_attributes(sim: Any) -> None:
    for name in dir(sim):
        if not name.startswith("__"):
            getattr(sim, name)


def _reinterpret(sim: Any, name: str, attribute: str, value: Any) -> None:
    """NumPy lets whoever has an array make something else of it."""
    setattr(getattr(sim, name), attribute, value)


Made = tuple[list[Any], dict[str, Any]]
FUNCTIONS: dict[str, Callable[..., Any]] = {
    "new": _new,
    "replaced": _replaced,
    "attributes": _all_attributes,
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "pickle": lambda sim: pickle.loads(pickle.dumps(sim)),
    "reinterpret": _reinterpret,
}
CALLS: dict[str, Callable[[Random, stepper.Stepper, Path], Made]] = {
    "step": lambda rng, sim, _: ([array(rng, _tail(sim, sim.model.nu))], {"nstep": int(rng.integers(-1, 4))}),
    "rollout": _rollout,
    "reset": _reset,
    "set_state": lambda rng, sim, _: ([], _state(rng, sim) | {"envs": _envs(rng, sim), "keep_warmstart": bool(rng.random() < 0.5)}),
    "stepper.State": lambda rng, sim, _: ([sim.get_state().bytes], {}),
    "get_state": lambda rng, sim, _: ([int(rng.integers(-4, 10))], {}),
    "contacts": lambda rng, sim, _: ([int(rng.integers(-4, 10))], {}),
    "energy": lambda rng, sim, _: ([], {}),
    "momentum": lambda rng, sim, _: ([], {}),
    "mass_matrix": lambda rng, sim, _: ([], {}),
    "rays": lambda rng, sim, _: ([array(rng, (3, 3)), array(rng, (3, 3))], {"exclude": int(rng.integers(-2, 9))}),
    "observe": lambda rng, sim, _: ([array(rng, _tail(sim, sim.model.nsensordata))], {}),
    "randomize": _randomize,
    "set qfrc_applied": lambda rng, sim, _: ([array(rng, _tail(sim, sim.model.nv))], {}),
    "set xfrc_applied": lambda rng, sim, _: ([array(rng, _tail(sim, sim.model.nbody, 6))], {}),
    "set mocap_pos": lambda rng, sim, _: ([array(rng, _tail(sim, 1, 3))], {}),
    "set mocap_quat": lambda rng, sim, _: ([array(rng, _tail(sim, 1, 4))], {}),
    "set qpos": lambda rng, sim, _: ([array(rng, _tail(sim, sim.model.nq))], {}),
    "set recorder": lambda rng, sim, _: ([None], {}),
    "record": lambda rng, sim, folder: ([folder / f"run{int(rng.integers(3))}"], {"chunk": int(rng.integers(0, 100))}),
    "attributes": lambda rng, sim, _: ([], {}),
    "copy": lambda rng, sim, _: ([], {}),
    "deepcopy": lambda rng, sim, _: ([], {}),
    "pickle": lambda rng, sim, _: ([], {}),
    "reinterpret": lambda rng, sim, _: (
        [
            str(rng.choice(["qfrc_applied", "xfrc_applied", "mocap_pos"])),
            *[("dtype", "f4"), ("dtype", "i8"), ("dtype", "c16"), ("shape", (-1,)), ("strides", (0, 0)), ("strides", (0, 0, 0))][
                int(rng.integers(6))
            ],
        ],
        {},
    ),
    "__setstate__": lambda rng, sim, _: ([sim.__getstate__() | ({"applied": [array(rng, (3,))] * 4} if rng.random() < 0.5 else {})], {}),
    "stepper.new": _make,
    "Model.replaced": lambda rng, sim, _: ([], _fields(rng, sim, ())),
    "Model.replace": lambda rng, sim, _: ([], _fields(rng, sim, ())),
    "Model.save": lambda rng, sim, folder: ([folder / "m.stepper"], {}),
    "Model.geoms_seen_from": lambda rng, sim, _: ([int(rng.integers(-2, 3))], {}),
    "Model.with_sensors": lambda rng, sim, _: ([{"fan": stepper.sensors.Combination({"servo": 1.0})}], {}),
    "stepper.load": lambda rng, sim, folder: ([folder / "m.stepper"], {"strict": True}),
    "stepper.recording.verify": lambda rng, sim, folder: ([folder / "run0"], {"threads": 1}),
}
