"""Environments in the engine rapier, built from MuJoCo's compiled model.

Rapier (https://rapier.rs, the package rapier3d) has hard contact and computes in 32 bits. Scenes may have free bodies, hinges and slides
with simple shapes. States are in MuJoCo's layout. MuJoCo's kinematics and narrow phase compute body poses, position sensors and
penetrations from them, so that all engines are measured in the same way.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper._status import Status
from stepper._stepper import Model, ModelError
from stepper.lab.study.worlds import MujocoWorld, Plan
from stepper.shared.machine import INSTALL, require

Array = NDArray[np.float64]
SETTINGS = ("timestep", "iterations")
"""Settings of rapier: the time step, and the iterations of its solver (4 by default)."""
_ZERO = 1e-12
"""Norm below which a quaternion is not normalised."""


def not_installed() -> str | None:
    """Message with the command that installs rapier, or None if it is installed."""
    return None if importlib.util.find_spec("rapier3d") else f"it is not installed: {INSTALL['rapier3d']}"


def lacks(compiled: Any, model: Model) -> str | None:
    """Reason why rapier cannot run a scene: an element that it lacks or defines differently from MJCF. None if it can.

    Args:
        compiled: The scene's `mujoco.MjModel`.
        model: The scene's `stepper.Model`.
    """
    mujoco = require("mujoco", "to run a study in rapier")
    if np.any(np.asarray(model.geom_restitution) != 0):
        return "it defines restitution differently from stepper"
    return next((words for words, lacking in _LACKS if lacking(compiled, mujoco)), None)


_Lack = Callable[[Any, Any], bool]
"""Test whether a scene has something that rapier lacks: function of an `MjModel` and the module `mujoco` that returns a bool."""


def _colliding(m: Any) -> NDArray[np.intp]:
    """Indices of the geoms that can collide."""
    return np.flatnonzero((m.geom_contype != 0) | (m.geom_conaffinity != 0))


def _other_joints(m: Any, mujoco: Any) -> bool:
    """Whether an `MjModel` has ball joints, or a body with several joints, which the rapier scene does not support."""
    return bool(np.any(m.jnt_type == mujoco.mjtJoint.mjJNT_BALL)) or bool(np.any(m.body_jntnum > 1))


def _other_shapes(m: Any, mujoco: Any) -> bool:
    """Whether a colliding geom has a shape that rapier does not support."""
    kinds = mujoco.mjtGeom
    known = (kinds.mjGEOM_PLANE, kinds.mjGEOM_SPHERE, kinds.mjGEOM_CAPSULE, kinds.mjGEOM_BOX, kinds.mjGEOM_CYLINDER)
    return not np.isin(m.geom_type[_colliding(m)], [int(kind) for kind in known]).all()


def _joint_forces(m: Any, _: Any) -> bool:
    """Whether a joint of an `MjModel` has damping, armature, dry friction or a spring."""
    return any(np.any(own != 0) for own in (m.dof_damping, m.dof_armature, m.dof_frictionloss, m.jnt_stiffness))


def _other_friction(m: Any, _: Any) -> bool:
    """Whether condim of an `MjModel` differs between colliding geoms, or is neither 1 nor 3."""
    own = _colliding(m)
    return not np.isin(m.geom_condim[own], (1, 3)).all() or len({int(x) for x in m.geom_condim[own]}) > 1


def _other_contacts(m: Any, mujoco: Any) -> bool:
    """Whether contacts of an `MjModel` have settings that the rapier scene does not support, such as margins or pairs."""
    own = _colliding(m)
    off = mujoco.mjtDisableBit
    flags = off.mjDSBL_CONTACT | off.mjDSBL_LIMIT | off.mjDSBL_CONSTRAINT | off.mjDSBL_FILTERPARENT | off.mjDSBL_GRAVITY
    return bool(m.nexclude or m.npair or m.geom_margin[own].any() or len(set(m.geom_priority[own])) > 1 or m.opt.disableflags & int(flags))


def _senses_accelerations(m: Any, mujoco: Any) -> bool:
    """Whether a sensor of an `MjModel` depends on accelerations or contact forces."""
    return bool(m.nsensor and np.any(m.sensor_needstage == int(mujoco.mjtStage.mjSTAGE_ACC)))


_LACKS: tuple[tuple[str, _Lack], ...] = (
    ("it has no actuators in the sense of MJCF", lambda m, _: m.nu > 0),
    ("it has no tendons", lambda m, _: m.ntendon > 0),
    ("it has no equalities in the sense of MJCF", lambda m, _: m.neq > 0),
    ("it has no flexes", lambda m, _: m.nflex > 0),
    ("mocap bodies are not supported", lambda m, _: m.nmocap > 0),
    ("it has no fluid forces (density, viscosity)", lambda m, _: bool(m.opt.density or m.opt.viscosity)),
    ("it has no gravity compensation", lambda m, _: bool(np.any(m.body_gravcomp != 0))),
    ("it supports free joints, hinges and slides, one joint per body, and the model has others", _other_joints),
    ("its joints have no damping, armature, friction or springs in the sense of MJCF", _joint_forces),
    ("it supports planes, spheres, boxes, capsules and cylinders, and the model has other colliding shapes", _other_shapes),
    ("it needs condim 3 for all geoms, or condim 1 for all geoms", _other_friction),
    ("it has no margins, priorities, exclusions and explicit pairs in the sense of MJCF", _other_contacts),
    ("its contact forces and accelerations cannot be read, and the model has sensors of them", _senses_accelerations),
)
"""Reasons why rapier cannot run a scene, each with the test of an `MjModel` that detects it."""


class RapierWorld(MujocoWorld):
    """World of the engine rapier, with a rapier scene for each environment. MuJoCo computes derived quantities of its states."""

    engine = "rapier"

    def __init__(self, plan: Plan, num_envs: int, settings: Mapping[str, Any]):
        reason = not_installed()
        if plan.compiled is None:
            reason = reason or "the model has no source that MuJoCo can read"
        if reason := reason or lacks(plan.compiled, plan.model):
            raise ModelError(f"rapier cannot run this study: {reason}")
        if unknown := set(settings) - set(SETTINGS):
            raise ValueError(f"rapier has no settings {sorted(unknown)}, there are: {', '.join(SETTINGS)}")
        super().__init__(replace(plan, mujoco={name: own for name, own in settings.items() if name == "timestep"}), num_envs)
        self._rapier = require("rapier3d", "to run a study in rapier")
        self._iterations: int | None = settings.get("iterations")
        self._scenes: list[_Scene] = []
        self._behind = False
        self._lost = np.zeros(num_envs, np.bool_)

    def start(self, qpos: Array, qvel: Array, keyframe: str | int | None, seed: int) -> None:
        """Starts an episode in new rapier scenes, so that no contacts of earlier episodes remain.

        Args:
            qpos: Initial positions, (num_envs, nq), m and rad.
            qvel: Initial velocities, (num_envs, nv), m/s and rad/s.
            keyframe: Unused, because rapier scenes have no controls.
            seed: Unused, because sensors are ideal.
        """
        super().start(qpos, qvel, keyframe, seed)
        self._scenes = [_Scene(self._rapier, self._mujoco, model, self._iterations) for model in self._models]
        for scene, q, v in zip(self._scenes, qpos, qvel, strict=True):
            scene.put(q, v)
        self._behind, self._depth[:], self._lost[:] = False, 0.0, False

    def advance(self, ctrl: Any, nstep: int) -> None:
        """Steps all environments `nstep` times, and updates the deepest penetration of the episode, which `certificate` returns.

        Args:
            ctrl: Ignored, because models with actuators are rejected.
            nstep: Number of steps.
        """
        self.step(ctrl, nstep)
        for env, data in enumerate(self._now()):
            self._depth[env] = max(self._depth[env], max((float(-c.dist) for c in data.contact), default=0.0))

    def step(self, ctrl: Any, nstep: int) -> None:
        """Advances all environments by `nstep` time steps. `ctrl` is ignored, because models with actuators are rejected."""
        for env, scene in enumerate(self._scenes):
            scene.push(self._applied[env])
            for _ in range(nstep):
                scene.world.step()
        self.time = self.time + nstep * self.timestep
        self._is_current, self._behind = False, True

    @property
    def qpos(self) -> Array:
        """Positions, (num_envs, nq), m and rad."""
        self._read()
        return super().qpos

    @property
    def qvel(self) -> Array:
        """Velocities, (num_envs, nv), m/s and rad/s."""
        self._read()
        return super().qvel

    def contacts(self) -> NDArray[np.void]:
        """Raises ModelError, because rapier's contact forces cannot be read."""
        raise ModelError("rapier cannot run this study: its controller or an outcome reads contact forces, which rapier does not give")

    def _now(self) -> list[Any]:
        self._read()
        return super()._now()

    def _read(self) -> None:
        """Copies states of the scenes to MuJoCo's data. A scene whose state is not finite keeps its last finite state."""
        if not self._behind:
            return
        self._behind = False
        for env, (scene, data) in enumerate(zip(self._scenes, self._data, strict=True)):
            qpos, qvel = scene.state()
            if np.isfinite(qpos).all() and np.isfinite(qvel).all():
                data.qpos[:], data.qvel[:] = qpos, qvel
            else:
                self._lost[env] = True
            data.time = self.time[env]

    def certificate(self) -> dict[str, NDArray[Any]]:
        """Quality of the steps of the episode so far, by name, (num_envs,) each.

        "status" has the flag `Status.NON_FINITE` if a state was not finite. "max_penetration" is the deepest penetration after a control
        period, m. Other entries are NaN.
        """
        self._read()
        nothing = np.full(self.num_envs, np.nan)
        return {
            "status": np.where(self._lost, int(Status.NON_FINITE), 0),
            "residual": nothing,
            "max_penetration": self._depth,
            "max_limit_violation": nothing,
            "max_equality_violation": nothing,
        }

    def settings(self) -> dict[str, Any]:
        """All settings of the step, with defaults filled in."""
        defaults = self._rapier.IntegrationParameters()
        return {
            "engine": self.engine,
            "contact": "rapier",
            "timestep": self.timestep,
            "iterations": self._iterations or defaults.num_solver_iterations,
            "precision": "f32",
        }


@dataclass(frozen=True)
class RapierJoint:
    """Joint between two bodies. In both bodies its frame is at the anchor, with the axis along x.

    Attributes:
        body, parent: Indices of the bodies in MuJoCo; 0 is the world.
        kind: Type of the joint, as in `mujoco.mjtJoint`.
        qpos, qvel: First index in qpos and qvel.
        low, high: Limits, m or rad; infinite without a limit.
        zero: Position at the reference pose, m or rad.
    """

    body: int
    parent: int
    kind: int
    qpos: int
    qvel: int
    low: float
    high: float
    zero: float


class RapierScene:
    """Rapier world of a model, which reads and writes states in MuJoCo's layout.

    Args:
        rapier: The library rapier3d.
        mujoco: The library MuJoCo.
        model: `mujoco.MjModel` of the scene.
        world: World of rapier with the scene.

    Attributes:
        bodies: Handles of rapier's bodies by index in MuJoCo; 0 is the world.
        joints: Joints of the model.
    """

    def __init__(self, rapier: Any, mujoco: Any, model: Any, world: Any):
        self._rp, self._mujoco, self._model, self._data, self.world = rapier, mujoco, model, mujoco.MjData(model), world
        self.bodies: dict[int, Any] = {}
        self.joints: list[RapierJoint] = []

    def put(self, qpos: Array, qvel: Array) -> None:
        """Sets the state of the rapier scene: qpos (nq,), m and rad, and qvel (nv,), m/s and rad/s."""
        m, d, mujoco = self._model, self._data, self._mujoco
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
            own.rotation = self._rotation(d.xquat[b])
            mujoco.mj_objectVelocity(m, d, mujoco.mjtObj.mjOBJ_XBODY, b, velocity, 0)
            # Rapier's linear velocity is that of the centre of mass.
            arm = _rotate(d.xquat[b], _vector(own.local_center_of_mass))
            own.linvel, own.angvel = _tuple(velocity[3:] + np.cross(velocity[:3], arm)), _tuple(velocity[:3])

    @property
    def _at_reference(self) -> Any:
        """`mujoco.MjData` at the reference pose."""
        if not hasattr(self, "_reference"):
            self._reference = self._mujoco.MjData(self._model)
            self._mujoco.mj_kinematics(self._model, self._reference)
            self._mujoco.mj_comPos(self._model, self._reference)
        return self._reference

    def state(self) -> tuple[Array, Array]:
        """Positions (nq,), m and rad, and velocities (nv,), m/s and rad/s, in MuJoCo's layout."""
        m = self._model
        qpos, qvel = np.array(m.qpos0, float), np.zeros(m.nv)
        for joint in self.joints:
            place, turn, linear, spin = self._motion(joint.body)
            q, v = joint.qpos, joint.qvel
            if joint.kind == self._mujoco.mjtJoint.mjJNT_FREE:
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
            if joint.kind == self._mujoco.mjtJoint.mjJNT_BALL:
                qpos[q : q + 4], qvel[v : v + 3] = since, _rotate(_conjugate(turn), spin - base_spin)
            elif joint.kind == self._mujoco.mjtJoint.mjJNT_HINGE:
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

    def _rotation(self, q: Array) -> Any:
        return self._rp.Rotation3.from_quaternion(*_tuple(q))


class _Scene(RapierScene):
    """Rapier scene built from MuJoCo's model. Bodies without joints are merged with the bodies to which they are fixed."""

    def __init__(self, rapier: Any, mujoco: Any, model: Any, iterations: int | None):
        super().__init__(rapier, mujoco, model, rapier.PhysicsWorld(gravity=_tuple(model.opt.gravity)))
        mujoco.mj_kinematics(model, self._data)
        mujoco.mj_comPos(model, self._data)
        self.world.integration_parameters.dt = float(model.opt.timestep)
        if iterations is not None:
            self.world.integration_parameters.num_solver_iterations = int(iterations)
        self.bodies = {0: self.world.add_body(rapier.RigidBody.fixed())}
        for b in range(1, model.nbody):
            if model.body_weldid[b] == b:
                self.bodies[b] = self._body(b)
        for g in _colliding(model):
            self._collider(int(g))
        for b, handle in self.bodies.items():
            if b:
                # Before this call a body does not have its given mass and centre of mass.
                self.world.rigid_bodies[handle].recompute_mass_properties_from_colliders(self.world.colliders)
        self.joints = [self._joint(j) for j in range(model.njnt)]

    def push(self, applied: Array) -> None:
        """Applies forces (N) and torques (N m) to bodies, (nbody, 6). The forces act until the next call."""
        done: set[int] = set()
        for b in range(1, self._model.nbody):
            root = int(self._model.body_weldid[b])
            if root == 0:
                continue
            own = self.world.rigid_bodies[self.bodies[root]]
            if root not in done:
                own.reset_forces(False)
                own.reset_torques(False)
                done.add(root)
            if applied[b].any():
                local = self._centre_of_mass(b, root)
                place = _vector(own.translation) + _rotate(_quaternion(own.rotation), local)
                own.add_force_at_point(_tuple(applied[b, :3]), _tuple(place))
                own.add_torque(_tuple(applied[b, 3:]))

    def _centre_of_mass(self, b: int, root: int) -> Array:
        """Centre of mass of body b, in the frame of the body `root` to which it is fixed, (3,), m."""
        reference = self._at_reference
        return _rotate(_conjugate(reference.xquat[root]), reference.xipos[b] - reference.xpos[root])

    def _body(self, b: int) -> Any:
        """Adds a body to the rapier scene, with the mass of MuJoCo's body b and of all bodies fixed to it, and returns its handle."""
        m, d, rp = self._model, self._data, self._rp
        parts = np.flatnonzero(m.body_weldid == b)
        mass = float(m.body_mass[parts].sum())
        turn = d.xmat[b].reshape(3, 3)
        if mass <= 0:
            raise ModelError(f"rapier cannot run this: body {m.body(b).name or b} has no mass")
        centre = m.body_mass[parts] @ d.xipos[parts] / mass
        inertia = np.zeros((3, 3))
        for p in parts:
            own, arm = d.ximat[p].reshape(3, 3), d.xipos[p] - centre
            inertia += own @ np.diag(m.body_inertia[p]) @ own.T + m.body_mass[p] * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        principal, axes = np.linalg.eigh(turn.T @ inertia @ turn)
        axes[:, 2] *= np.sign(np.linalg.det(axes))
        properties = rp.MassProperties(
            local_com=_tuple(turn.T @ (centre - d.xpos[b])),
            mass=mass,
            principal_inertia=_tuple(principal),
            principal_inertia_local_frame=self._rotation(self._quaternion(axes)),
        )
        builder = rp.RigidBody.dynamic().additional_mass_properties(properties).can_sleep(False)
        handle = self.world.add_body(builder)
        own = self.world.rigid_bodies[handle]
        own.translation, own.rotation = _tuple(d.xpos[b]), self._rotation(d.xquat[b])
        return handle

    def _collider(self, g: int) -> None:
        """Adds the geom with index g in MuJoCo to the rapier scene, as a collider."""
        m, d, rp, kinds = self._model, self._data, self._rp, self._mujoco.mjtGeom
        root = int(m.body_weldid[m.geom_bodyid[g]])
        size, kind = [float(x) for x in m.geom_size[g]], m.geom_type[g]
        quaternion = self._quaternion(d.geom_xmat[g].reshape(3, 3))
        if kind == kinds.mjGEOM_PLANE:
            shape = rp.Collider.halfspace((0.0, 0.0, 1.0))
        elif kind == kinds.mjGEOM_SPHERE:
            shape = rp.Collider.ball(size[0])
        elif kind == kinds.mjGEOM_BOX:
            shape = rp.Collider.cuboid(*size)
        elif kind == kinds.mjGEOM_CAPSULE:
            shape = rp.Collider.capsule_z(size[1], size[0])
        else:
            shape = rp.Collider.cylinder(size[1], size[0])
            # Rapier's cylinders stand along y.
            quaternion = _product(quaternion, np.array([np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0]))
        place = d.geom_xpos[g]
        if root:
            back = _conjugate(d.xquat[root])
            place, quaternion = _rotate(back, place - d.xpos[root]), _product(back, quaternion)
        groups = rp.InteractionGroups(
            memberships=rp.Group(int(m.geom_contype[g]) & 0xFFFFFFFF),
            filter=rp.Group(int(m.geom_conaffinity[g]) & 0xFFFFFFFF),
            test_mode=rp.InteractionTestMode.OR,
        )
        shape = shape.density(0.0).position(rp.Isometry3(_tuple(place), self._rotation(quaternion))).collision_groups(groups)
        friction = float(m.geom_friction[g, 0]) if m.geom_condim[g] > 1 else 0.0
        shape = shape.friction(friction).friction_combine_rule(rp.CoefficientCombineRule.MAX).restitution(0.0)
        self.world.add_collider(shape, self.bodies[root] if root else None)

    def _joint(self, j: int) -> RapierJoint:
        """Adds the joint with index j in MuJoCo to the rapier scene, and returns its data."""
        m, d, rp, kinds = self._model, self._data, self._rp, self._mujoco.mjtJoint
        b, kind = int(m.jnt_bodyid[j]), int(m.jnt_type[j])
        parent, q, v = int(m.body_weldid[m.body_parentid[b]]), int(m.jnt_qposadr[j]), int(m.jnt_dofadr[j])
        low, high = (float(x) for x in m.jnt_range[j]) if m.jnt_limited[j] else (-np.inf, np.inf)
        found = RapierJoint(b, parent, kind, q, v, low, high, 0.0 if kind == kinds.mjJNT_FREE else float(m.qpos0[q]))
        if kind == kinds.mjJNT_FREE:
            return found
        frame = self._quaternion(_along_x(d.xaxis[j]))
        hinge = kind == kinds.mjJNT_HINGE
        made = rp.GenericJointBuilder(rp.JointAxesMask.LOCKED_REVOLUTE_AXES if hinge else rp.JointAxesMask.LOCKED_PRISMATIC_AXES)
        made = made.local_frame1(self._local(parent, d.xanchor[j], frame)).local_frame2(self._local(b, d.xanchor[j], frame))
        if np.isfinite(low):
            made = made.limits(rp.JointAxis.ANG_X if hinge else rp.JointAxis.LIN_X, low - found.zero, high - found.zero)
        # As in MuJoCo, a body and its parent do not collide, unless the parent is fixed to the world.
        self.world.impulse_joints.insert(self.bodies[parent], self.bodies[b], made.contacts_enabled(parent == 0).build())
        return found

    def _local(self, b: int, place: Array, turn: Array) -> Any:
        """Frame in the coordinates of body b, as an object of rapier.

        Args:
            b: Index of the body in MuJoCo.
            place: Position of the frame in the world, (3,), m.
            turn: Orientation of the frame in the world, quaternion (w, x, y, z).
        """
        back = _conjugate(self._data.xquat[b])
        return self._rp.Isometry3(_tuple(_rotate(back, place - self._data.xpos[b])), self._rotation(_product(back, turn)))

    def _quaternion(self, matrix: Array) -> Array:
        """Quaternion (w, x, y, z), (4,), of a rotation matrix (3, 3)."""
        q = np.zeros(4)
        self._mujoco.mju_mat2Quat(q, np.ascontiguousarray(matrix, float).ravel())
        return q


def _along_x(axis: Array) -> Array:
    """Rotation matrix whose first column is the direction of an axis, (3, 3)."""
    first = axis / np.linalg.norm(axis)
    second = np.cross(first, np.eye(3)[int(np.argmin(np.abs(first)))])
    second /= np.linalg.norm(second)
    return np.stack([first, second, np.cross(first, second)], axis=1)


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
