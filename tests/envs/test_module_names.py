"""Names that `stepper.envs` and its submodules do not have: each error names what to use, and that works."""

import importlib
import re

import gymnasium
import pytest
import stepper.envs
from cases import Slide
from hypothesis import given
from hypothesis import strategies as st
from stepper._other_names import NEW_KEYWORDS_OF, NEW_NAMES
from stepper.envs import TASKS, StepperEnv
from stepper.envs.terrain import Flat, PyramidSlope, PyramidStairs, RandomRough, Terrain, TerrainCurriculum

MODULES = ("stepper.envs", "stepper.envs.terrain", "stepper.envs.tasks", "stepper.envs.suite")


def of(expression, module):
    """Value of an expression with names of `stepper`, of Gymnasium and of a module."""
    return eval(expression, {"stepper": stepper, "gymnasium": gymnasium, "MyTask": Slide, **vars(importlib.import_module(module))})


@pytest.mark.parametrize(("module", "name"), [(module, name) for module in MODULES for name in NEW_NAMES.get(module, {})])
def test_a_name_of_another_library_has_a_hint_that_works(module, name):
    hint = NEW_NAMES[module][name]
    with pytest.raises(AttributeError, match=f"^module '{module}' has no attribute '{name}'; (use|did you mean) ") as error:
        getattr(importlib.import_module(module), name)
    assert hint in str(error.value)
    with pytest.raises(ImportError, match=f"^cannot import name '{name}' from '{module}'; "):
        exec(f"from {module} import {name}")
    code = re.match(r'[\w.]+(\((("[^"]*"|[^()])*)\))?', hint).group()
    if "stepper.adapters" not in code and "dm_control" not in code and hint[:2] != "a " and "..." not in code:
        gymnasium.registry.pop("me/Task-v0", None)
        of(code, module)


def test_every_environment_of_gymnasium_has_its_name():
    for task in TASKS:
        assert gymnasium.make(f"stepper/{task}-v5").unwrapped.task == TASKS[task]()
        with pytest.raises(AttributeError, match=f'did you mean gymnasium.make\\("stepper/{task}-v5"\\)'):
            getattr(stepper.envs, f"{task}Env")


@given(st.sampled_from(MODULES), st.text("xyz", min_size=6, max_size=9))
def test_an_unknown_name_is_answered_with_all_names(module, name):
    there = importlib.import_module(module)
    with pytest.raises(AttributeError, match=f"^module '{module}' has no attribute '{name}'; there are: ") as error:
        getattr(there, name)
    assert set(there.__all__) == set(str(error.value).partition("there are: ")[2].split(", "))


@pytest.mark.parametrize("given", ["rough", [], {"rough": 1}])
def test_arguments_of_a_terrain_have_names(given):
    with pytest.raises(TypeError, match=r"Terrain\(\) takes no arguments without a keyword, not .*\(\*, sub_terrains, "):
        Terrain(given)


@pytest.mark.parametrize("name", NEW_KEYWORDS_OF["stepper.envs.terrain.Terrain"])
def test_keywords_of_other_libraries_are_errors_with_the_keyword(name):
    hint = NEW_KEYWORDS_OF["stepper.envs.terrain.Terrain"][name]
    with pytest.raises(TypeError, match=re.escape(f"stepper.envs.terrain.Terrain() takes no '{name}': use {hint}")):
        Terrain(**{name: 1})
    keyword = re.match(r"\w+", hint).group()
    values = {"sub_terrains": {"flat": Flat()}, "num_rows": 3, "size": 4.0, "horizontal_scale": 0.2, "border_width": 1.0}
    values["difficulty_range"] = (0.0, 0.5)
    assert Terrain(**{"sub_terrains": {"flat": Flat()}, keyword: values[keyword]})


def test_terrains_of_the_hints_are_made():
    kinds = {"rough": RandomRough(), "stairs": PyramidStairs(inverted=True), "slope": PyramidSlope(inverted=True)}
    assert TerrainCurriculum(terrain=Terrain(sub_terrains=kinds, num_rows=2))
    assert StepperEnv(Slide())
    with pytest.raises(TypeError, match=r"TerrainCurriculum\(\) takes no arguments without a keyword, not .*\(\*, terrain, "):
        TerrainCurriculum(Terrain(sub_terrains=kinds))
    with pytest.raises(TypeError, match=r"PyramidStairs\(\) takes no 'step_height'; did you mean step_height_range"):
        PyramidStairs(step_height=0.1)
