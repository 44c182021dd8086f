"""Generated terrains of tiles with increasing difficulty, and curricula over them. docs/how-to/terrain.md has an example."""

from stepper.envs.terrain.curriculum import TerrainCurriculum
from stepper.envs.terrain.generator import Terrain
from stepper.envs.terrain.sub_terrains import Flat, PyramidSlope, PyramidStairs, RandomRough, SubTerrain, Wave

__all__ = ["Flat", "PyramidSlope", "PyramidStairs", "RandomRough", "SubTerrain", "Terrain", "TerrainCurriculum", "Wave"]
