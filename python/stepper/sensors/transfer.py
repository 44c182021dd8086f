"""Transfer function of a sensor, from the true value to the reading."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from stepper.shared.tables import check_numbers, numbers

Number: TypeAlias = "float | ArrayLike"


@dataclass(frozen=True, kw_only=True)
class Transfer:
    """Transfer function of a sensor: errors between the true value and the reading. The default is an ideal sensor.

    The errors act in this order: scale and misalignment, bias, drift, noise, quantisation, limits, sample and hold, delay, dropout. Every
    number is a scalar for all environments or an array (num_envs,), in the unit of the readings. For unit vectors and quaternions, the
    bias, drift and noise are a rotation vector in rad. Readings of touch sensors and rangefinders that are not positive stay unchanged.

    Attributes:
        scale: Factor of every channel; or a matrix (dim, dim) that mixes them.
        scale_std: Standard deviation of the relative error of each channel's factor, drawn at each reset.
        misalignment_std: Standard deviation of the cross-axis sensitivity between channels, rad, drawn at each reset.
        bias: Bias of every channel, the same in every episode.
        bias_std: Standard deviation of a second bias of each channel, drawn at each reset.
        drift_std: Standard deviation of the change of each channel's drift in a short time t, divided by sqrt(t), per sqrt(s). The drift
            is 0 at each reset.
        drift_time: Correlation time of the drift, s. The drift is then a first-order Gauss-Markov process, whose standard deviation tends
            to drift_std sqrt(drift_time / 2). None makes the drift a random walk.
        noise_std: Standard deviation of the white noise of a sample. The half width of uniform noise is sqrt(3) times as large.
        noise: "gaussian" or "uniform".
        noise_density: Density of Gaussian white noise per sqrt(Hz), as in data sheets. A sample's standard deviation is the density divided
            by the square root of the sampling time, for any time step.
        quantum: Step of quantisation: readings are whole multiples of it; 0 disables it.
        limits: Smallest and largest reading.
        period: Sampling time, s; the reading is held between samples. None or 0 samples at every step.
        delay: Delay of the readings, s. A delayed reading between two steps is interpolated, except with `period`.
        jitter: Half width of the delay's uniform random part, drawn at every step, s.
        dropout: Probability that a sample is lost; the reading then keeps its last value.
    """

    scale: Number = 1.0
    scale_std: Number = 0.0
    misalignment_std: Number = 0.0
    bias: Number = 0.0
    bias_std: Number = 0.0
    drift_std: Number = 0.0
    drift_time: Number | None = None
    noise_std: Number = 0.0
    noise: str = "gaussian"
    noise_density: Number | None = None
    quantum: Number = 0.0
    limits: tuple[Number, Number] | None = None
    period: Number | None = None
    delay: Number = 0.0
    jitter: Number = 0.0
    dropout: Number = 0.0

    def __post_init__(self) -> None:
        if self.noise not in ("gaussian", "uniform"):
            raise ValueError(f"noise is {self.noise!r}, must be 'gaussian' or 'uniform'; noise_std=... is its standard deviation")
        if self.noise == "uniform" and self.noise_density is not None:
            raise ValueError(
                "noise_density is only for Gaussian noise; for uniform noise set noise_std, which is the half width divided by sqrt(3)"
            )
        check_numbers(self, "noise")

    def _row(self, num_envs: int) -> dict[str, Any]:
        """Transfer function as a dictionary for the Rust library. Numbers are lists with one value, or one per environment."""
        mixes = np.ndim(self.scale) == 2
        low, high = (-math.inf, math.inf) if self.limits is None else self.limits
        plain = ("scale_std", "misalignment_std", "bias", "bias_std", "drift_std", "quantum", "delay", "jitter", "dropout")
        return {
            **{name: numbers(name, getattr(self, name), num_envs) for name in plain},
            "noise_std": self._spread(num_envs),
            "scale": [1.0] if mixes else numbers("scale", self.scale, num_envs),
            "matrix": np.asarray(self.scale, dtype=np.float64).ravel().tolist() if mixes else [],
            "drift_time": numbers("drift_time", math.inf if self.drift_time is None else self.drift_time, num_envs),
            "uniform": self.noise == "uniform",
            "noise_density": numbers("noise_density", 0.0 if self.noise_density is None else self.noise_density, num_envs),
            "low": numbers("limits[0]", low, num_envs),
            "high": numbers("limits[1]", high, num_envs),
            "period": numbers("period", 0.0 if self.period is None else self.period, num_envs),
        }

    def _spread(self, num_envs: int) -> list[float]:
        """Parameter of the white noise for the Rust library, one number or one per environment.

        It is the standard deviation of Gaussian noise, or the half width of uniform noise, in the unit of the readings.
        """
        half_widths = math.sqrt(3.0) if self.noise == "uniform" else 1.0
        return [std * half_widths for std in numbers("noise_std", self.noise_std, num_envs)]
