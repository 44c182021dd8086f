"""All scenes, in a module for each family. `ALL` has them in the order of the printed table."""

from many_contacts.scene import Scene
from many_contacts.scenes import bodies, cells, grasps, hands, heaps, panda, unitree

ALL: tuple[Scene, ...] = (
    *unitree.SCENES,
    *panda.SCENES,
    *grasps.SCENES,
    *hands.SCENES,
    *heaps.SCENES,
    *bodies.SCENES,
    *cells.SCENES,
)
