"""Mistakes that are made again and again: the message says what to do."""

import subprocess
import sys

import numpy as np
import pytest
import stepper
from models import simulate, stepper_model

BALL = "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"


@pytest.fixture
def sim():
    return simulate(stepper_model("dm_control/humanoid"), 3)


@pytest.mark.parametrize(("mistake", "kind", "message"), [
    (lambda sim: sim.reset([0.0, 1.0]), TypeError, r"envs has 0\.0, of type float64: give a mask \(3,\) of bool, or indices"),
    (lambda _: stepper.Stepper("hopper.xml"), TypeError, r"model is 'hopper.xml' \(str\), must be a stepper.Model: stepper\.load\(...\)"),
    (lambda _: simulate(BALL).reset(keyframe="up"), KeyError, r"no keyframe .*up.*this model has none; give reset\(qpos=..., qvel=...\)"),
    (lambda _: simulate(BALL).reset(keyframe=0), KeyError, r"no keyframe 0: this model has none; give reset\(qpos=..., qvel=...\)"),
    (lambda sim: sim.reset(keyframe=1.5), TypeError, "keyframe, if it is no name, is 1.5"),
    (lambda sim: sim.get_state(env=3), IndexError, "env is 3, must be below 3"),
    (lambda _: stepper.load(BALL, package_dirs="meshes"), TypeError, "package_dirs is 'meshes', must be a list of folders"),
    (lambda _: stepper.load(BALL, package_dirs=[3]), TypeError, r"an entry of package_dirs is 3 \(int\), must be a path"),
    (lambda _: stepper.load(BALL, strict="no"), TypeError, "strict is 'no', must be True or False"),
    (lambda _: stepper.load(BALL, overlaps="drop"), ValueError, 'overlaps is \'drop\', must be "keep" or "exclude"'),
    (lambda sim: setattr(sim, "recorder", 2.5), TypeError, r"recorder is 2\.5 .* must be None or have the methods step, reset"),
    (lambda sim: sim.inverse_dynamics([["a"]]), TypeError, r"qacc is \[\['a'\]\], must be an array of numbers"),
    (lambda sim: sim.inverse_dynamics(np.full(sim.model.nv, np.nan)), ValueError, r"qacc\[0\] is nan, must be a finite number"),
    (lambda _: simulate(BALL).inverse_dynamics([1.0]), ValueError, r"qacc has shape \(1,\), must be \(6,\)$"),
    (lambda sim: sim.linearize(3), TypeError, r"wrt is 3, must be a sequence of names"),
    (lambda sim: sim.linearize(nstep="a"), TypeError, "nstep is 'a', must be a whole number of at least 1"),
    (lambda sim: sim.linearize(nstep=None), TypeError, "nstep is None, must be a whole number of at least 1"),
    (lambda sim: sim.linearize(nstep=0), ValueError, "nstep is 0, must be a whole number of at least 1"),
    (lambda sim: sim.linearize(method=np.zeros(2)), ValueError, r"method is array\(.*, must be 'fd' or 'implicit'"),
    (lambda sim: sim.linearize(centered=None), TypeError, "centered is None, must be True or False"),
    (lambda sim: sim.linearize(method=2), ValueError, "method is 2, must be 'fd' or 'implicit'"),
    (lambda sim: sim.linearize(centered=2), TypeError, "centered is 2, must be True or False"),
    (lambda sim: sim.linearize(sensors="no"), TypeError, "sensors is 'no', must be True or False"),
    (lambda sim: sim.set_state(sim.qpos, keep_warmstart=1), TypeError, "keep_warmstart is 1, must be True or False"),
    (lambda sim: sim.linearize(ctrl=[["a"]]), TypeError, r"ctrl is \[\['a'\]\], must be an array of numbers"),
    (lambda _: stepper.derivatives.rollout("sim", np.zeros(3)), TypeError, r"sim is 'sim' \(str\), must be a stepper.Stepper"),
    (lambda sim: stepper.derivatives.rollout(sim, np.zeros((2, sim.model.nu)), True), TypeError, "nstep is True, must be a whole number"),
    (lambda sim: stepper.derivatives.rollout(sim, np.zeros((2, sim.model.nu)), every=0), ValueError, "every is 0, must be a whole number"),
    (lambda sim: sim.randomize({"gravity[2]": "down"}), TypeError, r"'gravity\[2\]' is 'down', must be an array of numbers"),
    (lambda sim: sim.model.replace({"geom_friction": [[1], [2, 3]]}), TypeError, "must be an array of numbers, with rows of equal length"),
    (lambda sim: sim.step(frame_skip=2), TypeError, r"Stepper.step\(\) takes no 'frame_skip'; there are: ctrl, nstep"),
    (lambda sim: setattr(sim.model.body(1), "mass", 2.0), AttributeError, r"mass of a .*body cannot .*: model.replace\(body_mass="),
    (lambda sim: setattr(sim.model.joint(0), "damping", 2.0), AttributeError, r"damping of a .*joint cannot .*model.replace\(dof_damping="),
    (lambda sim: setattr(sim.model.body(1), "parentid", 2), AttributeError, "parentid of .* is defined in the model's file"),
    (lambda sim: sim.rays([0, 0, 1], [0, 0, -1]), ValueError, r"points has shape \(3,\), must be \(n, 3\) for n rays, as \[\[0, 0, 1\]\]"),
    (lambda sim: sim.model.replace(body_mass={"torso": 2.0}), TypeError, r"body_mass is a dict, .* {'body_mass\[element\]': value}"),
    (lambda sim: sim.randomize(geom_friction={"floor": 0.2}), TypeError, r"geom_friction is a dict, .* {'geom_friction\["),
    (lambda sim: sim.randomize(body_mass=[[1.0]], body_mas=2), stepper.ModelError, "there is no field 'body_mas'; did you mean body_mass"),
    (lambda sim: sim.rays(pnt=[[0, 0, 1]], vec=[[0, 0, -1]]), TypeError, "takes no 'pnt'; did you mean points"),
    (lambda sim: sim.rollout(actions=[[1.0]]), TypeError, r"takes no 'actions'; there are: ctrl"),
    (lambda sim: sim.rollout(), TypeError, r"Stepper.rollout\(\) lacks the argument ctrl"),
    (lambda sim: sim.read("geom_friction"), ValueError, r"there is no quantity 'geom_friction'"),
    (lambda sim: sim.record(3), TypeError, r"path is 3 \(int\), must be a path"),
    (lambda sim: sim.record("run", chunk="8"), TypeError, r"chunk \(bytes\) is '8', must be a whole number of at least 1"),
    (lambda _: stepper.recording.verify(3), TypeError, r"path is 3 \(int\), must be a path"),
    (lambda _: stepper.policies.load(3), TypeError, r"path is 3 \(int\), must be a path"),
    (lambda _: stepper.policies.load("none.npz"), FileNotFoundError, "there is no policy file 'none.npz'"),
    (lambda _: stepper.policies.evaluate(3, "stepper/Hopper-v5"), TypeError, "policy is 3, must be a stepper.policies.Policy"),
    (lambda _: stepper.policies.evaluate(np.zeros_like, 3), TypeError, "env is 3, must be the id of an environment"),
    (lambda _: stepper.policies.evaluate(np.zeros_like, "x", episodes="8"), TypeError, "episodes is '8', must be a whole number"),
])  # fmt: skip
def test_a_mistake_is_told_what_to_do(sim, mistake, kind, message):
    with pytest.raises(kind, match=message):
        mistake(sim)


def test_contacts_of_all_environments_are_one_array(sim):
    qpos = np.tile(sim.model.qpos0, (3, 1))
    qpos[:, 2] = [0.05, 5.0, 0.2]
    sim.set_state(qpos=qpos)
    sim.step()
    every = sim.contacts()
    assert set(every["env"].tolist()) == {0, 2}
    assert every.dtype.names[0] == "env"
    for env in range(3):
        one = sim.contacts(env)
        for name in one.dtype.names:
            assert np.array_equal(every[every["env"] == env][name], one[name]), name
    every["pos"][:] = 0  # an array of one's own


def test_sensordata_ideal_is_made_once():
    """And anew when anything changes that it depends on."""
    scene = """<mujoco><worldbody><body name="hand" mocap="true" pos="0 0 1"/>
      <body name="arm"><joint name="hinge"/><geom size=".1" pos=".2 0 0"/><site name="tip" pos=".2 0 0"/></body></worldbody>
      <actuator><motor joint="hinge"/></actuator>
      <sensor><framepos objtype="xbody" objname="hand"/><accelerometer site="tip"/><jointpos joint="hinge"/></sensor></mujoco>"""
    sim = stepper.Stepper(stepper.load(scene), 2)

    def check():
        """Reads twice, and compares with a stepper that has never read."""
        first, second = sim.sensordata_ideal, sim.sensordata_ideal
        assert first is not second
        assert np.array_equal(first, second)
        other = stepper.Stepper(sim.model, 2)
        other.set_state(sim.get_state())
        other.mocap_pos, other.qfrc_applied = sim.mocap_pos, sim.qfrc_applied
        if "gravity" in sim.randomized:
            other.randomize(gravity=sim.randomized["gravity"])
        assert np.array_equal(first, other.sensordata_ideal)
        return first

    changes = [
        lambda: None,
        lambda: sim.step(np.ones(1)),
        lambda: (sim.mocap_pos.__setitem__((0, 0), [1, 2, 3]), sim.step()),
        lambda: sim.reset([True, False]),
        lambda: sim.set_state(qpos=[0.3]),
        lambda: sim.qfrc_applied.__setitem__((0, 0), 4.0),
        lambda: sim.randomize(gravity=np.array([[0, 0, -1], [0, 0, -2]], float)),
        lambda: sim.rollout(np.zeros((2, 1))),
    ]
    before = None
    for change in changes:
        change()
        now = check()
        assert before is None or not np.array_equal(now, before)
        before = now


@pytest.mark.parametrize("version", ["3.3.0", "2.1", None])
def test_another_mujoco_is_refused_with_the_version_that_is_needed(tmp_path, version):
    (tmp_path / "mujoco.py").write_text(f"class MjModel: pass\n__version__ = {version!r}\n" if version else "class MjModel: pass\n")
    program = f"""
import sys; sys.path.insert(0, {str(tmp_path)!r})
import stepper, mujoco
for source in ('<mujoco/>', mujoco.MjModel()):
    try: stepper.load(source)
    except ImportError as error: print(error)
"""
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    lines = run.stdout.strip().splitlines()
    assert len(lines) == 2
    for line in lines:
        assert f"are read by MuJoCo 4, and MuJoCo {version or 'of an unknown version'} is installed here" in line
        assert 'pip install "stepper-sim[mjcf]"' in line
