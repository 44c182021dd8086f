"""Arguments of recordings, pictures, options, sensor and actuator models and `load`: wrong ones are errors with the right form."""

import dataclasses
import pickle
import re

import mujoco
import numpy as np
import pytest
import stepper
from checks import every, raises
from hypothesis import given, strategies as st
from stepper.recording.format import KINDS, read_header, read_rows

XML = """<mujoco><worldbody><light pos="0 0 3"/><camera name="side" pos="0 -2 1" xyaxes="1 0 0 0 0 1"/><body name="arm">
  <joint name="hip" axis="0 1 0"/><geom size=".1" pos=".3 0 0"/><site name="tip" pos=".6 0 0"/></body></worldbody>
  <actuator><motor name="motor" joint="hip"/></actuator><sensor><gyro name="gyro" site="tip"/></sensor></mujoco>"""
MODEL = stepper.load(XML)
COMPILED = mujoco.MjModel.from_xml_string(XML)
SIM = stepper.Stepper(MODEL, 2)
OPTIONS = stepper.Options()
LIN = stepper.Stepper(MODEL).linearize(sensors=True)
WORDS = {
    "contact": ("hard", "mujoco"), "integrator": ("euler", "midpoint", "implicit", "implicitfast", "rk4", None),
    "solver": ("auto", "pgs", "newton"), "stabilization": ("baumgarte", "split", "none"),
}  # fmt: skip
NUMBERS = {
    **dict.fromkeys(("timestep", "tolerance", "rtol", "error"), (lambda x: 0 < x < np.inf)),
    **dict.fromkeys(("slop", "max_correction_speed", "restitution_threshold"), (lambda x: x >= 0)),
    "baumgarte": lambda x: 0 <= x <= 1,
}


def new(tmp_path, steps=3):
    """A recording of some steps, and the stepper."""
    sim = stepper.Stepper(MODEL, 2)
    with sim.record(tmp_path / "run"):
        for _ in range(steps):
            sim.step([0.1])
    return sim


@every(make=[lambda sim, path: sim.record(path), stepper.Recorder], context=[True, False])
def test_a_recorder_records_however_it_is_made(tmp_path, make, context):
    sim = stepper.Stepper(MODEL, 2)
    if context:
        with make(sim, tmp_path / "run") as recorder:
            assert sim.recorder is recorder
            sim.step([0.1])
            sim.reset(envs=[1])
    else:
        recorder = make(sim, tmp_path / "run")
        sim.step([0.1])
        sim.reset(envs=[1])
        recorder.close()
    assert sim.recorder is None
    kinds = [kind for _, kind, _ in read_rows(tmp_path / "run", read_header(tmp_path / "run"))]
    assert kinds == ["start", "step", "reset"]
    assert set(kinds) <= set(KINDS)
    result = stepper.recording.verify(tmp_path / "run")
    assert (result.steps, result.rows, result.complete) == (1, 3, True)


def test_a_recording_without_steps_says_so(tmp_path):
    sim = stepper.Stepper(MODEL)
    recorder = sim.record(tmp_path / "open")
    said = "nothing to compare: no call of step was recorded; the recording was not closed, its last second may be missing"
    assert str(stepper.recording.verify(tmp_path / "open")) == said
    recorder.close()
    assert str(stepper.recording.verify(tmp_path / "open")) == "nothing to compare: no call of step was recorded"


def test_a_file_is_no_folder_of_a_recording(tmp_path):
    (tmp_path / "run").write_text("text")
    raises(FileExistsError, r"run is a file, but a recording is a folder; give the path of a new folder$", SIM.record, tmp_path / "run")
    assert (tmp_path / "run").read_text() == "text"


@pytest.mark.parametrize("name", ["run.gz", "run.tar.gz", "run.npz"])
def test_a_folder_of_a_recording_has_any_name(tmp_path, name):
    stepper.Stepper(MODEL).record(tmp_path / name).close()
    assert (tmp_path / name / "run.json").is_file()


@pytest.mark.parametrize("ending", [".xml", ".mjb", ".urdf", ".XML"])
def test_a_model_is_saved_under_its_own_ending(tmp_path, ending):
    raises(ValueError, r"stepper's own format: use the ending \.stepper, as .*model\.stepper", MODEL.save, tmp_path / f"model{ending}")
    for name in ("model", "model.stepper", "model.bin"):
        MODEL.save(tmp_path / name)
        assert stepper.load(tmp_path / name) == MODEL
    assert {file.name for file in tmp_path.iterdir()} == {"model", "model.stepper", "model.bin"}


WRONG = {
    "Renderer(sim)": (lambda: stepper.viewer.Renderer(SIM), r"must be a stepper.Model: stepper.viewer.Renderer(sim.model).render(sim)"),
    "Renderer(path)": (lambda: stepper.viewer.Renderer("x.xml"), "must be a stepper.Model: stepper.viewer.Renderer(sim.model).render(sim)"),
    "Renderer(mj)": (lambda: stepper.viewer.Renderer(COMPILED), "must be a stepper.Model: stepper.viewer.Renderer(sim.model).render(sim)"),
    "noise": (lambda: stepper.Transfer(noise=0.1), "noise_std=... is its standard deviation"),
    "transfer": (lambda: stepper.SensorModel({"gyro": 0.1}), "must be a stepper.Transfer, as stepper.Transfer(noise_std=...)"),
    "transfers": (lambda: stepper.SensorModel(0.1), "as {'*': stepper.Transfer(noise_std=...)}"),
    "drive": (lambda: stepper.ActuatorModel({"motor": 0.1}), "must be a stepper.Drive, as stepper.Drive(delay=...)"),
    "drive of another class": (lambda: stepper.ActuatorModel({"motor": stepper.Transfer()}), "is a Transfer, must be a stepper.Drive"),
    "model": (lambda: stepper.load(MODEL), "it is loaded already, as stepper.Stepper(model)"),
    "view(model)": (lambda: stepper.viewer.view(MODEL), "must be a stepper.Stepper: stepper.viewer.view(stepper.Stepper(model))"),
    "view(fps)": (lambda: stepper.viewer.view(SIM, fps=3), "unexpected keyword argument 'fps'"),
    "width": (lambda: stepper.viewer.Renderer(MODEL, width="a"), "width is 'a', must be a whole number"),
    "camera": (lambda: stepper.viewer.Renderer(MODEL, camera=2.5), "camera_config={'distance': ...} sets a free camera"),
    "camera_config": (lambda: stepper.viewer.Renderer(MODEL, camera_config=2.5), "must be a dict such as {'distance': 2.0"),
    "rollout": (lambda: stepper.derivatives.rollout(SIM, steps=3), "unexpected keyword argument 'steps'"),
    "A, B": (lambda: [*LIN], "use its attributes A and B"),
    "lin[0]": (lambda: LIN[0], "use its attributes A and B"),
    "lin['A']": (lambda: LIN["A"], "use its attributes A and B"),
}
"""Calls with wrong arguments, and part of the message."""


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_argument_is_an_error_with_the_right_form(name):
    call, hint = WRONG[name]
    with pytest.raises(TypeError if name != "noise" else ValueError) as error:
        call()
    assert hint in str(error.value)


class TestPictures:
    def test_width_and_height(self):
        with stepper.viewer.Renderer(MODEL, width=16, height=8, camera="side") as renderer:
            assert renderer.render(SIM, env=1).shape == (8, 16, 3)
            for env in (2, -3, "side", [0, 1], 0.5, True):
                with pytest.raises((TypeError, ValueError), match=re.escape(f"env is {env!r}, must be a whole number from -2 to 1")):
                    renderer.render(SIM, env)
            raises(TypeError, r"must be a stepper\.Stepper: stepper\.viewer\.Renderer\(sim\.model\)\.render\(sim\)", renderer.render, MODEL)


@pytest.mark.parametrize("option", WORDS)
def test_an_option_is_one_of_its_words_or_an_error(option):
    for word in ("foo", "Euler", "soft", "Newton", 3, -1.5):
        raises((TypeError, ValueError), f"{option} is ", stepper.Options, **{option: word})
    for word in WORDS[option]:
        more = {"contact": "mujoco"} if word == "implicitfast" else {}
        assert getattr(stepper.Options(**{option: word}, **more), option) == word


@given(st.sampled_from(sorted(NUMBERS)), st.floats())
def test_an_option_is_in_its_range_or_an_error(option, number):
    if NUMBERS[option](number):
        assert getattr(stepper.Options(**{option: number}), option) == number
        return
    raises(ValueError, f"option {option} is ", stepper.Options, **{option: number})


@pytest.mark.parametrize("settings", [{"integrator": "implicitfast"}, {"contact": "mujoco", "integrator": "midpoint"}])
def test_an_integrator_of_the_other_law_is_an_error(settings):
    raises(ValueError, r"option integrator is .*, must be .* with contact=", stepper.Options, **settings)


@pytest.mark.parametrize("frozen", [OPTIONS, stepper.Transfer(), stepper.Drive(), stepper.actuators.PID(kp=1.0)])
def test_a_frozen_object_is_changed_by_a_copy(frozen):
    for field in dataclasses.fields(frozen):
        raises(dataclasses.FrozenInstanceError, field.name, setattr, frozen, field.name, 1)
        assert dataclasses.replace(frozen, **{field.name: getattr(frozen, field.name)}) == frozen
    assert pickle.loads(pickle.dumps(frozen)) == frozen


def test_sensors_of_a_model_of_errors_can_be_assigned():
    sensors = stepper.SensorModel()
    sensors.default = stepper.Transfer(delay=0.01)
    assert sensors == stepper.SensorModel(default=stepper.Transfer(delay=0.01))


@pytest.mark.parametrize("name", ["reset", "set_state", "step", "rollout", "jacobian", "rays", "get_state", "contacts", "copy_state"])
def test_an_unknown_keyword_of_the_compiled_library_has_the_keywords(name):
    raises(TypeError, rf"^Stepper\.{name}\(\) takes no 'zzz'; there are: ", lambda: getattr(SIM, name)(zzz=1))
