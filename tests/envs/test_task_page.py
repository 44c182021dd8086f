"""docs/reference/tasks.md has the tables that the tasks have now."""

from importlib.util import find_spec

import pytest
from task_page import PAGE, page


@pytest.mark.skipif(
    any(find_spec(name) is None for name in ("dm_control", "mjlab")), reason="models of dm_control and mjlab are not installed"
)
def test_the_page_is_up_to_date():
    assert PAGE.read_text() == page(), (
        "the observations or actions of a task changed: PYTHONPATH=python:tests/helpers .venv/bin/python tests/helpers/task_page.py"
    )
