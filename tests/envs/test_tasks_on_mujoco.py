"""benches/mujoco_vector.py: tasks over MuJoCo's batch say what Gymnasium's own environments say, so that races compare the same work."""

import gymnasium
import mujoco
import mujoco_vector
import numpy as np
import pytest
from envs.cases import needs_gymnasiums
from gymnasium.vector import AutoresetMode
from stepper.envs import TASKS


def converge(m):
    """Has MuJoCo solve to round-off, wherever its solver starts from."""
    m.opt.solver, m.opt.tolerance, m.opt.iterations = mujoco.mjtSolver.mjSOL_NEWTON, 1e-14, 200


@needs_gymnasiums
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
