"""Models from files, text, or a compiled `mujoco.MjModel`."""

import contextlib
import os
import warnings
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, TypeAlias

from stepper._stepper import Model, ModelError
from stepper.loading.mjcf import describe
from stepper.loading.origins import remember
from stepper.loading.urdf import resolve_meshes

Source: TypeAlias = "str | os.PathLike[str] | Any"

_MUJOCO = "4"
"""Major version of MuJoCo whose models are understood."""

_SAVED = b"stepper\xff"
"""First bytes of every saved model (crates/core/src/model/file.rs)."""

_INSTALL = 'pip install "stepper-sim[mjcf]"'


class ModelWarning(UserWarning):
    """A source asks for something expressly, and by default something else runs. `Model.deviations` has it in words."""


def load(source: Source, *, strict: bool = True, package_dirs: Sequence[str | os.PathLike[str]] | None = None) -> Model:
    """Reads a model.

    Args:
        source: Path of an MJCF file (.xml), a URDF file (.urdf), a compiled model of MuJoCo (.mjb), or a model that `Model.save` wrote,
            told apart by their contents; or MJCF or URDF text; or a compiled `mujoco.MjModel`.
        strict: Whether elements that would change the motion and are not simulated yet are an error. If False they are left out:
            `Model.omitted` and `Model.explain()` list them, and actuators that are left out have no control, so `nu` is smaller. A saved
            model is what it was when it was saved, whatever `strict` says.
        package_dirs: Where meshes of a URDF are found: folders that have the package of `package://package/...`, or are it, and folders
            that relative names begin in besides the file's own. None looks for packages in all folders above the file.

    Warns:
        ModelWarning: The source asks expressly for what by default runs otherwise: another integrator than Euler's, solref or solimp of its
            own. Once for each call. `Options.from_model(model)` takes the source's integrator; contacts stay hard. Silence it with
            `warnings.filterwarnings("ignore", category=stepper.ModelWarning)`.

    Raises:
        ModelError: The model is not valid, is damaged, or uses elements that are not simulated; a mesh is not there. The message names
            them, and what to do.
        ImportError: MJCF or URDF without MuJoCo's compiler installed, or with one of another version; the message says how to install it.
        OSError: The file cannot be read.
    """
    if is_saved(source):
        return Model.from_file(source)
    model = _described(compile_source(source, package_dirs), strict)
    remember(model, source, package_dirs)
    return model


def compile_source(source: Source, package_dirs: Sequence[str | os.PathLike[str]] | None = None) -> Any:
    """The compiled `mujoco.MjModel` of a source that `load` takes, other than a saved model."""
    if _is_compiled(source):
        return source
    if _is_text(source):
        return _compile_text(str(source), package_dirs)
    return _compile_file(Path(source), package_dirs)


def _is_text(source: object) -> bool:
    return isinstance(source, str) and "<" in source


def is_saved(source: Source) -> bool:
    """Whether this is the path of a saved model; what is no source at all is an error."""
    if _is_compiled(source) or _is_text(source):
        return False
    if not isinstance(source, (str, os.PathLike)):
        raise TypeError(f"stepper.load takes a path, XML text or a mujoco.MjModel, not {type(source).__name__}")
    path = Path(source)
    if path.is_dir():
        raise IsADirectoryError(f"stepper.load takes the path of a file or XML text, and {str(source)!r} is a directory")
    with path.open("rb") as file:
        return file.read(len(_SAVED)) == _SAVED


def _described(compiled: Any, strict: bool) -> Model:
    _mujoco()
    model = Model.from_description(describe(compiled), strict)
    if model.deviations:
        name = f'"{model.name}"' if model.name else "this model"
        lines = "".join(f"\n  {line}" for line in model.deviations)
        silence = 'warnings.filterwarnings("ignore", category=stepper.ModelWarning) silences this'
        message = f"{name} asks for what does not run by default:{lines}\n(model.explain() has all of it; {silence})"
        warnings.warn(message, ModelWarning, stacklevel=3)
    return model


def _is_compiled(source: object) -> bool:
    """Whether this is a `mujoco.MjModel`, without importing mujoco."""
    kind = type(source)
    return kind.__name__ == "MjModel" and kind.__module__.split(".")[0] == "mujoco"


def _mujoco() -> Any:
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
            f"MJCF, URDF and mujoco.MjModel are read by MuJoCo {_MUJOCO}, and MuJoCo {version} is installed here: {_INSTALL}. "
            "Models that were saved with model.save(path) load with any version, or none.",
            name="mujoco",
        )
    return mujoco


def _compile_text(text: str, package_dirs: Sequence[str | os.PathLike[str]] | None) -> Any:
    place = "XML text"
    if "<robot" in text:
        text = resolve_meshes(text, place, None, package_dirs)
    return _compile(_mujoco().MjModel.from_xml_string, text, place)


def _compile_file(path: Path, package_dirs: Sequence[str | os.PathLike[str]] | None) -> Any:
    compiler, place = _mujoco().MjModel, str(path)
    if path.suffix == ".mjb":
        return _compile(compiler.from_binary_path, place, place)
    text = path.read_text(encoding="utf-8", errors="replace")
    resolved = resolve_meshes(text, place, path, package_dirs) if "<robot" in text else text
    if resolved == text:
        return _compile(compiler.from_xml_path, place, place)
    return _compile(compiler.from_xml_string, resolved, place)


def _compile(read: Any, source: str, place: str) -> Any:
    try:
        with _warnings_of_mujoco(place):
            return read(source)
    except ValueError as error:
        said = " ".join(str(error).split())
        raise ModelError(f"{place}: MuJoCo's compiler refuses it: {said}; correct it there, or give a saved stepper model") from error


@contextlib.contextmanager
def _warnings_of_mujoco(place: str) -> Iterator[None]:
    """Turns the compiler's warnings into Python's, which would else be written to MUJOCO_LOG.TXT in the working directory."""
    mujoco = _mujoco()
    said: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(said.append)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)
        for message in said:
            warnings.warn(f"{place}: {message}", UserWarning, stacklevel=7)
