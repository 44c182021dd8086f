"""Derivatives of the step and of rollouts (docs/how-to/derivatives.md).

"Nominal" is the unperturbed state, step or environment. A "column" is one perturbed number, a column of A or B. The "mode" of a step is its
set of active constraints: contacts that stick or slip, joints at their limits.

- `perturbations`: perturbed quantities and the displacements at which they are evaluated
- `copies`: perturbed copies of the environments, stepped together
- `kinks`: comparison of the active contacts and limits of the copies
- `linearize`: matrices by finite differences, and the error for steps without a derivative
- `implicit`: matrices by the implicit function theorem, at the mode of the solved step
- `nominal_mode`: replacement of columns whose difference crosses a kink
- `rollout`: gradients of a function of a rollout, by backpropagation through the steps
- `smoothing`: randomised smoothing of these gradients
"""

from stepper.derivatives.kinks import Kink
from stepper.derivatives.linearize import Linearization, UndeterminedDerivative, linearize
from stepper.derivatives.rollout import Gradients, Rollout, rollout
from stepper.derivatives.smoothing import Smoothing

__all__ = ["Gradients", "Kink", "Linearization", "Rollout", "Smoothing", "UndeterminedDerivative", "linearize", "rollout"]
