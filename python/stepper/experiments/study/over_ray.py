"""Batches of a study as tasks of Ray, on all machines of its cluster: the same rows, in whatever order they are done."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

from stepper.experiments.study.drives import FILES
from stepper.experiments.study.study import Study
from stepper.shared.machine import require

Batch = TypeVar("Batch")
Made = TypeVar("Made")


def over_ray(study: Study, batches: Sequence[Batch], run: Callable[[Study, Batch], Made]) -> Iterator[tuple[int, Made]]:
    """Runs batches, each as a task with as many CPUs as the study has threads.

    A task whose worker is lost is run again by Ray. Ray is started here where it does not run. Functions of the study's own files go along;
    modules that those import must be where the workers find them.

    Args:
        study: The study.
        batches: What is run.
        run: What runs one.

    Yields:
        The number of a batch and what was made of it, as they are done.

    Raises:
        MissingPackageError: Ray is not installed.
    """
    ray = require("ray", "to run a study over Ray")
    if not ray.is_initialized():
        ray.init(include_dashboard=False, log_to_driver=False)
    for name in [name for name in sys.modules if name.startswith(FILES)]:
        ray.cloudpickle.register_pickle_by_value(sys.modules[name])
    # What rows follow from is told here, where the files are; a worker has it with the study.
    assert study.in_force
    shared = ray.put(study)
    task = ray.remote(run).options(num_cpus=max(1, study.threads))
    waiting = {task.remote(shared, batch): number for number, batch in enumerate(batches)}
    try:
        while waiting:
            (done,), _ = ray.wait(list(waiting), num_returns=1)
            yield waiting.pop(done), ray.get(done)
    finally:
        for left in waiting:
            ray.cancel(left)
