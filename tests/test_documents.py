"""What documents say exists is there, what they show runs, and their figures are those of the result files."""

import importlib
import importlib.util
import inspect
import re
import sys
import tomllib
from collections import Counter
from pathlib import Path

import gymnasium
import mujoco
import numpy as np
import page_blocks
import page_checks
import pytest
import stepper
import stepper.envs
import typer
from atlas import scenes
from checks import raises
from generated import SECTIONS
from sections import section_of, write_section
from stepper.cli.app import application
from stepper.derivatives import Linearization
from stepper.envs import Observation, StepperVectorEnv, Task

ROOT = Path(__file__).parents[1]
DOCUMENTS = sorted(
    [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "benches").rglob("*.md"), *(ROOT / "examples").rglob("*.md")]
)
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
WITH_CODE = [page for page in PAGES if any(block.language in ("python", "sh") for block in page_blocks.blocks(page.read_text()))]
REPOSITORY = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["urls"]["Repository"]
BENCHMARKS = Path(__file__).parents[1] / "docs/benchmarks"


def named(path):
    return str(path.relative_to(ROOT))


def figures():
    """The module that computes figures of the documentation."""
    spec = importlib.util.spec_from_file_location("figures", ROOT / "docs/hooks/figures.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("document", DOCUMENTS, ids=named)
def test_links_and_paths_lead_somewhere(document):
    text = document.read_text()
    links = re.findall(r"\]\((?!https?://|#)([^)#]+)", text)
    # Paths of this repository that are named without a link; those that a command writes stand behind a ">" or in "out/".
    paths = re.findall(r"(?<![\w/.>])((?:benches|crates|docs|examples|python|tests)/[\w./-]*\w)", text)
    missing = [link for link in links if not (document.parent / link).exists()]
    missing += [path for path in paths if not (ROOT / path).exists()]
    assert missing == []


def anchors(document):
    """Anchors of the headings of a document, as GitHub and MkDocs make them of plain titles."""
    text = re.sub(r"```.*?```", "", document.read_text(), flags=re.DOTALL)
    titles = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", title)).strip().lower().replace(" ", "-") for title in titles}


@pytest.mark.parametrize("document", DOCUMENTS, ids=named)
def test_anchors_of_links_exist(document):
    links = re.findall(r"\]\((?!https?://)([^)#\s]*)#([^)\s]+)\)", document.read_text())
    targets = {(document.parent / path if path else document, anchor) for path, anchor in links}
    missing = [f"{path}#{anchor}" for path, anchor in targets if path.suffix == ".md" and anchor not in anchors(path)]
    assert missing == []


@pytest.mark.parametrize("page", WITH_CODE, ids=named)
@pytest.mark.filterwarnings("ignore::stepper.ModelWarning", "ignore::UserWarning")
def test_code_blocks_run(page, tmp_path, monkeypatch):
    """All code blocks of a page run exactly as shown (page_blocks.py), and leave what the page says (page_checks.py)."""
    page_blocks.prepare(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend("")
    before, known = set(sys.modules), set(gymnasium.registry)
    try:
        names = page_blocks.run(page, tmp_path)
        page_checks.CHECKS.get(str(page.relative_to(ROOT)), page_checks.nothing)(names)
    finally:
        for name in set(sys.modules) - before:
            if (tmp_path / f"{name}.py").exists():
                del sys.modules[name]
        for name in set(gymnasium.registry) - known:
            if not name.startswith("stepper/"):
                del gymnasium.registry[name]


def test_checked_pages_have_code():
    assert page_checks.CHECKS.keys() <= {named(page) for page in WITH_CODE}


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_languages_of_blocks_are_known(page):
    """A block without a language, or with another one, would be neither run nor left out with a reason."""
    assert [block.line for block in page_blocks.blocks(page.read_text()) if block.language not in page_blocks.LANGUAGES] == []


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_indented_blocks_are_no_python_and_their_commands_exist(page):
    """Formulas and commands may be indented; Python is fenced, so that it runs."""
    text = re.sub(r"^[ ]*```.*?^[ ]*```$", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    lines = [line.strip() for line in re.findall(r"^(?: {4}|\t)(.+)$", text, re.MULTILINE)]
    assert [line for line in lines if re.match(r"(import|from) \w|sim\.|\w+ = (stepper|sim|model)\.", line)] == []
    for line in page_blocks.commands("\n".join(line for line in lines if line.startswith("stepper "))):
        page_blocks.check_command(line, named(page))


@pytest.mark.parametrize("page", [page for page in PAGES if re.search(r"pip install [^\n]*\btrain\]", page.read_text())], ids=named)
def test_pages_that_install_pytorch_say_its_size_and_how_to_avoid_cuda(page):
    """The extra `train` takes 6 GB on Linux, because PyTorch on PyPI comes with CUDA. PyTorch's own page has the command without it."""
    text = " ".join(page.read_text().split())
    assert "6 GB" in text and "CUDA" in text
    assert '"Get started" (Linux, Pip, CPU)' in text or re.search(r"\[[^]]*PyTorch for CPUs[^]]*\]\([./]*how-to/train\.md\)", text)


@pytest.mark.parametrize("page", [page for page in PAGES if "\n::: " in page.read_text()], ids=named)
def test_documented_names_exist(page):
    """`::: NAME` on a page becomes the documentation of that name; modules of adapters need libraries that are not installed here."""
    for name in re.findall(r"^::: ([\w.]+)$", page.read_text(), re.MULTILINE):
        owner, _, last = name.rpartition(".")
        found = importlib.util.find_spec(name) if owner == "stepper.adapters" else getattr(importlib.import_module(owner), last, None)
        assert found is not None, name


@pytest.mark.parametrize("page", [page for page in PAGES if "\n::: " in page.read_text()], ids=named)
def test_documented_functions_are_not_hidden_by_their_modules(page):
    """Griffe takes `stepper.load` for the module of that name, which has no signature: such a page names the module and a heading."""
    entries = re.findall(r"^::: ([\w.]+)$((?:\n {4,}.*)*)", page.read_text(), re.MULTILINE)
    for name, options in entries:
        owner, _, last = name.rpartition(".")
        if owner == "stepper.adapters":
            continue
        found = getattr(importlib.import_module(owner), last)
        module = found.__module__ if inspect.isfunction(found) else ""
        if module.rpartition(".")[2] != last:
            continue
        of_module = f"from {module} import " in Path(inspect.getsourcefile(importlib.import_module(owner))).read_text()
        if module == name or not of_module:
            assert name == f"{module}.{last}", f"{name}: write ::: {module}.{last}, with heading: {name} in its options"
            heading = re.search(r"heading: (\S+)", options)
            assert heading, name
            place, _, public = heading[1].rpartition(".")
            assert getattr(importlib.import_module(place), public) is found


@pytest.mark.parametrize(("file", "line"), [
    # Mkdocstrings shows the signature of a class only if it merges the constructor into it.
    ("mkdocs.yml", r"^ +merge_init_into_class: true$"),
    ("mkdocs.yml", rf"^repo_url: {re.escape(REPOSITORY)}$"),
    ("README.md", "make test "),
    (".ci/run", "make test$"),
])  # fmt: skip
def test_what_readers_rely_on_is_there(file, line):
    assert re.search(line, (ROOT / file).read_text(), re.MULTILINE)


def test_figures_of_pages_are_those_of_the_result_files():
    module = figures()
    values = module.figures()
    for page in module.pages():
        text = page.read_text()
        assert module.with_figures(text, values, str(page)) == text, "python docs/hooks/figures.py --update-docs writes it"
        assert not re.search(r"\{\{ [\w.]+ \}\}", text), f"{named(page)} has a figure that the repository shows as a name"


def test_figures_have_names_that_exist():
    module = figures()
    raises(KeyError, "page has the figure no, which docs/hooks/figures", module.with_figures, "<!-- figure no -->1<!-- end -->", {}, "page")
    assert module.with_figures("a <!-- figure x.y -->1<!-- end --> b", {"x.y": "2"}, "page") == "a <!-- figure x.y -->2<!-- end --> b"


@pytest.mark.parametrize(("page", "words"), [("README.md", 900), ("docs/benchmarks/atlas.md", 4999)])
def test_pages_that_come_first_are_short(page, words):
    """A stranger reads the first in five minutes; the summary is a tenth of all pages of the atlas."""
    assert len((ROOT / page).read_text().split()) <= words


def test_every_page_is_in_the_navigation():
    listed = set(re.findall(r"([\w/-]+\.md)$", (ROOT / "mkdocs.yml").read_text(), re.MULTILINE))
    assert listed == {str(page.relative_to(ROOT / "docs")) for page in (ROOT / "docs").rglob("*.md")}


@pytest.mark.parametrize("name", SECTIONS)
def test_generated_sections_are_those_of_the_code(name):
    page, text = SECTIONS[name]
    assert section_of(page, name) == text().strip("\n"), (
        "PYTHONPATH=python:tests/helpers:benches python tests/helpers/generated.py writes it"
    )


def test_a_section_is_written_between_its_marks(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("a\n<!-- one: made by `make one` -->\n\nold\n\n<!-- end of one -->\nb\n<!-- one more -->\n<!-- end of one more -->\n")
    write_section(page, "one", "new --> \\1\n")
    write_section(page, "one more", "last")
    assert (section_of(page, "one"), section_of(page, "one more")) == ("new --> \\1", "last")
    before = page.read_text()
    assert before.startswith("a\n<!-- one: made by `make one` -->\n\nnew")
    write_section(page, "one", section_of(page, "one"))
    assert page.read_text() == before
    raises(ValueError, r"page\.md has no section 'two': it begins with '<!-- two -->' and ends with", write_section, page, "two", "")


def test_only_update_docs_writes_documentation():
    """Every command of benches/ that names a folder of the documentation has the option."""
    for path in (ROOT / "benches").rglob("*.py"):
        text = path.read_text()
        if re.search(r'"docs(/|")', text) and "ArgumentParser(" in text:
            assert "--update-docs" in text, named(path)
    assert "--update-docs" not in (ROOT / "Makefile").read_text().replace("=--update-docs", "")


@pytest.mark.parametrize("page", [page for page in PAGES if "\n::: " in page.read_text()], ids=named)
def test_entries_of_the_reference_are_comments_in_the_repository(page):
    """GitHub shows no mkdocstrings entries, because they are in comments. A visible list before each block names them."""
    visible = re.sub(r"<!--.*?-->", "", page.read_text(), flags=re.DOTALL)
    assert ":::" not in visible
    for entry in re.findall(r"^::: stepper\.(?:\w+\.)*(\w+)$", page.read_text(), re.MULTILINE):
        assert f"{entry}`" in visible or page.name in ("status.md", "options.md", "model.md", "stepper_class.md"), entry


def test_names_that_pages_import_are_documented():
    """Tutorials and guides import functions and classes that the Python reference has."""
    documented = set(re.findall(r"^::: (stepper[\w.]+)$", "\n".join(page.read_text() for page in PAGES), re.MULTILINE))
    headings = set(re.findall(r"heading: (stepper[\w.]+)$", "\n".join(page.read_text() for page in PAGES), re.MULTILINE))
    lasts = {name.rpartition(".")[2] for name in documented | headings}
    missing = {}
    for page in PAGES:
        if page.parent.name in ("tutorials", "how-to"):
            for module, names in re.findall(r"^from stepper\.(\w+) import ([\w, ]+)$", page.read_text(), re.MULTILINE):
                missing |= {name: named(page) for name in names.split(", ") if name not in lasts and module != "adapters"}
    assert missing == {}
    assert set(stepper.envs.quantities.__all__) <= lasts


def test_the_documentation_needs_no_rust():
    makefile = (ROOT / "Makefile").read_text()
    assert "cargo" not in re.search(r"^docs: .*\n((?:\t.*\n)+)", makefile, re.MULTILINE)[1]


def test_every_topic_is_in_one_group():
    """Each module of scenes is in one group, because the groups are the only list of the modules."""
    modules = (f"atlas.scenes.{file.stem}" for file in Path(scenes.__file__).parent.glob("[!_]*.py"))
    assert Counter(topic.__name__ for topic in scenes.TOPICS) == Counter(modules)


def test_every_group_has_a_page_to_which_the_summary_links():
    assert {page.stem for page in (BENCHMARKS / "atlas").glob("*.md")} == scenes.GROUPS.keys()
    summary = (BENCHMARKS / "atlas.md").read_text()
    for name, (title, _) in scenes.GROUPS.items():
        assert f"[{title}](atlas/{name}.md)" in summary
        assert (BENCHMARKS / f"atlas/{name}.md").read_text().startswith(f"# {title}\n")


# Tables of docs/coming_from/: all code in their last column runs, or names what there is.

COMING_FROM = Path(__file__).parents[1] / "docs/coming_from"
SCENE = """<mujoco><option timestep=".002"/><worldbody><geom name="floor" type="plane" size="5 5 .1"/><body name="hand" pos="0 0 .3">
  <freejoint/><geom name="palm" size=".1" mass="1"/><site name="tip" pos=".1 0 0"/><body name="finger" pos=".1 0 0">
  <joint name="j" axis="0 1 0" damping=".1"/>
  <geom name="f" type="capsule" fromto="0 0 0 .2 0 0" size=".02" mass=".2"/></body></body></worldbody>
  <actuator><motor name="m" joint="j" gear="2" ctrlrange="-1 1"/></actuator>
  <sensor><framepos objtype="site" objname="tip"/><jointpos joint="j"/></sensor>
  <keyframe><key name="home" qpos="0 0 .5 1 0 0 0 .3" qvel="0 0 0 0 0 .1 .2" ctrl=".4" time="2"/></keyframe></mujoco>"""
PLACES = (
    *(stepper, stepper.envs, stepper.envs.quantities, stepper.envs.events, stepper.envs.commands, stepper.sensors, gymnasium, mujoco),
    *(stepper.Stepper, stepper.Model, stepper.Status, Linearization, stepper.envs.TASKS["Hopper"]),
)
"""Modules and classes whose names the tables use."""
COMMANDS = typer.main.get_command(application()).commands


def codes():
    """Pieces of code in the last cells of all rows: page and code."""
    for page in sorted(COMING_FROM.glob("*.md")):
        for row in re.findall(r"^\| (.*) \|$", page.read_text(), re.MULTILINE):
            yield from ((page.stem, code) for code in re.findall("`([^`]*)`", row.rpartition(" | ")[2]))


class Names(dict):
    """Values for the names in the tables; other names are those of `PLACES`."""

    def __missing__(self, name):
        for place in PLACES:
            if hasattr(place, name):
                return getattr(place, name)
        raise KeyError(name)


@pytest.fixture
def names(tmp_path):
    (tmp_path / "scene.xml").write_text(SCENE)
    sim, env, envs = stepper.Stepper(stepper.load(SCENE), 2), gymnasium.make("stepper/Ant-v5"), StepperVectorEnv("Ant", 3)
    env.reset(seed=0)
    return Names(
        path=tmp_path / "scene.xml", ctrl=np.zeros((2, 1)), q=np.array([0, 0, 1.0, 1, 0, 0, 0, 0]), qacc=np.zeros((2, 7)),
        points=np.zeros((1, 3)), directions=np.ones((1, 3)), values=np.ones(2), state=sim.get_state(), stepper=stepper, gymnasium=gymnasium,
        sim=sim, model=sim.model, env=env, envs=envs, now=envs.now, name="torso", rows=(Observation("qpos"),), weight=1.0,
        function=lambda now: now.qpos[:, 0],
    )  # fmt: skip


@pytest.mark.parametrize(("page", "code"), codes())
@pytest.mark.filterwarnings("ignore::stepper.ModelWarning")
def test_code_runs(page, code, names):
    if code in ("-v5", "dm_control", "touch", "contact"):  # Endings of names, and sensors of MJCF.
        return
    if code.startswith("stepper.adapters."):
        assert importlib.util.find_spec(code)
        return
    if code.startswith("stepper "):
        assert code.split()[1] in COMMANDS
        return
    if re.fullmatch(r"\w+\((now)?\)", code) and hasattr(Task, code.partition("(")[0]):
        return
    if keyword := re.fullmatch(r"(\w+)=?(\"\w+\")?", code):
        known = [stepper.Stepper, stepper.Stepper.reset, StepperVectorEnv, gymnasium.make]
        if any(keyword[1] in inspect.signature(call).parameters for call in known):
            return
    if "rollout" in code:
        names["ctrl"] = np.zeros((3, 2, 1))
    code = code.partition(" = ")[2] or code
    code = code.replace("make_vec(...", 'make_vec("stepper/Ant-v5", num_envs=2').replace("clip=...", "clip=(-1, 1)")
    eval(code.replace("(...)", ""), {}, names)


def test_resets_are_mujocos():
    """The calls in the row of `mj_resetData` and `mj_resetDataKeyframe` set what these set."""
    m = mujoco.MjModel.from_xml_string(SCENE)
    d, sim = mujoco.MjData(m), stepper.Stepper(stepper.load(m))
    mujoco.mj_resetDataKeyframe(m, d, 0)
    for keyframe, call in (("home", lambda: None), (None, lambda: mujoco.mj_resetData(m, d))):
        call()
        sim.step(nstep=3)
        sim.reset(keyframe=keyframe) if keyframe else sim.reset()
        for name in ("qpos", "qvel", "ctrl", "time"):
            np.testing.assert_array_equal(getattr(sim, name), getattr(d, name))
