"""Interpolation of heights on a grid, for many points at once."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

_CHUNK = 16384
"""Number of points that are computed together, so that intermediate arrays stay in a core's cache.

Half and twice this number are equally fast.
"""


class HeightGrid:
    """Heights of a surface over a rectangle centred at the origin: a grid of heights with linear interpolation between its points.

    Each cell is two triangles, split by the diagonal from its corner with the smallest x and y.

    Args:
        top: Heights of the grid points, (rows, columns), m: rows along y, columns along x, from the corner with the smallest x and y.
        half: Half the extent in x and y, (2,), m.
    """

    def __init__(self, top: Array, half: Array):
        self.top, self.half = top, half
        rows, columns = top.shape
        self._cells = np.array([columns - 1, rows - 1])
        self._scale = self._cells / (2.0 * half)
        # Per cell: height at the corner with the smallest x and y, and slopes along x and y of its two triangles (upper ones first).
        least, right, above, far = top[:-1, :-1], top[:-1, 1:], top[1:, :-1], top[1:, 1:]
        self._least = np.ascontiguousarray(least).ravel()
        self._along = np.concatenate([(far - above).ravel(), (right - least).ravel()])
        self._across = np.concatenate([(above - least).ravel(), (far - right).ravel()])

    def at(self, places: Array, out: Array) -> None:
        """Writes heights, m, at the points `places`, (..., 2), m, to `out`, (...); NaN beyond the border."""
        flat, found = places.reshape(-1, 2), out.reshape(-1)
        for start in range(0, len(flat), _CHUNK):
            rows = slice(start, start + _CHUNK)
            steps = (flat[rows] + self.half) * self._scale
            self._look_up(np.ascontiguousarray(steps[:, 0]), np.ascontiguousarray(steps[:, 1]), True, found[rows])
        if not np.shares_memory(found, out):
            out[...] = found.reshape(out.shape)

    def around(self, places: Array, angles: Array, offsets: Array, out: Array) -> None:
        """Writes heights, m, at offsets (k, 2), m, rotated by angles (n,), rad, around points (n, 2), m, to `out`, (n, k).

        Heights beyond the border are NaN.
        """
        ahead, left = (np.ascontiguousarray(offsets[:, k]) for k in range(2))
        radius = np.sqrt((offsets * offsets).sum(axis=1).max(initial=0.0))
        nears_border = (np.abs(places) + radius * (1.0 + 1e-12) >= self.half).any(axis=1)
        along, across = self._scale
        turns = np.stack([np.cos(angles) * along, np.sin(angles) * along, np.sin(angles) * across, np.cos(angles) * across])
        first, second = ((places + self.half) * self._scale).T[..., None]
        size = max(1, _CHUNK // max(1, len(offsets)))
        for start in range(0, len(places), size):
            rows = slice(start, start + size)
            cos_u, sin_u, sin_v, cos_v = turns[:, rows]
            u, v = _outer(cos_u, ahead), _outer(sin_v, ahead)
            u -= _outer(sin_u, left)
            v += _outer(cos_v, left)
            u += first[rows]
            v += second[rows]
            self._look_up(u, v, bool(nears_border[rows].any()), out[rows])

    def _look_up(self, u: Array, v: Array, checks: bool, out: Array) -> None:
        """Writes heights, m, at points given in cells of the grid to `out`. The arrays u and v are overwritten.

        Args:
            u: Distances along x from the corner with the smallest x and y, in cells.
            v: Distances along y from that corner, in cells.
            checks: Whether points may lie beyond the border, where the result is NaN. If False, all points must lie within the border.
            out: Array of the shape of u.
        """
        columns, rows = self._cells
        column, row = np.floor(u), np.floor(v)
        if checks:
            outside = (u < 0.0) | (u > columns) | (v < 0.0) | (v > rows) | np.isnan(u) | np.isnan(v)
            column, row = (np.fmax(np.fmin(cell, last - 1), 0.0) for cell, last in ((column, columns), (row, rows)))
        u -= column
        v -= row
        row *= columns
        row += column
        cell = row.astype(np.intp)
        triangle = (u >= v) * np.intp(len(self._least))
        triangle += cell
        u *= self._along.take(triangle)
        v *= self._across.take(triangle)
        u += v
        np.add(self._least.take(cell), u, out=out)
        if checks:
            out[outside] = np.nan


def _outer(first: Array, second: Array) -> Array:
    """Outer product of two vectors, (n,) and (k,): (n, k). `np.einsum` is faster here than broadcasting."""
    products: Array = np.einsum("i,j->ij", first, second)
    return products
