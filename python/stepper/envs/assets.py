"""Loading of models for environments, with caches, and paths of the model files in Gymnasium."""

from __future__ import annotations

import functools
import os
import warnings
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast
from xml.etree import ElementTree

from stepper._stepper import Model
from stepper.loading import Origin, load, origin_of, remember
from stepper.shared.arguments import path_of

P = ParamSpec("P")
F = TypeVar("F", bound=Callable[..., Any])
_CACHE_SIZE = 64
"""Largest number of results that `cache_per_model` and `cache_model` keep per function."""


def load_quietly(source: Any) -> Model:
    """Loads a model without warnings about its solver settings, which the `contact` of the environment overrides.

    `source` is the root of an MJCF tree, or a source as for `stepper.load`.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return load(ElementTree.tostring(source, encoding="unicode") if isinstance(source, ElementTree.Element) else source)


def remove_elements(tree: ElementTree.Element, is_unwanted: Callable[[ElementTree.Element], bool]) -> ElementTree.Element:
    """Removes the elements of an XML tree for which `is_unwanted` is true, in place, and returns the tree."""
    for parent in list(tree.iter()):
        for child in list(parent):
            if is_unwanted(child):
                parent.remove(child)
    return tree


def cache_model(read: Callable[P, Model]) -> Callable[P, Model]:
    """Decorator that caches the results of a function that loads a model, by the function's arguments.

    It also stores the source of each model (path or MJCF text), which renderers need. `stepper.load` remembers the sources of the most
    recently loaded models only. Each call of the decorated function adds the source of its result to them again.
    """

    def first(*args: P.args, **kwargs: P.kwargs) -> tuple[Model, Origin | None]:
        model = read(*args, **kwargs)
        return model, origin_of(model)

    known = cast("Callable[P, tuple[Model, Origin | None]]", functools.lru_cache(_CACHE_SIZE)(first))

    @functools.wraps(read)
    def model_of(*args: P.args, **kwargs: P.kwargs) -> Model:
        model, origin = known(*args, **kwargs)
        if origin is not None:
            remember(model, origin)
        return model

    return model_of


def cache_per_model(function: F) -> F:
    """Decorator that caches the results of a function whose first argument is a model, for each model and further arguments.

    The key is the identity of the model (`id`), because hashing a model reads all its data in every call.
    """
    kept: dict[tuple[Any, ...], tuple[Any, Any]] = {}

    @functools.wraps(function)
    def once(model: Any, *args: Any) -> Any:
        key = (id(model), *args)
        if key not in kept:
            if len(kept) >= _CACHE_SIZE:
                del kept[next(iter(kept))]
            kept[key] = (model, function(model, *args))  # Keeps the model alive, so that no other model gets its id.
        return kept[key][1]

    return cast("F", once)


def model_file(name: str) -> str:
    """Path of the model file of an environment.

    Args:
        name: Name of a file in Gymnasium's assets, such as "ant.xml", or a path that begins with "/", "." or "~".
    """
    path_of("xml_file", name)
    name = os.fspath(name)
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
