"""`stepper.load`: reading of models from files, text, or a compiled `mujoco.MjModel`."""

import contextlib
import os
import warnings
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, TypeAlias

from stepper._hints import hint_keywords
from stepper._stepper import Model, ModelError
from stepper.loading.findings import warn_about
from stepper.loading.mjcf import describe
from stepper.loading.origins import remember
from stepper.loading.urdf import resolve_meshes
from stepper.loading.urdf_actuators import KINDS, Actuators, add_actuators
from stepper.loading.urdf_elements import Urdf, omissions, refuse_xacro
from stepper.shared.arguments import check_flag, path_of
from stepper.shared.files import existing

Source: TypeAlias = "str | os.PathLike[str] | Any"

_MUJOCO = "4"
"""Major version of MuJoCo whose compiled models can be read."""

_SAVED = b"stepper\xff"
"""First bytes of every saved model (crates/model/src/file.rs)."""

_INSTALL = 'pip install "stepper-sim[mjcf]"'


@hint_keywords("stepper.load")
def load(
    source: Source,
    *,
    strict: bool = True,
    package_dirs: Sequence[str | os.PathLike[str]] | None = None,
    overlaps: Literal["keep", "exclude"] = "keep",
    actuators: Actuators | None = None,
) -> Model:
    """Reads a model.

    Args:
        source: Path of an MJCF file (.xml), a URDF file (.urdf), a compiled MuJoCo model (.mjb), or a model that `Model.save` wrote; except
            for .mjb, the kind is detected from the contents. Alternatively MJCF or URDF text, or a compiled `mujoco.MjModel`.
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

    Warns:
        ModelWarning: The source sets an integrator other than Euler, or solref or solimp other than MuJoCo's defaults, which the default
            options do not use (`Options.from_model(model)` does). A mesh collides as a convex hull with a much larger volume: at least 1.25
            times for fixed ground, and 10 times for a part of a robot. A sensor is not read, so that `sensordata` is shorter than MuJoCo's.
            `overlaps="exclude"` disabled contacts, or kept overlaps with the ground. Geoms overlap by more than 1 mm in a keyframe. One
            warning per call. Silence it with
            `warnings.filterwarnings("ignore", category=stepper.ModelWarning)`.

    Raises:
        ModelError: The model is invalid or damaged, uses unsupported elements, or lacks a mesh file. The message has the element and a
            remedy.
        ValueError: An unknown value of `overlaps` or `actuators`; actuators for a source that is not a URDF.
        ImportError: MJCF or URDF without MuJoCo's compiler installed, or with one of another version; the message has the remedy.
        OSError: The file cannot be read.
    """
    _check_choices(overlaps, actuators, package_dirs, strict=strict)
    saved = is_saved(source)
    urdf = None if saved else read_urdf(source)
    if actuators is not None and urdf is None:
        raise ValueError(f"actuators is {actuators!r}, which needs a URDF, and the source is not one: define actuators in its file")
    model = Model.from_file(source) if saved else _read(source, strict, package_dirs, urdf, actuators)
    if overlaps == "exclude":
        model = model.exclude_overlaps()
    warn_about(model, loaded=not saved, excluded=overlaps == "exclude", is_robot=urdf is not None)
    if not saved:
        remember(model, source, package_dirs)
    return model


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


def _read(
    source: Source, strict: bool, package_dirs: Sequence[str | os.PathLike[str]] | None, urdf: Urdf | None, actuators: Actuators | None
) -> Model:
    """Model of any source other than a model file of `Model.save`.

    Args:
        source: Path, text or compiled `mujoco.MjModel`.
        strict: Whether elements that stepper does not support are errors.
        package_dirs: Folders to search for meshes of a URDF.
        urdf: The parsed source, if it is a URDF.
        actuators: Kind of actuator that the joints of a URDF get; None means no actuators.
    """
    _mujoco()
    compiled = compile_source(source, package_dirs)
    description = describe(compiled)
    if urdf is not None:
        description["omitted"] += omissions(urdf, actuators)
        for joint in description["joints"]:
            joint["velocity_limit"] = urdf.speed_limit(joint["name"]) if joint["name"] in urdf.joints else None
    if urdf is not None and actuators is not None:
        add_actuators(actuators, urdf, compiled, description)
    return Model.from_description(description, strict)


def read_urdf(source: Source) -> Urdf | None:
    """Parsed URDF of a source, for messages and actuators; None if the source is not a URDF."""
    if _is_compiled(source):
        return None
    if _is_text(source):
        text, place = str(source), "XML text"
    else:
        path = Path(source)
        if path.suffix == ".mjb":
            return None
        text, place = path.read_text(encoding="utf-8", errors="replace"), str(path)
    if "<robot" not in text:
        return None
    urdf = Urdf(text, place)
    refuse_xacro(urdf)
    return urdf


def compile_source(source: Source, package_dirs: Sequence[str | os.PathLike[str]] | None = None) -> Any:
    """Compiles a source of `load` other than a saved model to a `mujoco.MjModel`."""
    if _is_compiled(source):
        return source
    if _is_text(source):
        return _compile_text(str(source), package_dirs)
    return _compile_file(Path(source), package_dirs)


def _is_text(source: object) -> bool:
    """Whether a source is XML text and not a path."""
    return isinstance(source, str) and "<" in source


def is_saved(source: Source) -> bool:
    """Whether a source is the path of a model that `Model.save` wrote. An invalid source is an error."""
    if _is_compiled(source) or _is_text(source):
        return False
    if type(source).__name__ == "MjSpec":
        raise TypeError("stepper.load takes a path, XML text or a mujoco.MjModel, not MjSpec: stepper.load(spec.compile())")
    if isinstance(source, Model):
        raise TypeError(
            "stepper.load takes a path, XML text or a mujoco.MjModel, not Model: it is loaded already, as stepper.Stepper(model)"
        )
    if not isinstance(source, (str, os.PathLike)):
        raise TypeError(f"stepper.load takes a path, XML text or a mujoco.MjModel, not {type(source).__name__}")
    path = Path(source)
    if path.is_dir():
        raise IsADirectoryError(f"stepper.load takes the path of a file or XML text, and {str(source)!r} is a directory")
    with existing(path, "model").open("rb") as file:
        return file.read(len(_SAVED)) == _SAVED


def _is_compiled(source: object) -> bool:
    """Whether a source is a `mujoco.MjModel`; checked without importing mujoco."""
    kind = type(source)
    return kind.__name__ == "MjModel" and kind.__module__.split(".")[0] == "mujoco"


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


def _compile_text(text: str, package_dirs: Sequence[str | os.PathLike[str]] | None) -> Any:
    """Compiles MJCF or URDF text to a `mujoco.MjModel`."""
    place = "XML text"
    if "<robot" in text:
        text = resolve_meshes(text, place, None, package_dirs)
    return _compile(_mujoco().MjModel.from_xml_string, text, place)


def _compile_file(path: Path, package_dirs: Sequence[str | os.PathLike[str]] | None) -> Any:
    """Compiles an MJCF, URDF or .mjb file to a `mujoco.MjModel`."""
    compiler, place = _mujoco().MjModel, str(existing(path, "model"))
    if path.suffix == ".mjb":
        return _compile(compiler.from_binary_path, place, place)
    text = path.read_text(encoding="utf-8", errors="replace")
    resolved = resolve_meshes(text, place, path, package_dirs) if "<robot" in text else text
    if resolved == text:
        return _compile(compiler.from_xml_path, place, place)
    return _compile(compiler.from_xml_string, resolved, place)


def _compile(read: Any, source: str, place: str) -> Any:
    """Calls a constructor of `mujoco.MjModel` and returns the model; MuJoCo's errors become `ModelError`.

    Args:
        read: The constructor, such as `mujoco.MjModel.from_xml_string`.
        source: Its argument, a path or text.
        place: Name of the source in messages.
    """
    try:
        with _warnings_of_mujoco(place):
            return read(source)
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
            warnings.warn(f"{place}: {message}", UserWarning, stacklevel=9)
