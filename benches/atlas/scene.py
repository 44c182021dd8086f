"""Definition of a scene: a setup, the right answer with its source, and a measure of an engine's error."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from atlas.world import World

LONG = (1e-4, 5e-4, 2e-3, 5e-3, 2e-2)
"""Time steps at which most scenes run, s."""


class Engine(Protocol):
    """Simulator with its settings, which runs the scenes of the atlas. Its results are a column of the atlas's tables."""

    @property
    def name(self) -> str:
        """Name of the engine with its settings, the heading of its column in the table."""

    def start(self, mjcf: str, dt: float, num_envs: int = 1, *, restitution: float | None = None, iterations: int | None = None) -> World:
        """Load a scene.

        Args:
            mjcf: Model in MJCF.
            dt: Time step, s.
            num_envs: Number of environments.
            restitution: Newton's coefficient of restitution of every contact. With None contacts are inelastic, the default of the engine.
            iterations: Iterations of the contact solver. With None the engine uses the default of its setting.

        Raises:
            CannotRunError: The engine does not support the scene; the message has the reason.
        """


@dataclass(frozen=True)
class Scene:
    """Difficult scene with its right answer. Its results are a row of the atlas's tables.

    Attributes:
        number: Number of the scene, "1" to "44", or "S1" to "S7" for the tests of SimBenchmark.
        name: Short name, unique within the number.
        answer: Right answer.
        source: Source of the answer: a closed form, statics, a conservation law, a textbook.
        unit: Unit of the error.
        tolerance: Function from the time step (s) to the largest error at which the scene holds (passes).
        because: Reason for the tolerance.
        measure: Function from an engine and a time step (s) to the error in `unit`. NaN and infinity are failures.
        dts: Time steps at which `python -m atlas` runs the scene, s.
        test_dts: Time steps at which the tests run the scene, s.
    """

    number: str
    name: str
    answer: str
    source: str
    unit: str
    tolerance: Callable[[float], float]
    because: str
    measure: Callable[[Engine, float], float]
    dts: tuple[float, ...] = field(default=LONG)
    test_dts: tuple[float, ...] = field(default=LONG)

    @property
    def title(self) -> str:
        """Number and name of the scene."""
        return f"{self.number} {self.name}"

    def holds(self, error: float, dt: float) -> bool:
        """Whether an error at a time step, s, is within the scene's tolerance."""
        return math.isfinite(error) and error <= self.tolerance(dt)


def unrest(engine: Engine, dt: float, mjcf: str, qpos: Sequence[float], seconds: float) -> float:
    """Error of a scene that must come to rest at zero positions: largest position (m, rad) or speed (m/s, rad/s) after a time in s."""
    world = engine.start(mjcf, dt)
    world.set(qpos, np.zeros(world.model.nv))
    world.run(seconds)
    return float(max(np.abs(world.qpos).max(), np.abs(world.qvel).max()))


def flat(value: float) -> Callable[[float], float]:
    """Function of the time step that always returns `value`, for tolerances that do not depend on the time step."""
    return lambda _dt: value
