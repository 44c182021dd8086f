"""Environments under MuJoCo's law of contact are Gymnasium's own: observations, rewards, terminations, infos, and starts."""

from dataclasses import fields, replace
from inspect import signature

import gymnasium
import mujoco
import mujoco_vector
import numpy as np
import pytest
import stepper
from envs.cases import kolmogorov_smirnov, needs_gymnasiums
from gymnasium.vector import AutoresetMode
from stepper.envs import TASKS, StepperEnv

pytestmark = needs_gymnasiums


def step_and_refresh(env):
    """Let an environment read everything at the state after the step."""
    # A Runge-Kutta step of MuJoCo leaves positions and velocities of bodies and tendons as its last stage found them. Here they are
    # computed again. Of other integrators both engines read the beginning of the last step. Contacts and their forces stay those of the
    # last stage, in both engines.
    if env.model.opt.integrator != mujoco.mjtIntegrator.mjINT_RK4:
        return
    model, data, fresh = env.model, env.data, mujoco.MjData(env.model)

    def simulate(ctrl, n_frames):
        data.ctrl[:] = ctrl
        mujoco.mj_step(model, data, nstep=n_frames)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        fresh.qpos[:], fresh.qvel[:] = data.qpos, data.qvel
        mujoco.mj_forward(model, fresh)
        data.ten_length[:], data.ten_velocity[:] = fresh.ten_length, fresh.ten_velocity
        mujoco.mj_rnePostConstraint(model, data)

    env._step_mujoco_simulation = simulate


def pair(name):
    """Gymnasium's environment and ours, both with solvers that converge."""
    theirs = gymnasium.make(f"{name}-v5").unwrapped
    option = theirs.model.opt
    option.solver, option.tolerance, option.iterations = mujoco.mjtSolver.mjSOL_NEWTON, 1e-14, 200
    task = TASKS[name]()
    return theirs, StepperEnv(task, options=replace(stepper.Options.from_model(task.model()), tolerance=1e-12, iterations=200))


def from_the_same_states(theirs, ours, steps, seed=0):
    """Random actions, each after setting the state of Gymnasium's environment in ours."""
    ours.reset(seed=0)
    rng = np.random.default_rng(seed)
    for k in range(steps):
        if k % 20 == 0:
            theirs.reset(seed=k)
        mujoco.mj_forward(theirs.model, theirs.data)
        ours.set_state(theirs.data.qpos, theirs.data.qvel)
        yield rng.uniform(theirs.action_space.low, theirs.action_space.high).astype(np.float64)


def differences(theirs, ours, steps):
    """Largest difference of each row of the observation, of the reward and of each info, over steps from the same states."""
    worst = {}
    for action in from_the_same_states(theirs, ours, steps):
        observation, reward, terminated, truncated, info = theirs.step(action)
        found, found_reward, *flags, found_info = ours.step(action)
        assert flags == [terminated, truncated]
        assert list(found_info) == list(info)
        rows = np.split(np.abs(found - observation), np.cumsum(list(ours.observation_structure.values()))[:-1])
        said = dict(zip(ours.observation_structure, rows, strict=True))
        said |= {"reward": found_reward - reward, **{key: found_info[key] - np.asarray(value) for key, value in info.items()}}
        for key, value in said.items():
            worst[key] = max(worst.get(key, 0.0), float(np.abs(value).max(initial=0.0)))
    return worst


@pytest.mark.parametrize("name", sorted(TASKS))
def test_every_step_is_gymnasiums(name):
    theirs, ours = pair(name)
    step_and_refresh(theirs)
    worst = differences(theirs, ours, 300)
    # Both solve the same convex problem to round-off, some 1e-14 of velocities of up to 1e2, and an action is up to five steps.
    # Forces of contacts reach 4e3 N.
    bounds = dict.fromkeys(worst, 1e-10) | {"cfrc_ext": 1e-9}
    assert {key: value for key, value in worst.items() if not value < bounds[key]} == {}


def test_without_a_refresh_gymnasium_observes_the_last_stage():
    """The fingertip differs by far more than rounding: the reference needs `step_and_refresh`."""
    assert differences(*pair("Reacher"), 20)["fingertip"] > 1e-6


def test_the_double_pendulum_observes_the_force_of_the_carts_limit():
    theirs, ours = pair("InvertedDoublePendulum")
    theirs.reset(seed=0), ours.reset(seed=0)
    largest = 0.0
    for x, velocity in [(0.98, 0.3), (-0.99, -0.1), (0.9, 0.1)]:
        state = np.array([x, 0.1, -0.1]), np.array([velocity, 0.0, 0.0])
        theirs.set_state(*state), ours.set_state(*state)
        found, expected = ours.step(np.zeros(1))[0], theirs.step(np.zeros(1))[0]
        np.testing.assert_allclose(found[-1], expected[-1], atol=1e-10)
        largest = max(largest, abs(expected[-1]))
    assert largest == 10.0


@pytest.mark.parametrize("name", sorted(TASKS))
def test_arguments_are_gymnasiums(name):
    theirs = signature(type(gymnasium.make(f"{name}-v5").unwrapped).__init__).parameters
    drawn = {"self", "default_camera_config", "kwargs"}
    assert {field.name: field.default for field in fields(TASKS[name])} == {
        key: value.default for key, value in theirs.items() if key not in drawn
    }


@pytest.mark.parametrize("name", sorted(TASKS))
def test_spaces_and_dt_are_gymnasiums(name):
    theirs, ours = gymnasium.make(f"{name}-v5").unwrapped, StepperEnv(name)
    assert (ours.observation_space, ours.action_space, ours.dt) == (theirs.observation_space, theirs.action_space, theirs.dt)
    assert ours.metadata["render_fps"] == theirs.metadata["render_fps"]
    assert list(ours.reset(seed=0)[1]) == list(theirs.reset(seed=0)[1])


@pytest.mark.parametrize("name", sorted(TASKS))
def test_starts_are_drawn_from_gymnasiums_distribution(name):
    """Ranks of 1,000 starts of ours among as many of theirs, number by number: Kolmogorov and Smirnov's distance."""
    theirs = gymnasium.make(f"{name}-v5").unwrapped
    ours = stepper.envs.StepperVectorEnv(name, 1000)
    ours.reset(seed=0)
    found = np.hstack([ours.sim.qpos, ours.sim.qvel])
    expected = np.array([theirs.reset(seed=k)[0] is None or theirs.state_vector() for k in range(1000)])
    if theirs.model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE:
        expected[:, 3:7] /= np.linalg.norm(expected[:, 3:7], axis=1, keepdims=True)
    for one, other in zip(found.T, expected.T, strict=True):
        # Of two samples of one distribution it exceeds 0.1 once in 1e4 times.
        assert kolmogorov_smirnov(one, other) < 0.1


def converge(m):
    """Has MuJoCo solve to round-off, wherever its solver starts from."""
    m.opt.solver, m.opt.tolerance, m.opt.iterations = mujoco.mjtSolver.mjSOL_NEWTON, 1e-14, 200


@pytest.mark.parametrize("name", ["HalfCheetah", "Hopper", "Walker2d", "Ant", "Humanoid"])
def test_a_step_is_gymnasiums(name):
    task = TASKS[name]()
    m = mujoco_vector.mujoco_model(task.model(), with_contact_forces=mujoco_vector.reads_contact_forces(task))
    converge(m)
    envs = mujoco_vector.MujocoVectorEnv(task, 3, autoreset_mode=AutoresetMode.DISABLED, m=m)
    envs.reset(seed=0)
    theirs = [gymnasium.make(f"{name}-v5").unwrapped for _ in range(3)]
    rng = np.random.default_rng(0)
    for one in theirs:
        converge(one.model)
        one.reset(seed=0)
    for _ in range(4):
        qpos = np.array([one.init_qpos + rng.uniform(-0.005, 0.005, one.model.nq) for one in theirs])
        qvel = rng.uniform(-0.01, 0.01, (3, theirs[0].model.nv))
        for k, one in enumerate(theirs):
            if name in ("Ant", "Humanoid"):
                qpos[k, 3:7] /= np.linalg.norm(qpos[k, 3:7])
            one.set_state(qpos[k], qvel[k])
        envs.reset(options={"reset_mask": np.ones(3, dtype=bool)})
        envs.set_state(qpos, qvel)
        for _ in range(3):
            action = rng.uniform(envs.action_space.low, envs.action_space.high)
            observation, reward, terminated, *_ = envs.step(action)
            if terminated.any():
                break
            for k, one in enumerate(theirs):
                found, their_reward, their_end, *_ = one.step(action[k])
                np.testing.assert_allclose(observation[k], found, rtol=1e-8, atol=1e-10 * (1 + np.abs(found).max()))
                # Gymnasium reads the places of the ant and the humanoid in the last stage of a Runge-Kutta step:
                # docs/reference/environments.md.
                if name not in ("Ant", "Humanoid"):
                    assert reward[k] == pytest.approx(their_reward, rel=1e-8, abs=1e-8)
                assert terminated[k] == their_end


def test_it_is_registered_for_learners():
    name = mujoco_vector.register("Hopper-v5")
    envs = gymnasium.make_vec(name, num_envs=4, autoreset_mode=AutoresetMode.SAME_STEP)
    envs.reset(seed=0)
    ended = 0
    for _ in range(60):
        *_, terminated, _, info = envs.step(envs.action_space.sample())
        ended += int(terminated.sum())
        assert ("final_obs" in info) == bool(terminated.any())
    assert ended > 0


def test_what_a_batch_has_not_is_said():
    envs = mujoco_vector.MujocoVectorEnv(TASKS["Hopper"](), 2)
    with pytest.raises(AttributeError, match="no attribute 'residual'"):
        _ = envs._envs.sim.residual
