"""Environments go on from what `get_state` saved with the same bits, and rewards follow from the state that a step begins in."""

import functools
import pickle
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import stepper
from envs.cases import same
from envs.test_hooks import Levels
from envs.test_terms import Robot
from gymnasium.error import ResetNeeded
from hypothesis import given, settings
from hypothesis import strategies as st
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
    """A task with all that an episode can have: errors of a sensor, delays, episode_state, a kept quantity, noise, mocap."""

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
        now.sim.step(now.action, self.frame_skip - 1)
        now.keep("xpos", now.sim.xpos)
        now.sim.step(now.action)

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
@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize("before", [0, 3, LIMIT])
def test_environments_go_on_from_a_state_with_the_same_bits(name, mode, before):
    """Where it was saved, in a new batch, and by pickle in another one."""
    envs, rng = made(name, mode), np.random.default_rng(before)
    envs.reset(seed=1)
    for action in actions(envs, rng, before):
        seen = envs.step(action)[0]
    state, taken = envs.get_state(), actions(envs, rng, 2 * LIMIT)
    first = go_on(envs, taken)
    fresh, other = made(name, mode), made(name, mode)
    other.reset(seed=9)
    for each, given_state in ((envs, state), (fresh, state), (other, pickle.loads(pickle.dumps(state)))):
        observation = each.set_state(given_state)
        if before:
            np.testing.assert_array_equal(observation, seen)
        same(go_on(each, taken), first)
        np.testing.assert_array_equal(each.episode_returns, envs.episode_returns)


@pytest.mark.parametrize("name", TASKS)
@pytest.mark.parametrize("envs_given", [[3, 1], np.array([False, True, False, True])])
def test_some_environments_go_back_and_the_others_go_on(name, envs_given):
    """Those that go back repeat their bits, and the others have those of a batch in which nobody went back."""
    envs, alone = made(name), made(name)
    rng, back = np.random.default_rng(0), np.array([False, True, False, True])
    for each in (envs, alone):
        each.reset(seed=2)
    early, late, again = (actions(envs, rng, 3) for _ in range(3))
    again[:, back] = late[:, back]
    for action in early:
        envs.step(action), alone.step(action)
    state = envs.get_state()
    first = [envs.step(action)[:4] for action in late]
    expected = [alone.step(action)[:4] for action in late] + [alone.step(action)[:4] for action in again]
    envs.set_state(state, envs=envs_given)
    for found, repeated, others in zip([envs.step(action)[:4] for action in again], first, expected[len(late) :], strict=True):
        for part, one, other in zip(found, repeated, others, strict=True):
            np.testing.assert_array_equal(part[back], one[back])
            np.testing.assert_array_equal(part[~back], other[~back])


@pytest.mark.parametrize("name", TASKS)
def test_a_single_environment_goes_on_from_a_state(name):
    env, other = (StepperEnv(TASKS[name], max_episode_steps=LIMIT) for _ in range(2))
    env.reset(seed=3)
    taken = np.random.default_rng(0).uniform(env.action_space.low, env.action_space.high, (5, *env.action_space.shape))
    for action in taken[:2]:
        env.step(action)
    state = pickle.loads(pickle.dumps(env.get_state()))
    first = [env.step(action) for action in taken[2:]] + [env.reset()]
    for each in (env, other):
        each.set_state(state)
        same([each.step(action) for action in taken[2:]] + [each.reset()], first)


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


def test_kept_quantities_are_those_of_the_present_once_the_state_is_another():
    """Pusher observes places from within the last step; after `sim.set_state`, it must not go on to do so."""
    envs, other = made("Pusher"), made("Pusher")
    for each in (envs, other):
        each.reset(seed=0)
    envs.step(np.ones((N, 7)))
    qpos = np.array(other.sim.qpos)
    envs.sim.set_state(qpos, np.zeros_like(envs.sim.qvel), np.arange(N) == 2)
    tip = envs.sim.model.body_names.index("tips_arm")
    np.testing.assert_array_equal(envs.now.xpos[2, tip], other.sim.xpos[2, tip])
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


STATE = made("HalfCheetah")
STATE.reset(seed=0)


@pytest.mark.parametrize(("envs", "error", "said"), [
    (lambda: StepperVectorEnv("HalfCheetah", 2), ValueError, r"'returns' of the state has shape \(4,\), must have shape \(2,\)"),
    (lambda: StepperVectorEnv("Hopper", N), ValueError, "settings: task was 'HalfCheetah' and is 'Hopper' here. Make"),
    (lambda: StepperVectorEnv(Everything(), N), ValueError, "task was 'HalfCheetah' and is 'Everything' here"),
    (lambda: StepperVectorEnv("HalfCheetah", N, precision="f32"), ValueError, "precision was 'f64' and is 'f32' here. Make"),
    (lambda: StepperVectorEnv("HalfCheetah", N, contact="hard"), ValueError, "contact was 'mujoco' and is 'hard' here.*sim.set_state"),
    (lambda: StepperVectorEnv("HalfCheetah", N, options=stepper.Options(timestep=0.005)), ValueError, "timestep was 0.01 and is 0.005"),
    (lambda: StepperVectorEnv("HalfCheetah", N, forward_reward_weight=2.0), ValueError,
     r"settings: HalfCheetah\.forward_reward_weight was 1\.0 and is 2\.0 here\. Make .*, or restore only the state"),
    (lambda: StepperVectorEnv("HalfCheetah", N, model=heavier("HalfCheetah")), ValueError, "model"),
])  # fmt: skip
def test_a_state_of_other_environments_is_refused(envs, error, said):
    other = envs()
    other.reset(seed=0)
    before = pickle.dumps(other.get_state().sim)
    with pytest.raises(error, match=said):
        other.set_state(STATE.get_state())
    assert pickle.dumps(other.get_state().sim) == before


SETTINGS = {
    "frame_skip": st.integers(1, 9), "forward_reward_weight": st.floats(0.5, 2.0), "ctrl_cost_weight": st.floats(0.05, 0.2),
    "reset_noise_scale": st.floats(0.05, 0.2), "exclude_current_positions_from_observation": st.booleans(),
}  # fmt: skip
OPTIONS = {
    "contact": st.sampled_from(["mujoco", "hard"]), "solver": st.sampled_from(["auto", "pgs", "newton"]),
    "tolerance": st.sampled_from([1e-6, 1e-8]), "max_contacts": st.sampled_from([None, 40]),
}  # fmt: skip


@settings(max_examples=25, deadline=None)
@given(*(st.tuples(st.fixed_dictionaries(SETTINGS), st.fixed_dictionaries(OPTIONS)) for _ in range(2)), st.data())
def test_a_state_fits_where_all_settings_are_equal_and_nowhere_else(one, other, data):
    """Whichever of them differ; those that differ are named."""
    same_arguments, same_options = ({name for name in names if data.draw(st.booleans(), name)} for names in (SETTINGS, OPTIONS))
    arguments = {name: (one if name in same_arguments else other)[0][name] for name in SETTINGS}
    options = {name: (one if name in same_options else other)[1][name] for name in OPTIONS}
    made_with = [StepperEnv("HalfCheetah", options=stepper.Options(**o), **a) for a, o in (one, (arguments, options))]
    made_with[0].reset(seed=0)
    state = made_with[0].get_state()
    different = [f"HalfCheetah.{name}" for name in SETTINGS if arguments[name] != one[0][name]]
    different += [name for name in OPTIONS if options[name] != one[1][name]]
    if not different:
        made_with[1].set_state(state)
        return
    with pytest.raises(ValueError, match="other settings") as error:
        made_with[1].set_state(state)
    assert sum(f"{name} was" in str(error.value) for name in different) == min(len(different), 3)


@dataclass(frozen=True)
class Weights:
    """A dataclass, a mapping, a sequence and an array among the arguments of a task."""

    progress: float = 1.0
    limits: tuple[float, ...] = (1.0, 2.0)


@dataclass(frozen=True, kw_only=True)
class Weighted(Everything):
    """A task whose arguments are of many kinds."""

    weights: Weights = Weights()
    table: Any = None
    named: Any = None
    shape: Any = np.tanh


@pytest.mark.parametrize(("arguments", "said"), [
    ({"weights": Weights(progress=2.0)}, r"Weighted\.weights\.progress was 1\.0 and is 2\.0 here"),
    ({"weights": Weights(limits=(1.0, 3.0))}, r"Weighted\.weights\.limits\.1 was 2\.0 and is 3\.0 here"),
    ({"table": np.ones(2)}, r"Weighted\.table was None and is array\(\[1\., 1\.\]\) here"),
    ({"named": {"energy": 0.1}}, r"Weighted\.named was None and is absent here; Weighted\.named\.energy was absent and is 0\.1 here"),
    ({"named": {"energy": np.nan}, "shape": np.cos}, r"Weighted\.named\.energy"),
])  # fmt: skip
def test_arguments_of_a_task_are_compared_whatever_they_are_made_of(arguments, said):
    """Functions are not compared: nothing says whether two of them are the same."""
    plain, other = StepperEnv(Weighted()), StepperEnv(Weighted(**arguments))
    for env in (plain, other):
        env.reset(seed=0)
    with pytest.raises(ValueError, match=said):
        other.set_state(plain.get_state())
    other.set_state(pickle.loads(pickle.dumps(other.get_state())))


def test_settings_that_change_no_motion_may_differ():
    one = StepperVectorEnv("HalfCheetah", 2, max_episode_steps=5)
    other = StepperVectorEnv("HalfCheetah", 2, max_episode_steps=50, dtype=np.float32, threads=2, autoreset_mode="SameStep")
    one.reset(seed=0)
    other.set_state(one.get_state())
    np.testing.assert_array_equal(one.step(np.ones((2, 6)))[1], other.step(np.ones((2, 6)))[1])


@pytest.mark.parametrize("place", range(len(APPLIED)))
def test_names_of_writable_arrays_are_in_the_order_of_the_core(place):
    """A pickled stepper has a list without names, with None for each array that was never used."""
    sim = stepper.Stepper(_scene(), 2)
    getattr(sim, APPLIED[place])
    assert [array is not None for array in sim.__getstate__()["applied"]] == [k == place for k in range(len(APPLIED))]


def heavier(name):
    """The model of a task with twice the mass."""
    model = StepperEnv(name).sim.model
    return model.replace(body_mass=2.0 * model.body_mass)


def test_what_is_wrong_with_a_state_is_said():
    envs = made("HalfCheetah")
    with pytest.raises(ResetNeeded, match="before get_state"):
        envs.get_state()
    with pytest.raises(ResetNeeded, match="before get_state"):
        StepperEnv("HalfCheetah").get_state()
    with pytest.raises(ResetNeeded, match="some environments have no episode yet"):
        envs.set_state(STATE.get_state(), envs=[1])
    with pytest.raises(ValueError, match="qvel is given together with a state"):
        envs.set_state(STATE.get_state(), np.zeros(9))
    with pytest.raises(IndexError, match="envs has 7"):
        envs.set_state(STATE.get_state(), envs=[7])


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


# What happens to a batch between two steps, by name: a batch, a mask of environments, random numbers, and states that were saved before.


def _take_a_step(envs, mask, rng, states):
    before = _place(envs)
    *_, info = envs.step(actions(envs, rng, 1)[0])
    if "x_velocity" in info:
        rows = info["_x_velocity"]  # Others began an episode.
        np.testing.assert_array_equal(info["x_velocity"][rows], ((_place(envs) - before) / envs.dt)[rows])


def _place(envs):
    """What the velocity of a task is the rate of change of."""
    return np.array(envs.sim.subtree_com[:, 0, 0] if envs.task.__class__.__name__ == "Humanoid" else envs.sim.qpos[:, 0])


def _set_the_steppers_state(envs, mask, rng, states):
    qpos, qvel = envs.sim.qpos + rng.uniform(-0.01, 0.01, envs.sim.qpos.shape), rng.uniform(-0.1, 0.1, envs.sim.qvel.shape)
    envs.sim.set_state(qpos, qvel, mask)


def _restore_the_steppers_state(envs, mask, rng, states):
    kept = envs.sim.get_state()
    envs.sim.step(nstep=3)
    envs.sim.set_state(kept, envs=mask)


def _randomize(envs, mask, rng, states):
    envs.sim.randomize(mask, body_mass=envs.sim.model.body_mass * rng.uniform(0.5, 2.0, (N, 1)))


def _give_the_models_parameters_back(envs, mask, rng, states):
    envs.sim.randomize(mask)


def _draw_drives(envs, mask, rng, states):
    if envs.sim.actuators is not None:
        envs.sim.randomize(mask, actuators=ActuatorModel(default=Drive(delay=0.002, friction=rng.uniform(0.01, 0.1, N))))


def _reset_the_stepper(envs, mask, rng, states):
    envs.sim.reset(mask)


def _apply_forces(envs, mask, rng, states):
    envs.sim.qfrc_applied[mask] = rng.uniform(-0.1, 0.1, envs.sim.qfrc_applied[mask].shape)
    envs.sim.mocap_pos[mask] += rng.uniform(-0.1, 0.1, envs.sim.mocap_pos[mask].shape)


def _set_state(envs, mask, rng, states):
    envs.set_state(np.array(envs.sim.qpos), rng.uniform(-0.1, 0.1, envs.sim.qvel.shape), mask)


def _reset_some(envs, mask, rng, states):
    if mask.any():
        envs.reset(options={"reset_mask": mask}, seed=int(rng.integers(100)) if rng.random() < 0.5 else None)


def _save(envs, mask, rng, states):
    states.append(envs.get_state())


def _go_back(envs, mask, rng, states):
    envs.set_state(states[rng.integers(len(states))], envs=mask)


HAPPENINGS = (
    _take_a_step, _take_a_step, _set_the_steppers_state, _restore_the_steppers_state, _randomize, _give_the_models_parameters_back,
    _draw_drives, _reset_the_stepper, _apply_forces, _set_state, _reset_some, _save, _go_back,
)  # fmt: skip


@pytest.mark.parametrize("name", sorted(TASKS.keys() - {"Robot"}))  # Its events own the parameters that happenings would change.
@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@settings(max_examples=15, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(HAPPENINGS), st.lists(st.booleans(), min_size=N, max_size=N)), max_size=9), st.integers(0, 99))
def test_whatever_happens_a_new_batch_in_the_same_state_goes_on_alike(name, mode, happenings, seed):
    envs, rng = made(name, mode), np.random.default_rng(seed)
    envs.reset(seed=seed)
    states = [envs.get_state()]
    for happens, mask in happenings:
        happens(envs, np.array(mask), rng, states)
    by_state, by_pickle = made(name, mode), pickle.loads(pickle.dumps(envs))
    by_state.set_state(envs.get_state())
    taken = actions(envs, rng, 4)
    expected = go_on(envs, taken)
    for other in (by_state, by_pickle):
        same(go_on(other, taken), expected)


def test_a_batch_of_one_takes_the_state_of_a_single_environment():
    env, envs = StepperEnv(Everything()), StepperVectorEnv(Everything(), 1)
    env.reset(seed=0), env.step(np.ones(1))
    envs.set_state(env.get_state())
    for _ in range(3):
        one, many = env.step(np.ones(1)), envs.step(np.ones((1, 1)))
        np.testing.assert_array_equal(one[0], many[0][0])
        assert one[1] == many[1][0]
    env.set_state(envs.get_state())
    np.testing.assert_array_equal(env.step(np.ones(1))[0], envs.step(np.ones((1, 1)))[0][0])
