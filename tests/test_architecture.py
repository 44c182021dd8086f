"""The shape of the code: imports run one way, stages do not know one another, and ARCHITECTURE.md names only what exists."""

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
CORE = ROOT / "crates/core/src"
LAYERS = ["spatial", "model", "kinematics", "stages", "step", "batch"]


def dependencies(crate: str) -> set[str]:
    """Crates of this workspace that a crate uses, also in its tests and its build."""
    manifest = tomllib.loads((ROOT / "crates" / crate / "Cargo.toml").read_text())
    names = {name for table in ("dependencies", "dev-dependencies", "build-dependencies") for name in manifest.get(table, {})}
    return {name.removeprefix("stepper-") for name in names if name.startswith("stepper-")}


def code(file: Path) -> str:
    """Rust without its comments."""
    return re.sub(r"//.*", "", file.read_text())


def imports(file: Path) -> set[str]:
    """Modules of its own crate that a file names after `crate::`, also in lists."""
    text = code(file)
    found = set(re.findall(r"\bcrate::(\w+)", text))
    for group in re.findall(r"\bcrate::\{([^;]*)\}", text):
        found |= set(re.findall(r"(?:^|,)\s*(\w+)", group))
    return found


def files_of(module: str) -> list[Path]:
    return [f for f in [CORE / f"{module}.rs", *sorted((CORE / module).rglob("*.rs"))] if f.exists()]


@pytest.mark.parametrize(("crate", "allowed"), [
    ("real", set()), ("solve", {"real"}), ("core", {"real", "solve"}), ("python", {"core"}),
])  # fmt: skip
def test_crates_depend_one_way(crate, allowed):
    assert dependencies(crate) <= allowed


def test_every_crate_has_its_place():
    assert {path.parent.name for path in (ROOT / "crates").glob("*/Cargo.toml")} == {"real", "solve", "core", "python"}


def test_the_ten_stages_are_there_in_order():
    names = sorted(path.stem for path in (CORE / "stages").glob("s*.rs"))
    assert [name[:3] for name in names] == [f"s{k:02}" for k in range(1, 11)]


@pytest.mark.parametrize("stage", sorted((CORE / "stages").glob("s*.rs")), ids=lambda path: path.stem)
def test_no_stage_imports_another(stage):
    text = code(stage)
    assert "crate::stages" not in text
    assert not re.search(r"\bsuper::(?!\*)", text.split("#[cfg(test)]")[0])


@pytest.mark.parametrize("layer", LAYERS)
def test_layers_of_the_core_import_downwards(layer):
    files = files_of(layer)
    assert files, f"there is no {layer} in {CORE}"
    above = set(LAYERS[LAYERS.index(layer) + 1 :])
    for file in files:
        assert not imports(file) & above, f"{file.relative_to(ROOT)} imports {imports(file) & above}"


def test_solve_knows_no_bodies_and_the_bindings_no_numbers():
    """`solve` names neither bodies nor shapes nor Python; only the bindings know Python."""
    for file in (ROOT / "crates/solve/src").rglob("*.rs"):
        assert not re.search(r"\b(Body|Geom|Joint|pyo3|numpy)\b", code(file)), file
    for crate in ("real", "solve", "core"):
        for file in (ROOT / "crates" / crate / "src").rglob("*.rs"):
            assert not re.search(r"\b(pyo3|numpy)\b", code(file)), file


def test_architecture_names_only_what_exists():
    """Every path in back quotes: with a slash, or with the ending of a file."""
    named = re.findall(r"`([\w./-]+)`", (ROOT / "ARCHITECTURE.md").read_text())
    paths = [name for name in named if "/" in name or name.endswith((".rs", ".py", ".md", ".toml", ".pyi"))]
    assert len(paths) > 10
    missing = [path for path in paths if not any((base / path).exists() for base in (ROOT, ROOT / "crates", CORE, CORE / "stages"))]
    assert missing == []
