"""Warnings about a model that was just loaded."""

from __future__ import annotations

import warnings

from stepper._stepper import Model

_SHOWN = 8
"""Lines of a kind that a warning shows."""


_LARGE_PART = 10.0
"""Hull volume over the mesh's volume from which the warning names a part of a robot; `Model.explain()` names it from 2 on. Of
1,390 collision meshes of 120 URDFs, 28 of 13 robots are above, and 247 of 49 robots above 2."""


class ModelWarning(UserWarning):
    """A model that runs otherwise than its source says, or than its meshes look: `Model.explain()` has it in words."""


def warn_of(model: Model, *, loaded: bool, excluded: bool, is_robot: bool) -> None:
    """Issues one ModelWarning for all that runs otherwise than the user may expect.

    Args:
        model: The model.
        loaded: Whether it was read from its source, not from a saved model, of which the user was warned before.
        excluded: Whether overlaps were excluded.
        is_robot: Whether all that it has is a robot, as in a URDF: what no joint moves is a base, not the ground.
    """
    name = f'"{model.name}"' if model.name else "this model"
    parts = []
    if loaded and model.deviations:
        parts.append(_listed(f"{name} asks for what does not run by default:", model.deviations))
    if loaded and (hulls := [hull for hull in model.wide_hulls if _is_worth_a_warning(model, *hull, is_robot=is_robot)]):
        parts.append(_hulls(model, hulls))
    if excluded:
        parts += _overlaps(model)
    if parts:
        silence = 'warnings.filterwarnings("ignore", category=stepper.ModelWarning) silences this'
        message = "\n".join(parts) + f"\n(model.explain() has all of it; {silence})"
        warnings.warn(message, ModelWarning, stacklevel=3)


def _is_worth_a_warning(model: Model, geom: int, ratio: float, *, is_robot: bool) -> bool:
    """Whether a hull is too large for what the geom is: ground, on which others rest, or a part of a robot."""
    body = model.body(model.geom(geom).bodyid)
    while body.jntnum == 0 and body.id != 0:
        body = model.body(body.parentid)
    is_ground = body.id == 0 and not is_robot
    return is_ground or ratio >= _LARGE_PART


def _hulls(model: Model, hulls: list[tuple[int, float]]) -> str:
    lines = [
        f"{_label(model, geom)}: {ratio:.1f} times" if ratio < 100 else f"{_label(model, geom)}: more than 100 times"
        for geom, ratio in hulls
    ]
    remedy = "model.replace(geom_concave=...) makes a mesh collide as its triangles; see docs/terrain.md"
    return _listed(f"meshes collide as convex hulls that have more than the volume of the mesh ({remedy}):", lines)


def _label(model: Model, geom: int) -> str:
    found = model.geom(geom)
    return found.name or f"#{geom} of body {model.body(found.bodyid).name or f'#{found.bodyid}'}"


def _overlaps(model: Model) -> list[str]:
    """Paragraphs on the overlaps that were excluded, and on those that stay."""
    parts = []
    if model.excluded_overlaps:
        title = 'overlaps="exclude" leaves out contact between the bodies of these geoms, which overlap at the reference pose:'
        parts.append(_listed(title, [_line(*overlap) for overlap in model.excluded_overlaps]))
    if kept := model.overlaps():
        title = 'overlaps="exclude" keeps overlaps with the ground; give a pose above it (qpos0, the body\'s pos):'
        parts.append(_listed(title, [_line(*overlap) for overlap in kept]))
    return parts


def _line(one: str, other: str, depth: float) -> str:
    return f"{one} and {other} by {1e3 * depth:.2f} mm"


def _listed(title: str, lines: list[str]) -> str:
    more = [f"and {len(lines) - _SHOWN} more"] if len(lines) > _SHOWN else []
    return title + "".join(f"\n  {line}" for line in [*lines[:_SHOWN], *more])
