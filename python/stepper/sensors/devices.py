"""Transfer functions of commercial sensors from data sheets. Errors that the data sheet does not specify are 0.

Units are those of the readings: rad, rad/s, m/s^2, N, N m. Rates and accelerations are per axis. The zero-rate or zero-g offset of a data
sheet is used as one standard deviation of the bias. In-run stability is used as the stationary standard deviation of a drift, a first-order
Gauss-Markov process with a correlation time of 100 s.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

from stepper.sensors.transfer import Transfer
from stepper.shared.arguments import check_number, check_whole

__all__ = ["DEVICES", "encoder", "encoder_velocity", "find"]

_DEG = math.pi / 180.0  # rad
_HOUR = 3600.0  # s
_G = 9.80665  # standard gravity, m/s^2
_TAU = 100.0  # correlation time of a drift, s


def encoder(bits: int, *, turn: float = 2 * math.pi) -> Transfer:
    """Returns the transfer function of an absolute encoder: quantisation in 2^bits steps per turn.

    Args:
        bits: Number of bits per turn.
        turn: Range of the encoder that has 2^bits steps, rad; for a linear encoder, the travel in m.
    """
    check_whole("bits", bits, least=1, most=40)
    check_number("turn", turn, above=0.0)
    return Transfer(quantum=turn / 2**bits)


def encoder_velocity(bits: int, period: float, *, turn: float = 2 * math.pi) -> Transfer:
    """Returns the transfer function of a speed that is computed as counts of an absolute encoder per sampling period.

    Args:
        bits: Number of bits per turn.
        period: Sampling period, s.
        turn: Range of the encoder that has 2^bits steps, rad; for a linear encoder, the travel in m.
    """
    check_number("period", period, above=0.0)
    return Transfer(quantum=encoder(bits, turn=turn).quantum / period, period=period)  # type: ignore[operator]


def _drift(stability: float) -> float:
    """Value of `Transfer.drift_std`, per sqrt(s), for a drift with a stationary standard deviation and a correlation time of 100 s."""
    return stability * math.sqrt(2.0 / _TAU)


def _gyro(
    *, density: float, bias: float, stability: float, full: float, bits: int | None, scale: float = 0.0, cross: float = 0.0
) -> Transfer:
    """Transfer function of a gyro from values in the units of data sheets.

    Args:
        density: Noise density, deg/s/sqrt(Hz).
        bias: Zero-rate offset (one standard deviation), deg/s.
        stability: In-run bias stability, deg/h; 0 leaves the drift out.
        full: Largest absolute reading, deg/s.
        bits: Number of bits for the whole range, from -full to full; None leaves quantisation out.
        scale: Standard deviation of the relative error of the scale factor.
        cross: Standard deviation of the cross-axis sensitivity, rad.
    """
    return Transfer(
        noise_density=density * _DEG,
        bias_std=bias * _DEG,
        drift_std=_drift(stability * _DEG / _HOUR),
        drift_time=_TAU if stability else None,
        scale_std=scale,
        misalignment_std=cross,
        quantum=2 * full * _DEG / 2**bits if bits else 0.0,
        limits=(-full * _DEG, full * _DEG),
    )


def _accelerometer(
    *, density: float, bias: float, stability: float, full: float, bits: int | None, scale: float = 0.0, cross: float = 0.0
) -> Transfer:
    """Transfer function of an accelerometer from values in the units of data sheets.

    Args:
        density: Noise density, micro-g/sqrt(Hz).
        bias: Zero-g offset (one standard deviation), milli-g.
        stability: In-run bias stability, micro-g; 0 leaves the drift out.
        full: Largest absolute reading, g.
        bits: Number of bits for the whole range, from -full to full; None leaves quantisation out.
        scale: Standard deviation of the relative error of the scale factor.
        cross: Standard deviation of the cross-axis sensitivity, rad.
    """
    return Transfer(
        noise_density=density * 1e-6 * _G,
        bias_std=bias * 1e-3 * _G,
        drift_std=_drift(stability * 1e-6 * _G),
        drift_time=_TAU if stability else None,
        scale_std=scale,
        misalignment_std=cross,
        quantum=2 * full * _G / 2**bits if bits else 0.0,
        limits=(-full * _G, full * _G),
    )


DEVICES: dict[str, Callable[[], Transfer]] = {
    # Encoders: bits per turn.
    **{f"encoder_{bits}bit": partial(encoder, bits) for bits in (10, 12, 14, 16, 17, 18, 20, 23)},
    # Consumer IMU: InvenSense MPU-6000/MPU-6050 product specification, PS-MPU-6000A-00, revision 3.4 (2013), tables 6.1 and 6.2: rate noise
    # 0.005 deg/s/sqrt(Hz), zero-rate output 20 deg/s, scale 3 %, cross-axis 2 %, 16 bits; 400 micro-g/sqrt(Hz), zero-g 50 mg, scale 3 %.
    "mpu6050_gyro": lambda: _gyro(density=0.005, bias=20.0, stability=0.0, full=500.0, bits=16, scale=0.03, cross=0.02),
    "mpu6050_accelerometer": lambda: _accelerometer(density=400.0, bias=50.0, stability=0.0, full=4.0, bits=16, scale=0.03, cross=0.02),
    # Industrial IMU: Analog Devices ADIS16470 data sheet, revision C (2019): 8 deg/h in-run stability, 0.008 deg/s/sqrt(Hz), 2000 deg/s;
    # 13 micro-g in-run stability, 40 g, velocity random walk 0.037 m/s/sqrt(h).
    "adis16470_gyro": lambda: _gyro(density=0.008, bias=0.0, stability=8.0, full=2000.0, bits=None),
    "adis16470_accelerometer": lambda: _accelerometer(density=0.037 / 60 / _G * 1e6, bias=0.0, stability=13.0, full=40.0, bits=None),
    # Tactical IMU: Honeywell HG1700 brochure N61-1619-000-001: gyro bias 1 deg/h, angle random walk 0.125 deg/sqrt(h); accelerometer bias
    # 1 mg, velocity random walk 0.065 ft/s/sqrt(h).
    "hg1700_gyro": lambda: _gyro(density=0.125 / 60, bias=1 / _HOUR, stability=0.0, full=math.inf, bits=None),
    "hg1700_accelerometer": lambda: _accelerometer(
        density=0.065 * 0.3048 / 60 / _G * 1e6, bias=1.0, stability=0.0, full=math.inf, bits=None
    ),
    # Force-torque sensors: ATI Industrial Automation, F/T transducer manual (9620-05-Transducer Section), calibrations Mini45 SI-290-10 and
    # Gamma SI-130-10: resolution and range of the x axis.
    "ati_mini45_force": lambda: Transfer(quantum=1 / 8, limits=(-290.0, 290.0)),
    "ati_mini45_torque": lambda: Transfer(quantum=1 / 376, limits=(-10.0, 10.0)),
    "ati_gamma_force": lambda: Transfer(quantum=1 / 40, limits=(-130.0, 130.0)),
    "ati_gamma_torque": lambda: Transfer(quantum=1 / 800, limits=(-10.0, 10.0)),
}
"""Functions without arguments that return the `Transfer` of a device, by name of the device."""


def find(name: str) -> Transfer:
    """Returns the transfer function of a device of `DEVICES` by name.

    Raises:
        ValueError: An unknown device; the message lists the known ones.
    """
    if not isinstance(name, str) or name not in DEVICES:
        raise ValueError(f"there is no device {name!r}; the devices are: {', '.join(sorted(DEVICES))}")
    return DEVICES[name]()
