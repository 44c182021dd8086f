"""Models from files, text, or a compiled `mujoco.MjModel`."""

import contextlib
import os
import warnings
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, TypeAlias

from stepper._mjcf import describe
from stepper._stepper import Model, ModelError

Source: TypeAlias = "str | os.PathLike[str] | Any"

_SAVED = b"stepper\xff"
"""First bytes of every saved model (crates/core/src/model/file.rs)."""

_INSTALL = 'pip install "stepper[mjcf]"'


def load(source: Source, *, strict: bool = True) -> Model:
    """Reads a model.

    Args:
        source: Path of an MJCF file (.xml), a URDF file (.urdf), a compiled model of MuJoCo (.mjb), or a model that `Model.save` wrote,
            told apart by their contents; or MJCF or URDF text; or a compiled `mujoco.MjModel`.
        strict: Whether elements that would change the motion and are not simulated yet are an error. If False they are left out:
            `Model.omitted` and `Model.explain()` list them, and actuators that are left out have no control, so `nu` is smaller. A saved
            model is what it was when it was saved, whatever `strict` says.

    Raises:
        ModelError: The model is not valid, is damaged, or uses elements that are not simulated; the message names them, and what to do.
        ImportError: MJCF or URDF without MuJoCo's compiler installed; the message says how to install it.
        OSError: The file cannot be read.
    """
    if _is_compiled(source):
        return Model.from_description(describe(source), strict)
    if isinstance(source, str) and "<" in source:
        return Model.from_description(describe(_compile_text(source)), strict)
    if not isinstance(source, (str, os.PathLike)):
        raise TypeError(f"stepper.load takes a path, XML text or a mujoco.MjModel, not {type(source).__name__}")
    path = Path(source)
    if path.is_dir():
        raise IsADirectoryError(f"stepper.load takes the path of a file or XML text, and {str(source)!r} is a directory")
    with path.open("rb") as file:
        start = file.read(len(_SAVED))
    if start == _SAVED:
        return Model.from_file(path)
    return Model.from_description(describe(_compile_file(path)), strict)


def _is_compiled(source: object) -> bool:
    """Whether this is a `mujoco.MjModel`, without importing mujoco."""
    kind = type(source)
    return kind.__name__ == "MjModel" and kind.__module__.split(".")[0] == "mujoco"


def _mujoco() -> Any:
    try:
        return import_module("mujoco")
    except ImportError as error:
        raise ImportError(
            f"MJCF and URDF are read by MuJoCo's compiler, which is not installed: {_INSTALL}. "
            "Models that were saved with model.save(path) load without it.",
            name="mujoco",
        ) from error


def _compile_text(text: str) -> Any:
    return _compile(_mujoco().MjModel.from_xml_string, text, "XML text")


def _compile_file(path: Path) -> Any:
    compiler = _mujoco().MjModel
    read = compiler.from_binary_path if path.suffix == ".mjb" else compiler.from_xml_path
    return _compile(read, str(path), str(path))


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
            warnings.warn(f"{place}: {message}", UserWarning, stacklevel=6)
