"""Paths of the meshes of URDF files: resolves `package://`, `model://`, `file:` and relative names."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from urllib.parse import unquote
from xml.etree import ElementTree

from stepper._stepper import ModelError
from stepper.loading.urdf_elements import parse
from stepper.shared.files import shortened

_PACKAGE = ("package://", "model://")
_FILE = ("file://", "file:")

VARIABLES = {"ROS_PACKAGE_PATH": "", "AMENT_PREFIX_PATH": "share", "GAZEBO_MODEL_PATH": "", "GZ_SIM_RESOURCE_PATH": ""}
"""Environment variables with lists of folders in which packages are searched.

The value is the name of the subfolder with the packages in each listed folder, or "" if the listed folder itself contains them.
"""


def resolve_meshes(text: str, place: str, file: Path | None, package_dirs: Sequence[str | os.PathLike[str]] | None) -> str:
    """Replaces the paths of the meshes that MuJoCo's compiler reads, in the text of a URDF, by absolute paths.

    Args:
        text: The URDF.
        place: Name of the URDF in messages.
        file: File of the URDF, if it was read from one.
        package_dirs: Packages, or folders with packages or meshes; None searches for packages in all folders above the file. The folders
            of `VARIABLES` are searched last.

    Returns:
        The text with absolute paths; unchanged if it has no mesh, or if MuJoCo's compiler finds all meshes.

    Raises:
        ModelError: A mesh was not found; the message has its name, its link and the searched folders.
    """
    robot = parse(text)
    if robot is None:
        return text  # MuJoCo's compiler reports the fault.
    compiler = robot.find("mujoco/compiler")
    settings = {} if compiler is None else compiler.attrib
    if settings.get("strippath") == "true":
        return text  # The compiler removes folders from the names, and finds the files in the folder of the URDF.
    kinds = ["collision", "visual"] if settings.get("discardvisual") == "false" else ["collision"]
    meshes = [(link, mesh) for link in robot.iter("link") for kind in kinds for mesh in link.findall(f"{kind}/geometry/mesh")]
    if file is None and all("/" not in mesh.get("filename", "") for _, mesh in meshes):
        return text  # Text has no folder: MuJoCo reads names without a folder from the working directory.
    folders = _search_folders(file, settings.get("meshdir") or settings.get("assetdir") or "", package_dirs)
    for link, mesh in meshes:
        mesh.set("filename", str(_find_mesh(mesh.get("filename", ""), folders, place, link.get("name", ""))))
    if not meshes:
        return text
    if compiler is None:
        compiler = ElementTree.SubElement(ElementTree.SubElement(robot, "mujoco"), "compiler")
    compiler.set("strippath", "false")
    return ElementTree.tostring(robot, encoding="unicode")


@dataclass(frozen=True)
class _SearchFolders:
    """Folders in which meshes are searched.

    Attributes:
        of_file: Folder of the URDF file. If the URDF sets `meshdir`, that folder comes first in the list. Empty for XML text.
        packages: Folders that may be packages or contain packages.
        given: Folders of the argument `package_dirs`.
    """

    of_file: list[Path]
    packages: list[Path]
    given: list[Path]


def _search_folders(file: Path | None, meshdir: str, package_dirs: Sequence[str | os.PathLike[str]] | None) -> _SearchFolders:
    """Folders to search for meshes of a URDF."""
    above = [] if file is None else list(file.absolute().parents)
    of_file = above[:1]
    if of_file and meshdir:
        of_file = [of_file[0] / meshdir, *of_file]
    given = [Path(folder).absolute() for folder in package_dirs or ()]
    return _SearchFolders(of_file, [*(above if package_dirs is None else given), *_folders_of_environment()], given)


def _folders_of_environment() -> Iterator[Path]:
    """Yields folders with packages from the environment variables `VARIABLES`, such as ROS_PACKAGE_PATH."""
    for variable, inner in VARIABLES.items():
        yield from (Path(folder).absolute() / inner for folder in os.environ.get(variable, "").split(os.pathsep) if folder)


def _find_mesh(name: str, folders: _SearchFolders, place: str, link: str) -> Path:
    """Path of an existing file for a mesh of a URDF; a ModelError if there is none."""
    searched = list(dict.fromkeys(_candidates(name, folders)))
    for candidate in searched:
        # Unlike `Path.is_file`, this function is False for names that are too long for the file system.
        if os.path.isfile(candidate):
            return candidate
    where = ", ".join(shortened(str(candidate)) for candidate in searched) or "no folder, because XML text has none"
    package = _without_prefix(_PACKAGE, name).partition("/")[0] if name.startswith(_PACKAGE) else ""
    folder = f"the folder that contains the package {package}, or the package itself" if package else "the folder that the path starts from"
    remedy = f"Pass {folder} in stepper.load(..., package_dirs=[...])" + (", or set ROS_PACKAGE_PATH" if package else "")
    raise ModelError(f'{place}: link "{link}": mesh {shortened(name)} not found; searched {where}. {remedy}')


def _without_prefix(prefixes: tuple[str, ...], name: str) -> str:
    """Name without the first of `prefixes` with which it begins; unchanged if it begins with none."""
    return next((name[len(prefix) :] for prefix in prefixes if name.startswith(prefix)), name)


def _candidates(name: str, folders: _SearchFolders) -> Iterator[Path]:
    """Yields possible paths of a mesh file in the order of the search.

    A name such as "package://robot/mesh.stl" is searched in package folders. Any other relative name is searched in the folder of the URDF,
    and then in the folders of the argument `package_dirs`.
    """
    if name.startswith(_PACKAGE):
        package, _, rest = _without_prefix(_PACKAGE, name).partition("/")
        for folder in folders.packages:
            yield folder / package / rest
            if folder.name == package:
                yield folder / rest
        return
    path = Path(unquote(_without_prefix(_FILE, name)) if name.startswith(_FILE) else name)
    if path.is_absolute():
        yield path
        return
    yield from (folder / path for folder in [*folders.of_file, *folders.given])
    # Unless `strippath` is false, MuJoCo's compiler leaves out the folders in the name, and finds the file here.
    yield from (folder / PurePosixPath(name).name for folder in folders.of_file)
