"""Tasks of docs/tutorials/first_task.md and docs/how-to/write_a_task.md: their numbers are those of the pages, and learners find them."""

import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from page_blocks import blocks
from stepper.policies import is_native, make

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
