"""A block that falls on a floor, as a Gymnasium environment: alone, and many at once.

The block starts 0.20 m above the floor at -0.10 m/s. At every reset its restitution is drawn from 0.1 to 0.5. A step is 0.02 s; a thruster
pushes up or down with at most half the block's weight, so that it cannot hover: how long it stays up depends on how it is pushed between
bounces. Each of the 50 steps of an episode that ends with the block above 0.05 m is worth 1.

    python examples/falling_block.py      # mean scores of a few policies

Importing this file registers `examples/FallingBlock-v0` for `gymnasium.make` and `gymnasium.make_vec`. It writes out what an environment
has to do. The same as a task of `stepper.envs` is python/stepper/envs/basic/falling_block.py, whose scene this is.
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
    """One block.

    Observation (2,): height in m and velocity in m/s, as the sensors read them. Action (1,): thrust over half the weight, up is positive.

    Args:
        sensors: What the sensors make of the truth; None is ideal ones. The reward counts true heights.
    """

    def __init__(self, sensors: stepper.SensorModel | None = None):
        self.observation_space, self.action_space = OBSERVATION, ACTION
        self._model, self._sensors = stepper.load(SCENE), sensors
        self._sim: stepper.Stepper | None = None
        self._steps = 0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """A new block; info has its restitution."""
        super().reset(seed=seed)
        restitution = self.np_random.uniform(*RESTITUTION)
        # A pair of geoms takes the larger of the two: the floor's is zero.
        model = self._model.replace(geom_restitution=[0.0, restitution])
        self._sim = stepper.Stepper(model, options=OPTIONS, sensors=self._sensors, seed=int(self.np_random.integers(2**63)))
        self._sim.reset(qpos=[HEIGHT], qvel=[VELOCITY])
        self._steps = 0
        return self._sim.sensordata, {"restitution": restitution}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """One step of 0.02 s; truncated after 50."""
        if self._sim is None:
            raise gymnasium.error.ResetNeeded("call reset before step")
        self._sim.step(action)
        self._steps += 1
        return self._sim.sensordata, float(self._sim.qpos[0] > LOWEST), False, self._steps >= STEPS, {}


class FallingBlocks(VectorEnv[Array, Array, Array]):
    """Many blocks, each with its own restitution, stepped together.

    Args:
        num_envs: Blocks.
        sensors: As for `FallingBlock`; its numbers may be one for each block.
        autoreset_mode: When a block whose episode is over gets a new one: with the next call of `step`, whose action it ignores; within the
            step that ends it, which has the last observation as info "final_obs"; or when `reset(options={"reset_mask": mask})` is called.
        threads: Threads that step; 0 is all. The results do not depend on it.
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
        """New blocks: all, or those of `options["reset_mask"]` (num_envs,); info has their restitution."""
        super().reset(seed=seed)
        mask = np.ones(self.num_envs, dtype=bool) if options is None else options.get("reset_mask", np.ones(self.num_envs, dtype=bool))
        if np.shape(mask) != (self.num_envs,) or np.asarray(mask).dtype != np.bool_:
            raise ValueError(f"reset_mask has shape {np.shape(mask)}, must be ({self.num_envs},) and of bool")
        if seed is not None:
            self._sim.reset(mask, seed=seed)
        info = self._begin(mask)
        return self._sim.sensordata, info

    def step(self, actions: Array) -> tuple[Array, Array, Array, Array, dict[str, Any]]:
        """One step of 0.02 s of every block whose episode is not over."""
        waiting = self._over.copy()
        if self.autoreset_mode == AutoresetMode.DISABLED and waiting.any():
            raise gymnasium.error.ResetNeeded(f"blocks {np.flatnonzero(waiting)[:10].tolist()} wait for reset: give them in reset_mask")
        # All are stepped. Those that wait are reset after it, so that nothing of that step remains in them.
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
        """Starts episodes of the blocks of a mask; their info."""
        # Drawn for all, so that a block's numbers do not depend on which others begin with it.
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
"""Thrust by height and velocity, (num_envs,) each."""


def scores(policy: Any, num_envs: int = 1000, seed: int = 0) -> Array:
    """Sum of rewards of one episode of every block, (num_envs,)."""
    env = FallingBlocks(num_envs)
    observation, _ = env.reset(seed=seed)
    total = np.zeros(num_envs)
    for _ in range(STEPS):
        observation, reward, *_ = env.step(policy(*observation.T)[:, None])
        total += reward
    return total


def main() -> None:
    """Prints mean scores."""
    for name, policy in POLICIES.items():
        total = scores(policy)
        print(f"{name:20} {total.mean():5.1f} of {STEPS} steps above {LOWEST} m, from {total.min():.0f} to {total.max():.0f}")


if __name__ == "__main__":
    main()
