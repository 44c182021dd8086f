"""The example of docs/how-to/terrain.md is short. tests/test_documents.py runs it."""

import re
from pathlib import Path

PAGE = (Path(__file__).parents[2] / "docs/how-to/terrain.md").read_text()
SNIPPETS = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)


def test_the_first_builds_a_terrain_in_twenty_lines():
    body = SNIPPETS[0].split("ground = ")[1]
    assert len(body.splitlines()) <= 20
