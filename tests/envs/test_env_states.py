"""Copies and pickles of environments go on with the same bits, and rewards follow from the state that a step begins in."""

import copy
import functools
import pickle
from dataclasses import dataclass

import numpy as np
import pytest
import stepper
from envs.cases import same
from envs.test_hooks import Grouped, Levels
from envs.test_terms import Robot
from hypothesis import given, settings, strategies as st
from stepper.actuators import ActuatorModel, Drive
from stepper.envs import Observation, StepperEnv, StepperVectorEnv, Task
from stepper.envs.basic import FallingBlock
from stepper.sensors import SensorModel, Transfer
from stepper.shared.fields import APPLIED

N, LIMIT = 4, 5

SCENE = """<mujoco><worldbody>
    <body><joint name="x" type="slide" axis="1 0 0" damping="1"/><geom size=".1" mass="1"/></body>
    <body name="hand" mocap="true" pos="1 0 0"><geom size=".1"/></body>
  </worldbody>
  <actuator><motor joint="x" ctrlrange="-5 5" ctrllimited="true"/></actuator>
  <sensor><jointpos name="x" joint="x"/></sensor></mujoco>"""


@dataclass(frozen=True, kw_only=True)
class Everything(Task):
    """A task with all that an episode can have: errors of a sensor, delays, episode_state, noise, mocap."""

    frame_skip: int = 3

    def model(self):
        return _scene()

    def sensors(self):
        return SensorModel(default=Transfer(noise_std=0.1, delay=0.006))

    def actuators(self):
        return ActuatorModel(default=Drive(delay=0.004, friction=0.01))

    def episode_state(self, num_envs):
        return {"drawn": np.zeros(num_envs), "last": np.zeros((num_envs, 1))}

    def position(self, now):
        return now.qpos[:, 0]

    def observations(self):
        return (
            *(Observation(name) for name in ("sensordata", "qvel", "xpos", "mocap_pos", "time")),
            Observation("episode_state", func=lambda now: np.column_stack([now.episode_state["drawn"], now.episode_state["last"]])),
            Observation("step", func=lambda now: np.column_stack([now.action, now.velocity])),
        )

    def reset(self, reset):
        reset.qpos += reset.rng.uniform(-1.0, 1.0, 1)
        reset.episode_state["drawn"] = reset.rng.normal(1)[:, 0]
        mass = reset.sim.model.body_mass[1] * reset.rng.uniform(0.5, 2.0, 1)[:, 0]
        reset.sim.randomize({"body_mass[1]": mass}, envs=reset.envs)
        reset.mocap_pos[:, 0, 2] = reset.rng.uniform(0.5, 1.0, 1)[:, 0]

    def advance(self, now):
        now.episode_state["last"][:] = now.action
        now.step()

    def terminated(self, now):
        return np.abs(now.velocity) >= 1.5

    def reward(self, now):
        return now.velocity + now.episode_state["drawn"], {"x_velocity": now.velocity}


@functools.cache
def _scene():
    return stepper.load(SCENE)


TASKS = {
    "Everything": Everything(),
    "Levels": Levels(),
    "Robot": Robot(),
    "Grouped": Grouped(),
    "FallingBlock": FallingBlock(noise=0.01),
    "HalfCheetah": "HalfCheetah",
    "Humanoid": "Humanoid",
    "Pusher": "Pusher",
}


def made(name, mode="NextStep", **settings):
    return StepperVectorEnv(TASKS[name], N, autoreset_mode=mode, max_episode_steps=LIMIT, **settings)


def actions(envs, rng, count):
    """Actions within bounds, of which some are large enough to end episodes."""
    return rng.uniform(envs.action_space.low, envs.action_space.high, (count, *envs.action_space.shape))


def go_on(envs, taken):
    """All that environments say while they take actions, and while two of them are reset in between."""
    said = []
    for k, action in enumerate(taken):
        if k == len(taken) // 2:
            said.append(envs.reset(envs=[0, 2]))
        said.append(envs.step(action))
    return said


@pytest.mark.parametrize("name", TASKS)
def test_a_copy_of_a_single_environment_goes_on_with_the_same_bits(name):
    env = StepperEnv(TASKS[name], max_episode_steps=LIMIT)
    env.reset(seed=3)
    taken = np.random.default_rng(0).uniform(env.action_space.low, env.action_space.high, (5, *env.action_space.shape))
    for action in taken[:2]:
        env.step(action)
    other = pickle.loads(pickle.dumps(env))
    first, again = ([each.step(action) for action in taken[2:]] + [each.reset()] for each in (env, other))
    same(again, first)


def test_a_reward_follows_from_the_state_that_its_step_begins_in():
    """The way back to an earlier state is no motion: `sim.set_state` and then the same step give the same reward."""
    env = StepperEnv("HalfCheetah")
    env.reset(seed=0)
    kept, action = env.sim.get_state(), np.full(6, 0.3)
    first = env.step(action)
    for _ in range(5):
        env.step(-action)
    env.sim.set_state(kept)
    same(env.step(action), first)


def test_a_reward_follows_from_the_parameters_that_its_step_begins_with():
    """Another mass of the head moves the centre of mass of Humanoid at once, which is no velocity."""
    envs = made("Humanoid")
    envs.reset(seed=0)
    envs.step(np.zeros((N, 17)))
    masses = np.tile(envs.sim.model.body_mass, (N, 1))
    masses[:, -1] *= 100.0
    envs.sim.randomize(body_mass=masses)
    before = envs.sim.subtree_com[:, 0, 0].copy()
    info = envs.step(np.zeros((N, 17)))[-1]
    np.testing.assert_array_equal(info["x_velocity"], (envs.sim.subtree_com[:, 0, 0] - before) / envs.dt)


def test_places_are_those_of_the_present_once_the_state_is_another():
    """Pusher observes places from within the last step; after `sim.set_state`, it must not go on to do so."""
    envs, other = made("Pusher"), made("Pusher")
    for each in (envs, other):
        each.reset(seed=0)
    envs.step(np.ones((N, 7)))
    envs.sim.set_state(np.array(other.sim.qpos), np.zeros_like(envs.sim.qvel), np.arange(N) == 2)
    tip = envs.sim.model.body_names.index("tips_arm")
    observation, _ = envs.reset(envs=[0])
    np.testing.assert_array_equal(observation[2, 14:17], other.sim.xpos[2, tip])


def test_now_is_of_the_present_state():
    envs = made("HalfCheetah")
    envs.reset(seed=0)
    assert envs.now.qpos is envs.now.qpos
    qpos = np.array(envs.now.qpos) + 1.0
    envs.sim.set_state(qpos)
    np.testing.assert_array_equal(envs.now.qpos, qpos)
    assert not envs.now.action.any()


def test_a_moment_that_is_over_refuses_what_nobody_read():
    envs = made("HalfCheetah")
    envs.reset(seed=0)
    moment = envs.now
    height = moment.qpos.copy()
    envs.step(np.ones((N, 6)))
    np.testing.assert_array_equal(moment.qpos, height)
    with pytest.raises(RuntimeError, match="xpos is a quantity of a past moment, which was not read then"):
        _ = moment.xpos


def test_setting_a_state_leaves_others_and_their_last_step():
    envs = made("Pusher")
    envs.reset(seed=0)
    before = envs.step(np.ones((N, 7)))[0]
    observation = envs.set_state(envs.sim.qpos[[1]] * 0.0, envs.sim.qvel[[1]] * 0.0, envs=[1])
    others = np.arange(N) != 1
    np.testing.assert_array_equal(observation[others], before[others])
    assert not np.array_equal(observation[1], before[1])
    np.testing.assert_array_equal(envs.now.action, np.where(others[:, None], np.ones(7), 0.0))


@pytest.mark.parametrize("place", range(len(APPLIED)))
def test_names_of_writable_arrays_are_in_the_order_of_the_core(place):
    """A pickled stepper has a list without names, with None for each array that was never used."""
    sim = stepper.Stepper(_scene(), 2)
    getattr(sim, APPLIED[place])
    assert [array is not None for array in sim.__getstate__()["applied"]] == [k == place for k in range(len(APPLIED))]


def test_the_time_of_an_episode_goes_on_in_another_process():
    """Another process has another clock: what a pickle has of time is a duration."""
    envs = StepperVectorEnv("HalfCheetah", 2, max_episode_steps=2, episode_statistics=True)
    envs.reset(seed=0)
    envs.step(np.zeros((2, 6)))
    state = envs.__getstate__()
    state["_since"] = state["_since"] + 100.0  # As if the episodes had taken so much longer before.
    other = pickle.loads(pickle.dumps(envs))
    other.__setstate__(state)
    duration = other.step(np.zeros((2, 6)))[-1]["episode"]["t"]
    assert (duration > 100.0).all()
    assert (duration < 200.0).all()


# What happens to a batch between two steps, by name: a batch, a mask of environments, and random numbers.


def _take_a_step(envs, mask, rng):
    before = _place(envs)
    *_, info = envs.step(actions(envs, rng, 1)[0])
    if "x_velocity" in info:
        rows = info["_x_velocity"]  # Others began an episode.
        np.testing.assert_array_equal(info["x_velocity"][rows], ((_place(envs) - before) / envs.dt)[rows])


def _place(envs):
    """What the velocity of a task is the rate of change of."""
    return np.array(envs.sim.subtree_com[:, 0, 0] if envs.task.__class__.__name__ == "Humanoid" else envs.sim.qpos[:, 0])


def _set_the_steppers_state(envs, mask, rng):
    qpos, qvel = envs.sim.qpos + rng.uniform(-0.01, 0.01, envs.sim.qpos.shape), rng.uniform(-0.1, 0.1, envs.sim.qvel.shape)
    envs.sim.set_state(qpos, qvel, mask)


def _restore_the_steppers_state(envs, mask, rng):
    kept = envs.sim.get_state()
    envs.sim.step(nstep=3)
    envs.sim.set_state(kept, envs=mask)


def _draw_drives(envs, mask, rng):
    if envs.sim.actuators is not None:
        envs.sim.randomize(mask, actuators=ActuatorModel(default=Drive(delay=0.002, friction=rng.uniform(0.01, 0.1, N))))


def _apply_forces(envs, mask, rng):
    envs.sim.qfrc_applied[mask] = rng.uniform(-0.1, 0.1, envs.sim.qfrc_applied[mask].shape)
    envs.sim.mocap_pos[mask] += rng.uniform(-0.1, 0.1, envs.sim.mocap_pos[mask].shape)


def _set_state(envs, mask, rng):
    envs.set_state(np.array(envs.sim.qpos), rng.uniform(-0.1, 0.1, envs.sim.qvel.shape), mask)


def _reset_some(envs, mask, rng):
    if mask.any():
        envs.reset(options={"reset_mask": mask}, seed=int(rng.integers(100)) if rng.random() < 0.5 else None)


HAPPENINGS = (
    _take_a_step, _take_a_step, _set_the_steppers_state, _restore_the_steppers_state, _draw_drives, _apply_forces, _set_state, _reset_some,
    lambda envs, mask, rng: envs.sim.randomize(mask, body_mass=envs.sim.model.body_mass * rng.uniform(0.5, 2.0, (N, 1))),
    lambda envs, mask, rng: envs.sim.randomize(mask),
    lambda envs, mask, rng: envs.sim.reset(mask),
)  # fmt: skip


@pytest.mark.parametrize("name", TASKS)
@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@settings(max_examples=15, deadline=None)
@given(data=st.data(), seed=st.integers(0, 99))
def test_whatever_happens_a_copied_batch_goes_on_alike(name, mode, data, seed):
    """With the same bits, over the ends of episodes; the simplest draw is a pickle of a batch whose episodes are all over."""
    # Events of the robot own the parameters that happenings would change.
    happenings = st.sampled_from((_take_a_step, _set_state, _reset_some) if name == "Robot" else HAPPENINGS)
    envs, rng = made(name, mode), np.random.default_rng(seed)
    envs.reset(seed=seed)
    for action in actions(envs, rng, data.draw(st.sampled_from([LIMIT, 0, 3]))):
        envs.step(action)
    for happens, mask in data.draw(st.lists(st.tuples(happenings, st.lists(st.booleans(), min_size=N, max_size=N)), max_size=9)):
        happens(envs, np.array(mask), rng)
    other = copy.deepcopy(envs) if data.draw(st.booleans()) else pickle.loads(pickle.dumps(envs))
    taken = actions(envs, rng, 2 * LIMIT)
    same(go_on(other, taken), go_on(envs, taken))
    np.testing.assert_array_equal(other.episode_returns, envs.episode_returns)
