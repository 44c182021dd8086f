"""Python packages whose robot models form the corpus, each with the reason for its selection."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Package:
    """Package of the Python package index.

    Attributes:
        name: Name of the package.
        version: Version of the package.
        why: Contribution of its models to the corpus.
        left_out: Glob patterns of files that are not measured, for paths inside the package.
        because: Reason for `left_out`.
    """

    name: str
    version: str
    why: str
    left_out: tuple[str, ...] = ()
    because: str = ""


PACKAGES = (
    Package("gymnasium", "1.4.0", "the walkers of most papers on learning"),
    Package("gymnasium-robotics", "1.4.2", "Fetch arm, Shadow hand, Franka kitchen, Adroit hand, mazes"),
    Package("gym-aloha", "0.1.5", "ALOHA: two ViperX arms with grippers of meshes"),
    Package("safety-gymnasium", "1.0.0", "wheeled and legged robots among obstacles"),
    Package("dm-control", "1.0.50", "the suite, the dog, the composer's walkers and manipulation arms, soccer"),
    Package("example-robot-data", "6.0.0", "URDF of some thirty commercial robots, used with Pinocchio"),
    Package("robosuite", "1.5.2", "arms, grippers, humanoids and household objects"),
    Package("gym-hil", "0.1.14", "Franka Panda with a gripper for teleoperation"),
    Package("gym-xarm", "0.1.1", "UFACTORY xArm 7 with a gripper of closed loops"),
    Package("mjlab", "1.6.0", "Unitree Go1 and G1 as trained for transfer to hardware"),
    Package("playground", "0.2.0", "scenes of MuJoCo Playground: quadrupeds, humanoids, hands"),
    Package("brax", "0.14.2", "models of Brax and scenes of its tests"),
    Package("mujoco-mjx", "3.17.0", "test scenes of MuJoCo's port to accelerators, one for each feature"),
    Package("metaworld", "3.1.1", "Sawyer with fifty tasks: doors, drawers, levers, tools"),
    Package("myosuite", "3.0.0", "muscles and tendons over skeletons; hands and arms"),
    Package("flygym", "2.1.1", "NeuroMechFly: a fruit fly, whose masses are of the order of a microgram"),
    Package("hello-robot-stretch-urdf", "0.1.2", "URDF of a mobile manipulator with a telescoping arm"),
    Package("robosuite-models", "1.0.0", "further robots for robosuite: humanoids, quadrupeds, mobile arms"),
    Package("mani-skill", "3.0.1", "URDF and MJCF of ManiSkill's arms and hands"),
    Package(
        "pybullet",
        "3.2.7",
        "URDF and MJCF of PyBullet's pybullet_data: Laikago, KUKA, Minitaur, humanoids",
        left_out=("*/random_urdfs/*",),
        because="without its thousand random objects, which have no inertia",
    ),
)
"""Python packages with robot models, which form the corpus, in the order of their measurement: small packages first.

Not included: flybody, dex-urdf, robogym and hello-robot-stretch-mujoco have no archive in the Python package index. The packages
loco-mujoco and panda-gym download their models at run time, or make them in code.
"""
