"""A policy acts as it was made to, is the same after it was saved, and names what differs where it is loaded."""

import json
import warnings
import zlib
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import stepper
import stepper.envs
from checks import raises
from envs.cases import needs_gymnasiums
from stepper.policies import ACTIVATIONS, Policy, PolicyError, PolicyWarning, describe, differences, load


def made(env, activation="tanh", seed=0):
    """A policy of random numbers for an environment."""
    rng = np.random.default_rng(seed)
    base = env.unwrapped
    observations = getattr(base, "single_observation_space", base.observation_space).shape[0]
    space = getattr(base, "single_action_space", base.action_space)
    sizes = [observations, 16, 8, space.shape[0]]
    layers = tuple((rng.normal(size=pair).astype(np.float32), rng.normal(size=pair[1]).astype(np.float32)) for pair in pairwise(sizes))
    return Policy(
        mean=rng.normal(size=observations), std=rng.uniform(0.5, 2.0, observations), clip=5.0, layers=layers, activation=activation,
        low=space.low.astype(float), high=space.high.astype(float), environment=describe(env), training={"seed": seed},
    )  # fmt: skip


@pytest.fixture(scope="module")
def envs():
    return gymnasium.make_vec("stepper/Reacher-v5", num_envs=3)


@pytest.mark.parametrize("activation", ACTIVATIONS)
def test_an_action_is_what_the_layers_say(envs, activation):
    policy = made(envs, activation)
    policy = replace(policy, low=np.array([-2.0, 0.0]), high=np.array([2.0, 4.0]))
    observation = np.random.default_rng(1).normal(size=10) * 3.0
    x = [max(-5.0, min(5.0, (o - m) / s)) for o, m, s in zip(observation, policy.mean, policy.std, strict=True)]
    for k, (weight, bias) in enumerate(policy.layers):
        x = [sum(x[i] * float(weight[i, j]) for i in range(len(x))) + float(bias[j]) for j in range(len(bias))]
        if k < 2:
            x = [{"tanh": np.tanh(v), "elu": v if v > 0 else np.exp(v) - 1, "relu": max(v, 0.0)}[activation] for v in x]
    expected = [2.0 * max(-1.0, min(1.0, x[0])), 2.0 + 2.0 * max(-1.0, min(1.0, x[1]))]
    # Layers are computed in 32 bits: 1e-7 of sums of some tens of numbers of order 1.
    np.testing.assert_allclose(policy(observation), expected, atol=1e-4)
    np.testing.assert_allclose(policy(np.tile(observation, (4, 1))), [expected] * 4, atol=1e-4)
    assert policy(observation).dtype == np.float32


def test_it_is_the_same_after_it_was_saved(envs, tmp_path):
    policy = made(envs)
    policy.save(tmp_path / "policy.npz")
    with warnings.catch_warnings(action="error"):
        again = load(tmp_path / "policy.npz", env=envs)
    observation = np.random.default_rng(2).normal(size=(5, 10))
    np.testing.assert_array_equal(again(observation), policy(observation))
    assert (again.environment, again.training) == (policy.environment, policy.training)
    assert not list(tmp_path.glob("*.part"))


@pytest.mark.parametrize(("settings", "named"), [
    ({"contact": "hard"}, {"options.contact", "options.integrator", "options.iterations", "options.tolerance"}),
    ({"precision": "f32"}, {"precision", "options.tolerance"}),
    ({"options": stepper.Options(contact="mujoco", integrator="rk4", iterations=100, timestep=0.005)}, {"options.timestep"}),
    ({"frame_skip": 4}, {"task.frame_skip", "frame_skip"}),
    ({"reward_control_weight": 0.1}, {"task.reward_control_weight"}),
])  # fmt: skip
def test_each_difference_is_named(envs, settings, named):
    other = gymnasium.make_vec("stepper/Reacher-v5", num_envs=2, **settings)
    lines = made(envs).differences(other)
    assert {line.partition(":")[0] for line in lines} == named
    with pytest.warns(PolicyWarning) as caught:
        made(envs).check(other)
    assert all(line in str(caught[0].message) for line in lines)


def test_theta_and_another_model_are_named(envs, tmp_path):
    other = gymnasium.make_vec("stepper/Reacher-v5", num_envs=2)
    damping = np.tile(other.unwrapped.sim.model.dof_damping, (2, 1))
    damping[1] *= 2.0
    other.unwrapped.sim.randomize(dof_damping=damping)
    assert [line.partition(":")[0] for line in made(envs).differences(other)] == [
        "randomized.dof_damping.max",
        "randomized.dof_damping.min",
    ]
    assert made(other).environment["randomized"]["dof_damping"]["max"] == damping.max(axis=0).tolist()
    # A task that randomises has no parameters yet before its first reset: nothing is said then.
    assert made(other).differences(envs) == []
    text = Path(stepper.envs.assets.model_file("reacher.xml")).read_text()
    assert 'damping="1"' in text
    (tmp_path / "reacher.xml").write_text(text.replace('damping="1"', 'damping="2"', 1))
    heavier = gymnasium.make_vec("stepper/Reacher-v5", num_envs=2, xml_file=str(tmp_path / "reacher.xml"))
    assert "model.sha256" in {line.partition(":")[0] for line in made(envs).differences(heavier)}


@dataclass(frozen=True, kw_only=True)
class Own(stepper.envs.TASKS["Reacher"]):
    """With arguments that JSON does not have."""

    goal: np.ndarray = field(default_factory=lambda: np.array([0.1, 0.2]))
    scale: np.float32 = field(default_factory=lambda: np.float32(0.5))
    kind: type = int


def test_any_argument_of_a_task_is_described(envs):
    found = describe(stepper.envs.StepperEnv(Own()))["task"]
    assert (found["name"], found["goal"], found["scale"], found["kind"]) == ("Own", [0.1, 0.2], 0.5, "<class 'int'>")
    other = describe(stepper.envs.StepperEnv(Own(goal=np.array([0.1, 0.3]))))
    assert differences(describe(stepper.envs.StepperEnv(Own())), other) == ["task.goal: [0.1, 0.2] there, [0.1, 0.3] here"]


def test_a_single_environment_is_the_same_as_a_vector(envs):
    assert made(envs).differences(gymnasium.make("stepper/Reacher-v5")) == []


def test_versions_and_what_only_one_says_are_named(envs):
    past = json.loads(json.dumps(made(envs).environment))
    past["versions"]["stepper"] = "0.0.1"
    past["sensors"] = {"tip": 1}
    lines = differences(past, describe(envs))
    assert [line.partition(":")[0] for line in lines] == ["sensors.tip", "versions.stepper"]
    assert lines[1] == f"versions.stepper: '0.0.1' there, {stepper.__version__!r} here"


@needs_gymnasiums
def test_gymnasiums_own_environment_is_told_by_its_engine(envs):
    theirs = gymnasium.make("Reacher-v5")
    named = {line.partition(":")[0] for line in made(envs).differences(theirs)}
    assert named == {"engine", "options.tolerance"}
    vector = gymnasium.make_vec("Reacher-v5", num_envs=2, vectorization_mode="sync")
    assert describe(vector) == describe(theirs)


def test_other_sizes_are_an_error(envs):
    with pytest.raises(PolicyError, match=r"observations \(17,\) and actions \(6,\), the policy \(10,\) and \(2,\).*Reacher"):
        made(envs).check(gymnasium.make("stepper/HalfCheetah-v5"))
    raises(PolicyError, r"shape \(9,\), must be \(10,\)", lambda: made(envs)(np.zeros(9)))


@pytest.mark.parametrize(("change", "message"), [
    ({"activation": "sine"}, "activation is 'sine'"),
    ({"std": np.zeros(10)}, "std has shape"),
    ({"low": np.zeros(3)}, "bounds of actions"),
    ({"mean": np.full(10, np.nan)}, "not finite"),
    ({"layers": [(np.zeros((10, 3)), np.zeros(3)), (np.zeros((4, 2)), np.zeros(2))]}, r"layer 1 has weights \(4, 2\)"),
    # `ClipAction` widens the space of actions to infinity.
    ({"low": np.full(2, -np.inf), "high": np.full(2, np.inf)}, r"bounds of actions are not finite.*envs\.unwrapped\.single_action_space"),
    ({"low": np.array([0.0, 1.0]), "high": np.zeros(2)}, "action 1 has the bounds .* must have the lower one first"),
    *(({"clip": clip}, r"clip is .*, must be a number above 0: 10.0 is usual") for clip in (np.nan, -1.0, 0.0, "1", None, True)),
])  # fmt: skip
def test_a_policy_that_could_not_act_is_not_made(envs, change, message):
    raises(PolicyError, message, lambda: replace(made(envs), **change))
    assert replace(made(envs), clip=np.inf).clip == np.inf


def test_files_that_hold_none_are_refused_by_name(envs, tmp_path):
    (tmp_path / "text.npz").write_text("no archive")
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    np.savez(tmp_path / "future.npz", settings=np.array(json.dumps({"format": 99})))
    np.savez(tmp_path / "list.npz", settings=np.array("[]"))
    np.savez(tmp_path / "dict.npz", settings=np.array("{}"))
    settings = json.dumps({"format": 1, "clip": 5.0, "activation": "tanh", "environment": {}, "training": {}})
    np.savez(tmp_path / "scalar.npz", settings=np.array(settings), mean=np.zeros(()), std=np.ones(()), low=np.zeros(()), high=np.ones(()))
    for name in ("text", "other", "future", "list", "scalar"):
        raises(PolicyError, f"{name}.npz", load, tmp_path / f"{name}.npz")
    # Also a file of PyTorch, which is a ZIP archive as those of NumPy.
    for name in ("other", "list", "dict"):
        with pytest.raises(PolicyError) as error:
            load((tmp_path / f"{name}.npz").rename(tmp_path / f"{name}.pt"))
        assert str(error.value) == (
            f"{tmp_path / name}.pt contains no policy; give a file that Policy.save wrote, "
            "or make a stepper.policies.Policy of another library's layers"
        )
    with pytest.raises(FileNotFoundError):
        load(tmp_path / "nothing.npz")
    raises(ValueError, r"must be \.npz", lambda: made(envs).save(tmp_path / "policy.pt"))
    made(envs).save(tmp_path / "cut.npz")
    (tmp_path / "cut.npz").write_bytes((tmp_path / "cut.npz").read_bytes()[:-100])
    raises(PolicyError, r"cut\.npz", load, tmp_path / "cut.npz")


def test_a_damaged_file_is_refused_by_name(envs, tmp_path):
    """Or is read, where the byte decides nothing, such as those of a date."""
    file = tmp_path / "policy.npz"
    made(envs).save(file)
    whole, causes = file.read_bytes(), set()
    directory = whole.index(b"PK\x01\x02")
    for k in (*range(0, directory, 29), *range(directory, directory + 120), *range(len(whole) - 22, len(whole))):
        damaged = bytearray(whole)
        damaged[k] ^= 0xFF
        file.write_bytes(damaged)
        try:
            load(file)
        except PolicyError as error:
            assert str(file) in str(error)
            causes.add(type(error.__cause__))
    assert {zlib.error, NotImplementedError} < causes


@needs_gymnasiums
def test_the_command_names_differences_and_compares(envs, tmp_path, capsys):
    from stepper.cli.commands import evaluate

    made(envs).save(tmp_path / "policy.npz")
    evaluate(tmp_path / "policy.npz", "stepper/Reacher-v5", against="Reacher-v5", episodes=3, contact="hard")
    out, err = capsys.readouterr()
    assert "stepper/Reacher-v5: options.contact: 'mujoco' there, 'hard' here" in err
    assert "Reacher-v5: engine: 'stepper' there, 'MuJoCo' here" in err
    first, second, verdict = out.splitlines()
    assert first.startswith("stepper/Reacher-v5: -")
    assert second.startswith("Reacher-v5: -")
    assert verdict.startswith("Reacher-v5 minus stepper/Reacher-v5:")
    evaluate(tmp_path / "policy.npz", "stepper/Reacher-v5", episodes=3, contact="hard", infos=["reward_ctrl"])
    assert ", reward_ctrl -" in capsys.readouterr().out
    with pytest.raises(ValueError, match="--info cannot be compared"):
        evaluate(tmp_path / "policy.npz", "stepper/Reacher-v5", against="Reacher-v5", infos=["reward_ctrl"])


@pytest.mark.parametrize(("env", "remedy"), [("me/Reach-v0", True), ("Nothing-v0", True), ("stepper.envs:stepper/Nothing-v0", False)])
def test_an_unknown_environment_is_an_error_with_the_form_of_its_name(env, remedy):
    with pytest.raises(ValueError) as error:
        stepper.policies.make(env)
    assert ("write the module that registers it first" in str(error.value)) == remedy


@pytest.mark.parametrize("name", ["mean", "std", "low", "high", "weights", "biases"])
@pytest.mark.parametrize("change", [lambda x: x.astype(complex), np.ma.masked_array, lambda x: x.astype(object), lambda x: x.tolist()])
def test_arrays_of_a_policy_are_of_real_numbers(envs, name, change):
    one = made(envs)
    (weight, bias), *others = one.layers
    own = {"weights": ((change(weight), bias), *others), "biases": ((weight, change(bias)), *others)}
    own = {"layers": own[name]} if name in own else {name: change(getattr(one, name))}
    raises(PolicyError, rf"{name}.* is (MaskedArray|ndarray|list).*, must be an array of real numbers", replace, one, **own)


def test_a_damaged_clip_in_a_file_is_named(envs, tmp_path):
    made(envs).save(tmp_path / "p.npz")
    with np.load(tmp_path / "p.npz") as archive:
        arrays = dict(archive)
    arrays["settings"] = np.array(json.dumps(json.loads(str(arrays["settings"])) | {"clip": -1.0}))
    np.savez(tmp_path / "p.npz", **arrays)
    raises(PolicyError, r"p\.npz: clip is -1\.0, must be a number above 0", load, tmp_path / "p.npz")
