"""Scenes whose data determine only a part of the parameters, or only combinations of them.

In each scene the determined values are known from the equations of motion. `identify` must give finite intervals to no other values.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import stepper

from identification.scenes import HARD

Array = np.ndarray[Any, Any]


@dataclass(frozen=True)
class Partial:
    """Scene with parameters of which the data determine a part.

    Attributes:
        name: Name of the scene.
        source: MJCF of the model from which the search starts.
        changes: True values that differ from the source, by selector of `Model.replace`-like fields: (field, index, value).
        parameters: Selectors of the parameters to identify.
        determined: Labels of the values that the data determine.
        ctrl: Controls, (T, nu), each for a period.
        period: Time between controls, s.
        noise: Standard deviations of the readings by channel.
        qvel: Initial velocity, (nv,), or None for zero.
        scales: Factors of sensor readings by name, for parameters of sensors.
    """

    name: str
    source: str
    changes: Mapping[str, Mapping[Any, Any]]
    parameters: tuple[str, ...]
    determined: frozenset[str]
    ctrl: Array
    period: float
    noise: Mapping[str, float]
    qpos: tuple[float, ...] | None = None
    qvel: tuple[float, ...] | None = None
    scales: Mapping[str, float] | None = None

    def model(self) -> stepper.Model:
        return stepper.load(self.source)

    def true_model(self) -> stepper.Model:
        model = self.model()
        fields = {}
        for field, values in self.changes.items():
            fields[field] = np.array(getattr(model, field))
            for index, value in values.items():
                fields[field][index] = value
        return model.replace(**fields)

    def episode(self, seed: int) -> stepper.sysid.Episode:
        model = self.true_model()
        sim = stepper.Stepper(model, options=HARD)
        qpos = model.qpos0 if self.qpos is None else np.array(self.qpos)
        qvel = np.zeros(model.nv) if self.qvel is None else np.array(self.qvel)
        sim.set_state(qpos, qvel)
        made = sim.rollout(self.ctrl, round(self.period / sim.timestep), fields=("qpos", "qvel", "sensordata"))
        rng = np.random.default_rng(seed)
        readings = {}
        for name, std in self.noise.items():
            if name in ("qpos", "qvel"):
                rows = made[name]
            else:
                sensor = model.sensor(name)
                rows = made["sensordata"][:, sensor.adr : sensor.adr + sensor.dim] * (self.scales or {}).get(name, 1.0)
            readings[name] = rows + std * rng.standard_normal(rows.shape)
        return stepper.sysid.Episode(self.ctrl, readings, self.period, qpos=qpos, qvel=qvel)


T = np.arange(100) * 0.02
SWEEP = np.stack([np.sin(4 * T) + 0.5 * np.sin(9 * T + 1)], axis=1)
PENDULUM = """<mujoco><option timestep="0.005"/><worldbody><body name="a"><joint name="q" axis="0 1 0" damping="0.02"/>
  <inertial pos="0.02 0 -0.25" mass="0.5" diaginertia="0.004 0.0045 0.002"/></body></worldbody>
  <actuator><motor name="m" joint="q" gear="0.5"/></actuator><sensor><jointpos name="q" joint="q"/></sensor></mujoco>"""
TRUE_A = {"body_mass": {1: 0.7}, "body_ipos": {1: (0.03, 0.0, -0.3)}, "body_inertia": {1: (0.006, 0.0065, 0.003)}}
SLIDE = """<mujoco><option timestep="0.005" gravity="0 0 0"/><worldbody><body name="a"><joint name="q" type="slide" axis="1 0 0" damping="0.3"/>
  <geom name="a" type="box" size=".05 .05 .05" mass="0.8"/><body name="b" pos=".2 0 .1"><geom name="b" type="box" size=".03 .04 .05" mass="0.5"/>
  </body></body></worldbody>
  <actuator><motor name="m" joint="q" gear="4"/></actuator>
  <sensor><jointpos name="q" joint="q"/><actuatorfrc name="f" actuator="m"/></sensor></mujoco>"""
SPEED = """<mujoco><option timestep="0.005" gravity="0 0 0"/><worldbody><body name="a"><joint name="q" type="slide" axis="1 0 0" damping="1" frictionloss="0.5"/>
  <geom type="box" size=".05 .05 .05" mass="0.8"/></body></worldbody>
  <actuator><velocity name="m" joint="q" kv="200"/></actuator>
  <sensor><jointpos name="q" joint="q"/><actuatorfrc name="f" actuator="m"/></sensor></mujoco>"""
ARM2 = """<mujoco><option timestep="0.005"/><worldbody><body name="a"><joint name="q1" axis="0 1 0" damping="0.05"/>
  <inertial pos="0.01 0 -0.2" mass="0.8" diaginertia="0.005 0.006 0.002"/>
  <body name="b" pos="0 0 -0.4"><joint name="q2" axis="0 1 0" damping="0.03"/><inertial pos="0.02 0 -0.15" mass="0.4" diaginertia="0.003 0.0035 0.001"/>
  </body></body></worldbody>
  <actuator><motor name="m1" joint="q1" gear="2"/><motor name="m2" joint="q2" gear="0.5"/></actuator></mujoco>"""
TWO = np.stack([np.sin(4 * T) + 0.5 * np.sin(9 * T + 1), np.cos(5 * T) + 0.5 * np.sin(8 * T)], axis=1)
CONST = np.full((100, 1), 0.4)
ALL = lambda body: tuple(f"body_inertial[{body}].{p}" for p in ("mass", "com.x", "com.y", "com.z", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz"))

SCENES = (
    Partial("pendulum, inertial", PENDULUM, TRUE_A, ("body_inertial[a]",), frozenset(), SWEEP, 0.02, {"q": 2e-3}),
    Partial("pendulum, three parts", PENDULUM, TRUE_A, ("body_mass[a]", "body_ipos[a]", "body_inertia[a]"), frozenset(), SWEEP, 0.02, {"q": 2e-3}),
    Partial("pendulum, mass and centre", PENDULUM, {"body_mass": {1: 0.7}, "body_ipos": {1: (0.03, 0, -0.3)}, "body_inertia": {1: (0.0056, 0.0063, 0.0028)}},
            ("body_mass[a]", "body_ipos[a]"), frozenset({"body_mass[a]", "body_ipos[a][0]", "body_ipos[a][2]"}), SWEEP, 0.02, {"q": 2e-3}),
    Partial("bodies in series", SLIDE, {"body_mass": {1: 1.0, 2: 0.7}}, ("body_mass[a]", "body_mass[b]"), frozenset(), SWEEP, 0.02, {"q": 1e-3}),
    Partial("one speed", SPEED, {"dof_damping": {0: 1.3}, "dof_frictionloss": {0: 0.4}}, ("dof_damping[q]", "dof_frictionloss[q]"), frozenset(), CONST, 0.02,
            {"q": 1e-3, "f": 0.02}, qvel=(0.4,)),
    Partial("gain and scale", SLIDE, {"body_mass": {1: 1.0}, "actuator_gainprm": {(0, 0): 1.4}, "dof_damping": {0: 0.45}},
            ("actuator_gainprm[m]", "sensor.scale[f]", "body_mass[a,b]", "dof_damping[q]"), frozenset(), SWEEP, 0.02, {"q": 1e-3, "f": 0.02}, scales={"f": 1.2}),
    Partial("payload on a slide", SLIDE, {"body_mass": {2: 0.7}}, ("body_inertial[b]",), frozenset({"body_inertial[b].mass"}), SWEEP, 0.02, {"q": 1e-3}),
    Partial("two links", ARM2, {"body_mass": {1: 1.0, 2: 0.5}, "body_ipos": {1: (0.03, 0, -0.22), 2: (0.01, 0, -0.18)}},
            ("body_mass[a]", "body_ipos[a]", "body_inertia[a]", "body_mass[b]", "body_ipos[b]", "body_inertia[b]"), frozenset(), TWO, 0.02, {"qpos": 2e-3}),
    Partial("two links, damping", ARM2, {"dof_damping": {0: 0.07, 1: 0.05}}, ("dof_damping[q1]", "dof_damping[q2]", "body_mass[b]"),
            frozenset({"dof_damping[q1]", "dof_damping[q2]", "body_mass[b]"}), TWO, 0.02, {"qpos": 2e-3}),
)
