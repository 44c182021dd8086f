"""Policies of ONNX and torch give a study the rows of the same network in NumPy."""

import pickle

import numpy as np
import onnx
import pytest
import stepper
import torch
from onnx import TensorProto, helper, numpy_helper
from servo_arm import ARM, angles
from stepper.lab.study.controllers import digest_of
from stepper.lab.study.policy_files import read_policy

WEIGHT, BIAS = np.array([[-2.0], [-0.5]], np.float32), np.array([1.0], np.float32)


def plain(observation):
    return np.tanh(observation.astype(np.float32) @ WEIGHT + BIAS)


def write_onnx(path, batch="batch", kind=TensorProto.FLOAT, inputs=1):
    """One layer and its tanh, with a free batch, or that of `batch`."""
    dtype = np.float32 if kind == TensorProto.FLOAT else np.float64
    tensors = [numpy_helper.from_array(value.astype(dtype), name) for name, value in (("weight", WEIGHT), ("bias", BIAS))]
    nodes = [
        helper.make_node("MatMul", ["seen", "weight"], ["product"]),
        helper.make_node("Add", ["product", "bias"], ["sum"]),
        helper.make_node("Tanh", ["sum"], ["controls"]),
    ]
    shape = [2] if batch is None else [batch, 2]
    given = [helper.make_tensor_value_info(name, kind, shape) for name in ("seen", "state")[:inputs]]
    made = helper.make_tensor_value_info("controls", kind, [*shape[:-1], 1])
    graph = helper.make_graph(nodes, "servo", given, [made], tensors)
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8), path)
    return path


class Servo(torch.nn.Module):
    def __init__(self):
        super().__init__()
        self.weight, self.bias = torch.nn.Parameter(torch.from_numpy(WEIGHT)), torch.nn.Parameter(torch.from_numpy(BIAS))

    def forward(self, seen):
        return torch.tanh(seen @ self.weight + self.bias)


def write_script(path):
    torch.jit.save(torch.jit.trace(Servo(), torch.zeros(3, 2)), str(path))
    return path


def write_program(path):
    free = {0: torch.export.Dim("batch", min=1, max=4096)}
    torch.export.save(torch.export.export(Servo(), (torch.zeros(3, 2),), dynamic_shapes=(free,)), str(path))
    return path


@pytest.mark.parametrize(
    "write",
    [
        lambda folder: write_onnx(folder / "free.onnx"),
        lambda folder: write_onnx(folder / "one.onnx", batch=1),
        lambda folder: write_onnx(folder / "row.onnx", batch=None),
        lambda folder: write_onnx(folder / "double.onnx", kind=TensorProto.DOUBLE),
        lambda folder: write_script(folder / "script.pt"),
    ],
    ids=["onnx", "onnx of one", "onnx of a row", "onnx in 64 bits", "TorchScript"],
)
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning", "ignore::UserWarning")
def test_a_file_gives_the_rows_of_the_network(tmp_path, write):
    policy = stepper.lab.PolicyController(write(tmp_path))
    # Single precision: 2^-24 of a control, which twenty of them turn into as much of an angle.
    np.testing.assert_allclose(
        angles(policy, tmp_path / "file"), angles(stepper.lab.PolicyController(plain), tmp_path / "plain"), rtol=0, atol=1e-6
    )
    again = pickle.loads(pickle.dumps(policy))
    assert digest_of(again) == digest_of(policy)
    seen = np.array([[0.1, 0.2], [-0.3, 0.4]])
    np.testing.assert_array_equal(np.asarray(again.act(seen)), np.asarray(policy.act(seen)))


def test_a_study_of_a_file(tmp_path):
    write_onnx(tmp_path / "servo.onnx")
    (tmp_path / "arm.xml").write_text(ARM)
    (tmp_path / "reach.toml").write_text(
        'model = "arm.xml"\npolicy = "servo.onnx"\n[[outcomes]]\nname = "angle"\nmeasure = "joint hinge"\n'
    )
    study = stepper.lab.Study.from_file(tmp_path / "reach.toml")
    assert study.identity["controller"]["name"] == "policy servo.onnx"


@pytest.mark.parametrize(
    ("write", "message"),
    [
        (lambda folder: write_onnx(folder / "five.onnx", batch=5), r"its input has the shape \[5, 2\], must be \(num_envs, n\)"),
        (lambda folder: write_onnx(folder / "two.onnx", inputs=2), r"has the inputs seen .*, state .*; a policy has one"),
        (lambda folder: (folder / "words.onnx").write_bytes(b"words") and folder / "words.onnx", "ONNX Runtime cannot read it"),
        (
            lambda folder: torch.save(Servo().state_dict(), folder / "weights.pt") or folder / "weights.pt",
            "a pickle of torch.save and a program of torch.export are not read",
        ),
        (lambda folder: write_program(folder / "program.pt2"), "a program of torch.export is not read"),
        # By what it is, not by how it is called.
        (lambda folder: write_program(folder / "program.pt2").rename(folder / "program.pt"), "it is no TorchScript"),
        (lambda folder: (folder / "words.pt").write_bytes(b"words") and folder / "words.pt", "it is no TorchScript"),
    ],
)
def test_files_that_are_no_policy_are_named(tmp_path, write, message):
    with pytest.raises(ValueError, match=message):
        read_policy(write(tmp_path))


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning", "ignore::UserWarning")
def test_a_program_that_its_owner_loads_is_a_policy(tmp_path):
    policy = stepper.lab.PolicyController(torch.export.load(str(write_program(tmp_path / "program.pt2"))).module())
    np.testing.assert_allclose(
        angles(policy, tmp_path / "own"), angles(stepper.lab.PolicyController(plain), tmp_path / "plain"), rtol=0, atol=1e-6
    )


class Remembers(torch.nn.Module):
    """Adds up what it sees, in a buffer that takes the size of the batch; `reset` begins with another sum."""

    def __init__(self):
        super().__init__()
        self.register_buffer("sum", torch.zeros(1, 1))

    def forward(self, seen: torch.Tensor) -> torch.Tensor:
        self.sum = self.sum + 0.1 * (0.5 - seen[:, :1])
        return self.sum


class Resets(Remembers):
    @torch.jit.export
    def reset(self):
        self.sum = torch.full((1, 1), 0.2)


def scripted(module, path):
    torch.jit.save(torch.jit.script(module), str(path))
    return path


@pytest.mark.parametrize("kind", [Remembers, Resets])
@pytest.mark.parametrize("form", ["module", "file"])
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_memory_is_of_one_batch(tmp_path, kind, form):
    policy = stepper.lab.PolicyController(kind() if form == "module" else scripted(kind(), tmp_path / "memory.pt"))
    before = digest_of(policy)
    assert angles(policy, tmp_path / "one", batch=1) == angles(policy, tmp_path / "four", batch=4)
    assert digest_of(policy) == before


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_script_is_reset(tmp_path):
    first = [
        stepper.lab.PolicyController(scripted(kind(), tmp_path / f"{kind.__name__}.pt")).act(np.full((1, 2), 0.5))
        for kind in (Remembers, Resets)
    ]
    assert [float(controls) for controls in first] == pytest.approx([0.0, 0.2])


def test_sensors_that_a_network_does_not_take_are_named(tmp_path):
    policy = read_policy(write_onnx(tmp_path / "servo.onnx"))
    with pytest.raises(ValueError, match="it takes 2 numbers, and the model's sensors give 3"):
        policy(np.zeros((1, 3)))
