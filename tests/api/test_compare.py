"""`stepper.lab.compare`: the same episodes under both laws of contact and in MuJoCo."""

import math

import mujoco
import numpy as np
import pytest
import stepper
from models import SOURCES

BALL = """<mujoco><option timestep=".001"/><worldbody><geom type="plane" size="1 1 .1"/>
  <body pos="0 0 .101"><freejoint/><geom size=".1" mass="2"/></body></worldbody></mujoco>"""


def test_a_ball_that_falls_a_millimetre():
    """Hard contact leaves no depth; the soft one rests as deep as its law says, where its force is the weight, and presses as long."""
    found = stepper.lab.compare(BALL, seconds=1.0, num_envs=2, start=(np.tile([0, 0, 0.101, 1, 0, 0, 0], (2, 1)), np.zeros((2, 6))))
    figures = found.figures()
    assert list(figures) == ["hard", "MuJoCo's law", "MuJoCo"]
    assert figures["hard"]["largest penetration, mm"] < 0.02  # twice the slop, which is left alone
    assert figures["MuJoCo's law"]["largest penetration, mm"] > 0.1
    for name, value in figures["MuJoCo"].items():
        # The same law, and no chaos in a ball that falls: six digits, since energy and depth are differences.
        assert math.isclose(figures["MuJoCo's law"][name], value, rel_tol=1e-6, abs_tol=1e-9), name
    fall = math.sqrt(2 * 0.001 / 9.81)
    for of in figures.values():
        # The weight for a second, less the fall, and what the speed before a rest adds; the last step's force is a thousandth of it.
        assert math.isclose(of["impulse of contacts, N s"], 2 * 9.81 * 1.0, rel_tol=5e-3)
        assert abs(of["first touch, s"] - fall) < 0.003
        assert of["sliding distance of surfaces, m"] < 1e-3


def test_controls_policies_rewards_and_pictures(tmp_path):
    source = str(SOURCES["dm_control/hopper"])
    model = stepper.load(source, strict=False)

    def reward(before, ctrl, after):
        assert ctrl.shape == (3, model.nu)
        return after[0][:, 0] - before[0][:, 0]

    controls = np.random.default_rng(0).uniform(-1, 1, (40, model.nu))
    step = iter(range(10**6))
    by_table = stepper.lab.compare(source, controls, seconds=0.2, num_envs=3, reward=reward)
    policies = stepper.lab.compare(model, lambda qpos, qvel: controls[next(step) % 40], seconds=0.2, num_envs=3, reward=reward)
    assert list(policies.figures()) == ["hard", "MuJoCo's law"]
    for name, figures in policies.figures().items():
        assert math.isnan(figures.pop("sliding distance of surfaces, m"))
        same = {key: value for key, value in by_table.figures()[name].items() if key in figures}
        assert figures == same
    assert by_table.table().count("\n") == 13
    assert by_table.draw(tmp_path / "out" / "picture.png").stat().st_size > 10_000


def test_settings_hold_for_both_laws():
    found = stepper.lab.compare(BALL, seconds=0.02, num_envs=1, options=stepper.Options(timestep=0.002, integrator="euler"))
    assert {course.timestep for course in found.courses} == {0.002}
    assert len(found.courses[0].depth) == 10


@pytest.mark.parametrize(("given", "words"), [
    ({"seconds": 0.0}, "seconds is 0.0"),
    ({"num_envs": 0}, "num_envs is 0, must be a whole number of at least 1"),
    ({"num_envs": "8"}, "num_envs is '8', must be a whole number of at least 1"),
    ({"seconds": "2"}, "seconds is '2', must be a number"),
    ({"seed": -1}, "seed is -1, must be a whole number of at least 0"),
    ({"options": "euler"}, r"options is 'euler' \(str\), must be a stepper.Options"),
    ({"start": 3}, "start is 3, must be two arrays, qpos and qvel"),
    ({"controller": []}, r"controller has shape \(0,\), must be \(steps, 0\) or \(steps, 8, 0\)"),
    ({"controller": "zero"}, "controller is 'zero', must be an array of numbers"),
    ({"reward": 1.0}, "reward is 1.0, must be a function"),
    ({"start": (np.zeros((1, 7)), np.zeros((1, 6)))}, r"start has shapes \(1, 7\) and \(1, 6\), must be \(8, 7\) and \(8, 6\)"),
])  # fmt: skip
def test_what_is_wrong_is_named(given, words):
    with pytest.raises((TypeError, ValueError), match=words):
        stepper.lab.compare(BALL, **given)


def test_a_compiled_model_is_left_alone():
    compiled = mujoco.MjModel.from_xml_string(BALL)
    flags = compiled.opt.enableflags
    stepper.lab.compare(compiled, seconds=0.01, num_envs=1, options=stepper.Options(timestep=0.005))
    assert compiled.opt.enableflags == flags
    assert compiled.opt.timestep == 0.001
