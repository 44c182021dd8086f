"""Engine rapier: bodies, shapes and joints come from rapier's MJCF loader, and states have MuJoCo's layout."""

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import rapier3d as rp
from numpy.typing import ArrayLike
from rapier3d.loaders import mjcf as loader

from atlas.world import Array, CannotRunError, DivergedError, Touch, World

_ZERO = 1e-12
"""Norm below which a quaternion is not normalised."""
SLIDE, HINGE = int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE)


class RapierWorld(World):
    """Environments of a scene in the engine rapier, one rapier world each. Joints are impulse joints, the type that supports loops.

    Args:
        mjcf: Model in MJCF.
        dt: Time step, s.
        num_envs: Number of environments.
        restitution: Coefficient of restitution of every contact. With None contacts are inelastic.
        iterations: Iterations of the contact solver; None keeps rapier's default number.
    """

    def __init__(self, mjcf: str, dt: float, num_envs: int, restitution: float | None, iterations: int | None) -> None:
        super().__init__(mjcf, dt, num_envs)
        self._refuse()
        self._worlds = [_world(mjcf, self.model, dt, restitution, iterations) for _ in range(num_envs)]
        self.set(np.tile(self.model.qpos0, (num_envs, 1)), np.zeros((num_envs, self.model.nv)))

    def _refuse(self) -> None:
        """Raise `CannotRunError` if the scene has elements that rapier lacks."""
        m = self.model
        if m.nmocap or m.ntendon or m.nu:
            raise CannotRunError("rapier: no mocap bodies, tendons or actuators with the meaning of MJCF")
        if (m.body_jntnum > 1).any():
            raise CannotRunError("rapier: one joint per body")
        if (m.geom_type == mujoco.mjtGeom.mjGEOM_ELLIPSOID).any():
            raise CannotRunError("rapier: no ellipsoids")
        if self.surfaces.any():
            raise CannotRunError("rapier's MJCF loader replaces meshes by their convex hulls")

    @property
    def qpos(self) -> Array:
        """Positions, (num_envs, nq), a copy."""
        return np.array([w.state()[0] for w in self._worlds])

    @property
    def qvel(self) -> Array:
        """Velocities, (num_envs, nv), a copy."""
        return np.array([w.state()[1] for w in self._worlds])

    def set(self, qpos: ArrayLike | None = None, qvel: ArrayLike | None = None) -> None:
        """Set positions and velocities: (num_envs, n), or (n,) for the same in all environments. None keeps the present ones."""
        presents = map(np.array, zip(*(w.state() for w in self._worlds), strict=True))
        states = (
            present if given is None else np.broadcast_to(np.asarray(given, float), present.shape)
            for given, present in zip((qpos, qvel), presents, strict=True)
        )
        for world, q, v in zip(self._worlds, *states, strict=True):
            world.put(q, v)

    def push(self, body: str, force: ArrayLike, torque: ArrayLike = (0, 0, 0)) -> None:
        """Apply a lasting force (N) and torque (N m) at a body's centre of mass, in world axes, (num_envs, 3) or (3,) for all."""
        for env, world in enumerate(self._worlds):
            parts = (np.broadcast_to(np.asarray(part, float), (self.num_envs, 3))[env] for part in (force, torque))
            world.push(self.body(body), *parts)

    def touches(self, env: int = 0) -> list[Touch]:
        """Contacts of the last step that exert a force, in one environment."""
        return self._worlds[env].touches(self.dt)

    def _advance(self, ctrl: Array | None, nstep: int) -> None:
        for world in self._worlds:
            for _ in range(nstep):
                world.world.step()

    def _check(self) -> None:
        if not all(np.isfinite(w.state()[0]).all() for w in self._worlds):
            raise DivergedError("the state of rapier is not finite")


@dataclass(frozen=True)
class _Joint:
    """Joint between two bodies. In both bodies its frame is at the anchor, with the axis along x.

    Attributes:
        body, parent: Indices of the bodies in MuJoCo; 0 is the world.
        kind: Type of the joint, as in `mujoco.mjtJoint`.
        qpos, qvel: First index in qpos and qvel.
        zero: Position at the reference pose, m or rad.
    """

    body: int
    parent: int
    kind: int
    qpos: int
    qvel: int
    zero: float


class _Scene:
    """Rapier world that rapier's MJCF loader has made, which reads and writes states in MuJoCo's layout.

    Args:
        model: `mujoco.MjModel` of the scene.
        world: World of rapier with the scene.
        handles: Handles of rapier's bodies by index in MuJoCo.
        geoms: Index of each collider's geom in MuJoCo.
    """

    def __init__(
        self, model: mujoco.MjModel, world: rp.PhysicsWorld, handles: list[rp.RigidBodyHandle | None], geoms: dict[Any, int]
    ) -> None:
        self._model, self._data, self.world, self._geoms = model, mujoco.MjData(model), world, geoms
        self.bodies = {b: handle for b, handle in enumerate(handles) if b and handle is not None and model.body_weldid[b]}
        self.joints = []
        for j, b in enumerate(int(b) for b in model.jnt_bodyid):
            parent, kind, q = int(model.body_weldid[model.body_parentid[b]]), int(model.jnt_type[j]), int(model.jnt_qposadr[j])
            zero = float(model.qpos0[q]) if kind in (SLIDE, HINGE) else 0.0
            self.joints.append(_Joint(b, parent, kind, q, int(model.jnt_dofadr[j]), zero))

    def put(self, qpos: Array, qvel: Array) -> None:
        """Sets the state of the rapier scene: qpos (nq,), m and rad, and qvel (nv,), m/s and rad/s."""
        m, d = self._model, self._data
        d.qpos[:], d.qvel[:] = qpos, qvel
        mujoco.mj_kinematics(m, d)
        mujoco.mj_comPos(m, d)
        mujoco.mj_comVel(m, d)
        velocity = np.zeros(6)
        for b, handle in self.bodies.items():
            if b == 0:
                continue
            own = self.world.rigid_bodies[handle]
            own.translation = _tuple(d.xpos[b])
            own.rotation = rp.Rotation3.from_quaternion(*_tuple(d.xquat[b]))
            mujoco.mj_objectVelocity(m, d, mujoco.mjtObj.mjOBJ_XBODY, b, velocity, 0)
            # Rapier's linear velocity is that of the centre of mass.
            arm = _rotate(d.xquat[b], _vector(own.local_center_of_mass))
            own.linvel, own.angvel = _tuple(velocity[3:] + np.cross(velocity[:3], arm)), _tuple(velocity[:3])

    @property
    def _at_reference(self) -> Any:
        """`mujoco.MjData` at the reference pose."""
        if not hasattr(self, "_reference"):
            self._reference = mujoco.MjData(self._model)
            mujoco.mj_kinematics(self._model, self._reference)
            mujoco.mj_comPos(self._model, self._reference)
        return self._reference

    def state(self) -> tuple[Array, Array]:
        """Positions (nq,), m and rad, and velocities (nv,), m/s and rad/s, in MuJoCo's layout."""
        m = self._model
        qpos, qvel = np.array(m.qpos0, float), np.zeros(m.nv)
        for joint in self.joints:
            place, turn, linear, spin = self._motion(joint.body)
            q, v = joint.qpos, joint.qvel
            if joint.kind == mujoco.mjtJoint.mjJNT_FREE:
                r = self.world.rigid_bodies[self.bodies[joint.body]].rotation
                # The orientation is not normalised, so that a drift of its norm is visible.
                qpos[q : q + 7], qvel[v : v + 6] = [*place, r.w, r.i, r.j, r.k], [*linear, *_rotate(_conjugate(turn), spin)]
                continue
            base, base_turn, base_linear, base_spin = self._motion(joint.parent)
            reference = self._at_reference
            j = int(m.body_jntadr[joint.body])
            axis = _rotate(_conjugate(reference.xquat[joint.body]), reference.xaxis[j])
            along = _rotate(turn, axis)
            was = _product(_conjugate(reference.xquat[joint.parent]), reference.xquat[joint.body])
            since = _product(_conjugate(was), _product(_conjugate(base_turn), turn))
            if joint.kind == mujoco.mjtJoint.mjJNT_BALL:
                qpos[q : q + 4], qvel[v : v + 3] = since, _rotate(_conjugate(turn), spin - base_spin)
            elif joint.kind == mujoco.mjtJoint.mjJNT_HINGE:
                qpos[q] = joint.zero + _nearest(2.0 * np.arctan2(since[1:] @ axis, since[0]), self._data.qpos[q] - joint.zero)
                qvel[v] = (spin - base_spin) @ along
            else:
                then = _rotate(_conjugate(reference.xquat[joint.parent]), reference.xpos[joint.body] - reference.xpos[joint.parent])
                arm = place - base
                qpos[q] = joint.zero + (arm - _rotate(base_turn, then)) @ along
                qvel[v] = (linear - base_linear - np.cross(base_spin, arm)) @ along
        self._data.qpos[:] = qpos
        return qpos, qvel

    def _motion(self, b: int) -> tuple[Array, Array, Array, Array]:
        """Motion of a body's frame in world axes, by the body's index in MuJoCo.

        Returns:
            Position (m), orientation (w, x, y, z), linear velocity (m/s) and angular velocity (rad/s).
        """
        if b == 0:
            return np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), np.zeros(3)
        own = self.world.rigid_bodies[self.bodies[b]]
        turn, spin = _quaternion(own.rotation), _vector(own.angvel)
        arm = _rotate(turn, _vector(own.local_center_of_mass))
        return _vector(own.translation), turn, _vector(own.linvel) - np.cross(spin, arm), spin

    def push(self, body: int, force: Array, torque: Array) -> None:
        """Apply a lasting force (N) and torque (N m) at a body's centre of mass, in world axes, (3,) each."""
        b = self.world.rigid_bodies[self.bodies[body]]
        b.reset_forces()
        b.reset_torques()
        b.add_force(tuple(map(float, force)))
        b.add_torque(tuple(map(float, torque)))

    def touches(self, dt: float) -> list[Touch]:
        """Contact points of the last step. A normal force is the impulse of the step divided by the time step `dt`, s."""
        out = []
        for pair in self.world.narrow_phase.contact_pairs():
            geoms = tuple(self._geoms[h.index, h.generation] for h in (pair.collider1, pair.collider2))
            for manifold in pair.manifolds:
                normal = np.array([manifold.data.normal.x, manifold.data.normal.y, manifold.data.normal.z])
                out.extend(Touch((geoms[0], geoms[1]), normal, float(point.impulse) / dt) for point in manifold.points)
        return out


def _world(text: str, model: mujoco.MjModel, dt: float, restitution: float | None, iterations: int | None) -> _Scene:
    """Rapier world from MJCF text.

    If rapier's MJCF loader fails, or has other bodies, shapes or masses than MuJoCo, the function raises `CannotRunError`.
    """
    try:
        robot, _ = loader.MjcfRobot.from_str(text, loader.MjcfLoaderOptions(skip_plane_geoms=False))
    except rp.MjcfError as error:
        raise CannotRunError(f"rapier's MJCF loader: {error}") from error
    world = rp.PhysicsWorld(gravity=tuple(map(float, model.opt.gravity)))
    names = [model.body(b).name for b in range(1, model.nbody)]
    if [name or "" for name in robot.body_names[1:]] != names:
        raise CannotRunError("the bodies of rapier's MJCF loader differ from those of MuJoCo")
    handles = robot.insert_using_impulse_joints(world.rigid_bodies, world.colliders, world.impulse_joints)
    world.integration_parameters.dt = dt
    if iterations is not None:
        world.integration_parameters.num_solver_iterations = iterations
    bodies, geoms = [], {}
    for b, entry in enumerate(handles.bodies):
        bodies.append(None if entry is None else entry.body)
        colliders = [] if entry is None else entry.colliders
        own = [g for g in np.flatnonzero(model.geom_bodyid == b) if model.geom_contype[g] or model.geom_conaffinity[g]]
        if len(colliders) != len(own):
            raise CannotRunError("the shapes of rapier's MJCF loader differ from those of MuJoCo")
        for g, collider in zip(own, colliders, strict=True):
            geoms[collider.handle.index, collider.handle.generation] = int(g)
            shape = world.colliders[collider.handle]
            shape.friction_combine_rule = rp.CoefficientCombineRule.MAX
            if restitution is not None:
                shape.restitution = restitution
        if entry is not None and world.rigid_bodies[entry.body].is_dynamic:
            moving = world.rigid_bodies[entry.body]
            moving.activation = rp.RigidBodyActivation.cannot_sleep()
            moving.recompute_mass_properties_from_colliders(world.colliders)
            if abs(moving.mass - float(model.body_mass[b])) > 1e-5 * float(model.body_mass[b]):
                raise CannotRunError("the masses of rapier's MJCF loader differ from those of MuJoCo")
    return _Scene(model, world, bodies, geoms)


def _nearest(angle: float, before: float) -> float:
    """Angle plus the number of full turns that brings it closest to `before`, rad. Rapier's joints do not count turns."""
    return float(angle + 2.0 * np.pi * np.round((before - angle) / (2.0 * np.pi)))


def _tuple(v: Any) -> tuple[float, ...]:
    """Numbers of a vector as a tuple, the format of rapier."""
    return tuple(float(x) for x in v)


def _vector(v: Any) -> Array:
    """NumPy vector (3,) from a vector object of rapier."""
    return np.array([v.x, v.y, v.z], float)


def _quaternion(r: Any) -> Array:
    """Unit quaternion (w, x, y, z), (4,), from a quaternion object of rapier."""
    q = np.array([r.w, r.i, r.j, r.k], float)
    norm = float(np.linalg.norm(q))
    return q / norm if norm > _ZERO else q


def _conjugate(q: Array) -> Array:
    """Conjugate of a quaternion (w, x, y, z)."""
    return np.array([q[0], -q[1], -q[2], -q[3]])


def _product(a: Array, b: Array) -> Array:
    """Product of two quaternions (w, x, y, z)."""
    w, x = a[0], a[1:]
    return np.array([w * b[0] - x @ b[1:], *(w * b[1:] + b[0] * x + np.cross(x, b[1:]))])


def _rotate(q: Array, v: Array) -> Array:
    """Vector (3,) rotated by a unit quaternion (4,), in the unit of the vector."""
    twice = 2.0 * np.cross(q[1:], v)
    turned: Array = v + q[0] * twice + np.cross(q[1:], twice)
    return turned
