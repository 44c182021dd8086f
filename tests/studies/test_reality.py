"""Engines against measured motions (benches/reality), on motions of stepper itself in the layout of the real data."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from atlas.engines import Stepper
from reality import __main__ as command, engines, pendulum, report, tosses
from reality.data import HALF, PERIOD, Toss, cube_tosses
from stepper.cli import main
from stepper.lab.calibration import fit, trajectories

STUDIES = Path(__file__).parents[2] / "benches/studies"
CONTACT = {"friction": 0.18, "restitution": 0.25}
TOSSES, SAMPLES, FLIGHT = 12, 100, 20
"""Number of tosses, samples of each, and samples of the flight before a corner can touch the table."""


def tossed(experiment: tosses.Experiment, nq: int) -> np.ndarray:
    """Poses of tosses that stepper simulates, (tosses, samples, nq)."""
    rng, start = np.random.default_rng(0), np.zeros((TOSSES, 2 * nq - 1))
    start[:, 2] = HALF * np.sqrt(3.0) + 0.5 * 9.81 * (FLIGHT * PERIOD) ** 2
    start[:, 3:7] = rng.standard_normal((TOSSES, 4))
    start[:, 3:7] /= np.linalg.norm(start[:, 3:7], axis=1, keepdims=True)
    start[:, nq : nq + 2], start[:, nq + 3 : nq + 6] = rng.uniform(-0.3, 0.3, (TOSSES, 2)), rng.uniform(-5.0, 5.0, (TOSSES, 3))
    own = [Toss(np.zeros((SAMPLES, nq)), row, 0, 9.81) for row in start]
    return engines.OfAtlas("stepper", {}, engine=Stepper("stepper")).poses(CONTACT, experiment.table(), own, tosses.FITTED_AT)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of data with all sets: few and short motions."""
    folder = tmp_path_factory.mktemp("data")
    for name in ("cube_toss", "elbow_toss", "multiarm_pendulum", "servo_bam"):
        (folder / name).mkdir()
    for experiment, nq in ((tosses.CUBE, 7), (tosses.ELBOW, 8)):
        poses = tossed(experiment, nq)
        speeds = np.gradient(poses[..., :6], PERIOD, axis=1).reshape(-1, 6)
        first = np.arange(TOSSES + 1) * SAMPLES
        np.savez(folder / experiment.name / f"{experiment.name}.npz", start=first, pose=poses.reshape(-1, nq), vel=speeds)
    arrays, period = {}, 0.01
    for n, name in enumerate(("single", "double", "triple"), 1):
        published = np.r_[[0.1] * n, [0.1] * n, [0.2] * (n - 1), [0.001] * n, np.zeros(n), 9.81]
        # A pendulum at rest.
        arrays |= {f"{name}_q": np.full((900, n), np.pi), f"{name}_dq": np.zeros((900, n))}
        arrays |= {f"{name}_published_params": published, f"{name}_dt": period, f"{name}_n_train": 450}
    np.savez(folder / "multiarm_pendulum/multiarm_pendulum.npz", **arrays)
    runs = [f"{k},,xl330,sin_sin,0.49,0.1,{gain},7.4,2" for k, gain in enumerate((100, 200, 800))]
    (folder / "servo_bam/recordings.csv").write_text(
        "rec,source_file,motor,trajectory,mass_kg,length_m,kp_firmware,vin_V,n\n" + "\n".join(runs)
    )
    samples = [f"{k},{t},0.1,0,0,0,7.4,28,0" for k in range(3) for t in (0, 6)]
    head = "rec,t_s,q_rad,dq_rad_s,q_goal_rad,load_raw,input_V,temp_C,torque_enable\n"
    (folder / "servo_bam/servo_bam.csv").write_text(head + "\n".join(samples))
    return folder


def test_the_true_parameters_predict_tosses(data: Path) -> None:
    """Tosses of stepper are predicted with the true parameters, a thousand times better than with another friction.

    As published, the vertical velocity is that of one sample before the initial pose, too small by g / 148 Hz, which is added here.
    """
    every, errors = cube_tosses(data), []
    assert len(every) == TOSSES
    assert np.allclose([toss.fall for toss in every], 9.81, atol=0.01)
    started = [replace(toss, start=toss.start - 9.81 * PERIOD * (np.arange(13) == 9)) for toss in every]
    for values in (CONTACT, CONTACT | {"friction": 0.4}):
        poses = engines.engines()[0].poses(values, engines.Table(), started, tosses.FITTED_AT)
        errors.append(np.nanmean(tosses.CUBE.errors(poses, every)[0]))
    assert errors[0] < 1e-3 * errors[1]


def test_the_command_fits_and_predicts_all_sets(data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`python -m reality` fits stepper to each set, predicts the other half, and updates results, picture and pairs."""
    quick = tuple(replace(own, draws=4, rounds=1) for own in tosses.EXPERIMENTS)
    monkeypatch.setattr(tosses, "EXPERIMENTS", quick)
    monkeypatch.setattr(report, "EXPERIMENTS", quick)
    monkeypatch.setattr(pendulum, "fit", lambda *args, **_: fit.fit(*args, samples=4, rounds=1))
    monkeypatch.setattr(engines, "find_spec", lambda _: None)
    monkeypatch.setattr(report, "BENCHMARKS", tmp_path)
    for name in report.SETS.values():
        (tmp_path / name).write_text((STUDIES.parents[1] / "docs/benchmarks" / name).read_text())

    def run(*words: str) -> None:
        monkeypatch.setattr(sys, "argv", ["reality", "--data", str(data), "--out", str(tmp_path / "out"), *words])
        command.main()

    run("--engine", "stepper")
    run("--update-docs")
    run("--pairs")
    cube, elbow, swings = (report.read_rows(tmp_path / name) for name in report.SETS.values())
    for rows in (cube, elbow):
        held_out = [row for row in report.held_out(rows, "fitted") if row["engine"] == "stepper"]
        assert [row["tosses"] for row in held_out] == [str(TOSSES // 2)]
        assert 0.0 < float(held_out[0]["mean"]) < 1.0
    # A pendulum that rests is predicted exactly.
    assert max(float(row["median_rad"]) for row in swings if row["engine"] == "stepper") < 1e-9
    pairs = report.read_rows(tmp_path / "reality_pairs.csv")
    assert {(row["data_set"], row["engine"], row["other"]) for row in pairs} >= {("cube_toss", "stepper, compliant table", "stepper")}


@pytest.mark.parametrize(("words", "held_out"), [
    (["cube_toss.py", "--fit-trajectories", "2"], TOSSES // 2),
    (["servo_bam.py", "--fit-trajectories", "2", "--parameter", "armature", "--parameter", "gear efficiency"], 1),
])  # fmt: skip
def test_studies_of_real_data_are_calibrated(
    words: list[str], held_out: int, data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`stepper calibrate --fit-trajectories` fits both studies, and counts the held-out trajectories above the margin."""
    monkeypatch.setattr(trajectories, "fit", lambda *args, **_: fit.fit(*args, samples=2, rounds=1))
    study, *more = words
    given = ["calibrate", str(STUDIES / study), "--data", str(data), "--out", str(tmp_path), "--margin", "0.5", *more]
    monkeypatch.setattr(sys, "argv", ["stepper", *given])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 0
    text = next(tmp_path.glob("*/trajectories.md")).read_text()
    assert f"Chosen on 2 trajectories, checked on {held_out}," in text
    assert f" of {held_out} held-out trajectories exceed the margin" in text
