"""benches/many_contacts: scenes that need no download play in both engines, and the report has a row for each of their phases."""

import dataclasses
import json

import mujoco
import numpy as np
import pytest
import stepper
from many_contacts.assets import Assets, written
from many_contacts.episodes import floors
from many_contacts.kinematics import UnreachableError, downwards, eased, reach
from many_contacts.measure import Plan, measure, save_episodes
from many_contacts.report import accuracy, means, speed
from many_contacts.scene import Phase
from many_contacts.scenes import ALL, grasps, heaps, unitree
from many_contacts.targets import TARGETS, lines
from sections import section_of
from terrains import report
from terrains.grounds import GROUNDS
from terrains.measure import SPREAD
from terrains.report import steps, times

PLAN = Plan(num_envs=2, peers=2, precisions=("f64",), settings=("default", "fast"), rounds=2)
ARM = """<mujoco><worldbody><body><joint name="a" axis="0 0 1"/><geom size=".1"/><body pos="1 0 0"><joint name="b" axis="0 0 1"/>
<geom size=".1"/><site name="tip" pos="1 0 0"/></body></body></worldbody></mujoco>"""
MACHINE = {"cpu_level": "avx2"}
THEIRS = {"microseconds": 6.0, "contacts": 1.0, "penetration": 0.0}
OURS = THEIRS | {"microseconds": 2.0, "ratio": 3.0, "flags": {}, "sweeps": 1.0, "newton_steps": 1.0, "unsolved": 0.0}


@pytest.fixture(scope="module")
def lifted(tmp_path_factory):
    scene = dataclasses.replace(grasps.SCENES[0], phases=(Phase("grips", 150, timed=False), Phase("lifts", 60, held=grasps.HELD)))
    return measure(scene, written(scene.spec(Assets(tmp_path_factory.mktemp("cache"))), tmp_path_factory.mktemp("out") / "lift.xml"), PLAN)


def test_a_row_for_each_timed_phase_with_every_setting(lifted):
    (row,) = lifted
    assert set(row["ours"]) == {"f64 default", "f64 fast"}
    assert len(row["theirs"]) == 2
    found = row["ours"]["f64 default"]
    assert found["ratio"] > 0
    assert found["microseconds"] > 0
    assert found["unsolved"] == 0
    way, dropped = found["slip"]
    assert way < 1e-3
    assert dropped == 0


def test_the_tables_have_the_row(lifted):
    assert "lift 0.05 kg" in speed(lifted, {})
    assert "lift 0.05 kg" in accuracy(lifted)


def test_scenes_of_a_group_count_once_together():
    rows = [{"group": group, "ours": {"f64 default": {"ratio": ratio}}} for group, ratio in (("heaps", 1.0), ("heaps", 4.0), ("g1", 8.0))]
    assert means(rows, "f64 default") == pytest.approx(4.0)


@pytest.mark.parametrize("scene", heaps.SCENES, ids=lambda scene: scene.name)
def test_heaps_compile_and_begin_without_deep_overlap(scene, tmp_path):
    model = mujoco.MjModel.from_xml_path(str(written(scene.spec(Assets(tmp_path)), tmp_path / "scene.xml")))
    script = scene.script(model, 2, np.random.default_rng(0))
    data = mujoco.MjData(model)
    for qpos in script.qpos:
        data.qpos[:] = qpos
        mujoco.mj_forward(model, data)
        assert min((c.dist for c in data.contact), default=0.0) > -1e-3


def test_gains_of_walkers_are_those_of_mjlab():
    hip = unitree.GO1.motors[0]
    assert hip.armature == pytest.approx(0.004026312)
    assert hip.stiffness == pytest.approx(15.895, rel=1e-3)
    assert hip.scale == pytest.approx(0.3728, rel=1e-3)
    assert unitree.fallen(np.array([[0, 0, 1, 1, 0, 0, 0], [0, 0, 1, 0.7, 0.7, 0, 0]], float)).tolist() == [False, True]


def test_names_are_distinct():
    assert len({scene.name for scene in ALL}) == len(ALL)


def test_targets_are_those_of_scenes_and_their_phases():
    rows = {scene.row(phase) for scene in ALL for phase in scene.phases if phase.timed}
    assert {name for name in TARGETS if name not in rows | {scene.name for scene in ALL}} == set()


def test_an_arm_reaches_what_it_can():
    model = mujoco.MjModel.from_xml_string(ARM)
    angles = np.array([0.3, 0.5])
    data = mujoco.MjData(model)
    data.qpos[:] = angles
    mujoco.mj_kinematics(model, data)
    found = reach(model, np.array([0.1, 0.8]), "tip", ["a", "b"], pos=data.site("tip").xpos, rot=data.site("tip").xmat.reshape(3, 3))
    np.testing.assert_allclose(found, angles, atol=1e-4)
    with pytest.raises(UnreachableError, match="tip"):
        reach(model, np.zeros(2), "tip", ["a", "b"], pos=np.array([3.0, 0, 0]), rot=np.eye(3))


def test_ways_begin_and_end_at_rest():
    way = eased(np.zeros(2), np.ones(2), 100)
    np.testing.assert_array_equal(way[-1], [1.0, 1.0])
    assert way[0].max() < 1e-4
    np.testing.assert_allclose(downwards(0.3) @ downwards(0.3).T, np.eye(3), atol=1e-15)


def test_an_episode_is_what_was_timed(tmp_path):
    scene = dataclasses.replace(heaps.SCENES[2], phases=(Phase("stands", 4, timed=False), Phase("impact", 6)))
    path = written(scene.spec(Assets(tmp_path)), tmp_path / "wall.xml")
    for _ in range(2):  # The second one replaces the first.
        save_episodes(scene, path, dataclasses.replace(PLAN, precisions=("f32",)), tmp_path / "episodes")
    (folder,) = (tmp_path / "episodes").iterdir()
    assert folder.name == "wall_2_f32"
    done = stepper.recording.verify(folder)
    assert done
    assert done.steps == 6
    assert done.complete


def anatomy(name, precision, micros, solve, floor):
    parts = [{"name": "solve", "times": 1, "micros": solve, "floor": floor}, {"name": "detect", "times": 1, "micros": 1.0, "floor": 0.5}]
    return {"name": name, "num_envs": 64, "precision": precision, "micros": micros, "floor": floor + 0.5, "parts": parts}


def figures(ratio, unsolved):
    return {"ratio": ratio, "microseconds": 10.0, "unsolved": unsolved}


def test_targets_say_what_is_reached_at_the_floor_and_in_the_way(tmp_path):
    rows = [
        {"row": "g1", "group": "g1", "num_envs": 64, "ours": {"f64 default": figures(1.0, 1e-3)}},
        {"row": "wall", "group": "wall", "num_envs": 64, "ours": {"f64 default": figures(9.0, 0.0)}},
    ]
    (tmp_path / "floors.json").write_text(json.dumps({"episodes": [anatomy("g1", "f64", 10.0, 9.0, 1.5)]}))
    found = {line[0]: line[1:] for line in lines(rows, MACHINE, floors(tmp_path / "floors.json"), None)}
    assert found["g1"] == ["2 / 3.3", "**1** / -", "5 / -", "solve (75%) / -", "**0.1** / -"]
    assert found["geometric mean over scenes"][1] == "3 / -"
    assert found["smallest over scenes (g1)"][:2] == ["- / -", "1 / -"]
    raised = {line[0]: line[1:] for line in lines(rows, {"cpu_level": "avx512"}, {}, None)}
    assert raised["g1"] == ["2.7 / 4.4", "**1** / -", "- / -", "- / -", "**0.1** / -"]


def test_robots_have_targets_in_a_batch_and_alone():
    row = {
        "model": "ant",
        "ratio": {"stepper f64": 5.0, "stepper f32": 16.0},
        "microseconds": {"stepper f64": 1.0, "stepper f32": 0.5},
        "ratio_alone": {"stepper f64": 2.0},
        "microseconds_alone": {"stepper f64": 5.0},
        "certificates": {f"stepper {p}": {"not_converged": 0, "env_steps": 100} for p in ("f64", "f32")},
    }
    table = lines([], MACHINE, {}, {"plan": {"num_envs": 256}, "models": [row], "provenance": MACHINE})
    found = {line[0]: line[1:] for line in table}
    assert found["1 robots, random control, mean"] == ["5.2 / 8.5", "**5** / 16", "- / -", "- / -", "0 / 0"]
    assert found["the robots, a single environment"] == ["3.5", "**2**", "-", "-", "0"]


@pytest.mark.parametrize("ground", [g for g in GROUNDS if g.name != "3,000 tiles"], ids=lambda g: g.name)
def test_no_ground_is_higher_than_it_says(ground):
    spec = mujoco.MjSpec()
    ground.add(spec)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rng = np.random.default_rng(0)
    for x, y in rng.uniform(-SPREAD, SPREAD, (20, 2)):
        distance = mujoco.mj_ray(model, data, np.array([x, y, 9.0]), np.array([0.0, 0.0, -1.0]), None, 1, -1, np.zeros(1, np.int32))
        # Between points of a field the ground is as high as a neighbour at most: a robot's whole footprint is looked at.
        around = x + np.array([-0.1, 0.0, 0.1]), y + np.array([-0.1, 0.0, 0.1])
        highest = np.max(ground.height(*(np.ravel(a) for a in np.meshgrid(*around))))
        assert 9.0 - distance <= highest + 1e-6  # heights of fields are in single precision


def test_the_table_compares_with_the_faster_setting():
    row = {
        "scene": "stairs",
        "ours": {"f64 default": OURS},
        "theirs": {"MuJoCo own": THEIRS | {"microseconds": 8.0}, "MuJoCo same": THEIRS},
    }
    assert times([row]).splitlines()[-1] == "| stairs | 2.0 (3.00) | 8.0 | 6.0 |"
    assert len(steps([row]).splitlines()) == 5


def test_a_table_is_written_for_its_cpu_level(tmp_path, monkeypatch):
    page = tmp_path / "terrain.md"
    page.write_text(report.PAGE.read_text(encoding="utf-8"), encoding="utf-8")
    monkeypatch.setattr(report, "PAGE", page)
    rows = [{"scene": "stairs", "ours": {"f64 default": OURS}, "theirs": {"MuJoCo own": THEIRS}}]
    came_from = {"cpu": "a CPU", "cpu_level": "avx512", "utc": "2026-01-01T00:00", "load_average": 0.5}
    before = section_of(page, "times avx2")
    report.update_page(rows, came_from)
    assert "a CPU, CPU level avx512, 2026-01-01, load 0.5." in section_of(page, "times avx512")
    assert section_of(page, "times avx2") == before
    with pytest.raises(ValueError, match=r"terrain\.md has no table for the CPU level 'baseline': set STEPPER_CPU_LEVEL to avx2 or avx512"):
        report.update_page(rows, came_from | {"cpu_level": "baseline"})
