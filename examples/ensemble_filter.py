"""Ensemble Kalman filter that estimates the velocity of dm_control's quadruped from noisy encoders and a noisy IMU.

    python examples/ensemble_filter.py            # ten seconds, an ensemble of 128

The robot has joint encoders, a gyroscope and an attitude estimate. No sensor measures its linear velocity or its height, and unknown forces
push it. The ensemble has 128 environments. Each adds random controls to the commanded ones, which model the unknown forces.

Every 20 ms the filter corrects all environments with the covariance of the ensemble (Evensen 1994, https://doi.org/10.1029/94JC00572). The
readings are perturbed as in Burgers et al. (1998). The model has a free joint, so means and corrections are computed on the tangent space,
with `Model.differentiate_pos` and `integrate_pos`. `set_state(..., keep_warmstart=True)` keeps the contacts and the actuator state of the
corrected environments.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import stepper
from numpy.typing import NDArray
from stepper.envs.suite import SUITE

Array = NDArray[Any]

NSTEP = 4
"""Number of simulation steps, 5 ms each, between two corrections of the filter."""
ENCODER, GYRO, ATTITUDE = 0.01, 0.05, 0.01
"""Standard deviations of the sensor noise: rad, rad/s, components of a unit vector."""
PUSH = 60.0
"""Standard deviation of the external forces on the trunk, N."""
CONTROL = 0.3
"""Standard deviation of the random control that each environment of the ensemble adds to the commanded one.

It models the external forces and all other unknown effects.
"""
INFLATION = 1.01
"""Factor on the spread of the ensemble at each correction (covariance inflation): a finite ensemble underestimates its covariance."""


def model_of() -> stepper.Model:
    """dm_control's quadruped, with added encoders and IMU sensors."""
    kind, arguments = SUITE["quadruped-walk"]
    model = kind(**arguments).model()
    joints = [joint.name for joint in map(model.joint, range(model.njnt)) if joint.type == "hinge"]
    encoders = {f"encoder {name}": stepper.sensors.SensorSpec(type="jointpos", joint=name) for name in joints}
    attitude = {
        "attitude": stepper.sensors.SensorSpec(type="framezaxis", body="torso"),
        "heading": stepper.sensors.SensorSpec(type="framexaxis", body="torso"),
    }
    return model.with_sensors({**encoders, "rate": stepper.sensors.SensorSpec(type="gyro", site="torso"), **attitude})


def readings_of(model: stepper.Model) -> tuple[Array, Array]:
    """Columns of `sensordata_ideal` that the filter reads, and the standard deviations of their noise, (m,) each."""
    columns: list[int] = []
    deviations: list[float] = []
    for name in model.sensor_names:
        deviation = {"rate": GYRO, "attitude": ATTITUDE, "heading": ATTITUDE}.get(name, ENCODER if name.startswith("encoder ") else None)
        if deviation is not None:
            sensor = model.sensor(name)
            columns += range(sensor.adr, sensor.adr + sensor.dim)
            deviations += [deviation] * sensor.dim
    return np.array(columns), np.array(deviations)


class EnsembleFilter:
    """Ensemble of simulated robots whose spread represents the uncertainty of the state.

    Args:
        model: The robot, with its sensors.
        members: Number of environments in the ensemble.
        seed: Seed of all random numbers.
        settings: Arguments of `Stepper`: options, precision, threads.
    """

    def __init__(self, model: stepper.Model, members: int = 128, *, seed: int = 1, **settings: Any):
        self.sim = stepper.Stepper(model, members, **settings)
        self._columns, self._deviations = readings_of(model)
        self._random = np.random.default_rng(seed)
        self._own = np.zeros((members, model.nu))

    def begin(self, qpos: Array, qvel: Array, spread: float = 0.05) -> None:
        """Draws initial states of the ensemble around qpos (nq,) and qvel (nv,), with standard deviation `spread` on the tangent space."""
        members, nv = self.sim.num_envs or 1, self.sim.model.nv
        displaced = self.sim.model.integrate_pos(qpos, spread * self._random.normal(size=(members, nv)))
        self.sim.reset(qpos=displaced, qvel=qvel + spread * self._random.normal(size=(members, nv)))

    def predict(self, control: Array) -> None:
        """Steps all environments of the ensemble with a control (nu,), to which each adds a random control."""
        self._own = 0.9 * self._own + CONTROL * (1.0 - 0.9**2) ** 0.5 * self._random.normal(size=self._own.shape)
        self.sim.step(control + self._own, NSTEP)

    def correct(self, readings: Array) -> None:
        """Corrects all environments of the ensemble with sensor readings (m,), by the Kalman gain from the ensemble's covariance."""
        sim, model = self.sim, self.sim.model
        nv, members = model.nv, sim.num_envs or 1
        middle, displacements = mean_configuration(model, np.asarray(sim.qpos))
        state = np.hstack([displacements, np.asarray(sim.qvel), np.asarray(sim.act)])
        predicted = np.asarray(sim.sensordata_ideal)[:, self._columns]
        apart, predicted_apart = INFLATION * (state - state.mean(axis=0)), INFLATION * (predicted - predicted.mean(axis=0))
        state = state.mean(axis=0) + apart
        noise = np.square(self._deviations) * (members - 1)
        gain = np.linalg.solve(predicted_apart.T @ predicted_apart + np.diag(noise), predicted_apart.T @ apart)
        measured = readings + self._deviations * self._random.normal(size=predicted.shape)
        state = state + (measured - predicted) @ gain
        qpos = model.integrate_pos(middle, state[:, :nv])
        sim.set_state(qpos, state[:, nv : 2 * nv], act=state[:, 2 * nv :], keep_warmstart=True)

    def estimate(self) -> tuple[Array, Array, Array]:
        """Mean configuration (nq,), mean velocity (nv,), and standard deviation of the velocities (nv,)."""
        middle, _ = mean_configuration(self.sim.model, np.asarray(self.sim.qpos))
        qvel = np.asarray(self.sim.qvel, dtype=np.float64)
        return middle, qvel.mean(axis=0), qvel.std(axis=0)


def mean_configuration(model: stepper.Model, qpos: Array) -> tuple[Array, Array]:
    """Mean of the configurations `qpos` (n, nq): the configuration whose displacements to all these configurations average to zero.

    Returns:
        Mean configuration, (nq,), and displacements from it on the tangent space, (n, nv).
    """
    middle = np.asarray(qpos[0], dtype=np.float64)
    for _ in range(6):
        displacements = model.differentiate_pos(middle, qpos)
        middle = model.integrate_pos(middle, displacements.mean(axis=0))
    found: Array = model.differentiate_pos(middle, qpos)
    return middle, found


@dataclass(frozen=True)
class Outcome:
    """Estimation errors over a run, root mean squares.

    Attributes:
        velocity: Error of the filter's trunk velocity, m/s.
        alone: Velocity error of an ensemble without readings, m/s.
        moved: Root mean square of the true velocity, m/s: the error of an estimate of zero.
        height: Error of the filter's trunk height, m.
        covered: Fraction of the true velocities that are within two standard deviations of the estimate.
        milliseconds: Mean time of a prediction with its correction, ms.
    """

    velocity: float
    alone: float
    moved: float
    height: float
    covered: float
    milliseconds: float


def run(seconds: float = 10.0, members: int = 128, seed: int = 0, **settings: Any) -> Outcome:
    """Runs the filter on a moving robot that random forces push, and returns estimation errors; the first second does not count.

    Args:
        seconds: Simulated time, s.
        members: Number of environments in the ensemble.
        seed: Seed of the sensor noise, the forces and the controls.
        settings: Arguments of `Stepper`: options, precision, threads.
    """
    model, random = model_of(), np.random.default_rng(seed)
    robot = stepper.Stepper(model, 1, **settings)
    robot.reset(qpos=_standing(model))
    observers = [EnsembleFilter(model, members, seed=k + 1, **settings) for k in (seed, seed + 1)]
    for observer in observers:
        observer.begin(robot.qpos[0], robot.qvel[0])
    columns, deviations = readings_of(model)
    trunk = model.body("torso").id
    phase = random.uniform(0.0, 2.0 * np.pi, model.nu)
    rows, spent, push = [], 0.0, np.zeros(3)
    count = round(seconds / (NSTEP * robot.timestep))
    for k in range(count):
        if k % 25 == 0:
            push = PUSH * random.normal(size=3) * [1.0, 1.0, 0.3]
        robot.xfrc_applied[0, trunk, :3] = push if k % 25 < 10 else 0.0
        control = 0.3 * np.sin(2.0 * np.pi * 1.5 * k * NSTEP * robot.timestep + phase)
        robot.step(control, NSTEP)
        readings = robot.sensordata_ideal[0, columns] + deviations * random.normal(size=len(columns))
        since = time.perf_counter()
        observers[0].predict(control)
        observers[0].correct(readings)
        spent += time.perf_counter() - since
        observers[1].predict(control)
        estimates = [observer.estimate() for observer in observers]
        true, height = np.asarray(robot.qvel[0, :3]), robot.qpos[0, 2]
        rows.append((*(velocity[:3] - true for _, velocity, _ in estimates), true, estimates[0][0][2] - height, estimates[0][2][:3]))
    kept = [np.array(column) for column in zip(*rows[round(1.0 / (NSTEP * robot.timestep)) :], strict=True)]
    filtered, alone, true, high, deviation = kept
    rms = [float(np.sqrt(np.mean(np.square(part)))) for part in (filtered, alone, true, high)]
    return Outcome(rms[0], rms[1], rms[2], rms[3], float(np.mean(np.abs(filtered) < 2.0 * deviation)), 1e3 * spent / count)


def _standing(model: stepper.Model) -> Array:
    """Reference configuration (nq,), raised to standing height."""
    qpos = np.array(model.qpos0)
    qpos[2] = 0.57
    return qpos


def main() -> None:
    """Run the ensemble filter on a moving quadruped, and print the estimation errors."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=10.0, help="simulated time, s [10]")
    parser.add_argument("--members", type=int, default=128, help="number of environments in the ensemble [128]")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=1, help="number of threads; 0 uses all cores [1]")
    given = parser.parse_args()
    found = run(given.seconds, given.members, given.seed, threads=given.threads)
    print(f"rms velocity of the trunk: {found.moved:.3f} m/s; rms error {found.velocity:.3f} m/s, without readings {found.alone:.3f} m/s")
    print(f"rms error of the height: {1e3 * found.height:.0f} mm; {found.covered:.0%} of the velocities are within two standard deviations")
    print(f"{found.milliseconds:.1f} ms per prediction of {NSTEP} steps with its correction, {given.members} members")


if __name__ == "__main__":
    main()
