"""Elements of a model by name or index: the numbers are MuJoCo's, and a name that nothing has is answered with those that there are."""

import mujoco
import numpy as np
import pytest
import stepper
from models import SOURCES, stepper_model

ROBOTS = ["gymnasium/humanoid", "gymnasium/pusher_v5", "dm_control/quadruped", "dm_control/manipulator", "dm_control/finger"]
TYPES = {0: "free", 1: "ball", 2: "slide", 3: "hinge"}


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
    with pytest.raises(error, match=text):
        ask(stepper_model("gymnasium/humanoid"))


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
    with pytest.raises(ValueError, match=text):
        call(model, model.qpos0)
