"""Drives drawn anew by `Stepper.randomize`: each environment is, bit for bit, one of a stepper that was made with its numbers.

Both sides read tables that come out of one function and do the same operations with them, so that not even rounding may differ.
"""

import numpy as np
import pytest
import stepper
from checks import every, raises
from models import samples, stepper_model
from stepper import ActuatorModel, Drive
from stepper.actuators import PID, DCMotor

ROBOT, N, CALLS = "dm_control/humanoid", 11, 30


def drawn(n: int, seed: int) -> ActuatorModel:
    """Every stage that there is in `made`, with numbers of every environment's own."""
    rng = np.random.default_rng(seed)

    def u(low, high):
        return rng.uniform(low, high, n)

    curve = {"stall_torque": u(1, 3), "no_load_speed": u(200, 500)}
    motor = DCMotor(**curve, gear=0.5, rotor_inertia=1e-5, efficiency=u(0.6, 1.0))
    sampled = PID(kp=u(1, 3), ki=u(0, 4), kd=u(0, 0.02), integral_limit=u(0.05, 0.3), period=u(0.005, 0.02))
    return ActuatorModel(
        {
            "*_hip_*": Drive(delay=u(0, 0.02), lag=u(0.002, 0.02), limits=(-u(0.3, 1), u(0.3, 1)), motor=motor, friction=u(0, 0.02)),
            "*_knee": Drive(servo=sampled, delay_steps=u(0, 4), lag=u(0.001, 0.01)),
            "*_ankle_*": Drive(servo=PID(kp=u(0.2, 1), ki=u(0, 1), kd=u(0, 0.01)), limits=(-1, u(0.5, 1)), lag=u(0.002, 0.01)),
            "abdomen_*": Drive(motor=DCMotor(**curve, control="voltage"), delay=u(0, 0.004)),
        },
        default=Drive(lag=u(0.002, 0.05)),
    )


def made() -> ActuatorModel:
    """Other numbers for all, and the longest delays."""
    motor = DCMotor(stall_torque=9.0, no_load_speed=90.0, gear=0.5, rotor_inertia=1e-5, efficiency=0.5)
    return ActuatorModel(
        {
            "*_hip_*": Drive(delay=0.02, lag=0.1, limits=(-9, 9), motor=motor),
            "*_knee": Drive(servo=PID(kp=9.0, period=0.05), delay_steps=4, lag=0.5),
            "*_ankle_*": Drive(servo=PID(kp=9.0), limits=(-9, 9), lag=0.5),
            "abdomen_*": Drive(motor=DCMotor(stall_torque=9.0, no_load_speed=90.0, control="voltage"), delay=0.004),
        },
        default=Drive(lag=0.3),
    )


def only(model: ActuatorModel, env: int, n: int = N) -> ActuatorModel:
    """The numbers of one environment."""
    return model.chosen(np.arange(n) == env)


def sim_of(num_envs, actuators, **settings):
    return stepper.Stepper(stepper_model(ROBOT), num_envs, actuators=actuators, **settings)


def controls(calls=CALLS):
    return np.random.default_rng(7).uniform(-1.2, 1.2, (calls, N, stepper_model(ROBOT).nu))


def roll(sim, ctrl, nstep=2):
    for row in ctrl:
        sim.step(row, nstep=nstep)
    return sim


def read(sim, env=None) -> list[bytes]:
    own = [sim.qpos, sim.qvel, sim.residual, np.uint32(sim.status), sim.actuator_saturation, sim.qacc_smooth]
    return [np.asarray(x if env is None else np.asarray(x)[env]).tobytes() for x in own]


@every(precision=["f64", "f32"], integrator=["midpoint", "implicit", "euler", "rk4"])
def test_an_environment_is_one_that_was_made_so(integrator, precision):
    settings = {"options": stepper.Options(integrator=integrator), "precision": precision}
    numbers, ctrl = drawn(N, 0), controls()
    sim = sim_of(N, made(), threads=2, **settings)
    plain = roll(sim_of(N, made(), **settings), ctrl)
    sim.randomize(actuators=numbers)
    roll(sim, ctrl)
    for env in (0, 7, N - 1):
        own = roll(sim_of(None, only(numbers, env), **settings), ctrl[:, env])
        assert read(sim, env) == read(own), env
        assert read(sim, env) != read(plain, env)
        single = sim_of(None, made(), **settings)
        single.randomize(actuators=only(numbers, env))
        assert read(roll(single, ctrl[:, env])) == read(own), env


@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_a_mask_changes_those_environments_alone(precision):
    """Episode by episode; rows of the others are not read, and actuators that nothing is said of keep their drives."""
    first, second, ctrl, mask = drawn(N, 0), drawn(N, 1), controls(), np.arange(N) % 3 == 0
    sim = sim_of(N, made(), precision=precision)
    sim.randomize(actuators=first)
    roll(sim, ctrl)
    # 0 where the mask has nothing: no period of a servo and no torque of a motor.
    others = second.chosen(mask).spread(mask)
    later = {name: others.named[name] for name in ("*_knee", "abdomen_*")}
    sim.randomize(mask, actuators=ActuatorModel(later))
    sim.randomize(mask, actuators=ActuatorModel({"left_elbow": Drive(lag=np.where(mask, 0.004, np.nan))}))
    sim.reset()
    roll(sim, ctrl)
    for env in (0, 1, 9, N - 1):
        changed = later | {"left_elbow": Drive(lag=np.full(N, 0.004))} if mask[env] else {}
        now = ActuatorModel({**first.named, **changed}, default=first.default)
        assert read(sim, env) == read(roll(sim_of(None, only(now, env), precision=precision), ctrl[:, env])), env


def test_what_drives_remember_stays_until_reset():
    """A longer delay reads what the line has kept, and a lag goes on from where it is."""
    drive = Drive(delay_steps=5, lag=0.01)
    sim, fresh = (sim_of(2, ActuatorModel(default=drive)) for _ in range(2))
    sim.randomize(actuators=ActuatorModel(default=Drive(delay_steps=1, lag=0.05)))
    ctrl = controls()[:, :2]
    roll(sim, ctrl, nstep=1)
    state = sim.get_state()
    sim.randomize(actuators=None)
    assert sim.get_state() == state
    # The same numbers on the same memory: numbers are no part of the state.
    fresh.set_state(state)
    assert read(roll(sim, ctrl), 1) == read(roll(fresh, ctrl), 1)
    for s in (sim, fresh):
        s.randomize([True, False], actuators=ActuatorModel(default=Drive(delay_steps=2.5, lag=0.02)))
        s.reset([True, False])
    assert read(roll(sim, ctrl), 0) == read(roll(fresh, ctrl), 0)


def test_a_delay_reads_the_line_as_it_is():
    """Between two calls, of a wheel: the control of five steps ago, then that of two."""
    model = stepper.load("""<mujoco><option gravity="0 0 0" timestep="0.002"/><worldbody><body><joint name="j" axis="0 0 1"/>
      <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body></worldbody><actuator><motor name="m" joint="j"/></actuator></mujoco>""")
    sim, force = stepper.Stepper(model, actuators=ActuatorModel({"m": Drive(delay_steps=5)})), []
    for k in range(20):
        if k == 10:
            sim.randomize(actuators=ActuatorModel({"m": Drive(delay_steps=2)}))
        before = sim.qvel[0]
        sim.step([float(k)])
        force.append((sim.qvel[0] - before) / 0.002)
    expected = [max(k - 5, 0) for k in range(10)] + [k - 2 for k in range(10, 20)]
    assert force == pytest.approx(expected, abs=1e-9)  # A difference of velocities.


def test_none_gives_back_what_the_stepper_was_made_with():
    ctrl, numbers = controls(8), drawn(N, 0)
    sim = sim_of(N, made())
    held = sim.memory()["parameters"]
    plain = read(roll(sim, ctrl), N - 1)

    def again():
        sim.reset()
        roll(sim, ctrl)
        return read(sim, N - 1)

    sim.randomize(actuators=numbers)
    assert sim.memory()["parameters"] > held + N * 8 * 20
    assert again() != plain
    sim.randomize(np.arange(N) == N - 1, actuators=None)
    assert again() == plain
    assert "actuators" in sim.randomized
    for give_back in (lambda: sim.randomize(actuators=None), sim.randomize):
        sim.randomize(actuators=numbers)
        give_back()
        assert "actuators" not in sim.randomized
        assert sim.memory()["parameters"] == held
        assert again() == plain


def test_randomized_is_what_randomize_takes():
    sim, other, ctrl = sim_of(N, made()), sim_of(N, made()), controls(8)
    gravity = sim.model.gravity + np.linspace(-1, 1, N)[:, None]
    sim.randomize(actuators=drawn(N, 0), gravity=gravity)
    sim.randomize(np.arange(N) < 4, actuators=ActuatorModel({"*_knee": drawn(N, 1).named["*_knee"]}))
    other.randomize(**sim.randomized)
    assert other.randomized["actuators"] == sim.randomized["actuators"]
    assert read(roll(sim, ctrl), 2) == read(roll(other, ctrl), 2)
    knee = sim.randomized["actuators"].drive_of("left_knee").servo
    assert (
        knee.kp.tolist() == np.where(np.arange(N) < 4, drawn(N, 1).named["*_knee"].servo.kp, drawn(N, 0).named["*_knee"].servo.kp).tolist()
    )
    assert sim.actuators == made()


@every(num_envs=[None, N], precision=["f64", "f32"])
def test_recordings_have_drives(tmp_path, num_envs, precision):
    """Also those that were there before, and what changes on the way, in some environments or in one or in none."""
    n, ctrl = num_envs or 1, controls()
    sim = sim_of(num_envs, made(), precision=precision)
    sim.randomize(actuators=drawn(n, 0))
    masks = {3: np.arange(n) % 2 == 0, 5: np.arange(n) == 0, 7: np.zeros(n, bool), 9: None}
    with sim.record(tmp_path / "run"):
        for k, row in enumerate(ctrl):
            sim.step(row if num_envs else row[0])
            if k in masks:
                sim.randomize(masks[k], actuators=drawn(n, k), gravity=np.zeros((n, 3)) if num_envs else np.zeros(3))
            if k == 12:
                sim.randomize(actuators=None)
            if k == 15:
                sim.randomize(actuators=drawn(n, k))
            if k == 18:
                sim.randomize()
    result = stepper.recording.verify(tmp_path / "run", threads=2)
    assert result, str(result)


def test_nothing_is_changed_by_what_is_refused():
    sim = sim_of(3, made())
    raises(ValueError, "lag is -1", lambda: sim.randomize(gravity=np.zeros((3, 3)), actuators=ActuatorModel(default=Drive(lag=-1.0))))
    with pytest.raises(ValueError, match="gravity"):
        sim.randomize(gravity=np.zeros(3), actuators=ActuatorModel({"*_knee": drawn(3, 0).named["*_knee"]}))
    assert sim.randomized == {}


REFUSED = {
    "left_knee": [
        (Drive(lag=[1, 2]), r"lag has shape \(2,\), must be \(\) or \(3,\)"),
        (Drive(lag=0.1), "servo is missing, but the Stepper was created with servo; give servo here too"),
        (Drive(servo=PID(kp=1.0)), "period is missing"),
        (Drive(servo=PID(kp=1.0, period=0.01), delay_steps=4.5), r"up to 5 steps .* holds 4 steps; give Stepper\(..., act.* the longest"),
        (Drive(servo=PID(kp=1.0, period=[0.01, 0.0, 0.01])), "period is 0"),
        (Drive(servo=PID(kp=1.0, period=0.01), friction=0.1), r"friction is given, .* give friction to Stepper\(..., actuators=\)"),
    ],
    "left_ankle_x": [(Drive(servo=PID(kp=1.0, period=0.01)), "period is given, but the Stepper was created without")],
    "abdomen_x": [
        (Drive(), "motor is missing"),
        (Drive(motor=DCMotor(efficiency=0.5)), "stall_torque is missing"),
        (Drive(motor=DCMotor(stall_torque=1.0, no_load_speed=2.0)), 'control is "torque", must be "voltage"'),
        (Drive(motor=DCMotor(stall_torque=1.0, no_load_speed=2.0, control="voltage", gear=2.0)), "gear is 2, must be 1, because all"),
        (Drive(motor=DCMotor(stall_torque=1.0, no_load_speed=2.0, control="voltage", efficiency=0.5)), "efficiency is given"),
        (Drive(motor=DCMotor(stall_torque=1.0, no_load_speed=2.0, control="voltage"), lag=0.1), "lag is given, but the Stepper was"),
        (Drive(motor=DCMotor(stall_torque=1.0, no_load_speed=2.0, control="voltage"), limits=(-1, 1)), "limits is given"),
    ],
    "right_elbow": [
        (Drive(servo=PID(kp=1.0)), "servo is given"),
        (Drive(motor=DCMotor(efficiency=0.5)), "motor is given"),
        (Drive(delay=0.001), "holds 0 steps"),
    ],
}  # fmt: skip


@pytest.mark.parametrize(("name", "drive", "message"), [(name, *case) for name, cases in REFUSED.items() for case in cases])
def test_what_a_drive_was_not_made_for_is_named(name, drive, message):
    sim = sim_of(3, made())
    raises(ValueError, f"drive of actuator .{name}.: .*{message}", lambda: sim.randomize(actuators=ActuatorModel({name: drive})))
    assert sim.randomized == {}


def test_a_stepper_without_drives():
    sim = stepper.Stepper(stepper_model(ROBOT), 3)
    with pytest.raises(
        ValueError, match=r"drive of actuator .left_knee.: the Stepper was created without a drive .* Stepper\(..., actuators=\)"
    ):
        sim.randomize(actuators=ActuatorModel({"left_knee": Drive(lag=0.1)}))
    sim.randomize(actuators=ActuatorModel({"left_knee": Drive()}))
    sim.randomize(actuators=None)
    assert sim.randomized == {}
    raises(TypeError, r"actuators is .*must be a stepper.ActuatorModel", sim.randomize, actuators=3.0)
    raises(ValueError, "no actuator fits 'elbow'", lambda: sim.randomize(actuators=ActuatorModel({"elbow": Drive()})))


def test_ranges_of_forces_and_delays_of_the_model_stay():
    """What MJCF gives to a drive holds for other numbers too."""
    text = """<mujoco><option gravity="0 0 0"/><worldbody><body><joint name="j" axis="0 0 1"/><inertial pos="0 0 0" mass="1"
      diaginertia="1 1 1"/></body></worldbody><actuator><motor name="m" joint="j" forcerange="-2 2" delay=".006" nsample="3"/></actuator>
      <sensor><actuatorfrc actuator="m"/></sensor></mujoco>"""
    sim = stepper.Stepper(stepper.load(text), 2, actuators=ActuatorModel({"m": Drive(limits=(-3, 3), delay_steps=2)}))
    sim.randomize([True, False], actuators=ActuatorModel({"m": Drive()}))
    sim.step([0.0], nstep=9)
    force = samples(sim, 6, lambda: sim.sensordata_ideal[:, 0], [5.0])
    assert np.max(force, axis=0).tolist() == [2.0, 2.0]
    assert np.count_nonzero(force, axis=0)[0] == np.count_nonzero(force, axis=0)[1] + 2
