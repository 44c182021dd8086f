"""Folders of training runs: one run at a time, a checkpoint from the first update on, and damaged ones by name. PyTorch is a stand-in."""

import importlib
import pickle
import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
import stepper
from stepper.policies.ppo_settings import CHECKPOINT, Settings, kept_at_interrupt
from stepper.shared.files import locked

STEPS = 10
"""Environment steps of an update of the stand-in's runs."""
SETTINGS = {"env": "stepper/Reacher-v5", "num_envs": 64, "horizon": 64, "minibatch": 64}


def stand_in():
    """A module with the names of PyTorch that `stepper.policies.ppo` uses while it is imported, and its functions for files."""
    torch = ModuleType("torch")
    torch.Tensor = object
    torch.nn = SimpleNamespace(Module=object, Linear=object)
    torch.no_grad = lambda: lambda function: function
    torch.set_num_threads = lambda count: None
    torch.load = lambda file, weights_only: pickle.loads(np.load(file)["data"].tobytes())
    torch.save = lambda state, stream: np.savez(stream, data=np.frombuffer(pickle.dumps(state), np.uint8))
    return torch


@pytest.fixture
def ppo(monkeypatch):
    """The learner, imported with the stand-in."""
    monkeypatch.setitem(sys.modules, "torch", stand_in())
    monkeypatch.delitem(sys.modules, "stepper.policies.ppo", raising=False)
    learner = importlib.import_module("stepper.policies.ppo")
    monkeypatch.setattr(learner, "Run", run_of(learner))
    yield learner
    sys.modules.pop("stepper.policies.ppo", None)
    vars(stepper.policies).pop("ppo", None)


def run_of(learner):
    """Class of runs that count, in place of those that learn."""

    class Run(learner.Run):
        def __init__(self, settings):
            self.settings = settings
            self.steps, self.iteration, self.seconds, self.processor, self.episodes, self.recent = 0, 0, 0.0, 0.0, 0, []
            self.terms = {}

        def collect(self):
            if self.steps == getattr(learner, "interrupted_at", -1):
                raise KeyboardInterrupt
            self.steps += STEPS
            return {}

        def update(self, samples):
            return {"kl": 0.0}

        def policy(self):
            return SimpleNamespace(save=lambda file: file.write_bytes(b"policy"))

        def save(self, file):
            state = {"settings": vars(self.settings), "steps": self.steps, "iteration": self.iteration}
            with file.open("wb") as stream:
                sys.modules["torch"].save(state, stream)

        @classmethod
        def load(cls, file):
            state = learner.read_checkpoint(file)
            run = cls(Settings(**state["settings"]))
            run.steps, run.iteration = state["steps"], state["iteration"]
            return run

    return Run


def test_the_first_checkpoint_is_written_after_the_first_update(ppo, tmp_path, capsys):
    ppo.interrupted_at = STEPS
    with pytest.raises(KeyboardInterrupt):
        ppo.train(Settings(steps=5 * STEPS, **SETTINGS), tmp_path / "run", quiet=True)
    assert f"stopped: the run up to its last checkpoint is in {tmp_path / 'run'}; the same command continues it" in capsys.readouterr().err
    assert {file.name for file in (tmp_path / "run").glob("[!.]*")} == {CHECKPOINT, "curve.csv", "policy.npz"}
    ppo.interrupted_at = -1
    assert ppo.train(Settings(steps=5 * STEPS, **SETTINGS), tmp_path / "run", quiet=True).steps == 5 * STEPS
    assert len((tmp_path / "run/curve.csv").read_text().splitlines()) == 1 + 5


def test_an_interrupt_before_the_first_update_says_that_nothing_is_kept(ppo, tmp_path, capsys):
    ppo.interrupted_at = 0
    with pytest.raises(KeyboardInterrupt):
        ppo.train(Settings(steps=5 * STEPS, **SETTINGS), tmp_path / "run", quiet=True)
    assert f"stopped: the first update was not finished, so nothing is kept in {tmp_path / 'run'}" in capsys.readouterr().err


def test_two_runs_do_not_share_a_folder(ppo, tmp_path):
    with locked(tmp_path / "run"), pytest.raises(BlockingIOError, match="run: another run writes to this folder; wait for it"):
        ppo.train(Settings(steps=STEPS, **SETTINGS), tmp_path / "run", quiet=True)
    assert not (tmp_path / "run/curve.csv").exists()
    ppo.train(Settings(steps=STEPS, **SETTINGS), tmp_path / "run", quiet=True)


def test_a_damaged_checkpoint_is_named_with_a_remedy(ppo, tmp_path):
    ppo.train(Settings(steps=STEPS, **SETTINGS), tmp_path, quiet=True)
    whole = (tmp_path / CHECKPOINT).read_bytes()
    damaged = [b"", whole[: len(whole) // 2], whole[:-1], whole[:300] + bytes([whole[300] ^ 1]) + whole[301:], b"words\n"]
    np.savez(tmp_path / "other.npz", data=np.frombuffer(pickle.dumps([1]), np.uint8))
    np.savez(tmp_path / "another.npz", x=np.zeros(3))
    damaged += [(tmp_path / f"{name}.npz").read_bytes() for name in ("other", "another")]
    for content in damaged:
        (tmp_path / CHECKPOINT).write_bytes(content)
        with pytest.raises(ValueError, match=r"checkpoint\.pt: .*; restore the checkpoint, or delete it to begin the run again"):
            ppo.train(Settings(steps=5 * STEPS, **SETTINGS), tmp_path, quiet=True)


def test_a_message_after_ctrl_c_needs_no_torch(tmp_path, capsys):
    with pytest.raises(KeyboardInterrupt), kept_at_interrupt(tmp_path / CHECKPOINT):
        raise KeyboardInterrupt
    assert "nothing is kept" in capsys.readouterr().err
