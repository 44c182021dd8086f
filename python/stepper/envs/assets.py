"""Models of environments, and files of Gymnasium's MuJoCo environments."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast
from xml.etree import ElementTree

from stepper._stepper import Model
from stepper.loading import Origin, load, origin_of, remember

P = ParamSpec("P")
F = TypeVar("F", bound=Callable[..., Any])
_KEPT = 64
"""Values that `once_per_model` keeps of a function."""


def load_quietly(source: str | ElementTree.Element, *, strict: bool = True) -> Model:
    """Model of a file or an MJCF tree, without warnings about its settings, which the environment's `contact` overrides.

    Args:
        source: Path, or root of a tree.
        strict: Whether unsupported elements are errors, as in `stepper.load`.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return load(source if isinstance(source, str) else ElementTree.tostring(source, encoding="unicode"), strict=strict)


def without(tree: ElementTree.Element, is_unwanted: Callable[[ElementTree.Element], bool]) -> ElementTree.Element:
    """XML tree without some elements."""
    for parent in list(tree.iter()):
        for child in list(parent):
            if is_unwanted(child):
                parent.remove(child)
    return tree


def read_once(read: Callable[P, Model]) -> Callable[P, Model]:
    """Decorator that caches a function that loads a model, by its arguments, together with the source of the model.

    `stepper.load` keeps only the sources of the last models, and a cached model may be drawn much later.
    """

    def first(*args: P.args, **kwargs: P.kwargs) -> tuple[Model, Origin | None]:
        model = read(*args, **kwargs)
        return model, origin_of(model)

    known = cast("Callable[P, tuple[Model, Origin | None]]", functools.cache(first))

    @functools.wraps(read)
    def model_of(*args: P.args, **kwargs: P.kwargs) -> Model:
        model, origin = known(*args, **kwargs)
        if origin is not None:
            remember(model, origin.source, origin.package_dirs)
        return model

    return model_of


def once_per_model(function: F) -> F:
    """Decorator that caches a function of a model and further arguments.

    The key is the identity of the model, because hashing a model reads all its data in every call.
    """
    kept: dict[tuple[Any, ...], tuple[Any, Any]] = {}

    @functools.wraps(function)
    def once(model: Any, *args: Any) -> Any:
        key = (id(model), *args)
        if key not in kept:
            if len(kept) >= _KEPT:
                del kept[next(iter(kept))]
            kept[key] = (model, function(model, *args))  # The model itself, so that no other one gets its id.
        return kept[key][1]

    return cast("F", once)


def model_file(name: str) -> str:
    """Path of a model's file.

    Args:
        name: File of Gymnasium, such as "ant.xml", or a path that begins with "/", "." or "~".

    Raises:
        FileNotFoundError: There is no such file.
    """
    if Path(name).is_absolute() or name.startswith((".", "~")):
        file = Path(name).expanduser()
        remedy = "give the path of an MJCF file"
    else:
        spec = find_spec("gymnasium.envs.mujoco")
        folders = [] if spec is None else list(spec.submodule_search_locations or [])
        file = Path(folders[0] if folders else "gymnasium/envs/mujoco", "assets", name)
        remedy = 'pip install gymnasium, or give a path that begins with "/", "." or "~"'
    if not file.is_file():
        raise FileNotFoundError(f"there is no model file {file}: {remedy}")
    return str(file)
