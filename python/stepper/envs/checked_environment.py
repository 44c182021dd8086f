"""Base class of single and vector environments: checks of subclasses and of assignments, and hints for attributes that do not exist."""

from __future__ import annotations

from typing import Any

from gymnasium.error import ClosedEnvironmentError

from stepper._hints import raise_error_of_property
from stepper.envs.absent import check_assignment, missing_from_environment
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
        raise missing_from_environment(owner, self, name)

    def __setattr__(self, name: str, value: Any) -> None:
        if name[0] != "_":
            check_assignment(self, name, value)
        object.__setattr__(self, name, value)
