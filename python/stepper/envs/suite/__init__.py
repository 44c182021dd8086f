"""Tasks of dm_control's suite."""

from typing import Any

from stepper.envs.suite.ball_in_cup import BallInCup
from stepper.envs.suite.base import SuiteTask
from stepper.envs.suite.dog import Dog
from stepper.envs.suite.finger import Finger, FingerTurn, Reacher
from stepper.envs.suite.humanoid import Humanoid, HumanoidCMU
from stepper.envs.suite.lqr import LQR
from stepper.envs.suite.manipulator import Manipulator
from stepper.envs.suite.pendulums import Acrobot, Cartpole, Pendulum
from stepper.envs.suite.planar import Cheetah, Hopper, Walker
from stepper.envs.suite.point_mass import PointMass
from stepper.envs.suite.quadruped import Quadruped
from stepper.envs.suite.stacker import Stacker
from stepper.envs.suite.swimming import Fish, Swimmer

SUITE: dict[str, tuple[type[SuiteTask], dict[str, Any]]] = {
    "acrobot-swingup": (Acrobot, {}),
    "acrobot-swingup_sparse": (Acrobot, {"sparse": True}),
    "ball_in_cup-catch": (BallInCup, {}),
    "cartpole-balance": (Cartpole, {}),
    "cartpole-balance_sparse": (Cartpole, {"sparse": True}),
    "cartpole-swingup": (Cartpole, {"swing_up": True}),
    "cartpole-swingup_sparse": (Cartpole, {"swing_up": True, "sparse": True}),
    "cartpole-three_poles": (Cartpole, {"swing_up": True, "poles": 3}),
    "cartpole-two_poles": (Cartpole, {"swing_up": True, "poles": 2}),
    "cheetah-run": (Cheetah, {}),
    "dog-fetch": (Dog, {"fetch": True}),
    "dog-run": (Dog, {"move_speed": 9.0}),
    "dog-stand": (Dog, {}),
    "dog-trot": (Dog, {"move_speed": 3.0}),
    "dog-walk": (Dog, {"move_speed": 1.0}),
    "finger-spin": (Finger, {}),
    "finger-turn_easy": (FingerTurn, {"target_size": 0.07}),
    "finger-turn_hard": (FingerTurn, {"target_size": 0.03}),
    "fish-swim": (Fish, {"swim": True}),
    "fish-upright": (Fish, {}),
    "hopper-hop": (Hopper, {"hopping": True}),
    "hopper-stand": (Hopper, {}),
    "humanoid-run": (Humanoid, {"move_speed": 10.0}),
    "humanoid-run_pure_state": (Humanoid, {"move_speed": 10.0, "pure_state": True}),
    "humanoid-stand": (Humanoid, {}),
    "humanoid-walk": (Humanoid, {"move_speed": 1.0}),
    "humanoid_CMU-run": (HumanoidCMU, {"move_speed": 10.0}),
    "humanoid_CMU-stand": (HumanoidCMU, {}),
    "humanoid_CMU-walk": (HumanoidCMU, {"move_speed": 1.0}),
    "lqr-lqr_2_1": (LQR, {}),
    "lqr-lqr_6_2": (LQR, {"bodies": 6, "driven": 2}),
    "manipulator-bring_ball": (Manipulator, {}),
    "manipulator-bring_peg": (Manipulator, {"peg": True}),
    "manipulator-insert_ball": (Manipulator, {"insert": True}),
    "manipulator-insert_peg": (Manipulator, {"peg": True, "insert": True}),
    "pendulum-swingup": (Pendulum, {}),
    "point_mass-easy": (PointMass, {}),
    "point_mass-hard": (PointMass, {"turned": True}),
    "quadruped-escape": (Quadruped, {"escape": True}),
    "quadruped-fetch": (Quadruped, {"fetch": True}),
    "quadruped-run": (Quadruped, {"move_speed": 5.0}),
    "quadruped-walk": (Quadruped, {}),
    "reacher-easy": (Reacher, {"target_size": 0.05}),
    "reacher-hard": (Reacher, {"target_size": 0.015}),
    "stacker-stack_2": (Stacker, {}),
    "stacker-stack_4": (Stacker, {"boxes": 4}),
    "swimmer-swimmer15": (Swimmer, {"links": 15}),
    "swimmer-swimmer6": (Swimmer, {}),
    "walker-run": (Walker, {"move_speed": 8.0}),
    "walker-stand": (Walker, {}),
    "walker-walk": (Walker, {"move_speed": 1.0}),
}
"""Class and arguments of each task, by dm_control's names "domain-task"."""

__all__ = ["SUITE", "SuiteTask"]
