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
from checks import raises
from hypothesis import given, strategies as st
from stepper.envs import TASKS, Group, MujocoTask, Observation, StepperEnv, StepperVectorEnv, Task
from stepper.envs.tasks import Hopper

METHODS = [name for name, method in vars(Task).items() if inspect.isfunction(method) and name[0] != "_"]
SPEED = Observation("speed", lambda now: now.qvel)
TABLES = {
    **{f"returns {words}, must return a tuple of Observation, as (Observation(": table for words, table in {
        "a value of type Observation": SPEED, "'qpos'": "qpos", "None": None, "an array of shape (4, 1)": [np.zeros((4, 1))],
        "a value of type list": (), "a function": (lambda now: now.qpos,), "the class Observation": (SPEED, Observation),
    }.items()},
    "returns the groups 'critic', must have the group 'policy'": {"critic": (SPEED,)},
    "returns a value of type Group, must return a tuple of Observation": Group((SPEED,)),
    "returns two rows with the name 'speed': give one another name": (SPEED, SPEED),
    "the row 'x' is 0.0, must be an array (4, ...)": (Observation("x", lambda now: 0.0),),
    "the row 'x' is an array of shape (1,), must be an array (4, ...)": (Observation("x", lambda now: now.qpos[0]),),
    "the row 'qpos': columns is 0, must be a slice": (Observation("qpos", columns=0),),
    "the row 'step' is a function, must be an array (4, ...)": (Observation("step"),),
}  # fmt: skip


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
    raises(TypeError, rf"Own\.{method} is 3, must be a method: write def {re.escape(definition)}", StepperEnv, own)


def test_a_missing_method_is_named():
    raises(TypeError, r"abstract class Own .*model.*observations", type("Own", (Task,), {}))
    without = {name: value for name, value in vars(Slide).items() if name in ("frame_skip", "model", "observations")}
    with pytest.raises(TypeError, match=r"^Own has no reward: define reward\(self, now\), or rewards\(self\)"):
        StepperEnv(type("Own", (Task,), without)())
    members = {name: vars(Slide)[name] for name in ("model", "observations", "reward")}
    with pytest.raises(TypeError, match=r"Own has no frame_skip, .*: add the field `frame_skip: int = 1`"):
        StepperEnv(type("Own", (Task,), members)())
    with pytest.raises(TypeError, match=r"OfMujoco has no xml_file, the file of its model: add the field `xml_file: str"):
        StepperEnv(type("OfMujoco", (MujocoTask,), {name: vars(Slide)[name] for name in ("frame_skip", "observations", "reward")})())


def test_arguments_of_a_dataclass_are_checked():
    raises(TypeError, "unexpected keyword argument 'forward_weight'", Hopper, forward_weight=1.0)
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
    raises(TypeError, rf"Own changes {name} of a dataclass without effect: write @dataclass.*, {name}: .* = {value!r}$", StepperEnv, own)


def test_a_constructor_of_ones_own_gives_defaults():
    assert StepperEnv(type("Own", (Hopper,), {"frame_skip": 3, "__init__": lambda self: None})).task.frame_skip == 3


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
    raises((TypeError, ValueError), message, lambda: StepperEnv(type("Own", (Slide,), members)()))


# Results of a task's methods with a wrong shape, and episode data of environments that were not reset, are errors.


class Cart(Slide):
    """A cart, with a target per episode."""

    def episode_state(self, num_envs):
        return {"target": np.zeros((num_envs, 3))}

    def reset(self, reset):
        reset.episode_state["target"] = reset.rng.uniform(-1, 1, 3)


def cart(**methods):
    """Vector environment of a cart with other methods, after a reset and two steps."""
    envs = StepperVectorEnv(type("Other", (Cart,), methods)(), 4, max_episode_steps=2)
    envs.reset(seed=0)
    envs.step(np.zeros((4, 1)))
    envs.step(np.zeros((4, 1)))
    envs.reset()
    return envs


@pytest.mark.parametrize("message", TABLES)
def test_a_wrong_table_of_observations_is_named(message):
    raises(ValueError, r"Other\.observations:? " + re.escape(message), cart, observations=lambda self: TABLES[message])


def test_a_row_that_names_no_quantity_has_similar_names():
    with pytest.raises(AttributeError, match=r"TaskView has no attribute 'qpoz'; did you mean qpos"):
        cart(observations=lambda self: (Observation("qpoz"),))


def test_a_list_or_a_generator_of_observations_is_accepted():
    for table in (lambda self: [SPEED], lambda self: (row for row in [SPEED])):
        assert cart(observations=table).observation_structure == {"speed": 1}


ROWS = "must return an array (4,) of"
RESULTS = {
    f"reward returns an array of shape (), {ROWS} float64": {"reward": lambda self, now: (1.0, {})},
    f"reward returns an array of shape (4, 1), {ROWS} float64": {"reward": lambda self, now: np.ones((4, 1))},
    "reward returns a tuple (ndarray, list), must return rewards (4,), or two values": {"reward": lambda self, now: (np.ones(4), [])},
    f"terminated returns an array of shape (), {ROWS} bool": {"terminated": lambda self, now: True},
    f"terminated returns a value of type Int64DType, {ROWS} bool": {"terminated": lambda self, now: np.zeros(4, int)},
    f"truncated returns an array of shape (4, 1), {ROWS} bool": {"truncated": lambda self, now: np.zeros((4, 1), bool)},
    f"truncated returns a tuple (ndarray, dict), {ROWS} bool": {"truncated": lambda self, now: (now.qpos[:, 0] > 0, {})},
    "reset returns an array of shape (4, 1), must return nothing": {"reset": lambda self, reset: reset.qpos + 1},
    "on_end returns False, must return nothing": {"on_end": lambda self, now, envs: False},
    "advance returns an array of shape (4, 1), must return nothing": {"advance": lambda self, now: now.sim.qpos},
    "model returns '<mujoco/>', must return a stepper.Model: return stepper.load(...)": {"model": lambda self: "<mujoco/>"},
    **{f"action_bounds returns {words}, must return two arrays (n,)": {"action_bounds": lambda self, model, bounds=bounds: bounds}
       for words, bounds in {
           "1.0": 1.0, "a tuple (ndarray, ndarray)": (np.zeros(1), np.ones(2)), "a tuple (float, float)": (-1.0, 1.0),
           "a value of type list": [np.ones(1), -np.ones(1)],
       }.items()},
    "episode_state returns None, must return a dictionary": {"episode_state": lambda self, num_envs: None},
    "episode_state returns 'target' of shape (3,), must be (4, ...)": {"episode_state": lambda self, num_envs: {"target": np.zeros(3)}},
    "info returns None, must return a dictionary": {"info": lambda self, now: None},
    "info returns 'one' as 1.0, must be an array (4, ...)": {"info": lambda self, now: {"one": 1.0}},
    "reward returns 'one' as an array of shape (), must be an array": {"reward": lambda self, now: (np.ones(4), {"one": np.array(1.0)})},
    "position returns an array of shape (1,), must return an array (4, ...)": {"position": lambda self, now: now.qpos[0]},
}  # fmt: skip


@pytest.mark.parametrize("message", RESULTS)
def test_a_wrong_result_of_each_other_method_is_named(message):
    raises(ValueError, r"Other\." + re.escape(message), cart, **RESULTS[message])


def test_episode_state_of_some_environments_has_its_shape():
    def reset(self, reset):
        reset.episode_state["target"] = reset.rng.uniform(-1, 1, 3)[:, 0]

    raises(ValueError, r"episode_state\['target'\] of Other is set to an array of shape \(4,\), must have .*: set rows", cart, reset=reset)


def test_names_that_episode_state_does_not_return_are_errors_with_those_it_does():
    for methods in (
        {"reward": lambda self, now: (now.episode_state["tagret"][:, 0], {})},
        {"reset": lambda self, reset: reset.episode_state["tagret"]},
        {"reset": lambda self, reset: reset.episode_state.__setitem__("tagret", np.zeros(4))},
        {"advance": lambda self, now: now.episode_state.__setitem__("tagret", np.zeros(4))},
    ):
        raises(KeyError, r"Other\.episode_state returns no 'tagret', it returns target: define", cart, **methods)
    again = pickle.loads(pickle.dumps(StepperVectorEnv(Cart(), 2))).now.episode_state
    assert again["target"].shape == (2, 3)
    raises(KeyError, "it returns target", lambda: again["targets"])


TASK_METHODS = {
    "reward is reward(), must take 1 argument, now: write def reward(self, now)": {"reward": lambda now: (now, {})},
    "observations is observations(now), must take no arguments: write def observations(self)": {"observations": lambda self, now: (SPEED,)},
    "reset is reset(sim, mask), must take 1 argument, reset": {"reset": lambda self, sim, mask: None},
    "model is model(path), must take no arguments": {"model": lambda self, path: None},
}  # fmt: skip


@pytest.mark.parametrize("message", TASK_METHODS)
def test_a_method_with_other_arguments_is_named_with_its_signature(message):
    for name, method in TASK_METHODS[message].items():
        method.__name__ = name
    raises(TypeError, r"Other\." + re.escape(message), cart, **TASK_METHODS[message])


def test_methods_with_defaults_and_other_names_are_accepted():
    cart(reward=lambda self, now: np.ones(4))
    cart(reset=lambda self, begins, *more, scale=1.0: None, reward=lambda self, *given: (np.ones(4), {}))
