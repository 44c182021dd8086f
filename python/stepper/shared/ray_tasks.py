"""Parallel calls of a function as tasks of Ray, on one machine or a cluster."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from types import ModuleType
from typing import Any

from stepper.shared.machine import require


def running_ray(purpose: str) -> ModuleType:
    """Module `ray`, after `ray.init` if Ray is not running.

    Args:
        purpose: Purpose of Ray for the error message; see `stepper.shared.machine.require`.

    Raises:
        MissingPackageError: Ray is not installed.
    """
    ray = require("ray", purpose)
    if not ray.is_initialized():
        ray.init(include_dashboard=False)
    return ray


def each_task(
    ray: ModuleType, run: Callable[..., Any], shared: Iterable[Any], cases: Iterable[Any], **options: Any
) -> Generator[tuple[int, Any], None, None]:
    """Calls `run(*shared, case)` for every case, each call as a task of Ray. If a call fails, the others are cancelled.

    Args:
        ray: Module `ray`, initialised.
        run: The function.
        shared: Arguments of all calls, which Ray stores once.
        cases: Last argument of each call.
        **options: Options of Ray for a task, such as num_cpus=2.

    Yields:
        Index of a case and the return value of its call, in the order in which the calls end.
    """
    references = [ray.put(value) for value in shared]
    task = ray.remote(run).options(**options)
    waiting = {task.remote(*references, case): number for number, case in enumerate(cases)}
    try:
        while waiting:
            (done,), _ = ray.wait(list(waiting), num_returns=1)
            result = ray.get(done)
            yield waiting.pop(done), result
    finally:
        for left in waiting:
            ray.cancel(left)
