"""Requests of sources: floor and free base that `stepper.load` adds, `mujoco.MjSpec`, and what a source asks for and does not get."""

import math
import pickle
import warnings
from pathlib import Path

import mujoco
import numpy as np
import pytest
import stepper
from checks import raises
from hypothesis import given, settings, strategies as st
from loading_scenes import joint, link, robot, sphere
from models import SOURCES, simulate, stepper_model
from stepper.loading import origin_of
from stepper.loading.mjcf import describe, requested
from stepper.viewer.looks import looks_of

ROOT = Path(__file__).parents[2]
QUADRUPED = ROOT / "examples/quadruped.urdf"
BALL = "<mujoco><worldbody><body pos='0 0 .5'><freejoint/><geom name='ball' size='.1'/></body></worldbody></mujoco>"
OBJ = "v -.2 -.1 -.3\nv .2 -.1 -.3\nv 0 .2 -.3\nv 0 0 .3\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
PLANE = "<geom {} type='plane' size='1 1 1'/>"


def test_a_quadruped_stands_with_position_servos():
    """Within 0.1 rad and 2 cm of its pose: each leg bears a quarter of 13.8 kg, which deflects servos of 96 N m/rad by up to 0.06 rad."""
    model = stepper.load(QUADRUPED, floor=True, free_base=True, actuators="position")
    pose = {"hip": 0.0, "thigh": 0.7, "calf": -1.4}
    qpos = model.qpos0.copy()
    qpos[7:] = [pose[name.rpartition("_")[2]] for name in model.joint_names[1:]]
    sim = stepper.Stepper(model)
    sim.reset(qpos=qpos)
    sim.step(qpos[7:], nstep=1000)
    assert sim.status == 0
    assert np.abs(sim.qpos[7:] - qpos[7:]).max() < 0.1
    assert abs(sim.qpos[2] - (0.02 + 2 * 0.2 * math.cos(0.7))) < 0.02
    assert np.abs(sim.qvel).max() < 0.05
    feet = sim.contacts()
    assert set(feet["geom"][:, 0]) == {model.geom("floor").id}
    weight = 9.81 * model.body_mass.sum()
    assert feet["force"][:, 0].sum() == pytest.approx(weight, rel=0.02)  # It still settles at up to 0.05 m/s.


def test_the_links_of_a_free_base_keep_their_mass():
    parts = (link("base", sphere(0.1), mass=3), link("trunk", mass=10), link("arm"))
    text = robot(*parts, joint("f", "base", "trunk", kind="fixed"), joint("j", "trunk", "arm"))
    assert stepper.load(text).body_mass.sum() == pytest.approx(1.0)
    free = stepper.load(text, free_base=True)
    assert free.body_mass.sum() == pytest.approx(14.0)
    assert [free.joint(k).type for k in range(free.njnt)] == ["free", "hinge"]
    assert not [kind for kind, *_ in free.omitted if kind == "URDF inertial"]
    assert "free_base=True" in stepper.load(text).explain()


@settings(max_examples=30, deadline=None)
@given(
    shape=st.sampled_from(["box", "sphere", "cylinder", "mesh"]),
    size=st.floats(0.05, 0.5),
    pose=st.tuples(*[st.floats(-3, 3)] * 6),
    floor=st.floats(-2, 2),
)
def test_a_free_base_starts_on_the_floor(shape, size, pose, floor, tmp_path_factory):
    """Its lowest point is at the height of the floor within 1e-6 m (MuJoCo's meshes have 32 bits), whatever geom the robot has."""
    geometry = {
        "box": f'<box size="{size} {size / 2} {2 * size}"/>', "sphere": f'<sphere radius="{size}"/>',
        "cylinder": f'<cylinder radius="{size}" length="{size}"/>', "mesh": '<mesh filename="m.obj"/>',
    }[shape]  # fmt: skip
    folder = tmp_path_factory.mktemp("robot")
    (folder / "m.obj").write_text(OBJ)
    origin = f'<origin xyz="{pose[0]} {pose[1]} {pose[2]}" rpy="{pose[3]} {pose[4]} {pose[5]}"/>'
    file = folder / "robot.urdf"
    file.write_text(robot(link("base", f"<collision>{origin}<geometry>{geometry}</geometry></collision>")))
    model = stepper.load(file, floor=floor, free_base=True)
    qpos = model.qpos0.copy()
    qpos[2] -= 1e-4
    assert simulate(model, qpos=qpos).contacts()["distance"].min() == pytest.approx(-1e-4, abs=1e-6)


@pytest.mark.parametrize("height", [True, 0, 0.0, -0.25, np.float32(0.5)])
def test_a_ball_falls_on_the_floor(height):
    model = stepper.load(BALL, floor=height)
    sim = simulate(model, steps=2000)
    expected = 0.0 if height is True else float(height)
    assert sim.qpos[2] == pytest.approx(expected + 0.1, abs=2e-5)  # The position correction leaves up to 1e-5 m.
    assert model.geom("floor").type == "plane"


def test_no_floor_is_the_default():
    assert stepper.load(BALL).ngeom == stepper.load(BALL, floor=False).ngeom == 1


def test_a_floor_of_a_file_with_a_folder_of_meshes(tmp_path):
    """A file that sets its own `meshdir` needs no other than itself."""
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts/m.obj").write_text(OBJ)
    asset = '<compiler meshdir="parts"/><asset><mesh name="m" file="m.obj"/></asset>'
    body = '<worldbody><body pos="0 0 1"><freejoint/><geom type="mesh" mesh="m"/></body></worldbody>'
    (tmp_path / "robot.xml").write_text(f"<mujoco>{asset}{body}</mujoco>")
    assert stepper.load(tmp_path / "robot.xml", floor=True).ngeom == 2
    (tmp_path / "robot.urdf").write_text(
        robot(
            '<mujoco><compiler meshdir="parts"/></mujoco>',
            link("base", '<collision><geometry><mesh filename="m.obj"/></geometry></collision>'),
        )
    )
    assert stepper.load(tmp_path / "robot.urdf", floor=True, free_base=True).ngeom == 2


def test_a_floor_and_a_free_base_are_drawn(tmp_path):
    model = stepper.load(QUADRUPED, floor=-0.1, free_base=True)
    m = looks_of(model)
    assert m.geom("floor").pos[2] == -0.1
    assert np.array_equal(m.qpos0, model.qpos0)
    sim = stepper.Stepper(model)
    with sim.record(tmp_path / "run"):
        sim.step(nstep=2)
    from stepper.viewer.player import RecordedRun

    seen = RecordedRun(tmp_path / "run")
    assert seen.source == origin_of(model)
    assert looks_of(seen.sim.model, seen.source).ngeom == model.ngeom


def test_a_spec_is_a_source():
    spec = mujoco.MjSpec.from_string(BALL)
    model = stepper.load(spec)
    assert model.ngeom == 1
    assert stepper.load(spec, floor=True).ngeom == 2
    assert len(spec.geoms) == 1  # The spec of the caller does not change.
    spec.worldbody.add_geom(name="mark", size=[0.1, 0, 0])
    assert looks_of(model).ngeom == 1
    assert stepper.load(spec).geom_names == ["mark", "ball"]
    spec.worldbody.add_geom(size=[0, 0, 0])
    raises(stepper.ModelError, r"mujoco\.MjSpec: MuJoCo's compiler cannot read it: .*size", stepper.load, spec)


@pytest.mark.parametrize(("arguments", "more", "error", "said"), [
    ({"floor": True}, PLANE.format("name='ground'"), stepper.ModelError, r"XML text: floor is 0, and the plane ground .* omit"),
    ({"floor": 0.5}, PLANE.format("euler='20 0 0'"), stepper.ModelError, r"floor is 0\.5, and the plane #0 of the model faces upward"),
    ({"floor": True}, "<geom name='floor' size='1'/>", stepper.ModelError, r'the model has a geom "floor" already'),
    ({"floor": math.nan}, "", ValueError, "floor is nan, must be finite"),
    ({"floor": "yes"}, "", TypeError, "floor is 'yes', must be True, False or a height in m"),
    ({"free_base": True}, "", ValueError, "free_base is True, which needs a URDF, .* <freejoint/>"),
    ({"free_base": 1}, "", TypeError, "free_base is 1"),
])  # fmt: skip
def test_a_floor_that_cannot_be_added_is_an_error(arguments, more, error, said):
    raises(error, said, lambda: stepper.load(BALL.replace("<worldbody>", f"<worldbody>{more}"), **arguments))


def test_a_wall_is_no_floor():
    assert stepper.load(BALL.replace("<worldbody>", "<worldbody>" + PLANE.format("euler='90 0 0'")), floor=True).ngeom == 3


def test_compiled_and_saved_models_get_no_floor(tmp_path):
    stepper.load(BALL).save(tmp_path / "saved")
    m = mujoco.MjModel.from_xml_string(BALL)
    mujoco.mj_saveModel(m, str(tmp_path / "ball.mjb"))
    for source in (tmp_path / "saved", m, tmp_path / "ball.mjb"):
        raises(ValueError, r"floor is True, which needs MJCF, URDF or a mujoco\.MjSpec", stepper.load, source, floor=True)


@pytest.mark.parametrize(("text", "said"), [
    (robot('<link name="world"/>', link("base"), joint("f", "world", "base", kind="floating")),
     'link "base" moves on the joint "f" already'),
    (robot('<link name="world"/>', link("a"), link("b"), *(joint(f"on {x}", "world", x, kind="fixed") for x in "ab")),
     "links on the world are: a, b"),
])  # fmt: skip
def test_a_base_that_cannot_be_freed_is_an_error(text, said):
    raises(stepper.ModelError, f"XML text: free_base is True, .*{said}.*omit free_base", stepper.load, text, free_base=True)


def test_a_base_that_is_fixed_to_the_link_world_is_freed():
    text = robot('<link name="world"/>', link("base", mass=2), joint("f", "world", "base", kind="fixed"))
    model = stepper.load(text, free_base=True)
    assert (model.nv, model.body_mass[1]) == (6, 2)


# What a source asks for and by default does not get: one warning, `explain`, `Model.deviations`, and `Options.from_model`.

SCENE = """<mujoco model="robot"><option {option}/><worldbody><geom name="floor" type="plane" size="1 1 1" {floor}/>
  <body pos="0 0 1"><joint name="hinge" axis="0 1 0" range="-1 1" limited="true" {joint}/>
  <geom name="ball" size=".1" pos=".2 0 0" {ball}/></body>
  </worldbody></mujoco>"""


def scene(**parts):
    return SCENE.format(**({"option": "", "floor": "", "joint": "", "ball": ""} | parts))


def loaded(text):
    """The model, and the warnings of loading it."""
    with warnings.catch_warnings(record=True, action="always") as caught:
        model = stepper.load(text)
    return model, [w for w in caught if issubclass(w.category, stepper.ModelWarning)]


@pytest.mark.parametrize(("parts", "words"), [
    ({"option": 'integrator="RK4"'}, ["the source sets RK4, and the default options use midpoint", "Options.from_model(model)"]),
    ({"option": 'integrator="implicitfast"'}, ["the source sets implicitfast, and the default options use midpoint"]),
    ({"ball": 'solref=".005 1"'}, ["1 geoms (ball)", "dry friction hard"]),
    ({"floor": 'solimp=".99 .99 .01"', "ball": 'solref="-100 -1"'}, ["2 geoms (floor, ball)"]),
    ({"joint": 'solreflimit=".05 1"', "option": 'integrator="RK4"'}, ["1 limits of joints (hinge)", "the source sets RK4"]),
])  # fmt: skip
def test_what_is_asked_for_expressly_and_does_not_run_is_one_warning(parts, words):
    model, caught = loaded(scene(**parts))
    assert len(caught) == 1
    text = str(caught[0].message)
    assert caught[0].filename == __file__
    for word in [*words, '"robot" has settings that the default options do not use', "filterwarnings", "ModelWarning", "explain"]:
        assert word in text
    section = model.explain().split("\n\n")[1]
    assert section.startswith("Settings of the source that the default options replace:")
    assert all(word in section for word in words)


def test_defaults_are_no_warning_and_stand_in_explain():
    model, caught = loaded(scene())
    assert not caught
    assert model.deviations == []
    section = model.explain().split("\n\n")[1]
    default = "the source has the default, Euler, and the default options use midpoint"
    for words in (default, "softness: MuJoCo's default", "dry friction hard", "a pyramid"):
        assert words in section
    elliptic, _ = loaded(scene(option='cone="elliptic"'))
    assert "pyramid" not in elliptic.explain()


def test_what_cannot_push_is_not_soft():
    """Softness of what collides with nothing, or is switched off, is no deviation."""
    off = '<flag contact="disable" limit="disable"/>'
    text = scene(ball='solref=".005 1"', joint='solreflimit=".05 1"').replace("<option />", f"<option>{off}</option>")
    model, caught = loaded(text)
    assert not caught
    assert "softness" not in model.explain().split("\n\n")[1]


def test_the_warning_can_be_silenced_and_saved_models_say_it_in_explain(tmp_path):
    with warnings.catch_warnings(action="error"):
        warnings.filterwarnings("ignore", category=stepper.ModelWarning)
        model = stepper.load(scene(option='integrator="RK4"'))
        model.save(tmp_path / "robot.stepper")
        warnings.simplefilter("error")
        again = stepper.load(tmp_path / "robot.stepper")
    assert again == model
    assert again.deviations == model.deviations == pickle.loads(pickle.dumps(model)).deviations
    assert issubclass(stepper.ModelWarning, UserWarning)


@pytest.mark.parametrize(("option", "expected"), [
    ("", stepper.Options(contact="mujoco", integrator="euler", iterations=100)),
    ('integrator="RK4" iterations="5" solver="PGS"', stepper.Options(contact="mujoco", integrator="rk4", iterations=50)),
    ('integrator="implicit" solver="CG"', stepper.Options(contact="mujoco", integrator="implicit", iterations=100)),
    ('integrator="implicitfast" iterations="300"', stepper.Options(contact="mujoco", integrator="implicitfast", iterations=300)),
])  # fmt: skip
def test_options_of_a_model_are_those_of_its_source(option, expected):
    model, _ = loaded(scene(option=option))
    assert stepper.Options.from_model(model) == expected


def test_an_integrator_that_is_not_there_is_named():
    model = stepper.load(scene(option='integrator="discrete"'))
    assert model.deviations[0] == "integrator: the source sets discrete, which stepper does not have, and the default options use midpoint"
    assert not any("from_model" in line for line in model.deviations)
    for use in (stepper.Options.from_model, lambda m: stepper.Stepper(m, options=stepper.Options(contact="mujoco"))):
        with pytest.raises(ValueError, match="the source asks for discrete, which stepper does not have; choose"):
            use(model)
    # A choice replaces that of the file, and hard contact does not use it.
    for options in (stepper.Options(contact="mujoco", integrator="implicitfast"), stepper.Options()):
        stepper.Stepper(model, options=options).step()


def test_options_of_a_model_make_a_stepper_that_is_nearer_to_mujoco():
    """A robot whose file asks for Euler's rule, afloat: the difference to MuJoCo after a second is that of rounding."""
    compiled = mujoco.MjModel.from_xml_path(str(SOURCES["gymnasium/half_cheetah"]))
    compiled.geom_contype[:] = compiled.geom_conaffinity[:] = 0
    compiled.jnt_limited[:] = 0
    model, _ = loaded(compiled)
    data, ctrl = mujoco.MjData(compiled), np.linspace(-1, 1, model.nu)
    sims = [stepper.Stepper(model, options=options) for options in (stepper.Options.from_model(model), stepper.Options())]
    data.ctrl[:] = ctrl
    for sim in sims:
        sim.step(ctrl, nstep=30)
    mujoco.mj_step(compiled, data, 30)
    errors = [np.abs(sim.qpos - data.qpos).max() for sim in sims]
    assert errors[0] < 1e-9
    assert errors[1] > 1e-3


def test_the_command_explain_says_it_once(tmp_path, capsys):
    from stepper.cli.studies import explain

    file = tmp_path / "robot.xml"
    file.write_text(scene(option='integrator="RK4"'))
    with warnings.catch_warnings(action="error"):
        explain(str(file))
    assert capsys.readouterr().out.count("the source sets RK4") == 1


def test_a_model_made_in_code_asks_for_nothing():
    described = describe(mujoco.MjModel.from_xml_string(scene()))
    bare = stepper.Model.from_description({key: value for key, value in described.items() if key != "requested"}, strict=True)
    assert bare.requested is None
    assert stepper.Options.from_model(bare) == stepper.Options()


def test_softness_that_is_default_here_is_the_installed_mujocos():
    text = scene(joint='frictionloss=".1"').replace("</mujoco>", '<equality><joint joint1="hinge"/></equality></mujoco>')
    compiled = mujoco.MjModel.from_xml_string(text)
    for kind in ("geom", "jnt", "dof", "eq"):
        assert np.all(getattr(compiled, f"{kind}_solref") == requested.SOLREF)
        assert np.all(getattr(compiled, f"{kind}_solimp") == requested.SOLIMP)


@pytest.mark.parametrize("name", SOURCES)
def test_robots_of_others_say_what_they_ask_for(name):
    model = stepper_model(name, strict=False)
    asks = mujoco.MjModel.from_xml_path(str(SOURCES[name])).opt.integrator != mujoco.mjtIntegrator.mjINT_EULER
    assert any(line.startswith("integrator") for line in model.deviations) == asks
    assert isinstance(stepper.Options.from_model(model), stepper.Options)


def test_options_are_those_of_a_model_and_of_nothing_else():
    with pytest.raises(TypeError, match=r"from_model takes a stepper\.Model, not str; stepper\.load\(path\) reads one"):
        stepper.Options.from_model("robot.xml")
