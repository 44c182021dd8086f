"""Velocity tasks on rough terrain: what they observe, where episodes begin and end, commands, pushes, rewards and levels."""

import pickle
from importlib.util import find_spec
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import stepper.envs
from checks import raises
from stepper.envs import StepperVectorEnv
from stepper.envs.locomotion import G1Rough, Go1Rough
from stepper.envs.locomotion.rewards import SCAN, action_scale, foot_heights, foot_speeds, ground_normal

pytestmark = pytest.mark.skipif(find_spec("mjlab") is None, reason="mjlab, whose robots these are, is not installed: make training")

GROUND = Go1Rough().terrain


def made(num_envs=8, *, kind=Go1Rough, limit=1000, rewards=None, **given):
    envs = StepperVectorEnv(kind(**given), num_envs, max_episode_steps=limit, autoreset_mode="SameStep", rewards=rewards)
    return envs, envs.reset(seed=3)[0]


def rows(envs, observation):
    ends = np.cumsum([0, *envs.observation_structure.values()])
    return {name: observation[:, a:b] for name, a, b in zip(envs.observation_structure, ends, ends[1:], strict=False)}


def commanded(envs, values):
    """Sets the commands, (3,) or (num_envs, 3), for the rest of the episodes."""
    drawn = envs._batch.terms.drawn["twist"]
    drawn[:, :3], drawn[:, 3] = values, np.nan
    envs._batch.terms._left["twist"][:] = 10**6


def standing(envs):
    return np.zeros(envs.action_space.shape)


@pytest.mark.parametrize(("name", "size"), [("Go1Rough-v0", 48 + 187), ("G1Rough-v0", 99 + 187)])
@pytest.mark.parametrize("contact", ["hard", "mujoco"])
def test_it_runs_under_both_laws(name, size, contact):
    envs = gymnasium.make_vec(f"stepper/{name}", num_envs=4, contact=contact)
    envs.reset(seed=0)
    envs.action_space.seed(0)
    for _ in range(20):
        observation, reward, *_ = envs.step(0.3 * envs.action_space.sample())
    assert observation.shape == (4, size)
    assert np.isfinite(observation).all()
    assert (np.abs(reward) < 1.0).all()


def test_it_begins_on_the_tile_of_its_level_above_the_ground():
    envs, _ = made(64)
    state, base = envs.now.episode_state, envs.sim.qpos
    level, kind = state["terrain_level"], state["terrain_type"]
    assert ((level >= 0) & (level <= 5)).all()
    assert len(set(kind)) == len(GROUND.sub_terrains)
    assert (np.abs(base[:, :2] - GROUND.origins[level, kind][:, :2]) <= 0.5).all()
    # Feet are balls of 0.023 m. In the stance they are on flat ground, and the stance is lifted by 0.01 m or more.
    assert (foot_heights(envs.now) > 0.0325).all()
    envs.step(standing(envs))
    # Position correction leaves up to a millimetre or two in the first steps of a landing.
    assert envs.sim.max_penetration.max() < 2e-3


def test_it_stands_on_flat_ground_and_gains_for_it():
    envs, _ = made(4, noise=0.0, push=0.0)
    commanded(envs, 0.0)
    qpos = np.array(envs.sim.qpos)
    qpos[:, :2] = GROUND.origins[0, 0, :2]
    qpos[:, 2] = 0.2945
    envs.set_state(qpos, np.zeros((4, 18)))
    for _ in range(60):
        _, _, terminated, _, info = envs.step(standing(envs))
        assert not terminated.any()
    # Servos give way, and the centre of mass is shifted: a tilt of 8 degrees gives 0.9.
    for name, least in (("track_linear_velocity", 1.9), ("track_angular_velocity", 1.9), ("upright", 0.9)):
        assert (info[f"reward_{name}"] / envs.dt > least).all(), name
    # Those that cost: nothing moves any more.
    for name in ("action_rate", "foot_clearance", "foot_slip", "soft_landing", "shank_collision", "trunk_collision"):
        np.testing.assert_allclose(info[f"reward_{name}"], 0.0, atol=1e-4)
    np.testing.assert_allclose(ground_normal(envs.now)[:, 2], 1.0, atol=0.02)


def test_without_noise_it_observes_the_truth():
    envs, _ = made(noise=0.0)
    for _ in range(10):
        observation = envs.step(0.5 * envs.action_space.sample())[0]
    seen, sim = rows(envs, observation), envs.sim
    w, x, y, z = sim.qpos[:, 3:7].T
    axes = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
    np.testing.assert_allclose(seen["base_lin_vel"], np.einsum("ijn,ni->nj", axes, sim.body_linvel[:, 1]), atol=1e-12)
    np.testing.assert_allclose(seen["base_ang_vel"], np.einsum("ijn,ni->nj", axes, sim.body_angvel[:, 1]), atol=1e-12)
    np.testing.assert_allclose(seen["projected_gravity"], -axes[2].T, atol=1e-12)
    np.testing.assert_array_equal(seen["joint_vel"], sim.qvel[:, 6:])
    np.testing.assert_array_equal(seen["actions"], envs.now.action)
    # By another function of the height field, of the model.
    scan = stepper.sensors.HeightField(sim.model, "terrain").scan(sim, "trunk", SCAN)
    np.testing.assert_allclose(seen["height_scan"], (sim.qpos[:, 2:3] - scan) / 5.0, atol=1e-9)


def test_noise_has_mjlabs_width():
    envs, first = made(200)
    true, _ = made(200, noise=0.0)
    np.testing.assert_array_equal(envs.sim.qpos, true.sim.qpos)  # Other noise, the same starts.
    errors = {name: row - rows(true, true._batch.observation())[name] for name, row in rows(envs, first).items()}
    for name, width in {"base_lin_vel": 0.5, "base_ang_vel": 0.2, "joint_vel": 1.5, "height_scan": 0.02}.items():
        # 600 numbers or more: the ends are missed by a twentieth once in 1e6 times.
        assert 0.95 * width < np.abs(errors[name]).max() <= width, name
    assert np.abs(errors["joint_pos"]).max() <= 0.01 + 0.015
    assert not errors["command"].any()
    assert not errors["actions"].any()


def test_actions_are_quarters_of_the_largest_torque():
    envs, _ = made(2, noise=0.0)
    model = envs.sim.model
    envs.step(standing(envs) + 1.0)
    stance = model.keyframe("stance").qpos[7:]
    np.testing.assert_allclose(envs.sim.ctrl, np.broadcast_to(stance + action_scale(model), (2, 12)), atol=1e-12)
    torque = model.actuator_forcerange[:, 1]
    np.testing.assert_allclose(action_scale(model) * model.actuator_gainprm[:, 0], torque / 4.0, rtol=1e-9)
    low, high = envs.task.action_bounds(model)
    assert (stance + action_scale(model) * high <= model.actuator_ctrlrange[:, 1] + 1e-12).all()
    assert (low == -high).all()


def test_commands_change_within_their_times_and_bounds():
    envs, _ = made(8, push=0.0)
    drawn, changes = envs._batch.terms.drawn["twist"], []
    qpos, qvel = np.array(envs.sim.qpos), np.zeros((8, 18))
    qpos[:, 2] = 30.0  # In free flight nothing ends the episode.
    before = drawn[:, 4].copy(), drawn[:, :3].copy()
    for _ in range(410):
        envs.set_state(qpos, qvel)
        envs.step(standing(envs))
        changes.append((drawn[:, :3] != before[1]).any(axis=1))
        before = drawn[:, 4].copy(), drawn[:, :3].copy()
        assert (np.abs(envs.now.command()) <= [1.0, 1.0, 0.5]).all()
    for column in np.array(changes).T:
        times = np.diff(np.flatnonzero(column)) * envs.dt
        assert ((times >= 3.0 - envs.dt) & (times <= 8.0 + envs.dt)).all()
        assert column.any()


def test_later_stages_are_faster():
    envs, _ = made(400)
    envs._batch.streams.ages[:] = 240_000
    envs.reset()
    commands = envs._batch.terms.drawn["twist"]
    assert -2.0 <= commands[:, 0].min() < -1.8
    assert 2.8 < commands[:, 0].max() <= 3.0


def test_pushes_change_the_velocity_and_come_within_their_times():
    """In free flight beside the same without pushes."""
    pushed, _ = made(4, noise=0.0)
    calm, _ = made(4, noise=0.0, push=0.0)
    times = [[] for _ in range(4)]
    for k in range(320):
        for each in (pushed, calm):
            qpos = np.array(calm.sim.qpos)
            qpos[:, 2] = 30.0
            each.set_state(qpos, calm.sim.qvel)
            each.step(standing(each))
        change = pushed.sim.qvel[:, :3] - calm.sim.qvel[:, :3]
        # Legs move against the trunk, whose rates of turn changed at once.
        assert (np.abs(change) <= [0.6, 0.6, 0.5]).all()
        for env in np.flatnonzero(np.abs(change).max(axis=1) > 1e-3):
            times[env].append(k)
    for each in times:
        gaps = np.diff([0, *each]) * pushed.dt
        assert ((gaps >= 1.0 - 2 * pushed.dt) & (gaps <= 3.0 + pushed.dt)).all()


def test_a_hit_of_a_thigh_ends_an_episode():
    envs, _ = made(4, push=0.0)
    qpos = np.array(envs.sim.qpos)
    qpos[:2, 3:7] = [np.cos(np.pi / 4), np.sin(np.pi / 4), 0.0, 0.0]  # On its side.
    qpos[:, :2] = GROUND.origins[0, 0, :2]
    qpos[:, 2] = 0.2945
    envs.set_state(qpos, np.zeros((4, 18)))
    over, hit = np.zeros(4, dtype=bool), np.zeros(4, dtype=bool)
    for _ in range(30):
        going = ~over
        _, _, terminated, truncated, _ = envs.step(standing(envs))
        hit |= going & terminated
        over |= terminated
        assert not truncated.any()
    assert hit.tolist() == [True, True, False, False]


def test_beside_the_terrain_an_episode_is_cut_short():
    envs, _ = made(3, push=0.0)
    qpos = np.array(envs.sim.qpos)
    qpos[1, 0] = GROUND.half[0] - 0.1
    qpos[1, 2] = 0.2945
    envs.set_state(qpos, np.zeros((3, 18)))
    _, _, terminated, truncated, info = envs.step(standing(envs))
    assert truncated.tolist() == [False, True, False]
    assert not terminated.any()
    assert info["final_obs"][1] is not None


def test_levels_follow_the_way_that_was_made():
    envs, _ = made(4, limit=1, push=0.0)
    state = envs.now.episode_state
    state["terrain_level"][:] = [2, 2, 2, 9]
    state["terrain_type"][:] = 0  # Flat tiles.
    state["terrain_origin"][:] = GROUND.origins[state["terrain_level"], 0]
    commanded(envs, [[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    qpos = np.array(envs.sim.qpos)
    qpos[:, :2] = state["terrain_origin"][:, :2] + np.array([[4.5, 0.0], [1.0, 0.0], [1.0, 0.0], [0.0, -4.5]])
    qpos[:, 2] = 0.2945
    envs.set_state(qpos, np.zeros((4, 18)))
    envs.step(standing(envs))  # Each episode has one action.
    # It left its tile; it made less than half of 20 m; it was to stand; it solved the hardest row, and goes to any.
    assert state["terrain_level"][:3].tolist() == [3, 1, 2]
    assert 0 <= state["terrain_level"][3] < GROUND.num_rows
    np.testing.assert_array_equal(state["terrain_origin"], GROUND.origins[state["terrain_level"], 0])


def test_speeds_of_feet_are_those_of_their_places():
    envs, _ = made(3, push=0.0)
    for _ in range(5):
        envs.step(envs.action_space.sample())
    sim, h = envs.sim, 1e-6
    sites = [sim.model.site(name).id for name in Go1Rough.FEET]
    qpos, qvel, found = np.array(sim.qpos), np.array(sim.qvel), foot_speeds(envs.now)
    before = np.array(sim.site_xpos[:, sites, :2])
    ahead = qpos + h * np.hstack([qvel[:, :3], np.zeros((3, 4)), qvel[:, 6:]])
    w, v = qpos[:, 3:4], qpos[:, 4:7]
    turn = 0.5 * h * np.hstack([-(v * qvel[:, 3:6]).sum(axis=1, keepdims=True), w * qvel[:, 3:6] + np.cross(v, qvel[:, 3:6])])
    ahead[:, 3:7] = qpos[:, 3:7] + turn
    sim.set_state(qpos=ahead)
    moved = np.linalg.norm(np.array(sim.site_xpos[:, sites, :2]) - before, axis=-1) / h
    # A difference over 1e-6 s of speeds up to 5 m/s and accelerations of 100 m/s^2.
    np.testing.assert_allclose(found, moved, atol=1e-3)


def test_parameters_are_drawn_per_episode():
    envs, _ = made(200)
    model, own = envs.sim.model, envs.sim.randomized
    feet = [model.geom(name).id for names in Go1Rough.FEET.values() for name in names]
    friction = own["geom_friction"][:, feet, 0]
    assert (friction == friction[:, :1]).all()
    assert 0.3 <= friction.min() < 0.35
    assert 1.45 < friction.max() <= 1.5
    shift = own["body_ipos"][:, 1] - model.body_ipos[1]
    assert (np.abs(shift) <= [0.025, 0.025, 0.03]).all()
    assert (np.abs(shift).max(axis=0) > [0.023, 0.023, 0.028]).all()


def test_feet_in_the_air_are_rewarded_for_a_while():
    envs, _ = made(2, noise=0.0, push=0.0, rewards={"air_time": 50.0})
    qpos = np.array(envs.sim.qpos)
    commanded(envs, [[0.6, 0.0, 0.0], [0.4, 0.0, 0.0]])
    qpos[:, 2] += 3.0  # It falls for 0.7 s.
    envs.set_state(qpos, np.zeros((2, 18)))
    found = np.array([envs.step(standing(envs))[-1]["reward_air_time"] for _ in range(30)])
    # An action takes 0.02 s: from 0.06 s to 0.48 s all four feet count, if the command is above 0.5.
    np.testing.assert_array_equal(found[:, 0], np.where((np.arange(1, 31) >= 3) & (np.arange(1, 31) <= 24), 4.0, 0.0))
    np.testing.assert_array_equal(found[:, 1], 0.0)


def test_it_pickles():
    envs, _ = made(4, limit=15)
    envs.action_space.seed(0)
    for _ in range(20):
        envs.step(0.5 * envs.action_space.sample())
    other = pickle.loads(pickle.dumps(envs))
    assert len(pickle.dumps(envs.task)) < 4000  # Without the heights of the terrain, which are megabytes.
    for _ in range(20):
        action = 0.5 * envs.action_space.sample()
        for mine, theirs in zip(other.step(action)[:4], envs.step(action)[:4], strict=True):
            np.testing.assert_array_equal(mine, theirs)


def test_every_robot_has_what_the_terms_need():
    """Tolerances for all joints, geoms and sites by their names, and weights of known terms, which the page of environments lists."""
    page = (Path(__file__).parents[2] / "docs/reference/environments.md").read_text()
    for kind in (Go1Rough, G1Rough):
        names = kind().rewards()
        envs, _ = made(2, kind=kind, rewards=dict.fromkeys(names, 1.0))
        *_, info = envs.step(standing(envs))
        assert all(np.isfinite(info[f"reward_{name}"]).all() for name in names)
        assert len(names) == 14
        assert [name for name in names if f"`{name}`" not in page] == []
    raises(TypeError, "terrain is 'stairs', must be a Terrain", Go1Rough, terrain="stairs")
    for wrong in (-1.0, np.inf):
        raises(ValueError, r"noise is .*, must be a finite number of at least 0", Go1Rough, noise=wrong)


def test_the_humanoid_ends_when_it_falls():
    envs, _ = made(2, kind=G1Rough, push=0.0)
    qpos = np.array(envs.sim.qpos)
    qpos[0, 3:7] = [np.cos(0.65), 0.0, np.sin(0.65), 0.0]  # 74 degrees.
    envs.set_state(qpos, np.zeros((2, 35)))
    *_, terminated, truncated, _ = envs.step(standing(envs))
    assert terminated.tolist() == [True, False]
    assert not truncated.any()
