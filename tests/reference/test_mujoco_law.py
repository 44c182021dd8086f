"""MuJoCo's contact law: one step from the same state gives MuJoCo's velocity, in every state whose contacts agree."""

import mujoco
import numpy as np
import pytest
import stepper
from checks import every, raises
from equalities import KINDS, LINKAGE
from models import SOURCES
from mujoco_law.parity import AGREES, States as Found, compare, prepare, states
from stepper.loading.mjcf import describe

# The acceleration of both is that of a strictly convex problem, which both solve until rounding stops them: relative to 1 + max |qvel| the
# velocities after a step differ by less than 1e-9, or than MuJoCo's own solvers do (Parity.agrees).
LEFT_OUT = {
    "dm_control/lqr": "nothing in it moves",
    "gymnasium/point": "its ball is as far above the floor as rounding says, above in one and below in the other",
}
OTHER_POINTS = {"gymnasium/pusher": "plane and cylinder", "gymnasium/pusher_v5": "plane and cylinder", "dm_control/dog": "hulls"}


EXACT = stepper.Options(contact="mujoco", tolerance=1e-13, iterations=100)
CROWD = """<mujoco><option cone="{cone}" timestep=".004"/><worldbody><geom type="plane" size="9 9 .1" friction=".6"/>
  {bodies}<body name="plate" pos="0 0 .05"><freejoint/><geom type="box" size="1 1 .04" mass="9"/></body></worldbody></mujoco>"""
TUMBLES = """<mujoco><option integrator="implicitfast" timestep=".01" gravity="0 0 {gravity}"/><worldbody><geom type="plane" size="9 9 .1"/>
  <body name="stone" pos="0 0 .3"><freejoint/><geom type="box" size=".1 .2 .05" mass="2"/><site name="s" pos=".1 0 .1"/></body>
  <body pos="2 0 1"><freejoint/><geom type="ellipsoid" size=".1 .05 .03" mass="1"/></body></worldbody>{more}</mujoco>"""


def compiled(source, **options):
    """A compiled model that solves to the last digit, with fields of its options."""
    text = str(source)
    model = mujoco.MjModel.from_xml_string(text) if text.lstrip().startswith("<") else mujoco.MjModel.from_xml_path(text)
    prepare(model)
    for name, value in options.items():
        setattr(model.opt, name, value)
    if model.opt.noslip_iterations:
        # The sweeps hold normal forces: an error of 1e-9 m/s^2 in a stiff contact, which the solution hides, is one of 1e-6 N in these.
        model.opt.tolerance = 1e-16
    return model


def parity(model, count=12, seed=0):
    """One step from states of a model. Noslip sweeps change the velocity after it in some state."""
    ours, found = stepper.load(model, strict=False), states(model, count, seed)
    if model.opt.noslip_iterations and model.geom_condim.max() > 1:
        assert compare(ours.replace(noslip_iterations=0), found).agrees < 1.0
    return compare(ours, found)


def start(model, found):
    """A stepper with an environment at each of some states."""
    sim = stepper.Stepper(model, len(found.qpos), options=EXACT)
    sim.set_state(qpos=found.qpos, qvel=found.qvel, act=found.act)
    return sim


def stepped(model, found):
    """MuJoCo's data after a step from each state."""
    data = mujoco.MjData(model)
    for env in range(len(found.qpos)):
        for name in ("qpos", "qvel", "act", "ctrl"):
            getattr(data, name)[:] = getattr(found, name)[env]
        data.qacc_warmstart[:] = 0.0
        mujoco.mj_step(model, data)
        yield env, data


def assert_same_velocity(sim, model, found):
    for env, data in stepped(model, found):
        assert np.abs(sim.qvel[env] - data.qvel).max() < AGREES * (1 + np.abs(found.qvel[env]).max())


@every(sweeps=[0, 20], name=sorted(set(SOURCES) - set(LEFT_OUT)))
def test_robots_of_others_step_as_in_mujoco(name, sweeps):
    """With and without noslip sweeps, which do the same in the same order."""
    model = compiled(SOURCES[name], noslip_iterations=sweeps)
    found = compare(stepper.load(model, strict=False), states(model, 12))
    assert found.agrees == 1.0
    assert found.same == 1.0 or name in OTHER_POINTS


@every(sweeps=[0, 20], cone=["pyramidal", "elliptic"], integrator=["euler", "implicitfast", "implicit", "rk4"])
def test_every_cone_with_every_integrator(cone, integrator, sweeps):
    cone, integrator = getattr(mujoco.mjtCone, f"mjCONE_{cone.upper()}"), getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    found = parity(compiled(SOURCES["dm_control/quadruped"], cone=int(cone), integrator=int(integrator), noslip_iterations=sweeps))
    assert found.touching > 0.5
    assert found.agrees == 1.0


SCENE = """<mujoco><compiler angle="radian"/><option {option}/><default><geom {geom}/><joint {joint}/></default><worldbody>
  <geom name="floor" type="plane" size="4 4 .1" {floor}/>
  <body name="ball" pos="0 0 .099"><freejoint/><geom name="ball" size=".1" {ball}/></body>
  <body name="box" pos=".5 0 .0995" euler=".05 .07 .1"><freejoint/><geom name="box" type="box" size=".1 .1 .1"/></body>
  <body name="rod" pos="-.5 0 .0495" euler="0 1.53 .35"><freejoint/><geom name="rod" type="capsule" size=".05 .15"/></body>
  <body name="arm" pos="0 .5 .3"><joint name="hinge" axis="0 1 0" range="-.1 .1" limited="true"/>
    <geom type="capsule" size=".02" fromto="0 0 0 .2 0 0"/>
    <body pos=".2 0 0"><joint name="slide" type="slide" axis="1 0 0" range="-.01 .02" limited="true"/><geom size=".03"/></body></body>
  <body name="bob" pos="0 -.5 .5"><joint name="socket" type="ball" range="0 .2" limited="true"/>
    <geom type="capsule" size=".02" fromto="0 0 0 .05 0 -.2"/></body>
  </worldbody>{more}</mujoco>"""
PAIR = '<contact><pair geom1="floor" geom2="ball" condim="6" friction="{friction}" {more}/></contact>'
SCENES = {
    "defaults": {},
    "elliptic": {"option": 'cone="elliptic"'},
    "impratio": {"option": 'cone="elliptic" impratio="10"'},
    "impratio of a pyramid": {"option": 'impratio="5"'},
    "condim 1": {"geom": 'condim="1"'},
    "condim 4": {"geom": 'condim="4"', "option": 'cone="elliptic"'},
    "condim 4 of a pyramid": {"geom": 'condim="4"'},
    "condim 6": {"geom": 'condim="6" friction=".8 .02 .003"', "option": 'cone="elliptic"'},
    "condim 6 of a pyramid": {"geom": 'condim="6" friction=".8 .02 .003"'},
    "some of each": {"floor": 'condim="1"', "ball": 'condim="6"'},
    "priority": {"floor": 'priority="2" condim="4" friction=".3 .01 0" solref=".04 .7"', "geom": 'condim="6"'},
    "solmix": {"floor": 'solmix="3" solref=".05 1.2" solimp=".5 .8 .01 .3 3"', "ball": 'solimp=".8 .99 .002 .6 1.5"'},
    "no solmix": {"floor": 'solmix="0" solref=".05 1.2"'},
    "direct solref": {"geom": 'solref="-2000 -30"', "joint": 'solreflimit="-500 -7"'},
    "one direct solref": {"floor": 'solref="-2000 -30"'},
    "time constants below two steps": {"geom": 'solref=".001 1"', "joint": 'solreflimit=".002 1"'},
    "refsafe off": {"geom": 'solref=".003 1"', "more": '<option><flag refsafe="disable"/></option>'},
    "flat impedance": {"geom": 'solimp=".9 .9 .001"', "joint": 'solimplimit=".5 .9 0"'},
    "linear impedance": {"geom": 'solimp=".3 .9 .02 .5 1"'},
    "margin": {"geom": 'margin=".01"', "joint": 'margin=".004"'},
    "gap": {"geom": 'margin=".01" gap=".02"'},
    "dry friction": {"joint": 'frictionloss=".05" solreffriction=".03 1" solimpfriction=".8 .9 .01"'},
    "explicit pair": {"more": PAIR.format(friction=".9 .3 .02 .003 .001", more='solref=".03 1" solimp=".7 .9 .01"')},
    "explicit pair of an ellipse": {
        "option": 'cone="elliptic"',
        "more": PAIR.format(friction=".9 .3 .02 .003 .001", more='solref=".03 1" solreffriction=".08 1"'),
    },
    "override": {
        "option": 'o_solref=".06 1" o_solimp=".4 .8 .01 .5 2" o_margin=".004" o_friction=".6 .6 .01 .001 .001"',
        "geom": 'margin=".01" friction=".2"',
        "more": '<option><flag override="enable"/></option>',
    },
    "conveyor": {"floor": 'surfacevel=".3 .1 0 0 0 .2"', "geom": 'condim="4"'},
    "tendons": {
        "more": '<tendon><fixed name="t" range="-.05 .05" limited="true" frictionloss=".02" stiffness="3" damping=".2">'
        '<joint joint="hinge" coef="1"/><joint joint="slide" coef="-2"/></fixed></tendon>'
    },
    "implicitfast": {"option": 'integrator="implicitfast"', "joint": 'damping=".1"'},
    "implicit": {"option": 'integrator="implicit"', "joint": 'damping=".1"'},
    "damping": {"joint": 'damping=".1"'},
    "eulerdamp off": {"joint": 'damping=".1"', "more": '<option><flag eulerdamp="disable"/></option>'},
    "rk4": {"option": 'integrator="RK4"'},
}


def scene(**parts):
    return SCENE.format(**{part: "" for part in ("option", "geom", "joint", "floor", "ball", "more")} | parts)


@pytest.mark.parametrize(("sweeps", "tolerance"), [(0, 0.0), (1, 0.0), (20, 1e-6), (20, 0.0)])
@pytest.mark.parametrize("name", SCENES)
def test_every_number_of_the_law_means_what_it_means_in_mujoco(name, sweeps, tolerance):
    found = parity(compiled(scene(**SCENES[name]), noslip_iterations=sweeps, noslip_tolerance=tolerance), 12 if sweeps else 20)
    assert found.touching > 0.5
    assert found.same > 0.5
    assert found.agrees == 1.0


@pytest.mark.parametrize("name", [name for name in KINDS if "mocap" not in name])
def test_equalities_are_mujocos(name):
    assert parity(compiled(LINKAGE.format(equality=KINDS[name]))).agrees == 1.0


def test_randomised_masses_keep_the_inverse_weights_of_the_model():
    """MuJoCo's regularisation is relative to weights that its compiler computed; a mass that is changed afterwards does not move them."""
    model = compiled(scene())
    found = states(model, 10)
    sim = start(stepper.load(model), found)
    sim.randomize(body_mass=np.tile(model.body_mass, (10, 1)) * 3.0, body_inertia=np.tile(model.body_inertia, (10, 1, 1)) * 3.0)
    sim.step()
    model.body_mass[:] *= 3.0
    model.body_inertia[:] *= 3.0
    weights = model.body_invweight0.copy(), model.dof_invweight0.copy()
    mujoco.mj_setConst(model, mujoco.MjData(model))
    model.body_invweight0[:], model.dof_invweight0[:] = weights
    assert_same_velocity(sim, model, found)


def test_forces_of_constraints_are_mujocos():
    """Generalized forces of all constraints, and of every contact, relative 1e-9 of the largest: rounding of a sum."""
    model = compiled(SOURCES["dm_control/quadruped"])
    found = states(model, 12)
    sim = start(stepper.load(model, strict=False), found)
    sim.step(found.ctrl)
    wrench, touching = np.zeros(6), 0
    for env, data in stepped(model, found):
        size = 1 + np.abs(data.qfrc_constraint).max()
        assert np.abs(sim.qfrc_constraint[env] - data.qfrc_constraint).max() < AGREES * size
        theirs = []
        for i, contact in enumerate(data.contact):
            mujoco.mj_contactForce(model, data, i, wrench)
            theirs.append((int(contact.geom[0]), int(contact.geom[1]), wrench[0]))
        mine = [(int(c["geom"][0]), int(c["geom"][1]), c["force"][0]) for c in sim.contacts(env) if c["distance"] < 0]
        touching += len(theirs)
        assert [c[:2] for c in sorted(mine)] == [c[:2] for c in sorted(theirs)]
        assert np.allclose([c[2] for c in sorted(mine)], [c[2] for c in sorted(theirs)], rtol=0, atol=AGREES * size)
    assert touching > 10


def test_what_is_replaced_is_what_mujoco_compiles():
    """Softness, and masses with the weights that follow them, as after `mj_setConst`."""
    model = compiled(scene(joint='frictionloss=".05"'))
    found = states(model, 10)
    ours = stepper.load(model).replace(
        geom_solref=np.tile([0.05, 0.8], (model.ngeom, 1)), geom_solimp=np.tile([0.7, 0.9, 0.01, 0.4, 3], (model.ngeom, 1)),
        geom_solmix=np.arange(1.0, model.ngeom + 1), jnt_solref=np.tile([-300.0, -4.0], (model.njnt, 1)),
        dof_solref=np.tile([0.03, 1.0], (model.nv, 1)), body_mass=2 * model.body_mass, body_inertia=2 * model.body_inertia,
    )  # fmt: skip
    model.geom_solref[:], model.geom_solimp[:], model.geom_solmix[:] = [0.05, 0.8], [0.7, 0.9, 0.01, 0.4, 3], np.arange(1, model.ngeom + 1)
    model.jnt_solref[:], model.dof_solref[:] = [-300, -4], [0.03, 1]
    model.body_mass[:], model.body_inertia[:] = 2 * model.body_mass, 2 * model.body_inertia
    mujoco.mj_setConst(model, mujoco.MjData(model))
    sim = start(ours, found)
    sim.step()
    assert_same_velocity(sim, model, found)


def test_a_model_without_inverse_weights_gets_those_of_mujocos_compiler():
    """Relative 1e-9: the same matrices, summed in another order; the compiler's own are in double precision."""
    source = SOURCES["dm_control/humanoid"]
    kept = stepper.load(str(source), strict=False)
    described = describe(mujoco.MjModel.from_xml_path(str(source)))
    described["soft"]["inverse_weights"] = None
    code = stepper.Model.from_description(described, strict=False)
    settings = stepper.Options(contact="mujoco")
    sims = [stepper.Stepper(model, options=settings) for model in (kept, code)]
    for sim in sims:
        sim.step(np.linspace(-1, 1, kept.nu), nstep=200)
    assert np.abs(sims[0].qpos - sims[1].qpos).max() < 1e-6


def _crowd(cone):
    """Spheres and capsules of all kinds of contact in front of the plate that they lie on."""
    shapes = ('type="sphere" size=".1"', 'type="capsule" size=".08 .1"')
    bodies = "".join(
        f'<body pos="{0.35 * (k % 4) - 0.5} {0.35 * (k // 4) - 0.35} .3"><freejoint/>'
        f'<geom {shapes[k % 2]} mass="{1 + k}" condim="{condim}"/></body>'
        for k, condim in enumerate((1, 3, 4, 6) * 3)
    )
    return CROWD.format(cone=cone, bodies=bodies)


@pytest.mark.parametrize("cone", ["elliptic", "pyramidal"])
def test_bodies_on_a_plate_accelerate_as_mujocos(cone):
    """The plate is the last body, and the first of the solver's matrix."""
    found = parity(compiled(_crowd(cone)), count=30)
    assert found.touching > 0.5
    assert found.same > 0.5
    assert found.agrees == 1.0


@pytest.mark.parametrize(("options", "words"), [
    ({"integrator": "midpoint"}, "integrator is midpoint"),
    ({"contact": "hard", "integrator": "implicitfast"}, "integrator is implicitfast"),
    ({"contact": "soft"}, 'contact is "soft", must be one of: hard, mujoco'),
])  # fmt: skip
def test_what_the_law_does_not_have_is_named(options, words):
    raises(ValueError, words, lambda: stepper.Stepper(stepper.load(scene()), options=stepper.Options(**({"contact": "mujoco"} | options))))


@pytest.mark.parametrize("more", ["", '<actuator><position site="s" refsite="r" gear="1 .2 0 0 .1 0" kp="300" kv="4"/></actuator>'])
def test_free_bodies_tumble_as_mujocos(more):
    """Bodies on free joints have the derivative of their gyroscopic force in the implicit matrix."""
    text = TUMBLES.format(gravity=-9.81, more=more).replace('<geom type="plane"', '<site name="r" pos=".1 .2 .3"/><geom type="plane"')
    model = compiled(text)
    rng, data = np.random.default_rng(1), mujoco.MjData(model)
    sim = stepper.Stepper(stepper.load(model), options=EXACT)
    assert sim.options.integrator is None  # The file's.
    touching = set()
    for _ in range(40):
        qpos, qvel = model.qpos0.copy(), rng.normal(0, 8, model.nv)
        qpos[2], qpos[3:7] = rng.uniform(0.05, 0.4), rng.normal(0, 1, 4)
        qpos[3:7] /= np.linalg.norm(qpos[3:7])
        data.qpos[:], data.qvel[:], data.qacc_warmstart[:] = qpos, qvel, 0.0
        sim.set_state(qpos=qpos, qvel=qvel)
        mujoco.mj_step(model, data)
        touching.add(data.ncon > 0)
        sim.step()
        assert np.abs(sim.qvel - data.qvel).max() < AGREES * (1 + np.abs(qvel).max())
    assert touching == {True, False}


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "implicit", "RK4"])
def test_a_step_with_the_inertia_of_a_tendon_is_mujocos(integrator):
    """The inertia of a fixed tendon is in the mass matrix."""
    tendon = '<fixed armature=".3"><joint joint="hinge" coef="1"/><joint joint="slide" coef="-2"/></fixed>'
    model = compiled(scene(option=f'integrator="{integrator}"', more=f"<tendon>{tendon}</tendon>"))
    assert model.tendon_armature[0] == 0.3
    assert compare(stepper.load(model), states(model, 12)).agrees == 1.0


def test_a_second_of_motion_is_mujocos_until_chaos():
    """A walker of both engines: 300 steps apart by less than 1e-6, since errors of 1e-15 grow tenfold in some thirty steps of contact."""
    model = compiled(SOURCES["dm_control/walker"])
    sim = stepper.Stepper(stepper.load(model, strict=False), options=stepper.Options(contact="mujoco", tolerance=1e-12))
    data, touching = mujoco.MjData(model), 0
    for k in range(300):
        ctrl = np.sin(0.1 * k + np.arange(model.nu))
        data.ctrl[:] = ctrl
        mujoco.mj_step(model, data)
        sim.step(ctrl)
        touching += bool(data.ncon)
    assert touching > 100
    assert np.abs(sim.qpos - data.qpos).max() < 1e-6


def test_states_that_are_compared_touch():
    """The comparison of contacts can fail: of a state that was moved, contacts are others."""
    model = compiled(SOURCES["dm_control/walker"])
    found = states(model, 10)
    moved = Found(**(vars(found) | {"qpos": found.qpos + 1e-3}))
    assert compare(stepper.load(model, strict=False), moved).same < 1.0
