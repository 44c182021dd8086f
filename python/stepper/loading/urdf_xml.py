"""Parsing of the XML of URDF files, including two violations of the XML standard that MuJoCo's parser accepts.

These are blank lines before the XML declaration, and prefixes without a declared namespace.
"""

from __future__ import annotations

import re
from xml.etree import ElementTree

_PREFIX = re.compile(r"[<\s/]([A-Za-z_][\w.-]*):[A-Za-z_]")
_DECLARED = re.compile(r"xmlns:([\w.-]+)\s*=")


def parse(text: str) -> ElementTree.Element | None:
    """Element `robot` of a URDF; None if the text is not well-formed.

    Blank lines before the XML declaration, and prefixes without a declared namespace (`drake:acceleration`), are accepted.
    """
    text = text.lstrip()
    unbound = {prefix for prefix in _PREFIX.findall(text) if not prefix.lower().startswith("xml")} - set(_DECLARED.findall(text))
    declarations = "".join(f' xmlns:{prefix}="{prefix}"' for prefix in sorted(unbound))
    try:
        return ElementTree.fromstring(re.sub(r"<robot\b", f"<robot{declarations}", text))
    except ElementTree.ParseError:
        return None


def prefixed(name: str) -> str:
    """Name of an element or attribute with its prefix, as in the file: "drake:acceleration" for "{drake}acceleration"."""
    namespace, _, local = name.rpartition("}")
    prefix = namespace.removeprefix("{")
    return f"{prefix}:{local}" if prefix and "/" not in prefix else local
