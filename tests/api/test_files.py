"""Files that are missing, empty, cut or of another kind: every error names the file, whatever reads it."""

import errno
import inspect
import io
import json
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import mujoco
import numpy as np
import pytest
import stepper
from checks import raises
from hypothesis import given, settings, strategies as st
from loading_scenes import joint, link, robot
from recordings import disk_of
from stepper.cli.app import COMMANDS, application, main
from stepper.lab import Outcome, Parameter, Study
from stepper.lab.study.journal import rows_of
from stepper.policies.ppo_settings import Settings, default_folder
from stepper.shared.files import (
    LOCK,
    atomic_write,
    check_archive,
    existing,
    explained,
    locked,
    os_error_message,
    os_errors_of,
    read_arrays,
    read_csv,
    read_text,
    write_arrays,
    write_text,
)
from stepper.sysid import Identification
from stepper.sysid.data import episodes_of

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")  # Of MuJoCo, on damaged files.

MJCF = """<mujoco><worldbody><body name="pole"><joint name="my hinge" axis="0 1 0" damping="0.1"/>
  <geom type="capsule" fromto="0 0 0 0 0 -.5" size=".05"/></body></worldbody><actuator><motor name="motor" joint="my hinge"/></actuator>
  <sensor><jointpos name="angle" joint="my hinge"/></sensor></mujoco>"""
URDF = robot(link("base"), "{pole}", joint("j", "base", "pole", kind="continuous"))
STUDY = """model = "m.xml"
seconds = 0.1
qpos_noise = 0.01
[[outcomes]]
name = "angle"
measure = "joint my hinge"
success = ">= 0"
[parameters.damping]
selector = "dof_damping[my hinge]"
low = 0.0
high = 1.0
[parameters.gravity]
selector = "gravity[2]"
low = -10.0
high = -9.0
"""
ESCAPES = ["../../../escaped", "..", ".", "...", "a/b", "/a", "a\\b", "C:", "C:a", "", " a", "a\n", "\0", "\ud800", "x" * 201, "é" * 101]
MODEL = stepper.load(MJCF)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A folder with a valid file of every kind."""
    folder = tmp_path_factory.mktemp("files")
    (folder / "m.xml").write_text(MJCF)
    (folder / "m.urdf").write_text(URDF.format(pole=link("pole")))
    MODEL.save(folder / "m.stepper")
    mujoco.mj_saveModel(mujoco.MjModel.from_xml_string(MJCF), str(folder / "m.mjb"))
    (folder / "s.toml").write_text("[sensors.angle]\nnoise_std = 0.1\n")
    (folder / "s.json").write_text('{"sensors": {"angle": {"noise_std": 0.1}}}')
    (folder / "a.toml").write_text("[actuators.motor]\nlag = 0.1\n")
    (folder / "study.toml").write_text(STUDY)
    time = np.arange(20) * 0.02
    (folder / "log.csv").write_text("time,ctrl,qpos\n" + "".join(f"{t},0,{np.cos(t)}\n" for t in time))
    np.savez(folder / "log.npz", time=time, ctrl=np.zeros((20, 1)), qpos=np.cos(time)[:, None])
    layer = (np.zeros((3, 1), np.float32), np.zeros(1, np.float32))
    bounds = {"low": np.array([-1.0]), "high": np.array([1.0])}
    stepper.policies.Policy(
        mean=np.zeros(3), std=np.ones(3), clip=5.0, layers=[layer], activation="tanh", environment={}, **bounds
    ).save(folder / "p.npz")  # fmt: skip
    stepper.sysid.identify(MODEL, folder / "log.npz", ["dof_damping[my hinge]"], channels=["qpos"], starts=1).save(folder / "i.json")
    sim = stepper.Stepper(MODEL)
    with sim.record(folder / "run"):
        for _ in range(20):
            sim.step()
    stepper.lab.sweep(folder / "study.toml", folder / "out", cliffs=False)
    return folder


def segments(path, _):
    return list(stepper.recording.segments(path.parent))


def viewed(path, _):
    from stepper.viewer.player import RecordedRun

    return len(RecordedRun(path.parent))


def replayed(path, _):
    return stepper.recording.verify(path.parent)


def from_file(path, _):
    return stepper.Model.from_file(path)


def swept(path, _):
    return stepper.lab.sweep(path.parents[2] / "study.toml", path.parents[1], cliffs=False)


READERS = [
    *[(name, lambda path, _: stepper.load(path)) for name in ("m.xml", "m.urdf", "m.stepper", "m.mjb")],
    ("m.stepper", from_file),
    ("s.toml", lambda path, _: stepper.SensorModel.from_file(path)),
    ("s.json", lambda path, _: stepper.SensorModel.from_file(path)),
    ("a.toml", lambda path, _: stepper.ActuatorModel.from_file(path)),
    ("study.toml", lambda path, _: Study.from_file(path)),
    ("log.csv", episodes_of),
    ("log.npz", episodes_of),
    ("p.npz", lambda path, _: stepper.policies.load(path)),
    ("i.json", Identification.load),
    *[(f"run/{name}", read) for name in ("run.json", "model.stepper", "rows.bin") for read in (replayed, segments, viewed)],
    ("out/study/journal.sqlite", swept),
    ("out/study/resolved_settings.json", swept),
]
"""Every public function that reads a file, with the file that it reads, called with its path and the model of the files."""


@pytest.fixture
def work(files, tmp_path):
    """A copy of the files, which a test may damage."""
    shutil.copytree(files, tmp_path / "work")
    return tmp_path / "work"


def refuse(path, read, model, *, may_pass=False):
    """Reads a file, which must raise an error that names the file."""
    try:
        read(path, model)
    except (ValueError, OSError) as error:
        assert path.name in str(error), error
        assert len(str(error)) < 2000
    else:
        assert may_pass


@pytest.mark.parametrize(("name", "read"), READERS)
def test_files_that_are_missing_empty_or_of_another_kind_are_named(work, name, read):
    path = work / name
    whole = path.read_bytes()
    # A study without a journal begins anew, and empty tables are those of ideal sensors.
    new, tables = name.startswith("out"), Path(name).suffix == ".toml" and name != "study.toml"
    for content in (b"", bytes(100), b"hello\n", bytes(range(256)), whole.replace(b"e", b"\xe9", 3)):
        path.write_bytes(content)
        refuse(path, read, MODEL, may_pass=new or content == whole or (tables and not content))
    path.write_bytes(whole)
    read(path, MODEL)
    path.unlink()
    refuse(path, read, MODEL, may_pass=new)
    if not new:
        path.mkdir()
        refuse(path, read, MODEL)


@pytest.mark.parametrize(("name", "read"), [reader for reader in READERS if "/" not in reader[0] and reader[1] is not from_file])
def test_names_that_no_file_system_takes_are_refused_in_few_words(work, name, read):
    with pytest.raises((ValueError, OSError), match=r"there is no .* file .*xxx\.\.\.xxx") as error:
        read(work / ("x" * 5000 + Path(name).suffix), MODEL)
    assert len(str(error.value)) < 1000


@settings(max_examples=6)
@given(data=st.data())
@pytest.mark.parametrize(("name", "read"), READERS)
def test_files_that_are_cut_or_damaged_are_named_or_read(*, files, tmp_path_factory, name, read, data):
    """A cut text may be whole, and a changed byte may be that of a date."""
    whole = (files / name).read_bytes()
    content = bytearray(whole[: data.draw(st.integers(0, len(whole)))])
    for place, byte in data.draw(st.dictionaries(st.integers(0, len(whole)), st.integers(0, 255), max_size=3)).items():
        content[place : place + 1] = bytes([byte])
    work = tmp_path_factory.mktemp("damaged") / "work"
    shutil.copytree(files, work)
    (work / name).write_bytes(content)
    refuse(work / name, read, MODEL, may_pass=True)


def test_a_study_in_python_is_named_when_it_is_no_text(tmp_path):
    for number, content in enumerate((b"\xff\xfe", b"\0", b"study = 3\n", b"")):
        file = tmp_path / f"study{number}.py"
        file.write_bytes(content)
        with pytest.raises((ValueError, SyntaxError)) as error:
            Study.from_file(file)
        assert file.name in str(error.value) or error.value.filename == str(file)


@pytest.mark.parametrize("words", [
    ["explain", "m.xml"], ["chart", "m.xml"], ["view", "m.xml"],
    ["tune", "m.xml", "--error", "1 mm", "--horizon", "1 s"], ["sweep", "study.toml"], ["rank", "study.toml"], ["report", "study.toml"],
    ["view", "study.toml"],
    ["replay", "run"], ["view", "run"],
    ["evaluate", "p.npz", "stepper/Hopper-v5"], ["identify", "m.xml", "log.csv", "-p", "body_mass[pole]"],
])  # fmt: skip
@pytest.mark.parametrize("content", [b"\xff\xfe\0{", None], ids=["damaged", "missing"])
def test_commands_name_files_and_show_no_traceback(work, capsys, monkeypatch, words, content):
    file = {"run": "run/run.json"}.get(words[1], words[2] if words[0] == "identify" else words[1])
    (work / file).write_bytes(content) if content else (work / file).unlink()
    monkeypatch.chdir(work)
    monkeypatch.setattr(sys, "argv", ["stepper", *words])
    with pytest.raises(SystemExit) as end:
        main()
    told = capsys.readouterr().err
    assert end.value.code == 1
    assert Path(file).name in told
    assert "Traceback" not in told
    assert content or (re.search("there is no (.* )?file|is a folder without", told) and "Errno" not in told)


def forged(name, header, data, method=zipfile.ZIP_STORED):
    """Bytes of an .npz file with an array whose header may not fit its data."""
    stream, member = io.BytesIO(), io.BytesIO()
    np.lib.format.write_array_header_1_0(member, {"descr": "<f8", "fortran_order": False} | header)
    with zipfile.ZipFile(stream, "w", method) as archive:
        archive.writestr(f"{name}.npy", member.getvalue() + data)
    return bytearray(stream.getvalue())


@pytest.mark.parametrize("shape", [(10**12,), (10**6, 10**6), (2**62, 4), (3,), (0,)])
def test_a_shape_takes_no_more_memory_than_the_file_has_numbers(tmp_path, shape):
    (tmp_path / "c.npz").write_bytes(forged("ctrl", {"shape": shape}, bytes(16)))
    raises(ValueError, r"c\.npz: the array 'ctrl' has the shape .*, but another number of bytes", read_arrays, tmp_path / "c.npz", "log")


def test_a_size_takes_no_more_memory_than_compression_allows(tmp_path):
    """A member that claims a petabyte, with a shape that fits."""
    data = forged("ctrl", {"shape": (10**15 // 8,)}, b"")
    for place in (i for i in range(len(data) - 4) if data[i : i + 4] == b"PK\x01\x02"):
        data[place + 24 : place + 28] = b"\xfe\xff\xff\xff"
    (tmp_path / "c.npz").write_bytes(data)
    raises(ValueError, r"c\.npz: the array 'ctrl' has more bytes than a file of \d+ bytes can have", read_arrays, tmp_path / "c.npz", "log")


def test_the_mesh_of_a_urdf_may_have_a_name_that_no_file_system_takes(tmp_path):
    mesh = f'<collision><geometry><mesh filename="{"x" * 5000}.stl"/></geometry></collision>'
    (tmp_path / "r.urdf").write_text(URDF.format(pole=link("pole", mesh)))
    with pytest.raises(stepper.ModelError, match=r'r\.urdf: link "pole": mesh xxx.*\.\.\..*xxx\.stl not found; searched') as error:
        stepper.load(tmp_path / "r.urdf")
    assert len(str(error.value)) < 2000


# Writing


def test_errors_of_writing_name_the_file_and_a_remedy(tmp_path):
    """At a limit of file sizes, as on a full disk: the system's error has no name then."""
    (tmp_path / "kept.json").write_text("before")
    with disk_of(10_000):
        for write in (
            lambda path: write_text(path, "x" * 20_000),
            lambda path: write_arrays(path, {"x": np.zeros(10_000)}),
            lambda path: write_arrays(path, {"x": np.random.default_rng(0).normal(size=10_000)}, compressed=True),
        ):
            with pytest.raises(OSError, match=r"File too large; raise the limit .* another path: .*kept\.json") as error:
                write(tmp_path / "kept.json")
            assert error.value.errno == errno.EFBIG
            assert os_error_message(error.value).startswith(f"{str(tmp_path / 'kept.json')!r} cannot be used: file too large; raise")
    assert (tmp_path / "kept.json").read_text() == "before"
    assert [file.name for file in tmp_path.iterdir()] == ["kept.json"]


def test_a_full_disk_is_named_with_a_remedy():
    message = "No space left on device; free space on the disk, or give another path: '/dev/full'"
    with pytest.raises(OSError, match=message), os_errors_of("/dev/full"), open("/dev/full", "wb", buffering=0) as file:
        file.write(b"x")


def test_every_file_that_the_package_writes_is_written_by_one_module():
    """`stepper.shared.files` adds the name of the file to errors. Two modules append to files, and name them by `os_errors_of`."""
    package = Path(stepper.__file__).parent
    allowed = {"shared/files.py", "recording/recorder.py", "policies/ppo.py"}
    for file in package.rglob("*.py"):
        text = file.read_text()
        name = str(file.relative_to(package))
        for call in (".write_text(", ".write_bytes(", '.open("w', '.open("a', "np.savez(", "np.savez_compressed(", ".savefig("):
            written = call == "np.savez(" and name == "recording/format.py"  # To memory.
            assert call not in text or name in allowed or written, f"{name} has {call}, use stepper.shared.files"


# Locks


def folders_of_commands():
    """Commands with an output folder, and the arguments with which they run."""
    return {
        "sweep": ["sweep", "study.toml"],
        "rank": ["rank", "study.toml"],
        "report": ["report", "study.toml"],
        "tune": ["tune", "study.toml", "--error", "1 mm", "--horizon", "0.1 s"],
        "chart": ["chart", "study.toml"],
        "explain": ["explain", "study.toml"],
        "calibrate": ["calibrate", "study.toml", "--margin", "0.1"],
        "identify": ["identify", "m.xml", "log.csv", "-p", "dof_damping[my hinge]"],
        "demo": ["demo", "--num-envs", "1"],
    }


def test_every_command_with_an_output_folder_is_in_the_list():
    """Without `train`, which tests without PyTorch cannot run: tests/policies/test_runs.py."""
    commands = {command.name: inspect.signature(command.callback).parameters for command in application().registered_commands}
    assert {name for name, parameters in commands.items() if "out" in parameters} == folders_of_commands().keys()
    assert len(commands) == len(COMMANDS)


@pytest.mark.parametrize("words", folders_of_commands().values(), ids=" ".join)
def test_a_command_refuses_a_folder_that_another_run_writes(work, capsys, monkeypatch, words):
    monkeypatch.chdir(work)
    folder = Path("new") if words[0] in ("compare", "identify", "demo") else Path("new/study")
    monkeypatch.setattr(sys, "argv", ["stepper", *words, "--out", "new"])
    with locked(folder), pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 1
    assert f"stepper: {folder}: another run writes to this folder; wait for it, or choose another folder" in capsys.readouterr().err
    assert {file.name for file in folder.iterdir()} == {LOCK}


def test_a_lock_ends_with_its_block_and_with_its_process(tmp_path):
    with locked(tmp_path / "out") as folder, pytest.raises(BlockingIOError), locked(folder):
        pass
    program = "import sys; from pathlib import Path; from stepper.shared.files import lock_of; lock = lock_of(Path(sys.argv[1]))"
    wait = "; print('locked', flush=True); input()"
    with subprocess.Popen(
        [sys.executable, "-c", program + wait, str(tmp_path / "out")], stdout=subprocess.PIPE, stdin=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "locked\n"
        with pytest.raises(BlockingIOError, match="another run writes to this folder"), locked(tmp_path / "out"):
            pass
        process.kill()
    with locked(tmp_path / "out"):
        pass


def test_a_folder_that_cannot_be_locked_is_an_error_with_a_remedy(tmp_path):
    (tmp_path / LOCK).mkdir()
    with (
        pytest.raises(OSError, match=r"cannot be locked .*; choose a folder that can be written, on a file system with locks"),
        locked(tmp_path),
    ):
        pass
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match=r"; give .*/file"), locked(tmp_path / "file"):
        pass


# Names


@pytest.mark.parametrize("name", ESCAPES)
def test_a_study_stays_in_its_output_folder(tmp_path, name):
    raises(ValueError, r"name (is|has) .*the folder of the results: choose", Study, model=MODEL, name=name)
    if name.isprintable():
        (tmp_path / "study.toml").write_text(f'name = {json.dumps(name)}\nmodel = "m.xml"\n')
        raises(ValueError, r"study\.toml: name (is|has) .*the folder of the results", Study.from_file, tmp_path / "study.toml")


@given(st.text(max_size=20))
def test_a_name_is_refused_or_is_one_folder(name):
    try:
        Study(model=stepper.load, name=name)
    except ValueError:
        return
    except TypeError as error:
        assert "model" in str(error)
    path = Path("out") / name
    assert path.parent == Path("out")
    assert path.name == name


@pytest.mark.parametrize("name", ["study", "grasp: slow", "a b", ".hidden", "é", "v1.2"])
def test_usual_names_are_taken(name):
    assert Study(model=MODEL, name=name).name == name


def test_the_folder_of_a_run_is_one_folder():
    assert default_folder(Settings(env="stepper/Hopper-v5", seed=2)) == Path("out/train/stepper_Hopper-v5/seed2")
    assert default_folder(Settings(env="../../x", values={"a": "../b"})) == Path("out/train/.._.._x_a=.._b/seed1")
    with pytest.raises(ValueError, match=r"the task with its --values has .* bytes, must have at most 200"):
        default_folder(Settings(env="stepper/Hopper-v5", values={"a": "x" * 300}))


@pytest.mark.parametrize(("measure", "quantity", "name", "axis"), [
    ("joint my hinge", "qpos", "my hinge", None), ("jointvel my hinge", "qvel", "my hinge", None),
    ("joint my hinge 0", "qpos", "my hinge", 0), ("body two words z", "xpos", "two words", 2),
    ("body two words", "xpos", "two words", None), ("body  two words  x ", "xpos", "two words", 0),
    ("sensor arm 0", "sensordata", "arm", 0), ("sensor arm 0 0", "sensordata", "arm 0", 0), ("sensor leg 1", "sensordata", "leg 1", None),
])  # fmt: skip
def test_measures_name_elements_whose_names_have_spaces(measure, quantity, name, axis):
    """The last word is an axis if the words before it are a name."""
    two = '<body name="two words"><joint name="my hinge" axis="0 1 0"/><geom size=".1" pos="0 0 1"/></body>'
    names = "".join(f'<jointpos name="{sensor}" joint="my hinge"/>' for sensor in ("arm", "arm 0", "leg 1"))
    model = stepper.load(f"<mujoco><worldbody>{two}</worldbody><sensor>{names}</sensor></mujoco>")
    study = Study(model=model, outcomes=Outcome(name="x", measure=measure), seconds=0.1, qvel_noise=1.0, qpos_noise=1.0)
    world = stepper.Stepper(model, 2)
    world.set_state(qpos=[[0.3], [0.4]], qvel=[[1.0], [2.0]])
    value = np.asarray(world.read(quantity, name)).reshape(2, -1)
    expected = value[:, axis] if axis is not None else value[:, 0] if value.shape[1] == 1 else np.linalg.norm(value, axis=1)
    np.testing.assert_array_equal(study.all_outcomes[0].read(world), expected)


@pytest.mark.parametrize(("measure", "message"), [
    ("joint my hing", "no joint 'my hing'; did you mean my hinge"),
    ("joint my hinge q", "its last word is 'q', must be x, y, z or a number"),
    ("joint", "must be a function or a text such as"), ("", "must be a function or a text such as"),
])  # fmt: skip
def test_measures_of_other_elements_are_refused(measure, message):
    with pytest.raises(ValueError, match=message):
        Study(model=MODEL, outcomes=Outcome(name="x", measure=measure), parameters={"d": Parameter("gravity[2]", low=-10, high=-9)})


# Parts


def test_helpers_keep_errors_that_name_the_file_and_explain_others(tmp_path):
    with pytest.raises(ValueError, match=r"^a\.json: first; do that$"), explained("a.json", "do that"), explained("a.json", "do this"):
        raise ValueError("a.json: first; do that")
    with pytest.raises(ValueError, match=r"^a\.json: key is missing; do that$"), explained("a.json", "do that"):
        raise KeyError("key")
    with pytest.raises(MemoryError), explained("a.json", "do that"):
        raise MemoryError
    (tmp_path / "a.csv").write_bytes(b"\xef\xbb\xbfa,b\r\n1,2\r\n")
    assert read_csv(tmp_path / "a.csv", "log") == [["a", "b"], ["1", "2"]]
    assert read_text(tmp_path / "a.csv", "log").startswith("a,b")
    raises(FileNotFoundError, "there is no log file", existing, tmp_path / ("x" * 300), "log")
    with atomic_write(tmp_path / "new/folder/file") as stream:
        stream.write(b"x")
    assert (tmp_path / "new/folder/file").read_bytes() == b"x"


def test_a_cut_archive_is_refused(tmp_path):
    """As a checkpoint of PyTorch is an archive."""
    file = tmp_path / "checkpoint.pt"
    np.savez(file.with_suffix(".npz"), a=np.arange(1000))
    whole = file.with_suffix(".npz").read_bytes()
    file.write_bytes(whole)
    check_archive(file)
    for content in (b"", whole[:100], whole[:-1], whole[:500] + b"\xff" + whole[501:]):
        file.write_bytes(content)
        raises(ValueError, r"it is (cut off or )?damaged", check_archive, file)


def test_a_journal_is_read_while_its_folder_is_locked(work):
    with locked(work / "out/study"):
        assert len(rows_of(work / "out/study/journal.sqlite")) > 0
    assert os.path.getsize(work / "out/study" / LOCK) == 0
