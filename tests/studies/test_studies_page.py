"""The keys of a study that docs/reference/studies.md lists are those of the classes, with their docstrings."""

import pytest
from study_keys import PARTS, attributes, keys


@pytest.mark.parametrize("kind", [kind for _, kind in PARTS])
def test_each_key_has_a_description(kind):
    assert [field.name for field in keys(kind)] == list(attributes(kind))
