"""Actuator models: what can be said, what is refused, and that all they remember is state: same bits however it is run."""

import json

import numpy as np
import pytest
import stepper
from checks import raises
from models import stepper_model
from recordings import edit_header
from stepper import ActuatorModel, Drive
from stepper.actuators import PID, DCMotor

ROBOT = "dm_control/humanoid"
MOTOR = DCMotor(stall_torque=2.0, no_load_speed=400.0, gear=0.5, rotor_inertia=1e-5, efficiency=0.8)
CHAIN = Drive(delay=0.0047, lag=0.012, limits=(-0.7, 0.6), motor=MOTOR, friction=0.01)
EVERYTHING = ActuatorModel(
    {
        "*_hip_*": CHAIN,
        "*_knee": Drive(servo=PID(kp=2.0, ki=3.0, kd=0.01, integral_limit=0.2, period=0.01), delay_steps=2.5, lag=0.003),
        "*_ankle_*": Drive(servo=PID(kp=0.5, kd=0.004), limits=(-1, 1), lag=0.004),
        "abdomen_*": Drive(motor=DCMotor(stall_torque=1.5, no_load_speed=500.0, control="voltage"), delay=0.002),
    },
    default=Drive(lag=0.01),
)
ODD = """<mujoco><worldbody><body><joint name="j" axis="0 1 0"/><geom size=".1"/><site name="s"/></body></worldbody>
  <tendon><fixed name="t"><joint joint="j" coef="2"/></fixed></tendon><actuator><motor name="site" site="s" gear="1 0 0 0 1 0"/>
  <motor name="tendon" tendon="t"/><general name="lag" joint="j" dyntype="filter" dynprm=".1"/></actuator></mujoco>"""


def sim_of(num_envs=None, *, actuators=EVERYTHING, **settings):
    return stepper.Stepper(stepper_model(ROBOT), num_envs, actuators=actuators, **settings)


def controls(n: int, calls: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1.2, 1.2, (calls, n, stepper_model(ROBOT).nu))


def bits(sim) -> bytes:
    return b"".join(np.ascontiguousarray(x).tobytes() for x in (sim.qpos, sim.qvel, sim.time, sim.residual, sim.status))


def roll(sim, ctrl, nstep=2):
    for row in ctrl:
        sim.step(row, nstep=nstep)
    return sim


@pytest.mark.parametrize("num_envs", [None, 5])
def test_record_and_replay(tmp_path, num_envs):
    sim, ctrl = sim_of(num_envs), controls(5, 30)
    with sim.record(tmp_path / "run"):
        for k, row in enumerate(ctrl):
            sim.step(row if num_envs else row[0])
            if k == 10:
                sim.reset(None if num_envs is None else np.arange(num_envs) == 2)
    result = stepper.recording.verify(tmp_path / "run", threads=2)
    assert result, str(result)
    # Another drive is another run.
    head = json.loads((tmp_path / "run/run.json").read_text())
    assert ActuatorModel.from_dict(head["actuators"]) == EVERYTHING
    edit_header(tmp_path / "run", lambda head: head["actuators"]["default"].update(lag=0.02))
    assert stepper.recording.verify(tmp_path / "run").difference.field == "qpos"
    # And without them the state does not fit.
    edit_header(tmp_path / "run", lambda head: head.update(actuators=None))
    raises(ValueError, "state", stepper.recording.verify, tmp_path / "run")


def test_a_control_that_is_not_finite_is_not_taken_up(tmp_path):
    """Its environment keeps its state and says so, in that step and no later; the delay line goes on with the control before."""
    actuators = ActuatorModel(default=Drive(delay_steps=3, lag=0.01))
    sim, held = sim_of(3, actuators=actuators), sim_of(3, actuators=actuators)
    ctrl = controls(3, 12)
    bad = ctrl.copy()
    bad[4, 1, 2], bad[4, 2, 0] = np.nan, np.inf
    with sim.record(tmp_path / "run"):
        for k in range(12):
            before = sim.qpos
            sim.step(bad[k])
            held.step(ctrl[k])
            refused = (np.asarray(sim.status) & stepper.Status.NON_FINITE.value) != 0
            assert refused.tolist() == [False, k == 4, k == 4]
            assert np.all(sim.qpos[refused] == before[refused])
            assert np.all(np.isfinite(sim.qpos))
    assert sim.qpos[0].tobytes() == held.qpos[0].tobytes()


def test_a_first_control_that_is_not_finite_begins_nothing():
    actuators = ActuatorModel(default=Drive(delay_steps=3, lag=0.01))
    sim, fresh, ctrl = sim_of(actuators=actuators), sim_of(actuators=actuators), controls(1, 6)[:, 0]
    sim.step(np.full(sim.model.nu, np.nan))
    assert bits(roll(sim, ctrl)) == bits(roll(fresh, ctrl))


def test_files(tmp_path):
    text = """
        [actuators.right_knee]
        delay = 0.01
        limits = [-1, 2.5]
        [actuators.right_knee.motor]
        stall_torque = 3.0
        no_load_speed = 100
        [actuators.right_knee.servo]
        kp = [1.0, 2.0, 3.0]
        period = 0.01
        [default]
        lag = 0.02
    """
    (tmp_path / "a.toml").write_text(text)
    read = ActuatorModel.from_file(tmp_path / "a.toml")
    assert read.default == Drive(lag=0.02)
    knee = read.named["right_knee"]
    assert (knee.limits, knee.motor, knee.servo.period) == ((-1, 2.5), DCMotor(stall_torque=3.0, no_load_speed=100), 0.01)
    (tmp_path / "b.json").write_text(json.dumps(read.to_dict()))
    assert ActuatorModel.from_file(tmp_path / "b.json") == read
    assert ActuatorModel.from_dict(EVERYTHING.to_dict()) == EVERYTHING
    sim_of(3, actuators=read).step()


@pytest.mark.parametrize(("text", "message"), [
    ("[motors]", "unknown tables"),
    ("[default]\nlagg = 1", r"default: unknown entries \['lagg'\]"),
    ("[actuators.a.servo]\nkp = 1\nkq = 2", "actuator 'a': servo: unknown entries"),
    ("[actuators.a.servo]\nki = 1", "actuator 'a': servo"),
    ("[default]\nmotor = 3", "default: motor is 3"),
])  # fmt: skip
def test_bad_files(tmp_path, text, message):
    (tmp_path / "a.toml").write_text(text)
    raises((ValueError, TypeError), message, ActuatorModel.from_file, tmp_path / "a.toml")


@pytest.mark.parametrize(("drive", "message"), [
    (Drive(delay=-1), "delay is -1"),
    (Drive(delay=[0.1, 0.2]), r"delay has shape \(2,\), must be \(\) or \(3,\)"),
    (Drive(delay=1e6), "at most 100000 steps"),
    (Drive(lag=np.nan), "lag is NaN"),
    (Drive(limits=(1, -1)), r"limits are \(1, -1\)"),
    (Drive(motor=DCMotor(stall_torque=0.0, no_load_speed=1.0)), "stall_torque is 0"),
    (Drive(motor=DCMotor(efficiency=1.5)), "efficiency is 1.5"),
    (Drive(motor=DCMotor(gear=0.0)), "gear is 0"),
    (Drive(motor=DCMotor(control="voltage")), "needs stall_torque"),
    (Drive(servo=PID(kp=-1.0)), "kp is -1"),
    (Drive(servo=PID(kp=1.0, period=0.0)), "period is 0"),
    (Drive(friction=np.inf), "friction is inf"),
])  # fmt: skip
def test_numbers_out_of_range_are_named(drive, message):
    raises(ValueError, rf"drive of actuator .right_knee.: .*{message}", lambda: sim_of(3, actuators=ActuatorModel({"right_knee": drive})))


@pytest.mark.parametrize(("make", "message"), [
    (lambda: sim_of(actuators=ActuatorModel({"elbow": Drive()})), "no actuator fits 'elbow', there are: abdomen_y"),
    (lambda: sim_of(actuators={"right_knee": Drive()}), "must be a stepper.ActuatorModel"),
    (lambda: ActuatorModel({"a": PID(kp=1)}), "must be a stepper.Drive"),
    (lambda: Drive(servo=DCMotor()), "must be a stepper.actuators.PID"),
    (lambda: Drive(lag="slow"), "lag is 'slow'"),
    (lambda: DCMotor(stall_torque=1.0), "stall_torque is 1.0 and no_load_speed is None: give both, or neither"),
    (lambda: DCMotor(control="current"), "must be 'torque' or 'voltage'"),
    (lambda: Drive(limits=(1, 2, 3)), "limits"),
    (lambda: ActuatorModel.from_dict([]), r"actuators is \[\], must be a dict such as"),
    (lambda: ActuatorModel.from_file(3), r"path is 3 \(int\), must be a path"),
])  # fmt: skip
def test_what_cannot_be_said(make, message):
    raises((TypeError, ValueError), message, make)


@pytest.mark.parametrize(("name", "drive", "message"), [
    ("site", Drive(servo=PID(kp=1.0)), "which has no length to measure"),
    ("site", Drive(motor=DCMotor(rotor_inertia=1.0)), "rotor_inertia is set, but the actuator acts on a site"),
    ("site", Drive(friction=1.0), "leave them out"),
    ("tendon", Drive(motor=DCMotor(efficiency=0.5)), "leave them out"),
    ("lag", Drive(servo=PID(kp=1.0)), "activation dynamics"),
])  # fmt: skip
def test_what_an_actuator_cannot_have(name, drive, message):
    with pytest.raises(ValueError, match=f"drive of actuator .{name}.: .*{message}"):
        stepper.Stepper(stepper.load(ODD), actuators=ActuatorModel({name: drive}))


def test_what_odd_actuators_can_have():
    motor = DCMotor(stall_torque=0.1, no_load_speed=5.0)
    model = ActuatorModel({"site": Drive(delay_steps=1.5, lag=0.01, motor=motor), "lag": Drive(delay=0.01, limits=(-1, 1)),
                           "tendon": Drive(servo=PID(kp=1, kd=0.1), motor=DCMotor(rotor_inertia=1e-3, gear=3.0))})  # fmt: skip
    sim = stepper.Stepper(stepper.load(ODD), actuators=model)
    sim.step([1.0, 0.3, 1.0], nstep=500)
    assert sim.status == stepper.Status.OK
    # Rows of tendons carry their inertia: the wheel's is the joint's mass alone.
    assert sim.mass_matrix()[0, 0] == pytest.approx(stepper.Stepper(sim.model).mass_matrix()[0, 0] + 4 * 9 * 1e-3)


def test_smooth_acceleration_knows_the_drives():
    """What the trains hand on last, under their curve: the acceleration that the next short step makes."""
    motor = DCMotor(stall_torque=0.5, no_load_speed=30.0)
    actuators = ActuatorModel(default=Drive(lag=1e-6, motor=motor, limits=(-0.4, 0.4)))
    options = stepper.Options(timestep=1e-7)
    sim = stepper.Stepper(stepper_model("gymnasium/inverted_double_pendulum"), actuators=actuators, options=options)
    sim.reset(qpos=[0.1, 0.2, 0.3], qvel=[1.0, -1.0, 0.5])
    sim.step([0.0])
    sim.step([0.3], nstep=300)
    expected, before = sim.qacc_smooth, sim.qvel
    sim.step([0.3])
    # e^-30 of the lag is left; a step moves the arm by 1e-7 of its speed; the difference of velocities loses 1e-16 / 1e-7 times its size.
    assert (sim.qvel - before) / 1e-7 == pytest.approx(expected, rel=3e-5)
    idle = stepper.Stepper(sim.model, options=options)
    idle.set_state(sim.qpos, sim.qvel)
    assert np.abs(expected - idle.qacc_smooth).max() > 1e-2
