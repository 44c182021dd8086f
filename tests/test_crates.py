"""Crates can be published: packages with licences, a page and metadata, and no library that needs a newer Rust than they declare."""

import json
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
WORKSPACE = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]
PUBLISHED = ("real", "geometry", "model", "solve", "core", "derivative")
MANIFESTS = {crate: tomllib.loads((ROOT / "crates" / crate / "Cargo.toml").read_text()) for crate in PUBLISHED}

pytestmark = pytest.mark.skipif(shutil.which("cargo") is None, reason="cargo lists packages and their libraries")
COMPLETE = {"Precision", "Level", "StatePart", "Recomputed", "Solve", "ActuatorNumbers", "Numbers"}
"""Enums of the interface to which nothing will be added, so that a user may match them without a wildcard."""


def cargo(*arguments: str) -> str:
    return subprocess.run(["cargo", *arguments], cwd=ROOT, capture_output=True, text=True, check=True).stdout


@pytest.mark.parametrize("crate", PUBLISHED)
def test_a_package_has_its_licences_its_page_and_its_sources(crate):
    files = set(cargo("package", "--list", "--allow-dirty", "--offline", "-p", f"stepper-{crate}").split())
    assert {"LICENSE-APACHE", "LICENSE-MIT", "README.md", "Cargo.toml", "src/lib.rs"} <= files
    for name in ("LICENSE-APACHE", "LICENSE-MIT"):
        assert (ROOT / "crates" / crate / name).read_bytes() == (ROOT / name).read_bytes()
    sources = {str(file.relative_to(ROOT / "crates" / crate)) for file in (ROOT / "crates" / crate / "src").rglob("*.rs")}
    assert sources <= files


@pytest.mark.parametrize("crate", PUBLISHED)
def test_a_package_says_where_its_sources_and_documents_are(crate):
    package = MANIFESTS[crate]["package"]
    assert package["documentation"] == f"https://docs.rs/stepper-{crate}"
    assert package["repository"] == package["rust-version"] == {"workspace": True}
    assert WORKSPACE["repository"].startswith("https://")
    # Links that leave the crate would point nowhere on its page.
    assert "](../" not in (ROOT / "crates" / crate / "README.md").read_text()


@pytest.mark.parametrize("crate", PUBLISHED)
def test_the_documents_of_a_crate_have_what_its_features_add(crate):
    docs, features = MANIFESTS[crate]["package"]["metadata"]["docs"]["rs"], MANIFESTS[crate]["features"]
    assert docs.get("all-features") or set(docs["features"]) <= features.keys()
    assert docs.get("all-features") or "nalgebra" in docs["features"]


@pytest.mark.parametrize("crate", ["geometry", "solve", "core", "derivative"])
def test_cpu_levels_are_features_of_every_crate_that_has_kernels(crate):
    features = MANIFESTS[crate]["features"]
    for level in ("avx2", "avx512"):
        assert level in features["default"]
        assert f"stepper-real/{level}" in features[level]


def test_no_two_crates_have_the_same_description():
    descriptions = {manifest["package"]["description"] for manifest in MANIFESTS.values()}
    assert len(descriptions) == len(PUBLISHED)


def test_enums_that_may_grow_are_non_exhaustive():
    """A new variant would otherwise break programs that match one of these enums."""
    crates = [ROOT / "crates" / crate / "src" for crate in ("real", "model", "core", "derivative")]
    texts = [file.read_text() for crate in crates for file in crate.rglob("*.rs")]
    found = {name: attributes for text in texts for attributes, name in re.findall(r"((?:^#\[.*\]\n)*)^pub enum (\w+)", text, re.M)}
    # Enumerations that the macro `named!` declares.
    named = r"named! \{\n((?:    [/#].*\n)*)    pub enum (\w+) \{"
    found |= {name: attributes for text in texts for attributes, name in re.findall(named, text)}
    faces = ("core/src/lib.rs", "core/src/group_step/mod.rs", "derivative/src/lib.rs")
    face = "".join((ROOT / "crates" / name).read_text().partition("pub mod internals")[0] for name in faces)
    exported = re.findall(r"\w+", " ".join(re.findall(r"pub use ([^;]+);", face)))
    public = [name for name in exported if name in found]
    assert len(public) > 12
    assert set(public) >= COMPLETE
    assert [name for name in public if name not in COMPLETE and "#[non_exhaustive]" not in found[name]] == []


def test_a_method_without_a_result_that_takes_an_environment_lists_its_panic():
    """The front page allows a panic there alone. `public_face.rs` of the core calls each with an environment that does not exist."""
    files = [ROOT / "crates/core/src/batch/simulation.rs", *(ROOT / "crates/core/src/batch/simulation").glob("*.rs")]
    method = re.compile(r"((?:^    (?:///|#\[).*\n)*)^    pub fn (\w+)\(([^)]*)\)([^{]*)", re.M)
    methods = [found for file in files for found in method.findall(file.read_text()) if "env: usize" in found[2]]
    panicking = [name for documentation, name, _, returned in methods if "Result<" not in returned]
    assert len(panicking) > 15
    assert [name for documentation, name, _, _ in methods if ("# Panics" in documentation) != (name in panicking)] == []
    tested = (ROOT / "crates/core/tests/suite/public_face.rs").read_text()
    assert [name for _, name, _, _ in methods if not re.search(rf"sim\.{name}\((?:Field::\w+, )?3\b", tested)] == []


def test_no_library_needs_a_newer_rust_than_the_crates_declare():
    """Clippy's lint incompatible_msrv, part of `make check`, says the same of the standard library."""
    declared = version(WORKSPACE["rust-version"])
    packages = json.loads(cargo("metadata", "--format-version", "1", "--locked", "--filter-platform", "x86_64-unknown-linux-gnu"))[
        "packages"
    ]
    assert len(packages) > 100
    assert {p["name"]: p["rust_version"] for p in packages if version(p["rust_version"] or "1.0") > declared} == {}
    assert max(version(p["rust_version"] or "1.0") for p in packages if p["source"]) == declared, "a lower version would do"


def version(text: str) -> tuple[int, ...]:
    return tuple(int(part) for part in text.split(".")[:2])
