"""Names of MuJoCo and Gymnasium, and earlier ones: each error names the present name or keyword.

Three scripts are written as a user of MuJoCo, of Gymnasium and of a batched simulator would write them; the hints of every failing line are
in `SCRIPTS`.
"""

import importlib
import re

import gymnasium
import numpy as np
import pytest
import stepper
import stepper.envs
from stepper._other_names import NEW_KEYWORDS, NEW_KEYWORDS_OF, NEW_NAMES
from stepper.envs import StepperEnv, StepperVectorEnv

SCENE = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/><body name="box" pos="0 0 .1"><freejoint name="root"/>
  <geom name="box" size=".1"/><site name="imu"/></body><body name="arm" pos="1 0 1"><joint name="hip" axis="0 1 0"/>
  <geom name="arm" size=".1" pos=".3 0 0"/></body></worldbody><actuator><motor name="motor" joint="hip"/></actuator>
  <sensor><accelerometer name="imu" site="imu"/></sensor></mujoco>"""
MODEL = stepper.load(SCENE)
SIM = stepper.Stepper(MODEL, 4)
MASK = np.array([True, False, False, True])

SCRIPTS = {
    # Load a robot, drive it, read bodies, contacts and sensors, randomise friction of some environments, replay.
    "mujoco": (
        (lambda: stepper.MjModel.from_xml_path("robot.xml"), "use stepper.load(path or text)"),
        (lambda: stepper.MjData(MODEL), "use stepper.Stepper(model) for one environment"),
        (lambda: stepper.mj_resetDataKeyframe(MODEL, SIM, 0), "use sim.reset() of a stepper.Stepper, with keyframe="),
        (lambda: stepper.mj_step(MODEL, SIM), "use sim.step(ctrl)"),
        (lambda: stepper.mj_forward(MODEL, SIM), "attributes of a stepper.Stepper, which follow from its state"),
        (lambda: stepper.mj_name2id(MODEL, 1, "box"), "use model.body(name).id"),
        (lambda: MODEL.opt.timestep, "use timestep, gravity and others of the model"),
        (lambda: MODEL.geom_bodyid, "geom(name).bodyid"),
        (lambda: MODEL.jnt_qposadr, "joint(name).qposadr"),
        (lambda: MODEL.sensor_adr, "sensor(name).adr"),
        (lambda: MODEL.actuator_gaintype, "actuator(name).gaintype"),
        (lambda: MODEL.actuator_gain, "actuator_gainprm"),
        (lambda: MODEL.nsensor, "len(model.sensor_names)"),
        (lambda: MODEL.body_ipos.__setitem__(0, 0.0), "model.replace(body_ipos=...)"),
        (lambda: MODEL.geom("floor").friction.__setitem__(0, 0.3), "geom_friction"),
        (lambda: SIM.ctrl.__setitem__(0, 0.1), "sim.step(ctrl) sets new controls"),
        (lambda: SIM.qpos.__setitem__(0, 0.1), "sim.set_state(qpos=...) sets it"),
        (lambda: SIM.forward, "qacc or another attribute: all follow from the state"),
        (lambda: SIM.body("box").xpos, "use read('xpos', name) for values, or sim.model.body(name)"),
        (lambda: SIM.sensor("imu").data, "use read('sensordata', name)"),
        (lambda: SIM.contact[0].geom1, "contacts()"),
        (lambda: SIM.ncon, "contacts()"),
        (lambda: SIM.efc_force, "contacts()"),
        (lambda: SIM.xmat, "xquat"),
        (lambda: SIM.qM, "mass_matrix()"),
        (lambda: stepper.mj_contactForce(MODEL, SIM, 0), "use sim.contacts()['force']"),
        (lambda: stepper.mj_jacSite(MODEL, SIM, 0), "use sim.jacobian(body=..., site=...)"),
        (lambda: stepper.mjd_transitionFD(MODEL, SIM), "use sim.linearize()"),
        (lambda: stepper.launch_passive(MODEL, SIM), "use sim.view()"),
        (lambda: SIM.mj_step, "step(ctrl)"),
    ),
    "gymnasium": (
        (lambda: stepper.make("stepper/Ant-v5"), "use gymnasium.make"),
        (lambda: ENV.unwrapped.data.qpos, "use sim, as env.unwrapped.sim.qpos"),
        (lambda: ENV.unwrapped.model.body_mass, "sim.model"),
        (lambda: ENV.unwrapped.init_qpos, "sim.model.qpos0"),
        (lambda: ENV.unwrapped.init_qvel, "task.reset,"),
        (lambda: ENV.unwrapped.frame_skip, "task.frame_skip"),
        (lambda: ENV.unwrapped.state_vector, "use sim.qpos and sim.qvel"),
        (lambda: ENV.unwrapped.get_body_com("block"), "sim.read('xpos', name)"),
        (lambda: ENV.unwrapped.do_simulation(0, 1), "sim.step(ctrl, nstep)"),
        (lambda: ENV.unwrapped.sensordata, "sim.sensordata"),
        (lambda: ENV.unwrapped.contacts, "sim.contacts()"),
        (lambda: ENVS.unwrapped.envs[0], "use sim, one stepper with all environments"),
        (lambda: ENVS.call("task"), "use attributes and methods of the whole batch, as envs.unwrapped.sim.qpos"),
        (lambda: ENVS.get_attr("qpos"), "use attributes and methods of the whole batch"),
        (lambda: ENVS.set_attr("task", None), "use attributes and methods of the whole batch"),
        (lambda: ENVS.unwrapped.data, "use sim, as env.unwrapped.sim.qpos"),
        (lambda: ENVS.unwrapped.randomize(MASK), "sim.randomize"),
        (lambda: SIM.data.qpos, "use qpos, xpos, sensordata and others of the stepper itself"),
        (lambda: SIM.init_qpos, "model.qpos0"),
        (lambda: SIM.frame_skip, "step(ctrl, nstep)"),
        (lambda: SIM.dt, "timestep"),
        (lambda: SIM.render, "view()"),
    ),
    "batched": (
        (lambda: stepper.put_model(MODEL), "use stepper.load(mujoco_model)"),
        (lambda: stepper.make_data(MODEL), "use stepper.Stepper(model) for one environment"),
        (lambda: stepper.Stepper(MODEL, nworld=4), "use num_envs"),
        (lambda: stepper.Stepper(MODEL, 4, dt=0.002), "use options=stepper.Options(timestep=...)"),
        (lambda: stepper.Stepper(MODEL, 4, contact="mujoco"), "use options=stepper.Options(contact=...)"),
        (lambda: SIM.nworld, "num_envs"),
        (lambda: SIM.reset(mask=MASK), "Stepper.reset() takes no 'mask': use envs"),
        (lambda: SIM.reset(env_ids=[0]), "use envs"),
        (lambda: SIM.reset(init_qpos=MODEL.qpos0), "use qpos"),
        (lambda: SIM.set_state(SIM.qpos, mask=MASK), "Stepper.set_state() takes no 'mask': use envs"),
        (lambda: SIM.set_state(SIM.qpos, cold=True), "use keep_warmstart, its opposite: cold=True is keep_warmstart=False"),
        (lambda: SIM.rollout(np.zeros((2, 4, 1)), n_steps=2), "use nstep"),
        (lambda: SIM.contacts(env=0), "use envs"),
        (lambda: SIM.get_state(envs=[0]), "use env, one environment"),
        (lambda: SIM.worst_row(envs=[0]), "use env, one environment"),
        (lambda: SIM.save_problem("p", envs=[0]), "use env, one environment"),
        (lambda: SIM.mass_matrix(env=0), "use mass_matrix()[env]: it has all environments"),
        (lambda: SIM.randomize(mask=MASK), "did you mean envs"),
        (lambda: SIM.randomize(friction=0.5), "did you mean geom_friction"),
        (lambda: SIM.randomize({"friction[box]": 0.5}), "did you mean geom_friction"),
        (lambda: SIM.randomize(MASK, {"geom_friction[box][0]": 0.5}), "must be a dict of selectors"),
        (lambda: SIM.obs, "sensordata"),
        (lambda: stepper.rollout(MODEL, SIM), "use sim.rollout(ctrl)"),
    ),
}
ENV = gymnasium.make("stepper/FallingBlock-v0")
ENVS = gymnasium.make_vec("stepper/FallingBlock-v0", num_envs=2)


@pytest.mark.parametrize("script", SCRIPTS)
def test_every_line_that_fails_names_the_right_one(script):
    for line, (call, hint) in enumerate(SCRIPTS[script]):
        with pytest.raises((AttributeError, TypeError, ValueError)) as error:
            call()
        assert hint in str(error.value), f"line {line}: {error.value}"


def test_the_right_names_work(tmp_path):
    """The three scripts, as the hints have them."""
    sim = stepper.Stepper(MODEL, num_envs=4)
    with sim.record(tmp_path / "recording"):
        sim.reset(envs=MASK)
        sim.randomize({"geom_friction[box][0]": [0.3, 0.4]}, envs=[0, 3])
        sim.step([0.1], nstep=10)
    assert stepper.replay(tmp_path / "recording").difference is None
    assert sim.read("xpos", "box").shape == (4, 3)
    assert sim.read("sensordata", "imu").shape == (4, 3)
    assert sim.contacts(envs=MASK)["force"].shape[1:] == (3,)
    assert sim.get_state(env=2).nbytes > 0
    assert sim.worst_row(env=2) is None
    sim.save_problem(tmp_path / "problem", env=2)
    assert ENVS.unwrapped.sim.num_envs == 2


OWNERS = {
    "Stepper": stepper.Stepper, "Model": stepper.Model, "StepperEnv": StepperEnv, "StepperVectorEnv": StepperVectorEnv,
    "World": stepper.lab.World,
}  # fmt: skip


@pytest.mark.parametrize("owner", OWNERS)
def test_a_hint_is_for_a_name_that_is_absent(owner):
    assert [name for name in NEW_NAMES[owner] if hasattr(OWNERS[owner], name)] == []


@pytest.mark.parametrize("name", sorted({*NEW_KEYWORDS, *(name for names in NEW_KEYWORDS_OF.values() for name in names)}))
def test_no_call_of_a_stepper_ignores_a_keyword(name):
    """Methods raise for a keyword that they do not take, with their name in the message; `step` does so without a hint, to be fast."""
    calls = {"reset": (), "set_state": (), "get_state": (), "contacts": (), "worst_row": (), "mass_matrix": ()}
    for method, given in calls.items():
        text = inspect_text(method)
        if re.search(rf"\b{name}\b", text):
            continue
        with pytest.raises(TypeError, match=rf"^Stepper\.{method}\(\) takes no '{name}'"):
            getattr(SIM, method)(*given, **{name: None})


def inspect_text(method):
    """Signature of a method of a stepper."""
    return getattr(stepper.Stepper, method).__text_signature__


@pytest.mark.parametrize(
    ("statement", "hint"),
    [
        ("from stepper.envs import HalfCheetah", "did you mean stepper.envs.tasks.HalfCheetah?"),
        ("from stepper.envs import Go1Rough", "did you mean stepper.envs.locomotion.Go1Rough?"),
        ("from stepper.envs import Quantity", "did you mean Observation?"),
        ("from stepper import Study", "use stepper.lab.Study"),
        ("from stepper import mjx", "use stepper.load(path), and stepper.Stepper(model) for one environment"),
        ("from stepper import mju_mulQuat", "use mujoco.mju_mulQuat"),
        ("from stepper import step", "use sim.step of a stepper.Stepper"),
    ],
)
def test_an_import_of_a_name_from_elsewhere_has_the_hint(statement, hint):
    with pytest.raises(ImportError, match=re.escape(hint)):
        exec(statement)


def test_a_name_without_a_hint_stays_absent():
    """Submodules are imported after their name was not found, and `hasattr` is false."""
    exec("from stepper.envs import making")
    assert not hasattr(stepper.envs, "HalfCheetah")
    assert not hasattr(stepper, "Study")


@pytest.mark.parametrize("place", ["basic", "locomotion", "suite", "tasks", "terrain"])
def test_a_name_of_a_submodule_of_environments_has_its_place(place):
    module = importlib.import_module(f"stepper.envs.{place}")
    for name in module.__all__:
        if not hasattr(stepper.envs, name):
            with pytest.raises(AttributeError, match=rf"did you mean stepper\.envs\.{place}\.{name}\?$"):
                getattr(stepper.envs, name)
