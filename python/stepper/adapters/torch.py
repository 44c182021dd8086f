"""PyTorch tensors over the memory that environments write to."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from stepper.adapters.native import Env, make_native
from stepper.shared.machine import require

require("torch", "for stepper.adapters.torch")

import torch  # noqa: E402


class TorchVectorEnv:
    """Environments whose observations, rewards and actions are tensors over the memory that NumPy has; rewards are copied to float32.

    Observations are written to two buffers in turn: one stands until the call after the next, so that those before and after a step are
    there at once. Clone what should stand longer, or give a place for it, `envs.step(action, out=storage[t + 1])`.

    Args:
        env: A name that Gymnasium knows, "stepper/Hopper-v5", with the limit of its episodes; or a `Task`, or the class of one.
        num_envs: Number of environments.
        device: Where tensors are; on another device than the CPU they are copies, and stand.
        **settings: Further arguments of `stepper.envs.StepperVectorEnv`; observations are float32 unless `dtype` says otherwise.

    Attributes:
        envs: The vector environment.
    """

    def __init__(self, env: Env, num_envs: int = 1, *, device: torch.device | str = "cpu", **settings: Any):
        self.envs = make_native(env, num_envs, **{"dtype": "float32", **settings})
        self.num_envs, self.device = num_envs, torch.device(device)
        self.single_observation_space, self.single_action_space = self.envs.single_observation_space, self.envs.single_action_space
        dtype = {"float32": torch.float32, "float64": torch.float64}[str(self.single_observation_space.dtype)]
        pinned = self.device.type == "cuda"  # Copies to it are faster from there.
        shape = (num_envs, *(self.single_observation_space.shape or ()))
        self._buffers = [torch.zeros(shape, dtype=dtype, pin_memory=pinned) for _ in range(2)]

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None, out: torch.Tensor | None = None
    ) -> tuple[torch.Tensor, dict[str, Any]]:
        """Begins new episodes.

        Args:
            seed: As of `StepperVectorEnv.reset`.
            options: As of `StepperVectorEnv.reset`.
            out: Tensor on the CPU that observations are written to, (num_envs, n), contiguous; None is the next buffer.

        Returns:
            Observations (num_envs, n), and infos, of arrays.
        """
        room = self._room(out)
        _, infos = self.envs.reset(seed=seed, options=options, out=room.numpy())
        return room.to(self.device), infos

    def step(
        self, actions: torch.Tensor, *, out: torch.Tensor | None = None
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor, dict[str, Any]]:
        """Makes the steps of one action in every environment.

        Args:
            actions: (num_envs, nu).
            out: Tensor on the CPU that observations are written to, (num_envs, n), contiguous; None is the next buffer.

        Returns:
            Observations (num_envs, n), rewards (num_envs,) float32, terminations and truncations (num_envs,) bool, and infos, of arrays.
        """
        room = self._room(out)
        _, reward, terminated, truncated, infos = self.envs.step(actions.detach().cpu().numpy(), out=room.numpy())
        said = torch.from_numpy(reward).float(), torch.from_numpy(terminated), torch.from_numpy(truncated)
        rewards, terminations, truncations = (tensor.to(self.device) for tensor in said)
        return room.to(self.device), rewards, terminations, truncations, infos

    def close(self) -> None:
        """Closes the environments."""
        self.envs.close()

    def _room(self, out: torch.Tensor | None) -> torch.Tensor:
        """Where observations are written."""
        if out is None:
            self._buffers.reverse()
            return self._buffers[0]
        if out.device.type != "cpu" or not out.is_contiguous():
            raise ValueError(f"out is on {out.device} and contiguous {out.is_contiguous()}, must be a contiguous tensor on the CPU")
        return out
