"""Outcomes of settings beside those of the converged runs: intervals that hold what they promise."""

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.stats
import stepper
from stepper.lab.accuracy.dots import names, newcombe, shifts
from stepper.lab.accuracy.traces import run
from stepper.lab.study.intervals import student

HINGE = """<mujoco><worldbody><body><joint name="j" axis="0 1 0"/><geom size=".1" pos=".2 0 0"/></body></worldbody></mujoco>"""


def episodes(**values):
    """A run whose outcomes are given."""
    made = stepper.lab.Study.from_model(
        HINGE,
        seconds=0.04,
        controller=None,
        outcomes=(
            stepper.lab.Outcome(name="angle", measure="joint j", success=">= 0"),
            stepper.lab.Outcome(name="speed", measure="jointvel j"),
        ),
    )
    return made, replace(run(made, range(len(values["angle"]))), outcomes={name: np.array(own, float) for name, own in values.items()})


def test_an_interval_of_a_mean_is_scipys():
    values = [0.3, -0.1, 0.25, 0.9, 0.4]
    told = scipy.stats.ttest_1samp(values, 0.0).confidence_interval()
    assert student(values) == pytest.approx((told.low, told.high), rel=1e-9)
    with pytest.raises(ValueError, match="needs two"):
        student([1.0])


def test_an_interval_of_a_difference_of_shares_is_newcombes():
    # Of Wilson's intervals [0.5958, 0.9821] and [0.1078, 0.6032]: 0.6 less the hypotenuse of 0.3042 and 0.3032, and more that of 0.0821
    # and 0.1922.
    low, high = newcombe(9, 3, 10)
    assert (low, high) == pytest.approx((0.1705, 0.8090), abs=1e-3)
    assert newcombe(0, 0, 10) == pytest.approx((-0.2775, 0.2775), abs=1e-3)


def test_shifts_are_of_pairs_and_say_when_there_is_nothing_to_say():
    study, own = episodes(angle=[1.0, 2.0, 3.0, -4.0], speed=[1.0, 1.0, np.nan, 1.0])
    _, right = episodes(angle=[1.0, 1.0, 1.0, 1.0], speed=[0.0, 0.0, 0.0, 0.0])
    angle, speed, successes = shifts(study, own, right)
    assert [angle.name, speed.name, successes.name] == names(study) == ["mean angle", "mean speed", "successes"]
    assert (angle.value, angle.count) == (pytest.approx(-0.5), 4)
    assert (angle.low, angle.high) == pytest.approx(student([0.0, 1.0, 2.0, -5.0]))
    assert (speed.value, speed.count) == (1.0, 3)
    assert successes.value == -0.25
    assert successes.low < -0.25 < successes.high
    assert all(math.isnan(shift.value) for shift in shifts(study, replace(own, stopped=True), right))
    assert shifts(study, replace(own, stopped=True), right)[0].words == "-"
