"""Vector environment with PyTorch tensors, which share memory with NumPy arrays on the CPU."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from stepper.adapters.native import Env, make_native
from stepper.shared.machine import require

require("torch", "for stepper.adapters.torch")

import torch  # noqa: E402


class TorchVectorEnv:
    """Vector environment whose observations, rewards and actions are PyTorch tensors.

    On the CPU, observations and actions share memory with NumPy arrays. Rewards are copies in float32. Observations alternate between two
    buffers, so that an observation stays valid until the call after the next one. Clone it to keep it longer, or pass the destination:
    `envs.step(action, out=storage[t + 1])`.

    Args:
        env: Id of a registered Gymnasium environment, such as "stepper/Hopper-v5", whose episode limit applies; or a `Task` or its class.
        num_envs: Number of environments.
        device: Device of the tensors. On a device other than the CPU they are copies, which stay valid.
        **settings: Further arguments of `stepper.envs.StepperVectorEnv`. The default `dtype` of observations is float32.

    Attributes:
        envs: The vector environment.
    """

    def __init__(self, env: Env, num_envs: int = 1, *, device: torch.device | str = "cpu", **settings: Any):
        self.envs = make_native(env, num_envs, **{"dtype": "float32", **settings})
        self.num_envs, self.device = num_envs, torch.device(device)
        self.single_observation_space, self.single_action_space = self.envs.single_observation_space, self.envs.single_action_space
        dtype = {"float32": torch.float32, "float64": torch.float64}[str(self.single_observation_space.dtype)]
        pinned = self.device.type == "cuda"  # Copies from pinned memory to the GPU are faster.
        shape = (num_envs, *(self.single_observation_space.shape or ()))
        self._buffers = [torch.zeros(shape, dtype=dtype, pin_memory=pinned) for _ in range(2)]

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None, out: torch.Tensor | None = None
    ) -> tuple[torch.Tensor, dict[str, Any]]:
        """Begins new episodes.

        Args:
            seed: Seed or seeds, as in `StepperVectorEnv.reset`.
            options: Options, as in `StepperVectorEnv.reset`.
            out: Tensor for the observations: contiguous, on the CPU, (num_envs, n). None uses one of two internal tensors in turn.

        Returns:
            Observations (num_envs, n), and infos, whose values are NumPy arrays.
        """
        destination = self._destination(out)
        _, infos = self.envs.reset(seed=seed, options=options, out=destination.numpy())
        return destination.to(self.device), infos

    def step(
        self, actions: torch.Tensor, *, out: torch.Tensor | None = None
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor, dict[str, Any]]:
        """Advances every environment by one action, which may be several time steps.

        Args:
            actions: Actions, (num_envs, nu), in the units of the task.
            out: Tensor for the observations: contiguous, on the CPU, (num_envs, n). None uses one of two internal tensors in turn.

        Returns:
            Observations (num_envs, n), rewards (num_envs,) float32, terminations and truncations (num_envs,) bool, and infos, whose
            values are NumPy arrays.
        """
        destination = self._destination(out)
        _, reward, terminated, truncated, infos = self.envs.step(actions.detach().cpu().numpy(), out=destination.numpy())
        outcomes = torch.from_numpy(reward).float(), torch.from_numpy(terminated), torch.from_numpy(truncated)
        rewards, terminations, truncations = (tensor.to(self.device) for tensor in outcomes)
        return destination.to(self.device), rewards, terminations, truncations, infos

    def close(self) -> None:
        """Closes the environments."""
        self.envs.close()

    def _destination(self, out: torch.Tensor | None) -> torch.Tensor:
        """CPU tensor for the observations: `out` if it is given, or one of two internal buffers, which are used in turn."""
        if out is None:
            self._buffers.reverse()
            return self._buffers[0]
        if out.device.type != "cpu" or not out.is_contiguous():
            raise ValueError(f"out is on {out.device} and contiguous {out.is_contiguous()}, must be a contiguous tensor on the CPU")
        return out
