"""All scenes of the atlas, in a module for each topic. `ALL` has them in the order of their numbers."""

from types import ModuleType

from atlas.scene import Scene
from atlas.scenes import (
    contradictions,
    facets,
    flight,
    friction,
    grooves,
    impact_times,
    impacts,
    jamming,
    mechanisms,
    passing,
    rolling,
    simbenchmark,
    stacks,
    structures,
    tipping,
    top,
    turning,
    walls,
)

GROUPS: dict[str, tuple[str, tuple[ModuleType, ...]]] = {
    "friction": ("Friction and rolling", (friction, jamming, rolling, tipping, turning)),
    "impacts": ("Impacts and fast bodies", (impact_times, impacts, passing, walls)),
    "stacks": ("Stacks and structures", (contradictions, stacks, structures)),
    "mechanisms": ("Mechanisms and flight", (flight, mechanisms, top)),
    "surfaces": ("Surfaces of triangles and grooves", (facets, grooves)),
    "simbenchmark": ("SimBenchmark", (simbenchmark,)),
}
"""Groups of topics, each with a page of the report: title and modules by the name of the page's file."""

TOPICS = tuple(topic for _, topics in GROUPS.values() for topic in topics)


def _place(scene: Scene) -> tuple[bool, int]:
    """Sort key: numbered scenes first, then scenes of SimBenchmark (S1, S2 ...)."""
    return scene.number.startswith("S"), int(scene.number.lstrip("S"))


ALL: tuple[Scene, ...] = tuple(sorted((scene for topic in TOPICS for scene in topic.SCENES), key=_place))
