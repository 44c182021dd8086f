"""The first observation of an episode has nothing of the episode before, in every task and whenever environments begin another."""

import functools
from dataclasses import dataclass, field
from importlib.util import find_spec

import gymnasium
import numpy as np
import pytest
import stepper
from checks import every, raises
from envs.cases import same
from envs.test_hooks import Levels
from envs.test_terms import Robot
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from hypothesis import given, settings, strategies as st
from stepper.envs import TASKS, Observation, StepperEnv, StepperVectorEnv, Task, per_moment, square_sum
from stepper.sensors import SensorModel, Transfer

LIMIT = 3
NEEDS = {"G1": "mjlab", "Go1": "mjlab", "dm_control": "dm_control", "myosuite": "myo_sim"}
"""Packages that tasks need for their models, by a part of their names."""
OWN = {"Levels": Levels, "Robot": Robot}
"""Tasks whose episodes carry values on, and with all declared parts: terms, events, commands, servos with delays."""
NAMES = [*OWN, *sorted(name for name in gymnasium.registry if name.startswith("stepper/"))]
SEEN = ("ctrl", "time", "status", "qfrc_actuator", "qacc", "cfrc_ext", "qfrc_applied", "xfrc_applied")
"""Quantities of the stepper that a step leaves."""
SCENE = """<mujoco><worldbody><body><joint name="x" type="slide" axis="1 0 0"/><geom size=".1"/></body></worldbody>
  <actuator><motor joint="x" ctrlrange="-1 1" ctrllimited="true"/></actuator><sensor><jointpos joint="x"/></sensor></mujoco>"""
CHANGES = ("step", "steps", "some", "control", "reset", "set", "restore", "push", "mass")


@functools.cache
def watched(name):
    """A task that observes all that a step could leave to the next episode, and the arguments of its environments."""
    arguments = {"task": OWN[name]} if name in OWN else dict(gymnasium.spec(name).kwargs)
    task = arguments.pop("task")
    kind = TASKS[task] if isinstance(task, str) else task
    options = {"options": arguments.pop("options")} if "options" in arguments else {}

    class Watched(kind):
        def observations(self):
            steps = (
                Observation("seen action", func=lambda now: now.action),
                Observation("seen velocity", func=lambda now: np.zeros(len(now.action)) if now.velocity is None else now.velocity),
                *(Observation(f"episode_state {key}", func=lambda now, key=key: now.episode_state[key]) for key in self.episode_state(1)),
            )
            seen = (Observation(f"seen {quantity}", func=lambda now, quantity=quantity: getattr(now, quantity)) for quantity in SEEN)
            return (*super().observations(), *steps, *seen)

    return Watched(**arguments), options


@every(name=NAMES, mode=AutoresetMode)
def test_a_batch_says_what_single_environments_say(name, mode):
    for part, package in NEEDS.items():
        if part in name and find_spec(package) is None:
            pytest.skip(f"{package} is not installed")
    task, options = watched(name)
    # Errors of sensors follow from the place of an environment, too: the first of a batch has those of one alone.
    n, limit = 1 if task.sensors() is not None else 3, 3 * LIMIT if name in OWN else LIMIT
    ours = StepperVectorEnv(task, n, autoreset_mode=mode, max_episode_steps=limit, **options)
    alone = [lambda: StepperEnv(task, max_episode_steps=limit, **options)] * n
    theirs = SyncVectorEnv(alone, autoreset_mode=mode)
    same(ours.reset(seed=3), theirs.reset(seed=3))
    low, high = np.maximum(ours.action_space.low, -2.0), np.minimum(ours.action_space.high, 2.0)
    rng, over = np.random.default_rng(0), np.zeros(n, dtype=bool)
    # The second environment begins anew in the middle of the others, so that episodes do not all end at once.
    begins = {1: np.arange(n) == n // 2}
    for k in range(2 * limit + 2):
        if mode == AutoresetMode.DISABLED and over.any():
            begins[k] = over | begins.get(k, over)
        if k in begins:
            options = {"reset_mask": begins[k]}
            same(ours.reset(options=options), theirs.reset(options=dict(options)))
        action = rng.uniform(low, high)
        found = ours.step(action)
        same(found, theirs.step(action))
        over = found[2] | found[3]


@dataclass(frozen=True, kw_only=True)
class Forgetful(Task):
    """A task that observes its last step and its episode_state, of which it begins nothing anew itself."""

    frame_skip: int = 2

    def model(self):
        return stepper.load(SCENE)

    def sensors(self):
        return SensorModel(default=Transfer(noise_std=1.0, bias_std=1.0, delay=0.004))

    def episode_state(self, num_envs):
        return {"count": np.full(num_envs, 7)}

    def position(self, now):
        return now.qpos

    def observations(self):
        return (
            Observation("sensordata"),
            Observation("step", func=lambda now: np.hstack([now.action, now.velocity])),
            Observation("count", func=lambda now: now.episode_state["count"]),
        )

    def advance(self, now):
        now.episode_state["count"] += 1
        super().advance(now)

    def reward(self, now):
        return now.action[:, 0], {}


@pytest.mark.parametrize("mode", AutoresetMode)
def test_the_last_action_velocity_and_episode_state_are_forgotten(mode):
    envs = StepperVectorEnv(Forgetful(), 3, autoreset_mode=mode, max_episode_steps=LIMIT)
    first = envs.reset(seed=0)[0][:, 1:]
    np.testing.assert_array_equal(first, [[0.0, 0.0, 7.0]] * 3)
    one = np.ones((3, 1))
    seen = envs.step(one)[0][:, 1:]
    np.testing.assert_array_equal(seen[:, [0, 2]], [[1.0, 8.0]] * 3)
    assert (seen[:, 1] > 0.0).all()
    observation = envs.reset(envs=[1])[0]
    np.testing.assert_array_equal(observation[1, 1:], first[1])
    np.testing.assert_array_equal(observation[[0, 2], 1:], seen[[0, 2]])
    assert not envs.now.action[1].any()
    envs.step(one)
    observation, *_, info = envs.step(one)
    ended = observation if mode != AutoresetMode.SAME_STEP else np.array([row for row in info["final_obs"] if row is not None])[[0, -1]]
    np.testing.assert_array_equal(ended[[0, -1], 1:][:, [0, 2]], [[1.0, 10.0]] * 2)
    if mode == AutoresetMode.DISABLED:
        observation = envs.reset(options={"reset_mask": np.array([True, False, True])})[0]
    elif mode == AutoresetMode.NEXT_STEP:
        observation = envs.step(one)[0]
    np.testing.assert_array_equal(observation[[0, 2], 1:], first[[0, 2]])


def test_actions_and_infos_are_no_views_of_each_other():
    """Neither a caller who reuses the array of actions nor a later step changes what was said."""
    env, batch = StepperEnv(Forgetful()), StepperVectorEnv(Forgetful(), 1)
    env.reset(seed=0), batch.reset(seed=0)
    for each, action in ((env, np.ones(1)), (batch, np.ones((1, 1)))):
        each.step(action)
        action[:] = 0.5
        assert each.now.action == 1.0


def test_episode_state_of_another_shape_is_refused():
    class Shared(Forgetful):
        def episode_state(self, num_envs):
            return {"table": np.zeros((num_envs + 1, 2))}

    raises(ValueError, r"episode_state returns 'table' of shape \(3, 2\), must be \(2, \.\.\.\)", lambda: StepperVectorEnv(Shared(), 2))


# Quantities of `now` that a task reads in `advance`, between steps, resets and other changes of the stepper.

ARM = """<mujoco><option timestep=".01"/><worldbody><body name="arm"><joint name="j" axis="0 1 0" damping=".1"/>
  <geom name="g" type="capsule" fromto="0 0 0 .3 0 0" size=".02"/>{site}</body></worldbody>
  <actuator><motor name="m" joint="j" ctrlrange="-1 1"/></actuator>
  <sensor><jointpos name="angle" joint="j"/></sensor></mujoco>"""
N = 3


@per_moment
def tip(now):
    """Height of the arm's centre of mass, (num_envs,)."""
    return now.xipos[:, 1, 2]


QUANTITIES = {
    **{name: name for name in ("qpos", "qvel", "time", "ctrl", "status", "xpos", "xipos", "qacc_smooth", "sensordata", "xfrc_applied")},
    "tip": tip,
}


def fresh(now, name):
    """A quantity as the stepper has it now, without the view."""
    if name == "tip":
        return now.sim.xipos[:, 1, 2]
    return getattr(now.sim, name)


def check(now, name):
    """Asserts that the view has the same bits as the stepper."""
    seen = QUANTITIES[name](now) if callable(QUANTITIES[name]) else getattr(now, QUANTITIES[name])
    np.testing.assert_array_equal(seen, fresh(now, name), err_msg=name)


def change(sim, kind, envs):
    """Changes the stepper in one of the ways that a task has."""
    match kind:
        case "step":
            sim.step(np.full((N, 1), 0.7))
        case "steps":
            sim.step(nstep=3)
        case "some":
            sim.step(np.full((N, 1), -0.4), envs=envs)
        case "control":
            sim.step(np.full((N, 1), 0.1) + sim.ctrl, 0)
        case "reset":
            sim.reset(envs)
        case "set":
            sim.set_state(qpos=np.array(sim.qpos) + 0.2, envs=envs)
        case "restore":
            sim.set_state(sim.get_state(env=0), envs=envs)
        case "push":
            sim.xfrc_applied[envs, 1, 2] += 0.5
        case "mass":
            sim.randomize({"body_ipos[arm][0]": 0.9 * sim.model.body_ipos[1, 0]}, envs=envs)


@dataclass(frozen=True, kw_only=True)
class Script(Task):
    """A task whose `advance` follows a script of reads and changes."""

    frame_skip: int = 1
    site: str = ""
    script: list = field(default_factory=list)

    def model(self):
        return stepper.load(ARM.format(site=self.site))

    def observations(self):
        return (Observation("qpos"), Observation("tip", func=tip))

    def advance(self, now):
        for word, envs in self.script:
            if word in QUANTITIES:
                check(now, word)
            else:
                change(now.sim, word, np.array(envs))

    def reward(self, now):
        for name in QUANTITIES:
            check(now, name)
        return now.qpos[:, 0], {}


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(st.sampled_from([*QUANTITIES, *CHANGES]), st.lists(st.booleans(), min_size=N, max_size=N)), max_size=12),
    st.sampled_from(["", '<site name="s"/>']),
)
def test_every_read_equals_a_read_of_the_stepper(script, site):
    envs = StepperVectorEnv(Script(script=script, site=site), N)
    envs.reset(seed=0)
    for _ in range(2):
        observation = envs.step(np.full((N, 1), 0.5))[0]
        np.testing.assert_array_equal(observation[:, 0], envs.sim.qpos[:, 0])
        np.testing.assert_array_equal(observation[:, 1], envs.sim.xipos[:, 1, 2])


def test_the_observation_is_that_after_the_step_if_advance_reads_before():
    """A servo that a task computes reads the angle before it steps; observation and reward are those of the angle after it."""

    class Servo(Script):
        def advance(self, now):
            now.sim.step(5 * (now.action - now.qpos), 5)

        def reward(self, now):
            return -square_sum(now.qpos), {}

    envs = StepperVectorEnv(Servo(), N)
    envs.reset(seed=0)
    observation, reward, *_ = envs.step(np.full((N, 1), 1.0))
    assert (observation[:, 0] != 0.0).all()
    np.testing.assert_array_equal(observation[:, 0], envs.sim.qpos[:, 0])
    np.testing.assert_array_equal(reward, -(envs.sim.qpos[:, 0] ** 2))


def test_what_depends_on_episode_state_is_computed_anew_after_advance():
    """A function of `now` that reads `episode_state` is not kept from before `advance` changed it."""

    @per_moment
    def goal(now):
        return np.array(now.episode_state["goal"])

    class Goal(Script):
        def episode_state(self, num_envs):
            return {"goal": np.zeros(num_envs)}

        def observations(self):
            return (Observation("goal", func=goal),)

        def advance(self, now):
            now.sim.step(now.action)
            goal(now)
            now.episode_state["goal"] += 1.0

    envs = StepperVectorEnv(Goal(), N)
    envs.reset(seed=0)
    assert envs.step(np.zeros((N, 1)))[0].tolist() == [[1.0]] * N


def test_a_step_outside_a_hook_renews_the_view():
    envs = StepperVectorEnv(Script(script=[("step", [True] * N)]), N)
    envs.reset(seed=0)
    now = envs.now
    before = now.qpos
    envs.sim.step(np.full((N, 1), 1.0))
    assert (now.qpos != before).all()
    np.testing.assert_array_equal(now.qpos, envs.sim.qpos)
    with pytest.raises(AttributeError):
        now.qpos = before


# When environments whose episode is over begin another: as in Gymnasium's `SyncVectorEnv` of single environments, bit for bit.

BATCH, EPISODE = 5, 18


def pair(mode):
    """A batch, and as many single environments."""

    def single():
        return gymnasium.make("stepper/Hopper-v5", max_episode_steps=EPISODE, disable_env_checker=True)

    ours = StepperVectorEnv("Hopper", BATCH, autoreset_mode=mode, max_episode_steps=EPISODE)
    return ours, SyncVectorEnv([single] * BATCH, autoreset_mode=mode)


@pytest.mark.parametrize("mode", AutoresetMode)
def test_it_is_gymnasiums_for_episodes_that_fall_and_that_run_out(mode):
    """When disabled, whoever steps on is told, and a mask goes on. test_first_observations.py has all tasks, in short episodes."""
    ours, theirs = pair(mode)
    same(ours.reset(seed=3), theirs.reset(seed=3))
    rng, fell, ran_out = np.random.default_rng(0), 0, 0
    for _ in range(100):
        action = rng.uniform(-1, 1, ours.action_space.shape)
        found = ours.step(action)
        same(found, theirs.step(action))
        over = found[2] | found[3]
        fell, ran_out = fell + found[2].sum(), ran_out + found[3].sum()
        if mode == AutoresetMode.DISABLED and over.any():
            raises(ResetNeeded, rf"environments \[{np.flatnonzero(over)[0]}", ours.step, action)
            same(ours.reset(options={"reset_mask": over}), theirs.reset(options={"reset_mask": over}))
    assert min(fell, ran_out) >= 3


def test_statistics_of_an_episode_are_in_its_final_info():
    """With SAME_STEP, `final_info` has "episode" where an episode ended, with the length and the sum of rewards of that episode."""
    envs = StepperVectorEnv("HalfCheetah", 3, autoreset_mode=AutoresetMode.SAME_STEP, max_episode_steps=EPISODE, episode_statistics=True)
    envs.reset(seed=0)
    total = np.zeros(3)
    for _ in range(EPISODE):
        _, reward, _, truncated, info = envs.step(np.zeros(envs.action_space.shape))
        total += reward
    assert truncated.all()
    assert not (envs.episode_lengths.any() or envs.episode_returns.any())  # Those of the next episode.
    episode = info["final_info"]["episode"]
    np.testing.assert_array_equal(episode["l"], [EPISODE] * 3)
    np.testing.assert_allclose(episode["r"], total, rtol=1e-6)  # The sum has single precision.
