"""Copies of a study share its loaded model, also those with other parameters and settings."""

from dataclasses import replace

import stepper
from stepper.lab import Outcome, Parameter, Study

MJCF = "<mujoco><worldbody><body name='b'><freejoint/><geom size='.1'/></body></worldbody></mujoco>"


def test_a_study_and_its_copies_load_the_model_once():
    loads = []

    def model():
        loads.append(1)
        return stepper.load(MJCF)

    mass = {"m": Parameter("body_mass[b]", low=1.0, high=2.0)}
    study = Study(model=model, parameters=mass, outcomes=Outcome(name="z", measure="body b z"))
    copies = [replace(study, seed=1), study.at({"m": 1.5}), replace(study, parameters={}, settings={"f32": {"precision": "f32"}})]
    assert all(copy.loaded[0] == study.loaded[0] for copy in copies)
    assert len(loads) == 1


def test_another_model_is_loaded():
    study = Study(model=MJCF, parameters={"m": Parameter("body_mass[b]", low=1.0, high=2.0)})
    other = replace(study, model=MJCF.replace(".1", ".2"))
    assert other.loaded[0] != study.loaded[0]
