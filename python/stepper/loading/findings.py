"""Warnings about a model that was just loaded."""

from __future__ import annotations

import warnings
from collections.abc import Iterator

from stepper._options import Options
from stepper._stepper import Model, ModelError, Stepper

_MOST_LINES = 8
"""Largest number of lines per kind of finding in a warning."""


_LARGE_PART = 10.0
"""Smallest ratio of convex-hull volume to mesh volume at which the warning about a loaded model lists a mesh that is a part of a robot.

`Model.explain()` lists ratios from 2 on. Of 1,390 collision meshes of 120 URDFs, 28 (of 13 robots) exceed 10, and 247 (of 49 robots) exceed
2.
"""


_INSTANT = 1e-9
"""Duration of the trial step that measures overlaps in a keyframe, s. At 1,000 m/s a body moves by 1 um, a thousandth of `_DEEP`."""
_DEEP = 1e-3
"""Smallest overlap in a keyframe that the warning lists, m. At this depth, steps set DEEP in `Stepper.status`."""


class ModelWarning(UserWarning):
    """Warning that a loaded model differs from its source: other settings, convex hulls of meshes, missing sensors, or disabled contacts.

    The warning is also issued if geoms overlap in a keyframe. `Model.explain()` has the details except for keyframes. The command
    `stepper explain` has the deepest overlap of each keyframe. After `sim.reset(keyframe=name)`, `sim.contacts()` has all overlaps there.
    """


def explained(model: Model) -> str:
    """Text of `Model.explain()` for a model, followed by a section on keyframes in which geoms overlap."""
    lines = list(_keyframe_overlaps(model)) or ["nothing"]
    return f"{model.explain()}\n\nOverlaps of more than 1 mm in keyframes:" + "".join(f"\n  {line}" for line in lines)


def warn_about(model: Model, *, loaded: bool, excluded: bool, is_robot: bool) -> None:
    """Issues one ModelWarning with all findings about a model.

    Args:
        model: The model.
        loaded: Whether the model was read from its source. If it is False, the model was saved by `Model.save`, and these warnings were
            issued when it was first loaded.
        excluded: Whether contact between overlapping bodies was disabled (`overlaps="exclude"`).
        is_robot: Whether fixed geoms are the base of a robot, as in a URDF, instead of ground.
    """
    name = f'"{model.name}"' if model.name else "this model"
    parts = []
    if loaded and model.deviations:
        parts.append(_listed(f"{name} has settings that the default options do not use:", model.deviations))
    if loaded and (hulls := [hull for hull in model.wide_hulls if _is_worth_a_warning(model, *hull, is_robot=is_robot)]):
        parts.append(_hulls(model, hulls))
    unread = [f"{kind.split()[1]} {label}: {reason}" for kind, label, reason in model.omitted if kind.endswith(" without reading")]
    if loaded and unread:
        parts.append(_listed("sensors without readings, so that `sensordata` is shorter than MuJoCo's:", unread))
    if excluded:
        parts += _overlaps(model)
    details = "model.explain() has the details; " if parts else ""
    if loaded and (lines := list(_keyframe_overlaps(model))):
        title = "keyframes in which geoms overlap by more than 1 mm, so that the first steps push them apart and `status` has DEEP:"
        remedy = "change the qpos of the keyframe, or add <exclude> for the two bodies if the overlap is meant"
        parts.append(f"{_listed(title, lines)}\n  ({remedy})")
    if parts:
        silence = 'warnings.filterwarnings("ignore", category=stepper.ModelWarning) silences this'
        message = "\n".join(parts) + f"\n({details}{silence})"
        warnings.warn(message, ModelWarning, stacklevel=4)


def _is_worth_a_warning(model: Model, geom: int, ratio: float, *, is_robot: bool) -> bool:
    """Whether the warning about a loaded model lists a mesh whose convex hull is `ratio` times as large as the mesh.

    Fixed ground is listed at any ratio, a part of a robot if the ratio is at least `_LARGE_PART`. With `is_robot`, fixed geoms are the base
    of a robot.
    """
    body = model.body(model.geom(geom).bodyid)
    while body.jntnum == 0 and body.id != 0:
        body = model.body(body.parentid)
    is_ground = body.id == 0 and not is_robot
    return is_ground or ratio >= _LARGE_PART


def _hulls(model: Model, hulls: list[tuple[int, float]]) -> str:
    """Paragraph of the warning on meshes whose convex hulls are much larger. `hulls` are geom indices and ratios of volumes."""
    lines = [
        f"{_label(model, geom)}: {ratio:.1f} times the volume" if ratio < 100 else f"{_label(model, geom)}: more than 100 times the volume"
        for geom, ratio in hulls
    ]
    remedy = "model.replace(geom_concave=...) makes a mesh collide as its triangles; see docs/how-to/terrain.md"
    return _listed(f"these meshes collide as their convex hulls, which are much larger than the meshes ({remedy}):", lines)


def _label(model: Model, geom: int) -> str:
    """Name of a geom; without a name, its index and body."""
    found = model.geom(geom)
    return found.name or f"#{geom} of body {model.body(found.bodyid).name or f'#{found.bodyid}'}"


def _overlaps(model: Model) -> list[str]:
    """Paragraphs of a warning on geoms that overlap at the pose `qpos0`: excluded pairs, and pairs that still collide.

    With overlaps="exclude", contact between bodies that overlap was disabled, except with the ground.
    """
    parts = []
    if model.excluded_overlaps:
        title = 'overlaps="exclude" disables contact between the bodies of these geoms, which overlap at the reference pose:'
        parts.append(_listed(title, [_overlap_line(*overlap) for overlap in model.excluded_overlaps]))
    if kept := model.overlaps():
        title = 'overlaps="exclude" does not change overlaps with the ground; start from a pose above it (qpos0 or the body\'s pos):'
        parts.append(_listed(title, [_overlap_line(*overlap) for overlap in kept]))
    return parts


def _keyframe_overlaps(model: Model) -> Iterator[str]:
    """Yields a line on the deepest overlap in each keyframe, if it is deeper than 1 mm."""
    if not model.keyframe_names:
        return
    # Contacts are those of a trial step, which is too short to move anything.
    sim = Stepper(model, options=Options(timestep=_INSTANT))
    for number, name in enumerate(model.keyframe_names):
        try:
            sim.reset(keyframe=number)
            contacts = sim.contacts()
        except (ModelError, ValueError):
            # `Stepper.reset` reports states that the model cannot have.
            continue
        depths: dict[tuple[int, int], float] = {}
        for pair, distance in zip(contacts["geom"].tolist(), contacts["distance"].tolist(), strict=True):
            depths[tuple(pair)] = max(depths.get(tuple(pair), 0.0), -distance)
        deep = sorted((-depth, pair) for pair, depth in depths.items() if depth > _DEEP)
        if deep:
            more = f", and {len(deep) - 1} more" if len(deep) > 1 else ""
            (one, other), depth = deep[0][1], -deep[0][0]
            yield f"{name or f'#{number}'}: {_overlap_line(_label(model, one), _label(model, other), depth)}{more}"


def _overlap_line(one: str, other: str, depth: float) -> str:
    """Text on two overlapping geoms, given by name, and the depth of their overlap, m."""
    return f"{one} and {other} by {1e3 * depth:.2f} mm"


def _listed(title: str, lines: list[str]) -> str:
    """Paragraph of a warning: a title, at most `_MOST_LINES` indented lines, and the number of further lines."""
    more = [f"and {len(lines) - _MOST_LINES} more"] if len(lines) > _MOST_LINES else []
    return title + "".join(f"\n  {line}" for line in [*lines[:_MOST_LINES], *more])
