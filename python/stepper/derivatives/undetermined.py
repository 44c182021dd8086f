"""Error for gradients through a step that has no derivative."""

from __future__ import annotations

import numpy as np

from stepper._stepper import Model
from stepper.derivatives.kinks import Bools, Kink
from stepper.derivatives.linearize import Linearization


class UndeterminedDerivative(ArithmeticError):  # noqa: N818
    """Error of `Rollout.vjp` for a step that is at a kink and has no derivative (docs/how-to/derivatives.md).

    Attributes:
        env: Index of the environment.
        control: Index of the control of the rollout, from 0. The kink is in one of the steps in which this control is held.
        coordinate: Name of the coordinate with respect to which the step has no derivative, for example "qvel[3] (joint 'knee')".
        kinks: Flags of the kink.
    """

    def __init__(self, env: int, control: int, coordinate: str, kinks: Kink):
        self.env, self.control, self.coordinate, self.kinks = env, control, coordinate, kinks
        cause = " | ".join(kink.name or "" for kink in kinks & ~Kink.UNDETERMINED)
        super().__init__(
            f"the steps of control {control} have no derivative by {coordinate} in environment {env}: they are at a kink ({cause}). Use "
            "smoothed gradients, vjp(smoothing=Smoothing(...)), or zero gradients for this environment, vjp(undetermined='zero')"
        )


def first_undetermined(part: Linearization, needed: Bools, control: int, model: Model) -> dict[int, UndeterminedDerivative]:
    """Errors for steps without a derivative, by index of the environment; at most one per environment.

    Args:
        part: Linearization of the steps in which one control of a rollout is held.
        needed: Mask of the environments that need the derivative, (num_envs,), because their gradient in the backward pass is not zero.
            Other environments get no error.
        control: Index of this control in the rollout.
        model: The model.
    """
    errors: dict[int, UndeterminedDerivative] = {}
    for name, flags in part.kinks.items():
        rows = flags.reshape(len(needed), -1)
        for env, column in np.argwhere((rows & np.uint32(Kink.UNDETERMINED)) != 0):
            if needed[env] and int(env) not in errors:
                coordinate, kinks = _coordinate(model, name, int(column)), Kink(int(rows[env, column]))
                errors[int(env)] = UndeterminedDerivative(int(env), control, coordinate, kinks)
    return errors


def _coordinate(model: Model, name: str, column: int) -> str:
    """Name of a perturbed coordinate for an error message, with the joint or actuator, such as "qvel[3] (joint 'knee')"."""
    if name in ("qpos", "qvel"):
        joint = max((model.joint(k) for k in range(model.njnt)), key=lambda joint: joint.dofadr if joint.dofadr <= column else -1)
        return f"{name}[{column}] (joint {joint.name!r})" if joint.name else f"{name}[{column}]"
    if name == "ctrl":
        actuator = model.actuator(column).name
        return f"ctrl[{column}] (actuator {actuator!r})" if actuator else f"ctrl[{column}]"
    return f"{name}[{column}]"
