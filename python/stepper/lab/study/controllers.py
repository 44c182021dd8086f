"""Controllers of a study: policies and random controls; digests of controllers and measures (functions of outcomes)."""

from __future__ import annotations

import ast
import contextlib
import functools
import hashlib
import importlib
import importlib.util
import inspect
import io
import pickle
import sys
from collections.abc import Callable, Collection
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper.lab.study.worlds import World
from stepper.shared.arguments import check_takes
from stepper.shared.files import existing

Array = NDArray[np.float64]
FILES = "stepper_study_"
"""Prefix of the names under which `load_file` imports Python files of studies."""
Controller = Callable[[World], Any]
"""Function of a `World` that returns controls (num_envs, nu) or (nu,), or None to keep the last controls. If it has
a method `begin(now)`, the method is called at the start of each batch."""


class Random:
    """Controller with uniform random controls within their ranges (without a range: -1 to 1).

    The controls of an episode depend on the seed and the number of the episode, not on its batch.

    Args:
        seed: Seed of the random numbers.
    """

    def __init__(self, seed: int):
        self.seed = seed
        self._streams: list[np.random.Generator] = []

    def begin(self, now: World) -> None:
        """Restart the controller's random numbers at the start of a batch of episodes."""
        self._streams = [np.random.default_rng([self.seed, int(e), 1]) for e in now.episodes]
        bounds = np.asarray(now.model.actuator_ctrlrange, float).reshape(now.model.nu, 2)
        self._low, self._high = np.where(np.isfinite(bounds), bounds, [-1.0, 1.0]).T

    def __call__(self, _: World) -> Array:
        """New controls, (num_envs, nu), in the actuators' units."""
        return np.array([stream.uniform(self._low, self._high) for stream in self._streams])


class PolicyController:
    """Controller that calls a policy, which maps sensor readings (num_envs, nsensordata) to controls (num_envs, nu).

    Args:
        act: Policy: a function of arrays that returns an array or a torch tensor, such as a `stepper.policies.Policy`. A policy with
            internal state needs a method `begin(now)`, which is called at the start of each batch.
    """

    def __init__(self, act: Callable[[Array], Any]):
        check_takes(act, ["observations"], "act")
        self.act = act

    def begin(self, now: World) -> None:
        """Calls the policy's method `begin` at the start of a batch, if it has one."""
        if hasattr(self.act, "begin"):
            self.act.begin(now)

    def __call__(self, now: World) -> Array:
        """Controls for the current sensor readings, (num_envs, nu) or (nu,), in the actuators' units."""
        made = self.act(now.sensordata)
        controls = np.asarray(made.detach().cpu().numpy() if hasattr(made, "detach") else made, float)
        if controls.shape not in ((now.num_envs, now.model.nu), (now.model.nu,)):
            raise ValueError(
                f"the policy {name_of(self.act)} returned the shape {controls.shape}, must be (num_envs, nu), which is "
                f"({now.num_envs}, {now.model.nu})"
            )
        return controls


def find(reference: str, folder: Path) -> Any:
    """Python object that a text names, in the form "module:name" or "file.py:name".

    Args:
        reference: The text.
        folder: Folder of the study, to which paths of files are relative.

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
    """Python module from a file, imported once. It can import modules of its folder, which becomes the last entry of `sys.path`."""
    path = path.resolve()
    if str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))
    # The stem alone may be the name of another module.
    name = f"{FILES}{path.stem}_{hashlib.sha256(str(path).encode()).hexdigest()[:8]}"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, path)
        existing(path, "Python")
        if spec is None or spec.loader is None:
            raise ValueError(f"{path}: the ending is {path.suffix!r}, must be .py")
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        try:
            spec.loader.exec_module(module)
        except BaseException as error:
            del sys.modules[name]
            if isinstance(error, SyntaxError) and error.filename is None:  # As for a file with null bytes.
                error.filename = str(path)
            raise
    return sys.modules[name]


def digest_of(thing: Any) -> str:
    """SHA-256 of a controller, or of a measure (the function of an outcome). Controllers with equal digests give equal results.

    * Function: its name, file, default arguments, closure variables, and the object of which it is a method. Modules that the file imports
      from the folder of a study are included.
    * Object or function with an attribute `digest`, the version that its author declares: that attribute.
    * Other object: its class, its `state_dict()` if it has one, and its attributes, recursively. Attributes whose names begin with an
      underscore are internal state and are left out.
    * Number, text, array and others: what `pickle` stores of them.
    """
    content = io.BytesIO()
    try:
        _Pickler(content, protocol=5).dump(thing)
    except (TypeError, AttributeError, pickle.PicklingError) as error:
        raise TypeError(
            f"{name_of(thing)} has no digest, so that the journal could not distinguish its rows from those of another: {error}. Give it, "
            "or the object that has the part, an attribute `digest`, a str that declares its version. If rows do not depend on the part, "
            "begin its name with an underscore"
        ) from error
    return hashlib.sha256(content.getvalue()).hexdigest()


class StateCheck:
    """Check that a controller without a method `begin` carries no state from one batch to the next.

    Args:
        controller: The controller, before its batch.
    """

    def __init__(self, controller: Any):
        # `PolicyController.begin` calls the method `begin` of its function if there is one.
        self._controller = controller.act if isinstance(controller, PolicyController) else controller
        self._restarts = hasattr(self._controller, "begin")
        self._before = {} if self._restarts else self._held()

    def check(self) -> None:
        """Raises ValueError if an attribute or closure variable of the controller changed during the batch.

        Controllers with a method `begin` are not checked. Variables without a digest are not checked either, and variables
        that were missing, None or empty before the batch, because they may be caches.
        """
        if self._restarts:
            return
        now = self._held()
        changed = [name for name, before in self._before.items() if before is not None and now.get(name, before) != before]
        if changed:
            raise ValueError(
                f"the controller {name_of(self._controller)} has changed {', '.join(changed)} in a batch and has no method begin(now): "
                "the next batch would continue with the changed value, and results would depend on how episodes are batched. Make it a "
                f"class with a method begin(now) that resets {', '.join(changed)} (an empty method, if no control depends on them)"
            )

    def _held(self) -> dict[str, str | None]:
        """Digest of each attribute and closure variable of the controller, by name; None for those that are empty or have no digest."""
        owner = getattr(self._controller, "__self__", self._controller)
        held = {} if isinstance(owner, ModuleType) else dict(getattr(owner, "__dict__", {}))
        names = getattr(getattr(self._controller, "__code__", None), "co_freevars", ())
        for name, cell in zip(names, getattr(self._controller, "__closure__", None) or (), strict=True):
            with contextlib.suppress(ValueError):
                held[name] = cell.cell_contents
        return {name: _state_of(value) for name, value in held.items()}


def _state_of(value: Any) -> str | None:
    """Digest of an attribute or closure variable of a controller. None if the value is None, an empty collection, or has no digest."""
    if value is None or (isinstance(value, Collection) and not isinstance(value, np.ndarray) and not len(value)):
        return None
    try:
        return digest_of(value)
    except TypeError:
        return None


class _Pickler(pickle.Pickler):
    """Pickler of a controller for its digest. Functions and classes are stored with their source files, objects by public attributes."""

    def reducer_override(self, value: Any) -> Any:
        """Reduced form of an object: a tuple of the parts that the digest depends on, or NotImplemented for pickle's own form."""
        parts: list[Any] | None = None
        if inspect.isclass(value):
            parts = self._class(value)
        elif isinstance(declared := getattr(value, "digest", None), str | bytes):
            parts = [type(value).__qualname__, declared]
        elif inspect.ismethod(value):
            parts = [value.__func__, value.__self__]
        elif inspect.isfunction(value):
            parts = self._function(value)
        elif isinstance(value, ModuleType):
            parts = [value.__name__]
        elif hasattr(value, "detach"):  # A tensor. NumPy has no bfloat16; float32 represents all its values.
            tensor = value.detach().cpu()
            parts = [str(tensor.dtype), np.asarray((tensor.float() if "bfloat16" in str(tensor.dtype) else tensor).numpy())]
        elif not any({"__reduce__", "__reduce_ex__"} & vars(base).keys() for base in type(value).__mro__[:-1]):
            parts = self._attributes(value)
        return NotImplemented if parts is None else (tuple, (parts,))

    @staticmethod
    def _class(value: type) -> list[Any] | None:
        """Name and sources of a class and its bases, and the methods of local classes; None for a class without a source."""
        files = [file for base in value.__mro__ if (file := _file_of(base)) is not None]
        local = [own for base in value.__mro__ if "<" in base.__qualname__ for own in vars(base).values() if inspect.isfunction(own)]
        return [value.__qualname__, *map(_source, files), *local] if files else None

    @staticmethod
    def _function(value: FunctionType) -> list[Any]:
        """Name, source, defaults and closure variables of a function, and its place in the file, because lambdas share a name."""
        if (file := _file_of(value)) is None:
            raise TypeError(f"{name_of(value)} has no source file")
        place = list(value.__code__.co_positions()) if "<" in value.__qualname__ else []
        cells = []
        for cell in value.__closure__ or ():
            with contextlib.suppress(ValueError):  # A variable that has no value yet.
                cells.append(cell.cell_contents)
        return [value.__qualname__, _source(file), place, value.__defaults__, value.__kwdefaults__, cells]

    @staticmethod
    def _attributes(value: Any) -> list[Any] | None:
        """Class, state and public attributes of an object; None if it has no attributes."""
        slots = [name for base in type(value).__mro__ for name in base.__dict__.get("__slots__", ()) if hasattr(value, name)]
        held = getattr(value, "__dict__", {}) | {name: getattr(value, name) for name in slots}
        state = getattr(value, "state_dict", None)
        # Submodules of a torch module: `state_dict` has their weights, not their types.
        kept = {name: own for name, own in held.items() if name[0] != "_" or (state is not None and name == "_modules")}
        sets = {name: sorted(own, key=repr) for name, own in kept.items() if isinstance(own, set | frozenset)}
        has_attributes = hasattr(value, "__dict__") or hasattr(type(value), "__slots__")
        return [type(value), sorted((kept | sets).items()), dict(state()) if state else None] if has_attributes else None


def _source(file: Path) -> bytes:
    """Digest of a Python file, and of the modules that it imports from its folder if the folder has a study."""
    neighbours = sorted(_imported_neighbours(file)) if file.parent in _study_folders() else []
    return hashlib.sha256(b"".join(hashlib.sha256(own.read_bytes()).digest() for own in (file, *neighbours))).digest()


def _study_folders() -> set[Path]:
    """Folders of the files that `load_file` has loaded."""
    return {Path(str(module.__file__)).parent for name, module in list(sys.modules.items()) if name.startswith(FILES)}


@functools.cache
def _imported_neighbours(file: Path) -> frozenset[Path]:
    """Paths of the Python files that a Python file imports from its folder, directly or through other files of the folder.

    The file itself is not included.
    """
    found: set[Path] = set()
    waiting = [file]
    while waiting:
        for node in ast.walk(ast.parse(waiting.pop().read_bytes())):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module] if isinstance(node, ast.ImportFrom) and node.module and not node.level else []
            new = {path for name in names if (path := file.parent / f"{name.partition('.')[0]}.py").is_file()} - found - {file}
            found |= new
            waiting += new
    return frozenset(found)


def _file_of(thing: Any) -> Path | None:
    """File of a function or of the class of an object; None if it was defined interactively."""
    owner = thing if inspect.isroutine(thing) or inspect.isclass(thing) else type(thing)
    try:
        file = inspect.getsourcefile(owner)
    except TypeError:
        return None
    return Path(file) if file is not None and Path(file).exists() else None


def name_of(thing: Any) -> str:
    """Name of a controller or of an outcome's measure, for tables: "file.py:name", or the name of a policy file."""
    if isinstance(thing, str) or thing is None:
        return str(thing or "nothing")
    if isinstance(thing, PolicyController):
        return f"policy {name_of(thing.act)}"
    if isinstance(thing, functools.partial):
        return name_of(thing.func)
    name = getattr(thing, "__qualname__", type(thing).__qualname__)
    file = _file_of(thing)
    return name if file is None or type(thing).__module__.startswith("stepper.") else f"{file.name}:{name}"
