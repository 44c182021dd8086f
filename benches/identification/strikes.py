"""Online identification with contacts that begin and end: coverage of the 95 % intervals of `stepper.sysid.Tracker` over time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import stepper
from sections import Table

from identification.followed import Followed, followed
from identification.scenes import HARD, Scene, by_sensor, gripper, springy_finger

PERIOD = 0.02
START_STD = (1e-4, 1e-3)
"""Standard deviations of the true initial positions, m or rad, and velocities, m/s or rad/s. The tracker gets them as `start_std`."""
GUESS = 0.4
"""Standard deviation of log(initial value / true value) for the random initial values of the tracker's parameters.

The fixed initial values of the scenes (`Scene.starts`) deviate by a similar amount.
"""

STRUCK = springy_finger("struck box", stiffness=3000, damping=5)

THROWN = """<mujoco model="thrown box"><option timestep="0.002"/><worldbody>
  <geom name="floor" type="plane" size="5 5 .1" friction="{1}"/>
  <body name="plate" pos="0 0 .1"><joint name="plate" type="slide" axis="0 0 1" stiffness="400" springref=".0123" damping="2"/>
    <geom name="plate" type="box" size=".5 .1 .01" mass=".5" friction="{1}" contype="1" conaffinity="2"/></body>
  <body name="box" pos="-.3 0 .3"><joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>
    <geom name="box" type="box" size=".04 .04 .04" mass="{0}" friction="{1}" contype="2" conaffinity="1"/></body></worldbody>
  <sensor><jointpos name="x" joint="x"/><jointpos name="z" joint="z"/><jointpos name="plate" joint="plate"/></sensor></mujoco>"""

FLOOR, HEIGHT = '<geom name="floor" type="plane" size="2 2 .1"/>', '<jointpos name="height" joint="z"/>'
GRASPED = gripper("grasped box", arm=0.3, finger=(0.04, -0.19), damping=20, box=0.05, sensors=HEIGHT, floor=FLOOR)

STOPPED = """<mujoco model="pendulum against a stop"><option timestep="0.002"/><worldbody>
  <body name="arm" pos="0 0 1"><joint name="swing" axis="0 -1 0" damping=".02"/>
    <geom name="bob" type="sphere" pos="0 0 -.4" size=".03" mass="{0}" contype="1" conaffinity="2"/></body>
  <body name="stop" pos=".1 0 .6"><joint name="stop" type="slide" axis="1 0 0" stiffness="{1}" damping="4"/>
    <geom name="stop" type="box" size=".02 .05 .05" mass=".1" contype="2" conaffinity="1"/></body></worldbody>
  <actuator><motor joint="swing"/></actuator>
  <sensor><jointpos name="swing" joint="swing"/><jointpos name="stop" joint="stop"/></sensor></mujoco>"""


@dataclass(frozen=True, kw_only=True)
class Strike(Scene):
    """Scene of an identification with two unknown parameters, in which contacts begin and end (a strike).

    Attributes:
        spread: Half widths of the random variation of the true values, as logarithms.
        qvel: Initial velocities by joint.
        marks: Numbers of samples after which intervals are compared with the truth, each with the last event before that time.
    """

    spread: tuple[float, float] = (0.1, 0.05)
    qvel: dict[str, float] = field(default_factory=dict)
    marks: dict[int, str]

    def velocities(self, model: stepper.Model) -> np.ndarray[Any, Any]:
        """Initial velocities of all degrees of freedom of a model, (nv,), m/s or rad/s."""
        out = np.zeros(model.nv)
        for name, value in self.qvel.items():
            out[model.joint(name).dofadr] = value
        return out

    def draw(self, rng: np.random.Generator) -> np.ndarray[Any, Any]:
        """Random true values of the scene's two unknown parameters for one run, (2,), within the factor exp(`spread`) of `truth`."""
        return np.array(self.truth) * np.exp(np.array(self.spread) * rng.uniform(-1, 1, 2))

    def tracker(self, prior: float | None = None, **settings: Any) -> stepper.sysid.Tracker:
        """Create a tracker that estimates the scene's two unknown parameters, before its first sample.

        Args:
            prior: Standard deviation of the tracker's prior, divided by the initial values, which are the mean of the prior. With None the
                tracker uses its default prior.
            settings: Further arguments of `stepper.sysid.Tracker`.
        """
        start = self.starts[0]
        model = self.model(*start)
        known = [None if prior is None else (value, prior) for value in start]
        return stepper.sysid.Tracker(
            model,
            [stepper.sysid.FitParameter(name, prior=of) for name, of in zip(self.parameters, known, strict=True)],
            noise=self.noise,
            period=PERIOD,
            options=HARD,
            qvel=self.velocities(model),
            start_std=START_STD,
            **settings,
        )


def struck() -> Strike:
    """Create the scene of a box that a finger on a spring hits, releases, and hits again. Unknown: mass and friction."""
    t = np.arange(75) * PERIOD
    ctrl = 0.04 + 0.06 * t - 0.05 * np.cos(4 * np.pi * t)
    marks = {8: "hit", 9: "hit", 10: "pushed", 12: "released", 16: "slides", 30: "rests", 50: "hit again", 75: "hit a third time"}
    sought = ("body_mass[box]", "geom_friction[floor,box][0]")
    return Strike("struck box", STRUCK, (1.3, 0.35), sought, ctrl[:, None], {"wrist_force": 0.3, "box_x": 5e-4}, ((1.0, 0.5),), marks=marks)


def thrown() -> Strike:
    """Create the scene of a box with a sideways velocity that bounces on a plate on a spring. Unknown: mass and friction."""
    noise = {"x": 1e-3, "z": 1e-3, "plate": 5e-4}
    marks = {9: "falls on the plate", 10: "slides", 11: "slides", 13: "sticks", 17: "rises"}
    marks |= {25: "falls on it again", 40: "rides", 60: "rides"}
    sought, start = ("body_mass[box]", "geom_friction[plate,box][0]"), (0.6, 0.5)
    return Strike("thrown box", THROWN, (0.4, 0.3), sought, np.zeros((60, 0)), noise, (start,), qvel={"x": 0.5}, marks=marks)


def grasped() -> Strike:
    """Create the scene of a box that two fingers grasp, lift, shake until it slips, and release. Unknown: mass and friction."""
    t = np.arange(90) * PERIOD
    ramp = np.clip((t - 0.5) / 0.3, 0, 1)
    lift = 0.05 * ramp + 0.02 * np.sin(2 * np.pi * 3.0 * (t - 0.8)) * (t > 0.8)
    squeeze = np.where(t < 0.2, -1.0, np.where(t < 1.5, 12.0, -3.0))
    ctrl, noise = np.stack([lift, squeeze, squeeze], axis=1), {"wrist_force": 0.3, "height": 5e-4}
    marks = {15: "grasped", 28: "lifted", 32: "lifted", 40: "lifted", 50: "slips", 75: "slips", 90: "released and fallen"}
    sought = ("body_mass[box]", "geom_friction[left,right,box][0]")
    return Strike("grasped box", GRASPED, (0.8, 0.45), sought, ctrl, noise, ((0.5, 0.6),), marks=marks)


def stopped() -> Strike:
    """Create the scene of a motorised pendulum that hits a stop on a spring. Unknown: mass and stiffness of the spring."""
    ctrl = 0.8 + 0.4 * np.sin(2 * np.pi * 1.5 * np.arange(75)[:, None] * PERIOD)
    noise, sought = {"swing": 2e-3, "stop": 2e-4}, ("body_mass[arm]", "jnt_stiffness[stop]")
    marks = {5: "swings", 7: "swings", 9: "hits the stop", 12: "bounces", 18: "bounces", 30: "hits again", 50: "rests", 75: "rests"}
    starts = ((0.8, 1000.0),)
    return Strike("pendulum against a stop", STOPPED, (0.5, 600.0), sought, ctrl, noise, starts, spread=(0.1, 0.1), marks=marks)


STRIKES = (struck, thrown, grasped, stopped)


def readings(scene: Strike, truth: Any, rng: np.random.Generator) -> dict[str, np.ndarray[Any, Any]]:
    """Noisy sensor readings by channel, (T, dim) each, of a run with the given true values from a perturbed start."""
    model = scene.model(*truth)
    sim = stepper.Stepper(model, options=HARD)
    shift = START_STD[0] * rng.standard_normal(model.nv)
    if "z" in model.joint_names:  # A box that may rest on the floor at the start is perturbed away from it only.
        shift[model.joint("z").dofadr] = np.abs(shift[model.joint("z").dofadr])
    qvel = scene.velocities(model) + START_STD[1] * rng.standard_normal(model.nv)
    sim.set_state(model.integrate_pos(model.qpos0, shift), qvel)
    made = sim.rollout(scene.ctrl, round(PERIOD / sim.timestep), fields=("sensordata",))["sensordata"]
    clean = by_sensor(model, made, scene.noise)
    return {name: rows + scene.noise[name] * rng.standard_normal(rows.shape) for name, rows in clean.items()}


def follow(scene: Strike, seed: int, **settings: Any) -> Followed:
    """Run a tracker on a scene with the noise of a seed, and return the results. `settings` are arguments of the tracker."""
    rng = np.random.default_rng(seed)
    truth = scene.draw(rng)
    noisy = readings(scene, truth, rng)
    return followed(scene.tracker(**settings), scene.ctrl, noisy, dict.fromkeys(scene.marks, truth))


def follow_matched(scene: Strike, seed: int) -> Followed:
    """Run a tracker on a scene so that the tracker's assumptions hold, and return the results.

    The tracker's initial values are drawn from its prior, and the true parameters are constant.
    """
    truth = scene.draw(np.random.default_rng(seed))
    guess = truth * np.exp(GUESS * np.random.default_rng([seed, 1]).standard_normal(2))
    return follow(replace(scene, starts=((float(guess[0]), float(guess[1])),)), seed, prior=GUESS, drift=0.0)


NAMES = {"body_mass": "mass", "geom_friction": "friction", "jnt_stiffness": "stiffness"}
"""Names of the parameters in the table, by model field."""


def table(count: int, run: Callable[[Strike, int], Followed] = follow) -> Table:
    """Table of `count` runs of each scene by `follow` or `follow_matched`.

    Errors, interval widths and coverage are over the runs in which the tracker marks the parameter as determined.
    """
    made = Table("scene", "after", "last event", "parameter", "error", "interval", "determined", "coverage")
    for make in STRIKES:
        scene = make()
        runs = [run(scene, seed) for seed in range(count)]
        for k, (mark, what) in enumerate(scene.marks.items()):
            for j, parameter in enumerate(scene.parameters):
                cells = ("-", "-", "0 %", "-")
                if determined := [each for each in runs if each.determined[k, j]]:
                    error = np.sqrt(np.mean([each.error[k, j] ** 2 for each in determined]))
                    width = np.median([each.width[k, j] for each in determined])
                    share, covers = len(determined) / count, np.mean([each.covers[k, j] for each in determined])
                    cells = (f"{100 * error:.2g} %", f"{100 * width:.2g} %", f"{100 * share:.0f} %", f"{100 * covers:.1f} %")
                made.add(scene.name, f"{mark * PERIOD:.2f} s", what, NAMES[parameter.partition("[")[0]], *cells)
    return made
