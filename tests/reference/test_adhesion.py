"""Actuators on the contacts of a body (`<adhesion>`): one step equals MuJoCo's by its law, and hard contact holds what suction holds."""

import mujoco
import numpy as np
import pytest
import stepper

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


def random_state(model: mujoco.MjModel, rng: np.random.Generator) -> mujoco.MjData:
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
    states = [random_state(model, rng) for _ in range(n)]
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


HANGING = """
<mujoco><option timestep="{h}"/><worldbody><body name="cup" pos="0 0 1"><geom type="box" size=".05 .05 .05" {reach}/></body>
<body name="box" pos="0 0 {z}"><freejoint/><geom type="box" size=".05 .05 .05" mass="{mass}" {reach}/></body></worldbody>
<actuator><adhesion name="suck" body="cup" gain="10" ctrlrange="0 1"/></actuator></mujoco>"""


def hanging(mass=0.5, z=0.9, h=0.002, reach="", **more) -> stepper.Stepper:
    return stepper.Stepper(stepper.load(HANGING.format(mass=mass, z=z, h=h, reach=reach)), **more)


@pytest.mark.parametrize("precision", ["f64", "f32"])
@pytest.mark.parametrize("integrator", ["midpoint", "implicit", "euler", "rk4"])
@pytest.mark.parametrize("h", [0.001, 0.005, 0.02])
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
    with pytest.raises(stepper.ModelError, match="actuator g: transmission body with a force that depends on its length or velocity"):
        stepper.load(scene)
    model = stepper.load(HANGING.format(mass=1, z=0.9, h=0.002, reach=""))
    assert (model.actuator(0).trntype, model.actuator(0).trnid) == ("body", model.body("cup").id)
    with pytest.raises(stepper.ModelError, match="it acts on the contacts of a body"):
        model.replace(actuator_gear=[[2.0, 0, 0, 0, 0, 0]])
    with pytest.raises(ValueError, match="servo"):
        stepper.Stepper(model, actuators=stepper.ActuatorModel({"*": stepper.Drive(servo=stepper.actuators.PID(kp=1.0))}))
