"""Array arguments of a stepper and a model: masks, complex numbers, objects and texts are refused, and so are negative environments."""

import numpy as np
import pytest
import stepper

MODEL = stepper.load("""<mujoco><worldbody><body name="a"><joint name="j"/><geom size=".1" pos=".1 0 0"/></body></worldbody>
  <actuator><motor joint="j"/></actuator></mujoco>""")
WRONG = {
    "complex": lambda values: values + 1j,
    "masked": lambda values: np.ma.array(values, mask=np.ones(values.shape, dtype=bool)),
    "masked without a mask": np.ma.array,
    "objects": lambda values: values.astype(object),
    "texts": lambda values: values.astype(str),
}
CALLS = {
    "step": lambda sim, wrong: sim.step(wrong(np.ones((2, 1)))),
    "step in f32": lambda sim, wrong: sim.step(wrong(np.ones((2, 1), np.float32))),
    "step some": lambda sim, wrong: sim.step(wrong(np.ones((1, 1))), envs=[1]),
    "reset": lambda sim, wrong: sim.reset(qpos=wrong(np.ones((2, 1)))),
    "set_state": lambda sim, wrong: sim.set_state(wrong(np.ones((2, 1)))),
    "time": lambda sim, wrong: sim.set_state(time=wrong(np.ones(2))),
    "randomize": lambda sim, wrong: sim.randomize(body_mass=wrong(np.array([[0.0, 1.0], [0.0, 1.0]]))),
    "xfrc_applied": lambda sim, wrong: setattr(sim, "xfrc_applied", wrong(np.zeros((2, 2, 6)))),
    "rollout": lambda sim, wrong: sim.rollout(wrong(np.ones((3, 2, 1)))),
    "rays": lambda sim, wrong: sim.rays(wrong(np.ones((1, 3))), np.ones((1, 3))),
    "replace": lambda sim, wrong: sim.model.replace(body_mass=wrong(np.array([0.0, 1.0]))),
    "inverse_dynamics": lambda sim, wrong: sim.inverse_dynamics(wrong(np.ones((2, 1)))),
    "randomize a selector": lambda sim, wrong: sim.randomize({"body_mass[a]": wrong(np.ones(2))}),
    "integrate_pos": lambda sim, wrong: sim.model.integrate_pos(wrong(np.zeros(1)), np.zeros(1)),
}


@pytest.mark.parametrize("kind", WRONG)
@pytest.mark.parametrize("call", CALLS)
def test_arrays_that_are_no_real_numbers_are_refused(call, kind):
    sim = stepper.Stepper(MODEL, 2)
    with pytest.raises(TypeError, match=r"masked array|complex numbers|must be an array of numbers"):
        CALLS[call](sim, WRONG[kind])
    assert not sim.time.any()


def test_read_only_arrays_and_other_layouts_of_numbers_are_taken():
    sim = stepper.Stepper(MODEL, 2)
    sim.set_state(sim.qpos, sim.qvel)
    sim.step(sim.ctrl)
    sim.step(np.ones((1, 2), dtype=np.int8).T)
    sim.step([[True], [0.5]])
    assert sim.ctrl.tolist() == [[1.0], [0.5]]
