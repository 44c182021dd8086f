"""Environments obey Gymnasium's interface, alone and in batches, within its wrappers, and say what is wrong with a call."""

import subprocess
import sys
from dataclasses import dataclass, fields
from pathlib import Path
from types import MappingProxyType

import gymnasium
import numpy as np
import pytest
import stepper
import stepper.adapters
from checks import every, raises
from envs.cases import same
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import vector
from gymnasium.wrappers.vector import RecordEpisodeStatistics
from stepper.envs import TASKS, Observation, StepperEnv, StepperVectorEnv, Task
from stepper.envs.locomotion import G1Velocity, Go1Velocity, VelocityTask
from stepper.sensors import SensorModel, Transfer

NAMES = sorted(TASKS)
FREE = "<worldbody><body><freejoint/><geom size='1'/></body></worldbody>"
SLIDER = """<mujoco><worldbody><body><joint name="slider" type="slide" axis="1 0 0"/><geom size=".1"/></body></worldbody>
  <actuator><motor joint="slider" ctrlrange="-5 5" ctrllimited="true"/></actuator></mujoco>"""
WRAPPERS = {
    "ClipAction": {},
    "RecordEpisodeStatistics": {},
    "NormalizeReward": {},
    "TransformReward": {"func": lambda reward: reward},
    "NormalizeObservation": {"refused": ("SAME_STEP", "DISABLED")},
    "TransformObservation": {"func": lambda observation: observation, "refused": ("SAME_STEP",)},
    "DtypeObservation": {"dtype": np.float32, "refused": ("SAME_STEP",)},
    "FlattenObservation": {"refused": ("SAME_STEP",)},
}
MODULES = sorted(path.stem for path in Path(stepper.adapters.__file__).parent.glob("[a-z]*.py"))
LIBRARIES = {
    "jax_rollout": ("jax", "pip install jax"),
    "ray": ("ray", "pip install ray"),
    "rllib": ("ray.rllib", 'pip install "ray[rllib]"'),
    "rsl_rl": ("rsl_rl", "pip install rsl-rl-lib"),
    "sb3": ("stable_baselines3", "pip install stable-baselines3"),
    "torch_rollout": ("torch", "pip install torch"),
    "torchrl": ("torchrl", "pip install torchrl"),
}
"""Library of each adapter, and the command that installs it."""


@pytest.mark.parametrize("name", [*(f"{name}-v5" for name in NAMES), "FallingBlock-v0", "Grasp-v0"])
def test_gymnasiums_checker_accepts_it(name):
    check_env(gymnasium.make(f"stepper/{name}", disable_env_checker=True).unwrapped, skip_render_check=True)


@every(name=NAMES, contact=["mujoco", "hard"])
def test_make_vec_makes_a_batch(name, contact):
    envs = gymnasium.make_vec(f"stepper/{name}-v5", num_envs=3, contact=contact, vectorization_mode="vector_entry_point")
    assert isinstance(envs, StepperVectorEnv)
    assert envs.sim.options == (stepper.Options.from_model(envs.sim.model) if contact == "mujoco" else stepper.Options())
    observation, _ = envs.reset(seed=0)
    assert observation in envs.observation_space
    for _ in range(3):
        observation, reward, terminated, truncated, _ = envs.step(envs.action_space.sample())
        assert observation in envs.observation_space
        assert (reward.dtype, terminated.dtype, truncated.dtype) == (np.float64, bool, bool)
    assert sum(envs.observation_structure.values()) == observation.shape[1]


@pytest.mark.parametrize("code", [
    "import sys, stepper; assert 'gymnasium' not in sys.modules; stepper.envs; assert 'gymnasium' in sys.modules",
    "import gymnasium; gymnasium.make('stepper.envs:stepper/HalfCheetah-v5')",
    "import sys, stepper.adapters.native; assert not {'torch', 'ray'} & sys.modules.keys()",
], ids=["stepper imports no gymnasium", "gymnasium finds it by the module in its name", "adapters need no library"])  # fmt: skip
def test_modules_are_imported_where_they_are_needed(code):
    subprocess.run([sys.executable, "-W", "ignore", "-c", code], check=True)


def test_the_start_of_an_environment_follows_from_its_seed_alone():
    many, few = StepperVectorEnv("Hopper", 9), StepperVectorEnv("Hopper", 2)
    starts = many.reset(seed=3)[0]
    np.testing.assert_array_equal(few.reset(seed=[11, 5])[0], starts[[8, 2]])
    again = many.reset()[0]
    assert not np.any(again == starts, axis=None) or np.mean(again == starts) < 0.1
    # One that is reset more often than others does not move theirs.
    many.reset(seed=3)
    mask = np.arange(9) == 4
    for _ in range(3):
        many.reset(options={"reset_mask": mask})
    np.testing.assert_array_equal(many.reset()[0][~mask], again[~mask])


def test_without_a_seed_starts_are_random():
    one, other = StepperVectorEnv("Hopper", 2).reset()[0], StepperVectorEnv("Hopper", 2).reset()[0]
    assert not np.array_equal(one, other)


def test_some_environments_are_given_seeds_and_others_go_on():
    envs = StepperVectorEnv("Hopper", 3)
    first = envs.reset(seed=0)[0]
    second = envs.reset(seed=[None, 1, None])[0]
    np.testing.assert_array_equal(second[1], first[1])
    assert not np.any(second[[0, 2]] == first[[0, 2]])


def test_indices_begin_some_and_leave_the_rest():
    """As a mask of them does; seeds are theirs alone, in their order."""
    by_ids, by_mask = StepperVectorEnv("Walker2d", 5), StepperVectorEnv("Walker2d", 5)
    for envs in (by_ids, by_mask):
        envs.reset(seed=0)
        envs.step(np.full((5, 6), 0.3))
    mask = np.array([False, True, False, False, True])
    for seed, all_seeds in ((None, None), ([11, 12], [None, 12, None, None, 11]), ([5, 2], [1, 2, 3, 4, 5]), (7, 7)):
        same(by_ids.reset(seed=seed, envs=[4, 1]), by_mask.reset(seed=all_seeds, options={"reset_mask": mask}))
        same(by_ids.step(np.full((5, 6), 0.1))[:4], by_mask.step(np.full((5, 6), 0.1))[:4])
    np.testing.assert_array_equal(by_ids.episode_lengths, [5, 1, 5, 5, 1])


def test_the_dtype_of_observations_is_chosen():
    for precision, dtype, found in [("f64", None, np.float64), ("f32", None, np.float32), ("f64", "float32", np.float32)]:
        envs = StepperVectorEnv("Hopper", 2, precision=precision, dtype=dtype)
        assert envs.reset(seed=0)[0].dtype == found
        assert envs.step(envs.action_space.sample())[0].dtype == found
        assert envs.single_observation_space.dtype == found


def test_statistics_are_those_of_gymnasiums_wrapper():
    own = StepperVectorEnv("Hopper", 5, max_episode_steps=12, episode_statistics=True)
    wrapped = gymnasium.wrappers.vector.RecordEpisodeStatistics(StepperVectorEnv("Hopper", 5, max_episode_steps=12))
    own.reset(seed=0), wrapped.reset(seed=0)
    ended = 0
    for action in np.random.default_rng(0).uniform(-1, 1, (40, 5, 3)):
        found, expected = own.step(action)[-1], wrapped.step(action)[-1]
        assert ("episode" in found) == ("episode" in expected)
        if "episode" in found:
            ended += 1
            np.testing.assert_array_equal(found["_episode"], expected["_episode"])
            np.testing.assert_array_equal(found["episode"]["r"], expected["episode"]["r"])
            np.testing.assert_array_equal(found["episode"]["l"], expected["episode"]["l"])
            assert (found["episode"]["t"][found["_episode"]] > 0).all()
    assert ended > 2


@pytest.mark.parametrize(("make", "error", "said"), [
    (lambda: StepperVectorEnv("Cheetah", 2), ValueError, "there is no task 'Cheetah'; did you mean HalfCheetah"),
    (lambda: StepperVectorEnv("Hopper", 2, contact="soft"), ValueError, "contact is 'soft', must be"),
    (lambda: StepperVectorEnv("Hopper", 2, max_episode_steps=0), ValueError, "max_episode_steps is 0"),
    (lambda: StepperVectorEnv("Hopper", 2, render_mode="human"), ValueError, "render_mode is 'human', must be"),
    (lambda: StepperVectorEnv("Hopper", 2, healthy=1), TypeError, "healthy"),
    (lambda: StepperEnv("Hopper", xml_file="none.xml"), FileNotFoundError, 'none.xml: pip install gymnasium'),
    (lambda: StepperEnv("Hopper", xml_file="/none.xml"), FileNotFoundError, "/none.xml: give the path"),
    (lambda: StepperVectorEnv("Hopper", 2).step(np.zeros((2, 3))), ResetNeeded, "call reset before step"),
    (lambda: StepperEnv("Hopper").step(np.zeros(3)), ResetNeeded, "call reset before step"),
    (lambda: StepperVectorEnv("Hopper", 2).step(np.zeros(3)), ValueError, r"shape \(3,\), must be \(2, 3\)"),
    (lambda: StepperEnv("Hopper").step(np.zeros(2)), ValueError, r"shape \(2,\), must be \(3,\)"),
    (lambda: StepperVectorEnv("Hopper", 2).reset(seed=[1]), ValueError, "there are 1 seeds, must be 2"),
    (lambda: StepperVectorEnv("Hopper", 2).reset(seed=-1), Exception, "-1"),
    (lambda: StepperVectorEnv("Hopper", 2).reset(seed=[-1, 0]), ValueError, "seed of environment 0 is -1"),
    (lambda: StepperVectorEnv("Hopper", 2).reset(options={"mask": 0}), ValueError, "unknown options"),
    (lambda: StepperVectorEnv("Hopper", 2).reset(options={"reset_mask": [True, False]}), TypeError, "must be an array of bool"),
    (lambda: StepperVectorEnv("Hopper", 2).reset(options={"reset_mask": np.ones(3, bool)}), ValueError, r"must be \(2,\)"),
    (lambda: StepperVectorEnv("Hopper", 2).reset(options={"reset_mask": np.zeros(2, bool)}), ValueError, "0 true entries"),
    (lambda: StepperVectorEnv("Hopper", 2).reset(options={"reset_mask": np.arange(2) == 0}), ResetNeeded, "have no episode yet"),
    (lambda: StepperVectorEnv("Hopper", 2).reset(envs=[0, 0]), ValueError, "envs has environment 0 more than once"),
    (lambda: StepperVectorEnv("Hopper", 2).reset(envs=[0], options={"reset_mask": 0}), ValueError, "give one of them"),
    (lambda: StepperVectorEnv("Hopper", 2).reset(envs=[0]), ResetNeeded, "have no episode yet"),
    (lambda: StepperEnv("Hopper").reset(options={"x": 0}), ValueError, r"options is {'x': 0}, but this environment has no options"),
    (lambda: StepperVectorEnv("Hopper", None), TypeError, "num_envs is None, must be a whole number of at least 1"),
    (lambda: StepperVectorEnv("Hopper", 2, max_episode_steps="8"), TypeError, "max_episode_steps is '8', must be a whole number"),
    (lambda: StepperVectorEnv(TASKS["Hopper"](frame_skip=0), 2), ValueError, "frame_skip of Hopper is 0, must be a whole"),
    (lambda: StepperVectorEnv("Hopper", 2, healthy_reward=None), TypeError, "healthy_reward of Hopper is None, must be a number"),
    (lambda: StepperVectorEnv("Hopper", 2, healthy_z_range=0.7), TypeError, "healthy_z_range of Hopper is 0.7, must be two numbers"),
    (lambda: StepperVectorEnv("Hopper", 2, reset_noise_scale=np.nan), TypeError, "reset_noise_scale of Hopper is nan, must be a number"),
    (lambda: StepperEnv("Hopper", xml_file=3), TypeError, r"xml_file is 3 \(int\), must be a path"),
    (lambda: StepperVectorEnv("Hopper", 2).reset(options=3), TypeError, "options is 3, must be a dict such as"),
    (lambda: Go1Velocity(max_latency="8"), TypeError, "max_latency of Go1Velocity is '8', must be a whole number"),
    (lambda: Go1Velocity(roughness="8"), TypeError, "roughness of Go1Velocity is '8', must be a number"),
    (lambda: Go1Velocity(max_latency=8), ValueError, "max_latency is 8, must be from 0 to frame_skip, which is 4"),
    (lambda: G1Velocity(roughness=-1.0), ValueError, r"roughness is -1\.0, must be a finite number from 0 to 1"),
])  # fmt: skip
def test_what_is_wrong_is_said(make, error, said):
    raises(error, said, make)


@pytest.mark.parametrize("name", sorted(TASKS))
def test_every_task_is_registered_and_says_what_it_takes(name):
    spec = gymnasium.spec(f"stepper/{name}-v5")
    assert (spec.max_episode_steps, spec.reward_threshold) == (
        gymnasium.spec(f"{name}-v5").max_episode_steps,
        gymnasium.spec(f"{name}-v5").reward_threshold,
    )
    assert {"xml_file", "frame_skip"} <= {field.name for field in fields(TASKS[name])}


def test_without_gymnasium_it_says_what_to_install():
    code = "import sys; sys.modules['gymnasium'] = None; import stepper; stepper.envs"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert 'pip install "stepper-sim[envs]"' in ended.stderr


@dataclass(frozen=True)
class Heard(Task):
    """A pendulum whose encoder is noisy."""

    frame_skip: int = 1

    def model(self):
        return stepper.load("""<mujoco><worldbody><body><joint name="hinge"/><geom size=".1" pos="0 0 -1"/></body></worldbody>
            <sensor><jointpos joint="hinge"/></sensor></mujoco>""")

    def sensors(self):
        return SensorModel(default=Transfer(noise_std=1.0))

    def observations(self):
        return (Observation("read", func=lambda now: now.sensordata),)

    def reward(self, now):
        return np.zeros(now.sim.num_envs or 1), {}


def test_errors_of_an_environments_sensors_follow_from_its_own_seed():
    """Of its neighbours' seeds, of their number, and of whether they have one, they know nothing."""
    envs = StepperVectorEnv(Heard(), 4)
    read = envs.reset(seed=5)[0]
    np.testing.assert_array_equal(StepperVectorEnv(Heard(), 9).reset(seed=5)[0][:4], read)
    np.testing.assert_array_equal((envs.reset(seed=[5, 6, 99, 8])[0] == read)[:, 0], [True, True, False, True])
    envs.reset(seed=5)
    after = envs.reset()[0]
    envs.reset(seed=5)
    some = envs.reset(seed=[None, 6, None, None])[0]
    np.testing.assert_array_equal(some[[0, 2, 3]], after[[0, 2, 3]])
    assert some[1] == read[1] != after[1]
    # A seed for one that does not begin is none of those that do.
    masked = envs.reset(seed=[5, 6, 7, 8], options={"reset_mask": np.array([True, False, False, True])})[0]
    np.testing.assert_array_equal(masked[[0, 3]], read[[0, 3]])
    np.testing.assert_array_equal(masked[[1, 2]], some[[1, 2]])
    assert envs.reset()[0][1] not in (read[1], some[1])


@pytest.mark.parametrize(("file", "said"), [
    (FREE, "keyframe is 'stance', which the model has not"),
    (FREE + "<keyframe><key name='stance'/></keyframe>", "no geom 'foot'"),
])  # fmt: skip
def test_a_robot_that_cannot_follow_commands_is_refused(file, said):
    @dataclass(frozen=True, kw_only=True)
    class Mine(VelocityTask):
        FEET = MappingProxyType({"foot": ("foot",)})

        def model(self):
            return stepper.load(f"<mujoco>{file}</mujoco>")

    raises(ValueError, said, lambda: StepperVectorEnv(Mine(), 2))


@dataclass(frozen=True, kw_only=True)
class TwoHands(Task):
    """A slider that two hands push, each with up to 1 N: two actions, one control."""

    frame_skip: int = 2

    def model(self):
        return stepper.load(SLIDER)

    def action_bounds(self, model):
        return -np.ones(2), np.ones(2)

    def observations(self):
        return (Observation("qpos"),)

    def advance(self, now):
        now.sim.step(now.action.sum(axis=1, keepdims=True), self.frame_skip)

    def reward(self, now):
        return now.sim.ctrl[:, 0], {"hands": now.action}


@pytest.mark.filterwarnings("ignore::stepper.ModelWarning")
def test_actions_need_not_be_controls():
    envs = StepperVectorEnv(TwoHands(), 3)
    check_env(StepperEnv(TwoHands()), skip_render_check=True)
    assert envs.single_action_space == gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)
    envs.reset(seed=0)
    assert envs.now.action.shape == (3, 2)
    action = np.array([[1.0, 1.0], [0.5, -0.25], [-1.0, 0.0]], np.float32)
    _, reward, *_ = envs.step(action)
    np.testing.assert_array_equal(reward, action.sum(axis=1))


def test_a_batch_whose_constructor_raised_can_be_closed():
    """Gymnasium 1.2 closes a vector environment when it is collected. An error of `close` would be printed after the real one."""
    unmade = StepperVectorEnv.__new__(StepperVectorEnv)
    unmade.close()
    assert unmade.closed


def run(envs, steps=30):
    """Observations, rewards, flags and infos of some steps."""
    envs.reset(seed=0)
    rng = np.random.default_rng(0)
    return [envs.step(rng.uniform(-1, 1, envs.action_space.shape)) for _ in range(steps)]


def test_a_mask_reaches_wrappers():
    envs = RecordEpisodeStatistics(StepperVectorEnv("Hopper", 4, autoreset_mode="Disabled"))
    envs.reset(seed=0)
    for _ in range(3):
        envs.step(np.zeros((4, 3)))
    envs.reset(options={"reset_mask": np.arange(4) == 2})
    np.testing.assert_array_equal(envs.episode_lengths, [3, 3, 0, 3])


@every(mode=["NEXT_STEP", "SAME_STEP", "DISABLED"], name=WRAPPERS)
def test_wrappers_refuse_the_modes_that_the_page_of_adapters_names(name, mode):
    """By a ValueError in Gymnasium 1.4, by an AssertionError in 1.2."""
    arguments = dict(WRAPPERS[name])
    refused = mode in arguments.pop("refused", ())
    envs = StepperVectorEnv("Hopper", 2, autoreset_mode=mode)
    if not refused:
        assert len(run(getattr(vector, name)(envs, **arguments), 5)) == 5
        return
    with pytest.raises((ValueError, AssertionError)):
        getattr(vector, name)(envs, **arguments)


def test_every_adapter_is_here():
    assert set(MODULES) == LIBRARIES.keys() | {"native"}


@pytest.mark.parametrize("module", LIBRARIES)
def test_a_library_that_is_missing_is_named_with_its_remedy(module):
    library, remedy = LIBRARIES[module]
    code = f"import sys; sys.modules[{library!r}] = None; import stepper.adapters.{module}"
    ended = subprocess.run([sys.executable, "-W", "ignore", "-c", code], capture_output=True, text=True, check=False)
    error = ended.stderr.splitlines()[-1]
    assert "MissingPackageError" in error
    assert f"{library.partition('.')[0]}" in error
    assert f"for stepper.adapters.{module}" in error
    assert remedy in error
