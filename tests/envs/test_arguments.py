"""Arguments of environments: names of Gymnasium and Stable-Baselines3, modes by name, and errors that name what was given."""

import dataclasses
import re
import warnings
from dataclasses import dataclass

import gymnasium
import numpy as np
import pytest
import stepper
import stepper.envs
from cases import Slide
from checks import raises
from gymnasium.error import ClosedEnvironmentError
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode
from hypothesis import given, strategies as st
from hypothesis.extra import numpy as arrays
from loading_scenes import arm
from stepper._arrays import array_of
from stepper.adapters.native import make_native, with_autoreset
from stepper.envs import Observation, StepperEnv, StepperVectorEnv, Task
from stepper.envs.environment import autoreset
from stepper.envs.task import TaskView
from stepper.envs.tasks import TASKS
from stepper.policies.ppo_settings import check_bounds

NAME = "stepper/InvertedPendulum-v5"
MODEL = stepper.load("<mujoco><worldbody><body><joint/><geom size='.1' pos='.2 0 0'/></body></worldbody></mujoco>")
CALLS = {
    "vector": lambda **given: StepperVectorEnv("InvertedPendulum", **given),
    "make_vec": lambda **given: gymnasium.make_vec(NAME, num_envs=1, **given),
    "make": lambda **given: gymnasium.make(NAME, **given),
    "single": lambda **given: StepperEnv("InvertedPendulum", **given),
    "native": lambda **given: make_native(NAME, 1, **given),
}
WRONG = {
    "complex": np.array([[1.0 + 0.0j]]),
    "masked": np.ma.array([[1.0]], mask=[[True]]),
    "masked without a mask": np.ma.array([[1.0]]),
    "objects": np.array([[1.0]], dtype=object),
    "texts": np.array([["1.0"]]),
    "times": np.array([[1]], dtype="m8[s]"),
    "nothing": None,
    "ragged": [[1.0], [1.0, 2.0]],
}
ENV_CALLS = {
    "reset": lambda env: env.reset(seed=0),
    "step": lambda env: env.step(np.zeros(env.action_space.shape)),
    "set_state": lambda env: env.set_state(np.array(env.sim.qpos) if isinstance(env, StepperVectorEnv) else env.sim.qpos[0]),
    "render": lambda env: env.render(),
}


@given(st.sampled_from(AutoresetMode), st.sampled_from(["member", "name", "value", "lower"]))
def test_modes_are_members_names_and_values(mode, form):
    assert autoreset({"member": mode, "name": mode.name, "value": mode.value, "lower": mode.name.lower()}[form]) is mode


@given(st.text() | st.integers() | st.none())
def test_another_mode_is_an_error_with_all_names(text):
    known = {word for mode in AutoresetMode for word in (mode.name.lower(), mode.value.lower())}
    if not isinstance(text, str) or text.lower() not in known:
        raises(ValueError, r"autoreset_mode is .*, must be 'NEXT_STEP', 'SAME_STEP', 'DISABLED', or a member of", autoreset, text)


def test_environments_take_the_mode_by_name():
    for made in (
        gymnasium.make_vec(NAME, num_envs=2, autoreset_mode="SAME_STEP"),
        StepperVectorEnv("InvertedPendulum", 2, autoreset_mode="same_step"),
        make_native(NAME, 2, autoreset_mode="SameStep"),
    ):
        assert made.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
        made.close()


@pytest.mark.parametrize("value", ["f32", "float32", np.float32, np.dtype("f4"), "single"])
def test_precisions_are_also_types_of_numpy(value):
    assert StepperVectorEnv("InvertedPendulum", 1, precision=value).sim.precision == "f32"
    assert StepperVectorEnv("InvertedPendulum", 1, dtype=value).single_observation_space.dtype == np.float32


@pytest.mark.parametrize("value", [np.float16, 32, "f16", int, object()])
def test_another_precision_is_an_error_with_the_remedy(value):
    with pytest.raises(ValueError, match=r'precision is .*, must be "f64" or "f32", or np\.float64 or np\.float32'):
        StepperEnv("InvertedPendulum", precision=value)
    raises(ValueError, r"dtype is .*, must be np\.float64 or np\.float32", StepperEnv, "InvertedPendulum", dtype=value)


@pytest.mark.parametrize(("seed", "message"), [
    ([0, 1.5], "the seed of environment 1 is 1.5, must be a whole number, or None"),
    ([0, "x"], "the seed of environment 1 is 'x', must be a whole number"),
    ([None, True], "the seed of environment 1 is True, must be a whole number"),
    (1.5, "seed is 1.5, must be a whole number, or a sequence"),
    ("12", "seed is '12', must be a whole number, or a sequence"),
])  # fmt: skip
def test_every_seed_is_checked(seed, message):
    raises(TypeError, message, lambda: StepperVectorEnv("InvertedPendulum", 2).reset(seed=seed))


def test_a_library_has_the_mode_that_it_needs():
    same = AutoresetMode.SAME_STEP
    assert with_autoreset({"threads": 1}, same, "L") == {"threads": 1, "autoreset_mode": same}
    assert with_autoreset({"autoreset_mode": "SAME_STEP"}, same, "L") == {"autoreset_mode": same}
    with pytest.raises(ValueError, match="autoreset_mode is NEXT_STEP, must be SAME_STEP for rsl_rl: leave it out"):
        with_autoreset({"autoreset_mode": "NEXT_STEP"}, same, "rsl_rl")


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize(("name", "hint"), [("dtyp", "; did you mean dtype?"), ("colour", "; there are: ")])
def test_an_unknown_argument_has_similar_names_or_all(call, name, hint):
    with pytest.raises(TypeError) as error:
        CALLS[call](**{name: 1})
    assert re.fullmatch(rf"Stepper(Vector)?Env\(\) takes no {name!r}{re.escape(hint)}.*", str(error.value))


def test_arguments_with_a_task_that_exists():
    with pytest.raises(TypeError, match=r"Hopper exists already: give \['frame_skip'\] to its constructor, as Hopper\(frame_skip=\.\.\.\)"):
        StepperEnv(TASKS["Hopper"](), frame_skip=2)
    raises(TypeError, "takes no 'frame_skp'; did you mean frame_skip", lambda: StepperVectorEnv(TASKS["Hopper"](), 2, frame_skp=2))


@pytest.mark.parametrize(("given", "said"), [
    (lambda: gymnasium.make(NAME), "a value of type"),
    (lambda: lambda: gymnasium.make(NAME), "a function"),
    (lambda: [len], "a value of type list"),
    (lambda: MODEL, "a value of type Model"),
    (lambda: None, "the task is None"),
    (lambda: 3, "the task is 3"),
    (lambda: dict, "the class dict"),
])  # fmt: skip
def test_something_else_than_a_task_is_named(given, said):
    value = given()
    for call in (lambda: StepperVectorEnv(value, 1), lambda: make_native(value, 1)):
        with pytest.raises(TypeError, match=r"the task is .*, must be a stepper.envs.Task, the class of one, or the name of one") as error:
            call()
        assert said in str(error.value)


def test_a_single_environment_lists_no_argument_of_vector_environments():
    with pytest.raises(TypeError, match="takes no 'colour'; there are: ") as error:
        StepperEnv("InvertedPendulum", colour=1)
    assert not any(name in str(error.value) for name in ("threads", "autoreset_mode", "episode_statistics"))


def test_settings_and_arguments_of_tasks_have_different_names():
    settings = set(StepperVectorEnv.__init__.__kwdefaults__) | {"num_envs"}
    for task in TASKS.values():
        assert not settings & {field.name for field in dataclasses.fields(task)} - {"contact"}


@pytest.mark.parametrize("kind", WRONG)
def test_actions_that_are_no_real_numbers_are_refused(kind):
    """NumPy would drop imaginary parts and masks, and convert texts and objects."""
    single, batch = StepperEnv(Slide()), StepperVectorEnv(Slide(), 1)
    single.reset(seed=0)
    batch.reset(seed=0)
    raises(TypeError, r"^action is ", single.step, WRONG[kind] if kind in ("nothing", "ragged") else WRONG[kind][0])
    raises(TypeError, r"^actions is ", batch.step, WRONG[kind])
    assert batch.sim.time[0] == 0.0


@given(arrays.arrays(arrays.scalar_dtypes(), arrays.array_shapes(min_dims=0, max_dims=3, min_side=1)))
def test_an_array_is_converted_without_a_change_or_refused(values):
    """Integers beyond 2^53 are rounded, as everywhere in NumPy."""
    if values.dtype.kind in "fiub":
        np.testing.assert_array_equal(array_of("x", values), values.astype(np.float64))
    else:
        raises(TypeError, r"^x is ", array_of, "x", values)


@dataclass(frozen=True, kw_only=True)
class Unbounded(Slide):
    """A task whose only action has no bounds."""

    def action_bounds(self, model):
        return np.full(1, -np.inf), np.full(1, np.inf)


def test_an_action_of_an_infinite_range_that_is_nan_has_its_cause():
    """Learners scale actions to their bounds: the middle of infinite ones is NaN."""
    envs = StepperVectorEnv(Unbounded(), 2)
    envs.reset(seed=0)
    space = envs.single_action_space
    with np.errstate(invalid="ignore"):
        action = np.tile((space.low + space.high) / 2, (2, 1))
    with pytest.raises(
        ValueError, match=r"is nan in column 0 .* The bounds of this action are -inf to inf, .*: define finite ones by action_bounds"
    ):
        envs.step(action)
    bounded = StepperVectorEnv(Slide(), 2)
    bounded.reset(seed=0)
    raises(ValueError, "Check the policy's weights", bounded.step, np.full((2, 1), np.nan))


def test_a_training_with_infinite_bounds_ends_before_it_starts():
    """The message names an action and its bounds, and where to define finite ones; all registered tasks have finite ones."""
    space = Box(np.array([-1.0, -np.inf, -1.0]), np.array([1.0, np.inf, np.inf]), dtype=np.float32)
    with pytest.raises(
        ValueError, match=r"^action 1 of me/Reach-v0 has the bounds -inf to inf, and 1 more actions? .*action_bounds.*ctrlrange"
    ):
        check_bounds("me/Reach-v0", space)
    check_bounds("stepper/HalfCheetah-v5", StepperVectorEnv("HalfCheetah", 1).single_action_space)


@pytest.mark.parametrize("make", [lambda: StepperEnv(Slide()), lambda: StepperVectorEnv(Slide(), 2)], ids=["single", "vector"])
@pytest.mark.parametrize("call", ENV_CALLS)
def test_a_closed_environment_refuses_calls(make, call):
    env = make()
    env.reset(seed=0)
    ENV_CALLS[call](env)
    env.close()
    env.close()
    raises(ClosedEnvironmentError, f"^{call} was called after close: ", lambda: ENV_CALLS[call](env))
    assert len(env.sim.qpos) == env.sim.num_envs


def test_a_closed_environment_behind_wrappers_refuses_steps():
    env = gymnasium.make("stepper/HalfCheetah-v5")
    env.reset(seed=0)
    env.close()
    with pytest.raises(ClosedEnvironmentError):
        env.step(np.zeros(6))


class Wrong:
    @property
    def height(self):
        return [].top


@pytest.mark.parametrize("kind", [Slide, StepperEnv, StepperVectorEnv, TaskView])
def test_an_error_inside_a_property_shows(kind):
    own = type("Own", (Wrong, kind), {})
    with pytest.raises(AttributeError, match=r"^'list' object has no attribute 'top'$"):
        own.__new__(own).height  # noqa: B018


def test_an_absent_attribute_of_a_view_or_a_reset_has_similar_names():
    envs = StepperVectorEnv(Slide(), 2)
    envs.reset(seed=0)
    with pytest.raises(AttributeError, match=r"^a stepper.envs.TaskView has no attribute 'qpso'; did you mean qpos\?$"):
        envs.now.qpso  # noqa: B018
    raises(TypeError, r"now\['qpos'\] is not defined: quantities are attributes, as now\.qpos, and now\.read", lambda: envs.now["qpos"])
    own = type("Own", (Slide,), {"reset": lambda self, reset: reset.qpso})()
    with pytest.raises(AttributeError, match=r"^a stepper.envs.Reset has no attribute 'qpso'; did you mean qpos"):
        StepperVectorEnv(own, 2).reset(seed=0)


def test_the_time_of_an_episode_counts_actions():
    envs = StepperVectorEnv("Hopper", 2, max_episode_steps=3)
    envs.reset(seed=0)
    for _ in range(8):
        envs.step(np.zeros((2, 3)))
        np.testing.assert_array_equal(np.rint(envs.now.time / envs.now.dt), envs.episode_lengths)


@dataclass(frozen=True)
class Arm(Task):
    """An arm from a URDF."""

    actuators_of_joints: str | None = None
    frame_skip: int = 1

    def model(self):
        return stepper.load(arm(), actuators=self.actuators_of_joints)

    def observations(self):
        return (Observation("qpos"),)

    def reward(self, now):
        return np.zeros(now.sim.num_envs or 1), {}


def test_a_urdf_without_actuators_warns_with_the_remedy():
    with pytest.warns(
        stepper.ModelWarning, match=r'Arm: the model "r" has no actuators, .* stepper\.load\(\.\.\., actuators="position"\)'
    ) as caught:
        envs = StepperVectorEnv(Arm(), 2)
    assert envs.single_action_space.shape == (0,)
    assert caught[0].filename == __file__


def test_one_with_actuators_does_not():
    with warnings.catch_warnings(action="error"):
        envs = StepperVectorEnv(Arm("position"), 2)
    assert envs.single_action_space.low.tolist() == [-1, -1]
    assert envs.single_action_space.high.tolist() == [2, 2]


def test_a_task_with_actions_of_its_own_does_not():
    class Moved(Arm):
        def action_bounds(self, model):
            return np.full(1, -1.0), np.full(1, 1.0)

    with warnings.catch_warnings(action="error"):
        StepperVectorEnv(Moved(), 2)
