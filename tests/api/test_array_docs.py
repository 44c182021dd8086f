"""Docstrings of public functions of Python name the shape and the unit of their arrays."""

from pathlib import Path

import pytest
from array_docs import arrays_of

ROOT = Path(__file__).parents[2] / "python/stepper"
EXCEPTIONS: frozenset[str] = frozenset()
"""Places of arrays without a shape or a unit. The list may only become shorter."""


def test_docstrings_name_the_shape_and_the_unit_of_each_array():
    found = list(arrays_of(sorted(ROOT.rglob("*.py")), ROOT))
    assert len(found) > 300
    assert {array.place: array.lacks for array in found if array.lacks and array.place not in EXCEPTIONS} == {}


@pytest.mark.parametrize(("text", "lacks"), [
    ('"""Sum.\n\n    Args:\n        a: Positions, (n, 3), m.\n    """', [[]]),
    ('"""Sum.\n\n    Args:\n        a: Positions, (n, 3).\n    """', [["unit"]]),
    ('"""Sum.\n\n    Args:\n        a: Positions, m.\n    """', [["shape"]]),
    ('"""Sum.\n\n    Args:\n        b: Positions, (n, 3), m.\n    """', [["shape", "unit"]]),
    ('"""Sum of the masses, (n,), kg."""', [[]]),
    ('"""Sum."""', [["shape", "unit"]]),
])  # fmt: skip
def test_a_planted_docstring_is_found(tmp_path, text, lacks):
    file = tmp_path / "planted.py"
    file.write_text(f"def f(a: Array) -> float:\n    {text}\n")
    assert [array.lacks for array in arrays_of([file], tmp_path)] == lacks


def test_an_override_inherits_the_description(tmp_path):
    file = tmp_path / "planted.py"
    base = 'class A:\n    def f(self, a: Array):\n        """Mass, (n,), kg."""\n'
    file.write_text(base + 'class B(A):\n    def f(self, a: Array):\n        """Mass."""\n')
    assert [array.place for array in arrays_of([file], tmp_path)] == ["planted.py:A:f(a)"]
