"""The policies that docs/how-to/train.md and docs/benchmarks/training.md are about act as they say."""

import importlib
import warnings
from importlib.util import find_spec
from pathlib import Path

import gymnasium
import pytest
from envs.cases import needs_gymnasiums
from stepper.policies import PolicyWarning, evaluate, load

ROOT = Path(__file__).parents[2]
KEPT = sorted((ROOT / "examples/policies").glob("*.npz"))


def test_policies_are_small():
    assert KEPT
    assert max(file.stat().st_size for file in KEPT) < 200_000


def test_the_cheetah_runs():
    """As the page says of its law: 3,000 and more, in some fresh episodes."""
    policy = load(ROOT / "examples/policies/half_cheetah.npz")
    assert evaluate(policy, "stepper/HalfCheetah-v5", episodes=4, seed=7, precision="f32").mean > 3000.0


@needs_gymnasiums
@pytest.mark.parametrize("file", KEPT, ids=lambda path: path.stem)
def test_a_policy_fits_the_environment_that_it_names(file, monkeypatch):
    policy = load(file)
    legged = ("stepper/Go1Velocity-v0", "stepper/G1Velocity-v0", "stepper/Go1Stairs-v0")
    if policy.training["env"] in legged and find_spec("mjlab") is None:
        pytest.skip("mjlab, whose robot this is, is not installed: make training")
    if policy.training["env"] == "stepper/Go1Stairs-v0":
        pytest.importorskip("torch", reason="torch is not installed: make training")
        monkeypatch.syspath_prepend(ROOT / "examples")
        importlib.import_module("train_stairs")
    if policy.training["env"] == "stepper/Encoders-v0":
        monkeypatch.syspath_prepend(ROOT / "examples/studies")
        importlib.import_module("encoders_task").register()
    if policy.training["env"] == "stepper/PandaPick-v0":
        if find_spec("robosuite") is None:
            pytest.skip("robosuite, whose robot this is, is not installed: make study-libraries")
        monkeypatch.syspath_prepend(ROOT / "examples/studies")
        importlib.import_module("panda_task").register()
    with warnings.catch_warnings(action="ignore", category=PolicyWarning):
        env = gymnasium.make(policy.training["env"])
        policy.check(env)
    action = policy(env.reset(seed=0)[0])
    assert env.action_space.contains(action)
