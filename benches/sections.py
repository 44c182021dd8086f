"""Tables of benchmarks, and generated sections of Markdown pages: the text between `<!-- NAME ... -->` and `<!-- end of NAME -->`."""

import re
from pathlib import Path


class Table:
    """Markdown table that is printed row by row.

    Args:
        head: Headings of the columns.
    """

    def __init__(self, *head: str) -> None:
        self._lines: list[str] = []
        self.add(*head)
        self.add(*["---"] * len(head))

    def __str__(self) -> str:
        return "\n".join(self._lines)

    def add(self, *cells: object) -> None:
        """Add a row, and print it."""
        self._lines.append("| " + " | ".join(map(str, cells)) + " |")
        print(self._lines[-1], flush=True)


def section_of(page: Path, name: str) -> str:
    """Text of one generated section of a Markdown page.

    Raises:
        ValueError: The page has no section of that name.
    """
    return _parts(page, name)[1].strip("\n")


def write_section(page: Path, name: str, text: str) -> None:
    """Replace the text of one generated section in a Markdown file.

    Raises:
        ValueError: The page has no section of that name.
    """
    before, _, after = _parts(page, name)
    text = text.strip("\n")
    page.write_text(f"{before}\n\n{text}\n\n{after}", encoding="utf-8")


def _parts(page: Path, name: str) -> tuple[str, str, str]:
    """Split the text of a page at one of its generated sections."""
    mark, text = re.escape(name), page.read_text(encoding="utf-8")
    found = re.fullmatch(rf"(.*<!-- {mark}(?:: [^\n]*?)? -->)(.*)(<!-- end of {mark} -->.*)", text, re.DOTALL)
    if found is None:
        raise ValueError(f"{page} has no section {name!r}: it begins with '<!-- {name} -->' and ends with '<!-- end of {name} -->'")
    return found[1], found[2], found[3]
