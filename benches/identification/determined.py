"""Scenes whose data determine only a part of the parameters, or only combinations of them.

The determined values and combinations follow from the equations of motion. `identify` must give finite intervals to no other values.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
import stepper

from identification.scenes import HARD

Array = np.ndarray[Any, Any]
Truth: TypeAlias = "dict[str, dict[Any, Any]]"
PERIOD = 0.02
"""Time between controls, s."""
T = np.arange(60) * PERIOD
"""Times at which the control periods begin, s."""


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
        return stepper.sysid.identify(self.model(), [self.episode(seed)], self.parameters, starts=starts, seed=seed, threads=1)

    def true_values(self, labels: Sequence[str]) -> Array:
        """True values by label, (n,)."""
        model = self.true_model()
        return np.array([_value(model, label, self.factors) for label in labels])


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
    if kind == "sensor.scale":
        return factors[name]
    if kind == "actuator_gainprm":
        return float(model.actuator_gainprm[model.actuator(name).id, 0])
    return float(getattr(model.joint(name), kind.removeprefix("dof_")))


SWEEP = np.stack([np.sin(4 * T) + 0.5 * np.sin(9 * T + 1)], axis=1)
TWO_SWEEPS = np.stack([np.sin(4 * T) + 0.5 * np.sin(9 * T + 1), np.cos(5 * T) + 0.5 * np.sin(8 * T)], axis=1)
PENDULUM = """<mujoco><option timestep="0.005"/><worldbody><body name="a"><joint name="q" axis="0 1 0" damping="0.02"/>
  <inertial pos="0.02 0 -0.25" mass="0.5" diaginertia="0.004 0.0045 0.002"/></body></worldbody>
  <actuator><motor name="m" joint="q" gear="0.5"/></actuator><sensor><jointpos name="q" joint="q"/></sensor></mujoco>"""
LIGHT = """<mujoco><option timestep="0.005"/><worldbody><body name="a"><joint name="q" axis="0 1 0" damping="0.02"/>
  <geom type="sphere" size="0.05" pos="0.05 0 -0.3" mass="0.45"/></body></worldbody>
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
THREE = ("body_mass[{}]", "body_ipos[{}]", "body_inertia[{}]")
ENCODER = {"q": 2e-3}


def _of_body(name: str) -> tuple[str, ...]:
    """Selectors of mass, centre of mass and inertia of a body."""
    return tuple(text.format(name) for text in THREE)


def _swing(name: str, source: str, parameters: tuple[str, ...]) -> Partial:
    """Pendulum with an encoder, of which the data determine the first moments and the moment of inertia about the joint alone."""
    truth: Truth = {"body_mass": {1: 0.7}, "body_ipos": {1: (0.03, 0.0, -0.3)}, "body_inertia": {1: (0.006, 0.0065, 0.003)}}
    known = {
        "body_mass[a] * body_ipos[a][0]": 0.7 * 0.03,
        "body_mass[a] * body_ipos[a][2]": 0.7 * -0.3,
        "Iyy[a] about joint q": 0.0065 + 0.7 * (0.03**2 + 0.3**2),
    }
    return Partial(name, source, truth, parameters, (), known, SWEEP, ENCODER)


def scenes() -> list[Partial]:
    """All scenes. The last one is fully determined."""
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
    damping = ("dof_damping[q]", "dof_damping[r]", "body_mass[b]")
    return [
        _swing("pendulum, three parts", PENDULUM, _of_body("a")),
        _swing("pendulum, small ball", LIGHT, _of_body("a")),
        _swing("pendulum, pseudo-inertia", PENDULUM, ("body_inertial[a]",)),
        Partial("pendulum, shape known", PENDULUM, centre, ("body_mass[a]", "body_ipos[a]"), plane, {}, SWEEP, ENCODER),
        Partial("bodies in series", SLIDE, {"body_mass": {1: 1.0, 2: 0.7}}, ("body_mass[a]", "body_mass[b]"), (), series, SWEEP,
                {"q": 1e-3}),
        Partial("friction and damping at one speed", ONE_SPEED, {"dof_damping": {0: 1.3}, "dof_frictionloss": {0: 0.4}},
                ("dof_damping[q]", "dof_frictionloss[q]"), (), {}, np.full((60, 1), 0.4), {"q": 1e-3, "f": 0.02}, (0.4,)),
        Partial("gain and scale", SLIDE, gain_truth, gain_parameters, (), gains, SWEEP, {"q": 1e-3, "f": 0.02}, factors={"f": 1.2}),
        Partial("payload on a slide", SLIDE, {"body_mass": {2: 0.7}}, ("body_inertial[b]",), ("body_inertial[b].mass",), {}, SWEEP,
                {"q": 1e-3}),
        Partial("two links", LINKS, link_truth, (*_of_body("a"), *_of_body("b")), (), links, TWO_SWEEPS, {"qpos": 2e-3}),
        Partial("two links, fully determined", LINKS, {"dof_damping": {0: 0.07, 1: 0.05}}, damping, damping, {}, TWO_SWEEPS,
                {"qpos": 2e-3}),
    ]  # fmt: skip


@dataclass
class Count:
    """Counts of the intervals in repeated identifications.

    Attributes:
        finite: Number of finite intervals.
        missed: Number of finite intervals without the true value.
        wrong: Number of finite intervals of values that are not determined.
        lost: Number of infinite intervals of values that are determined.
        together: Number of intervals of combinations.
        together_missed: Number of intervals of combinations without the true value.
        unnamed: Number of determined combinations that the result does not name.
    """

    finite: int = 0
    missed: int = 0
    wrong: int = 0
    lost: int = 0
    together: int = 0
    together_missed: int = 0
    unnamed: int = 0

    def add(self, scene: Partial, found: stepper.sysid.Identification) -> None:
        """Adds the intervals of a result."""
        truth = scene.true_values(found.labels)
        for label, value, known, (low, high) in zip(found.labels, truth, found.determined, found.interval(), strict=True):
            finite = bool(known) and bool(np.isfinite([low, high]).all())
            self.finite += finite
            self.missed += finite and not low <= value <= high
            self.wrong += finite and label not in scene.determined
            self.lost += label in scene.determined and not finite
        named = {c.text: c.interval for c in getattr(found, "combinations", ())}
        for text, value in scene.combinations.items():
            if text not in named:
                self.unnamed += 1
                continue
            low, high = named[text]
            self.together += 1
            self.together_missed += not low <= value <= high


HEAD = (
    "scene | runs | finite intervals | finite without the truth | finite, not determined | infinite, determined | "
    "combinations | combinations without the truth | combinations not named"
)


def table(count: int) -> str:
    """Markdown table of `count` identifications of each scene, which is also printed."""
    lines = [f"| {HEAD} |", "|" + "---|" * (HEAD.count("|") + 1)]
    print("\n".join(lines), flush=True)
    for scene in scenes():
        total = Count()
        for seed in range(count):
            total.add(scene, scene.identified(seed))
        counts = (total.finite, total.missed, total.wrong, total.lost, total.together, total.together_missed, total.unnamed)
        lines.append(f"| {scene.name} | {count} | " + " | ".join(map(str, counts)) + " |")
        print(lines[-1], flush=True)
    return "\n".join(lines)
