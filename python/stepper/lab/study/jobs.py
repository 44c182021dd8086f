"""Jobs of a study, run one after the other or as tasks of Ray on a cluster, with the same results."""

from __future__ import annotations

import contextlib
import copy
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

from stepper.lab.study.controllers import FILES
from stepper.shared.ray_tasks import each_task, running_ray

if TYPE_CHECKING:
    from stepper.lab.study.study import Study

Job = TypeVar("Job")
Made = TypeVar("Made")


class WorkerVersionError(ValueError):
    """A worker of Ray has other versions of stepper, NumPy or MuJoCo than this process, so that its results could differ."""


def each(study: Study, jobs: Sequence[Job], run: Callable[[Study, Job], Made]) -> Iterator[tuple[int, Made]]:
    """Runs jobs one after the other, or as tasks of Ray if `study.ray` is set.

    Yields:
        Index of a job and its result. With Ray the order is that in which the jobs end.
    """
    if study.ray and jobs:
        yield from _on_ray(study, jobs, run)
    else:
        for number, job in enumerate(jobs):
            yield number, run(study, job)


def _on_ray(study: Study, jobs: Sequence[Job], run: Callable[[Study, Job], Made]) -> Iterator[tuple[int, Made]]:
    """Runs each job as a task of Ray with one CPU per thread of the study, or one CPU with threads=0.

    Ray is started if it is not running, and repeats a task whose worker is lost. Functions of the study's files are sent to the workers.
    Modules that these files import must be installed on the workers.

    Raises:
        MissingPackageError: Ray is not installed.
        WorkerVersionError: A worker has other versions of stepper, NumPy or MuJoCo, or lacks one of them.
    """
    ray = running_ray("to run a study over Ray", log_to_driver=False)
    for name in [name for name in sys.modules if name.startswith(FILES)]:
        ray.cloudpickle.register_pickle_by_value(sys.modules[name])
    # `resolved_settings` is computed (and cached in the study) before pickling, because only this process has the files.
    assert study.resolved_settings()
    ours = study.identity["versions"]
    shared = (ours, ray.cloudpickle.dumps((_of_task(study), run)))
    pickled = map(ray.cloudpickle.dumps, jobs)
    with contextlib.closing(each_task(ray, _guarded(), shared, pickled, num_cpus=max(1, study.threads))) as tasks:
        for number, (machine, theirs, made) in tasks:
            if theirs != ours:
                raise WorkerVersionError(_refusal(machine, theirs, ours))
            yield number, made


def _of_task(study: Study) -> Study:
    """Copy of a study for a task of Ray, with its cached properties.

    threads=0 becomes 1, because each task would otherwise use all CPUs.
    """
    made = copy.copy(study)
    object.__setattr__(made, "threads", max(1, study.threads))
    return made


def _guarded() -> Callable[[dict[str, Any], bytes, bytes], tuple[str, dict[str, Any], Any]]:
    """Function that each task runs: it compares the worker's versions with this process's, and runs the job if they are equal.

    It is a nested function, so that Ray sends its code. A worker with another version may fail to unpickle objects of this package; the
    function therefore unpickles them after the comparison.
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
    """Error message that lists the versions that differ between a worker and this process."""
    apart = [
        f"{name} {theirs[name] or '(not installed)'} there and {ours[name] or '(not installed)'} here"
        for name in ours
        if theirs[name] != ours[name]
    ]
    return (
        f"a worker of Ray on {machine} has {', '.join(apart)}, so that its rows would not be those of this process: install the same "
        "versions on all machines, or give ray.init a runtime_env that has them"
    )
