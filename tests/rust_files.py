"""Which files of a Rust crate use which, read from their text: an item counts for the file that defines it."""

import re
from pathlib import Path


def modules_of(src: Path) -> dict[tuple[str, ...], Path]:
    """Files of a crate by the path of their module; `lib.rs` has the empty one."""
    found = {}
    for file in sorted(src.rglob("*.rs")):
        parts = file.relative_to(src).with_suffix("").parts
        found[() if parts == ("lib",) else parts[:-1] if parts[-1] == "mod" else parts] = file
    return found


def _expand(tree: str) -> list[str]:
    """The single paths of a `use`."""
    tree = tree.strip()
    group = re.match(r"^((?:\w+::)*)\{(.*)\}$", tree, re.DOTALL)
    if not group:
        return [re.sub(r"\s+as\s+\w+$", "", tree)]
    parts, depth, start, inner = [], 0, 0, group[2] + ","
    for i, c in enumerate(inner):
        depth += (c == "{") - (c == "}")
        if c == "," and not depth:
            parts.append(inner[start:i])
            start = i + 1
    return [group[1] + path for part in parts if part.strip() for path in _expand(part)]


def graph_of(src: Path) -> dict[str, set[str]]:
    """Files that each file uses. What a file only declares or re-exports (`mod`, `pub use` in `lib.rs`) does not count, nor do its tests, nor what
    a macro says in other crates (`$crate`)."""
    modules = modules_of(src)
    graph = {}
    for path, file in modules.items():
        text = re.sub(r"//.*", "", file.read_text()).split("#[cfg(test)]")[0]
        text = re.sub(r"\$crate(::\w+)*", "", text)
        if not path:
            text = re.sub(r"\bpub use [^;]+;", "", text)
        paths = [p for tree in re.findall(r"\buse\s+([^;]+);", text) for p in _expand(tree)]
        paths += re.findall(r"\b(?:crate|super|self)(?:::\w+)+", re.sub(r"\buse\s+[^;]+;", "", text))
        used = set()
        for words in (p.split("::") for p in paths):
            at = () if words[0] == "crate" else path
            if words[0] not in {"crate", "self", "super"}:
                if (*path, words[0]) not in modules:
                    continue
                words.insert(0, "self")
            while words[0] == "super":
                at, words = at[:-1], words[1:]
            for word in words[words[0] in {"crate", "self"} :]:
                if (*at, word) not in modules:
                    break
                at = (*at, word)
            used.add("::".join(at) or "lib")
        graph["::".join(path) or "lib"] = used - {"::".join(path) or "lib"}
    return graph
