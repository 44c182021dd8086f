"""Kinks: places where a step is not differentiable, seen by comparing perturbed copies with the nominal environment.

There are two tests. `Stepper._find_kinks` compares the active sets: contacts that push, whether they stick or slip, joints at their limits,
joints held by dry friction, saturated actuators. The second test compares the slopes on both sides: they may differ by curvature only.
docs/how-to/derivatives.md explains what each test proves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntFlag
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from stepper._stepper import Model, Stepper
from stepper.derivatives.perturbations import NOISE_RATIO, Array, Stencil

Bools = NDArray[np.bool_]

CURVATURE = 1e4
"""Change of a slope per unit of a coordinate, relative to the slope, that smooth motion may have."""

LEAST_SLOPE = 0.1
"""Slope of velocities below which a column is compared with this one, SI units: what rests has columns that are 0 but for terms of second
order. Slopes of displacements are smaller by the duration of the steps."""

SOLVED = 1e-9
"""Residual with which the modes of a step are certain, m/s."""


class Kink(IntFlag):
    """Kinds of kinks: differences between perturbed copies and the nominal environment."""

    NONE = 0
    """No kink."""
    CONTACT = 1
    """Contacts begin or cease to push."""
    SLIP = 2
    """Contacts that stick in one and slip in the other; not detected with contact="mujoco"."""
    GAP = 4
    """A contact or limit has a tiny gap in one and overlaps in the other. A gap may close within the step; an overlap adds no velocity.
    A robot at rest is at this kink; docs/how-to/derivatives.md has settings without it. With method="implicit" the flag has a second
    cause: equalities move a contact across the depth at which the damping of its position correction begins."""
    LIMIT = 8
    """Slides and hinges that reach a limit or leave it; limits of ball joints and tendons are not detected."""
    DRY_FRICTION = 16
    """Joints that dry friction holds in one and not in the other; not detected with contact="mujoco"."""
    SATURATION = 32
    """Actuators at the bound of their effort."""
    SLOPE = 64
    """Slopes on both sides of the nominal point differ, whatever the cause."""
    UNSOLVED = 128
    """A step was not solved, not finite, or too long for its motion (`Status`)."""
    UNDETERMINED = 256
    """The nominal mode has no slope (docs/how-to/derivatives.md): the column is 0 in place of a derivative."""


@dataclass(frozen=True)
class Rows:
    """Rows of one kind, whose slopes are compared with one another.

    Attributes:
        where: The rows.
        least: Slope below which a column is compared with this one, SI units.
    """

    where: slice
    least: float = LEAST_SLOPE


@dataclass
class Report:
    """Kinks found in some environments.

    Attributes:
        causes: Flags of `Kink` by column, (num_envs, nstep, columns) uint32.
        distance: Widths of the difference to the nearest kink of each step, (num_envs, nstep).
    """

    causes: NDArray[np.uint32]
    distance: Array


class Watch:
    """Comparison of copies with their nominal environment after every step.

    Args:
        sim: The copies, row e * count + k for copy k of environment e.
        stencil: Displacements of the copies.
        nstep: Number of steps.
    """

    def __init__(self, sim: Stepper, stencil: Stencil, nstep: int):
        self.sim, self.stencil = sim, stencil
        n, levels, self.sides, columns = stencil.offsets.shape
        self.count = 1 + levels * self.sides * columns
        self.report = Report(np.zeros((n, nstep, columns), np.uint32), np.full((n, nstep), np.inf))
        fixed, randomized = _numbers_of(sim), sim.randomized
        self._limited, self._rubbing = fixed.limited, fixed.rubbing
        self._ranges = np.asarray(randomized.get("jnt_range", fixed.ranges))[..., [index for _, _, index in self._limited], :]
        hard = sim.options.contact == "hard"
        # From the configuration before the step to that at which its rows are taken, s.
        self._ahead = 0.5 * sim.timestep if hard and sim.options.integrator in (None, "midpoint", "rk4") else 0.0
        self._steps = nstep
        self._taken = self._where_taken()

    def look(self, step: int) -> None:
        """Compares the active constraints of the copies after a step."""
        causes, distance = self.sim._find_kinks(
            count=self.count,
            sides=self.sides,
            one_sided=~self.stencil.central,
            limited=[[place, dof] for place, dof, _ in self._limited],
            ranges=self._ranges,
            taken=self._taken,
            rubbing=self._rubbing,
            smooth_at_rest=_smooth_at_rest(self.sim),
            tolerance=NOISE_RATIO * self.sim.tolerance,
        )
        self.report.causes[:, step] |= causes
        self.report.distance[:, step] = distance
        if step + 1 < self._steps:
            self._taken = self._where_taken()

    def _where_taken(self) -> Array:
        """Positions of the limited joints at which the next step takes its rows, (copies, joints)."""
        if not self._limited:
            return np.zeros((self.stencil.offsets.shape[0] * self.count, 0))
        place, dof, _ = (np.array(part) for part in zip(*self._limited, strict=True))
        taken: Array = np.asarray(self.sim.qpos, np.float64)[:, place] + self._ahead * np.asarray(self.sim.qvel, np.float64)[:, dof]
        return taken

    def bends(self, changes: Array, slopes: Array, groups: Sequence[Rows], noise: float) -> None:
        """Compares the slopes on both sides at the end of all steps, for columns with two points.

        Args:
            changes: Results minus the nominal result, (num_envs, levels, points, columns, n), as in `Stencil.slopes`.
            slopes: Slopes of the finest level, (num_envs, columns, n).
            groups: Rows that are compared with one another.
            noise: Noise of a result.
        """
        if self.sides == 1:
            return
        bends = self.stencil.bends(changes)[:, 0]
        h = self.stencil.step[:, 0]
        floor = 4.0 * noise / np.where(h > 0.0, h, 1.0)
        for group in groups:
            size = np.abs(slopes[..., group.where]).max(axis=-1, initial=group.least)
            bend = bends[..., group.where].max(axis=-1, initial=0.0)
            kinked = bend > np.minimum(CURVATURE * h, 0.1) * size + floor
            self.report.causes[:, -1][kinked] |= np.uint32(Kink.SLOPE)


def _smooth_at_rest(sim: Stepper) -> bool:
    """Whether gaps and overlaps have the same position target: Baumgarte's method that closes all of an overlap in a step."""
    options = sim.options
    return options.stabilization == "baumgarte" and options.baumgarte == 1.0 and options.slop == 0.0


@dataclass(frozen=True)
class _Numbers:
    """Parts of a model that the comparison of copies reads.

    Attributes:
        limited: Place in qpos, place in qvel and index of every slide and hinge that has a range.
        rubbing: Degrees of freedom with dry friction.
        ranges: Of the joints, (njnt, 2).
    """

    limited: list[tuple[int, int, int]]
    rubbing: list[int]
    ranges: Array


_numbers: WeakKeyDictionary[Stepper, _Numbers] = WeakKeyDictionary()
"""By copies, which are kept from call to call: to find a model takes a hash of all that it has."""


def _numbers_of(sim: Stepper) -> _Numbers:
    known = _numbers.get(sim)
    if known is None:
        known = _numbers[sim] = _read_numbers(sim.model)
    return known


def _read_numbers(model: Model) -> _Numbers:
    joints = (model.joint(k) for k in range(model.njnt))
    limited = [(joint.qposadr, joint.dofadr, joint.id) for joint in joints if joint.limited and joint.type in ("slide", "hinge")]
    rubbing = np.flatnonzero(np.asarray(model.dof_frictionloss) > 0.0).tolist()
    return _Numbers(limited, rubbing, np.array(model.jnt_range, np.float64))
