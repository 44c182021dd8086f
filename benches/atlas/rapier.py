"""Engine rapier: bodies, shapes and joints come from rapier's MJCF loader, and states have MuJoCo's layout."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import rapier3d as rp
from numpy.typing import ArrayLike
from rapier3d.loaders import mjcf as loader
from stepper.lab.study.rapier import RapierJoint, RapierScene

from atlas.world import Array, CannotRunError, DivergedError, Touch, World

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


class _Loaded(RapierScene):
    """World of rapier that rapier's MJCF loader has made, with MuJoCo's index of the geom of each collider."""

    def __init__(
        self, model: mujoco.MjModel, world: rp.PhysicsWorld, handles: list[rp.RigidBodyHandle | None], geoms: dict[Any, int]
    ) -> None:
        super().__init__(rp, mujoco, model, world)
        self.bodies = {b: handle for b, handle in enumerate(handles) if b and handle is not None and model.body_weldid[b]}
        for j, b in enumerate(int(b) for b in model.jnt_bodyid):
            parent, kind, q = int(model.body_weldid[model.body_parentid[b]]), int(model.jnt_type[j]), int(model.jnt_qposadr[j])
            zero = float(model.qpos0[q]) if kind in (SLIDE, HINGE) else 0.0
            self.joints.append(RapierJoint(b, parent, kind, q, int(model.jnt_dofadr[j]), -np.inf, np.inf, zero))
        self._geoms = geoms

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


def _world(text: str, model: mujoco.MjModel, dt: float, restitution: float | None, iterations: int | None) -> _Loaded:
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
    return _Loaded(model, world, bodies, geoms)
