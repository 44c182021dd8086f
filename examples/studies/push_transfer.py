"""Parameters of a UR5e, a box and a camera that the end of a push depends on, for `stepper calibrate`.

The arm, robosuite's (`pip install --no-deps robosuite`), pushes a box with a ball at its flange, and stops when a camera sees the box at
a line. The box then slides on. The line is chosen for the nominal friction and delay.

    stepper calibrate examples/studies/push_transfer.py --margin 0.25
    stepper calibrate examples/studies/push_transfer.py --margin 0.25 --setting "MuJoCo's law"

docs/benchmarks/reality.md has results.
"""

from __future__ import annotations

import importlib.util
from collections import deque
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import stepper
from stepper.lab import Outcome, Parameter

HALF, BALL, SPEED, PERIOD = 0.04, 0.02, 0.3, 0.01
"""Half width of the box, m; radius of the ball, m; speed of the push, m/s; control period, s."""
GOAL, NEAR = 0.6, 0.02
"""Position of the goal in x, m, and largest distance of the box from it at the end, m."""
FRICTION, DELAY = 0.4, 0.03
"""Nominal friction of box and table, and nominal delay of the camera, s."""
KP, KV, ARMATURE = 8000.0, 200.0, 0.2
"""Gains of the servos, N m/rad and N m s/rad, and inertia of their rotors, kg m^2."""
LINE = GOAL - SPEED * (DELAY + KV / KP) - SPEED**2 / (2.0 * 9.81 * FRICTION)
"""Position of the box at which the arm stops, m, so that the box slides to the goal in the nominal world."""
TRACK = np.linspace(0.36, 0.7, 69)
"""Positions of the ball in x at which joint angles are computed, m; between them they are interpolated."""


def robot() -> Any:
    """Model of the arm with position servos, a ball at its flange, a table and a box."""
    found = importlib.util.find_spec("robosuite")
    if found is None or found.origin is None:
        raise ModuleNotFoundError("package robosuite, which has the model of the UR5e, is missing: pip install --no-deps robosuite")
    spec = mujoco.MjSpec.from_file(str(Path(found.origin).parent / "models/assets/robots/ur5e/robot.xml"))
    for geom in [*spec.geoms]:
        spec.delete(geom)
    for mesh in [*spec.meshes]:
        spec.delete(mesh)
    for body in spec.bodies:
        body.gravcomp = 1.0
    for motor in spec.actuators:
        motor.gaintype, motor.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
        motor.gainprm[0], motor.biasprm[1], motor.biasprm[2] = KP, -KP, -KV
        motor.ctrllimited, motor.forcerange = False, motor.ctrlrange
    for joint in spec.joints:
        joint.armature = ARMATURE
    flange = next(body for body in spec.bodies if body.name == "right_hand")
    flange.add_geom(name="ball", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[BALL, 0, 0], mass=0.1)
    flange.add_site(name="ball")
    spec.worldbody.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[2, 2, 1])
    box = spec.worldbody.add_body(name="box", pos=[0.45, 0.0, HALF])
    box.add_freejoint()
    box.add_geom(name="box", type=mujoco.mjtGeom.mjGEOM_BOX, size=[HALF] * 3, mass=0.5)
    spec.option.timestep = 0.002
    return spec.compile()


def track() -> Any:
    """Joint angles (69, 6), rad, that put the ball at the positions `TRACK` in x, in front of the middle of the box."""
    model = robot()
    data, site, made = mujoco.MjData(model), model.site("ball").id, []
    data.qpos[:6] = [0.0, -1.2, 2.0, -2.4, -1.57, 0.0]
    jacobian = np.zeros((3, model.nv))
    for x in TRACK:
        for _ in range(200):
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_jacSite(model, data, jacobian, None, site)
            error, j = np.array([x, 0.0, HALF]) - data.site_xpos[site], jacobian[:, :6]
            data.qpos[:6] += j.T @ np.linalg.solve(j @ j.T + 1e-4 * np.eye(3), error)
        if np.abs(error).max() > 1e-4:
            raise ValueError(f"the arm does not reach x = {x:g} m, error {error} m: move the track nearer to its base")
        made.append(data.qpos[:6].copy())
    return np.array(made)


class Push:
    """Controller that moves the ball at constant speed until the camera sees the box at the line.

    It adds the camera's bias, delay and scatter to the true position: an error that differs from run to run. As sensors of the model these
    would forbid batches of several worlds. The last move is as long as the rest of the way that the camera sees. The end then depends
    on all parameters without jumps.
    """

    def __init__(self) -> None:
        self.angles = track()

    def begin(self, now: Any) -> None:
        """Puts the target of the ball to the start of the track, starts to move, and draws the errors of the runs."""
        self._x, self._moving, self._seen = np.full(now.num_envs, TRACK[0]), np.ones(now.num_envs, bool), deque[Any](maxlen=12)
        self._error = now.parameters["camera bias"] + now.parameters["camera scatter"] * now.rng("camera").normal(1)[:, 0]

    def __call__(self, now: Any) -> Any:
        """Servo targets, (num_envs, 6), rad."""
        self._seen.append(now.read("xpos", "box")[:, 0].copy())
        seen, number = np.array(self._seen), np.arange(now.num_envs)
        last = len(seen) - 1
        late = np.minimum(now.parameters["camera delay"] / PERIOD, last)
        older = np.minimum(np.floor(late).astype(int) + 1, last)
        newer = seen[np.minimum(last - older + 1, last), number]
        reading = newer + (late - older + 1) * (seen[last - older, number] - newer) + self._error
        way = np.clip(LINE - reading, 0.0, SPEED * PERIOD)
        self._x = np.where(self._moving, np.minimum(self._x + way, TRACK[-1]), self._x)
        self._moving &= way >= SPEED * PERIOD
        return np.stack([np.interp(self._x, TRACK, column) for column in self.angles.T], axis=1)


push = Push()


def start(now: Any, rngs: Any) -> Any:
    """Initial qpos and qvel: the ball at the start of the track, the box displaced by up to 1 cm in x and y."""
    qpos = np.tile(np.asarray(now.model.qpos0, float), (now.num_envs, 1))
    qpos[:, :6] = push.angles[0]
    qpos[:, 6:8] += np.array([rng.uniform(-0.01, 0.01, 2) for rng in rngs])
    return qpos, np.zeros((now.num_envs, now.model.nv))


study = stepper.lab.Study(
    name="push_transfer",
    model=robot,
    controller=push,
    start=start,
    outcomes=Outcome(
        name="from the goal", measure=lambda now: np.abs(now.read("xpos", "box")[:, 0] - GOAL), success=f"<= {NEAR}", unit="m"
    ),
    parameters={
        "friction": Parameter("geom_friction[table,box][0]", nominal=FRICTION, low=0.2, high=0.6, source="cardboard on wood"),
        "ball friction": Parameter("geom_friction[ball][0]", nominal=0.6, low=0.6, high=1.2, source="rubber, dusty to clean"),
        "box mass": Parameter("body_mass[box]", operation="scale", low=0.5, high=2.0, source="empty to full"),
        "servo stiffness": Parameter("actuator_kp[*]", operation="scale", low=0.5, high=1.5, source="usual gains"),
        "servo damping": Parameter("actuator_kv[*]", operation="scale", low=0.7, high=1.3, source="usual gains"),
        "motor delay": Parameter("actuator.delay", low=0.0, high=0.02, nominal=0.004, unit="s", source="buses, 0 to 20 ms"),
        "camera bias": Parameter("controller", low=-0.02, high=0.02, nominal=0.0, unit="m", source="a bracket, by eye"),
        "camera delay": Parameter("controller", low=0.0, high=0.1, nominal=DELAY, unit="s", source="cameras of 30 to 100 Hz"),
        "camera scatter": Parameter("controller", low=0.002, high=0.006, nominal=0.004, unit="m", source="detectors of markers"),
    },
    settings={"MuJoCo's law": {"contact": "mujoco", "integrator": "implicit"}},
    seconds=1.2,
    control=PERIOD,
    batch=512,
    episodes=8,
)
