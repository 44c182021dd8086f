"""Base class of sensor and actuator models: parts of one kind by name or pattern, with conversion to and from files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any, ClassVar, Generic, Self, TypeVar

import numpy as np

from stepper.shared.tables import by_name, check_names, fitting, named_tables

T = TypeVar("T")


class NamedParts(Generic[T]):
    """Parts (transfer functions of sensors, or drives of actuators) by the name of the element or by pattern. Abstract."""

    named: dict[str, T]
    default: T | None
    _kind: ClassVar[type[Any]]
    """Class of the parts, a dataclass."""
    _element: ClassVar[str]
    """Kind of element with a part: "sensor" or "actuator"."""
    _part: ClassVar[str]
    """Word for a part in messages: "transfer" or "drive"."""
    _example: ClassVar[str]
    """Expression that makes a part, for messages."""

    def _set(self, parts: Mapping[str, T] | None, default: T | None) -> None:
        """Sets `named` and `default` after a check."""
        self.named = by_name(parts, default, self._kind, self._part, self._example)
        self.default = default

    @classmethod
    def _of(cls, parts: Mapping[str, T], default: T | None) -> Self:
        made = cls.__new__(cls)
        made._set(parts, default)
        return made

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], place: str = "") -> Self:
        """Returns a model from a dictionary in the format of `to_dict` and of files; error messages begin with `place`."""
        place = place or f"{cls._element}s"
        tables = named_tables(data, f"{cls._element}s", place)
        named = {name: cls._read_part(table, f"{place}: {cls._element} {name!r}") for name, table in tables.items()}
        return cls._of(named, cls._read_part(data["default"], f"{place}: default") if "default" in data else None)

    @classmethod
    def _read_part(cls, table: Any, place: str) -> T:
        """Part from a table of a file; error messages begin with `place`."""
        part: T = read_part(table, cls._kind, place)
        return part

    def to_dict(self) -> dict[str, Any]:
        """Returns a dictionary in the format of the files of `from_file`; arrays become lists."""
        out: dict[str, Any] = {f"{self._element}s": {name: _plain(part) for name, part in self.named.items()}}
        return out | ({"default": _plain(self.default)} if self.default else {})

    def chosen(self, index: np.ndarray[Any, Any]) -> Self:
        """Returns a copy of this model for some environments only: arrays of numbers per environment keep the entries of `index`.

        Args:
            index: Boolean mask (num_envs,), or indices (n,), which may repeat.
        """
        return self._changed(lambda x: x[index])

    def _changed(self, change: Callable[[np.ndarray[Any, Any]], np.ndarray[Any, Any]]) -> Self:
        """Copy of this model in which `change` was applied to every array with one number per environment."""
        return self._of({name: _changed(part, change) for name, part in self.named.items()}, _changed(self.default, change))

    def _rows(self, names: list[str], *arguments: Any) -> list[dict[str, Any] | None]:
        """Parts of the elements with these names, as dictionaries for the Rust library; None for ideal elements.

        The method `_row` of a part gets the arguments.
        """
        check_names(self.named, names, self._element)
        rows: list[dict[str, Any] | None] = []
        for name in names:
            part: Any = fitting(self.named, self.default, name)
            try:
                rows.append(None if part is None else part._row(*arguments))
            except ValueError as error:
                raise ValueError(f"{self._part} of {self._element} {name!r}: {error}") from None
        return rows

    def __eq__(self, other: object) -> bool:
        return isinstance(other, type(self)) and self.to_dict() == other.to_dict()

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.named!r}, default={self.default!r})"


def _plain(value: Any) -> Any:
    """Value of a part without arrays: a dataclass becomes a dictionary without None, and an array or pair a list."""
    if is_dataclass(value):
        given = {field.name: getattr(value, field.name) for field in fields(value)}
        return {name: _plain(own) for name, own in given.items() if own is not None}
    if isinstance(value, tuple):
        return [_plain(end) for end in value]
    return value if isinstance(value, str) else np.asarray(value).tolist()


def _changed(value: Any, change: Callable[[np.ndarray[Any, Any]], np.ndarray[Any, Any]]) -> Any:
    """Copy of a part in which `change` was applied to all arrays with one number per environment."""
    if is_dataclass(value) and not isinstance(value, type):
        return replace(value, **{field.name: _changed(getattr(value, field.name), change) for field in fields(value)})
    if isinstance(value, tuple):
        return tuple(_changed(end, change) for end in value)
    # A single number applies to all environments, as does a matrix, which mixes the axes of a sensor.
    shared = value is None or isinstance(value, str) or np.size(value) == 1 or np.ndim(value) == 2
    return value if shared else change(np.asarray(value, np.float64))


def read_part(
    table: Any, kind: type[Any], place: str, *, make: Callable[..., Any] | None = None, nested: Mapping[str, type[Any]] | None = None
) -> Any:
    """Part from a table of a TOML or JSON file.

    Args:
        table: The table, of attributes by name.
        kind: Class of the part, a dataclass.
        place: Beginning of error messages.
        make: Function that makes the part from attributes by name; None selects the class.
        nested: Classes of attributes that are tables, by name.
    """
    if not isinstance(table, dict):
        raise ValueError(f"{place} is {table!r}, must be a table of entries")
    given = dict(table)
    known = {field.name for field in fields(kind)}
    if unknown := set(given) - known:
        raise ValueError(f"{place}: unknown entries {sorted(unknown)}, must be one of: {', '.join(sorted(known))}")
    for name, own in (nested or {}).items():
        if name in given:
            given[name] = read_part(given[name], own, f"{place}: {name}")
    if isinstance(given.get("limits"), list):
        given["limits"] = tuple(given["limits"])
    try:
        return (make or kind)(**given)
    except (TypeError, ValueError) as error:
        raise type(error)(f"{place}: {error}") from None
