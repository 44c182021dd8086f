"""Base of the tasks of dm_control's suite: models, `tolerance` for rewards, and random initial poses."""

from __future__ import annotations

from collections.abc import Callable, Set
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar
from xml.etree import ElementTree

import numpy as np

from stepper._options import Options
from stepper._stepper import Joint, Model, Stepper
from stepper.envs.assets import cache_model, cache_per_model, load_quietly, remove_elements
from stepper.envs.observations import Observation
from stepper.envs.task import Array, Reset, Task, TaskView, Terms
from stepper.shared.machine import package_file
from stepper.shared.rotations import matrices
from stepper.shared.streams import Rng
from stepper.shared.view import per_moment


@dataclass(frozen=True, kw_only=True)
class SuiteTask(Task):
    """Task of dm_control's suite (Tassa et al. 2018, https://arxiv.org/abs/1801.00690), with MuJoCo's contact law by default. Abstract.

    Observations are the entries of dm_control's observations, concatenated. Observations and rewards use positions and velocities of bodies
    in the state after the step, as in dm_control. Only episodes of `LQR` terminate.
    """

    contact = "mujoco"
    file: ClassVar[str]
    """Name of the task's model file in dm_control's suite."""
    episode_steps: ClassVar[int | None] = 1000
    """Number of actions per episode: dm_control's time limit divided by the time per action. None means no limit."""

    def model(self) -> Model:
        """Model of the scene, loaded once from the file that the attribute `file` names."""
        return scene(self.file)

    def reward(self, now: TaskView) -> tuple[Array, Terms]:
        """Reward, (num_envs,): `score`, from 0 to 1 except for `LQR`, and no entries for the info dict."""
        return self.score(now), {}

    def score(self, now: TaskView) -> Array:
        """dm_control's reward, (num_envs,)."""
        raise NotImplementedError


SLIDES = (
    Observation("position", func=lambda now: now.qpos, unit="m"),
    Observation("velocity", func=lambda now: now.qvel, unit="m/s"),
)
"""Observations of models whose joints are slides: positions, (nq,), and velocities, (nv,)."""


@cache_model
def scene(file: str) -> Model:
    """Model of a file of dm_control's suite.

    Raises:
        MissingPackageError: dm_control is not installed.
    """
    return load_quietly(package_file("dm_control", f"suite/{file}", "for tasks of its suite, whose models it has"))


def source_tree(file: str) -> ElementTree.Element:
    """XML tree of a file of dm_control's suite, without elements that only affect rendering.

    Raises:
        MissingPackageError: dm_control is not installed.
    """
    path = package_file("dm_control", f"suite/{file}", "for tasks of its suite, whose models it has")
    tree = ElementTree.fromstring(Path(path).read_text("utf-8"))
    for include in tree.findall("include"):
        tree.remove(include)
    for element in tree.iter():
        element.attrib.pop("material", None)
    return tree


def open_floor(tree: ElementTree.Element, half_side: float, ball: Set[tuple[str, str]]) -> ElementTree.Element:
    """Removes the walls and the ball from a scene, and sets the size of the floor.

    Args:
        tree: MJCF tree of the scene, which is changed.
        half_side: Half side of the floor, m.
        ball: Tag and name of each element that belongs to the ball.
    """
    for floor in tree.iterfind(".//geom[@name='floor']"):
        floor.set("size", f"{half_side!r} {half_side!r} {floor.get('size', '').split()[2]}")
    return remove_elements(tree, lambda element: element.get("name", "").startswith("wall_") or (element.tag, element.get("name")) in ball)


@cache_per_model
def hinges(model: Model) -> tuple[Joint, ...]:
    """Hinge joints of a model, in order."""
    return tuple(joint for joint in map(model.joint, range(model.njnt)) if joint.type == "hinge")


@per_moment
def rotations(now: TaskView) -> Array:
    """Rotation matrices of the bodies (MuJoCo's xmat), (num_envs, nbody, 3, 3)."""
    return matrices(now.xquat)


def rotation(now: TaskView, body: str) -> Array:
    """Rotation matrix of a body by name: (num_envs, 3, 3)."""
    matrix: Array = rotations(now)[:, now.sim.model.body(body).id]
    return matrix


def reading(now: TaskView, *sensors: str) -> Array:
    """Concatenated ideal readings of the named sensors, (num_envs, n), in their units."""
    values: Array = now.sensordata_ideal.take(_columns(now.model, *sensors), axis=1)
    return values


@cache_per_model
def _columns(model: Model, *sensors: str) -> Array:
    """Columns of the readings of the named sensors."""
    return np.concatenate([np.arange(sensor.adr, sensor.adr + sensor.dim) for sensor in map(model.sensor, sensors)])


def norm(vectors: Array) -> Array:
    """Norms of vectors (num_envs, n): (num_envs,), in the same unit."""
    lengths: Array = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
    return lengths


_DECREASES: dict[str, Callable[[Array, float], Array]] = {
    "gaussian": lambda x, value: np.exp(np.log(value) * x * x),
    "linear": lambda x, value: np.maximum(1.0 - (1.0 - value) * x, 0.0),
    "quadratic": lambda x, value: np.maximum(1.0 - (1.0 - value) * x * x, 0.0),
    "reciprocal": lambda x, value: 1.0 / ((1.0 / value - 1.0) * x + 1.0),
    "long_tail": lambda x, value: 1.0 / ((1.0 / value - 1.0) * x * x + 1.0),
}
"""Decreasing functions of (x, value) by name, which are 1 at x = 0 and `value` at x = 1."""


def tolerance(
    x: Array,
    low: float | Array = 0.0,
    high: float | Array = 0.0,
    *,
    margin: float | Array = 0.0,
    fall: str = "gaussian",
    value: float = 0.1,
) -> Array:
    """Scores, (...), of numbers x: 1 within bounds, decreasing towards 0 outside. The function is dm_control's `rewards.tolerance`.

    Args:
        x: Numbers, (...), in any unit.
        low: Lower bound, in the unit of x.
        high: Upper bound, in the unit of x.
        margin: Distance from the bounds at which the score is `value`; 0 makes the score 0 outside the bounds.
        fall: Shape of the decrease: "gaussian", "linear", "quadratic", "reciprocal" or "long_tail".
        value: Score at the margin.
    """
    inside = (low <= x) & (x <= high)
    if np.all(np.asarray(margin) == 0.0):
        return inside.astype(np.float64)
    distance = np.where(x < low, low - x, x - high) / margin
    reward: Array = np.where(inside, 1.0, _DECREASES[fall](distance, value))
    return reward


def small_control(now: TaskView) -> Array:
    """Score of small controls, (num_envs,): mean over the actuators of max(0, 1 - control^2)."""
    mean: Array = tolerance(now.action, margin=1.0, fall="quadratic", value=0.0).mean(axis=1)
    return mean


def randomize_joints(model: Model, qpos: Array, rng: Rng) -> None:
    """Draws random joint positions into qpos, (n, nq), m and rad: limited joints within their limits, other hinges from -pi to pi.

    Quaternions of free joints get positive components only, as in dm_control. Slides without limits keep their position.
    """
    for joint in (model.joint(k) for k in range(model.njnt)):
        at = joint.qposadr
        if joint.type in ("hinge", "slide"):
            low, high = joint.range if joint.limited else (-np.pi, np.pi)
            if joint.limited or joint.type == "hinge":
                qpos[:, at : at + 1] = rng.uniform(low, high, 1)
        elif joint.type == "free":
            quat = rng.uniform(0.0, 1.0, 4)
            qpos[:, at + 3 : at + 7] = quat / norm(quat)[:, None]
        else:
            raise NotImplementedError(
                f"joint {joint.name!r} is a ball joint, for which no random positions are defined: use hinges, slides or free joints"
            )


def randomize_without_overlap(
    model: Model, qpos: Array, rng: Rng, randomize: Callable[[Model, Array, Rng], None] = randomize_joints
) -> None:
    """Draws random joint positions into qpos, (n, nq), m and rad, with the function `randomize`, until no geoms overlap.

    The function is called again for those of the n configurations in which geoms overlap.
    """
    again = np.ones(len(qpos), dtype=bool)
    while again.any():
        some = qpos[again]
        randomize(model, some, rng.of(again))
        qpos[again] = some
        again[again] = overlapping(model, some)


def lift_until_free(model: Model, qpos: Array, height: int) -> None:
    """Sets the column `height` of qpos, (n, nq), m, to the smallest whole number of centimetres, up to 127, at which no geoms overlap.

    It assumes that geoms which overlap at a height also overlap at all lower heights.
    """
    low = np.zeros(len(qpos), dtype=np.int64)
    for step in (64, 32, 16, 8, 4, 2, 1):
        qpos[:, height] = 0.01 * (low + step - 1)
        low[overlapping(model, qpos)] += step
    qpos[:, height] = 0.01 * low


def overlapping(model: Model, qpos: Array, mocap_pos: Array | None = None, mocap_quat: Array | None = None) -> Array:
    """Whether any geoms of a model overlap in configurations qpos (n, nq), m and rad: (n,) bool.

    `mocap_pos` (n, nmocap, 3), m, and `mocap_quat` (n, nmocap, 4) are poses of the mocap bodies; None means those of the model.
    """
    probe = Stepper(model, len(qpos), options=Options(contact="mujoco", integrator="euler"))
    probe.reset(qpos=qpos)
    if mocap_pos is not None:
        probe.mocap_pos[...] = mocap_pos
    if mocap_quat is not None:
        probe.mocap_quat[...] = mocap_quat
    probe.step()
    contacts = probe.contacts()
    touching = np.zeros(len(qpos), dtype=bool)
    touching[contacts["env"][contacts["distance"] < 0.0]] = True
    return touching


def settle(reset: Reset, steps: int) -> None:
    """Replaces initial states by those after a number of time steps without controls, which begin at rest."""
    sim = reset.sim
    probe = Stepper(sim.model, len(reset.envs), options=sim.options, precision=sim.precision)
    probe.reset(qpos=reset.qpos)
    probe.step(nstep=steps)
    reset.qpos, reset.qvel = probe.qpos, probe.qvel
