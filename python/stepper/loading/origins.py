"""Record of the sources from which models were loaded. Drawing reads a source again, because a Model has no colours or visual meshes."""

from __future__ import annotations

import os
import weakref
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from stepper._stepper import Model

KEPT = 8
"""Largest number of texts and compiled models that are kept as sources after their Model was deleted.

The sources are kept because a variant of the model (`Model.replace`) may still exist. The number is small, because a compiled model may
be large.
"""
KEPT_FILES = 256
"""Largest number of file paths that are kept as sources after their Model was deleted."""


@dataclass(frozen=True)
class Origin:
    """Arguments of the call of `stepper.load` that loaded a model.

    Attributes:
        source: Path, text, `mujoco.MjSpec` or compiled `mujoco.MjModel`.
        package_dirs: Folders with the meshes of a URDF.
        floor: Height of the added floor, m; None without one.
        free_base: Whether the root link of a URDF got a free joint.
    """

    source: Any
    package_dirs: Sequence[str | os.PathLike[str]] | None = None
    floor: float | None = None
    free_base: bool = False

    @property
    def is_changed(self) -> bool:
        """Whether `load` added a floor or a free joint to the source."""
        return self.floor is not None or self.free_base

    def absolute(self) -> Origin:
        """Origin whose paths do not depend on the working directory."""
        folders = None if self.package_dirs is None else tuple(os.path.abspath(folder) for folder in self.package_dirs)
        is_path = isinstance(self.source, os.PathLike) or (isinstance(self.source, str) and "<" not in self.source)
        return replace(self, source=os.path.abspath(self.source) if is_path else self.source, package_dirs=folders)

    @property
    def is_file(self) -> bool:
        """Whether the source is a path; paths are stored as absolute ones."""
        return isinstance(self.source, str) and "<" not in self.source


@dataclass(frozen=True)
class _Entry:
    """Remembered source of a loaded model, with data of the model by which its variants (`Model.replace`) are recognised.

    Attributes:
        structure: Counts and names of the model's elements.
        places: Sizes and poses of geoms and bodies, as bytes.
        origin: The source.
        model: The model, as a weak reference.
    """

    structure: tuple[Any, ...]
    places: tuple[Any, ...]
    origin: Origin
    model: weakref.ref[Model]

    @property
    def key(self) -> tuple[Any, ...]:
        """Key that identifies the model: names, counts, sizes and poses. A later model with an equal key replaces this entry."""
        return self.structure, self.places


_remembered: list[_Entry] = []


def remember(model: Model, origin: Origin) -> None:
    """Stores the source from which a model was loaded, for later calls of `origin_of`."""
    entry = _Entry(_structure(model), _places(model), origin.absolute(), weakref.ref(model))
    # A model that is loaded again replaces its entry, so that it does not displace other entries.
    others = [other for other in _remembered if other.key != entry.key]
    gone = [other for other in others if other.model() is None]
    forgotten = set()
    for kept, of_files in ((KEPT, False), (KEPT_FILES, True)):
        alike = [other for other in gone if other.origin.is_file == of_files]
        forgotten |= {id(other) for other in alike[:-kept]}
    _remembered[:] = [*(other for other in others if id(other) not in forgotten), entry]


def origin_of(model: Model) -> Origin | None:
    """Source of a model: the file, text or compiled model from which this process loaded it. None if it is unknown.

    For a variant of a loaded model (`Model.replace`), it is the source of the loaded model. Models are found by
    comparison: the most recently loaded one with equal names, sizes and poses, or otherwise with equal names.
    """
    structure, places = _structure(model), _places(model)
    alike = [entry for entry in reversed(_remembered) if entry.structure == structure]
    same = [entry for entry in alike if entry.places == places]
    return next((entry.origin for entry in [*same, *alike]), None)


def _structure(model: Model) -> tuple[Any, ...]:
    """Counts and names of a model's elements, which `Model.replace` does not change."""
    return (model.name, model.nq, model.nv, model.ngeom, *model.body_names, *model.joint_names, *model.geom_names)


def _places(model: Model) -> tuple[Any, ...]:
    """Sizes and poses of a model's geoms and bodies, as bytes. `Model.replace` may change sizes and poses."""
    return tuple(values.tobytes() for values in (model.geom_size, model.geom_pos, model.geom_quat, model.body_pos, model.body_quat))
