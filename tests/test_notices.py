"""What is linked into the wheel is named in it, with its licence."""

import shutil
import tomllib

import pytest
from notices import DENY, NOTICES, ROOT, licence_of, linked, notices


def test_the_wheel_carries_the_notices():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert NOTICES.name in project["license-files"]
    assert all((ROOT / name).is_file() for name in project["license-files"])


@pytest.mark.skipif(shutil.which("cargo") is None, reason="cargo says what is linked")
def test_every_library_that_is_linked_is_named_with_a_licence_that_is_accepted():
    """Else: python tests/helpers/notices.py writes the file anew, and says what it cannot accept."""
    assert len(linked()) > 20
    assert NOTICES.read_text(encoding="utf-8") == notices()


@pytest.mark.skipif(shutil.which("cargo") is None, reason="cargo says what is linked")
def test_what_deny_toml_excepts_is_not_linked():
    assert not {package["name"] for package in linked()} & {exception["crate"] for exception in DENY["licenses"]["exceptions"]}


def test_a_licence_that_nobody_accepted_is_an_error():
    assert licence_of({"name": "a", "license": "Unlicense OR MIT"}) == "MIT"
    assert licence_of({"name": "a", "license": "MIT/Apache-2.0"}) == "Apache-2.0"
    for other in ("GPL-3.0-only", None, "MIT AND GPL-2.0"):
        with pytest.raises(ValueError, match=r"none of Apache-2\.0, MIT"):
            licence_of({"name": "a", "license": other})
