"""The velocity tasks of the Go1 and the G1: what they observe, what is drawn, rewards of strides, motors, and the policies."""

from importlib.util import find_spec
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import stepper
import stepper.envs
from stepper.envs import StepperVectorEnv
from stepper.envs.locomotion import G1Velocity, Go1Velocity
from stepper.envs.locomotion.rewards import SCAN
from stepper.policies import evaluate, load

pytestmark = pytest.mark.skipif(find_spec("mjlab") is None, reason="mjlab, whose robot this is, is not installed: make training")


@pytest.fixture
def envs():
    made = StepperVectorEnv(Go1Velocity(), 16, max_episode_steps=1000, autoreset_mode="SameStep")
    made.reset(seed=3)
    made.action_space.seed(3)
    return made


def still(envs):
    """Actions that keep the set points in the stance."""
    return np.zeros(envs.action_space.shape)


def test_the_robot_is_a_go1():
    """Its mass is that of the datasheet's 12 kg and some, and it stands on its feet by its servos."""
    same = (1.0, 1.0)
    envs = StepperVectorEnv(Go1Velocity(push=0.0, friction=same, mass_scale=same, gain_scale=same, center_shift=(0.0, 0.0, 0.0)), 2)
    assert envs.sim.model.body_mass.sum() == pytest.approx(12.74, abs=0.01)
    envs.reset(seed=0)
    envs.set_state(envs.now.default_qpos, np.zeros(18))
    for _ in range(150):
        _, _, terminated, _, _ = envs.step(still(envs))
        assert not terminated.any()
    assert (np.abs(envs.sim.qpos[:, 2] - 0.27) < 0.03).all()
    assert np.abs(envs.sim.qvel).max() < 0.05


def test_what_is_drawn_lies_within_its_ranges_and_is_drawn_anew():
    envs = StepperVectorEnv(Go1Velocity(), 400)
    envs.reset(seed=0)
    model, given = envs.sim.model, envs.sim.randomized
    feet = [k for k, name in enumerate(model.geom_names) if name.endswith("foot_collision")]
    assert len(feet) == 4
    friction = given["geom_friction"][:, feet, 0]
    mass = given["body_mass"][:, 1] / model.body_mass[1]
    gains = given["actuator_gainprm"][..., 0] / model.actuator_gainprm[:, 0]
    for values, (low, high) in ((friction, (0.4, 1.2)), (mass, (0.8, 1.2)), (gains, (0.9, 1.1))):
        # Of 400 draws the ends are missed by a twentieth of the range once in 1e9 times.
        assert low <= values.min() < low + 0.05 * (high - low)
        assert high - 0.05 * (high - low) < values.max() <= high
    np.testing.assert_array_equal(given["actuator_biasprm"][..., 1], -given["actuator_gainprm"][..., 0])
    np.testing.assert_array_equal(given["body_mass"][:, 2:], np.tile(model.body_mass[2:], (400, 1)))
    mask = np.zeros(400, dtype=bool)
    mask[5] = True
    before = {name: np.array(values) for name, values in given.items()}
    envs.reset(options={"reset_mask": mask})
    for name, values in envs.sim.randomized.items():
        np.testing.assert_array_equal((np.asarray(values) != before[name]).reshape(400, -1).any(axis=1), mask)
    stands = (envs.now.command() == 0.0).all(axis=1).mean()
    # 400 draws of 0.1: a deviation of 0.015.
    assert 0.04 < stands < 0.16


def test_strides_are_what_feet_are_in_the_air_when_they_land():
    """A foot lands where its lowest point comes within 1 cm of the ground; its time in the air beyond 0.1 s counts, up to 0.3 s."""
    envs = StepperVectorEnv(Go1Velocity(push=0.0), 8)
    envs.reset(seed=5)
    qpos = np.array(envs.sim.qpos)
    qpos[:, 2] = [0.28, 0.3, 0.32, 0.35, 0.4, 0.5, 0.7, 0.9]  # Falls of nothing to 0.35 s.
    envs.set_state(qpos, np.zeros((8, 18)))
    sites = [envs.sim.model.site_names.index(name) for name in ("FR", "FL", "RR", "RL")]
    air, gained, moves = np.zeros((8, 4)), [], np.linalg.norm(envs.now.command(), axis=1) > 0.1
    for _ in range(25):
        info = envs.step(still(envs))[4]
        height = envs.sim.site_xpos[:, sites, 2] - 0.023
        expected = np.where((height < 0.01) & (air > 0.0), np.minimum(air, 0.3) - 0.1, 0.0).sum(axis=1)
        air = np.where(height < 0.01, 0.0, air + 0.02)
        np.testing.assert_allclose(info["reward_stride"], 3.0 * expected * moves, atol=1e-12)
        gained.append(info["reward_stride"])
    assert np.min(gained) < 0.0
    assert np.max(gained) > 0.5


def rows(envs, observation):
    ends = np.cumsum([0, *envs.observation_structure.values()])
    return {name: observation[:, a:b] for name, a, b in zip(envs.observation_structure, ends, ends[1:], strict=False)}


def test_errors_have_the_widths_of_mjlabs_training():
    """Observation errors reach mjlab's widths and no more; those of gravity turn it, so that its length stays 1."""
    told, true = (StepperVectorEnv(Go1Velocity(noise=noise), 500) for noise in (1.0, 0.0))
    one, other = rows(told, told.reset(seed=0)[0]), rows(true, true.reset(seed=0)[0])
    for name, width in {"base_lin_vel": 0.5, "base_ang_vel": 0.2, "joint_pos": 0.01, "joint_vel": 1.5}.items():
        errors = one[name] - other[name]
        # Of 1,500 uniform errors the ends are missed by a fiftieth once in 1e6 times.
        assert 0.95 * width < np.abs(errors).max() < width * 1.000001, name
    np.testing.assert_allclose(np.linalg.norm(one["projected_gravity"], axis=1), 1.0)
    turned = np.abs(one["projected_gravity"] - other["projected_gravity"])[:, :2].max()
    assert 0.045 < turned < 0.05 / 0.95
    np.testing.assert_array_equal(one["command"], other["command"])
    # Rewards are of the truth.
    np.testing.assert_array_equal(told.step(still(told))[1], true.step(still(true))[1])


def test_motors_have_curves_and_friction():
    """Joints that turn faster than their motors without load get no torque in that direction, where those without curves do."""
    task = Go1Velocity(motors=True, push=0.0, max_latency=0)
    plain = Go1Velocity(push=0.0, max_latency=0)
    for kind, pushes in ((task, False), (plain, True)):
        envs = StepperVectorEnv(kind, 1, options=stepper.Options(integrator="euler"))
        envs.reset(seed=0)
        envs.sim.randomize({"actuator_biasprm": 0.0, "actuator_gainprm[*][0]": 20.0})
        qvel = np.zeros((1, 18))
        qvel[:, 6:] = 40.0
        envs.set_state(np.array(envs.sim.qpos) + np.eye(19)[2] * 5.0, qvel)
        envs.sim.step(np.ones((1, 12)))
        assert (envs.sim.qfrc_actuator[0, 6:] > 1.0).any() == pushes
    assert set(envs.sim.model.actuator_names) == set(task.actuators().named)


def test_it_sees_the_ground_around_it():
    """The height scan equals that of `stepper.sensors.HeightField` in the model, because both interpolate the same heights."""
    envs = StepperVectorEnv(Go1Velocity(roughness=0.3, scan=True), 20)
    seen = rows(envs, envs.reset(seed=4)[0])["height_scan"]
    scan = stepper.sensors.HeightField(envs.sim.model, "terrain").scan(envs.sim, "trunk", SCAN)
    np.testing.assert_allclose(seen, (envs.sim.xpos[:, [1], 2] - scan) / 5.0, atol=1e-9)
    assert np.ptp(seen, axis=1).min() > 0.02 / 5.0
    assert np.ptp(envs.sim.qpos[:, 0]) > 15.0


def test_what_is_real_is_registered(envs):
    for name in ("Go1", "G1"):
        made = gymnasium.make_vec(f"stepper/{name}VelocityReal-v0", num_envs=3, precision="f32")
        assert made.unwrapped.task.noise == 1.0 and made.unwrapped.sim.actuators is not None
        made.reset(seed=0)
        assert np.isfinite(made.step(made.action_space.sample())[0]).all()
        assert envs.task.noise == 0.0 and envs.sim.actuators is None
    with pytest.raises(ValueError, match="noise is -1, must be a finite number of at least 0"):
        Go1Velocity(noise=-1)


def test_it_is_registered_and_ends_where_it_falls():
    env = gymnasium.make("stepper/Go1Velocity-v0", push=0.0)
    env.reset(seed=0)
    sim = env.unwrapped.sim
    for quat, height, over in (([1, 0, 0, 0], 0.3, False), ([0.7, 0.7, 0, 0], 0.3, True), ([1, 0, 0, 0], 0.1, True)):
        qpos = np.array(sim.qpos[0])
        qpos[2], qpos[3:7] = height, quat
        env.unwrapped.set_state(qpos, np.zeros(18))
        assert env.step(np.zeros(12))[2] == over


def test_the_policy_that_is_kept_follows_its_commands():
    """Within 0.25 m/s in x and y, with pushes; one that stands in its stance does not."""
    policy = load(Path(__file__).parents[2] / "examples/policies/go1_velocity.npz")
    follows, stands = (
        evaluate(act, "stepper/Go1Velocity-v0", episodes=32, seed=7, infos=("tracking_error",), precision="f32").infos["tracking_error"]
        for act in (policy, lambda observation: np.zeros((len(observation), 12)))
    )
    assert follows.mean() < 0.25
    assert stands.mean() > 0.4


# The velocity task of the G1: its servos, what is drawn, rough ground, and the policy.


@pytest.fixture
def g1_envs():
    made = StepperVectorEnv(G1Velocity(), 6, max_episode_steps=1000, autoreset_mode="SameStep")
    made.reset(seed=3)
    return made


@pytest.mark.parametrize(("joint", "inertia", "torque"), [
    # The inertias that mjlab's and other simulators of the G1 have of its motors, to their digits.
    ("left_elbow_joint", 0.003609725, 25.0), ("waist_yaw_joint", 0.010177520, 88.0), ("right_knee_joint", 0.025101925, 139.0),
    ("left_wrist_yaw_joint", 0.00425, 5.0), ("left_ankle_roll_joint", 2 * 0.003609725, 50.0),
])  # fmt: skip
def test_servos_are_those_of_its_motors(g1_envs, joint, inertia, torque):
    model = g1_envs.sim.model
    servo = model.actuator(joint).id
    assert model.dof_armature[model.joint(joint).dofadr] == pytest.approx(inertia, abs=1e-9)
    assert model.actuator_forcerange[servo, 1] == torque
    stiffness = inertia * (20.0 * np.pi) ** 2
    # The inertias above have ten decimals.
    assert model.actuator_gainprm[servo, 0] == pytest.approx(stiffness, rel=1e-6)
    assert model.actuator_biasprm[servo, 2] == pytest.approx(-4.0 * inertia * 20.0 * np.pi, rel=1e-6)


def test_it_stands_in_its_stance():
    g1_envs = StepperVectorEnv(G1Velocity(push=0.0, center_shift=(0.0, 0.0, 0.0), mass_scale=(1.0, 1.0), gain_scale=(1.0, 1.0)), 2)
    g1_envs.reset(seed=0)
    assert g1_envs.sim.model.omitted == []
    g1_envs.set_state(np.tile(g1_envs.sim.model.keyframe("stance").qpos, (2, 1)), np.zeros((2, 35)))
    for _ in range(25):
        _, reward, terminated, _, info = g1_envs.step(still(g1_envs))
    assert not terminated.any()
    assert (g1_envs.now.qpos[:, 2] > 0.7).all()
    feet = [k for k, name in enumerate(g1_envs.sim.model.geom_names) if "foot" in name]
    # The soles' radius is 0.01 m; hard contact does not let them sink in.
    assert 0.0095 < g1_envs.sim.geom_xpos[:, feet, 2].min() < 0.0105
    total = g1_envs.sim.body_contact_force[:, 1:, 2].sum(axis=1)
    np.testing.assert_allclose(total, 9.81 * g1_envs.sim.model.body_mass.sum(), rtol=0.2)
    assert (info["tracking_error"] < 1.5).all() and (reward >= 0.0).all()


def test_what_is_drawn_lies_within_its_ranges():
    g1_envs = StepperVectorEnv(G1Velocity(), 200)
    g1_envs.reset(seed=0)
    own, model = g1_envs.sim.randomized, g1_envs.sim.model
    feet = [k for k, name in enumerate(model.geom_names) if "foot" in name]
    assert len(feet) == 14
    friction = own["geom_friction"][:, feet, 0]
    assert (friction.min(axis=1) == friction.max(axis=1)).all() and 0.4 <= friction.min() < 0.5 and 1.1 < friction.max() <= 1.2
    mass = own["body_mass"][:, 1] / model.body_mass[1]
    assert 0.9 <= mass.min() < 0.92 and 1.08 < mass.max() <= 1.1
    gains = own["actuator_gainprm"][:, :, 0] / model.actuator_gainprm[:, 0]
    assert 0.9 <= gains.min() < 0.91 and 1.09 < gains.max() <= 1.1
    np.testing.assert_allclose(own["actuator_biasprm"][:, :, 1] / model.actuator_biasprm[:, 1], gains, rtol=1e-12)
    assert sorted(set(g1_envs._batch.terms.delay)) == [0, 1, 2, 3, 4]
    stands = (g1_envs.now.command() == 0.0).all(axis=1).mean()
    # One of ten of 200 commands; four standard deviations.
    assert abs(stands - 0.1) < 0.085


def test_the_g1_is_registered_and_ends_where_it_falls():
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


def test_the_policy_of_the_g1_follows_its_commands():
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
