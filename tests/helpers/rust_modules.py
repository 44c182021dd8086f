"""Which files of a Rust crate use which, read from their text.

A file that declares others and hands on their names (`pub use`) is their face: a name that is reached through it counts as that of the file
that defines it. Tests within a file do not count.
"""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path

Module = str
"""Path of a module in its crate, `a::b`; the crate's root is empty."""

ITEM = r"^pub(?:\([\w: ]+\))? (?:unsafe |const |async )*(?:struct|enum|trait|fn|const|static|type|union) (\w+)"


def sources_of(src: Path) -> dict[Module, str]:
    """The text of every module below a crate's `src`, by its path."""
    found = {}
    for file in sorted(src.rglob("*.rs")):
        parts = list(file.relative_to(src).with_suffix("").parts)
        if parts[-1] in ("mod", "lib"):
            parts.pop()
        found["::".join(parts)] = file.read_text()
    return found


def undeclared(sources: Mapping[Module, str]) -> list[Module]:
    """Files that no `mod` declares: no compiler reads them."""
    parents = ((module, *module.rpartition("::")[::2]) for module in sources if module)
    return [
        module for module, parent, name in parents if not re.search(rf"^\s*(?:pub(?:\([\w: ]+\))? )?mod {name};", sources[parent], re.M)
    ]


def _code(text: str) -> str:
    """Without comments, texts, tests, and what a macro says in other crates (`$crate`)."""
    text = re.sub(r"//.*", "", text)
    text = re.sub(r'"(?:\\.|[^"\\])*"', '""', text)
    text = re.sub(r"\$crate(?:::\w+)*", "", text)
    return text.partition("#[cfg(test)]\n")[0]


def _paths(tree: str) -> Iterator[str]:
    """The single paths of what follows `use`, `crate::{a, b::{c, d as e}}` being three."""
    tree = tree.strip()
    group = re.fullmatch(r"((?:\w+::)*)\{(.*)\}", tree, re.S)
    if not group:
        yield re.sub(r"\s+as\s+\w+$", "", tree)
        return
    depth, part = 0, ""
    for character in group[2] + ",":
        depth += {"{": 1, "}": -1}.get(character, 0)
        if character == "," and not depth:
            if part.strip():
                yield from (group[1] + path for path in _paths(part))
            part = ""
        else:
            part += character


class Crate:
    """The modules of a crate, and which name comes from which of them."""

    def __init__(self, sources: Mapping[Module, str]) -> None:
        self.code = {module: _code(text) for module, text in sources.items()}
        self._handed_on: dict[Module, dict[str, Module]] = {}

    def children(self, module: Module) -> set[str]:
        """Names of the modules that a module has."""
        start = f"{module}::" if module else ""
        return {m.removeprefix(start) for m in self.code if m and m.startswith(start) and "::" not in m.removeprefix(start)}

    def items(self, module: Module) -> dict[str, Module]:
        """The module that defines each name which a module has or hands on."""
        if module in self._handed_on:
            return self._handed_on[module]
        text = self.code[module]
        own = dict.fromkeys(re.findall(ITEM, text, re.M), module)
        self._handed_on[module] = own
        for tree in re.findall(r"\bpub(?:\([\w: ]+\))? use ([^;]+);", text):
            for path in _paths(tree):
                *_, last = path.split("::")
                if last == "*":
                    target = self.target(module, path.removesuffix("::*"))
                    if target is not None:
                        own |= {name: home for name, home in self.items(target).items() if name not in own}
                elif (target := self.target(module, path)) is not None:
                    own.setdefault(last, target)
        return own

    def target(self, module: Module, path: str) -> Module | None:
        """The module that a path which a module names leads to; none where it leads out of the crate."""
        first, *rest = path.split("::")
        if first == "crate":
            here: list[str] = []
        elif first == "self":
            here = module.split("::") if module else []
        elif first == "super":
            here = module.split("::")[:-1]
        elif first in self.children(module):
            here, rest = (module.split("::") if module else []), [first, *rest]
        else:
            return None
        while rest and rest[0] == "super":
            here, rest = here[:-1], rest[1:]
        for name in rest:
            inner = "::".join([*here, name])
            if inner not in self.code:
                return self.items("::".join(here)).get(name, "::".join(here))
            here.append(name)
        return "::".join(here)

    def uses(self, module: Module) -> set[Module]:
        """The other modules that the code of a module names. What it hands on does not count."""
        text = re.sub(r"\bpub(?:\([\w: ]+\))? use [^;]+;", "", self.code[module])
        paths = [path for tree in re.findall(r"\buse ([^;]+);", text) for path in _paths(tree)]
        body = re.sub(r"\buse [^;]+;", "", text)
        paths += re.findall(r"(?<![\w:])(?:crate|self|super)(?:::\w+)+", body)
        for child in self.children(module):
            paths += re.findall(rf"(?<![\w:]){child}(?:::\w+)+", body)
        targets = {self.target(module, path.removesuffix("::*")) for path in paths}
        return {target for target in targets if target is not None} - {module}


def graph_of(sources: Mapping[Module, str]) -> dict[Module, set[Module]]:
    """What every module uses."""
    crate = Crate(sources)
    return {module: crate.uses(module) for module in crate.code}
