"""Vehicle that tows sledges by a rope: the jerk when the rope goes taut, the tension while it pulls, and when braking makes it slack.

    python examples/tow.py    # theory and simulation, as a table

The rope is a spatial tendon with a largest length, and starts slack. A vehicle of mass M drives off with a force F. When the rope goes
taut, both bodies get the speed that conserves momentum, v M / (M + m). The sledge then slides with the tension m (F + mu M g) / (M + m).
At last the vehicle brakes with a force B, which is a negative F. The rope stays taut if and only if B < mu M g, whatever the mass m of the
sledge, because friction alone slows a sledge by mu g. The sledges of the environments differ in mass.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import stepper
from numpy.typing import NDArray

Array = NDArray[Any]

VEHICLE, FORCE, FRICTION, GRAVITY = 20.0, 60.0, 0.3, 9.81
"""Mass of the vehicle, kg, force with which it drives, N, coefficient of friction of the sledge, and gravitational acceleration, m/s^2."""
APART, LENGTH = 0.8, 1.0
"""Distance between the ends of the rope at the start, and length of the rope, m."""
BRAKING = 0.2
"""Time of braking, s."""
SCENE = f"""
<mujoco>
  <option timestep="0.001"/>
  <default><geom friction="{FRICTION} 0 0" condim="3"/></default>
  <worldbody>
    <geom type="plane" size="50 5 .1"/>
    <body name="vehicle" pos="{0.5 + APART} 0 .1">
      <joint name="drive" type="slide" axis="1 0 0"/>
      <geom type="box" size=".3 .2 .05" mass="{VEHICLE}" contype="0" conaffinity="0"/><site name="hook"/>
    </body>
    <body name="sledge" pos="0 0 .1"><freejoint/><geom type="box" size=".5 .3 .1" mass="1"/><site name="eye" pos=".5 0 0"/></body>
  </worldbody>
  <tendon><spatial name="rope" limited="true" range="0 {LENGTH}"><site site="eye"/><site site="hook"/></spatial></tendon>
  <actuator><motor joint="drive"/></actuator>
  <sensor><tendonpos tendon="rope"/><tendonlimitfrc tendon="rope"/></sensor>
</mujoco>
"""


def tow(masses: Array, brake: float, options: stepper.Options | None = None) -> tuple[stepper.Stepper, dict[str, Array]]:
    """Tows one sledge per mass: drives for 1.5 s, and brakes for `BRAKING`.

    Args:
        masses: Masses of the sledges, (num_envs,), kg.
        brake: Braking force of the vehicle, N.
        options: Options of the stepper.

    Returns:
        The stepper at the end, and arrays (num_envs,) by name: "jerk" is the vehicle's speed after the jerk, m/s; "pull" and "brake" are
        the mean tensions in the last 0.1 s of driving and of braking, N; "slack" is the length of the rope minus the distance of its ends
        at the end, m.
    """
    model = stepper.load(SCENE)
    sim = stepper.Stepper(model, len(masses), options=options)
    sim.randomize({"body_mass[sledge]": masses})

    def drive(force: float, duration: float) -> tuple[Array, Array]:
        """Drives with a force. Returns speeds and tensions after every step, (steps, num_envs)."""
        speeds, tensions = [], []
        for _ in range(round(duration / sim.timestep)):
            sim.step(np.full((len(masses), 1), force))
            speeds.append(np.array(sim.qvel[:, 0]))
            tensions.append(np.array(sim.sensordata[:, 1]))
        return np.array(speeds), np.array(tensions)

    last = round(0.1 / sim.timestep)
    speeds, pulls = drive(FORCE, 1.5)
    # The first step with tension only closes the rest of the gap. The next one ends the impact.
    jerk = np.take_along_axis(speeds, (pulls > 0).argmax(axis=0)[None] + 1, axis=0)[0]
    _, brakes = drive(-brake, BRAKING)
    tensions = {"pull": pulls[-last:].mean(axis=0), "brake": brakes[-last:].mean(axis=0)}
    return sim, {"jerk": jerk, **tensions, "slack": LENGTH - np.array(sim.sensordata[:, 0])}


def theory(masses: Array, brake: float) -> dict[str, Array]:
    """Results of `tow` in theory, (num_envs,)."""

    def tension(force: float) -> Array:
        return masses / (VEHICLE + masses) * max(force + FRICTION * VEHICLE * GRAVITY, 0.0)

    speed = np.sqrt(2 * FORCE / VEHICLE * (LENGTH - APART))
    slack = np.full(len(masses), max(brake / VEHICLE - FRICTION * GRAVITY, 0.0) * BRAKING**2 / 2)
    return {"jerk": speed * VEHICLE / (VEHICLE + masses), "pull": tension(FORCE), "brake": tension(-brake), "slack": slack}


def main() -> None:
    """Print the results next to the theory, as a table."""
    masses = np.array([2.0, 5.0, 10.0, 15.0])
    (_, found), (_, hard) = tow(masses, 40.0), tow(masses, 80.0)
    expected, expected_hard = theory(masses, 40.0), theory(masses, 80.0)
    print("| sledge | speed after the jerk | theory | tension | theory | braking with 40 N | theory | slack after 80 N | theory |")
    print("|---|---|---|---|---|---|---|---|---|")
    for k, mass in enumerate(masses):
        pairs = [[f"{x[name][k]:.2f} {unit}" for x in (found, expected)] for name, unit in (("jerk", "m/s"), ("pull", "N"), ("brake", "N"))]
        pairs.append([f"{100 * x['slack'][k]:.2f} cm" for x in (hard, expected_hard)])
        print(f"| {mass:.0f} kg | {' | '.join(' | '.join(pair) for pair in pairs)} |")


if __name__ == "__main__":
    main()
