"""Elements of a compiled `mujoco.MjModel` that its description leaves out.

An omission that changes the motion is an error, except with `stepper.load(..., strict=False)`. The Rust crate adds to the list those
elements of the description that it does not simulate. tests/api/test_load.py classifies every field of MuJoCo's MjModel.
"""

from __future__ import annotations

import numpy as np

from stepper.loading.mjcf.actuators import CUBIC, delay, is_whole, reasons_to_omit
from stepper.loading.mjcf.source import Source

FLAGS = {
    "disable": {
        "warmstart": (9, "the solver always starts from the impulses of the last step", False),
        "filterparent": (10, "a body never collides with its parent in stepper", True),
        "midphase": (14, "the flag concerns MuJoCo's search for contacts, and does not change the contacts", False),
        "eulerdamp": (
            15,
            "as in MuJoCo, euler then applies joint damping explicitly; other integrators apply it implicitly",
            False,
        ),
        "autoreset": (
            16,
            "bodies whose next state is not finite keep their last one, and status has a flag",
            False,
        ),
        "nativeccd": (17, "the flag selects one of MuJoCo's collision algorithms; stepper uses another one", False),
        "island": (18, "the flag concerns MuJoCo's solver", False),
        "multiccd": (
            19,
            "the flag selects one of MuJoCo's collision algorithms; stepper always finds all contact points of a pair",
            False,
        ),
    },
    "enable": {
        "energy": (1, "Stepper.energy() returns the energy at any time", False),
        "fwdinv": (2, "the flag concerns MuJoCo's solver; status and residual measure the solution of a step", False),
        "invdiscrete": (3, "the inverse dynamics of stepper do not depend on the flag", False),
        "sleep": (4, "bodies at rest are simulated like all others", False),
        "diagexact": (
            5,
            "hard contact has no regularisation, and MuJoCo's contact law always uses the approximate inverse weights for it",
            False,
        ),
        "ipc": (6, "the flag concerns deformable bodies, which are not simulated", False),
        "speculative": (7, "stepper always finds contacts that may close within a step in advance", False),
    },
}
"""Flags of MuJoCo without effect in stepper, by kind ("disable" or "enable") and name.

Each value has the bit of the flag, a text on what stepper does instead, and whether the motion differs from MuJoCo's.

Models with such a flag list it as an omission. `stepper.loading.mjcf.source.DISABLE` has the flags that take effect; a test compares both
tables with the installed version of MuJoCo.
"""


def list_omissions(source: Source) -> None:
    """Adds all elements and settings of a compiled model that stepper does not simulate to the list `source.omitted`."""
    _scene(source)
    _joints(source)
    _contacts(source)
    _equalities(source)
    _tendons(source)
    _actuators(source)
    _keyframes(source)


def _scene(source: Source) -> None:
    """Appends to `source.omitted` the flags, options, deformable bodies and plugins that stepper does not simulate."""
    m = source.m
    for kind, flags in (("disable", int(m.opt.disableflags)), ("enable", int(m.opt.enableflags))):
        for name, (bit, reason, changes_motion) in FLAGS[kind].items():
            if flags >> bit & 1 and _matters(source, name):
                source.leave_out(f"flag {name}", f"{kind}d", reason, changes_motion=changes_motion)
    if source.overrides and m.opt.o_friction[0] != m.opt.o_friction[1]:
        source.leave_out("o_friction", "option", f"{m.opt.o_friction.tolist()} depends on the direction; the first is used")
    for i in range(m.nflex):
        source.leave_out(
            "flex", source.label("FLEX", i), "deformable bodies are not simulated; the vertices of the flex move as bodies without shape"
        )
    for i in range(m.nplugin):
        source.leave_out(
            "plugin", source.label("PLUGIN", i), "plugins of MuJoCo do not run here; forces, shapes and readings of the plugin are missing"
        )


def _matters(source: Source, flag: str) -> bool:
    """Whether a flag of MuJoCo's options can affect this model; checked for two flags only, and True for all others."""
    if flag == "eulerdamp":
        return bool(np.any(source.m.dof_damping)) and not source.off("damper")
    return flag != "filterparent" or source.collides


def _joints(source: Source) -> None:
    """Appends to `source.omitted` the properties of joints that stepper does not simulate."""
    m = source.m
    if not m.njnt:
        return
    first, fields = m.jnt_dofadr, ("damping", "armature", "frictionloss")
    special = np.logical_or.reduceat(m.dof_dampingpoly.any(axis=1), first) | m.jnt_stiffnesspoly.any(axis=1)
    for field in fields:
        values = getattr(m, f"dof_{field}")
        special |= np.minimum.reduceat(values, first) != np.maximum.reduceat(values, first)
    special |= (m.jnt_actgravcomp != 0) | (m.jnt_springyield != 0) | (m.jnt_margin != 0)
    for i in np.flatnonzero(special).tolist():
        name, dofs = source.label("JOINT", i), source.dofs(i)
        if np.any(m.jnt_stiffnesspoly[i]) and not source.off("spring"):
            source.leave_out("joint spring polynomial", name, "stiffness that grows with deflection is not simulated; the linear part is")
        if m.jnt_actgravcomp[i] and np.any(m.body_gravcomp) and not source.skips_passive_forces:
            reason = "gravity compensation acts as a passive force, which qfrc_actuator and jointactuatorfrc do not contain"
            limited = bool(m.jnt_actfrclimited[i])
            if limited:
                reason += " and actuatorfrcrange does not limit"
            source.leave_out("joint gravity compensation", name, reason, changes_motion=limited)
        if m.jnt_springyield[i] and m.jnt_stiffness[i] and not source.off("spring"):
            source.leave_out("joint spring yield", name, "plastic yielding of springs is not simulated; the spring stays elastic")
        if np.any(m.dof_dampingpoly[dofs]) and not source.off("damper"):
            source.leave_out("joint damping polynomial", name, "damping that grows with speed is not simulated; the linear part is")
        for field in fields:
            values = getattr(m, f"dof_{field}")[dofs]
            if np.any(values != values[0]):
                source.leave_out(
                    f"joint {field}",
                    name,
                    f"{values.tolist()} differ between the joint's degrees of freedom; {values[0]:g} is used for all",
                )
        if m.jnt_limited[i] and m.jnt_margin[i] and not source.off("limit"):
            reason = f"the range is narrowed by the margin {m.jnt_margin[i]:g}, because MuJoCo's limit pushes from there on"
            source.leave_out("joint margin", name, reason, changes_motion=False)


def _contacts(source: Source) -> None:
    """Appends to `source.omitted` the properties of geoms and of explicit contact pairs that stepper does not simulate."""
    m = source.m
    if not source.collides:
        return
    for g in np.flatnonzero(m.geom_type == 8):
        source.leave_out("signed distance field", source.label("GEOM", int(g)), "it collides as the convex hull of its mesh")
    for g in np.flatnonzero(m.geom_adhesion):
        source.leave_out("adhesion", source.label("GEOM", int(g)), "adhesion is not simulated: contacts push and never pull")
    for i in range(m.npair):
        friction, name = m.pair_friction[i], source.label("PAIR", i)
        if m.pair_adhesion[i]:
            source.leave_out("adhesion", name, "adhesion is not simulated: contacts push and never pull")
        if (m.pair_dim[i] > 1 and friction[0] != friction[1]) or (m.pair_dim[i] == 6 and friction[3] != friction[4]):
            reason = f"friction {friction.tolist()} depends on the direction; the first coefficient of each pair of directions is used"
            source.leave_out("anisotropic friction", name, reason)


def _equalities(source: Source) -> None:
    """Appends to `source.omitted` the equality constraints that stepper does not simulate."""
    m = source.m
    if source.off("equality"):
        return
    for i in range(m.neq):
        if reason := source.reason_to_omit_equality(i):
            kind = str(source.mujoco.mjtEq(int(m.eq_type[i])).name).removeprefix("mjEQ_").lower()
            source.leave_out(f"equality {kind}", source.label("EQUALITY", i), reason, changes_motion=bool(m.eq_active0[i]))


def _tendons(source: Source) -> None:
    """Appends to `source.omitted` the properties of tendons that stepper does not simulate."""
    m = source.m
    for i in range(m.ntendon):
        fixed = source.is_fixed(i)
        properties = {
            "stiffness that grows with deflection": bool(np.any(m.tendon_stiffnesspoly[i])) and not source.off("spring"),
            "damping that grows with speed": bool(np.any(m.tendon_dampingpoly[i])) and not source.off("damper"),
            "yield": bool(m.tendon_springyield[i]) and bool(m.tendon_stiffness[i]) and not source.off("spring"),
            "actuatorfrcrange": bool(m.tendon_actfrclimited[i]),
        }
        missing = [name for name, is_set in properties.items() if is_set]
        if missing:
            kind = "fixed" if fixed else "spatial"
            source.leave_out(f"{kind} tendon", source.label("TENDON", i), f"not simulated: {', '.join(missing)} of the tendon")
        if m.tendon_limited[i] and m.tendon_margin[i] and not source.off("limit"):
            reason = f"the range is narrowed by the margin {m.tendon_margin[i]:g}, because MuJoCo's limit pushes from there on"
            source.leave_out("tendon margin", source.label("TENDON", i), reason, changes_motion=False)


def _actuators(source: Source) -> None:
    """Appends to `source.omitted` the actuators, and properties of actuators, that stepper does not simulate."""
    m = source.m
    for a in range(m.nactuator):
        name, unsupported = source.label("ACTUATOR", a), reasons_to_omit(source, a)
        if unsupported:
            left_out = f"the actuator is left out with its controls, so nu is smaller by {m.actuator_ctrlnum[a]}"
            source.leave_out("actuator", name, f"{', '.join(unsupported)} not simulated; {left_out}")
            continue
        late, between = delay(source, a)
        if between == CUBIC and not is_whole(late, m.opt.timestep):
            reason = f"the control {late:g} s ago is interpolated linearly, not with a cubic polynomial"
            source.leave_out("actuator delay", name, reason)
        if np.any(m.actuator_dampingpoly[a]):
            source.leave_out("actuator damping polynomial", name, "damping that grows with speed is not simulated; the linear part is")
        if a not in source.joint_actuators.get(int(m.actuator_trnid[a, 0]), []) and (m.actuator_damping[a] or m.actuator_armature[a]):
            source.leave_out("actuator damping and armature", name, "they act through a tendon or site, which is not simulated")


def _keyframes(source: Source) -> None:
    """Appends to `source.omitted` the keyframes whose poses of mocap bodies stepper does not load."""
    m = source.m
    mocap_bodies = np.flatnonzero(m.body_mocapid >= 0)
    for i in range(m.nkey):
        pos, quat = m.body_pos[mocap_bodies].ravel(), m.body_quat[mocap_bodies].ravel()
        if np.any(m.key_mpos[i] != pos) or np.any(m.key_mquat[i] != quat):
            reason = "poses of mocap bodies in keyframes are not stored; set Stepper.mocap_pos and mocap_quat"
            source.leave_out("keyframe mocap pose", source.label("KEY", i), reason, changes_motion=False)
