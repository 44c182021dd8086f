"""Signatures of classes in the documentation."""

from __future__ import annotations

from typing import Any

import griffe


class Constructors(griffe.Extension):
    """Takes the arguments of a class from `__new__` if it has no `__init__`, as the classes of the stub."""

    def on_class_members(self, *, cls: griffe.Class, **_: Any) -> None:
        """Called by griffe when the members of a class are known."""
        if "__new__" in cls.members and "__init__" not in cls.members:
            new = cls.members["__new__"]
            if isinstance(new, griffe.Function):
                init = griffe.Function("__init__", lineno=new.lineno, parameters=new.parameters, returns=None, parent=cls)
                cls.members["__init__"] = init
