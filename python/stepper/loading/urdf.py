"""Meshes of URDF files: paths of `package://`, `model://`, `file:` and relative names."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from urllib.parse import unquote
from xml.etree import ElementTree

from stepper._stepper import ModelError
from stepper.loading.urdf_xml import parse

_PACKAGE = ("package://", "model://")
_FILE = ("file://", "file:")

VARIABLES = {"ROS_PACKAGE_PATH": "", "AMENT_PREFIX_PATH": "share", "GAZEBO_MODEL_PATH": "", "GZ_SIM_RESOURCE_PATH": ""}
"""Environment variables with lists of folders, and the folder in each of these that has packages."""


def resolve_meshes(text: str, place: str, file: Path | None, package_dirs: Sequence[str | os.PathLike[str]] | None) -> str:
    """Text of a URDF with absolute paths of its collision meshes.

    Args:
        text: The URDF.
        place: Name of the URDF in messages.
        file: File of the URDF, if it was read from one.
        package_dirs: Folders with packages or meshes, or packages; None is the folders above the file. The folders of `VARIABLES` come
            after these.

    Returns:
        The text with absolute paths; unchanged if it has no mesh, or if MuJoCo's compiler finds all meshes.

    Raises:
        ModelError: A mesh was not found; the message has its name, its link and the searched folders.
    """
    robot = parse(text)
    if robot is None:
        return text  # MuJoCo's compiler reports the fault.
    compiler = robot.find("mujoco/compiler")
    said = {} if compiler is None else compiler.attrib
    if said.get("strippath") == "true":
        return text  # Without folders names are found in the folder of the file.
    kinds = ["collision", "visual"] if said.get("discardvisual") == "false" else ["collision"]
    meshes = [(link, mesh) for link in robot.iter("link") for kind in kinds for mesh in link.findall(f"{kind}/geometry/mesh")]
    if file is None and all("/" not in mesh.get("filename", "") for _, mesh in meshes):
        return text  # Text has no folder: such names are in the working directory.
    places = _places(file, said.get("meshdir") or said.get("assetdir") or "", package_dirs)
    for link, mesh in meshes:
        mesh.set("filename", str(_found(mesh.get("filename", ""), places, place, link.get("name", ""))))
    if not meshes:
        return text
    if compiler is None:
        compiler = ElementTree.SubElement(ElementTree.SubElement(robot, "mujoco"), "compiler")
    compiler.set("strippath", "false")
    return ElementTree.tostring(robot, encoding="unicode")


@dataclass(frozen=True)
class _Places:
    """Folders in which meshes may be.

    Attributes:
        own: Those of the file.
        packages: Those that have packages, or are one.
        given: Those that the user gave.
    """

    own: list[Path]
    packages: list[Path]
    given: list[Path]


def _places(file: Path | None, meshdir: str, package_dirs: Sequence[str | os.PathLike[str]] | None) -> _Places:
    above = [] if file is None else list(file.absolute().parents)
    own = above[:1]
    if own and meshdir:
        own = [own[0] / meshdir, *own]
    given = [Path(folder).absolute() for folder in package_dirs or ()]
    return _Places(own, [*(above if package_dirs is None else given), *_of_environment()], given)


def _of_environment() -> Iterator[Path]:
    for variable, inner in VARIABLES.items():
        yield from (Path(folder).absolute() / inner for folder in os.environ.get(variable, "").split(os.pathsep) if folder)


def _found(name: str, places: _Places, place: str, link: str) -> Path:
    searched = list(dict.fromkeys(_candidates(name, places)))
    for candidate in searched:
        if candidate.is_file():
            return candidate
    where = ", ".join(str(candidate) for candidate in searched) or "no folder, because XML text has none"
    package = _without(_PACKAGE, name).partition("/")[0] if name.startswith(_PACKAGE) else ""
    folder = f"the folder that contains the package {package}, or the package itself" if package else "the folder that the path starts from"
    remedy = f"Pass {folder} in stepper.load(..., package_dirs=[...])" + (", or set ROS_PACKAGE_PATH" if package else "")
    raise ModelError(f'{place}: link "{link}": mesh {name} not found; searched {where}. {remedy}')


def _without(prefixes: tuple[str, ...], name: str) -> str:
    return next((name[len(prefix) :] for prefix in prefixes if name.startswith(prefix)), name)


def _candidates(name: str, places: _Places) -> Iterator[Path]:
    """Possible paths of a mesh, the likeliest first: in the folders of the file, in those that have packages, in those that were given."""
    if name.startswith(_PACKAGE):
        package, _, rest = _without(_PACKAGE, name).partition("/")
        for folder in places.packages:
            yield folder / package / rest
            if folder.name == package:
                yield folder / rest
        return
    path = Path(unquote(_without(_FILE, name)) if name.startswith(_FILE) else name)
    if path.is_absolute():
        yield path
        return
    yield from (folder / path for folder in [*places.own, *places.given])
    # Where a compiler that strips names of their folders finds it.
    yield from (folder / PurePosixPath(name).name for folder in places.own)
