"""Derivatives at the modes of the solution: beside extrapolated differences of whole steps, and closed forms."""

import numpy as np
import pytest
import stepper
from checks import every
from hypothesis import given, strategies as st
from numerics import NOISE, joined, touching
from stepper.derivatives import Kink

G, H = 9.81, 0.002
SETTINGS = {
    "hard": {"integrator": "euler", "stabilization": "baumgarte", "baumgarte": 1.0, "slop": 0.0},
    "hard, no correction": {"integrator": "euler", "stabilization": "none"},
    "hard, implicit rule": {"integrator": "implicit", "stabilization": "baumgarte", "baumgarte": 1.0, "slop": 0.0},
    "hard, midpoint": {"integrator": "midpoint", "stabilization": "baumgarte", "baumgarte": 1.0, "slop": 0.0},
    "split, Euler": {"integrator": "euler"},
    "split, implicit rule": {"integrator": "implicit"},
    "split, midpoint": {},
    "mujoco, Euler": {"contact": "mujoco", "integrator": "euler"},
    "mujoco, implicitfast": {"contact": "mujoco", "integrator": "implicitfast"},
}
SPLIT = [law for law in SETTINGS if law.startswith("split")]
ROBOTS = ["gymnasium/ant", "gymnasium/half_cheetah", "gymnasium/hopper", "gymnasium/humanoid", "gymnasium/walker2d_v5"]
ROBOTS += ["dm_control/cheetah", "dm_control/hopper", "dm_control/quadruped", "dm_control/walker"]
BALL = '<body pos="0 0 .1">{joints}<geom type="sphere" size=".1" mass="2" friction=".4 0 0"/></body>'
SLIDES = "".join(
    f'<joint name="{axis}" type="slide" axis="{numbers}"/>' for axis, numbers in zip("xyz", ("1 0 0", "0 1 0", "0 0 1"), strict=True)
)
PUSHED = '<actuator><motor joint="x"/><motor joint="z"/></actuator>'
LOOP = (
    '<body pos="0 0 1"><joint axis="0 1 0"/>{rod}<body pos="0 0 -.4"><joint axis="0 1 0"/>{bar}'
    '<body name="tip" pos=".4 0 0"><geom size=".01" mass=".1" contype="0"/></body></body></body>'
    '<body name="other" pos=".4 0 1"><joint axis="0 1 0"/>{rod}</body>'
).format(
    rod='<geom type="capsule" size=".02" fromto="0 0 0 0 0 -.4" mass=".5" contype="0"/>',
    bar='<geom type="capsule" size=".02" fromto="0 0 0 .4 0 0" mass=".5" contype="0"/>',
)


def scene(body: str, *, more: str = "", floor: str = "") -> stepper.Model:
    ground = f'<geom name="floor" type="plane" size="9 9 1" {floor}/>'
    return stepper.load(f'<mujoco><option timestep="{H}"/><worldbody>{ground}{body}</worldbody>{more}</mujoco>')


def simulation(model: stepper.Model, num_envs: int | None = 3, law: str = "hard", **more) -> stepper.Stepper:
    return stepper.Stepper(model, num_envs, options=stepper.Options(**(SETTINGS[law] | more)))


def apart(one: stepper.derivatives.Linearization, two: stepper.derivatives.Linearization, nv: int) -> np.ndarray:
    """Largest difference of every column, (num_envs, columns), relative to its largest entry among rows of a kind."""
    a, b = joined(one.blocks), joined(two.blocks)
    groups = [slice(0, nv), slice(nv, None)]
    return np.max([np.abs(a - b)[:, g].max(axis=1) / np.maximum(np.abs(b[:, g]).max(axis=1), 1.0) for g in groups], axis=0)


@every(law=list(SETTINGS), robot=ROBOTS)
def test_implicit_derivatives_are_those_of_extrapolated_differences(robot, law):
    sim, ctrl = touching(robot, **SETTINGS[law])
    own = sim.linearize(ctrl=ctrl, method="implicit")
    differences = sim.linearize(ctrl=ctrl, extrapolate=True)
    assert own.implicit.mean() > 0.5
    np.testing.assert_array_equal(own.qvel, differences.qvel)
    off = apart(own, differences, sim.model.nv)
    noise = joined(differences.errors).max(axis=1)
    # Differences do not see that a contact begins or ceases to be damped in the correction of positions.
    smooth = (joined(differences.kinks) == 0) & (joined(own.kinks) == 0) & own.implicit[:, None]
    assert smooth.mean() > 0.3
    # To 1e-6 of a column's largest entry, or to what the differences say of themselves.
    good = (off < 1e-6) | (off < noise)
    assert good[smooth].mean() > 0.99, np.sort(off[smooth & ~good])[-5:]
    assert np.median(off[smooth]) < 1e-7


@pytest.mark.parametrize("robot", ROBOTS)
def test_differences_without_a_kink_do_not_depend_on_their_width(robot):
    """Positions of the quadruped jump by up to 1e-8 m where equalities push a foot, which is as much as their differences by velocities."""
    sim, ctrl = touching(robot, **SETTINGS["split, midpoint"])
    wide = sim.linearize(ctrl=ctrl)
    narrow = sim.linearize(ctrl=ctrl, step=0.5 * wide.step)
    smooth = joined(wide.kinks) == 0
    for rows in (slice(0, sim.model.nv), slice(sim.model.nv, None)):
        a, b = (joined(lin.blocks)[:, rows] for lin in (wide, narrow))
        # To 2 % of a column's largest entry, as gradients of rollouts are judged, or to rounding of numbers of 50 over half the width.
        close = 0.02 * np.abs(a).max(axis=1) + 10 * NOISE
        assert (np.abs(a - b).max(axis=1) < close)[smooth].all()


def sliding(num_envs: int | None = 3) -> stepper.Stepper:
    """A ball that cannot turn, on the floor: one contact, with the friction of the floor."""
    return simulation(scene(BALL.format(joints=SLIDES), floor='friction=".4 0 0"', more=PUSHED), num_envs)


@given(st.floats(0.05, 5.0), st.floats(-3.1, 3.1), st.floats(-10.0, 15.0))
def test_a_sliding_contact_in_closed_form(speed, heading, push):
    sim, mu, m = sliding(1), 0.4, 2.0
    along = np.array([np.cos(heading), np.sin(heading)])
    sim.set_state(qvel=[[*(speed * along), 0.0]])
    lin = sim.linearize(ctrl=[[0.0, -push]], method="implicit")
    assert lin.implicit.all()
    # v+ = v - mu N h v+ / (m |v+|): the direction stays, so that v turns by less than its friction takes of it.
    lost = mu * (m * G + push) * H / m
    across = np.eye(2) - np.outer(along, along)
    if speed < 2 * lost + 1e-3:
        return
    np.testing.assert_allclose(lin.A[0, 3:5, 3:5], np.outer(along, along) + across * (1 - lost / speed), atol=10 * NOISE)
    # Pushed down by one newton more, it loses mu h / m more; an overlap is pushed out within the step, and that costs mu times as much.
    np.testing.assert_allclose(lin.B[0, 3:5, 1], mu * H / m * along, atol=NOISE)
    np.testing.assert_allclose(lin.A[0, 5, 2], -1 / H, rtol=1e-8)
    np.testing.assert_allclose(lin.A[0, 3:5, 2], mu / H * along, rtol=1e-6, atol=1e-5)
    assert not lin.A[0, 5, 3:].any() or np.abs(lin.A[0, 5, 3:]).max() < NOISE


def test_a_contact_that_sticks_lets_nothing_through():
    sim = sliding()
    sim.step(nstep=5)
    lin = sim.linearize(ctrl=[3.0, 0.0], method="implicit")
    assert lin.implicit.all()
    assert not lin.near_kink.any()
    np.testing.assert_allclose(lin.A[:, 3:, 3:], 0, atol=NOISE)
    np.testing.assert_allclose(lin.B[:, 3:], 0, atol=NOISE)


def test_a_push_at_the_bound_of_friction_is_near_a_kink():
    sim, bound = sliding(), 0.4 * 2 * G
    sim.step(nstep=5)
    # The change of the velocity by this much force is less than the displacement of a velocity by its width.
    lin = sim.linearize(("qvel", "ctrl"), ctrl=[[0.5 * bound, 0.0], [bound * (1 - 1e-9), 0.0], [2 * bound, 0.0]], method="implicit")
    assert lin.near_kink.tolist() == [False, True, False]
    assert lin.kinks["ctrl"][1, 0] == Kink.SLIP
    assert lin.kink_distance[0] > 1 > lin.kink_distance[1]


def test_loads_that_are_shared_matter_where_a_patch_turns():
    box = '<body pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" mass="2" friction=".4 0 0"/></body>'
    sim = simulation(scene(box, floor='friction=".4 0 0"'), 3)
    sim.step(nstep=20)
    # At rest, sliding along a line, and sliding while it turns: twelve rows of six directions.
    sim.set_state(qvel=np.array([[0, 0, 0, 0, 0, 0], [1.0, 0.3, 0, 0, 0, 0], [1.0, 0.3, 0, 0, 0, 2.0]]))
    own, differences = sim.linearize(method="implicit"), sim.linearize()
    assert own.implicit.tolist() == [True, True, False]
    assert not differences.implicit.any()
    np.testing.assert_array_equal(own.A[2], differences.A[2])
    # Along the directions in which nothing of it is lifted: shifts and turns in the plane.
    flat = [0, 1, 6, 7]
    np.testing.assert_allclose(own.A[:2][:, :, flat], differences.A[:2][:, :, flat], atol=1e-6)


@pytest.mark.parametrize("law", ["hard, implicit rule", "hard, midpoint"])
def test_a_ball_that_slips_on_a_body_which_turns(law):
    # How the velocity of a contact of two bodies changes as it moves on is bounded along each tangent: rows demand what depends on these.
    # At 30 rad/s the bound holds in some contacts; with tangents that are not those of the step columns are off by 1e-2.
    table = '<body pos="0 0 1"><freejoint/><geom type="box" size=".3 .4 .1" mass="5" friction=".3 0 0"/></body>'
    ball = '<body pos="0 0 1.2"><freejoint/><geom type="sphere" size=".1" mass="1" friction=".3 0 0"/></body>'
    model, rng = scene(table + ball), np.random.default_rng(4)
    sim = simulation(model, 16, law)
    sim.set_state(qvel=rng.normal(size=(16, 12)) * [1, 1, 0, 30, 30, 30, 1, 1, -1, 30, 30, 30] - [0, 0, 0, 0, 0, 0, 0, 0, 2, 0, 0, 0])
    sim.step(nstep=3)
    own, differences = sim.linearize(method="implicit"), sim.linearize(extrapolate=True)
    smooth = (joined(differences.kinks) == 0) & own.implicit[:, None]
    off = apart(own, differences, 12)
    assert own.implicit.mean() > 0.5
    assert smooth.mean() > 0.5
    assert off[smooth].max() < 1e-6


def compared(sim: stepper.Stepper, **more) -> tuple[stepper.derivatives.Linearization, np.ndarray]:
    """The derivatives at the modes, and how far columns away from kinks are from differences beyond their own error and 1e-6."""
    own, differences = sim.linearize(method="implicit", **more), sim.linearize(extrapolate=True, **more)
    smooth = (joined(differences.kinks) == 0) & (joined(own.kinks) == 0) & own.implicit[:, None]
    off = apart(own, differences, sim.model.nv)
    return own, np.where(off < np.maximum(joined(differences.errors).max(axis=1), 1e-6), 0.0, off)[smooth]


@pytest.mark.parametrize("speed", [0.1, 10.0])
def test_an_overlap_that_is_corrected_in_closed_form(speed):
    # z+ = z + h c G / (G + R), c = w s / |(w, s)| of the overlap's share w = beta (overlap - slop) / h and the fastest correction s,
    # G = 1 / m, R = (1e-3 + c h / 0.1 m) (G + 1 / m): the damping of docs/development/decisions/stabilisation.md.
    model = scene(BALL.format(joints=SLIDES), floor='friction=".4 0 0"', more=PUSHED)
    sim = simulation(model, 6, "split, Euler", max_correction_speed=speed)
    beta, slop = sim.options.baumgarte, sim.options.slop

    def after(z: np.ndarray) -> np.ndarray:
        w = beta * (0.1 - z - slop) / H
        c = w * speed / np.hypot(w, speed)
        return z + H * c / (1 + 2 * (1e-3 + c * H / 0.1))

    depth = np.array([2e-5, 1e-4, 1e-3, 3e-3, 1e-2, 2e-2])
    sim.set_state(np.c_[np.zeros((6, 2)), -depth], np.zeros((6, 3)))
    own, off = compared(sim)
    assert own.implicit.all()
    assert not own.near_kink.any()
    assert not off.any()
    np.testing.assert_allclose(0.1 + own.qpos[:, 2], after(0.1 - depth), atol=1e-12)
    slope = (after(0.1 - depth + 1e-6) - after(0.1 - depth - 1e-6)) / 2e-6
    np.testing.assert_allclose(own.A[:, 2, 2], slope, rtol=1e-7)
    # What positions are moved by is no velocity.
    np.testing.assert_allclose(own.A[:, 3:, 2], 0, atol=NOISE)


@pytest.mark.parametrize("law", SPLIT)
def test_balls_that_overlap_roll_and_touch_one_another(law):
    ball = '<body pos="{} 0 .1"><freejoint/><geom type="sphere" size=".1" mass="2" condim="6" friction=".4 .01 .005"/></body>'
    model, rng = scene(ball.format(0) + ball.format(0.15), floor='condim="6" friction=".4 .01 .005"'), np.random.default_rng(0)
    sim = simulation(model, 16, law)
    qpos = np.tile([0, 0, 0.1, 1, 0, 0, 0, 0.1995, 0, 0.1, 1, 0, 0, 0], (16, 1))
    qpos[:, [2, 9]] -= rng.uniform(0, 1e-3, (16, 2))
    sim.set_state(qpos, 0.3 * rng.normal(size=(16, 12)))
    own, off = compared(sim)
    assert own.implicit.mean() > 0.8
    assert off.size > 200
    assert not off.any()


@every(law=SPLIT, wrong=[0.0, 1e-2])
def test_a_loop_is_closed_beside_a_state_in_which_it_is(law, wrong):
    # Where the loop's error is none the step corrects nothing, and beside it all of the error: the derivative has the correction.
    rng = np.random.default_rng(0)
    sim = simulation(scene(LOOP, more='<equality><connect body1="other" body2="tip" anchor="0 0 -.4"/></equality>'), 8, law)
    turned = rng.uniform(-1, 1, (8, 1)) * [1, -1, 1] + wrong * rng.uniform(-1, 1, (8, 3))
    sim.set_state(turned, rng.normal(size=(8, 1)) * [1, -1, 1])
    own, off = compared(sim)
    assert own.implicit.all()
    assert off.size > 30
    assert not off.any()
    assert np.abs(own.A[:, :3, :3] - np.eye(3)).max() > 0.05


def test_a_correction_at_its_bound_is_taken_by_differences():
    # A slide that begins far outside of its range comes back at the 5 m/s that bound a correction of the default 1 m/s.
    slide = '<body pos="0 0 2"><joint type="slide" axis="0 0 1" limited="true" range="-.1 .1"/><geom size=".1" mass="1"/></body>'
    sim = simulation(scene(slide), 2, "split, Euler")
    sim.set_state([[-0.11], [-0.6]], np.zeros((2, 1)))
    own, differences = sim.linearize(method="implicit"), sim.linearize()
    assert own.implicit.tolist() == [True, False]
    np.testing.assert_allclose(own.A, differences.A, atol=1e-6)


@pytest.mark.parametrize("law", SPLIT)
def test_loads_that_are_shared_move_nothing_in_the_correction(law):
    # Impulses of four corners are not unique, and damping counts from them.
    box = '<body pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" mass="2" friction=".4 0 0"/></body>'
    sim, rng = simulation(scene(box, floor='friction=".4 0 0"'), 8, law), np.random.default_rng(0)
    qpos, qvel = np.tile([0, 0, 0.0995, 1, 0, 0, 0], (8, 1)), np.zeros((8, 6))
    qpos[:, 2] -= rng.uniform(0, 1e-3, 8)
    qvel[:4, :2], qvel[4:, 0], qvel[4:, 5] = [1.0, 0.3], 1.0, 2.0
    sim.set_state(qpos, qvel)
    own, off = compared(sim)
    assert own.implicit.tolist() == [True] * 4 + [False] * 4
    assert off.size > 40
    assert not off.any()


def test_damping_of_what_corrects_nothing_is_not_decided_by_rounding():
    # A foot that does not overlap demands of positions what it demands of velocities, but for rounding where a leg's coupling is taken out
    # of its row. The sign of that decided whether the row is damped, so that q+ jumped by up to 1e-8 m where another foot is corrected.
    law = "split, Euler"
    sim, ctrl = touching("dm_control/quadruped", **SETTINGS[law])
    model, points, nv = sim.model, 33, sim.model.nv
    places = np.linspace(-1e-6, 1e-6, points)
    basis, found = np.vander(places / 1e-6, 3), []
    along = np.random.default_rng(1).normal(size=(8, nv))
    for env in range(8):
        copies = simulation(model, points, law, tolerance=1e-13)
        copies.set_state(sim.get_state(env=env))
        # By Euler's rule velocities move no foot from the floor and no coupling out of its place: there is no kink but of friction.
        copies.set_state(None, sim.qvel[env] + places[:, None] * along[env], keep_warmstart=True)
        copies.step(ctrl[env])
        ends = model.differentiate_pos(np.tile(copies.qpos[points // 2], (points, 1)), copies.qpos)
        found.append(np.abs(ends - basis @ np.linalg.lstsq(basis, ends, rcond=None)[0]).max())
    # The correction is solved to 1e-11 m/s, which is 2e-14 m over a step; joints may move some times as much.
    assert max(found) < 2e-13


def test_a_bounce_is_taken_by_differences():
    ball = scene(BALL.format(joints="<freejoint/>")).replace(geom_restitution=np.array([0.0, 0.7]))
    sim = simulation(ball, 2)
    sim.set_state([[0, 0, 0.1, 1, 0, 0, 0], [0, 0, 0.5, 1, 0, 0, 0]], [[0, 0, -2.0, 0, 0, 0], [0, 0, -2.0, 0, 0, 0]])
    own, differences = sim.linearize(method="implicit"), sim.linearize()
    assert own.implicit[1]
    np.testing.assert_allclose(own.A, differences.A, atol=1e-6)


@pytest.mark.parametrize("law", ["hard", "split, midpoint", "mujoco, Euler"])
def test_several_steps_are_differences_of_several_steps(law):
    sim, ctrl = touching("gymnasium/hopper", **SETTINGS[law])
    own = sim.linearize(("qvel", "ctrl", "qpos"), ctrl=ctrl, nstep=4, method="implicit")
    differences = sim.linearize(("qvel", "ctrl", "qpos"), ctrl=ctrl, nstep=4, extrapolate=True)
    assert own.kinked_steps.shape == (8, 4)
    np.testing.assert_allclose(own.qpos, differences.qpos, atol=1e-12)
    for name in ("qvel", "ctrl", "qpos"):
        smooth = (differences.kinks[name] == 0) & ~own.near_kink[:, None]
        a, b = own.blocks[name], differences.blocks[name]
        off = np.abs(a - b).max(axis=1) / np.maximum(np.abs(b).max(axis=1), 1.0)
        assert smooth.mean() > 0.3
        assert np.mean(off[smooth] < 1e-5) > 0.98


def test_nothing_advances_and_a_single_environment_has_no_leading_axis():
    sim = sliding(None)
    sim.step(nstep=3)
    before = sim.get_state()
    one, again = sim.linearize(method="implicit"), sim.linearize(method="implicit")
    assert sim.get_state() == before
    assert one.A.shape == (6, 6)
    assert one.implicit.shape == ()
    np.testing.assert_array_equal(one.A, again.A)


def test_a_batch_in_f32_is_differentiated_in_f64():
    model = scene(BALL.format(joints=SLIDES), floor='friction=".4 0 0"', more=PUSHED)
    lin = stepper.Stepper(model, 2, options=stepper.Options(**SETTINGS["hard"]), precision="f32").linearize(method="implicit")
    assert lin.A.dtype == np.float64
    assert lin.implicit.all()
