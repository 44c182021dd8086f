"""Scenes with known parameters: a box pushed over a floor, and a box held between two fingers and shaken."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import stepper

HARD = stepper.Options(tolerance=1e-9)
"""Options of stepper in all runs with hard contact."""


def by_sensor(model: stepper.Model, rows: np.ndarray[Any, Any], names: Iterable[str]) -> dict[str, np.ndarray[Any, Any]]:
    """Readings of some sensors by name, (T, dim) each, from all readings (T, nsensordata)."""
    sensors = [model.sensor(name) for name in names]
    return {sensor.name: rows[:, sensor.adr : sensor.adr + sensor.dim] for sensor in sensors}


def springy_finger(name: str, *, stiffness: float, damping: float) -> str:
    """MJCF of a finger on a spring behind a box on a floor: stiffness of the spring, N/m, and its damping, N s/m.

    The placeholders are for the mass of the box, and for the friction of box and floor.
    """
    return f"""<mujoco model="{name}"><option timestep="0.002"/><worldbody>
  <geom name="floor" type="plane" size="2 2 .1" friction="{{1}}"/>
  <body name="box" pos="0 0 .04"><joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>
    <geom name="box" type="box" size=".05 .04 .04" mass="{{0}}" friction="{{1}}"/></body>
  <body name="hand" pos="-.1 0 .04"><joint name="push" type="slide" axis="1 0 0" damping="2"/>
    <geom name="hand" type="box" size=".01 .01 .01" mass=".4" contype="2" conaffinity="2"/>
    <body name="finger" pos=".02 0 0"><joint name="give" type="slide" axis="1 0 0" stiffness="{stiffness:g}" damping="{damping:g}"/>
      <geom name="finger" type="sphere" size=".01" mass=".05" condim="1" priority="1"/>
      <site name="wrist" pos="-.01 0 0"/></body>
  </body></worldbody>
  <actuator><position joint="push" kp="800" kv="60"/></actuator>
  <sensor><force name="wrist_force" site="wrist"/><jointpos name="box_x" joint="x"/></sensor></mujoco>"""


def gripper(name: str, *, arm: float, finger: tuple[float, float], damping: float, box: float, sensors: str, floor: str = "") -> str:
    """MJCF of two fingers on slides below an arm on a vertical slide, and a box between them: heights of arm and box, m; MJCF of sensors.

    A finger has a distance from the middle and a height above the wrist, m, and its slide has a damping, N s/m. The placeholders are for
    the mass of the box, and for the friction of box and fingers.
    """
    aside, above = finger
    return f"""<mujoco model="{name}"><option timestep="0.002"/><worldbody>{floor}
  <body name="arm" pos="0 0 {arm:g}"><joint name="lift" type="slide" axis="0 0 1" damping="5"/>
    <geom type="box" size=".03 .03 .03" mass="1" contype="0" conaffinity="0"/>
    <body name="wrist" pos="0 0 -.05"><site name="wrist"/>
      <geom type="box" size=".04 .02 .01" mass=".3" contype="0" conaffinity="0"/>
      <body name="left" pos="{-aside:g} 0 {above:g}"><joint name="left" type="slide" axis="1 0 0" damping="{damping:g}"/>
        <geom name="left" type="box" size=".005 .02 .03" mass=".05" friction="{{1}}" contype="2" conaffinity="1"/></body>
      <body name="right" pos="{aside:g} 0 {above:g}"><joint name="right" type="slide" axis="-1 0 0" damping="{damping:g}"/>
        <geom name="right" type="box" size=".005 .02 .03" mass=".05" friction="{{1}}" contype="2" conaffinity="1"/></body>
    </body></body>
  <body name="box" pos="0 0 {box:g}"><joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>
    <geom name="box" type="box" size=".025 .02 .05" mass="{{0}}" friction="{{1}}" contype="1" conaffinity="3"/></body>
  </worldbody>
  <actuator><position joint="lift" kp="4000" kv="200"/><motor joint="left"/><motor joint="right"/></actuator>
  <sensor><force name="wrist_force" site="wrist"/>{sensors}</sensor></mujoco>"""


PUSHED = springy_finger("pushed box", stiffness=2000, damping=40)

TORQUE_AND_LIFT = '<torque name="wrist_torque" site="wrist"/><jointpos name="lift" joint="lift"/>'
HELD = gripper("held box", arm=0.5, finger=(0.03, -0.06), damping=1, box=0.39, sensors=TORQUE_AND_LIFT)


@dataclass(frozen=True)
class Scene:
    """Scene of an identification with two unknown parameters, such as mass (kg) and friction.

    Attributes:
        name: Name of the scene.
        source: MJCF with placeholders for both parameters.
        truth: True values.
        parameters: Selectors of both parameters.
        ctrl: Controls, (T, nu), each for a period.
        noise: Standard deviations of the readings by channel.
        starts: Initial values of the search.
        period: Time between controls, s.
    """

    name: str
    source: str
    truth: tuple[float, float]
    parameters: tuple[str, str]
    ctrl: np.ndarray[Any, Any]
    noise: dict[str, float]
    starts: tuple[tuple[float, float], ...]
    period: float = 0.02

    def text(self, *values: float) -> str:
        """MJCF with the given values of both parameters."""
        return self.source.format(*(repr(float(value)) for value in values))

    def model(self, *values: float) -> stepper.Model:
        """Model with the given values of both parameters."""
        return stepper.load(self.text(*values))

    def readings(self, options: stepper.Options) -> dict[str, np.ndarray[Any, Any]]:
        """Ideal sensor readings of the scene's motion with the true parameters, by channel: T readings of dim numbers each, (T, dim)."""
        model = self.model(*self.truth)
        sim = stepper.Stepper(model, options=options)
        made = sim.rollout(self.ctrl, round(self.period / sim.timestep), fields=("sensordata",))["sensordata"]
        return by_sensor(model, made, self.noise)


def pushed() -> Scene:
    """Scene in which a finger on a spring pushes a box with varying speed. Sensors: force behind the finger, position of the box."""
    t = np.arange(100) * 0.02
    ctrl = 0.022 + 0.12 * t + 0.008 * np.sin(2 * np.pi * 2.2 * t)
    return Scene("pushed box", PUSHED, (1.3, 0.35), ("body_mass[box]", "geom_friction[floor,box][0]"), ctrl[:, None],
                 {"wrist_force": 0.3, "box_x": 5e-4}, ((1.0, 0.5), (0.4, 1.0), (4.0, 0.1), (2.5, 0.9)))  # fmt: skip


def held() -> Scene:
    """Scene in which two fingers squeeze a box while the wrist shakes, so that the box slips at times. Sensors: wrist force and torque."""
    t = np.arange(100) * 0.02
    lift = 0.03 * (np.sin(2 * np.pi * 1.0 * t) + 0.5 * np.sin(2 * np.pi * 2.6 * t)) * np.minimum(1, t / 0.4)
    squeeze = np.full_like(t, 12.0)
    sought = ("body_mass[box]", "geom_friction[left,right,box][0]")
    return Scene("held box", HELD, (0.8, 0.45), sought, np.stack([lift, squeeze, squeeze], axis=1),
                 {"wrist_force": 0.3, "wrist_torque": 0.02}, ((0.5, 0.6), (0.2, 1.2), (2.0, 0.3), (1.2, 0.9)))  # fmt: skip


SCENES = (pushed, held)
