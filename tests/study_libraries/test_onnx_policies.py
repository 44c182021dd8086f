"""Policies as ONNX files: the actions of ONNX's runtime are those of NumPy."""

from itertools import pairwise

import numpy as np
import onnxruntime
import pytest
from stepper.policies import Policy


@pytest.mark.parametrize("activation", ["tanh", "elu", "relu"])
@pytest.mark.parametrize("clip", [10.0, np.inf])
def test_an_onnx_file_acts_as_the_policy(tmp_path, activation, clip):
    """Actions agree within 1e-4 of half the range, because both compute in 32 bits, in other orders."""
    rng = np.random.default_rng(0)
    sizes = [5, 16, 8, 3]
    layers = [(0.2 * rng.normal(size=ends).astype(np.float32), rng.normal(size=ends[1]).astype(np.float32)) for ends in pairwise(sizes)]
    policy = Policy(
        mean=rng.normal(size=5), std=rng.uniform(0.5, 2.0, 5), clip=clip, layers=layers, activation=activation,
        low=np.array([-1.0, -2.0, 0.0]), high=np.array([1.0, 2.0, 3.0]), environment={},
    )  # fmt: skip
    policy.save(tmp_path / "policy.onnx")
    session = onnxruntime.InferenceSession(tmp_path / "policy.onnx")
    observation = rng.normal(size=(40, 5)).astype(np.float32) * 3.0
    (action,) = session.run(["action"], {"observation": observation})
    np.testing.assert_allclose(action, policy(observation), atol=1e-4)
    assert np.ptp(action, axis=0).max() > 0.1
