"""A release has one version, its workflow is well formed, and its documents name what there is."""

import re
import tomllib

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
    items = [line for line in text.splitlines() if line.startswith("- ")]
    assert len(items) > 50
    assert not re.search(r"^ +\S", text, re.MULTILINE), "an item continues on a second line"
