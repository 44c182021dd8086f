"""All scenes, in a module for each family. `ALL` has them in the order of the printed table."""

from many_contacts.scene import Scene
from many_contacts.scenes import bodies, cells, grasps, hands, heaps, panda, unitree

FAMILIES = (unitree, panda, grasps, hands, heaps, bodies, cells)
ALL: tuple[Scene, ...] = tuple(scene for family in FAMILIES for scene in family.SCENES)
