"""Jams, that is overlaps that contradict one another, and contacts that no motion can open or close: they are solved and come to rest."""

import functools

import numpy as np
import pytest
import stepper
from checks import every
from hypothesis import example, given, settings, strategies as st
from models import flags_of, simulate
from scenes import arms

JAMMED = {
    "a box on a hinge between two boxes": """<geom type="box" size=".1 .1 .1" pos=".11 0 0"/>
      <geom type="box" size=".1 .1 .1" pos="-.11 0 .02" euler="3 4 5"/>
      <body><joint axis="0 1 0"/><geom type="box" size=".05 .02 .03" euler="2 20 1" pos=".003 0 .002"/></body>""",
    "a box on three hinges between two boxes": """<geom type="box" size=".1 .1 .1" pos=".11 0 0"/>
      <geom type="box" size=".1 .1 .1" pos="-.11 0 .02" euler="3 4 5"/>
      <body><joint axis="0 1 0"/><joint axis="0 0 1"/><joint axis="1 0 0"/>
      <geom type="box" size=".05 .02 .03" euler="2 20 1" pos=".003 0 .002"/></body>""",
    "two links within a box": """<geom type="box" size=".06 .05 .04"/>
      <body><joint axis="0 1 0"/><geom type="box" size=".04 .03 .03" pos=".02 .01 0" euler="10 20 30"/>
      <body pos=".01 0 0"><joint axis="1 0 0"/><geom type="box" size=".04 .02 .03" pos="0 .01 0" euler="40 10 30"/></body></body>""",
}

# Steps in which positions give way where they can: a contact is undone by a fifth a step, so that these leave nothing of what can be.
SETTLING = 500
# Jams that were not solved, or whose impulses did not determine the energy. All of the first 400 are solved now.
HARD = [7, 16, 24, 36, 55, 100, 102, 109, 118, 136, 140, 153, 175, 196, 257, 323, 324, 336, 346, 398]
PRESSED = """<mujoco><worldbody><geom name="post" size=".05"/><geom type="plane" size="3 3 1" contype="2" conaffinity="2"/>
<body><joint axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 .3 0 0"/></body>
<body pos="1 0 .03"><joint type="slide" axis="0 0 1"/><geom size=".05" mass="1" contype="2" conaffinity="2"/></body></worldbody></mujoco>"""
ANGLES = st.floats(-180.0, 180.0)


@every(gravity=[0, -9.81], scene=JAMMED)
def test_contradictory_corrections_come_to_rest(scene, gravity):
    """They moved 4e-3 to 2e-2 rad in 400 steps, for ever: normals of deep overlaps turn, and a joint was pushed to and fro."""
    sim = simulate(f'<mujoco><option gravity="0 0 {gravity}"/><worldbody>{JAMMED[scene]}</worldbody></mujoco>', steps=SETTLING)
    before = sim.qpos.copy()
    sim.step(nstep=5000)
    # Ten seconds, in which an eye sees nothing of less than a tenth of a milliradian.
    assert np.abs(sim.qpos - before).max() < 1e-4
    assert sim.status & stepper.Status.INFEASIBLE


def test_what_comes_to_rest_does_not_depend_on_its_past():
    """The pose at which a jam rests is one at which it rests, too, for a stepper that has never seen another."""
    scene = JAMMED["a box on three hinges between two boxes"]
    model = stepper.load(f'<mujoco><option gravity="0 0 0"/><worldbody>{scene}</worldbody></mujoco>')
    sim, fresh = stepper.Stepper(model), stepper.Stepper(model)
    sim.step(nstep=SETTLING)
    fresh.set_state(qpos=sim.qpos)
    fresh.step(nstep=100)
    np.testing.assert_array_equal(fresh.qpos, sim.qpos)


def penalty(sim: stepper.Stepper) -> float:
    """Sum of the penalties of the deepest overlap of every pair, as the step takes it: linear beyond half a millimetre."""
    deepest, bend = {}, 5e-4
    for geoms, distance in zip(sim.contacts()["geom"].tolist(), sim.contacts()["distance"], strict=True):
        depth = max(-float(distance) - sim.options.slop, 0.0)
        deepest[tuple(geoms)] = max(deepest.get(tuple(geoms), 0.0), depth)
    return sum(depth - bend * float(np.log1p(depth / bend)) for depth in deepest.values())


@settings(max_examples=30, deadline=None)
@example(3)
@example(20)
@example(45)
@given(st.integers(0, 2**16))
def test_a_random_jam_that_is_proven_moves_only_while_overlaps_become_less(seed):
    sim = simulate(stepper.load(arms(seed)).replace(gravity=[0, 0, 0]), steps=100)
    before, proven = np.inf, False
    for _ in range(60):
        sim.step()
        now = penalty(sim)
        # Without gravity nothing else moves it. Depths round by 1e-16 m.
        assert not proven or now <= before + 1e-15
        before, proven = now, bool(sim.status & stepper.Status.INFEASIBLE)


@pytest.mark.parametrize("seed", HARD)
def test_arms_that_begin_jammed_are_solved(seed):
    sim = stepper.Stepper(stepper.load(arms(seed)))
    for _ in range(50):
        sim.step()
        assert not sim.status & stepper.Status.NOT_CONVERGED, (float(sim.residual), sim.worst_row())


def test_motors_that_load_a_jam_do_not_make_it_unresolved():
    """Without contacts 300 N m would throw the arms. While they do not move, the gain of energy is rounding error."""
    # Coulomb's law has several solutions here. In one of them the jam opens. Of 400 random arms, this jam holds longest.
    joints = arms(693).split("<joint ")
    text = joints[0] + "".join(f'<joint name="{k}" {joint}' for k, joint in enumerate(joints[1:]))
    motors = "".join(f'<motor joint="{k}" gear="300"/>' for k in range(len(joints) - 1))
    model = stepper.load(text.replace("</mujoco>", f"<actuator>{motors}</actuator></mujoco>"))
    sim, rng = stepper.Stepper(model), np.random.default_rng(693)
    for _ in range(40):
        sim.step(rng.uniform(-1, 1, model.nu))
        assert not sim.status & stepper.Status.UNRESOLVED
        # A velocity of at most the solver's tolerance, of which 300 N m through one step are 1e-7 or less.
        assert np.abs(sim.qvel).max() < 1e-6


def test_a_hundred_random_jams_are_solved():
    unsolved = 0
    for seed in range(1000, 1100):
        sim = stepper.Stepper(stepper.load(arms(seed)))
        for _ in range(20):
            sim.step()
            unsolved += bool(sim.status & stepper.Status.NOT_CONVERGED)
    # A thousandth of the steps.
    assert unsolved <= 2


@pytest.mark.parametrize("integrator", ["euler", "midpoint"])
def test_impulses_belong_to_the_velocity_where_baumgartes_bias_is_limited(integrator):
    """A rod that nothing can move limits the bias, and the ball beside it, 2 cm within the floor, gets the bounded correction instead."""
    sim = stepper.Stepper(stepper.load(PRESSED), options=stepper.Options(stabilization="baumgarte", integrator=integrator))
    for _ in range(5):
        before = float(sim.qvel[1])
        sim.step()
        # The ball weighs 1 kg. Sums of three terms of 500 N round by 1e-13.
        force = (float(sim.qvel[1]) - before) / sim.timestep + 9.81
        assert float(sim.qfrc_constraint[1]) == pytest.approx(force, abs=1e-10)
        assert float(sim.contacts()["force"][:, 0].sum()) == pytest.approx(force, abs=1e-10)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**16))
def test_impulses_of_random_jams_belong_to_the_velocity_with_baumgartes_method(seed):
    model = stepper.load(arms(seed)).replace(dof_damping=np.zeros(stepper.load(arms(seed)).nv))
    sim = stepper.Stepper(model, options=stepper.Options(stabilization="baumgarte", integrator="euler", max_correction_speed=1e-3))
    for _ in range(3):
        before, mass, smooth = sim.qvel.copy(), np.reshape(sim.mass_matrix(), (model.nv, model.nv)), np.reshape(sim.qacc_smooth, model.nv)
        sim.step()
        if sim.status & (stepper.Status.UNRESOLVED | stepper.Status.NOT_CONVERGED | stepper.Status.NON_FINITE):
            # Speed and energy were bounded by force.
            return
        force = mass @ ((sim.qvel - before) / sim.timestep - smooth)
        # Matrices of condition 1e4 at the most.
        assert np.abs(sim.qfrc_constraint - force).max() <= 1e-9 * (1 + np.abs(force).max())


# Limbs on two hinges that touch a trunk: some impulses of such a contact have no effect. If one of these is in the friction cone, the
# contact holds itself at any load, like a wedge. The targets of its friction rows must then be a motion of the hinges.

HELD = [146, 196, 300, 313, 411, 485, 543, 641, 659, 667, 702, 801, 818, 839, 869, 943, 981]
"""Seeds of the first 1000 in which a contact that holds itself was not solved, and pushed with up to 1e11 N."""


SLIDING = 'friction="{} 0 0"'
ROTATION_FRICTION = ['condim="4" friction="{} 1e-3 0"', 'condim="6" friction="{} 1e-3 1e-4"']


def limb(seed: int, rotation_friction: str = SLIDING) -> tuple[str, np.ndarray]:
    """MJCF of a free trunk with a limb on two hinges, and the initial velocities of the hinges, rad/s."""
    # `rotation_friction` are the attributes of both geoms that concern friction, with braces for the sliding coefficient.
    rng = np.random.default_rng(seed)
    first, second = (text(axis) for axis in rng.normal(size=(2, 3)))
    shape = rng.choice(["box", "capsule", "sphere"])
    size = {
        "box": text(rng.uniform(0.02, 0.05, 3)),
        "capsule": f"{rng.uniform(0.02, 0.04)} {rng.uniform(0.03, 0.1)}",
        "sphere": f"{rng.uniform(0.03, 0.06)}",
    }[shape]
    angles, pos = text(rng.uniform(-180, 180, 3)), text(rng.uniform(0.05, 0.2, 3) * rng.choice([-1, 1], 3))
    friction = rotation_friction.format(rng.uniform(0.5, 1.5))
    hip, knee = text(rng.uniform(-0.1, 0.1, 3)), text(rng.uniform(-0.05, 0.05, 3))
    xml = f"""<mujoco><option timestep=".002"/><worldbody><body><freejoint/><geom type="box" size=".1 .06 .04" {friction} mass="5"/>
    <body pos="{hip}"><joint axis="{first}"/><geom size=".01" contype="0" conaffinity="0"/>
    <body pos="{knee}"><joint axis="{second}"/><geom type="{shape}" size="{size}" euler="{angles}" pos="{pos}" {friction}/>
    </body></body></body></worldbody></mujoco>"""
    return xml, rng.uniform(-20, 20, 2)


def text(numbers: np.ndarray) -> str:
    return " ".join(map(str, numbers))


@functools.cache
def largest_force(seed: int, rotation_friction: str = SLIDING) -> float:
    """Largest component of the contact forces of a limb in 100 steps, N. Every step is solved."""
    xml, qvel = limb(seed, rotation_friction)
    sim, largest = stepper.Stepper(stepper.load(xml)), 0.0
    sim.set_state(qvel=[0.0] * 6 + list(qvel))
    for _ in range(100):
        sim.step()
        assert not sim.status & stepper.Status.NOT_CONVERGED, (float(sim.residual), sim.worst_row())
        largest = max(largest, np.abs(sim.contacts()["force"]).max(initial=0.0))
    return largest


@pytest.mark.parametrize("rotation_friction", ROTATION_FRICTION, ids=["4", "6"])
@pytest.mark.parametrize("seed", HELD)
def test_a_limb_that_holds_itself_is_solved_and_pushes_with_moderate_forces(seed, rotation_friction):
    """With and without torsional and rolling friction of a millimetre, which hardly change what holds, so that forces have one size."""
    # Limbs strike at other times and places, with up to a few times the force. Impulses without effect grew to 1e9 N.
    assert largest_force(seed, rotation_friction) < 20 * largest_force(seed) + 100


@given(seed=st.integers(0, 2**32 - 1), rotation_friction=st.sampled_from([SLIDING, *ROTATION_FRICTION]))
@example(seed=146, rotation_friction=SLIDING)
@example(seed=146, rotation_friction=ROTATION_FRICTION[1])
def test_random_limbs_that_strike_their_trunk_are_solved(seed, rotation_friction):
    """Contacts with three, four and six rows."""
    largest_force(seed, rotation_friction)


def creeping(seed: int) -> tuple[str, np.ndarray]:
    """MJCF of a limb on two hinges that gravity may press against a moving box, and the velocity of the box: 1e-8 to 3e-6 m/s."""
    rng = np.random.default_rng(seed)
    first, second = (text(axis) for axis in rng.normal(size=(2, 3)))
    size, angles = text(rng.uniform(0.02, 0.05, 3)), text(rng.uniform(-180, 180, 3))
    pos = text(rng.uniform(0.05, 0.2, 3) * rng.choice([-1, 1], 3))
    friction = f'friction="{rng.uniform(0.5, 1.5)} 0 0"'
    gravity, hip, knee = text(10 * rng.normal(size=3)), text(rng.uniform(-0.1, 0.1, 3)), text(rng.uniform(-0.05, 0.05, 3))
    xml = f"""<mujoco><option timestep=".002" gravity="{gravity}"/><worldbody>
    <body mocap="true"><geom type="box" size=".1 .06 .04" {friction}/></body>
    <body pos="{hip}"><joint axis="{first}" damping=".02"/><geom size=".01" contype="0" conaffinity="0"/>
    <body pos="{knee}"><joint axis="{second}" damping=".02"/><geom type="box" size="{size}" euler="{angles}" pos="{pos}" {friction}/>
    </body></body></worldbody></mujoco>"""
    direction = rng.normal(size=3)
    return xml, direction / np.linalg.norm(direction) * 10 ** rng.uniform(-8, -5.5)


@pytest.mark.parametrize("seed", [184, 985, 1289])
def test_a_wedge_on_a_creeping_box_has_impulses_that_determine_its_energy(seed):
    """Impulses without effect grow until they cancel at a million times the load. The solver replaces them by those of least norm."""
    xml, velocity = creeping(seed)
    sim = stepper.Stepper(stepper.load(xml))
    for k in range(150):
        sim.mocap_pos = (velocity * 2e-3 * (k + 1))[None]
        sim.step()
        assert not sim.status & stepper.Status.NOT_CONVERGED, (float(sim.residual), sim.worst_row())


# Contacts whose normal passes through a joint, so that no motion can open or close them.

BALL_JOINT = """<mujoco><worldbody><geom type="capsule" size=".01" fromto="0 0 0 0 0 .1"/>
<body pos="0 0 .1"><joint type="ball" damping=".005"/><geom type="capsule" size=".01" fromto="0 0 0 0 .1 .1"/></body>
</worldbody></mujoco>"""

TURNTABLE = """<mujoco><option gravity="0 0 0"/><worldbody><geom type="box" size=".1 .1 .05"/>
<body pos="0 0 .07"><joint axis="{tilt} 0 1"/><geom type="box" size=".02 .02 .02" pos="0 .05 0" condim="{condim}"/></body>
</worldbody></mujoco>"""

TELESCOPE = """<mujoco><worldbody><body euler="{euler}"><joint type="slide" axis="0 0 1" range="0 1" limited="true"/>
<geom type="box" size=".1 .1 .05"/><body><geom size=".001"/><joint type="slide" axis="{axis}" range="0 .1" limited="true"/>
<body pos=".15 0 0"><joint type="slide" axis="{axis}" range="0 .1" limited="true"/>
<geom type="box" size=".1 .1 .05" euler="{turn} 0 0"/></body></body></body></worldbody></mujoco>"""


def test_a_contact_at_the_centre_of_a_ball_joint_does_not_lock_it() -> None:
    """The overlapping ends coincide at the joint's centre up to rounding, and no impulse can act there."""
    sim = stepper.Stepper(stepper.load(BALL_JOINT, strict=False))
    free = stepper.Stepper(stepper.load(BALL_JOINT.replace('size=".01"', 'size=".01" contype="0" conaffinity="0"')))
    for other in (sim, free):
        other.step(nstep=40)
    assert np.linalg.norm(free.qvel) > 0.5
    # The contact has no lever arm: what remains is rounding, amplified over 40 steps.
    assert np.allclose(sim.qvel, free.qvel, atol=1e-9)


@every(condim=[3, 6], tilt=[0.0, 1e-6, 3e-6, 8e-6])
def test_a_contact_along_a_hinge_neither_blocks_it_nor_stops_the_solver(tilt: float, condim: int) -> None:
    """A box slides on a face normal to its hinge's axis, up to a tilt below the least lever arm of 1e-5."""
    sim = simulate(TURNTABLE.format(tilt=tilt, condim=condim), qvel=[-20.0])
    for _ in range(20):
        sim.step()
        # A lever arm above rounding closes the gap slowly. No impulse can stop it, and the residual reports it.
        # A corner of the box is less than 75 mm from the hinge.
        assert sim.status & ~stepper.Status.NOT_CONVERGED == 0
        assert sim.residual <= 20.0 * 0.075 * tilt + 1e-9
    # No impulse acts along an immovable normal, so that the speed is exactly the initial one but for rounding.
    assert sim.qvel[0] == pytest.approx(-20.0, abs=1e-12)


@pytest.mark.parametrize("condim", [3, 6])
def test_a_contact_that_an_equality_unloads_has_no_friction_left(condim: int) -> None:
    """A box slides on a floor until an equality holds its height. The impulse of the last step with a load must not act on."""
    slides = '<joint type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>'
    box = f'<geom type="box" size=".05 .05 .05" friction=".5 0 0" condim="{condim}"/>'
    model = stepper.load(
        f'<mujoco><worldbody><geom type="plane" size="5 5 1"/><body pos="0 0 .05">{slides}{box}</body></worldbody>'
        '<equality><joint joint1="z" active="false"/></equality></mujoco>'
    )
    sim = simulate(model, steps=5)
    sim.set_state(qvel=[1.0, 0.0])
    sim.step(nstep=20)
    speed = sim.qvel[0]
    assert speed < 0.9
    sim.eq_active = np.ones_like(sim.eq_active)
    sim.step(nstep=100)
    # The equality carries the weight, so that no friction acts: the speed is the same but for rounding.
    assert sim.qvel[0] == pytest.approx(speed, abs=1e-12)


@settings(max_examples=20, deadline=None)
@example(euler=(128.666, -167.909, 82.676), tilt=80.0)
@example(euler=(-72.104, -27.833, -169.805), tilt=80.0)
@given(euler=st.tuples(ANGLES, ANGLES, ANGLES), tilt=st.floats(60.0, 120.0))
def test_a_contact_across_a_telescope_carries_no_load(euler: tuple[float, float, float], tilt: float) -> None:
    """A tube overlaps the lift beside it, across its slides, which are inclined to the lift. The lever arms are rounding error."""
    axis = f"0 {np.sin(np.radians(tilt))} {np.cos(np.radians(tilt))}"
    sim = stepper.Stepper(stepper.load(TELESCOPE.format(euler=" ".join(map(str, euler)), axis=axis, turn=tilt - 90.0)))
    for _ in range(50):
        sim.step()
        assert not sim.status & (stepper.Status.NOT_CONVERGED | stepper.Status.UNRESOLVED)
        # Nothing else loads the contacts. Through lever arms of 1e-16 they pushed with 1e17 N.
        assert np.abs(sim.contacts()["force"]).max(initial=0.0) == 0.0


# Contacts that no impulse can stop: slow approaches are at rest, faster ones and growing overlaps are reported.

TOLERANCE, SLOP = 1e-6, 1e-5
"""Tolerance of the solver, m/s, and overlap that stabilisation leaves, m."""
RESTING = 10 * TOLERANCE
"""Normal speed below which a touching contact counts as resting, m/s."""
REPORTED = 1e-4 + SLOP
"""Overlap whose correction exceeds 1 cm/s, so that it is reported as infeasible, m: 1e-2 m/s * 2 ms / 0.2, and the slop."""
REACH = float(np.hypot(0.02, 0.07))
"""Distance of the box's farthest corner from the hinge, m."""

HINGE = """<mujoco><option gravity="0 0 0"/><worldbody><geom type="box" size=".1 .1 .05"/>
<body pos="0 0 {height}"><joint axis="{slope} 0 1"/><geom type="box" size=".02 .02 .02" pos="0 .05 0" condim="{condim}"/></body>
</worldbody></mujoco>"""
SLIDE = """<mujoco><option gravity="0 0 0"/><worldbody><geom type="box" size=".5 .1 .05"/>
<body pos="0 0 {height}"><joint type="slide" axis="1 0 {slope}"/><geom type="box" size=".02 .02 .02" condim="{condim}"/></body>
</worldbody></mujoco>"""
PRESS = """<mujoco><option gravity="0 0 0"/><worldbody><body mocap="true"><geom type="box" size=".1 .1 .05"/></body>
<body pos="0 0 {height}"><joint type="slide" axis="1 0 0"/><geom type="box" size=".02 .02 .02"/></body></worldbody></mujoco>"""

JOINTS = st.sampled_from(["hinge", "slide"])
SLOPES = st.floats(-6.5, -5.1).map(lambda x: 10.0**x)
"""Slopes of a surface below the least lever arm of 1e-5."""


def mover(joint: str, slope: float, speed: float, *, overlap: float, condim: int = 3, timestep: float = 2e-3) -> stepper.Stepper:
    """A box that a joint moves along a face at `speed`, m/s, while the face approaches it at `slope` times that speed."""
    xml = (HINGE if joint == "hinge" else SLIDE).format(height=0.07 - overlap, slope=-slope, condim=condim)
    return simulate(xml, timestep=timestep, tolerance=TOLERANCE, qvel=[speed / REACH if joint == "hinge" else speed])


@given(joint=JOINTS, slope=SLOPES, approach=st.floats(0.0, 0.9), overlap=st.floats(0.0, 0.8), condim=st.sampled_from([3, 6]))
@example(joint="slide", slope=3.67e-6, approach=0.17, overlap=0.5, condim=3)
@example(joint="hinge", slope=8e-6, approach=0.33, overlap=0.4, condim=3)
def test_a_slow_approach_within_the_slop_is_not_reported(joint, slope, approach, overlap, condim):
    """Angles of a model file with six digits, as 1.5708 for a right angle, tilt a face by 4e-6."""
    speed = approach * RESTING / slope
    sim = mover(joint, slope, speed, overlap=overlap * SLOP, condim=condim)
    # In 20 steps of 2 ms the overlap grows by 4e-7 m at most, and stays below the slop.
    assert flags_of(sim, 20) == stepper.Status.OK
    # No impulse acts. The velocity is the initial one but for rounding.
    assert abs(sim.qvel[0]) * (REACH if joint == "hinge" else 1.0) == pytest.approx(speed, rel=1e-12)


@given(slope=SLOPES, approach=st.floats(0.0, 0.9), overlap=st.floats(2.0, 90.0))
@example(slope=3.67e-6, approach=0.17, overlap=84.6)
def test_a_slow_approach_in_an_infeasible_overlap_has_one_flag(slope, approach, overlap):
    """The overlap of a lift with its mast is millimetres deep. It is reported as infeasible, whether the lift moves or not."""
    sim = mover("slide", slope, approach * RESTING / slope, overlap=overlap * REPORTED)
    assert flags_of(sim, 20) & ~stepper.Status.DEEP == stepper.Status.INFEASIBLE


@given(joint=JOINTS, slope=SLOPES, more=st.floats(0.0, 1.0), overlap=st.floats(0.0, 0.8))
def test_a_faster_approach_is_reported(joint, slope, more, overlap):
    """The corners of the box on a hinge that approach do so at 0.9 of the speed of the farthest one, for a turn of less than 0.1 rad."""
    least = 1.1 * RESTING / slope / (0.9 if joint == "hinge" else 1.0)
    sim = mover(joint, slope, least * (500.0 / least) ** more, overlap=overlap * SLOP, timestep=1e-5)
    assert flags_of(sim, 1) == stepper.Status.NOT_CONVERGED
    assert sim.residual >= 1.09 * RESTING


@given(slope=SLOPES, approach=st.floats(1.2, 9.0), overlap=st.floats(1.1, 10.0))
def test_a_slow_approach_beyond_the_slop_is_reported(slope, approach, overlap):
    """The correction of such an overlap is too slow to be reported as infeasible. Its growth is not silent."""
    sim = mover("slide", slope, approach * TOLERANCE / slope, overlap=overlap * SLOP)
    assert flags_of(sim, 1) == stepper.Status.NOT_CONVERGED
    assert sim.residual == pytest.approx(approach * TOLERANCE, rel=1e-6)


@given(speed=st.floats(-4.9, 0.0).map(lambda x: 10.0**x), overlap=st.floats(0.0, 9.0))
def test_a_plate_pressed_into_a_box_is_reported(speed, overlap):
    """A moving plate presses a box across its slide, so that the contact has no lever arm at all."""
    sim = simulate(PRESS.format(height=0.07 - overlap * SLOP), tolerance=TOLERANCE, steps=1)
    for k in range(3):
        sim.mocap_pos = np.array([[0.0, 0.0, 2e-3 * speed * (k + 1)]])
        sim.step()
        assert sim.status & (stepper.Status.NOT_CONVERGED | stepper.Status.INFEASIBLE)
