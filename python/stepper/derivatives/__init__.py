"""Derivatives of the step and of rollouts (docs/how-to/derivatives.md).

`perturbations` lists what is moved and by how much, `copies` steps perturbed copies of a batch, `kinks` compares what is active in them,
`linearize` makes matrices of their differences, `implicit` those at the modes of the solution, and `rollout` takes gradients backwards
through time with these, or with the means of `smoothing`; `tangent` is between gradients by quaternions and by rotations.
"""

from stepper.derivatives.kinks import Kink
from stepper.derivatives.linearize import Linearization, linearize
from stepper.derivatives.rollout import Gradients, Rollout, rollout
from stepper.derivatives.smoothing import Smoothing
from stepper.derivatives.undetermined import UndeterminedDerivative

__all__ = ["Gradients", "Kink", "Linearization", "Rollout", "Smoothing", "UndeterminedDerivative", "linearize", "rollout"]
