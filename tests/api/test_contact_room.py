"""Room for contacts: whatever a model's own states have fits."""

import pickle

import numpy as np
import pytest
import stepper

FEET = 60


def many_feet(height: float, keyframe: str = "", friction: float = 0.001) -> stepper.Model:
    """A tray on many feet: one body, more contacts than a body of a heap has.

    Their coefficients of friction grow by `friction` from foot to foot, so that none is redundant; with 0 they are alike.
    """
    feet = "".join(
        f'<geom size=".01" pos="{0.05 * (k % 10):g} {0.05 * (k // 10):g} 0" friction="{1 + friction * k:g}"/>' for k in range(FEET)
    )
    more = "".join(f'<body pos="0 0 {5 + k}"><freejoint/><geom size=".01"/></body>' for k in range(2))
    world = f'<geom type="plane" size="9 9 1"/><body pos="0 0 {height}"><freejoint/>{feet}</body>{more}'
    return stepper.load(f"<mujoco><worldbody>{world}</worldbody>{keyframe}</mujoco>")


@pytest.mark.parametrize("precision", ["f64", "f32"])
@pytest.mark.parametrize("num_envs", [None, 3])
def test_all_contacts_of_the_reset_state_fit(num_envs, precision):
    sim = stepper.Stepper(many_feet(0.01), num_envs, precision=precision)
    sim.step(nstep=20)
    assert not (np.atleast_1d(sim.status) & stepper.Status.CONTACTS_FULL).any()
    assert len(sim.contacts(0) if num_envs else sim.contacts()) == FEET


def test_all_contacts_of_a_keyframe_fit():
    key = '<keyframe><key name="low" qpos="0 0 .01 1 0 0 0 0 0 5 1 0 0 0 0 0 6 1 0 0 0"/></keyframe>'
    sim = stepper.Stepper(many_feet(3.0, key))
    sim.reset(keyframe="low")
    sim.step(nstep=20)
    assert not sim.status & stepper.Status.CONTACTS_FULL
    assert len(sim.contacts()) == FEET


def test_feet_that_others_make_redundant_have_room():
    sim = stepper.Stepper(many_feet(0.01, friction=0.0))
    sim.step(nstep=20)
    assert not sim.status & stepper.Status.CONTACTS_FULL
    assert len(sim.contacts()) == 4, "the corners of the tray"


def test_a_pickle_has_the_same_room():
    sim = stepper.Stepper(many_feet(0.01))
    sim.step(nstep=5)
    other = pickle.loads(pickle.dumps(sim))
    for each in (sim, other):
        each.step(nstep=5)
    assert other.qpos.tobytes() == sim.qpos.tobytes()
    assert len(other.contacts()) == FEET
