"""Meshes of URDF files: where `package://` and relative names lead."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath
from xml.etree import ElementTree

from stepper._stepper import ModelError

_PACKAGE, _FILE = "package://", "file://"


def resolve_meshes(text: str, place: str, file: Path | None, package_dirs: Sequence[str | os.PathLike[str]] | None) -> str:
    """A URDF whose meshes of collision are named by where they are.

    Args:
        text: The URDF.
        place: What messages call it.
        file: Where it was read from, if from a file.
        package_dirs: Folders that have packages or meshes, or are a package; None is the folders above the file.

    Returns:
        The text with absolute names; as it is where no mesh has a folder in its name, which MuJoCo's compiler finds beside the file.

    Raises:
        ModelError: A mesh is nowhere; the message names it and where it was looked for.
    """
    try:
        robot = ElementTree.fromstring(text)
    except ElementTree.ParseError:
        return text  # MuJoCo's compiler says what is wrong.
    compiler = robot.find("mujoco/compiler")
    said = {} if compiler is None else compiler.attrib
    if said.get("strippath") == "true":
        return text  # Without folders names are found beside the file.
    meshes = robot.findall(".//collision/geometry/mesh")
    if said.get("discardvisual") == "false":
        meshes += robot.findall(".//visual/geometry/mesh")
    if all("/" not in mesh.get("filename", "") for mesh in meshes):
        return text
    given = None if package_dirs is None else [Path(folder).absolute() for folder in package_dirs]
    above = [] if file is None else list(file.absolute().parents)
    own = above[:1]
    if own and (meshdir := said.get("meshdir") or said.get("assetdir")):
        own = [own[0] / meshdir, *own]
    for mesh in meshes:
        name = mesh.get("filename", "")
        searched = list(dict.fromkeys(_candidates(name, own, above if given is None else given, given or [])))
        mesh.set("filename", str(_first(searched, name, place)))
    if compiler is None:
        compiler = ElementTree.SubElement(ElementTree.SubElement(robot, "mujoco"), "compiler")
    compiler.set("strippath", "false")
    return ElementTree.tostring(robot, encoding="unicode")


def _first(searched: list[Path], name: str, place: str) -> Path:
    for candidate in searched:
        if candidate.is_file():
            return candidate
    where = ", ".join(str(candidate) for candidate in searched) or "nowhere: text has no folder of its own"
    package = name.removeprefix(_PACKAGE).partition("/")[0] if name.startswith(_PACKAGE) else ""
    folder = f"the folder that has the package {package}, or is it" if package else "the folder that the name begins in"
    raise ModelError(f"{place}: the mesh {name} is not there; looked for {where}. Give stepper.load(..., package_dirs=[...]) {folder}")


def _candidates(name: str, own: list[Path], packages: list[Path], given: list[Path]) -> Iterator[Path]:
    """Where a mesh may be, the likeliest first: in the file's own folders, in those that have packages, in those that were given."""
    if name.startswith(_PACKAGE):
        package, _, rest = name.removeprefix(_PACKAGE).partition("/")
        for folder in packages:
            yield folder / package / rest
            if folder.name == package:
                yield folder / rest
        return
    path = Path(name.removeprefix(_FILE))
    if path.is_absolute():
        yield path
        return
    yield from (folder / path for folder in [*own, *given])
    # Where a compiler that strips names of their folders finds it.
    yield from (folder / PurePosixPath(name).name for folder in own)
