"""Robots at which derivatives are compared, and their columns side by side."""

from collections.abc import Mapping
from functools import cache

import numpy as np
import stepper
from models import stepper_model

# Noise of a central difference: rounding of numbers of order 1 to 10 over the step of 1e-6.
NOISE = 1e-8


def joined(blocks: Mapping[str, np.ndarray]) -> np.ndarray:
    """Derivatives by the state and the controls, or what is known of these columns."""
    return np.concatenate([blocks[name] for name in ("qpos", "qvel", "act", "ctrl")], axis=-1)


@cache
def touching(robot: str, **options) -> tuple[stepper.Stepper, np.ndarray]:
    """Eight robots that fell onto the floor under random controls, and controls."""
    model, rng = stepper_model(robot, strict=False), np.random.default_rng(0)
    sim = stepper.Stepper(model, 8, options=stepper.Options(**options))
    for _ in range(10):
        sim.step(rng.uniform(-0.3, 0.3, (8, model.nu)), nstep=20)
    assert sum(c["force"][0] > 0 for c in sim.contacts()) >= 4
    return sim, rng.uniform(-0.3, 0.3, (8, model.nu))
