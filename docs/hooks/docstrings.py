"""Docstrings and signatures in the documentation: extensions of griffe, which reads the sources (mkdocs.yml)."""

from __future__ import annotations

import re
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


class Selectors(griffe.Extension):
    """Keeps selectors in docstrings as they are."""

    def on_instance(self, *, obj: griffe.Object, **_: Any) -> None:
        """Called by griffe for every module, class, function and attribute."""
        if obj.docstring:
            obj.docstring.value = without_links(obj.docstring.value)
