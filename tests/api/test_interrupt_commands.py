"""Ctrl-C ends a command at once, with one line, and leaves no unfinished file, thread or process."""

import ast
import importlib
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import stepper
from models import stepper_model
from stepper.shared.files import atomic_write
from stepper.sysid import fit

MODEL = "gymnasium/ant"
PACKAGE = Path(stepper.__file__).parent
PATIENCE = 60.0
"""Seconds after which a command that does not end fails the test: it ends within two on an idle machine."""

RUN = """
import signal
from stepper.cli import main
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where a shell starts the tests in the background
main()
"""


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> dict[str, Path]:
    """A saved model, and a recording of it that takes long to identify."""
    folder = tmp_path_factory.mktemp("interrupted")
    model = stepper_model(MODEL)
    model.save(folder / "ant.stepper")
    sim = stepper.Stepper(model)
    rng = np.random.default_rng(0)
    with sim.record(folder / "run"):
        for _ in range(300):
            sim.step(rng.uniform(-1, 1, model.nu), nstep=5)
    return {"model": folder / "ant.stepper", "recording": folder / "run"}


@pytest.mark.parametrize("command", [
    ["chart", "{model}", "--episodes", "64"],
    ["tune", "{model}", "--error", "1 mm", "--horizon", "1 s"],
    ["identify", "{model}", "{recording}", "-p", "body_mass[torso]=0.1..10", "-p", "dof_damping[hip_1]=0.1..10", "--channel", "qpos",
     "--starts", "8"],
], ids=lambda command: command[0])  # fmt: skip
def test_a_command_ends_at_once_and_leaves_nothing(files, tmp_path, command):
    arguments = [part.format(**files) for part in command]
    child = subprocess.Popen(
        [sys.executable, "-c", RUN, *arguments, "--out", str(tmp_path / "out")],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    assert child.stderr is not None
    said = [child.stderr.readline()]
    while "%" not in said[-1]:
        assert child.poll() is None, "".join(said)
        said.append(child.stderr.readline())
    os.kill(child.pid, signal.SIGINT)
    _, rest = child.communicate(timeout=PATIENCE)
    assert child.returncode == 130, rest
    assert "Traceback" not in rest
    assert list(tmp_path.rglob("*.part")) == []
    # No process of its group is left.
    with pytest.raises(ProcessLookupError):
        os.killpg(child.pid, 0)


def test_searches_side_by_side_end_when_the_call_is_interrupted(monkeypatch):
    """The main thread alone gets Ctrl-C. Without `Together.stop`, its searches would run to their ends, here for ever."""

    class EndlessLeastSquares:
        @staticmethod
        def least_squares(residual, x0, *_, **__):
            while True:
                residual(x0)
                x0 = x0 + 1e-9

    class Interrupted(fit.ThreadPoolExecutor):
        def map(self, *given):
            super().map(*given)
            raise KeyboardInterrupt

    monkeypatch.setattr(fit, "ThreadPoolExecutor", Interrupted)
    model = stepper.load(
        "<mujoco><worldbody><body name='b'><joint name='j' type='slide' damping='1'/><geom size='.1'/></body></worldbody></mujoco>"
    )
    episode = stepper.sysid.Episode(np.zeros((20, 0)), {"qpos": np.linspace(0, 0.1, 20)[:, None]}, 0.02)
    monkeypatch.setattr(fit, "require", lambda name, _: EndlessLeastSquares if name == "scipy.optimize" else importlib.import_module(name))
    with pytest.raises(KeyboardInterrupt):
        stepper.sysid.identify(model, [episode], ["dof_damping[j]"], starts=2, threads=1)


def test_a_file_that_was_begun_leaves_what_was_there(tmp_path):
    file = tmp_path / "kept.json"
    file.write_text("before")
    with pytest.raises(KeyboardInterrupt), atomic_write(file) as stream:
        stream.write(b"half of")
        raise KeyboardInterrupt
    assert file.read_text() == "before"
    assert list(tmp_path.iterdir()) == [file]
    with atomic_write(file) as stream:
        stream.write(b"after")
    assert file.read_text() == "after"


def _flags(node: ast.expr) -> bool:
    """Whether an expression is a flag of `Status` or a union of several."""
    if isinstance(node, ast.BinOp):
        return _flags(node.left) and _flags(node.right)
    return isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "Status"


@pytest.mark.parametrize("file", sorted(PACKAGE.rglob("*.py")), ids=lambda file: str(file.relative_to(PACKAGE)))
def test_arrays_meet_flags_as_plain_integers(file):
    """NumPy asks the class of a flag for attributes, which before Python 3.12 runs code of `enum`, and NumPy drops a Ctrl-C from there."""
    for node in ast.walk(ast.parse(file.read_text())):
        operands = (
            [node.left, node.right] if isinstance(node, ast.BinOp) else [node.target, node.value] if isinstance(node, ast.AugAssign) else []
        )
        mixed = bool(operands) and isinstance(node.op, ast.BitAnd | ast.BitOr) and sum(map(_flags, operands)) == 1
        assert not mixed, f"line {node.lineno}: {ast.unparse(node)}"
