"""Pure functions of benches/corpus: rows, judgements, the report, and where URDF finds its meshes. Nothing is downloaded."""

import dataclasses

import mujoco
import pytest
import stepper
from checks import raises
from corpus import judge
from corpus.download import DownloadError, unpacked
from corpus.dynamics import kept_controls
from corpus.files import FragmentError, compile_model, digest, resolve
from corpus.measure import measure
from corpus.packages import PACKAGES, Package
from corpus.report import write_markdown
from corpus.row import FRAGMENT, MEASURED, SAME, STILL, Episode, Motion, Row
from rows import read_csv, write_csv

WELL = Episode(steps=500, ours=Motion(1.0, 2.0), theirs=Motion(1.0, 2.0))
ROW = Row(PACKAGES[0].name, PACKAGES[0].version, "a.xml", "0", MEASURED, model="1", nv=3, strict=True, random=WELL, rest=WELL)
PENDULUM = """<mujoco><worldbody><body><joint name="a" axis="0 1 0"/><geom size=".1" pos="0 0 -1"/></body></worldbody>
  <actuator><motor joint="a"/></actuator></mujoco>"""
URDF = """<robot name="r"><link name="base"/><link name="arm"><inertial><mass value="1"/>
  <inertia ixx="1" ixy="1" ixz="1" iyy="1" iyz="1" izz="1"/></inertial><visual><geometry><mesh filename="none.dae"/></geometry></visual>
  </link>
  <joint name="j" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint></robot>"""


def with_random(**changes) -> Row:
    return dataclasses.replace(ROW, random=dataclasses.replace(WELL, **changes))


@pytest.mark.parametrize(("changes", "criterion"), [
    ({"non_finite": 0.002}, "NON_FINITE"),
    ({"contacts_full": 0.002}, "CONTACTS_FULL"),
    ({"unresolved": 0.002}, "UNRESOLVED"),
    ({"not_converged": 0.004}, "NOT_CONVERGED"),
    ({"ours": Motion(0.09, 1.0)}, "less energy"),
    ({"ours": Motion(11.0, 20.0)}, "more energy"),
    ({"ours": Motion(1.0, 2.0, hinge_excess=0.06)}, "hinge limit"),
    ({"ours": Motion(1.0, 2.0, slide_excess=0.02)}, "slide limit"),
])  # fmt: skip
def test_each_criterion_is_missed_by_itself(changes, criterion):
    assert [fault.criterion for fault in judge.faults(with_random(**changes))] == [criterion]


@pytest.mark.parametrize("changes", [
    {},
    {"not_converged": 0.002},  # One step of the thousand of both episodes.
    {"infeasible": 1.0, "tunnelled": 1.0},
    {"ours": Motion(0.0, 0.0), "theirs": Motion(9e-3, 1.0)},  # Below the floor of 1 mJ times ten.
    {"ours": Motion(50.0, 50.0), "warnings": "BADQACC:3"},  # MuJoCo has begun again from the reference pose.
    {"theirs": Motion(1.0, 2.0, hinge_excess=1.0)},
])  # fmt: skip
def test_what_steps_well(changes):
    assert judge.faults(with_random(**changes)) == []


def test_a_row_survives_its_file(tmp_path):
    rows = [
        with_random(warnings="BADQACC:3", residual=1e-7),
        dataclasses.replace(ROW, outcome=FRAGMENT, note='two\nlines, a comma, a "quote"'),
    ]
    write_csv(tmp_path / "corpus.csv", rows, {"cores": 2})
    assert read_csv(tmp_path / "corpus.csv", Row) == (rows, {"cores": 2})
    assert read_csv(tmp_path / "none.csv", Row) == ([], {})


def test_the_report_counts_each_model_once(tmp_path):
    worse = dataclasses.replace(with_random(unresolved=0.5), file="b.xml", model="2", strict=False, missing="spatial tendon")
    again = dataclasses.replace(worse, package=PACKAGES[1].name, version=PACKAGES[1].version, outcome=SAME, strict=False)
    write_markdown(tmp_path / "corpus.md", [ROW, worse, again], {})
    text = (tmp_path / "corpus.md").read_text()
    assert f"| {PACKAGES[0].name} {PACKAGES[0].version} | 2 | 2 | 1 | 2 | 1 | 2 | 0 | 0 |" in text
    assert f"| {PACKAGES[1].name} {PACKAGES[1].version} | 1 | 1 | 0 | 1 | 0 | 1 | 0 | 0 |" in text
    assert "| **all, each model once** | 3 | 2 | 1 | 2 | 1 | 2 | 0 | 0 |" in text
    assert "| spatial tendon | 1 | 1 |" in text
    assert "b.xml, without spatial tendon | UNRESOLVED: 50.00% of the steps, random |" in text


def test_meshes_of_urdf_are_found_beside_it_and_above(tmp_path):
    mesh = tmp_path / "arm_description/meshes/link.stl"
    mesh.parent.mkdir(parents=True)
    mesh.touch()
    urdf = tmp_path / "arm_description/urdf/arm.urdf"
    urdf.parent.mkdir()
    for reference in ("package://arm_description/meshes/link.stl", "package://another_name/meshes/link.stl", "../meshes/link.stl"):
        assert resolve(reference, tmp_path, urdf) == mesh
    raises(FragmentError, r"missing\.stl", resolve, "package://arm_description/missing.stl", tmp_path, urdf)


def test_a_file_is_measured(tmp_path):
    files = {
        "a.xml": PENDULUM,
        "still.xml": "<mujoco/>",
        "part.xml": "<mujoco><actuator><motor joint='a'/></actuator></mujoco>",
        "r.urdf": URDF,
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    rows = {name: measure(PACKAGES[0], tmp_path, name, set()) for name in files}
    assert {name: row.outcome for name, row in rows.items()} == {
        "a.xml": MEASURED, "still.xml": STILL, "part.xml": FRAGMENT, "r.urdf": MEASURED,
    }  # fmt: skip
    assert rows["a.xml"].strict
    assert judge.agrees(rows["a.xml"])
    assert judge.faults(rows["a.xml"]) == []
    assert rows["a.xml"].random.theirs.mean_energy == pytest.approx(rows["a.xml"].random.ours.mean_energy, rel=0.05)
    assert measure(PACKAGES[0], tmp_path, "a.xml", {rows["a.xml"].model}).outcome == SAME
    assert digest(compile_model(tmp_path, "a.xml")) == rows["a.xml"].model


def test_controls_of_actuators_that_are_left_out_are_skipped():
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody><body name="b"><joint name="a"/><geom size=".1"/></body></worldbody>
      <actuator><adhesion body="b" ctrlrange="0 1"/><motor joint="a"/></actuator></mujoco>""")
    ours = stepper.load(model, strict=False)
    assert len(kept_controls(model, ours)) == ours.nu


def test_a_package_that_cannot_be_had_is_named(tmp_path):
    folder = tmp_path / "archives/robots-1.0"
    folder.mkdir(parents=True)
    (folder / "robots-1.0-py3-none-any.whl").write_text("damaged")
    raises(DownloadError, "not a wheel", lambda: unpacked(Package("robots", "1.0", "a test"), tmp_path))
