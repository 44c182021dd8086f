"""Scenes with Unitree's G1 and Go1 as in mjlab's walking tasks, with the random actions of an untrained policy.

Parameters are those of mjlab 1.6.0: `asset_zoo/robots/unitree_*/*_constants.py` (motors, gains, collisions, poses, scale of actions), and
`tasks/velocity/velocity_env_cfg.py` with `config/*/env_cfgs.py` (time step, solver, 4 steps per action, resets). They are copied here,
because mjlab needs torch. The MJCF comes from the package.
"""

import functools
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from many_contacts.assets import Assets, add_servo
from many_contacts.scene import Array, Phase, Scene, Script

HOLD = 4
"""Number of time steps for which the robot's action stays the same."""
STEPS = 300
FREQUENCY, DAMPING_RATIO = 10 * 2.0 * math.pi, 2.0
"""Natural frequency (rad/s) and damping ratio of a servo that moves only the armature of its joint; they determine the gains."""
FALLEN = math.cos(math.radians(70.0))
"""Vertical component of the trunk's z axis below which the robot counts as fallen."""
DRAWS = 8
"""Number of random configurations of each environment, for its resets."""


@dataclass(frozen=True)
class Motor:
    """Kind of motor, with its joints.

    Attributes:
        joints: Regular expressions for the names of the joints.
        armature: Reflected inertia, kg m^2.
        effort: Largest torque, N m.
    """

    joints: tuple[str, ...]
    armature: float
    effort: float

    @property
    def stiffness(self) -> float:
        """Stiffness of a servo with this motor, N m/rad."""
        return self.armature * FREQUENCY**2

    @property
    def damping(self) -> float:
        """Damping of a servo with this motor, N m s/rad."""
        return 2.0 * DAMPING_RATIO * self.armature * FREQUENCY

    @property
    def scale(self) -> float:
        """Displacement of the servo's target by an action of 1, rad."""
        return 0.25 * self.effort / self.stiffness


@dataclass(frozen=True)
class Walker:
    """Walking robot.

    Attributes:
        xml: MJCF file in mjlab.
        height: Initial height of the trunk, m.
        pose: Initial joint angles, rad, by regular expression for the names of the joints; other angles are 0.
        motors: Motors of the joints.
        colliding: Regular expression for the names of colliding geoms.
        feet: Regular expression for the names of the feet. Other geoms have no friction.
        foot: Attributes condim and friction of the feet.
        geom: Further attributes of the colliding geoms.
        option: Attributes of `mjOption` that differ from MuJoCo's defaults.
    """

    xml: str
    height: float
    pose: Mapping[str, float]
    motors: tuple[Motor, ...]
    colliding: str
    feet: str
    foot: tuple[int, tuple[float, ...]]
    geom: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    option: Mapping[str, Any] = field(default_factory=dict)


def planetary(rotors: tuple[float, float, float], gears: tuple[float, float, float]) -> float:
    """Reflected inertia of a planetary gear of two stages, kg m^2 (mjlab's `reflected_inertia_from_two_stage_planetary`)."""
    return rotors[0] * (gears[1] * gears[2]) ** 2 + rotors[1] * gears[2] ** 2 + rotors[2]


_5020 = planetary((0.139e-4, 0.017e-4, 0.169e-4), (1, 1 + 46 / 18, 1 + 56 / 16))
_7520_14 = planetary((0.489e-4, 0.098e-4, 0.533e-4), (1, 4.5, 1 + 48 / 22))
_7520_22 = planetary((0.489e-4, 0.109e-4, 0.738e-4), (1, 4.5, 5))
_4010 = planetary((0.068e-4, 0.0, 0.0), (1, 5, 5))

G1 = Walker(
    xml="mjlab/asset_zoo/robots/unitree_g1/xmls/g1.xml",
    height=0.76,
    pose={
        ".*_hip_pitch_joint": -0.312,
        ".*_knee_joint": 0.669,
        ".*_ankle_pitch_joint": -0.363,
        ".*_elbow_joint": 0.6,
        "left_shoulder_roll_joint": 0.2,
        "right_shoulder_roll_joint": -0.2,
        ".*_shoulder_pitch_joint": 0.2,
    },
    motors=(
        Motor((".*_elbow_joint", ".*_shoulder_(pitch|roll|yaw)_joint", ".*_wrist_roll_joint"), _5020, 25.0),
        Motor((".*_hip_pitch_joint", ".*_hip_yaw_joint", "waist_yaw_joint"), _7520_14, 88.0),
        Motor((".*_hip_roll_joint", ".*_knee_joint"), _7520_22, 139.0),
        Motor((".*_wrist_pitch_joint", ".*_wrist_yaw_joint"), _4010, 5.0),
        Motor(("waist_pitch_joint", "waist_roll_joint", ".*_ankle_pitch_joint", ".*_ankle_roll_joint"), 2 * _5020, 50.0),
    ),
    colliding=".*_collision",
    feet=r"(left|right)_foot[1-7]_collision",
    foot=(3, (0.6,)),
    option={"ccd_iterations": 50},
)

GO1 = Walker(
    xml="mjlab/asset_zoo/robots/unitree_go1/xmls/go1.xml",
    height=0.278,
    pose={".*thigh_joint": 0.9, ".*calf_joint": -1.8, ".*R_hip_joint": 0.1, ".*L_hip_joint": -0.1},
    motors=(Motor((".*_hip_joint", ".*_thigh_joint"), 0.000111842 * 6**2, 23.7), Motor((".*_calf_joint",), 0.000111842 * 9**2, 35.55)),
    colliding=r".*_collision\d*",
    feet=r"[FR][LR]_foot_collision",
    foot=(6, (1.0, 5e-3, 5e-4)),
    geom={"solref": (0.01, 1.0)},
    option={"ccd_iterations": 500, "impratio": 10.0, "cone": mujoco.mjtCone.mjCONE_ELLIPTIC},
)


def spec(walker: Walker, assets: Assets) -> Any:
    """Model specification (`MjSpec`) of a robot on a plane, with mjlab's collisions, motors and solver settings."""
    s = assets.spec("mjlab", walker.xml)
    s.option.timestep, s.option.iterations, s.option.ls_iterations = 0.005, 10, 20
    s.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    for name, value in walker.option.items():
        setattr(s.option, name, value)
    for geom in s.geoms:
        collides, foot = (re.fullmatch(p, geom.name or "") is not None for p in (walker.colliding, walker.feet))
        geom.contype = geom.conaffinity = int(collides)
        geom.condim, geom.priority = (walker.foot[0], 1) if foot else (1, 0)
        if foot:
            geom.friction[: len(walker.foot[1])] = walker.foot[1]
        for name, values in walker.geom.items() if collides else ():
            getattr(geom, name)[: len(values)] = values
    for joint in s.joints:
        if joint.type == mujoco.mjtJoint.mjJNT_HINGE:
            motor = _motor(walker, joint.name)
            joint.armature = motor.armature
            add_servo(s, joint.name, motor.stiffness, motor.damping, motor.effort).ctrllimited = False
    s.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 0.01])
    return s


def home(walker: Walker, model: mujoco.MjModel) -> Array:
    """Initial configuration of a walking robot, (nq,)."""
    qpos: Array = model.qpos0.copy()
    qpos[2] = walker.height
    for j in range(model.njnt):
        for pattern, angle in walker.pose.items():
            if re.fullmatch(pattern, model.joint(j).name):
                qpos[model.jnt_qposadr[j]] = angle
    return qpos


def script(walker: Walker, model: mujoco.MjModel, num_envs: int, rng: np.random.Generator, noise: float = 1.0) -> Script:
    """Initial states and controls of an episode (a `Script`) of a walking robot with random actions.

    Robots that have fallen are reset.
    """
    qpos = home(walker, model)
    starts = np.tile(qpos, (DRAWS + 1, num_envs, 1))
    starts[..., :2] += rng.uniform(-0.5, 0.5, (DRAWS + 1, num_envs, 2))
    starts[..., 2] += rng.uniform(0.01, 0.05, (DRAWS + 1, num_envs))
    half = rng.uniform(-math.pi, math.pi, (DRAWS + 1, num_envs)) / 2
    starts[..., 3:7] = np.stack([np.cos(half), 0 * half, 0 * half, np.sin(half)], axis=-1)
    joints = model.actuator_trnid[:, 0]
    scale = np.array([_motor(walker, model.joint(j).name).scale for j in joints])
    target = qpos[model.jnt_qposadr[joints]]
    control = target + noise * scale * rng.standard_normal((STEPS // HOLD, num_envs, model.nu))
    return Script(starts[0], control, hold=HOLD, ended=fallen, reset_qpos=starts[1:])


def _motor(walker: Walker, joint: str) -> Motor:
    """Motor, among those of a robot, that drives the joint with the given name."""
    return next(m for m in walker.motors if any(re.fullmatch(pattern, joint) for pattern in m.joints))


def fallen(qpos: Array) -> NDArray[np.bool_]:
    """Mask (n,) of the robots that lean by more than 70 degrees, from configurations (n, nq)."""
    x, y = qpos[:, 4], qpos[:, 5]
    return np.asarray(1 - 2 * (x * x + y * y) < FALLEN)


def _scene(name: str, walker: Walker, about: str) -> Scene:
    """Scene with a robot of mjlab's walking tasks."""
    return Scene(name, about, functools.partial(spec, walker), functools.partial(script, walker), (Phase("trained", STEPS),))


SCENES = (
    _scene("g1", G1, "Unitree's G1 in mjlab's walking task: seven capsules per foot, self-collisions, 5 ms"),
    _scene("go1", GO1, "Unitree's Go1 in mjlab's walking task: feet with torsional and rolling friction, 5 ms"),
)
