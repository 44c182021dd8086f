"""Results of a task's methods with a wrong shape, and episode data of environments that were not reset, are errors."""

import numpy as np
import pytest
import stepper
from stepper.envs import Observation, StepperVectorEnv, Task

CART = """<mujoco><worldbody><body><joint name="x" type="slide" axis="1 0 0"/><geom size=".1"/></body></worldbody>
  <actuator><motor joint="x"/></actuator></mujoco>"""


class Cart(Task):
    """A cart, with a target per episode and a switch for each mistake."""

    frame_skip = 1
    mistake = ""

    def model(self):
        return stepper.load(CART)

    def observations(self):
        return [Observation("qpos", lambda now: now.qpos)]

    def episode_state(self, num_envs):
        return {"target": np.zeros((num_envs, 3))}

    def on_reset(self, sim, episode_state, mask, rng):
        drawn = rng.uniform(-1, 1, 3)
        rows = {"all": np.resize(drawn[:1], (len(mask), 3)), "in place": np.ones((len(mask), 3)), "shape": drawn[:, 0]}
        if self.mistake in ("all", "shape"):
            episode_state["target"] = rows[self.mistake]
        elif self.mistake == "in place":
            episode_state["target"] += 1
        elif self.mistake == "new":
            episode_state["goal"] = np.zeros(len(mask))
        elif self.mistake == "where":
            episode_state["target"] = np.where(mask[:, None], np.resize(drawn[:1], (len(mask), 3)), episode_state["target"])
        else:
            episode_state["target"][mask] = drawn

    def reward(self, now):
        reward = np.ones(now.sim.num_envs)
        return {"scalar": (1.0, {}), "alone": reward, "list": (reward, [])}.get(self.mistake, (reward, {"one": reward}))

    def terminated(self, now):
        return True if self.mistake == "terminated" else now.qpos[:, 0] > 1e9

    def truncated(self, now):
        return np.zeros((now.sim.num_envs, 1), bool) if self.mistake == "truncated" else None


def run(mistake):
    task = Cart()
    task.mistake = mistake
    envs = StepperVectorEnv(task, 4, autoreset_mode="DISABLED", max_episode_steps=9)
    envs.reset(seed=0)
    for k in range(6):
        if k == 1:
            envs.reset(options={"reset_mask": np.array([True, False, False, False])})
        envs.step(np.zeros((4, 1)))


@pytest.mark.parametrize(("mistake", "message"), [
    ("all", r"Cart\.on_reset changed episode_state\['target'\] of environments that were not reset: set rows of the mask"),
    ("in place", r"on_reset changed episode_state\['target'\]"),
    ("new", r"on_reset adds episode_state\['goal'\]"),
    ("scalar", r"Cart\.reward returns an array of shape \(\), must be \(4,\)"),
    ("alone", r"Cart\.reward must return two values: rewards \(num_envs,\), and a dictionary"),
    ("list", r"Cart\.reward must return two values"),
    ("terminated", r"Cart\.terminated returns an array of shape \(\), must be \(4,\)"),
    ("truncated", r"Cart\.truncated returns an array of shape \(4, 1\), must be \(4,\)"),
])  # fmt: skip
def test_a_wrong_result_of_a_task_is_named(mistake, message):
    with pytest.raises(ValueError, match=message):
        run(mistake)


@pytest.mark.parametrize("mistake", ["", "where"])
def test_right_results_are_accepted(mistake):
    run(mistake)
