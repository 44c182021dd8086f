"""Base class of single and vector environments: checks of subclasses and of assignments, and hints for attributes that do not exist."""

from __future__ import annotations

from typing import Any

from gymnasium.error import ClosedEnvironmentError

from stepper._hints import no_attribute, raise_error_of_property, replacement
from stepper.envs.members import check_environment
from stepper.envs.task import Task


class CheckedEnvironment:
    """Base class of `StepperEnv` and `StepperVectorEnv`, which have the attributes `_batch`, `task`, `sim` and `now`."""

    _closed = False
    """Whether `close` was called."""

    def _check_open(self, call: str) -> None:
        """Raises ClosedEnvironmentError, Gymnasium's, if the environment was closed; `call` is the name of the method."""
        if self._closed:
            raise ClosedEnvironmentError(f"{call} was called after close: call close last, or make another environment")

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if CheckedEnvironment not in cls.__bases__:  # The two environments themselves need no check.
            check_environment(cls, Task)

    def __getattr__(self, name: str) -> Any:
        raise_error_of_property(self, name)
        owner = next(kind for kind in type(self).__mro__ if CheckedEnvironment in kind.__bases__)
        if "_batch" in vars(self) and name[0] != "_" and not replacement(owner.__name__, name):
            parts = {"task": self.task, "sim": self.sim, "sim.model": self.sim.model, "now": self.now}
            for place, part in parts.items():
                if name in dir(part):
                    raise AttributeError(f"a stepper.envs.{owner.__name__} has no attribute {name!r}; use env.unwrapped.{place}.{name}")
        raise no_attribute(owner, name)

    def __setattr__(self, name: str, value: Any) -> None:
        if name[0] != "_" and "_batch" in vars(self) and not hasattr(type(self), name):
            task = type(self.task).__name__
            if name == "frame_skip" or name in getattr(self.task, "__dataclass_fields__", ()):
                raise AttributeError(
                    f"{name} of a {type(self).__name__} cannot be assigned, it is an attribute of the task: make another environment, with "
                    f"the argument {name}={value!r} if {task} has the field, or set it in the class {task}"
                )
        object.__setattr__(self, name, value)
