"""A plate pushes a box to a line and stops when a camera says that it is there: what of mass, friction, shape, rate and camera decides?

The box goes on for v t, t the camera's delay, and then slides out, v^2 / (2 mu g). Its mass and shape have no part in either. The
camera is a sensor: the position of the box in the camera's frame, with noise, delay and a field of view. It hangs above the table, and
nobody tells the controller by how much it is beside its place or tilted.

    stepper report examples/studies/pushed_box.py
"""

from __future__ import annotations

from typing import Any

import numpy as np
import stepper

SPEED, LINE, WIDE = 0.3, 0.25, 0.02
"""m/s, m, m"""
AHEAD = 1.0 - 0.04
"""Of the box in the camera's frame, m."""

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
    """Pushes at a speed until the camera has seen the box at the line; looks at the rate of the actions."""

    def begin(self, now: Any) -> None:
        """Nothing was seen yet."""
        self._moving, self._next = np.ones(now.num_envs, bool), np.zeros(now.num_envs)
        self._box = np.full((now.num_envs, 3), np.nan)
        self._view = stepper.sensors.FieldOfView(width=now.theta["field of view"], height=0.5)

    def __call__(self, now: Any) -> np.ndarray[Any, Any]:
        """The speed of the plate."""
        looks = now.time >= self._next - 1e-9
        self._next = np.where(looks, self._next + 1.0 / now.theta["rate"], self._next)
        said = now.read("sensordata", "camera")
        # An ideal camera sees everything.
        self._box = said if now.ideal else self._view.detect(said, self._box)
        self._moving &= ~(looks & (self._box[:, 0] >= LINE))
        return np.where(self._moving, SPEED, 0.0)[:, None]


def beyond(now: Any) -> np.ndarray[Any, Any]:
    """How far beyond the line the box is, m."""
    far: np.ndarray[Any, Any] = np.abs(now.read("xpos", "box")[:, 0] - LINE)
    return far


study = stepper.lab.Study(
    name="pushed_box",
    model=MODEL,
    drive=Stop(),
    outcomes=stepper.lab.Outcome(name="from the line", measure=beyond, success=f"<= {WIDE}", margin=1e-5, unit="m"),
    sensors=stepper.SensorModel({"camera": stepper.Transfer(noise_std=0.001, delay=0.01)}),
    parameters={
        "friction": stepper.lab.Parameter("geom_friction[table,box][0]", nominal=0.5, low=0.1, high=0.9, source="boxes on tables"),
        "mass": stepper.lab.Parameter("body_mass[box]", how="scale", low=0.5, high=2.0, source="what is in the box"),
        "height": stepper.lab.Parameter("geom_size[box][2]", how="scale", low=0.6, high=1.0, source="the box"),
        "rate": stepper.lab.Parameter("drive", nominal=50.0, values=(5.0, 10.0, 25.0, 50.0), unit="Hz", source="controllers"),
        "camera noise": stepper.lab.Parameter("sensor.noise_std", low=0.0, high=0.02, unit="m", source="detectors of markers"),
        "camera delay": stepper.lab.Parameter("sensor.delay", low=0.0, high=0.1, unit="s", source="cameras of 30 to 100 Hz"),
        "camera place": stepper.lab.Parameter("body_pos[camera][0]", how="add", low=-0.03, high=0.03, unit="m", source="a bracket, by eye"),
        # About the camera's y axis: (0, 1, 0, 0) is turned by half the angle in its last number.
        "camera tilt": stepper.lab.Parameter(
            "body_quat[camera][3]", how="add", low=-0.015, high=0.015, unit="rad/2", source="a bracket, by eye"
        ),
        "field of view": stepper.lab.Parameter("drive", nominal=1.0, low=0.4, high=1.2, unit="rad", source="lenses of 23 to 69 degrees"),
    },
    seconds=1.6,
    control=0.02,
    episodes=16,
    qvel_noise=1e-4,
)

if __name__ == "__main__":
    print(stepper.lab.report(study).document.markdown())
