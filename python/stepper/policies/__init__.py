"""Trained policies: small networks that run in NumPy, stored with the settings of the environment of their training.

    policy = stepper.policies.load("half_cheetah.npz", env=envs)  # warns of all differences from the environment of the training
    observation, reward, terminated, truncated, info = envs.step(policy(observation))

    stepper.policies.evaluate(policy, "stepper/HalfCheetah-v5", episodes=20)

Loading and running a policy needs only NumPy. `evaluate` and `compare` need Gymnasium and SciPy, and `film` needs Gymnasium and MoviePy.
docs/how-to/train.md shows how to train one.
"""

from stepper.policies.environment import describe, differences
from stepper.policies.evaluation import Comparison, Evaluation, check_film, compare, evaluate, film, is_native, make
from stepper.policies.policy import ACTIVATIONS, Policy, PolicyError, PolicyWarning, load

__all__ = [
    "ACTIVATIONS",
    "Comparison",
    "Evaluation",
    "Policy",
    "PolicyError",
    "PolicyWarning",
    "check_film",
    "compare",
    "describe",
    "differences",
    "evaluate",
    "film",
    "is_native",
    "load",
    "make",
]
