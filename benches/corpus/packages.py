"""Which packages the corpus is made of, and why each one is there."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Package:
    """A package of the Python package index.

    Attributes:
        name: Of the package.
        version: The one that is measured.
        why: What its models add to the corpus.
        left_out: Glob patterns of files that are not measured, against the path inside the package.
        because: Why they are not.
    """

    name: str
    version: str
    why: str
    left_out: tuple[str, ...] = ()
    because: str = ""


PACKAGES = (
    Package("gymnasium", "1.4.0", "the walkers that most papers on learning report"),
    Package("gymnasium-robotics", "1.4.2", "Fetch arm, Shadow hand, Franka kitchen, Adroit hand, mazes"),
    Package("gym-aloha", "0.1.5", "ALOHA: two ViperX arms with grippers of meshes"),
    Package("safety-gymnasium", "1.0.0", "wheeled and legged robots among obstacles"),
    Package("dm-control", "1.0.50", "the suite, the dog, the composer's walkers and manipulation arms, soccer"),
    Package("example-robot-data", "6.0.0", "URDF of some thirty commercial robots, as users of Pinocchio have them"),
    Package("robosuite", "1.5.2", "arms, grippers, humanoids and household objects"),
    Package("gym-hil", "0.1.14", "Franka Panda with a gripper for teleoperation"),
    Package("gym-xarm", "0.1.1", "UFACTORY xArm 7 with a gripper of closed loops"),
    Package("mjlab", "1.6.0", "Unitree Go1 and G1 as trained for transfer to hardware"),
    Package("playground", "0.2.0", "scenes of MuJoCo Playground: quadrupeds, humanoids, hands"),
    Package("brax", "0.14.2", "models of Brax and scenes of its tests"),
    Package("mujoco-mjx", "3.17.0", "scenes of the tests of MuJoCo's own port to accelerators: one for each feature"),
    Package("metaworld", "3.1.1", "Sawyer with fifty tasks: doors, drawers, levers, tools"),
    Package("myosuite", "3.0.0", "muscles and tendons over skeletons; hands and arms beside them"),
    Package("flygym", "2.1.1", "NeuroMechFly: a fruit fly, whose masses are of the order of a microgram"),
    Package("hello-robot-stretch-urdf", "0.1.2", "URDF of a mobile manipulator with a telescoping arm"),
    Package("robosuite-models", "1.0.0", "further robots for robosuite: humanoids, quadrupeds, mobile arms"),
    Package("mani-skill", "3.0.1", "URDF and MJCF of ManiSkill's arms and hands"),
    Package(
        "pybullet",
        "3.2.7",
        "URDF and MJCF that PyBullet ships as pybullet_data: Laikago, KUKA, Minitaur, humanoids",
        left_out=("*/random_urdfs/*",),
        because="without its thousand random objects, which have no inertia",
    ),
)
"""In the order in which they are measured, small ones first.

Looked for and not there: flybody, dex-urdf, robogym and hello-robot-stretch-mujoco have no archive in the index; loco-mujoco and panda-gym
download their models when they run, or make them in code.
"""
