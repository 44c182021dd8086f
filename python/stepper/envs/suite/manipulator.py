"""dm_control's planar manipulator: an arm with a hand that brings a ball or a peg to a target, or puts it into a receptacle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stepper._stepper import Model, Stepper
from stepper.envs.assets import read_once
from stepper.envs.streams import Rng
from stepper.envs.suite.arm import arm_observations, arm_scene, draw_arm, pose
from stepper.envs.suite.base import SuiteTask, norm, overlapping, place, tolerance
from stepper.envs.task import Array, Moment, Observation, Terms
from stepper.shared.rotations import matrices

_PROPS = {"ball", "target_ball", "cup", "peg", "target_peg", "slot"}
_CLOSE = 0.01
"""Distance that is close, m."""
_IN_HAND, _IN_TARGET = 0.1, 0.1
"""Probabilities that the object begins in the hand, and in the target."""


@dataclass(frozen=True, kw_only=True)
class Manipulator(SuiteTask):
    """Bring an object to a target. Targets and receptacles are mocap bodies: each environment has them elsewhere.

    Attributes:
        peg: Whether the object is a peg; a ball otherwise.
        insert: Whether the target is in a receptacle: a slot, or a cup.
    """

    file = "manipulator.xml"
    frame_skip: int = 10
    peg: bool = False
    insert: bool = False

    @property
    def _object(self) -> str:
        return "peg" if self.peg else "ball"

    def model(self) -> Model:
        """Scene with the objects of this task."""
        return _scene(self.peg, self.insert)

    def observations(self) -> tuple[Observation, ...]:
        """Arm and hand, touch sensors, the object and the target: (44,)."""
        thing = self._object
        return (
            *arm_observations(),
            Observation("object_pos", func=lambda now: pose(now, thing), unit="m"),
            Observation(
                "object_vel", func=lambda now: now.qvel[:, [now.sim.model.joint(f"{thing}_{k}").dofadr for k in "xzy"]], unit="m/s, rad/s"
            ),
            Observation("target_pos", func=lambda now: pose(now, f"target_{thing}"), unit="m"),
        )

    def score(self, now: Moment) -> Array:
        """Score: the object at the target; for a peg, also the hand in its grasp pose."""
        if not self.peg:
            return _near(now, "ball", "target_ball")
        grasping = (_near(now, "peg_grasp", "grasp") + _near(now, "peg_pinch", "pinch")) / 2.0
        bringing = (_near(now, "peg", "target_peg") + _near(now, "peg_tip", "target_peg_tip")) / 2.0
        reward: Array = np.maximum(bringing, grasping / 3.0)
        return reward

    def on_reset(self, sim: Stepper, episode_state: Terms, mask: Array, rng: Rng) -> None:
        """The arm anywhere, the target anywhere, the object in the hand, in the target, or anywhere in flight: where nothing touches."""
        model, count = sim.model, len(rng.envs)
        qpos, qvel = np.tile(model.qpos0, (count, 1)), np.zeros((count, model.nv))
        target = np.zeros((count, 3))
        again = np.ones(count, dtype=bool)
        while again.any():
            some, rates = qpos[again], qvel[again]
            target[again] = self._draw(model, some, rates, rng.of(again))
            qpos[again], qvel[again] = some, rates
            again[again] = overlapping(model, some, *_posed(model, target[again]))
        place(sim, mask, qpos, qvel)
        sim.mocap_pos[mask], sim.mocap_quat[mask] = _posed(model, target)

    def _draw(self, model: Model, qpos: Array, qvel: Array, rng: Rng) -> Array:
        """Draws a configuration, changed in place, and the target's x, z and angle, (n, 3)."""
        draw_arm(model, qpos, rng)
        widest = np.pi / 3.0 if self.insert else np.pi
        target = np.hstack([rng.uniform(-0.4, 0.4, 1), rng.uniform(0.1, 0.4, 1), rng.uniform(-widest, widest, 1)])
        kind = rng.uniform(0.0, 1.0, 1)[:, 0]
        in_hand, in_target = kind < _IN_HAND, (kind >= _IN_HAND) & (kind < _IN_HAND + _IN_TARGET)
        thing = np.hstack([rng.uniform(-0.5, 0.5, 1), rng.uniform(0.0, 0.7, 1), rng.uniform(0.0, 2.0 * np.pi, 1)])
        speed = rng.uniform(-5.0, 5.0, 1)[:, 0]
        thing[in_target] = target[in_target]
        if in_hand.any():
            thing[in_hand] = _grasp(model, qpos[in_hand])
        flies = ~(in_hand | in_target)
        qvel[flies, model.joint(f"{self._object}_x").dofadr] = speed[flies]
        qpos[:, [model.joint(f"{self._object}_{k}").qposadr for k in "xzy"]] = thing
        return target


def _near(now: Moment, one: str, other: str) -> Array:
    """Score of the distance of two sites, (num_envs,): 1 when close, decreasing with the distance."""
    places = [now.site_xpos[:, now.sim.model.site(name).id] for name in (one, other)]
    return tolerance(norm(places[0] - places[1]), 0.0, _CLOSE, margin=2.0 * _CLOSE)


def _grasp(model: Model, qpos: Array) -> Array:
    """Grasp pose of the hand of configurations (n, nq): x, z and angle, (n, 3)."""
    probe, site = Stepper(model, len(qpos)), model.site("grasp").id
    probe.reset(qpos=qpos)
    across = matrices(np.asarray(probe.site_xquat)[:, site])[:, :, 0]
    return np.column_stack([np.asarray(probe.site_xpos)[:, site, ::2], np.pi - np.arctan2(across[:, 2], across[:, 0])])


def _posed(model: Model, target: Array) -> tuple[Array, Array]:
    """Poses of the mocap bodies, all of which are at the target (n, 3): places (n, nmocap, 3) and quaternions (n, nmocap, 4)."""
    bodies = [body for body in map(model.body, range(model.nbody)) if body.mocapid >= 0]
    place, quat = np.zeros((len(target), len(bodies), 3)), np.zeros((len(target), len(bodies), 4))
    for body in bodies:
        # Those across the plane are the file's own.
        place[:, body.mocapid] = np.column_stack([target[:, 0], np.full(len(target), body.pos[1]), target[:, 1]])
        quat[:, body.mocapid, 0], quat[:, body.mocapid, 2] = np.cos(target[:, 2] / 2.0), np.sin(target[:, 2] / 2.0)
    return place, quat


@read_once
def _scene(peg: bool, insert: bool) -> Model:
    """The file with the props of a task alone, of which those that it places are mocap bodies."""
    placed = {"target_peg" if peg else "target_ball"} | ({"slot" if peg else "cup"} if insert else set())
    return arm_scene(Manipulator.file, unused=_PROPS - placed - {"peg" if peg else "ball"}, placed=placed)
