"""Arrays of attributes are read-only copies: a write to one is an error, and an assignment names the call to use."""

import numpy as np
import pytest
import stepper
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
    with pytest.raises(ValueError, match="read-only"):
        write(sim)


@pytest.mark.parametrize(("name", "remedy"), [
    *((name, "the methods set_state, reset, step and randomize change a stepper") for name in ("qpos", "ctrl", "timestep", "residual")),
    ("step", "it is a method"),
])  # fmt: skip
def test_an_assignment_that_nothing_takes_names_the_call_to_use(sim, name, remedy):
    with pytest.raises(AttributeError, match=f"{name} of a stepper.Stepper cannot be assigned: .*{remedy}"):
        setattr(sim, name, 0.5)


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
        with pytest.raises(AttributeError, match=f"{name} of a stepper.Model cannot be assigned: .*{remedy}"):
            setattr(sim.model, name, 3)


@pytest.mark.parametrize("name", STATE)
def test_copies_cannot_be_made_writable(sim, name):
    array = getattr(sim, name)
    with pytest.raises(ValueError, match="WRITEABLE"):
        array.flags.writeable = True
