"""`Policy`: a small fully connected network in NumPy, with the normalisation of observations; and functions to save and load it."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepper._arrays import array_of
from stepper.policies.environment import Description, describe, differences, of_policy
from stepper.shared.arguments import path_of
from stepper.shared.files import atomic_write, existing, explained, read_arrays, write_arrays
from stepper.shared.machine import require

OPSET = 17
"""Version of ONNX's operators, which runtimes since 2022 have."""
OPERATORS = {"tanh": "Tanh", "elu": "Elu", "relu": "Relu"}
"""ONNX's operators of the activation functions, by name."""


def write_onnx(policy: Policy, file: Path) -> None:
    """Writes a policy as a network from "observation", (n, observations) float32, to "action", (n, actions) float32, in the task's units.

    Raises:
        MissingPackageError: The package onnx is not installed.
    """
    onnx = require("onnx", "to write policies as ONNX files")
    constants: list[Any] = []
    nodes: list[Any] = []

    def constant(values: ArrayLike) -> str:
        constants.append(onnx.numpy_helper.from_array(np.asarray(values, dtype=np.float32), f"c{len(constants)}"))
        return str(constants[-1].name)

    def apply(operator: str, *inputs: str) -> str:
        nodes.append(onnx.helper.make_node(operator, inputs, [f"x{len(nodes)}"]))
        return f"x{len(nodes) - 1}"

    x = apply("Div", apply("Sub", "observation", constant(policy.mean)), constant(policy.std))
    if np.isfinite(policy.clip):
        x = apply("Clip", x, constant(-policy.clip), constant(policy.clip))
    for k, (weight, bias) in enumerate(policy.layers):
        x = apply("Add", apply("MatMul", x, constant(weight)), constant(bias))
        if k < len(policy.layers) - 1:
            x = apply(OPERATORS[policy.activation], x)
    x = apply("Mul", apply("Clip", x, constant(-1.0), constant(1.0)), constant((policy.high - policy.low) / 2))
    nodes.append(onnx.helper.make_node("Add", [x, constant((policy.high + policy.low) / 2)], ["action"]))
    ends = [
        onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, ["batch", size])
        for name, size in (("observation", len(policy.mean)), ("action", len(policy.low)))
    ]
    graph = onnx.helper.make_graph(nodes, "policy", ends[:1], ends[1:], constants)
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", OPSET)], ir_version=8)
    onnx.checker.check_model(model)
    with atomic_write(file) as stream:
        stream.write(model.SerializeToString())


Array = NDArray[Any]
FORMAT = 1
_REMEDY = "give a file that Policy.save wrote, or make a stepper.policies.Policy of another library's layers"
"""Remedy for a file that contains no policy."""

ACTIVATIONS: dict[str, Callable[[Array], Array]] = {
    "tanh": np.tanh,
    "elu": lambda x: np.where(x > 0.0, x, np.expm1(np.minimum(x, 0.0))),
    "relu": lambda x: np.maximum(x, 0.0),
}
"""Activation functions by name."""


class PolicyError(ValueError):
    """A policy does not match an environment, or a file contains no valid policy. The message has a remedy."""


class PolicyWarning(UserWarning):
    """An environment differs from the environment of a policy's training."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Policy:
    """Deterministic policy network. Its action is the mean of the trained distribution of actions.

    The input of the first layer is (observation - mean) / std, clipped to +-`clip`. Every layer is `x @ weight + bias`, with the
    activation after each but the last. The output is clipped to +-1 and scaled to the bounds of the actions.

    Attributes:
        mean: Mean of the observations in training, (n,).
        std: Standard deviation of the observations, (n,).
        clip: Largest absolute value of normalised observations.
        layers: Weights (inputs, outputs) and biases (outputs,) of every layer, float32.
        activation: Name of the activation function, one of `ACTIVATIONS`.
        low: Lower bounds of the actions, (nu,), in the units of the task.
        high: Upper bounds of the actions, (nu,), in the units of the task.
        environment: Settings of the environment of the training, from `stepper.policies.describe`.
        training: Notes on the training: numbers, texts, lists and dictionaries, which JSON can store.
    """

    mean: Array
    std: Array
    clip: float
    layers: Sequence[tuple[Array, Array]]
    activation: str
    low: Array
    high: Array
    environment: Description
    training: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, array in [("mean", self.mean), ("std", self.std), ("low", self.low), ("high", self.high), *_named(self.layers)]:
            if not isinstance(array, np.ndarray) or isinstance(array, np.ma.MaskedArray) or array.dtype.kind not in "fiu":
                found = f"{type(array).__name__}{f' of {array.dtype}' if isinstance(array, np.ndarray) else ''}"
                raise PolicyError(f"{name} is {found}, must be an array of real numbers: np.asarray(values, np.float32) makes one")
        sizes = [len(self.mean), *(len(bias) for _, bias in self.layers)]
        if self.activation not in ACTIVATIONS:
            raise PolicyError(f"activation is {self.activation!r}, must be one of {', '.join(ACTIVATIONS)}")
        for k, (weight, bias) in enumerate(self.layers):
            if weight.shape != (sizes[k], sizes[k + 1]) or bias.ndim != 1:
                fit = (sizes[k], sizes[k + 1])
                raise PolicyError(f"layer {k} has weights {weight.shape} and biases {bias.shape}, must be {fit} and (n,)")
        if self.std.shape != self.mean.shape or not np.all(self.std > 0.0):
            raise PolicyError(
                f"std has shape {self.std.shape} and smallest value {self.std.min(initial=np.inf)}, must have the shape of mean and be "
                "above 0"
            )
        if not self.low.shape == self.high.shape == (sizes[-1],):
            raise PolicyError(f"bounds of actions have shapes {self.low.shape} and {self.high.shape}, must be ({sizes[-1]},)")
        if not (np.isfinite(self.low).all() and np.isfinite(self.high).all()):
            raise PolicyError(
                f"bounds of actions are not finite: low {self.low.tolist()}, high {self.high.tolist()}. Wrappers such as ClipAction widen "
                "the space of actions: use envs.unwrapped.single_action_space"
            )
        if (above := np.flatnonzero(self.low > self.high)).size:
            k = above[0]
            raise PolicyError(f"action {k} has the bounds {self.low[k]} to {self.high[k]}, must have the lower one first: exchange them")
        if isinstance(self.clip, bool) or not (isinstance(self.clip, int | float | np.number) and self.clip > 0.0):
            raise PolicyError(f"clip is {self.clip!r}, must be a number above 0: 10.0 is usual, and math.inf clips nothing")
        if not all(np.isfinite(part).all() for part in (self.mean, self.std, *sum(self.layers, ()))):
            raise PolicyError("a number of the policy is not finite: the training diverged, or the policy was not trained")

    def __call__(self, observation: ArrayLike) -> Array:
        """Actions for observations.

        Args:
            observation: Observations, (n,) or (num_envs, n).

        Returns:
            Actions, (nu,) or (num_envs, nu), float32, in the units of the task.

        Raises:
            PolicyError: The observations have another size.
        """
        given = array_of("observation", observation)
        if given.shape[-1:] != self.mean.shape:
            raise PolicyError(f"observations have shape {given.shape}, must be {self.mean.shape} or (num_envs, {len(self.mean)})")
        x: Array = np.clip((given - self.mean) / self.std, -self.clip, self.clip).astype(np.float32)
        for k, (weight, bias) in enumerate(self.layers):
            x = x @ weight + bias
            if k < len(self.layers) - 1:
                x = ACTIVATIONS[self.activation](x)
        middle, half = (self.high + self.low) / 2, (self.high - self.low) / 2
        action: Array = middle + half * np.clip(x, -1.0, 1.0)
        return action.astype(np.float32)

    def differences(self, env: Any) -> list[str]:
        """Returns the differences between the environment of the training ("there") and another one ("here"), one line each."""
        return differences(self.environment, describe(env))

    def check(self, env: Any) -> None:
        """Issues a `PolicyWarning` with all differences between an environment and the environment in which the policy was trained.

        Raises:
            PolicyError: The environment has observations or actions of another size.
        """
        base = env.unwrapped
        spaces = [getattr(base, f"single_{name}", getattr(base, name)) for name in ("observation_space", "action_space")]
        sizes = [of_policy(space).shape for space in spaces]
        if sizes != [self.mean.shape, self.low.shape]:
            raise PolicyError(
                f"the environment has observations {sizes[0]} and actions {sizes[1]}, the policy {self.mean.shape} and {self.low.shape}: "
                f"the policy was trained in {self.environment.get('task', {}).get('name')}"
            )
        if found := self.differences(env):
            warnings.warn("the policy was trained in another environment:\n  " + "\n  ".join(found), PolicyWarning, stacklevel=2)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes a file atomically.

        A name that ends in .npz gives a NumPy archive with arrays and JSON, without pickles, for `stepper.policies.load`. A name that ends
        in .onnx gives a network from "observation" to "action" for ONNX runtimes, which includes normalisation and bounds.

        Raises:
            ValueError: The name has another ending.
            MissingPackageError: The package onnx is not installed, and the name ends in .onnx.
        """
        file = Path(path)
        if file.suffix == ".onnx":
            write_onnx(self, file)
            return
        if file.suffix != ".npz":
            raise ValueError(f"{file}: the ending is {file.suffix!r}, must be .npz or .onnx")
        arrays: dict[str, Any] = {"mean": self.mean, "std": self.std, "low": self.low, "high": self.high}
        for k, (weight, bias) in enumerate(self.layers):
            arrays |= {f"weight{k}": weight, f"bias{k}": bias}
        settings = {"format": FORMAT, "clip": self.clip, "activation": self.activation}
        settings |= {"environment": self.environment, "training": self.training}
        write_arrays(file, arrays | {"settings": np.array(json.dumps(settings))}, compressed=True)


def _named(layers: Sequence[tuple[Array, Array]]) -> Iterator[tuple[str, Array]]:
    """Yields the arrays of all layers, with their names for error messages."""
    for k, (weight, bias) in enumerate(layers):
        yield f"the weights of layer {k}", weight
        yield f"the biases of layer {k}", bias


def load(path: str | os.PathLike[str], env: Any = None) -> Policy:
    """Reads a policy.

    Args:
        path: File that `Policy.save` wrote.
        env: Environment in which the policy will run. A `PolicyWarning` lists all differences from the environment of the training. None
            skips this comparison.

    Raises:
        PolicyError: The file contains no policy that this version can read, or `env` has observations or actions of another size.
        OSError: The file cannot be read.
    """
    file = existing(path_of("path", path), "policy")
    arrays = read_arrays(file, "policy", remedy=_REMEDY, kind=PolicyError)
    with explained(file, _REMEDY, PolicyError):
        settings = json.loads(str(arrays.pop("settings", "{}")))
        if not isinstance(settings, dict) or "format" not in settings:
            raise PolicyError(f"{file} contains no policy; {_REMEDY}")
        if settings["format"] != FORMAT:
            raise PolicyError(f"the file has format {settings['format']} of policies, and this version reads format {FORMAT}")
        count = sum(name.startswith("weight") for name in arrays)
        layers = tuple((arrays[f"weight{k}"], arrays[f"bias{k}"]) for k in range(count))
        shared: dict[str, Any] = {name: arrays[name] for name in ("mean", "std", "low", "high")}
        kept = {name: settings[name] for name in ("clip", "activation", "environment", "training")}
        policy = Policy(**shared, layers=layers, **kept)
    if env is not None:
        policy.check(env)
    return policy
