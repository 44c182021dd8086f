"""Selectors: texts that name numbers of a field, as `field`, `field[names]` or `field[names][columns]`.

    geom_friction                        all numbers of a field
    geom_friction[floor,box][0]          sliding friction of two geoms
    geom_friction[*_foot][0]             names by pattern
    dof_damping[root][2]                 third degree of freedom of a joint
    body_mass[3]                         element by its index, a row of the field
    gravity[2]                           number of a field of the whole model, by its column
    geom_friction['a,b'][0]              quotes around a name with , [ ] ' or ", or a name that consists of digits

The shape of the selected numbers follows NumPy's indexing. A single name or index that selects one row gives no axis for elements.
Several names, a pattern, or a joint with several degrees of freedom give one. A single column gives no axis for columns, and several
columns give one. In fields with one number for each degree of freedom, columns count within a joint; a single joint then gives no axis for
elements.
"""

from __future__ import annotations

import ast
import fnmatch
import functools
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepper._arrays import array_of
from stepper._hints import unknown, unknown_field
from stepper._stepper import Model, Stepper, selected
from stepper.shared.draws import Draw, present_rng
from stepper.shared.fields import COMPOUNDS, FIELDS, RANDOMIZED

Array = NDArray[np.float64]
Item = str | int
"""Element of a model in a selector: a name, a pattern with * or ?, or an index."""

_ITEM = r"""\s*(?:'(?:[^'\\]|\\.)*'|"(?:[^"\\]|\\.)*"|[^\[\],'"]+)\s*"""
_LIST = rf"\[({_ITEM}(?:,{_ITEM})*)\]\s*"
_TEXT = re.compile(rf"\s*([A-Za-z_][\w.]*)\s*(?:{_LIST})?(?:{_LIST})?", re.DOTALL)
_SHOWN = 30
"""Largest number of elements that an error message about a pattern lists."""
_JOINT_ROWS = {"dof": ("dofadr", "nv"), "coordinate": ("qposadr", "nq")}
"""Attributes of a joint for its first row and its number of rows, by kind of row: degrees of freedom or coordinates."""


@dataclass(frozen=True)
class Selector:
    """Selector of numbers in a field.

    Attributes:
        field: Name of the field.
        elements: Names, patterns and indices of elements; None selects all elements.
        columns: Column indices of each element's row; for a field of the whole model, indices of its numbers. None selects all columns.
    """

    field: str
    elements: tuple[Item, ...] | None = None
    columns: tuple[int, ...] | None = None

    def __post_init__(self) -> None:
        for name in ("elements", "columns"):
            if getattr(self, name) == ():
                raise ValueError(f"{name} of a selector of {self.field!r} is empty: give at least one, or None for all")
        if self.columns is not None and self.elements is None and not _global(self.field):
            object.__setattr__(self, "elements", ("*",))

    def __str__(self) -> str:
        parts = (self.elements and ",".join(map(_quoted, self.elements)), self.columns and ",".join(map(str, self.columns)))
        return self.field + "".join(f"[{part}]" for part in parts if part)


def _global(field: str) -> bool:
    """Whether a field, such as "gravity", belongs to the whole model and not to elements of the model."""
    return field in FIELDS and not FIELDS[field].element


def _quoted(item: Item) -> str:
    """Name, pattern or index as text for a selector, in quotes where `parse` needs them."""
    if isinstance(item, int):
        return str(item)
    plain = item and item == item.strip() and item.isprintable() and not re.search(r"""[\[\],'"\\]|^-?[0-9]+$""", item)
    return item if plain else repr(item)


def parse(text: str, where: str = "selector") -> Selector:
    """Parses a selector.

    Args:
        text: `field`, `field[names]` or `field[names][columns]`.
        where: Name of the argument with the text, for error messages.

    Raises:
        TypeError: `text` is not a str.
        ValueError: The text is not a selector.
    """
    found, rest = parse_start(text, where)
    if rest:
        raise _spelling(where, text)
    return found


def parse_start(text: str, where: str = "selector") -> tuple[Selector, str]:
    """Selector at the beginning of a text such as "geom_friction[floor][0]=0.1..2", and the rest of the text: "" or "=..."."""
    if not isinstance(text, str):
        raise TypeError(f"{where} is {text!r}, must be a str, as 'geom_friction[floor,box][0]'")
    return _parsed(text, where)


def parse_range(text: str, where: str = "selector") -> tuple[Selector, tuple[float, float] | None]:
    """Selector and its range (low, high) from a text such as "geom_friction[floor][0]=0.1..2"; the range is None if the text has none."""
    selector, rest = parse_start(text, where)
    if not rest:
        return selector, None
    try:
        low, high = (float(end) for end in rest.removeprefix("=").split(".."))
    except ValueError:
        raise ValueError(f"{where} has {text!r}: the range is '{rest[1:]}', must be two numbers, as '0.1..2'") from None
    return selector, (low, high)


@functools.lru_cache(maxsize=1024)
def _parsed(text: str, where: str) -> tuple[Selector, str]:
    """Selector at the start of a text, and the rest of the text. Results are cached; `where` is the argument's name for messages."""
    found = _TEXT.match(text)
    if found is None or text[found.end() : found.end() + 1] not in ("", "="):
        raise _spelling(where, text)
    field, first, second = found.groups()
    elements, columns = (None if part is None else _items(part, text, where) for part in (first, second))
    if _global(field) and elements is not None:
        if columns is not None:
            raise ValueError(f"{where} has {text!r}: {field} belongs to the whole model; write its columns alone, as '{field}[{second}]'")
        elements, columns = None, elements
    if columns is not None and not all(isinstance(column, int) for column in columns):
        raise ValueError(f"{where} has {text!r}: columns are {list(columns)}, must be numbers, as '{field}[{'*][' if elements else ''}0]'")
    return Selector(field, elements, columns), text[found.end() :]  # type: ignore[arg-type]


def _items(part: str, text: str, where: str) -> tuple[Item, ...]:
    """Names, patterns and indices between two brackets of a selector."""
    items: list[Item] = []
    for item in (found.strip() for found in re.findall(_ITEM, part, re.DOTALL)):
        if re.fullmatch("-?[0-9]+", item):
            items.append(int(item))
        elif item[:1] in ("'", '"'):
            try:
                items.append(ast.literal_eval(item))
            except (SyntaxError, ValueError):
                raise _spelling(where, text) from None
        else:
            items.append(item)
    if not all(item != "" for item in items):
        raise ValueError(f"{where} has {text!r}: a name is empty; write the index of an element without a name")
    return tuple(items)


def _spelling(where: str, text: str) -> ValueError:
    """Error for a text that is not a selector; `where` is the argument's name."""
    return ValueError(
        f"{where} has {text!r}, which is no selector: write field[names][columns], as 'geom_friction[floor,box][0]'; "
        "names with , [ ] or quotes are quoted"
    )


@dataclass(frozen=True)
class Part:
    """Numbers in one field of a model that a selector selects.

    Attributes:
        field: Name of the field.
        index: Indices into the flattened field, as an array of the shape of the selector's values.
        sign: Factor, 1 or -1, from a value of the selector to a number of the field.
    """

    field: str
    index: NDArray[np.int64]
    sign: float = 1.0


def parts_of(model: Model, selector: Selector, where: str = "selector") -> list[Part]:
    """Numbers that a selector selects, as one `Part` per field. A compound parameter (`COMPOUNDS`) can have numbers in several fields."""
    if (compound := COMPOUNDS.get(selector.field)) is None:
        return [Part(selector.field, places(model, selector, where))]
    if selector.columns is not None:
        raise ValueError(f"{where} has '{selector}': {selector.field} is one number of each {compound.element}; leave out the columns")
    return [
        Part(field, places(model, Selector(field, selector.elements, (column,)), where), sign) for field, column, sign in compound.parts
    ]


def numbers_of(model: Model, selector: Selector, where: str = "selector") -> frozenset[tuple[str, int]]:
    """Set with the field and flat index of each number that a selector selects. Selectors of the same numbers give equal sets.

    Raises:
        ValueError: An unknown field, element or column.
    """
    return frozenset((part.field, int(place)) for part in parts_of(model, selector, where) for place in part.index.flat)


def places(model: Model, selector: Selector, where: str = "selector") -> NDArray[np.int64]:
    """Indices in the flattened field of the numbers that a selector selects, with the axes (elements, columns).

    For single names, indices and columns, axes are absent as described at the head of this module.
    """
    field, columns = selector.field, selector.columns
    if field not in FIELDS:
        raise ValueError(unknown_field(where, field, [*FIELDS, *COMPOUNDS], "docs/reference/what_can_vary.md"))
    shape = np.shape(getattr(model, field))
    index = np.arange(int(np.prod(shape)), dtype=np.int64).reshape(shape)
    if _global(field):
        return index if columns is None else _columns(index, columns, selector, where)
    if selector.elements is None:
        return index
    kind = FIELDS[field].element
    chosen = [_chosen(model, kind, item, f"{where} has '{selector}'") for item in selector.elements]
    one = len(chosen) == 1 and chosen[0][1]
    if kind in _JOINT_ROWS and index.ndim == 1 and columns is not None:
        return _of_joints(model, kind, [k for rows, _ in chosen for k in rows], selector, where, one=one)
    rows = _flat(own for own, _ in chosen)
    found = index[rows[0]] if one and len(rows) == 1 else index[rows]
    if columns is None:
        return np.asarray(found)
    if index.ndim == 1:
        raise ValueError(f"{where} has '{selector}': {field} has one number of each {kind}; leave out the columns")
    return _columns(found, columns, selector, where)


def _columns(index: NDArray[np.int64], columns: Sequence[int], selector: Selector, where: str, element: str = "") -> NDArray[np.int64]:
    """Selected columns of an array of indices, (..., columns). If there is a single column, the last axis is absent."""
    width = index.shape[-1] if index.ndim else 0
    if wrong := [column for column in columns if not -width <= column < width]:
        there = f"columns are 0 to {width - 1}" if width else "it is a single number; leave out the columns"
        raise ValueError(f"{where} has '{selector}'{element}: there is no column {wrong[0]}; {there}")
    if len({column % width for column in columns}) < len(columns):
        raise ValueError(f"{where} has '{selector}', which names a column twice: name it once")
    found: NDArray[np.int64] = np.asarray(index[..., columns[0]] if len(columns) == 1 else index[..., list(columns)])
    return found


def _of_joints(model: Model, kind: str, rows: Sequence[int | range], selector: Selector, where: str, *, one: bool) -> NDArray[np.int64]:
    """Indices of the degrees of freedom or coordinates that a selector with columns selects, such as "dof_damping[root][2]".

    Args:
        model: The model.
        kind: "dof" or "coordinate".
        rows: Range of the degrees of freedom (or coordinates) of each selected joint. A single index instead of a range is an error.
        selector: Selector, whose columns count from the first degree of freedom (or coordinate) of each joint.
        where: Name of the argument with the selector, for error messages.
        one: Whether the selector selects a single joint by name, so that the result has no axis for joints.
    """
    if any(isinstance(own, int) for own in rows):
        raise ValueError(f"{where} has '{selector}': an index is one row of {selector.field}; leave out the columns, or name a joint")
    columns = selector.columns or ()
    found = []
    for own in dict.fromkeys(rows):
        name = f", joint {_name_of(model, kind, own).partition(' (')[0]!r}"
        found.append(_columns(np.array(own), columns, selector, where, name))
    return found[0] if one else np.stack(found)


def rows_of(model: Model, kind: str, items: Sequence[Item] | None, where: str = "selector") -> list[int]:
    """Indices of elements of a kind ("geom", "joint", "dof") by names, patterns and indices; None selects all elements.

    Raises:
        ValueError: An item matches no element.
    """
    return _flat(_chosen(model, kind, item, where)[0] for item in (("*",) if items is None else items))


def _flat(chosen: Iterable[Iterable[int | range]]) -> list[int]:
    """List of row indices from nested indices and ranges, in their order and without duplicates."""
    return list(dict.fromkeys(int(k) for rows in chosen for part in rows for k in np.atleast_1d(part)))


def _chosen(model: Model, kind: str, item: Item, where: str) -> tuple[list[Any], bool]:
    """Elements that a name, pattern or index in a selector selects, and whether the selection is without a pattern.

    Returns:
        Two values. The first is a list of the elements' indices; a name or pattern of "dof" or "coordinate" gives a range of indices per
        joint. The second is True for an index or an exact name, and False for a pattern.
    """
    labels = _labels(model, kind)
    if isinstance(item, int):
        count = len(labels) if kind not in _JOINT_ROWS else int({"dof": model.nv, "coordinate": model.nq}[kind])
        if not -count <= item < count:
            raise ValueError(f"{where}: there is no {kind} {item}; the model has {count}")
        return [item % count], True
    exact = [k for k, own in enumerate(labels) if item in own]
    pattern = item.replace("[", "[[]")
    wild = any(character in item for character in "*?")
    found = exact or [k for k, own in enumerate(labels) if wild and any(fnmatch.fnmatchcase(label, pattern) for label in own)]
    if not found:
        what = "joint" if kind in _JOINT_ROWS else kind
        if wild:
            known = ", ".join(own[0] or str(k) for k, own in enumerate(labels[:_SHOWN])) or "none"
            raise ValueError(f"{where}: no {what} fits {item!r}, there are: {known}{' ...' if len(labels) > _SHOWN else ''}")
        if re.fullmatch("#[0-9]+", item):
            raise ValueError(f"{where}: no {what} {item!r}; write the index {item[1:]} alone")
        raise ValueError(f"{where}: {unknown(what, item, [own[0] for own in labels])}")
    if kind not in _JOINT_ROWS:
        return found, bool(exact)
    first, count_of = _JOINT_ROWS[kind]
    joints = [model.joint(k) for k in found]
    return [range(getattr(j, first), getattr(j, first) + getattr(j, count_of)) for j in joints], bool(exact)


def matches(model: Model, selector: Selector) -> str:
    """End of an error message with the elements that the patterns of a selector select; "" for a selector without a pattern.

    A joint with several rows of the field has their number after its name, as "floating_base_joint (6 rows)".
    """
    field = COMPOUNDS[selector.field] if selector.field in COMPOUNDS else FIELDS[selector.field]
    text = ""
    for item in selector.elements or ():
        if isinstance(item, str) and any(character in item for character in "*?"):
            chosen, exact = _chosen(model, field.element, item, "")
            if not exact:
                names = [_name_of(model, field.element, rows) for rows in chosen[:_SHOWN]]
                more = f" and {len(chosen) - _SHOWN} more" if len(chosen) > _SHOWN else ""
                text += f"; {item!r} selects {', '.join(names)}{more}"
    return text


def _name_of(model: Model, kind: str, rows: int | range) -> str:
    """Name of an element for an error message, with the number of its rows if there are several; without a name, its index."""
    if isinstance(rows, int):
        return _labels(model, kind)[rows][0] or str(rows)
    joints = (model.joint(k) for k in range(model.njnt))
    joint = next(joint for joint in joints if getattr(joint, _JOINT_ROWS[kind][0]) == rows.start)
    return (joint.name or f"joint {joint.id}") + (f" ({len(rows)} rows)" if len(rows) > 1 else "")


def _labels(model: Model, kind: str) -> list[list[str]]:
    """Texts by which a selector can name each element of a kind. For "dof" and "coordinate", the elements are the joints.

    The first text is the name of the element, or "" if the element has no name. Further texts are "body/geom" for geoms, and "geom/geom"
    for contact pairs.
    """
    names = list(getattr(model, f"{'joint' if kind in _JOINT_ROWS else kind}_names"))
    if kind == "geom":
        return [[name, f"{model.body(model.geom(k).bodyid).name}/{name}"] for k, name in enumerate(names)]
    if kind == "pair":
        pairs = [model.pair(k) for k in range(model.npair)]
        ends = [[model.geom(g).name or str(g) for g in (pair.geom1, pair.geom2)] for pair in pairs]
        return [[name, f"{one}/{other}", f"{other}/{one}"] for name, (one, other) in zip(names, ends, strict=True)]
    return [[name] for name in names]


def randomized_fields(sim: Stepper, values: Mapping[str, ArrayLike | None], envs: Any, fields: Mapping[str, Any] | None) -> dict[str, Any]:
    """Complete arrays for `Stepper.randomize`, from values by selector and from fields given as arrays.

    Args:
        sim: The stepper.
        values: Values by selector; None restores the model's value.
        envs: Boolean mask (num_envs,) or indices (n,); None selects all environments.
        fields: Complete arrays by name of the field. The result contains them unchanged.

    Returns:
        Arrays by name of the field, with rows for all environments, or for the indices in `envs`. Numbers that no selector names keep
        their current values.

    Raises:
        ValueError: A selector is unknown, a shape is wrong, or a number is given twice.
    """
    model, n = sim.model, sim.num_envs or 1
    by_index = envs is not None and np.asarray(envs).dtype != np.bool_
    rows = np.array(selected(envs, n), dtype=np.int64) if by_index else np.arange(n)
    lead = (len(rows),) if by_index or sim.num_envs is not None else ()
    present = sim.randomized

    def base(field: str) -> Array:
        """Current values of a field in the selected environments, (environments, numbers), or (numbers,) without environments."""
        own = np.asarray(getattr(model, field), np.float64)
        now = np.asarray(present.get(field, np.broadcast_to(own, (n, *own.shape))), np.float64).reshape(n, own.size)
        return now[rows].reshape(*lead, own.size)

    def draw(text: str, value: Draw, part: Part, own: Array) -> Array:
        """Random values of the selected numbers, (*lead, ...)."""
        reference = np.asarray(getattr(model, part.field), np.float64).reshape(-1)[part.index]
        current = np.ascontiguousarray(own[..., part.index].reshape(len(rows), -1))
        numbers = value.numbers(present_rng(text, value.seed, rows, current), part.index.shape)
        return (part.sign * value.values(numbers, part.sign * reference)).reshape(*lead, *part.index.shape)

    return _whole("Stepper.randomize", model, values, base, lead=lead, known=RANDOMIZED, fields=fields or {}, draw=draw)


def replaced_fields(model: Model, values: Any, fields: Mapping[str, Any] | None) -> dict[str, Any]:
    """Complete arrays for `Model.replace`, from values by selector and from fields given as arrays.

    Returns:
        Arrays by name of the field. Numbers that no selector names keep the model's values.

    Raises:
        TypeError: `values` is not a mapping.
        ValueError: A selector is unknown, a shape is wrong, or a number is given twice.
    """
    if not isinstance(values, Mapping):
        raise TypeError(f"Model.replace: values is {values!r}, must be a dict of selectors, as {{'geom_friction[floor][0]': 0.5}}")

    def base(field: str) -> Array:
        """Values of a field of the model, flattened."""
        return np.array(getattr(model, field), np.float64).reshape(-1)

    return _whole("Model.replace", model, values, base, lead=(), known=FIELDS, fields=fields or {})


def _whole(
    where: str,
    model: Model,
    values: Mapping[str, Any],
    base: Callable[[str], Array],
    *,
    lead: tuple[int, ...],
    known: Collection[str],
    fields: Mapping[str, Any],
    draw: Callable[[str, Draw, Part, Array], Array] | None = None,
) -> dict[str, Any]:
    """Complete arrays of fields, with the numbers that selectors set, for `Stepper.randomize` or `Model.replace`.

    Args:
        where: Name of the call, for error messages.
        model: The model.
        values: Values by selector.
        base: Function from the name of a field to its current numbers, (*lead, numbers).
        lead: Leading shape of the arrays: (environments,), or () without environments.
        known: Names of the fields that the call takes.
        fields: Fields that the caller gave as complete arrays.
        draw: Function that returns random values, (*lead, ...), of the numbers of a selector. It takes the selector, its `Draw`, the part
            of the selector, and the current numbers of the field. None means that the call takes no random values.
    """
    made: dict[str, Array] = {}
    # Position among `values` of the selector that gave each number, by field; -1 is none.
    taken: dict[str, NDArray[np.int64]] = {}
    for place, (text, value) in enumerate(values.items()):
        selector = parse(text, where)
        if selector.field not in known and selector.field not in COMPOUNDS:
            raise ValueError(unknown_field(where, selector.field, [*known, *COMPOUNDS], "docs/reference/what_can_vary.md"))
        for part in parts_of(model, selector, where):
            if part.field not in made:
                made[part.field] = base(part.field)
                taken[part.field] = np.full(made[part.field].shape[-1], -1)
            own, used = made[part.field], taken[part.field]
            other = int(np.max(used[part.index], initial=-1))
            if part.field in fields or other >= 0:
                raise conflict(where, text, f"{part.field}=" if part.field in fields else list(values)[other], part.field)
            used[part.index] = place
            if value is None:
                own[..., part.index] = np.asarray(getattr(model, part.field), np.float64).reshape(-1)[part.index]
            elif isinstance(value, Draw):
                if draw is None:
                    raise TypeError(f"{where}: {text!r} is random, must be numbers; sim.randomize takes random values")
                own[..., part.index] = draw(text, value, part, own)
            else:
                matched = functools.partial(matches, model, selector)
                own[..., part.index] = part.sign * _numbers(f"{where}: {text!r}", value, lead, part.index.shape, matched)
    return {**fields, **{field: own.reshape(*lead, *np.shape(getattr(model, field))) for field, own in made.items()}}


def conflict(where: str, one: object, other: object, field: str, differ: str = "") -> ValueError:
    """Error for two selectors or names that set the same number of a field.

    Args:
        where: Name of the call or the argument that has both.
        one: First selector or name.
        other: Second selector or name.
        field: Name of the field.
        differ: Values that the two set, such as "to 1 and to 2", for the message; "" leaves them out.
    """
    numbers = f"number of {field} {differ}" if differ else f"number of {field}"
    return ValueError(
        f"{where} has {str(one)!r} and {str(other)!r}, which set the same {numbers}: give one of them, or select other elements"
    )


def _numbers(what: str, value: ArrayLike, lead: tuple[int, ...], tail: tuple[int, ...], matched: Callable[[], str]) -> Array:
    """Values for a selector as an array (*lead, *tail), from a number, such an array, or an array (*lead,).

    The error message names the values `what`, and ends with `matched()`: the elements that patterns select.
    """
    given = array_of(what, value)
    if given.shape == lead and tail:
        given = given.reshape(*lead, *(1 for _ in tail))
    elif given.shape not in ((), (*lead, *tail)):
        shapes = dict.fromkeys(str(shape) for shape in ((*lead, *tail), lead) if shape)
        # A row of numbers for all environments is not allowed. If it had as many numbers as there are environments, it would mean one
        # number per environment.
        remedy = f"; np.broadcast_to(value, {(*lead, *tail)}) gives all environments the same" if given.shape == tail and lead else ""
        raise ValueError(f"{what} has shape {given.shape}, must be {' or '.join([*shapes, 'a single number'])}{remedy}{matched()}")
    return np.broadcast_to(given, (*lead, *tail))
