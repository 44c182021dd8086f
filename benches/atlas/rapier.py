"""Scenes in rapier: bodies, shapes and joints by its own MJCF loader, states in MuJoCo's layout."""

from __future__ import annotations

import mujoco
import numpy as np
import rapier3d as rp
from numpy.typing import ArrayLike
from rapier3d.loaders import mjcf as loader

from atlas.world import Array, CannotRunError, DivergedError, Touch, World

FREE, SLIDE, HINGE = (int(t) for t in (mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE))


class RapierWorld(World):
    """One world per environment; joints are impulse joints, which is the loader's first way and has loops."""

    def __init__(self, mjcf: str, dt: float, num_envs: int, restitution: float | None, iterations: int | None) -> None:
        super().__init__(mjcf, dt, num_envs)
        self._refuse()
        self._worlds = [_world(mjcf, self.model, dt, restitution, iterations) for _ in range(num_envs)]
        self.set(np.tile(self.model.qpos0, (num_envs, 1)), np.zeros((num_envs, self.model.nv)))

    def _refuse(self) -> None:
        m = self.model
        if m.nmocap or m.ntendon or m.nu:
            raise CannotRunError("rapier: no mocap bodies, tendons or actuators as MJCF means them")
        if (m.body_jntnum > 1).any():
            raise CannotRunError("rapier: one joint per body")
        if (m.geom_type == mujoco.mjtGeom.mjGEOM_ELLIPSOID).any():
            raise CannotRunError("rapier: no ellipsoids")
        if self.surfaces.any():
            raise CannotRunError("rapier's MJCF loader takes a mesh for its hull")

    def _joints(self) -> list[tuple[int, int, int, int, int]]:
        """(body, parent, type, index in qpos, index in qvel) of every joint."""
        m = self.model
        return [
            (int(b), int(m.body_parentid[b]), int(m.jnt_type[j]), int(m.jnt_qposadr[j]), int(m.jnt_dofadr[j]))
            for j, b in enumerate(m.jnt_bodyid)
        ]

    @property
    def qpos(self) -> Array:
        """See `World`."""
        return np.array([self._state(w)[0] for w in self._worlds])

    @property
    def qvel(self) -> Array:
        """See `World`."""
        return np.array([self._state(w)[1] for w in self._worlds])

    def _state(self, world: _Loaded) -> tuple[Array, Array]:
        m = self.model
        qpos, qvel = m.qpos0.copy(), np.zeros(m.nv)
        for j, (b, parent, kind, q, v) in enumerate(self._joints()):
            place, turn, linear, spin = world.motion(b)
            if kind == FREE:
                qpos[q : q + 7] = [*place, *turn]
                qvel[v : v + 6] = [*linear, *_rotate(_conjugate(turn), spin)]
                continue
            base, base_turn, base_linear, base_spin = world.motion(parent)
            relative = _product(_conjugate(m.body_quat[b]), _product(_conjugate(base_turn), turn))
            axis = m.jnt_axis[j]
            if kind == HINGE:
                qpos[q] = 2.0 * np.arctan2(relative[1:] @ axis, relative[0])
                qpos[q] = (qpos[q] + np.pi) % (2.0 * np.pi) - np.pi
                qvel[v] = (spin - base_spin) @ _rotate(turn, axis)
            elif kind == SLIDE:
                along = _rotate(base_turn, _rotate(m.body_quat[b], axis))
                arm = place - base
                qpos[q] = (arm - _rotate(base_turn, m.body_pos[b])) @ along
                qvel[v] = (linear - base_linear - np.cross(base_spin, arm)) @ along
            else:
                qpos[q : q + 4] = relative
                qvel[v : v + 3] = _rotate(_conjugate(turn), spin - base_spin)
        return qpos, qvel

    def set(self, qpos: ArrayLike | None = None, qvel: ArrayLike | None = None) -> None:
        """See `World`."""
        m, d = self.model, self._yard
        old_qpos, old_qvel = self.qpos, self.qvel
        qpos = old_qpos if qpos is None else np.broadcast_to(np.asarray(qpos, float), old_qpos.shape)
        qvel = old_qvel if qvel is None else np.broadcast_to(np.asarray(qvel, float), old_qvel.shape)
        velocity = np.zeros(6)
        for world, q, v in zip(self._worlds, qpos, qvel, strict=True):
            d.qpos[:], d.qvel[:] = q, v
            mujoco.mj_kinematics(m, d)
            mujoco.mj_comPos(m, d)
            mujoco.mj_comVel(m, d)
            for b in range(1, m.nbody):
                mujoco.mj_objectVelocity(m, d, mujoco.mjtObj.mjOBJ_XBODY, b, velocity, 0)
                # Rapier's linear velocity is that of the centre of mass.
                arm = d.xipos[b] - d.xpos[b]
                world.place(b, d.xpos[b], d.xquat[b], velocity[3:] + np.cross(velocity[:3], arm), velocity[:3])

    def push(self, body: str, force: ArrayLike, torque: ArrayLike = (0, 0, 0)) -> None:
        """See `World`."""
        for env, world in enumerate(self._worlds):
            parts = (np.broadcast_to(np.asarray(part, float), (self.num_envs, 3))[env] for part in (force, torque))
            world.push(self.body(body), *parts)

    def touches(self, env: int = 0) -> list[Touch]:
        """See `World`."""
        return self._worlds[env].touches(self.dt)

    def _advance(self, ctrl: Array | None, nstep: int) -> None:
        for world in self._worlds:
            for _ in range(nstep):
                world.world.step()

    def _check(self) -> None:
        if not all(np.isfinite(self._state(w)[0]).all() for w in self._worlds):
            raise DivergedError("rapier's state is not finite")


class _Loaded:
    """A rapier world, and which of its bodies and colliders are which of MuJoCo's."""

    def __init__(self, world: rp.PhysicsWorld, handles: list[rp.RigidBodyHandle | None], geoms: dict[tuple[int, int], int]) -> None:
        self.world = world
        self._handles = handles
        self._geoms = geoms
        self._rest = (np.zeros(3), np.array([1.0, 0, 0, 0]), np.zeros(3), np.zeros(3))

    def motion(self, body: int) -> tuple[Array, Array, Array, Array]:
        """Place and orientation of a body's frame, linear velocity of its origin, angular velocity; world axes."""
        handle = self._handles[body]
        if body == 0 or handle is None:
            return self._rest
        b = self.world.rigid_bodies[handle]
        place, turn = _vector(b.translation), np.array([b.rotation.w, b.rotation.i, b.rotation.j, b.rotation.k])
        spin, centre = _vector(b.angvel), _vector(b.center_of_mass)
        return place, turn / np.linalg.norm(turn), _vector(b.linvel) - np.cross(spin, centre - place), spin

    def place(self, body: int, at: Array, turn: Array, linear: Array, spin: Array) -> None:
        """Puts a body somewhere with velocities of its centre of mass."""
        handle = self._handles[body]
        if handle is None:
            return
        b = self.world.rigid_bodies[handle]
        if b.is_fixed:
            return
        b.translation = tuple(map(float, at))
        angle = 2.0 * np.arctan2(np.linalg.norm(turn[1:]), turn[0])
        axis = turn[1:] / max(float(np.linalg.norm(turn[1:])), 1e-300)
        b.rotation = rp.Rotation3.from_scaled_axis(tuple(map(float, axis * angle)))
        b.linvel, b.angvel = tuple(map(float, linear)), tuple(map(float, spin))

    def push(self, body: int, force: Array, torque: Array) -> None:
        """A lasting force and torque."""
        b = self.world.rigid_bodies[self._handles[body]]
        b.reset_forces()
        b.reset_torques()
        b.add_force(tuple(map(float, force)))
        b.add_torque(tuple(map(float, torque)))

    def touches(self, dt: float) -> list[Touch]:
        """Points of contact with their impulse over the step."""
        out = []
        for pair in self.world.narrow_phase.contact_pairs():
            geoms = tuple(self._geoms[h.index, h.generation] for h in (pair.collider1, pair.collider2))
            for manifold in pair.manifolds:
                normal = _vector(manifold.data.normal)
                out.extend(Touch((geoms[0], geoms[1]), normal, float(point.impulse) / dt) for point in manifold.points)
        return out


def _world(text: str, model: mujoco.MjModel, dt: float, restitution: float | None, iterations: int | None) -> _Loaded:
    try:
        robot, _ = loader.MjcfRobot.from_str(text, loader.MjcfLoaderOptions(skip_plane_geoms=False))
    except rp.MjcfError as error:
        raise CannotRunError(f"rapier's MJCF loader: {error}") from error
    world = rp.PhysicsWorld(gravity=tuple(map(float, model.opt.gravity)))
    names = [model.body(b).name for b in range(1, model.nbody)]
    if [name or "" for name in robot.body_names[1:]] != names:
        raise CannotRunError("rapier's MJCF loader has other bodies than MuJoCo")
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
            raise CannotRunError("rapier's MJCF loader has other shapes than MuJoCo")
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
                raise CannotRunError("rapier's MJCF loader has other masses than MuJoCo")
    return _Loaded(world, bodies, geoms)


def _vector(v: rp.Vec3) -> Array:
    return np.array([v.x, v.y, v.z], dtype=np.float64)


def _conjugate(q: Array) -> Array:
    return np.array([q[0], -q[1], -q[2], -q[3]])


def _product(a: Array, b: Array) -> Array:
    out = np.zeros(4)
    mujoco.mju_mulQuat(out, a, b)
    return out


def _rotate(q: Array, v: Array) -> Array:
    out = np.zeros(3)
    mujoco.mju_rotVecQuat(out, v, q)
    return out
