"""`max_penetration`, `max_limit_violation`, and the flags that they set."""

import numpy as np
import pytest
import stepper
from models import SOURCES, simulate, stepper_model

HINGE = """<mujoco><compiler angle="radian"/><option gravity="0 0 0" timestep=".002"/><worldbody>
  <body><joint name="hinge" axis="0 1 0" range="-1 1" limited="true"/><geom size=".1" pos=".3 0 0"/></body>
  <body pos="2 0 0"><joint name="ball" type="ball" range="0 .5" limited="true"/><geom size=".1" pos=".1 0 0"/></body>
  <body pos="4 0 0"><joint name="slide" type="slide" range="-.1 .1" limited="true"/><geom size=".1"/></body></worldbody>
  <tendon><fixed limited="true" range="-3 .3"><joint joint="slide" coef="2"/></fixed></tendon></mujoco>"""
BALL = (
    """<mujoco><worldbody><geom type="plane" size="0 0 1"/><body pos="0 0 {z}"><freejoint/><geom size=".1"/></body></worldbody></mujoco>"""
)
TURNED = [np.cos(0.4), np.sin(0.4), 0, 0]


@pytest.mark.parametrize(("qpos", "overshoot"), [
    ([0, 1, 0, 0, 0, 0], 0.0),
    ([1.2, 1, 0, 0, 0, 0], 0.2),
    ([-1.3, 1, 0, 0, 0, 0], 0.3),
    ([0, *TURNED, 0], 0.3),
    ([0, 1, 0, 0, 0, -0.15], 0.05),
    ([0, 1, 0, 0, 0, 0.2], 0.1),
])  # fmt: skip
def test_max_limit_violation_is_how_far_the_farthest_joint_or_tendon_is_out(qpos, overshoot):
    sim = simulate(HINGE, 2, stabilization="none")
    sim.set_state(np.array([qpos, [0, 1, 0, 0, 0, 0]], float))
    sim.step()
    assert sim.max_limit_violation == pytest.approx([overshoot, 0.0], abs=1e-12)
    assert bool(sim.status[0] & stepper.Status.OVER_LIMIT) == (overshoot > 0.01)
    assert sim.status[1] == stepper.Status.OK


def test_overshoot_and_depth_are_the_largest_of_the_call():
    """A joint beyond its range and a ball in the floor come back: the call that began so says how far they were, the next does not."""
    sim = simulate(HINGE, stabilization="split")
    sim.set_state(qpos=[1.5, 1, 0, 0, 0, 0])
    sim.step()
    first = sim.max_limit_violation
    sim.set_state(qpos=[1.5, 1, 0, 0, 0, 0])
    sim.step(nstep=400)
    assert sim.max_limit_violation == first > 0.3
    assert sim.status & stepper.Status.OVER_LIMIT
    sim.step()
    assert sim.max_limit_violation < 1e-3
    assert sim.status == stepper.Status.OK
    ball = simulate(BALL.format(z=0.09), 2, stabilization="split")
    ball.step(nstep=300)
    assert ball.max_penetration == pytest.approx([0.01, 0.01], rel=0.05)
    assert (ball.status & stepper.Status.DEEP).all()
    ball.step()
    assert (ball.max_penetration < 1e-4).all()
    assert (ball.status == stepper.Status.OK).all()


def test_depth_is_that_of_the_contacts_of_a_step():
    model = stepper_model("dm_control/humanoid")
    sim = simulate(model, 6)
    qpos = np.tile(model.qpos0, (6, 1))
    qpos[:, 2] = np.linspace(0.0, 1.5, 6)
    sim.set_state(qpos=qpos)
    for _ in range(20):
        sim.step()
        contacts = sim.contacts()
        deepest = [max([0.0, *-contacts["distance"][contacts["env"] == env]]) for env in range(6)]
        assert sim.max_penetration.tolist() == deepest
        assert np.array_equal((sim.status & stepper.Status.DEEP) != 0, sim.max_penetration > 1e-3)
    assert sim.max_penetration.max() > 1e-3


def test_robots_at_rest_are_neither_deep_nor_over_a_limit():
    """The sizes of the flags are not those of contacts that are solved: standing robots stay below them."""
    for name in ("gymnasium/ant", "dm_control/quadruped"):
        assert name in SOURCES
        sim = stepper.Stepper(stepper_model(name))
        sim.step(nstep=2000)
        sim.step(nstep=100)
        assert not sim.status & (stepper.Status.DEEP | stepper.Status.OVER_LIMIT), name
        assert sim.max_penetration < 1e-4


@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_a_rollout_has_the_depth_of_all_its_steps(precision):
    one, many = (simulate(BALL.format(z=0.09), 2, precision=precision) for _ in range(2))
    one.rollout(np.zeros((20, 0)), nstep=3)
    many.step(nstep=60)
    assert np.array_equal(one.max_penetration, many.max_penetration)
    assert one.get_state() == many.get_state()
