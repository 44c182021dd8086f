"""Field of view of a camera, and readings of a detector that works on the camera's images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepper._arrays import array_of

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class FieldOfView:
    """Field of view of a camera: a pyramid in front of the camera, between two distances.

    Positions are in the camera's frame: x to the right, y down, z ahead. (MuJoCo's cameras look along -z; rotate them by 180 degrees about
    x.) A "framepos" sensor with a site or body as reference measures such positions. With a delayed sensor, the position
    and therefore the result belong to the time at which the image was taken. Orientations of objects do not matter.

    Attributes:
        width: Angle between the left and the right edge, rad, a scalar or (num_envs,).
        height: Angle between the upper and the lower edge, rad, a scalar or (num_envs,).
        near: Smallest distance ahead, m.
        far: Largest distance ahead, m.

    Raises:
        TypeError: An attribute is no number.
        ValueError: An angle is not between 0 and pi, a distance is negative, or `near` is beyond `far`.
    """

    width: float | Array
    height: float | Array
    near: float = 0.0
    far: float = np.inf

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            angle = array_of(name, getattr(self, name))
            if not np.all((angle > 0) & (angle < np.pi)):
                raise ValueError(f"{name} is {getattr(self, name)}, must be between 0 and pi: the whole angle between two edges, in rad")
        near, far = array_of("near", self.near), array_of("far", self.far)
        if near.shape != () or far.shape != () or not 0 <= near < far:
            raise ValueError(f"near is {self.near} and far is {self.far}, must be distances in m, near at least 0 and below far")

    def sees(self, position: ArrayLike) -> NDArray[np.bool_]:
        """Whether positions are in view.

        Args:
            position: Positions in the camera's frame, (num_envs, 3) or (3,), m. A position that is not finite is not in view.

        Returns:
            Whether each is in view, (num_envs,), or a single bool.

        Raises:
            ValueError: `position` has another shape.
        """
        given = array_of("position", position)
        if given.ndim == 0 or given.shape[-1] != 3:
            raise ValueError(f"position has the shape {given.shape}, must be (num_envs, 3) or (3,): x, y and z in the camera's frame")
        x, y, z = np.moveaxis(given, -1, 0)
        inside = (np.abs(x) <= z * np.tan(0.5 * np.asarray(self.width))) & (np.abs(y) <= z * np.tan(0.5 * np.asarray(self.height)))
        found: NDArray[np.bool_] = np.asarray(inside & (z >= self.near) & (z <= self.far) & (z > 0))
        return found

    def detect(self, reading: ArrayLike, last: ArrayLike) -> Array:
        """Returns readings of a detector, (num_envs, 3 + k): the current reading if the position is in view, otherwise the last one.

        Args:
            reading: Position in the camera's frame, m, and further outputs of the detector, (num_envs, 3 + k).
            last: Result of the previous call, (num_envs, 3 + k), in the units of `reading`; NaN before the first detection.

        Raises:
            ValueError: The shapes differ, or a row has fewer than three numbers.
        """
        given, before = array_of("reading", reading), array_of("last", last)
        if given.shape != before.shape or given.ndim != 2:
            raise ValueError(f"reading has the shape {given.shape} and last {before.shape}, must both be (num_envs, 3 + k)")
        return np.where(self.sees(given[:, :3])[:, None], given, before)
