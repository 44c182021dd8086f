"""What a scene of the atlas is: a setup, the right answer with its source, and a measure of how far an engine is from it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from atlas.world import World

LONG = (1e-4, 5e-4, 2e-3, 5e-3, 2e-2)
"""Time steps of the long sweep, s."""
SHORT = (2e-3, 2e-2)
"""Time steps of the short one, for scenes that take seconds."""


class Engine(Protocol):
    """An engine with its settings, one column of the table."""

    @property
    def name(self) -> str:
        """As in the table."""

    def start(self, mjcf: str, dt: float, num_envs: int = 1, *, restitution: float | None = None, iterations: int | None = None) -> World:
        """Loads a scene.

        Args:
            mjcf: The model.
            dt: Time step in s.
            num_envs: Copies that are stepped together.
            restitution: Newton's coefficient of every contact; None is the engine's own default, inelastic.
            iterations: Of the contact solver; None is the setting's own.

        Raises:
            CannotRunError: The engine has no such thing; the message says what.
        """


@dataclass(frozen=True)
class Scene:
    """One row of the table.

    Attributes:
        number: In the list of scenes, "1" to "35"; "S1" to "S7" are SimBenchmark's.
        name: A few words, unique within the number.
        answer: What is right.
        source: Where that comes from: a closed form, statics, a law of conservation, a textbook.
        unit: Of the error.
        tolerance: Largest error (in `unit`) with which the scene counts as held, from the time step in s.
        because: Where the tolerance comes from.
        measure: From an engine and a time step in s, the error in `unit`. NaN and infinity are failures.
        dts: Time steps of the long sweep, s.
        test_dts: Time steps of the test, s.
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
        """Number and name."""
        return f"{self.number} {self.name}"

    def holds(self, error: float, dt: float) -> bool:
        """Whether an error is none."""
        return math.isfinite(error) and error <= self.tolerance(dt)


def flat(value: float) -> Callable[[float], float]:
    """A tolerance that does not depend on the time step."""
    return lambda _dt: value
