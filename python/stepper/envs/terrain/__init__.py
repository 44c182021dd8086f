"""Generated terrains of tiles with increasing difficulty, and curricula over them. docs/how-to/terrain.md has an example."""

from typing import Any

from stepper._hints import no_name
from stepper.envs.terrain.curriculum import TerrainCurriculum, stage_of
from stepper.envs.terrain.generator import Terrain
from stepper.envs.terrain.sub_terrains import (
    BoxTerrain,
    DiscreteObstacles,
    Flat,
    Gap,
    PyramidSlope,
    PyramidStairs,
    RandomRough,
    SteppingStones,
    SubTerrain,
    Wave,
)

__all__ = [
    "BoxTerrain",
    "DiscreteObstacles",
    "Flat",
    "Gap",
    "PyramidSlope",
    "PyramidStairs",
    "RandomRough",
    "SteppingStones",
    "SubTerrain",
    "Terrain",
    "TerrainCurriculum",
    "Wave",
    "stage_of",
]


def __getattr__(name: str) -> Any:
    raise no_name(__name__, name, __all__)
