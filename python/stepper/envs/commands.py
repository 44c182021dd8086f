"""Commands: random targets, such as a velocity, that are drawn at a reset and again during an episode."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from stepper.envs.quantities import heading
from stepper.envs.task import Array, TaskView
from stepper.shared.arguments import check_number, check_range
from stepper.shared.streams import Rng

Range = tuple[float, float]

_SLOWEST = 0.3
"""Least velocity of a command to go straight ahead, m/s."""
_STIFFNESS = 0.5
"""Commanded rate of turn divided by the angle from the current to the commanded heading, 1/s."""


@dataclass(frozen=True, kw_only=True)
class Command:
    """Random target that a task gives to its policy, a value of the dictionary `Task.commands`. Abstract.

    Each environment draws its command at a reset, and again between reward and observation when its time is over. A subclass defines
    `size` and `draw`.

    Attributes:
        every: Shortest and longest time of a command, s; None keeps it for the whole episode.
    """

    size: ClassVar[int]
    """Number of random numbers that a command consists of."""
    every: Range | None = None

    def __post_init__(self) -> None:
        if self.every is not None:
            check_range(f"every of {type(self).__name__}", self.every, above=0.0)

    @abstractmethod
    def draw(self, rng: Rng, steps: Array) -> Array:
        """Draws the numbers of new commands of n environments, (n, size).

        Args:
            rng: Random number generator of these environments.
            steps: Number of actions and resets of each environment since it was seeded, (n,), for curricula.
        """

    def value(self, now: TaskView, drawn: Array) -> Array:
        """Returns the present commands, (num_envs, n), from the numbers of `draw`, (num_envs, size). The default is these numbers."""
        return drawn


@dataclass(frozen=True, kw_only=True)
class VelocityCommand(Command):
    """Velocity of the base: along x and y (m/s) and about z (rad/s), in the frame of the base. The command has 3 numbers.

    Attributes:
        x: Lowest and highest velocity along x, m/s.
        y: Lowest and highest velocity along y, m/s.
        yaw: Lowest and highest velocity about z, rad/s.
        standing: Probability that the command is to stand.
        forward: Probability of a command straight ahead, of 0.3 m/s or more.
        turning: Probability that the velocity about z turns the base to a random heading.
        heading: Lowest and highest random heading, rad.
        stages: Curriculum: pairs of the number of actions of an environment from which fields change, and their values, as
            ((120_000, {"x": (-1.5, 2.0)}),).
    """

    size: ClassVar[int] = 5
    x: Range = (0.0, 0.0)
    y: Range = (0.0, 0.0)
    yaw: Range = (0.0, 0.0)
    standing: float = 0.0
    forward: float = 0.0
    turning: float = 0.0
    heading: Range = (-np.pi, np.pi)
    stages: Sequence[tuple[int, Mapping[str, Any]]] = field(default=())

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("x", "y", "yaw", "heading"):
            check_range(f"{name} of {type(self).__name__}", getattr(self, name))
        for name in ("standing", "forward", "turning"):
            check_number(f"{name} of {type(self).__name__}", getattr(self, name), least=0.0, most=1.0)

    def draw(self, rng: Rng, steps: Array) -> Array:
        """Numbers of commands, (n, 5): velocities along x and y and about z, heading (NaN for none), and largest rate of turn (rad/s)."""
        drawn, made = rng.uniform(0.0, 1.0, 7), np.empty((len(steps), 5))
        stage, ranges = np.zeros(len(steps), dtype=np.int64), [self]
        for begin, changes in self.stages:
            stage[steps >= begin] = len(ranges)
            ranges.append(replace(ranges[-1], stages=(), **changes))
        for k in np.unique(stage):
            rows = stage == k
            made[rows] = ranges[k]._commands(drawn[rows])
        return made

    def _commands(self, drawn: Array) -> Array:
        """Numbers of commands, (n, 5), from uniform random numbers (n, 7) from 0 to 1."""
        commands = np.empty((len(drawn), 5))
        for k, (low, high) in enumerate((self.x, self.y, self.yaw, self.heading)):
            commands[:, k] = low + drawn[:, k] * (high - low)
        ahead, stands = drawn[:, 4] < self.forward, drawn[:, 5] < self.standing
        commands[ahead, 0] = np.maximum(np.abs(commands[ahead, 0]), _SLOWEST)
        commands[ahead, 1:3] = 0.0
        commands[(drawn[:, 6] >= self.turning) | stands, 3] = np.nan
        commands[stands, :3] = 0.0
        commands[:, 4] = max(map(abs, self.yaw))
        return commands

    def value(self, now: TaskView, drawn: Array) -> Array:
        """Commanded velocities along x and y (m/s) and about z (rad/s), (num_envs, 3)."""
        if not self.turning:
            return drawn[:, :3]
        difference = np.remainder(drawn[:, 3] - heading(now) + np.pi, 2.0 * np.pi) - np.pi
        turn = np.clip(_STIFFNESS * difference, -drawn[:, 4], drawn[:, 4])
        commands = np.array(drawn[:, :3])
        commands[:, 2] = np.where(np.isnan(turn), drawn[:, 2], turn)
        return commands


def commands_of(task: Any) -> dict[str, Command]:
    """Commands of a task by name; a TypeError if `Task.commands` is no dictionary of them."""
    commands = task.commands
    if not isinstance(commands, Mapping) or not all(isinstance(command, Command) for command in commands.values()):
        raise TypeError(
            f"{type(task).__name__}.commands is {commands!r}, must be commands by name, as "
            '{"twist": VelocityCommand(every=(3, 8), x=(-1, 1))} of stepper.envs.commands'
        )
    return dict(commands)
