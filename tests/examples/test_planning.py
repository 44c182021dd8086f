"""examples/mppi.py: what plans predict comes true to the bit; examples/ensemble_filter.py: readings make estimates better."""

import ensemble_filter
import mppi
import numpy as np
import pytest
import stepper


@pytest.mark.parametrize("precision", ["f64", "f32"])
@pytest.mark.parametrize("name", ["walker", "quadruped"])
def test_predictions_come_true_to_the_bit(name, precision):
    """With drives, too, whose delay lines are part of the state."""
    drives = stepper.ActuatorModel(default=stepper.Drive(delay=0.011))
    for settings in ({}, {"actuators": drives}):
        found = mppi.run(name, seconds=0.2, samples=24, precision=precision, **settings)
        assert found.kept == found.promised > 15


def test_under_mujocos_law_too():
    options = stepper.Options.from_model(mppi.model_of(mppi.ROBOTS["walker"]))
    found = mppi.run("walker", seconds=0.2, samples=24, options=options, threads=2)
    assert found.kept == found.promised


def test_a_plant_that_is_another_breaks_the_promise(monkeypatch):
    """So that the count can fail: the plant's controls are not the plan's in the last bit of one."""
    step = stepper.Stepper
    seen = []

    class Plant:
        def __init__(self, *args, **kwargs):
            self._sim = step(*args, **kwargs)
            seen.append(self)

        def __getattr__(self, name):
            return getattr(self._sim, name)

        def step(self, ctrl, nstep):
            self._sim.step(np.nextafter(ctrl, 0.0), nstep)

    planner = mppi.Planner

    def made(*args, **kwargs):
        found = planner(*args, **kwargs)
        monkeypatch.setattr(mppi.stepper, "Stepper", Plant)
        return found

    monkeypatch.setattr(mppi, "Planner", made)
    found = mppi.run("walker", seconds=0.2, samples=24)
    assert len(seen) == 1
    assert found.kept < found.promised


def test_the_walker_goes_where_it_is_wanted():
    assert mppi.run("walker", seconds=1.0, samples=64).distance > 0.4


def test_readings_make_an_estimate_better():
    found = ensemble_filter.run(seconds=2.5, members=64)
    assert found.moved > 0.2
    assert found.velocity < 0.5 * min(found.alone, found.moved)
    assert found.height < 0.01
    assert found.covered > 0.85


def test_the_mean_of_configurations_has_no_displacement_left():
    model = ensemble_filter.model_of()
    rng = np.random.default_rng(0)
    around = model.integrate_pos(model.qpos0, 0.2 * rng.normal(size=(50, model.nv)))
    middle, displacements = ensemble_filter.mean_configuration(model, around)
    np.testing.assert_allclose(displacements.mean(axis=0), 0.0, atol=1e-9)
    assert np.linalg.norm(middle[3:7]) == pytest.approx(1.0, abs=1e-14)
