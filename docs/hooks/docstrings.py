"""Docstrings and signatures in the documentation: extensions of griffe, which reads the sources (mkdocs.yml)."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import griffe

CODE_OR_SELECTOR = re.compile(r"(```.*?```|`[^`]*`|^ +(?:model|sim)\.[^\n]*$)|(\w\[[^\]\n]*\])\[", re.DOTALL | re.MULTILINE)
"""Code in fences, in backticks and in the indented examples of docstrings; or a selector up to its second bracket."""


def without_links(text: str) -> str:
    """Text in which Markdown takes no selector, geom_friction[floor,box][0], for a link."""
    return CODE_OR_SELECTOR.sub(lambda match: match[1] or match[2] + "\\[", text)


class Constructors(griffe.Extension):
    """Takes the arguments of a class from `__new__` if it has no `__init__`, as the classes of the stub."""

    def on_class_members(self, *, cls: griffe.Class, **_: Any) -> None:
        """Called by griffe when the members of a class are known."""
        if "__new__" in cls.members and "__init__" not in cls.members:
            new = cls.members["__new__"]
            if isinstance(new, griffe.Function):
                init = griffe.Function("__init__", lineno=new.lineno, parameters=new.parameters, returns=None, parent=cls)
                cls.members["__init__"] = init


class PrivateParameters(griffe.Extension):
    """Leaves private parameters out of the signatures of constructors; griffe's `dataclasses` must run before."""

    def on_package(self, *, pkg: griffe.Module, **_: Any) -> None:
        """Called by griffe when a package is loaded."""
        for owner in _classes(pkg):
            init = owner.members.get("__init__")
            if isinstance(init, griffe.Function):
                init.parameters = griffe.Parameters(*(own for own in init.parameters if not own.name.startswith("_")))


def _classes(owner: griffe.Object) -> Iterator[griffe.Class]:
    """Classes of a package, module or class, without imported ones."""
    for member in owner.members.values():
        if isinstance(member, griffe.Class):
            yield member
        if isinstance(member, griffe.Module | griffe.Class):
            yield from _classes(member)


class Selectors(griffe.Extension):
    """Keeps selectors in docstrings as they are."""

    def on_instance(self, *, obj: griffe.Object, **_: Any) -> None:
        """Called by griffe for every module, class, function and attribute."""
        if obj.docstring:
            obj.docstring.value = without_links(obj.docstring.value)
