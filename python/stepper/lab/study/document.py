"""What is told of a study: sections of words, tables and pictures, as Markdown and as one HTML file that needs no other."""

from __future__ import annotations

import base64
import html
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

_STYLE = """
:root { color-scheme: light dark; }
body { font: 15px/1.5 system-ui, sans-serif; max-width: 68rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; } h2 { font-size: 1.15rem; margin-top: 2.2rem; border-bottom: 1px solid #8884; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; margin: .8rem 0; max-width: 100%; }
th, td { padding: .2rem .5rem; text-align: left; border-bottom: 1px solid #8883; overflow-wrap: anywhere; } th { font-weight: 600; }
td.n { text-align: right; } img { max-width: 100%; background: white; } code { font-size: .92em; }
pre { overflow-x: auto; background: #8881; padding: .6rem; }
"""


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
        body = "".join(_section(section) for section in self.sections)
        title = html.escape(self.title)
        return (
            f'<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">'
            f"<title>{title}</title><style>{_STYLE}</style><h1>{title}</h1>{body}</html>\n"
        )

    def save(self, folder: Path, name: str) -> list[Path]:
        """Writes NAME.html and NAME.md."""
        files = [folder / f"{name}.html", folder / f"{name}.md"]
        for file, text in zip(files, (self.html(), self.markdown()), strict=True):
            file.write_text(text, encoding="utf-8")
        return files


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


def _words(text: str) -> str:
    return re.sub(r"`([^`]*)`", r"<code>\1</code>", html.escape(text))


def _section(section: Section) -> str:
    parts = [f"<h2>{html.escape(section.title)}</h2>", *(f"<p>{_words(text)}</p>" for text in section.words)]
    if section.text:
        parts.append(f"<pre>{html.escape(section.text.rstrip())}</pre>")
    if section.rows:
        head = "".join(f"<th>{_words(name)}</th>" for name in section.head)
        rows = "".join("<tr>" + "".join(_cell(x) for x in row) + "</tr>" for row in section.rows)
        parts.append(f"<table><tr>{head}</tr>{rows}</table>")
    if section.picture is not None:
        data = base64.b64encode(section.picture.read_bytes()).decode()
        parts.append(f'<p><img alt="{html.escape(section.title)}" src="data:image/png;base64,{data}"></p>')
    return "".join(parts)


def _cell(value: Any) -> str:
    kind = ' class="n"' if isinstance(value, int | float) and not isinstance(value, bool) else ""
    return f"<td{kind}>{_words(cell(value))}</td>"
