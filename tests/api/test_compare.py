"""`stepper.lab.compare`: the same episodes under both laws of contact and in MuJoCo."""

import math

import mujoco
import pytest
import stepper
from models import SOURCES

BALL = """<mujoco><option timestep=".001"/><worldbody><geom type="plane" size="1 1 .1"/>
  <body pos="0 0 .101"><freejoint/><geom size=".1" mass="2"/></body></worldbody></mujoco>"""


def test_a_ball_that_falls_a_millimetre():
    """Hard contact leaves no depth; the soft one rests as deep as its law says, where its force is the weight, and presses as long."""
    figures = stepper.lab.compare(BALL, seconds=1.0, num_envs=2).figures()
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
        # Initial speeds of 0.01 m/s (standard deviation) move the touch by 1 ms.
        assert abs(of["first touch, s"] - fall) < 0.005


def test_a_robot_and_its_picture(tmp_path):
    source = str(SOURCES["dm_control/hopper"])
    by_source = stepper.lab.compare(source, seconds=0.2, num_envs=3)
    by_model = stepper.lab.compare(stepper.load(source, strict=False), seconds=0.2, num_envs=3)
    assert list(by_model.figures()) == ["hard", "MuJoCo's law"]
    assert by_model.figures().items() <= by_source.figures().items()
    assert by_source.table().count("\n") == 11
    assert by_source.draw(tmp_path / "out" / "picture.png").stat().st_size > 10_000


@pytest.mark.parametrize(("given", "words"), [
    ({"seconds": 0.0}, "seconds is 0.0"),
    ({"num_envs": 0}, "num_envs is 0, must be a whole number of at least 1"),
    ({"num_envs": "8"}, "num_envs is '8', must be a whole number of at least 1"),
    ({"seconds": "2"}, "seconds is '2', must be a number"),
    ({"seed": -1}, "seed is -1, must be a whole number of at least 0"),
])  # fmt: skip
def test_what_is_wrong_is_named(given, words):
    with pytest.raises((TypeError, ValueError), match=words):
        stepper.lab.compare(BALL, **given)


def test_a_compiled_model_is_left_alone():
    compiled = mujoco.MjModel.from_xml_string(BALL)
    flags = compiled.opt.enableflags
    stepper.lab.compare(compiled, seconds=0.01, num_envs=1)
    assert (compiled.opt.enableflags, compiled.opt.timestep) == (flags, 0.001)
