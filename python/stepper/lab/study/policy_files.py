"""Policies from files: ONNX, TorchScript, and files of `stepper.policies`.

A policy maps observations (num_envs, n) to controls (num_envs, nu). A network that was exported for single observations is called row by
row. Formats that can execute code while they are read are rejected: pickles of torch.save, and programs of torch.export, which may contain
pickles.
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
from stepper.shared.files import existing, explained
from stepper.shared.machine import require

Array = NDArray[Any]


class PolicyFile(ABC):
    """Policy that was read from a file. Abstract.

    Attributes:
        path: Path of the file.
        digest: SHA-256 of the file, which is part of the keys of a study's rows.
    """

    endings: ClassVar[tuple[str, ...]]
    """File name endings of the format."""

    def __init__(self, path: Path):
        self.path = path
        self.digest = hashlib.sha256(existing(path, "policy").read_bytes()).hexdigest()

    @abstractmethod
    def __call__(self, observation: Array) -> Any:
        """Controls (num_envs, nu) for observations (num_envs, n)."""

    def __reduce__(self) -> tuple[type[PolicyFile], tuple[Path]]:
        # Sessions and scripts do not pickle; the file is read again.
        return type(self), (self.path,)


class _Onnx(PolicyFile):
    """ONNX network, run by ONNX Runtime on one thread of the CPU."""

    endings = (".onnx",)

    def __init__(self, path: Path):
        super().__init__(path)
        runtime = require("onnxruntime", "to run a policy of an ONNX file")
        settings = runtime.SessionOptions()
        settings.intra_op_num_threads = settings.inter_op_num_threads = 1
        settings.log_severity_level = 3
        try:
            self._session = runtime.InferenceSession(str(path), settings, providers=["CPUExecutionProvider"])
        except Exception as error:  # The errors of ONNX Runtime have no narrower base class.
            raise ValueError(f"{path}: ONNX Runtime cannot read it: {error}") from error
        inputs = self._session.get_inputs()
        if len(inputs) != 1:
            names = ", ".join(f"{one.name} {one.shape}" for one in inputs)
            raise ValueError(f"{path}: it has the inputs {names}, must have one, the observations (num_envs, n): export it with one")
        (self._input,) = inputs
        kinds: dict[str, type[np.floating[Any]]] = {"tensor(float)": np.float32, "tensor(double)": np.float64}
        if self._input.type not in kinds:
            raise ValueError(f"{path}: its input is a {self._input.type}, must be a tensor of float or double")
        self._type = kinds[self._input.type]
        shape = self._input.shape
        if len(shape) not in (1, 2) or (len(shape) == 2 and isinstance(shape[0], int) and shape[0] != 1):
            raise ValueError(f"{path}: its input has the shape {shape}, must be (num_envs, n), (1, n) or (n,): export a dynamic first axis")
        self._single = len(shape) == 1 or shape[0] == 1

    def __call__(self, observation: Array) -> Array:
        """Controls (num_envs, nu) for observations (num_envs, n)."""
        size, given = self._input.shape[-1], observation.astype(self._type)
        if isinstance(size, int) and given.shape[1] != size:
            raise ValueError(
                f"{self.path}: it takes {size} numbers, and the model's sensors give {given.shape[1]}: use the model of its training"
            )
        if not self._single:
            made: Array = self._session.run(None, {self._input.name: given})[0]
            return made
        rows = given if len(self._input.shape) == 1 else given[:, None]
        return np.array([np.ravel(self._session.run(None, {self._input.name: row})[0]) for row in rows])


class Network:
    """Policy that calls a `torch.nn.Module`, without gradients.

    Each batch uses a new copy of the module, so that internal state such as buffers does not pass from one batch to the next. The
    `reset()` of a TorchScript is called, if it has one.

    Attributes:
        module: Original module, which is copied and never called.
    """

    def __init__(self, module: Any):
        self._torch = require("torch", "to run a policy of torch")
        self.module = module
        self._playing: Any = None

    def begin(self, _: Any = None) -> None:
        """Replace the copy of the module that computes controls by a new one, at the start of a batch."""
        self._playing = copy.deepcopy(self.module)
        if isinstance(self.module, self._torch.jit.ScriptModule) and hasattr(self.module, "reset"):
            self._playing.reset()

    def __call__(self, observation: Array) -> Any:
        """Controls (num_envs, nu) for observations (num_envs, n), in the precision and on the device of the module's first parameter."""
        if self._playing is None:
            self.begin()
        own = next(self.module.parameters(), self._torch.zeros(0))
        with self._torch.no_grad():
            return self._playing(self._torch.as_tensor(np.ascontiguousarray(observation), dtype=own.dtype, device=own.device))


class _Torch(PolicyFile):
    """Policy from a TorchScript file, on the CPU without gradients."""

    endings = (".pt", ".pth", ".ts")

    def __init__(self, path: Path):
        super().__init__(path)
        torch = require("torch", "to run a policy of torch")
        if not _is_script(path):
            raise ValueError(
                f"{path}: it is no TorchScript (torch.jit.save); a pickle of torch.save and a program of torch.export are not read, "
                "because they can run any code: if you trust it, load it yourself and give stepper.lab.PolicyController the module"
            )
        with explained(path, "export the policy again with torch.jit.save"):
            self._network = Network(torch.jit.load(str(path), map_location="cpu"))

    def begin(self, now: Any) -> None:
        """Replace the copy of the network that computes controls by a new one, at the start of a batch."""
        self._network.begin(now)

    def __call__(self, observation: Array) -> Any:
        """Controls (num_envs, nu) for observations (num_envs, n)."""
        return self._network(observation)


class _Own(PolicyFile):
    """Policy from an .npz file in the format of `stepper.policies`."""

    endings = (".npz",)

    def __init__(self, path: Path):
        super().__init__(path)
        self._policy = load(path)

    def __call__(self, observation: Array) -> Array:
        """Controls (num_envs, nu) for observations (num_envs, n)."""
        return self._policy(observation)


_FORMATS: tuple[type[PolicyFile], ...] = (_Onnx, _Torch, _Own)
ENDINGS = tuple(ending for kind in _FORMATS for ending in kind.endings)
PROGRAM = ".pt2"
"""Ending of programs of torch.export, which are rejected."""


def read_policy(path: str | os.PathLike[str]) -> PolicyFile:
    """Reads a policy from a file.

    Args:
        path: File with the suffix .onnx (ONNX Runtime), .pt, .pth or .ts (TorchScript), or .npz (`stepper.policies`).

    Raises:
        ValueError: The ending is unknown, or the file does not contain a policy of this format.
        OSError: The file cannot be read.
        MissingPackageError: ONNX Runtime or torch is not installed.
    """
    file = Path(path)
    for kind in _FORMATS:
        if file.suffix.lower() in kind.endings:
            return kind(file)
    if file.suffix.lower() == PROGRAM:
        raise ValueError(
            f"{file}: a program of torch.export is not read, because it can run any code: if you trust it, load it yourself with "
            "torch.export.load(...).module() and give stepper.lab.PolicyController the module"
        )
    raise ValueError(f"{file}: the ending is {file.suffix!r}, must be one of {', '.join(ENDINGS)}, or give a function")


def is_module(thing: Any) -> bool:
    """Whether an object is a `torch.nn.Module`. The check does not import torch."""
    torch = sys.modules.get("torch")
    return torch is not None and isinstance(thing, torch.nn.Module)


def _is_script(path: Path) -> bool:
    """Whether a file is a TorchScript archive, by the names of its entries."""
    if not zipfile.is_zipfile(path):
        return False
    with explained(path, "export the policy again with torch.jit.save"), zipfile.ZipFile(path) as archive:
        names = archive.namelist()
    return any(name.endswith("/constants.pkl") for name in names) and any("/code/" in name for name in names)
