"""Limits of scenes: room for contacts, very many geoms, `max_penetration` with its flags, and joints whose motions cancel."""

import pickle

import numpy as np
import pytest
import stepper
from hypothesis import given, settings, strategies as st
from models import SOURCES, simulate, stepper_model
from stepper.loading.load import compile_source
from stepper.loading.mjcf import describe
from stepper.loading.origins import Origin

FEET = 60
SCENE = """<mujoco><worldbody><geom type="box" size=".05 .05 .05"/>
<body pos="0 0 .15"><freejoint/><geom size=".05"/></body></worldbody></mujoco>"""
HINGE = """<mujoco><compiler angle="radian"/><option gravity="0 0 0" timestep=".002"/><worldbody>
  <body><joint name="hinge" axis="0 1 0" range="-1 1" limited="true"/><geom size=".1" pos=".3 0 0"/></body>
  <body pos="2 0 0"><joint name="ball" type="ball" range="0 .5" limited="true"/><geom size=".1" pos=".1 0 0"/></body>
  <body pos="4 0 0"><joint name="slide" type="slide" range="-.1 .1" limited="true"/><geom size=".1"/></body></worldbody>
  <tendon><fixed limited="true" range="-3 .3"><joint joint="slide" coef="2"/></fixed></tendon></mujoco>"""
BALL = (
    """<mujoco><worldbody><geom type="plane" size="0 0 1"/><body pos="0 0 {z}"><freejoint/><geom size=".1"/></body></worldbody></mujoco>"""
)
TURNED = [np.cos(0.4), np.sin(0.4), 0, 0]
BODY = '<geom size=".1" mass="4" pos=".3 0 .2"/>'


def many_feet(height: float, keyframe: str = "", friction: float = 0.001) -> stepper.Model:
    """A tray on many feet: one body, more contacts than a body of a heap has."""
    # Their coefficients of friction grow by `friction` from foot to foot, so that none is redundant; with 0 they are alike.
    feet = "".join(
        f'<geom size=".01" pos="{0.05 * (k % 10):g} {0.05 * (k // 10):g} 0" friction="{1 + friction * k:g}"/>' for k in range(FEET)
    )
    more = "".join(f'<body pos="0 0 {5 + k}"><freejoint/><geom size=".01"/></body>' for k in range(2))
    world = f'<geom type="plane" size="9 9 1"/><body pos="0 0 {height}"><freejoint/>{feet}</body>{more}'
    return stepper.load(f"<mujoco><worldbody>{world}</worldbody>{keyframe}</mujoco>")


@pytest.mark.parametrize("precision", ["f64", "f32"])
@pytest.mark.parametrize("num_envs", [None, 3])
def test_all_contacts_of_the_reset_state_fit(num_envs, precision):
    sim = simulate(many_feet(0.01), num_envs, precision=precision, steps=20)
    assert not (np.atleast_1d(sim.status) & stepper.Status.CONTACTS_FULL).any()
    assert len(sim.contacts(0) if num_envs else sim.contacts()) == FEET


def test_all_contacts_of_a_keyframe_fit():
    key = '<keyframe><key name="low" qpos="0 0 .01 1 0 0 0 0 0 5 1 0 0 0 0 0 6 1 0 0 0"/></keyframe>'
    sim = stepper.Stepper(many_feet(3.0, key))
    sim.reset(keyframe="low")
    sim.step(nstep=20)
    assert not sim.status & stepper.Status.CONTACTS_FULL
    assert len(sim.contacts()) == FEET


def test_feet_that_others_make_redundant_have_room():
    sim = simulate(many_feet(0.01, friction=0.0), steps=20)
    assert not sim.status & stepper.Status.CONTACTS_FULL
    assert len(sim.contacts()) == 4, "the corners of the tray"


def test_a_pickle_has_the_same_room():
    sim = simulate(many_feet(0.01), steps=5)
    other = pickle.loads(pickle.dumps(sim))
    for each in (sim, other):
        each.step(nstep=5)
    assert other.qpos.tobytes() == sim.qpos.tobytes()
    assert len(other.contacts()) == FEET


@pytest.mark.parametrize("count", [5_000, 70_000])
def test_a_ball_rests_on_one_of_many_fixed_boxes(count):
    """Up to 65,535 geoms the numbers of pairs form a square table, and above only moving geoms have rows: both find the same contact."""
    # MuJoCo's compiler is left out, because its time grows with the square of the number.
    description = describe(compile_source(Origin(SCENE)))
    box, ball = description["geoms"]
    places = 0.1 * np.stack(np.unravel_index(np.arange(count), (300, 300)), axis=1)
    under = places[count // 2]
    boxes = [box | {"pos": [x - under[0], y - under[1], 0.0]} for x, y in places.tolist()]
    sim = simulate(stepper.Model.from_description(description | {"geoms": [*boxes, ball]}, True), timestep=5e-3, steps=200)
    (contact,) = sim.contacts()
    assert sorted(contact["geom"].tolist()) == [count // 2, count]
    # The slop, by which contacts overlap at rest.
    assert sim.qpos[:3] == pytest.approx([0, 0, 0.1], abs=2e-5)
    assert not sim.status & (stepper.Status.NOT_CONVERGED | stepper.Status.TUNNELLED)


@pytest.mark.parametrize(("qpos", "overshoot"), [
    ([0, 1, 0, 0, 0, 0], 0.0),
    ([1.2, 1, 0, 0, 0, 0], 0.2),
    ([-1.3, 1, 0, 0, 0, 0], 0.3),
    ([0, *TURNED, 0], 0.3),
    ([0, 1, 0, 0, 0, -0.15], 0.05),
    ([0, 1, 0, 0, 0, 0.2], 0.1),
])  # fmt: skip
def test_max_limit_violation_is_how_far_the_farthest_joint_or_tendon_is_out(qpos, overshoot):
    sim = simulate(HINGE, 2, stabilization="none", qpos=np.array([qpos, [0, 1, 0, 0, 0, 0]], float), steps=1)
    assert sim.max_limit_violation == pytest.approx([overshoot, 0.0], abs=1e-12)
    assert bool(sim.status[0] & stepper.Status.OVER_LIMIT) == (overshoot > 0.01)
    assert sim.status[1] == stepper.Status.OK


def test_overshoot_and_depth_are_the_largest_of_the_call():
    """A joint beyond its range and a ball in the floor come back: the call that began so says how far they were, the next does not."""
    sim = simulate(HINGE, stabilization="split", qpos=[1.5, 1, 0, 0, 0, 0], steps=1)
    first = sim.max_limit_violation
    sim.set_state(qpos=[1.5, 1, 0, 0, 0, 0])
    sim.step(nstep=400)
    assert sim.max_limit_violation == first > 0.3
    assert sim.status & stepper.Status.OVER_LIMIT
    sim.step()
    assert sim.max_limit_violation < 1e-3
    assert sim.status == stepper.Status.OK
    ball = simulate(BALL.format(z=0.09), 2, stabilization="split", steps=300)
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
        sim = simulate(stepper_model(name), steps=2000)
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


def scene(joints, body=BODY):
    return f"<mujoco><worldbody><body name='a'>{joints}{body}</body></worldbody></mujoco>"


def test_two_hinges_on_one_line_are_named_without_a_contradiction():
    with pytest.raises(stepper.ModelError) as error:
        stepper.load(scene('<joint name="first" axis="0 1 0"/><joint name="second" axis="0 1 0"/>'))
    message = str(error.value)
    for part in ('body "a"', 'joint "first" and "second" can move without moving any inertia', "remove one of these joints", "armature"):
        assert part in message
    assert "moves nothing" not in message
    assert "4 kg" not in message
    stepper.load(scene('<joint name="first" axis="0 1 0" armature=".01"/><joint name="second" axis="0 1 0"/>'))


def test_a_body_without_mass_still_says_that_it_has_none():
    light = '<body name="b" pos="0 0 1"><joint name="only"/><geom size=".1" mass="0"/></body>'
    with pytest.raises(stepper.ModelError, match="mass"):
        stepper.load(scene('<joint name="first" axis="0 1 0"/>', BODY + light))


@settings(max_examples=50, deadline=None)
@given(st.integers(1, 4), st.integers(0, 3), st.data())
def test_the_joints_that_are_named_are_those_that_depend(count, others, data):
    """Slides of one body in a plane: two determine it, and a third depends on both; unrelated ones along z do not matter."""
    angles = data.draw(st.lists(st.sampled_from([(1, 0), (0, 1), (1, 1), (1, -1), (2, 1)]), min_size=count, max_size=count))
    axes = [(x, y, 0) for x, y in angles] + [(0, 0, 1)] * min(others, 1)
    joints = "".join(f'<joint name="s{i}" type="slide" axis="{x} {y} {z}"/>' for i, (x, y, z) in enumerate(axes))
    independent = len(angles) == 1 or (len(angles) == 2 and angles[0] != angles[1])
    if independent:
        stepper.load(scene(joints))
        return
    with pytest.raises(stepper.ModelError) as error:
        stepper.load(scene(joints))
    message = str(error.value)
    assert "can move without moving any inertia" in message
    assert f'"s{len(angles)}"' not in message  # The vertical one.
