"""Curriculum: harder terrain for environments that make progress."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from stepper.envs.task import Array, Reset, Terms
from stepper.envs.terrain.generator import Terrain
from stepper.shared.arguments import check_number, check_whole


@dataclass(frozen=True, kw_only=True, eq=False)
class TerrainCurriculum:
    """Curriculum over a terrain. Each environment has a tile: its row is the level (0 is the easiest), its column the kind of terrain.

    The first reset after a seed draws the column. After an episode the environment can move to a harder or easier row. A task uses the
    curriculum like this:

        class Walk(Task):
            carried = TerrainCurriculum.carried

            def episode_state(self, num_envs):
                return levels.episode_state(num_envs)

            def reset(self, reset):
                reset.qpos[:] = ...
                levels.place(reset)

            def on_end(self, now, envs):
                distance = levels.distance(now.episode_state, envs, now.qpos[envs])
                levels.move(now.episode_state, envs, up=distance > 4.0, down=distance < 2.0)

    The model's first joint must be free. `place` moves the sampled initial position to the middle of the tile, plus a random offset of at
    most `spread`. `place` also raises the position by the height of the highest terrain point within `footprint`.

    Attributes:
        terrain: The terrain.
        max_init_level: Hardest row that an environment can draw after a reset with a seed.
        spread: Largest distance of the initial position from the middle of the tile in x and y, m.
        footprint: Half side of the square around the initial position in which the highest point is searched, m.
    """

    carried: ClassVar[tuple[str, ...]] = ("terrain_level", "terrain_type")
    """Names in `episode_state` that must persist between episodes: add them to `Task.carried`."""

    terrain: Terrain
    max_init_level: int = 5
    spread: float = 0.5
    footprint: float = 0.4

    def __post_init__(self) -> None:
        if not isinstance(self.terrain, Terrain):
            raise TypeError(f"terrain is {self.terrain!r}, must be a stepper.envs.terrain.Terrain, such as Terrain(sub_terrains=...)")
        check_whole("max_init_level", self.max_init_level, least=0)
        check_number("spread", self.spread, least=0.0)
        check_number("footprint", self.footprint, least=0.0)

    def episode_state(self, num_envs: int) -> Terms:
        """Returns the arrays for `Task.episode_state`, by name.

        Returns:
            terrain_level: Row of the terrain (level of difficulty) for each environment, (num_envs,) int; -1 before it is drawn.
            terrain_type: Column of the terrain (kind of terrain) for each environment, (num_envs,) int; -1 before it is drawn.
            terrain_origin: Middle of each environment's tile on the surface of the terrain, (num_envs, 3) m.
        """
        undrawn = np.full(num_envs, -1, dtype=np.int64)
        return {"terrain_level": undrawn, "terrain_type": undrawn.copy(), "terrain_origin": np.zeros((num_envs, 3))}

    def place(self, reset: Reset) -> None:
        """Moves the initial positions of new episodes to the environments' tiles. Call it in `Task.reset`.

        An environment without a tile draws a random row (level of difficulty) from 0 to `max_init_level`. It also draws a column (kind of
        terrain) with the probabilities `Terrain.proportions`. An environment that moved up from the hardest row draws a row from all rows.
        """
        state, terrain = reset.episode_state, self.terrain
        level, kind = state["terrain_level"], state["terrain_type"]
        drawn = reset.rng.uniform(0.0, 1.0, 2)
        first = min(self.max_init_level + 1, terrain.num_rows)
        level = np.where(level < 0, drawn[:, 0] * first, np.where(level >= terrain.num_rows, drawn[:, 0] * terrain.num_rows, level))
        bounds = np.cumsum(terrain.proportions)[:-1]
        state["terrain_level"] = level.astype(np.int64)
        state["terrain_type"] = np.where(kind < 0, np.searchsorted(bounds, drawn[:, 1], side="right"), kind)
        origin = terrain.origins[state["terrain_level"], state["terrain_type"]]
        state["terrain_origin"] = origin
        reset.qpos[:, :2] += origin[:, :2] + reset.rng.uniform(-self.spread, self.spread, 2)
        reset.qpos[:, 2] += self._highest(reset.qpos[:, :2])

    def _highest(self, places: Array) -> Array:
        """Height of the highest grid point of the terrain within `footprint` of the points `places` (n, 2), (n,) m."""
        step = self.terrain.horizontal_scale
        reach = step * np.arange(-np.ceil(self.footprint / step) - 1, np.ceil(self.footprint / step) + 2)
        middle = step * np.round((places + self.terrain.half) / step) - self.terrain.half
        offsets = np.stack(np.meshgrid(reach, reach), axis=-1).reshape(-1, 2)
        highest: Array = self.terrain.height(middle[:, None] + offsets).max(axis=1)
        return highest

    def move(self, episode_state: Terms, envs: Array, *, up: Array, down: Array) -> None:
        """Moves environments to the next harder or easier row. Call it in `Task.on_end`.

        Args:
            episode_state: Arrays of `Task.episode_state`, in which "terrain_level" is changed.
            envs: Indices of the environments, (n,).
            up: Environments that move to the next harder row, (n,) bool. From the hardest row they move to a random row.
            down: Environments that move to the next easier row, (n,) bool. It has no effect together with `up`, or on the easiest row.
        """
        level = episode_state["terrain_level"]
        change = np.where(up, 1, np.where(down, -1, 0))
        level[envs] = np.where(level[envs] < 0, level[envs], np.clip(level[envs] + change, 0, self.terrain.num_rows))

    def distance(self, episode_state: Terms, envs: Array, places: Array) -> Array:
        """Returns the horizontal distances of robots from the middles of their tiles, (n,) m.

        Args:
            episode_state: Arrays of `Task.episode_state`.
            envs: Indices of the environments, (n,).
            places: Positions, (n, 2 or more) m, of which the first two columns count: `now.qpos[envs]`.
        """
        away = places[:, :2] - episode_state["terrain_origin"][envs, :2]
        distances: Array = np.hypot(away[:, 0], away[:, 1])
        return distances
