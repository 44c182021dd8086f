"""Hooks and observation groups of tasks: placement, ends of episodes, values that episodes carry on, noise, delays and histories."""

from dataclasses import dataclass

import gymnasium
import numpy as np
import pytest
import stepper
import stepper.envs
from checks import raises
from envs.cases import SLIDE, Slide, same
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from hypothesis import given, settings, strategies as st
from stepper.envs import Group, Observation, Rng, StepperEnv, StepperVectorEnv, Task, contact_forces, normal, scale, uniform
from stepper.envs.commands import VelocityCommand
from stepper.shared.streams import Streams

SCENE = """<mujoco><worldbody><body><joint name="x" type="slide" axis="1 0 0"/><geom size=".1"/></body></worldbody>
  <actuator><motor joint="x" ctrlrange="-1 1" ctrllimited="true"/></actuator></mujoco>"""
LIMIT = 3
LEG = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/><geom name="wall" type="box" size=".1 1 1" pos="1 0 1"/>
  <body pos="0 0 .4"><joint type="slide" axis="0 0 1"/><geom name="shank" type="capsule" size=".03" fromto="0 0 0 0 0 -.3" mass="1"/>
  <geom name="foot" size=".1" pos="0 0 -.3" mass="1"/></body></worldbody></mujoco>"""


@dataclass(frozen=True, kw_only=True)
class Levels(Task):
    """A task whose episodes begin at their level, which rises with each episode; it observes noise in two ways."""

    carried = ("level", "end", "steps")
    frame_skip: int = 1

    def model(self):
        return stepper.load(SCENE)

    def episode_state(self, num_envs):
        return {"level": np.zeros(num_envs), "end": np.zeros(num_envs), "steps": np.zeros(num_envs)}

    def observations(self):
        return (
            Observation("qpos"),
            Observation("level", func=lambda now: now.episode_state["level"]),
            Observation("steps", func=lambda now: now.episode_state["steps"]),
            Observation("noisy", func=lambda now: np.zeros((len(now.qpos), 3)), noise=0.5),
            Observation("drawn", func=lambda now: now.rng("drawn").normal(2)),
        )

    def reward(self, now):
        return now.qpos[:, 0], {}

    def reset(self, reset):
        reset.qpos += reset.rng.uniform(0.0, 0.5, 1)
        reset.qpos[:, 0] += 10.0 * reset.episode_state["level"]

    def advance(self, now):
        now.episode_state["steps"] += 1.0
        super().advance(now)

    def on_end(self, now, envs):
        now.episode_state["level"][envs] += 1.0
        now.episode_state["end"][envs] = now.qpos[envs, 0]


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_the_end_of_an_episode_is_seen_before_the_next_begins(mode):
    envs = StepperVectorEnv(Levels(), 2, max_episode_steps=LIMIT, autoreset_mode=mode)
    envs.reset(seed=0)
    for k in range(LIMIT + 1):
        step = envs.step(np.ones((2, 1)))
        if k == LIMIT - 1:
            last = np.stack([row[0] for row in step[4]["final_obs"]]) if mode == AutoresetMode.SAME_STEP else step[0][:, 0]
    np.testing.assert_array_equal(envs.now.episode_state["end"], last)
    assert (envs.now.episode_state["level"] == 1.0).all()
    assert (envs.sim.qpos[:, 0] >= 10.0).all()


def test_an_episode_without_a_step_has_no_end_and_a_seed_restores_what_is_carried():
    envs = StepperVectorEnv(Levels(), 2)
    first = envs.reset(seed=0)[0]
    envs.reset()
    assert (envs.now.episode_state["level"] == 0.0).all()
    envs.step(np.ones((2, 1)))
    envs.reset(envs=[1])
    np.testing.assert_array_equal(envs.now.episode_state["level"], [0.0, 1.0])
    np.testing.assert_array_equal(envs.reset(seed=0)[0], first)


def test_the_reset_hook_sees_the_simulation_before_the_reset():
    seen = []

    class Sees(Levels):
        def reset(self, reset):
            seen.append((reset.envs.copy(), np.array(reset.sim.qpos[reset.envs, 0])))

    envs = StepperVectorEnv(Sees(), 3)
    envs.reset(seed=0)
    envs.sim.set_state(qpos=np.array([[1.0], [2.0], [3.0]]))
    envs.reset(envs=[0, 2])
    assert seen[-1][0].tolist() == [0, 2]
    assert seen[-1][1].tolist() == [1.0, 3.0]


def noise_of(observation):
    return observation[..., 3:]


@settings(deadline=None, max_examples=25)
@given(st.integers(1, 7), st.integers(0, 2**31), st.integers(0, 3), st.data())
def test_noise_depends_on_the_seed_and_the_step_alone(num_envs, seed, steps, data):
    """Not on the number of environments, the place in the batch, other environments' resets, or how often it is read."""
    place = data.draw(st.integers(0, num_envs - 1))
    alone, many = StepperEnv(Levels()), StepperVectorEnv(Levels(), num_envs)
    expected, found = alone.reset(seed=seed)[0], many.reset(seed=seed - place if seed >= place else [seed] * num_envs)[0]
    for _ in range(steps):
        np.testing.assert_array_equal(noise_of(found[place]), noise_of(expected))
        found = many.reset(envs=[k for k in range(num_envs) if k != place and data.draw(st.booleans())])[0]
        np.testing.assert_array_equal(noise_of(found[place]), noise_of(expected))
        expected, found = alone.step(np.zeros(1))[0], many.step(np.zeros((num_envs, 1)))[0]
    np.testing.assert_array_equal(noise_of(found[place]), noise_of(expected))
    assert np.abs(expected[3:6]).max() <= 0.5


@settings(deadline=None)
@given(st.lists(st.sampled_from("abcd"), min_size=1, max_size=6), st.integers(0, 2**63))
def test_forked_numbers_do_not_depend_on_their_order(names, seed):
    """And leave the streams that initial states are drawn from as they are."""
    streams = Streams(3, seed)
    before = streams.state.copy()
    first = {name: Rng(streams.fork(name), np.arange(3)).uniform(0.0, 1.0, 2) for name in names}
    for name in reversed(names):
        np.testing.assert_array_equal(Rng(streams.fork(name), np.arange(3)).uniform(0.0, 1.0, 2), first[name])
    np.testing.assert_array_equal(streams.state, before)
    assert len({tuple(values.ravel()) for values in first.values()}) == len(set(names))


def test_noise_is_another_one_in_each_step_and_episode_and_is_uniform():
    envs = StepperVectorEnv(Levels(), 200, max_episode_steps=LIMIT)
    rows = [noise_of(envs.reset(seed=1)[0])] + [noise_of(envs.step(np.zeros((200, 1)))[0]) for _ in range(7)]
    drawn = np.concatenate(rows)
    assert len(np.unique(drawn)) == drawn.size
    uniform = drawn[:, :3]
    # 4,800 numbers: their mean has a deviation of 0.004, their standard deviation one of 0.002.
    assert abs(uniform.mean()) < 0.02
    assert abs(uniform.std() - 1.0 / np.sqrt(12.0)) < 0.01


def test_a_carried_name_that_there_is_not_is_an_error():
    class Wrong(Levels):
        carried = ("levle",)

    raises(ValueError, r"Wrong.carried names \['levle'\], .*it returns level, end, steps", lambda: StepperVectorEnv(Wrong(), 1))


@pytest.mark.filterwarnings("ignore::stepper.ModelWarning")
def test_contact_forces_are_those_of_each_geom():
    """A foot and a shank of one body: its weight is on the foot alone. Forces of the body cannot tell."""

    class Leg(Levels):
        def model(self):
            return stepper.load(LEG)

        def reset(self, reset):
            reset.qpos = np.array([[0.0], [5.0], [0.0]])[reset.envs]

    envs = StepperVectorEnv(Leg(), 3)
    envs.reset(seed=0)
    for _ in range(300):
        envs.step(np.zeros((3, 0)))
    found = contact_forces(envs.now, ["shank", "foot"])
    assert found.shape == (3, 2)
    # At rest on a residual of 1e-6 m/s or so of 2 kg in 2 ms: below 0.01 N. The second still falls after 0.6 s.
    np.testing.assert_allclose(found, [[0.0, 2 * 9.81], [0.0, 0.0], [0.0, 2 * 9.81]], atol=0.02)
    np.testing.assert_array_equal(contact_forces(envs.now, ["foot"], against=["floor"])[:, 0], found[:, 1])
    assert not contact_forces(envs.now, ["foot"], against=["wall"]).any()
    np.testing.assert_array_equal(contact_forces(envs.now, ["floor"])[:, 0], found[:, 1])
    raises(KeyError, "no geom 'feet'", contact_forces, envs.now, ["feet"])


# Observation groups: errors, delays and histories of rows, and what environments and learners get of several groups.

MODEL = stepper.load(SLIDE)


def position(now):
    return now.qpos


@dataclass(frozen=True, kw_only=True)
class Grouped(Slide):
    """A slider whose policy sees errors, and whose critic does not."""

    commands = {"twist": VelocityCommand(every=(0.004, 0.01), x=(-1.0, 1.0))}  # noqa: RUF012

    def model(self):
        return MODEL

    def observations(self):
        policy = (
            Observation(position, noise=normal(0.0, 0.1), bias=0.2, history=3, delay=(0, 2)),
            Observation("qvel", noise=0.1, clip=(-0.05, 0.05), scale=2.0, delay=1),
            Observation("twist"),
            Observation("action"),
        )
        return {"policy": policy, "critic": Group(policy, noise=False, extra=(Observation("body_mass[1]"),))}


def made(kind=StepperVectorEnv, **given):
    return kind(Grouped(), **({"max_episode_steps": 6} | given))


def only(*rows):
    """A slider with these rows."""

    class Only(Slide):
        def model(self):
            return MODEL

        def observations(self):
            return rows

    return Only()


def seen(task, steps=6, num_envs=3, **given):
    """Observations of an environment after reset and after each step with the action 0.5, (steps + 1, num_envs, n)."""
    envs = StepperVectorEnv(task, num_envs, **given)
    return np.array([envs.reset(seed=0)[0], *(envs.step(np.full((num_envs, 1), 0.5))[0] for _ in range(steps))])


@pytest.mark.parametrize("mode", AutoresetMode)
def test_a_batch_of_groups_has_the_bits_of_single_environments(mode):
    """Observations, final observations and infos equal those of single environments, because each draws from one stream."""
    envs = made(num_envs=3, groups=True, autoreset_mode=mode)
    alone = SyncVectorEnv([lambda: made(StepperEnv, groups=True)] * 3, autoreset_mode=mode)
    same(envs.reset(seed=3), alone.reset(seed=3))
    rng = np.random.default_rng(0)
    for k in range(6 if mode == AutoresetMode.DISABLED else 15):
        actions = rng.uniform(-1.0, 1.0, (3, 1)).astype(np.float32)
        ours, theirs = envs.step(actions), alone.step(actions)
        for one, other in zip(ours[:4], theirs[:4], strict=True):
            same(one, other)
        assert ("final_obs" in ours[4]) == (mode == AutoresetMode.SAME_STEP and k % 6 == 5)
        if "final_obs" in ours[4]:
            same(ours[4]["final_obs"], theirs[4]["final_obs"])
    assert envs.observation_structure["critic"] == {"position": 3, "qvel": 1, "twist": 3, "action": 1, "body_mass[1]": 1}
    assert isinstance(envs.single_observation_space, gymnasium.spaces.Dict)
    assert ours[0] in envs.observation_space


def test_without_groups_the_observation_is_that_of_the_policy():
    """The array equals the group "policy" bit for bit, because errors do not depend on which groups are computed."""
    grouped, flat = made(num_envs=4, groups=True), made(num_envs=4)
    np.testing.assert_array_equal(grouped.reset(seed=1)[0]["policy"], flat.reset(seed=1)[0])
    for k in range(9):
        actions = np.full((4, 1), 0.1 * k)
        np.testing.assert_array_equal(grouped.step(actions)[0]["policy"], flat.step(actions)[0])
    assert list(flat.observation_structure) == ["position", "qvel", "twist", "action"]


def test_the_critic_sees_no_errors():
    envs = made(num_envs=2, groups=True)
    observation, _ = envs.reset(seed=1)
    for _ in range(3):
        observation = envs.step(np.ones((2, 1)))[0]
    critic, now = observation["critic"], envs.now
    np.testing.assert_array_equal(critic[:, 2], now.qpos[:, 0])  # the newest of three positions
    np.testing.assert_array_equal(critic[:, 3], np.clip(now.qvel[:, 0], -0.05, 0.05) * 2.0)
    np.testing.assert_array_equal(critic[:, 4:7], now.command("twist"))
    np.testing.assert_array_equal(critic[:, 8], now.parameter("body_mass[1]")[:, 0])
    assert not np.array_equal(observation["policy"][:, 2], now.qpos[:, 0])


def test_a_history_has_the_last_observations_the_oldest_first():
    true, found = seen(only(Observation("qpos"))), seen(only(Observation("qpos", history=3)))
    for k in range(7):
        np.testing.assert_array_equal(found[k], true[[max(0, k - 2), max(0, k - 1), k], :, 0].T)


def test_a_delay_shows_earlier_observations():
    true = seen(only(Observation("qpos")))
    np.testing.assert_array_equal(seen(only(Observation("qpos", delay=2)))[2:], true[:-2])
    np.testing.assert_array_equal(seen(only(Observation("qpos", delay=2)))[:2], true[[0, 0]])
    drawn = seen(only(Observation("qpos", delay=(1, 3))), num_envs=64)
    true = seen(only(Observation("qpos")), num_envs=64)
    # Positions of the accelerated slider differ between steps, so that a position tells its step.
    delays = [next(d for d in range(4) if drawn[6, env, 0] == true[6 - d, env, 0]) for env in range(64)]
    assert set(delays) == {1, 2, 3}


def test_noise_and_bias_have_their_distributions():
    """Means and deviations equal those of the distributions within 5 standard errors, a chance of 6e-7 each."""
    n = 4000
    for error, mean, std in ((0.3, 0.0, 0.3 / 3**0.5), (normal(0.1, 0.2), 0.1, 0.2), (uniform(0.0, 1.0), 0.5, 1 / 12**0.5)):
        values = seen(only(Observation("qpos", noise=error), Observation("start", func=position, bias=error)), steps=1, num_envs=n)
        noise, bias = (values - seen(only(Observation("qpos")), steps=1, num_envs=n)).transpose(2, 0, 1)
        np.testing.assert_array_equal(np.round(bias[0], 9), np.round(bias[1], 9))
        assert not np.allclose(noise[0], noise[1])
        for errors in (noise[1], bias[1]):
            assert abs(errors.mean() - mean) < 5 * std / n**0.5
            assert abs(errors.std() - std) < 5 * std / n**0.5  # the error of a deviation is at most std / sqrt(n) for these distributions
    one = seen(only(Observation("ones", func=lambda now: np.ones((len(now.qpos), 1)), noise=scale(0.5, 2.0))), num_envs=n)
    assert 0.5 <= one.min() < 0.51
    assert 1.99 < one.max() <= 2.0


def test_a_position_that_the_user_sets_is_observed_once():
    envs = StepperVectorEnv(only(Observation("qpos", history=2)), 1)
    envs.reset(seed=0)
    np.testing.assert_array_equal(envs.set_state(qpos=[[0.5]]), [[0.5, 0.5]])
    envs.step(np.zeros((1, 1)))
    np.testing.assert_array_equal(envs.set_state(qpos=[[0.7]]), [[0.5, 0.7]])
