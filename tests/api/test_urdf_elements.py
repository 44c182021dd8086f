"""Elements of a URDF: each is simulated, an error, or a line of `explain()`."""

import warnings

import numpy as np
import pytest
import stepper
from hypothesis import given, settings
from hypothesis import strategies as st
from loading_scenes import LIMIT, arm, joint, link, robot, sphere
from stepper.loading.urdf_elements import LEFT_OUT, READ

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
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert lines(stepper.load(one_joint(more, kind)), said)


@pytest.mark.parametrize(("text", "said"), [
    (one_joint(LIMIT.replace('velocity="3"', 'velocity="fast"')), r'XML text: joint "j": limit velocity is "fast"; give a number'),
    (one_joint(LIMIT.replace('velocity="3"', 'velocity="nan"')), r'"nan"; give a number'),
    ('<robot name="r" xmlns:xacro="x"><xacro:include filename="f"/></robot>', "expand it: xacro FILE"),
    (one_joint("", "wobbly"), "invalid joint type"),
    (one_joint(arm_more="<collision><geometry><cone/></geometry></collision>"), "geometry"),
])  # fmt: skip
def test_what_cannot_be_read_is_an_error(text, said):
    with pytest.raises(stepper.ModelError, match=said):
        stepper.load(text)


def test_text_that_is_not_well_formed_says_that_it_lists_nothing():
    text = one_joint().replace("</robot>", "<!-- -- --></robot>")  # XML allows no -- in a comment.
    compiled = stepper.load(text)
    assert lines(compiled, "not well-formed")
    with pytest.raises(stepper.ModelError, match="the XML is not well-formed"):
        stepper.load(text, actuators="position")


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
