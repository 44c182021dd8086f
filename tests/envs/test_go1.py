"""The velocity task of the Go1: what it observes, when commands change and pushes come, how late actions are, what is drawn."""

import pickle
from importlib.util import find_spec
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import stepper
import stepper.envs
from stepper.envs import StepperEnv, StepperVectorEnv
from stepper.envs.locomotion import G1Velocity, Go1Velocity
from stepper.policies import evaluate, load

pytestmark = pytest.mark.skipif(find_spec("mjlab") is None, reason="mjlab, whose robot this is, is not installed: make training")


@pytest.fixture
def envs():
    made = StepperVectorEnv(Go1Velocity(), 16, max_episode_steps=1000, autoreset_mode="SameStep")
    made.reset(seed=3)
    made.action_space.seed(3)
    return made


def stance(envs):
    return np.tile(envs.task.episode_state(1)["last"], (envs.num_envs, 1))


def test_the_robot_is_a_go1():
    """Its mass is that of the datasheet's 12 kg and some, and it stands on its feet by its servos."""
    same = (1.0, 1.0)
    envs = StepperVectorEnv(Go1Velocity(max_push=0.0, friction=same, mass_scale=same, gain_scale=same, center_shift=0.0), 2)
    assert envs.sim.model.body_mass.sum() == pytest.approx(12.74, abs=0.01)
    envs.reset(seed=0)
    envs.set_state(np.hstack([[0.0, 0.0, 0.278, 1.0, 0.0, 0.0, 0.0], stance(envs)[0]]), np.zeros(18))
    for _ in range(150):
        _, _, terminated, _, _ = envs.step(stance(envs))
        assert not terminated.any()
    assert (np.abs(envs.sim.qpos[:, 2] - 0.27) < 0.03).all()
    assert np.abs(envs.sim.qvel).max() < 0.05


def test_it_observes_velocities_and_the_vertical_in_its_own_frame(envs):
    for _ in range(20):
        observation = envs.step(envs.action_space.sample())[0]
    sim, rows = envs.sim, np.cumsum([0, *envs.observation_structure.values()])
    seen = {name: observation[:, a:b] for name, a, b in zip(envs.observation_structure, rows, rows[1:], strict=False)}
    for k in range(envs.num_envs):
        w, x, y, z = sim.xquat[k, 1]
        axes = np.array([
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ])  # fmt: skip
        np.testing.assert_allclose(seen["linear_velocity"][k], axes.T @ sim.body_linvel[k, 1], atol=1e-12)
        np.testing.assert_allclose(seen["angular_velocity"][k], axes.T @ sim.body_angvel[k, 1], atol=1e-12)
        np.testing.assert_allclose(seen["vertical"][k], axes.T @ [0.0, 0.0, 1.0], atol=1e-12)
    assert np.abs(seen["linear_velocity"]).max() > 0.1


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
        changed = (np.asarray(values) != before[name]).reshape(400, -1).any(axis=1)
        np.testing.assert_array_equal(changed, mask)
    still = (envs.now.episode_state["commands"] == 0.0).all(axis=2).mean()
    # 800 draws of 0.1: a deviation of 0.01.
    assert 0.05 < still < 0.15


def test_commands_change_in_the_middle(envs):
    task = envs.task
    mine = StepperVectorEnv(Go1Velocity(episode_steps=20, max_push=0.0), 4)
    _, info = mine.reset(seed=0)
    commands = mine.now.episode_state["commands"].copy()
    assert (commands[:, 0] != commands[:, 1]).any()
    for step in range(1, 20):
        _, _, _, _, info = mine.step(stance(mine))
        np.testing.assert_array_equal(info["command"], commands[:, 0 if step < 10 else 1])
    assert task.episode_steps == 1000


def test_pushes_come_when_they_were_drawn(envs):
    """In free flight, beside a batch without pushes but with the same seeds: velocities differ by the pushes so far alone."""
    pushed, calm = (StepperVectorEnv(Go1Velocity(episode_steps=60, max_push=size), 4) for size in (0.5, 0.0))
    pushed.reset(seed=1), calm.reset(seed=1)
    episode_state = pushed.now.episode_state
    when, size = episode_state["push_steps"].copy(), episode_state["pushes"].copy()
    np.testing.assert_array_equal(when, calm.now.episode_state["push_steps"])
    qpos = np.array(pushed.sim.qpos)
    qpos[:, 2] = 30.0
    for each in (pushed, calm):
        each.set_state(qpos, each.sim.qvel)
    for step in range(1, 61):
        pushed.step(stance(pushed)), calm.step(stance(calm))
        expected = np.einsum("nk,nki->ni", when <= step, size)
        difference = pushed.sim.qvel - calm.sim.qvel
        np.testing.assert_allclose(difference[:, :2], expected, atol=1e-9)
        np.testing.assert_allclose(difference[:, 2:], 0.0, atol=1e-9)
    assert (when < 60).all()
    assert np.abs(expected).max() > 0.1


def test_strides_are_what_feet_are_in_the_air_when_they_land():
    """A foot lands where its lowest point comes within 1 cm of the ground; its time in the air beyond 0.1 s counts, up to 0.3 s."""
    envs = StepperVectorEnv(Go1Velocity(max_push=0.0), 8)
    envs.reset(seed=5)
    qpos = np.array(envs.sim.qpos)
    qpos[:, 2] = [0.28, 0.3, 0.32, 0.35, 0.4, 0.5, 0.7, 0.9]  # Falls of nothing to 0.35 s.
    envs.set_state(qpos, np.zeros((8, 18)))
    sites = [envs.sim.model.site_names.index(name) for name in ("FR", "FL", "RR", "RL")]
    air, gained, moves = np.zeros((8, 4)), [], np.linalg.norm(envs.now.episode_state["commands"][:, 0], axis=1) > 0.1
    for _ in range(25):
        info = envs.step(stance(envs))[4]
        height = envs.sim.site_xpos[:, sites, 2] - 0.023
        expected = np.where((height < 0.01) & (air > 0.0), np.minimum(air, 0.3) - 0.1, 0.0).sum(axis=1)
        air = np.where(height < 0.01, 0.0, air + 0.02)
        np.testing.assert_allclose(info["reward_stride"], 3.0 * expected * moves, atol=1e-12)
        gained.append(info["reward_stride"])
    assert np.min(gained) < 0.0
    assert np.max(gained) > 0.5


@pytest.mark.parametrize("latency", [0, 1, 3, 4])
def test_actions_are_late_by_whole_steps(latency):
    envs = StepperVectorEnv(Go1Velocity(max_push=0.0), 2)
    envs.reset(seed=2)
    envs.now.episode_state["latency"][:] = latency
    alone = stepper.Stepper(envs.sim.model, 2, options=envs.sim.options)
    alone.randomize(**envs.sim.randomized)
    alone.reset(qpos=envs.sim.qpos, qvel=envs.sim.qvel)
    last = stance(envs)
    for k in range(5):
        action = np.random.default_rng(k).uniform(envs.action_space.low, envs.action_space.high)
        envs.step(action)
        if latency:
            alone.step(last, latency)
        if latency < 4:
            alone.step(action, 4 - latency)
        last = action
        np.testing.assert_array_equal(envs.sim.qpos, alone.qpos)


def test_an_environment_is_the_same_alone_among_others_and_after_a_pickle(envs):
    alone = StepperEnv(Go1Velocity())
    observation = alone.reset(seed=3 + 7)[0]
    rng = np.random.default_rng(0)
    for k in range(30):
        actions = rng.uniform(envs.action_space.low, envs.action_space.high)
        if k == 15:
            envs = pickle.loads(pickle.dumps(envs))
        batch, reward, terminated, _, _ = envs.step(actions)
        observation, own, over, _, _ = alone.step(actions[7])
        if over:
            assert terminated[7]
            break
        np.testing.assert_array_equal(observation, batch[7])
        assert own == reward[7]
    assert k > 5


def rows(envs, observation):
    ends = np.cumsum([0, *envs.observation_structure.values()])
    return {name: observation[:, a:b] for name, a, b in zip(envs.observation_structure, ends, ends[1:], strict=False)}


@pytest.mark.parametrize("kind", [Go1Velocity, G1Velocity])
def test_sensors_read_what_it_is_told_without_errors(kind):
    """With errors of 1e-9 rows are the truth's; the velocity is that of the IMU, which is not at the base's origin."""
    same = {"max_push": 0.3}
    told, true = (StepperVectorEnv(kind(noise=noise, **same), 12) for noise in (1e-9, 0.0))
    found, expected = told.reset(seed=2)[0], true.reset(seed=2)[0]
    for k in range(15):
        np.testing.assert_array_equal(told.sim.qpos, true.sim.qpos)
        one, other = rows(told, found), rows(true, expected)
        site = true.sim.model.site(told.task.imu)
        arm = np.cross(other["angular_velocity"], site.pos)
        np.testing.assert_allclose(one.pop("linear_velocity"), other.pop("linear_velocity") + arm, atol=1e-7)
        for name, row in one.items():
            np.testing.assert_allclose(row, other[name], atol=1e-7, err_msg=name)
        action = np.random.default_rng(k).uniform(told.action_space.low, told.action_space.high)
        found, expected = told.step(action)[0], true.step(action)[0]
    assert told.sim.model.site(told.task.imu).bodyid == 1


def test_errors_have_the_widths_of_mjlabs_training():
    told, true = StepperVectorEnv(Go1Velocity(noise=1.0), 500), StepperVectorEnv(Go1Velocity(noise=1e-9), 500)
    one, other = rows(told, told.reset(seed=0)[0]), rows(true, true.reset(seed=0)[0])
    for name, width in Go1Velocity.ERRORS.items():
        errors = one[name] - other[name]
        # Of 1,500 uniform errors the ends are missed by a fiftieth once in 1e6 times; those of the vertical turn it.
        assert 0.95 * width < np.abs(errors).max() < width * (1.0 if name != "vertical" else 2.0) * 1.000001, name
    np.testing.assert_array_equal(one["command"], other["command"])
    # Rewards are of the truth.
    stances = stance(told)
    np.testing.assert_array_equal(told.step(stances)[1], true.step(stances)[1])


def test_motors_have_curves_and_friction():
    """Joints that turn faster than their motors without load get no torque in that direction, where those without curves do."""
    task = Go1Velocity(motors=True, max_push=0.0, max_latency=0)
    plain = Go1Velocity(max_push=0.0, max_latency=0)
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
    """Where `stepper.sensors.HeightField` scans it, between the points of whose grid the ground's function is the smoother."""
    envs = StepperVectorEnv(Go1Velocity(roughness=0.3, sight=0.5), 20)
    seen = rows(envs, envs.reset(seed=4)[0])["ground"]
    places = 0.5 * np.stack(np.meshgrid(*[np.linspace(-1, 1, 5)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    scan = stepper.sensors.HeightField(envs.sim.model, "terrain").scan(envs.sim, "trunk", places) - envs.sim.xpos[:, [1], 2]
    assert seen.shape == (20, 25)
    np.testing.assert_allclose(seen, scan, atol=0.01)
    assert np.ptp(seen, axis=1).min() > 0.02
    flat = StepperVectorEnv(Go1Velocity(sight=0.5), 2)
    np.testing.assert_allclose(rows(flat, flat.reset(seed=0)[0])["ground"], -np.asarray(flat.sim.qpos[:, 2:3]).repeat(25, axis=1))


def test_what_is_real_is_registered(envs):
    for name in ("Go1", "G1"):
        made = gymnasium.make_vec(f"stepper/{name}VelocityReal-v0", num_envs=3, precision="f32")
        assert made.unwrapped.sim.sensors is not None and made.unwrapped.sim.actuators is not None
        made.reset(seed=0)
        assert np.isfinite(made.step(made.action_space.sample())[0]).all()
        assert envs.sim.sensors is None and envs.sim.actuators is None
    with pytest.raises(ValueError, match="noise is -1, must be at least 0 and finite"):
        Go1Velocity(noise=-1)


def test_it_is_registered_and_ends_where_it_falls():
    env = gymnasium.make("stepper/Go1Velocity-v0", max_push=0.0)
    env.reset(seed=0)
    sim = env.unwrapped.sim
    for quat, height, over in (([1, 0, 0, 0], 0.3, False), ([0.7, 0.7, 0, 0], 0.3, True), ([1, 0, 0, 0], 0.1, True)):
        qpos = np.array(sim.qpos[0])
        qpos[2], qpos[3:7] = height, quat
        env.unwrapped.set_state(qpos, np.zeros(18))
        assert env.step(stance_of(env))[2] == over


def stance_of(env):
    return env.unwrapped.task.episode_state(1)["last"][0]


def test_the_policy_that_is_kept_follows_its_commands():
    """Within 0.25 m/s in x and y, with pushes; one that stands in its stance does not."""
    policy = load(Path(__file__).parents[2] / "examples/policies/go1_velocity.npz")
    standing = Go1Velocity().episode_state(32)["last"]
    follows, stands = (
        evaluate(act, "stepper/Go1Velocity-v0", episodes=32, seed=7, infos=("tracking_error",), precision="f32").infos["tracking_error"]
        for act in (policy, lambda observation: standing)
    )
    assert follows.mean() < 0.25
    assert stands.mean() > 0.4
