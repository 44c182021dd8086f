"""A release has one version, its workflow is well formed, and its documents name what there is."""

import re
import shutil
import tomllib

import pytest
from notices import DENY, NOTICES, licence_of, linked, notices
from release_version import ROOT, faults, versions

WORKFLOW = (ROOT / ".github/workflows/release.yml").read_text(encoding="utf-8")


def test_every_place_has_the_version_of_the_workspace():
    found = versions()
    assert set(found.values()) == {found["Cargo.toml"]}
    assert len(found) > 7


def test_a_tag_of_another_version_and_a_changelog_without_date_are_faults(tmp_path):
    for name in ("Cargo.toml", "CITATION.cff", "CHANGELOG.md"):
        (tmp_path / name).write_text((ROOT / name).read_text(encoding="utf-8"), encoding="utf-8")
    version = versions()["Cargo.toml"]
    changelog = tmp_path / "CHANGELOG.md"
    text = re.sub(rf"^## \[{version}\] - .*$", "## [0.0.0] - 2026-01-01", changelog.read_text(encoding="utf-8"), flags=re.MULTILINE)
    changelog.write_text(text, encoding="utf-8")
    assert faults(f"v{version}", tmp_path) == [
        f"CHANGELOG.md has version 0.0.0, the tag is v{version}",
        f"CHANGELOG.md has no line '## [{version}] - YYYY-MM-DD'",
    ]
    changelog.write_text(text.replace("[0.0.0]", f"[{version}]"), encoding="utf-8")
    assert faults(f"v{version}", tmp_path) == []
    assert f"Cargo.toml has version {version}, the tag is v9.9.9" in faults("v9.9.9", tmp_path)


def test_the_workflow_runs_files_that_there_are():
    scripts = set(re.findall(r"tests/[\w/]+\.py", WORKFLOW))
    assert "tests/helpers/release_version.py" in scripts
    assert [script for script in scripts if not (ROOT / script).is_file()] == []
    members = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["members"]
    names = {tomllib.loads((ROOT / member / "Cargo.toml").read_text())["package"]["name"] for member in members}
    assert set(re.findall(r"--exclude (\S+)", WORKFLOW)) == {"stepper-python", "stepper-benches"} < names


def test_the_workflow_gives_rights_to_the_last_job_alone():
    """Only `publish` may write: nothing that a build runs can change a release."""
    head, publish = WORKFLOW.split("\n  publish:\n")
    assert "write" not in re.sub(r"#.*", "", head)
    assert set(re.findall(r"^      ([a-z-]+): write", publish, re.MULTILINE)) == {"attestations", "contents", "id-token"}
    assert "secrets." not in WORKFLOW


def test_the_changelog_has_one_line_per_item_under_the_usual_headings():
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert set(re.findall(r"^### (.+)$", text, re.MULTILINE)) <= {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}
    assert re.search(r"^## \[\d+\.\d+\.\d+\]", text, re.MULTILINE)
    assert len([line for line in text.splitlines() if line.startswith("- ")]) > 50
    assert not re.search(r"^ +\S", text, re.MULTILINE), "an item continues on a second line"


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
