"""Kinks, which are states where a step is not differentiable, found by comparing perturbed copies with the nominal environment.

There are two tests. `Stepper._find_kinks` compares the active constraints: contacts that push, stick or slip, joints at their limits,
joints held by dry friction, saturated actuators. It also compares the geoms that tendons touch, and the contacts that adhesion pulls. The
second test compares the slopes on the two sides of the nominal value. Without a kink they differ by curvature only.
docs/how-to/derivatives.md explains what each test proves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntFlag
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from stepper._stepper import Stepper
from stepper.derivatives.perturbations import NOISE_RATIO, Array, Stencil

Bools = NDArray[np.bool_]

CURVATURE = 1e4
"""Largest relative change of a slope (derivative) per unit of its coordinate (SI) that counts as curvature of smooth motion, not a kink."""

LEAST_SLOPE = 0.1
"""Smallest divisor for relative differences between slopes (derivatives) of velocities, SI units.

Bodies at rest have slopes near 0, whose relative change means nothing. For slopes of positions, the divisor is multiplied by the duration
of the steps, in s.
"""

SOLVED = 1e-9
"""Residual of a step below which its active constraints (its "mode") are certain, m/s."""


class Kink(IntFlag):
    """Flags for the kinds of kinks: differences between a perturbed copy and the nominal (unperturbed) environment."""

    NONE = 0
    """No kink."""
    CONTACT = 1
    """A contact pushes in the perturbed copy or in the nominal environment, but not in both."""
    SLIP = 2
    """A contact sticks in the perturbed copy and slips in the nominal environment, or vice versa; not detected with contact="mujoco"."""
    GAP = 4
    """A contact or limit has a tiny gap in the perturbed copy and an overlap in the nominal environment, or vice versa.

    With a gap, the step allows the velocity that closes it. With an overlap, it allows no approach. A robot at rest is at this kink;
    docs/how-to/derivatives.md has settings without it. With method="implicit" the flag has a second cause: an equality constraint moves a
    contact across the depth at which the damping of the contact's position correction begins.
    """
    LIMIT = 8
    """A slide or hinge is at a limit in the perturbed copy or in the nominal environment, but not in both.

    Limits of ball joints and tendons are not detected.
    """
    DRY_FRICTION = 16
    """Dry friction holds a joint in the perturbed copy or in the nominal environment, but not in both.

    It is not detected with contact="mujoco".
    """
    SATURATION = 32
    """The force of an actuator is at its limit in the perturbed copy, in the nominal environment, or in both."""
    SLOPE = 64
    """The slopes (derivatives) on the two sides of the nominal value differ, whatever the cause."""
    UNSOLVED = 128
    """A step was not solved, its result was not finite, or the time step was too long for the motion (see `Status`)."""
    UNDETERMINED = 256
    """The step has no derivative for fixed active constraints (those of the unperturbed step). The column of the matrix is 0."""
    WRAP = 512
    """A tendon touches a geom in its path in the perturbed copy or in the nominal environment, but not in both."""
    ADHESION = 1024
    """An adhesion actuator pulls other contacts in the perturbed copy than in the nominal environment."""


@dataclass(frozen=True)
class RowGroup:
    """Range of rows of the derivative matrix that have the same unit, so that their slopes can be compared with one another.

    Attributes:
        rows: Range of the rows.
        least_slope: Lower bound of the divisor in relative differences between slopes (derivatives), SI units. Columns whose slopes are
            all smaller are compared relative to this bound.
    """

    rows: slice
    least_slope: float = LEAST_SLOPE


@dataclass
class Report:
    """Kinks found by comparing perturbed copies with their nominal (unperturbed) environments.

    Attributes:
        causes: Flags of `Kink` for every column, (num_envs, nstep, columns) uint32.
        distance: Estimated distance to the nearest kink in each step, (num_envs, nstep), as a multiple of the displacement of the copies.
            Infinite if it cannot be estimated.
    """

    causes: NDArray[np.uint32]
    distance: Array


class KinkDetector:
    """Detector of kinks, which compares perturbed copies with their nominal (unperturbed) environment after every step.

    Args:
        sim: Stepper of the copies; row e * count + k is copy k of environment e, and copy 0 is nominal.
        stencil: Displacements of the perturbed numbers in the copies, from the nominal values.
        nstep: Number of steps.

    Attributes:
        report: Kinks found so far.
    """

    def __init__(self, sim: Stepper, stencil: Stencil, nstep: int):
        self.sim, self.stencil = sim, stencil
        n, levels, self.sides, columns = stencil.offsets.shape
        self.count = 1 + levels * self.sides * columns
        self.report = Report(np.zeros((n, nstep, columns), np.uint32), np.full((n, nstep), np.inf))
        fixed, randomized = _joint_data_of(sim), sim.randomized
        self._limited, self._rubbing = fixed.limited, fixed.rubbing
        self._ranges = np.asarray(randomized.get("jnt_range", fixed.ranges))[..., [index for _, _, index in self._limited], :]
        hard = sim.options.contact == "hard"
        # Time from the state before a step to the configuration at which its constraints are evaluated, s.
        self._ahead = 0.5 * sim.timestep if hard and sim.options.integrator in (None, "midpoint", "rk4") else 0.0
        self._steps = nstep
        self._evaluated_at = self._constraint_positions()

    def compare(self, step: int) -> None:
        """Compares the active constraints of the copies with those of the nominal copy after a step, and adds the kinks to `report`."""
        causes, distance = self.sim._find_kinks(
            count=self.count,
            sides=self.sides,
            one_sided=~self.stencil.central,
            limited=[[place, dof] for place, dof, _ in self._limited],
            ranges=self._ranges,
            limit_positions=self._evaluated_at,
            rubbing=self._rubbing,
            smooth_at_rest=_smooth_at_rest(self.sim),
            tolerance=NOISE_RATIO * self.sim.tolerance,
        )
        self.report.causes[:, step] |= causes
        self.report.distance[:, step] = distance
        if step + 1 < self._steps:
            self._evaluated_at = self._constraint_positions()

    def _constraint_positions(self) -> Array:
        """Positions of all joints with limits, (copies, joints), rad or m.

        They are extrapolated to the time at which the next step evaluates its constraints.
        """
        if not self._limited:
            return np.zeros((self.stencil.offsets.shape[0] * self.count, 0))
        place, dof, _ = (np.array(part) for part in zip(*self._limited, strict=True))
        positions: Array = np.asarray(self.sim.qpos, np.float64)[:, place] + self._ahead * np.asarray(self.sim.qvel, np.float64)[:, dof]
        return positions

    def compare_slopes(self, changes: Array, slopes: Array, groups: Sequence[RowGroup], noise: float) -> None:
        """Sets the flag `Kink.SLOPE` of the last step for columns whose slopes (derivatives) above and below the nominal value differ.

        Such a column has a kink of unknown cause. If columns are displaced to one side only, the method does nothing.

        Args:
            changes: Results after all steps minus the nominal results, (num_envs, levels, points, columns, n). Levels, points and columns
                are those of `Stencil.offsets`; n is the number of results (rows of the derivative matrix).
            slopes: Derivatives from the finest level, (num_envs, columns, n).
            groups: Groups of results with the same unit. Differences are relative to the largest slope of a group, at least `least_slope`.
            noise: Error of a result due to the solver's tolerance, in SI units.
        """
        if self.sides == 1:
            return
        bends = self.stencil.bends(changes)[:, 0]
        h = self.stencil.step[:, 0]
        floor = 4.0 * noise / np.where(h > 0.0, h, 1.0)
        for group in groups:
            size = np.abs(slopes[..., group.rows]).max(axis=-1, initial=group.least_slope)
            bend = bends[..., group.rows].max(axis=-1, initial=0.0)
            kinked = bend > np.minimum(CURVATURE * h, 0.1) * size + floor
            self.report.causes[:, -1][kinked] |= np.uint32(Kink.SLOPE)


def _smooth_at_rest(sim: Stepper) -> bool:
    """Whether the step is smooth for contacts at rest: gaps and overlaps have the same target velocity (Baumgarte, factor 1, no slop)."""
    options = sim.options
    return options.stabilization == "baumgarte" and options.baumgarte == 1.0 and options.slop == 0.0


@dataclass(frozen=True)
class _JointData:
    """Limits and dry friction of a model's joints.

    Attributes:
        limited: Index in qpos, index in qvel and index of the joint, for every slide and hinge with limits.
        rubbing: Indices of the degrees of freedom that have dry friction (`dof_frictionloss` above 0).
        ranges: Limits of all joints, (njnt, 2), rad or m.
    """

    limited: list[tuple[int, int, int]]
    rubbing: list[int]
    ranges: Array


_joint_data: WeakKeyDictionary[Stepper, _JointData] = WeakKeyDictionary()
"""Cache of the limits and dry friction of joints. Its keys are steppers of perturbed copies.

Models are not used as keys, because hashing a model takes longer than a step.
"""


def _joint_data_of(sim: Stepper) -> _JointData:
    """Limits and dry friction of the joints of a stepper's model, read once per stepper."""
    if sim not in _joint_data:
        model = sim.model
        joints = (model.joint(k) for k in range(model.njnt))
        limited = [(joint.qposadr, joint.dofadr, joint.id) for joint in joints if joint.limited and joint.type in ("slide", "hinge")]
        rubbing = np.flatnonzero(np.asarray(model.dof_frictionloss) > 0.0).tolist()
        _joint_data[sim] = _JointData(limited, rubbing, np.array(model.jnt_range, np.float64))
    return _joint_data[sim]
