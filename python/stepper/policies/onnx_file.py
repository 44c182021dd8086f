"""Policies as ONNX files, which run on robots without Python: the network with the normalisation of its observations."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from stepper.shared.files import atomic_write
from stepper.shared.machine import require

if TYPE_CHECKING:
    from stepper.policies.policy import Policy

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
