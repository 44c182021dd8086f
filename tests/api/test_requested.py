"""What a source asks for and by default does not get: one warning, `explain`, `Model.deviations`, and `Options.from_model`."""

import pickle
import warnings

import mujoco
import numpy as np
import pytest
import stepper
from models import SOURCES, stepper_model
from stepper.loading.mjcf import describe, requested

SCENE = """<mujoco model="robot"><option {option}/><worldbody><geom name="floor" type="plane" size="1 1 1" {floor}/>
  <body pos="0 0 1"><joint name="hinge" axis="0 1 0" range="-1 1" limited="true" {joint}/>
  <geom name="ball" size=".1" pos=".2 0 0" {ball}/></body>
  </worldbody></mujoco>"""


def scene(**parts):
    return SCENE.format(**({"option": "", "floor": "", "joint": "", "ball": ""} | parts))


def loaded(text):
    """The model, and the warnings of loading it."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
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
    with warnings.catch_warnings():
        warnings.simplefilter("error")
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
    ('integrator="discrete"', stepper.Options(contact="mujoco", integrator="discrete", iterations=100)),
    ('integrator="implicitfast" iterations="300"', stepper.Options(contact="mujoco", integrator="implicitfast", iterations=300)),
])  # fmt: skip
def test_options_of_a_model_are_those_of_its_source(option, expected):
    model, _ = loaded(scene(option=option))
    assert stepper.Options.from_model(model) == expected


def test_an_integrator_that_is_not_there_is_named():
    described = describe(mujoco.MjModel.from_xml_string(scene()))
    described["requested"]["integrator"] = "leapfrog"
    with pytest.raises(ValueError, match="the source asks for leapfrog, which stepper does not have; choose"):
        stepper.Options.from_model(stepper.Model.from_description(described, strict=True))


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
    with warnings.catch_warnings():
        warnings.simplefilter("error")
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
    compiled = mujoco.MjModel.from_xml_path(str(SOURCES[name]))
    asks = compiled.opt.integrator != mujoco.mjtIntegrator.mjINT_EULER
    assert any(line.startswith("integrator") for line in model.deviations) == asks
    assert isinstance(stepper.Options.from_model(model), stepper.Options)


def test_options_are_those_of_a_model_and_of_nothing_else():
    with pytest.raises(TypeError, match=r"from_model takes a stepper\.Model, not str; stepper\.load\(path\) reads one"):
        stepper.Options.from_model("robot.xml")
