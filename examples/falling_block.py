"""Falling block as a Gymnasium environment: one block, or a vector environment of many.

The block starts 0.20 m above the floor at -0.10 m/s. Each reset draws its restitution from 0.1 to 0.5. An episode has 50 steps of 0.02 s.
A thruster pushes up or down with at most half the block's weight, too little to hover. The reward of a step is 1 if the block is above
0.05 m after the step, else 0.

    python examples/falling_block.py      # mean scores of a few policies

Importing this file registers `examples/FallingBlock-v0` for `gymnasium.make` and `gymnasium.make_vec`. The file implements the Gymnasium
interface without the helpers of `stepper.envs`. With them, the task is python/stepper/envs/basic/falling_block.py.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import stepper
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray
from stepper.envs.basic.falling_block import HEIGHT, LOWEST, OPTIONS, SCENE, STEPS, VELOCITY

Array = NDArray[Any]

RESTITUTION = (0.1, 0.5)
OBSERVATION = Box(np.array([-1.0, -20.0]), np.array([5.0, 20.0]), dtype=np.float64)
ACTION = Box(-1.0, 1.0, (1,), dtype=np.float32)


class FallingBlock(gymnasium.Env[Array, Array]):
    """Gymnasium environment of a single block with a thruster, which must stay above 0.05 m.

    Observation (2,): measured height in m and velocity in m/s. Action (1,): thrust divided by half the weight, positive upwards.

    Args:
        sensors: Sensor model. With None sensors are ideal. The reward always uses the true height.
    """

    def __init__(self, sensors: stepper.SensorModel | None = None):
        self.observation_space, self.action_space = OBSERVATION, ACTION
        self._model, self._sensors = stepper.load(SCENE), sensors
        self._sim: stepper.Stepper | None = None
        self._steps = 0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Start an episode; info has the restitution of the block."""
        super().reset(seed=seed)
        restitution = self.np_random.uniform(*RESTITUTION)
        # A contact uses the larger restitution of its two geoms; the floor's is zero.
        model = self._model.replace(geom_restitution=[0.0, restitution])
        self._sim = stepper.Stepper(model, options=OPTIONS, sensors=self._sensors, seed=int(self.np_random.integers(2**63)))
        self._sim.reset(qpos=[HEIGHT], qvel=[VELOCITY])
        self._steps = 0
        return self._sim.sensordata, {"restitution": restitution}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Step the block by 0.02 s with a thrust (1,), from -1 to 1. Episodes are truncated after 50 steps."""
        if self._sim is None:
            raise gymnasium.error.ResetNeeded("call reset before step")
        self._sim.step(action)
        self._steps += 1
        return self._sim.sensordata, float(self._sim.qpos[0] > LOWEST), False, self._steps >= STEPS, {}


class FallingBlocks(VectorEnv[Array, Array, Array]):
    """Vector environment of blocks with thrusters, each with a separate restitution.

    Args:
        num_envs: Number of blocks.
        sensors: Sensor model. Its parameters may differ between blocks. With None sensors are ideal.
        autoreset_mode: Time at which a finished episode is reset. NEXT_STEP: at the next `step`, which ignores the block's action.
            SAME_STEP: within the step that ends it; the last observation is `info["final_obs"]`. DISABLED: by `reset(options={"reset_mask":
                mask})`.
        threads: Number of threads. 0 uses all available threads. The results do not depend on the number.
    """

    def __init__(
        self,
        num_envs: int = 1,
        sensors: stepper.SensorModel | None = None,
        autoreset_mode: AutoresetMode = AutoresetMode.NEXT_STEP,
        threads: int = 1,
    ):
        self.num_envs, self.autoreset_mode = num_envs, AutoresetMode(autoreset_mode)
        self.metadata = {"autoreset_mode": self.autoreset_mode}
        self.single_observation_space, self.single_action_space = OBSERVATION, ACTION
        self.observation_space, self.action_space = batch_space(OBSERVATION, num_envs), batch_space(ACTION, num_envs)
        self._sim = stepper.Stepper(stepper.load(SCENE), num_envs, options=OPTIONS, sensors=sensors, threads=threads)
        self._restitution = np.zeros((num_envs, 2))
        self._steps = np.zeros(num_envs, dtype=np.int64)
        self._over = np.ones(num_envs, dtype=bool)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Start episodes of all blocks, or of those in `options["reset_mask"]` (num_envs,). Info has their restitution."""
        super().reset(seed=seed)
        mask = np.ones(self.num_envs, dtype=bool) if options is None else options.get("reset_mask", np.ones(self.num_envs, dtype=bool))
        if np.shape(mask) != (self.num_envs,) or np.asarray(mask).dtype != np.bool_:
            raise ValueError(f"reset_mask has shape {np.shape(mask)}, must be ({self.num_envs},) with dtype bool: give one bool per block")
        if seed is not None:
            self._sim.reset(mask, seed=seed)
        info = self._begin(mask)
        return self._sim.sensordata, info

    def step(self, actions: Array) -> tuple[Array, Array, Array, Array, dict[str, Any]]:
        """Step by 0.02 s every block whose episode is not over."""
        waiting = self._over.copy()
        if self.autoreset_mode == AutoresetMode.DISABLED and waiting.any():
            blocks = np.flatnonzero(waiting)[:10].tolist()
            raise gymnasium.error.ResetNeeded(f"episodes of blocks {blocks} are over: call reset(options={{'reset_mask': mask}})")
        # All blocks step. Finished blocks are reset afterwards, so that this step has no effect on them.
        self._sim.step(np.asarray(actions, dtype=np.float64).reshape(self.num_envs, 1))
        self._steps += 1
        info = self._begin(waiting) if waiting.any() else {}
        reward = np.where(waiting, 0.0, self._sim.qpos[:, 0] > LOWEST)
        truncated = self._steps >= STEPS
        self._over = truncated.copy()
        observation = self._sim.observe()
        if self.autoreset_mode == AutoresetMode.SAME_STEP and truncated.any():
            info = self._begin(truncated) | {"final_obs": observation, "_final_obs": truncated, "final_info": {}, "_final_info": truncated}
            observation = self._sim.observe()
        return observation, reward, np.zeros(self.num_envs, dtype=bool), truncated, info

    def _begin(self, mask: Array) -> dict[str, Any]:
        """Starts episodes of the blocks in a mask, (num_envs,), and returns the info dict with their restitution."""
        # Drawn for all blocks, so that a block's restitution does not depend on which other blocks are reset.
        self._restitution[mask, 1] = self.np_random.uniform(*RESTITUTION, self.num_envs)[mask]
        self._sim.randomize(mask, geom_restitution=self._restitution)
        self._sim.reset(mask, qpos=[HEIGHT], qvel=[VELOCITY])
        self._steps[mask], self._over[mask] = 0, False
        return {"restitution": np.where(mask, self._restitution[:, 1], 0.0), "_restitution": mask}


gymnasium.register("examples/FallingBlock-v0", entry_point=f"{__name__}:FallingBlock", vector_entry_point=f"{__name__}:FallingBlocks")

POLICIES = {
    "nothing": lambda height, velocity: 0.0 * height,
    "always up": lambda height, velocity: 1.0 + 0.0 * height,
    "with the motion": lambda height, velocity: np.where(velocity > 0, 1.0, -1.0),
    "down below 0.05 m": lambda height, velocity: np.where((velocity < 0) & (height < LOWEST), -1.0, 1.0),
}
"""Policies by name: functions from heights (m) and velocities (m/s) to thrusts, (num_envs,) each."""


def scores(policy: Any, num_envs: int = 1000, seed: int = 0) -> Array:
    """Returns of a policy in one episode of every block, (num_envs,)."""
    env = FallingBlocks(num_envs)
    observation, _ = env.reset(seed=seed)
    total = np.zeros(num_envs)
    for _ in range(STEPS):
        observation, reward, *_ = env.step(policy(*observation.T)[:, None])
        total += reward
    return total


def main() -> None:
    """Print the mean scores of a few policies for the falling block."""
    for name, policy in POLICIES.items():
        total = scores(policy)
        print(f"{name:20} {total.mean():5.1f} of {STEPS} steps above {LOWEST} m, from {total.min():.0f} to {total.max():.0f}")


if __name__ == "__main__":
    main()
