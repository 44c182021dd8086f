"""Comparison of the version of a release in every file that has it: `python tests/helpers/release_version.py v0.1.0` before a release."""

import re
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]


def versions(root: Path = ROOT) -> dict[str, str]:
    """Version by place; empty if a place has none."""
    workspace = tomllib.loads((root / "Cargo.toml").read_text(encoding="utf-8"))["workspace"]
    crates = {name: table["version"] for name, table in workspace["dependencies"].items() if name.startswith("stepper-")}
    return {
        "Cargo.toml": workspace["package"]["version"],
        **{f"Cargo.toml, {name}": version for name, version in crates.items()},
        "CITATION.cff": _first(r"^version: (\S+)$", root / "CITATION.cff"),
        "CHANGELOG.md": _first(r"^## \[(\d\S*)\]", root / "CHANGELOG.md"),
    }


def faults(tag: str, root: Path = ROOT) -> list[str]:
    """What is wrong with a tag: versions that differ from it, and a changelog without a date."""
    wanted = tag.removeprefix("v")
    found = [f"{place} has version {version or 'none'}, the tag is {tag}" for place, version in versions(root).items() if version != wanted]
    dated = _first(rf"^## \[{re.escape(wanted)}\] - (\d{{4}}-\d\d-\d\d)$", root / "CHANGELOG.md")
    return found if dated else [*found, f"CHANGELOG.md has no line '## [{wanted}] - YYYY-MM-DD'"]


def _first(pattern: str, file: Path) -> str:
    found = re.search(pattern, file.read_text(encoding="utf-8"), re.MULTILINE)
    return found[1] if found else ""


if __name__ == "__main__":
    (given,) = sys.argv[1:]
    if wrong := faults(given):
        raise SystemExit("\n".join(wrong))
