"""Trained policies, without the library that trained them: small networks that act in NumPy, and what they were trained in.

    policy = stepper.policies.load("half_cheetah.npz", env=envs)  # warns of everything that differs from what it was trained in
    observation, reward, terminated, truncated, info = envs.step(policy(observation))

    stepper.policies.evaluate(policy, "stepper/HalfCheetah-v5", episodes=20)

Loading and acting need NumPy alone; `evaluate`, `compare` and `film` need Gymnasium, SciPy and MoviePy. docs/how-to/train.md trains one.
"""

from stepper.policies.environment import describe, differences
from stepper.policies.evaluation import Comparison, Evaluation, compare, evaluate, is_native, make
from stepper.policies.film import check_film, film
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
