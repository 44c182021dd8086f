"""Scenes whose data determine only a part of the parameters, or only combinations of them.

The determined values and combinations follow from the equations of motion. `identify` must give finite intervals to no other values.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, TypeAlias

import numpy as np
import stepper
from scipy.stats import binom
from sections import Table
from stepper.sysid.parameters import bind

from identification.repetitions import Answer, Kept, Row, repeated
from identification.scenes import HARD

Array = np.ndarray[Any, Any]
Truth: TypeAlias = "dict[str, dict[Any, Any]]"
PERIOD = 0.02
"""Time between controls, s."""
T = np.arange(60) * PERIOD
"""Times at which the control periods begin, s."""
SEEDS_OF_A_SCENE = 1000
"""Number of seeds between those of two scenes, so that no two scenes have the same noise."""


@dataclass(frozen=True)
class Partial:
    """Scene with parameters of which the data determine a part.

    Attributes:
        name: Name of the scene.
        source: MJCF of the model with the start values.
        truth: True values that differ from the source, by field of the model and index.
        parameters: Selectors of the parameters to identify.
        determined: Labels of the values that the data determine.
        combinations: True values of the combinations that the data determine, by text.
        ctrl: Controls, (T, nu), each for a period.
        noise: Standard deviations of the readings by channel.
        qvel: Initial velocity, (nv,); None is zero.
        factors: Factors of the readings by sensor, for parameters "sensor.scale".
        spread: Largest change of the logarithms of the start values, which each run draws. Start values of a centre of mass change by one
            factor.
    """

    name: str
    source: str
    truth: Mapping[str, Mapping[Any, Any]]
    parameters: tuple[str, ...]
    determined: tuple[str, ...]
    combinations: Mapping[str, float]
    ctrl: Array
    noise: Mapping[str, float]
    qvel: tuple[float, ...] | None = None
    factors: Mapping[str, float] = field(default_factory=dict)
    spread: float = 0.0

    def model(self) -> stepper.Model:
        """Model with the start values."""
        return stepper.load(self.source)

    def true_model(self) -> stepper.Model:
        """Model with the true values."""
        model, fields = self.model(), {}
        for name, values in self.truth.items():
            fields[name] = np.array(getattr(model, name))
            for index, value in values.items():
                fields[name][index] = value
        return model.replace(**fields)

    def episode(self, seed: int) -> stepper.sysid.Episode:
        """Noisy readings of a motion with the true values."""
        sim = stepper.Stepper(self.true_model(), options=HARD)
        qvel = np.zeros(sim.model.nv) if self.qvel is None else np.array(self.qvel)
        sim.set_state(qvel=qvel)
        made = sim.rollout(self.ctrl, round(PERIOD / sim.timestep), fields=("qpos", "sensordata"))
        rng = np.random.default_rng(seed)
        readings = {}
        for name, std in self.noise.items():
            rows = made["qpos"]
            if name != "qpos":
                sensor = sim.model.sensor(name)
                rows = self.factors.get(name, 1.0) * made["sensordata"][:, sensor.adr : sensor.adr + sensor.dim]
            readings[name] = rows + std * rng.standard_normal(rows.shape)
        return stepper.sysid.Episode(self.ctrl, readings, PERIOD, qvel=qvel)

    def identified(self, seed: int, starts: int = 2) -> stepper.sysid.Identification:
        """Result of an identification with the noise of a seed."""
        rng = np.random.default_rng((seed, 1))
        model, parameters = self.model(), []
        for block in bind(self.parameters, model):
            factor = np.exp(rng.uniform(-self.spread, self.spread))
            if block.size == 1:
                parameters.append(replace(block.parameter, start=float(factor * block.natural(block.start)[0])))
                continue
            parameters.append(block.parameter)
            if block.parameter.kind == "body_ipos":
                ipos = np.array(model.body_ipos)
                ipos[block.index] *= factor
                model = model.replace(body_ipos=ipos)
        return stepper.sysid.identify(model, [self.episode(seed)], parameters, starts=starts, seed=seed, threads=1)

    def labels(self) -> list[str]:
        """Labels of the n values."""
        return [label for block in bind(self.parameters, self.model()) for label in block.labels]

    def all_true_values(self) -> Array:
        """True values, then those of the combinations, (n + combinations,)."""
        model = self.true_model()
        return np.array([*(_value(model, label, self.factors) for label in self.labels()), *self.combinations.values()])

    def answer(self, seed: int, starts: int = 2) -> Answer:
        """Values and their intervals, then those of `combinations`, (n + combinations,), NaN for combinations without a name."""
        found = self.identified(seed, starts)
        named = {c.text: (c.value, *c.interval) for c in found.combinations}
        rows = [named.get(text, (np.nan,) * 3) for text in self.combinations]
        values = np.column_stack([found.values, found.interval()])
        value, low, high = np.concatenate([values, np.reshape(rows, (-1, 3))]).T
        return value, low, high


def _value(model: stepper.Model, label: str, factors: Mapping[str, float]) -> float:
    """Value of a label such as "body_ipos[a][2]" in a model whose principal axes are those of the body's frame."""
    kind, _, rest = label.partition("[")
    names, _, part = rest.partition("]")
    name = names.partition(",")[0]
    if kind.startswith("body"):
        body = model.body(name)
        if kind == "body_inertial":
            values = [body.mass, *body.ipos, *body.inertia, 0.0, 0.0, 0.0]
            return float(values[(".mass", ".com.x", ".com.y", ".com.z", ".Ixx", ".Iyy", ".Izz", ".Ixy", ".Ixz", ".Iyz").index(part)])
        value = getattr(body, kind.removeprefix("body_"))
        return float(value[int(part[1:-1])] if part else value)
    if kind.startswith("sensor."):
        return factors[name] if kind == "sensor.scale" else 0.0
    if kind.startswith("actuator"):
        actuator = model.actuator(name)
        return float(-actuator.biasprm[2] if kind == "actuator_kv" else actuator.gainprm[0])
    if kind == "geom_friction":
        return float(model.geom(name).friction[0])
    return float(getattr(model.joint(name), kind.removeprefix("dof_").removeprefix("jnt_")))


SWEEP = np.stack([np.sin(4 * T) + 0.5 * np.sin(9 * T + 1)], axis=1)
TWO_SWEEPS = np.stack([np.sin(4 * T) + 0.5 * np.sin(9 * T + 1), np.cos(5 * T) + 0.5 * np.sin(8 * T)], axis=1)
PENDULUM = """<mujoco><option timestep="0.005"/><worldbody><body name="a"><joint name="q" axis="0 1 0" damping="0.02"/>
  <inertial pos="0.02 0 -0.25" mass="0.5" diaginertia="0.004 0.0045 0.002"/></body></worldbody>
  <actuator><motor name="m" joint="q" gear="0.5"/></actuator><sensor><jointpos name="q" joint="q"/></sensor></mujoco>"""
LIGHT = """<mujoco><option timestep="0.005"/><worldbody><body name="a"><joint name="q" axis="0 1 0" damping="0.02"/>
  <geom type="sphere" size="0.05" pos="0.05 0 -0.3" mass="0.45"/></body></worldbody>
  <actuator><motor name="m" joint="q" gear="0.5"/></actuator><sensor><jointpos name="q" joint="q"/></sensor></mujoco>"""
TWO_MASSES = """<mujoco><option timestep="0.005"/><worldbody><body name="a"><joint name="q" axis="0 1 0" damping="0.02"/>
  <inertial pos="0.02 0 -0.1" mass="1.2" diaginertia="0.01 0.0108 0.005"/></body></worldbody>
  <actuator><motor name="m" joint="q" gear="0.5"/></actuator><sensor><jointpos name="q" joint="q"/></sensor></mujoco>"""
SLIDE = """<mujoco><option timestep="0.005" gravity="0 0 0"/><worldbody><body name="a">
  <joint name="q" type="slide" axis="1 0 0" damping="0.3"/>
  <geom type="box" size=".05 .05 .05" mass="0.8"/><body name="b" pos=".2 0 .1"><geom type="box" size=".03 .04 .05" mass="0.5"/></body>
  </body></worldbody><actuator><motor name="m" joint="q" gear="4"/></actuator>
  <sensor><jointpos name="q" joint="q"/><actuatorfrc name="f" actuator="m"/></sensor></mujoco>"""
ONE_SPEED = """<mujoco><option timestep="0.005" gravity="0 0 0"/><worldbody><body name="a">
  <joint name="q" type="slide" axis="1 0 0" damping="1" frictionloss="0.5"/>
  <geom type="box" size=".05 .05 .05" mass="0.8"/></body></worldbody>
  <actuator><velocity name="m" joint="q" kv="200"/></actuator>
  <sensor><jointpos name="q" joint="q"/><actuatorfrc name="f" actuator="m"/></sensor></mujoco>"""
LINKS = """<mujoco><option timestep="0.005"/><worldbody><body name="a"><joint name="q" axis="0 1 0" damping="0.05"/>
  <inertial pos="0.01 0 -0.2" mass="0.8" diaginertia="0.005 0.006 0.002"/>
  <body name="b" pos="0 0 -0.4"><joint name="r" axis="0 1 0" damping="0.03"/>
  <inertial pos="0.02 0 -0.15" mass="0.4" diaginertia="0.003 0.0035 0.001"/></body></body></worldbody>
  <actuator><motor joint="q" gear="2"/><motor joint="r" gear="0.5"/></actuator></mujoco>"""
DROPPED = """<mujoco><option timestep="0.005"/><worldbody><geom name="floor" type="plane" size="5 1 .1" friction=".3"/>
  <body name="a" pos="0 0 .05"><joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>
  <geom name="box" type="box" size=".05 .05 .05" mass="0.8" friction=".3"/></body></worldbody>
  <sensor><jointpos name="x" joint="x"/></sensor></mujoco>"""
ROLLED = """<mujoco><option timestep="0.005" gravity="3 0 -9"/><worldbody><geom type="plane" size="5 1 .1" friction="1"/>
  <body name="a" pos="0 0 .05"><joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>
  <joint name="turn" axis="0 1 0"/><geom name="disc" type="cylinder" euler="90 0 0" size=".05 .02" friction="1"/>
  <inertial pos="0 0 0" mass="0.8" diaginertia="0.0009 0.001 0.0009"/></body></worldbody>
  <sensor><jointpos name="x" joint="x"/></sensor></mujoco>"""
COASTING = """<mujoco><option timestep="0.005" gravity="0 0 0"/><worldbody><body name="a">
  <joint name="q" type="slide" axis="1 0 0" stiffness="20" damping="0.6"/><geom type="sphere" size=".05" mass="0.8"/></body></worldbody>
  <sensor><jointpos name="q" joint="q"/></sensor></mujoco>"""
SERVO = """<mujoco><option timestep="0.005" gravity="0 0 0"/><worldbody><body name="a">
  <joint name="q" type="slide" axis="1 0 0" stiffness="20" damping="0.6"/><geom type="sphere" size=".05" mass="0.8"/></body></worldbody>
  <actuator><position name="m" joint="q" kp="10" kv="0.5"/></actuator><sensor><jointpos name="q" joint="q"/></sensor></mujoco>"""
GEARED = """<mujoco><option timestep="0.005" gravity="0 0 0"/><worldbody>
  <body name="a"><joint name="q" axis="0 0 1" damping=".02" armature=".002"/><geom type="sphere" size=".05" mass="0.8"/></body>
  <body name="b" pos="1 0 0"><joint name="r" axis="0 0 1" armature=".01"/><geom type="sphere" size=".05" mass="0.8"/></body></worldbody>
  <equality><joint joint1="r" joint2="q" polycoef="0 2 0 0 0"/></equality>
  <actuator><motor joint="q" gear=".3"/></actuator><sensor><jointpos name="q" joint="q"/></sensor></mujoco>"""
TUMBLING = """<mujoco><option timestep="0.005" gravity="0 0 0"/><worldbody><body name="a"><freejoint/>
  <inertial pos="0 0 0" mass="0.8" diaginertia="0.001 0.002 0.0026"/><site name="imu"/></body></worldbody>
  <sensor><gyro name="w" site="imu"/></sensor></mujoco>"""
DRY = """<mujoco><option timestep="0.005"/><worldbody><body name="a"><joint name="q" axis="0 0 1" damping="0.2" stiffness="0.7"
  frictionloss="0.08" armature="0.008"/><inertial pos="0.1 0 0" mass="0.5" diaginertia="0.004 0.004 0.004"/></body></worldbody>
  <actuator><motor joint="q" gear="1"/></actuator><sensor><jointpos name="q" joint="q"/></sensor></mujoco>"""
FREE = """<mujoco><option timestep="0.005"/><worldbody><body name="a"><joint name="q" axis="0 1 0"/>
  <inertial pos="0.02 0 -0.2" mass="0.6" diaginertia="0.01 0.0108 0.005"/></body></worldbody>
  <sensor><jointpos name="q" joint="q"/></sensor></mujoco>"""
BALL = """<mujoco><option timestep="0.005" gravity="0 0 0"/><worldbody><body name="a"><joint type="ball"/>
  <inertial pos="0.05 0.03 0.04" mass="0.8" diaginertia="0.001 0.002 0.0026"/><site name="imu"/></body></worldbody>
  <sensor><gyro name="w" site="imu"/></sensor></mujoco>"""
SUM = """<mujoco><option timestep="0.005" gravity="0 0 0"/><default><geom size=".05" mass="1"/><joint type="slide" axis="1 0 0"/></default>
  <worldbody><body name="a"><joint name="q" stiffness="{q[0]}" damping="{q[1]}"/><geom/></body>
  <body name="b" pos="0 2 0"><joint name="r" stiffness="{r[0]}" damping="{r[1]}"/><geom/></body></worldbody>
  <tendon><fixed name="t"><joint joint="q" coef="1"/><joint joint="r" coef="1"/></fixed></tendon>
  <actuator><motor joint="q" gear="4"/><motor joint="r" gear="4"/></actuator><sensor><tendonpos name="s" tendon="t"/></sensor></mujoco>"""
THREE = ("body_mass[{}]", "body_ipos[{}]", "body_inertia[{}]")
ENCODER = {"q": 2e-3}


def _of_body(name: str) -> tuple[str, ...]:
    """Selectors of mass, centre of mass and inertia of a body."""
    return tuple(text.format(name) for text in THREE)


def _swing(
    name: str, source: str, parameters: tuple[str, ...], distance: float = 0.3, inertia: tuple[float, float, float] = (0.006, 0.0065, 0.003)
) -> Partial:
    """Pendulum with an encoder, of which the data determine the first moments and the moment of inertia about the joint alone."""
    truth: Truth = {"body_mass": {1: 0.7}, "body_ipos": {1: (0.03, 0.0, -distance)}, "body_inertia": {1: inertia}}
    known = {
        "body_mass[a] * body_ipos[a][0]": 0.7 * 0.03,
        "body_mass[a] * body_ipos[a][2]": 0.7 * -distance,
        "Iyy[a] about joint q": inertia[1] + 0.7 * (0.03**2 + distance**2),
    }
    return Partial(name, source, truth, parameters, (), known, SWEEP, ENCODER)


def _without_a_scale() -> list[Partial]:
    """Scenes in which no reading has the scale of a force, or in which two elements act as one."""
    rest = np.zeros((60, 0))
    disc, body = "body_mass[a] / (Iyy[a] about joint x)", "I{0}{0}[a] about its origin"
    tumbling: Truth = {"body_inertia": {1: (0.0012, 0.0021, 0.0029)}}
    ratios = {f"{body.format('x')} / ({body.format('y')})": 12 / 21, f"{body.format('x')} / ({body.format('z')})": 12 / 29}
    return [
        Partial("sliding box", DROPPED, {"geom_friction": {(0, 0): 0.4, (1, 0): 0.4}, "body_mass": {1: 1.0}},
                ("body_mass[a]", "geom_friction[floor,box][0]"), ("geom_friction[floor,box][0]",), {}, rest, {"x": 2e-3}, (3.0, 0.0)),
        Partial("rolling disc", ROLLED, {"body_mass": {1: 1.0}, "body_inertia": {1: (0.0015, 0.0018, 0.0015)}},
                ("body_mass[a]", "body_inertia[a]"), (), {disc: 1.0 / 0.0018}, rest, {"x": 2e-3}),
        Partial("coasting mass", COASTING, {"body_mass": {1: 1.0}, "jnt_stiffness": {0: 30.0}, "dof_damping": {0: 0.5}},
                ("jnt_stiffness[q]", "dof_damping[q]", "body_mass[a]"), (),
                {"jnt_stiffness[q] / dof_damping[q]": 60.0, "jnt_stiffness[q] / body_mass[a]": 30.0}, rest, {"q": 2e-3}, (1.0,)),
        Partial("servo beside a spring", SERVO, {"jnt_stiffness": {0: 26.0}, "dof_damping": {0: 0.5}},
                ("jnt_stiffness[q]", "actuator_kp[m]", "dof_damping[q]", "actuator_kv[m]"), (),
                {"jnt_stiffness[q] + actuator_kp[m]": 36.0, "dof_damping[q] + actuator_kv[m]": 1.0},
                np.zeros((60, 1)), {"q": 2e-3}, (1.0,)),
        Partial("geared wheels", GEARED, {"dof_armature": {0: 0.003, 1: 0.008}, "dof_damping": {0: 0.03}},
                ("dof_armature[q]", "dof_armature[r]", "dof_damping[q]"), ("dof_damping[q]",),
                {"dof_armature[q] + 4 dof_armature[r]": 0.035}, SWEEP, {"q": 2e-3}),
        Partial("tumbling body", TUMBLING, tumbling, ("body_inertia[a]",), (), ratios, rest, {"w": 0.02}, (0, 0, 0, 2.0, 3.0, 1.0)),
        Partial("scale and bias of a constant force", ONE_SPEED, {}, ("sensor.bias[f]", "sensor.scale[f]"), (), {},
                np.full((60, 1), 0.4), {"f": 0.02}, (0.4,), {"f": 1.2}),
    ]  # fmt: skip


def _two_minima() -> list[Partial]:
    """Scenes with two minima that explain the readings equally well, and three with one minimum, all from far start values."""
    rest, far = np.zeros((60, 0)), 1.2
    # The true mass is one of two with the same first moments and the same moment of inertia m k^2 + (m l)^2 / m, with a known k^2.
    gyration, moment = 0.009, (0.021, 0.091)
    masses = (0.7, (moment[0] ** 2 + moment[1] ** 2) / gyration / 0.7)
    mass_truths: list[Truth] = [
        {"body_mass": {1: m}, "body_ipos": {1: (moment[0] / m, 0.0, -moment[1] / m)},
         "body_inertia": {1: (m / 120, m * gyration, m / 240)}} for m in masses
    ]  # fmt: skip
    # The period is that of (k^2 + l^2) / l, which is the same at the distance k^2 / l.
    direction = np.array([0.02, 0.0, -0.2]) / np.hypot(0.02, 0.2)
    two_springs = SUM.format(q=(30, 0.5), r=(80, 1.0))
    springs, dampers = ("jnt_stiffness[q]", "jnt_stiffness[r]"), ("dof_damping[q]", "dof_damping[r]")
    links: Truth = {"dof_damping": {0: 0.07, 1: 0.05}}
    both = np.repeat(SWEEP, 2, axis=1)
    return [
        Partial("far start: pendulum, lighter mass", TWO_MASSES, mass_truths[0], ("body_mass[a]", "body_ipos[a]"), (), {}, SWEEP, ENCODER,
                spread=far),
        Partial("far start: pendulum, heavier mass", TWO_MASSES, mass_truths[1], ("body_mass[a]", "body_ipos[a]"), (), {}, SWEEP, ENCODER,
                spread=far),
        Partial("far start: free pendulum, longer distance", FREE, {"body_ipos": {1: tuple(0.25 * direction)}}, ("body_ipos[a]",), (), {},
                rest, ENCODER, (3.0,), spread=far),
        Partial("far start: free pendulum, shorter distance", FREE, {"body_ipos": {1: tuple(0.018 / 0.25 * direction)}},
                ("body_ipos[a]",), (), {}, rest, ENCODER, (3.0,), spread=far),
        Partial("far start: ball joint, opposite centre of mass", BALL, {"body_ipos": {1: (-0.06, -0.04, -0.03)}}, ("body_ipos[a]",), (),
                {}, rest, {"w": 0.02}, (2.0, 3.0, 1.0), spread=far),
        Partial("far start: sum of two springs", SUM.format(q=(30, 0.5), r=(80, 0.5)), {}, springs, (), {}, both, {"s": 2e-3}, spread=far),
        Partial("far start: sum of two springs and dampers", two_springs, {}, (*springs, *dampers), (), {}, both, {"s": 2e-3}, spread=far),
        Partial("far start: sum of two unlike springs", two_springs, {}, springs, springs, {}, both, {"s": 2e-3}, spread=far),
        Partial("far start: friction and damping", DRY, {}, (*springs[:1], "dof_frictionloss[q]", *dampers[:1]),
                (*springs[:1], "dof_frictionloss[q]", *dampers[:1]), {}, 0.6 * SWEEP, {"q": 1e-2}, spread=far),
        Partial("far start: two links", LINKS, links, (*dampers, "body_mass[b]"), (*dampers, "body_mass[b]"), {}, TWO_SWEEPS,
                {"qpos": 2e-3}, spread=far),
    ]  # fmt: skip


def scenes() -> list[Partial]:
    """All scenes."""
    series = {"body_mass[a] + body_mass[b]": 1.7}
    # The parameter keeps the ratio 0.8 : 0.5 of both masses, and the true masses have this ratio too.
    gains = {
        "actuator_gainprm[m] * sensor.scale[f]": 1.4 * 1.2,
        "actuator_gainprm[m] / body_mass[a,b]": 1.4 / 1.0,
        "actuator_gainprm[m] / dof_damping[q]": 1.4 / 0.45,
    }
    gain_truth: Truth = {"body_mass": {1: 1.0, 2: 0.625}, "actuator_gainprm": {(0, 0): 1.4}, "dof_damping": {0: 0.45}}
    gain_parameters = ("actuator_gainprm[m]", "sensor.scale[f]", "body_mass[a,b]", "dof_damping[q]")
    links = {
        "body_mass[a] * body_ipos[a][0]": 1.0 * 0.03,
        "body_mass[b] * body_ipos[b][0]": 0.5 * 0.01,
        "body_mass[b] * body_ipos[b][2]": 0.5 * -0.18,
        "Iyy[b] about joint r": 0.0035 + 0.5 * (0.01**2 + 0.18**2),
        "body_mass[a] * body_ipos[a][2] - 0.4 body_mass[b]": 1.0 * -0.22 - 0.4 * 0.5,
    }
    link_truth: Truth = {"body_mass": {1: 1.0, 2: 0.5}, "body_ipos": {1: (0.03, 0.0, -0.22), 2: (0.01, 0.0, -0.18)}}
    plane = ("body_mass[a]", "body_ipos[a][0]", "body_ipos[a][2]")
    centre: Truth = {"body_mass": {1: 0.7}, "body_ipos": {1: (0.03, 0.0, -0.3)}, "body_inertia": {1: (0.0056, 0.0063, 0.0028)}}
    # The inertia about the joint is m k^2 + (m l)^2 / m, with a known k: two masses have the same inertia and the same m l.
    two = _swing(
        "pendulum, two masses fit", TWO_MASSES, ("body_mass[a]", "body_ipos[a]"), distance=0.13, inertia=(7 / 1200, 0.0063, 7 / 2400)
    )
    damping = ("dof_damping[q]", "dof_damping[r]", "body_mass[b]")
    return [
        _swing("pendulum, three parts", PENDULUM, _of_body("a")),
        _swing("pendulum, small ball", LIGHT, _of_body("a")),
        _swing("pendulum, pseudo-inertia", PENDULUM, ("body_inertial[a]",)),
        Partial("pendulum, shape known", PENDULUM, centre, ("body_mass[a]=0.1..3", "body_ipos[a]"), plane, {}, SWEEP, ENCODER),
        two,
        Partial("bodies in series", SLIDE, {"body_mass": {1: 1.0, 2: 0.7}}, ("body_mass[a]", "body_mass[b]"), (), series, SWEEP,
                {"q": 1e-3}),
        Partial("friction and damping at one speed", ONE_SPEED, {"dof_damping": {0: 1.3}, "dof_frictionloss": {0: 0.4}},
                ("dof_damping[q]", "dof_frictionloss[q]"), (), {}, np.full((60, 1), 0.4), {"q": 1e-3, "f": 0.02}, (0.4,)),
        Partial("gain and scale", SLIDE, gain_truth, gain_parameters, (), gains, SWEEP, {"q": 1e-3, "f": 0.02}, factors={"f": 1.2}),
        Partial("payload on a slide", SLIDE, {"body_mass": {2: 0.7}}, ("body_inertial[b]",), ("body_inertial[b].mass",), {}, SWEEP,
                {"q": 1e-3}),
        *_without_a_scale(),
        Partial("two links", LINKS, link_truth, (*_of_body("a"), *_of_body("b")), (), links, TWO_SWEEPS, {"qpos": 2e-3}),
        Partial("two links, fully determined", LINKS, {"dof_damping": {0: 0.07, 1: 0.05}}, damping, damping, {}, TWO_SWEEPS,
                {"qpos": 2e-3}),
        *_two_minima(),
    ]  # fmt: skip


@dataclass(frozen=True)
class Count:
    """Counts of the intervals in repeated identifications of a scene.

    Attributes:
        finite: Number of finite intervals of values.
        missed: Number of finite intervals of values without the true value.
        wrong: Number of finite intervals of values that are not determined.
        lost: Number of infinite intervals of values that are determined.
        together: Number of intervals of combinations.
        together_missed: Number of intervals of combinations without the true value.
        unnamed: Number of determined combinations that the result does not name.
        probability: Binomial probability of at least as many misses, for intervals that miss the truth in 5 % of the runs. It is the
            smallest of all values and combinations of the scene.
    """

    finite: int
    missed: int
    wrong: int
    lost: int
    together: int
    together_missed: int
    unnamed: int
    probability: float

    @classmethod
    def of(cls, scene: Partial, answers: Sequence[Answer]) -> Count:
        """Counts of the intervals in some results of a scene, as `Partial.answer` returns them."""
        labels, truth = scene.labels(), scene.all_true_values()
        low, high = (np.stack([answer[k] for answer in answers]) for k in (1, 2))
        finite = np.isfinite(low) & np.isfinite(high)
        missed = finite & ~((low <= truth) & (truth <= high))
        n, determined = len(labels), np.isin(labels, scene.determined)
        chance = binom.sf(missed.sum(axis=0) - 1, finite.sum(axis=0), 0.05)
        return cls(
            finite=int(finite[:, :n].sum()),
            missed=int(missed[:, :n].sum()),
            wrong=int(finite[:, :n][:, ~determined].sum()),
            lost=int((~finite[:, :n][:, determined]).sum()),
            together=int(finite[:, n:].sum()),
            together_missed=int(missed[:, n:].sum()),
            unnamed=int((~finite[:, n:]).sum()),
            probability=float(chance.min()),
        )


HEAD = (
    *("scene", "runs", "finite intervals", "finite without the truth", "finite, not determined", "infinite, determined"),
    *("combinations", "combinations without the truth", "combinations not named", "least probability"),
)


def table(count: int, kept: Kept) -> Table:
    """Table of `count` identifications of each scene, each with other noise. `kept` is the store of finished runs."""
    all_scenes = scenes()
    rows = [
        Row(scene.name, tuple(scene.all_true_values()), scene.answer, count, first=k * SEEDS_OF_A_SCENE)
        for k, scene in enumerate(all_scenes)
    ]
    results = repeated(rows, kept)
    made = Table(*HEAD)
    for scene, (name, tally) in zip(all_scenes, results, strict=True):
        counted = Count.of(scene, tally.answers)
        *numbers, probability = (getattr(counted, each.name) for each in fields(Count))
        made.add(name, count, *numbers, f"{probability:.2g}")
    return made
