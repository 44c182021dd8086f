"""RLlib's environments, vectorised natively in each of its env runners."""

from __future__ import annotations

from typing import Any

from stepper.adapters.native import Env, make_native, with_autoreset
from stepper.shared.machine import require

require("ray.rllib", "for stepper.adapters.rllib")

import gymnasium  # noqa: E402
from gymnasium.vector import AutoresetMode  # noqa: E402
from ray import tune  # noqa: E402

from stepper.envs import StepperEnv, StepperVectorEnv  # noqa: E402


def register_env(name: str, env: Env, **settings: Any) -> None:
    """Registers environments under a name for RLlib's configurations.

        register_env("hopper", "stepper/Hopper-v5", precision="f32")
        config = (
            PPOConfig()
            .environment("hopper", env_config={"contact": "hard"})
            .env_runners(gym_env_vectorize_mode="vector_entry_point", num_envs_per_env_runner=64)
        )

    An env runner makes one `StepperVectorEnv` of its environments then; without that mode it makes them one by one.

    Args:
        name: What `config.environment` takes. A name that is taken is registered anew.
        env: A name that Gymnasium knows, "stepper/Hopper-v5", with the limit of its episodes; or a `Task`, or the class of one.
        **settings: Further arguments of `stepper.envs.StepperVectorEnv`; `env_config` may have more. Observations are float32 unless
            `dtype` says otherwise; RLlib asks for Gymnasium's autoreset NEXT_STEP.
    """

    def create(config: dict[str, Any]) -> gymnasium.Env[Any, Any] | StepperVectorEnv:
        given = {"dtype": "float32", **settings, **config}
        num_envs = given.pop("num_envs", None)
        if num_envs is not None:
            return make_native(env, num_envs, **with_autoreset(given, AutoresetMode.NEXT_STEP, "RLlib"))
        given.pop("threads", None)
        return gymnasium.make(env, **given) if isinstance(env, str) else StepperEnv(env, **given)

    tune.register_env(name, create)
