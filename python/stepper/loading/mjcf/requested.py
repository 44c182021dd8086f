"""Integrator, solver and softness that a compiled `mujoco.MjModel` requests, and that stepper's default options replace."""

from __future__ import annotations

from typing import Any

import numpy as np

from stepper.loading.mjcf.source import Description, Source

# MuJoCo's default solref and solimp; a test compares them with the installed version.
SOLREF = (0.02, 1.0)
SOLIMP = (0.9, 0.95, 0.001, 0.5, 2.0)

_MOST_NAMES = 4
"""Largest number of element names that a text lists for a kind of constraint."""


def requested(source: Source) -> dict[str, Any]:
    """Integrator, solver, iterations, friction cone and softness of a model, as fields of the Rust crate's `Requested`.

    "cone" is None if no contact is possible; "constrained" is whether the model can have constraints.
    """
    m, opt = source.m, source.m.opt
    limited = (np.any(m.jnt_limited) or np.any(m.tendon_limited)) and not source.off("limit")
    has_friction = (np.any(m.dof_frictionloss) or np.any(m.tendon_frictionloss)) and not source.off("frictionloss")
    has_equalities = np.any(m.eq_active0) and not source.off("equality")
    return {
        "integrator": _mjcf_name(source, "mjtIntegrator", opt.integrator),
        "solver": _mjcf_name(source, "mjtSolver", opt.solver),
        "iterations": int(opt.iterations),
        "cone": _mjcf_name(source, "mjtCone", opt.cone).lower() if source.collides else None,
        "constrained": bool(source.collides or limited or has_friction or has_equalities),
        "soft": list(_soft(source)),
    }


def _mjcf_name(source: Source, enum: str, value: int) -> str:
    """Name in MJCF of a value of an enumeration of MuJoCo, for example "Newton" for `mjSOL_NEWTON`."""
    name = str(getattr(source.mujoco, enum)(int(value)).name).split("_", 1)[1]
    return {"EULER": "Euler", "NEWTON": "Newton"}.get(name, name if len(name) < 4 else name.lower())


def _soft(source: Source) -> list[str]:
    """Texts on constraints whose softness is not MuJoCo's default, one for each kind of constraint: the number and the first names."""
    m = source.m
    solid = ((m.geom_contype != 0) | (m.geom_conaffinity != 0)) & source.collides
    lossy, differs = m.dof_frictionloss != 0, _differs(m.dof_solref, m.dof_solimp)
    friction = np.array([lossy[dofs].any() and differs[dofs].any() for dofs in map(source.dofs, range(m.njnt))], bool)
    limits, losses = not source.off("limit"), not source.off("frictionloss")
    kinds = {
        ("GEOM", "geoms"): solid & _differs(m.geom_solref, m.geom_solimp),
        ("PAIR", "contact pairs"): _differs(m.pair_solref, m.pair_solimp) & (not source.off("contact")),
        ("JOINT", "limits of joints"): (m.jnt_limited != 0) & _differs(m.jnt_solref, m.jnt_solimp) & limits,
        ("JOINT", "joints with dry friction"): friction & losses,
        ("EQUALITY", "equalities"): (m.eq_active0 != 0) & _differs(m.eq_solref, m.eq_solimp) & (not source.off("equality")),
        ("TENDON", "limits of tendons"): (m.tendon_limited != 0) & _differs(m.tendon_solref_lim, m.tendon_solimp_lim) & limits,
        ("TENDON", "tendons with dry friction"): (m.tendon_frictionloss != 0) & _differs(m.tendon_solref_fri, m.tendon_solimp_fri) & losses,
    }
    found = []
    for (kind, word), chosen in kinds.items():
        indices = np.flatnonzero(chosen).tolist()
        if indices:
            names, more = [source.label(kind, i) for i in indices[:_MOST_NAMES]], ", ..." if len(indices) > _MOST_NAMES else ""
            found.append(f"{len(indices)} {word} ({', '.join(names)}{more})")
    return found


def _differs(solref: np.ndarray[Any, Any], solimp: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Whether each row of solref (n, 2) or solimp (n, 5) differs from MuJoCo's default: (n,) bool."""
    differs: np.ndarray[Any, Any] = np.any(solref != SOLREF, axis=1) | np.any(solimp != SOLIMP, axis=1)
    return differs


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
