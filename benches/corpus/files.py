"""Model files of a package, and their compilation by MuJoCo."""

import fnmatch
import hashlib
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np

from corpus.packages import Package

ROOTS = {"mujoco", "robot"}
"""Names of the outermost element of MJCF and URDF."""


class FragmentError(Exception):
    """Error of a file that is no complete model; the message has the reason."""


def candidates(package: Package, folder: Path) -> list[str]:
    """Paths in the package of possible models: MJCF, URDF, and MuJoCo's compiled models."""
    found = (path for kind in ("*.xml", "*.urdf", "*.mjb") for path in folder.rglob(kind))
    names = sorted(path.relative_to(folder).as_posix() for path in found)
    kept = [name for name in names if not any(fnmatch.fnmatch(name, pattern) for pattern in package.left_out)]
    return [name for name in kept if name.endswith(".mjb") or _root(folder / name) in ROOTS]


def _root(path: Path) -> str:
    """Name of the outermost element of an XML file. It is "mujoco" for invalid XML, so that MuJoCo reports the error."""
    try:
        for _, element in ET.iterparse(path, events=("start",)):
            return str(element.tag)
    except ET.ParseError:
        pass
    return "mujoco"


def compile_model(folder: Path, name: str) -> mujoco.MjModel:
    """Compile a file of a package.

    Raises:
        FragmentError: MuJoCo's compiler rejects the file.
    """
    path = folder / name
    try:
        if path.suffix == ".mjb":
            return mujoco.MjModel.from_binary_path(str(path))
        if _root(path) == "robot":
            return _compile_urdf(folder, path)
        return mujoco.MjModel.from_xml_path(str(path))
    except (ValueError, ET.ParseError) as error:
        raise FragmentError(" ".join(str(error).replace(str(folder), "").split())) from error


def _compile_urdf(folder: Path, path: Path) -> mujoco.MjModel:
    """Compile a copy of a URDF file with resolved mesh paths and corrected impossible inertias.

    The copy has no visual shapes: they do not affect the motion, and MuJoCo cannot read the format of many visual meshes.
    """
    tree = ET.parse(path)
    robot = tree.getroot()
    for link in robot.iter("link"):
        for visual in link.findall("visual"):
            link.remove(visual)
    for inertia in robot.iter("inertia"):
        _correct_inertia(inertia)
    for mesh in robot.iter("mesh"):
        mesh.set("filename", str(resolve(mesh.get("filename", ""), folder, path)))
    settings = robot.find("mujoco")
    settings = ET.SubElement(robot, "mujoco") if settings is None else settings
    compiler = settings.find("compiler")
    compiler = ET.SubElement(settings, "compiler") if compiler is None else compiler
    compiler.set("strippath", "false")
    # With `balanceinertia`, MuJoCo replaces impossible principal moments A + B < C by their mean.
    compiler.set("balanceinertia", "true")
    compiler.attrib.pop("meshdir", None)
    with tempfile.TemporaryDirectory() as place:
        copy = Path(place) / path.name
        tree.write(copy)
        return mujoco.MjModel.from_xml_path(str(copy))


def _correct_inertia(inertia: ET.Element) -> None:
    """Set the products of inertia of a URDF's inertia to 0 if the inertia is not positive definite."""
    xx, xy, xz, yy, yz, zz = (float(inertia.get(name, "0")) for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
    if np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])[0] <= 0.0:
        for name in ("ixy", "ixz", "iyz"):
            inertia.set(name, "0")


def resolve(reference: str, folder: Path, urdf: Path) -> Path:
    """Path of the file to which a reference in a URDF refers.

    The search begins in the folder of the URDF and goes up to the folder of the package.

    Raises:
        FragmentError: The package has no such file.
    """
    _, scheme, rest = reference.rpartition("://")
    for place in _upwards(urdf.parent, folder):
        # The name of a ROS package often differs from that of its folder.
        for tail in (rest, rest.partition("/")[2]) if scheme else (rest,):
            if tail and (place / tail).is_file():
                return (place / tail).resolve()
    raise FragmentError(f"file {reference}, to which the model refers, is not in the package")


def _upwards(start: Path, end: Path) -> Iterator[Path]:
    """Yield a folder and all folders above it, up to the folder `end`."""
    yield start
    while start not in (end, start.parent):
        start = start.parent
        yield start


def digest(model: mujoco.MjModel) -> str:
    """Digest of a compiled model, twelve hexadecimal digits. It does not depend on the paths of the files."""
    buffer = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    compiled = buffer.tobytes()
    return hashlib.sha256(compiled.replace(model.paths, b"") if model.paths else compiled).hexdigest()[:12]
