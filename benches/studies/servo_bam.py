"""Study of real servos that swing a pendulum (Rhoban BAM): which parameters of motor and gear must be fitted to predict the position.

The folder of data has servo_bam/servo_bam.csv and recordings.csv. Runs of the servo XL330 with three gains come first, those with the
fourth gain last:

    stepper calibrate benches/studies/servo_bam.py --data FOLDER --fit-trajectories 12 --margin 0.005
    stepper chart benches/studies/servo_bam.py --data FOLDER --angle --quick --horizon "0.5 s"

Of the STS3250, one of four trajectories comes last. `study(Path("FOLDER"), "sts3250", "sin_sin")` is its study in Python.
"""

from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import stepper
from numpy.typing import NDArray
from stepper.lab import Outcome, Parameter
from stepper.shared.files import read_csv

Array = NDArray[np.float64]
PERIOD, SECONDS = 0.002, 5.5
"""Time step and control period, s; length of the part of a run that is predicted, s."""
FIRMWARE = 4096.0 / (2.0 * np.pi) / (256.0 * 885.0)
"""Duty cycle of the motor per unit of gain and rad of error, in the firmware of the XL330."""
HELD_OUT = "800"
"""Gain of the XL330 whose runs are held out by default."""


def measured_runs(folder: Path, motor: str, last: str | None = None) -> dict[str, Array]:
    """Measured runs of a motor on a grid of times, those with the gain or trajectory `last` at the end.

    Arrays (runs,) are "gain", that of the firmware, and "speed", the velocity at the first sample, rad/s. Arrays (runs, times) are "goal",
    the target angle, rad, "q", the angle, rad, 0 when hanging, "volts", the supply voltage, V, and "on", 1 if the motor has power.
    """
    head, *about = read_csv(folder / "servo_bam/recordings.csv", "table of recordings")
    rows = [dict(zip(head, row, strict=True)) for row in about if row[head.index("motor")] == motor]
    rows.sort(key=lambda row: last in (row["kp_firmware"], row["trajectory"]))
    names, *lines = read_csv(folder / "servo_bam/servo_bam.csv", "table of samples")
    table = np.array(lines, float)
    times = np.arange(round(SECONDS / PERIOD) + 1) * PERIOD
    made = defaultdict[str, list[Any]](list)
    for row in rows:
        made["gain"].append(float(row["kp_firmware"]))
        own = dict(zip(names, table[table[:, 0] == int(row["rec"])].T, strict=True))
        t = own["t_s"] - own["t_s"][0]
        for name, column in (("goal", "q_goal_rad"), ("q", "q_rad"), ("volts", "input_V")):
            made[name].append(np.interp(times, t, own[column]))
        made["on"].append(own["torque_enable"][np.clip(np.searchsorted(t, times, side="right") - 1, 0, None)])
        made["speed"].append(own["dq_rad_s"][0])
    return {name: np.array(column) for name, column in made.items()}


PENDULUMS = {"xl330": (0.49, 0.1), "sts3250": (1.13, 0.12)}
"""Mass, kg, of each motor's pendulum, and its distance from the axis, m."""
Numbers = tuple[float, float, float]
WIDE = "wide, around BAM's m1 (XL330) and the data sheet (STS3250)"
PARAMETERS: dict[str, tuple[str, str, str, Numbers | None, Numbers]] = {
    "command delay": ("controller", "s", "BAM", (0.0, 0.0, 0.05), (0.0, 0.0, 0.05)),
    "torque constant": ("controller", "N m/A", WIDE, (0.387, 0.2, 0.6), (1.5, 0.7, 3.0)),
    "resistance": ("controller", "ohm", WIDE, (4.02, 2.0, 8.0), (3.7, 1.5, 8.0)),
    "armature": ("dof_armature[hinge]", "kg m2", WIDE, (0.0018, 0.0005, 0.005), (0.01, 0.001, 0.04)),
    "dry friction": ("dof_frictionloss[hinge]", "N m", WIDE, (0.0128, 0.0, 0.06), (0.06, 0.0, 0.3)),
    "viscous friction": ("dof_damping[hinge]", "N m s", WIDE, (0.00366, 0.0, 0.02), (0.06, 0.0, 0.2)),
    "gear efficiency": ("actuator.motor.efficiency", "", "gears of metal", (1.0, 0.6, 1.0), (1.0, 0.6, 1.0)),
    "Stribeck friction": ("actuator.stribeck_friction", "N m", WIDE, (0.0, 0.0, 0.06), (0.0, 0.0, 0.3)),
    "Stribeck velocity": ("actuator.stribeck_velocity", "rad/s", "BAM", (0.2, 0.02, 1.0), (0.2, 0.02, 1.0)),
    "duty": ("controller", "1/rad", WIDE, None, (0.166, 0.05, 0.5)),
}
"""Selector, unit and source of each parameter, and its nominal value and range for each motor; None if it is known."""


def study(data: Path, motor: str = "xl330", last: str = HELD_OUT) -> stepper.lab.Study:
    """Study of a motor in a folder of data, whose runs with the gain or trajectory `last` come last."""
    own, (mass, length) = measured_runs(data, motor, last), PENDULUMS[motor]

    def start(now: Any, _: Any) -> tuple[Array, Array]:
        return own["q"][now.episodes, 0][:, None], own["speed"][now.episodes][:, None]

    def torque(now: Any) -> Array:
        """Torque at the joint before the losses of the gear, (num_envs, 1), N m.

        The firmware sets a voltage in proportion to the error, and the motor has a back-EMF. Without power there is no torque.
        """
        which, k = now.episodes, round(float(now.time[0]) / PERIOD)
        q, speed, kt = now.qpos[:, 0], now.qvel[:, 0], now.parameters["torque constant"]
        then = np.maximum(k - np.rint(now.parameters["command delay"] / PERIOD).astype(int), 0)
        duty = np.clip(own["gain"][which] * (own["goal"][which, then] - q) * now.parameters.get("duty", FIRMWARE), -1.0, 1.0)
        current = (duty * own["volts"][which, k] - kt * speed) / now.parameters["resistance"]
        return np.asarray(own["on"][which, k] * kt * current)[:, None]

    def error(now: Any) -> Array:
        k = min(round(float(now.time[0]) / PERIOD), own["q"].shape[1] - 1)
        return np.asarray(np.abs(now.qpos[:, 0] - own["q"][now.episodes, k]))

    parameters = {}
    for name, (selector, unit, source, *numbers) in PARAMETERS.items():
        if (given := dict(zip(PENDULUMS, numbers, strict=True))[motor]) is not None:
            parameters[name] = Parameter(selector, nominal=given[0], low=given[1], high=given[2], unit=unit, source=source)
    drive = stepper.Drive(motor=stepper.actuators.DCMotor(), stribeck_velocity=0.2)
    return stepper.lab.Study(
        name=f"servo_bam_{motor}",
        model=f"""<mujoco><option timestep="0.002"/><worldbody><body><joint name="hinge" axis="0 1 0"/>
          <inertial pos="0 0 -{length}" mass="{mass}" diaginertia="1e-6 1e-6 1e-6"/></body></worldbody>
          <actuator><motor name="servo" joint="hinge"/></actuator></mujoco>""",
        controller=torque,
        start=start,
        outcomes=Outcome(name="error", measure=error, reduce="mean", unit="rad"),
        parameters=parameters,
        actuators=stepper.ActuatorModel({"servo": drive}),
        seconds=SECONDS,
        control=PERIOD,
        episodes=len(own["gain"]),
        batch=512,
        # The encoder has 4096 steps per turn.
        trajectories=stepper.lab.MeasuredTrajectories(own["q"][:, 1:, None], 2.0 * np.pi / 4096.0 / np.sqrt(12.0)),
    )
