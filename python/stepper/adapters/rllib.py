"""Registration of environments with RLlib, as one `StepperVectorEnv` per env runner."""

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

    With this `gym_env_vectorize_mode`, an env runner steps all its environments as one `StepperVectorEnv`. Without it, RLlib steps them one
    by one.

    Args:
        name: Name for `config.environment`. An earlier registration of the name is replaced.
        env: Id of a registered Gymnasium environment, such as "stepper/Hopper-v5", whose episode limit applies; or a `Task` or its class.
        **settings: Further arguments of `stepper.envs.StepperVectorEnv`; `env_config` may add more. The default `dtype` of observations
            is float32. The autoreset is Gymnasium's NEXT_STEP, which RLlib needs.
    """

    def create(config: dict[str, Any]) -> gymnasium.Env[Any, Any] | StepperVectorEnv:
        given = {"dtype": "float32", **settings, **config}
        num_envs = given.pop("num_envs", None)
        if num_envs is not None:
            return make_native(env, num_envs, **with_autoreset(given, AutoresetMode.NEXT_STEP, "RLlib"))
        given.pop("threads", None)
        return gymnasium.make(env, **given) if isinstance(env, str) else StepperEnv(env, **given)

    tune.register_env(name, create)
