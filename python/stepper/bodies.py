"""Quantities of bodies as MuJoCo lays them out: inertias, velocities and contact forces about the centre of mass of the body's tree.

    import stepper

    sim = stepper.Stepper(stepper.load("humanoid.xml"), 1024)
    sim.step()
    stepper.bodies.cinert(sim)  # (1024, nbody, 10)

Names, axes, order and points of reference are those of mjData (https://mujoco.readthedocs.io/en/stable/APIreference/APItypes.html#mjdata).
All are of the present state, as `mj_forward` leaves them, with `num_envs` in front and of the scalar type of the stepper. The point of
reference is the centre of mass of the tree that a body belongs to: of a child of the world, with all that hangs from it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper._stepper import Model, Stepper

Array = NDArray[Any]

_WIDTHS = {"xipos": 3, "cinert": 10, "cvel": 6, "cfrc_ext": 6}
_BLOCK = 256
"""Environments that are computed together: their numbers stay in the cache from one operation to the next."""


def xipos(sim: Stepper, *, out: Array | None = None) -> Array:
    """Centres of mass of the bodies in the world, m.

    Args:
        sim: The stepper.
        out: Array to write to; None is a new one.

    Returns:
        (num_envs, nbody, 3), MuJoCo's xipos.

    Raises:
        ValueError: An `out` of another shape or scalar type.
    """
    out, written = _room(sim, "xipos", out)
    bodies = _Bodies(sim)
    for some in _blocks(written):
        written[some] = np.moveaxis(bodies.centers(some, bodies.components("xquat", some)), 0, -1)
    return out


def cinert(sim: Stepper, *, out: Array | None = None) -> Array:
    """Inertias of the bodies about the centre of mass of their tree, world axes.

    Args:
        sim: The stepper.
        out: Array to write to; None is a new one.

    Returns:
        (num_envs, nbody, 10), MuJoCo's cinert: the inertia's xx, yy, zz, xy, xz, yz in kg m^2, the mass times the place of the body's
        centre of mass in kg m, the mass in kg. The world's row is zero.

    Raises:
        ValueError: An `out` of another shape or scalar type.
    """
    out, written = _room(sim, "cinert", out)
    bodies = _Bodies(sim)
    for some in _blocks(written):
        _inertias(bodies, some, written[some])
    return out


def cvel(sim: Stepper, *, out: Array | None = None) -> Array:
    """Velocities of the bodies, of the point of each that is at the centre of mass of its tree, world axes.

    Args:
        sim: The stepper.
        out: Array to write to; None is a new one.

    Returns:
        (num_envs, nbody, 6), MuJoCo's cvel: angular velocity (3) in rad/s, linear velocity (3) in m/s.

    Raises:
        ValueError: An `out` of another shape or scalar type.
    """
    out, written = _room(sim, "cvel", out)
    bodies = _Bodies(sim)
    for some in _blocks(written):
        angular = bodies.components("body_angvel", some)
        linear = _cross(angular, bodies.references(some) - bodies.components("xpos", some))
        linear += bodies.components("body_linvel", some)
        rows = written[some]
        for k in range(3):
            rows[..., k], rows[..., 3 + k] = angular[k], linear[k]
    return out


def cfrc_ext(sim: Stepper, *, xfrc_applied: Array | None = None, out: Array | None = None) -> Array:
    """Torques and forces on the bodies of the last step's contacts, about the centre of mass of their tree, world axes.

    MuJoCo counts forces of connect and weld equalities among them, which are not in it. Where no step was made since the state was set
    there are no contacts, and it is zero.

    Args:
        sim: The stepper.
        xfrc_applied: Forces that are counted as well, (num_envs, nbody, 6) in N and N m at the bodies' centres of mass:
            `sim.xfrc_applied`, as MuJoCo counts them. None is none.
        out: Array to write to; None is a new one.

    Returns:
        (num_envs, nbody, 6), MuJoCo's cfrc_ext: torque (3) in N m, force (3) in N. The world's row is zero.

    Raises:
        ValueError: An `out` of another shape or scalar type, forces of another shape.
    """
    out, written = _room(sim, "cfrc_ext", out)
    given = None if xfrc_applied is None else np.asarray(xfrc_applied)
    if given is not None and given.shape != out.shape:
        raise ValueError(f"xfrc_applied has shape {given.shape}, must be {out.shape}")
    if given is not None and np.may_share_memory(given, out):
        given = given.copy()
    bodies, listed = _Bodies(sim), sim.contacts()
    env, frame = listed["env"].astype(np.int64), np.ascontiguousarray(listed["frame"].transpose(1, 2, 0))
    force, torque = (_combined(frame, listed[name]) for name in ("force", "torque"))
    pos, com = np.ascontiguousarray(listed["pos"].T), bodies.of("subtree_com")
    places, terms = [], []
    for side, sign in ((1, 1.0), (0, -1.0)):
        body = listed["body"][:, side].astype(np.int64)
        if body.any():  # Not all of the world.
            arm = pos - com[env, bodies.roots[body]].T
            terms.append(sign * np.concatenate([torque + _cross(arm, force), force]))
            places.append(6 * (env * written.shape[1] + body) + np.arange(6)[:, None])
    if places:
        place, term = np.concatenate(places, axis=1), np.concatenate(terms, axis=1)
        written[...] = np.bincount(place.ravel(), term.ravel(), written.size).reshape(written.shape)
    else:
        written[...] = 0.0
    if given is not None:
        applied = np.moveaxis(given.reshape(written.shape), -1, 0)
        every = slice(0, len(written))
        arm = bodies.centers(every, bodies.components("xquat", every)) - bodies.references(every)
        written[..., 3:] += np.moveaxis(applied[:3], 0, -1)
        written[..., :3] += np.moveaxis(applied[3:] + _cross(arm, applied[:3]), 0, -1)
    written[:, 0] = 0.0
    return out


QUANTITIES: Mapping[str, Callable[[Stepper], Array]] = {"xipos": xipos, "cinert": cinert, "cvel": cvel, "cfrc_ext": cfrc_ext}
"""The functions of this module by name."""


class _Bodies:
    """Numbers of bodies, component by component, (k, n, nbody), of n neighbouring environments: those of a slice.

    Args:
        sim: The stepper.

    Attributes:
        dtype: Scalar type of the stepper.
        roots: The first body of the tree that each body belongs to, (nbody,).
        iquat: Orientations of the principal axes in the bodies' frames times the square root of 2, the same `_BLOCK` times.
    """

    def __init__(self, sim: Stepper):
        self._sim, self._own, self._num_envs = sim, sim.randomized, sim.num_envs or 1
        self.dtype = np.dtype(np.float32 if sim.precision == "f32" else np.float64)
        self.roots, self.iquat, self._shared = _shared(sim.model, min(self._num_envs, _BLOCK), self.dtype.char)

    def of(self, name: str) -> Array:
        """A quantity of the stepper, with an axis of environments: (num_envs, nbody, k)."""
        values = np.asarray(getattr(self._sim, name))
        return values.reshape(self._num_envs, *values.shape[-2:])

    def components(self, name: str, some: slice) -> Array:
        """A quantity of the stepper."""
        return _components(self.of(name)[some])

    def parameter(self, name: str, some: slice) -> Array:
        """A parameter of the model, or what environments have of their own."""
        if name in self._own:
            own = np.asarray(self._own[name], dtype=self.dtype).reshape(self._num_envs, len(self.roots), -1)
            return _components(own[some])
        shared, count = self._shared[name], some.stop - some.start
        return shared[:, :count] if count <= shared.shape[1] else np.repeat(shared[:, :1], count, axis=1)

    def references(self, some: slice) -> Array:
        """Centres of mass of the trees that the bodies belong to, m."""
        return np.take(self.components("subtree_com", some), self.roots, axis=2)

    def centers(self, some: slice, quat: Array) -> Array:
        """Centres of mass of the bodies, m, of their orientations (4, n, nbody)."""
        # p + r + 2 w u x r + 2 u x (u x r), with the quaternion (w, u), the origin p of the frame and the place r in the frame.
        place = self.parameter("body_ipos", some)
        half = _cross(quat[1:], place)
        half += quat[0] * place
        centers = _cross(quat[1:], half)
        centers *= 2.0
        centers += place
        centers += self.components("xpos", some)
        return centers


@lru_cache(maxsize=8)
def _shared(model: Model, count: int, dtype: str) -> tuple[Array, Array, dict[str, Array]]:
    """What all environments have in common, each number `count` times: arrays of one shape are multiplied several times faster than others.

    Returns:
        The first body of the tree that each belongs to, (nbody,); orientations of the principal axes in the bodies' frames times the square
        root of 2, (4, count, nbody); parameters by name, (k, count, nbody).
    """
    roots = np.zeros(model.nbody, dtype=np.int64)
    for body in range(1, model.nbody):
        parent = model.body(body).parentid
        roots[body] = roots[parent] if parent else body

    def spread(values: Array) -> Array:
        return np.repeat(values.reshape(model.nbody, -1).T[:, None].astype(dtype), count, axis=1)

    fields = {name: spread(getattr(model, name)) for name in ("body_mass", "body_inertia", "body_ipos")}
    return roots, spread(np.sqrt(2.0) * model.body_iquat), fields


def _room(sim: Stepper, name: str, out: Array | None) -> tuple[Array, Array]:
    """The array that is returned, and the same with an axis of environments."""
    envs = () if sim.num_envs is None else (sim.num_envs,)
    shape, dtype = (*envs, sim.model.nbody, _WIDTHS[name]), np.dtype(np.float32 if sim.precision == "f32" else np.float64)
    if out is None:
        out = np.empty(shape, dtype=dtype)
    elif out.shape != shape or out.dtype != dtype:
        raise ValueError(f"out has shape {out.shape} and type {out.dtype}, must have {shape} and {dtype}")
    return out, out if envs else out[None]


def _blocks(written: Array) -> Iterator[slice]:
    """Slices of the environments of an array (num_envs, ...)."""
    for begin in range(0, len(written), _BLOCK):
        yield slice(begin, min(begin + _BLOCK, len(written)))


def _components(values: Array) -> Array:
    """Numbers (n, nbody, k) component by component: (k, n, nbody)."""
    return np.ascontiguousarray(values.transpose(2, 0, 1))


def _combined(frame: Array, values: Array) -> Array:
    """Vectors (3, n) of their components (n, 3) along the rows of frames (3, 3, n)."""
    first, second, third = np.ascontiguousarray(values.T)
    vectors: Array = frame[0] * first
    vectors += frame[1] * second
    vectors += frame[2] * third
    return vectors


def _inertias(bodies: _Bodies, some: slice, out: Array) -> None:
    """Writes `cinert` of some environments, (n, nbody, 10)."""
    quat = bodies.components("xquat", some)
    mass, moments = bodies.parameter("body_mass", some)[0], bodies.parameter("body_inertia", some)
    # The inertia is trace(S) - S, with the second moments of the distribution of mass, S = sum of w a a^T: over the principal axes a, whose
    # weights w follow from the principal moments, and over the place of the centre of mass, whose weight is the mass.
    axes = np.empty((3, 4, *quat.shape[1:]), dtype=quat.dtype)
    _principal_axes(quat, bodies.iquat[:, : quat.shape[1]], axes[:, :3])
    np.subtract(bodies.centers(some, quat), bodies.references(some), out=axes[:, 3])
    weighted = np.empty_like(axes)
    half = 0.5 * (moments[0] + moments[1] + moments[2])
    for k in range(3):
        np.multiply(axes[:, k], half - moments[k], out=weighted[:, k])
    np.multiply(axes[:, 3], mass, out=weighted[:, 3])
    xx, yy, zz = _summed(axes * weighted)
    xy, yz = _summed(axes[:2] * weighted[1:])
    (xz,) = _summed(axes[:1] * weighted[2:])
    for k, entry in enumerate((yy + zz, xx + zz, xx + yy, -xy, -xz, -yz, *weighted[:, 3], mass)):
        out[..., k] = entry
    out[:, 0] = 0.0


def _cross(a: Array, b: Array) -> Array:
    """Cross product of vectors (3, ...)."""
    product = np.empty(np.broadcast_shapes(a.shape, b.shape), dtype=np.result_type(a, b))
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        np.multiply(a[i], b[j], out=product[k])
        product[k] -= a[j] * b[i]
    return product


def _principal_axes(quat: Array, iquat: Array, out: Array) -> None:
    """Rotation matrices of the principal axes, row by row, (3, 3, num_envs, nbody), of bodies' quaternions and `_Bodies.iquat`."""
    a, b, c, d = quat
    e, f, g, h = iquat
    w, x, y, z = a * e - b * f, a * f + b * e, a * g + c * e, a * h + d * e
    w -= c * g
    w -= d * h
    x += c * h
    x -= d * g
    y += d * f
    y -= b * h
    z += b * g
    z -= c * f
    # The quaternion has the length sqrt(2), which stands for the factors 2 of the matrix.
    xx, yy, zz = x * x, y * y, z * z
    for (i, j), product, other in (((0, 1), x * y, w * z), ((2, 0), x * z, w * y), ((1, 2), y * z, w * x)):
        np.subtract(product, other, out=out[i, j])
        np.add(product, other, out=out[j, i])
    for k, (one, other) in enumerate(((yy, zz), (xx, zz), (xx, yy))):
        np.add(one, other, out=out[k, k])
        np.subtract(1.0, out[k, k], out=out[k, k])


def _summed(products: Array) -> Array:
    """Sums over an axis of length 4, (k, 4, ...), one after the other: the bits are the same for any number of environments."""
    sums: Array = products[:, 0]
    for k in range(1, 4):
        sums += products[:, k]
    return sums
