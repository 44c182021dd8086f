"""Adapters of `stepper.envs` and `stepper.Stepper` to other libraries: one module per library, imported by name.

    from stepper.adapters.sb3 import StepperVecEnv  # or stepper.adapters.sb3.StepperVecEnv

docs/reference/adapters.md has an example of each. Importing an adapter requires its library; importing this package requires none.
"""

import importlib
from typing import Any

_SUBMODULES = (
    *("jax_rollout", "native", "ray", "rllib", "rsl_rl", "sb3"),
    *("torch_rollout", "torchrl"),
)
"""Names of the adapter modules, which are imported at first use."""


def __getattr__(name: str) -> Any:
    if name in _SUBMODULES:
        return importlib.import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *_SUBMODULES})
