"""Code blocks of a documentation page, and how a test runs them.

The blocks of a page run in order, in one namespace and in a folder of their own, exactly as the page shows them:

* A `python` block is executed.
* A block with `title="name"`, of any language, is written into the file of that name.
* A `text` block with `title="output"` is compared with what the python block before it printed.
* In a `sh` block, each line that calls `stepper` is parsed as the command line does it; after `<!-- test: run -->` it is executed.

An HTML comment on the line before a block changes that: `<!-- test: needs torch, ray -->` ends the run of the page there if a package is
missing, and `<!-- test: not run, REASON -->` skips the block. The build of the site removes these comments. The folder has `humanoid.xml`,
dm_control's humanoid, `examples`, as a checkout does, and a policy where `stepper train stepper/HalfCheetah-v5` writes it.
"""

import contextlib
import io
import re
import shlex
import subprocess
import sys
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import mujoco
import pytest
from models import SOURCES

ROOT = Path(__file__).parents[2]
FENCE = re.compile(
    r"^(?:[ ]*<!-- test: (?P<rule>.*?) -->\n)?^(?P<indent>[ ]*)```(?P<info>[^\n]*)\n(?P<text>.*?)^(?P=indent)```$", re.MULTILINE | re.DOTALL
)
LANGUAGES = ("python", "sh", "text", "toml", "xml", "json", "diff")
"""Languages of blocks; `diff` is a change of another project's file, `text` a transcript or a formula unless it has the title "output"."""


@dataclass(frozen=True)
class Block:
    """A fenced code block of a page."""

    language: str
    title: str
    rule: str
    text: str
    line: int


def blocks(text: str) -> list[Block]:
    """Code blocks of a page, in order."""
    found = []
    for match in FENCE.finditer(text):
        language, _, rest = match["info"].strip().partition(" ")
        title = re.search(r'title="([^"]*)"', rest)
        body = re.sub(rf"^{match['indent']}", "", match["text"], flags=re.MULTILINE)
        line = text.count("\n", 0, match.start("text")) + 1
        found.append(Block(language, title[1] if title else "", match["rule"] or "", body, line))
    return found


def prepare(folder: Path) -> None:
    """Puts the files that pages may use into a folder."""
    spec = mujoco.MjSpec.from_file(str(SOURCES["dm_control/humanoid"]))
    spec.compile()
    (folder / "humanoid.xml").write_text(spec.to_xml())
    (folder / "examples").symlink_to(ROOT / "examples")
    trained = folder / "out/train/stepper_HalfCheetah-v5/seed1"
    trained.mkdir(parents=True)
    (trained / "policy.npz").symlink_to(ROOT / "examples/policies/half_cheetah.npz")


def run(page: Path, folder: Path) -> dict:
    """Runs all blocks of a page in a folder that is the working directory; returns the names that they leave."""
    # `names["printed"]` is the text that the python blocks printed.
    names: dict = {"__name__": "page", "printed": ""}
    printed = ""
    for block in blocks(page.read_text()):
        place = f"{page.relative_to(ROOT)}, line {block.line}"
        rule, _, reason = block.rule.partition(" ")
        if rule == "needs":
            missing = [name for name in re.split(r",\s*", reason) if not available(name)]
            if missing:
                pytest.skip(f"{place}: needs {', '.join(missing)}")
        if rule == "not":
            assert re.match(r"run, .{10,}", reason), f"{place}: a block that is not run has a reason: <!-- test: not run, REASON -->"
            continue
        if block.language == "text" and block.title == "output":
            assert printed.strip() == block.text.strip(), place
        elif block.title:
            (folder / block.title).write_text(block.text)
        elif block.language == "python":
            out = io.StringIO()
            # Empty lines in front, so that tracebacks show the line of the page.
            code = compile("\n" * (block.line - 1) + block.text, str(page), "exec")
            with contextlib.redirect_stdout(out):
                exec(code, names)
            printed = out.getvalue()
            names["printed"] += printed
        elif block.language == "sh":
            for line in commands(block.text):
                check_command(line, place)
                if rule == "run":
                    printed = execute(line, place)
    return names


def available(name: str) -> bool:
    """Whether a package is installed; "OpenGL": whether MuJoCo's renderer draws here."""
    if name != "OpenGL":
        return find_spec(name) is not None
    import stepper

    try:
        model = stepper.load('<mujoco><worldbody><geom size="1"/></worldbody></mujoco>')
        stepper.viewer.Renderer(model, width=8, height=8).render(stepper.Stepper(model))
    except (ImportError, RuntimeError):
        return False
    return True


def commands(text: str) -> list[list[str]]:
    """Calls of `stepper` in a block of shell commands."""
    lines = (shlex.split(line, comments=True) for line in text.replace("\\\n", " ").splitlines())
    return [line for line in lines if line and line[0] == "stepper"]


def check_command(line: list[str], place: str) -> None:
    """Parses a call of `stepper`, without running it."""
    import typer
    from stepper.cli.app import application

    known = typer.main.get_command(application()).commands
    words = line[1 : line.index("&&")] if "&&" in line else line[1:]
    assert words[0] in known, f"{place}: {' '.join(line)}: there is no command {words[0]}"
    try:
        if "--help" not in words:
            known[words[0]].make_context(words[0], words[1:])
    except Exception as error:
        # Errors of usage have this method; their class is click's or typer's own, depending on the version.
        said = error.format_message() if hasattr(error, "format_message") else str(error)
        raise AssertionError(f"{place}: {' '.join(line)}: {said}") from None


def execute(line: list[str], place: str) -> str:
    """Runs a call of `stepper`, and returns what it prints."""
    done = subprocess.run([sys.executable, "-m", "stepper", *line[1:]], capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{place}: {' '.join(line)}\n{done.stderr}"
    return done.stdout
