"""What is told of a study: sections of words, tables and pictures, as Markdown and as one HTML file that needs no other."""

from __future__ import annotations

import base64
import functools
import importlib
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from stepper.shared.machine import require


@dataclass
class Section:
    """A part of a document.

    Attributes:
        title: Its heading.
        words: Paragraphs; `code` in back quotes.
        head: Of the table.
        rows: Of the table.
        picture: A PNG.
        text: What is set as it is, line by line.
    """

    title: str
    words: Sequence[str] = ()
    head: Sequence[str] = ()
    rows: Sequence[Sequence[Any]] = ()
    picture: Path | None = None
    text: str = ""


@dataclass
class Document:
    """Sections under a title."""

    title: str
    sections: list[Section] = field(default_factory=list)

    def markdown(self) -> str:
        """As Markdown; pictures are links beside the file."""
        parts = [f"# {self.title}"]
        for section in self.sections:
            parts += [f"## {section.title}", *section.words]
            if section.text:
                parts.append(f"```text\n{section.text.rstrip()}\n```")
            if section.rows:
                lines = ["| " + " | ".join(section.head) + " |", "|" + "---|" * len(section.head)]
                lines += ["| " + " | ".join(cell(x).replace("|", "\\|") for x in row) + " |" for row in section.rows]
                parts.append("\n".join(lines))
            if section.picture is not None:
                parts.append(f"![{section.title}]({section.picture.name})")
        return "\n\n".join(parts) + "\n"

    def html(self) -> str:
        """As a page that carries its pictures."""
        page: str = _template().render(title=self.title, sections=self.sections)
        return page

    def save(self, folder: Path, name: str) -> list[Path]:
        """Writes NAME.html and NAME.md."""
        files = [folder / f"{name}.html", folder / f"{name}.md"]
        for file, text in zip(files, (self.html(), self.markdown()), strict=True):
            file.write_text(text, encoding="utf-8")
        return files


def check_pages() -> None:
    """Raises MissingPackageError if pages cannot be written: called before hours of running, not after.

    Raises:
        MissingPackageError: jinja2 is not installed.
    """
    require("jinja2", "to write HTML reports")


def counted(number: int, what: str) -> str:
    """A number of things: "1 episode", "2 episodes"."""
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def cell(value: Any) -> str:
    """A value in a table: four digits of what is no whole number, a dash for what is none."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    return str(value) if isinstance(value, int) or math.isinf(value) else f"{value:.4g}"


@functools.cache
def _template() -> Any:
    """The template of a page, which escapes all that it is given."""
    check_pages()
    jinja2, markupsafe = importlib.import_module("jinja2"), importlib.import_module("markupsafe")

    def code(text: str) -> Any:
        return markupsafe.Markup(re.sub(r"`([^`]*)`", r"<code>\1</code>", str(markupsafe.escape(text))))

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader(__package__, ""), autoescape=True, trim_blocks=True, undefined=jinja2.StrictUndefined
    )
    encoded = {"base64": lambda file: base64.b64encode(file.read_bytes()).decode()}
    environment.filters |= encoded | {"cell": cell, "code": code}
    return environment.get_template("document.html")
