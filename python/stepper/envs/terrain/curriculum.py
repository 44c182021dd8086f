"""Curricula: harder or easier tiles of a terrain by an environment's progress, and wider commands by its number of steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from stepper.envs.task import Array, Reset, Terms
from stepper.envs.terrain.generator import Terrain


@dataclass(frozen=True, kw_only=True, eq=False)
class TerrainCurriculum:
    """Curriculum of a terrain: an environment has a column of tiles, and moves to a harder or easier row after an episode.

        class Walk(Task):
            carried = TerrainCurriculum.carried

            def episode_state(self, num_envs):
                return levels.episode_state(num_envs)

            def place(self, reset):
                super().place(reset)
                levels.place(reset)

            def on_end(self, now, envs):
                distance = levels.distance(now.episode_state, envs, now.qpos[envs])
                levels.move(now.episode_state, envs, up=distance > 4.0, down=distance < 2.0)

    The model's first joint must be free. An episode starts near the middle of its tile, above the highest point around it.

    Attributes:
        terrain: The terrain.
        max_init_level: Hardest row in which an environment begins after a reset with a seed.
        spread: Largest distance of the initial position from the middle of the tile in x and y, m.
        footprint: Half side of the square around the initial position whose highest point counts, m.
    """

    carried: ClassVar[tuple[str, ...]] = ("terrain_level", "terrain_type")
    """Names for `Task.carried`."""

    terrain: Terrain
    max_init_level: int = 5
    spread: float = 0.5
    footprint: float = 0.4

    def episode_state(self, num_envs: int) -> Terms:
        """Arrays for `Task.episode_state`: row and column of each environment, -1 where none was drawn yet, and the origin of its tile."""
        undrawn = np.full(num_envs, -1, dtype=np.int64)
        return {"terrain_level": undrawn, "terrain_type": undrawn.copy(), "terrain_origin": np.zeros((num_envs, 3))}

    def place(self, reset: Reset) -> None:
        """Moves initial states to the environments' tiles, for `Task.place`.

        Environments without a level draw one, and a column by the proportions of its kind. Those that solved the hardest row draw any.
        """
        state, envs, terrain = reset.episode_state, reset.envs, self.terrain
        level, kind = state["terrain_level"][envs], state["terrain_type"][envs]
        drawn = reset.rng.uniform(0.0, 1.0, 2)
        first = min(self.max_init_level + 1, terrain.num_rows)
        level = np.where(level < 0, drawn[:, 0] * first, np.where(level >= terrain.num_rows, drawn[:, 0] * terrain.num_rows, level))
        bounds = np.cumsum(terrain.proportions)[:-1]
        state["terrain_level"][envs] = level.astype(np.int64)
        state["terrain_type"][envs] = np.where(kind < 0, np.searchsorted(bounds, drawn[:, 1], side="right"), kind)
        origin = terrain.origins[state["terrain_level"][envs], state["terrain_type"][envs]]
        state["terrain_origin"][envs] = origin
        reset.qpos[:, :2] += origin[:, :2] + reset.rng.uniform(-self.spread, self.spread, 2)
        reset.qpos[:, 2] += self._highest(reset.qpos[:, :2])

    def _highest(self, places: Array) -> Array:
        """Height of the highest point of the terrain near places (n, 2), (n,) m: that of a point of its grid."""
        step = self.terrain.horizontal_scale
        reach = step * np.arange(-np.ceil(self.footprint / step) - 1, np.ceil(self.footprint / step) + 2)
        middle = step * np.round((places + self.terrain.half) / step) - self.terrain.half
        near = np.stack(np.meshgrid(reach, reach), axis=-1).reshape(-1, 2)
        highest: Array = self.terrain.height(middle[:, None] + near).max(axis=1)
        return highest

    def move(self, episode_state: Terms, envs: Array, *, up: Array, down: Array) -> None:
        """Moves environments to a harder or an easier row, for `Task.on_end`.

        Args:
            episode_state: The task's arrays.
            envs: Indices of the environments, (n,).
            up: Environments that go to the next harder row, (n,) bool. From the hardest one they go to any.
            down: Environments that go to the next easier row, (n,) bool, unless they go up.
        """
        level = episode_state["terrain_level"]
        change = np.where(up, 1, np.where(down, -1, 0))
        level[envs] = np.where(level[envs] < 0, level[envs], np.clip(level[envs] + change, 0, self.terrain.num_rows))

    def distance(self, episode_state: Terms, envs: Array, places: Array) -> Array:
        """Distances of environments `envs` (n,) at places (n, 2 or more) from the origins of their tiles, (n,) m."""
        away = places[:, :2] - episode_state["terrain_origin"][envs, :2]
        distances: Array = np.hypot(away[:, 0], away[:, 1])
        return distances


def stage_of(steps: Array, stages: Sequence[tuple[int, tuple[float, ...]]]) -> Array:
    """Values of the present stage of each environment, for a curriculum of commands.

    Args:
        steps: Actions of each environment, (n,): count them in `Task.episode_state`, under a name in `Task.carried`.
        stages: First number of actions of each stage, ascending from 0, and its values (k,), such as the largest commands.

    Returns:
        Values of each environment, (n, k), in the unit of the stages.

    Raises:
        ValueError: Stages that do not begin with 0, or do not ascend.
    """
    begins = [begin for begin, _ in stages]
    if not begins or begins[0] != 0 or begins != sorted(set(begins)):
        raise ValueError(f"stages begin at {begins}, must ascend from 0")
    values: Array = np.array([value for _, value in stages])[np.searchsorted(begins, steps, side="right") - 1]
    return values
