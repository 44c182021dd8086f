"""Recordings: replayed bit for bit across threads and precisions, refused for another model, and read for what failed."""

import json

import numpy as np
import pytest
import stepper
from models import stepper_model

ROBOT = "gymnasium/ant"
N, STEPS = 5, 30


def run(path, *, num_envs=N, precision="f64", threads=1, **settings):
    """A run with everything that a run can have: control, resets, states, applied forces."""
    sim = stepper.Stepper(stepper_model(ROBOT), num_envs, precision=precision, threads=threads, seed=3)
    sim.step(nstep=7)
    rng, shape = np.random.default_rng(0), () if num_envs is None else (num_envs,)
    with sim.record(path, **settings):
        for k in range(STEPS):
            sim.step(rng.uniform(-1, 1, (*shape, sim.model.nu)), nstep=1 + k % 2)
            if k == 7:
                sim.xfrc_applied[..., 1, 2] = 30.0
            if k == 11:
                kept = sim.get_state()
            if k == 13:
                sim.reset(None if num_envs is None else np.arange(num_envs) % 2 == 0, seed=9)
            if k == 17:
                sim.set_state(kept)
            if k == 19:
                sim.set_state(qvel=np.full(sim.model.nv, 0.1))
    return sim


@pytest.mark.parametrize("precision", ["f64", "f32"])
@pytest.mark.parametrize("num_envs", [None, N])
def test_a_replay_reproduces_every_bit(tmp_path, precision, num_envs):
    run(tmp_path / "run", precision=precision, num_envs=num_envs)
    for threads in (None, 2):
        result = stepper.replay(tmp_path / "run", threads=threads)
        assert result
        assert (result.steps, result.complete, result.difference) == (STEPS, True, None)
        assert "bit for bit" in str(result)


def test_small_chunks_are_the_same_recording(tmp_path):
    run(tmp_path / "run", chunk=1)
    assert len(list((tmp_path / "run").glob("*.npz"))) > STEPS
    assert stepper.replay(tmp_path / "run").steps == STEPS


def test_a_difference_is_named_by_step_field_and_environment(tmp_path):
    run(tmp_path / "run")
    file = tmp_path / "run/00000.npz"
    with np.load(file) as chunk:
        arrays = dict(chunk)
    arrays["qvel"][12, 3, 4] = np.nextafter(arrays["qvel"][12, 3, 4], 9.0)
    np.savez(file, **arrays)
    difference = stepper.replay(tmp_path / "run").difference
    assert (difference.step, difference.field, difference.env) == (12, "qvel", 3)
    assert difference.recorded[4] != difference.replayed[4]
    assert "call 12" in str(difference)
    assert "environment 3" in str(difference)


def test_another_model_is_refused(tmp_path):
    sim = run(tmp_path / "run")
    other = sim.model.replace(timestep=0.003)
    with pytest.raises(ValueError, match="recorded with model"):
        stepper.replay(tmp_path / "run", model=other)
    other.save(tmp_path / "run/model.stepper")
    with pytest.raises(ValueError, match="recorded with model"):
        stepper.replay(tmp_path / "run")


def test_a_run_that_was_cut_off_is_replayed_as_far_as_it_goes(tmp_path):
    sim = stepper.Stepper(stepper_model(ROBOT))
    recorder = sim.record(tmp_path / "run", chunk=1)
    sim.step(nstep=3)
    sim.recorder = None
    recorder.close()
    result = stepper.replay(tmp_path / "run")
    assert result
    assert not result.complete
    assert "not closed" in str(result)


def test_one_recording_at_a_time_into_an_empty_folder(tmp_path):
    sim = stepper.Stepper(stepper_model(ROBOT))
    with sim.record(tmp_path / "run"), pytest.raises(ValueError, match="already recorded"):
        sim.record(tmp_path / "other")
    with pytest.raises(FileExistsError, match="not empty"):
        sim.record(tmp_path / "run")
    assert sim.recorder is None


def test_failures_are_laid_to_action_or_physics(tmp_path):
    model = stepper_model(ROBOT)
    sim = stepper.Stepper(model, 3, options=stepper.Options(iterations=1, solver="pgs", tolerance=1e-12))
    ctrl = np.zeros((3, model.nu))
    ctrl[1, 2], ctrl[2, 0] = np.nan, 1e3
    with sim.record(tmp_path / "run"):
        sim.reset(qpos=np.where(np.arange(model.nq) == 2, 0.3, model.qpos0))
        sim.step(ctrl)
        sim.step(np.zeros_like(ctrl))
    head = json.loads((tmp_path / "run/run.json").read_text())
    found = {(f["whose"], f["what"]): f for f in head["failures"]}
    assert found["action", "non-finite"]["first"] == [[2, 1]]
    assert found["action", "clipped"]["first"] == [[2, 2]]
    assert ("physics", "non-finite") not in found
    assert found["physics", "residual"]["count"] > 0
    assert head["model"]["sha256"] == model.digest
    assert head["options"]["iterations"] == 1


def test_the_command_line_reports_and_replays(tmp_path, capsys):
    from stepper._cli import replay, report

    run(tmp_path / "run")
    report(tmp_path / "run")
    replay(tmp_path / "run", None)
    said = capsys.readouterr().out
    assert "5 environments" in said
    assert "bit for bit" in said
