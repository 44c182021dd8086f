"""Jobs of a study one after the other, or as tasks of Ray on all machines of its cluster: the same results, in whatever order."""

from __future__ import annotations

import contextlib
import copy
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

from stepper.lab.study.drives import FILES
from stepper.shared.over_ray import each_task, running_ray

if TYPE_CHECKING:
    from stepper.lab.study.study import Study

Job = TypeVar("Job")
Made = TypeVar("Made")


class WorkerVersionError(ValueError):
    """A worker has other versions than the process that asks it, so that its rows would not be those of this process."""


def each(study: Study, jobs: Sequence[Job], run: Callable[[Study, Job], Made]) -> Iterator[tuple[int, Made]]:
    """Runs jobs here one after the other, or over Ray where the study says so: as of `over_ray`."""
    if study.ray and jobs:
        yield from over_ray(study, jobs, run)
    else:
        for number, job in enumerate(jobs):
            yield number, run(study, job)


def over_ray(study: Study, jobs: Sequence[Job], run: Callable[[Study, Job], Made]) -> Iterator[tuple[int, Made]]:
    """Runs jobs, each as a task with as many CPUs as the study has threads; with threads=0 that is one, since jobs take all CPUs.

    A task whose worker is lost is run again by Ray. Ray is started here where it does not run. Functions of the study's own files go along;
    modules that those import must be where the workers find them.

    Args:
        study: The study.
        jobs: What is run.
        run: What runs one.

    Yields:
        The number of a job and what was made of it, as they are done.

    Raises:
        MissingPackageError: Ray is not installed.
        WorkerVersionError: A worker has another stepper, NumPy or MuJoCo, or none.
    """
    ray = running_ray("to run a study over Ray", log_to_driver=False)
    for name in [name for name in sys.modules if name.startswith(FILES)]:
        ray.cloudpickle.register_pickle_by_value(sys.modules[name])
    # What rows follow from is told here, where the files are; a worker has it with the study.
    assert study.in_force
    ours = study.identity["versions"]
    shared = (ours, ray.cloudpickle.dumps((_of_task(study), run)))
    pickled = map(ray.cloudpickle.dumps, jobs)
    with contextlib.closing(each_task(ray, _guarded(), shared, pickled, num_cpus=max(1, study.threads))) as tasks:
        for number, (machine, theirs, made) in tasks:
            if theirs != ours:
                raise WorkerVersionError(_refusal(machine, theirs, ours))
            yield number, made


def _of_task(study: Study) -> Study:
    """The study as a task steps it, with all that was found out about it here: threads=0 would be all CPUs for each of many tasks."""
    made = copy.copy(study)
    object.__setattr__(made, "threads", max(1, study.threads))
    return made


def _guarded() -> Callable[[dict[str, Any], bytes, bytes], tuple[str, dict[str, Any], Any]]:
    """What a task runs: a job, where the versions of its worker are the driver's, and they are told.

    A function within this one, which Ray sends as it is. What is of this package a worker with another version may not be able to read, so
    it is read after the versions were compared.
    """

    def guarded(ours: dict[str, Any], shared: bytes, job: bytes) -> tuple[str, dict[str, Any], Any]:
        import contextlib  # noqa: PLC0415
        import importlib.metadata  # noqa: PLC0415
        import pickle  # noqa: PLC0415
        import platform  # noqa: PLC0415

        theirs: dict[str, Any] = dict.fromkeys(ours)
        for name in ("stepper", "numpy"):
            with contextlib.suppress(ImportError):
                theirs[name] = importlib.import_module(name).__version__
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            theirs["mujoco"] = importlib.metadata.version("mujoco-core")
        if theirs != ours:
            return platform.node(), theirs, None
        study, run = pickle.loads(shared)
        return platform.node(), theirs, run(study, pickle.loads(job))

    return guarded


def _refusal(machine: str, theirs: dict[str, Any], ours: dict[str, Any]) -> str:
    apart = [
        f"{name} {theirs[name] or '(not installed)'} there and {ours[name] or '(not installed)'} here"
        for name in ours
        if theirs[name] != ours[name]
    ]
    return (
        f"a worker of Ray on {machine} has {', '.join(apart)}, so that its rows would not be those of this process: install the same "
        "versions on all machines, or give ray.init a runtime_env that has them"
    )
