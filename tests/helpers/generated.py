"""Generated sections of pages of the reference: this script writes them, and tests/test_documents.py compares them.

Usage:

    PYTHONPATH=python:tests/helpers:benches python tests/helpers/generated.py
"""

from pathlib import Path

import api_names
import command_line
import field_table
import study_keys
from sections import write_section

REFERENCE = Path(__file__).parents[2] / "docs/reference"
SECTIONS = {
    "commands": (REFERENCE / "command_line.md", command_line.table),
    "fields": (REFERENCE / "what_can_vary.md", lambda: f"{field_table.table()}\n{field_table.others()}"),
    "keys": (REFERENCE / "studies.md", study_keys.table),
    **api_names.sections(),
}
"""Page and text of each section, by its name."""

if __name__ == "__main__":
    for name, (page, text) in SECTIONS.items():
        write_section(page, name, text())
