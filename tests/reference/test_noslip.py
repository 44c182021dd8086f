"""MuJoCo's noslip sweeps under its contact law: what should stick stays. test_mujoco_law.py compares single steps with MuJoCo's."""

import mujoco
import numpy as np
import pytest
import stepper
from checks import raises
from hypothesis import assume, given, settings, strategies as st
from models import full_mass_matrix, simulate

BLOCK = """<mujoco><option timestep=".002" cone="{cone}" noslip_iterations="{sweeps}" gravity="4.0 0 -8.96"/>
  <worldbody><geom type="plane" size="3 3 .1" friction="{friction}"/>
  <body pos="0 0 .0499"><freejoint/><geom type="box" size=".1 .1 .05" mass="1" friction="{friction}"/></body></worldbody></mujoco>"""
JOINTS = [
    '<joint axis="{axis}"/>',
    '<joint axis="{axis}" pos="1e-7 0 1e-8"/>',
    '<joint axis="{axis}" range="-.1 -.02" limited="true"/>',
    '<joint axis="{axis}" frictionloss="1e-4"/>',
]


@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
def test_a_block_on_a_slope_creeps_without_the_sweeps_and_stays_with_them(cone):
    """The regularised law creeps by more than a millimetre a second, and the sweeps leave less than a hundredth of that."""
    # The slope is 0.446 and friction 1.5, of which a pyramid may have half along each axis; friction 0.3 slides with the sweeps, too.
    moved = {}
    for sweeps in (0, 20):
        model = stepper.load(BLOCK.format(cone=cone, sweeps=sweeps, friction=1.5))
        sim = stepper.Stepper(model, options=stepper.Options.from_model(model))
        sim.step(nstep=500)
        start = sim.qpos[0]
        sim.step(nstep=500)
        moved[sweeps] = sim.qpos[0] - start
        assert (sim.iterations > sim.newton_steps) == (sweeps > 0)
    assert moved[0] > 1e-3
    assert abs(moved[20]) < 1e-2 * moved[0]
    model = stepper.load(BLOCK.format(cone=cone, sweeps=20, friction=0.3))
    sim = stepper.Stepper(model, options=stepper.Options.from_model(model))
    sim.step(nstep=500)
    assert sim.qpos[0] > 0.1


def test_what_the_model_says():
    model = stepper.load(BLOCK.format(cone="elliptic", sweeps=7, friction=0.8))
    assert model.noslip_iterations == 7
    assert model.noslip_tolerance == 1e-6
    assert not model.omitted
    text = model.explain()
    assert "noslip: the source sets noslip_iterations=7" in text
    assert "7 noslip iterations at most with MuJoCo's contact law; hard contact ignores them" in text
    other = model.replace(noslip_iterations=3, noslip_tolerance=1e-8)
    assert (other.noslip_iterations, other.noslip_tolerance) == (3, 1e-8)
    assert stepper.Model.from_bytes(other.to_bytes()) == other
    assert other != model
    for wrong in (2.5, -1.0, np.nan):
        raises(stepper.ModelError, "noslip_iterations", model.replace, noslip_iterations=wrong)
    raises(stepper.ModelError, "noslip_tolerance", model.replace, noslip_tolerance=-1e-6)


def test_hard_contact_makes_no_sweeps_of_it():
    bits = []
    for sweeps in (0, 20):
        bits.append(simulate(BLOCK.format(cone="elliptic", sweeps=sweeps, friction=0.3), steps=200).qpos.tobytes())
    assert bits[0] == bits[1]


def test_implicit_derivatives_are_refused_by_name_and_differences_are_not():
    model = stepper.load(BLOCK.format(cone="elliptic", sweeps=20, friction=0.8))
    sim = stepper.Stepper(model, options=stepper.Options.from_model(model))
    sim.step(nstep=100)
    raises(ValueError, r"noslip_iterations is 20, must be 0 for method='implicit'.*method='fd'", sim.linearize, method="implicit")
    assert np.isfinite(sim.linearize(method="fd").A).all()


# Rows of MuJoCo's contact law whose approximate inverse inertia is 0 or tiny, so that they are almost rigid. Contacts have such rows on a
# body that turns about its own centre of mass: a wheel, the first link of an arm, the base of a finger.

PIVOT = """<mujoco><worldbody><geom type="box" size=".02 .02 .02"/>
<body pos=".0399 0 0"><joint axis="1 0 0"/><geom type="box" size=".02 .01 .007"/></body></worldbody></mujoco>"""


def law(compiled: mujoco.MjModel, **more) -> stepper.Stepper:
    """Stepper of a compiled model with the model's own settings, and MuJoCo's contact law."""
    model = stepper.load(compiled)
    return stepper.Stepper(model, options=stepper.Options.from_model(model), **more)


@pytest.mark.parametrize("num_envs", [1, 9])
def test_a_contact_of_a_body_that_turns_about_its_centre_of_mass_converges(num_envs):
    """Its forces are 1e14 N and cancel, so that the imbalance of forces is rounding, while the velocity is exact."""
    compiled = mujoco.MjModel.from_xml_string(PIVOT)
    data, sim = mujoco.MjData(compiled), law(compiled, num_envs=num_envs)
    sim.set_state(qvel=np.ones((num_envs, 1)))
    data.qvel[:] = 1
    for _ in range(50):
        mujoco.mj_step(compiled, data)
        sim.step()
        assert not np.any(np.asarray(sim.status) & stepper.Status.NOT_CONVERGED)
        assert np.max(sim.newton_steps) <= 1  # As many as MuJoCo takes.
        # Both solve the same row, which alone determines the velocity. The limit of its weight changes each of 50 steps by 1e-8.
        assert np.asarray(sim.qvel) == pytest.approx(data.qvel[0], rel=5e-8, abs=1e-15)
        # The largest product of weight and inverse inertia is 1e8, and rounding 1e-16 of the velocities, some 1 m/s. Measured: 1e-8.
        assert np.max(sim.residual) < 1e-7


@st.composite
def mechanisms(draw) -> str:
    """A ball on a link that turns about its own centre of mass, pressed into a fixed ball or capsule; perhaps with a link at its end."""
    vector = st.lists(st.floats(-1, 1).map(lambda x: round(x, 3)), min_size=3, max_size=3).filter(lambda v: np.linalg.norm(v) > 0.3)
    axis, way, arm = (draw(vector) for _ in range(3))
    rub = f'condim="{draw(st.sampled_from([1, 3, 4, 6]))}" friction="{draw(st.sampled_from([0.2, 1, 2]))} .01 .001"'
    at = 0.008 * np.array(arm) / np.linalg.norm(arm)
    obstacle = at + 0.027 * np.array(way) / np.linalg.norm(way)
    shape = draw(st.sampled_from(['size=".02"', 'type="capsule" size=".015 .02"']))
    inertial = '<inertial pos="0 0 0" mass=".05" diaginertia="2e-6 3e-6 4e-6"/>'
    joint = draw(st.sampled_from(JOINTS)).format(axis=" ".join(map(str, axis)))
    child = f'<body pos=".03 0 .02"><joint axis="0 1 0"/>{inertial}</body>' if draw(st.booleans()) else ""
    cone, step = draw(st.sampled_from(["pyramidal", "elliptic"])), draw(st.sampled_from([0.001, 0.005]))
    return f"""<mujoco><option cone="{cone}" timestep="{step}" tolerance="1e-14" iterations="200"/><worldbody>
      <geom {shape} pos="{" ".join(f"{x:.5f}" for x in obstacle)}" {rub}/>
      <body>{joint}{inertial}<geom size=".01" pos="{" ".join(f"{x:.5f}" for x in at)}" {rub}/>{child}</body></worldbody></mujoco>"""


@settings(max_examples=60, deadline=None)
@given(mechanisms(), st.integers(0, 2**32 - 1))
def test_rigid_rows_converge_to_mujocos_acceleration(text, seed):
    """One contact determines its forces, so that the acceleration is MuJoCo's up to the limit of a row's weight."""
    compiled = mujoco.MjModel.from_xml_string(text)
    data, sim = mujoco.MjData(compiled), law(compiled)
    velocity = np.random.default_rng(seed).normal(size=compiled.nv)
    data.qvel[:] = velocity
    sim.set_state(qvel=velocity)
    mujoco.mj_forward(compiled, data)
    # A lever of rounding size times a force of 1e15 N is no number to compare.
    jacobian = dense_jacobian(compiled, data)
    levers = np.abs(jacobian)
    assume(not np.any((levers > 0) & (levers < 1e-9)))
    sim.step()
    assert data.ncon == len(sim.contacts())
    assert not sim.status & stepper.Status.NON_FINITE
    # Rounding of large forces: up to 7e-6 m/s in 5,854 draws, and above the tolerance, 1e-6 m/s, in two of them.
    assert sim.residual < 1e-5
    if compiled.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC:
        return  # MuJoCo's own solver stops up to 1e-3 of the acceleration before the solution.
    acceleration = (np.asarray(sim.qvel) - velocity) / compiled.opt.timestep
    # The limit of the weights adds a regularisation of 1e-8 of the contact's largest inverse inertia. It changes the force of another edge
    # of the pyramid by as much more as this edge has less inverse inertia.
    inverse_mass = np.linalg.inv(full_mass_matrix(compiled, data))
    inverse_inertia = np.einsum("ri,ij,rj->r", jacobian, inverse_mass, jacobian)
    is_edge = data.efc_type == mujoco.mjtConstraint.mjCNSTR_CONTACT_PYRAMIDAL
    active = inverse_inertia[is_edge & (data.efc_force > 0) & (inverse_inertia > 0)]
    ratio = inverse_inertia[is_edge].max() / active.min() if active.size else 1.0
    assume(ratio < 1e5)  # 93 % of the draws.
    by_forces = (np.abs(inverse_mass) @ levers.T @ np.abs(data.efc_force)).max()
    # MuJoCo's own error is up to 1e-7 in two degrees of freedom, where its matrix loses the inertia by rounding.
    rounding = 1e-7 * (by_forces + np.abs(data.qacc_smooth).max() + 1)
    assert np.abs(acceleration - data.qacc).max() < 1e-8 * ratio * by_forces + rounding


def dense_jacobian(compiled: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Jacobian of all constraint rows, (nefc, nv)."""
    if not mujoco.mj_isSparse(compiled):
        return data.efc_J.reshape(data.nefc, compiled.nv)
    dense = np.zeros((data.nefc, compiled.nv))
    mujoco.mju_sparse2dense(dense, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind)
    return dense
