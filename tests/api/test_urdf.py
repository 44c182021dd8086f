"""URDFs with meshes: `package://` and relative names are found, or the message lists the paths searched."""

import os

import numpy as np
import pytest
import stepper
from stepper.loading.urdf import VARIABLES

OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'


def urdf(*names, extension=""):
    meshes = "".join(f'<collision><geometry><mesh filename="{name}"/></geometry></collision>' for name in names)
    visual = '<visual><geometry><mesh filename="package://nowhere/painted.dae"/></geometry></visual>'
    links = f'<link name="base">{INERTIAL}</link><link name="arm">{INERTIAL}{visual}{meshes}</link>'
    joint = '<joint name="j" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/></joint>'
    return f'<robot name="r">{extension}{links}{joint}</robot>'


@pytest.fixture
def package(tmp_path):
    """A package as ROS has them: robot/urdf/robot.urdf beside robot/meshes, with two meshes of one name."""
    for folder in ("urdf", "meshes/left", "meshes/right"):
        (tmp_path / "robot" / folder).mkdir(parents=True)
    (tmp_path / "robot/meshes/left/hand.obj").write_text(OBJ)
    (tmp_path / "robot/meshes/right/hand.obj").write_text(OBJ.replace("1 0 0", "2 0 0"))
    return tmp_path / "robot"


def load(folder, text, **arguments):
    file = folder / "robot.urdf"
    file.write_text(text)
    return stepper.load(file, **arguments)


NAMES = ("package://robot/meshes/left/hand.obj", "package://robot/meshes/right/hand.obj")


def test_packages_are_found_in_the_folders_above_the_file(package):
    model = load(package / "urdf", urdf(*NAMES))
    assert model.ngeom == 2
    assert not np.array_equal(model.geom_pos[0], model.geom_pos[1])


def test_relative_names_begin_at_the_file(package):
    assert load(package / "urdf", urdf("../meshes/left/hand.obj")).ngeom == 1
    assert load(package, urdf("meshes/left/hand.obj")).ngeom == 1
    assert load(package / "meshes/left", urdf("hand.obj")).ngeom == 1
    # MuJoCo's compiler alone finds a mesh beside the file, whatever folder its name has.
    assert load(package / "meshes/left", urdf("elsewhere/hand.obj")).ngeom == 1


@pytest.mark.parametrize("up", [0, 1])
def test_package_dirs_are_the_package_or_the_folder_above(package, tmp_path_factory, up):
    away = tmp_path_factory.mktemp("away")
    folder = [package, package.parent][up]
    assert load(away, urdf(*NAMES), package_dirs=[away, str(folder)]).ngeom == 2
    assert stepper.load(urdf(*NAMES), package_dirs=[folder]).ngeom == 2
    assert stepper.load(urdf("meshes/left/hand.obj"), package_dirs=[package]).ngeom == 1


def test_a_mesh_that_is_nowhere_is_named_with_the_places(package, tmp_path):
    with pytest.raises(stepper.ModelError) as error:
        load(package / "urdf", urdf("package://hands/left.obj"))
    for part in (
        "robot.urdf",
        'link "arm": mesh package://hands/left.obj not found',
        str(tmp_path / "hands/left.obj"),
        "package_dirs=[...]",
        "the folder that contains the package hands",
    ):
        assert part in str(error.value)
    with pytest.raises(stepper.ModelError) as error:
        load(package / "urdf", urdf(*NAMES), package_dirs=[tmp_path / "other"])
    assert str(tmp_path / "other/robot/meshes/left/hand.obj") in str(error.value)
    with pytest.raises(stepper.ModelError, match=r"XML text: link \"arm\": mesh a/b\.obj not found; searched no folder.*package_dirs"):
        stepper.load(urdf("a/b.obj"))


def test_a_file_can_say_where_its_meshes_are(package):
    for compiler in ('meshdir="../meshes"', 'assetdir="../meshes" discardvisual="true"'):
        extension = f"<mujoco><compiler {compiler}/></mujoco>"
        assert load(package / "urdf", urdf("left/hand.obj", "right/hand.obj", NAMES[0], extension=extension)).ngeom == 3
    extension = '<mujoco><compiler strippath="true" meshdir="../meshes/left"/></mujoco>'
    assert load(package / "urdf", urdf("package://anything/hand.obj", extension=extension)).ngeom == 1


def test_a_mesh_beside_the_file_that_is_missing_is_named_too(package):
    with pytest.raises(stepper.ModelError, match=r'robot\.urdf: link "arm": mesh gone\.obj not found; searched .*gone\.obj'):
        load(package, urdf("gone.obj"))


@pytest.mark.parametrize("scheme", ["package", "model"])
@pytest.mark.parametrize("variable", VARIABLES)
def test_packages_are_found_by_the_environment(package, tmp_path_factory, monkeypatch, scheme, variable):
    away, name = tmp_path_factory.mktemp("away"), f"{scheme}://robot/meshes/left/hand.obj"
    with pytest.raises(stepper.ModelError, match=r"hand\.obj not found; searched"):
        load(away, urdf(name))
    folder = package.parent
    if inner := VARIABLES[variable]:
        (folder / inner).symlink_to(folder)
    monkeypatch.setenv(variable, f"{away}{os.pathsep}{folder}")
    assert load(away, urdf(name)).ngeom == 1
    assert stepper.load(urdf(name), package_dirs=[away]).ngeom == 1


def test_what_the_user_gives_comes_before_the_environment(package, tmp_path_factory, monkeypatch):
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(package.parent))
    other = tmp_path_factory.mktemp("other")
    (other / "robot/meshes/left").mkdir(parents=True)
    (other / "robot/meshes/left/hand.obj").write_text(OBJ.replace("1 0 0", "3 0 0"))
    given, found = stepper.load(urdf(NAMES[0]), package_dirs=[other]), stepper.load(urdf(NAMES[0]))
    assert given.geom_pos[0, 0] > found.geom_pos[0, 0]


@pytest.mark.parametrize("prefix", ["file://", "file:"])
def test_file_names_are_absolute_or_begin_at_the_file(package, prefix):
    for name in (f"{package}/meshes/left/hand.obj", "../meshes/left/hand.obj"):
        assert load(package / "urdf", urdf(prefix + name)).ngeom == 1
    (package / "meshes/my hand.obj").write_text(OBJ)
    assert load(package / "urdf", urdf(f"{prefix}{package}/meshes/my%20hand.obj")).ngeom == 1


def test_prefixes_without_a_namespace_do_not_hide_meshes(package):
    text = urdf(*NAMES).replace("</robot>", "<drake:group/></robot>")
    assert load(package / "urdf", text).ngeom == 2
