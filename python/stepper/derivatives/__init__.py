"""Derivatives of the step and of rollouts (docs/how-to/derivatives.md).

- `perturbations`: perturbed quantities and the widths of their differences
- `copies`: perturbed copies of a batch, stepped together
- `kinks`: comparison of the active contacts and limits of the copies
- `linearize`: matrices of finite differences
- `implicit`: matrices by the implicit function theorem, for the contact modes of the solved step
- `rollout`: gradients backwards through time
- `smoothing`: randomised smoothing of these gradients
- `tangent`: conversion between gradients with respect to quaternions and rotation vectors
"""

from stepper.derivatives.kinks import Kink
from stepper.derivatives.linearize import Linearization, linearize
from stepper.derivatives.rollout import Gradients, Rollout, rollout
from stepper.derivatives.smoothing import Smoothing
from stepper.derivatives.undetermined import UndeterminedDerivative

__all__ = ["Gradients", "Kink", "Linearization", "Rollout", "Smoothing", "UndeterminedDerivative", "linearize", "rollout"]
