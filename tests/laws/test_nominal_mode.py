"""Gradients at kinks and jumps are slopes of the nominal mode, or errors that say where."""

from collections import Counter

import numpy as np
import pytest
import stepper
from rollout_gradients import LAWS, Judged, bodies_on_a_floor, judge
from stepper import Options
from stepper.derivatives import Kink, Smoothing, UndeterminedDerivative, rollout
from stepper.derivatives.kinks import RowGroup
from stepper.derivatives.nominal_mode import WIDTH_RATIO, WIDTHS, Readings, slopes_of

PUSHED_BOX = """<mujoco><option timestep="0.01"/><worldbody><geom type="plane" size="3 3 1" friction=".4 0 0"/>
  <body pos="-.12 0 .05"><joint name="f" type="slide" axis="1 0 0" damping="3"/><geom size=".03" mass=".4" friction=".4 0 0"/></body>
  <body pos="0 0 .06"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/><joint name="turn" axis="0 1 0"/>
  <geom type="box" size=".06 .06 .06" mass=".6" friction=".4 0 0"/></body></worldbody><actuator><motor joint="f"/></actuator></mujoco>"""
"""A finger pushes a box that just touches the floor, at a distance of exactly 0."""


def last(made: stepper.derivatives.Rollout, place: int) -> np.ndarray:
    """Gradient of one number of the last configuration."""
    gradient = np.zeros_like(made.qpos)
    gradient[-1].reshape(-1)[place] = 1.0
    return gradient


def by_differences(model: stepper.Model, ctrl: np.ndarray, options: Options, width: float) -> float:
    """Derivative of where the box is in the end by the first control."""
    ends = []
    for sign in (1, -1):
        sim = stepper.Stepper(model, options=Options(**{**vars(options), "tolerance": 1e-13}))
        moved = ctrl.copy()
        moved[0] += sign * width
        ends.append(sim.rollout(moved, 2, fields=["qpos"])["qpos"][-1, 1])
    return (ends[0] - ends[1]) / (2 * width)


@pytest.mark.parametrize("method", ["fd", "implicit"])
def test_the_push_of_a_box_that_just_touches_the_floor(method):
    model, ctrl, options = stepper.load(PUSHED_BOX), np.full((40, 1), 2.0), Options(contact="mujoco")
    made = rollout(stepper.Stepper(model, options=options), ctrl, 2)
    found = made.vjp(qpos=last(made, 1), method=method)
    assert found.near_kink.any()
    for width in (1e-2, 1e-3, 1e-4):
        # The differences of three widths agree to 1e-5; a rollout to a tolerance of 1e-6 differs from theirs by 1e-3 of that.
        assert found.ctrl[0, 0] == pytest.approx(by_differences(model, ctrl, options, width), rel=1e-3)


def test_a_parameter_takes_nothing_from_the_other_columns():
    model, ctrl = stepper.load(PUSHED_BOX), np.full((40, 1), 2.0)
    sim = stepper.Stepper(model, options=Options(contact="mujoco"))
    alone, both = (rollout(sim, ctrl, 2, parameters=names) for names in ((), ("body_mass",)))
    gradient = last(alone, 1)
    found = both.vjp(qpos=gradient)
    np.testing.assert_array_equal(found.ctrl, alone.vjp(qpos=gradient).ctrl)
    h, ends = 1e-4, []
    for factor in (1 + h, 1 - h):
        other = stepper.Stepper(model, options=Options(contact="mujoco", tolerance=1e-13))
        other.randomize(body_mass=np.asarray(model.body_mass) * factor)
        ends.append(other.rollout(ctrl, 2, fields=["qpos"])["qpos"][-1, 1])
    # As above; differences of masses are relative ones, whose truncation is 1e-8.
    assert found.parameters["body_mass"] @ np.asarray(model.body_mass) == pytest.approx((ends[0] - ends[1]) / (2 * h), rel=1e-3)


@pytest.mark.parametrize("law", list(LAWS))
def test_gradients_of_random_contact_scenes_agree_with_differences_of_whole_rollouts(law):
    judged = Judged(Counter(), [])
    for seed in range(12):
        judge(bodies_on_a_floor(seed, LAWS[law], steps=10), seed, judged)
    rows = [judged.row(kind) for kind in ("no kink", "near a kink")]
    _, known, good, wrong = np.sum(rows, axis=0)
    assert wrong == 0, judged.worst
    # Differences of an hundredth are agreement, and one derivative in a hundred may differ, as docs/how-to/derivatives.md says.
    assert good >= 0.99 * known, judged.worst
    # Nor is it an answer to refuse all: differences judge most derivatives.
    assert known > 0.5 * sum(judged.counts.values()), judged.counts


WIDTH = 1e-6 * WIDTH_RATIO ** np.arange(WIDTHS)


def read(function, differs=lambda x: np.zeros_like(x, bool)):
    """Slopes of a function of one number, of which `differs` says where it is in another mode than at 0."""
    offsets = np.stack([WIDTH, -WIDTH])[None]
    slopes = (np.vectorize(function)(offsets) - function(0.0)) / offsets
    out, nominal, other = slopes_of(Readings(slopes[..., None], differs(offsets), np.array([1e-15])), offsets, [RowGroup(slice(0, 1))])
    return out[0, 0], bool(nominal[0]), bool(other[0])


@pytest.mark.parametrize("place", [1e-7, -1e-7, 1e-12, -1e-12])
@pytest.mark.parametrize("jump", [0.0, 1.0])
def test_the_slope_on_the_side_of_the_nominal_point_is_found(place, jump):
    def function(x):
        return 2.0 * x if (x - place) * place < 0.0 else jump + 2.0 * place - 5.0 * (x - place)

    # To the rounding of a slope over the narrowest width.
    assert read(function, lambda x: (x - place) * place > 0.0) == (pytest.approx(2.0, abs=1e-6), True, False)


def test_a_switch_without_effect_and_strong_curvature_are_no_kinks():
    assert read(lambda x: 3.0 * x, lambda x: x != 0.0) == (pytest.approx(3.0), False, True)
    # Twice the curvature from which on slopes on both sides count as different.
    assert read(lambda x: 3.0 * x + 3e4 * x * x) == (pytest.approx(3.0), True, False)


def test_a_jump_on_both_sides_has_no_slope():
    assert read(lambda x: float(x != 0.0), lambda x: x != 0.0)[1:] == (False, False)
    assert read(np.sign, lambda x: x != 0.0)[1:] == (False, False)


def test_a_kink_without_a_slope_says_where():
    # Runge and Kutta's method has no derivative at the modes, and a turn either way lets a corner touch.
    model = stepper.load(PUSHED_BOX)
    sim = stepper.Stepper(model, 2, options=Options(contact="mujoco", integrator="rk4"))
    sim.set_state([[0, 0, 0.01, 0], [0, 0, 0, 0]])
    lin = sim.linearize(ctrl=[2.0])
    assert lin.undetermined.tolist() == [False, True]
    assert Kink(int(lin.kinks["qpos"][1, 3])) & Kink.UNDETERMINED
    assert not lin.A[1, :, 3].any()
    made = rollout(sim, np.full((3, 2, 1), 2.0), 2)
    gradient = np.ones_like(made.qpos)
    with pytest.raises(UndeterminedDerivative, match=r"control 0 .* qpos\[\d\] .*environment 1.*CONTACT") as caught:
        made.vjp(qpos=gradient)
    assert (caught.value.env, caught.value.control) == (1, 0)
    found = made.vjp(qpos=gradient, undetermined="zero")
    assert found.undetermined.tolist() == [False, True]
    assert not found.ctrl[:, 1].any() and not found.qpos[1].any()
    alone = stepper.Stepper(model, 1, options=sim.options)
    alone.set_state([[0, 0, 0.01, 0]])
    np.testing.assert_array_equal(found.ctrl[:, :1], rollout(alone, np.full((3, 1, 1), 2.0), 2).vjp(qpos=gradient[:, :1]).ctrl)
    assert not made.vjp(qpos=gradient, smoothing=Smoothing(samples=4, qpos=1e-4)).undetermined.any()
    with pytest.raises(ValueError, match="undetermined is 'skip'"):
        made.vjp(qpos=gradient, undetermined="skip")
