"""Hooks of the build of the documentation (mkdocs.yml)."""

from __future__ import annotations

import posixpath
import re
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

import docstrings

ENTRIES = re.compile(r"^<!-- api\n(.*?)^-->\n", re.MULTILINE | re.DOTALL)
"""Entries of mkdocstrings, which are comments in the repository."""
LINK = re.compile(r"\[([^\]]*)\]\((\.\./[^)#\s]+)(#[^)\s]*)?\)")
TEST = re.compile(r"^[ \t]*<!-- test: .*? -->\n", re.MULTILINE)


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Text of a page for the site.

    Entries of API pages appear, which comments hide in the repository. Links to files outside of docs/ become file names or, with
    `repo_url`, links to the repository.
    """

    def link(match: re.Match[str]) -> str:
        text, target = match[1], match[2]
        path = posixpath.normpath(posixpath.join("docs", posixpath.dirname(page.file.src_uri), target))
        if path.startswith("docs/"):
            return match[0]
        if config.repo_url:
            return f"[{text}]({config.repo_url.rstrip('/')}/blob/main/{path})"
        return f"`{path}`" if posixpath.basename(path) in text or text in path else f"{text} (`{path}`)"

    return docstrings.without_links(LINK.sub(link, ENTRIES.sub(r"\1", TEST.sub("", markdown))))


CELL = re.compile(r"(<td[^>]*>)(.*?)</td>", re.DOTALL)
NUMBER = re.compile(r"[-+\d.,/]*\d(?:e[-+]?\d+)?(?: (?:%|(?:[num]?s|mm?)\b))?")
PATH = re.compile(r"<(a|code|pre)\b.*?</\1>|\bdocs/([\w/-]+\.md)", re.DOTALL)


def on_page_content(html: str, page: Any, config: Any, files: Any) -> str:
    """Numbers in cells that do not break, and paths of pages in docstrings as links."""

    def unbroken(number: re.Match[str]) -> str:
        return f'<span style="white-space: nowrap">{number[0]}</span>' if re.search("[-/ ]", number[0]) else number[0]

    def cell(match: re.Match[str]) -> str:
        return match[1] + re.sub(r"(?<![\w.-])" + NUMBER.pattern + r"(?![^<>]*>)", unbroken, match[2]) + "</td>"

    def path(match: re.Match[str]) -> str:
        file = files.get_file_from_path(match[2]) if match[2] else None
        return f'<a href="{file.url_relative_to(page.file)}">{file.page.title}</a>' if file and file.page and file.page.title else match[0]

    return PATH.sub(path, CELL.sub(cell, html))
