"""`stepper train` without PyTorch: what it prints first, and the remedy; and the check of a film before a training."""

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from stepper.policies import check_film

ROOT = Path(__file__).parents[2]
WITHOUT_TORCH = "import sys; sys.modules['torch'] = None; "
COMMAND = "from stepper.cli import main; sys.argv = ['stepper', 'train', 'stepper/Hopper-v5', '--seed', '3']; main()"
EXAMPLE = f"import runpy; runpy.run_path({str(ROOT / 'examples/train.py')!r}, run_name='__main__')"
LEARNER = f"import runpy; runpy.run_path({str(ROOT / 'python/stepper/policies/ppo.py')!r}, run_name='__main__')"


@pytest.mark.skipif(find_spec("typer") is None, reason="typer, which the command line needs, is not installed")
def test_the_command_says_what_it_does_before_it_imports_pytorch():
    ended = subprocess.run([sys.executable, "-c", WITHOUT_TORCH + COMMAND], capture_output=True, text=True, check=False)
    assert ended.stdout == "stepper train: importing PyTorch\n"
    assert ended.stderr == 'stepper: torch is needed to train, and is not installed: pip install "stepper-sim[train]"\n'
    assert ended.returncode == 1


@pytest.mark.skipif(find_spec("typer") is None, reason="typer, which the command line needs, is not installed")
@pytest.mark.parametrize(("option", "code", "said"), [("--help", 0, "--minibatch"), ("--minibach", 2, "--minibach")])
def test_help_and_wrong_options_need_no_pytorch(option, code, said):
    ended = subprocess.run(
        [sys.executable, "-c", WITHOUT_TORCH + COMMAND.replace("--seed", option)], capture_output=True, text=True, check=False
    )
    assert ended.returncode == code
    assert said in ended.stdout + ended.stderr
    assert "usage: stepper train" in ended.stdout + ended.stderr
    assert "PyTorch" not in ended.stdout


@pytest.mark.skipif(find_spec("typer") is None, reason="typer, which the command line needs, is not installed")
def test_copy_needs_no_pytorch(tmp_path):
    copy = tmp_path / "mine.py"
    code = WITHOUT_TORCH + COMMAND.replace("'--seed', '3'", f"'--copy', {str(copy)!r}")
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (0, "")
    assert copy.read_text() == (ROOT / "python/stepper/policies/ppo.py").read_text()


@pytest.mark.parametrize("script", [EXAMPLE, LEARNER])
def test_scripts_do_too(script):
    """The example, and a copy of the learner."""
    ended = subprocess.run([sys.executable, "-c", WITHOUT_TORCH + script], capture_output=True, text=True, check=False)
    assert "importing PyTorch" in ended.stdout
    assert 'MissingPackageError: torch is needed to train, and is not installed: pip install "stepper-sim[train]"' in ended.stderr


class Dark(gymnasium.Env):
    """An environment without pictures, as on a machine without OpenGL."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012
    observation_space, action_space = gymnasium.spaces.Box(0.0, 1.0, (1,)), gymnasium.spaces.Box(-1.0, 1.0, (1,))

    def __init__(self, render_mode=None):
        self.render_mode = render_mode

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return np.zeros(1, np.float32), {}

    def render(self):
        raise RuntimeError("MuJoCo's renderer cannot draw here")


@pytest.mark.skipif(find_spec("moviepy") is None, reason="moviepy, which writes films, is not installed")
def test_a_film_that_cannot_be_drawn_is_refused_before_the_training():
    if "test/Dark-v0" not in gymnasium.registry:
        gymnasium.register("test/Dark-v0", entry_point=Dark)
    with pytest.raises(RuntimeError, match="cannot draw here"):
        check_film("test/Dark-v0")
