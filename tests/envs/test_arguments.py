"""Arguments of environments: names of Gymnasium and Stable-Baselines3, modes by name, and errors that name what was given."""

import dataclasses
import re

import gymnasium
import numpy as np
import pytest
import stepper
import stepper.envs
from gymnasium.vector import AutoresetMode
from hypothesis import given
from hypothesis import strategies as st
from stepper.adapters.native import make_native, with_autoreset
from stepper.envs import StepperEnv, StepperVectorEnv
from stepper.envs.environment import autoreset
from stepper.envs.tasks import TASKS

NAME = "stepper/InvertedPendulum-v5"
MODEL = stepper.load("<mujoco><worldbody><body><joint/><geom size='.1' pos='.2 0 0'/></body></worldbody></mujoco>")


@given(st.sampled_from(AutoresetMode), st.sampled_from(["member", "name", "value", "lower"]))
def test_modes_are_members_names_and_values(mode, form):
    assert autoreset({"member": mode, "name": mode.name, "value": mode.value, "lower": mode.name.lower()}[form]) is mode


@given(st.text() | st.integers() | st.none())
def test_another_mode_is_an_error_with_all_names(text):
    known = {word for mode in AutoresetMode for word in (mode.name.lower(), mode.value.lower())}
    if not isinstance(text, str) or text.lower() not in known:
        with pytest.raises(ValueError, match=r"autoreset_mode is .*, must be 'NEXT_STEP', 'SAME_STEP', 'DISABLED', or a member of"):
            autoreset(text)


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
    with pytest.raises(ValueError, match=r"dtype is .*, must be np\.float64 or np\.float32"):
        StepperEnv("InvertedPendulum", dtype=value)


@pytest.mark.parametrize(("seed", "message"), [
    ([0, 1.5], "the seed of environment 1 is 1.5, must be a whole number, or None"),
    ([0, "x"], "the seed of environment 1 is 'x', must be a whole number"),
    ([None, True], "the seed of environment 1 is True, must be a whole number"),
    (1.5, "seed is 1.5, must be a whole number, or a sequence"),
    ("12", "seed is '12', must be a whole number, or a sequence"),
])  # fmt: skip
def test_every_seed_is_checked(seed, message):
    with pytest.raises(TypeError, match=message):
        StepperVectorEnv("InvertedPendulum", 2).reset(seed=seed)


def test_a_library_has_the_mode_that_it_needs():
    same = AutoresetMode.SAME_STEP
    assert with_autoreset({"threads": 1}, same, "L") == {"threads": 1, "autoreset_mode": same}
    assert with_autoreset({"autoreset_mode": "SAME_STEP"}, same, "L") == {"autoreset_mode": same}
    with pytest.raises(ValueError, match="autoreset_mode is NEXT_STEP, must be SAME_STEP for rsl_rl: leave it out"):
        with_autoreset({"autoreset_mode": "NEXT_STEP"}, same, "rsl_rl")


CALLS = {
    "vector": lambda **given: StepperVectorEnv("InvertedPendulum", **given),
    "make_vec": lambda **given: gymnasium.make_vec(NAME, num_envs=1, **given),
    "make": lambda **given: gymnasium.make(NAME, **given),
    "single": lambda **given: StepperEnv("InvertedPendulum", **given),
    "native": lambda **given: make_native(NAME, 1, **given),
}


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize(("name", "hint"), [("dtyp", "; did you mean dtype?"), ("colour", "; there are: ")])
def test_an_unknown_argument_has_similar_names_or_all(call, name, hint):
    with pytest.raises(TypeError) as error:
        CALLS[call](**{name: 1})
    assert re.fullmatch(rf"Stepper(Vector)?Env\(\) takes no {name!r}{re.escape(hint)}.*", str(error.value))


def test_arguments_with_a_task_that_exists():
    with pytest.raises(TypeError, match=r"Hopper exists already: give \['frame_skip'\] to its constructor, as Hopper\(frame_skip=\.\.\.\)"):
        StepperEnv(TASKS["Hopper"](), frame_skip=2)
    with pytest.raises(TypeError, match="takes no 'frame_skp'; did you mean frame_skip"):
        StepperVectorEnv(TASKS["Hopper"](), 2, frame_skp=2)


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
