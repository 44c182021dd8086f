"""What drives a study: recorded controls, a script, a policy, or controls at random."""

from __future__ import annotations

import functools
import hashlib
import importlib
import importlib.util
import inspect
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper.experiments.study.worlds import World

Array = NDArray[np.float64]
Drive = Callable[[World], Any]
"""From a `World`, controls (num_envs, nu) or (nu,), or None, which holds those in force. One with a method `begin(now)` is told of
starts."""


class Recorded:
    """Controls of a file, one after the other; the last is held.

    Args:
        path: An .npz with "ctrl": (T, nu), or (T, n, nu) for the episodes 0 to n - 1, after which they repeat.

    Raises:
        ValueError: The file has no such array.
    """

    def __init__(self, path: Path):
        with np.load(path, allow_pickle=False) as file:
            if "ctrl" not in file:
                raise ValueError(f'{path}: it has {sorted(file)}, must have "ctrl" (T, nu) or (T, n, nu)')
            self.ctrl = np.asarray(file["ctrl"], float)
        if self.ctrl.ndim not in (2, 3) or not len(self.ctrl):
            raise ValueError(f'{path}: "ctrl" has the shape {self.ctrl.shape}, must be (T, nu) or (T, n, nu)')
        if not np.isfinite(self.ctrl).all():
            raise ValueError(f'{path}: "ctrl" has numbers that are not finite')
        self._row = 0

    def begin(self, _: World) -> None:
        """Goes back to the first row."""
        self._row = 0

    def __call__(self, now: World) -> Array:
        """The next row."""
        row: Array = self.ctrl[min(self._row, len(self.ctrl) - 1)]
        self._row += 1
        return row if row.ndim == 1 else row[now.episodes % len(row)]


class Random:
    """Controls at random within their ranges (without a range: -1 to 1), each episode its own, whatever batch it is in.

    Args:
        seed: Of what is random.
        hold: Controls for which one is held.
    """

    def __init__(self, seed: int, hold: int = 1):
        self.seed, self.hold, self._count = seed, hold, 0
        self._streams: list[np.random.Generator] = []

    def begin(self, now: World) -> None:
        """Begins the streams of the episodes anew."""
        self._count = 0
        self._streams = [np.random.default_rng([self.seed, int(e), 1]) for e in now.episodes]
        bounds = np.asarray(now.model.actuator_ctrlrange, float).reshape(now.model.nu, 2)
        self._low, self._high = np.where(np.isfinite(bounds), bounds, [-1.0, 1.0]).T

    def __call__(self, _: World) -> Array | None:
        """New controls, or None while the old ones are held."""
        self._count += 1
        if (self._count - 1) % self.hold:
            return None
        return np.array([stream.uniform(self._low, self._high) for stream in self._streams])


class Policy:
    """A policy: a function of observations (num_envs, nsensordata) that returns controls.

    Args:
        act: The function; what it returns may be a torch tensor.
    """

    def __init__(self, act: Callable[[Array], Any]):
        self.act = act

    def __call__(self, now: World) -> Array:
        """Controls for what the sensors say."""
        made = self.act(now.observation)
        return np.asarray(made.detach().cpu().numpy() if hasattr(made, "detach") else made, float)


def find(reference: str, folder: Path) -> Any:
    """What "module:name" or "file.py:name" stands for; files are found beside the study.

    Raises:
        ValueError: There is no such module, file or name.
    """
    place, _, name = reference.rpartition(":")
    if not place or not name:
        raise ValueError(f'{reference!r} must be "module:function" or "file.py:function"')
    try:
        module = load_file(folder / place) if place.endswith(".py") else importlib.import_module(place)
    except (ModuleNotFoundError, FileNotFoundError) as error:
        raise ValueError(f"{reference!r}: {error}") from error
    if not hasattr(module, name):
        raise ValueError(f"{reference!r}: {place} has no {name!r}")
    return getattr(module, name)


def load_file(path: Path) -> ModuleType:
    """The module of a file, imported once."""
    path = path.resolve()
    # Not the bare stem, which another module may have.
    name = f"stepper_study_{path.stem}_{hashlib.sha256(str(path).encode()).hexdigest()[:8]}"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, path)
        if spec is None or spec.loader is None or not path.exists():
            raise FileNotFoundError(f"there is no file {path}")
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        try:
            spec.loader.exec_module(module)
        except BaseException:
            del sys.modules[name]
            raise
    return sys.modules[name]


def digest_of(thing: Any) -> str:
    """SHA-256 of a drive or measure.

    Of a function: its name, the file that it is in, and what it holds from around it; of an object: its class likewise, and its attributes
    but for those that begin with an underscore, which are its memory; of recorded controls: the numbers; of words: themselves.
    """
    if isinstance(thing, Policy):
        return digest_of(thing.act)
    if isinstance(thing, Recorded):
        return hashlib.sha256(thing.ctrl.tobytes() + str(thing.ctrl.shape).encode()).hexdigest()
    if isinstance(thing, Random):
        thing = f"random {thing.seed} {thing.hold}"
    if thing is None or isinstance(thing, str):
        return hashlib.sha256(repr(thing).encode()).hexdigest()
    if isinstance(thing, functools.partial):
        parts = [digest_of(thing.func).encode(), *map(_plain, thing.args), _plain(thing.keywords)]
        return hashlib.sha256(b"".join(parts)).hexdigest()
    found = hashlib.sha256(name_of(thing).encode())
    file = _file_of(thing)
    if file is not None:
        found.update(file.read_bytes())
    if hasattr(thing, "__code__") and (file is None or "<" in thing.__qualname__):
        # Functions of a file that have one name: lambdas, and those within functions.
        found.update(_code(thing.__code__))
    for cell in getattr(thing, "__closure__", None) or ():
        found.update(_plain(cell.cell_contents))
    if not inspect.isroutine(thing) and not inspect.isclass(thing):
        found.update(_plain({name: value for name, value in vars(thing).items() if not name.startswith("_")}))
    return found.hexdigest()


def _file_of(thing: Any) -> Path | None:
    """The file of a function or of the class of an object; None of what was typed in."""
    owner = thing if inspect.isroutine(thing) or inspect.isclass(thing) else type(thing)
    try:
        file = inspect.getsourcefile(owner)
    except TypeError:
        return None
    return Path(file) if file is not None and Path(file).exists() else None


def _code(code: CodeType) -> bytes:
    constants = b"".join(_code(c) if isinstance(c, CodeType) else repr(c).encode() for c in code.co_consts)
    return code.co_code + constants + repr(code.co_names).encode()


def _plain(value: Any) -> bytes:
    """What a drive holds: numbers, words and arrays by value, functions by their digest, of all else the type."""
    if isinstance(value, np.ndarray):
        return value.tobytes() + str((value.dtype, value.shape)).encode()
    if isinstance(value, Mapping):
        return b"".join(str(name).encode() + _plain(own) for name, own in sorted(value.items(), key=lambda item: str(item[0])))
    if isinstance(value, tuple | list):
        return b"".join(map(_plain, value))
    if isinstance(value, int | float | str | bool | bytes | None):
        return repr(value).encode()
    return digest_of(value).encode() if inspect.isroutine(value) else type(value).__qualname__.encode()


def name_of(thing: Any) -> str:
    """A drive or measure in words: the name of its file, and its own."""
    if isinstance(thing, str) or thing is None:
        return str(thing or "nothing")
    if isinstance(thing, Policy):
        return f"policy {name_of(thing.act)}"
    if isinstance(thing, functools.partial):
        return name_of(thing.func)
    name = getattr(thing, "__qualname__", type(thing).__qualname__)
    file = _file_of(thing)
    return name if file is None or type(thing).__module__.startswith("stepper.") else f"{file.name}:{name}"
