"""Hints of the errors for names of MuJoCo, dm_control, Isaac Lab and others: each names a replacement that exists, or says what is absent.

`check` executes every name and call that a hint contains.
"""

import inspect
import re

import mujoco
import numpy as np
import pytest
import stepper
from stepper._hints import did_you_mean, hint_of
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
    "spec": mujoco.MjSpec.from_string(SCENE),
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
    """Faults of the hint of an error, as texts. `owner` is the word for the object of the error: "sim", "model" or "stepper"."""
    hint = re.split(r"has no attribute '\w+'", str(error), maxsplit=1)[1]
    if not hint.startswith("; ") or len(str(error)) > LONGEST:
        return [f"{error}: no hint, or too long"]
    first = re.match(rf"; (?:did you mean|use) ((?!{INSTANCES})\w+(?:\.\w+)*(?:\([^()]*\)(?:\.\w+)?)?)", hint)
    relative = f"{owner}.{first[1]}" if first and owner != "stepper" else ""
    return [f"{error}: {fault}" for fault in [*faults(hint), *faults(relative)]]


def is_written(owner, name):
    """Whether a hint is from a table or a rule, not a similar spelling."""
    if owner is stepper:
        return str(error_of(owner, name)).partition(repr(name))[2] not in ("", did_you_mean(name, dir(stepper)))
    return hint_of(type(owner), name) != ""


def error_of(owner, name):
    with pytest.raises(AttributeError) as error:
        getattr(owner, name)
    return error.value


def is_imported(name):
    """Whether a name in `mujoco` is that of another package: a module such as numpy, or a type for annotations."""
    thing = getattr(mujoco, name)
    if inspect.ismodule(thing):
        return not thing.__name__.startswith("mujoco")
    return getattr(thing, "__module__", "") in ("typing", "types", "collections.abc")


ROOT = [name for name in dir(mujoco) if not name.startswith("_") and not is_imported(name)]
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
        wrong += check(error, WORDS[place]) if is_written(owner, name) else [str(error)]
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
        accel acceleration accelerations accelerometer acquire_dof_state_tensor action_dim action_size action_space activation
        actuator_names actuator_size add_render_callback advance ang ang_vel angular_velocity applied_torque apply apply_force
        apply_rigid_body_force_tensors base_ang_vel base_lin_vel batch_size body_ang_vel_w body_jacobian body_lin_vel
        body_lin_vel_w body_link_pos_w body_names body_pos_w body_quat_w body_state_w body_vel body_velocity body_xmat body_xpos
        body_xquat body_xvelp cast_ray center_of_mass_position cfg check_divergence check_invalid_state clear_randomization clone
        close collide collision collisions com_pos com_vel common_step_counter compute computed_torque contact_force
        contact_forces contact_pairs contact_points contexts control control_timestep copy ctrl_range data ddq decimation
        default_joint_pos default_mass default_root_state depth derivatives detect_contacts device distance dof_force
        dof_force_tensor dof_pos dof_states dof_vel domain_randomize done dones dq dt dynamics ee_pos effort efforts elapsed_steps
        env env_origins episode episode_length_buf episodes euler evaluate external_force fd fetch_results field fields
        find_bodies find_joints fk force forces fork forward forward_kinematics frame frames free friction from_byte_string
        from_model fullM full_mass_matrix geom_distance geom_linvel geom_names geom_xvelp get get_body get_body_jacp get_body_jacr
        get_body_xmat get_body_xpos get_body_xquat get_body_xvelp get_body_xvelr get_camera_xpos get_contacts get_field
        get_geom_xpos get_jacobian get_joint_qpos get_joint_qvel get_mocap_pos get_model get_obs get_observation get_qpos
        get_reward get_sensor get_site_jacp get_site_xmat get_site_xpos get_site_xvelp get_state_vector get_states get_xml grad
        gradient gravity heading_w ik image images impulse impulses in_contact info infos init init_q integrate integrate_pos
        inverse is_colliding jac jac_body jac_site jacobians jacp joint_acc joint_armature joint_damping joint_effort_target
        joint_forces joint_friction joint_limits joint_names joint_pos joint_pos_limits joint_pos_target joint_positions
        joint_qpos joint_stiffness joint_torque joint_torques joint_vel joint_vel_target kinematics kinetic_energy legacy_step
        limits lin_vel linear_velocity linearise link link_names linvel load_state log mass max_contacts max_episode_length
        metrics model_of models n_actions n_contacts n_obs n_sub_steps name named nbatch net_contact_forces nobs noise normal
        normals nstack nstate nsubsteps num_bodies num_contacts num_dof num_dofs num_instances num_joints num_links num_steps
        nworld object_velocity obs obs_buf obs_dim observation_size observation_space orientation orientations parameters params
        penetration penetrations physics physics_dt pipeline_state pipeline_step pixels pos pose poses position potential_energy
        progress_buf projected_gravity projected_gravity_b q qM q_size qd qd_size qdd qpos_torch quat random randomization ray
        ray_cast raycast rb_states refresh refresh_dof_state_tensor reload_from_xml_path reload_from_xml_string render
        render_contexts replace reset_buf reset_envs reset_idx reset_keyframe reset_randomization reset_to restore rew_buf reward
        rewards rgb rigid_body_pos rigid_body_states rng root_ang_vel_b root_ang_vel_w root_lin_vel_b root_lin_vel_w
        root_link_pos_w root_pos root_pos_w root_quat_w root_state_w root_states rot rotation rotations rpy run save save_state
        scene screenshot seed_all sensor_data sensor_names set set_body_mass set_camera set_constants set_control set_controls
        set_ctrl set_damping set_dof_actuation_force_tensor set_dof_pos set_dof_position_target_tensor
        set_dof_state_tensor_indexed set_dof_targets set_external_force_and_torque set_friction set_geom_friction set_gravity
        set_joint_effort_target set_joint_position_target set_joint_positions set_joint_qpos set_joint_qvel
        set_joint_velocity_target set_mass set_mocap set_mocap_pos set_mocap_quat set_model set_options set_param set_parameter
        set_parameters set_params set_qpos set_qvel set_seed set_sensor_noise set_states set_time set_xfrc_applied simulate
        site_jacobian site_linvel site_names snapshot soft_joint_pos_limits solve_ik spaces start_recording state state_size
        status_names step1 step_count step_dt stop_recording substep substep_callback suppress_physics_errors sys tau terminated
        torch torque torques touch touching trajectory transform transforms transition_fd truncated u update values vel velocity
        video viewer wind wrench write write_data_to_sim write_joint_position_to_sim write_joint_state_to_sim
        write_root_pose_to_sim write_root_state_to_sim write_root_velocity_to_sim x xd xform xvel xvelp
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
        wrong += check(error, WORDS[place]) if is_written(owner, name) else [str(error)]
    assert not wrong, "\n".join(wrong)


CALLS = {
    "stepper.Stepper": stepper.Stepper,
    **{call: getattr(SIM, call.partition(".")[2]) for call in NEW_KEYWORDS_OF if call.startswith("Stepper.")},
}
REQUIRED = {
    "stepper.Stepper": (MODEL,), "Stepper.save_problem": ("problem",), "Stepper.rollout": (np.zeros((1, 1)),),
    "Stepper.rays": (np.ones((1, 3)), np.ones((1, 3))), "Stepper.read": ("xpos",),
}  # fmt: skip
"""Arguments that calls require."""


@pytest.mark.parametrize("call", CALLS)
def test_every_keyword_of_other_simulators_names_one_that_the_call_takes_or_another_call(call):
    known = inspect.signature(CALLS[call]).parameters
    for name in {*NEW_KEYWORDS_OF[call], *NEW_KEYWORDS} - known.keys():
        with pytest.raises(TypeError) as error:
            CALLS[call](*REQUIRED.get(call, ()), **{name: 1})
        text = str(error.value)
        assert text.startswith(f"{call}() takes no {name!r}")
        assert faults(text.partition(repr(name))[2]) == []
        if name in NEW_KEYWORDS_OF[call]:
            first = re.split(r"\W", NEW_KEYWORDS_OF[call][name])[0]
            assert first in {*known, "sim", "stepper", "the"} or hasattr(SIM, first), text


def getter(name):
    """Function that reads an attribute of a stepper."""
    return lambda: getattr(SIM, name)


@pytest.mark.parametrize(("attempt", "hint"), [
    (lambda: SIM.get_stat, "did you mean get_state"),
    (lambda: SIM.set_stat, "did you mean set_state"),
    (lambda: SIM.get_param, "sim.randomize(...) sets parameters of each environment"),
    (lambda: SIM.get_values, "use read('xpos', name)"),
    (lambda: SIM.randomize(body_xpos=1), "no field 'body_xpos'; sim.set_state(qpos=...) moves bodies"),
    (lambda: SIM.randomize(joint_pos=1), "no field 'joint_pos'; sim.set_state(qpos=...) sets it"),
    (lambda: stepper.ActuatorModel(noise=3), "takes no 'noise': use a disturbance added to the controls: a drive has no noise"),
    (lambda: stepper.rendering, "stepper.viewer.Renderer(model) draws pictures"),
    (lambda: stepper.from_zip, "use mujoco.from_zip(path), then stepper.load(spec)"),
    (lambda: stepper.mj_setTotalmass, "use model.replace(...), which recomputes dependent values"),
    (lambda: stepper.mjd_inverseFD, "derivatives of inverse dynamics are not computed"),
    (lambda: stepper.mju_user_warning, "there are no callbacks"),
    (lambda: stepper.mju_threadpool, "did you mean stepper.Stepper(model, threads=...)?"),
    (lambda: MODEL.dof_invweight0, "mujoco.MjModel.from_xml_path(path) of the same file has it"),
    *((getter(name), "use xfrc_applied of bodies and sim.qfrc_applied of joints") for name in (
        "add_force", "apply_force", "add_torque", "apply_torque", "apply_joint_force", "set_external_force", "xfrc", "push",
        "add_force_at_pos", "apply_impulse", "apply_ft",
    )),
    *((getter(name), "use reset(keyframe=...), the state of a keyframe") for name in (
        "set_keyframe", "set_key", "load_keyframe", "apply_keyframe", "go_to_keyframe", "reset_to_key", "init_keyframe",
    )),
    *((getter(name), "keyframes are those of the file") for name in ("add_keyframe", "save_keyframe", "create_key")),
    *((getter(name), "did you mean jacobian(site=name)?") for name in ("jac_site", "site_jac", "get_site_jacp", "jacobian_site")),
    *((getter(name), "use jacobian(body=name), or sim.jacobian(site=name)") for name in ("jac", "jacp", "jac_body", "get_body_jacr")),
    (lambda: MODEL.add_force, "use sim.xfrc_applied of bodies and sim.qfrc_applied of joints"),
    (lambda: MODEL.set_keyframe, "use sim.reset(keyframe=...), the state of a keyframe"),
])  # fmt: skip
def test_a_hint_names_what_does_the_same(attempt, hint):
    with pytest.raises((AttributeError, TypeError, ValueError), match=re.escape(hint)):
        attempt()


@pytest.mark.parametrize("owner", [SIM, MODEL, stepper, stepper.recording, stepper.Options(), MODEL.body("x")])
def test_a_special_name_of_python_has_no_hint(owner):
    with pytest.raises(AttributeError, match=r"has no attribute '__array_interfac__'$"):
        getattr(owner, "__array_interfac__")  # noqa: B009


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


@pytest.mark.parametrize(("owner", "name", "hint"), [
    (SIM, "geom_frictoin", "did you mean sim.model.geom_friction?"),
    (MODEL, "sensordat", "did you mean sim.sensordata?"),
    (SIM, "qpso", "did you mean qpos?"),
    (MODEL, "body_mas", "did you mean body_mass"),
])  # fmt: skip
def test_a_misspelt_name_of_the_other_class_is_suggested(owner, name, hint):
    assert hint in str(error_of(owner, name))


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


def element(kind):
    return STATE if kind == "State" else getattr(MODEL, kind.lower())("x")


@pytest.mark.parametrize("kind", ELEMENTS)
def test_elements_of_a_model_have_hints_that_can_be_followed(kind):
    """Attributes of the element are the words at the start of a hint."""
    instance, wrong = element(kind), []
    for name in ELEMENTS[kind].split():
        if hasattr(instance, name):
            continue
        error = str(error_of(instance, name))
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
    ("time", "there is no quantity 'time'; use sim.time"),
    ("zzz", "there are: actuator_force"),
])  # fmt: skip
def test_a_quantity_that_read_does_not_have_is_said_to_be_elsewhere(name, hint):
    with pytest.raises(ValueError, match=re.escape(hint)) as error:
        SIM.read(name)
    assert faults(str(error.value).partition(";")[2]) == []


@pytest.mark.parametrize("kind", [kind for kind in ELEMENTS if kind != "State"])
def test_an_assignment_to_an_attribute_of_an_element_names_what_sets_it(kind):
    for name in dir(element(kind)):
        if not name.startswith("_"):
            with pytest.raises(AttributeError) as raised:
                setattr(element(kind), name, 1)
            error = str(raised.value)
            assert error.startswith(f"{name} of a stepper.Model's {kind.lower()} cannot be assigned: ")
            assert faults(error.partition(": ")[2]) == []
            for field in re.findall(r"sim\.randomize\((\w+)=", error):
                assert field in RANDOMIZED


def test_passive_forces_are_the_expression_of_the_hint():
    text = SCENE.replace('<joint name="x"/>', '<joint name="x" stiffness="2" damping=".5"/>')
    sim, model = stepper.Stepper(stepper.load(text), 6), mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    sim.set_state(qpos=[0.3], qvel=[0.4])
    data.qpos[:], data.qvel[:] = 0.3, 0.4
    mujoco.mj_forward(model, data)
    code = CODE.findall(str(error_of(sim, "qfrc_passive")).partition(";")[2])
    assert " - ".join(code) in str(error_of(sim, "qfrc_passive"))
    first, second = (eval(one, {}, {**NAMES, "sim": sim}) for one in code)
    np.testing.assert_allclose((first - second)[0], data.qfrc_passive, atol=1e-12)


MUJOCO = mujoco.MjModel.from_xml_string(SCENE)
DATA = mujoco.MjData(MUJOCO)


@pytest.mark.parametrize("kind", [kind for kind in ELEMENTS if kind != "State"])
def test_every_name_of_an_element_in_mujoco_exists_or_has_a_hint(kind):
    """Elements of MuJoCo's model, and those of its data, which stepper's elements are tried as."""
    owner, wrong = element(kind), []
    for source in (MUJOCO, DATA):
        theirs = dir(getattr(source, kind.lower())("x")) if hasattr(source, kind.lower()) else []
        for name in theirs:
            if not name.startswith("_") and not hasattr(owner, name):
                error = error_of(owner, name)
                wrong += faults(str(error).partition(";")[2]) if is_written(owner, name) else [str(error)]
    assert not wrong, "\n".join(wrong)


def test_the_jacobian_of_a_site_by_its_name_alone_names_the_argument():
    sim = stepper.Stepper(stepper.load('<mujoco><worldbody><body><joint/><geom size=".1"/><site name="tip"/></body></worldbody></mujoco>'))
    with pytest.raises(KeyError, match=r"no body is named 'tip', but a site is: jacobian\(site='tip'\)"):
        sim.jacobian("tip")
    with pytest.raises(KeyError, match="tap"):
        sim.jacobian("tap")
    assert sim.jacobian(site="tip").shape == (6, 1)
