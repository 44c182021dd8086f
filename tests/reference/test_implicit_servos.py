"""Servos with MuJoCo's implicit integrators: one step and a short motion are MuJoCo's, whatever the servos drive.

MuJoCo keeps of the derivative of actuator forces what its sparse matrices have entries for: products of dofs on one branch (`qDeriv`), and
with implicitfast nothing between the dofs of a simple body (`M`). It drops the derivative of an actuator whose force is at a bound, its
own or that of the joint that it drives. All numbers here are smooth functions of the state, so that both agree to rounding.
"""

import mujoco
import numpy as np
import pytest
import stepper
from hypothesis import assume, given, strategies as st
from models import full_mass_matrix
from mujoco_law.parity import prepare, states

# Relative to 1 + max |qvel|. Rounding is 1e-16 times what a factored mass matrix loses, 1e-12 in single steps here, and grows with motion.
BOUND = 1e-9
STEPS = 10
FASTEST = 30.0  # rad/s or m/s: beyond it a servo that drives itself on has taken over, and multiplies rounding in every step.
IMPLICIT = pytest.mark.parametrize("integrator", ["implicitfast", "implicit"])
CHAIN = """<body><joint name="a" axis="0 1 0" {a}/><geom size=".1" pos="0 0 .3"/>
  <body pos="0 0 .6"><joint name="b" axis="0 1 0" {b}/><geom size=".1" pos=".1 0 .3"/></body></body>"""
BRANCHES = """<body pos="0 0 1"><joint name="base" axis="1 0 0"/><geom size=".1" pos="0 .1 0"/>
  <body pos="0 .3 0"><joint name="a" axis="0 1 0"/><geom size=".05" pos="0 0 .3"/><site name="left" pos="0 0 .3"/></body>
  <body pos="0 -.3 0"><joint name="b" type="{kind}" axis="0 1 0"/><geom size=".05" pos="0 0 .3"/>
    <body pos="0 0 .4"><joint name="c" axis="0 1 0"/><geom size=".05" pos=".1 0 0"/><site name="right" pos=".1 0 .2"/></body>
  </body></body>"""
POINT = """<body><joint name="a" type="slide" axis="1 0 0"/><joint name="b" type="slide" axis="0 1 0"/>
  <joint name="c" axis="0 0 1"/><geom type="box" size=".1 .2 .1"/><site name="s" pos=".1 .2 0"/></body>"""
TENDON = '<fixed name="t" {}><joint joint="a" coef="1"/><joint joint="b" coef="2"/></fixed>'
WIDE = '<fixed name="t" {}><joint joint="a" coef=".5"/><joint joint="b" coef=".5"/><joint joint="c" coef="-.7"/></fixed>'
KV = "kv='3'"
# Name: bodies, tendons, actuators, controls.
SCENES = {
    "gripper": (BRANCHES, WIDE, '<general tendon="t" gainprm="10" biastype="affine" biasprm="0 -10 -10"/>', 1.0),
    "damper of a tendon": (BRANCHES, WIDE.replace("{}", "damping='2'"), '<motor tendon="t"/>', 1.0),
    "slide and hinges": (BRANCHES.replace("{kind}", "slide"), WIDE, '<velocity tendon="t" kv="30"/>', 1.0),
    "site across branches": (BRANCHES, "", f'<velocity site="left" refsite="right" gear="1 2 -1 .1 .2 .3" {KV}/>', 2.0),
    "site on a branch": (BRANCHES, "", f'<velocity site="right" gear="1 2 -1 .1 .2 .3" {KV}/>', 2.0),
    "several on one tendon": (BRANCHES, WIDE, f'<velocity tendon="t" {KV}/><position tendon="t" kp="9" kv="1"/><motor joint="c"/>', 1.0),
    "joint at its bound": (CHAIN.replace("{a}", 'actuatorfrcrange="-5 5"'), "", f'<velocity joint="a" {KV}/>', 3.0),
    "joint just at its bound": (CHAIN.replace("{a}", 'actuatorfrcrange="-6 6"'), "", f'<velocity joint="a" {KV}/>', 2.0),
    "joint within its bound": (CHAIN.replace("{a}", 'actuatorfrcrange="-5 5"'), "", f'<velocity joint="a" {KV}/>', 1.0),
    "sum at the joint's bound": (
        CHAIN.replace("{a}", 'actuatorfrcrange="-6 6"'),
        "",
        f'<velocity joint="a" {KV}/><motor joint="a" gear="5"/>',
        1.0,
    ),
    "tendon on a joint at its bound": (CHAIN.replace("{a}", 'actuatorfrcrange="-5 5"'), TENDON, f'<velocity tendon="t" {KV}/>', 3.0),
    "both on a joint at its bound": (
        CHAIN.replace("{a}", 'actuatorfrcrange="-5 5"'),
        TENDON,
        f'<velocity tendon="t" {KV}/><velocity joint="a" {KV}/>',
        3.0,
    ),
    "force at its bound": (CHAIN, "", f'<velocity joint="a" {KV} forcerange="-5 5"/>', 3.0),
    "force at a bound of zero": (CHAIN, "", f'<velocity joint="a" {KV} forcerange="0 10"/>', 0.0),
    "force within its bounds": (CHAIN, "", f'<velocity joint="a" {KV} forcerange="0 10"/>', 1.0),
    "gain with a velocity": (CHAIN, "", '<general joint="a" gaintype="affine" gainprm="1 -4 -2" ctrlrange="-1 1"/>', 5.0),
    "gain with an activation": (
        CHAIN,
        "",
        '<general joint="a" dyntype="filter" dynprm=".1" gaintype="affine" gainprm="1 -4 -2" biastype="affine" biasprm="0 0 -1"/>',
        5.0,
    ),
    "early activation": (
        CHAIN,
        "",
        '<general joint="a" dyntype="filter" dynprm=".1" gaintype="affine" gainprm="1 -4 -2" biastype="affine" biasprm="0 0 -1"'
        ' actearly="true"/>',
        5.0,
    ),
    "early integrated velocity": (
        CHAIN,
        "",
        '<general joint="b" dyntype="integrator" gainprm="20" biastype="affine" biasprm="0 -20 -2" actlimited="true" actrange="-1 1"'
        ' actearly="true"/>',
        2.0,
    ),
    "early exact filter": (CHAIN, "", '<general joint="b" dyntype="filterexact" dynprm=".02" gainprm="9" actearly="true"/>', 2.0),
    "servo of a ball": (BRANCHES.replace("{kind}", "ball"), "", '<position joint="b" gear="1 2 -.5 0 0 0" kp="9" kv="1"/>', 0.5),
    "servo of a ball in its parent": (
        BRANCHES.replace("{kind}", "ball"),
        "",
        '<velocity jointinparent="b" gear="1 2 -.5 0 0 0" kv="3"/>',
        2.0,
    ),
    "motor with back-EMF": (CHAIN, "", '<dcmotor joint="a" motorconst="2" resistance="1"/>', 5.0),
    "PID": (CHAIN.replace("{b}", 'actuatorfrcrange="-1 1"'), "", '<pid joint="b" kp="20" kv="3" input="pos"/>', 0.2),
    "drives itself on": (CHAIN, "", '<general joint="b" biastype="affine" biasprm="0 0 .2"/>', 1.0),
    "simple body": (POINT, TENDON, '<velocity tendon="t" kv="300"/>', 3.0),
    "damper of a simple body": (POINT, TENDON.replace("{}", "damping='300'"), '<motor tendon="t" gear="90"/>', 3.0),
    "site of a simple body": (POINT, "", '<velocity site="s" gear="1 2 0 0 0 .3" kv="100"/>', 3.0),
    "damper of a free body": (
        "<body><freejoint name='f'/><geom type='box' size='.1 .2 .3'/></body>",
        "",
        '<velocity joint="f" gear="1 2 3 .1 .2 .3" kv="50"/><velocity jointinparent="f" gear="1 2 3 .1 .2 .3" kv="50"/>',
        3.0,
    ),
    "site of a free body": (
        "<body><freejoint/><geom type='box' size='.1 .2 .3'/><site name='s' pos='.1 .2 0'/></body>",
        "",
        '<velocity site="s" gear="1 2 3 .1 .2 .3" kv="100"/>',
        3.0,
    ),
}
numbers = st.floats(-2, 2).map(lambda x: round(x, 3))
positive = st.floats(0.05, 3).map(lambda x: round(x, 3))
ranges = st.tuples(positive, positive).map(lambda ends: f"{-ends[0]} {ends[1]}")
vectors = st.tuples(numbers, numbers, numbers).filter(lambda v: sum(x * x for x in v) > 0.05)
axes = st.one_of(st.sampled_from([(1, 0, 0), (0, 1, 0), (0, 0, 1)]), vectors)
FEET = """<mujoco><option cone="elliptic" impratio="100" timestep=".01"/><worldbody>
  <geom type="plane" size="4 4 .1"/>
  <body name="trunk" pos="0 0 .3"><freejoint/><geom type="box" size=".2 .1 .05" mass="5" contype="0"/>{legs}</body>
  </worldbody></mujoco>"""
LEG = """<body pos="{x} {y} 0"><joint axis="0 1 0" damping="2" armature=".01"/>
  <geom type="capsule" size=".02" fromto="0 0 0 0 0 -.2" mass="1" contype="0"/>
  <body pos="0 0 -.2"><joint axis="0 1 0" damping="2" armature=".01"/>
  <geom size=".023" pos="0 0 -.1" mass=".2" solimp=".015 1 .023" condim="6" friction=".8 .02 .01"/></body></body>"""


def text(bodies, tendons="", actuators="", timestep=0.01):
    bodies, tendons = bodies.replace("{a}", "").replace("{b}", "").replace("{kind}", "hinge"), tendons.replace("{}", "")
    return f"""<mujoco><compiler angle="radian"/><option timestep="{timestep}"><flag contact="disable"/></option>
      <worldbody>{bodies}</worldbody>
      <tendon>{tendons}</tendon><actuator>{actuators}</actuator></mujoco>"""


def difference(source, integrator, ctrl, qvel=None, displacement=None):
    """Largest difference to MuJoCo relative to 1 + max |qvel|, after one step and over a motion of STEPS."""
    model = mujoco.MjModel.from_xml_string(source)
    prepare(model)
    model.opt.integrator = int(getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}"))
    data, options = mujoco.MjData(model), stepper.Options(contact="mujoco", integrator=integrator, tolerance=1e-13)
    sim = stepper.Stepper(stepper.load(model, strict=False), options=options)
    data.ctrl[:] = ctrl
    data.qvel[:] = np.resize([0.3, -1.0, 0.7, 0.2], model.nv) if qvel is None else qvel
    if displacement is not None:
        mujoco.mj_integratePos(model, data.qpos, displacement, 1.0)
    sim.set_state(qpos=data.qpos, qvel=data.qvel)
    found = []
    for _ in range(STEPS):
        mujoco.mj_step(model, data)
        sim.step(data.ctrl)
        if np.abs(data.qvel).max() > FASTEST:
            break
        found.append(float(np.abs(sim.qvel - data.qvel).max() / (1 + np.abs(data.qvel).max())))
    return (found[0], max(found)) if found else (0.0, 0.0)


@IMPLICIT
@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("moves", [False, True])
def test_servos_are_mujocos(name, integrator, moves):
    bodies, tendons, actuators, ctrl = SCENES[name]
    step, motion = difference(text(bodies, tendons, actuators), integrator, ctrl, None if moves else 0.0)
    assert step < BOUND and motion < BOUND


def test_the_derivative_across_branches_is_felt():
    """The gripper's tendon across branches: with the terms between branches one step would be another by 30 %."""
    bodies, tendons, actuators, ctrl = SCENES["gripper"]
    model = mujoco.MjModel.from_xml_string(text(bodies, tendons, actuators))
    model.opt.integrator = int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
    data = mujoco.MjData(model)
    data.ctrl[:] = ctrl
    mujoco.mj_step(model, data)
    arm = np.array([0.0, 0.5, 0.5, -0.7])
    whole = np.linalg.solve(full_mass_matrix(model, data) + 0.01 * 10 * np.outer(arm, arm), 0.01 * (data.qfrc_smooth))
    assert np.abs(whole - data.qvel).max() > 0.1 * np.abs(data.qvel).max()


def words(numbers):
    return " ".join(str(x) for x in numbers)


@st.composite
def joints(draw, name, axis):
    kind, damping = draw(st.sampled_from(["hinge", "slide"])), draw(st.sampled_from([0, 0.3]))
    bound = f'actuatorfrcrange="{draw(ranges)}"' if draw(st.booleans()) else ""
    # An armature keeps joints apart that move alike.
    return f'<joint name="{name}" type="{kind}" axis="{words(axis)}" damping="{damping}" armature=".1" {bound}/>'


@st.composite
def servos(draw, target):
    bound = f'forcerange="{draw(ranges)}"' if draw(st.booleans()) else ""
    limit = f'ctrlrange="{draw(ranges)}"' if draw(st.booleans()) else ""
    kind = draw(st.sampled_from(["motor", "position", "velocity", "general", "filtered"]))
    if kind == "motor":
        return f"<motor {target} {bound} {limit}/>"
    if kind in ("position", "velocity"):
        stiffness = f'kp="{draw(positive)}"' if kind == "position" else ""
        return f'<{kind} {target} {bound} {limit} {stiffness} kv="{draw(positive)}"/>'
    gain, bias = words(draw(vectors)), words(draw(vectors))
    dynamics = 'dyntype="filter" dynprm=".05"' if kind == "filtered" else ""
    return f'<general {target} {bound} {limit} {dynamics} gaintype="affine" gainprm="{gain}" biastype="affine" biasprm="{bias}"/>'


@st.composite
def trees(draw):
    """Random trees with servos on joints, tendons and sites, as MJCF, and the number of bodies."""
    count, names, open_bodies = draw(st.integers(1, 5)), [], []
    children, opening = {b: [] for b in range(count)}, []
    for b in range(count):
        parent = draw(st.integers(-1, b - 1))
        (children[parent] if parent >= 0 else open_bodies).append(b)
        if parent < 0 and draw(st.integers(0, 5)) == 0:
            own = "<freejoint/>"
        else:
            new = [f"j{len(names) + k}" for k in range(draw(st.integers(1, 2)))]
            # Of parallel slides of one body MuJoCo takes a mass matrix that is diagonal.
            pairs = st.tuples(axes, axes).filter(lambda pair: np.linalg.norm(np.cross(*pair)) > 0.3 * np.prod(np.linalg.norm(pair, axis=1)))
            own = "".join(draw(joints(name, axis)) for name, axis in zip(new, draw(pairs), strict=False))
            names += new
        centre = draw(st.sampled_from([(0, 0, 0), (0.1, -0.2, 0.05)]))
        opening.append(
            f'<body pos="{words(draw(vectors))}">{own}<geom type="box" size=".1 .15 .05" pos="{words(centre)}"/>'
            f'<site name="s{b}" pos="{words(draw(vectors))}"/>'
        )

    def body(b):
        return opening[b] + "".join(body(c) for c in children[b]) + "</body>"

    tendons = []
    for t in range(draw(st.integers(0, 2)) if names else 0):
        terms = draw(st.lists(st.sampled_from(names), min_size=1, max_size=3, unique=True))
        coefficients = "".join(f'<joint joint="{j}" coef="{draw(positive)}"/>' for j in terms)
        tendons.append(f'<fixed name="t{t}" damping="{draw(st.sampled_from([0, 0.5]))}">{coefficients}</fixed>')
    targets = [f'joint="{j}"' for j in names] + [f'tendon="t{t}"' for t in range(len(tendons))]
    targets = [f'{t} gear="{draw(positive)}"' for t in targets]
    targets += [f'site="s{b}" gear="{words(draw(vectors) + draw(vectors))}"' for b in range(count)]
    targets += [f'site="s{b}" refsite="s{b - 1}" gear="{words(draw(vectors) + draw(vectors))}"' for b in range(1, count)]
    actuators = [draw(servos(draw(st.sampled_from(targets)))) for _ in range(draw(st.integers(1, 4)))]
    return text("".join(body(b) for b in open_bodies), "".join(tendons), "".join(actuators), draw(st.sampled_from([0.001, 0.005, 0.01])))


@pytest.mark.parametrize("integrator", ["euler", "implicitfast", "implicit", "rk4"])
@given(source=trees(), seed=st.integers(0, 1000))
def test_random_trees_with_random_servos_are_mujocos(integrator, source, seed):
    rng = np.random.default_rng(seed)
    model = mujoco.MjModel.from_xml_string(source)
    moves = 0.3 if seed % 4 else 0.0
    ctrl, qvel, displacement = rng.normal(0, 2, model.nu), rng.normal(0, 3 * moves, model.nv), rng.normal(0, moves, model.nv)
    try:
        step, motion = difference(source, integrator, ctrl, qvel, displacement)
    except stepper.ModelError:
        assume(False)  # joints that cancel one another
    assert step < BOUND and motion < BOUND


def test_mujoco_stops_before_its_own_solution_on_feet_of_nearly_rigid_friction():
    """Feet of solimp 0.015 to 1 with impratio 100 and six rows, as Unilab's Go1 has them."""
    # MuJoCo stops where the objective, some 1e3, no longer decreases by what its rounding lets it see. Stepper's velocity is that of
    # MuJoCo's problem, solved further by Newton's method.
    legs = "".join(LEG.format(x=x, y=y) for x in (-0.2, 0.2) for y in (-0.1, 0.1))
    model = mujoco.MjModel.from_xml_string(FEET.format(legs=legs))
    prepare(model)
    found = states(model, 12, 3)
    sim = stepper.Stepper(stepper.load(model, strict=False), 12, options=stepper.Options(contact="mujoco", tolerance=1e-13, iterations=100))
    sim.set_state(qpos=found.qpos, qvel=found.qvel)
    sim.step()
    touching = 0
    for env in range(12):
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = found.qpos[env], found.qvel[env]
        mujoco.mj_forward(model, data)
        touching += data.ncon > 0
        after = found.qvel[env] + solved_further(model, data)
        scale = 1 + np.abs(found.qvel[env]).max()
        # Rounding of forces of 1e5 N in a mass matrix of condition 1e4.
        assert np.abs(sim.qvel[env] - after).max() < 1e-11 * scale
    assert touching > 6


def solved_further(model, data):
    """Change of the velocity in a step of Euler's rule, with the constraints solved until rounding by Newton's method in NumPy."""
    mass, h = full_mass_matrix(model, data), model.opt.timestep
    free, acceleration = data.qacc_smooth.copy(), data.qacc.copy()

    def imbalance(a):
        residual = np.zeros(data.nefc)
        mujoco.mj_mulJacVec(model, data, residual, a)
        mujoco.mj_constraintUpdate(model, data, residual - data.efc_aref, np.zeros(1), 0)
        return mass @ (a - free) - data.qfrc_constraint

    for _ in range(4):
        # Central differences of what is piecewise linear but for the cone's bend.
        steps = 1e-4 * np.eye(model.nv)
        hessian = np.array([(imbalance(acceleration + d) - imbalance(acceleration - d)) / 2e-4 for d in steps]).T
        acceleration = acceleration - np.linalg.solve(hessian, imbalance(acceleration))
    return h * np.linalg.solve(mass + h * np.diag(model.dof_damping), mass @ acceleration)
