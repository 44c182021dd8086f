"""Definitions of tasks: missing methods, and fields without a dataclass, are errors."""

import copy
import inspect
import pickle
import re
from dataclasses import dataclass, fields

import gymnasium
import numpy as np
import pytest
import stepper
from cases import Slide
from hypothesis import given
from hypothesis import strategies as st
from stepper.envs import TASKS, MujocoTask, Observation, StepperEnv, StepperVectorEnv, Task
from stepper.envs.tasks import Hopper

METHODS = [name for name, method in vars(Task).items() if inspect.isfunction(method) and name[0] != "_"]


class Scaled:
    def __init__(self):
        self.scale = 2.0

    def __getattr__(self, name):
        if name != "twice":
            raise AttributeError(name)
        return 2 * self.scale


def test_a_task_has_the_constructor_and_the_attributes_of_a_mixin():
    task = type("Own", (Slide, Scaled), {})()
    assert (task.scale, task.twice) == (2.0, 4.0)
    StepperEnv(task)


def test_a_task_may_have_its_own_constructor():
    class Made(Slide):
        def __new__(cls, gain=1.0):
            return super().__new__(cls)

        def __init__(self, gain=1.0):
            self.gain = gain

    for kind in (Made, type("Any", (Slide,), {"__init__": lambda self, *given, **named: None})):
        StepperEnv(kind(2.0))
        StepperEnv(kind(gain=2.0))


def test_settings_of_environments_are_no_members_of_tasks():
    assert StepperVectorEnv(Slide(), 2, max_episode_steps=3, options=stepper.Options(), precision="f32", threads=1, dtype=np.float32)
    gymnasium.register("test/Slide-v0", entry_point="stepper.envs:StepperEnv", kwargs={"task": Slide()}, max_episode_steps=3)
    assert gymnasium.make("test/Slide-v0").spec.max_episode_steps == 3

    class Bounded(Slide):
        def action_bounds(self, model):
            return np.full(1, -2.0), np.full(1, 2.0)

    assert StepperEnv(Bounded()).action_space.high == 2.0


@pytest.mark.parametrize("method", METHODS)
def test_a_value_in_place_of_a_method_is_an_error_with_the_definition(method):
    definition = f"{method}({', '.join(inspect.signature(getattr(Task, method)).parameters)})"
    own = type("Own", (Slide,), {method: 3})()
    with pytest.raises(TypeError, match=rf"Own\.{method} is 3, must be a method: write def {re.escape(definition)}"):
        StepperEnv(own)


def test_a_missing_method_is_named():
    with pytest.raises(TypeError, match=r"abstract class Own .*model.*observations"):
        type("Own", (Task,), {})()
    without = {name: value for name, value in vars(Slide).items() if name in ("frame_skip", "model", "observations")}
    with pytest.raises(TypeError, match=r"^Own has no reward: define reward\(self, now\), or rewards\(self\)"):
        StepperEnv(type("Own", (Task,), without)())
    members = {name: vars(Slide)[name] for name in ("model", "observations", "reward")}
    with pytest.raises(TypeError, match=r"Own has no frame_skip, .*: add the field `frame_skip: int = 1`"):
        StepperEnv(type("Own", (Task,), members)())
    with pytest.raises(TypeError, match=r"OfMujoco has no xml_file, the file of its model: add the field `xml_file: str"):
        StepperEnv(type("OfMujoco", (MujocoTask,), {name: vars(Slide)[name] for name in ("frame_skip", "observations", "reward")})())


def test_arguments_of_a_dataclass_are_checked():
    with pytest.raises(TypeError, match="unexpected keyword argument 'forward_weight'"):
        Hopper(forward_weight=1.0)
    with pytest.raises(TypeError, match=r"StepperEnv\(\) takes no 'forward_weight'; did you mean forward_reward_weight"):
        StepperEnv("Hopper", forward_weight=1.0)


def changes():
    """Fields of Gymnasium's tasks: task, and name of the field."""
    return [(task, field.name) for task in TASKS.values() for field in fields(task) if field.init]


@given(st.sampled_from(changes()), st.booleans(), st.booleans())
def test_a_changed_default_that_python_ignores_is_an_error(change, typed, decorated):
    task, name = change
    value = task.__dataclass_fields__[name].default
    value = value + 1 if isinstance(value, float) else 7  # Another value, of a type that the field need not have.
    own = type("Own", (task,), {name: value} | ({"__annotations__": {name: object}} if typed else {}))
    own = dataclass(frozen=True, kw_only=True)(own) if decorated else own
    if typed and decorated:
        assert getattr(own(), name) is value
        return
    with pytest.raises(TypeError, match=rf"Own changes {name} of a dataclass without effect: write @dataclass.*, {name}: .* = {value!r}$"):
        StepperEnv(own)


def test_a_constructor_of_ones_own_gives_defaults():
    own = type("Own", (Hopper,), {"frame_skip": 3, "__init__": lambda self: None})
    assert StepperEnv(own).task.frame_skip == 3


@pytest.mark.parametrize("task", [Slide(), Hopper(frame_skip=2)])
def test_tasks_are_copied_and_pickled(task):
    for twin in (copy.copy(task), copy.deepcopy(task), pickle.loads(pickle.dumps(task))):
        assert vars(twin) == vars(task)
    assert "reset_noise_scale" in inspect.signature(Hopper).parameters


def test_a_class_of_environments_has_its_own_methods():
    class Own(StepperEnv):
        def __init__(self, **given):
            super().__init__("Hopper", **given)

        def reset(self, **given):
            return self._first_three(super().reset(**given))

        def _first_three(self, found):
            return found[0][:3], found[1]

        @property
        def model(self):
            return self.sim.model

    assert Own().reset(seed=0)[0].shape == (3,)
    assert Own().model.nq == 6


@pytest.mark.parametrize(("members", "message"), [
    ({"carried": "level"}, r"Own\.carried is 'level', must be a tuple of names: \('level',\)"),
    ({"camera": "track"}, r"Own\.camera is 'track', must be a dict such as .*camera_name of the environment names a camera"),
    ({"observations": lambda self: [Observation("qpos", columns=[0, 9])]}, r"the row 'qpos': columns is \[0, 9\]: index 9 is out"),
])  # fmt: skip
def test_values_of_a_wrong_kind_are_named(members, message):
    with pytest.raises((TypeError, ValueError), match=message):
        StepperEnv(type("Own", (Slide,), members)())
