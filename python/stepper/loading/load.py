"""`stepper.load`: reading of models from files, text, a `mujoco.MjSpec` or a compiled `mujoco.MjModel`."""

import contextlib
import math
import numbers
import os
import warnings
from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np

from stepper._stepper import Model, ModelError
from stepper.loading.findings import warn_about
from stepper.loading.mjcf import describe
from stepper.loading.origins import Origin, remember
from stepper.loading.urdf import resolve_meshes
from stepper.loading.urdf_actuators import KINDS, Actuators, add_actuators
from stepper.loading.urdf_elements import Urdf, omissions, refuse_xacro
from stepper.shared.arguments import check_flag, path_of
from stepper.shared.files import existing

FLOOR, FREE_BASE = "floor", "free_base"
"""Names of the added plane and of the added free joint."""
_COLOUR = (0.5, 0.55, 0.6, 1.0)
"""Colour of the added plane in pictures: red, green, blue, opacity."""
_UPWARD = 0.5
"""Smallest z component of the normal of a plane that counts as a floor. A steeper plane is a wall."""


def complete(spec: Any, origin: Origin) -> Any:
    """Adds the floor and the free base of an origin to a `mujoco.MjSpec`, and compiles it to a `mujoco.MjModel`.

    Raises:
        ModelError: The model has a floor or a free base already, or no root link.
        ValueError: MuJoCo's compiler cannot read the model.
    """
    base = _freed(spec) if origin.free_base else None
    if origin.floor is None:
        return spec.compile()
    mujoco = import_module("mujoco")
    if any(geom.name == FLOOR for geom in spec.geoms):
        raise ModelError(f'floor is {origin.floor:g}, and the model has a geom "{FLOOR}" already: omit the argument floor')
    spec.worldbody.add_geom(name=FLOOR, type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], pos=[0, 0, origin.floor], rgba=_COLOUR)
    m = spec.compile()
    data = mujoco.MjData(m)
    mujoco.mj_forward(m, data)
    floor = m.geom(FLOOR).id
    _check_no_floor(mujoco, m, data, floor)
    if base is None:
        return m
    collides = (m.geom_contype != 0) | (m.geom_conaffinity != 0)
    above = [mujoco.mj_geomDistance(m, data, floor, k, np.inf, None) for k in np.flatnonzero(collides & (m.geom_bodyid != 0)) if k != floor]
    base.pos = [*base.pos[:2], base.pos[2] - min(above, default=0.0)]
    return spec.compile()


def _check_no_floor(mujoco: Any, m: Any, data: Any, added: int) -> None:
    """Raises a ModelError if a fixed plane other than the added one faces upward."""
    for k in np.flatnonzero(m.geom_type == mujoco.mjtGeom.mjGEOM_PLANE):
        if k != added and data.geom_xmat[k].reshape(3, 3)[2, 2] > _UPWARD:
            label = m.geom(k).name or f"#{k}"
            raise ModelError(
                f"floor is {m.geom_pos[added][2]:g}, and the plane {label} of the model faces upward already: omit the argument floor"
            )


def _freed(spec: Any) -> Any:
    """Root link of a URDF, to which the function adds a free joint."""
    roots = list(spec.worldbody.bodies)
    if len(roots) != 1:
        names = ", ".join(root.name for root in roots) or "none"
        raise ModelError(f"free_base is True, which needs one root link, and the links on the world are: {names}; omit free_base")
    (root,) = roots
    if list(root.joints):
        joint = root.joints[0].name
        raise ModelError(f'free_base is True, and the root link "{root.name}" moves on the joint "{joint}" already: omit free_base')
    root.add_freejoint(name=FREE_BASE)
    return root


Source: TypeAlias = "str | os.PathLike[str] | Any"

_MUJOCO = "4"
"""Major version of MuJoCo whose compiled models can be read."""

_SAVED = b"stepper\xff"
"""First bytes of every saved model (crates/model/src/file.rs)."""

_TEXT = "XML text"
"""Name of a source in messages that is a text."""

_INSTALL = 'pip install "stepper-sim[mjcf]"'


def load(
    source: Source,
    *,
    strict: bool = True,
    package_dirs: Sequence[str | os.PathLike[str]] | None = None,
    overlaps: Literal["keep", "exclude"] = "keep",
    actuators: Actuators | None = None,
    floor: bool | float = False,
    free_base: bool = False,
) -> Model:
    """Reads a model.

    Args:
        source: Path of an MJCF file (.xml), a URDF file (.urdf), a compiled MuJoCo model (.mjb), or a model that `Model.save` wrote; except
            for .mjb, the kind is detected from the contents. Alternatively MJCF or URDF text, a `mujoco.MjSpec`, of which `load` compiles
            a copy, or a compiled `mujoco.MjModel`.
        strict: Whether unsupported elements that would change the motion are an error. If False, they are left out, and `Model.omitted`
            and `Model.explain()` list them; `nu` counts only the remaining actuators. Saved models ignore `strict`.
        package_dirs: Folders to search for meshes of a URDF: package folders (of `package://package/...` or `model://package/...`), folders
            that contain packages, and base folders of relative paths. None searches for packages in all folders above the file. The folders
            of ROS_PACKAGE_PATH, AMENT_PREFIX_PATH, GAZEBO_MODEL_PATH and GZ_SIM_RESOURCE_PATH come last.
        overlaps: Treatment of geoms that overlap at the reference pose (`qpos0`). With "keep", contact pushes them apart. "exclude"
            disables contact between their two bodies permanently (`Model.exclude_overlaps`), except with the ground. A `ModelWarning`,
            `Model.excluded_overlaps` and `Model.explain()` list the pairs.
        actuators: Kind of actuators to add to the joints of a URDF: servos ("position", "velocity") or motors ("torque"). The control
            ranges are the position, velocity and effort limits of the file. For the inertia at the reference pose, a position servo
            has a natural frequency of 5 Hz with critical damping, and a velocity servo a bandwidth of 50 Hz. None adds none.
        floor: Whether to add a horizontal plane "floor", with the default friction of 1. True puts it at z = 0; a number is its
            height, m.
        free_base: Whether to give the root link of a URDF a free joint "free_base", as a mobile robot needs. With `floor`, the robot starts
            so high that its lowest geom touches the floor at the reference pose; otherwise at the origin. Position servos of hinges are
            stiff enough to carry a robot: they reach their effort limit at an error of at most 0.25 rad.

    Warns:
        ModelWarning: The source sets an integrator other than Euler, or solref or solimp other than MuJoCo's defaults, which the default
            options do not use (`Options.from_model(model)` does). A mesh collides as a convex hull with a much larger volume: at least 1.25
            times for fixed ground, and 10 times for a part of a robot. A sensor is not read, so that `sensordata` is shorter than MuJoCo's.
            `overlaps="exclude"` disabled contacts, or kept overlaps with the ground. Geoms overlap by more than 1 mm in a keyframe. One
            warning per call. Silence it with
            `warnings.filterwarnings("ignore", category=stepper.ModelWarning)`.

    Raises:
        ModelError: The model is invalid or damaged, uses unsupported elements, or lacks a mesh file. Or it has a floor or a free base
            already. The message has the element and a remedy.
        ValueError: An unknown value of `overlaps` or `actuators`, or a floor that is not finite. Actuators or a free base for a source
            that is not a URDF. A floor for a compiled or saved model.
        ImportError: MJCF or URDF without MuJoCo's compiler installed, or with one of another version; the message has the remedy.
        OSError: The file cannot be read.
    """
    _check_choices(overlaps, actuators, package_dirs, strict=strict)
    check_flag("free_base", free_base)
    height = _height(floor)
    saved = is_saved(source)
    urdf = None if saved else read_urdf(source)
    for name, value, missing in (("actuators", actuators, None), ("free_base", free_base, False)):
        if value is not missing and urdf is None:
            remedy = "define actuators" if name == "actuators" else "write <freejoint/> into the base"
            raise ValueError(f"{name} is {value!r}, which needs a URDF, and the source is not one: {remedy} in its file")
    if height is not None and (saved or is_binary(source)):
        raise ValueError(
            f"floor is {floor!r}, which needs MJCF, URDF or a mujoco.MjSpec, and the source is a compiled or saved model: "
            "add the floor before it is compiled or saved"
        )
    own: Any = source
    origin = Origin(own.copy() if is_spec(own) else own, package_dirs, height, free_base)
    try:
        model = Model.from_file(source) if saved else _read(origin, strict, urdf, actuators)
    except (ModelError, UnicodeError) as error:
        if not origin.absolute().is_file or str(source) in str(error):
            raise
        raise ModelError(f"{source}: {error}") from error
    if overlaps == "exclude":
        model = model.exclude_overlaps()
    warn_about(model, loaded=not saved, excluded=overlaps == "exclude", is_robot=urdf is not None)
    if not saved:
        remember(model, origin)
    return model


def _height(floor: bool | float) -> float | None:
    """Height of the floor for the argument `floor` of `load`, m; None for no floor."""
    if floor is False or floor is True:
        return 0.0 if floor else None
    if not isinstance(floor, numbers.Real):
        raise TypeError(f"floor is {floor!r}, must be True, False or a height in m")
    if not math.isfinite(floor):
        raise ValueError(f"floor is {floor!r}, must be finite: the height of the floor in m")
    return float(floor)


def _check_choices(overlaps: str, actuators: str | None, package_dirs: Any, *, strict: Any) -> None:
    """Raises TypeError or ValueError if an argument of `load` other than the source has another type or an unknown value."""
    if isinstance(package_dirs, str) or not isinstance(package_dirs, Sequence | None):
        raise TypeError(f"package_dirs is {package_dirs!r}, must be a list of folders, or None")
    for folder in package_dirs or ():
        path_of("an entry of package_dirs", folder)
    check_flag("strict", strict)
    if overlaps not in ("keep", "exclude"):
        raise ValueError(f'overlaps is {overlaps!r}, must be "keep" or "exclude"')
    if actuators not in (None, *KINDS):
        raise ValueError(f"actuators is {actuators!r}, must be None or one of {', '.join(map(repr, KINDS))}")


def _read(origin: Origin, strict: bool, urdf: Urdf | None, actuators: Actuators | None) -> Model:
    """Model of any source other than a model file of `Model.save`."""
    _mujoco()
    compiled = compile_source(origin)
    description = describe(compiled)
    if urdf is not None:
        description["omitted"] += omissions(urdf, actuators, free_base=origin.free_base)
        for joint in description["joints"]:
            joint["velocity_limit"] = urdf.speed_limit(joint["name"]) if joint["name"] in urdf.joints else None
    if urdf is not None and actuators is not None:
        add_actuators(actuators, urdf, compiled, description, free_base=origin.free_base)
    return Model.from_description(description, strict)


def read_urdf(source: Source) -> Urdf | None:
    """Parsed URDF of a source, for messages and actuators; None if the source is not a URDF."""
    if is_spec(source) or is_binary(source):
        return None
    if _is_text(source):
        text, place = str(source), _TEXT
    else:
        path = Path(source)
        text, place = path.read_text(encoding="utf-8", errors="replace"), str(path)
    if "<robot" not in text:
        return None
    urdf = Urdf(text, place)
    refuse_xacro(urdf)
    return urdf


def compile_source(origin: Origin) -> Any:
    """Compiles a source of `load` other than a saved model to a `mujoco.MjModel`, with its floor and free base."""
    source = origin.source
    if _is_compiled(source):
        return source
    if is_spec(source):
        return _compile(lambda spec: complete(spec.copy(), origin), source, "mujoco.MjSpec")
    text = str(source) if _is_text(source) else None
    place = _TEXT if text is not None else str(existing(Path(source), "model"))
    if is_binary(source):
        return _compile(_mujoco().MjModel.from_binary_path, place, place)
    if text is None:
        content = Path(source).read_text(encoding="utf-8", errors="replace")
        resolved = resolve_meshes(content, place, Path(source), origin.package_dirs) if "<robot" in content else content
        text = None if resolved == content else resolved
    elif "<robot" in text:
        text = resolve_meshes(text, place, None, origin.package_dirs)
    if origin.is_changed:
        kind = _mujoco().MjSpec
        read = kind.from_file if text is None else kind.from_string
        return _compile(lambda given: complete(read(given), origin), place if text is None else text, place)
    kind = _mujoco().MjModel
    return _compile(kind.from_xml_path, place, place) if text is None else _compile(kind.from_xml_string, text, place)


def _is_text(source: object) -> bool:
    """Whether a source is XML text and not a path."""
    return isinstance(source, str) and "<" in source


def is_saved(source: Source) -> bool:
    """Whether a source is the path of a model that `Model.save` wrote. An invalid source is an error."""
    if _is_compiled(source) or is_spec(source) or _is_text(source):
        return False
    if isinstance(source, Model):
        raise TypeError(
            "stepper.load takes a path, XML text, a mujoco.MjSpec or a mujoco.MjModel, not Model: it is loaded already, as "
            "stepper.Stepper(model)"
        )
    if not isinstance(source, (str, os.PathLike)):
        raise TypeError(f"stepper.load takes a path, XML text, a mujoco.MjSpec or a mujoco.MjModel, not {type(source).__name__}")
    path = Path(source)
    if os.path.isdir(path):
        raise IsADirectoryError(f"stepper.load takes the path of a file or XML text, and {str(source)!r} is a directory")
    with existing(path, "model").open("rb") as file:
        return file.read(len(_SAVED)) == _SAVED


def _is_compiled(source: object) -> bool:
    """Whether a source is a `mujoco.MjModel`."""
    return _is_of_mujoco(source, "MjModel")


def is_spec(source: object) -> bool:
    """Whether a source is a `mujoco.MjSpec`."""
    return _is_of_mujoco(source, "MjSpec")


def _is_of_mujoco(source: object, name: str) -> bool:
    """Whether a source is of the class of this name in the package mujoco; checked without an import of mujoco."""
    kind = type(source)
    return kind.__name__ == name and kind.__module__.split(".")[0] == "mujoco"


def is_binary(source: Source) -> bool:
    """Whether a source is compiled already: a `mujoco.MjModel`, or the path of a .mjb file."""
    return _is_compiled(source) or (not is_spec(source) and not _is_text(source) and Path(source).suffix == ".mjb")


def _mujoco() -> Any:
    """The module `mujoco`; an ImportError if it is missing or has another major version."""
    try:
        mujoco = import_module("mujoco")
    except ImportError as error:
        raise ImportError(
            f"MJCF and URDF are read by MuJoCo's compiler, which is not installed: {_INSTALL}. "
            "Models that were saved with model.save(path) load without it.",
            name="mujoco",
        ) from error
    version = str(getattr(mujoco, "__version__", "of an unknown version"))
    if version.partition(".")[0] != _MUJOCO:
        raise ImportError(
            f"MJCF, URDF and mujoco.MjModel are read by MuJoCo {_MUJOCO}, and MuJoCo {version} is installed here: "
            f"pip uninstall mujoco mujoco-core, then {_INSTALL}. "
            "Models that were saved with model.save(path) load with any version, or none.",
            name="mujoco",
        )
    return mujoco


def _compile(read: Callable[[Any], Any], source: Any, place: str) -> Any:
    """Calls a function that makes a `mujoco.MjModel` and returns the model; MuJoCo's errors become `ModelError`."""
    try:
        with _warnings_of_mujoco(place):
            return read(source)
    except ModelError as error:
        raise ModelError(f"{place}: {error}") from None
    except ValueError as error:
        message = " ".join(str(error).split())
        raise ModelError(f"{place}: MuJoCo's compiler cannot read it: {message}; correct it, or pass a saved model") from error


@contextlib.contextmanager
def _warnings_of_mujoco(place: str) -> Iterator[None]:
    """Context manager that issues warnings of MuJoCo's compiler as Python warnings. MuJoCo would write them to the file MUJOCO_LOG.TXT."""
    mujoco = _mujoco()
    messages: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(messages.append)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)
        for message in messages:
            warnings.warn(f"{place}: {message}", UserWarning, stacklevel=8)
