"""Names of fields and attributes that do not exist: the message names the argument and the right name, and is short."""

import re

import numpy as np
import pytest
import stepper
from hypothesis import example, given
from hypothesis import strategies as st
from stepper.derivatives import rollout
from stepper.lab.study.parameters import Parameter, check
from stepper.shared.fields import RANDOMIZED

SCENE = """<mujoco><worldbody><body name="ball"><joint name="x" type="slide" axis="1 0 0"/><geom name="ball" size=".1" mass="1"/>
<site name="tip"/></body></worldbody><actuator><motor joint="x"/></actuator></mujoco>"""
MODEL = stepper.load(SCENE)
SIM = stepper.Stepper(MODEL)
CTRL = np.zeros((2, 1))
LONGEST = 200
"""Characters of a message, about two lines of a terminal; all fields of `Model.replace` by name take 1,300."""

TAKERS = {
    "wrt": lambda name: SIM.linearize((name,)),
    "parameters": lambda name: rollout(SIM, CTRL, parameters=(name,)),
    "Stepper.randomize": lambda name: SIM.randomize(**{name: None}),
    "Model.replace": lambda name: MODEL.replace(**{name: 1.0}),
    "selector": lambda name: check({"p": Parameter(name, low=0.1, high=1.0)}, MODEL),
}
"""Calls that take the name of a field, by the argument that has it."""


@st.composite
def typos(draw):
    """A field, and its name with a letter left out, doubled, replaced, or two letters exchanged."""
    field = draw(st.sampled_from(sorted(RANDOMIZED)))
    at = draw(st.integers(0, len(field) - 2))
    letter = draw(st.sampled_from("abcdefghijklmnopqrstuvwxyz_"))
    before, one, two, after = field[:at], field[at], field[at + 1], field[at + 2 :]
    wrong = draw(st.sampled_from([two, one + one + two, letter + two, two + one]))
    return field, before + wrong + after


@given(typos(), st.sampled_from(sorted(TAKERS)))
def test_a_field_with_a_slip_of_the_pen_is_suggested(typo, argument):
    field, name = typo
    if hasattr(stepper.Model, name):  # Another field: "body_pos" from "body_ipos".
        return
    with pytest.raises(ValueError, match=rf"\b{field}\b") as error:
        TAKERS[argument](name)
    assert argument in str(error.value)
    assert f"there is no field {name!r}" in str(error.value)
    assert len(str(error.value)) <= LONGEST


@pytest.mark.parametrize(("name", "remedy"), [
    ("geom_margin", "make a stepper.Stepper of model.replace(geom_margin=...)"),
    ("zzz", "help(stepper.Stepper.randomize) lists the fields"),
])  # fmt: skip
def test_what_randomize_does_not_take_is_said_to_be_elsewhere(name, remedy):
    with pytest.raises(stepper.ModelError) as error:
        SIM.randomize(**{name: np.ones(1)})
    message = str(error.value)
    assert message.startswith(f"Stepper.randomize: there is no field {name!r}; ")
    assert remedy in message
    assert len(message) <= LONGEST


@pytest.mark.parametrize(("parameters", "error", "message"), [
    (("typo",), ValueError, r"^parameters: there is no field 'typo'"),
    (("qpos",), ValueError, r"^parameters has 'qpos', but gradients by the state .* are always computed: remove the name"),
    (("ctrl",), ValueError, r"^parameters has 'ctrl'"),
    (("gravity", "gravity"), ValueError, r"^parameters has 'gravity' more than once"),
    ((3,), TypeError, r"^parameters is \(3,\), must be a sequence of names"),
    ("gravity", TypeError, r"^parameters is 'gravity', must be a sequence of names, for example \('gravity',\)"),
    (("geom_friction[bell]",), ValueError, r"^parameters has 'geom_friction\[bell\]': no geom 'bell'; did you mean ball"),
])  # fmt: skip
def test_a_rollout_names_the_argument_that_it_was_given(parameters, error, message):
    with pytest.raises(error) as raised:
        rollout(SIM, CTRL, parameters=parameters)
    raised.match(message)
    assert "wrt" not in str(raised.value)


@pytest.mark.parametrize(("wrt", "error", "message"), [
    ((), ValueError, r"^wrt is \(\), must have at least one name"),
    (("qvel", "qvel"), ValueError, "^wrt has 'qvel' more than once"),
    (("qpos[x]",), ValueError, r"^wrt has 'qpos\[x\]', but qpos has no named elements: write 'qpos' alone"),
])  # fmt: skip
def test_names_of_linearize(wrt, error, message):
    with pytest.raises(error, match=message):
        SIM.linearize(wrt)


@pytest.mark.parametrize(("text", "hint"), [
    ("geom_friction[ball]", "write 'geom_friction[ball][0]' (sliding friction), 'geom_friction[ball][1]' (torsional friction)"),
    ("body_mas[ball]", "did you mean body_mass"),
    ("body_mass", "names no body: write 'body_mass[name]'"),
    ("body_mass[ball][0]", "body_mass has no columns here; leave them out"),
    ("mass:ball", "write field[names][columns], as 'geom_friction[floor,box][0]'"),
    ("geom_margin[ball]", "'geom_margin' cannot be identified"),
])  # fmt: skip
def test_identify_names_the_right_selector(text, hint):
    with pytest.raises(ValueError, match=r"^(parameters|'body_mass')") as error:
        stepper.sysid.identify(MODEL, [], [text])
    assert hint in str(error.value)


TWO = stepper.Stepper(
    stepper.load(SCENE.replace("<joint", '<joint type="slide" axis="0 1 0"/><joint').replace("<motor", '<motor joint="x"/><motor')), 2
)
"""Two environments, each with two joints and two motors."""


@pytest.mark.parametrize(("call", "message"), [
    (lambda: SIM.randomize(geom_friction=0.3), r"^geom_friction is 0\.3 \(float\), a single number, must be an array of shape \(1, 3\)$"),
    (lambda: TWO.randomize(gravity=-9.81), r"^gravity is -9\.81 \(float\), a single number, must be an array of shape \(2, 3\)$"),
    (lambda: MODEL.replace(body_mass=2), r"^body_mass is 2 \(int\), a single number, must be an array of shape \(2,\)$"),
    (lambda: TWO.step(0.5), r"^ctrl is 0\.5 \(float\), a single number, must be an array of shape \(2, 2\) or \(2,\)$"),
    (lambda: TWO.set_state(qpos=np.array(1.0)), r"^qpos has shape \(\), must be \(2, 2\) or \(2,\)$"),
    (lambda: MODEL.replace(body_mass=[2.0]), r"^body_mass has shape \(1,\), must be \(2,\)$"),
])  # fmt: skip
def test_a_single_number_for_an_array_is_named_as_one(call, message):
    with pytest.raises(ValueError, match=message):
        call()


@example("geom_restitution", 0.5)  # One geom: a number has the shape of the model's array once it is an array.
@given(st.sampled_from(sorted(RANDOMIZED)), st.floats(0.1, 1.0))
def test_every_field_names_a_single_number(field, number):
    with pytest.raises(ValueError, match=f"^{field} is .* a single number, must be an array of shape") as error:
        TWO.randomize(**{field: number})
    assert str((2, *np.shape(getattr(TWO.model, field)))) in str(error.value)


@pytest.mark.parametrize("envs", [None, [1]])
@pytest.mark.parametrize("field", sorted(RANDOMIZED))
def test_values_of_one_environment_are_named_with_the_call_that_repeats_them(field, envs):
    own = np.asarray(getattr(TWO.model, field), float)
    if own.ndim == 0 or own.size == 0 or own.shape == (1,):
        pytest.skip("a single number, or none")
    must = (2 if envs is None else 1, *own.shape)
    with pytest.raises(ValueError, match=rf"must be {re.escape(str(must))}; np\.broadcast_to\(value, {re.escape(str(must))}\) gives all"):
        TWO.randomize(envs=envs, **{field: own})


def test_a_single_number_is_taken_where_one_is_meant():
    """Numbers of the model, and arrays of one number of a single environment."""
    assert MODEL.replace(timestep=0.001).timestep == 0.001
    SIM.step(0.5)
    SIM.set_state(qpos=0.1)
    assert SIM.qpos.tolist() == [0.1]


@pytest.mark.parametrize(("attempt", "hint"), [
    (lambda: SIM.contacts()["frc"], "no field of name frc"),
    (lambda: SIM.jacobian("tip"), "but a site is: jacobian(site='tip')"),
    (lambda: SIM.qpso, "did you mean qpos"),
    (lambda: SIM.geom_frictoin, "did you mean sim.model.geom_friction"),
    (lambda: SIM.flux, "a stepper.Stepper has no attribute 'flux'"),
    (lambda: MODEL.body_mas, "a stepper.Model has no attribute 'body_mas'; did you mean body_mass"),
    (lambda: setattr(SIM, "xfrc_aplied", 0), "no attribute 'xfrc_aplied'; did you mean xfrc_applied"),
    (lambda: setattr(MODEL.joint("x"), "axis", 1), "change the file"),
    (lambda: SIM.__array_interfac__, "has no attribute '__array_interfac__'"),
])  # fmt: skip
def test_an_unknown_attribute_has_a_hint(attempt, hint):
    with pytest.raises((AttributeError, KeyError, ValueError)) as error:
        attempt()
    assert hint in str(error.value)


def test_attributes_of_one_class_are_hints_of_the_other():
    for owner, other, place in ((MODEL, stepper.Stepper, "sim."), (SIM, stepper.Model, "model.")):
        for name in {name for name in dir(other) if name[0] != "_"} - {*dir(owner)}:
            with pytest.raises(AttributeError) as error:
                getattr(owner, name)
            assert f"{place}{name}" in str(error.value)


@pytest.mark.parametrize("field", sorted(RANDOMIZED))
def test_fields_of_randomize_are_hints_of_a_stepper(field):
    """Reading and assigning: the values of an environment are not those of the model."""
    for attempt in (lambda: getattr(SIM, field), lambda: setattr(SIM, field, 1.0)):
        with pytest.raises(AttributeError, match=rf"sim\.model\.{field}"):
            attempt()
