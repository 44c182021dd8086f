"""Friction: torsional and rolling friction (condim 4 and 6), wheels, boxes on inclines, and large coefficients."""

import functools

import mujoco
import numpy as np
import pytest
import stepper
from checks import every
from geometry import matrix
from models import simulate
from scenes import BOX, G, every_choice, every_dt, on_plane


def scene(geom: str, height: float, condim: int, friction: str) -> str:
    return f"""<mujoco><worldbody><geom type="plane" size="5 5 1" condim="{condim}" friction="{friction}"/>
      <body pos="0 0 {height}"><freejoint/><geom {geom} condim="{condim}" friction="{friction}" density="1000"/></body>
    </worldbody></mujoco>"""


@every(integrator=["euler", "midpoint"], condim=[4, 6])
def test_a_spinning_sphere_stops_at_the_rate_of_torsional_friction(condim, integrator):
    """I w' = -mu_t m g with I = 2/5 m r^2: exactly linear, to rest within a step, and then it rests exactly."""
    r, mu, spin, h = 0.1, 0.002, 20.0, 1e-3
    sim = simulate(scene(f'type="sphere" size="{r}"', r, condim, f"1 {mu} .0001"), integrator=integrator, timestep=h, tolerance=1e-6)
    rate = mu * G / (0.4 * r * r)
    sim.set_state(qvel=[0, 0, 0, 0, 0, spin])
    for steps in (500, 500, 1000):
        sim.step(nstep=steps)
        # Rounding of the solver's tolerance, an angular velocity of 1e-6 m/s over mu, over the steps.
        assert sim.qvel[5] == pytest.approx(max(spin - rate * sim.time, 0.0), abs=1e-6)
        (contact,) = sim.contacts()
        assert contact["force"] == pytest.approx([sim.model.body_mass[1] * G, 0, 0], abs=1e-6)
        assert abs(contact["torque"][0]) == pytest.approx(mu * contact["force"][0] if sim.qvel[5] > 1e-9 else 0.0, abs=1e-6)
    sim.step(nstep=round(spin / rate / h))
    assert np.abs(sim.qvel).max() < 1e-9
    assert sim.status == stepper.Status.OK


def rolling(push: float, press: float, r: float, slide: float, roll: float) -> tuple[float, float]:
    """Acceleration of a ball that rolls under an acceleration `push` along the ground and `press` onto it, and its v / w."""
    # One cone holds sliding force f and torque t (per mass): (f / slide)^2 + (t / roll)^2 = press^2, opposed to the velocities in the same
    # metric, so that a ball that rolls also slips a little: slip / f = (slide / roll)^2 w / t. With r' = v / w = r + slip / w: v' = push -
    # f = r' (f r - t) / (2/5 r^2).
    f, lever = 0.0, r
    for _ in range(200):
        t = roll * np.sqrt(press**2 - (f / slide) ** 2)
        lever = r + (roll / slide) ** 2 * f / t
        f = (push * 0.4 * r * r + lever * t) / (0.4 * r * r + lever * r)
    return push - f, lever


@pytest.mark.parametrize("integrator", ["euler", "midpoint"])
def test_a_rolling_ball_is_stopped_by_rolling_friction(integrator):
    """Rate v' = -5/7 g mu_r / r but for what the force takes of the cone; it stops, and does not creep."""
    r, mu, speed, h = 0.1, 0.005, 1.0, 1e-3
    sim = simulate(scene(f'type="sphere" size="{r}"', r, 6, f"1 .003 {mu}"), integrator=integrator, timestep=h, tolerance=1e-6)
    rate, lever = rolling(0, G, r, 1, mu)
    assert rate == pytest.approx(-5 / 7 * G * mu / r, rel=2e-3)
    direction = np.array([np.cos(0.7), np.sin(0.7), 0])
    sim.set_state(qvel=np.concatenate([speed * direction, np.cross([0, 0, 1], direction) * speed / lever]))
    sim.step(nstep=1000)
    # A solver residual of 1e-6 m/s sums up to less than its like; velocities are linear in time, which both rules integrate exactly.
    assert sim.qvel[:3] == pytest.approx((speed + rate * sim.time) * direction, abs=2e-6)
    sim.step(nstep=round(-speed / rate / h) - 1000 + 5)
    stopped = sim.qpos[:3]
    assert np.abs(sim.qvel).max() < 1e-9
    # The distance v^2 / (2 a), up to the half step that each rule of integration is off.
    assert stopped[:2] == pytest.approx(-(speed**2) / (2 * rate) * direction[:2], abs=0.51 * speed * h)
    sim.step(nstep=2000)
    assert sim.qpos[:3] == pytest.approx(stopped, abs=1e-9)


def test_below_the_angle_of_rolling_friction_a_ball_rests():
    """On a slope the ground takes f = g sin and t = f r: both fit in the cone iff tan(angle) <= 1 / |(1 / mu, r / mu_r)|."""
    r, mu = 0.1, 0.01
    limit = np.arctan(1 / np.hypot(1, r / mu))
    for angle, holds in ((limit - 1e-4, True), (limit + 1e-4, False), (limit + 2e-2, False)):
        model = mujoco.MjModel.from_xml_string(scene(f'type="sphere" size="{r}"', r, 6, f"1 .005 {mu}"))
        model.opt.gravity[:] = G * np.array([np.sin(angle), 0, -np.cos(angle)])
        sim = simulate(model, timestep=2e-3, steps=1000)
        if holds:
            assert np.abs(sim.qvel).max() < 1e-9
            assert abs(sim.qpos[0]) < 1e-9
        else:
            rate, _ = rolling(G * np.sin(angle), G * np.cos(angle), r, 1, mu)
            assert sim.qvel[0] == pytest.approx(rate * sim.time, rel=1e-3)


def test_a_spinning_box_shares_friction_among_its_corners():
    """Torsional friction of four corners adds to what their sliding friction does at the distance of the corners."""
    a, mu, torsion = 0.1, 0.4, 0.02
    slower = {}
    for condim in (3, 4):
        sim = simulate(scene(f'type="box" size="{a} {a} .05"', 0.05, condim, f"{mu} {torsion} 0"), timestep=1e-3, iterations=500)
        sim.set_state(qvel=[0, 0, 0, 0, 0, 10.0])
        sim.step(nstep=100)
        slower[condim] = (10 - sim.qvel[5]) / sim.time
        sim.step(nstep=2000)
        assert np.abs(sim.qvel).max() < 1e-9
    arm, inertia = np.sqrt(2) * a, 2 / 3 * a * a  # I / m of a square of half side a
    # Each corner slips at w arm and turns at w: maximal dissipation over the ellipse gives n sqrt((mu arm)^2 + torsion^2) of torque.
    assert slower[3] == pytest.approx(G * mu * arm / inertia, rel=1e-3)
    assert slower[4] == pytest.approx(G * np.hypot(mu * arm, torsion) / inertia, rel=1e-3)


@pytest.mark.parametrize("condim", [4, 6])
def test_forces_are_in_the_elliptic_cone_and_oppose_the_slip(condim):
    """Thrown balls with spin: sum (f_i / mu_i)^2 <= f_n^2 in every step, on the surface while anything slips or turns."""
    mu = np.array([0.6, 0.6, 0.03, 0.01, 0.01])
    source = scene('type="sphere" size=".1"', 0.1, condim, "0.6 0.03 0.01")
    rng = np.random.default_rng(1)
    slid = 0
    for _ in range(5):
        sim = simulate(source, timestep=2e-3, qvel=np.concatenate([rng.normal(size=2), [0], rng.normal(scale=20, size=3)]))
        for _ in range(200):
            sim.step()
            for contact in sim.contacts():
                force = np.concatenate([contact["force"], contact["torque"]])
                if condim == 4:
                    assert not force[4:].any()
                fraction = np.linalg.norm(force[1:] / mu) / force[0]
                assert fraction < 1 + 1e-12
                velocity = contact["frame"] @ (sim.qvel[:3] + np.cross(matrix(sim.qpos[3:7]) @ sim.qvel[3:], contact["pos"] - sim.qpos[:3]))
                turning = contact["frame"] @ matrix(sim.qpos[3:7]) @ sim.qvel[3:]
                scaled = np.concatenate([velocity[1:], turning])[: 3 if condim == 4 else 5] * (mu / mu[0])[: 3 if condim == 4 else 5]
                if np.linalg.norm(scaled) > 1e-3:
                    slid += 1
                    pull = (force[1:] * mu[0] / mu)[: len(scaled)]
                    # The velocity of the step's end is taken at its beginning's contact point: off by the turn within the step.
                    assert fraction > 1 - 1e-9
                    assert pull @ scaled < -(1 - 1e-2) * np.linalg.norm(pull) * np.linalg.norm(scaled)
    assert slid > 100


def test_a_friction_of_zero_costs_no_rows_and_changes_no_bit():
    """With condim 6 but without torsional and rolling friction it is condim 3, to the bit."""
    found = []
    for condim, friction in ((3, "0.7 0 0"), (6, "0.7 0 0")):
        sim = simulate(scene('type="box" size=".1 .2 .05"', 0.2, condim, friction), timestep=2e-3, qvel=[1, 0.5, 0, 3, 2, 1], steps=300)
        found.append(np.concatenate([sim.qpos, sim.qvel]))
    assert np.array_equal(*found)


def test_a_contact_without_torsional_friction_has_no_torque():
    """Also if it had some before: coefficients can change between steps."""
    ball = '<body pos="0 0 .1"><freejoint/><geom name="ball" size=".1" condim="4" friction="1 .05 0"/></body>'
    sim = simulate(f'<mujoco><worldbody><geom type="plane" size="1 1 1" condim="1"/>{ball}</worldbody></mujoco>', qvel=[0, 0, 0, 0, 0, 50])
    sim.step()
    assert abs(sim.contacts()["torque"][0, 0]) > 0.1
    sim.randomize({"geom_friction[ball][1]": 0.0, "geom_friction[0][1]": 0.0})
    sim.step()
    assert (sim.contacts()["torque"] == 0).all()


def car() -> str:
    """Four wheels of two contacts of six rows each, the front ones steered together, with bumpers that a turned wheel runs into."""
    wheels = ""
    for name, x, y in (("fl", 0.16, 0.1), ("fr", 0.16, -0.1), ("rl", -0.16, 0.1), ("rr", -0.16, -0.1)):
        axle = f'<joint name="{name}" axis="0 1 0"/><geom type="cylinder" size=".05 .0225" zaxis="0 1 0" mass=".34"/>'
        if name[0] == "r":
            wheels += f'<body pos="{x} {y} 0">{axle}</body>'
        else:
            steered = f'<joint name="steer_{name}" axis="0 0 1" range="-.785 .785"/>'
            steered += '<inertial pos="0 0 0" mass=".1" diaginertia="4e-6 4e-6 4e-6"/>'
            wheels += f'<body pos="{x} {y} 0">{steered}<body>{axle}</body></body>'
    bumper = '<geom type="box" size=".0165 .0875 .015" pos=".232 0 .02" mass=".2"/>'
    body = f'<geom type="box" size=".14 .05 .02" mass="2"/>{bumper}{wheels}'
    motors = "".join(f'<motor joint="{name}" gear=".2" ctrlrange="-1 1"/>' for name in ("rl", "rr"))
    return f"""<mujoco><compiler angle="radian" autolimits="true"/><option timestep="0.004"/>
    <default><geom condim="6"/><joint damping=".001"/></default>
    <worldbody><geom type="plane" size="9 9 .1"/><body pos="0 0 .05"><freejoint/>{body}</body></worldbody>
    <equality><joint joint1="steer_fl" joint2="steer_fr"/></equality>
    <actuator>{motors}<position joint="steer_fl" kp="2" ctrlrange="-.785 .785"/></actuator></mujoco>"""


@pytest.mark.parametrize("integrator", ["midpoint", "euler"])
def test_a_car_under_random_control_is_solved_with_bounded_forces(integrator):
    """Wheels are steered into the bumper, contacts in line with both axes: forces in that line move nothing, and are not to grow."""
    sim = stepper.Stepper(stepper.load(car()), num_envs=32, options=stepper.Options(integrator=integrator, tolerance=1e-6))
    rng, unsolved, most = np.random.default_rng(0), 0, 0.0
    for step in range(400):
        if step % 10 == 0:
            ctrl = rng.uniform([-1, -1, -0.785], [1, 1, 0.785], (32, 3))
        sim.step(ctrl)
        assert not np.any(sim.status & stepper.Status.NON_FINITE)
        unsolved += np.count_nonzero(sim.status & stepper.Status.NOT_CONVERGED)
        contacts = sim.contacts()
        most = max(most, np.abs(contacts["force"][sim.status[contacts["env"]] == stepper.Status.OK]).max(initial=0.0))
    assert unsolved / (32 * 400) <= 1e-3
    # What a residual of 1e-6 m/s leaves open of their work within a step, 4 ms 1e-6 m/s F, is less than the energy of the 5 kg at 1 m/s.
    assert most < 2.5 / (4e-3 * 1e-6)


# Scene 3: a box on an incline, a tenth of a degree to either side of the friction angle atan mu. Right answer: below it the box does not
# move at all; above it, it slides with a = g (sin theta - mu cos theta). MuJoCo creeps at 44 to 888 um/s at 10 degrees with mu 1.

MU = 0.5
NEAR = np.radians(0.1)
CRITICAL = float(np.arctan(MU))


def on_slope(theta: float, dt: float, choice: dict):
    """The box at rest on a plane of that slope."""
    return simulate(on_plane(BOX, MU, 0.05, theta), timestep=dt, **choice)


def acceleration(theta: float, steps: int, dt: float, choice: dict) -> float:
    """Mean over so many steps in one call, after the cold start is over; the way must be that of a constant acceleration."""
    sim = on_slope(theta, dt, choice)
    sim.step(nstep=100)
    place, speed, t = sim.qpos[:3], np.linalg.norm(sim.qvel[:3]), steps * dt
    sim.step(nstep=steps)
    gained = np.linalg.norm(sim.qvel[:3]) - speed
    # Exact for the midpoint rule; Euler's is half a step of the gained speed ahead.
    assert np.linalg.norm(sim.qpos[:3] - place) == pytest.approx(speed * t + gained * t / 2, rel=2 / steps)
    return gained / t


@every_dt
@every_choice
def test_below_the_friction_angle_nothing_moves_in_a_hundred_thousand_steps(dt, choice):
    """Nothing creeps: v = 0 to the rounding of g dt (1e-17 to 1e-15 m/s), once the warm start has converged."""
    # The four corners of the box share the load in many ways, and friction is nearly used up: from a cold start the solver may spend its
    # sweeps for a few steps. It then says so, and the box moves by no more than the residual of those steps.
    sim = on_slope(CRITICAL - NEAR, dt, choice)
    for _ in range(100):
        sim.step()
        # The residual is that of one corner; four make the body's velocity, each with up to 1 + mu of it.
        assert np.linalg.norm(sim.qvel[:3]) < 4 * (1 + MU) * max(sim.residual, 1e-15)
    start = sim.qpos
    sim.step(nstep=100_000)
    assert sim.status == 0
    assert np.abs(sim.qvel).max() < 1e-14
    assert np.abs(sim.qpos - start).max() < 1e-14 * 100_000 * dt


@every_choice
def test_below_the_friction_angle_nothing_moves_from_the_first_step(choice):
    """Given the sweeps: v = 0 to the tolerance, for every step from the cold start on."""
    sim = on_slope(CRITICAL - NEAR, 5e-3, choice | {"tolerance": 1e-13, "iterations": 100_000})
    for _ in range(20):
        sim.step()
        assert sim.status == 0
        assert np.linalg.norm(sim.qvel[:3]) < 1e-12


@every_dt
@every_choice
def test_above_it_the_box_accelerates_as_coulomb_says(dt, choice):
    """Once the warm start has converged, every step is solved to rounding; a is a thousandth of g, and carries a thousand times g's."""
    theta = CRITICAL + NEAR
    expected = G * (np.sin(theta) - MU * np.cos(theta))
    assert acceleration(theta, 100_000, dt, choice) == pytest.approx(expected, rel=1e-9)


# Large coefficients of friction: in hard contact those above 30 act as 30, for which stacked cubes settle at steps of 1 to 20 ms. The bound
# leaves torsional friction below it alone, and MuJoCo's contact law has no bound.

LARGEST = 30.0
"""Coefficient above which larger ones act as this one. Its cone has a half-angle of 88.1 degrees."""


def stack(friction: str, step: float, condim: int = 3) -> stepper.Model:
    """Two cubes of 10 cm on a plane, each tilted by a milliradian about another axis, so that they land on edges."""
    cube = '<freejoint/><geom type="box" size=".05 .05 .05" mass="1"/>'
    return stepper.load(
        f"""<mujoco><option timestep="{step}"/><default><geom friction="{friction}" condim="{condim}"/></default><worldbody>
        <geom type="plane" size="0 0 .1"/><body pos="0 0 .05" euler=".0573 0 0">{cube}</body>
        <body pos="0 0 .15" euler="0 .0573 0">{cube}</body></worldbody></mujoco>"""
    )


@every(precision=["f64", "f32"], step=[1e-3, 2e-3, 5e-3, 1e-2, 2e-2], friction=["1", "3", "10", "30", "1e9 1e9 1e9"])
def test_stacked_cubes_settle_at_every_friction(friction, step, precision):
    """Cubes that land on edges lie flat after a second, and move by less than 0.1 mm and 0.2 mrad in the next one."""
    # A residual of the default tolerance, 1e-4 m/s, at an edge 5 cm from the middle of a face is 2e-3 rad/s.
    sim = simulate(stack(friction, step), precision=precision, steps=round(1.0 / step))
    # Position correction leaves up to 0.01 mm per contact, thus 0.02 mm of the upper cube. Measured: up to 0.009 mm.
    np.testing.assert_allclose(sim.qpos[[2, 9]], [0.05, 0.15], atol=2.5e-5)
    # Measured: up to 9e-5 in f64, and 3.5e-4 in f32. At the largest friction, short steps bring the cubes to rest: up to 1e-8 and 3e-5.
    rests = friction in ("30", "1e9 1e9 1e9") and step <= 5e-3
    assert np.abs(sim.qvel).max() < ({"f64": 1e-6, "f32": 1e-4}[precision] if rests else 1e-3)
    before = sim.qpos.copy()
    sim.step(nstep=round(1.0 / step))
    np.testing.assert_allclose(sim.qpos, before, atol=1e-4)
    assert not sim.status & ~stepper.Status.OK, sim.status


@functools.cache
def sheared(friction: float, condim: int, precision: str) -> np.ndarray:
    """State of the stacked cubes 0.2 s after they were pushed sideways and turned: qpos, then qvel."""
    sim = stepper.Stepper(stack(f"{friction} {friction} {friction}", 5e-3, condim), precision=precision)
    sim.set_state(qvel=[0.3, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -0.2, 0.0, 0.0, 0.5, 0.0])
    sim.step(nstep=40)
    return np.concatenate([sim.qpos, sim.qvel])


@every(precision=["f64", "f32"], friction=[31.0, 100.0, 1e3, 1e6, 1e9], condim=[3, 4, 6])
def test_larger_friction_acts_as_friction_30(condim, friction, precision):
    """States are equal to the last bit, because the solver's cone is the same."""
    np.testing.assert_array_equal(sheared(friction, condim, precision), sheared(LARGEST, condim, precision))


@pytest.mark.parametrize("torsion", [0.01, 20.0])
def test_large_sliding_friction_leaves_torsional_friction_alone(torsion):
    """The torque that brakes a spinning ball is the torsional coefficient times the normal force, whatever the sliding coefficient."""
    spin = 100.0 if torsion < 1 else 2000.0
    for sliding in (0.5, 1e6):
        model = stepper.load(
            f"""<mujoco><default><geom friction="{sliding} {torsion} 0" condim="4"/></default><worldbody><geom type="plane" size="0 0 .1"/>
            <body name="ball" pos="0 0 .05"><freejoint/><geom type="sphere" size=".05" mass="1"/></body></worldbody></mujoco>"""
        )
        sim = simulate(model, qvel=[0, 0, 0, 0, 0, spin], steps=2)
        braking = torsion * 9.81 / model.body("ball").inertia[2]
        # One contact, whose forces are exact up to rounding.
        assert sim.qvel[5] == pytest.approx(spin - braking * 2 * sim.timestep, rel=1e-9)


def test_mujocos_law_keeps_large_friction():
    """The bound belongs to hard contact: by MuJoCo's law the coefficient 1e3 has another effect than 30."""
    positions = []
    for mu in (30, 1e3):
        sim = stepper.Stepper(stack(f"{mu}", 2e-3), options=stepper.Options(timestep=2e-3, contact="mujoco"))
        sim.set_state(qvel=[0.3, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -0.2, 0.0, 0.0, 0.5, 0.0])
        sim.step(nstep=20)
        positions.append(np.array(sim.qpos))
    assert (positions[0] != positions[1]).any()
