"""Fixed data of a tracker (`Problem`), and prediction of the readings in a window."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from stepper._stepper import Model, Stepper
from stepper.sysid.data import COORDINATES
from stepper.sysid.inertia import Array
from stepper.sysid.parameters import Block, write
from stepper.sysid.simulate import Channel, compared

Sample = tuple[Array, dict[str, Array]]
"""Pair of the controls of a period, (nu,), and the readings at its end by channel, (columns,)."""


MAX_PREDICTIONS = 32
"""Number of predictions after which an update of a tracker starts no optional work, such as new hypotheses.

Each prediction simulates the whole window in all environments. In ordinary updates 2 to 16 are enough.
"""


@dataclass
class Budget:
    """Number of predictions that the present update of a tracker may still make.

    Attributes:
        left: Number of predictions. At 0 or below, only predictions that the estimate needs may follow.
    """

    left: int = MAX_PREDICTIONS


@dataclass(frozen=True)
class Problem:
    """Fixed data of an online identification (`Tracker`): model, parameters, channels and noise.

    Attributes:
        model: The model.
        blocks: Tracked parameters.
        sim: Stepper for predictions, with one environment for each simulated point.
        nstep: Number of time steps per period.
        channels: Measured channels.
        sigma: Standard deviations of the noise of the columns of all channels, (width,).
        dofs: Degrees of freedom whose state is uncertain.
        low, high, scale: Bounds and scales of the parameters, (n,).
        kinked: Indices of the friction parameters in the parameter vector. While nothing slides, the readings do not depend on friction.
        drift: Standard deviation of the random change of each parameter in one second, (n,).
        gained: Standard deviation of the random change of each parameter and state coordinate in one period, (n + states,).
        period: Time between samples, s.
        length: Number of samples in a window.
        budget: Number of predictions that the present update may still make.
    """

    model: Model
    blocks: tuple[Block, ...]
    sim: Stepper
    nstep: int
    channels: tuple[Channel, ...]
    sigma: Array
    dofs: list[int]
    low: Array
    high: Array
    scale: Array
    kinked: list[int]
    drift: Array
    gained: Array
    period: float
    length: int
    budget: Budget = field(default_factory=Budget)

    @property
    def n(self) -> int:
        """Number n of entries of the parameter vector theta."""
        return len(self.scale)

    def seen(self, readings: dict[str, Array]) -> np.ndarray[Any, np.dtype[np.bool_]]:
        """Mask of the columns of a sample's readings that are measured and have finite noise, (width,)."""
        parts = []
        for channel in self.channels:
            finite = np.isfinite(readings[channel.name])
            size = channel.lines.stop - channel.lines.start
            parts.append(np.full(size, finite.all()) if channel.dofs or channel.quaternion else finite)
        return np.asarray(np.concatenate(parts) & np.isfinite(self.sigma))

    def predict(
        self, begin: tuple[Array, Array, Array], points: Array, samples: Sequence[Sample], now: float
    ) -> tuple[dict[str, Array], Array]:
        """Simulates a window of samples from several initial states and parameter vectors.

        Args:
            begin: qpos, qvel and act at the start of the window.
            points: Simulated points, (count, n + states). A row has the n parameters theta, then displacements (m, rad) and changes
                of velocity (m/s, rad/s) that are added to the state `begin`.
            samples: The T samples of the window.
            now: Time of the last sample, s, for error messages.

        Returns:
            Predicted states and readings by field, (T, count, ...); residuals in units of the noise, (count, T, width), 0 for readings that
            are NaN.

        Raises:
            FloatingPointError: The prediction is not finite.
        """
        self.budget.left -= 1
        m, nv = len(self.dofs), self.model.nv
        shift = np.zeros((2, len(points), nv))
        shift[0][:, self.dofs], shift[1][:, self.dofs] = points[:, self.n : self.n + m], points[:, self.n + m :]
        theta = np.clip(points[:, : self.n], self.low, self.high)
        self.sim.randomize(**write(self.blocks, theta, self.model).fields)
        self.sim.reset()
        qpos = self.model.integrate_pos(np.tile(begin[0], (len(points), 1)), shift[0])
        act = np.tile(begin[2], (len(points), 1))
        self.sim.set_state(qpos, begin[1] + shift[1], act=act, time=0.0)
        ctrl = np.repeat(np.stack([c for c, _ in samples])[:, None], len(points), axis=1)
        fields = sorted({*(channel.field for channel in self.channels), *COORDINATES})
        made: dict[str, Array] = self.sim.rollout(ctrl, self.nstep, fields=fields)
        out = np.zeros((len(points), len(ctrl), len(self.sigma)))
        for channel in self.channels:
            measured = np.stack([readings[channel.name] for _, readings in samples])
            value = compared(self.model, channel, made[channel.field], measured)
            if not channel.dofs and not channel.quaternion:
                value = np.where(np.isfinite(measured)[:, None], value - measured[:, None], 0.0)
            out[..., channel.lines] = value.transpose(1, 0, 2) / self.sigma[channel.lines]
        if not np.isfinite(out).all():
            raise FloatingPointError(f"the prediction of the window that ends at {now:g} s is not finite; begin again with a new Tracker")
        return made, out
