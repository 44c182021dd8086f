"""The licences of the libraries that are linked into the binary: `python tests/helpers/notices.py` writes NOTICES.

Cargo says which libraries those are, and where their sources lie. One that comes from elsewhere than crates.io, or that has no licence of
`ACCEPTED`, is an error. cargo-deny (`make check`) asks the same of what only builds them and of what only tests them.
"""

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
NOTICES = ROOT / "NOTICES"
DENY = tomllib.loads((ROOT / "deny.toml").read_text())
(TARGET,) = DENY["graph"]["targets"]
ACCEPTED = tuple(DENY["licenses"]["allow"])
"""The first of them that a library offers is the one it is used under: Apache's text is the same for all."""
HEAD = """\
stepper is built with the libraries that are listed here, each under the licence that stands above it. stepper's own licences are in
LICENSE-MIT and LICENSE-APACHE. `python tests/helpers/notices.py` writes this file.
"""


def linked() -> list[dict]:
    """Packages that are linked into the binary, by name: without what only builds it."""
    command = ["cargo", "metadata", "--format-version", "1", "--locked", "--filter-platform", TARGET]
    metadata = json.loads(subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout)
    packages = {package["id"]: package for package in metadata["packages"]}
    nodes = {node["id"]: node for node in metadata["resolve"]["nodes"]}
    found, open_ids = {}, [key for key, package in packages.items() if package["name"] == "stepper-python"]
    while open_ids:
        key = open_ids.pop()
        macro = any("proc-macro" in target["kind"] for target in packages[key]["targets"])
        if key in found or macro:
            continue
        found[key] = packages[key]
        open_ids += [d["pkg"] for d in nodes[key]["deps"] if any(kind["kind"] is None for kind in d["dep_kinds"])]
    foreign = [package for package in found.values() if package["source"] is not None]
    for package in foreign:
        if not package["source"].startswith("registry+"):
            raise ValueError(f"{package['name']} comes from {package['source']}: take a release of it from the registry")
    return sorted(foreign, key=lambda package: (package["name"], package["version"]))


def licence_of(package: dict) -> str:
    """The licence that a library is used under."""
    offered = re.split(r"\s+OR\s+|/", package["license"] or "")
    for licence in ACCEPTED:
        if licence in (word.strip("() ") for word in offered):
            return licence
    raise ValueError(f"{package['name']} offers {package['license']}, none of {', '.join(ACCEPTED)}: do without it, or accept it here")


def texts_of(package: dict, licence: str) -> str:
    """What a library wants to be said of it."""
    folder = Path(package["manifest_path"]).parent
    files = sorted(file for file in folder.iterdir() if file.is_file())
    notices = [file for file in files if file.name.upper().startswith("NOTICE")]
    own = [file for file in files if re.match("(LICEN[CS]E|COPYING)", file.name.upper())]
    if licence == "Apache-2.0":
        own = []
    elif len(own) > 1:
        own = [file for file in own if licence.split("-", maxsplit=1)[0].upper() in file.name.upper()]
    if licence != "Apache-2.0" and not own:
        raise ValueError(f"{package['name']} has no text of its licence {licence} in {folder}")
    return "\n\n".join(file.read_text(encoding="utf-8").strip() for file in [*own, *notices])


def notices() -> str:
    """The whole file."""
    apache, others = [], []
    for package in linked():
        licence = licence_of(package)
        texts, title = texts_of(package, licence), f"{package['name']} {package['version']}"
        if licence == "Apache-2.0":
            apache.append(title)
        if texts:
            others.append(f"{title} ({licence})\n\n{texts}\n")
    rule = "=" * 100 + "\n"
    shared = (ROOT / "LICENSE-APACHE").read_text().strip()
    names = "Rust's standard library, " + ", ".join(apache)
    wrapped = re.sub(r"(.{1,110})(?:\s|$)", r"\1\n", names)
    return HEAD + rule + rule.join(others) + rule + f"Apache-2.0:\n\n{wrapped}\n{shared}\n"


if __name__ == "__main__":
    os.chdir(ROOT)
    NOTICES.write_text(notices(), encoding="utf-8")
    print(f"{NOTICES.name}: {len(linked())} libraries", file=sys.stderr)
