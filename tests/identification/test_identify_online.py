"""`stepper.sysid.Tracker`: what is known after every sample."""

import numpy as np
import pytest
import stepper
from checks import every, raises
from identification.online import NOISE, PERIOD, controls, readings
from identification.scenes import held
from stepper.sysid.problem import MAX_PREDICTIONS, Problem
from stepper.sysid.uncertainty import uncertainty

SCENE = held()
MODEL = SCENE.model(*SCENE.starts[0])


def test_a_held_box_is_weighed_at_once_and_its_friction_is_known_when_it_slips():
    """Held still, friction has a lower bound alone: what just holds. Shaken, it slips a second later."""
    ctrl, (mass, friction) = controls()[:110], (0.8, 0.45)
    clean = readings(np.full(200, mass), friction)
    rng = np.random.default_rng(0)
    tracker = stepper.sysid.Tracker(MODEL, list(SCENE.parameters), noise=NOISE, period=PERIOD)
    for k, row in enumerate(ctrl):
        now = tracker.update(row, {name: rows[k] + NOISE[name] * rng.standard_normal(rows.shape[1]) for name, rows in clean.items()})
        if k == 45:
            # The weight takes a friction of m g / (2 F) = 0.327.
            low, high = now.interval[1]
            assert now.determined.tolist() == [True, False]
            assert 0.2 < low < 0.327 * 1.05
            assert high > 1.0
            assert abs(now["body_mass[box]"] / mass - 1) < 0.02  # four standard deviations
    assert now.determined.all()
    # Four standard deviations of the mass, and of friction as `make identify IDENTIFY='--only online'` finds it just after a slip.
    assert abs(now["body_mass[box]"] / mass - 1) < 0.015
    assert abs(now["geom_friction[left,right,box][0]"] / friction - 1) < 0.05
    assert now.surprise < 4
    assert now.untrusted == 0
    drawn = tracker.sample(50)
    assert drawn["body_mass"].shape == (50, MODEL.nbody)
    assert abs(drawn["body_mass"][:, MODEL.body("box").id].mean() / mass - 1) < 0.02
    stepper.Stepper(MODEL, 50).randomize(**drawn)


@pytest.mark.parametrize(("start", "bounds"), [(0.5, (0.5, 2.0)), (1.5, (0.3, 1.5))])
def test_an_estimate_leaves_the_bound_that_it_begins_at(start, bounds):
    """There the slope is that of the side within bounds."""
    clean = readings(np.full(200, 0.8), 0.45)
    tracker = stepper.sysid.Tracker(
        SCENE.model(start, 0.6), [stepper.sysid.FitParameter("body_mass[box]", bounds=bounds)], noise=NOISE, period=PERIOD
    )
    for k, row in enumerate(controls()[:20]):
        now = tracker.update(row, {name: rows[k] for name, rows in clean.items()})
    # The readings are exact: a standard deviation of the mass after 20 samples of 0.3 N on a weight of 8 N, which the prior may still pull.
    assert now["body_mass[box]"] == pytest.approx(0.8, rel=0.01)
    assert now.interval[0, 0] < 0.8 < now.interval[0, 1]


def test_readings_that_are_absent_say_nothing():
    tracker = stepper.sysid.Tracker(MODEL, ["body_mass[box]"], noise=NOISE, period=PERIOD)
    now = tracker.update([0.0, 12.0, 12.0], {"wrist_force": [np.nan] * 3})
    np.testing.assert_allclose(now.values, 0.5, rtol=1e-9)
    assert now.covariance[0, 0] == pytest.approx(1.0)
    assert not now.determined[0]
    np.testing.assert_array_equal(now.interval, [[0.0, np.inf]])


def test_a_box_that_falls_takes_a_bounded_number_of_predictions(monkeypatch):
    """The box is too heavy for its friction. When it falls, its contacts take long to solve, and further hypotheses start."""
    counts = []
    predict = Problem.predict

    def counted(*args):
        counts[-1] += 1
        return predict(*args)

    monkeypatch.setattr(Problem, "predict", counted)
    rng = np.random.default_rng(4)
    mass, friction = 0.8 * np.exp(rng.uniform(-0.8, 0.8)), 0.45 * np.exp(rng.uniform(-0.3, 0.5))
    clean = readings(np.full(200, mass), friction)
    noisy = {name: rows + NOISE[name] * rng.standard_normal(rows.shape) for name, rows in clean.items()}
    tracker = stepper.sysid.Tracker(MODEL, list(SCENE.parameters), noise=NOISE, period=PERIOD)
    for k, row in enumerate(controls()[:18]):
        counts.append(0)
        now = tracker.update(row, {name: rows[k] for name, rows in noisy.items()})
        low, high = now.interval.T
        assert (np.isinf(high) == ~now.determined).all()
        assert ((low <= [mass, friction]) | now.determined).all()
    # Of four hypotheses, the last three take a prediction each when none is left.
    assert max(counts) <= MAX_PREDICTIONS + 3


def test_surprise_is_that_of_columns_with_noise():
    """Columns of infinite noise are not looked at: the mean square is that of the others, as if they had not been read."""
    row, force = controls()[0], [0.0, 0.0, 40.0]
    noise = {"wrist_force": [np.inf, np.inf, 0.3]}
    whole = stepper.sysid.Tracker(MODEL, ["body_mass[box]"], noise=noise, period=PERIOD).update(row, {"wrist_force": force})
    part = stepper.sysid.Tracker(MODEL, ["body_mass[box]"], noise=noise, period=PERIOD).update(row, {"wrist_force": [np.nan, np.nan, 40.0]})
    assert whole.surprise > 100  # of 30 N where noise is 0.3 N
    assert whole.surprise == part.surprise
    np.testing.assert_array_equal(whole.values, part.values)


@pytest.mark.parametrize(("change", "error", "message"), [
    ({"noise": {"wrist": 1.0}}, KeyError, "no sensor or coordinate is named 'wrist'"),
    ({"noise": {"wrist_force": 0.0}}, ValueError, "noise of 'wrist_force' is 0.0, must be above 0"),
    ({"noise": {}}, ValueError, "noise is empty"),
    ({"period": 0.0213}, ValueError, "must be a whole number of time steps"),
    ({"window": 0.01}, ValueError, "window is 0.01 s"),
    ({"period": 0.0}, ValueError, r"period \(s\) is 0.0, must be a finite number above 0"),
    ({"period": "fast"}, TypeError, r"period \(s\) is 'fast', must be a number"),
    ({"moving": 3}, TypeError, "moving is 3, must be a list of names of joints"),
    ({"noise": 0.3}, TypeError, "noise is 0.3, must be a dict such as"),
    ({"drift": -1.0}, ValueError, "drift is -1.0, must be standard deviations"),
    ({"drift": [0.0, 0.1]}, ValueError, r"drift has shape \(2,\), must be one number, or one for each of body_mass\[box\]"),
    ({"start_std": 1e-3}, ValueError, r"start_std has shape \(\), must be two numbers, of displacement"),
    ({"start_std": (1e-3, np.inf)}, ValueError, "start_std is .* finite and not negative"),
    ({"period": np.nan}, ValueError, r"period \(s\) is nan, must be a finite number above 0"),
    ({"window": np.nan}, ValueError, r"window \(s\) is nan, must be a finite number above 0"),
    ({"window": np.inf}, ValueError, r"window \(s\) is inf, must be a finite number above 0"),
    ({"qvel": 0.1}, ValueError, rf"qvel at the start has shape \(\), must be \({MODEL.nv},\)"),
    ({"qvel": np.zeros((3, MODEL.nv))}, ValueError, rf"qvel at the start has shape \(3, {MODEL.nv}\)"),
    ({"qpos": np.zeros(MODEL.nq + 1)}, ValueError, rf"qpos at the start has shape \({MODEL.nq + 1},\), must be \({MODEL.nq},\)"),
    ({"qpos": np.full(MODEL.nq, np.nan)}, ValueError, r"qpos\[0\] at the start is not finite"),
    ({"parameters": ["body_inertial[box]"]}, ValueError, r"body_inertial\[box\] cannot be followed sample by sample"),
    ({"parameters": ["actuator.delay[left]"]}, ValueError, "no actuator"),
])  # fmt: skip
def test_trackers_that_cannot_be(change, error, message):
    settings = {"parameters": ["body_mass[box]"], "noise": NOISE, "period": PERIOD} | change
    raises(error, message, lambda: stepper.sysid.Tracker(MODEL, settings.pop("parameters"), **settings))


def test_samples_that_do_not_fit():
    tracker = stepper.sysid.Tracker(MODEL, ["body_mass[box]"], noise=NOISE, period=PERIOD)
    raises(ValueError, r"ctrl has shape \(1,\), must be \(3,\)", tracker.update, [0.0], {})
    raises(KeyError, "no noise was given of channel 'torque'", tracker.update, np.zeros(3), {"torque": 1.0})
    raises(ValueError, r"'lift' has shape \(2,\), must be \(1,\)", tracker.update, np.zeros(3), {"lift": [1.0, 2.0]})


@every(spacing=[1, 11, 20], colour=[0.0, 0.8])
def test_intervals_of_a_line_under_coloured_noise(colour, spacing):
    """A regression on slow functions of time, whose covariance is known: J^T Gamma J; the sensor is read at every row, or at few."""
    T, count = 150, 200
    t = np.arange(T) / T
    J = np.stack([np.sin(7 * t), np.cos(5 * t) * t], axis=1)
    times = np.stack([np.zeros(T, int), 3 + spacing * np.arange(T), np.zeros(T, int)], axis=1)
    gamma = colour ** np.abs(np.arange(T)[:, None] - np.arange(T))
    inverse = np.linalg.inv(J.T @ J)
    exact = np.sqrt(np.diag(inverse @ J.T @ gamma @ J @ inverse))
    rng = np.random.default_rng(0)
    stds, inside = [], []
    for _ in range(count):
        noise = rng.standard_normal(T)
        for k in range(1, T):
            noise[k] = colour * noise[k - 1] + np.sqrt(1 - colour**2) * noise[k]
        error = inverse @ J.T @ noise
        std = np.sqrt(np.diag(uncertainty(J, noise - J @ error, times, np.full(2, 100.0)).covariance))
        stds.append(std)
        inside.append(np.abs(error) < 1.96 * std)
    # Of 400 intervals of 95 %, three standard deviations are 3 %; short series make those of coloured noise a little too narrow.
    assert np.mean(inside) > (0.92 if colour == 0 else 0.89)
    np.testing.assert_allclose(np.median(stds, axis=0), exact, rtol=0.15)
