"""Field of view of a camera, or of its detector."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class FieldOfView:
    """A pyramid ahead of a camera, between two distances. What is outside is not seen, and no frame has it.

    Positions are those in the camera's frame, as a "framepos" sensor reads them whose reference is a site or body: x to the right, y down,
    z ahead (MuJoCo's own cameras look along -z: turn them by 180 degrees about x). Of a sensor with a delay, a reading is the position
    when the frame was taken, so that what is asked is whether it was in view then. A pose is seen where its position is.

    Attributes:
        width: Angle between the left and the right edge, rad; one for all environments, or one for each, (num_envs,).
        height: Angle between the upper and the lower edge, rad; likewise.
        near: Least distance ahead, m.
        far: Greatest distance ahead, m.

    Raises:
        ValueError: An angle that is not between 0 and pi, a distance that is negative, or near beyond far.
    """

    width: float | Array
    height: float | Array
    near: float = 0.0
    far: float = np.inf

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            angle = np.asarray(getattr(self, name), float)
            if not np.all((angle > 0) & (angle < np.pi)):
                raise ValueError(f"{name} is {getattr(self, name)}, must be between 0 and pi: the whole angle between two edges, in rad")
        if not 0 <= self.near < self.far:
            raise ValueError(f"near is {self.near} and far is {self.far}, must be distances in m, near at least 0 and below far")

    def sees(self, position: ArrayLike) -> NDArray[np.bool_]:
        """Whether positions are in view.

        Args:
            position: In the camera's frame, (num_envs, 3) or (3,) in m. One that is not finite is not seen.

        Returns:
            Of each, (num_envs,), or one.

        Raises:
            ValueError: Rows that are no positions.
        """
        given = np.asarray(position, float)
        if given.ndim == 0 or given.shape[-1] != 3:
            raise ValueError(f"position has the shape {given.shape}, must be (num_envs, 3) or (3,): x, y and z in the camera's frame")
        x, y, z = np.moveaxis(given, -1, 0)
        inside = (np.abs(x) <= z * np.tan(0.5 * np.asarray(self.width))) & (np.abs(y) <= z * np.tan(0.5 * np.asarray(self.height)))
        found: NDArray[np.bool_] = np.asarray(inside & (z >= self.near) & (z <= self.far) & (z > 0))
        return found

    def detect(self, reading: ArrayLike, last: ArrayLike) -> Array:
        """Readings of what is in view, and the last ones of what is not, as a tracker holds them.

        Args:
            reading: The position in the camera's frame and the further outputs of the detector, (num_envs, 3 and more).
            last: What it said before, of the same shape; NaN where it has seen nothing yet.

        Raises:
            ValueError: Shapes that differ, or rows that begin with no position.
        """
        given, before = np.asarray(reading, float), np.asarray(last, float)
        if given.shape != before.shape or given.ndim != 2:
            raise ValueError(f"reading has the shape {given.shape} and last {before.shape}, must be one, (num_envs, 3 and more)")
        return np.where(self.sees(given[:, :3])[:, None], given, before)
