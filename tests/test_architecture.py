"""The shape of the code: imports run one way, stages do not know one another, and ARCHITECTURE.md names only what exists."""

import re
import tomllib
from pathlib import Path

import pytest
import rust_modules
from imports import circle, graph_of, sources_of, trespasses

ROOT = Path(__file__).parents[1]
CORE = ROOT / "crates/core/src"
CRATES = ("real", "geometry", "model", "solve", "core", "derivative", "python")
BODIES = {"math", "model", "compile", "dynamics"}
STEP_PARTS = BODIES | {"options", "probe", "collision", "actuation", "constraints", "sensing"}
CORE_FOLDERS = {
    **{"math": set(), "model": set(), "tuning": set(), "probe": set()},
    "error": {"math", "model"},
    "options": {"math", "error", "model"},
    "compile": {"math", "model"},
    "dynamics": {"math", "model", "compile"},
    "collision": BODIES,
    "actuation": BODIES,
    "constraints": {"math", "options", "tuning", "compile", "dynamics", "collision"},
    "sensing": BODIES | {"collision", "actuation"},
    "stages": STEP_PARTS | {"tuning"},
    "integrators": STEP_PARTS | {"tuning", "stages"},
    "step": {"options", "probe", "compile", "constraints", "stages", "integrators"},
    "group_step": STEP_PARTS - {"actuation", "sensing"} | {"stages", "integrators", "step"},
    "analysis": STEP_PARTS - {"constraints"} | {"error", "stages", "integrators"},
    "batch": STEP_PARTS | {"error", "stages", "integrators", "step", "group_step", "analysis"},
}
"""Folders and single files of the core, and the others that each may use."""
PACKAGE = ROOT / "python/stepper"
BINARY = frozenset({"stepper._stepper"})
FOLDERS = {
    "shared": set(),
    "sensors": {"shared", "loading"},
    "actuators": {"shared"},
    "loading": {"shared"},
    "recording": {"shared", "sensors", "actuators", "loading"},
    "sysid": {"shared", "actuators", "recording"},
    "lab": {"shared", "loading", "sensors", "actuators", "policies", "sysid"},
    "viewer": {"shared", "loading", "recording"},
    "envs": {"sensors", "actuators", "shared", "loading", "viewer"},
    "derivatives": {"shared"},
    "adapters": {"shared", "envs", "derivatives"},
    "policies": {"shared", "envs"},
    "doctor": {"shared"},
    "cli": {"shared", "doctor", "loading", "recording", "lab", "viewer", "envs", "policies", "sysid"},
}
"""Folders of the Python package, and the others that each may import."""
BOTTOM = {"_stepper", "_arrays", "_options", "_status", "_hints", "_quantities"}
"""Modules beside the folders that everything may import: the binary, its arguments, settings, messages and quantities."""
FACE = {"__main__", "elements"}
"""Modules beside the folders that are for users alone: nothing in a folder imports them, or the names of `stepper` itself."""
CRATE = {
    "": "mod a;\nmod c;\npub use a::One;",
    "a": "mod b;\npub use b::Two;\npub struct One;\nuse crate::c::Three;",
    "a::b": "pub struct Two;",
    "c": "pub struct Three;",
}
LAYERED = {
    "p": "from p.high import top",
    "p.low": "",
    "p.low.a": "import os",
    "p.low.b": "from p.low.a import x",
    "p.high": "from p.high.c import top",
    "p.high.c": "from p.low import b",
}
DECLARED = {"low": set(), "high": {"low"}}


def dependencies(crate: str) -> set[str]:
    """Other crates of this workspace that a crate uses, also in its tests and its build."""
    manifest = tomllib.loads((ROOT / "crates" / crate / "Cargo.toml").read_text())
    names = {name for table in ("dependencies", "dev-dependencies", "build-dependencies") for name in manifest.get(table, {})}
    return {name.removeprefix("stepper-") for name in names if name.startswith("stepper-")} - {crate}


def code(file: Path) -> str:
    """Rust without its comments."""
    return re.sub(r"//.*", "", file.read_text())


@pytest.mark.parametrize(("crate", "allowed"), [
    ("real", set()), ("geometry", {"real"}), ("model", {"geometry"}), ("solve", {"real"}), ("core", {"real", "geometry", "model", "solve"}),
    ("derivative", {"real", "solve", "core"}), ("python", {"core", "derivative"}),
])  # fmt: skip
def test_crates_depend_one_way(crate, allowed):
    assert dependencies(crate) <= allowed


def test_the_bindings_use_what_every_user_sees():
    manifest = tomllib.loads((ROOT / "crates/python/Cargo.toml").read_text())
    for crate in ("stepper-core", "stepper-derivative"):
        assert manifest["dependencies"][crate] == {"workspace": True, "features": ["default"]}
    for file in (ROOT / "crates/python/src").rglob("*.rs"):
        assert "internals" not in code(file), file


def test_every_crate_has_its_place():
    assert {path.parent.name for path in (ROOT / "crates").glob("*/Cargo.toml")} == set(CRATES)


def test_the_ten_stages_are_there_in_order():
    names = sorted(path.stem for path in (CORE / "stages").glob("s*.rs"))
    assert [name[:3] for name in names] == [f"s{k:02}" for k in range(1, 11)]


@pytest.mark.parametrize("stage", sorted((CORE / "stages").glob("s*.rs")), ids=lambda path: path.stem)
def test_no_stage_imports_another(stage):
    text = code(stage)
    assert "crate::stages" not in text
    assert not re.search(r"\bsuper::(?!\*)", text.split("#[cfg(test)]")[0])


def test_solve_and_geometry_know_no_bodies_and_the_bindings_no_numbers():
    """`solve` and `geometry` name neither bodies nor geoms nor Python; only the bindings know Python."""
    for crate in ("solve", "geometry"):
        for file in (ROOT / "crates" / crate / "src").rglob("*.rs"):
            assert not re.search(r"\b(Body|Geom|Joint|pyo3|numpy)\b", code(file)), file
    for crate in CRATES[:-1]:
        for file in (ROOT / "crates" / crate / "src").rglob("*.rs"):
            assert not re.search(r"\b(pyo3|numpy)\b", code(file)), file


@pytest.mark.parametrize("crate", CRATES)
def test_no_rust_files_use_one_another_in_a_circle(crate):
    graph = rust_modules.graph_of(rust_modules.sources_of(ROOT / "crates" / crate / "src"))
    assert sum(map(len, graph.values())) > 5
    assert circle(graph) == []


@pytest.mark.parametrize("crate", CRATES)
def test_every_rust_file_is_declared(crate):
    assert rust_modules.undeclared(rust_modules.sources_of(ROOT / "crates" / crate / "src")) == []


def test_folders_of_the_core_use_one_another_one_way():
    assert circle(CORE_FOLDERS) == []
    graph = rust_modules.graph_of(rust_modules.sources_of(CORE))
    assert ({name.partition("::")[0] for name in graph} - {""}) == set(CORE_FOLDERS)
    found = {}
    for module, used in graph.items():
        place = module.partition("::")[0]
        if place:
            found.setdefault(place, set()).update(u.partition("::")[0] for u in used if u and u.partition("::")[0] != place)
    assert {place: used - CORE_FOLDERS[place] for place, used in found.items() if used - CORE_FOLDERS[place]} == {}


def test_a_name_that_is_handed_on_is_of_the_file_that_defines_it():
    graph = rust_modules.graph_of(CRATE | {"c": "use crate::{One, a::Two};\n#[cfg(test)]\nmod tests { use crate::a; }"})
    assert graph["c"] == {"a", "a::b"}
    assert rust_modules.graph_of(CRATE)["a"] == {"c"}


@pytest.mark.parametrize(("planted", "found"), [
    ({"c": "use crate::a::{Two as Other, One};"}, {"a", "c"}),
    ({"c": "fn f() { crate::a::one() }"}, {"a", "c"}),
    ({"c": "use super::a;"}, {"a", "c"}),
    ({"c": "use crate::One;"}, {"a", "c"}),
    ({"a::b": "pub struct Two;\nuse super::One;", "a": "mod b;\npub struct One;\nfn f() { b::two() }"}, {"a", "a::b"}),
])  # fmt: skip
def test_a_planted_circle_of_rust_files_is_found(planted, found):
    assert set(circle(rust_modules.graph_of(CRATE | planted))) == found


def test_every_python_module_is_in_a_declared_folder():
    inside = [path for path in PACKAGE.iterdir() if path.is_dir() and path.name != "__pycache__"]
    assert {path.name for path in inside} == set(FOLDERS)
    assert all(
        (path / "__init__.py").exists()
        for folder in inside
        for path in [folder, *folder.rglob("*")]
        if path.is_dir() and "__" not in path.name
    )
    assert {path.stem for path in PACKAGE.glob("*.py")} | {"_stepper"} == {"__init__"} | BOTTOM | FACE


def test_python_folders_import_one_way():
    assert circle(FOLDERS) == []
    assert trespasses(graph_of(sources_of(PACKAGE), BINARY), FOLDERS, BOTTOM, FACE) == []


def test_no_python_modules_import_in_a_circle():
    graph = graph_of(sources_of(PACKAGE), BINARY)
    assert len(graph) > 40
    assert circle(graph) == []


def test_the_bindings_name_python_modules_that_there_are():
    """They call back at run time, when the package is there."""
    named = {name for file in (ROOT / "crates/python/src").rglob("*.rs") for name in re.findall(r'import\("(stepper[\w.]*)"\)', code(file))}
    assert "stepper" in named
    assert named <= sources_of(PACKAGE).keys()


def test_layers_without_a_circle_pass():
    assert circle(graph_of(LAYERED)) == []
    assert trespasses(graph_of(LAYERED), DECLARED, set(), set()) == []
    assert graph_of(LAYERED)["p.high.c"] == {"p.low", "p.low.b"}


@pytest.mark.parametrize(("planted", "found"), [
    ({"p.low.a": "from p.low.b import y"}, {"p.low.a", "p.low.b"}),
    ({"p.low.a": "def f():\n    from p.high import c"}, {"p.high", "p.high.c", "p.low.a", "p.low.b"}),
    ({"p.low.a": "if True:\n    import p.high.c"}, {"p.high", "p.high.c", "p.low.a", "p.low.b"}),
    ({"p.low.a": "from p import top"}, {"p", "p.high", "p.high.c", "p.low.a", "p.low.b"}),
    ({"p.low": "from p.low.b import x", "p.low.a": "from p.low import x"}, {"p.low", "p.low.b", "p.low.a"}),
    ({"p.low.a": "import p.low.a"}, {"p.low.a"}),
])  # fmt: skip
def test_a_planted_circle_is_found(planted, found):
    """Within a folder, in a function, through a package's own names, of a module with itself."""
    around = circle(graph_of(LAYERED | planted))
    assert around[0] == around[-1]
    assert set(around) <= found
    upwards = [line for line in trespasses(graph_of(LAYERED | planted), DECLARED, set(), set()) if line.startswith("p.low")]
    assert bool(upwards) == any("low" not in name for name in found)


@pytest.mark.parametrize("test", ["TYPE_CHECKING", "typing.TYPE_CHECKING"])
def test_imports_for_type_checkers_are_no_circle(test):
    text = f"if {test}:\n    from p.high import c\nelse:\n    from p.low import b"
    assert graph_of(LAYERED | {"p.low.a": text})["p.low.a"] == {"p.low.b"}


def test_a_module_in_no_declared_folder_and_an_import_upwards_are_named():
    planted = {
        "p.low.a": "from p.high import c",
        "p.high.c": "import p.face",
        "p.new.d": "",
        "p._bottom": "import p.low.a",
        "p.face": "import p.high.c",
    }
    assert trespasses(graph_of(LAYERED | planted), DECLARED, {"_bottom"}, {"face"}) == [
        "p.low.a imports p.high",
        "p.low.a imports p.high.c",
        "p.high.c imports p.face",
        "p.new.d is in no declared folder",
        "p._bottom imports p.low",
        "p._bottom imports p.low.a",
    ]


def test_comments_of_rust_fit_in_140_columns():
    """Rustfmt breaks code there and leaves comments alone. A row of a table and a line of a drawing cannot be broken."""
    files = [file for folder in ("crates", "benches") for file in (ROOT / folder).rglob("*.rs") if "target" not in file.parts]
    assert len(files) > 200
    long = re.compile(r"\s*//[/!]? (?![|`]|control -> )\S")
    found = [
        f"{file.relative_to(ROOT)}:{k}"
        for file in files
        for k, line in enumerate(file.read_text().splitlines(), 1)
        if len(line) > 140 and long.match(line)
    ]
    assert found == []


def test_architecture_names_only_what_exists():
    """Every path in back quotes: with a slash, or with the ending of a file."""
    named = re.findall(r"`([\w./-]+)`", (ROOT / "ARCHITECTURE.md").read_text())
    paths = [name for name in named if "/" in name or name.endswith((".rs", ".py", ".md", ".toml", ".pyi"))]
    assert len(paths) > 10
    missing = [path for path in paths if not any((base / path).exists() for base in (ROOT, ROOT / "crates", CORE, CORE / "stages"))]
    assert missing == []
