"""Actuators against MuJoCo: every kind that is simulated, on joints, fixed tendons and sites.

Lengths, velocities, forces and generalized forces are functions of the state, so they agree to rounding: 1e-10 relative to the largest.
"""

import mujoco
import numpy as np
import pytest
import stepper
from actuators import ALL_KINDS, TARGETS, TREE, scene
from models import forward, random_state, simulate
from numerics import relative_error

BOUND = 1e-10  # As for smooth dynamics: rounding (1e-16) times what a mass matrix loses in a difference of accelerations.
STATES = 20


@pytest.mark.parametrize("kind", ALL_KINDS)
def test_forces_lengths_and_velocities(kind):
    text, rng = scene(kind), np.random.default_rng(0)
    model, sim, idle = mujoco.MjModel.from_xml_string(text), simulate(text), simulate(TREE.format(actuators="", sensors=""))
    assert sim.model.nu == model.nu
    reader = stepper.Stepper(sim.model, options=stepper.Options(timestep=1e-15))
    for _ in range(STATES):
        state = random_state(model, rng)
        act, ctrl = rng.uniform(-0.3, 0.3, model.na), rng.uniform(-1, 1, model.nu)
        data = forward(model, *state, ctrl, act=act)
        sim.step(ctrl)  # Puts the controls in force; the state is set again below.
        sim.set_state(*state, act=act)
        idle.set_state(*state)
        found = sim.mass_matrix() @ (sim.qacc_smooth - idle.qacc_smooth)
        assert relative_error(found, data.qfrc_actuator) < BOUND
        assert relative_error(sim.actuator_force, data.actuator_force) < BOUND
        if "early" in kind:
            continue  # The time step of `reader` determines its early activations.
        # A step so short that it changes nothing takes up the control.
        reader.set_state(*state, act=act)
        reader.step(ctrl)
        assert relative_error(reader.sensordata_ideal, data.sensordata) < BOUND


@pytest.mark.parametrize("gear", ["0 0 0 1 0 0", "0 0 0 .1 0 -.05", "0 0 0 -2 1 3", "1 0 0 1 0 0"])
@pytest.mark.parametrize("sites", [("tip", "hull"), ("hull", "base"), ("base", "hand")])
def test_setpoints_of_angles_are_those_nearest_to_them(sites, gear):
    """Servos of a rotational gear with a reference, on a free base: setpoints up to several turns away, and what is no such servo.

    MuJoCo takes a setpoint on the circle where the gear is a rotation alone and the servo pulls back with as much as it pulls with.
    """
    target = f'site="{sites[0]}" refsite="{sites[1]}" gear="{gear}"'
    servos = {
        "position": f'position {target} kp="20" kv="3"',
        "servo": f'general {target} gainprm="2" biastype="affine" biasprm=".5 -2 -.1"',
        "of another gain": f'general {target} gainprm="2" biastype="affine" biasprm=".5 -3 -.1"',
        "integrated": f'intvelocity {target} kp="20" actrange="-30 30"',
        "filtered": f'position {target} kp="20" timeconst=".1"',
        "filtered by Euler": f'general {target} gainprm="2" biastype="affine" biasprm="0 -2 0" dyntype="filter" dynprm=".1"',
        "PID": f'pid {target} kp="20" kv="3" input="pos"',
    }
    rng = np.random.default_rng(1)
    for made in servos.values():
        model = mujoco.MjModel.from_xml_string(TREE.format(actuators=f"<{made}/>", sensors=""))
        sim = simulate(model, integrator="euler")
        for _ in range(STATES):
            state, act, ctrl = random_state(model, rng), rng.uniform(-20, 20, model.na), rng.uniform(-20, 20, 1)
            data = forward(model, *state, ctrl, act=act)
            sim.step(ctrl)  # Puts the controls in force; the state is set again below.
            sim.set_state(*state, act=act)
            assert relative_error(sim.qacc_smooth, data.qacc_smooth) < BOUND
            # Activations follow the nearest setpoint too. MuJoCo's own differ by whole turns, of which forces know nothing.
            if model.na:
                sim.step(ctrl)
                mujoco.mj_step(model, data)
                turn = 2 * np.pi * np.linalg.norm(np.array(gear.split(), dtype=float)[3:])
                apart = (sim.act[0] - data.act[0]) / (turn if gear[0] == "0" and made != servos["of another gain"] else np.inf)
                assert sim.act[0] - data.act[0] - turn * round(apart) == pytest.approx(0.0, abs=1e-12 * 30)


@pytest.mark.parametrize("target", ['joint="socket"', 'jointinparent="socket"'])
def test_setpoints_of_balls_are_those_nearest_to_them(target):
    """A ball's length is the projection of its rotation vector, an angle, so that setpoints count modulo whole turns, as in MuJoCo."""
    text = TREE.format(actuators=f'<position {target} gear=".5 -1 .3 0 0 0" kp="20" kv="3"/>', sensors="")
    model, rng = mujoco.MjModel.from_xml_string(text), np.random.default_rng(2)
    sim = simulate(model, integrator="euler")
    for _ in range(STATES):
        state, ctrl = random_state(model, rng), rng.uniform(-20, 20, 1)
        data = forward(model, *state, ctrl)
        sim.step(ctrl)  # Puts the control in force; the state is set again below.
        sim.set_state(*state)
        assert relative_error(sim.actuator_force, data.actuator_force) < BOUND
        assert relative_error(sim.qacc_smooth, data.qacc_smooth) < BOUND


@pytest.mark.parametrize("integrator", ["midpoint", "implicit", "euler", "rk4"])
@pytest.mark.parametrize("kind", ["motor", "position", "velocity"])
def test_trajectories_of_actuators_on_sites(kind, integrator):
    """Every integrator converges to MuJoCo's trajectory at a fine step: arms, reactions and implicit parts are those of one model."""
    text, until, fine = scene(kind), 0.05, 2e-5
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.timestep, model.opt.integrator = fine, mujoco.mjtIntegrator.mjINT_RK4
    data = mujoco.MjData(model)
    ctrl = np.linspace(-0.5, 0.5, model.nu)
    data.ctrl[:] = ctrl
    for _ in range(round(until / fine)):
        mujoco.mj_step(model, data)
    errors = []
    for h in (1e-3, 5e-4):
        sim = stepper.Stepper(stepper.load(model), options=stepper.Options(timestep=h, integrator=integrator))
        sim.step(ctrl, nstep=round(until / h))
        errors.append(relative_error(sim.qvel, data.qvel))
    # A stiffness or damping across branches is an added inertia in the mass matrix, which is of first order
    # (crates/core/src/actuation/forces.rs).
    order = 4 if integrator == "rk4" else 2 if integrator == "midpoint" and kind == "motor" else 1
    # Half the step, that part of the error, or both are at the reference's own.
    assert errors[1] < max(1.1 * errors[0] / 2**order, 1e-9)
    assert errors[1] < 0.02


WHEEL = """<mujoco><option gravity="0 0 0" timestep=".01"/><worldbody><body><joint name="axle" axis="0 0 1"/>
  <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body></worldbody>
  <actuator><motor name="m" joint="axle" {history}/></actuator></mujoco>"""


EARLY = """<mujoco><option gravity="0 0 0" timestep=".01"/><worldbody><body><joint name="axle" axis="0 0 1"/>
  <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body></worldbody>
  <actuator><general joint="axle" dyntype="filter" dynprm=".1" gainprm="3" actearly="{early}"/></actuator></mujoco>"""


@pytest.mark.parametrize("contact", ["hard", "mujoco"])
@pytest.mark.parametrize("integrator", ["euler", "implicit", "midpoint"])
def test_an_early_activation_is_that_after_the_step(integrator, contact):
    """The first step from rest already has the force of the control, by both laws, and derivatives by the control have it."""
    if contact == "mujoco" and integrator == "midpoint":
        pytest.skip("MuJoCo has no midpoint rule")
    options = stepper.Options(contact=contact, integrator=integrator)
    early, late = (stepper.Stepper(stepper.load(EARLY.format(early=word)), options=options) for word in ("true", "false"))
    slope = early.linearize(("ctrl",)).blocks["ctrl"][1, 0]
    for sim in (early, late):
        sim.step([2.0])
    # With the midpoint rule, two half steps of the activation differ from the whole step by h / (4 tau) = 2.5 % of its change. A late
    # activation acts with its value in the middle, which is 2 h / (2 tau) = 0.1.
    midpoint = integrator == "midpoint"
    assert early.qvel[0] == pytest.approx(0.01 * 3 * early.act[0], rel=3e-2 if midpoint else 1e-12)
    assert late.qvel[0] == pytest.approx(0.01 * 3 * 0.1 if midpoint else 0.0, rel=1e-12, abs=1e-15)
    assert slope == pytest.approx(early.qvel[0] / 2, rel=1e-6)
    assert early.model.explain().count("early activations") == 1


@pytest.mark.parametrize("delay", [0.3, 1, 1.5, 2.49999999999999, 2.5, 3, 7])
@pytest.mark.parametrize("samples", [1, 2, 3, 5, 8])
@pytest.mark.parametrize("interp", ["zoh", "linear"])
def test_controls_are_as_late_as_mujocos(delay, samples, interp):
    """Delays in steps, whatever acts between two controls, and where the history is too short. The first control is 0, as MuJoCo's are.

    MuJoCo's history of controls begins with zeros, a delay line here with the first control (docs/reference/actuators.md).
    """
    # A power of two: sums of time steps have no rounding error, which could delay MuJoCo's samples by a step.
    h = 1 / 256
    scene = WHEEL.format(history=f'delay="{delay * h}" nsample="{samples}" interp="{interp}"').replace('".01"', f'"{h}"')
    model = mujoco.MjModel.from_xml_string(scene)
    data, sim = mujoco.MjData(model), stepper.Stepper(stepper.load(model))
    rng = np.random.default_rng(0)
    for k in range(40):
        data.ctrl[:] = rng.normal() if k else 0.0
        sim.step(data.ctrl)
        mujoco.mj_step(model, data)
        assert sim.qvel == pytest.approx(data.qvel, abs=1e-14)


def test_a_declared_delay_adds_to_a_drives_and_to_a_batch():
    model = stepper.load(WHEEL.format(history='nsample="8" delay=".03"'))
    for actuators, late in ((None, 3), (stepper.ActuatorModel({"m": stepper.Drive(delay_steps=2)}), 5)):
        sim = stepper.Stepper(model, 9, actuators=actuators)
        sim.step(np.zeros((9, 1)))
        moves = []
        for _ in range(8):
            sim.step(np.ones((9, 1)))
            moves.append(bool(np.all(sim.qvel > 0)))
        assert moves == [k >= late for k in range(8)]


def test_a_cubic_delay_is_refused_but_where_it_is_whole():
    history = 'nsample="8" interp="cubic" delay="{}"'
    stepper.load(WHEEL.format(history=history.format(0.03)))
    with pytest.raises(stepper.ModelError, match=r"actuator delay.*m.*cubic"):
        stepper.load(WHEEL.format(history=history.format(0.025)))


@pytest.mark.parametrize("actuator", [
    'dcmotor {} motorconst=".05" resistance="2" inductance=".01"',
    'dcmotor {} motorconst=".05" resistance="2" cogging=".1 6 0"',
    'dcmotor {} motorconst=".05" resistance="2" lugre="1 2 3 4 5"',
    'dcmotor {} motorconst=".05" resistance="2" thermal="1 2 3 4 5 6"',
    'dcmotor {} motorconst=".05" resistance="2" input="pos" controller="1 2 3"',
    'pid {} kp="3" ki="1" input="pos"',
    'pid {} kp="3" slewmax="1" input="pos"',
    'pid {} kp="3"',
])  # fmt: skip
def test_motors_and_servos_beyond_an_affine_law_are_refused_by_name(actuator):
    text = TREE.format(actuators=f"<{actuator.format(TARGETS['joint'])} name='hip'/>", sensors="")
    with pytest.raises(stepper.ModelError, match=r"hip.*(dcmotor|pid|2 controls) not simulated"):
        stepper.load(text)
    assert stepper.load(text, strict=False).nu == 0


@pytest.mark.parametrize("integrator", ["midpoint", "implicit"])
@pytest.mark.parametrize("target", ["site on the world", "site on the same tree"])
def test_a_stiff_servo_on_a_site_is_stable(target, integrator):
    """At h sqrt(k/m) of 20 and more: what the mass matrix holds of a wrench, on one chain or across branches, keeps the motion bounded."""
    actuator = f'<position {TARGETS[target]} kp="1e6" kv="1e3" name="a"/>'
    text = TREE.format(actuators=actuator, sensors='<actuatorpos actuator="a"/>').replace("-9.81", "0")
    sim = simulate(text, integrator=integrator)
    length = sim.sensordata_ideal[0]
    energy = 1e6 / 2 * 1e-3**2  # Of a servo whose set point is a thousandth beyond its length, in J: all that there is.
    for _ in range(2000):
        sim.step([length + 1e-3])
        assert sim.status == stepper.Status.OK
        # The arms turn with the bodies, which the rules take to second order (midpoint) and first order.
        assert sim.energy()[1] < 1.2 * energy
