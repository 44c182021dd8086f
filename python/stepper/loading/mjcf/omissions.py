"""Elements of a compiled `mujoco.MjModel` that its description leaves out.

`FIELDS` classifies every field of MuJoCo 4's MjModel; a test compares the table with the installed version. An omission that changes the
motion is an error, except with `stepper.load(..., strict=False)`. The Rust crate adds to the list those elements of the
description that it does not simulate.
"""

from __future__ import annotations

import numpy as np

from stepper.loading.mjcf.actuators import CUBIC, delay, is_whole, reasons_to_omit
from stepper.loading.mjcf.source import Source

FIELDS = {
    "used": """
        names opt qpos0 qpos_spring exclude_signature wrap_type wrap_objid wrap_prm
        body_parentid body_pos body_quat body_mass body_ipos body_iquat body_inertia body_mocapid body_gravcomp
        jnt_type jnt_dofadr jnt_bodyid jnt_limited jnt_range jnt_margin jnt_pos jnt_axis jnt_stiffness jnt_actfrclimited jnt_actfrcrange
        dof_damping dof_armature dof_frictionloss
        geom_type geom_contype geom_conaffinity geom_condim geom_bodyid geom_dataid geom_priority geom_size geom_pos geom_quat
        geom_friction geom_margin geom_gap geom_surfacevel geom_fluid
        pair_dim pair_geom1 pair_geom2 pair_margin pair_gap pair_friction
        eq_type eq_obj1id eq_obj2id eq_objtype eq_active0 eq_data site_bodyid site_pos site_quat
        tendon_adr tendon_num tendon_limited tendon_range tendon_margin tendon_stiffness tendon_lengthspring tendon_damping tendon_armature
        tendon_frictionloss
        actuator_trntype actuator_dyntype actuator_gaintype actuator_biastype actuator_ctrladr actuator_ctrlnum actuator_outadr
        actuator_actadr actuator_trnid actuator_dynprm actuator_gainprm actuator_biasprm actuator_actlimited actuator_actrange
        actuator_damping actuator_armature actuator_group actuator_forcelimited actuator_forcerange actuator_ctrllimited
        actuator_ctrlrange actuator_gear actuator_delay actuator_history actuator_ctrlspec actuator_actnum
        actuator_cranklength actuator_acc0 actuator_lengthrange
        mesh_vertadr mesh_vertnum mesh_vert mesh_faceadr mesh_facenum mesh_face hfield_size hfield_nrow hfield_ncol hfield_adr hfield_data
        sensor_type sensor_objtype sensor_objid sensor_reftype sensor_refid sensor_intprm sensor_noise sensor_cutoff sensor_delay
        sensor_interval sensor_history site_bodyid site_pos site_quat site_type site_size geom_rgba geom_matid mat_rgba
        geom_solref geom_solimp pair_solref pair_solimp jnt_solref jnt_solimp dof_solref dof_solimp eq_solref eq_solimp
        tendon_solref_lim tendon_solimp_lim tendon_solref_fri tendon_solimp_fri
        key_time key_qpos key_qvel key_act key_ctrl
        """,
    "left out, listed": """
        jnt_actgravcomp jnt_stiffnesspoly jnt_springyield dof_dampingpoly geom_adhesion pair_adhesion
        tendon_actfrclimited tendon_actfrcrange tendon_stiffnesspoly tendon_dampingpoly tendon_springyield
        actuator_actearly actuator_dampingpoly actuator_plugin
        flex_* flexedge_* plugin* body_plugin geom_plugin sensor_plugin
        key_mpos key_mquat flex_solref flex_solimp *_solmix pair_solreffriction
        """,
    # Counts, addresses, names, derived constants, drawing, bounding volumes, and settings of MuJoCo's solver.
    "no effect on the motion": """
        n[a-zA-Z]* flg_* vis stat signature paths
        body_rootid body_weldid body_jntnum body_jntadr body_dofnum body_dofadr body_treeid body_geomnum body_geomadr body_simple
        body_sameframe body_subtreemass body_invweight0 body_margin body_contype body_conaffinity body_bvhadr body_bvhnum
        bvh_* oct_* tree_* *_user *_group *_matid *_rgba
        jnt_qposadr jnt_actuatorid jnt_plasticadr dof_bodyid dof_jntid dof_parentid dof_treeid dof_Madr dof_simplenum dof_invweight0
        dof_M0 dof_length geom_sameframe geom_castshadow geom_aabb site_* cam_* light_* mesh_* skin_* hfield_* tex_* mat_*
        geom_rbound pair_signature efm0_* efmC_perm
        tendon_type tendon_actuatorid tendon_plasticadr tendon_treenum tendon_treeid tendon_width tendon_length0 tendon_invweight0 ten_J_*
        actuator_outnum actuator_historyadr actuator_length0
        sensor_datatype sensor_needstage sensor_dim sensor_adr
        sensor_historyadr key_plastic
        numeric_* text_* tuple_* name_* B_* M_* D_* mapM2M mapM2D mapD2M
        """,
}


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
            "armature": bool(m.tendon_armature[i]) and not fixed,
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
