"""Pages about tasks: the numbers, tables and examples of the tutorial, the reference and the port from mjlab are those of the code."""

import re
import sys
from importlib.util import find_spec
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import stepper.envs
from envs.go1_flat import LEGS, Go1Flat
from page_blocks import blocks
from stepper.envs import StepperVectorEnv
from stepper.envs.quantities import gravity, site_linvel
from stepper.policies import is_native, make
from task_page import PAGE, page

DOCS = Path(__file__).parents[2] / "docs"
FILE, MEASURED_ENVS = (block.text for block in blocks((DOCS / "tutorials/first_task.md").read_text()) if block.language == "python")
SERVOS, *_ = (block.text for block in blocks((DOCS / "how-to/write_a_task.md").read_text()) if block.language == "python")


@pytest.fixture
def written(tmp_path, monkeypatch):
    (tmp_path / "push_task.py").write_text(FILE)
    monkeypatch.chdir(tmp_path)
    yield
    sys.modules.pop("push_task", None)
    gymnasium.registry.pop("me/Push-v0", None)


@pytest.mark.usefixtures("written")
def test_its_numbers_are_what_the_page_says(monkeypatch, capsys):
    monkeypatch.syspath_prepend("")
    exec(compile(MEASURED_ENVS, "docs/tutorials/first_task.md", "exec"), {"__name__": "__main__"})
    said = capsys.readouterr().out.splitlines()
    assert said[0] == MEASURED_ENVS.split("print(envs.observation_structure)  # ")[1].splitlines()[0]
    assert 0.1 < float(said[1]) < 0.3
    assert said[2] == "Status.OK"
    assert float(said[3]) < 1e-4


@pytest.mark.filterwarnings("error::stepper.ModelWarning")
def test_actions_of_servos_are_scaled(capsys):
    names = {}
    exec(compile(SERVOS, "docs/how-to/write_a_task.md", "exec"), names)
    space, controls = capsys.readouterr().out.splitlines()
    assert space == SERVOS.split("print(envs.single_action_space)  # ")[1].splitlines()[0]
    envs, home = names["envs"], np.array([-0.5, 1.0])
    # NumPy prints eight decimals, of the number or of its mantissa.
    np.testing.assert_allclose(np.fromstring(controls.strip("[]"), sep=" "), envs.sim.ctrl[0], rtol=5e-9, atol=5e-9)
    # The action is drawn in float32, the control computed in float64.
    np.testing.assert_array_equal(envs.sim.ctrl, home + 0.5 * envs.now.action)
    first, _ = envs.reset()
    assert not first[:, -2:].any()
    for _ in range(200):
        *_, info = envs.step(np.zeros((4, 2)))
    # Servos of 50 N m/rad hold up to 4 N m of weight: 0.08 rad, of two joints, squared and with some room.
    assert (info["miss"] < 0.02).all()


@pytest.mark.usefixtures("written")
def test_its_module_is_imported_by_name():
    envs = make("push_task:me/Push-v0", 3, farthest=0.1)
    assert envs.unwrapped.task.farthest == 0.1
    assert envs.reset(seed=0)[0].shape == (3, 10)
    assert is_native("push_task:me/Push-v0")
    assert not is_native("HalfCheetah-v5")
    with pytest.raises(ValueError, match=r"there is no module 'no_such_task'.*run in the folder of no_such_task\.py"):
        make("no_such_task:me/Push-v0")


def test_it_is_short():
    """Without its scene and what registers it, some forty lines."""
    task = FILE.split("class Push")[1].split("gymnasium.register")[0]
    assert len([line for line in task.splitlines() if line.strip()]) < 45


def test_the_table_of_environments_has_every_task():
    text = (DOCS / "reference/environments.md").read_text()
    sizes = {name: int(size) for name, size in re.findall(r"`stepper/(\w+)-v5` \| (\d+) \|", text)}
    assert sizes.keys() == stepper.envs.TASKS.keys()
    for name, size in sizes.items():
        assert stepper.envs.StepperEnv(name).observation_space.shape == (size,)


@pytest.mark.skipif(
    any(find_spec(name) is None for name in ("dm_control", "mjlab", "myo_sim")),
    reason="models of dm_control, mjlab and myo_sim are not installed",
)
def test_the_page_of_tasks_is_up_to_date():
    assert PAGE.read_text() == page(), (
        "the observations or actions of a task changed: PYTHONPATH=python:tests/helpers .venv/bin/python tests/helpers/task_page.py"
    )


def test_a_terrain_is_built_in_twenty_lines():
    first = next(block.text for block in blocks((DOCS / "how-to/terrain.md").read_text()) if block.language == "python")
    assert len(first.split("ground = ")[1].splitlines()) <= 20


# A port of mjlab's Go1 velocity task: at most 100 lines, groups with errors, and a robot that stands with the action zero.

needs_mjlab = pytest.mark.skipif(find_spec("mjlab") is None, reason="mjlab is not installed, whose robot the task reads")


def test_the_task_and_its_robot_have_at_most_100_lines():
    assert len(Path(__file__).with_name("go1_flat.py").read_text().splitlines()) <= 100


@needs_mjlab
def test_the_robot_stands_and_its_terms_are_in_the_info():
    """The trunk stays within 10 degrees of level for 0.4 s, before the first push, because the servos hold the stance."""
    envs = StepperVectorEnv(Go1Flat(), 8, groups=True)
    observation, _ = envs.reset(seed=0)
    assert {name: value.shape for name, value in observation.items()} == {"policy": (8, 48), "critic": (8, 60)}
    for _ in range(20):
        observation, _, terminated, _, info = envs.step(np.zeros((8, 12)))
    assert not terminated.any()
    assert (gravity(envs.now)[:, 2] < -np.cos(np.radians(10.0))).all()
    assert {f"return_{name}" for name in envs.task.rewards()} <= info.keys()
    assert (info["reward_upright"] > 0.9 * envs.dt).all()
    np.testing.assert_array_equal(observation["critic"][:, :3] != observation["policy"][:, :3], True)


@needs_mjlab
def test_velocities_of_sites_are_those_of_their_positions():
    """They equal differences of positions over 1e-5 s within 0.01 m/s, because accelerations of the feet are below 1000 m/s^2."""
    envs = StepperVectorEnv(Go1Flat(), 4)
    envs.reset(seed=0)
    envs.step(np.ones((4, 12)))
    sim = envs.sim
    velocity, before, qpos = site_linvel(envs.now, LEGS), envs.now.read("site_xpos", LEGS), np.array(sim.qpos)
    sim.set_state(qpos=np.stack([sim.model.integrate_pos(q, 1e-5 * v) for q, v in zip(qpos, sim.qvel, strict=True)]))
    np.testing.assert_allclose((envs.now.read("site_xpos", LEGS) - before) / 1e-5, velocity, atol=0.01)
