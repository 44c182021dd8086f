"""URDFs: meshes are found or searched paths listed, joints get servos and motors, every element is simulated, refused or explained."""

import math
import os
import warnings

import numpy as np
import pytest
import stepper
from checks import every, raises
from hypothesis import given, settings, strategies as st
from loading_scenes import LIMIT, arm, joint, link, robot, sphere
from stepper.loading.urdf import VARIABLES
from stepper.loading.urdf_actuators import POSITION_FREQUENCY, VELOCITY_FREQUENCY
from stepper.loading.urdf_elements import LEFT_OUT, READ

OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
NAMES = ("package://robot/meshes/left/hand.obj", "package://robot/meshes/right/hand.obj")


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


@every(scheme=["package", "model"], variable=VARIABLES)
def test_packages_are_found_by_the_environment(package, tmp_path_factory, monkeypatch, scheme, variable):
    away, name = tmp_path_factory.mktemp("away"), f"{scheme}://robot/meshes/left/hand.obj"
    raises(stepper.ModelError, r"hand\.obj not found; searched", lambda: load(away, urdf(name)))
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
    assert load(package / "urdf", urdf(*NAMES).replace("</robot>", "<drake:group/></robot>")).ngeom == 2


def test_a_urdf_has_none_of_its_own():
    assert stepper.load(arm()).nu == 0


@pytest.mark.parametrize("element", ["transmission", "ros2_control"])
def test_an_element_that_names_motors_points_to_actuators_unless_there_are_some(element):
    urdf = robot(link("base"), link("arm"), joint("j", "base", "arm", kind="continuous"), f'<{element} name="x"/>')
    hint = 'stepper.load(..., actuators="position") adds actuators'
    models = stepper.load(urdf), stepper.load(urdf, actuators="position")
    reasons = [[why for kind, _, why in model.omitted if kind == f"URDF {element}"] for model in models]
    assert [len(own) for own in reasons] == [1, 1]
    assert [hint in own[0] for own in reasons] == [True, False]


def test_bounds_are_those_of_the_file():
    position, velocity, torque = (stepper.load(arm(), actuators=kind) for kind in ("position", "velocity", "torque"))
    assert position.actuator_names == ["shoulder", "elbow"]
    assert position.actuator_ctrlrange.tolist() == [[-1, 2]] * 2
    assert velocity.actuator_ctrlrange.tolist() == [[-3, 3]] * 2
    assert torque.actuator_ctrlrange.tolist() == [[-10, 10]] * 2
    assert all(model.actuator_forcerange.tolist() == [[-10, 10]] * 2 for model in (position, velocity, torque))


def test_gains_follow_from_the_inertia_at_the_reference_pose():
    model = stepper.load(arm(), actuators="position")
    inertia = np.diag(stepper.Stepper(model).mass_matrix())
    w = 2 * math.pi * POSITION_FREQUENCY
    np.testing.assert_allclose(model.actuator_gainprm[:, 0], inertia * w**2, rtol=1e-12)  # Rounding.
    np.testing.assert_allclose(model.actuator_biasprm[:, 2], -2 * inertia * w, rtol=1e-12)
    velocity = stepper.load(arm(), actuators="velocity")
    np.testing.assert_allclose(velocity.actuator_gainprm[:, 0], inertia * 2 * math.pi * VELOCITY_FREQUENCY, rtol=1e-12)


def test_a_position_servo_is_critically_damped():
    """Alone and without bounds its angle is that of x'' + 2 w x' + w^2 x = w^2."""
    sim = stepper.Stepper(stepper.load(one_joint(kind="continuous"), actuators="position"), options=stepper.Options(timestep=1e-4))
    sim.step([1.0], nstep=500)
    w, t = 2 * math.pi * POSITION_FREQUENCY, 0.05
    # Second order in w h = 3e-3; 1e-4 leaves an order of magnitude.
    assert sim.qpos[0] == pytest.approx(1 - (1 + w * t) * math.exp(-w * t), abs=1e-4)


def test_a_velocity_servo_reaches_its_speed():
    sim = stepper.Stepper(stepper.load(one_joint(kind="continuous"), actuators="velocity"))
    sim.step([0.7], nstep=100)
    # exp(-w t) of its time constants is left, w t = 2 pi 50 Hz * 0.2 s = 63.
    assert sim.qvel[0] == pytest.approx(0.7, rel=1e-9)


def test_joints_that_follow_another_have_none_and_count():
    follower = joint("g", "arm", "hand", kind="continuous", more='<mimic joint="j" multiplier="2"/>')
    text = robot(link("base"), link("arm"), link("hand"), joint("j", "base", "arm", kind="continuous"), follower)
    model = stepper.load(text, actuators="position")
    assert model.actuator_names == ["j"]
    # Of 1 kg m^2 each: the hand turns three times as fast as the arm.
    assert model.actuator_gainprm[0, 0] == pytest.approx((1 + 3**2) * (2 * math.pi * POSITION_FREQUENCY) ** 2, rel=1e-12)


@pytest.mark.parametrize(
    ("kind", "said"),
    [("velocity", "velocity limit j: the file has no velocity limit"), ("torque", "effort limit j: the file has no effort limit")],
)
def test_controls_without_bounds_have_a_line(kind, said):
    assert said in stepper.load(one_joint(kind="continuous"), actuators=kind).explain()


def test_errors_say_what_to_do():
    raises(ValueError, "actuators is 'servo', must be None or one of 'position'", lambda: stepper.load(arm(), actuators="servo"))
    raises(ValueError, "needs a URDF, and the source is not one", stepper.load, "<mujoco/>", actuators="torque")
    with pytest.raises(stepper.ModelError, match="has no revolute, continuous or prismatic joint; omit the argument actuators"):
        stepper.load(robot('<link name="world"/>', link("a"), joint("f", "world", "a", kind="floating")), actuators="torque")


def test_actuators_are_saved(tmp_path):
    model = stepper.load(arm(), actuators="torque")
    model.save(tmp_path / "arm")
    assert stepper.load(tmp_path / "arm") == model
    assert stepper.load(one_joint(LIMIT), actuators="torque").nu == 1


# Elements of a URDF: each is simulated, an error, or a line of `explain()`.

TOP = {
    "material": '<material name="x"><color rgba="1 0 0 1"/></material>',
    "transmission": '<transmission name="x"><type>t</type><joint name="shoulder"/><actuator name="m"/></transmission>',
    "ros2_control": '<ros2_control name="x" type="system"><hardware/></ros2_control>',
    "gazebo": '<gazebo reference="x"><mu1>0.5</mu1></gazebo>',
    "sensor": '<sensor name="x" type="force_torque"/>',
    "deformable": '<deformable name="x"/>',
    "group": '<group name="x"/>',
}
IN_LINKS = {
    "visual": "<visual><geometry><sphere radius='1'/></geometry></visual>",
    "contact": '<contact><lateral_friction value="1"/></contact>',
    "surface": "<surface><friction/></surface>",
    "self_filter": "<self_filter/>",
    "collision_checking": "<collision_checking/>",
    "kinematic": "<kinematic>1</kinematic>",
}
IN_JOINTS = {
    "safety_controller": '<safety_controller k_velocity="10" soft_lower_limit="-1"/>',
    "calibration": '<calibration rising="0"/>',
    "joint_properties": '<joint_properties damping="1"/>',
    "spring": "<spring/>",
}
READINGS = {
    "damping": ('<dynamics damping="0.5"/>', lambda m: m.dof_damping[0] == 0.5),
    "friction": ('<dynamics friction="0.5"/>', lambda m: m.dof_frictionloss[0] == 0.5),
    "range": ('<limit lower="-1" upper="2" effort="7" velocity="3"/>', lambda m: m.jnt_range[0].tolist() == [-1, 2]),
    "effort": ('<limit lower="-1" upper="2" effort="7" velocity="3"/>', lambda m: m.jnt_actfrcrange[0].tolist() == [-7, 7]),
    "velocity": (
        '<limit lower="-1" upper="2" effort="7" velocity="3"/>',
        lambda m: m.jnt_velocity_limit[0] == m.joint("j").velocity_limit == 3,
    ),
}


def lines(model, part):
    return [line for line in model.explain().splitlines() if part in line]


def one_joint(more="", kind="revolute", arm_more=""):
    return robot(link("base", mass=10), link("arm", arm_more), joint("j", "base", "arm", kind=kind, more=more))


def test_the_mass_of_a_base_on_the_world_has_a_line():
    model = stepper.load(
        robot(
            link("base", mass=10), link("mount", mass=2), link("arm"), joint("f", "base", "mount", kind="fixed"), joint("j", "mount", "arm")
        )
    )
    (line,) = lines(model, "URDF inertial")
    assert "base (10 kg), mount (2 kg): the link is welded to the world" in line
    assert "floating" in line
    free = stepper.load(robot('<link name="world"/>', link("base", mass=10), joint("f", "world", "base", kind="floating")))
    assert lines(free, "URDF inertial") == []
    assert free.body_mass.tolist() == [0, 10]


@pytest.mark.parametrize("name", READINGS)
def test_what_is_simulated_is_in_the_model(name):
    more, is_there = READINGS[name]
    assert is_there(stepper.load(one_joint(more)))


def test_mimic_is_an_equality():
    mimic = '<mimic joint="shoulder" multiplier="-0.5" offset="0.25"/>'
    model = stepper.load(
        robot(
            link("b"),
            link("a"),
            link("c"),
            joint("shoulder", "b", "a", kind="continuous"),
            joint("elbow", "a", "c", kind="continuous", more=mimic),
        )
    )
    assert model.eq_data[0, :2].tolist() == [0.25, -0.5]


def test_speed_limits_are_kept_and_explained(tmp_path):
    model = stepper.load(arm())
    assert model.jnt_velocity_limit.tolist() == [3, 3]
    assert lines(model, "speed limits of 2 joints (shoulder, elbow)")
    model.save(tmp_path / "arm")
    assert stepper.load(tmp_path / "arm").jnt_velocity_limit.tolist() == [3, 3]
    assert model.replace(jnt_velocity_limit=[np.inf, 2]).jnt_velocity_limit.tolist() == [np.inf, 2]
    assert stepper.load("<mujoco><worldbody><body><joint/><geom size='1'/></body></worldbody></mujoco>").jnt_velocity_limit.tolist() == [
        np.inf
    ]


@pytest.mark.parametrize(("more", "kind", "said"), [
    ('<limit lower="1" upper="-1" effort="1" velocity="1"/>', "revolute", "URDF range j: from 1 to -1 is empty"),
    ("", "prismatic", "URDF range j: from 0 to 0 is empty"),
    ('<limit lower="1" upper="2" effort="1" velocity="1"/>', "continuous", "URDF range j: a continuous joint has no limits"),
    (LIMIT.replace("10", "0"), "revolute", "URDF effort limit j: is 0, which counts as none"),
    (LIMIT.replace('velocity="3"', 'velocity="0"'), "revolute", "URDF velocity limit j: is 0, which counts as none"),
    (LIMIT.replace('velocity="3"', 'velocity="-1"'), "revolute", "URDF velocity limit j: is -1, which counts as none"),
    (LIMIT.replace('velocity="3"', 'velocity="inf"'), "revolute", "URDF velocity limit j: is inf, which counts as none"),
    ('<limit lower="-1" upper="2" effort="10" velocity="3" jerk="9"/>', "revolute", "URDF limit attribute jerk j"),
    ('<dynamics damping="1" spring_stiffness="2"/>', "continuous", "URDF dynamics attribute spring_stiffness j"),
])  # fmt: skip
def test_limits_and_attributes_that_are_not_what_they_seem_have_a_line(more, kind, said):
    with warnings.catch_warnings(action="ignore"):
        assert lines(stepper.load(one_joint(more, kind)), said)


@pytest.mark.parametrize(("text", "said"), [
    (one_joint(LIMIT.replace('velocity="3"', 'velocity="fast"')), r'XML text: joint "j": limit velocity is "fast"; give a number'),
    (one_joint(LIMIT.replace('velocity="3"', 'velocity="nan"')), r'"nan"; give a number'),
    ('<robot name="r" xmlns:xacro="x"><xacro:include filename="f"/></robot>', "expand it: xacro FILE"),
    (one_joint("", "wobbly"), "invalid joint type"),
    (one_joint(arm_more="<collision><geometry><cone/></geometry></collision>"), "geometry"),
])  # fmt: skip
def test_what_cannot_be_read_is_an_error(text, said):
    raises(stepper.ModelError, said, stepper.load, text)


def test_text_that_is_not_well_formed_says_that_it_lists_nothing():
    text = one_joint().replace("</robot>", "<!-- -- --></robot>")  # XML allows no -- in a comment.
    assert lines(stepper.load(text), "not well-formed")
    raises(stepper.ModelError, "the XML is not well-formed", stepper.load, text, actuators="position")


def test_prefixes_without_a_namespace_are_read():
    """As of Drake: MuJoCo's parser does not know namespaces."""
    limit = LIMIT.replace("<limit", '<limit drake:acceleration="2"')
    text = "\n" + one_joint(limit).replace("</robot>", '<drake:collision_filter_group name="left"/></robot>')
    model = stepper.load(text, actuators="position")
    assert model.nu == 1
    assert lines(model, "URDF limit attribute drake:acceleration j")
    assert lines(model, "URDF drake:collision_filter_group left")


@settings(max_examples=50, deadline=None)
@given(
    st.sets(st.sampled_from(sorted(TOP))), st.sets(st.sampled_from(sorted(IN_LINKS))), st.sets(st.sampled_from(sorted(IN_JOINTS))),
    st.sampled_from(["base", "arm"]),
)  # fmt: skip
def test_every_element_that_is_not_simulated_is_named(top, in_link, in_joint, owner):
    more = "".join(IN_LINKS[name] for name in sorted(in_link))
    base, other = (more, sphere(0.1)) if owner == "base" else (sphere(0.1), more)
    elements = "".join(TOP[name] for name in sorted(top))
    text = robot(
        elements,
        link("base", base),
        link("arm", other),
        joint("j", "base", "arm", x=1, more=LIMIT + "".join(IN_JOINTS[n] for n in sorted(in_joint))),
    )
    model = stepper.load(text)
    expected = {(f"URDF {n}", "x") for n in top} | {(f"URDF {n}", owner) for n in in_link} | {(f"URDF {n}", "j") for n in in_joint}
    assert {(kind, name) for kind, name, _ in model.omitted if kind != "URDF inertial"} == expected
    report = model.explain()
    assert all(f"{kind} {name}: " in report for kind, name in expected)


def test_no_element_is_both_read_and_left_out():
    assert not READ.keys() & LEFT_OUT.keys()
    assert all(path.rpartition("/")[0] in READ for path in [*READ, *LEFT_OUT] if path != "robot")
