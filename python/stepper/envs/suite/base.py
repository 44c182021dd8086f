"""Base of the tasks of dm_control's suite: their models, rewards that fall off outside a range, and random poses."""

from __future__ import annotations

from collections.abc import Callable, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar
from xml.etree import ElementTree

import numpy as np

from stepper._options import Options
from stepper._stepper import Joint, Model, Stepper
from stepper.envs.assets import load_quietly, once_per_model, read_once, without
from stepper.envs.streams import Rng
from stepper.envs.task import Array, Moment, Task, Terms, per_moment
from stepper.shared.machine import package_file
from stepper.shared.rotations import matrices


@dataclass(frozen=True, kw_only=True)
class SuiteTask(Task):
    """A task of dm_control's suite (Tassa et al. 2018, https://arxiv.org/abs/1801.00690), under MuJoCo's law by default.

    Observations are the entries of dm_control's, one after the other. What they have of bodies is that of the present state: dm_control,
    too, evaluates the state after a step before it observes. No episode terminates but those of `LQR`.
    """

    contact = "mujoco"
    file: ClassVar[str]
    """Model of the task, a file of dm_control's."""
    episode_steps: ClassVar[int | None] = 1000
    """Actions of an episode: dm_control's time limit over its time step of control. None is no limit."""

    def model(self) -> Model:
        """The scene of the file, which is read once."""
        return scene(self.file)

    def reward(self, now: Moment) -> tuple[Array, Terms]:
        """From 0 to 1, but for `LQR`."""
        return self.score(now), {}

    def score(self, now: Moment) -> Array:
        """dm_control's reward, (num_envs,)."""
        raise NotImplementedError


@read_once
def scene(file: str) -> Model:
    """The model of a file of dm_control's suite.

    Raises:
        MissingPackageError: dm_control is not installed.
    """
    return load_quietly(package_file("dm_control", f"suite/{file}", "for tasks of its suite, whose models it has"))


def source_tree(file: str) -> ElementTree.Element:
    """A file of dm_control's suite to be added to, without what it only looks like.

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
    """A file's arena without its walls and what is there for its ball, by tag and name, on a floor of that half side, m."""
    for floor in tree.iterfind(".//geom[@name='floor']"):
        floor.set("size", f"{half_side!r} {half_side!r} {floor.get('size', '').split()[2]}")
    return without(tree, lambda element: element.get("name", "").startswith("wall_") or (element.tag, element.get("name")) in ball)


@once_per_model
def hinges(model: Model) -> tuple[Joint, ...]:
    """The hinges of a model, in its order."""
    return tuple(joint for joint in map(model.joint, range(model.njnt)) if joint.type == "hinge")


@per_moment
def rotations(now: Moment) -> Array:
    """MuJoCo's xmat: rotation matrices of the bodies, (num_envs, nbody, 3, 3)."""
    return matrices(now.xquat)


def rotation(now: Moment, body: str) -> Array:
    """Rotation matrix of a body: (num_envs, 3, 3)."""
    matrix: Array = rotations(now)[:, now.sim.model.body(body).id]
    return matrix


def reading(now: Moment, *sensors: str) -> Array:
    """Readings of sensors, one after the other: (num_envs, n)."""
    found = [now.sim.model.sensor(name) for name in sensors]
    return np.concatenate([now.sensordata_ideal[:, sensor.adr : sensor.adr + sensor.dim] for sensor in found], axis=1)


def norm(vectors: Array) -> Array:
    """Lengths of vectors (num_envs, n): (num_envs,)."""
    lengths: Array = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
    return lengths


_FALLS: dict[str, Callable[[Array, float], Array]] = {
    "gaussian": lambda x, value: np.exp(np.log(value) * x * x),
    "linear": lambda x, value: np.maximum(1.0 - (1.0 - value) * x, 0.0),
    "quadratic": lambda x, value: np.maximum(1.0 - (1.0 - value) * x * x, 0.0),
    "reciprocal": lambda x, value: 1.0 / ((1.0 / value - 1.0) * x + 1.0),
    "long_tail": lambda x, value: 1.0 / ((1.0 / value - 1.0) * x * x + 1.0),
}
"""Functions that are 1 at 0 and `value` at 1."""


def tolerance(
    x: Array,
    low: float | Array = 0.0,
    high: float | Array = 0.0,
    *,
    margin: float | Array = 0.0,
    fall: str = "gaussian",
    value: float = 0.1,
) -> Array:
    """dm_control's `rewards.tolerance`: 1 where a number lies within bounds, and less outside.

    Args:
        x: Numbers.
        low: Lower bound.
        high: Upper bound.
        margin: Distance from the bounds at which it is `value`; with 0 it is 0 everywhere outside the bounds.
        fall: How it falls: "gaussian", "linear", "quadratic", "reciprocal" or "long_tail".
        value: At the margin.
    """
    inside = (low <= x) & (x <= high)
    if np.all(np.asarray(margin) == 0.0):
        return inside.astype(np.float64)
    beside = np.where(x < low, low - x, x - high) / margin
    reward: Array = np.where(inside, 1.0, _FALLS[fall](beside, value))
    return reward


def small_control(now: Moment) -> Array:
    """Mean over the actuators of what is 1 without control and 0 at 1: (num_envs,)."""
    mean: Array = tolerance(now.action, margin=1.0, fall="quadratic", value=0.0).mean(axis=1)
    return mean


def randomize_joints(model: Model, qpos: Array, rng: Rng) -> None:
    """Draws hinges and slides within their limits, hinges without any from the whole circle, and orientations; changes qpos (n, nq).

    Orientations of free bodies have positive numbers alone, as dm_control draws them; slides without limits stay.
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
            raise NotImplementedError(f"joint {joint.name!r} is a ball: no task of the suite that is here has one")


def randomize_without_overlap(
    model: Model, qpos: Array, rng: Rng, randomize: Callable[[Model, Array, Rng], None] = randomize_joints
) -> None:
    """Draws configurations (n, nq) as `randomize` does, which changes them in place, again and again until nothing touches."""
    again = np.ones(len(qpos), dtype=bool)
    while again.any():
        some = qpos[again]
        randomize(model, some, rng.of(again))
        qpos[again] = some
        again[again] = overlapping(model, some)


def lift_until_free(model: Model, qpos: Array, height: int) -> None:
    """Sets a coordinate of qpos (n, nq), a height, to the least whole number of centimetres, up to 127, at which nothing touches.

    What touches at a height must touch below, too.
    """
    low = np.zeros(len(qpos), dtype=np.int64)
    for step in (64, 32, 16, 8, 4, 2, 1):
        qpos[:, height] = 0.01 * (low + step - 1)
        low[overlapping(model, qpos)] += step
    qpos[:, height] = 0.01 * low


def overlapping(model: Model, qpos: Array, mocap_pos: Array | None = None, mocap_quat: Array | None = None) -> Array:
    """Whether anything touches in configurations (n, nq), with mocap bodies where they are posed or the file has them: (n,) bool."""
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


def settle(sim: Stepper, mask: Array, steps: int) -> None:
    """Makes steps without control of the environments of a mask alone."""
    probe = Stepper(sim.model, int(mask.sum()), options=sim.options, precision=sim.precision)
    probe.reset(qpos=sim.qpos[mask])
    probe.step(nstep=steps)
    place(sim, mask, probe.qpos, probe.qvel)


def place(sim: Stepper, mask: Array, qpos: Array, qvel: Array) -> None:
    """Sets states (n, nq), (n, nv) of the n environments of a mask."""
    all_qpos, all_qvel = np.array(sim.qpos, dtype=np.float64), np.array(sim.qvel, dtype=np.float64)
    all_qpos[mask], all_qvel[mask] = qpos, qvel
    sim.set_state(all_qpos, all_qvel, mask)


def move_geom(sim: Stepper, mask: Array, geom: str, pos: Array, columns: Any = slice(None)) -> None:
    """Gives the environments of a mask a separate place for a geom: coordinates (n, ...) of its body's frame, m."""
    places = np.array(sim.randomized.get("geom_pos", np.tile(sim.model.geom_pos, (sim.num_envs or 1, 1, 1))))
    chosen = places[mask]
    chosen[:, sim.model.geom(geom).id, columns] = pos
    places[mask] = chosen
    sim.randomize(mask, geom_pos=places)
