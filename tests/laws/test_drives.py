"""Drive trains against closed forms: what becomes of a control before it is a force.

All of them are exact or known to the order of the integrator; a body of one joint has no other error than rounding, which a thousand steps
add up to 1e-13 of the largest number or less.
"""

import numpy as np
import pytest
import stepper
from checks import every
from stepper import ActuatorModel, Drive
from stepper.actuators import PID, DCMotor

H, J = 2e-3, 0.03
ROUNDING = 1e-12
INTEGRATORS = ["midpoint", "implicit", "euler"]
WHEEL = """<mujoco><option gravity="0 0 0"/><worldbody><body><joint name="axle" axis="0 0 1" {joint}/>
  <inertial pos="0 0 0" mass="1" diaginertia="{inertia} {inertia} {inertia}"/></body></worldbody>
  <actuator>{actuator}</actuator><sensor><actuatorfrc actuator="m"/><jointactuatorfrc joint="axle"/></sensor></mujoco>"""


def wheel(drive: Drive | None, *, actuator='<motor name="m" joint="axle"/>', joint="", num_envs=None, h=H, precision="f64", **options):
    """A wheel of inertia J with one actuator."""
    model = stepper.load(WHEEL.format(joint=joint, actuator=actuator, inertia=J))
    options = stepper.Options(timestep=h, **({"integrator": "midpoint"} | options))
    return stepper.Stepper(model, num_envs, options=options, precision=precision, actuators=drive and ActuatorModel({"m": drive}))


def factor(integrator: str, x: float) -> float:
    """What a rule makes of e^-x in a step: Pade's (1, 2) for the midpoint rule, (0, 1) for those that are implicit in the damping."""
    return (1 - x / 3) / (1 + 2 * x / 3 + x**2 / 6) if integrator == "midpoint" else 1 / (1 + x)


@every(integrator=INTEGRATORS, control=["voltage", "torque"], ratio=[0.01, 1.0, 50.0])
def test_a_motor_spins_up_exponentially(ratio, control, integrator):
    """J w' = T (1 - w/w0), at full voltage or with more torque asked for than there is: 1 - w/w0 = e^(-t/tau), tau = J w0 / T."""
    stall, speed, gear, rotor = 0.2, 300.0, 5.0, 1e-4
    tau = (J + gear**2 * rotor) * (speed / gear) / (gear * stall)
    motor = DCMotor(stall_torque=stall, no_load_speed=speed, gear=gear, rotor_inertia=rotor, control=control)
    sim = wheel(Drive(motor=motor), integrator=integrator, h=ratio * tau)
    command = [1.0 if control == "voltage" else 10 * gear * stall]
    x, left = factor(integrator, ratio), 1.0
    for _ in range(40):
        sim.step(command)
        left *= x
        assert sim.qvel[0] * gear / speed == pytest.approx(1 - left, abs=ROUNDING)
        # The torque that there is, at the speed after the step.
        assert sim.sensordata_ideal == pytest.approx(gear * stall * left, abs=ROUNDING)
    if ratio == 0.01:
        # x^n - e^(-n ratio): the rule's truncation, n ratio^4 / 72 or n ratio^2 / 2 times what is left.
        bound = {"midpoint": ratio**3 / 72, "implicit": ratio / 2, "euler": ratio / 2}[integrator]
        assert abs(left - np.exp(-40 * ratio)) <= 1.1 * bound * 40 * ratio * left


@every(integrator=INTEGRATORS, start=[0.0, 200.0])
def test_terminal_speed_under_a_load(start, integrator):
    """T (1 - w/w0) = load: the speed of the curve, from below and from above."""
    stall, speed, load = 2.0, 40.0, 0.5
    sim = wheel(Drive(motor=DCMotor(stall_torque=stall, no_load_speed=speed)), integrator=integrator)
    sim.set_state(qvel=[start])
    sim.qfrc_applied[:] = -load
    sim.step([1.5], nstep=20_000)  # More torque than the load, less than stall: the curve decides.
    assert sim.qvel[0] == pytest.approx(speed * (1 - load / stall), rel=ROUNDING)


def test_a_motor_that_keeps_below_its_curve_is_a_motor():
    """Bit for bit: what is not reached has no effect."""
    plain, driven = wheel(None), wheel(Drive(motor=DCMotor(stall_torque=100.0, no_load_speed=1e4), limits=(-50, 50)))
    for k in range(100):
        for sim in (plain, driven):
            sim.step([np.sin(k)])
    assert plain.qvel.tobytes() == driven.qvel.tobytes()


@pytest.mark.parametrize("tau", [1e-4, 0.02, 1.0])
def test_step_response_of_a_lag(tau):
    """J w' = F (1 - e^(-t/tau)), so w = F/J (t - tau (1 - e^(-t/tau))): exact, as the mean over every step is."""
    sim = wheel(Drive(lag=tau))
    sim.step([0.0])
    for k in range(1, 200):
        sim.step([3.0])
        risen = -np.expm1(-k * H / tau)
        assert sim.qvel[0] == pytest.approx(3.0 / J * (k * H - tau * risen), rel=1e-10)
        assert sim.sensordata_ideal == pytest.approx(3.0 * risen, rel=1e-10)


@every(steps=[0, 1, 2.5, 7, 10.25], unit=["steps", "seconds", "both"])
def test_a_delay_is_exact(steps, unit):
    """A pulse of a step arrives `steps` later, spread over two steps where that is no whole number: the impulse is the same."""
    given = {"steps": {"delay_steps": steps}, "seconds": {"delay": steps * H}, "both": {"delay": H * steps / 2, "delay_steps": steps / 2}}
    sim = wheel(Drive(**given[unit]))
    pulse, found = 4, []
    for k in range(30):
        before = sim.qvel[0]
        sim.step([1.0 if k == pulse else 0.0])
        found.append((sim.qvel[0] - before) * J / H)
    whole, part = int(steps), steps - int(steps)
    expected = np.zeros(30)
    expected[pulse + whole], expected[pulse + whole + 1] = 1 - part, part
    assert found == pytest.approx(expected, abs=1e-9)  # A difference of velocities of 1/J h.


def test_delay_lines_begin_with_the_first_control():
    sim = wheel(Drive(delay_steps=5, lag=0.01))
    sim.step([2.0])
    assert sim.qvel[0] == pytest.approx(2.0 * H / J, rel=ROUNDING)


def numpy_pid(servo: PID, limits, target, states, every):
    """Efforts of a sampled PID with conditional integration, for the states before every step."""
    integral, effort, out = 0.0, 0.0, []
    for k, (q, v) in enumerate(states):
        if k % every == 0:
            error = target[k] - q
            more = np.clip(integral + servo.ki * servo.period * error, -servo.integral_limit, servo.integral_limit)
            asked = servo.kp * error + more - servo.kd * v
            if (asked > limits[1] and more > integral) or (asked < limits[0] and more < integral):
                more = integral
            integral = more
            effort = servo.kp * error + integral - servo.kd * v
        out.append(np.clip(effort, *limits))
    return np.array(out)


@every(every=[1, 4, 25], limits=[(-0.2, 0.3), (-100.0, 100.0)], integral_limit=[0.05, 1e9])
def test_a_sampled_pid_is_the_textbooks(every, limits, integral_limit):
    """Against a loop of its own at the same rate, with both forms of anti-windup; the effort is held between samples."""
    servo = PID(kp=2.0, ki=5.0, kd=0.05, integral_limit=integral_limit, period=every * H)
    sim = wheel(Drive(servo=servo, limits=limits), joint='damping=".02"')
    target = np.where(np.arange(600) < 300, 1.0, -0.5)
    states, effort = [], []
    for k in range(600):
        states.append((sim.qpos[0], sim.qvel[0]))
        sim.step([target[k]])
        effort.append(sim.sensordata_ideal[0])
    expected = numpy_pid(servo, limits, target, states, every)
    assert np.abs(np.array(effort) - expected).max() < ROUNDING * max(1, np.abs(expected).max())


def test_an_integral_removes_the_error_and_unwinds():
    """A constant load: without the integral an error of load / kp is left, with it none."""
    load, kp = 0.4, 4.0
    for ki, error in ((0.0, load / kp), (8.0, 0.0)):
        sim = wheel(Drive(servo=PID(kp=kp, ki=ki, kd=0.5, period=2 * H), limits=(-1, 1)))
        sim.qfrc_applied[:] = -load
        sim.step([1.0], nstep=20_000)
        assert 1.0 - sim.qpos[0] == pytest.approx(error, abs=1e-9)


@pytest.mark.parametrize("integrator", [*INTEGRATORS, "rk4"])
def test_a_continuous_pd_is_mjcfs_position_servo(integrator):
    """The same law by another way; only the sum of its parts is rounded differently."""
    servo = wheel(Drive(servo=PID(kp=50.0, kd=0.7)), integrator=integrator)
    mjcf = wheel(None, actuator='<position name="m" joint="axle" kp="50" kv=".7"/>', integrator=integrator)
    for sim in (servo, mjcf):
        sim.step([0.3], nstep=500)
    if integrator == "euler":
        # Euler's rule takes MJCF's servos explicitly, as MuJoCo's does, and those of drives implicitly in the damping.
        assert servo.qpos == pytest.approx(mjcf.qpos, abs=1e-3)
    else:
        assert servo.qpos == pytest.approx(mjcf.qpos, rel=1e-11)
        assert servo.qvel == pytest.approx(mjcf.qvel, rel=1e-9, abs=1e-12)


@every(integrator=["midpoint", "implicit"], lag=[0.0, 0.01], ratio=[0.5, 10.0, 100.0])
def test_a_stiff_pd_with_limits_and_a_motor_settles(ratio, lag, integrator):
    """H sqrt(k/J) up to 100: it speeds up along its limit and its curve, never beyond them, and settles; a lag takes its own damping."""
    limit, stall, speed = 1.0, 1.5, 30.0
    kp = J * (ratio / H) ** 2
    drive = Drive(servo=PID(kp=kp, kd=0.1 * kp), limits=(-limit, limit), motor=DCMotor(stall_torque=stall, no_load_speed=speed), lag=lag)
    sim = wheel(drive, integrator=integrator)
    for _ in range(1000):
        before = sim.qvel[0]
        sim.step([2.0])
        assert (abs(sim.qvel[0] - before) * J / H) <= limit * (1 + 1e-9)
        assert abs(sim.qvel[0]) <= speed
    sim.step([2.0], nstep=9000)
    # It slides along kp e = kd v: e^(-t / 0.1 s) of 2 rad after 20 s. The midpoint rule damps what it cannot resolve by (x-1)/(x+1) a step,
    # x = h kd / 2J; behind a lag it may ring at the step's frequency with the velocity of its limit, which averages to nothing.
    x = H * 0.1 * kp / (2 * J)
    slow = ((x - 1) / (x + 1)) ** 9000 if integrator == "midpoint" and x > 1 else 0.0
    assert sim.qpos[0] == pytest.approx(2.0, abs=1e-6 + H * limit * H / J * (slow + 1e-3))


@pytest.mark.parametrize("efficiency", [0.3, 0.8, 1.0])
def test_a_gear_loses_power_both_ways(efficiency):
    """It drives with efficiency T, is driven against T / efficiency, and holds whatever is in between."""
    torque, gear = 0.1, 4.0
    motor = DCMotor(gear=gear, efficiency=efficiency)
    for qvel, expected in ((3.0, efficiency * torque), (-3.0, torque / efficiency)):
        sim = wheel(Drive(motor=motor))
        sim.set_state(qvel=[qvel])
        sim.step([torque])
        assert (sim.qvel[0] - qvel) * J / H == pytest.approx(expected, rel=1e-9)  # A difference of velocities.
        assert sim.sensordata_ideal == pytest.approx(expected, rel=1e-9)
    for load in np.linspace(efficiency * torque + 1e-6, torque / efficiency - 1e-6, 5) if efficiency < 1 else ():
        sim = wheel(Drive(motor=motor))
        sim.qfrc_applied[:] = -load
        sim.step([torque], nstep=50)
        assert abs(sim.qvel[0]) < 1e-12
        assert sim.sensordata_ideal == pytest.approx(load, rel=1e-9)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_servo_behind_a_gear_lags_by_the_losses(integrator):
    """A servo that lifts a load at constant speed needs load / efficiency: it lags behind its target by as much more."""
    kp, load, efficiency, speed = 200.0, 0.3, 0.7, 0.5

    def lag(efficiency):
        sim = wheel(Drive(servo=PID(kp=kp, kd=5.0), motor=DCMotor(efficiency=efficiency)), integrator=integrator)
        sim.qfrc_applied[:] = -load
        for k in range(3000):
            sim.step([speed * H * (k + 1)])
        return speed * H * 3000 - sim.qpos[0]

    # The start has decayed by e^-150. A difference of positions of 3 m that round at 4e-16, relative to 6e-4 m.
    assert lag(efficiency) - lag(1.0) == pytest.approx((load / efficiency - load) / kp, rel=1e-9)


@every(integrator=INTEGRATORS, seed=range(4))
def test_a_gear_creates_no_energy(seed, integrator):
    """Whatever the motor and the load do, losses only slow the wheel down, and it gains at the most what shaft and load put in."""
    # Where it turns back within a step, the work before and after the turn is not known from its ends.
    rng = np.random.default_rng(seed)
    motor = DCMotor(gear=3.0, efficiency=rng.uniform(0.2, 1.0))
    sim = wheel(Drive(motor=motor, friction=rng.uniform(0, 0.05)), integrator=integrator, joint=f'frictionloss="{rng.uniform(0, 0.02)}"')
    for _ in range(500):
        torque, load = rng.normal(size=2) * 0.3
        before = sim.qvel[0]
        sim.qfrc_applied[:] = load
        sim.step([torque])
        lossless, after = before + H * (torque + load) / J, sim.qvel[0]
        assert min(lossless, 0.0) - 1e-12 <= after <= max(lossless, 0.0) + 1e-12
        if before * after > 0 and abs(after) > 1e-12:
            # Of one inertia, force times the mean velocity is the change of energy exactly, by every rule.
            put_in = (torque + load) * (before + after) / 2 * H
            assert J / 2 * (after**2 - before**2) <= put_in + 1e-12


def test_friction_and_rotors_are_the_joints():
    """Dry friction and rotor inertia reflected to the joint are those of MJCF's joint, through both gears."""
    actuator = '<motor name="m" joint="axle" gear="2"/>'
    drive = Drive(friction=0.03, motor=DCMotor(gear=5.0, rotor_inertia=1e-4))
    sims = [wheel(drive, actuator=actuator), wheel(None, actuator=actuator, joint='frictionloss=".06" armature=".01"')]
    for k in range(300):
        for sim in sims:
            sim.step([0.2 * np.sin(k / 20)])
    assert sims[0].mass_matrix() == pytest.approx(sims[1].mass_matrix(), rel=1e-14)
    assert sims[0].qvel == pytest.approx(sims[1].qvel, rel=ROUNDING)
    # The reader of the joint's own friction does not see it, that of the drive's does.
    assert sims[1].sensordata_ideal[0] == pytest.approx(0.2 * np.sin(299 / 20), rel=ROUNDING)
    assert abs(sims[0].sensordata_ideal[0] - sims[1].sensordata_ideal[0]) <= 0.03 * (1 + 1e-9)


@every(integrator=[*INTEGRATORS, "rk4"], gear=[1.0, 2.0])
def test_friction_of_a_gear_falls_with_the_speed(gear, integrator):
    """J w' = -gear (F + S exp(-(gear w / V)^2)): first order, because a step takes the friction at the velocity before it."""
    friction, extra, speed, start, seconds = 0.03, 0.06, 0.5, 0.8, 0.2

    def slowed(w):
        return -gear * (friction + extra * np.exp(-((gear * w / speed) ** 2))) / J

    w, dt = start, seconds / 4000
    for _ in range(4000):
        w += dt * slowed(w + dt / 2 * slowed(w))
    drive = Drive(friction=friction, stribeck_friction=extra, stribeck_velocity=speed)
    errors = []
    for h in (4e-3, 2e-3):
        sim = wheel(drive, actuator=f'<motor name="m" joint="axle" gear="{gear}"/>', integrator=integrator, h=h)
        sim.set_state(qvel=[start])
        sim.step([0.0], round(seconds / h))
        errors.append(abs(sim.qvel[0] - w))
    # A step's error is h^2/2 w'', with |w''| <= |w'| times the steepest slope of the curve, 0.86 gear^2 S / (V J).
    most = 0.5 * seconds * 4e-3 * gear * (friction + extra) / J * 0.86 * gear**2 * extra / (speed * J)
    assert 1.8 * errors[1] < errors[0] < most
    assert errors[0] < 2.2 * errors[1]


@every(precision=["f64", "f32"], integrator=[*INTEGRATORS, "rk4"])
def test_a_gear_breaks_away_above_its_friction_at_rest(integrator, precision):
    """A torque below F + S leaves the joint at rest, to the bit, and one above it moves it."""
    drive = Drive(friction=0.1, stribeck_friction=0.2, stribeck_velocity=0.5)
    sim = wheel(drive, integrator=integrator, num_envs=2, precision=precision)
    sim.step([[0.299], [0.301]], 100)
    assert sim.qvel[0, 0] == 0.0
    # The friction falls as soon as the joint moves, so that it is faster than the torque of 0.001 N m alone makes it.
    assert sim.qvel[1, 0] > 0.001 * 100 * H / J
    assert sim.qfrc_actuator[0, 0] == pytest.approx(0.0, abs=1e-6)


def test_friction_that_falls_needs_its_speed():
    """An error names the missing number."""
    with pytest.raises(ValueError, match="stribeck_velocity is 0, must be at least 1e-9"):
        wheel(Drive(stribeck_friction=0.1))


def test_limits_hold():
    sim = wheel(Drive(limits=(-0.5, 0.25)))
    for command, expected in ((9.0, 0.25), (-9.0, -0.5), (0.1, 0.1)):
        before = sim.qvel[0]
        sim.step([command])
        assert (sim.qvel[0] - before) * J / H == pytest.approx(expected, rel=1e-9)
        assert sim.sensordata_ideal == pytest.approx(expected, rel=ROUNDING)
