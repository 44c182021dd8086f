"""Arrays of attributes: read-only copies, real numbers alone, and quantities of bodies that are computed in one pass."""

import numpy as np
import pytest
import stepper
from checks import every, raises
from models import STATE, simulate, stepper_model

ROBOT = "dm_control/humanoid"


@pytest.fixture
def sim():
    return simulate(stepper_model(ROBOT), 3)


@pytest.mark.parametrize("write", [
    lambda sim: sim.qpos.__setitem__((slice(None), 1), 5),
    lambda sim: sim.qpos[0].__setitem__(1, 5),
    lambda sim: exec("sim.qvel += 1", {"sim": sim}),
    lambda sim: sim.ctrl.__setitem__(slice(None), 1),
    lambda sim: sim.status.fill(0),
    lambda sim: sim.model.body_mass.__setitem__(0, 3),
    lambda sim: sim.randomized["body_mass"].__setitem__(0, 3),
])  # fmt: skip
def test_a_write_to_a_copy_is_an_error(sim, write):
    sim.randomize(body_mass=np.tile(sim.model.body_mass, (3, 1)))
    raises(ValueError, "read-only", write, sim)


@pytest.mark.parametrize(("name", "remedy"), [
    *((name, "the methods set_state, reset, step and randomize change a stepper") for name in ("qpos", "ctrl", "timestep", "residual")),
    ("step", "it is a method"),
])  # fmt: skip
def test_an_assignment_that_nothing_takes_names_the_call_to_use(sim, name, remedy):
    raises(AttributeError, f"{name} of a stepper.Stepper cannot be assigned: .*{remedy}", setattr, sim, name, 0.5)


def test_every_attribute_of_a_model_names_what_sets_it(sim):
    """Fields name calls, and what follows from the file names the file; a model is no result of the simulation."""
    for name in (name for name in dir(stepper.Model) if not name.startswith("_")):
        with pytest.raises(AttributeError, match=f"^{name} of a stepper.Model cannot be assigned: ") as error:
            setattr(sim.model, name, 3)
        reason = str(error.value).partition(": ")[2]
        known = ("it is a method", "it is defined in the model's file", f"model.replace({name}=", f"stepper.Options({name}=")
        assert reason.startswith(known) or name == "sensors", reason
        assert "simulation" not in reason
    for name, remedy in (("nq", "the model's file: change the file"), ("sensors", r"model\.with_sensors\("), ("replace", "it is a method")):
        raises(AttributeError, f"{name} of a stepper.Model cannot be assigned: .*{remedy}", setattr, sim.model, name, 3)


@pytest.mark.parametrize("name", STATE)
def test_copies_cannot_be_made_writable(sim, name):
    raises(ValueError, "WRITEABLE", setattr, getattr(sim, name).flags, "writeable", True)


# Array arguments of a stepper and a model: masks, complex numbers, objects and texts are refused, and so are negative environments.

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


@every(kind=WRONG, call=CALLS)
def test_arrays_that_are_no_real_numbers_are_refused(call, kind):
    sim = stepper.Stepper(MODEL, 2)
    raises(TypeError, r"masked array|complex numbers|must be an array of numbers", lambda: CALLS[call](sim, WRONG[kind]))
    assert not sim.time.any()


def test_read_only_arrays_and_other_layouts_of_numbers_are_taken():
    sim = stepper.Stepper(MODEL, 2)
    sim.set_state(sim.qpos, sim.qvel)
    sim.step(sim.ctrl)
    sim.step(np.ones((1, 2), dtype=np.int8).T)
    sim.step([[True], [0.5]])
    assert sim.ctrl.tolist() == [[1.0], [0.5]]


# Quantities of bodies that are read after every step are computed in one pass: the same numbers as read alone, of the present state.

NAMES = ("xpos", "xquat", "body_linvel", "body_angvel", "site_xpos", "geom_xpos", "geom_xquat", "subtree_com", "xipos", "cinert", "cvel",
         "cfrc_ext", "actuator_force", "qfrc_actuator", "qacc", "qfrc_constraint", "body_contact_force")  # fmt: skip
ENVS = 21
"""No multiple of the lanes."""


def batch(precision="f64", threads=1):
    options = stepper.Options(contact="mujoco")
    return stepper.Stepper(stepper_model("gymnasium/humanoid", strict=False), ENVS, options=options, precision=precision, threads=threads)


def controls(k):
    return np.random.default_rng(k).uniform(-0.4, 0.4, (ENVS, 17))


@pytest.mark.parametrize(("precision", "threads"), [("f64", 1), ("f32", 1), ("f32", 2)])
def test_together_they_have_the_bits_of_each_alone(precision, threads):
    sim = batch(precision, threads)
    alone = {name: batch(precision) for name in NAMES}
    rng = np.random.default_rng(0)
    for k in range(40):
        order = rng.permutation(NAMES)[: rng.integers(1, len(NAMES) + 1)]
        for other in (sim, *alone.values()):
            if k % 9 == 4:
                other.reset(np.arange(ENVS) % 3 == k % 3)
            other.step(controls(k), nstep=3)
        for name in order:
            np.testing.assert_array_equal(getattr(sim, name), getattr(alone[name], name), err_msg=name)


def test_every_change_is_seen():
    """After each change of state, parameters or what is applied, what was read together is that of a stepper made for it."""
    sim = batch()
    read = ("xpos", "cinert", "cvel", "cfrc_ext", "subtree_com", "qfrc_actuator")
    heavy = np.tile(sim.model.body_mass, (ENVS, 1)) * np.linspace(1.0, 2.0, ENVS)[:, None]
    changes = (
        lambda s: s.step(controls(1), nstep=20),
        lambda s: s.set_state(qvel=np.ones(sim.model.nv)),
        lambda s: s.randomize(body_mass=heavy),
        lambda s: s.step(controls(2), nstep=20),
        lambda s: s.reset(np.arange(ENVS) < 7),
        lambda s: s.set_state(qpos=sim.model.qpos0 + np.array([0, 0, 1.0, *np.zeros(sim.model.nq - 3)]), envs=np.arange(ENVS) > 15),
        lambda s: s.randomize(),
    )
    before: dict[str, np.ndarray] = {}
    for k, change in enumerate(changes):
        change(sim)
        other = batch()
        for again in changes[: k + 1]:
            again(other)
        for name in read:
            now = getattr(sim, name)
            assert now is getattr(sim, name)
            np.testing.assert_array_equal(now, getattr(other, name), err_msg=f"{name} after change {k}")
            assert name not in before or before[name] is not now
            before[name] = now
