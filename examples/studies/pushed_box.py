"""Effect of mass, friction, shape, control rate and camera errors on pushing a box to a line.

A plate pushes the box and stops when a camera detects the box at the line. The box then overshoots by v t, with t the camera's delay, plus
the sliding distance v^2 / (2 mu g). Neither depends on the mass or shape of the box. The camera hangs above the table. It measures the
position of the box in the camera's frame, with noise, delay and a field of view. The controller assumes the nominal pose of the camera.

    stepper report examples/studies/pushed_box.py
"""

from __future__ import annotations

from typing import Any

import numpy as np
import stepper

SPEED, LINE, WIDE = 0.3, 0.25, 0.02
"""Speed of the plate, m/s; position of the line, m; allowed distance of the box from the line, m."""
HEIGHT = 0.5
"""Angle between the upper and the lower edge of the field of view, rad."""
AHEAD = 1.0 - 0.04
"""Distance of the box from the camera along its optical axis, m."""

MODEL = """
<mujoco model="pushed box">
  <option timestep="0.002"/>
  <worldbody>
    <geom name="table" type="plane" size="2 2 0.1"/>
    <body name="camera" pos="0 0 1" euler="180 0 0"><site name="camera"/></body>
    <body name="plate" pos="-0.07 0 0.04"><joint name="plate" type="slide" axis="1 0 0"/>
      <geom name="plate" type="box" size="0.01 0.08 0.03" mass="1"/></body>
    <body name="box" pos="0 0 0.04"><freejoint name="box"/><geom name="box" type="box" size="0.04 0.06 0.04" mass="0.5"/>
      <site name="box"/></body>
  </worldbody>
  <actuator><velocity joint="plate" kv="5000"/></actuator>
  <sensor><framepos name="camera" objtype="site" objname="box" reftype="site" refname="camera"/></sensor>
</mujoco>
"""


class Stop:
    """Controller that pushes at constant speed until the camera detects the box at the line. It samples the camera at a given rate."""

    def begin(self, now: Any) -> None:
        """Reset the controller at the start of a batch: the camera has not detected the box at the line yet."""
        self._moving, self._next = np.ones(now.num_envs, bool), np.zeros(now.num_envs)
        self._box = np.full((now.num_envs, 3), np.nan)
        self._slopes = np.tan(0.5 * np.stack(np.broadcast_arrays(now.parameters["field of view"], HEIGHT), axis=-1))

    def __call__(self, now: Any) -> np.ndarray[Any, Any]:
        """Speed of the plate, (num_envs, 1) m/s."""
        samples = now.time >= self._next - 1e-9
        self._next = np.where(samples, self._next + 1.0 / now.parameters["rate"], self._next)
        reading = now.read("sensordata", "camera")
        # The field of view of an ideal camera is unlimited. Others keep the last reading when the box leaves it.
        is_seen = np.all(np.abs(reading[:, :2]) <= reading[:, 2:] * self._slopes, axis=1)
        self._box = np.where(is_seen[:, None] | now.ideal, reading, self._box)
        self._moving &= ~(samples & (self._box[:, 0] >= LINE))
        return np.where(self._moving, SPEED, 0.0)[:, None]


def beyond(now: Any) -> np.ndarray[Any, Any]:
    """Distance of the box from the line, m."""
    far: np.ndarray[Any, Any] = np.abs(now.read("xpos", "box")[:, 0] - LINE)
    return far


study = stepper.lab.Study(
    name="pushed_box",
    model=MODEL,
    controller=Stop(),
    outcomes=stepper.lab.Outcome(name="from the line", measure=beyond, success=f"<= {WIDE}", margin=1e-5, unit="m"),
    sensors=stepper.SensorModel({"camera": stepper.Transfer(noise_std=0.001, delay=0.01)}),
    parameters={
        "friction": stepper.lab.Parameter("geom_friction[table,box][0]", nominal=0.5, low=0.1, high=0.9, source="boxes on tables"),
        "mass": stepper.lab.Parameter("body_mass[box]", operation="scale", low=0.5, high=2.0, source="contents of the box"),
        "height": stepper.lab.Parameter("geom_size[box][2]", operation="scale", low=0.6, high=1.0, source="the box"),
        "rate": stepper.lab.Parameter("controller", nominal=50.0, values=(5.0, 10.0, 25.0, 50.0), unit="Hz", source="controllers"),
        "camera noise": stepper.lab.Parameter("sensor.noise_std", low=0.0, high=0.02, unit="m", source="detectors of markers"),
        "camera delay": stepper.lab.Parameter("sensor.delay", low=0.0, high=0.1, unit="s", source="cameras of 30 to 100 Hz"),
        "camera place": stepper.lab.Parameter(
            "body_pos[camera][0]", operation="add", low=-0.03, high=0.03, unit="m", source="a bracket, by eye"
        ),
        # Rotation about the camera's y axis: the last component of the quaternion (0, 1, 0, 0) changes by half the angle.
        "camera tilt": stepper.lab.Parameter(
            "body_quat[camera][3]", operation="add", low=-0.015, high=0.015, unit="rad/2", source="a bracket, by eye"
        ),
        "field of view": stepper.lab.Parameter(
            "controller", nominal=1.0, low=0.4, high=1.2, unit="rad", source="lenses of 23 to 69 degrees"
        ),
    },
    seconds=1.6,
    control=0.02,
    episodes=16,
    qvel_noise=1e-4,
)

if __name__ == "__main__":
    print(stepper.lab.report(study).document.markdown())
