"""Policies that others have exported: ONNX, TorchScript, and files of `stepper.policies`.

A policy takes observations (num_envs, n) and returns controls (num_envs, nu). A network that was exported for one observation at a time is
asked row by row. What can run code of its own when it is read is refused: pickles of torch.save, and programs of torch.export, whose
reader takes pickles too.
"""

from __future__ import annotations

import copy
import hashlib
import os
import sys
import zipfile
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from stepper.policies import load
from stepper.shared.machine import require

Array = NDArray[Any]


class PolicyFile(ABC):
    """A policy of a file.

    Attributes:
        path: The file.
        digest: SHA-256 of its bytes, of which the rows of a study follow.
    """

    endings: ClassVar[tuple[str, ...]]

    def __init__(self, path: Path):
        self.path = path
        self.digest = hashlib.sha256(path.read_bytes()).hexdigest()

    @abstractmethod
    def __call__(self, observation: Array) -> Any:
        """Controls (num_envs, nu) for observations (num_envs, n)."""

    def __reduce__(self) -> tuple[type[PolicyFile], tuple[Path]]:
        # Sessions and scripts do not pickle; files are read anew.
        return type(self), (self.path,)


class _Onnx(PolicyFile):
    """A network of ONNX Runtime on one thread of the CPU."""

    endings = (".onnx",)

    def __init__(self, path: Path):
        super().__init__(path)
        runtime = require("onnxruntime", "to run a policy of an ONNX file")
        settings = runtime.SessionOptions()
        settings.intra_op_num_threads = settings.inter_op_num_threads = 1
        settings.log_severity_level = 3
        try:
            self._session = runtime.InferenceSession(str(path), settings, providers=["CPUExecutionProvider"])
        except Exception as error:  # ONNX Runtime has a class for each of its codes, and their base is Exception.
            raise ValueError(f"{path}: ONNX Runtime cannot read it: {error}") from error
        inputs = self._session.get_inputs()
        if len(inputs) != 1:
            names = ", ".join(f"{one.name} {one.shape}" for one in inputs)
            raise ValueError(f"{path}: it has the inputs {names}; a policy has one, the observations (num_envs, n)")
        (self._input,) = inputs
        kinds: dict[str, type[np.floating[Any]]] = {"tensor(float)": np.float32, "tensor(double)": np.float64}
        if self._input.type not in kinds:
            raise ValueError(f"{path}: its input is a {self._input.type}, must be a tensor of float or double")
        self._type = kinds[self._input.type]
        shape = self._input.shape
        if len(shape) not in (1, 2) or (len(shape) == 2 and isinstance(shape[0], int) and shape[0] != 1):
            raise ValueError(f"{path}: its input has the shape {shape}, must be (num_envs, n), (1, n) or (n,); export it with a free batch")
        self._single = len(shape) == 1 or shape[0] == 1

    def __call__(self, observation: Array) -> Array:
        """See `PolicyFile`."""
        size, given = self._input.shape[-1], observation.astype(self._type)
        if isinstance(size, int) and given.shape[1] != size:
            raise ValueError(f"{self.path}: it takes {size} numbers, and the model's sensors give {given.shape[1]}")
        if not self._single:
            made: Array = self._session.run(None, {self._input.name: given})[0]
            return made
        rows = given if len(self._input.shape) == 1 else given[:, None]
        return np.array([np.ravel(self._session.run(None, {self._input.name: row})[0]) for row in rows])


class Network:
    """A module of torch as a policy, without gradients.

    Each start takes a copy of the module as it was given, whose `reset()` is called where a TorchScript has one: what a network
    remembers, in buffers or elsewhere, is of one batch alone.

    Attributes:
        module: As it was given; it is never called itself.
    """

    def __init__(self, module: Any):
        self._torch = require("torch", "to run a policy of torch")
        self.module = module
        self._playing: Any = None

    def begin(self, _: Any = None) -> None:
        """Forgets."""
        self._playing = copy.deepcopy(self.module)
        if isinstance(self.module, self._torch.jit.ScriptModule) and hasattr(self.module, "reset"):
            self._playing.reset()

    def __call__(self, observation: Array) -> Any:
        """Controls for observations, which it is given in the precision and on the device of its first parameter."""
        if self._playing is None:
            self.begin()
        own = next(self.module.parameters(), self._torch.zeros(0))
        with self._torch.no_grad():
            return self._playing(self._torch.as_tensor(np.ascontiguousarray(observation), dtype=own.dtype, device=own.device))


class _Torch(PolicyFile):
    """A TorchScript, on the CPU without gradients."""

    endings = (".pt", ".pth", ".ts")

    def __init__(self, path: Path):
        super().__init__(path)
        torch = require("torch", "to run a policy of torch")
        if not _is_script(path):
            raise ValueError(
                f"{path}: it is no TorchScript (torch.jit.save); a pickle of torch.save and a program of torch.export are not read, as "
                "they can run any code: load it yourself and give stepper.lab.Policy the module"
            )
        self._network = Network(torch.jit.load(str(path), map_location="cpu"))

    def begin(self, now: Any) -> None:
        """See `Network`."""
        self._network.begin(now)

    def __call__(self, observation: Array) -> Any:
        """See `PolicyFile`."""
        return self._network(observation)


class _Own(PolicyFile):
    """A file of `stepper.policies`."""

    endings = (".npz",)

    def __init__(self, path: Path):
        super().__init__(path)
        self._policy = load(path)

    def __call__(self, observation: Array) -> Array:
        """See `PolicyFile`."""
        return self._policy(observation)


_KINDS: tuple[type[PolicyFile], ...] = (_Onnx, _Torch, _Own)
ENDINGS = tuple(ending for kind in _KINDS for ending in kind.endings)
PROGRAM = ".pt2"
"""How programs of torch.export end, which are refused."""


def read_policy(path: str | os.PathLike[str]) -> PolicyFile:
    """Reads a policy.

    Args:
        path: A file that ends in .onnx (ONNX Runtime), .pt, .pth or .ts (TorchScript), or .npz (`stepper.policies`).

    Raises:
        ValueError: Another ending, or a file that holds no policy of its kind.
        OSError: The file cannot be read.
        MissingPackageError: ONNX Runtime or torch is not installed.
    """
    file = Path(path)
    for kind in _KINDS:
        if file.suffix.lower() in kind.endings:
            return kind(file)
    if file.suffix.lower() == PROGRAM:
        raise ValueError(
            f"{file}: a program of torch.export is not read, as it can run any code: load it yourself, where you trust it, with "
            "torch.export.load(...).module() and give stepper.lab.Policy the module"
        )
    raise ValueError(f"{file}: the ending is {file.suffix!r}, must be one of {', '.join(ENDINGS)}, or give a function")


def is_module(thing: Any) -> bool:
    """Whether it is a module of torch, which is not imported for that."""
    torch = sys.modules.get("torch")
    return torch is not None and isinstance(thing, torch.nn.Module)


def _is_script(path: Path) -> bool:
    """Whether an archive is a TorchScript, from the names in it."""
    if not zipfile.is_zipfile(path):
        return False
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
    return any(name.endswith("/constants.pkl") for name in names) and any("/code/" in name for name in names)
