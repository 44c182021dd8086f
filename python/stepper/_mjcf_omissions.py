"""What a compiled `mujoco.MjModel` has and the description of it does not.

`FIELDS` decides for every field of MjModel 4; a test holds it against the installed version. Elements that would change the motion are
errors unless `stepper.load(..., strict=False)`; what the description has but the step does not simulate yet is listed by the Rust crate.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from stepper._mjcf import Source

FIELDS = {
    "used": """
        names opt qpos0 qpos_spring exclude_signature wrap_type wrap_objid wrap_prm
        body_parentid body_pos body_quat body_mass body_ipos body_iquat body_inertia body_mocapid
        jnt_type jnt_dofadr jnt_bodyid jnt_limited jnt_range jnt_margin jnt_pos jnt_axis jnt_stiffness jnt_actfrclimited jnt_actfrcrange
        dof_damping dof_armature dof_frictionloss
        geom_type geom_contype geom_conaffinity geom_condim geom_bodyid geom_dataid geom_priority geom_size geom_rbound geom_pos geom_quat
        geom_friction geom_margin geom_gap
        pair_dim pair_geom1 pair_geom2 pair_margin pair_gap pair_friction
        tendon_adr tendon_num
        actuator_trntype actuator_dyntype actuator_gaintype actuator_biastype actuator_ctrladr actuator_ctrlnum actuator_outadr
        actuator_actadr actuator_trnid actuator_dynprm actuator_gainprm actuator_biasprm actuator_actlimited actuator_actrange
        actuator_damping actuator_armature actuator_group actuator_forcelimited actuator_forcerange actuator_ctrllimited
        actuator_ctrlrange actuator_gear
        sensor_type sensor_objid key_time key_qpos key_qvel key_act key_ctrl
        """,
    "left out, listed": """
        body_gravcomp jnt_actgravcomp jnt_stiffnesspoly jnt_springyield dof_dampingpoly geom_surfacevel geom_adhesion pair_adhesion
        tendon_limited tendon_range tendon_margin tendon_actfrclimited tendon_actfrcrange tendon_stiffness tendon_stiffnesspoly
        tendon_damping tendon_dampingpoly tendon_armature tendon_frictionloss tendon_lengthspring tendon_springyield
        actuator_actearly actuator_history actuator_delay actuator_dampingpoly actuator_plugin actuator_cranklength actuator_ctrlspec
        eq_* flex_* flexedge_* plugin* body_plugin geom_plugin geom_fluid sensor_plugin sensor_cutoff sensor_delay sensor_interval
        key_mpos key_mquat *_solref *_solimp *_solmix *_solref_* *_solimp_* pair_solreffriction
        """,
    # Counts, addresses, names, derived constants, drawing, bounding volumes, and what belongs to MuJoCo's own solver.
    "no effect on the motion": """
        n[a-zA-Z]* flg_* vis stat signature paths
        body_rootid body_weldid body_jntnum body_jntadr body_dofnum body_dofadr body_treeid body_geomnum body_geomadr body_simple
        body_sameframe body_subtreemass body_invweight0 body_margin body_contype body_conaffinity body_bvhadr body_bvhnum
        bvh_* oct_* tree_* *_user *_group *_matid *_rgba
        jnt_qposadr jnt_actuatorid jnt_plasticadr dof_bodyid dof_jntid dof_parentid dof_treeid dof_Madr dof_simplenum dof_invweight0
        dof_M0 dof_length geom_sameframe geom_castshadow geom_aabb site_* cam_* light_* mesh_* skin_* hfield_* tex_* mat_*
        pair_signature efm0_* efmC_perm
        tendon_type tendon_actuatorid tendon_plasticadr tendon_treenum tendon_treeid tendon_width tendon_length0 tendon_invweight0 ten_J_*
        actuator_outnum actuator_actnum actuator_historyadr actuator_acc0 actuator_length0 actuator_lengthrange
        sensor_datatype sensor_needstage sensor_objtype sensor_reftype sensor_refid sensor_intprm sensor_dim sensor_adr sensor_noise
        sensor_history sensor_historyadr key_plastic
        numeric_* text_* tuple_* name_* B_* M_* D_* mapM2M mapM2D mapD2M
        """,
}


def list_omissions(source: Source) -> None:
    """Fills `source.omitted`."""
    _scene(source)
    _bodies(source)
    _joints(source)
    _contacts(source)
    _equalities(source)
    _tendons(source)
    _actuators(source)
    _sensors(source)
    _keyframes(source)


def _scene(source: Source) -> None:
    m = source.m
    if m.opt.density or m.opt.viscosity:
        medium = f"density {m.opt.density:g} kg/m^3, viscosity {m.opt.viscosity:g} Pa s"
        source.leave_out("fluid", "option", f"forces of the medium ({medium}) are not simulated; bodies move as in vacuum")
    if int(m.opt.enableflags) & 1:
        source.leave_out("contact override", "option", "the override of contact parameters is not read; geoms keep their own")
    if int(m.opt.enableflags) >> 4 & 1:
        source.leave_out("sleep", "option", "bodies at rest are simulated like all others", changes_motion=False)
    for i in range(m.nflex):
        source.leave_out("flex", source.label("FLEX", i), "deformable bodies are not simulated; its vertices move as bodies without shape")
    for i in range(m.nplugin):
        source.leave_out("plugin", source.label("PLUGIN", i), "plugins are MuJoCo's; its forces, shapes and readings are missing")


def _bodies(source: Source) -> None:
    # Gravity acts through the springs and dampers' stage in MuJoCo: with gravity off its compensation is off too.
    weightless = source.off("gravity") or not np.any(source.m.opt.gravity)
    for i in np.flatnonzero(source.m.body_gravcomp):
        if not weightless and source.m.body_mass[i]:
            share = f"{float(source.m.body_gravcomp[i]):g} of its weight"
            source.leave_out("gravity compensation", source.label("BODY", int(i)), f"the force against {share} is not simulated")


def _joints(source: Source) -> None:
    m = source.m
    for i in range(m.njnt):
        name, dofs = source.label("JOINT", i), source.dofs(i)
        if np.any(m.jnt_stiffnesspoly[i]) and not source.off("spring"):
            source.leave_out("joint spring polynomial", name, "stiffness that grows with deflection is not simulated; the linear part is")
        if m.jnt_springyield[i] and m.jnt_stiffness[i] and not source.off("spring"):
            source.leave_out("joint spring yield", name, "springs do not yield; it stays elastic")
        if np.any(m.dof_dampingpoly[dofs]) and not source.off("damper"):
            source.leave_out("joint damping polynomial", name, "damping that grows with speed is not simulated; the linear part is")
        for field in ("damping", "armature", "frictionloss"):
            values = getattr(m, f"dof_{field}")[dofs]
            if np.any(values != values[0]):
                source.leave_out(f"joint {field}", name, f"{values.tolist()} differ between its degrees of freedom; all get {values[0]:g}")
        if m.jnt_limited[i] and m.jnt_margin[i] and source.moves_one(i) and not source.off("limit"):
            reason = f"its range is narrowed by the margin {m.jnt_margin[i]:g}, where MuJoCo's limit comes to rest"
            source.leave_out("joint margin", name, reason, changes_motion=False)


def _contacts(source: Source) -> None:
    m = source.m
    limits = np.any(m.jnt_limited) and not source.off("limit")
    losses = np.any(m.dof_frictionloss) and not source.off("frictionloss")
    contacts = (np.any(m.geom_contype) or np.any(m.geom_conaffinity) or m.npair) and not source.off("contact")
    if contacts or limits or losses:
        reason = "contacts, limits and dry friction are hard here: solref, solimp, solmix, impratio and the shape of the cone are not read"
        source.leave_out("soft contact parameters", "all", reason, changes_motion=False)
    if not contacts:
        return
    if source.off("filterparent"):
        source.leave_out("collision of parent and child", "option", "parent and child never collide here, whatever the flag says")
    for g in np.flatnonzero(np.any(m.geom_surfacevel, axis=1)):
        source.leave_out("surface velocity", source.label("GEOM", int(g)), "moving surfaces are not simulated; it stands still")
    for g in np.flatnonzero(m.geom_adhesion):
        source.leave_out("adhesion", source.label("GEOM", int(g)), "contacts do not pull")
    for i in range(m.npair):
        friction, name = m.pair_friction[i], source.label("PAIR", i)
        if m.pair_adhesion[i]:
            source.leave_out("adhesion", name, "contacts do not pull")
        if (m.pair_dim[i] > 1 and friction[0] != friction[1]) or (m.pair_dim[i] == 6 and friction[3] != friction[4]):
            reason = f"friction {friction.tolist()} depends on the direction; the first of each two is used"
            source.leave_out("anisotropic friction", name, reason)


def _equalities(source: Source) -> None:
    m = source.m
    if source.off("equality"):
        return
    for i in range(m.neq):
        kind = str(source.mujoco.mjtEq(int(m.eq_type[i])).name).removeprefix("mjEQ_").lower()
        active = bool(m.eq_active0[i])
        reason = "not simulated; what it couples moves independently" if active else "not simulated; it is inactive at the start"
        source.leave_out(f"equality {kind}", source.label("EQUALITY", i), reason, changes_motion=active)


def _tendons(source: Source) -> None:
    m = source.m
    for i in range(m.ntendon):
        stiff = bool(m.tendon_stiffness[i]) or bool(np.any(m.tendon_stiffnesspoly[i]))
        damped = bool(m.tendon_damping[i]) or bool(np.any(m.tendon_dampingpoly[i]))
        has = {
            "stiffness": stiff and not source.off("spring"),
            "damping": damped and not source.off("damper"),
            "limits": bool(m.tendon_limited[i]) and not source.off("limit"),
            "dry friction": bool(m.tendon_frictionloss[i]) and not source.off("frictionloss"),
            "armature": bool(m.tendon_armature[i]),
            "bounds of the actuators' force": bool(m.tendon_actfrclimited[i]) and source.is_fixed(i),
        }
        missing = [what for what, there in has.items() if there]
        if missing:
            kind = "fixed" if source.is_fixed(i) else "spatial"
            source.leave_out(f"{kind} tendon", source.label("TENDON", i), f"not simulated: its {', '.join(missing)}")


def _actuators(source: Source) -> None:
    m = source.m
    for a in range(m.nactuator):
        name, dropped = source.label("ACTUATOR", a), source.why_dropped(a)
        if dropped:
            left_out = f"the actuator is left out with its controls, so nu is smaller by {m.actuator_ctrlnum[a]}"
            source.leave_out("actuator", name, f"{', '.join(dropped)} not simulated; {left_out}")
            continue
        if m.actuator_actearly[a] and m.actuator_dyntype[a]:
            source.leave_out("actuator early activation", name, "its force lags its activation by one step")
        if m.actuator_delay[a]:
            source.leave_out("actuator delay", name, f"the delay of {m.actuator_delay[a]:g} s is not simulated; it acts at once")
        if np.any(m.actuator_dampingpoly[a]):
            source.leave_out("actuator damping polynomial", name, "damping that grows with speed is not simulated; the linear part is")
        if a not in source.joint_actuators.get(int(m.actuator_trnid[a, 0]), []) and (m.actuator_damping[a] or m.actuator_armature[a]):
            source.leave_out("actuator damping and armature", name, "they act through a tendon, which is not simulated")


def _sensors(source: Source) -> None:
    m, kinds = source.m, source.mujoco.mjtSensor
    for i in range(m.nsensor):
        kind, name = str(kinds(int(m.sensor_type[i])).name).removeprefix("mjSENS_").lower(), source.label("SENSOR", i)
        if source.off("sensor"):
            source.leave_out(f"sensor {kind}", name, "sensors are disabled by the model's flags", changes_motion=False)
        elif kind not in ("jointpos", "jointvel"):
            source.leave_out(f"sensor {kind}", name, "not read yet; nsensordata is smaller", changes_motion=False)
        elif m.sensor_cutoff[i] or m.sensor_delay[i] or np.any(m.sensor_interval[i]):
            reason = "its cutoff, delay and sampling interval are not read; give the sensor a Transfer"
            source.leave_out("sensor cutoff and delay", name, reason, changes_motion=False)


def _keyframes(source: Source) -> None:
    m = source.m
    posed = np.flatnonzero(m.body_mocapid >= 0)
    for i in range(m.nkey):
        pos, quat = m.body_pos[posed].ravel(), m.body_quat[posed].ravel()
        if np.any(m.key_mpos[i] != pos) or np.any(m.key_mquat[i] != quat):
            reason = "its poses of mocap bodies are not kept; set Stepper.mocap_pos and mocap_quat"
            source.leave_out("keyframe mocap pose", source.label("KEY", i), reason, changes_motion=False)
