"""mjlab's velocity task of the Go1 on flat ground, with its robot, as a user of mjlab would write it. It needs mjlab's files."""

from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec

import gymnasium
import mujoco
import numpy as np
import stepper
from stepper.envs import Group, Observation, Reward, Servo, Task, add, at_start, contact_forces, every, push, square_sum, uniform
from stepper.envs.commands import VelocityCommand
from stepper.envs.locomotion import rewards as terms
from stepper.envs.quantities import action_rate, base_angvel, base_linvel, gravity, joint_pos, joint_vel, site_linvel

LEGS = ("FR", "FL", "RR", "RL")
FEET = [f"{leg}_foot_collision" for leg in LEGS]
STANCE, GEAR, TORQUE = {"hip": 0.1, "thigh": 0.9, "calf": -1.8}, {"calf": 9.0}, {"calf": 35.55}  # rad, gear ratio, N m


@cache
def robot():
    spec = mujoco.MjSpec.from_file(f"{find_spec('mjlab').submodule_search_locations[0]}/asset_zoo/robots/unitree_go1/xmls/go1.xml")
    spec.option.timestep, angles = 0.005, []
    for geom in spec.geoms:
        geom.conaffinity = 0
        if geom.name in FEET:
            geom.priority, geom.condim = 1, 3
    for joint in spec.joints[1:]:
        leg, kind, _ = joint.name.split("_")
        angles.append(STANCE[kind] * (-1.0 if kind == "hip" and leg[1] == "L" else 1.0))
        joint.armature, rate = 0.000111842 * GEAR.get(kind, 6.0) ** 2, 20.0 * np.pi
        servo = spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        servo.set_to_position(kp=joint.armature * rate**2, kv=4.0 * joint.armature * rate)
        servo.forcerange = [-TORQUE.get(kind, 23.7), TORQUE.get(kind, 23.7)]
    spec.add_key(name="stance", qpos=[0, 0, 0.2945, 1, 0, 0, 0, *angles], ctrl=angles)
    return stepper.load(spec, floor=True)


def feet(now):
    """Heights (m), horizontal speeds (m/s) and normal forces (N) of the feet, (num_envs, 4) each."""
    return now.read("site_xpos", LEGS)[..., 2], np.hypot(*site_linvel(now, LEGS).T[:2]).T, contact_forces(now, FEET, ["floor"])


def moves(now):
    return np.abs(now.command()).sum(axis=1) > 0.05


def pose(now):
    tolerance = np.where(moves(now)[:, None], 0.3, 0.05) * np.tile([1.0, 1.0, 2.0], 4)
    return np.exp(-square_sum(joint_pos(now) / tolerance) / 12)


@dataclass(frozen=True, kw_only=True)
class Go1Flat(Task):
    keyframe = "stance"
    actions = Servo("*", scale=lambda model: model.actuator_forcerange[:, 1] / (4.0 * model.actuator_gainprm[:, 0]), bound=4.0)
    commands = {"twist": VelocityCommand(every=(3, 8), x=(-1, 1), y=(-1, 1), yaw=(-0.5, 0.5), standing=0.1, forward=0.2, turning=0.3)}  # noqa: RUF012
    episode_seconds: float = 20.0
    frame_skip: int = 4

    def model(self):
        return robot()

    def observations(self):
        joints = Observation(joint_pos, noise=0.01, bias=0.015), Observation(joint_vel, noise=1.5)
        base = Observation(base_linvel, noise=0.5), Observation(base_angvel, noise=0.2), Observation(gravity, noise=0.05)
        policy = (*base, *joints, Observation("action"), Observation("twist"))
        extra = tuple(Observation(f"foot {k}", func=lambda now, k=k: feet(now)[k]) for k in range(3))
        return {"policy": policy, "critic": Group(policy, noise=False, extra=extra)}

    def rewards(self):
        return {
            "track_linear": Reward(terms.track_linear_velocity, 2.0),
            "track_angular": Reward(terms.track_angular_velocity, 2.0),
            "upright": Reward(lambda now: np.exp(-square_sum(gravity(now)[:, :2]) / 0.2)),
            "pose": Reward(pose),
            "limits": Reward(terms.dof_pos_limits, -1.0),
            "action_rate": Reward(action_rate, -0.1),
            "clearance": Reward(lambda now: (np.abs(feet(now)[0] - 0.1) * feet(now)[1]).sum(axis=1) * moves(now), -2.0),
            "slip": Reward(lambda now: (feet(now)[1] ** 2 * (feet(now)[2] > 0.0)).sum(axis=1) * moves(now), -0.1),
        }

    def events(self):
        pushes = push("trunk", x=(-0.5, 0.5), y=(-0.5, 0.5), z=(-0.4, 0.4), roll=(-0.52, 0.52), pitch=(-0.52, 0.52), yaw=(-0.78, 0.78))
        friction = at_start("geom_friction[*_foot_collision][0]", uniform(0.3, 1.5, shared=True))
        centre = at_start("body_ipos[trunk]", add([-0.025, -0.025, -0.03], [0.025, 0.025, 0.03]))
        return friction, centre, every((1.0, 3.0), pushes)

    def reset(self, reset):
        half = reset.rng.uniform(-np.pi / 2, np.pi / 2, 1)[:, 0]
        reset.qpos[:, 2] += reset.rng.uniform(0.01, 0.05, 1)[:, 0]
        reset.qpos[:, 3], reset.qpos[:, 6] = np.cos(half), np.sin(half)

    def terminated(self, now):
        return gravity(now)[:, 2] > -np.cos(np.radians(70.0))


gymnasium.register("me/Go1Flat-v0", vector_entry_point="stepper.envs:StepperVectorEnv", kwargs={"task": Go1Flat})
