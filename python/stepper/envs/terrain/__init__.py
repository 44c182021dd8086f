"""Generated terrains of tiles with increasing difficulty, and curricula over them. docs/how-to/terrain.md has an example."""

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
