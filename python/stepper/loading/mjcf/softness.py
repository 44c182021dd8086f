"""Softness of a compiled `mujoco.MjModel`: the parameters of its contact law (`stepper.Options(contact="mujoco")`)."""

from __future__ import annotations

from stepper.loading.mjcf.source import Description, Source

CONES = ("Pyramidal", "Elliptic")
"""Names in the Rust library of friction cones, by MuJoCo's number."""


def soft_settings(source: Source) -> Description:
    """Settings of MuJoCo's contact law for the whole model, as fields of the Rust crate's `SoftSettings`."""
    m = source.m
    return {
        "cone": CONES[int(m.opt.cone)],
        "impratio": float(m.opt.impratio),
        "refsafe": not source.off("refsafe"),
        "inverse_weights": {
            "bodies": m.body_invweight0.tolist(),
            "dofs": m.dof_invweight0.tolist(),
            "tendons": m.tendon_invweight0.tolist(),
        },
        "noslip": {
            "iterations": max(int(m.opt.noslip_iterations), 0),
            "tolerance": float(m.opt.noslip_tolerance),
        },
    }


def joint_softness(source: Source, i: int) -> Description:
    """Softness (solref and solimp) of a joint's limit and of its dry friction, as a dictionary; `i` is the index in MuJoCo's model."""
    rows, dof = source.rows, source.dofs(i).start
    return {
        "limit_softness": _softness(rows.jnt_solref[i], rows.jnt_solimp[i]),
        "friction_softness": _softness(rows.dof_solref[dof], rows.dof_solimp[dof]),
    }


def contact_softness(source: Source, i: int) -> Description:
    """Softness (solref and solimp) of a geom's contacts, and its weight `solmix` in the mean over the two geoms of a contact."""
    rows = source.rows
    return {"softness": _contact(source, rows.geom_solref[i], rows.geom_solimp[i]), "solmix": rows.geom_solmix[i]}


def pair_softness(source: Source, i: int) -> Description:
    """Softness (solref and solimp) of an explicit contact pair, and the anisotropy of its friction.

    The anisotropy has two ratios, for sliding and for rolling: the coefficient in the second tangential direction divided by the
    coefficient in the first.
    """
    m = source.m
    slide, other_slide, _, roll, other_roll = (m.opt.o_friction if source.overrides else m.pair_friction[i]).tolist()
    ratio = [b / a if a > 0 else 1.0 for a, b in ((slide, other_slide), (roll, other_roll))]
    return {
        "softness": _contact(source, source.rows.pair_solref[i], source.rows.pair_solimp[i]),
        "solref_friction": m.pair_solreffriction[i].tolist(),
        "anisotropy": ratio,
    }


def tendon_softness(source: Source, i: int) -> Description:
    """Softness (solref and solimp) of a tendon's limit and of its dry friction, as a dictionary; `i` is the index in MuJoCo's model."""
    rows = source.rows
    return {
        "limit_softness": _softness(rows.tendon_solref_lim[i], rows.tendon_solimp_lim[i]),
        "friction_softness": _softness(rows.tendon_solref_fri[i], rows.tendon_solimp_fri[i]),
    }


def equality_softness(source: Source, i: int) -> Description:
    """Softness (solref and solimp) of an equality constraint, as a dictionary; `i` is the index in MuJoCo's model."""
    rows = source.rows
    return {"softness": _softness(rows.eq_solref[i], rows.eq_solimp[i])}


def _contact(source: Source, solref: list[float], solimp: list[float]) -> Description:
    """Softness of a contact as a dictionary, from its solref and solimp, or from the options if `option/flag override` is enabled."""
    opt = source.m.opt
    return _softness(opt.o_solref.tolist(), opt.o_solimp.tolist()) if source.overrides else _softness(solref, solimp)


def _softness(solref: list[float], solimp: list[float]) -> Description:
    """Dictionary for the Rust library of a softness, from solref (2 numbers) and solimp (5 numbers)."""
    return {"solref": solref, "solimp": solimp}
