"""Definitions of tasks: members that no environment calls are warnings, fields without a dataclass and missing methods are errors."""

import copy
import difflib
import functools
import inspect
import keyword
import pickle
import re
import warnings
from dataclasses import dataclass, fields

import gymnasium
import numpy as np
import pytest
import stepper
from cases import SLIDE, Slide
from hypothesis import assume, given
from hypothesis import strategies as st
from stepper._hints import replacements
from stepper.envs import TASKS, MujocoTask, Observation, StepperEnv, StepperVectorEnv, Task
from stepper.envs.tasks import Hopper

RENAMED, IGNORED, PARTS = (replacements(section) for section in ("Task", "ignored", "parts"))
METHODS = [name for name, method in vars(Task).items() if inspect.isfunction(method) and name[0] != "_"]


def signature(method):
    return f"{method}({', '.join(inspect.signature(getattr(Task, method)).parameters)})"


def nothing(self, *_):
    pass


FORMS = {
    "property": property(nothing), "static": staticmethod(nothing), "class": type("Terms", (), {}), "value": 3.0,
    "decorated": functools.wraps(nothing)(functools.partial(nothing)),
}  # fmt: skip
"""Members other than functions that a class can have under a name."""


def warnings_of(make):
    """Texts of the warnings that a function issues."""
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        make()
    return [str(each.message) for each in found]


@pytest.mark.parametrize("name", RENAMED)
def test_a_method_of_another_library_is_a_warning_with_the_method_to_define(name):
    """Such a method is never called: episodes never end, or have other rewards, without a word."""
    method = RENAMED[name].partition("(")[0]
    assert RENAMED[name] == signature(method)
    text = f"Own defines {name}, which environments ignore: define {signature(method)} instead of {name}"
    assert warnings_of(lambda: type("Own", (Slide,), {name: nothing})) == [text]
    assert not hasattr(Task, name)
    # A class that defines the method may have a helper of this name.
    assert warnings_of(lambda: type("Own", (Slide,), {name: nothing, method: vars(Task)[method]})) == []


@given(st.sampled_from(sorted(RENAMED.keys() - IGNORED.keys())), st.sampled_from(sorted(FORMS)))
def test_only_functions_have_names_of_methods(name, form):
    assert warnings_of(lambda: type("Own", (Slide,), {name: FORMS[form]})) == []


def test_the_warning_has_the_line_of_the_class_and_a_filter_silences_it():
    with pytest.warns(UserWarning, match="Own defines metrics, which environments ignore") as found:

        class Own(Slide):
            def metrics(self, now):
                return {}

    (warning,) = found
    assert warning.filename == __file__
    assert warning.lineno == inspect.getsourcelines(Own)[1]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", "Own defines metrics")
        type("Own", (Slide,), {"metrics": nothing})
        type("Again", (Own,), {"metrics": nothing})  # The base class has the method.
    with pytest.warns(UserWarning, match="Own defines resets, "), pytest.warns(UserWarning, match="Own defines max_steps, "):
        type("Own", (Slide,), {"resets": lambda self: self.resets(), "max_steps": 100})


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
    with pytest.raises(AttributeError, match=r"^other$"):
        task.other  # noqa: B018
    StepperEnv(task)


def test_a_task_may_have_its_own_constructor():
    class Made(Slide):
        def __new__(cls, gain=1.0):
            return super().__new__(cls)

    class Mixed:
        def __init__(self, gain=1.0):
            self.gain = gain

    for kind in (Made, type("Own", (Mixed, Slide), {}), type("Any", (Slide,), {"__init__": lambda self, *given, **named: None})):
        StepperEnv(kind(2.0))
        StepperEnv(kind(gain=2.0))


@st.composite
def typos(draw):
    """A method of Task, and its name with a letter left out, doubled or replaced, or two letters exchanged."""
    method = draw(st.sampled_from(METHODS))
    at = draw(st.integers(0, len(method) - 2))
    before, one, two, after = method[:at], method[at], method[at + 1], method[at + 2 :]
    letter = draw(st.sampled_from("abcdefghijklmnopqrstuvwxyz"))
    return method, before + draw(st.sampled_from([two, one + one + two, letter + two, two + one])) + after


@given(typos())
def test_a_misspelled_method_is_a_warning_with_the_right_name(typo):
    method, name = typo
    assume(name.isidentifier() and name not in METHODS and name not in RENAMED and name not in PARTS and not keyword.iskeyword(name))
    assume(difflib.get_close_matches(name, METHODS, 1, 0.85) == [method])  # Short names are similar to many others.
    text = f"Own defines {name}, which environments ignore: define {signature(method)} instead of {name}"
    assert warnings_of(lambda: type("Own", (Slide,), {name: nothing})) == [text]
    assert warnings_of(lambda: type("Own", (Slide,), {name: property(nothing)})) == []


def test_helpers_of_other_names_and_values_are_the_tasks_own():
    members = {"height": nothing, "torso_upright": nothing, "rewarding": nothing, "_scan": nothing, "health": property(nothing)}
    assert warnings_of(lambda: type("Own", (Slide,), members)) == []
    fields = {name: 3.0 for name in RENAMED.keys() - IGNORED.keys()}
    assert warnings_of(lambda: type("Own", (Slide,), {**fields, "__annotations__": dict.fromkeys(fields, float)})) == []


@pytest.mark.parametrize("name", IGNORED)
@pytest.mark.parametrize("how", ["value", "annotation"])
def test_a_value_that_environments_ignore_is_a_warning(name, how):
    text = f"Own defines {name}, which environments ignore: {IGNORED[name]}"
    assert warnings_of(lambda: type("Own", (Slide,), {name: 3} if how == "value" else {"__annotations__": {name: int}})) == [text]


def test_the_advice_on_values_works():
    assert StepperVectorEnv(Slide(), 2, max_episode_steps=3, options=stepper.Options(), precision="f32", threads=1, dtype=np.float32)
    gymnasium.register("test/Slide-v0", entry_point="stepper.envs:StepperEnv", kwargs={"task": Slide()}, max_episode_steps=3)
    assert gymnasium.make("test/Slide-v0").spec.max_episode_steps == 3

    class Bounded(Slide):
        frame_skip = 4

        def action_bounds(self, model):
            return np.full(1, -2.0), np.full(1, 2.0)

    assert StepperEnv(Bounded()).action_space.high == 2.0


@pytest.mark.parametrize("method", METHODS)
def test_a_value_in_place_of_a_method_is_an_error_with_the_definition(method):
    own = type("Own", (Slide,), {method: 3})()
    with pytest.raises(TypeError, match=rf"Own\.{method} is 3, must be a method: write def {re.escape(signature(method))}"):
        StepperEnv(own)


def test_a_missing_method_is_an_error_with_a_skeleton():
    class Own(Task):
        pass

    class OfMujoco(MujocoTask):
        xml_file: str = "hopper.xml"

    for kind, missing in ((Own, "frame_skip, model, observations, reward"), (OfMujoco, "frame_skip, observations, reward")):
        with pytest.raises(TypeError, match=f"^{kind.__name__} does not define {missing}. In the class of your task, write\n") as error:
            kind()
        body = str(error.value).partition("\n")[2].replace('"robot.xml"', repr(SLIDE))
        namespace = {"kind": kind, "stepper": stepper}
        exec(f"class Whole(kind):\n{body}", namespace)
        envs = StepperVectorEnv(namespace["Whole"](), 2)
        envs.reset(seed=0)
        assert envs.step(envs.action_space.sample())[1].shape == (2,)
    with pytest.raises(TypeError, match=r"^Task does not define frame_skip, model, observations, reward"):
        Task()


FIELD = {"__annotations__": {"gain": float}, "gain": 1.0}


@pytest.mark.parametrize("base", [Slide, *TASKS.values()])
def test_a_field_without_dataclass_is_no_argument_and_the_error_says_so(base):
    own = type("Own", (base,), FIELD)
    for call in (lambda: own(gain=2.0), lambda: StepperEnv(own, gain=2.0), lambda: StepperVectorEnv(own, 2, gain=2.0)):
        with pytest.raises(TypeError) as error:
            call()
        remedy = "takes no 'gain', because Own is no dataclass: write @dataclass(frozen=True, kw_only=True) above class Own"
        assert remedy in str(error.value)
    assert dataclass(frozen=True, kw_only=True)(own)(gain=2.0).gain == 2.0


@pytest.mark.parametrize("arguments", [("robot.xml",), (5,)])
def test_a_task_without_fields_takes_no_arguments(arguments):
    with pytest.raises(TypeError, match=r"Slide\(\) takes no argument without a name, but .*: write @dataclass\(.*above class Slide"):
        Slide(*arguments)
    with pytest.raises(
        TypeError,
        match=r"Slide\(\) takes no 'gain', because Slide is no dataclass: write .*class Slide, with the field gain",
    ):
        Slide(gain=1.0)


def test_arguments_of_a_dataclass_are_checked():
    with pytest.raises(TypeError, match=r"Hopper\(\) takes no 'forward_weight'; did you mean forward_reward_weight"):
        Hopper(forward_weight=1.0)
    with pytest.raises(TypeError, match=r"Hopper\(\) takes no argument without a name, but 'x\.xml' is given: give it by name"):
        Hopper("x.xml")


def changes():
    """Fields of Gymnasium's tasks: task, and name of the field."""
    return [(task, field.name) for task in TASKS.values() for field in fields(task) if field.init]


@given(st.sampled_from(changes()), st.booleans(), st.booleans())
def test_a_changed_default_that_python_ignores_is_an_error(change, typed, decorated):
    task, field = change
    value = task.__dataclass_fields__[field].default
    own = type("Own", (task,), {field: value} | ({"__annotations__": {field: type(value)}} if typed else {}))
    own = dataclass(frozen=True, kw_only=True)(own) if decorated else own
    if typed and decorated:
        assert getattr(own(), field) is value
        return
    for call in (own, lambda: StepperEnv(own)):
        with pytest.raises(
            TypeError, match=f"Own changes {field} of the dataclass {task.__name__} without effect: write @dataclass"
        ) as error:
            call()
        assert f"the field with its type, {field}: " in str(error.value)


def test_a_changed_default_takes_effect_as_the_error_says():
    with pytest.raises(TypeError) as error:
        type("Own", (Hopper,), {"reset_noise_scale": 0.5})()
    namespace = {"dataclass": dataclass, "Hopper": Hopper}
    decorator, line = re.search(r"write (@.*\)) above class Own, and the field with its type, (.*)", str(error.value)).groups()
    exec(f"{decorator}\nclass Own(Hopper):\n    {line}", namespace)
    assert namespace["Own"]().reset_noise_scale == 0.5
    assert type("Own", (Hopper,), {"frame_skip": 3, "__init__": lambda self: None})().frame_skip == 3


@pytest.mark.parametrize(("name", "hint"), [
    ("sim", "now has it, as now.sim"),
    ("qpos", "now has it, as now.qpos"),
    ("action", "now has it, as now.action"),
    ("get_reward", "use reward(self, now)"),
    ("observatoins", "did you mean observations"),
])  # fmt: skip
def test_an_absent_attribute_of_a_task_has_a_hint(name, hint):
    with pytest.raises(AttributeError, match=f"^the task Slide has no attribute '{name}'; {re.escape(hint)}"):
        getattr(Slide(), name)


@pytest.mark.parametrize("task", [Slide(), Hopper(frame_skip=2)])
def test_tasks_are_copied_and_pickled(task):
    for twin in (copy.copy(task), copy.deepcopy(task), pickle.loads(pickle.dumps(task))):
        assert vars(twin) == vars(task)
    assert str(inspect.signature(Slide)) == "()"
    assert "reset_noise_scale" in inspect.signature(Hopper).parameters
    with pytest.raises(TypeError, match=r"OfMujoco has no xml_file, the file of its model: add the field `xml_file: str"):
        StepperEnv(type("OfMujoco", (MujocoTask,), {name: vars(Slide)[name] for name in ("frame_skip", "observations", "reward")})())


@pytest.mark.parametrize("env", [StepperEnv, StepperVectorEnv])
@pytest.mark.parametrize(
    "name", [*(name for name in METHODS if name != "reset"), "_get_obs", "_get_rew", "reset_model", "reset_idx", "_get_reset_info"]
)
def test_methods_of_tasks_in_a_class_of_environments_are_warnings(env, name):
    """As subclasses of Gymnasium's MujocoEnv define them: they are never called."""
    method = RENAMED.get(name) or signature(name)
    remedy = f"define {method} in a subclass of stepper.envs.Task, and give that to {env.__name__}"
    text = f"Own defines {name}, which environments ignore: {remedy}"
    assert warnings_of(lambda: type("Own", (env,), {name: nothing})) == [text]
    assert warnings_of(lambda: type("Own", (env,), {name: property(nothing)})) == []
    assert warnings_of(lambda: type("Own", (env,), {"compute_reward": nothing})) == []


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

        def height(self):
            return self.sim.qpos[0, 1]

    assert Own().reset(seed=0)[0].shape == (3,)
    assert Own().model.nq == 6


@pytest.mark.parametrize(("members", "message"), [
    ({"carried": "level"}, r"Own\.carried is 'level', must be a tuple of names: \('level',\)"),
    ({"camera": "track"}, r"Own\.camera is 'track', must be a dict such as .*camera_name of the environment names a camera"),
    ({"observations": lambda self: [Observation("qpos", columns=[0, 9])]}, r"columns of the row 'qpos' is \[0, 9\]: index 9 is out"),
])  # fmt: skip
def test_values_of_a_wrong_kind_are_named(members, message):
    with pytest.raises((TypeError, ValueError), match=message):
        StepperEnv(type("Own", (Slide,), members)())


def test_an_absent_array_of_a_task_without_arrays_names_the_method():
    own = type("Own", (Slide,), {"reward": lambda self, now: (now.episode_state["speed"], {})})
    message = (
        r"Own.episode_state returns no 'speed'; define episode_state\(self, num_envs\), which returns \{'speed': np.zeros\(num_envs\)\}"
    )
    with pytest.raises(KeyError, match=message):
        _step(own())
    own.episode_state = lambda self, num_envs: {"speed": np.zeros(num_envs)}
    assert _step(own())[1].tolist() == [0.0, 0.0]


def _step(task):
    """Results of one step of two environments."""
    envs = StepperVectorEnv(task, 2)
    envs.reset(seed=0)
    return envs.step(np.zeros((2, 1)))


@pytest.mark.parametrize("name", PARTS)
def test_a_part_of_another_librarys_task_is_a_warning_with_its_place(name):
    """Groups, commands, curricula, startup events, pushes: environments ignore methods of these names."""
    text = f"Own defines {name}, which environments ignore: {PARTS[name]}"
    assert warnings_of(lambda: type("Own", (Slide,), {name: nothing})) == [text]
    # A number, such as an argument of the task, is the task's own.
    assert warnings_of(lambda: type("Own", (Slide,), {name: 3.0})) == []
    assert not hasattr(Task, name)


def test_names_of_other_libraries_for_the_memory_of_an_observation_are_named():
    for name, remedy in (("history_length", "history, the number of observations"), ("lag", "delay, in actions")):
        with pytest.raises(TypeError, match=rf"'{name}': use {remedy}"):
            Observation("qpos", **{name: 3})
