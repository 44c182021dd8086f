"""Names that `stepper.envs` and its submodules do not have: each error names what to use, and that works."""

import importlib
import re

import gymnasium
import pytest
import stepper.envs
from cases import Slide
from hypothesis import given
from hypothesis import strategies as st
from stepper._hints import replacements
from stepper.envs import StepperEnv
from stepper.envs.terrain import Flat, PyramidSlope, PyramidStairs, RandomRough, Terrain, TerrainCurriculum

MODULES = ("stepper.envs", "stepper.envs.terrain", "stepper.envs.tasks", "stepper.envs.suite")


def of(expression, module):
    """Value of an expression with names of `stepper`, of Gymnasium and of a module."""
    return eval(expression, {"stepper": stepper, "gymnasium": gymnasium, "MyTask": Slide, **vars(importlib.import_module(module))})


@given(st.sampled_from(MODULES), st.text("xyz", min_size=6, max_size=9))
def test_an_unknown_name_is_answered_with_all_names(module, name):
    there = importlib.import_module(module)
    with pytest.raises(AttributeError, match=f"^module '{module}' has no attribute '{name}'; there are: ") as error:
        getattr(there, name)
    assert set(there.__all__) == set(str(error.value).partition("there are: ")[2].split(", "))


@pytest.mark.parametrize("name", replacements("stepper.envs.terrain.Terrain()"))
def test_keywords_of_other_libraries_are_errors_with_the_keyword(name):
    hint = replacements("stepper.envs.terrain.Terrain()")[name]
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
    with pytest.raises(TypeError, match=r"PyramidStairs\(\) takes no 'step_height'; did you mean step_height_range"):
        PyramidStairs(step_height=0.1)
