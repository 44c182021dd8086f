"""Scene in which robosuite's Panda picks a cube from a table, carries it and puts it down.

Robot, gripper and settings (impratio 20, elliptic cones) are those of robosuite 1.5.2. Table, cube, robot position and time step are those
of its task Lift (`environments/manipulation/lift.py`, `models/assets/arenas/table_arena.xml`). The controllers of robosuite are Python
code. This model has servos instead, with libfranka's gains for joint impedance, so that both engines get the same controls.
"""

from typing import Any

import mujoco
import numpy as np

from many_contacts.assets import Assets, add_servo, bare
from many_contacts.kinematics import downwards, eased, reach
from many_contacts.scene import Array, Phase, Scene, Script

FOLDER = "robosuite/models/assets"
JOINTS = tuple(f"joint{i}" for i in range(1, 8))
GAINS = ((600, 50), (600, 50), (600, 50), (600, 50), (250, 30), (150, 25), (50, 15))
"""Stiffness (N m/rad) and damping (N m s/rad) of the servo of each joint, from libfranka's examples/joint_impedance_control.cpp."""
TORQUE = (80, 80, 80, 80, 80, 12, 12)
"""Torque limits of robosuite's motors, N m."""
REST = (0.0, np.pi / 16, 0.0, -np.pi / 2 - np.pi / 3, 0.0, np.pi - 0.2, np.pi / 4)
"""Joint angles of robosuite's `init_qpos`, rad."""
BASE, TABLE, CUBE = (-0.56, 0.0, 0.912), 0.8, 0.021
"""Position of the robot, height of the table top, and half size of the cube, m."""
OPEN, CLOSED = (0.04, -0.04), (0.0, 0.0)
ABOVE, ASIDE = 0.12, 0.15
"""Height to which the hand lifts the cube, and horizontal distance over which it carries the cube, m."""
HOLD = 5
"""Number of steps per target, 10 ms."""
HELD = ("cube", "leftfinger")
PHASES = (Phase("approach", 250), Phase("close", 150), Phase("lift", 250, held=HELD), Phase("carry", 250, held=HELD), Phase("place", 250))


def spec(assets: Assets) -> Any:
    """Model specification (`MjSpec`) of a Panda arm with gripper and servos, and a cube on a table."""
    s = bare(mujoco.MjSpec.from_file(str(assets.file("robosuite", f"{FOLDER}/base.xml"))))
    robot = assets.spec("robosuite", f"{FOLDER}/robots/panda/robot.xml")
    gripper = assets.spec("robosuite", f"{FOLDER}/grippers/panda_gripper.xml")
    for part in (robot, gripper):
        part.compiler.inertiagrouprange = [0, 0]
        for sensor in list(part.sensors):
            part.delete(sensor)
        for body in part.bodies[1:]:
            body.gravcomp = 1.0
    for act in list(robot.actuators):
        robot.delete(act)
    for joint, (stiffness, damping), torque in zip(JOINTS, GAINS, TORQUE, strict=True):
        add_servo(robot, joint, stiffness, damping, torque)
    robot.attach(gripper, prefix="", frame=robot.body("right_hand").add_frame())
    s.attach(robot, prefix="", frame=s.worldbody.add_frame(pos=BASE))
    s.option.timestep = 0.002
    box = mujoco.mjtGeom.mjGEOM_BOX
    s.worldbody.add_geom(name="table", type=box, size=[0.4, 0.4, 0.4], pos=[0, 0, TABLE - 0.4])
    cube = s.worldbody.add_body(name="cube", pos=[0, 0, TABLE + CUBE])
    cube.add_freejoint()
    cube.add_geom(name="cube", type=box, size=[CUBE] * 3, density=1000.0)
    return s


def script(model: mujoco.MjModel, num_envs: int, rng: np.random.Generator) -> Script:
    """Initial states and controls of an episode (a `Script`) in which the robot picks, carries and places a cube.

    The initial pose of the cube is random, within 3 cm and 20 degrees of the middle of the table.
    """
    places = rng.uniform(-0.03, 0.03, (num_envs, 2))
    yaws = rng.uniform(-0.35, 0.35, num_envs)
    starts = np.tile(model.qpos0, (num_envs, 1))
    cube = int(model.joint(int(model.body("cube").jntadr[0])).qposadr[0])
    way = np.zeros((num_envs, 5, len(JOINTS)))
    arm = [int(model.joint(name).qposadr[0]) for name in JOINTS]
    fingers = [int(model.joint(f"finger_joint{i}").qposadr[0]) for i in (1, 2)]
    for env, (place, yaw) in enumerate(zip(places, yaws, strict=True)):
        qpos = model.qpos0.copy()
        qpos[arm], qpos[fingers] = REST, OPEN
        points = [(*place, ABOVE), (*place, 0.0), (*place, ABOVE), (place[0], place[1] + ASIDE, ABOVE), (place[0], place[1] + ASIDE, 0.0)]
        for k, (x, y, height) in enumerate(points):
            qpos = reach(model, qpos, "grip_site", JOINTS, pos=np.array([x, y, TABLE + CUBE + height]), rot=downwards(yaw))
            way[env, k] = qpos[arm]
        starts[env, arm], starts[env, fingers] = way[env, 0], OPEN
        starts[env, cube : cube + 7] = (*place, TABLE + CUBE, np.cos(yaw / 2), 0, 0, np.sin(yaw / 2))
    return Script(starts, _controls(way, num_envs), hold=HOLD)


def _controls(way: Array, num_envs: int) -> Array:
    """Servo targets of arm and fingers in all phases, from the joint angles at five waypoints (num_envs, 5, 7)."""

    def both(k: int, grip: tuple[float, float]) -> Array:
        return np.concatenate([way[:, k], np.tile(grip, (num_envs, 1))], axis=1)

    down, up, aside = both(1, CLOSED), both(2, CLOSED), both(3, CLOSED)
    blocks = [phase.steps // HOLD for phase in PHASES]
    release = blocks[4] // 5
    return np.concatenate(
        [
            eased(both(0, OPEN), both(1, OPEN), blocks[0]),
            np.repeat(down[None], blocks[1], axis=0),
            eased(down, up, blocks[2]),
            eased(up, aside, blocks[3]),
            eased(aside, both(4, CLOSED), blocks[4] - release),
            np.repeat(both(4, OPEN)[None], release, axis=0),
        ]
    )


SCENES = (Scene("panda", "robosuite's Panda with its gripper picks a cube of 42 mm and 74 g from a table, 2 ms", spec, script, PHASES),)
