"""Reference of a chart or tuning: the study's closed-form solution (`Study.exact`) if it has one, or a converged run."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper.lab.accuracy.budget import Stage
from stepper.lab.accuracy.reference import Reference, converge
from stepper.lab.accuracy.traces import Distance, Trace, TraceRecorder
from stepper.lab.study import controllers
from stepper.lab.study.batches import begin, world_of
from stepper.lab.study.points import USUAL
from stepper.lab.study.study import Study
from stepper.lab.study.worlds import StepperWorld

Array = NDArray[np.float64]
_INITIAL_DIFFERENCE = 1e-9
"""Largest accepted difference between the initial state of a closed-form solution and that of an episode, m, rad, m/s, rad/s."""


def reference_of(
    study: Study,
    episodes: Sequence[int],
    distance: Distance,
    *,
    target: float,
    most: int = 7,
    law: dict[str, Any] | None = None,
    stage: Stage | None = None,
    progress: Callable[[float], None] | None = None,
) -> Reference:
    """Reference of some episodes: the study's closed form if it has one, otherwise a run that is converged by halving the time step.

    Args:
        study: The study.
        episodes: Numbers of the episodes.
        distance: Definition of the difference of two runs.
        target: Target of the uncertainty, m or rad.
        most: Largest number of halvings of the study's time step, at least 2.
        law: Settings of the converged run, such as those of MuJoCo's contact law. None selects hard contact and the midpoint rule.
        stage: Stage of the time budget; None sets no time limit.
        progress: Progress callback with the fraction done.
    """
    if study.exact is None:
        return converge(study, episodes, distance, target=target, most=most, law=law, stage=stage, progress=progress)
    trace = closed_form(study, episodes)
    if progress:
        progress(1.0)
    count = len(episodes)
    return Reference(
        runs=(trace,),
        second=(),
        target=target,
        uncertainty=np.zeros(count),
        orders=np.full(count, np.nan),
        extrapolates=np.ones(count, np.bool_),
        methods=np.full(count, np.nan),
        known=np.full(count, trace.reached),
        exact=controllers.name_of(study.exact) or "a function",
    )


def closed_form(study: Study, episodes: Sequence[int]) -> Trace:
    """Trace of episodes from the study's closed form, after every control period, with outcomes."""
    assert study.exact is not None
    world = world_of(study, USUAL, [study.nominal] * len(episodes), sensors=None)
    assert isinstance(world, StepperWorld)
    begin(study, world, episodes)
    name = controllers.name_of(study.exact)
    times: Array = study.control_period * np.arange(study.num_control_steps + 1, dtype=np.float64)
    found = study.exact(world, times)
    if not isinstance(found, tuple | list) or len(found) != 2:
        raise ValueError(f"{study.name}: exact, {name}, gives {type(found).__name__}, must give two arrays, qpos and qvel")
    start = (world.qpos.copy(), world.qvel.copy())
    rows = []
    for what, given, own in zip(("qpos", "qvel"), found, start, strict=True):
        made, shape = np.asarray(given, float), (len(times), *own.shape)
        if made.shape != shape:
            raise ValueError(f"{study.name}: exact, {name}, gives {what} of shape {made.shape}, must be (T, num_envs, n{what[0]}): {shape}")
        if not np.isfinite(made).all():
            raise ValueError(f"{study.name}: exact, {name}, gives {what} that is not finite: it must be finite at all times")
        if (apart := float(np.abs(made[0] - own).max(initial=0.0))) > _INITIAL_DIFFERENCE:
            raise ValueError(
                f"{study.name}: exact, {name}, begins {apart:.2g} away from the initial {what} of the episodes: at time 0 it must "
                "return the world's qpos and qvel, with their noise"
            )
        rows.append(made)
    seen = TraceRecorder(study, world)
    seen.record(world)
    for k, time in enumerate(times[1:], start=1):
        world.sim.reset(qpos=rows[0][k], qvel=rows[1][k])
        world.time = np.full(world.num_envs, time)
        seen.record(world)
    # The duration of the reference is infinite, so that no run counts as much slower than the reference.
    return replace(seen.trace(world, study.num_control_steps, math.inf), settings={"exact": name}, timestep=math.nan)
