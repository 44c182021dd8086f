"""Documents with texts, tables and pictures, as Markdown and as a self-contained HTML file."""

from __future__ import annotations

import base64
import functools
import importlib
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from stepper.shared.files import write_text
from stepper.shared.machine import require

_INTERVAL = re.compile(r"(?<=\d) to (?=[-\d])")
"""Word between the two numbers of an interval, at which a cell of a table must not break."""


@dataclass
class Section:
    """Section of a document.

    Attributes:
        title: Heading.
        words: Paragraphs, in which back quotes mark code.
        head: Headings of the table's columns.
        rows: Rows of the table; without rows the section has no table.
        picture: Path of a PNG file; None adds no picture.
        text: Preformatted text.
    """

    title: str
    words: Sequence[str] = ()
    head: Sequence[str] = ()
    rows: Sequence[Sequence[Any]] = ()
    picture: Path | None = None
    text: str = ""


def markdown_table(head: Iterable[object], rows: Iterable[Iterable[object]]) -> str:
    """Markdown table with headings `head` and the cells of each row. Vertical bars in cells are escaped."""
    names = list(head)
    table: list[Iterable[object]] = [names, ["---"] * len(names), *rows]
    return "\n".join("| " + " | ".join(str(cell).replace("|", "\\|") for cell in row) + " |" for row in table)


@dataclass
class Document:
    """Document: a title and sections."""

    title: str
    sections: list[Section] = field(default_factory=list)

    def markdown(self) -> str:
        """Document as Markdown text, with links to pictures in the same folder."""
        parts = [f"# {self.title}"]
        for section in self.sections:
            parts += [f"## {section.title}", *section.words]
            if section.text:
                parts.append(f"```text\n{section.text.rstrip()}\n```")
            if section.rows:
                parts.append(markdown_table(section.head, ([cell(x) for x in row] for row in section.rows)))
            if section.picture is not None:
                parts.append(f"![{section.title}]({section.picture.name})")
        return "\n\n".join(parts) + "\n"

    def html(self) -> str:
        """Document as text of an HTML page that contains its pictures."""
        page: str = _template().render(title=self.title, sections=self.sections)
        return page

    def save(self, folder: Path, name: str) -> list[Path]:
        """Writes NAME.html and NAME.md to a folder, and returns their paths."""
        files = [folder / f"{name}.html", folder / f"{name}.md"]
        return [write_text(file, text) for file, text in zip(files, (self.html(), self.markdown()), strict=True)]


def check_pages() -> None:
    """Checks that HTML pages can be written. Call it before a long run.

    Raises:
        MissingPackageError: jinja2 is not installed.
    """
    require("jinja2", "to write HTML reports")


def counted(number: int, what: str) -> str:
    """Number with a noun in singular or plural: "1 episode", "2 episodes"."""
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def cell(value: Any) -> str:
    """Text of a value in a table: floats with four significant digits, a dash for None and NaN."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    return str(value) if isinstance(value, int) or math.isinf(value) else f"{value + 0.0:.4g}"  # The sum turns -0 into 0.


@functools.cache
def _template() -> Any:
    """Jinja template of an HTML page, which escapes special characters in texts. It is loaded once."""
    check_pages()
    jinja2, markupsafe = importlib.import_module("jinja2"), importlib.import_module("markupsafe")

    def code(text: str) -> Any:
        return markupsafe.Markup(re.sub(r"`([^`]*)`", r"<code>\1</code>", str(markupsafe.escape(text))))

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader(__package__, ""), autoescape=True, trim_blocks=True, undefined=jinja2.StrictUndefined
    )
    encoded = {"base64": lambda file: base64.b64encode(file.read_bytes()).decode()}

    def unbroken(text: str) -> str:
        return _INTERVAL.sub("\u00a0to\u00a0", text)

    environment.filters |= encoded | {"cell": cell, "code": code, "unbroken": unbroken}
    return environment.get_template("document.html")
