"""Kinks: places where a step is not differentiable, seen by comparing perturbed copies with the nominal environment.

Two signs are read. What is active: contacts that push, whether they stick or slip, joints at their limits, joints held by dry friction,
saturated actuators. And slopes on both sides that differ by more than curvature explains. docs/derivatives.md says what each proves.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from enum import IntFlag
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper._status import Status
from stepper._stepper import Model, Stepper
from stepper.derivatives.perturbations import NOISE_RATIO, Array, Stencil

Bools = NDArray[np.bool_]

UNSOLVED = Status.NOT_CONVERGED | Status.NON_FINITE | Status.CONTACTS_FULL | Status.UNRESOLVED | Status.INFEASIBLE
"""Flags of steps whose derivatives mean little."""
PUSHES = 1e-9
"""Normal force relative to the largest of the environment, above which a contact pushes."""
SLIPS = 1e-6
"""Contacts slip whose friction is nearer to the bound than this share of it: solutions are on the bound to 1e-12."""
AT_LIMIT = 1e-6
"""Distance from the end of its range, rad or m, at which a joint is held there: the position solve of a step ends within 1e-7."""
HELD = 1e-9
"""Speed below which dry friction holds a joint, m/s or rad/s."""
CURVATURE = 1e4
"""Change of a slope per unit of a coordinate, relative to the slope, that smooth motion may have."""


class Kink(IntFlag):
    """Why a derivative is near a kink: what differs between perturbed copies and the nominal environment."""

    NONE = 0
    """Nothing does."""
    CONTACT = 1
    """Contacts begin or cease to push."""
    SLIP = 2
    """Contacts that stick in one and slip in the other; not read with contact="mujoco"."""
    GAP = 4
    """A contact or limit that is open by a hair in one and overlaps in the other: an open gap may close within the step, an overlap is
    not pushed out by velocity. A robot at rest is at this kink; docs/derivatives.md has settings without it."""
    LIMIT = 8
    """Slides and hinges that reach a limit or leave it; limits of ball joints and tendons are not read."""
    DRY_FRICTION = 16
    """Joints that dry friction holds in one and not in the other; not read with contact="mujoco"."""
    SATURATION = 32
    """Actuators at the bound of their effort."""
    SLOPE = 64
    """Slopes on both sides of the nominal point differ, whatever the cause."""
    UNSOLVED = 128
    """A step was not solved, not finite, or too long for its motion (`Status`)."""


@dataclass
class Report:
    """What was found in some environments.

    Attributes:
        causes: Flags of `Kink` by column, (num_envs, nstep, columns) uint32.
        distance: Widths of the difference to the nearest kink of each step, (num_envs, nstep).
    """

    causes: NDArray[np.uint32]
    distance: Array


class Watch:
    """Compares copies with their nominal environment after every step.

    Args:
        sim: The copies, row e * count + k for copy k of environment e.
        stencil: Where they are, of these environments.
        nstep: Number of steps.
    """

    def __init__(self, sim: Stepper, stencil: Stencil, nstep: int):
        self.sim, self.stencil, self.model = sim, stencil, sim.model
        self.n, self.levels, _, self.columns = stencil.offsets.shape
        self.count = 1 + self.levels * 2 * self.columns
        self.hard = sim.options.contact == "hard"
        self.report = Report(np.zeros((self.n, nstep, self.columns), np.uint32), np.full((self.n, nstep), np.inf))
        self._before = np.asarray(sim.qpos), np.asarray(sim.qvel)

    def look(self, step: int) -> None:
        """Reads what is active after a step."""
        self._contacts(step)
        self._joints(step)
        saturated = np.asarray(self.sim.actuator_saturation) > 0
        self._differs(step, saturated, Kink.SATURATION)
        status, enough = np.asarray(self.sim.status), NOISE_RATIO * self.sim.tolerance
        # A residual that the step of the differences is made for does no harm, however tight the tolerance was.
        flags = np.where(np.asarray(self.sim.residual) > enough, int(UNSOLVED), int(UNSOLVED & ~Status.NOT_CONVERGED))
        unsolved = (status & flags) != 0
        copies = unsolved.reshape(self.n, self.count)
        self._mark(step, copies | copies[:, :1], Kink.UNSOLVED)
        self._before = np.asarray(self.sim.qpos), np.asarray(self.sim.qvel)

    def bends(self, changes: Array, slopes: Array, groups: list[slice], noise: float) -> None:
        """Reads slopes on both sides, at the end of all steps.

        Args:
            changes: As of `Stencil.slopes`.
            slopes: What that returned for the finest level, (num_envs, columns, n).
            groups: Rows of a kind, whose slopes are compared with one another.
            noise: Noise of a result.
        """
        bends = self.stencil.bends(changes)[:, 0]
        h = self.stencil.step[:, 0]
        floor = 4.0 * noise / np.where(h > 0.0, h, 1.0)
        for group in groups:
            size = np.abs(slopes[..., group]).max(axis=-1, initial=0.0)
            bend = bends[..., group].max(axis=-1, initial=0.0)
            kinked = bend > np.minimum(CURVATURE * h, 0.1) * size + floor
            self.report.causes[:, -1][kinked] |= np.uint32(Kink.SLOPE)

    def _mark(self, step: int, copies: Bools, kink: Kink) -> None:
        """Marks the columns of copies, (num_envs, count)."""
        columns = copies[:, 1:].reshape(self.n, self.levels * 2, self.columns).any(axis=1)
        self.report.causes[:, step][columns] |= np.uint32(kink)

    def _differs(self, step: int, active: Bools, kink: Kink) -> None:
        """Marks where what is active, (copies, m), is otherwise than in the nominal environment."""
        each = active.reshape(self.n, self.count, active.shape[1])
        differs = (each != each[:, :1]).any(axis=2)
        self._mark(step, differs, kink)
        # What switches between the copies is within their reach, whatever first order says of it from the nominal one.
        near = differs[:, 1:].any(axis=1)
        self.report.distance[near, step] = np.minimum(self.report.distance[near, step], 1.0)

    def _approach(self, step: int, indicator: Array) -> None:
        """Takes the distance to where an indicator, (copies, m), would be zero, to first order; NaN says nothing."""
        each = indicator.reshape(self.n, self.count, indicator.shape[1])
        now = each[:, 0]
        moved = (each[:, 1:] - each[:, :1]).reshape(self.n, self.levels, 2, self.columns, indicator.shape[1])
        slopes = self.stencil.slopes(moved)[:, 0] * self.stencil.step[:, 0, :, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            widths = np.abs(now)[:, None] / np.abs(slopes)
        nearest = np.where(np.isnan(widths), np.inf, widths).min(axis=(1, 2), initial=np.inf)
        self.report.distance[:, step] = np.minimum(self.report.distance[:, step], nearest)

    def _joints(self, step: int) -> None:
        """Limits and dry friction."""
        joints = [joint for joint in _limited(self.model)]
        q, v = np.asarray(self.sim.qpos), np.asarray(self.sim.qvel)
        if joints:
            place, dof, index = (np.array(part) for part in zip(*joints, strict=True))
            ranges = np.asarray(self.sim.randomized.get("jnt_range", self.model.jnt_range[None]))[:, index]
            middle = 0.5 if self.sim.options.integrator in (None, "midpoint", "rk4") and self.hard else 0.0
            taken = self._before[0][:, place] + middle * self.sim.timestep * self._before[1][:, dof]
            for side, sign in ((0, 1.0), (1, -1.0)):
                after, gap = sign * (q[:, place] - ranges[..., side]), sign * (taken - ranges[..., side])
                held = after < AT_LIMIT if self.hard else gap < 0.0
                self._differs(step, held, Kink.LIMIT)
                if not self.hard:
                    self._approach(step, gap)
                elif _smooth_at_rest(self.sim):
                    self._approach(step, np.where(held, np.nan, after))
                else:
                    self._differs(step, held & (gap < 0.0), Kink.GAP)
                    self._approach(step, np.where(held, gap, after))
        losses = np.flatnonzero(np.asarray(self.model.dof_frictionloss) > 0.0)
        if len(losses) and self.hard:
            held = np.abs(v[:, losses]) < HELD
            self._differs(step, held, Kink.DRY_FRICTION)
            self._approach(step, np.where(held, np.nan, v[:, losses]))

    def _contacts(self, step: int) -> None:
        """Contacts that push, in the order in which a step lists them."""
        all_ = self.sim.contacts()
        force = all_["force"][:, 0]
        largest = np.zeros(self.n * self.count)
        np.maximum.at(largest, all_["env"], force)
        contacts = all_[force > PUSHES * largest[all_["env"]]]
        env = contacts["env"]
        counts = np.bincount(env, minlength=self.n * self.count)
        starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
        width = int(counts.max(initial=0))
        if not width:
            return
        table = np.full((len(counts), width), -1)
        table[env, np.arange(len(env)) - starts[env]] = np.arange(len(env))
        pair = np.where(table[..., None] >= 0, contacts["geom"][table], -1)
        self._differs(step, pair.reshape(len(counts), 2 * width), Kink.CONTACT)
        there = table >= 0
        normal = np.where(there, contacts["force"][table, 0], np.nan)
        self._approach(step, normal)
        if self.hard:
            slack = np.where(there, _slack(self.sim, contacts)[table], np.nan)
            slips = slack < SLIPS * normal
            self._differs(step, slips & there, Kink.SLIP)
            self._approach(step, np.where(slips, np.nan, slack))
            gap = np.where(there, contacts["distance"][table], np.nan)
            if not _smooth_at_rest(self.sim):
                self._differs(step, gap < 0.0, Kink.GAP)
                self._approach(step, gap)


def _smooth_at_rest(sim: Stepper) -> bool:
    """Whether gaps and overlaps have one and the same demand: Baumgarte's method that closes all of an overlap in a step."""
    options = sim.options
    return options.stabilization == "baumgarte" and options.baumgarte == 1.0 and options.slop == 0.0


def _slack(sim: Stepper, contacts: NDArray[Any]) -> Array:
    """Force that the bound of friction leaves, in N; infinite without friction. Explicit pairs are taken to have that of their geoms."""
    model = sim.model
    friction = np.asarray(sim.randomized.get("geom_friction", model.geom_friction[None]))
    priority = _priorities(model)
    env = contacts["env"] if len(friction) > 1 else np.zeros(len(contacts), np.intp)
    first, second = contacts["geom"][:, 0], contacts["geom"][:, 1]
    a, b = friction[env, first], friction[env, second]
    above = priority[first] - priority[second]
    mu = np.where((above > 0)[:, None], a, np.where((above < 0)[:, None], b, np.maximum(a, b)))
    force, torque = contacts["force"], contacts["torque"]
    with np.errstate(divide="ignore", invalid="ignore"):
        loads = np.column_stack([force[:, 1:] / mu[:, :1], torque[:, :1] / mu[:, 1:2], torque[:, 1:] / mu[:, 2:]])
    size = np.sqrt(np.square(np.where(np.isfinite(loads), loads, 0.0)).sum(axis=1))
    condim = np.asarray(model.geom_condim)
    frictionless = np.where(above > 0, condim[first], np.where(above < 0, condim[second], np.maximum(condim[first], condim[second]))) == 1
    slack: Array = np.where(frictionless, np.inf, force[:, 0] - size)
    return slack


@functools.lru_cache(maxsize=8)
def _priorities(model: Model) -> NDArray[np.int64]:
    return np.array([model.geom(k).priority for k in range(model.ngeom)], dtype=np.int64)


@functools.lru_cache(maxsize=8)
def _limited(model: Model) -> list[tuple[int, int, int]]:
    """Place in qpos, place in qvel and index of every slide and hinge that has a range."""
    joints = (model.joint(k) for k in range(model.njnt))
    return [(joint.qposadr, joint.dofadr, joint.id) for joint in joints if joint.limited and joint.type in ("slide", "hinge")]
