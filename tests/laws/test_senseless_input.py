"""Input that makes no sense is an error that names the element, or a flag of its environment alone."""

import numpy as np
import pytest
import stepper

BODY = """<mujoco><worldbody><geom type="plane" size="0 0 1"/>
  <body name="crate" pos="0 0 1"><joint name="lift" type="slide" axis="0 0 1"/><joint name="turn" type="ball"/>
    <geom size=".1"/></body></worldbody>
  <actuator><motor joint="lift"/></actuator></mujoco>"""


@pytest.mark.parametrize("field", ["body_mass", "body_inertia"])
def test_a_body_without_mass_or_inertia_is_named(field):
    model = stepper.load(BODY)
    value = np.array(getattr(model, field))
    value[1] = 0.0
    with pytest.raises(stepper.ModelError, match="crate"):
        model.replace(**{field: value})


def test_massless_mjcf_is_named():
    with pytest.raises(ValueError, match="mass"):
        stepper.load(BODY.replace('size=".1"', 'size=".1" mass="0"'))


def test_an_action_that_is_no_number_stays_in_its_environment():
    sim = stepper.Stepper(stepper.load(BODY), 2)
    before = sim.qpos
    sim.step([[np.nan], [1.0]])
    assert sim.status[0] & stepper.Status.NON_FINITE
    assert sim.status[1] == stepper.Status.OK
    assert (sim.qpos[0] == before[0]).all()
    assert np.isfinite(sim.qpos).all()


def test_a_quaternion_of_zeros_is_refused():
    sim = stepper.Stepper(stepper.load(BODY))
    with pytest.raises(ValueError, match=r"orientation of joint .*its length is 0"):
        sim.set_state(qpos=[0.0, 0.0, 0.0, 0.0, 0.0])
