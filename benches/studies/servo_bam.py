"""Study of real servos that swing a pendulum (Rhoban BAM): which parameters of motor and gear must be fitted to predict the position.

The environment variable STEPPER_DATA names the folder that has servo_bam/servo_bam.csv and recordings.csv. Recordings of the servo XL330
with three gains come first, those with the fourth gain last:

    STEPPER_DATA=data stepper calibrate benches/studies/servo_bam.py --recordings 12 --margin 0.005
    STEPPER_DATA=data stepper chart benches/studies/servo_bam.py --angle --quick --horizon "0.5 s"
"""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import stepper
from numpy.typing import NDArray
from stepper.lab import Outcome, Parameter
from stepper.shared.files import read_csv

Array = NDArray[np.float64]
PERIOD, SECONDS = 0.002, 5.5
"""Time step and control period, s; length of the part of a recording that is predicted, s."""
FIRMWARE = 4096.0 / (2.0 * np.pi) / (256.0 * 885.0)
"""Duty cycle of the motor per unit of gain and rad of error, in the firmware of the XL330."""
HELD_OUT = 800
"""Gain whose recordings are held out."""


@dataclass(frozen=True)
class Recordings:
    """Recordings of one motor on a grid of times.

    Attributes:
        gain: Gain of the firmware, (recordings,).
        goal: Target angle, (recordings, times), rad.
        q: Measured angle, (recordings, times), rad; 0 is hanging.
        speed: Measured velocity at the first sample, (recordings,), rad/s.
        on: Whether the motor has power, 0 or 1, (recordings, times).
        volts: Supply voltage, (recordings, times), V.
        names: Trajectory and gain of each recording.
    """

    gain: Array
    goal: Array
    q: Array
    speed: Array
    on: Array
    volts: Array
    names: tuple[str, ...]


def recordings(folder: Path, motor: str, last: int | None = None) -> Recordings:
    """Recordings of a motor, those with the gain `last` at the end."""
    head, *about = read_csv(folder / "servo_bam/recordings.csv", "table of recordings")
    rows = [dict(zip(head, row, strict=True)) for row in about if row[head.index("motor")] == motor]
    rows.sort(key=lambda row: int(row["kp_firmware"]) == last)
    names, *lines = read_csv(folder / "servo_bam/servo_bam.csv", "table of samples")
    table = np.array(lines, float)
    times = np.arange(round(SECONDS / PERIOD) + 1) * PERIOD
    made: dict[str, list[Array]] = {"goal": [], "q": [], "on": [], "volts": []}
    speed = []
    for row in rows:
        own = dict(zip(names, table[table[:, 0] == int(row["rec"])].T, strict=True))
        t = own["t_s"] - own["t_s"][0]
        for name, column in (("goal", "q_goal_rad"), ("q", "q_rad"), ("volts", "input_V")):
            made[name].append(np.interp(times, t, own[column]))
        made["on"].append(own["torque_enable"][np.clip(np.searchsorted(t, times, side="right") - 1, 0, None)])
        speed.append(own["dq_rad_s"][0])
    return Recordings(
        gain=np.array([float(row["kp_firmware"]) for row in rows]),
        speed=np.array(speed),
        names=tuple(f"{row['trajectory']} {row['kp_firmware']}" for row in rows),
        **{name: np.array(column) for name, column in made.items()},
    )


def servo(folder: Path, last: int = HELD_OUT) -> stepper.lab.Study:
    """Study of the XL330, whose last four recordings have the gain `last`."""
    data = recordings(folder, "xl330", last)

    def start(now: Any, _: Any) -> tuple[Array, Array]:
        return data.q[now.episodes, 0][:, None], data.speed[now.episodes][:, None]

    def torque(now: Any) -> Array:
        """Torque at the joint before the losses of the gear, (num_envs, 1), N m.

        The firmware sets a voltage in proportion to the error, and the motor has a back-EMF. Without power there is no torque.
        """
        which, k = now.episodes, round(float(now.time[0]) / PERIOD)
        q, speed, kt = now.qpos[:, 0], now.qvel[:, 0], now.parameters["torque constant"]
        duty = np.clip(data.gain[which] * (data.goal[which, k] - q) * FIRMWARE, -1.0, 1.0)
        current = (duty * data.volts[which, k] - kt * speed) / now.parameters["resistance"]
        return np.asarray(data.on[which, k] * kt * current)[:, None]

    def error(now: Any) -> Array:
        k = min(round(float(now.time[0]) / PERIOD), data.q.shape[1] - 1)
        return np.asarray(np.abs(now.qpos[:, 0] - data.q[now.episodes, k]))

    return stepper.lab.Study(
        name="servo_bam",
        model="""<mujoco><option timestep="0.002"/><worldbody><body><joint name="hinge" axis="0 1 0"/>
          <inertial pos="0 0 -.1" mass=".49" diaginertia="1e-6 1e-6 1e-6"/></body></worldbody>
          <actuator><motor name="servo" joint="hinge"/></actuator></mujoco>""",
        controller=torque,
        start=start,
        outcomes=Outcome(name="error", measure=error, reduce="mean", unit="rad"),
        parameters={
            "torque constant": Parameter("controller", nominal=0.387, low=0.2, high=0.6, unit="N m/A", source="half to twice BAM's m1"),
            "resistance": Parameter("controller", nominal=4.02, low=2.0, high=8.0, unit="ohm", source="half to twice BAM's m1"),
            "armature": Parameter("dof_armature[hinge]", nominal=0.0018, low=0.0005, high=0.005, unit="kg m2", source="BAM's m1, wide"),
            "dry friction": Parameter("dof_frictionloss[hinge]", nominal=0.0128, low=0.0, high=0.06, unit="N m", source="BAM's m1, wide"),
            "viscous friction": Parameter("dof_damping[hinge]", nominal=0.00366, low=0.0, high=0.02, unit="N m s", source="BAM's m1, wide"),
            "gear efficiency": Parameter("actuator.motor.efficiency", nominal=1.0, low=0.6, high=1.0, source="planetary gears of metal"),
        },
        actuators=stepper.ActuatorModel({"servo": stepper.Drive(motor=stepper.actuators.DCMotor(efficiency=1.0))}),
        seconds=SECONDS,
        control=PERIOD,
        episodes=len(data.gain),
        batch=512,
        # The encoder has 4096 steps per turn.
        recordings=stepper.lab.Recordings(data.q[:, 1:, None], 2.0 * np.pi / 4096.0 / np.sqrt(12.0)),
    )


if "STEPPER_DATA" in os.environ:
    study = servo(Path(os.environ["STEPPER_DATA"]))
