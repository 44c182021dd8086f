"""`stepper.load`: what it takes, what it refuses and how it says so, saved models, `explain`, `replace`."""

import fnmatch
import pickle
import re
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
import stepper
from checks import raises
from models import SOURCES, mjcf, mujoco_model, stepper_model
from stepper.loading.mjcf import source
from stepper.loading.mjcf.omissions import FLAGS

PENDULUM = mjcf("pendulum")

# One element of each kind that is left out, on this scene, and what the message must name.
SCENE = """
<mujoco>
  {option}
  <worldbody>
    <geom name="floor" type="plane" size="1 1 1"/>
    <body name="a" pos="0 0 1" {a}>
      <joint name="ja" type="hinge" axis="0 1 0" {ja}/>
      <geom name="ga" {ga}/>
      <site name="sa"/>
    </body>
    <body name="b" pos="1 0 1"><joint name="jb" type="{jb}"/><geom name="gb" size="0.1"/><site name="sb"/></body>
    {world}
  </worldbody>
  {rest}
</mujoco>
"""
LEFT_OUT = {
    "spatial tendon rope: not simulated: actuatorfrcrange": {
        "rest": '<tendon><spatial name="rope" actuatorfrcrange="-1 1"><site site="sa"/><site site="sb"/></spatial></tendon>'
    },
    "fixed tendon belt: not simulated: stiffness that grows with deflection": {
        "rest": '<tendon><fixed name="belt" stiffness="1 2"><joint joint="ja" coef="1"/></fixed></tendon>'
    },
    "actuator stick: transmission body with a force that depends on its length or velocity": {
        "rest": '<actuator><general name="stick" body="a" biastype="affine" biasprm="0 0 -1"/></actuator>'
    },
    "actuator delay lead": {"rest": '<actuator><motor name="lead" joint="ja" nsample="8" interp="cubic" delay="0.0051"/></actuator>'},
    "adhesion ga": {"ga": 'size="0.1" adhesion="1"'},
    "joint spring polynomial ja": {"ja": 'stiffness="1 2"'},
}


def scene(**parts: str) -> str:
    """The scene with some parts filled in."""
    text = SCENE
    if limits := parts.pop("jb_range", ""):
        text = text.replace('type="{jb}"', 'type="{jb}" ' + limits)
    if floor := parts.pop("floor", ""):
        text = text.replace('size="1 1 1"', 'size="1 1 1" ' + floor)
    return text.format(**{"option": "", "a": "", "ja": "", "ga": 'size="0.1"', "jb": "hinge", "world": "", "rest": ""} | parts)


# Sources.


def test_text_file_and_compiled_model_are_the_same(tmp_path: Path) -> None:
    file = tmp_path / "pendulum.xml"
    file.write_text(PENDULUM)
    compiled = mujoco.MjModel.from_xml_string(PENDULUM)
    models = [stepper.load(PENDULUM), stepper.load(file), stepper.load(str(file)), stepper.load(compiled)]
    assert all(model == models[0] for model in models)
    assert len({model.digest for model in models}) == 1


def test_a_saved_model_is_known_by_its_contents(tmp_path: Path) -> None:
    stepper.load(PENDULUM).save(tmp_path / "pendulum.stepper")
    path = (tmp_path / "pendulum.stepper").rename(tmp_path / "pendulum.xml")
    assert stepper.load(path) == stepper.load(PENDULUM)


@pytest.mark.parametrize("name", SOURCES)
def test_every_robot_of_gymnasium_and_dm_control_loads(name: str) -> None:
    compiled, model = mujoco_model(name), stepper_model(name, strict=False)
    assert (model.nq, model.nv, model.nbody, model.ngeom) == (compiled.nq, compiled.nv, compiled.nbody, compiled.ngeom)
    assert model.nu == compiled.nu
    assert model.na == compiled.na
    for kind, number in (("body", model.nbody), ("joint", model.njnt), ("geom", model.ngeom), ("actuator", model.nu)):
        assert getattr(model, f"{kind}_names") == [getattr(compiled, kind)(k).name for k in range(number)]
    for field in ("body_mass", "body_inertia", "body_ipos", "body_pos", "geom_friction", "geom_margin", "dof_damping", "dof_armature"):
        np.testing.assert_array_equal(getattr(model, field), getattr(compiled, field), err_msg=field)
    np.testing.assert_array_equal(model.qpos0, compiled.qpos0)
    weightless = compiled.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY
    np.testing.assert_array_equal(model.gravity, np.zeros(3) if weightless else compiled.opt.gravity)
    assert model.timestep == compiled.opt.timestep


@pytest.mark.parametrize("constraints", [["limit", "frictionloss", "contact", "equality"], ["constraint"]])
def test_disable_flags_apply(constraints: list[str]) -> None:
    flags = ["gravity", "spring", "damper", "clampctrl", "actuation", *constraints]
    option = "<option><flag " + " ".join(f'{flag}="disable"' for flag in flags) + "/></option>"
    joint = 'stiffness="2" damping="1" range="-1 1" limited="true" frictionloss="0.5"'
    rest = '<equality><joint joint1="ja"/></equality><actuator><position name="p" joint="ja" kp="3" ctrlrange="-1 1"/></actuator>'
    model = stepper.load(scene(option=option, ja=joint, rest=rest))
    assert not model.equality_names
    assert not np.any(model.gravity)
    assert not np.any(model.jnt_stiffness)
    assert not np.any(model.dof_damping)
    assert not np.any(model.dof_frictionloss)
    sim = stepper.Stepper(model)
    sim.step([1.0])
    assert not sim.actuator_force.any()
    assert np.all(np.isinf(model.jnt_range))
    assert np.all(np.isinf(model.actuator_ctrlrange))
    assert "pairs of geoms that can collide" in model.explain().split("Not in this scene")[1]


def test_actuators_bring_rotor_inertia_and_damping_through_their_gear() -> None:
    actuators = '<motor joint="ja" gear="3" armature="2" damping="0.5"/><motor joint="ja" gear="-1" armature="1"/>'
    text = scene(ja='armature="0.5" damping="0.1"', rest=f"<actuator>{actuators}</actuator>")
    model, compiled = stepper.load(text), mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(compiled)
    data.qvel[0] = 1
    mujoco.mj_forward(compiled, data)
    assert model.dof_armature[0] == 0.5 + 9 * 2 + 1
    assert model.dof_damping[0] == pytest.approx(-data.qfrc_passive[0], rel=1e-15)


def test_a_limit_stops_at_its_margin() -> None:
    model = stepper.load(scene(ja='limited="true" range="-60 60" margin="0.1"'))
    limit = np.pi / 3 - 0.1
    np.testing.assert_allclose(model.jnt_range[0], [-limit, limit], rtol=1e-15)
    assert ("joint margin", "ja") in [(kind, name) for kind, name, _ in model.omitted]


# Invalid sources and models.


@pytest.mark.parametrize(("named", "parts"), LEFT_OUT.items(), ids=LEFT_OUT)
def test_what_is_not_simulated_is_named_or_left_out(named: str, parts: dict[str, str]) -> None:
    text = scene(**parts)
    with pytest.raises(stepper.ModelError) as error:
        stepper.load(text)
    assert named in str(error.value)
    assert "strict=False" in str(error.value)
    model = stepper.load(text, strict=False)
    left_out = model.explain().split("Left out, which changes the motion:")[1].split("\n\n")[0]
    assert named.split(":", maxsplit=1)[0] in left_out
    assert model.nu == sum(word in text for word in ("lead",))


def test_every_omission_is_listed_at_once() -> None:
    text = scene(
        ja='stiffness="1 2"',
        ga='size="0.1" adhesion="1"',
        rest='<actuator><motor name="lead" joint="ja" nsample="8" interp="cubic" delay="0.0051"/></actuator>',
    )
    with pytest.raises(stepper.ModelError) as error:
        stepper.load(text)
    parts = ("3 elements", "joint spring polynomial ja", "adhesion ga", "actuator delay lead")
    assert all(part in str(error.value) for part in parts)


@pytest.mark.parametrize("parts", [
    {"rest": '<tendon><spatial name="rope"><site site="sa"/><site site="sb"/></spatial></tendon>'},
    {"world": '<light pos="0 0 3"/><camera name="c" pos="0 0 3"/>'},
    {"rest": '<equality><connect active="false" body1="a" body2="b" anchor="0 0 0"/></equality>'},
    {"rest": '<equality><weld body1="a" body2="b"/><joint joint1="ja" joint2="jb"/></equality>'},
    {"rest": '<tendon><fixed limited="true" range="0 1" stiffness="1" damping="1"><joint joint="ja" coef="1"/></fixed></tendon>'},
    {"ga": 'size="0.1" condim="6"'},
    {"jb": "ball", "jb_range": 'limited="true" range="0 1"'},
    {"rest": '<sensor><gyro name="imu" site="sa"/></sensor>'},
    {"option": '<option density="0" wind="1 0 0"/>'},
])  # fmt: skip
def test_what_does_not_change_the_motion_is_no_error(parts: dict[str, str]) -> None:
    stepper.load(scene(**parts))


@pytest.mark.parametrize(("change", "parts"), [
    (lambda m: m.body_mass.__setitem__(1, -1.0), ['body "arm"', "mass is -1 kg", "at least 0"]),
    (lambda m: m.body_inertia.__setitem__(1, [1.0, 1.0, 3.0]), ['body "arm"', "triangle inequality", "inertiafromgeom"]),
    (lambda m: m.body_quat.__setitem__(1, [2.0, 0.0, 0.0, 0.0]), ['body "arm"', "length 2", "length 1"]),
    (lambda m: m.jnt_range.__setitem__(0, [1.0, -1.0]), ['joint "pivot"', "above the upper bound", "lower bound first"]),
    (lambda m: m.geom_friction.__setitem__(1, np.nan), ['geom "rod"', "friction", "NaN"]),
    (lambda m: m.opt.gravity.__setitem__(0, np.nan), ["gravity", "NaN", "finite"]),
    (
        lambda m: [field.__setitem__(k, 0.0) for field, k in ((m.body_mass, 1), (m.body_inertia, 1), (m.dof_armature, 0))],
        ['body "arm": joint "pivot" moves no inertia', "armature"],
    ),
])  # fmt: skip
def test_impossible_values_name_element_value_and_remedy(change, parts: list[str]) -> None:
    compiled = mujoco.MjModel.from_xml_string(PENDULUM)
    change(compiled)
    with pytest.raises(stepper.ModelError) as error:
        stepper.load(compiled)
    assert all(part in str(error.value) for part in parts), str(error.value)


def test_what_mujoco_refuses_is_said_in_its_words() -> None:
    with pytest.raises(stepper.ModelError, match=r"(?s)XML text: MuJoCo's compiler cannot read it.*bodyy"):
        stepper.load("<mujoco><worldbody><bodyy/></worldbody></mujoco>")


def test_missing_files_and_strange_sources() -> None:
    raises(FileNotFoundError, r"no_such\.xml", stepper.load, "no_such.xml")
    raises(TypeError, "int", stepper.load, 3)


def test_without_mujoco_the_message_says_how_to_install_it(tmp_path: Path) -> None:
    saved = tmp_path / "pendulum.stepper"
    stepper.load(PENDULUM).save(saved)
    program = (
        "import sys; sys.modules['mujoco'] = None\n"
        "import stepper\n"
        "assert stepper.load(sys.argv[1]).nq == 1\n"
        "try: stepper.load('<mujoco/>')\n"
        "except ImportError as error: print(error)"
    )
    run = subprocess.run([sys.executable, "-c", program, str(saved)], capture_output=True, text=True, check=True)
    assert 'pip install "stepper-sim[mjcf]"' in run.stdout


# Saved models


@pytest.mark.parametrize("name", ["gymnasium/ant", "dm_control/humanoid", "dm_control/quadruped"])
def test_saved_models_load_bit_for_bit(tmp_path: Path, name: str) -> None:
    model = stepper_model(name, strict=False)
    path = tmp_path / "robot.stepper"
    model.save(path)
    again = stepper.load(path)
    assert again == model
    assert again.to_bytes() == model.to_bytes() == path.read_bytes()
    assert again.digest == model.digest
    assert again.omitted == model.omitted
    assert pickle.loads(pickle.dumps(model)) == model


def test_files_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    good = stepper.load(PENDULUM).to_bytes()
    path = tmp_path / "model.stepper"

    def refusal(contents: bytes) -> str:
        path.write_bytes(contents)
        with pytest.raises(stepper.ModelError) as error:
            stepper.load(path)
        return str(error.value)

    assert "damaged" in refusal(good[:-1])
    assert "damaged" in refusal(good[:-1] + bytes([good[-1] ^ 1]))
    assert "cut off" in refusal(good[:20])
    assert "format version" in refusal(good[:8] + b"\xff\xff\0\0" + good[12:])
    # The last format without hulls.
    assert re.search(r"format version 9, this stepper reads \d+; .* save it again", refusal(good[:8] + b"\x09\0\0\0" + good[12:]))
    assert "model.stepper" in refusal(good[:-1])


# Reports


def test_explain_tells_what_is_modelled_left_out_free_and_beyond() -> None:
    text = stepper_model("dm_control/humanoid").explain()
    for part in (
        "nq 28, nv 27, nu 21",
        "17 bodies",
        "geom pairs can collide",
        "belong to a body and its parent",
        "rows per contact",
        "joint limits",
    ):
        assert part in text
    absent = text.split("Not in this scene, without cost:")[1].split("\n\n")[0]
    assert all(part in absent for part in ("ball joints", "slide joints", "dry friction in joints", "fixed tendons"))
    assert "deformation" in text.split("Never simulated")[1]


def test_explain_counts_merged_bodies() -> None:
    fixed = '<body name="tray"><geom name="gt" size="0.1"/></body>'
    text = stepper.load(scene(world=fixed)).explain()
    assert "2 moving links" in text
    assert "tray into world" in text


# Other numbers


def test_replace_makes_a_new_model() -> None:
    model = stepper.load(PENDULUM)
    friction = model.geom_friction.copy()
    friction[1, 0] = 0.2
    other = model.replace(geom_friction=friction, geom_restitution=[0.0, 0.5], timestep=0.001)
    assert other.geom_friction[1, 0] == 0.2
    assert other.geom_restitution[1] == 0.5
    assert other.timestep == 0.001
    assert model.geom_friction[1, 0] == 0.7
    assert model.timestep == 0.004
    assert other.digest != model.digest
    assert other.replace(geom_friction=model.geom_friction, geom_restitution=[0.0, 0.0], timestep=0.004) == model


def test_equalities_and_tendons_can_be_replaced() -> None:
    belt = '<tendon><fixed name="belt" range="-1 1"><joint joint="ja" coef="1"/><joint joint="jb" coef="2"/></fixed></tendon>'
    model = stepper.load(scene(rest=belt + '<equality><connect name="grip" body1="a" body2="b" anchor="0 0 .1"/></equality>'))
    assert model.eq_active0 == [1.0]
    assert model.eq_data.shape == (1, 11)
    assert model.eq_data[0, :3] == pytest.approx([0, 0, 0.1])
    assert model.tendon_range == pytest.approx(np.array([[-1.0, 1.0]]))
    assert "hard equalities: grip (connect)" in model.explain()
    loose = model.replace(eq_active0=[0.0], tendon_stiffness=[3.0], tendon_range=[[-2.0, 2.0]])
    assert "inactive equalities: grip" in loose.explain()
    assert loose.tendon_stiffness == [3.0]
    raises(stepper.ModelError, "would store as", model.replace, eq_data=np.ones((1, 11)))


def test_replace_refuses_what_a_model_cannot_have() -> None:
    model = stepper.load(PENDULUM)
    raises(stepper.ModelError, r"no field .colour.*help", model.replace, colour=[1.0])
    raises(stepper.ModelError, 'body "arm": mass is -1 kg', model.replace, body_mass=[0.0, -1.0])
    raises(stepper.ModelError, "whole numbers", model.replace, geom_condim=[3.0, 2.5])
    raises(stepper.ModelError, "condim is 5", model.replace, geom_condim=[3.0, 5.0])
    free = stepper.load('<mujoco><worldbody><body><freejoint name="root"/><geom size="0.1"/></body></worldbody></mujoco>')
    raises(stepper.ModelError, "same value", free.replace, dof_damping=[1.0, 0, 0, 0, 0, 0])


# MuJoCo's types and defaults in the loader.


FIELDS = {
    "used": """
        names opt qpos0 qpos_spring exclude_signature wrap_type wrap_objid wrap_prm
        body_parentid body_pos body_quat body_mass body_ipos body_iquat body_inertia body_mocapid body_gravcomp
        jnt_type jnt_dofadr jnt_bodyid jnt_limited jnt_range jnt_margin jnt_pos jnt_axis jnt_stiffness jnt_actfrclimited jnt_actfrcrange
        dof_damping dof_armature dof_frictionloss
        geom_type geom_contype geom_conaffinity geom_condim geom_bodyid geom_dataid geom_priority geom_size geom_pos geom_quat
        geom_friction geom_margin geom_gap geom_surfacevel geom_fluid
        pair_dim pair_geom1 pair_geom2 pair_margin pair_gap pair_friction
        eq_type eq_obj1id eq_obj2id eq_objtype eq_active0 eq_data site_bodyid site_pos site_quat
        tendon_adr tendon_num tendon_limited tendon_range tendon_margin tendon_stiffness tendon_lengthspring tendon_damping tendon_armature
        tendon_frictionloss
        actuator_trntype actuator_dyntype actuator_gaintype actuator_biastype actuator_ctrladr actuator_ctrlnum actuator_outadr
        actuator_actadr actuator_trnid actuator_dynprm actuator_gainprm actuator_biasprm actuator_actlimited actuator_actrange
        actuator_damping actuator_armature actuator_group actuator_forcelimited actuator_forcerange actuator_ctrllimited
        actuator_ctrlrange actuator_gear actuator_delay actuator_history actuator_ctrlspec actuator_actnum
        actuator_cranklength actuator_acc0 actuator_lengthrange
        mesh_vertadr mesh_vertnum mesh_vert mesh_faceadr mesh_facenum mesh_face hfield_size hfield_nrow hfield_ncol hfield_adr hfield_data
        sensor_type sensor_objtype sensor_objid sensor_reftype sensor_refid sensor_intprm sensor_noise sensor_cutoff sensor_delay
        sensor_interval sensor_history site_bodyid site_pos site_quat site_type site_size geom_rgba geom_matid mat_rgba
        geom_solref geom_solimp pair_solref pair_solimp jnt_solref jnt_solimp dof_solref dof_solimp eq_solref eq_solimp
        tendon_solref_lim tendon_solimp_lim tendon_solref_fri tendon_solimp_fri
        key_time key_qpos key_qvel key_act key_ctrl
        """,
    "left out, listed": """
        jnt_actgravcomp jnt_stiffnesspoly jnt_springyield dof_dampingpoly geom_adhesion pair_adhesion
        tendon_actfrclimited tendon_actfrcrange tendon_stiffnesspoly tendon_dampingpoly tendon_springyield
        actuator_actearly actuator_dampingpoly actuator_plugin
        flex_* flexedge_* plugin* body_plugin geom_plugin sensor_plugin
        key_mpos key_mquat flex_solref flex_solimp *_solmix pair_solreffriction
        """,
    # Counts, addresses, names, derived constants, drawing, bounding volumes, and settings of MuJoCo's solver.
    "no effect on the motion": """
        n[a-zA-Z]* flg_* vis stat signature paths
        body_rootid body_weldid body_jntnum body_jntadr body_dofnum body_dofadr body_treeid body_geomnum body_geomadr body_simple
        body_sameframe body_subtreemass body_invweight0 body_margin body_contype body_conaffinity body_bvhadr body_bvhnum
        bvh_* oct_* tree_* *_user *_group *_matid *_rgba
        jnt_qposadr jnt_actuatorid jnt_plasticadr dof_bodyid dof_jntid dof_parentid dof_treeid dof_Madr dof_simplenum dof_invweight0
        dof_M0 dof_length geom_sameframe geom_castshadow geom_aabb site_* cam_* light_* mesh_* skin_* hfield_* tex_* mat_*
        geom_rbound pair_signature efm0_* efmC_perm
        tendon_type tendon_actuatorid tendon_plasticadr tendon_treenum tendon_treeid tendon_width tendon_length0 tendon_invweight0 ten_J_*
        actuator_outnum actuator_historyadr actuator_length0
        sensor_datatype sensor_needstage sensor_dim sensor_adr
        sensor_historyadr key_plastic
        numeric_* text_* tuple_* name_* B_* M_* D_* mapM2M mapM2D mapD2M
        """,
}
"""Meaning of every field of MuJoCo's MjModel."""


def test_every_field_of_mjmodel_is_decided() -> None:
    patterns = " ".join(FIELDS.values()).split()
    compiled = mujoco.MjModel.from_xml_string("<mujoco/>")
    fields = [name for name in dir(compiled) if not name.startswith("_") and not callable(getattr(compiled, name))]
    undecided = [name for name in fields if not any(fnmatch.fnmatchcase(name, pattern) for pattern in patterns)]
    assert not undecided, "decide in FIELDS what new fields of MjModel mean"
    used = FIELDS["used"].split()
    assert not [name for name in used if not hasattr(compiled, name)]


@pytest.mark.parametrize("which", ["disable", "enable"])
def test_every_flag_of_mujoco_is_honoured_or_listed(which: str) -> None:
    """Of a scene that has something of all that flags are about; what a listed flag says stands in `omitted` and in `explain`."""
    enum, prefix = {"disable": ("mjtDisableBit", "mjDSBL_"), "enable": ("mjtEnableBit", "mjENBL_")}[which]
    flags = {n.removeprefix(prefix).lower(): int(v) for n, v in getattr(mujoco, enum).__members__.items() if n.startswith(prefix)}
    listed = {name: 1 << bit for name, (bit, _, _) in FLAGS[which].items()}
    honoured = source.DISABLE if which == "disable" else source.ENABLE
    assert honoured | listed == flags, "decide in stepper/loading/mjcf/omissions.py what new flags of MuJoCo mean"
    scene = """<mujoco><worldbody><geom type="plane" size="1 1 1"/>
      <body pos="0 0 1"><joint damping="1"/><geom size=".1"/></body></worldbody></mujoco>"""
    for name, bit in flags.items():
        compiled = mujoco.MjModel.from_xml_string(scene)
        before = {(kind, place) for kind, place, _ in stepper.load(compiled, strict=False).omitted}
        setattr(compiled.opt, f"{which}flags", bit)
        model = stepper.load(compiled, strict=False)
        new = {(kind, place) for kind, place, _ in model.omitted} - before
        assert new == ({(f"flag {name}", f"{which}d")} if name in listed else set())
        assert name not in listed or f"flag {name}" in model.explain()


def test_the_compilers_warnings_are_pythons(tmp_path, monkeypatch):
    """They name the source, and no MUJOCO_LOG.TXT appears in the working directory."""
    monkeypatch.chdir(tmp_path)
    old = '<mujoco><compiler settotalmass="2"/><worldbody><body><freejoint/><geom size="1"/></body></worldbody></mujoco>'
    with pytest.warns(UserWarning, match="XML text: .*settotalmass"):
        model = stepper.load(old)
    assert model.body_mass[1] == pytest.approx(2.0)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("limit", ["", 'actuatorfrcrange="-1 1"'])
def test_gravity_compensation_by_actuators_is_listed_and_is_an_error_only_where_it_changes_the_motion(limit):
    """MuJoCo counts it as an actuator force; here it is a passive one, which readings of actuator forces do not contain."""
    scene = f"""<mujoco><worldbody><body gravcomp="1"><joint name="j" axis="0 1 0" actuatorgravcomp="true" {limit}/>
    <geom size=".1" mass="1" pos=".5 0 0"/></body></worldbody></mujoco>"""
    if limit:
        raises(stepper.ModelError, "joint gravity compensation j", stepper.load, scene)
    else:
        ((kind, name, reason),) = stepper.load(scene).omitted
        assert (kind, name) == ("joint gravity compensation", "j")
        assert "qfrc_actuator and jointactuatorfrc do not contain" in reason
