"""Where models came from: what a model does not hold, such as colours and meshes that nothing touches, is still in its source."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from stepper._stepper import Model

KEPT = 8
"""Texts and compiled models that are remembered, the last ones. Few, because one may be a compiled model with all its meshes."""
KEPT_FILES = 256
"""Files that are remembered, the last ones: of each only its path."""


@dataclass(frozen=True)
class Origin:
    """What `stepper.load` was given.

    Attributes:
        source: Path, text or compiled `mujoco.MjModel`.
        package_dirs: Where meshes of a URDF are found.
    """

    source: Any
    package_dirs: tuple[str, ...] | None = None

    @property
    def is_file(self) -> bool:
        """Whether the source is a path, which is absolute then."""
        return isinstance(self.source, str) and "<" not in self.source


_remembered: list[tuple[tuple[Any, ...], tuple[Any, ...], Origin]] = []


def remember(model: Model, source: Any, package_dirs: Sequence[str | os.PathLike[str]] | None) -> None:
    """Notes where a model came from."""
    folders = None if package_dirs is None else tuple(os.path.abspath(folder) for folder in package_dirs)
    is_path = isinstance(source, os.PathLike) or (isinstance(source, str) and "<" not in source)
    given = os.path.abspath(source) if is_path else source
    entry = (_structure(model), _places(model), Origin(given, folders))
    # What is noted again is the newest, and does not take the place of others.
    _remembered[:] = [other for other in _remembered if other[:2] != entry[:2]]
    _remembered.append(entry)
    for kept, of_files in ((KEPT, False), (KEPT_FILES, True)):
        alike = [entry for entry in _remembered if entry[2].is_file == of_files]
        for oldest in alike[:-kept]:
            _remembered.remove(oldest)


def origin_of(model: Model) -> Origin | None:
    """Where a model came from, or one that it is a variant of (`Model.replace`); None where this process did not load it from a source."""
    structure, places = _structure(model), _places(model)
    alike = [entry for entry in reversed(_remembered) if entry[0] == structure]
    same = [entry for entry in alike if entry[1] == places]
    return next((origin for _, _, origin in [*same, *alike]), None)


def _structure(model: Model) -> tuple[Any, ...]:
    """What variants of a model have in common."""
    return (model.name, model.nq, model.nv, model.ngeom, *model.body_names, *model.joint_names, *model.geom_names)


def _places(model: Model) -> tuple[Any, ...]:
    """What tells variants of a model apart for the eye."""
    return tuple(values.tobytes() for values in (model.geom_size, model.geom_pos, model.geom_quat, model.body_pos, model.body_quat))
