"""Runs that take too long or are not finite: what they have seen counts, and their rows say why they ended."""

import math
import time
from dataclasses import replace

import matplotlib.figure
import numpy as np
import pytest
import stepper
from stepper.lab.accuracy import measure as measured
from stepper.lab.accuracy.candidates import Line
from stepper.lab.accuracy.measure import ChartBasis, measure
from stepper.lab.accuracy.reference import converge
from stepper.lab.accuracy.traces import Distance, run

BALL = """<mujoco><option timestep=".005"/><worldbody><geom type="plane" size="9 9 1"/>
  <body name="ball" pos="0 0 .12"><freejoint/><geom size=".1"/></body></worldbody></mujoco>"""
MIDPOINT = Line("stepper", "midpoint", {"contact": "hard", "integrator": "midpoint"}, "hard")


class Clock:
    """A clock that goes on by a tenth of a second whenever it is read."""

    def __init__(self):
        self.now = 1000.0

    def time(self):
        self.now += 0.1
        return self.now


@pytest.fixture
def clock(monkeypatch):
    made = Clock()
    monkeypatch.setattr(time, "process_time", made.time)
    return made


def ball(**changed):
    return stepper.lab.Study.from_model(BALL, name="ball", seconds=0.2, qvel_noise=0.1, controller=None, **changed)


def test_a_run_that_the_clock_stops_has_what_it_saw(clock):
    study = ball()
    whole = run(study, range(2))
    # Between steps the clock goes on by a tenth: the end comes after some controls of four steps each.
    part = run(study, range(2), patience=2.5)
    assert part.stopped
    assert not whole.stopped
    assert 0 < len(part.time) < len(whole.time)
    np.testing.assert_array_equal(part.points, whole.points[: len(part.time)])
    assert part.finite.all()
    early, late = Distance("m", part.reached), Distance("m", 0.2)
    np.testing.assert_array_equal(early(part, whole), 0.0)
    assert np.isnan(late(part, whole)).all()


def test_steps_one_by_one_are_those_of_a_control():
    """A run with a limit looks at the clock between steps, and is the same to the bit."""
    np.testing.assert_array_equal(run(ball(), range(2), patience=1e6).points, run(ball(), range(2)).points)


def test_what_is_run_for_its_beginning_alone_has_no_outcome():
    study = ball(outcomes=stepper.lab.Outcome(name="height", measure="body ball z"))
    part = run(study, range(2), until=0.1)
    assert part.reached == pytest.approx(0.1)
    assert not part.stopped
    assert np.isnan(part.outcomes["height"]).all()


def test_an_episode_that_is_not_finite_is_over(tmp_path):
    """A servo of negative stiffness: numbers grow until there are none."""
    wild = """<mujoco><option timestep=".02" integrator="Euler"/><worldbody><body><joint name="j"/><geom size=".1" pos=".1 0 0"/></body>
      <body pos="3 0 0"><joint name="k"/><geom size=".1" pos=".1 0 0"/></body></worldbody>
      <actuator><general joint="j" biastype="affine" biasprm="0 1e7 1e6"/></actuator></mujoco>"""
    study = stepper.lab.Study.from_model(
        wild,
        seconds=1.0,
        controller=None,
        qvel_noise=0.0,
        # The first episode begins at the joint's zero, where nothing grows.
        start=lambda now, rng: (np.array([[0.0, 0.1], [0.1, 0.1]]), np.zeros((2, 2))),
        outcomes=stepper.lab.Outcome(name="other", measure="joint k", success=">= -9"),
    )
    for engine in ("stepper", "mujoco"):
        settings = {"integrator": "euler"} | ({"engine": engine} if engine == "mujoco" else {})
        trace = run(study, range(2), **settings)
        assert trace.finite.tolist() == [True, False]
        assert not trace.stopped
        # What the engine does with the other joint after that, a reset say, is no success.
        assert np.isfinite(trace.outcomes["other"]).tolist() == [True, False]
        assert Distance("m", 1.0)(trace, trace).tolist() == [0.0, math.inf]


def test_rows_say_what_was_stopped(monkeypatch):
    """Short time steps take more than the limit; the row then has the reason in place of a number."""
    study, distance = replace(ball(), threads=1), Distance("m", 0.1)
    right = converge(study, range(2), distance, target=1e-3, most=2)
    monkeypatch.setattr(measured, "patience", lambda study, of, timestep, **_: 0.0 if timestep < 0.005 else math.inf)
    found, skipped, _ = measure(ChartBasis(study, range(2), distance, right, 2), [MIDPOINT], [0.005, 0.0025, 0.001], lambda *_: None)
    assert not skipped
    assert [any("stopped after" in note for note in point.notes) for point in found] == [False, True, True]
    assert [bool(np.isfinite(point.errors["total"]).all()) for point in found] == [True, False, False]


def test_labels_of_a_chart_are_no_wider_than_their_panels(tmp_path, monkeypatch):
    save, found = matplotlib.figure.Figure.savefig, []

    def look(figure, path, **settings):
        save(figure, path, **settings)
        if not found:
            for panel in figure.axes[:2]:
                label, frame = panel.xaxis.label.get_window_extent(), panel.get_window_extent()
                found.append((label.x0 - frame.x0, frame.x1 - label.x1))

    monkeypatch.setattr(matplotlib.figure.Figure, "savefig", look)
    stepper.lab.chart(ball(), tmp_path, quick=True, episodes=2, horizon=0.1)
    assert min(margin for pair in found for margin in pair) >= 0
