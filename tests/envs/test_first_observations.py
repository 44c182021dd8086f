"""The first observation of an episode has nothing of the episode before, in every task and whenever environments begin another."""

import functools
from dataclasses import dataclass
from importlib.util import find_spec

import gymnasium
import numpy as np
import pytest
import stepper
from envs.cases import same
from envs.test_hooks import Levels
from envs.test_terms import Robot
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from stepper.envs import TASKS, Observation, StepperEnv, StepperVectorEnv, Task
from stepper.sensors import SensorModel, Transfer

LIMIT = 3
NEEDS = {"G1": "mjlab", "Go1": "mjlab", "dm_control": "dm_control", "myosuite": "myo_sim"}
"""Packages that tasks need for their models, by a part of their names."""
OWN = {"Levels": Levels, "Robot": Robot}
"""Tasks whose episodes carry values on, and with all declared parts: terms, events, commands, servos with delays."""
NAMES = [*OWN, *sorted(name for name in gymnasium.registry if name.startswith("stepper/"))]
SEEN = ("ctrl", "time", "status", "qfrc_actuator", "qacc", "cfrc_ext", "qfrc_applied", "xfrc_applied")
"""Quantities of the stepper that a step leaves."""


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


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("mode", AutoresetMode)
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


SCENE = """<mujoco><worldbody><body><joint name="x" type="slide" axis="1 0 0"/><geom size=".1"/></body></worldbody>
  <actuator><motor joint="x" ctrlrange="-1 1" ctrllimited="true"/></actuator><sensor><jointpos joint="x"/></sensor></mujoco>"""


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

    with pytest.raises(ValueError, match=r"episode_state returns 'table' of shape \(3, 2\), must be \(2, \.\.\.\)"):
        StepperVectorEnv(Shared(), 2)
