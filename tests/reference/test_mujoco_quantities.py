"""Quantities of all environments at once against MuJoCo's of each, on robots that others wrote, over random states.

Both compute the same formulas in another order: what differs is rounding, 1e-16 times the joints on the way to a body, the metres or m/s of
what is read, and for velocities those of the joints (tens of rad/s). The bound of 1e-10 is that of the other comparisons with MuJoCo, and a
thousand times what is found.
"""

import functools
from importlib.util import find_spec
from pathlib import Path

import mujoco
import numpy as np
import pytest
import stepper
from geometry import matrix
from models import SOURCES, afloat, forward, full_mass_matrix, random_quaternion, random_state, simulate, stepper_model
from stepper._quantities import KINDS

BOUND = 1e-10
ENVS = 19
"""More than one group of lanes at every CPU level, and not a whole number of them."""
ROBOTS = [
    "gymnasium/humanoid", "gymnasium/ant", "gymnasium/pusher_v5", "gymnasium/walker2d", "gymnasium/swimmer",
    "dm_control/humanoid_CMU", "dm_control/dog", "dm_control/quadruped", "dm_control/manipulator", "dm_control/stacker",
    "dm_control/fish", "dm_control/lqr",
]  # fmt: skip
OTHERS = {
    "robosuite/panda": "models/assets/robots/panda/robot.xml",
    "gymnasium_robotics/fetch": "envs/assets/fetch/slide.xml",
    "gymnasium_robotics/hand": "envs/assets/hand/reach.xml",
}
"""Robots of packages that are not always there: welded grippers, bodies that the user poses."""
MOCAP = """
<mujoco><worldbody>
  <body name="hand" mocap="true" pos="0 0 1"><inertial pos="0 .1 0" mass="2" diaginertia=".1 .2 .25" euler="10 20 30"/>
    <body name="finger" pos="0 0 .2"><joint name="finger" axis="0 1 0"/><geom size=".05" pos=".1 0 0"/></body>
  </body>
  <body pos="1 0 0"><geom size=".1" pos=".2 0 0"/></body></worldbody></mujoco>"""
INERTIAS = {"f64": 1e-12, "f32": 1e-4}
"""Bounds of inertias and of velocities about centres of mass: sums of a few numbers of at most the size of the largest."""


@functools.cache
def robot(name: str) -> mujoco.MjModel:
    """A robot that touches nothing. Frames that agree to 1e-6 are one to MuJoCo, which spares it their product: here they are two."""
    if name in SOURCES:
        model = afloat(name)
    elif name == "mocap":
        model = mujoco.MjModel.from_xml_string(MOCAP)
    else:
        package = find_spec(name.partition("/")[0])
        if package is None:
            pytest.skip(f"{name.partition('/')[0]} is not installed")
        model = mujoco.MjModel.from_xml_path(str(Path(package.submodule_search_locations[0]) / OTHERS[name]))
        model.geom_contype[:] = model.geom_conaffinity[:] = model.jnt_limited[:] = 0
    model.body_sameframe[:] = model.geom_sameframe[:] = model.site_sameframe[:] = 0
    return model


class Pair:
    """A batch at random states, and MuJoCo's data at each of them."""

    def __init__(self, name: str, precision: str = "f64", threads: int = 2, envs: int = ENVS) -> None:
        self.mujoco, rng = robot(name), np.random.default_rng(list(name.encode()))
        self.model = stepper.load(self.mujoco, strict=False)
        self.sim = stepper.Stepper(self.model, envs, precision=precision, threads=threads)
        states = [random_state(self.mujoco, rng) for _ in range(envs)]
        self.sim.set_state(qpos=[q for q, _ in states], qvel=[v for _, v in states])
        if self.mujoco.nmocap:
            self.sim.mocap_pos[:] = rng.normal(size=self.sim.mocap_pos.shape)
            self.sim.mocap_quat[:] = [[random_quaternion(rng) for _ in range(self.mujoco.nmocap)] for _ in range(envs)]

    def data(self):
        """MuJoCo's data at the state, the controls and the poses of each environment."""
        for env in range(self.sim.num_envs):
            data = mujoco.MjData(self.mujoco)
            data.mocap_pos[:], data.mocap_quat[:] = self.sim.mocap_pos[env], self.sim.mocap_quat[env]
            data.qpos[:], data.qvel[:], data.act[:] = self.sim.qpos[env], self.sim.qvel[env], self.sim.act[env]
            data.ctrl[:] = self.sim.ctrl[env]
            mujoco.mj_forward(self.mujoco, data)
            yield env, data


def matrices(quaternions: np.ndarray) -> np.ndarray:
    """Rotations row by row: a quaternion and its negative are one, and that of a matrix has but half the digits near half a turn."""
    return np.reshape([matrix(quat) for quat in quaternions], (-1, 9))


def close(found: np.ndarray, expected: np.ndarray, bound: float = BOUND) -> None:
    """Relative to the largest number, at least 1 (m, m/s)."""
    scale = max(1.0, np.abs(expected).max(initial=0.0))
    np.testing.assert_allclose(found, expected, atol=bound * scale, rtol=0)


def velocities(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """(angular, linear) of the bodies' frames in world axes."""
    out = np.zeros((model.nbody, 6))
    for body in range(model.nbody):
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, body, out[body], 0)
    return out


def check_poses(pair: Pair, bound: float) -> None:
    sim = pair.sim
    for env, data in pair.data():
        close(sim.xpos[env], data.xpos, bound)
        close(matrices(sim.xquat[env]), data.xmat, bound)
        close(sim.site_xpos[env], data.site_xpos, bound)
        close(matrices(sim.site_xquat[env]), data.site_xmat, bound)
        close(sim.geom_xpos[env], data.geom_xpos, bound)
        close(matrices(sim.geom_xquat[env]), data.geom_xmat, bound)
        close(sim.subtree_com[env], data.subtree_com, bound)
        expected = velocities(pair.mujoco, data)
        close(sim.body_angvel[env], expected[:, :3], bound)
        close(sim.body_linvel[env], expected[:, 3:], bound)
        check_inertias(sim, env, data)


def check_inertias(sim: stepper.Stepper, env: int, data: mujoco.MjData) -> None:
    for quantity in ("cinert", "cvel", "xipos"):
        close(getattr(sim, quantity)[env], getattr(data, quantity), INERTIAS[sim.precision])


@pytest.mark.parametrize("name", [*ROBOTS, *OTHERS, "mocap"])
def test_poses_and_velocities(name):
    pair = Pair(name)
    assert (pair.model.nbody, pair.model.ngeom, pair.model.nsite) == (pair.mujoco.nbody, pair.mujoco.ngeom, pair.mujoco.nsite)
    check_poses(pair, BOUND)
    pair.sim.step(nstep=3)
    if not pair.sim.status.any():
        check_poses(pair, BOUND)


@pytest.mark.parametrize("name", ["gymnasium/humanoid", "dm_control/dog", "gymnasium_robotics/fetch"])
def test_poses_in_32_bits(name):
    # Rounding is 6e-8 of metres, and some hundred times that along the chains of a dog's tail.
    check_poses(Pair(name, "f32", envs=33), 2e-5)


@pytest.mark.parametrize("name", [*ROBOTS, *OTHERS])
def test_jacobians(name):
    pair = Pair(name, envs=3)
    rng = np.random.default_rng(1)
    bodies = rng.permutation(pair.model.nbody)[:6]
    sites = rng.permutation(pair.model.nsite)[:4]
    of_bodies = [pair.sim.jacobian(body=int(body)) for body in bodies]
    of_sites = [pair.sim.jacobian(site=int(site)) for site in sites]
    for env, data in pair.data():
        for body, found in zip(bodies, of_bodies, strict=True):
            expected = np.zeros((6, pair.model.nv))
            mujoco.mj_jacBody(pair.mujoco, data, expected[:3], expected[3:], body)
            close(found[env], expected)
            moves = np.r_[pair.sim.body_linvel[env, body], pair.sim.body_angvel[env, body]]
            np.testing.assert_allclose(found[env] @ pair.sim.qvel[env], moves, atol=1e-9)
        for site, found in zip(sites, of_sites, strict=True):
            expected = np.zeros((6, pair.model.nv))
            mujoco.mj_jacSite(pair.mujoco, data, expected[:3], expected[3:], site)
            close(found[env], expected)


@pytest.mark.parametrize("name", [name for name in [*ROBOTS, *OTHERS] if name not in {"dm_control/lqr", "gymnasium_robotics/fetch"}])
def test_forces_of_actuators_are_those_of_the_present_state(name):
    pair = Pair(name)
    pair.sim.step(np.random.default_rng(2).uniform(-1.2, 1.2, (ENVS, pair.model.nu)))
    checked = 0
    for env, data in pair.data():
        # A random state of a stiff robot may fly apart; what is not finite is refused and says so.
        if pair.sim.status[env] & stepper.Status.NON_FINITE:
            continue
        close(pair.sim.actuator_force[env], data.actuator_force)
        close(pair.sim.qfrc_actuator[env], data.qfrc_actuator)
        checked += 1
    assert checked > ENVS // 2
    assert pair.model.nu == pair.sim.actuator_force.shape[1]


@pytest.mark.parametrize("name", ["gymnasium/humanoid", "gymnasium/ant", "dm_control/dog"])
def test_accelerations_are_mujocos_where_nothing_is_implicit(name):
    source = robot(name)
    model = mujoco.MjModel.from_xml_path(str(SOURCES[name]))
    for field in ("geom_contype", "geom_conaffinity", "jnt_limited"):
        getattr(model, field)[:] = getattr(source, field)
    model.dof_damping[:] = model.dof_frictionloss[:] = model.tendon_damping[:] = model.tendon_frictionloss[:] = 0
    model.tendon_limited[:] = 0
    model.eq_active0[:] = 0
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
    rng = np.random.default_rng(3)
    sim = stepper.Stepper(stepper.load(model, strict=False), 5, options=stepper.Options(integrator="euler"))
    states = [random_state(model, rng) for _ in range(5)]
    sim.set_state([q for q, _ in states], [v for _, v in states])
    for env, (q, v) in enumerate(states):
        expected = forward(model, q, v, act=np.zeros(model.na)).qacc
        # (v+ - v) / h loses what v is rounded by: 1e-16 times velocities of 10 rad/s over 2 ms.
        np.testing.assert_allclose(sim.qacc[env], expected, atol=1e-8 * np.abs(expected).max())


def test_parameters_of_environments_move_geoms_and_centres_of_mass():
    name = "gymnasium/humanoid"
    pair, rng = Pair(name, envs=9), np.random.default_rng(4)
    numbers = {
        "geom_pos": pair.model.geom_pos + rng.normal(scale=0.1, size=(9, pair.model.ngeom, 3)),
        "body_mass": pair.model.body_mass * rng.uniform(0.5, 2, (9, pair.model.nbody)),
        "body_inertia": pair.model.body_inertia * rng.uniform(0.9, 1.1, (9, pair.model.nbody, 1)),
        "body_ipos": pair.model.body_ipos + rng.normal(scale=0.02, size=(9, pair.model.nbody, 3)) * (pair.model.body_mass > 0)[:, None],
    }
    before = pair.sim.geom_xpos, pair.sim.subtree_com
    pair.sim.randomize(**numbers)
    assert not np.array_equal(before[0], pair.sim.geom_xpos)
    assert not np.array_equal(before[1], pair.sim.subtree_com)
    own = afloat(name)
    for env in range(9):
        for field, values in numbers.items():
            getattr(own, field)[:] = values[env]
        mujoco.mj_setConst(own, mujoco.MjData(own))
        data = forward(own, pair.sim.qpos[env], pair.sim.qvel[env])
        close(pair.sim.geom_xpos[env], data.geom_xpos)
        close(pair.sim.subtree_com[env], data.subtree_com)
        check_inertias(pair.sim, env, data)


@pytest.mark.parametrize("name", ["gymnasium/humanoid", "dm_control/stacker", "dm_control/lqr"])
def test_integrating_and_differentiating_configurations(name):
    source, rng = robot(name), np.random.default_rng(5)
    model = stepper.load(source, strict=False)
    q = np.array([random_state(source, rng)[0] for _ in range(6)])
    dv = rng.normal(scale=0.8, size=(6, model.nv))
    there = model.integrate_pos(q, dv)
    for k in range(6):
        expected = q[k].copy()
        mujoco.mj_integratePos(source, expected, dv[k], 1.0)
        np.testing.assert_allclose(there[k], expected, atol=BOUND)
        back = np.zeros(model.nv)
        mujoco.mj_differentiatePos(source, back, 1.0, q[k], there[k])
        np.testing.assert_allclose(model.differentiate_pos(q[k], there[k]), back, atol=BOUND)
    np.testing.assert_allclose(model.differentiate_pos(q, there), dv, atol=1e-8)
    np.testing.assert_array_equal(model.integrate_pos(q[0], dv)[3], model.integrate_pos(q[0], dv[3]))
    np.testing.assert_array_equal(model.integrate_pos(q.reshape(2, 3, -1), dv[1]).reshape(6, -1)[4], model.integrate_pos(q[4], dv[1]))


# Quantities of all environments by name, mass matrices and inverse dynamics: MuJoCo's, in arrays of the caller's.

CROWD = 5
OTHER_ROBOTS = [
    "gymnasium/ant",
    "gymnasium/humanoid",
    "gymnasium/pusher_v5",
    "dm_control/quadruped",
    "dm_control/fish",
    "dm_control/cheetah",
]


def crowd(name, num_envs=CROWD, **settings):
    """Environments in random states, and the states."""
    source = mujoco.MjModel.from_xml_path(str(SOURCES[name]))
    sim = stepper.Stepper(stepper_model(name), num_envs, **settings)
    rng = np.random.default_rng(3)
    q, v = (np.array(part) for part in zip(*(random_state(source, rng, 1.0) for _ in range(num_envs)), strict=True))
    sim.set_state(q, v)
    return source, sim, q, v, rng


@pytest.mark.parametrize("name", OTHER_ROBOTS)
def test_mass_matrices_and_inverse_dynamics_are_mujocos(name):
    source, sim, q, v, rng = crowd(name)
    source.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    sim.qfrc_applied[:], sim.xfrc_applied[:] = rng.normal(size=(CROWD, source.nv)), rng.normal(size=(CROWD, source.nbody, 6))
    qacc = rng.normal(size=(CROWD, source.nv))
    mass, bias, forces = sim.mass_matrix(), sim.qfrc_bias, sim.inverse_dynamics(qacc)
    half = simulate(sim.model, CROWD, precision="f32", qpos=q, qvel=v)
    data = mujoco.MjData(source)
    for k in range(CROWD):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[k], v[k], qacc[k]
        mujoco.mj_inverse(source, data)
        expected = full_mass_matrix(source, data)
        size = np.abs(data.qfrc_inverse).max() + np.abs(expected).max()
        np.testing.assert_allclose(mass[k], expected, atol=1e-11 * size)
        # Sums of some tens of terms of single precision.
        np.testing.assert_allclose(half.mass_matrix()[k], expected, rtol=0, atol=1e-5 * np.abs(mass).max())
        np.testing.assert_allclose(bias[k], data.qfrc_bias, atol=1e-10 * size)
        np.testing.assert_allclose(forces[k], data.qfrc_inverse, atol=1e-9 * size)


def test_forces_of_inverse_dynamics_make_the_acceleration():
    """What it says is applied, and the step without contacts accelerates so, whatever drives do between controls and joints."""
    free = stepper.load("""<mujoco><option gravity="0 0 -3"/><worldbody><body><joint name="a" axis="0 1 0" stiffness="2" damping=".3"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".03"/><body pos="0 0 -.4"><joint name="b" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02"/></body></body></worldbody>
      <actuator><position joint="a" kp="5"/><motor joint="b"/></actuator></mujoco>""")
    drives = stepper.ActuatorModel(default=stepper.Drive(delay=0.01, lag=0.02))
    for settings in ({}, {"actuators": drives}):
        sim = stepper.Stepper(free, 3, **settings)
        sim.reset(qpos=[[0.1, 0.2], [-1, 0.4], [2, -0.3]], qvel=[[0, 1], [2, -1], [0.5, 0.5]])
        sim.step(np.full((3, 2), 0.3), nstep=7)
        wanted = np.random.default_rng(0).normal(size=(3, 2))
        sim.qfrc_applied[:] = sim.inverse_dynamics(wanted) - np.asarray(sim.qfrc_actuator)
        np.testing.assert_allclose(sim.qacc_smooth, wanted, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_what_is_read_by_name_is_the_attributes(precision):
    _, sim, *_ = crowd("gymnasium/humanoid", precision=precision)
    sim.step(nstep=3)
    model, dtype = sim.model, {"f64": np.float64, "f32": np.float32}[precision]
    for name in KINDS:
        found = sim.read(name)
        np.testing.assert_array_equal(found, np.asarray(getattr(sim, name)), name)
        found[...] = 0  # It is the caller's.
        if name not in ("xfrc_applied", "qfrc_applied", "actuator_saturation", "eq_active"):
            assert found.dtype == dtype, name
    np.testing.assert_array_equal(sim.read("xpos", "torso"), sim.xpos[:, model.body("torso").id])
    np.testing.assert_array_equal(sim.read("cvel", ["torso", -1]), sim.cvel[:, [1, -1]])
    root, knee = model.joint("root"), model.joint("left_knee")
    columns = [*range(root.qposadr, root.qposadr + 7), knee.qposadr]
    np.testing.assert_array_equal(sim.read("qpos", ["root", "left_knee"]), sim.qpos[:, columns])
    np.testing.assert_array_equal(sim.read("qacc", "left_knee"), sim.qacc[:, [knee.dofadr]])
    np.testing.assert_array_equal(sim.read("actuator_force", "left_knee"), sim.actuator_force[:, [model.actuator("left_knee").id]])


def test_a_stepper_without_an_axis_has_none():
    sim = stepper.Stepper(stepper_model("gymnasium/ant"))
    assert sim.read("xpos", "torso").shape == (3,)
    assert sim.mass_matrix().shape == (14, 14)
    assert sim.inverse_dynamics(np.zeros(14)).shape == (14,)
    sim.xfrc_applied[1, 2] = 5.0
    np.testing.assert_allclose(sim.inverse_dynamics(sim.qacc_smooth)[:3], [0, 0, 5.0], atol=1e-12)


@pytest.mark.parametrize(("call", "error", "said"), [
    (lambda sim: sim.read("xpo"), ValueError, "there is no quantity 'xpo'; did you mean xpos"),
    (lambda sim: sim.read("xpos", "tors"), KeyError, "torso"),
    (lambda sim: sim.read("xpos", 99), IndexError, "99"),
    (lambda sim: sim.inverse_dynamics(np.zeros((4, 14))), ValueError, r"qacc has shape \(4, 14\), must be \(5, 14\)"),
    (stepper.Stepper.jacobian, ValueError, "body"),
])  # fmt: skip
def test_what_is_wrong_is_said(call, error, said):
    with pytest.raises(error, match=said):
        call(stepper.Stepper(stepper_model("gymnasium/ant"), CROWD))
