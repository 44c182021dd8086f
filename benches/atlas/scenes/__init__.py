"""Every scene, by topic; `ALL` in the order of their numbers."""

from atlas.scene import Scene
from atlas.scenes import flight, friction, impacts, jamming, mechanisms, rolling, simbenchmark, stacks, structures, walls

TOPICS = (flight, friction, impacts, jamming, mechanisms, rolling, simbenchmark, stacks, structures, walls)


def _place(scene: Scene) -> tuple[bool, int]:
    return scene.number.startswith("S"), int(scene.number.lstrip("S"))


ALL: tuple[Scene, ...] = tuple(sorted((scene for topic in TOPICS for scene in topic.SCENES), key=_place))


def of(number: str) -> tuple[Scene, ...]:
    """The scenes of one number."""
    return tuple(scene for scene in ALL if scene.number == number)
