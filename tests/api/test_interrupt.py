"""Ctrl-C ends a long call between two steps: the same number of them in every environment, and the state that so many steps leave."""

import ast
import contextlib
import importlib
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
import stepper
from models import simulate, stepper_model
from stepper.shared.files import atomic_write
from stepper.sysid import fit

ROBOT = "gymnasium/ant"
ENVS = 20
FOREVER = 10**9
SOON = 0.2  # seconds, in which more than one part of a long call is made
MOCAP = """<mujoco><worldbody><body name="hand" mocap="true" pos="0 0 1"><geom size=".1" contype="0" conaffinity="0"/></body>
  <body name="ball" pos="0 0 1"><freejoint/><geom size=".05" contype="0" conaffinity="0"/></body></worldbody>
  <equality><connect body1="hand" body2="ball" anchor="0 0 0"/></equality>
  <sensor><framepos objtype="body" objname="hand"/></sensor></mujoco>"""
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


@contextlib.contextmanager
def interrupted(number=signal.SIGINT):
    """Sends a signal to this process after a while; what it raises is the block's."""
    before = signal.getsignal(number)
    if before is signal.SIG_IGN:
        # A shell that starts the tests in the background has them ignore Ctrl-C.
        signal.signal(number, signal.default_int_handler)
    timer = threading.Timer(SOON, os.kill, (os.getpid(), number))
    timer.start()
    try:
        yield
    finally:
        timer.join()
        signal.signal(number, before)


def new(num_envs=ENVS, **settings):
    sim = stepper.Stepper(stepper_model(ROBOT), num_envs, **settings)
    spread = np.random.default_rng(5).uniform(-0.1, 0.1, np.shape(sim.qvel))
    sim.set_state(qvel=spread)
    return sim


def control(shape):
    return np.random.default_rng(3).uniform(-1, 1, (*shape, stepper_model(ROBOT).nu))


def assert_same(one, other):
    for name in ("qpos", "qvel", "act", "ctrl", "time", "status", "residual", "iterations", "sensordata"):
        assert np.asarray(getattr(one, name)).tobytes() == np.asarray(getattr(other, name)).tobytes(), name
    # All that survives a step, warm starts too.
    one.step()
    other.step()
    assert np.asarray(one.qvel).tobytes() == np.asarray(other.qvel).tobytes()


@pytest.mark.parametrize(("num_envs", "threads", "precision"), [(None, 1, "f64"), (ENVS, 1, "f64"), (ENVS, 2, "f64"), (40, 2, "f32")])
def test_a_step_leaves_what_so_many_steps_leave(num_envs, threads, precision):
    settings = {"num_envs": num_envs, "threads": threads, "precision": precision}
    ctrl = control(() if num_envs is None else (num_envs,))
    sim, again = new(**settings), new(**settings)
    with pytest.raises(KeyboardInterrupt, match="step was interrupted after") as caught, interrupted():
        sim.step(ctrl, nstep=FOREVER)
    steps = caught.value.steps
    assert 0 < steps < FOREVER
    assert f"{steps} of {FOREVER} steps" in str(caught.value)
    assert len(set(np.atleast_1d(sim.time))) == 1
    again.step(ctrl, nstep=steps)
    assert_same(sim, again)


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize(("controls", "nstep"), [(50_000, 1), (3, FOREVER), (20_000, 7)])
def test_a_rollout_has_written_what_it_made(threads, controls, nstep):
    ctrl = np.resize(control((97, ENVS)), (controls, ENVS, stepper_model(ROBOT).nu))
    sim, again = new(threads=threads), new(threads=threads)
    out = {"qvel": np.full((controls, ENVS, sim.model.nv), np.nan), "status": np.zeros((controls, ENVS), np.uint32)}
    out["residual"] = np.full((controls, ENVS), -1.0)
    with pytest.raises(KeyboardInterrupt, match="rollout was interrupted after") as caught, interrupted():
        sim.rollout(ctrl, nstep, out=out)
    whole, rest = divmod(caught.value.steps, nstep)
    assert whole + rest > 0
    assert f"{whole} of {controls} controls are complete" in str(caught.value)
    assert len(set(sim.time)) == 1
    expected = again.rollout(ctrl[:whole], nstep, fields=["qvel"])
    status = again.status if whole else np.zeros(ENVS, np.uint32)
    if rest:
        part = again.rollout(ctrl[whole : whole + 1], rest, fields=["qvel"])
        expected = {name: np.concatenate([expected[name], part[name]]) for name in expected}
        status = status | again.status
    rows = whole + (rest > 0)
    for name, values in expected.items():
        assert out[name][:rows].tobytes() == values.tobytes(), name
    assert np.isnan(out["qvel"][rows:]).all()
    assert sim.status.tolist() == status.tolist()
    assert sim.ctrl.tobytes() == ctrl[rows - 1].tobytes()
    assert sim.qpos.tobytes() == again.qpos.tobytes()


def test_parts_of_a_long_call_make_the_bits_of_single_steps():
    """With sensors that err and remember. So many steps of so many environments are some parts of 50 ms."""
    model, envs, steps = stepper_model("dm_control/quadruped"), 64, 800
    errors = stepper.SensorModel(default=stepper.Transfer(noise_std=0.1, delay=0.005, drift_std=0.1))
    one, other = (stepper.Stepper(model, envs, threads=threads, sensors=errors) for threads in (1, 2))
    ctrl = np.random.default_rng(3).uniform(-1, 1, (envs, model.nu))
    one.step(ctrl, nstep=steps)
    status = np.zeros(envs, np.uint32)
    for _ in range(steps):
        other.step(ctrl)
        status |= other.status
    assert one.status.tolist() == status.tolist()
    assert one.sensordata.tobytes() == other.sensordata.tobytes()
    assert one.qvel.tobytes() == other.qvel.tobytes()


def test_mocap_bodies_are_where_the_longer_way_has_brought_them():
    sim = simulate(MOCAP, timestep=1e-3, steps=2)
    sim.mocap_pos[0] = [1e3, 0, 1]
    with pytest.raises(KeyboardInterrupt) as caught, interrupted():
        sim.step(nstep=10**7)
    x = 1e3 * caught.value.steps / 10**7
    # Rounding of the time, a sum of up to 1e6 steps.
    assert sim.sensordata[0] == pytest.approx(x, rel=1e-9)
    # What hangs on the hand follows it at 0.1 m/s, a fifth of what is left a step.
    assert sim.qpos[0] == pytest.approx(x, abs=5e-4 * 1.1)
    # From there on to where it is put next, and not from where it would have gone.
    sim.mocap_pos[0] = [x, 0, 1]
    sim.step(nstep=100)
    assert sim.qpos[0] == pytest.approx(x, abs=1e-5 * 2)  # the slop


def test_mocap_bodies_at_rest_change_no_bit():
    sim, again = (stepper.Stepper(stepper.load(MOCAP)) for _ in range(2))
    for s in (sim, again):
        s.mocap_pos[0] = [0.1, 0, 1]
        s.step()
    with pytest.raises(KeyboardInterrupt) as caught, interrupted():
        sim.step(nstep=FOREVER)
    again.step(nstep=caught.value.steps)
    assert sim.qpos.tobytes() == again.qpos.tobytes()


def test_a_recording_has_the_steps_that_were_made(tmp_path):
    sim = new()
    with sim.record(tmp_path / "run"):
        sim.step()
        timestep = sim.time[0]
        sim.step(nstep=4)
        with pytest.raises(KeyboardInterrupt) as caught, interrupted():
            sim.step(nstep=FOREVER)
        sim.step(nstep=3)
    assert round(sim.time[0] / timestep) == caught.value.steps + 8
    assert stepper.recording.verify(tmp_path / "run")


def test_what_a_handler_raises_says_how_many_steps_too():
    class StopError(Exception):
        pass

    def handle(number, frame):
        raise StopError("enough")

    before = signal.signal(signal.SIGUSR1, handle)
    try:
        with pytest.raises(StopError, match="enough") as caught, interrupted(signal.SIGUSR1):
            new().step(nstep=FOREVER)
    finally:
        signal.signal(signal.SIGUSR1, before)
    assert caught.value.steps > 0
    assert f"after {caught.value.steps} of" in caught.value.__notes__[0]


def test_a_handler_that_raises_nothing_stops_nothing():
    seen = []
    before = signal.signal(signal.SIGUSR1, lambda number, frame: seen.append(number))
    try:
        with interrupted(), pytest.raises(KeyboardInterrupt):
            threading.Timer(SOON / 2, os.kill, (os.getpid(), signal.SIGUSR1)).start()
            new().step(nstep=FOREVER)
    finally:
        signal.signal(signal.SIGUSR1, before)
    assert seen == [signal.SIGUSR1]


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
