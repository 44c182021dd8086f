"""Fields of actuators in MuJoCo's shapes: what they read, and what a change of them does, against MuJoCo after the same change."""

import mujoco
import numpy as np
import pytest
import stepper
from actuators import KINDS, TREE, scene
from hypothesis import given, settings, strategies as st
from models import forward, random_state, simulate
from numerics import relative_error

BOUND = 1e-10  # As for smooth dynamics: rounding (1e-16) times what a mass matrix loses in a difference of accelerations.
FIELDS = ("actuator_gainprm", "actuator_biasprm", "actuator_gear")
UNREAD = 'general joint="swing" gear="3 1" gainprm="2 7" biasprm="5 6"'  # MuJoCo reads the first number of gear and gain alone.
ONE_OF_EACH = {
    "motor": 'motor joint="swing" gear="3"',
    "servo": 'position joint="wrist" kp="20" kv="3"',
    "affine": 'general tendon="belt" gaintype="affine" gainprm="1 2 -3" biastype="affine" biasprm=".1 -4 -5"',
    "thruster": 'motor site="tip" gear="1 -2 3 .5 -.4 .3"',
    "dcmotor": 'dcmotor joint="rail" motorconst=".5 .6" resistance="2" ctrlrange="-.7 .7"',
    "pid": 'pid joint="wrist" kp="20" kv="3" input="pos"',
}
SCENE = TREE.format(actuators="".join(f'<{made} name="{name}"/>' for name, made in ONE_OF_EACH.items()), sensors="")
number = st.floats(-5.0, 5.0).map(lambda x: round(x, 3) + 0.0)


def forces(sim, rest, state, act, ctrl):
    """Generalized forces of the actuators: the mass matrix times what they change of the accelerations."""
    sim.step(ctrl)  # Puts the controls in force; the state is set again below.
    sim.set_state(*state, act=act)
    rest.set_state(*state)
    return sim.mass_matrix() @ (sim.qacc_smooth - rest.qacc_smooth)


def check_forces(model, changed, rng):
    """Compares the forces of a model with MuJoCo's at one random state."""
    rest = simulate(TREE.format(actuators="", sensors=""))
    state = random_state(model, rng)
    act, ctrl = rng.uniform(-0.3, 0.3, model.na), rng.uniform(-1, 1, model.nu)
    data = forward(model, *state, ctrl, act=act)
    assert relative_error(forces(changed, rest, state, act, ctrl), data.qfrc_actuator) < BOUND


@pytest.mark.parametrize("kind", KINDS)
def test_fields_are_those_of_mujoco(kind):
    text = scene(kind)
    compiled, model = mujoco.MjModel.from_xml_string(text), stepper.load(text)
    for field in FIELDS:
        np.testing.assert_array_equal(getattr(model, field), getattr(compiled, field))
    words = [mujoco.mjtGain(k).name.removeprefix("mjGAIN_").lower() for k in compiled.actuator_gaintype]
    assert [model.actuator(k).gaintype for k in range(model.nu)] == words
    words = [mujoco.mjtBias(k).name.removeprefix("mjBIAS_").lower() for k in compiled.actuator_biastype]
    assert [model.actuator(k).biastype for k in range(model.nu)] == words
    assert (model.actuator(0).gear.shape, model.actuator(0).gainprm.shape, model.actuator(0).biasprm.shape) == ((6,), (10,), (10,))


@pytest.mark.parametrize("kind", KINDS)
def test_forces_after_a_change_are_those_of_mujoco(kind):
    """Every number that is not 0 is scaled, as a user scales MuJoCo's whole arrays: by `replace`, and by `randomize` what it takes."""
    text, rng = scene(kind), np.random.default_rng(0)
    compiled, model = mujoco.MjModel.from_xml_string(text), stepper.load(text)
    scaled = {field: getattr(model, field) * rng.uniform(0.5, 2.0, getattr(model, field).shape) for field in FIELDS}
    for field in FIELDS[:2]:
        getattr(compiled, field)[:] = scaled[field]
    sim = simulate(model, 2)
    alone = simulate(model.replace(**{field: scaled[field] for field in FIELDS[:2]}))
    if kind.startswith("muscle"):
        with pytest.raises(stepper.ModelError, match="muscles are the same in all environments"):
            sim.randomize(envs=[1], **{field: scaled[field][None] for field in FIELDS[:2]})
    else:
        sim.randomize(envs=[1], **{field: scaled[field][None] for field in FIELDS[:2]})
        for each in (sim, alone):
            each.set_state(qpos=np.broadcast_to(model.qpos0, each.qpos.shape), qvel=np.ones(each.qvel.shape))
            each.step(np.full(model.nu, 0.3), nstep=3)
        np.testing.assert_array_equal(sim.qpos[1], alone.qpos)
    check_forces(compiled, alone, rng)
    compiled.actuator_gear[:] = scaled["actuator_gear"]
    check_forces(compiled, simulate(model.replace(**scaled)), rng)


@given(data=st.data())
@settings(max_examples=60, deadline=None)
def test_a_change_is_that_of_mujoco_or_an_error(data):
    """One number anywhere: if MuJoCo's forces depend on its column, ours are the same; if not, or for a column not simulated, an error."""
    compiled, model = mujoco.MjModel.from_xml_string(SCENE), stepper.load(SCENE)
    field = data.draw(st.sampled_from(FIELDS))
    row = data.draw(st.integers(0, model.nu - 1))
    column = data.draw(st.integers(0, getattr(model, field).shape[1] - 1))
    value = data.draw(number)
    kind = list(ONE_OF_EACH)[row]
    reads = {
        "actuator_gear": 6 if kind == "thruster" else 1,
        "actuator_gainprm": {"affine": 3, "dcmotor": 2, "pid": 0}.get(kind, 1),
        "actuator_biasprm": {"servo": 3, "affine": 3, "pid": 3}.get(kind, 0),
    }
    if kind == "dcmotor" and field == "actuator_gainprm" and column == 0:
        value = abs(value) + 1.0  # A resistance.
    selector = {f"{field}[{kind}][{column}]": value}
    if column >= reads[field] and value != 0.0:
        with pytest.raises(stepper.ModelError, match=rf'actuator "{kind}".*{field} is .* in column {column}.*does not read.*give 0'):
            model.replace(selector)
        return
    changed = model.replace(selector)
    getattr(compiled, field)[row, column] = value
    np.testing.assert_array_equal(getattr(changed, field), getattr(compiled, field))
    check_forces(compiled, simulate(changed), np.random.default_rng(row))


@pytest.mark.parametrize(("selector", "parts"), [
    ("actuator_gainprm[motor][1]", ['gaintype is "fixed", which reads column 0 alone', 'gaintype="affine"']),
    ("actuator_gainprm[affine][3]", ['gaintype is "affine", which reads columns 0 to 2']),
    ("actuator_gainprm[pid][0]", ['gaintype is "pid", which reads no column']),
    ("actuator_biasprm[motor][1]", ['biastype is "none", which reads no column', 'biastype="affine"']),
    ("actuator_gear[motor][1]", ["acts on a joint, which reads column 0 alone"]),
    ("actuator_gear[affine][5]", ["acts on a tendon, which reads column 0 alone"]),
])  # fmt: skip
def test_columns_that_an_actuator_does_not_read_are_refused(selector, parts):
    model = stepper.load(SCENE)
    with pytest.raises(stepper.ModelError) as error:
        model.replace({selector: 0.5})
    assert all(part in str(error.value) for part in parts), str(error.value)
    if not selector.startswith("actuator_gear"):
        with pytest.raises(stepper.ModelError, match="environment 1") as error:
            stepper.Stepper(model, 2).randomize({selector: [0.0, 0.5]})
        assert all(part in str(error.value) for part in parts), str(error.value)


def test_a_term_that_the_model_lacks_is_added_by_replace_alone():
    """Environments of a batch share the structure of the step: whether forces depend on lengths and velocities."""
    general = 'general name="general" joint="swing" gaintype="affine" gainprm="1" biastype="affine"'
    model = stepper.load(TREE.format(actuators=f"<{general}/>", sensors=""))
    for field in ("actuator_gainprm", "actuator_biasprm"):
        with pytest.raises(stepper.ModelError, match=rf'environment 0: actuator "general": {field} is .*, and the model has.*small number'):
            stepper.Stepper(model, 1).randomize({f"{field}[general][1]": -2.0})
        stepper.Stepper(model.replace({f"{field}[general][1]": -2.0}), 1).randomize({f"{field}[general][1]": -3.0})


def test_numbers_that_mujoco_does_not_read_either_are_left_out():
    text = TREE.format(actuators=f'<{UNREAD} name="motor"/>', sensors="")
    compiled, model = mujoco.MjModel.from_xml_string(text), stepper.load(text)
    assert (compiled.actuator_gainprm[0, 1], compiled.actuator_biasprm[0, 0], compiled.actuator_gear[0, 1]) == (7, 5, 1)
    assert (model.actuator_gainprm[0, 1], model.actuator_biasprm[0, 0], model.actuator_gear[0, 1]) == (0, 0, 0)
    check_forces(compiled, simulate(model), np.random.default_rng(0))


@pytest.mark.parametrize(
    "option", ['<option><flag actuation="disable"/></option>', '<option actuatorgroupdisable="2"/><default><position group="2"/></default>']
)
def test_a_disabled_actuator_stays_disabled(option):
    text = f"""<mujoco>{option}<worldbody><body><joint name="hip"/><geom size=".1" pos=".2 0 0"/></body></worldbody>
      <actuator><position name="servo" joint="hip" kp="5" kv="2"/></actuator></mujoco>"""
    model = stepper.load(text)
    np.testing.assert_array_equal(model.actuator_gainprm, mujoco.MjModel.from_xml_string(text).actuator_gainprm)
    sim = stepper.Stepper(model.replace(actuator_gainprm=2.0 * model.actuator_gainprm))
    sim.step([1.0])
    assert not sim.actuator_force.any()


def test_signs_of_zeros_do_not_matter():
    model = stepper.load(SCENE)
    assert model.replace(actuator_biasprm=np.where(model.actuator_biasprm == 0, -0.0, model.actuator_biasprm)) == model


def test_types_survive_a_file_and_a_pickle(tmp_path):
    model = stepper.load(SCENE)
    model.save(tmp_path / "scene.stepper")
    again = stepper.load(tmp_path / "scene.stepper")
    assert again == model
    assert [again.actuator(k).gaintype for k in range(again.nu)] == ["fixed", "fixed", "affine", "fixed", "dcmotor", "pid"]


def test_a_servo_whose_gains_are_0_stays_a_servo():
    model = stepper.load(SCENE)
    slack = model.replace({"actuator_gainprm[servo]": np.zeros(10), "actuator_biasprm[servo]": np.zeros(10)})
    assert slack.replace({"actuator_kp[servo]": 20.0, "actuator_kv[servo]": 3.0}) == model


def test_the_gain_of_a_dc_motor_is_not_identified():
    with pytest.raises(ValueError, match='gaintype of actuator "dcmotor" is "dcmotor"'):
        stepper.sysid.parameters.bind(["actuator_gainprm[dcmotor]"], stepper.load(SCENE))
