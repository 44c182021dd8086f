"""Spatial tendons and muscles: lengths, moment arms and steps are MuJoCo's."""

import mujoco
import numpy as np
import pytest
import stepper
from checks import every
from models import forward, full_mass_matrix, random_state, simulate
from mujoco_law.parity import compare, prepare, states
from numerics import acceleration_of_short_steps, relative_error

# Lengths and moment arms are smooth functions of the state, and both engines use the same formulas: rounding is 1e-16 times the size of the
# scene (1 m), and grows by the condition of tangents, at most 1e4 in random states.
BOUND = 1e-10
STATES = 200
SCENE = """<mujoco><compiler angle="radian"/><option timestep=".002" {option}><flag contact="disable"/></option><worldbody>
  <site name="base" pos=".3 -.2 .9"/><geom name="post" type="cylinder" size=".15 .1" pos=".4 .1 1.2" euler=".3 .5 0"/>
  <body name="hull" pos="0 0 1"><freejoint/><geom type="box" size=".1 .2 .3"/><site name="hull" pos=".1 .05 -.2"/>
    <geom name="drum" type="cylinder" size=".12 .1" pos=".2 .1 .1" euler=".4 .1 .2"/><site name="drum" pos=".2 .3 .1"/>
    <site name="inside drum" pos=".23 .12 .1"/>
    <body pos=".2 0 .1"><joint name="swing" axis="1 2 0" pos=".05 0 0"/><geom type="capsule" size=".05 .2" euler=".1 .2 0"/>
      <geom name="ball" size=".08" pos=".1 .1 0"/><site name="ball" pos=".1 .1 .2"/><site name="inside ball" pos=".12 .11 .02"/>
      <body pos="0 .4 .1"><joint name="rail" type="slide" axis="1 0 1" damping=".4"/><geom size=".1"/>
        <site name="tip" pos=".1 .2 .3"/></body></body>
    <body pos="-.2 0 .1"><joint name="socket" type="ball" damping=".2"/><geom type="capsule" size=".05 .2" pos="0 0 .2"/>
      <body pos="0 0 .4"><joint name="wrist" axis="0 1 0"/><geom size=".08" pos=".1 0 0"/><site name="hand" pos="0 .1 .2"/></body>
    </body></body>
  <body name="load" pos=".6 .3 1.1"><freejoint/><geom size=".07"/><site name="load" pos=".05 0 0"/></body></worldbody>
  <tendon>{tendons}</tendon><actuator>{actuators}</actuator><sensor>{sensors}</sensor></mujoco>"""
PATHS = {
    "sites": '<site site="base"/><site site="tip"/><site site="load"/>',
    "sites of one body": '<site site="hull"/><site site="drum"/><site site="tip"/>',
    "sphere": '<site site="hull"/><geom geom="ball"/><site site="tip"/>',
    "sphere with a side": '<site site="hull"/><geom geom="ball" sidesite="ball"/><site site="tip"/>',
    "inside a sphere": '<site site="hull"/><geom geom="ball" sidesite="inside ball"/><site site="tip"/>',
    "cylinder": '<site site="base"/><geom geom="drum"/><site site="hand"/>',
    "cylinder with a side": '<site site="base"/><geom geom="drum" sidesite="drum"/><site site="hand"/>',
    "inside a cylinder": '<site site="base"/><geom geom="drum" sidesite="inside drum"/><site site="hand"/>',
    "cylinder on the world": '<site site="load"/><geom geom="post"/><site site="hand"/>',
    "side on another body": '<site site="load"/><geom geom="post" sidesite="tip"/><site site="hull"/>',
    "pulley": '<site site="base"/><site site="tip"/><pulley divisor="2"/><site site="tip"/><geom geom="ball"/><site site="hull"/>'
    '<pulley divisor="3"/><site site="hull"/><site site="load"/>',
    "two obstacles": '<site site="base"/><geom geom="post"/><site site="load"/><geom geom="drum"/><site site="hand"/><site site="tip"/>',
}
EXACT = np.array(["inside" not in name for name in PATHS])
INEXACT = 1e-4
"""MuJoCo's path through an obstacle is the shortest to about 1e-6 rad, so that its moment arms, unlike its lengths, are that inexact."""
SENSORS = "".join(f'<tendonpos tendon="{name}"/><tendonvel tendon="{name}"/>' for name in PATHS)
MUSCLE = '<muscle tendon="t" lengthrange=".3 1.5" force="40" timeconst=".02 .06" {}/>'
ROWS = {
    "spring": 'stiffness="40" springlength=".2"',
    "slack spring": 'stiffness="40" springlength=".1 .8"',
    "damper": 'damping="3"',
    "limits": 'limited="true" range=".3 .7"',
    "dry friction": 'frictionloss="2"',
    "all of them": 'stiffness="40" springlength=".1 .3" damping="3" limited="true" range=".2 .6" frictionloss="1"',
}
ACTUATORS = {
    "motor": '<motor tendon="t" gear="2"/>',
    "servo": '<position tendon="t" kp="30" kv="2"/>',
    "muscle": MUSCLE.format(""),
    "muscle with a smooth activation": MUSCLE.format('tausmooth=".3"'),
    "bounded muscle": MUSCLE.format('forcerange="-5 0"'),
}
INTEGRATORS = ["Euler", "implicitfast", "implicit", "RK4"]
# MuJoCo allows an inertia of tendons that wrap around nothing.
STRAIGHT = {
    "one branch": '<site site="base"/><site site="tip"/>',
    "pulley": '<site site="base"/><site site="tip"/><pulley divisor="2"/><site site="tip"/><site site="hull"/><site site="base"/>',
    "branches": '<site site="hand"/><site site="tip"/><site site="load"/>',
}


INERTIA = dict.fromkeys(STRAIGHT, 40.0) | {"branches": 1.0}
"""Inertia of the tendon, kg. Without entries between branches, MuJoCo's mass matrix is singular with 40 kg."""


def scene(tendons: str, actuators: str = "", sensors: str = "", option: str = "") -> str:
    """The scene with some parts filled in."""
    return SCENE.format(tendons=tendons, actuators=actuators, sensors=sensors, option=option)


def all_paths() -> str:
    """The scene with a tendon on each path, and sensors of all."""
    return scene("".join(f'<spatial name="{name}">{path}</spatial>' for name, path in PATHS.items()), sensors=SENSORS)


@pytest.mark.parametrize("num_envs", [1, 7])
def test_lengths_and_rates_are_mujocos(num_envs):
    """In every lane, at random poses. A rate is the sum of the moment arms times the velocity, so that random velocities test them."""
    source = all_paths()
    model, sim, rng = mujoco.MjModel.from_xml_string(source), simulate(source, num_envs), np.random.default_rng(0)
    touched = np.zeros(model.ntendon, bool)
    for _ in range(STATES // num_envs):
        drawn = [random_state(model, rng) for _ in range(num_envs)]
        sim.set_state(*(np.array(x) for x in zip(*drawn, strict=True)))
        found = np.reshape(sim.sensordata_ideal, (num_envs, model.ntendon, 2))
        for env, state in enumerate(drawn):
            data = forward(model, *state)
            assert np.abs(found[env, :, 0] - data.ten_length).max() < BOUND
            assert relative_error(found[env, EXACT, 1], data.ten_velocity[EXACT]) < BOUND
            assert relative_error(found[env, ~EXACT, 1], data.ten_velocity[~EXACT]) < INEXACT
            for t in range(model.ntendon):
                some = slice(data.ten_wrapadr[t], data.ten_wrapadr[t] + data.ten_wrapnum[t])
                touched[t] |= bool((data.wrap_obj.ravel()[some] >= 0).any())
    # Every path with an obstacle touches it in some state.
    assert all(touched[t] for t, path in enumerate(PATHS.values()) if "<geom" in path)


def test_bits_do_not_depend_on_neighbours():
    """A string that touches no obstacle has the same arms alone as next to one that does."""
    source, rng = all_paths(), np.random.default_rng(2)
    model, batch = mujoco.MjModel.from_xml_string(source), simulate(source, 8)
    alone = simulate(source, 1)
    for _ in range(5):
        drawn = [random_state(model, rng) for _ in range(8)]
        batch.set_state(*(np.array(x) for x in zip(*drawn, strict=True)))
        found = np.array(batch.sensordata_ideal)
        for env, state in enumerate(drawn):
            alone.set_state(*(np.array([x]) for x in state))
            assert np.array_equal(np.ravel(alone.sensordata_ideal), found[env])


def test_moment_arms_are_the_derivatives_of_lengths():
    """Central differences with a step of 1e-6 have errors of 1e-10 by rounding and truncation; tangents multiply both by up to 100."""
    source = all_paths()
    model, sim, rng = mujoco.MjModel.from_xml_string(source), simulate(source), np.random.default_rng(1)
    for _ in range(10):
        q, v = random_state(model, rng)
        sim.set_state(q, v)
        rates = np.array(sim.sensordata_ideal)[1::2]
        ends = []
        for sign in (1e-6, -1e-6):
            moved = q.copy()
            mujoco.mj_integratePos(model, moved, v, sign)
            sim.set_state(moved, v)
            ends.append(np.array(sim.sensordata_ideal)[::2])
        assert relative_error(rates, (ends[0] - ends[1]) / 2e-6) < 1e-8


def agrees(source: str, count: int = 6) -> None:
    """Check that steps from random states are MuJoCo's by its law."""
    model = mujoco.MjModel.from_xml_string(source)
    prepare(model)
    assert compare(stepper.load(model), states(model, count, 0)).agrees == 1.0, source


@every(path=["sites", "sphere with a side", "cylinder", "pulley"], rows=ROWS)
def test_a_step_of_mujocos_law_is_mujocos(path, rows):
    """Springs, dampers, limits and dry friction: relative to 1 + max |qvel|, within 1e-9 or the difference of MuJoCo's own solvers."""
    for integrator in INTEGRATORS:
        agrees(scene(f'<spatial name="t" {ROWS[rows]}>{PATHS[path]}</spatial>', option=f'integrator="{integrator}"'))


def heavy(path: str, more: str = "", option: str = "") -> str:
    """The scene with a tendon whose inertia is of the order of the bodies' masses."""
    return scene(f'<spatial name="t" armature="{INERTIA[path]}" {more}>{STRAIGHT[path]}</spatial>', option=option)


@every(more=["", 'stiffness="40" springlength=".1 .3" damping="3" limited="true" range=".2 .9" frictionloss="1"'], path=STRAIGHT)
def test_a_step_with_inertia_of_mujocos_law_is_mujocos(path, more):
    """As above. MuJoCo's mass matrix has no entries between branches, and so has the law's."""
    for integrator in INTEGRATORS:
        agrees(heavy(path, more, f'integrator="{integrator}"'))


@pytest.mark.parametrize("path", STRAIGHT)
def test_inertia_of_a_tendon_is_m_jtj(path):
    """Mass matrix, bias force, acceleration and energy. Between branches, where MuJoCo has no entries, they follow from its Jacobian."""
    source = heavy(path)
    model, sim, rng = mujoco.MjModel.from_xml_string(source), simulate(source), np.random.default_rng(0)
    light = mujoco.MjModel.from_xml_string(source)
    light.tendon_armature[:] = 0
    for _ in range(20):
        state = random_state(model, rng)
        sim.set_state(*state)
        data = forward(model, *state)
        jacobian = np.zeros((1, model.nv))
        mujoco.mju_sparse2dense(jacobian, *(np.ravel(x) for x in (data.ten_J, model.ten_J_rownnz, model.ten_J_rowadr, model.ten_J_colind)))
        mass = full_mass_matrix(light, forward(light, *state)) + INERTIA[path] * jacobian.T @ jacobian
        assert relative_error(sim.mass_matrix(), mass) < BOUND
        assert relative_error(sim.qfrc_bias, data.qfrc_bias) < BOUND
        assert relative_error(sim.qacc_smooth, np.linalg.solve(mass, data.qfrc_smooth)) < BOUND
        if path != "branches":
            assert relative_error(sim.qacc_smooth, data.qacc_smooth) < BOUND
        kinetic = 0.5 * state[1] @ mass @ state[1]
        assert sim.energy()[1] == pytest.approx(kinetic, rel=BOUND)


@every(integrator=["euler", "midpoint"], path=STRAIGHT)
def test_a_step_with_inertia_tends_to_the_smooth_acceleration(path, integrator):
    """The inertia of a tendon is a row of the step: extrapolated to h = 0, the acceleration is that of the mass matrix with m J^T J."""
    source = heavy(path)
    model, sim, rng = mujoco.MjModel.from_xml_string(source), simulate(source), np.random.default_rng(0)
    for _ in range(5):
        state = random_state(model, rng)
        sim.set_state(*state)
        assert relative_error(acceleration_of_short_steps(source, state, integrator), sim.qacc_smooth) < 1e-7


def test_inertia_of_a_tendon_around_a_geom_is_refused():
    """MuJoCo's compiler refuses it, and so does a model that is changed later."""
    model = stepper.load(scene(f'<spatial name="t">{PATHS["sphere"]}</spatial>'))
    with pytest.raises(stepper.ModelError, match='tendon "t": armature is 1, and its path wraps around a geom; leave out the geom'):
        model.replace(tendon_armature=[1.0])


@every(kind=ACTUATORS, integrator=INTEGRATORS)
def test_a_step_with_an_actuator_is_mujocos(kind, integrator):
    """As above, with the velocity derivative of muscles in the implicit rules."""
    path = f'<spatial name="t">{PATHS["sphere with a side"]}</spatial>'
    agrees(scene(path, ACTUATORS[kind], option=f'integrator="{integrator}"'), count=12)


@pytest.mark.parametrize("armature", [0.0, 0.5])
def test_energy_of_a_rubber_band_is_conserved(armature):
    """The midpoint rule conserves the energy of a mass on a spatial spring to order h^2: halving the step divides the error by four."""
    source = """<mujoco><option gravity="0 0 0"/><worldbody><site name="a" pos="0 0 1"/>
      <body pos=".4 0 1"><freejoint/><geom size=".05"/><site name="b"/></body></worldbody>
      <tendon><spatial stiffness="60" springlength=".1" armature="{}"><site site="a"/><site site="b"/></spatial></tendon></mujoco>"""
    source, errors = source.format(armature), []
    for h in (4e-3, 2e-3, 1e-3):
        sim = simulate(source, timestep=h, integrator="midpoint", qvel=[0, 2.0, 1.0, 0, 0, 0])
        start, worst = sum(sim.energy()), 0.0
        for _ in range(round(1.0 / h)):
            sim.step()
            worst = max(worst, abs(sum(sim.energy()) - start))
        errors.append(worst / start)
    assert errors[0] > 3.5 * errors[1] > 12 * errors[2]
    assert errors[2] < 1e-3


def test_a_rope_holds_a_ball():
    """A ball swings on a rope of a limited length. The rope is never longer than its range by more than the slop, and becomes slack."""
    source = """<mujoco><worldbody><site name="a" pos="0 0 1"/>
      <body pos=".2 0 1"><freejoint/><geom size=".05"/><site name="b"/></body></worldbody>
      <tendon><spatial name="t" limited="true" range="0 .5"><site site="a"/><site site="b"/></spatial></tendon>
      <sensor><tendonpos tendon="t"/></sensor></mujoco>"""
    sim = simulate(source, timestep=2e-3)
    lengths = []
    for _ in range(1000):
        sim.step()
        lengths.append(float(sim.sensordata_ideal[0]))
        assert sim.status == stepper.Status.OK
    assert max(lengths) < 0.5 + 1e-4
    assert min(lengths[:100]) < 0.4
    assert float(sim.max_limit_violation) < 1e-4


def test_a_rope_ties_two_bodies():
    """An equality holds the length of a spatial tendon at that of the reference configuration, 0.4 m here."""
    source = """<mujoco><worldbody><site name="a" pos="0 0 1"/>
      <body pos=".4 0 1"><freejoint/><geom size=".05"/><site name="b"/></body></worldbody>
      <tendon><spatial name="t"><site site="a"/><site site="b"/></spatial></tendon>
      <equality><tendon tendon1="t"/></equality><sensor><tendonpos tendon="t"/></sensor></mujoco>"""
    sim = simulate(source, timestep=1e-3)
    for _ in range(500):
        sim.step()
        assert float(sim.sensordata_ideal[0]) == pytest.approx(0.4, abs=1e-4)
    # A pendulum that falls from the horizontal: below its support after a quarter of its period.
    assert sim.qpos[2] < 0.9


def test_a_saved_model_keeps_paths_and_muscles(tmp_path):
    """The model from the file is equal, and steps to the same bits."""
    model = stepper.load(scene(f'<spatial name="t">{PATHS["sphere"]}</spatial>', ACTUATORS["muscle"]))
    model.save(tmp_path / "m.stepper")
    again = stepper.load(tmp_path / "m.stepper")
    assert again == model
    assert again.digest == model.digest
    runs = [stepper.Stepper(m) for m in (model, again)]
    for sim in runs:
        sim.step([0.7], nstep=20)
    assert np.array_equal(runs[0].qpos, runs[1].qpos)
    assert model.tendon("t").spatial
    assert model.actuator(0).gaintype == "muscle"
    assert model.actuator(0).gainprm[2] == 40.0


@pytest.mark.parametrize("path", [name for name, exact in zip(PATHS, EXACT, strict=True) if exact and name != "pulley"])
def test_drawn_paths_are_mujocos(path):
    """Paths for drawing have MuJoCo's sites and tangent points. Chords of the arcs are as long as the tendon."""
    text, rng = scene(f'<spatial name="t">{PATHS[path]}</spatial>'), np.random.default_rng(3)
    model = mujoco.MjModel.from_xml_string(text)
    sim, wrapped = simulate(model), 0
    for _ in range(STATES // 4):
        state = random_state(model, rng)
        data = forward(model, *state)
        sim.set_state(*state)
        points = sim.tendon_paths
        given = data.wrap_xpos.reshape(-1, 3)[: data.ten_wrapnum[0]]
        apart = np.linalg.norm(given[:, None] - points.reshape(-1, 3), axis=2).min(axis=1)
        # Rounding, times the condition of tangents in random states.
        assert apart.max() < 1e-9
        wrapped += len(given) > points.shape[0] + 1
        length = np.linalg.norm(np.diff(points, axis=1), axis=2).sum()
        # Seven chords of an arc of at most 2 pi are at most 1 - sin(pi / 7) / (pi / 7) = 3.3 % shorter than the arc.
        assert 0.967 * data.ten_length[0] - 1e-9 < length < data.ten_length[0] + 1e-9
    assert wrapped > 0 or "sites" in path
    assert stepper.Stepper(sim.model, 3).tendon_paths.shape == (3, *points.shape)


def test_frames_for_viewers_have_wrapped_tendons():
    """Frames of the viewers have the paths of every shown environment; a model without spatial tendons has none."""
    from stepper.viewer.frames import frame_of

    sim = simulate(scene(f'<spatial name="t">{PATHS["cylinder"]}</spatial>'), 4, steps=3)
    assert np.array_equal(frame_of(sim, np.array([1, 3])).tendons, sim.tendon_paths[[1, 3]])
    assert frame_of(stepper.Stepper(stepper.load("<mujoco/>")), np.array([0])).tendons.shape == (1, 0, 10, 3)
