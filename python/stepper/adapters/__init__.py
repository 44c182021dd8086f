"""Adapters of `stepper.envs` to other libraries: one module for each library, imported by its name.

    from stepper.adapters.sb3 import StepperVecEnv  # or stepper.adapters.sb3.StepperVecEnv

docs/reference/adapters.md has an example of each. Importing one needs its library; importing this package needs none.
"""

import importlib
from typing import Any

_SUBMODULES = ("envpool", "jax_rollout", "native", "pufferlib", "ray", "rllib", "sb3", "torch", "torch_rollout", "torchrl", "unisim")
"""Adapters, which are imported when they are first used."""


def __getattr__(name: str) -> Any:
    if name in _SUBMODULES:
        return importlib.import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *_SUBMODULES})
