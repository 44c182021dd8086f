"""Data of `stepper.sysid.identify`: recordings, CSV and npz files, and the errors about those that do not fit."""

import subprocess
import sys

import numpy as np
import pytest
import stepper
from checks import raises
from identification.scenes import HARD, pushed
from stepper.sysid import Episode, episodes_of

SCENE = pushed()
MODEL = SCENE.model(*SCENE.truth)


def log():
    """The scene as a log: row k is at time 0.02 k, and has the readings that control k - 1 led to."""
    made = stepper.Stepper(MODEL, options=HARD).rollout(SCENE.ctrl, 10, fields=("sensordata", "qpos", "qvel"))
    observed = np.concatenate([np.zeros((1, MODEL.nsensordata)), made["sensordata"]])
    return {
        "time": 0.02 * np.arange(101),
        "ctrl": np.concatenate([SCENE.ctrl, SCENE.ctrl[-1:]]),
        "wrist_force": observed[:, :3],
        "box_x": observed[:, 3],
        "qpos": np.concatenate([MODEL.qpos0[None], made["qpos"]]),
        "qvel": np.concatenate([np.zeros((1, MODEL.nv)), made["qvel"]]),
    }


def write_csv(path, table):
    columns = {}
    for name, values in table.items():
        if values.ndim == 1:
            columns[name] = values
        else:
            columns |= {f"{name}[{k}]": values[:, k] for k in range(values.shape[1])}
    rows = [",".join(columns)] + [
        ",".join("" if np.isnan(x) else repr(float(x)) for x in row) for row in zip(*columns.values(), strict=True)
    ]
    path.write_text("\n".join(rows) + "\n")


def test_logs_and_recordings_say_the_same(tmp_path):
    table = log()
    np.savez(tmp_path / "log.npz", **table)
    # A sensor that is read every other time, and a heading of somebody else's.
    sparse = {name: values.copy() for name, values in table.items()}
    sparse["wrist_force"][1::2] = np.nan
    sparse["t [s]"] = sparse.pop("time")
    write_csv(tmp_path / "log.csv", sparse)
    sim = stepper.Stepper(MODEL, num_envs=2, options=HARD)
    with sim.record(tmp_path / "run"):
        for ctrl in SCENE.ctrl:
            sim.step(ctrl, nstep=10)
    channels = ["wrist_force", "box_x"]
    start = SCENE.model(1.0, 0.5)
    for data, settings in ((tmp_path / "log.npz", {}), (tmp_path / "log.csv", {"columns": {"t [s]": "time"}}), (tmp_path / "run", {})):
        found = stepper.sysid.identify(start, data, SCENE.parameters, channels=channels, starts=1, **settings)
        # Recordings and logs hold all digits; what is left is the tolerance of the steps.
        np.testing.assert_allclose(found.values, SCENE.truth, rtol=1e-5, err_msg=str(data))
        assert found.warnings == ()
    episodes = episodes_of(tmp_path / "run", start)
    assert len(episodes) == 2
    np.testing.assert_array_equal(episodes[1].readings["box_x"][:, 0], table["box_x"][1:])


def test_a_recording_with_resets_forces_and_a_mask(tmp_path):
    """Stretches between resets are episodes with starts of their own, and applied forces are those that were in force."""
    model = stepper.load("""<mujoco><worldbody><body name="b"><freejoint/><geom size=".1" mass="2"/><site name="s"/></body></worldbody>
        <sensor><framelinvel name="v" objtype="site" objname="s"/></sensor></mujoco>""")
    sim = stepper.Stepper(model, num_envs=2)
    with sim.record(tmp_path / "run"):
        sim.step(nstep=5)
        sim.xfrc_applied[:, 1, 0] = 3.0
        sim.step(nstep=5)
        sim.step(nstep=5)
        sim.reset(np.array([False, True]), qvel=[0, 1, 0, 0, 0, 0])
        sim.step(nstep=5)
        sim.step(nstep=10)
    episodes = episodes_of(tmp_path / "run", model)
    assert [len(e.ctrl) for e in episodes] == [3, 3, 1, 1, 1, 1]
    assert [e.applied["xfrc_applied"][:, 1, 0].tolist() for e in episodes[:2]] == [[0, 3, 3]] * 2
    # The mask: environment 0 goes on, with the force that applies to it.
    assert episodes[2].qvel[0] > 0
    assert episodes[3].qvel.tolist() == [0, 1, 0, 0, 0, 0]
    found = stepper.sysid.identify(model.replace(body_mass=[0, 5.0]), episodes[:3], ["body_mass[b]"], starts=1)
    assert found.values[0] == pytest.approx(2.0, rel=1e-6)


@pytest.mark.parametrize(("change", "message"), [
    (lambda t: t.pop("time"), "there is no column 'time'; add one"),
    (lambda t: t["time"].__setitem__(slice(50, None), t["time"][50:] + 0.01), "not equally spaced"),
    (lambda t: t.update(ctrl=t["ctrl"][:, :0]), r"ctrl has 0 columns, must have 1"),
    (lambda t: t["ctrl"].__setitem__(7, np.nan), "ctrl of row 7 is not finite"),
    (lambda t: t.update(time=1.1 * t["time"] + 0.0), r"no whole number of time steps.*choose options=stepper.Options\(timestep=0.002\)"),
    (lambda t: t.update(wrist_force=t["wrist_force"][:, :2]), "has 2 columns, must have 3"),
])  # fmt: skip
def test_logs_that_do_not_fit(tmp_path, change, message):
    table = log()
    change(table)
    if np.asarray(table.get("time", [0, 0.02]))[-1] > 2.15:
        table["time"] = 0.021 * np.arange(101)
        message = message.replace("0.002", "0.0021")
    np.savez(tmp_path / "log.npz", **table)
    with pytest.raises(ValueError, match=message) as caught:
        stepper.sysid.identify(MODEL, tmp_path / "log.npz", ["body_mass[box]"], starts=1)
    assert "log.npz" in str(caught.value)


def test_cells_lines_and_names(tmp_path):
    file = tmp_path / "log.csv"
    for text, error, message in (
        ("time,ctrl,box_x\n0,0,0\n0.02,0,abc\n", ValueError, r"log.csv, line 3, column 'box_x': 'abc' is no number"),
        ("time,ctrl,box_x\n0,0,0\n0.02,0\n", ValueError, "line 3: 2 cells, must be 3"),
        ("time,ctrl,box_y\n0,0,0\n0.02,0,0\n0.04,0,0\n", KeyError, "no sensor or coordinate is named 'box_y'; did you mean box_x"),
    ):
        file.write_text(text)
        raises(error, message, stepper.sysid.identify, MODEL, file, ["body_mass[box]"])
    for name in ("none.csv", "none"):
        raises(FileNotFoundError, rf"there is no .* file '.*{name}'", stepper.sysid.identify, MODEL, tmp_path / name, ["body_mass[box]"])
    good = Episode(SCENE.ctrl, SCENE.readings(stepper.Options()), 0.02)
    for parameters, error, message in (
        ([], ValueError, "no parameter"),
        (["mas:box"], ValueError, r"is no selector: write field\[names\]"),
        (["mass"], ValueError, "did you mean body_mass"),
        (["body_mass[boxx]"], ValueError, "no body 'boxx'; did you mean box"),
        (["body_mass[box]", "body_inertial[box]"], ValueError, "same number"),
        (["body_mass[box]=3..1"], ValueError, "bounds"),
        (["pair_friction[p][0]"], ValueError, "no pair 'p': this model has no pair"),
        (["actuator_kp[push]"], ValueError, "no actuator 'push'"),
        (["dof_frictionloss[x]"], ValueError, "give a start above 0"),
        (["sensor.bias[torque]"], ValueError, "no sensor 'torque'"),
    ):
        raises(error, message, stepper.sysid.identify, MODEL, good, parameters)
    raises(ValueError, "noise has 'q'", stepper.sysid.identify, MODEL, good, ["body_mass[box]"], noise={"q": 1.0})
    with pytest.raises(TypeError, match=r"data has 3 \(int\), must be a stepper\.sysid\.Episode, or the path"):
        stepper.sysid.identify(MODEL, 3, ["body_mass[box]"])


@pytest.mark.parametrize(("given", "message"), [
    ({"readings": "8"}, "readings is '8', must be a dict"),
    ({"readings": {}}, "readings is empty; give the readings of a sensor"),
    ({"readings": {"box_x": [["a"]]}}, r"channel 'box_x' is \[\['a'\]\], must be an array of numbers"),
    ({"applied": {"xfrc_applied": 3.0}}, r"applied\['xfrc_applied'\] has shape \(\), must have .* rows"),
    ({"period": "8"}, r"period \(s\) is '8', must be a number"),
    ({"ctrl": [["a"]]}, r"ctrl is \[\['a'\]\], must be an array of numbers"),
    ({"start_std": 0.1}, "start_std is 0.1, must be two values, of positions and of velocities"),
    ({"start_std": (0.1, [0.1] * 99)}, r"start_std has shapes \[\(\), \(99,\)\], each must be \(\) or"),
])  # fmt: skip
def test_episodes_with_wrong_values_are_named(given, message):
    good = {"ctrl": SCENE.ctrl, "readings": SCENE.readings(stepper.Options()), "period": 0.02}
    raises(ValueError, f"^episode: {message}", lambda: Episode(**(good | given)).checked(MODEL))


@pytest.mark.parametrize(("given", "message"), [
    ({"model": "box.xml"}, r"model is 'box.xml' \(str\), must be a stepper.Model: stepper.load\(path\) reads one"),
    ({"parameters": [1, 2]}, r"parameters is \[1, 2\], must be a list of selectors or FitParameter"),
    ({"noise": 0.1}, "noise is 0.1, must be a dict such as"),
    ({"noise": {"box_x": "small"}}, "noise of 'box_x' is 'small', must be an array of numbers"),
    ({"starts": "8"}, "starts is '8', must be a whole number of at least 1"),
    ({"step": 0.0}, "step is 0.0, must be a finite number above 0"),
    ({"seed": -1}, "seed is -1, must be a whole number of at least 0"),
    ({"progress": 1}, "progress is 1, must be a function"),
    ({"options": "euler"}, r"options is 'euler' \(str\), must be a stepper.Options"),
])  # fmt: skip
def test_wrong_arguments_of_identify_are_named(given, message):
    good = {"model": MODEL, "data": Episode(SCENE.ctrl, SCENE.readings(stepper.Options()), 0.02), "parameters": ["body_mass[box]"]}
    raises((TypeError, ValueError), message, stepper.sysid.identify, **good | given)


@pytest.mark.parametrize(("given", "message"), [
    ({"bounds": 3.0}, r"bounds is 3.0, must be two numbers, \(low, high\)"),
    ({"prior": [1.0]}, r"prior is \[1.0\], must be two numbers, \(mean, standard deviation\)"),
    ({"start": "heavy"}, "start is 'heavy', must be a number"),
])  # fmt: skip
def test_wrong_arguments_of_parameters_are_named(given, message):
    raises(TypeError, rf"^body_mass\[box\]: {message}", stepper.sysid.FitParameter, "body_mass[box]", **given)


def test_a_log_without_a_start_says_so(tmp_path):
    table = log()
    del table["qpos"], table["qvel"]
    np.savez(tmp_path / "log.npz", **table)
    found = stepper.sysid.identify(MODEL, tmp_path / "log.npz", ["body_mass[box]"], starts=1)
    assert sum("in its first row" in text for text in found.warnings) == 2
    assert not stepper.sysid.identify(
        MODEL, tmp_path / "log.npz", ["body_mass[box]"], starts=1, start=(MODEL.qpos0, np.zeros(MODEL.nv))
    ).warnings


def test_the_command(tmp_path):
    np.savez(tmp_path / "log.npz", **log())
    (tmp_path / "scene.xml").write_text(SCENE.text(1.0, 0.5))
    command = [sys.executable, "-m", "stepper", "identify", "scene.xml", "log.npz", "-p", "body_mass[box]", "-p"]
    running = {"cwd": tmp_path, "capture_output": True, "text": True}
    ran = subprocess.run([*command, "geom_friction[floor,box][0]"], check=False, **running)
    assert ran.returncode == 0, ran.stderr
    assert "| body_mass[box] | 1.3 |" in ran.stdout
    assert stepper.load(tmp_path / "out/identified.stepper").body("box").mass == pytest.approx(1.3, rel=1e-5)
    ran = subprocess.run([*command, "body_mass[bok]"], check=False, **running)
    assert ran.returncode == 1
    assert ran.stderr.startswith("stepper: parameters has 'body_mass[bok]': no body 'bok'")
