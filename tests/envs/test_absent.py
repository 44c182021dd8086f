"""Absent attributes of environments and of `now`: the error names what to use, and that works."""

import copy
import inspect
import pickle
import re
from dataclasses import dataclass

import gymnasium
import numpy as np
import pytest
import stepper.envs
from cases import Slide
from stepper import _hints
from stepper._hints import replacements
from stepper.envs import StepperEnv, StepperVectorEnv
from stepper.envs.task import TaskView

NAME = "stepper/Hopper-v5"
ENV, ENVS = gymnasium.make(NAME), gymnasium.make_vec(NAME, num_envs=3)
OWNERS = {"StepperEnv": ENV, "StepperVectorEnv": ENVS}
NEW_NAMES = {owner: replacements("StepperEnv") | replacements(owner) for owner in OWNERS}
for _made in (ENV, ENVS):
    _made.reset(seed=0)
    for _ in range(2):
        _made.step(np.zeros(_made.action_space.shape))
OTHERS = StepperVectorEnv("Hopper", 2)
OTHERS.reset(seed=0)
NOW = OTHERS.now


def value(hint, env):
    """Value of the expression with which a hint begins, on an environment."""
    expression = re.match(r"[\w.]+(\((\w+(\(\))?(, )?)*\))?", hint).group()
    names = {
        **{name: getattr(env.unwrapped, name) for name in dir(env.unwrapped) if not name.startswith("__") and hasattr(env.unwrapped, name)},
        **{
            "env": env,
            "name": "torso",
            "ctrl": np.zeros(3),
            "nstep": 1,
            "geoms": ["floor"],
            "actions": np.zeros((3, 3)),
            "stepper": stepper,
        },
    }
    return eval(expression, names)


@pytest.mark.parametrize(("owner", "name"), [(owner, name) for owner in OWNERS for name in NEW_NAMES[owner]])
def test_an_attribute_of_another_library_has_a_hint(owner, name):
    env, hint = OWNERS[owner], NEW_NAMES[owner][name]
    with pytest.raises(AttributeError, match=f"^a stepper.envs.{owner} has no attribute '{name}'; ") as error:
        getattr(env.unwrapped, name)
    assert hint in str(error.value)
    code = re.match(r"(sim|task|now|spec|dt|action_space|single_\w+|observation_\w+|step\(|episode_\w+|render)\b", hint)
    if code and "..." not in hint:
        value(hint, env)


@pytest.mark.parametrize("owner", OWNERS)
def test_attributes_of_the_parts_of_an_environment_are_found(owner):
    """Of its task, stepper, model and view: the error has the expression, whose value is the attribute."""
    env = OWNERS[owner]
    parts = {"task": env.unwrapped.task, "sim": env.unwrapped.sim, "sim.model": env.unwrapped.sim.model, "now": env.unwrapped.now}
    tried = 0
    for place, part in parts.items():
        for name in dir(part):
            if name.startswith("_") or hasattr(env.unwrapped, name) or name in NEW_NAMES[owner]:
                continue
            with pytest.raises(AttributeError, match=f"has no attribute '{name}'; use env.unwrapped") as error:
                getattr(env.unwrapped, name)
            expression = str(error.value).partition("; use ")[2]
            assert eval(expression, {"env": env}) is not NotImplemented
            tried += place != "sim.model"
    assert tried > 30
    with pytest.raises(AttributeError, match=r"'healthy_z_range'; use env\.unwrapped\.task\.healthy_z_range$"):
        env.unwrapped.healthy_z_range  # noqa: B018


class Wrong:
    @property
    def height(self):
        return [].top


@pytest.mark.parametrize("kind", [Slide, StepperEnv, StepperVectorEnv, TaskView, _hints.Hints])
def test_an_error_inside_a_property_shows(kind):
    own = type("Own", (Wrong, kind), {})
    with pytest.raises(AttributeError, match=r"^'list' object has no attribute 'top'$"):
        own.__new__(own).height  # noqa: B018


def test_special_names_have_no_hint():
    """Libraries look for many of them, and similar names take a millisecond."""
    for thing in (Slide(), ENV.unwrapped, ENVS.unwrapped):
        with pytest.raises(AttributeError, match=f"^'{type(thing).__name__}' object has no attribute '__array__'$"):
            thing.__array__  # noqa: B018


def test_a_misspelled_attribute_of_an_environment_is_suggested():
    with pytest.raises(AttributeError, match="did you mean episode_returns"):
        ENVS.unwrapped.episode_retuns  # noqa: B018
    with pytest.raises(AttributeError, match=r"as envs\.unwrapped\.sim\.qpos and envs\.unwrapped\.task\.<name>$"):
        ENVS.unwrapped.call("healthy_reward")


@pytest.mark.parametrize("name", replacements("TaskView"))
def test_an_attribute_that_now_has_not_has_a_hint(name):
    hint = replacements("TaskView")[name]
    with pytest.raises(AttributeError, match=f"^a stepper.envs.TaskView has no attribute '{name}'; ") as error:
        getattr(NOW, name)
    assert hint in str(error.value)
    if re.match(r"(velocity|action|episode_state|sim|time|default_qpos)\b", hint):
        assert getattr(NOW, re.match(r"\w+", hint).group()) is not None
    if hint.startswith("task."):
        assert eval(f"now.{hint}", {"now": NOW}) is not None


def test_hints_of_the_stepper_are_those_of_now():
    for name in replacements("engine"):
        if not {name} & {*replacements("TaskView"), *replacements("Stepper")} and not hasattr(NOW, name):
            with pytest.raises(AttributeError, match=f"^a stepper.envs.TaskView has no attribute '{name}'; ") as error:
                getattr(NOW, name)
            assert replacements("engine")[name].removeprefix(": ") in str(error.value)
    with pytest.raises(AttributeError, match=r"did you mean qpos\?$"):
        NOW.qpso  # noqa: B018
    with pytest.raises(TypeError, match=r"now\['qpos'\] is not defined: quantities are attributes, as now\.qpos, and now\.read"):
        NOW["qpos"]


def test_the_time_of_an_episode_counts_actions():
    envs = StepperVectorEnv("Hopper", 2, max_episode_steps=3)
    envs.reset(seed=0)
    for _ in range(8):
        envs.step(np.zeros((2, 3)))
        np.testing.assert_array_equal(np.rint(envs.now.time / envs.now.dt), envs.episode_lengths)


def test_hints_do_not_hinder_copies_and_lookups():
    env = StepperEnv(Slide())
    env.reset(seed=0)
    for twin in (copy.deepcopy(env), pickle.loads(pickle.dumps(env))):
        assert not hasattr(twin, "healthy_reward")
        assert not hasattr(twin, "_batches")
    assert not hasattr(StepperEnv.__new__(StepperEnv), "sim_dt")


@pytest.mark.parametrize("name", [*replacements("Reset"), "qpso"])
def test_an_attribute_that_a_reset_has_not_has_a_hint(name):
    hint = replacements("Reset").get(name, "qpos")
    found = []

    class Own(Slide):
        def reset(self, reset):
            found.append(eval(hint if "(" in hint else f"reset.{hint.partition(',')[0]}"))
            getattr(reset, name)

    with pytest.raises(AttributeError, match=f"^a stepper.envs.Reset has no attribute '{name}'; ") as error:
        StepperVectorEnv(Own(), 2).reset(seed=0)
    assert hint in str(error.value)
    assert len(found) == 1


@pytest.mark.parametrize("method", ["reward", "advance", "reset"])
def test_a_task_that_assigns_to_itself_has_a_note_with_the_place_of_data(method):
    def assigns(self, *arguments):
        self.last = 1.0

    assigns.__signature__ = inspect.signature(getattr(Slide, method))
    own = dataclass(frozen=True)(type("Own", (Slide,), {method: assigns}))
    envs = StepperVectorEnv(own(), 2)
    with pytest.raises(AttributeError, match="cannot assign to field 'last'") as error:
        envs.reset(seed=0)
        envs.step(np.zeros((2, 1)))
    assert "define episode_state(self, num_envs), which returns an array for each name" in error.value.__notes__[0]


@pytest.mark.parametrize("owner", OWNERS)
def test_an_argument_of_the_task_is_not_assigned_to_an_environment(owner):
    """The assignment changed nothing."""
    env = OWNERS[owner].unwrapped
    for name in ("frame_skip", "healthy_reward", "reset_noise_scale"):
        with pytest.raises(
            AttributeError, match=rf"^{name} of a {owner} cannot be assigned, .*: make another environment, with the argument {name}=3"
        ):
            setattr(env, name, 3)
    assert gymnasium.make(NAME, frame_skip=3, healthy_reward=3).unwrapped.task.frame_skip == 3
    with pytest.raises(AttributeError, match=r"^frame_skip of a StepperEnv cannot be assigned, .* or set it in the class Slide$"):
        StepperEnv(Slide()).frame_skip = 3
    env.own = 3
    assert env.own == 3
