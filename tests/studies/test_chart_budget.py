"""A chart that has little time: runs that end, rows that say so, a reference that is known less well."""

import itertools
import math
import sys
import time
from dataclasses import replace

import matplotlib.figure
import numpy as np
import pytest
import stepper
from stepper.lab.accuracy import measure as measured
from stepper.lab.accuracy.budget import Budget, Stage
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


def test_other_load_of_the_machine_spends_no_budget(monkeypatch):
    """The wall clock goes on by an hour whenever it is read, as if the process did not run."""
    hours = itertools.count()
    for name in ("time", "monotonic", "perf_counter"):
        monkeypatch.setattr(time, name, lambda: 3600.0 * next(hours))
    budget = Budget.from_seconds(100.0)
    assert budget.stage(0.5).left > 0
    assert not run(ball(), range(2), stage=budget.stage(0.5)).stopped


def ball(**changed):
    return stepper.lab.Study.from_model(BALL, name="ball", seconds=0.2, qvel_noise=0.1, controller=None, **changed)


def test_a_run_that_the_clock_stops_has_what_it_saw(clock):
    study = ball()
    whole = run(study, range(2))
    # Between steps the clock goes on by a tenth: the end comes after some controls of four steps each.
    part = run(study, range(2), stage=Stage(clock.now + 2.5))
    assert part.stopped
    assert not whole.stopped
    assert 0 < len(part.time) < len(whole.time)
    np.testing.assert_array_equal(part.points, whole.points[: len(part.time)])
    assert part.finite.all()
    early, late = Distance("m", part.reached), Distance("m", 0.2)
    np.testing.assert_array_equal(early(part, whole), 0.0)
    assert np.isnan(late(part, whole)).all()


def test_steps_one_by_one_are_those_of_a_control(clock):
    """A run with a clock looks at it between steps, and is the same to the bit."""
    study = ball()
    np.testing.assert_array_equal(run(study, range(2), stage=Stage(clock.now + 1e6)).points, run(study, range(2)).points)


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


def test_a_reference_with_little_time_says_how_well_it_is_known(clock):
    study, distance = ball(), Distance("m", 0.2)
    free = converge(study, range(2), distance, target=1e-12, most=6)
    assert not free.stopped
    short = converge(study, range(2), distance, target=1e-12, most=6, stage=Stage(clock.now + 60.0))
    assert short.stopped
    assert short.timestep > free.timestep
    assert "stopped by the time budget" in short.words
    # A single run says nothing of how well it is known.
    single = converge(study, range(2), distance, target=1e-12, most=6, stage=Stage(clock.now + 4.0))
    assert len(single.runs) == 1
    assert np.isinf(single.uncertainty).all()
    with pytest.raises(ValueError, match=r"took more than 40% of the time for it; give more time with --budget"):
        converge(study, range(2), distance, target=1e-12, most=6, stage=Stage(clock.now))


def test_rows_say_what_was_stopped_and_what_was_not_run(clock):
    study = replace(ball(), threads=1)
    distance = Distance("m", 0.1)
    right = converge(study, range(2), distance, target=1e-3, most=2)
    other = replace(MIDPOINT, name="f32", settings=MIDPOINT.settings | {"precision": "f32"})
    found, skipped, _ = measure(
        ChartBasis(study, range(2), distance, right, 2, Budget(120.0, clock.now)),
        [MIDPOINT, other],
        [0.005, 0.0025, 0.001],
        lambda *_: None,
    )
    assert not skipped
    assert len(found) == 6
    notes = [" ".join(point.notes) for point in found]
    assert any("stopped after" in note for note in notes)
    # The longest time steps are run first, and leave time to the others.
    assert any(np.isfinite(point.errors["total"]).all() for point in found)
    for point, note in zip(found, notes, strict=True):
        # A number, or the reason why there is none.
        assert np.isfinite(point.errors["total"]).all() or note
        assert np.isfinite(point.errors["solver"]).all() or note


def test_a_chart_of_little_time_is_written(tmp_path, monkeypatch):
    """The clock jumps ahead when the runs begin, so that the reference alone is whole."""
    real, begun = time.process_time, measured.measure

    def late(*given):
        monkeypatch.setattr(time, "process_time", lambda: real() + 3600.0)
        return begun(*given)

    monkeypatch.setattr(sys.modules["stepper.lab.accuracy.chart"], "measure", late)
    found = stepper.lab.chart(ball(), tmp_path, quick=True, episodes=2, horizon=0.1, budget="1800 s")
    assert {dot.notes[0] for dot in found.dots} == {"not run: the budget of 1800 s was spent before"}
    page = (tmp_path / "ball/chart.html").read_text()
    assert "the budget of 1800 s was spent before" in page
    assert ">nan<" not in page


def test_labels_of_a_chart_are_no_wider_than_their_panels(tmp_path, monkeypatch):
    save, found = matplotlib.figure.Figure.savefig, []

    def look(figure, path, **settings):
        save(figure, path, **settings)
        if not found:
            for panel in figure.axes[:2]:
                label, frame = panel.xaxis.label.get_window_extent(), panel.get_window_extent()
                found.append((label.x0 - frame.x0, frame.x1 - label.x1))

    monkeypatch.setattr(matplotlib.figure.Figure, "savefig", look)
    stepper.lab.chart(ball(), tmp_path, quick=True, episodes=2, horizon=0.1, budget="20 s")
    assert min(margin for pair in found for margin in pair) >= 0


@pytest.mark.parametrize("wrong", ["5", 0, "1 m", math.inf])
def test_a_wrong_budget_is_named(tmp_path, wrong):
    with pytest.raises(ValueError, match=r"budget is .*, must be a number above 0 with a unit"):
        stepper.lab.chart(ball(), tmp_path, budget=wrong)


def test_rows_without_time_for_invariants_and_costs_say_so(tmp_path, monkeypatch):
    """The clock jumps ahead when all is run."""
    real, made = time.process_time, sys.modules["stepper.lab.accuracy.chart"].Invariants

    def late(study):
        monkeypatch.setattr(time, "process_time", lambda: real() + 3600.0)
        return made(study)

    monkeypatch.setattr(sys.modules["stepper.lab.accuracy.chart"], "Invariants", late)
    found = stepper.lab.chart(ball(), tmp_path, quick=True, episodes=1, horizon=0.1, budget="1800 s")
    assert {dot.notes for dot in found.dots} == {("invariants: the budget was spent before", "costs: the budget was spent before")}
    assert all(math.isfinite(dot.error) and math.isnan(dot.us_single_env) for dot in found.dots)
    assert "invariants: the budget was spent before" in (tmp_path / "ball/chart.csv").read_text()
