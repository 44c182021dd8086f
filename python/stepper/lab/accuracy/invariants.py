"""Invariants: quantities that every correct motion conserves or bounds, and their errors in a run.

docs/reference/studies.md defines them. The errors are computed from positions and velocities after every control period, in the same way
for every engine. MuJoCo's library computes kinematics, energies and overlaps; an engine's own diagnostics are not used. The model
determines the invariants of a scene. The chart lists those that do not apply, with the reasons.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper.lab.accuracy.traces import Trace
from stepper.lab.study.parameters import model_fields
from stepper.lab.study.study import Study
from stepper.lab.study.worlds import with_fields
from stepper.shared.machine import require

Array = NDArray[np.float64]
_INITIAL_VIOLATION = 1e-6
"""Largest initial overlap, limit violation or loop error of an episode whose energy error is measured, m and rad."""


@dataclass(frozen=True)
class Invariant:
    """Quantity that is conserved or bounded in every correct motion.

    Attributes:
        name: Name of the quantity.
        unit: Unit of its error.
    """

    name: str
    unit: str

    @property
    def label(self) -> str:
        """Name and unit of the invariant, for tables and pictures."""
        return f"{self.name}, {self.unit}" if self.unit else self.name


PENETRATION = Invariant("penetration", "m")
LIMITS = {"m": Invariant("limits of slides", "m"), "rad": Invariant("limits of joints", "rad")}
LOOPS = {"m": Invariant("loops", "m"), "rad": Invariant("loops", "rad")}
NORM = Invariant("quaternion norm", "")
ENERGY, CONSERVED = Invariant("energy gained", "J"), Invariant("energy changed", "J")
"""Invariants of the energy: `CONSERVED` in scenes without dissipation, `ENERGY` in others."""
MOMENTUM = Invariant("momentum", "kg m/s")
ANGULAR = Invariant("angular momentum", "kg m2/s")


@dataclass(frozen=True)
class _Measured:
    """Measurements of one state (positions and velocities) with MuJoCo's library.

    Attributes:
        errors: Position errors by invariant, m or rad.
        energy: Kinetic and potential energy, J.
        momentum: Momentum, (3,), kg m/s.
        angular: Angular momentum about the centre of mass, (3,), kg m^2/s.
        lengths: Lengths of the actuators, (nu,), m or rad.
    """

    errors: dict[Invariant, float]
    energy: float
    momentum: Array
    angular: Array
    lengths: Array


class Invariants:
    """Invariants (conserved or bounded quantities) of a study's scene with nominal parameters.

    Attributes:
        kinds: Invariants that apply to the scene.
        left_out: Invariants that do not apply, each with the reason.
    """

    def __init__(self, study: Study):
        self._study, self._model = study, _nominal(study)
        self.kinds: list[Invariant] = []
        self.left_out: list[str] = []
        model = study.loaded[0]
        if any(model.joint(j).type in ("free", "ball") for j in range(model.njnt)):
            self.kinds.append(NORM)
        if self._model is None:
            self.left_out.append("all but norms of quaternions, because the model has no source that MuJoCo can read")
            return
        self._mujoco = require("mujoco", "to measure invariants")
        self._data = self._mujoco.MjData(self._model)
        self._choose()

    def _choose(self) -> None:
        """Sets the lists of invariants that apply to the scene (`kinds`) and that do not (`left_out`), from properties of the scene."""
        m, mujoco = self._model, self._mujoco
        collides = bool(m.npair or (np.any(m.geom_contype) and np.any(m.geom_conaffinity)))
        if collides and not m.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_CONTACT):
            self.kinds.append(PENETRATION)
        limited = m.jnt_type[np.flatnonzero(m.jnt_limited)]
        slides = bool(np.any(limited == mujoco.mjtJoint.mjJNT_SLIDE)) or bool(np.any(m.tendon_limited))
        turns = bool(np.any(limited != mujoco.mjtJoint.mjJNT_SLIDE))
        self.kinds += [LIMITS[unit] for unit, there in (("m", slides), ("rad", turns)) if there]
        units = {unit for e in range(m.neq) if m.eq_active0[e] for unit in self._units(e)}
        self.kinds += [LOOPS[unit] for unit in ("m", "rad") if unit in units]
        inflow, losses = _inflow(self._study, m, mujoco), _may_dissipate(m, mujoco, self.kinds)
        if inflow:
            self.left_out.append(f"energy, because {inflow}")
        else:
            self.kinds.append(ENERGY if losses else CONSERVED)
        if outside := _outside(self._study, m, mujoco):
            self.left_out.append(f"momentum, because {outside}")
        else:
            self.kinds += [MOMENTUM, ANGULAR]

    def measure(self, trace: Trace) -> dict[Invariant, Array]:
        """Largest error of every invariant in every episode, (episodes,), in its unit, over the finite part of the run.

        Values are NaN in these cases:

        * The episode diverged within its first control period.
        * Energy: the episode starts with an overlap, a violated limit or an open kinematic loop. The correction would add energy.
        * Energy and momentum: the controller applies forces to bodies.
        """
        found = {kind: np.full(len(trace.qpos), np.nan) for kind in self.kinds}
        for e in range(len(trace.qpos)):
            sound = np.isfinite(np.concatenate([trace.path[0][:, e], trace.path[1][:, e]], axis=1)).all(axis=1)
            count = int(np.argmin(sound)) if not sound.all() else len(sound)
            if count:
                for kind, error in self._episode(trace, e, count).items():
                    found[kind][e] = error
        return found

    def _episode(self, trace: Trace, e: int, count: int) -> dict[Invariant, float]:
        """Largest error of every invariant in one episode."""
        path = [(trace.qpos[e], trace.qvel[e]), *zip(trace.path[0][:count, e], trace.path[1][:count, e], strict=True)]
        errors: dict[Invariant, float] = {}
        if NORM in self.kinds:
            errors[NORM] = max(self._norms(qpos) for qpos, _ in path)
        if self._model is None:
            return errors
        seen = [self._state(qpos, qvel) for qpos, qvel in path]
        for kind in seen[0].errors:
            # Errors of the initial state are not counted.
            errors[kind] = max(own.errors[kind] for own in seen[1:])
        # The work of applied forces cannot be computed from the positions after the control periods.
        pushed = bool(trace.applied[:count, e].any())
        begins = all(own <= _INITIAL_VIOLATION for own in seen[0].errors.values()) and not pushed
        for kind in (ENERGY, CONSERVED):
            if kind in self.kinds:
                excess = np.array([own.energy for own in seen]) - seen[0].energy - self._work(trace, e, seen)
                errors[kind] = float(np.max(excess if kind is ENERGY else np.abs(excess)).clip(0.0)) if begins else np.nan
        if MOMENTUM in self.kinds and not pushed:
            gravity = np.zeros(3) if self._weightless else np.array(self._model.opt.gravity)
            gained = float(self._model.body_mass.sum()) * np.outer([0.0, *trace.time[:count]], gravity)
            errors[MOMENTUM] = float(np.linalg.norm(np.array([own.momentum for own in seen]) - seen[0].momentum - gained, axis=1).max())
            errors[ANGULAR] = float(np.linalg.norm(np.array([own.angular for own in seen]) - seen[0].angular, axis=1).max())
        return errors

    @property
    def _weightless(self) -> bool:
        """Whether the model has gravity disabled."""
        return bool(self._model.opt.disableflags & int(self._mujoco.mjtDisableBit.mjDSBL_GRAVITY))

    def _norms(self, qpos: Array) -> float:
        """Largest deviation from 1 of the norm of a quaternion in the positions `qpos`, (nq,)."""
        model, worst = self._study.loaded[0], 0.0
        for j in range(model.njnt):
            joint = model.joint(j)
            if joint.type in ("free", "ball"):
                last = joint.qposadr + joint.nq
                worst = max(worst, abs(float(np.linalg.norm(qpos[last - 4 : last])) - 1.0))
        return worst

    def _state(self, qpos: Array, qvel: Array) -> _Measured:
        """Measures energies, momenta and position errors of a state, qpos (nq,) and qvel (nv,), with MuJoCo's library."""
        m, d, mujoco = self._model, self._data, self._mujoco
        d.qpos[:], d.qvel[:] = qpos, qvel
        mujoco.mj_fwdPosition(m, d)
        mujoco.mj_fwdVelocity(m, d)
        mujoco.mj_energyPos(m, d)
        mujoco.mj_energyVel(m, d)
        mujoco.mj_subtreeVel(m, d)
        errors: dict[Invariant, float] = {}
        if PENETRATION in self.kinds:
            errors[PENETRATION] = max((-float(x) for x in d.contact.dist), default=0.0)
            errors[PENETRATION] = max(errors[PENETRATION], 0.0)
        for unit, kind in LIMITS.items():
            if kind in self.kinds:
                errors[kind] = self._over_limits(unit)
        errors |= {kind: 0.0 for kind in LOOPS.values() if kind in self.kinds}
        # Errors of loops come from `efc_pos`, whose rows for the orientation of a weld are scaled; `_parts` removes the scale.
        rows = np.flatnonzero(np.asarray(d.efc_type[: d.nefc]) == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY))
        for e in dict.fromkeys(int(x) for x in np.asarray(d.efc_id)[rows]):
            own = np.asarray(d.efc_pos)[rows[np.asarray(d.efc_id)[rows] == e]]
            for unit, part in self._parts(e, own).items():
                errors[LOOPS[unit]] = max(errors[LOOPS[unit]], float(np.linalg.norm(part)))
        mass = float(m.body_mass.sum())
        return _Measured(
            errors=errors,
            energy=float(d.energy[0] + d.energy[1]),
            momentum=mass * np.array(d.subtree_linvel[0]),
            angular=np.array(d.subtree_angmom[0]),
            lengths=np.array(d.actuator_length),
        )

    def _over_limits(self, unit: str) -> float:
        """Largest violation of a limit in the present state of MuJoCo's data, m or rad."""
        m, d, kinds = self._model, self._data, self._mujoco.mjtJoint
        worst = 0.0
        for j in np.flatnonzero(m.jnt_limited):
            kind, q, (low, high) = m.jnt_type[j], int(m.jnt_qposadr[j]), m.jnt_range[j]
            if (kind == kinds.mjJNT_SLIDE) != (unit == "m"):
                continue
            if kind == kinds.mjJNT_BALL:
                own = d.qpos[q : q + 4]
                angle = 2.0 * np.arctan2(np.linalg.norm(own[1:]), abs(own[0]))
                worst = max(worst, float(angle - max(low, high)))
            else:
                worst = max(worst, float(d.qpos[q] - high), float(low - d.qpos[q]))
        if unit == "m":
            for t in np.flatnonzero(m.tendon_limited):
                low, high = m.tendon_range[t]
                worst = max(worst, float(d.ten_length[t] - high), float(low - d.ten_length[t]))
        return worst

    def _units(self, e: int) -> tuple[str, ...]:
        """Units of the position error of an equality constraint, given by its index: "m", "rad", both or none."""
        m, kinds = self._model, self._mujoco.mjtEq
        kind = m.eq_type[e]
        if kind == kinds.mjEQ_WELD:
            return ("m", "rad") if m.eq_data[e, 10] > 0 else ("m",)
        if kind == kinds.mjEQ_JOINT:
            slides = m.jnt_type[m.eq_obj1id[e]] == self._mujoco.mjtJoint.mjJNT_SLIDE
            return ("m",) if slides else ("rad",)
        return ("m",) if int(kind) in (int(kinds.mjEQ_CONNECT), int(kinds.mjEQ_TENDON)) else ()

    def _parts(self, e: int, rows: Array) -> dict[str, Array]:
        """Components of the position error of an equality constraint, by unit: "m" and "rad"."""
        units = self._units(e)
        if self._model.eq_type[e] != self._mujoco.mjtEq.mjEQ_WELD:
            return {unit: rows for unit in units}
        scale = float(self._model.eq_data[e, 10])
        # The rows of the orientation are the vector part of a quaternion (half the angle) times the scale.
        return {"m": rows[:3]} | ({"rad": 2.0 * rows[3:] / scale} if scale > 0 else {})

    def _work(self, trace: Trace, e: int, seen: list[_Measured]) -> Array:
        """Work that the actuators have done since the start of an episode, (1 + T,), J.

        The entries are for the start and for the end of each of the T control periods in `seen`. The work does not include the energy that
        the damping of actuators removes.
        """
        m, done, off = self._model, [0.0], self._mujoco.mjtDisableBit
        if m.nu == 0 or m.opt.disableflags & int(off.mjDSBL_ACTUATION):
            return np.zeros(len(seen))
        clamped = (m.actuator_ctrllimited > 0) & (not m.opt.disableflags & int(off.mjDSBL_CLAMPCTRL))
        low, high = np.where(clamped[:, None], m.actuator_ctrlrange, [-np.inf, np.inf]).T
        key = self._study.keyframe
        held = np.zeros(m.nu) if key is None else np.array(m.key_ctrl[self._study.loaded[0].keyframe(key).id])
        for before, after, given in zip(seen[:-1], seen[1:], trace.ctrl[:, e], strict=False):
            held = np.where(np.isfinite(given), given, held)
            force = m.actuator_gainprm[:, 0] * np.clip(held, low, high) + m.actuator_biasprm[:, 0]
            way, squares = after.lengths - before.lengths, after.lengths**2 - before.lengths**2
            done.append(done[-1] + float(force @ way + m.actuator_biasprm[:, 1] @ squares / 2.0))
        return np.array(done)


def _nominal(study: Study) -> Any:
    """Compiled `mujoco.MjModel` of a study with nominal parameters; None if the model has no source.

    Fields that MuJoCo lacks are left out, because they affect no invariant.
    """
    model, compiled = study.loaded
    if compiled is None:
        return None
    fields = {name: rows[0] for name, rows in model_fields(study.parameters, model, [study.nominal]).items()}
    known = {name: own for name, own in fields.items() if name == "gravity"}
    known |= {name: own for name, own in fields.items() if getattr(getattr(compiled, name, None), "shape", None) == own.shape}
    return with_fields(require("mujoco", "to measure invariants"), compiled, known)


# Properties of a scene that make an invariant inapplicable.


def _inflow(study: Study, m: Any, mujoco: Any) -> str | None:
    """Reason why a scene may gain energy that the energy balance does not count; None if there is none."""
    kinds = mujoco.mjtGain, mujoco.mjtBias, mujoco.mjtDyn
    plain = [
        m.actuator_gaintype[k] == kinds[0].mjGAIN_FIXED
        and int(m.actuator_biastype[k]) in (int(kinds[1].mjBIAS_NONE), int(kinds[1].mjBIAS_AFFINE))
        and m.actuator_dyntype[k] == kinds[2].mjDYN_NONE
        and m.actuator_biasprm[k, 2] <= 0
        and not m.actuator_forcelimited[k]
        and m.actuator_delay[k] == 0
        and m.actuator_ctrlnum[k] == 1
        and _along_positions(m, mujoco, k)
        for k in range(len(m.actuator_gaintype))
    ]
    found = [
        ("the study has actuator pipelines", study.actuators is not None or any(p.kind == "actuator" for p in study.parameters.values())),
        (
            "the work of actuators with activations, delays, muscles, force limits, or on sites and bodies cannot be computed from "
            "positions",
            not all(plain),
        ),
        ("joints limit the force of their actuators (actuatorfrcrange)", bool(np.any(m.jnt_actfrclimited)) and m.nu > 0),
        ("gravity compensation does work", bool(np.any(m.body_gravcomp != 0))),
        ("wind does work", bool(np.any(m.opt.wind != 0)) and bool(m.opt.density or m.opt.viscosity)),
        ("moving surfaces do work", bool(np.any(np.asarray(study.loaded[0].geom_surfacevel) != 0))),
        ("the scene has flexes", m.nflex > 0),
    ]
    return next((words for words, there in found if there), None)


def _along_positions(m: Any, mujoco: Any, k: int) -> bool:
    """Whether actuator k acts on a hinge, a slide or a tendon. Its work is then its force times the change of its length."""
    kinds, joints = mujoco.mjtTrn, mujoco.mjtJoint
    if m.actuator_trntype[k] == kinds.mjTRN_TENDON:
        return True
    if m.actuator_trntype[k] != kinds.mjTRN_JOINT:
        return False
    return bool(int(m.jnt_type[m.actuator_trnid[k, 0]]) in (int(joints.mjJNT_HINGE), int(joints.mjJNT_SLIDE)))


def _may_dissipate(m: Any, mujoco: Any, kinds: list[Invariant]) -> bool:
    """Whether a scene may dissipate energy, by damping, friction or impacts."""
    touches = {PENETRATION, *LIMITS.values(), *LOOPS.values()} & set(kinds)
    damped = any(np.any(own != 0) for own in (m.dof_damping, m.dof_frictionloss, m.tendon_damping, m.tendon_frictionloss))
    servo = bool(m.nu and np.any(m.actuator_biasprm[:, 2] != 0))
    return bool(touches) or damped or servo or bool(m.opt.density or m.opt.viscosity)


def _outside(study: Study, m: Any, mujoco: Any) -> str | None:
    """Reason why the world may exert forces on the bodies, so that momentum is not conserved; None if there is none."""
    free = int(mujoco.mjtJoint.mjJNT_FREE)
    roots = [b for b in range(1, m.nbody) if m.body_parentid[b] == 0]
    moving = [b for b in roots if m.body_weldid[b] != 0]
    attached = [b for b in moving if m.body_jntnum[b] != 1 or m.jnt_type[m.body_jntadr[b]] != free]
    fixed = m.body_weldid[m.geom_bodyid] == 0
    static = [int(g) for g in np.flatnonzero(fixed)]
    others = [int(g) for g in np.flatnonzero(~fixed)]
    meets = any(m.geom_contype[a] & m.geom_conaffinity[b] or m.geom_contype[b] & m.geom_conaffinity[a] for a in static for b in others)
    loads = [j for j in range(m.njnt) if m.jnt_type[j] == free]
    held = any(m.dof_damping[m.jnt_dofadr[j] + k] or m.dof_frictionloss[m.jnt_dofadr[j] + k] for j in loads for k in range(6))
    found = [
        ("some bodies are attached to the world", bool(attached) or not moving),
        ("bodies may touch the world", meets or bool(m.npair)),
        ("equalities, tendons or mocap bodies may exert forces", bool(m.neq or m.ntendon or m.nmocap)),
        ("free joints have damping or friction", held),
        ("actuators may push against the world", any(_on_world(m, mujoco, k) for k in range(m.nu))),
        ("the scene has fluid forces", bool(m.opt.density or m.opt.viscosity)),
        ("gravity is compensated", bool(np.any(m.body_gravcomp != 0))),
        ("armature adds inertia that the momentum does not include", bool(np.any(m.dof_armature != 0))),
    ]
    return next((words for words, there in found if there), None)


def _on_world(m: Any, mujoco: Any, k: int) -> bool:
    """Whether actuator k may push against the world: it acts on a free joint, or on something other than a joint."""
    if m.actuator_trntype[k] != int(mujoco.mjtTrn.mjTRN_JOINT):
        return True
    return bool(m.jnt_type[m.actuator_trnid[k, 0]] == int(mujoco.mjtJoint.mjJNT_FREE))
