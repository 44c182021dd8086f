"""Hints of the errors for names of MuJoCo, dm_control, Isaac Lab and others: each names a replacement that exists, or says what is absent.

`check` executes every name and call that a hint contains.
"""

import inspect
import re

import mujoco
import numpy as np
import pytest
import stepper
from stepper import _stepper
from stepper._hints import did_you_mean, no_attribute, not_assigned, unknown_keyword
from stepper._other_names import NEW_KEYWORDS, NEW_KEYWORDS_OF, NEW_NAMES, ROOT_NAMES
from stepper.shared.fields import RANDOMIZED

SCENE = """<mujoco><asset><hfield name="x" nrow="3" ncol="3" size="1 1 1 1"/></asset><worldbody>
  <geom name="x" type="hfield" hfield="x" pos="0 0 -9"/>
  <body name="x"><joint name="x"/><geom name="ball" size=".1" mass="1"/><site name="x"/></body><body name="moved" mocap="true" pos="0 3 0"/>
  </worldbody><contact><pair name="x" geom1="x" geom2="ball"/></contact><equality><joint joint1="x"/></equality>
  <tendon><fixed name="x"><joint joint="x" coef="1"/></fixed></tendon><actuator><position name="x" joint="x" kp="1"/></actuator>
  <sensor><jointpos name="x" joint="x"/></sensor><keyframe><key name="x"/></keyframe></mujoco>"""
"""Scene in which every kind of element has one with the name "x"."""
MODEL = stepper.load(SCENE)
SIM = stepper.Stepper(MODEL, 6)
STATE = SIM.get_state()
LONGEST = 260
"""Characters of a message."""
WORDS = {"stepper.Model": "model", "stepper.Stepper": "sim", "stepper": "stepper"}
TABLES = {"stepper.Model": NEW_NAMES["Model"], "stepper.Stepper": NEW_NAMES["Stepper"], "stepper": ROOT_NAMES}
OWNERS = {"stepper.Model": MODEL, "stepper.Stepper": SIM, "stepper": stepper}

CODE = re.compile(r"(?<![\w.'\"\[])(?:sim|model|stepper|mujoco|np|copy|gymnasium)(?:\.\w+(?:\([^()]*(?:\([^()]*\)[^()]*)*\)|\['\w+'\])?)+")
"""Names and calls in a hint, such as "sim.read('xpos', name)"."""
INSTANCES = r"(?:sim|model|stepper|mujoco|np|copy|len)\b"
NAMES = {
    "sim": SIM, "model": MODEL, "stepper": stepper, "mujoco": mujoco, "np": np, "name": "x", "geom": "x", "qacc": np.zeros(1),
    "ctrl": np.zeros(1), "nstep": 1, "state": STATE, "points": np.ones((1, 3)), "directions": np.ones((1, 3)), "sources": 0, "envs": [0],
    "q": np.zeros(1), "dv": np.zeros(1), "q1": np.zeros(1), "q2": np.zeros(1), "num_envs": 2, "qpos": np.zeros(1), "qvel": np.zeros(1),
    "mujoco_model": mujoco.MjModel.from_xml_string(SCENE), "x": np.zeros((6, 1, 1)),
    "copy": __import__("copy"), "gymnasium": __import__("gymnasium"), "env": 0, "bytes": STATE.bytes,
}  # fmt: skip
"""Values of the words in the calls of hints."""


def run(code):
    """Value of a name or call of a hint. A call that has an ellipsis or a path is not executed: its keywords must exist."""
    if re.search(r"\.\.\.|\bpath\b|\bview\(\)|Renderer\(|rollout\(ctrl\)", code):
        head, _, given = code.partition("(")
        target = eval(head, {}, NAMES)
        assert callable(target), code
        inner = re.sub(r"\([^()]*\)", "", given)
        assert faults(given) == [], code
        given = re.findall(r"(\w+)=", inner)
        known = inspect.signature(target).parameters if given else {}
        wild = any(one.kind is one.VAR_KEYWORD for one in known.values())
        assert wild or set(given) <= known.keys(), code
        return None
    if code.endswith("]") and ".randomized" in code:  # It has a field after it was randomized.
        SIM.randomize(**{code[code.index("'") + 1 : -2]: getattr(MODEL, code[code.index("'") + 1 : -2])[None].repeat(6, 0)})
    return eval(code, {}, NAMES)


def faults(text):
    """Errors of the names and calls in a text."""
    found = []
    for code in [*CODE.findall(text), *re.findall(r"len\([\w.]+\)", text)]:
        try:
            run(code)
        except ImportError:  # stepper.adapters.torch without PyTorch
            continue
        except (AssertionError, AttributeError, TypeError, ValueError, KeyError, NameError) as error:
            found.append(f"{text}: {code}: {type(error).__name__}: {error}")
    return found


def check(error, owner):
    """What the hint of an error says wrongly, if anything. `owner` is the word for the object of the error: "sim", "model" or "stepper"."""
    hint = re.split(r"has no attribute '\w+'", str(error), maxsplit=1)[1]
    if not hint.startswith("; ") or len(str(error)) > LONGEST:
        return [f"{error}: no hint, or too long"]
    first = re.match(rf"; (?:did you mean|use) ((?!{INSTANCES})\w+(?:\.\w+)*(?:\([^()]*\)(?:\.\w+)?)?)", hint)
    relative = f"{owner}.{first[1]}" if first and owner != "stepper" else ""
    return [f"{error}: {fault}" for fault in [*faults(hint), *faults(relative)]]


def error_of(owner, name):
    with pytest.raises(AttributeError) as error:
        getattr(owner, name)
    return error.value


ROOT = [name for name in dir(mujoco) if re.match(r"mj|Mj|[gs]et_mj", name)]
FROM_MUJOCO = [
    *(("stepper.Model", name) for name in dir(mujoco.MjModel) if not name.startswith("_")),
    *(("stepper.Stepper", name) for name in dir(mujoco.MjData) if not name.startswith("_")),
    *(("stepper", name) for name in ROOT),
    # In MuJoCo the names of the model are in the model alone, and those of the data in the data; here some are looked for in the other.
    *(("stepper.Stepper", name) for name in dir(mujoco.MjModel) if not name.startswith("_")),
    *(("stepper.Model", name) for name in dir(mujoco.MjData) if not name.startswith("_")),
]


@pytest.mark.parametrize("place", OWNERS)
def test_every_public_name_of_mujoco_exists_or_has_a_hint_that_was_written_for_it(place):
    """A similar spelling is no such hint: "neq" is not "nq"."""
    owner = OWNERS[place]
    wrong = []
    for where, name in FROM_MUJOCO:
        if where != place or hasattr(owner, name):
            continue
        error = error_of(owner, name)
        hint = str(error).partition(f"has no attribute {name!r}")[2]
        similar = did_you_mean(name, dir(owner))
        if not hint or (hint == similar and name not in TABLES[place]):
            wrong.append(f"{name}{hint}")
        else:
            wrong += check(error, WORDS[place])
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("place", OWNERS)
def test_every_row_of_the_tables_has_a_hint_that_can_be_followed(place):
    owner, rows = OWNERS[place], TABLES[place]
    assert [row for row in rows if hasattr(owner, row)] == []
    wrong = [text for row in rows for text in check(error_of(owner, row), WORDS[place])]
    assert not wrong, "\n".join(wrong)


OTHERS = {
    "stepper.Model": """
        bodies body_name2id collision_pairs copy dof dof_names eq_names equality_names geom_pairs geoms get_xml height_field
        height_fields heights hfield_names hfields id2name integrator jnt_names joints links mjmodel name2id num_bodies num_dof
        num_envs num_joints ptr set set_hfield set_timestep text to_mujoco to_xml to_xml_string total_mass view
    """,
    "stepper.Stepper": """
        accelerometer advance apply apply_force apply_rigid_body_force_tensors base_ang_vel base_lin_vel batch_size body_jacobian
        body_lin_vel body_names body_pos_w body_vel body_velocity body_xmat body_xpos body_xquat body_xvelp cast_ray
        center_of_mass_position clear_randomization clone close collide compute contact_force contact_forces control
        control_timestep copy data derivatives detect_contacts device distance dof_pos dof_states dof_vel domain_randomize dt
        dynamics ee_pos evaluate fd fetch_results field fields fork forward forward_kinematics friction fullM full_mass_matrix
        geom_distance geom_linvel geom_xvelp get get_body get_body_xpos get_contacts get_field get_jacobian get_model get_qpos
        get_sensor get_site_xpos get_state_vector get_states grad gradient gravity in_contact integrate integrate_pos inverse jac
        jac_body jac_site jacobians jacp joint_names joint_pos joint_positions joint_qpos joint_vel kinetic_energy linearise
        linvel load_state log mass max_contacts model_of models n_sub_steps name named nbatch net_contact_forces noise nstack
        num_bodies num_dofs nworld object_velocity obs parameters params physics position potential_energy projected_gravity qM
        qpos_torch randomization ray ray_cast raycast rb_states refresh render replace reset_envs reset_idx reset_keyframe
        reset_randomization reset_to restore rigid_body_pos rigid_body_states root_lin_vel_b root_pos root_pos_w root_states run
        save save_state sensor_data set set_body_mass set_control set_controls set_ctrl set_damping set_dof_pos
        set_dof_position_target_tensor set_dof_state_tensor_indexed set_dof_targets set_external_force_and_torque set_friction
        set_geom_friction set_gravity set_joint_effort_target set_joint_position_target set_joint_positions set_joint_qpos
        set_mass set_mocap set_mocap_pos set_model set_options set_param set_parameter set_parameters set_params set_qpos set_qvel
        set_seed set_sensor_noise set_states set_time set_xfrc_applied simulate site_jacobian site_linvel snapshot solve_ik
        start_recording state state_size status_names step1 stop_recording substep torch touch trajectory transition_fd update
        values velocity viewer wind write write_joint_state_to_sim write_root_state_to_sim xvel xvelp
    """,
    "stepper": """
        Actuator Actuators Batch BatchEnv BatchSim BatchedSim Data Delay Env HeightField Log MjSim MjVFS NoiseModel Physics
        Recording Scene Sensor SensorNoise Sensors Sim Simulation Simulator Spec StepperError System Terrain Trajectory VecEnv
        VectorEnv Viewer World add_terrain batch convert dm_control domain_randomization forward generate_terrain get_data grad
        ground gym heightfield heightfields ik jax jit launch list_envs load_model load_model_from_path load_model_from_xml
        load_recording load_xml loads make make_data make_vec mjcf mjx noise put_data put_model randomize read_recording record
        registry render reset rollout rough sb3 scene spec status step suite terrain terrains testspeed to_mujoco torch trajectory
        utils view vmap worlds wrappers
    """,
}
"""Names of dm_control, mujoco-py, Isaac Gym, Isaac Lab, MJX and Brax, and others that a user may try."""


@pytest.mark.parametrize("place", OWNERS)
def test_names_of_other_simulators_have_hints_that_can_be_followed(place):
    owner, wrong = OWNERS[place], []
    for name in OTHERS[place].split():
        error = error_of(owner, name)
        similar = str(error).endswith(f"{name!r}{did_you_mean(name, dir(owner))}") and name not in TABLES[place]
        wrong += [f"{error}: a similar name"] if similar else check(error, WORDS[place])
    assert not wrong, "\n".join(wrong)


CALLS = {
    "stepper.Stepper": stepper.Stepper,
    **{f"Stepper.{name}": getattr(stepper.Stepper, name) for name in dir(stepper.Stepper) if not name.startswith("_")},
}


@pytest.mark.parametrize("call", [call for call in NEW_KEYWORDS_OF if call in CALLS])
def test_every_keyword_of_other_simulators_names_one_that_the_call_takes_or_another_call(call):
    known = inspect.signature(CALLS[call]).parameters
    for name in {*NEW_KEYWORDS_OF[call], *NEW_KEYWORDS} - known.keys():
        text = unknown_keyword(call, name, [other for other in known if other != "self"])
        assert text.startswith(f"{call}() takes no {name!r}")
        assert faults(text.partition(repr(name))[2]) == []
        if name in NEW_KEYWORDS_OF[call]:
            first = re.split(r"\W", NEW_KEYWORDS_OF[call][name])[0]
            assert first in {*known, "sim", "stepper", "the"} or hasattr(SIM, first), text


@pytest.mark.parametrize("call", ["Stepper.randomize", "Model.replace"])
@pytest.mark.parametrize("name", ["kp", "kv", "kd", "actuator_kp", "actuator_kv"])
def test_gains_of_servos_are_named_by_a_selector_that_the_call_takes(call, name):
    give = {"Stepper.randomize": SIM.randomize, "Model.replace": MODEL.replace}[call]
    with pytest.raises(stepper.ModelError) as error:
        give(**{name: 1.0})
    selector = re.search(r"use \{'(\w+\[name\])': \.\.\.\} as the first argument$", str(error.value))[1]
    give({selector.replace("name", "x"): 2.0})


@pytest.mark.parametrize("call", ["Stepper.randomize", "Model.replace"])
@pytest.mark.parametrize(("name", "hint"), [
    ("env_ids", "did you mean envs"),
    ("joint_damping", "did you mean dof_damping"),
    ("mass", "did you mean body_mass"),
    ("geom_rgba", "colours, materials and other looks are not part of a model"),
    ("hfield_data", "other heights need another file"),
    ("jnt_axis", "change the file"),
    ("body_parentid", "change the file"),
    ("delay", "stepper.Stepper(model, "),
    ("noise", "stepper.Stepper(model, sensors="),
])  # fmt: skip
def test_names_that_are_no_field_are_said_to_be_elsewhere(call, name, hint):
    if (call, name) == ("Model.replace", "env_ids"):
        return
    give = {"Stepper.randomize": SIM.randomize, "Model.replace": MODEL.replace}[call]
    with pytest.raises(stepper.ModelError) as error:
        give(**{name: 1.0})
    assert hint in str(error.value)
    assert faults(str(error.value).partition(";")[2]) == []


def test_fields_of_randomize_are_the_hint_of_a_stepper():
    """Reading and assigning: the values of an environment are not those of the model."""
    for field in RANDOMIZED:
        for attempt in (lambda: getattr(SIM, field), lambda: setattr(SIM, field, 1.0)):  # noqa: B023
            with pytest.raises(AttributeError) as error:
                attempt()
            assert f"sim.model.{field}" in str(error.value)
            assert ("use geom_xpos" in str(error.value)) == (field == "geom_pos")
            assert f"sim.randomize({field}=...)" in str(error.value)
            assert f"sim.randomized['{field}']" in str(error.value)
            assert faults(str(error.value).partition(";")[2]) == []


ELEMENTS = {
    "Body": "xpos xquat rgba rootid subtreemass geoms joints gravcomp parent cinert cvel xmat user invweight0 weldid",
    "Joint": "qpos qvel qacc anchor body margin solref actfrcrange group springyield",
    "Geom": "xpos xmat rgba group dataid rbound matid solref body surfacevel",
    "Site": "xpos xmat size rgba group body",
    "Actuator": "ctrl force dyntype length velocity joint group",
    "Sensor": "data objid reftype datatype user",
    "Tendon": "length velocity lengthspring rgba width num",
    "Keyframe": "mpos mquat",
    "Pair": "signature adhesion",
    "State": "qpos qvel time save load num_envs copy ctrl",
}
"""Names that users look for on an element of a model, or on a state."""


@pytest.mark.parametrize("kind", ELEMENTS)
def test_elements_of_a_model_have_hints_that_can_be_followed(kind):
    """`no_attribute` serves these classes too. Their own attributes are the words at the start of a hint."""
    owner = getattr(_stepper, kind)
    instance = STATE if kind == "State" else getattr(MODEL, kind.lower())("x")
    wrong = []
    for name in ELEMENTS[kind].split():
        if hasattr(owner, name):
            continue
        error = str(no_attribute(owner, name))
        hint = error.partition(f"has no attribute {name!r}")[2]
        assert error.startswith("a stepper.State" if kind == "State" else f"a stepper.Model's {kind.lower()}"), error
        first = re.match(rf"; (?:did you mean|use) ((?!{INSTANCES})\w+)", hint)
        if not hint or (first and not hasattr(instance, first[1])):
            wrong.append(error)
        wrong += faults(hint)
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize(("name", "hint"), [
    ("xvel", "did you mean body_linvel?"),
    ("acc", "did you mean qacc?"),
    ("body_mass", "sim.randomize(body_mass=...)"),
    ("ten_length", "a sensor has it"),
    ("time", "use sim.time, which has no elements"),
    ("zzz", "there are: actuator_force"),
])  # fmt: skip
def test_a_quantity_that_read_does_not_have_is_said_to_be_elsewhere(name, hint):
    with pytest.raises(ValueError, match=re.escape(hint)) as error:
        SIM.read(name)
    assert faults(str(error.value).partition(";")[2]) == []


@pytest.mark.parametrize("kind", [kind for kind in ELEMENTS if kind != "State"])
def test_an_assignment_to_an_attribute_of_an_element_names_what_sets_it(kind):
    for name in dir(getattr(_stepper, kind)):
        if not name.startswith("_"):
            error = str(not_assigned(getattr(_stepper, kind), name))
            assert error.startswith(f"{name} of a stepper.Model's {kind.lower()} cannot be assigned: ")
            assert faults(error.partition(": ")[2]) == []
            for field in re.findall(r"sim\.randomize\((\w+)=", error):
                assert field in RANDOMIZED
