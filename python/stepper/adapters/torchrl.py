"""TorchRL environment, a batch that steps as one `StepperVectorEnv`."""

from __future__ import annotations

from typing import Any

import numpy as np

from stepper.adapters.native import Env, make_native, with_autoreset
from stepper.envs.task import Array
from stepper.shared.machine import require

require("torchrl", "for stepper.adapters.torchrl")

import torch  # noqa: E402
from gymnasium.vector import AutoresetMode  # noqa: E402
from tensordict import TensorDict, TensorDictBase  # noqa: E402
from torchrl.data import Bounded, Categorical, Composite, Unbounded  # noqa: E402
from torchrl.envs import EnvBase  # noqa: E402


class StepperTorchRLEnv(EnvBase):  # type: ignore[misc]
    """TorchRL environment with the batch size (num_envs,) and the entries "observation", "action" and "reward".

    With `groups=True`, the observation groups of the task are entries in place of "observation", such as "policy" and "critic".

    Partial resets and partial steps by TorchRL's masks "_reset" and "_step" are supported. On the CPU, observations share memory with NumPy
    arrays. Later steps do not overwrite returned tensors.

    Args:
        env: Id of a registered Gymnasium environment, such as "stepper/Hopper-v5", whose episode limit applies; or a `Task` or its class.
        num_envs: Number of environments.
        device: Device of the tensors.
        **settings: Further arguments of `stepper.envs.StepperVectorEnv`. The default `dtype` of observations is float32.
    """

    def __init__(self, env: Env, num_envs: int = 1, *, device: torch.device | str = "cpu", **settings: Any):
        super().__init__(device=device, batch_size=torch.Size([num_envs]))
        settings = with_autoreset({"dtype": "float32", **settings}, AutoresetMode.NEXT_STEP, "TorchRL")
        self.envs = make_native(env, num_envs, **settings)
        self._seed: int | None = None
        self._last: TensorDictBase | None = None
        self._ended: Array = np.zeros(num_envs, dtype=bool)
        space: Any = self.envs.action_space
        low, high = (torch.from_numpy(bound).to(device) for bound in (space.low, space.high))
        spaces = _by_entry(getattr(self.envs.observation_space, "spaces", self.envs.observation_space))
        dtypes = {"float32": torch.float32, "float64": torch.float64}
        observed = {name: Unbounded(box.shape, dtype=dtypes[str(box.dtype)], device=device) for name, box in spaces.items()}
        self.observation_spec = Composite(observed, shape=self.batch_size, device=device)
        self.action_spec = Bounded(low, high, shape=low.shape, dtype=torch.float32, device=device)
        self.reward_spec = Unbounded((num_envs, 1), dtype=torch.float32, device=device)
        flag = Categorical(2, shape=(num_envs, 1), dtype=torch.bool, device=device)
        self.done_spec = Composite(done=flag, terminated=flag.clone(), truncated=flag.clone(), shape=self.batch_size, device=device)

    def _set_seed(self, seed: int | None) -> None:
        # The next reset gives environment i the seed `seed + i`.
        self._seed = seed

    def _reset(self, tensordict: TensorDictBase | None = None, **kwargs: Any) -> TensorDictBase:
        chosen = None if tensordict is None else tensordict.get("_reset", None)
        mask = np.ones(self.batch_size, dtype=bool) if chosen is None else chosen.cpu().numpy().reshape(self.batch_size)
        seed, self._seed = self._seed, None
        observation, _ = self.envs.reset(seed=seed, options={"reset_mask": mask})
        self._ended = self._ended & ~mask
        no_flags = np.zeros_like(self._ended)
        kept = no_flags if self._last is None else self._last["terminated"].cpu().numpy()[:, 0] & ~mask
        self._last = self._entries(observation, kept, self._ended & ~kept)
        return self._last

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        chosen = tensordict.get("_step", None)
        mask = np.ones(self.batch_size, dtype=bool) if chosen is None else chosen.cpu().numpy().reshape(self.batch_size)
        if (mask & self._ended).any():
            raise RuntimeError(f"episodes of environments {np.flatnonzero(mask & self._ended)[:10].tolist()} have ended: reset them")
        if not (mask | self._ended).all():
            waiting = np.flatnonzero(~(mask | self._ended))[:10].tolist()
            raise RuntimeError(f"'_step' excludes the environments {waiting}, whose episodes have not ended: step or reset them")
        last = self._last
        observation, reward, terminated, truncated, _ = self.envs.step(tensordict["action"].detach().cpu().numpy())
        result = self._entries(observation, terminated, truncated)
        result["reward"] = torch.from_numpy(reward).float().to(self.device).unsqueeze(-1)
        if last is not None and not mask.all():  # Environments that do not step keep their last entries, as TorchRL requires.
            out = torch.from_numpy(~mask).to(self.device)
            for name in (*self.observation_spec, "done", "terminated", "truncated"):
                result[name] = torch.where(out.unsqueeze(-1), last[name], result[name])
        self._ended = result["done"].cpu().numpy()[:, 0]
        self._last = result
        return result

    def _entries(self, observation: Any, terminated: Array, truncated: Array) -> TensorDictBase:
        """Entries of the result of a reset or step: the observation (num_envs, n), or one per group, and the flags (num_envs, 1)."""
        flags = {"terminated": terminated, "truncated": truncated, "done": terminated | truncated}
        values = {name: torch.from_numpy(flag).to(self.device).unsqueeze(-1) for name, flag in flags.items()}
        seen = {name: torch.from_numpy(value).to(self.device) for name, value in _by_entry(observation).items()}
        return TensorDict(seen | values, self.batch_size, device=self.device)


def _by_entry(observation: Any) -> dict[str, Any]:
    """Observations or spaces by name of the entry: "observation", or the observation groups."""
    return observation if isinstance(observation, dict) else {"observation": observation}
