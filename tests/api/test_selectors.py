"""Selectors and elements: one grammar for parts of a field, whole or in part, and elements by name or index with MuJoCo's numbers."""

import mujoco
import numpy as np
import pytest
import stepper
from checks import raises
from hypothesis import given, strategies as st
from models import SOURCES, mjcf, stepper_model
from stepper.shared.fields import COMPOUNDS, FIELDS, RANDOMIZED
from stepper.shared.selectors import Selector, numbers_of, parse, places, rows_of

SCENE = mjcf("selectors")
MODEL = stepper.load(SCENE)
ITEMS = st.text(min_size=1, max_size=12) | st.integers(-5, 20) | st.text("ab,[]'\"\\ 0*?=:.", min_size=1, max_size=6)
FIELDS_OF_ELEMENTS = st.sampled_from([name for name, field in FIELDS.items() if field.element] + [*COMPOUNDS, "sensor.delay", "thing"])
LEGS = """<mujoco><worldbody><body name="base"><freejoint name="floating_base_joint"/><geom name="g" size=".1"/>
  <body name="a"><joint name="FL_joint"/><geom size=".1" pos="0 0 .5"/></body>
  <body name="b"><joint name="FR_joint"/><geom size=".1" pos="0 .5 .5"/></body></body></worldbody></mujoco>"""
ROBOTS = ["gymnasium/humanoid", "gymnasium/pusher_v5", "dm_control/quadruped", "dm_control/manipulator", "dm_control/finger"]
TYPES = {0: "free", 1: "ball", 2: "slide", 3: "hinge"}
DERIVED = ("mass_matrix", "subtree_com", "xipos", "geom_xpos", "qfrc_bias", "qacc_smooth", "actuator_force")
"""Quantities of a state."""
FOLLOW = {
    "gravity": {"qfrc_bias", "qacc_smooth"},
    "body_mass": {"mass_matrix", "subtree_com", "qfrc_bias", "qacc_smooth"},
    "body_ipos": {"mass_matrix", "subtree_com", "xipos", "qfrc_bias", "qacc_smooth"},
    "body_inertia": {"mass_matrix", "qfrc_bias", "qacc_smooth"},
    "geom_pos": {"geom_xpos"},
    "jnt_stiffness": {"qacc_smooth"},
    "dof_damping": {"qacc_smooth"},
    "dof_armature": {"mass_matrix", "qacc_smooth"},
    "actuator_gainprm": {"qacc_smooth", "actuator_force"},
    "actuator_biasprm": {"qacc_smooth", "actuator_force"},
}
"""Those that follow a field; the other fields act in constraints alone."""


@given(
    FIELDS_OF_ELEMENTS,
    st.none() | st.lists(ITEMS, min_size=1, max_size=4),
    st.none() | st.lists(st.integers(-3, 9), min_size=1, max_size=3),
)
def test_a_selector_is_read_as_it_is_written(field, elements, columns):
    selector = Selector(field, elements and tuple(elements), columns and tuple(columns))
    assert parse(str(selector)) == selector


@given(st.lists(st.integers(0, 5), min_size=1, max_size=4, unique=True), st.lists(st.integers(0, 2), min_size=1, unique=True), st.data())
def test_all_spellings_of_a_selector_have_the_same_numbers(geoms, columns, data):
    """By name, index and negative index, in any order, and some elements twice."""
    names = [name or k for k, name in enumerate(MODEL.geom_names)]

    def spelling():
        elements = [data.draw(st.sampled_from([names[k], k, k - len(names)])) for k in data.draw(st.permutations([*geoms, geoms[0]]))]
        own = [data.draw(st.sampled_from([k, k - 3])) for k in data.draw(st.permutations(columns))]
        return Selector("geom_friction", tuple(elements), tuple(own))

    assert numbers_of(MODEL, spelling()) == numbers_of(MODEL, spelling()) == {("geom_friction", 3 * k + c) for k in geoms for c in columns}


@given(st.sampled_from(["gravity", "wind"]), st.none() | st.lists(st.integers(0, 2), min_size=1, max_size=3, unique=True))
def test_fields_of_the_whole_model_have_columns_alone(field, columns):
    selector = Selector(field, None, columns and tuple(columns))
    assert parse(str(selector)) == selector
    assert np.array_equal(places(MODEL, selector), np.arange(3) if not columns else columns[0] if len(columns) == 1 else columns)


@pytest.mark.parametrize(("text", "expected"), [
    ("geom_friction[floor]", [0, 1, 2]),
    ("geom_friction[floor][0]", 0),
    ("geom_friction[floor,left_foot][0]", [0, 9]),
    ("geom_friction[*_foot][0,2]", [[9, 11], [12, 14]]),
    ("geom_friction[2][0]", 6),
    ("geom_friction[-1]", [15, 16, 17]),
    ("geom_friction['a,b'][1]", 4),
    ('geom_friction["it\'s [x]"][0]', 15),
    ("geom_restitution[base/*]", [1, 2]),
    ("geom_restitution[ left_foot , right_foot ]", [3, 4]),
    ("pair_friction[sole][0]", 0),
    ("pair_friction[right_foot/floor][0]", 0),
    ("dof_damping[root]", [0, 1, 2, 3, 4, 5]),
    ("dof_damping[root][2]", 2),
    ("dof_damping[hip]", 6),
    ("dof_damping[3]", 3),
    ("dof_damping['7']", 7),
    ("dof_damping[hip,'7']", [6, 7]),
    ("dof_solref[hip]", [12, 13]),
    ("dof_solref[root][1]", [1, 3, 5, 7, 9, 11]),
    ("dof_solref[6][1]", 13),
    ("jnt_range[hip]", [2, 3]),
    ("qpos0[root][2]", 2),
    ("qpos0[hip]", 7),
    ("actuator_gainprm[servo,motor][0]", [0, 10]),
])  # fmt: skip
def test_names_indices_and_columns_have_the_shape_of_numpy(text, expected):
    found = places(MODEL, parse(text))
    assert np.array_equal(found, expected)
    assert found.shape == np.shape(expected)


@pytest.mark.parametrize(("text", "message"), [
    ("geom_friction[flor][0]", "no geom 'flor'; did you mean floor"),
    ("geom_friction[*_hand]", "no geom fits '\\*_hand', there are: floor, a,b"),
    ("geom_friction[9]", "there is no geom 9; the model has 6"),
    ("geom_friction[floor][3]", "there is no column 3; columns are 0 to 2"),
    ("geom_friction[floor][0,-3]", "which names a column twice: name it once"),
    ("geom_friction[#2]", "no geom '#2'; write the index 2 alone"),
    ("body_mass[base][0]", "body_mass has one number of each body; leave out the columns"),
    ("dof_damping[3][0]", "an index is one row of dof_damping; leave out the columns, or name a joint"),
    ("gravity[0][1]", "gravity belongs to the whole model; write its columns alone, as 'gravity\\[1\\]'"),
    ("geom_friction[floor", "which is no selector: write field\\[names\\]\\[columns\\]"),
    ("geom_friction[]", "which is no selector"),
    ("geom_friction['']", "a name is empty; write the index"),
    ("geom_friction[floor][x]", "columns are \\['x'\\], must be numbers"),
    ("geom_frictoin", "there is no field 'geom_frictoin'; did you mean geom_friction"),
    ("actuator_kp[servo][0]", "actuator_kp is one number of each actuator; leave out the columns"),
])  # fmt: skip
def test_what_is_no_selector_is_said(text, message):
    for call in (lambda: stepper.Stepper(MODEL, 2).randomize({text: 1.0}), lambda: MODEL.replace({text: 1.0})):
        with pytest.raises(ValueError, match=message) as error:
            call()
        assert str(error.value).startswith(("Stepper.randomize", "Model.replace"))


@st.composite
def parts(draw):
    """A field that environments may vary, a selector of some of its numbers, and factors for them."""
    field = draw(
        st.sampled_from(["body_mass", "geom_friction", "geom_restitution", "dof_damping", "actuator_biasprm", "gravity", "geom_pos"])
    )
    names = {"body": MODEL.body_names[1:], "geom": [name for name in MODEL.geom_names if name not in {"", "floor", "right_foot"}],
             "dof": ["hip", "7"], "actuator": ["servo"]}  # fmt: skip
    kind = FIELDS[field].element
    elements = tuple(draw(st.lists(st.sampled_from(names[kind]), min_size=1, max_size=3, unique=True))) if kind else None
    wide = np.ndim(getattr(MODEL, field)) == 2 or not kind
    columns = tuple(draw(st.lists(st.integers(0, 2), min_size=1, max_size=3, unique=True))) if wide and draw(st.booleans()) else None
    return Selector(field, elements, columns), draw(st.integers(0, 2**32 - 1))


@given(parts(), st.sampled_from(["all", "mask", "indices", "none"]))
def test_a_part_of_a_field_is_set_as_the_whole(part, how):
    """The same bits in `randomized` and in `replace`, for any environments."""
    selector, seed = part
    rng = np.random.default_rng(seed)
    n = None if how == "none" else 4
    envs = {"mask": np.array([True, False, True, True]), "indices": [2, 0]}.get(how)
    one, other = stepper.Stepper(MODEL, n), stepper.Stepper(MODEL, n)
    own = np.array(getattr(MODEL, selector.field))
    index = places(MODEL, selector)
    rows = 2 if how == "indices" else 4
    # Factors near 1 leave every field valid.
    values = own.reshape(-1)[index] * rng.uniform(0.9, 1.1, (rows, *index.shape) if n else index.shape)
    whole = np.tile(own, (rows, *[1] * own.ndim)) if n else own.copy()
    whole.reshape(*whole.shape[: whole.ndim - own.ndim], -1)[..., index] = values
    one.randomize({str(selector): values}, envs=envs)
    other.randomize(envs, **{selector.field: whole})
    assert one.randomized.keys() == other.randomized.keys() == {selector.field}
    assert np.array_equal(one.randomized[selector.field], other.randomized[selector.field])
    if n is None:
        assert MODEL.replace({str(selector): values}) == MODEL.replace(**{selector.field: whole})


@pytest.mark.parametrize("part", ["elements", "columns"])
def test_a_selector_of_nothing_is_refused(part):
    """Without brackets it would be written as the whole field."""
    raises(ValueError, f"{part} of a selector of 'geom_friction' is empty", Selector, "geom_friction", **{part: ()})


def test_values_are_for_all_selected_one_for_each_environment_or_one():
    sim = stepper.Stepper(MODEL, 2)
    sim.randomize({"geom_friction[left_foot,2][0]": [[0.1, 0.2], [0.3, 0.4]], "geom_restitution[left_foot]": 0.5})
    assert sim.randomized["geom_friction"][:, [3, 2], 0].tolist() == [[0.1, 0.2], [0.3, 0.4]]
    assert sim.randomized["geom_restitution"][:, 3].tolist() == [0.5, 0.5]
    sim.randomize({"geom_friction[left_foot,2][0]": [0.6, 0.7]})
    assert sim.randomized["geom_friction"][:, [3, 2], 0].tolist() == [[0.6, 0.6], [0.7, 0.7]]
    sim.randomize({"geom_friction[left_foot][0]": None}, envs=[1])
    assert sim.randomized["geom_friction"][:, [3, 2], 0].tolist() == [[0.6, 0.6], [1.0, 0.7]]
    with pytest.raises(
        ValueError, match=r"'geom_friction\[left_foot,2\]\[0\]' has shape \(3,\), must be \(2, 2\) or \(2,\) or a single number"
    ):
        sim.randomize({"geom_friction[left_foot,2][0]": [1, 2, 3]})
    with pytest.raises(ValueError, match=r"must be \(4, 3\) or \(4,\) or a single number; np\.broadcast_to\(value, \(4, 3\)\) gives all"):
        stepper.Stepper(MODEL, 4).randomize({"gravity": [0.0, 0.0, -3.7]})
    before = sim.randomized["geom_friction"].copy()
    sim.randomize({})
    assert np.array_equal(sim.randomized["geom_friction"], before), "no values change nothing"


def test_the_gains_of_a_servo_are_one_number_each():
    sim = stepper.Stepper(MODEL, 2)
    sim.randomize({"actuator_kp[servo]": [10.0, 20.0], "actuator_kv[servo]": 2.0})
    assert sim.randomized["actuator_gainprm"][:, 0, 0].tolist() == [10, 20]
    assert sim.randomized["actuator_biasprm"][:, 0, :3].tolist() == [[0, -10, -2], [0, -20, -2]]
    assert MODEL.replace({"actuator_kp[servo]": 7.0}).actuator_biasprm[0, :3].tolist() == [0, -7, -0.5]


def test_a_number_is_given_once():
    sim = stepper.Stepper(MODEL, 2)
    for values, fields, other in (
        ({"geom_friction[left_foot][0]": 1.0, "geom_friction[*_foot]": 2.0}, {}, "'geom_friction[left_foot][0]'"),
        ({"geom_friction[left_foot][0]": 1.0}, {"geom_friction": np.ones((2, 6, 3))}, "'geom_friction='"),
    ):
        with pytest.raises(ValueError, match="set the same number of geom_friction: give one of them") as error:
            sim.randomize(values, **fields)
        assert f"has {list(values)[-1]!r} and {other}," in str(error.value)
    assert sim.randomized == {}


def test_selectors_are_recorded(tmp_path):
    sim = stepper.Stepper(MODEL, 2)
    with sim.record(tmp_path / "recording"):
        sim.randomize({"body_mass[cart]": [1.0, 3.0]}, envs=[1, 0])
        sim.step([0.1, 0.5], nstep=5)
    assert stepper.recording.verify(tmp_path / "recording").difference is None
    assert sim.randomized["body_mass"][:, 3].tolist() == [3.0, 1.0]


def test_one_selector_is_for_everything():
    """`randomize`, `linearize`, `identify` and studies take the same text."""
    text = "geom_friction[left_foot,'a,b'][0]"
    sim = stepper.Stepper(MODEL, 2)
    sim.randomize({text: [0.5, 0.6]})
    assert sim.linearize((text,)).blocks[text].shape == (2, 2 * MODEL.nv, 2)
    parameter = stepper.lab.Parameter(text, low=0.1, high=1.0)
    assert stepper.lab.Study(model=MODEL, parameters={"friction": parameter}).loaded[0] == MODEL
    assert str(stepper.sysid.FitParameter.parse(f"{text}=0.1..2")) == text


@pytest.mark.parametrize("field", RANDOMIZED)
def test_what_is_derived_follows_and_nothing_else(field):
    """The column "derived quantities": geoms have no part in masses, nor a mass in the inertia."""
    sim = stepper.Stepper(MODEL)
    qpos = np.array(MODEL.qpos0)
    qpos[7] = 0.3
    sim.set_state(qpos, np.linspace(0.5, 1.0, MODEL.nv))
    sim.step([0.7, 0.2])

    def read():
        return {name: np.array(found() if callable(found := getattr(sim, name)) else found) for name in DERIVED}

    before = read()
    values = 1.1 * np.asarray(getattr(MODEL, field))
    sim.randomize(**{field: values}, **({"pair_friction": MODEL.pair_friction} if field == "geom_friction" else {}))
    after = read()
    assert {name for name in DERIVED if not np.array_equal(before[name], after[name])} == FOLLOW.get(field, set())


@pytest.mark.parametrize("field", FIELDS)
def test_all_elements_are_the_whole_field(field):
    whole = places(MODEL, Selector(field))
    assert whole.shape == np.shape(getattr(MODEL, field))
    assert np.array_equal(whole.reshape(-1), np.arange(whole.size))
    if FIELDS[field].element and whole.size:
        assert np.array_equal(places(MODEL, Selector(field, ("*",))), whole)


def test_the_table_names_every_field():
    assert {name for name in dir(stepper.Model) if isinstance(getattr(stepper.Model, name), property)} == set(FIELDS)
    assert all(field in FIELDS for compound in COMPOUNDS.values() for field, _, _ in compound.parts)
    assert set(RANDOMIZED) < set(FIELDS)


def test_names_of_joints_select_all_their_degrees_of_freedom_beside_indices():
    scene = """<mujoco><worldbody><body><joint name="shoulder" type="ball"/><geom size=".1"/>
      <body pos="0 0 .3"><joint name="elbow"/><geom size=".1"/></body></body></worldbody></mujoco>"""
    model = stepper.load(scene)
    assert rows_of(model, "dof", ["elbow", "shoulder", 1]) == [3, 0, 1, 2]
    assert rows_of(model, "coordinate", ["shoulder"]) == [0, 1, 2, 3]
    assert rows_of(model, "dof", None) == [0, 1, 2, 3]


def test_a_wrong_shape_of_a_pattern_lists_what_the_pattern_selects():
    """A pattern for the joints of the legs also fits the free joint of the base."""
    sim = stepper.Stepper(stepper.load(LEGS), 4)
    with pytest.raises(ValueError, match=r"must be \(4, 8\) .*; '\*_joint' selects floating_base_joint \(6 rows\), FL_joint, FR_joint$"):
        sim.randomize({"dof_damping[*_joint]": np.ones((4, 2))})
    with pytest.raises(ValueError, match=r"; '\*_joint' selects floating_base_joint, FL_joint, FR_joint$"):
        sim.randomize({"jnt_range[*_joint]": np.ones((4, 2, 2))})
    raises(ValueError, r"; '\*' selects g, 1, 2$", sim.model.replace, {"geom_friction[*]": np.ones((2, 3))})
    with pytest.raises(ValueError, match=r"'dof_damping\[\*_joint\]\[2\]', joint 'FL_joint': there is no column 2; columns are 0 to 0"):
        sim.randomize({"dof_damping[*_joint][2]": 1.0})
    with pytest.raises(ValueError, match="must be") as error:
        sim.randomize({"dof_damping[FL_joint,FR_joint]": np.ones((4, 3))})
    assert "selects" not in str(error.value)
    sim.randomize({"dof_damping[F*_joint]": np.ones((4, 2))})


@pytest.mark.parametrize("name", ROBOTS)
def test_elements_have_mujocos_numbers(name):
    source, model = mujoco.MjModel.from_xml_path(str(SOURCES[name])), stepper_model(name, strict=False)
    for j in range(source.njnt):
        ours, theirs = model.joint(j), source.joint(j)
        assert (ours.id, ours.name, ours.type) == (theirs.id, theirs.name, TYPES[int(theirs.type[0])])
        assert (ours.qposadr, ours.dofadr, ours.bodyid) == (theirs.qposadr[0], theirs.dofadr[0], theirs.bodyid[0])
        assert ours.limited == bool(theirs.limited[0])
        assert not ours.limited or np.array_equal(ours.range, theirs.range)
        assert np.array_equal(ours.pos, theirs.pos)
        assert len(model.qpos0[ours.qposadr : ours.qposadr + ours.nq]) == ours.nq
    for b in range(source.nbody):
        ours, theirs = model.body(b), source.body(b)
        assert (ours.id, ours.name, ours.parentid, ours.mass) == (theirs.id, theirs.name, theirs.parentid[0], theirs.mass[0])
        for field in ("pos", "quat", "ipos", "iquat", "inertia"):
            assert np.array_equal(getattr(ours, field), getattr(theirs, field)), field
        for field in ("jntadr", "jntnum", "dofadr", "dofnum", "geomadr", "geomnum", "mocapid"):
            assert getattr(ours, field) == getattr(source, f"body_{field}")[b], field
    for g in range(source.ngeom):
        ours, theirs = model.geom(g), source.geom(g)
        assert (ours.id, ours.name, ours.bodyid, ours.condim) == (theirs.id, theirs.name, theirs.bodyid[0], theirs.condim[0])
        assert np.array_equal(ours.pos, theirs.pos)
        assert np.array_equal(ours.friction, theirs.friction)
        assert ours.type == mujoco.mjtGeom(int(theirs.type[0])).name[7:].lower()
    for s in range(source.nsite):
        ours, theirs = model.site(s), source.site(s)
        assert (ours.id, ours.name, ours.bodyid) == (theirs.id, theirs.name, theirs.bodyid[0])
        assert np.array_equal(ours.pos, theirs.pos)
    for a in range(source.nu):
        ours, theirs = model.actuator(a), source.actuator(a)
        assert (ours.id, ours.name, ours.trnid) == (theirs.id, theirs.name, theirs.trnid[0])
        for field in ("gear", "gainprm", "biasprm"):
            assert np.array_equal(getattr(ours, field), np.ravel(getattr(theirs, field)))
        assert ours.actadr == theirs.actadr[0]
        assert not theirs.ctrllimited[0] or np.array_equal(ours.ctrlrange, theirs.ctrlrange)
    for k in range(source.nkey):
        ours, theirs = model.keyframe(k), source.key(k)
        assert (ours.id, ours.name, ours.time) == (theirs.id, theirs.name, theirs.time[0])
        assert np.array_equal(ours.qpos, theirs.qpos)
        assert np.array_equal(ours.ctrl, theirs.ctrl)


def test_sensors_and_tendons_say_where_their_numbers_are():
    model = stepper_model("dm_control/quadruped", strict=False)
    for sensor, row in zip(model.sensors, map(model.sensor, range(len(model.sensors))), strict=True):
        assert (row.name, row.type, row.adr, row.dim) == tuple(sensor[field] for field in ("name", "type", "adr", "dim"))
    tendon = model.tendon(model.tendon_names[0])
    assert tendon.jntid.tolist() == [model.joint_names.index(model.joint(int(j)).name) for j in tendon.jntid]
    assert len(tendon.jntid) == len(tendon.coef) > 1


def test_names_find_what_indices_find():
    model = stepper_model("gymnasium/humanoid")
    hip = model.joint("right_hip_y")
    assert model.joint_names[hip.id] == hip.name == "right_hip_y"
    assert repr(model.joint(hip.id)) == repr(hip) == repr(model.joint(np.int64(hip.id)))
    assert repr(hip).startswith(f"<stepper Joint: id={hip.id}, name='right_hip_y', type='hinge', bodyid=")
    assert model.body(-1).id == model.nbody - 1
    assert model.body("world").id == 0
    sim = stepper.Stepper(model, 2)
    sim.step(np.eye(2, model.nu))
    assert sim.qpos[0, hip.qposadr] != sim.qvel[0, hip.dofadr]


@pytest.mark.parametrize(("ask", "error", "text"), [
    (lambda model: model.joint("right_hip"), KeyError, r"no joint 'right_hip'; did you mean right_hip_. or .*\? There are: root, "),
    (lambda model: model.body("Torso"), KeyError, "no body 'Torso'; did you mean torso.*There are: world, torso"),
    (lambda model: model.geom("zzz"), KeyError, r"no geom 'zzz', there are: floor, .* and \d+ more"),
    (lambda model: model.keyframe("home"), KeyError, r"no keyframe .*home.*none of the 5 has a name, give an index"),
    (lambda model: model.sensor("gyro"), KeyError, r"no sensor .*gyro.*this model has no sensor"),
    (lambda model: model.joint(99), IndexError, "joint is 99, must be below 18"),
    (lambda model: model.joint(-19), IndexError, "joint is -19, must be below 18"),
    (lambda model: model.joint(0.5), TypeError, r"joint, if it is no name, is 0\.5 \(float\)"),
    (lambda model: model.joint(""), KeyError, "no joint ''"),
])  # fmt: skip
def test_what_is_not_there_is_answered_with_what_is(ask, error, text):
    raises(error, text, lambda: ask(stepper_model("gymnasium/humanoid")))


def test_rows_cannot_be_written():
    model = stepper_model("gymnasium/humanoid")
    for array in (model.joint(3).range, model.joint(3).axis):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1
    with pytest.raises(AttributeError):
        model.joint(3).range = 0


@pytest.mark.parametrize(("call", "text"), [
    (lambda model, q: model.integrate_pos(q[:-1], np.zeros(model.nv)), r"q has shape \(23,\), must be \(24,\) or"),
    (lambda model, q: model.integrate_pos(q, np.zeros((2, model.nq))), r"dv has shape \(2, 24\), must be \(23,\) or"),
    (lambda model, q: model.integrate_pos(np.tile(q, (3, 1)), np.zeros((2, model.nv))), "axes before the last must be the same"),
    (lambda model, q: model.integrate_pos(q * np.nan, np.zeros(model.nv)), "must be finite"),
    (lambda model, q: model.differentiate_pos(q, q * 0), "the orientation of joint \"root\" in row 0 of q2 is a quaternion of length 0"),
])  # fmt: skip
def test_configurations_that_are_none_are_refused(call, text):
    model = stepper_model("gymnasium/humanoid")
    raises(ValueError, text, call, model, model.qpos0)
