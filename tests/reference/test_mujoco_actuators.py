"""Actuators against MuJoCo: every kind that is simulated, on joints, fixed tendons and sites.

Lengths, velocities, forces and generalized forces are functions of the state, so they agree to rounding: 1e-10 relative to the largest.
"""

import mujoco
import numpy as np
import pytest
import stepper
from actuators import ALL_KINDS, TARGETS, TREE, scene
from checks import every, raises
from models import forward, random_state, samples, simulate
from numerics import relative_error

BOUND = 1e-10  # As for smooth dynamics: rounding (1e-16) times what a mass matrix loses in a difference of accelerations.
STATES = 20
WHEEL = """<mujoco><option gravity="0 0 0" timestep=".01"/><worldbody><body><joint name="axle" axis="0 0 1"/>
  <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body></worldbody>
  <actuator><motor name="m" joint="axle" {history}/></actuator></mujoco>"""


EARLY = """<mujoco><option gravity="0 0 0" timestep=".01"/><worldbody><body><joint name="axle" axis="0 0 1"/>
  <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body></worldbody>
  <actuator><general joint="axle" dyntype="filter" dynprm=".1" gainprm="3" actearly="{early}"/></actuator></mujoco>"""
HANGING = """
<mujoco><option timestep="{h}"/><worldbody><body name="cup" pos="0 0 1"><geom type="box" size=".05 .05 .05" {reach}/></body>
<body name="box" pos="0 0 {z}"><freejoint/><geom type="box" size=".05 .05 .05" mass="{mass}" {reach}/></body></worldbody>
<actuator><adhesion name="suck" body="cup" gain="10" ctrlrange="0 1"/></actuator></mujoco>"""


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
        assert relative_error(sim.mass_matrix() @ (sim.qacc_smooth - idle.qacc_smooth), data.qfrc_actuator) < BOUND
        assert relative_error(sim.actuator_force, data.actuator_force) < BOUND
        if "early" in kind:
            continue  # The time step of `reader` determines its early activations.
        # A step so short that it changes nothing takes up the control.
        reader.set_state(*state, act=act)
        reader.step(ctrl)
        assert relative_error(reader.sensordata_ideal, data.sensordata) < BOUND


@every(gear=["0 0 0 1 0 0", "0 0 0 .1 0 -.05", "0 0 0 -2 1 3", "1 0 0 1 0 0"], sites=[("tip", "hull"), ("hull", "base"), ("base", "hand")])
def test_setpoints_of_angles_are_those_nearest_to_them(sites, gear):
    """Servos of a rotational gear with a reference, on a free base: setpoints up to several turns away, and what is no such servo."""
    # MuJoCo takes a setpoint on the circle where the gear is a rotation alone and the servo pulls back with as much as it pulls with.
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


@every(integrator=["midpoint", "implicit", "euler", "rk4"], kind=["motor", "position", "velocity"])
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


@every(contact=["hard", "mujoco"], integrator=["euler", "implicit", "midpoint"])
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


@every(delay=[0.3, 1, 1.5, 2.49999999999999, 2.5, 3, 7], samples=[1, 2, 3, 5, 8], interp=["zoh", "linear"])
def test_controls_are_as_late_as_mujocos(delay, samples, interp):
    """Delays in steps, whatever acts between two controls, and where the history is too short. The first control is 0, as MuJoCo's are."""
    # MuJoCo's history of controls begins with zeros, a delay line here with the first control (docs/reference/actuators.md).
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
        moves = samples(sim, 8, lambda sim=sim: bool(np.all(sim.qvel > 0)), np.ones((9, 1)))
        assert moves.tolist() == [k >= late for k in range(8)]


def test_a_cubic_delay_is_refused_but_where_it_is_whole():
    history = 'nsample="8" interp="cubic" delay="{}"'
    stepper.load(WHEEL.format(history=history.format(0.03)))
    raises(stepper.ModelError, r"actuator delay.*m.*cubic", lambda: stepper.load(WHEEL.format(history=history.format(0.025))))


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
    raises(stepper.ModelError, r"hip.*(dcmotor|pid|2 controls) not simulated", stepper.load, text)
    assert stepper.load(text, strict=False).nu == 0


@every(integrator=["midpoint", "implicit"], target=["site on the world", "site on the same tree"])
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


# Actuators on the contacts of a body (`<adhesion>`): one step equals MuJoCo's by its law, and hard contact holds what suction holds.

SCENE = """
<mujoco><option timestep=".002" cone="{cone}" integrator="{integrator}"/>
<default><geom condim="{condim}" friction=".6 .02 .003" {reach}/></default><worldbody>
<geom name="floor" type="plane" size="9 9 1"/><geom name="wall" type="box" size=".02 1 1" pos="-.5 0 0"/>
<body name="arm" pos="0 0 .5"><joint name="a" axis="0 1 0" damping=".2"/><geom type="capsule" size=".03" fromto="0 0 0 .3 0 0" mass=".5"/>
<body name="cup" pos=".3 0 0"><joint name="b" axis="0 1 0" armature=".01"/>
<geom type="capsule" size=".04" fromto=".05 -.02 0 .05 .02 0" mass=".2"/>
</body></body>
<body name="box" pos=".42 0 .5" euler="0 0 0"><freejoint/><geom type="box" size=".03 .03 .03" mass=".4"/></body>
<body name="ball" pos="-.43 0 .3"><freejoint/><geom type="sphere" size=".05" mass=".3"/></body></worldbody>
<actuator><motor joint="a" gear="2"/><adhesion name="suck" body="cup" gain="8" ctrlrange="0 2"/>
<general name="stick" body="ball" gainprm="3" biastype="affine" biasprm=".5 0 0" dyntype="filter" dynprm=".05" forcerange="0 6"/></actuator>
</mujoco>"""
REACHES = {"none": "", "margin": 'margin=".005"', "margin and gap": 'margin=".002" gap=".01"'}
BOX, BALL = slice(2, 8), slice(8, 14)


def text(cone="pyramidal", integrator="Euler", condim=3, reach="none") -> str:
    return SCENE.format(cone=cone, integrator=integrator, condim=condim, reach=REACHES[reach])


def adhering_state(model: mujoco.MjModel, rng: np.random.Generator) -> mujoco.MjData:
    """State in which cup, box, ball and wall are within a few millimetres of each other."""
    data = mujoco.MjData(model)
    data.qpos[:2] = rng.normal(0, 0.02, 2)
    data.qpos[2:5] += rng.normal(0, 0.004, 3)
    data.qpos[5:9] += rng.normal(0, 0.03, 4)
    data.qpos[9:12] += rng.normal(0, 0.004, 3)
    mujoco.mj_normalizeQuat(model, data.qpos)
    data.qvel[:] = rng.normal(0, 0.3, model.nv)
    data.act[:] = rng.uniform(0, 1, model.na)
    data.ctrl[:] = rng.uniform(-1, 2.5, model.nu)
    return data


@pytest.mark.parametrize("reach", REACHES)
@pytest.mark.parametrize(("cone", "condim"), [("pyramidal", 1), ("pyramidal", 3), ("elliptic", 3), ("elliptic", 6)])
@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "implicit", "RK4"])
def test_a_step_is_mujocos(integrator, cone, condim, reach):
    model = mujoco.MjModel.from_xml_string(text(cone, integrator, condim, reach))
    model.opt.iterations, model.opt.tolerance, model.opt.ls_tolerance = 500, 0, 1e-12
    n, rng = 24, np.random.default_rng(0)
    states = [adhering_state(model, rng) for _ in range(n)]
    name = {"Euler": "euler", "implicitfast": "implicitfast", "implicit": "implicit", "RK4": "rk4"}[integrator]
    sim = stepper.Stepper(stepper.load(model), n, options=stepper.Options(contact="mujoco", integrator=name, tolerance=1e-13))
    sim.set_state(**{field: np.array([getattr(s, field) for s in states]) for field in ("qpos", "qvel", "act")})
    sim.step(np.array([s.ctrl for s in states]))
    pulled = 0
    for env, state in enumerate(states):
        mujoco.mj_step(model, state)
        pulled += np.any(state.actuator_force[1:] != 0) and state.ncon > 0
        # As far as MuJoCo solves the problem, relative to the accelerations of a pull on 0.3 kg.
        np.testing.assert_allclose(sim.qvel[env], state.qvel, atol=2e-9 * (1 + np.abs(state.qvel).max()))
        np.testing.assert_allclose(sim.act[env], state.act, atol=1e-14)
    assert pulled > n / 2


def hanging(mass=0.5, z=0.9, h=0.002, reach="", **more) -> stepper.Stepper:
    return stepper.Stepper(stepper.load(HANGING.format(mass=mass, z=z, h=h, reach=reach)), **more)


@every(precision=["f64", "f32"], integrator=["midpoint", "implicit", "euler", "rk4"], h=[0.001, 0.005, 0.02])
def test_suction_holds_a_box_at_rest(integrator, h, precision):
    """10 N hold 0.5 kg for ten seconds. Without control the box falls freely."""
    sim = hanging(h=h, options=stepper.Options(integrator=integrator), precision=precision)
    sim.step([1.0], nstep=round(10 / h))
    # Gaps at rest are closed up to their rounding error.
    assert abs(sim.qpos[2] - 0.9) < (1e-8 if precision == "f64" else 2e-6)
    assert sim.status == 0
    sim.step([0.0], nstep=round(0.1 / h))
    assert sim.qpos[2] == pytest.approx(0.9 - 9.81 * 0.1**2 / 2, abs=0.1 * 9.81 * h + 1e-5)


@pytest.mark.parametrize(("mass", "stays"), [(1.0, True), (10 / 9.81 - 1e-3, True), (10 / 9.81 + 1e-3, False), (2.0, False)])
def test_suction_holds_up_to_its_force(mass, stays):
    sim = hanging(mass)
    sim.step([1.0], nstep=1000)
    assert (sim.qpos[2] > 0.899) == stays


def test_contacts_of_the_pads_share_the_force_and_the_normal_force_is_the_rest():
    """The contacts push with F - m g, so that friction under suction is mu (F - m g)."""
    sim = hanging(0.5)
    sim.step([1.0], nstep=20)
    assert np.sum(sim.contacts()["force"][:, 0]) == pytest.approx(10 - 0.5 * 9.81, abs=1e-6)
    assert sim.actuator_force[0] == 10
    np.testing.assert_allclose(sim.qfrc_actuator[:3], [0, 0, 10], atol=1e-9)


@pytest.mark.parametrize("contact", ["hard", "mujoco"])
def test_suction_pulls_across_a_gap(contact):
    """A box 4 mm below the cup is pulled up within gaps of 3 + 3 mm, and falls without them. Before it touches, a = F / m - g."""
    near = hanging(z=0.896, reach='gap=".003"', options=stepper.Options(contact=contact))
    near.step([1.0])
    # Each point of the box accelerates alike, so that the first step has the velocity of a free motion.
    assert near.qvel[2] == pytest.approx((10 / 0.5 - 9.81) * 0.002, abs=1e-9)
    near.step([1.0], nstep=500)
    assert abs(near.qpos[2] - 0.9) < 2e-3
    far = hanging(z=0.896, options=stepper.Options(contact=contact))
    far.step([1.0], nstep=100)
    assert far.qpos[2] < 0.8


@pytest.mark.parametrize("contact", ["hard", "mujoco"])
def test_derivatives_by_the_control_are_those_of_the_pull(contact):
    """In the gap, the control changes the velocity by gain h / m; in contact, only the push of the contact changes."""
    options = stepper.Options(contact=contact, **({"integrator": "euler"} if contact == "mujoco" else {}))
    pulled = hanging(z=0.896, reach='gap=".003"', options=options)
    held = hanging(options=options)
    for sim, slope in ((pulled, 10 * 0.002 / 0.5), (held, 0.0)):
        sim.step([0.9], nstep=1 if sim is pulled else 300)
        block = sim.linearize(("ctrl",)).blocks["ctrl"]
        # MuJoCo's contact is a spring: the pull changes its compression.
        assert block[sim.model.nv + 2, 0] == pytest.approx(slope, abs=1e-6 if contact == "hard" or sim is pulled else 0.04)


def test_what_adhesion_cannot_be_is_refused():
    biased = '<actuator><general name="g" body="cup" gainprm="1" biastype="affine" biasprm="0 0 -1"/></actuator>'
    scene = HANGING.format(mass=1, z=0.9, h=0.002, reach="").split("<actuator>")[0] + biased + "</mujoco>"
    raises(stepper.ModelError, "actuator g: transmission body with a force that depends on its length or velocity", stepper.load, scene)
    model = stepper.load(HANGING.format(mass=1, z=0.9, h=0.002, reach=""))
    assert (model.actuator(0).trntype, model.actuator(0).trnid) == ("body", model.body("cup").id)
    raises(stepper.ModelError, "it acts on the contacts of a body", model.replace, actuator_gear=[[2.0, 0, 0, 0, 0, 0]])
    with pytest.raises(ValueError, match="servo"):
        stepper.Stepper(model, actuators=stepper.ActuatorModel({"*": stepper.Drive(servo=stepper.actuators.PID(kp=1.0))}))
