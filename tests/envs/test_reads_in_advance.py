"""Quantities of `now` that a task reads in `advance`, between steps, resets and other changes of the stepper."""

from dataclasses import dataclass, field

import numpy as np
import pytest
import stepper
from hypothesis import given, settings
from hypothesis import strategies as st
from stepper.envs import Observation, StepperVectorEnv, Task, per_moment, square_sum

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


CHANGES = ("step", "steps", "some", "control", "reset", "set", "restore", "push", "mass")


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
