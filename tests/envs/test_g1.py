"""The velocity task of the G1: its servos, what is drawn, rough ground, and the policy."""

from importlib.util import find_spec
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from stepper.envs import StepperVectorEnv
from stepper.envs.locomotion import G1Velocity
from stepper.policies import evaluate, load

pytestmark = pytest.mark.skipif(find_spec("mjlab") is None, reason="mjlab, whose robot this is, is not installed: make training")


@pytest.fixture
def envs():
    made = StepperVectorEnv(G1Velocity(), 6, max_episode_steps=1000, autoreset_mode="SameStep")
    made.reset(seed=3)
    return made


def still(envs):
    """Actions that keep the set points in the stance."""
    return np.zeros(envs.action_space.shape)


@pytest.mark.parametrize(("joint", "inertia", "torque"), [
    # The inertias that mjlab's and other simulators of the G1 have of its motors, to their digits.
    ("left_elbow_joint", 0.003609725, 25.0), ("waist_yaw_joint", 0.010177520, 88.0), ("right_knee_joint", 0.025101925, 139.0),
    ("left_wrist_yaw_joint", 0.00425, 5.0), ("left_ankle_roll_joint", 2 * 0.003609725, 50.0),
])  # fmt: skip
def test_servos_are_those_of_its_motors(envs, joint, inertia, torque):
    model = envs.sim.model
    servo = model.actuator(joint).id
    assert model.dof_armature[model.joint(joint).dofadr] == pytest.approx(inertia, abs=1e-9)
    assert model.actuator_forcerange[servo, 1] == torque
    stiffness = inertia * (20.0 * np.pi) ** 2
    # The inertias above have ten decimals.
    assert model.actuator_gainprm[servo, 0] == pytest.approx(stiffness, rel=1e-6)
    assert model.actuator_biasprm[servo, 2] == pytest.approx(-4.0 * inertia * 20.0 * np.pi, rel=1e-6)


def test_it_stands_in_its_stance():
    envs = StepperVectorEnv(G1Velocity(push=0.0, center_shift=(0.0, 0.0, 0.0), mass_scale=(1.0, 1.0), gain_scale=(1.0, 1.0)), 2)
    envs.reset(seed=0)
    assert envs.sim.model.omitted == []
    envs.set_state(np.tile(envs.sim.model.keyframe("stance").qpos, (2, 1)), np.zeros((2, 35)))
    for _ in range(25):
        _, reward, terminated, _, info = envs.step(still(envs))
    assert not terminated.any()
    assert (envs.now.qpos[:, 2] > 0.7).all()
    feet = [k for k, name in enumerate(envs.sim.model.geom_names) if "foot" in name]
    # The soles' radius is 0.01 m; hard contact does not let them sink in.
    assert 0.0095 < envs.sim.geom_xpos[:, feet, 2].min() < 0.0105
    total = envs.sim.body_contact_force[:, 1:, 2].sum(axis=1)
    np.testing.assert_allclose(total, 9.81 * envs.sim.model.body_mass.sum(), rtol=0.2)
    assert (info["tracking_error"] < 1.5).all() and (reward >= 0.0).all()


def test_what_is_drawn_lies_within_its_ranges():
    envs = StepperVectorEnv(G1Velocity(), 200)
    envs.reset(seed=0)
    own, model = envs.sim.randomized, envs.sim.model
    feet = [k for k, name in enumerate(model.geom_names) if "foot" in name]
    assert len(feet) == 14
    friction = own["geom_friction"][:, feet, 0]
    assert (friction.min(axis=1) == friction.max(axis=1)).all() and 0.4 <= friction.min() < 0.5 and 1.1 < friction.max() <= 1.2
    mass = own["body_mass"][:, 1] / model.body_mass[1]
    assert 0.9 <= mass.min() < 0.92 and 1.08 < mass.max() <= 1.1
    gains = own["actuator_gainprm"][:, :, 0] / model.actuator_gainprm[:, 0]
    assert 0.9 <= gains.min() < 0.91 and 1.09 < gains.max() <= 1.1
    np.testing.assert_allclose(own["actuator_biasprm"][:, :, 1] / model.actuator_biasprm[:, 1], gains, rtol=1e-12)
    assert sorted(set(envs._batch.terms.delay)) == [0, 1, 2, 3, 4]
    stands = (envs.now.command() == 0.0).all(axis=1).mean()
    # One of ten of 200 commands; four standard deviations.
    assert abs(stands - 0.1) < 0.085


def test_it_is_registered_and_ends_where_it_falls():
    env = gymnasium.make("stepper/G1Velocity-v0", push=0.0)
    env.reset(seed=0)
    sim = env.unwrapped.sim
    for quat, height, over in (([1, 0, 0, 0], 0.8, False), ([0.7, 0.7, 0, 0], 0.8, True), ([1, 0, 0, 0], 0.4, True)):
        qpos = np.array(sim.model.keyframe("stance").qpos)
        qpos[2], qpos[3:7] = height, quat
        env.unwrapped.set_state(qpos, np.zeros(35))
        assert env.step(np.zeros(29))[2] == over


def test_rough_ground_is_where_the_task_says():
    """Nobody begins in the ground, and standing ends no episode there."""
    rough = StepperVectorEnv(G1Velocity(roughness=0.15, push=0.0), 60)
    rough.reset(seed=0)
    feet = [k for k, name in enumerate(rough.sim.model.geom_names) if "foot" in name]
    assert np.ptp(rough.now.qpos[:, 0]) > 15.0
    for _ in range(3):
        _, _, terminated, _, _ = rough.step(still(rough))
        assert not terminated.any()
        # What lands at 1 m/s moves by 5 mm in a step.
        assert (rough.sim.max_penetration < 5e-3).all()
    places = rough.sim.geom_xpos[:, feet]
    assert (places[..., 2] - rough.task.ground_height(places[..., :2]) > -0.02).all()
    assert rough.task.ground_height(places[..., :2]).max() > 0.1


def test_the_policy_that_is_kept_follows_its_commands():
    """Within 0.25 m/s in x and y, with pushes, under the law that it was trained in; one that stands in its stance falls."""
    policy = load(Path(__file__).parents[2] / "examples/policies/g1_velocity.npz")
    follows, stands = (
        evaluate(act, "stepper/G1Velocity-v0", episodes=16, seed=7, infos=("tracking_error",), contact="mujoco", precision="f32")
        for act in (policy, lambda observation: np.zeros((len(observation), 29)))
    )
    assert follows.infos["tracking_error"].mean() < 0.25
    # Most episodes last their 1,000 actions (nine of ten in the page's table), and none of those that only stand.
    assert np.median(follows.lengths) == 1000
    assert stands.lengths.max() < 1000
