"""Sources of models, which have visual elements that a model does not store, such as colours and visual meshes."""

from __future__ import annotations

import os
import weakref
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from stepper._stepper import Model

KEPT = 8
"""Texts and compiled models that are kept in addition to those of existing models: of the last ones that do not, whose variants
(`Model.replace`) may. Few, because one may be a compiled model with all its meshes."""
KEPT_FILES = 256
"""Files that are kept in this way; of each only its path."""


@dataclass(frozen=True)
class Origin:
    """Arguments of `stepper.load`.

    Attributes:
        source: Path, text or compiled `mujoco.MjModel`.
        package_dirs: Folders with the meshes of a URDF.
    """

    source: Any
    package_dirs: tuple[str, ...] | None = None

    @property
    def is_file(self) -> bool:
        """Whether the source is a path, which is absolute then."""
        return isinstance(self.source, str) and "<" not in self.source


@dataclass(frozen=True)
class _Entry:
    """Looks of a model when it was loaded, its source, and the model while it exists."""

    structure: tuple[Any, ...]
    places: tuple[Any, ...]
    origin: Origin
    model: weakref.ref[Model]

    @property
    def looks(self) -> tuple[Any, ...]:
        return self.structure, self.places


_remembered: list[_Entry] = []


def remember(model: Model, source: Any, package_dirs: Sequence[str | os.PathLike[str]] | None) -> None:
    """Stores the source of a model."""
    folders = None if package_dirs is None else tuple(os.path.abspath(folder) for folder in package_dirs)
    is_path = isinstance(source, os.PathLike) or (isinstance(source, str) and "<" not in source)
    given = os.path.abspath(source) if is_path else source
    entry = _Entry(_structure(model), _places(model), Origin(given, folders), weakref.ref(model))
    # What is noted again is the newest, and does not take the place of others.
    others = [other for other in _remembered if other.looks != entry.looks]
    gone = [other for other in others if other.model() is None]
    forgotten = set()
    for kept, of_files in ((KEPT, False), (KEPT_FILES, True)):
        alike = [other for other in gone if other.origin.is_file == of_files]
        forgotten |= {id(other) for other in alike[:-kept]}
    _remembered[:] = [*(other for other in others if id(other) not in forgotten), entry]


def origin_of(model: Model) -> Origin | None:
    """Source of a model, or of the model from which `Model.replace` made it; None if this process did not load it from a source."""
    structure, places = _structure(model), _places(model)
    alike = [entry for entry in reversed(_remembered) if entry.structure == structure]
    same = [entry for entry in alike if entry.places == places]
    return next((entry.origin for entry in [*same, *alike]), None)


def _structure(model: Model) -> tuple[Any, ...]:
    """Fields that variants of a model share."""
    return (model.name, model.nq, model.nv, model.ngeom, *model.body_names, *model.joint_names, *model.geom_names)


def _places(model: Model) -> tuple[Any, ...]:
    """Fields in which variants of a model look different."""
    return tuple(values.tobytes() for values in (model.geom_size, model.geom_pos, model.geom_quat, model.body_pos, model.body_quat))
