"""The labs in examples/studies say what the textbook says."""

import importlib.util
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import stepper
from stepper.envs import StepperVectorEnv
from stepper.lab.study.batches import Point, run_points
from stepper.lab.study.failure_causes import causes_of
from stepper.lab.study.journal import Results

LABS = Path(__file__).parents[2] / "examples/studies"


def lab(name):
    return stepper.lab.Study.from_file(LABS / name)


def module(name):
    spec = importlib.util.spec_from_file_location(f"lab_{name}", LABS / f"{name}.py")
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


def cliffs(study, out, *names, **given):
    found = stepper.lab.sweep(study, out, parameters=names, **given).sweep
    return {(cliff.setting, cliff.parameter): cliff for cliff in found.cliffs}, found


def test_friction_decides_a_grasp(tmp_path):
    study, theory = lab("grasp.py"), module("grasp").THEORY
    quick = replace(study, settings={"5 iterations": {"iterations": 5}, "MuJoCo": {"engine": "mujoco"}})
    ends, found = cliffs(quick, tmp_path, "friction", resolution=5e-4)
    for setting in ("stepper", "5 iterations"):
        end = ends[setting, "friction"]
        # Half a millimetre of slip is allowed, which the lift makes 0.0006 of friction: it falls behind by 0.0247 m/s^2 for 0.2 s, and 1.67
        # times as fast as it would behind a hand that did not speed up without it.
        assert (end.low + end.high) / 2 == pytest.approx(theory, abs=1e-3)
    rows = [row for row in found.table.rows if row["parameters"].get("friction", 0) >= 0.5]
    ours = [row["outcomes"] for row in rows if row["setting"] == "stepper"]
    # Motors of 10 N: what accelerates the pads is gone when the box is still, to the solver's tolerance over a step of 0.1 kg.
    assert all(row["force at a pad"] == pytest.approx(10.0, abs=1e-3) for row in ours)
    assert all(row["slip"] < 1e-6 and row["rise"] == pytest.approx(0.1, abs=1e-6) for row in ours)
    # Soft contact creeps at any friction.
    assert all(row["outcomes"]["slip"] > 1e-3 for row in rows if row["setting"] == "MuJoCo")


def test_the_tray_slides_until_the_gripper_reacts(tmp_path):
    study = replace(lab("tray.toml"), episodes=1)
    mu, push, mass, g = 0.55, 2.0, 0.3, 9.81
    a = push / mass - mu * g
    ends, found = cliffs(study, tmp_path, "reaction", "timestep")
    end = ends["stepper", "reaction"]
    exact = math.sqrt(2 * 0.03 / (a * (1 + a / (mu * g))))
    # The push ends within a control of 8 ms, in which it is scaled: of second order in that, and the bracket is 0.35 ms wide.
    assert (end.low + end.high) / 2 == pytest.approx(exact, abs=5e-4)
    ways = [level.mean for level in found.levels_of("timestep")]
    assert ways == pytest.approx([0.5 * a * 0.15**2 * (1 + a / (mu * g))] * 4, rel=5e-3)
    with Results(study, tmp_path / "stuck") as results:
        (row,) = run_points(study, [Point(study.nominal | {"friction": 1.0, "timestep": 0.001})], results.journal)
    # It starts with a millionth of a metre a second, which friction takes in 1e-7 s.
    assert abs(row["outcomes"]["way"]) < 1e-9


def test_ten_percent_at_each_touch_is_no_friction(tmp_path):
    block = module("block")
    ends, found = cliffs(lab("block.py"), tmp_path, "friction", "speed")
    end = ends["stepper", "friction"]
    assert end.low - 1e-6 <= block.THEORY <= end.high + 1e-6
    assert ends["stepper", "speed"].high == pytest.approx(block.SPEED, abs=2e-3)
    for level in found.levels_of("friction"):
        expected = level.value * (1 + block.RESTITUTION) * block.IMPACT / block.SPEED
        # The impact is found within the step: its speed to the gravity of a step's end, 1e-5 of it.
        assert level.mean == pytest.approx(expected, rel=1e-4, abs=1e-12)


def test_what_decides_where_a_pushed_box_stops(tmp_path):
    study = replace(lab("pushed_box.py"), episodes=3)
    _, found = cliffs(study, tmp_path, "friction", "mass", "height", "camera delay", cliffs=False)
    mean = {name: [level.mean for level in found.levels_of(name)] for name in ("friction", "mass", "height", "camera delay")}
    # Mass and height have no part in v t + v^2 / (2 mu g); 2 mm are the camera's noise and looks every 20 ms at 0.3 m/s.
    for name in ("mass", "height"):
        assert np.ptp(mean[name]) < 2e-3
    slope = np.polyfit(study.parameters["camera delay"].levels(), mean["camera delay"], 1)[0]
    assert slope == pytest.approx(0.3, rel=0.1)
    slides = [0.3**2 / (2 * mu * 9.81) for mu in study.parameters["friction"].levels()]
    assert mean["friction"][0] - mean["friction"][-1] == pytest.approx(slides[0] - slides[-1], abs=3e-3)


def test_where_the_camera_hangs_and_what_it_sees_decides(tmp_path):
    lab_of, study = module("pushed_box"), replace(lab("pushed_box.py"), episodes=4)
    ends, found = cliffs(study, tmp_path, "field of view", "camera place", "camera tilt", resolution=2e-3)
    # The box has to be seen at the line and until the next look, 20 ms and 6 mm later; edges are blurred by 1 mm of noise.
    exact = [2.0 * math.atan((lab_of.LINE + further) / lab_of.AHEAD) for further in (-0.003, 0.006 + 0.003)]
    end = ends["stepper", "field of view"]
    assert exact[0] <= end.low < end.high <= exact[1]
    # The camera reads less by its place, and by the tilt times the distance; the box stops that much later. In six millimetres of a look.
    mean = {level.value: level.mean for level in found.levels_of("camera place")}
    assert mean[0.03] - mean[0.0] == pytest.approx(0.03, abs=6e-3)
    tilt = {level.value: level.mean for level in found.levels_of("camera tilt")}
    assert tilt[0.015] - tilt[0.0] == pytest.approx(2 * 0.015 * lab_of.AHEAD, abs=6e-3)
    # What is not seen is perception's failure, as all of it goes well with a camera that sees everything.
    narrow = replace(study, parameters={**study.parameters, "field of view": replace(study.parameters["field of view"], nominal=0.4)})
    with Results(narrow, tmp_path / "narrow") as results:
        rows = run_points(narrow, [Point(narrow.nominal)], results.journal)
        assert {(row["success"], found.cause) for row, found in zip(rows, causes_of(narrow, rows, results.journal), strict=True)} == {
            (False, "perception")
        }


def test_perfect_sensors_inflate_a_score(tmp_path):
    """The policy that was trained on the state falls with 10 ms of delay, with which the other one was trained."""
    shares = {}
    for name in ("encoders", "encoders_trained"):
        study = lab(f"{name}.py")
        delay = replace(study.parameters["delay"], low=None, high=None, values=(0.0, 0.01))
        found = stepper.lab.sweep(replace(study, parameters={"delay": delay}), tmp_path, cliffs=False).sweep
        shares[name] = [level.successes for level in found.levels_of("delay")]
    # All, none and all of 16 where it was measured. Products of NumPy differ between machines in their last bits, and a fall may follow.
    assert shares["encoders"][0] >= 15
    assert shares["encoders"][1] <= 1
    assert shares["encoders_trained"][1] >= 12


def test_a_policy_is_trained_by_what_encoders_say():
    lesson = module("encoders_task")
    seen = []
    for _ in range(2):
        envs = StepperVectorEnv(lesson.Encoders, 3)
        first, _ = envs.reset(seed=1)
        for _ in range(4):
            observation, *_ = envs.step(np.zeros((3, 1), np.float32))
        truth = lesson.encoders.seen(np.asarray(envs.sim.sensordata_ideal, float))
        seen.append((first, observation))
        errors = np.abs(observation - truth).max(axis=0)
        # Sines of angles, to 0.02 rad of noise a sample, and rates, to 0.2 rad/s; the cart, which moves for 10 ms, to its delay.
        assert 1e-4 < errors[1] < 0.2
        assert 1e-2 < errors[7] < 2.0
        assert errors[8] == 0.0
    np.testing.assert_array_equal(seen[0][1], seen[1][1])
