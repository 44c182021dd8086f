"""Tables of docs/coming_from/: all code in their last column runs, or names what there is."""

import importlib.util
import inspect
import re
from pathlib import Path

import gymnasium
import mujoco
import numpy as np
import pytest
import stepper
import stepper.envs
import typer
from stepper.cli.app import application
from stepper.derivatives import Linearization
from stepper.envs import Observation, StepperVectorEnv, Task

PAGES = Path(__file__).parents[1] / "docs/coming_from"
SCENE = """<mujoco><option timestep=".002"/><worldbody><geom name="floor" type="plane" size="5 5 .1"/><body name="hand" pos="0 0 .3">
  <freejoint/><geom name="palm" size=".1" mass="1"/><site name="tip" pos=".1 0 0"/><body name="finger" pos=".1 0 0">
  <joint name="j" axis="0 1 0" damping=".1"/>
  <geom name="f" type="capsule" fromto="0 0 0 .2 0 0" size=".02" mass=".2"/></body></body></worldbody>
  <actuator><motor name="m" joint="j" gear="2" ctrlrange="-1 1"/></actuator>
  <sensor><framepos objtype="site" objname="tip"/><jointpos joint="j"/></sensor>
  <keyframe><key name="home" qpos="0 0 .5 1 0 0 0 .3" qvel="0 0 0 0 0 .1 .2" ctrl=".4" time="2"/></keyframe></mujoco>"""
PLACES = (
    *(stepper, stepper.envs, stepper.envs.quantities, stepper.envs.events, stepper.envs.commands, stepper.sensors, gymnasium, mujoco),
    *(stepper.Stepper, stepper.Model, stepper.Status, Linearization, stepper.envs.TASKS["Hopper"]),
)
"""Modules and classes whose names the tables use."""
COMMANDS = typer.main.get_command(application()).commands


def codes():
    """Pieces of code in the last cells of all rows: page and code."""
    for page in sorted(PAGES.glob("*.md")):
        for row in re.findall(r"^\| (.*) \|$", page.read_text(), re.MULTILINE):
            yield from ((page.stem, code) for code in re.findall("`([^`]*)`", row.rpartition(" | ")[2]))


class Names(dict):
    """Values for the names in the tables; other names are those of `PLACES`."""

    def __missing__(self, name):
        for place in PLACES:
            if hasattr(place, name):
                return getattr(place, name)
        raise KeyError(name)


@pytest.fixture
def names(tmp_path):
    (tmp_path / "scene.xml").write_text(SCENE)
    sim, env, envs = stepper.Stepper(stepper.load(SCENE), 2), gymnasium.make("stepper/Ant-v5"), StepperVectorEnv("Ant", 3)
    env.reset(seed=0)
    return Names(
        path=tmp_path / "scene.xml", ctrl=np.zeros((2, 1)), q=np.array([0, 0, 1.0, 1, 0, 0, 0, 0]), qacc=np.zeros((2, 7)),
        points=np.zeros((1, 3)), directions=np.ones((1, 3)), values=np.ones(2), state=sim.get_state(), stepper=stepper, gymnasium=gymnasium,
        sim=sim, model=sim.model, env=env, envs=envs, now=envs.now, name="torso", rows=(Observation("qpos"),), weight=1.0,
        function=lambda now: now.qpos[:, 0],
    )  # fmt: skip


@pytest.mark.parametrize(("page", "code"), codes())
@pytest.mark.filterwarnings("ignore::stepper.ModelWarning")
def test_code_runs(page, code, names):
    if code in ("-v5", "dm_control", "touch", "contact"):  # Endings of names, and sensors of MJCF.
        return
    if code.startswith("stepper.adapters."):
        assert importlib.util.find_spec(code)
        return
    if code.startswith("stepper "):
        assert code.split()[1] in COMMANDS
        return
    if re.fullmatch(r"\w+\((now)?\)", code) and hasattr(Task, code.partition("(")[0]):
        return
    if keyword := re.fullmatch(r"(\w+)=?(\"\w+\")?", code):
        known = [stepper.Stepper, stepper.Stepper.reset, StepperVectorEnv, gymnasium.make]
        if any(keyword[1] in inspect.signature(call).parameters for call in known):
            return
    if "rollout" in code:
        names["ctrl"] = np.zeros((3, 2, 1))
    code = code.partition(" = ")[2] or code
    code = code.replace("make_vec(...", 'make_vec("stepper/Ant-v5", num_envs=2').replace("clip=...", "clip=(-1, 1)")
    eval(code.replace("(...)", ""), {}, names)


def test_resets_are_mujocos():
    """The calls in the row of `mj_resetData` and `mj_resetDataKeyframe` set what these set."""
    m = mujoco.MjModel.from_xml_string(SCENE)
    d, sim = mujoco.MjData(m), stepper.Stepper(stepper.load(m))
    mujoco.mj_resetDataKeyframe(m, d, 0)
    for keyframe, call in (("home", lambda: None), (None, lambda: mujoco.mj_resetData(m, d))):
        call()
        sim.step(nstep=3)
        sim.reset(keyframe=keyframe) if keyframe else sim.reset()
        for name in ("qpos", "qvel", "ctrl", "time"):
            np.testing.assert_array_equal(getattr(sim, name), getattr(d, name))
