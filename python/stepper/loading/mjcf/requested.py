"""Integrator, solver and softness that a compiled `mujoco.MjModel` requests, and that stepper's default options replace."""

from __future__ import annotations

from typing import Any

import numpy as np

from stepper.loading.mjcf.source import Source

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
