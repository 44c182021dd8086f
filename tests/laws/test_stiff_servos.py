"""Stiff servos and springs, h sqrt(k/m) from 0.5 to 100, and servos at the bounds of their force (scene 22 has the plain case).

They settle without oscillation that grows. Explicit springs need h^2 k/m < 4. Both implicit rules are unconditionally stable (Hairer &
Wanner, Solving Ordinary Differential Equations II, section IV.3): the midpoint rule conserves the energy of a spring without damper,
backward Euler's removes it. What is damped and not resolved dies out with either (crates/core/src/actuation/forces.rs).
"""

import numpy as np
import pytest
import stepper
from checks import every
from models import simulate
from numerics import slope
from scipy.linalg import expm
from stepper.actuators import PID, ActuatorModel, Drive

H, MASS = 2e-3, 0.7
RATIOS = [0.5, 1.9, 2.1, 10.0, 100.0]
DAMPING_RATIOS = [0.0, 0.1, 1.0, 10.0]
IMPLICIT = ["midpoint", "implicit"]

SERVO = """<mujoco><option gravity="0 0 0"/><worldbody><body><joint name="rail" type="slide" axis="1 0 0" {joint}/>
  <inertial pos="0 0 0" mass="{mass}" diaginertia=".1 .1 .1"/></body></worldbody><actuator>{actuator}</actuator></mujoco>"""
TENDON = """<mujoco><option gravity="0 0 0"/><worldbody>
  <body><joint name="a" type="slide" axis="1 0 0"/><inertial pos="0 0 0" mass="1" diaginertia=".1 .1 .1"/>{open}
  <body><joint name="b" type="slide" axis="1 0 0"/><inertial pos="0 0 0" mass="2" diaginertia=".1 .1 .1"/></body>{close}</worldbody>
  <tendon><fixed name="t"><joint joint="a" coef="1"/><joint joint="b" coef="-.7"/></fixed></tendon>
  <actuator><position tendon="t" kp="{kp}" kv="{kv}"/></actuator></mujoco>"""
LAWS = {"hard": ("midpoint", "implicit", "euler", "rk4"), "mujoco": ("euler", "implicitfast", "rk4")}


def servo(ratio: float, zeta: float, integrator: str):
    """A position servo with h sqrt(k/m) = ratio and a damping ratio zeta, asked to go to 0."""
    kp = MASS * (ratio / H) ** 2
    kv = 2 * zeta * np.sqrt(kp * MASS)
    actuator = f'<position joint="rail" kp="{kp}" kv="{kv}"/>'
    return simulate(SERVO.format(mass=MASS, joint="", actuator=actuator), timestep=H, integrator=integrator), kp


def spring(k: float, d: float, integrator: str):
    """The same as a passive joint."""
    return simulate(SERVO.format(mass=MASS, joint=f'stiffness="{k}" damping="{d}"', actuator=""), timestep=H, integrator=integrator)


def energy(kp: float, q: float, v: float) -> float:
    return (kp * q**2 + MASS * v**2) / 2


def added_inertia(ratio: float, zeta: float, integrator: str) -> float:
    """Inertia beyond its mass with which the midpoint rule is contractive for a damped spring."""
    # The step takes k at the mean position; d at the mean velocity, and s/2 d times its change; the damping e = 3/2 s h k at the velocity
    # after it, which is the mean and half of the change. Times the mean velocity: with m + h (s d + e) / 2 the energy falls by h (d + e)
    # v_mean^2.
    if integrator != "midpoint":
        return 0.0
    kp = MASS * (ratio / H) ** 2
    kv = 2 * zeta * np.sqrt(kp * MASS)
    share = H * kv / (6 * MASS + H * kv)
    return H * (share * kv + 1.5 * share * H * kp) / 2


@every(integrator=IMPLICIT, zeta=DAMPING_RATIOS, ratio=RATIOS)
def test_energy_never_grows(ratio, zeta, integrator):
    """Both rules are contractive for a linear oscillator: no step gains energy beyond rounding, and damping ends the motion."""
    # Energy is that of the oscillator itself with backward Euler's rule and without damping; with damping, the midpoint rule's is that of
    # some more inertia, of the order h^2 of the mass where a step resolves the motion. A rule that takes positions at the mean velocity
    # turns a stiff spring's velocity around with all of its energy, or cannot be contractive in that energy itself.
    sim, kp = servo(ratio, zeta, integrator)
    sim.set_state(qpos=[0.3], qvel=[1.0])
    more = added_inertia(ratio, zeta, integrator)
    before = first = energy(kp, 0.3, 1.0) + more / 2
    for _ in range(2000):
        sim.step()
        now = energy(kp, sim.qpos[0], sim.qvel[0]) + more * sim.qvel[0] ** 2 / 2
        assert now <= before * (1 + 1e-12) + 1e-24 * first
        before = now
    if integrator == "implicit":
        # |amplification|^2 of backward Euler is 1/(1 + ratio^2) at the most.
        assert before <= max(first * (1 + ratio**2) ** -1000.0, 1e-20 * first)


@every(of=["servo", "spring"], zeta=[0.05, 0.2, 0.7, 1.0, 2.0], ratio=[0.5, 1.0, 2.0, 5.0, 20.0, 100.0])
def test_what_is_damped_dies_out_in_a_second(ratio, zeta, of):
    """A damped servo or spring that a step of 5 ms does not resolve does not ring: 200 steps after it was pulled by 0.1 it is at rest."""
    # As fast as the true motion to a tenth of its rate, or by a factor of ten in 20 steps where that is faster. On the way it never has
    # more energy than in the beginning.
    h = 5e-3
    kp = (ratio / h) ** 2
    kv = 2 * zeta * np.sqrt(kp)
    actuator, joint = (f'<position joint="rail" kp="{kp}" kv="{kv}"/>', "") if of == "servo" else ("", f'stiffness="{kp}" damping="{kv}"')
    sim = simulate(SERVO.format(mass=1, joint=joint, actuator=actuator), timestep=h, qpos=[0.1])
    rate = -np.roots([1, 2 * zeta * ratio, ratio**2]).real.max()
    # The true amplitude after n steps; 2 for its phase, the double eigenvalue of zeta = 1 has n + 1 besides.
    n = 200
    for _ in range(n):
        sim.step()
        amplitude = np.hypot(sim.qpos[0], sim.qvel[0] * h / ratio)
        assert amplitude <= 0.1 * (1 + 1e-12)
    bound = 2 * max(np.exp(-0.9 * rate * n), 10 ** (-n / 20))
    assert amplitude < 0.1 * bound * (n + 1 if zeta == 1.0 else 1)


@every(damping=[1e2, 1e4, 1e8], of=["servo", "joint"])
def test_a_stiff_damper_stops_what_it_brakes(of, damping):
    """H d / m up to 5e5: the velocity does not go back and forth, and a force moves it at force over damping."""
    actuator, joint = (f'<velocity joint="rail" kv="{damping}"/>', "") if of == "servo" else ("", f'damping="{damping}"')
    sim = simulate(SERVO.format(mass=1, joint=joint, actuator=actuator), timestep=5e-3, qvel=[1.0], steps=40)
    assert abs(sim.qvel[0]) < 1e-6
    sim.qfrc_applied[:] = 3.0
    sim.step(nstep=100)
    assert sim.qvel[0] == pytest.approx(3.0 / damping, rel=1e-9)


@pytest.mark.parametrize("zeta", [0.05, 0.7, 2.0])
def test_what_a_step_resolves_stays_of_second_order(zeta):
    """A servo at omega = 20/s against the exponential of its matrix: halving the step takes three quarters of the error."""
    omega, errors = 20.0, []
    kp, kv = omega**2, 2 * zeta * omega
    end = expm(0.2 * np.array([[0.0, 1.0], [-kp, -kv]])) @ [0.1, 0.3]
    for h in (4e-3, 2e-3, 1e-3):
        sim = simulate(SERVO.format(mass=1, joint="", actuator=f'<position joint="rail" kp="{kp}" kv="{kv}"/>'), timestep=h)
        sim.set_state(qpos=[0.1], qvel=[0.3])
        sim.step(nstep=round(0.2 / h))
        errors.append(np.hypot(omega * (sim.qpos[0] - end[0]), sim.qvel[0] - end[1]))
    assert abs(slope([4e-3, 2e-3, 1e-3], errors) - 2) < 0.2


@pytest.mark.parametrize("ratio", [5.0, 50.0])
def test_an_arm_of_stiff_servos_settles(ratio):
    """Six links whose servos are far stiffer than a step resolves, for the inertia of what hangs from each; one drives two joints."""
    h, text, made = 5e-3, "", ""
    for k in range(6):
        text += f'<body pos="{0.2 if k else 0} 0 0"><joint name="j{k}" axis="0 {k % 2} {1 - k % 2}"/>'
        text += '<geom type="capsule" size=".03" fromto="0 0 0 .2 0 0" contype="0" conaffinity="0"/>'
        kp = 0.02 * (6 - k) ** 3 * (ratio / h) ** 2
        made += f'<position joint="j{k}" kp="{kp}" kv="{0.2 * kp * h / ratio}"/>' if k < 4 else ""
    made += f'<position tendon="t" kp="{kp}" kv="{0.2 * kp * h / ratio}"/>'
    tendon = '<tendon><fixed name="t"><joint joint="j4" coef="1"/><joint joint="j5" coef=".7"/></fixed></tendon>'
    xml = f'<mujoco><option gravity="0 0 0"/><default><joint damping=".05"/></default><worldbody>{text}{"</body>" * 6}</worldbody>{tendon}'
    sim = simulate(f"{xml}<actuator>{made}</actuator></mujoco>", timestep=h, qpos=[0.1, -0.05, 0.1, -0.1, 0.05, 0.1], steps=400)
    # What no servo holds, the two last joints against each other, is braked by the joints' damping alone.
    assert np.abs(sim.qvel[:4]).max() < 1e-6
    assert np.abs(sim.qpos[:4]).max() < 1e-6


@every(ratio=RATIOS, of=["servo", "spring"])
def test_the_midpoint_rule_keeps_a_linear_springs_energy(of, ratio):
    """To rounding: 1e-16 in each of 10,000 steps, which add up as a walk or at worst as a sum."""
    kp = MASS * (ratio / H) ** 2
    sim = servo(ratio, 0.0, "midpoint")[0] if of == "servo" else spring(kp, 0.0, "midpoint")
    sim.set_state(qpos=[0.3], qvel=[1.0])
    sim.step(nstep=10_000)
    # q and v of a stiff spring differ in size by sqrt(k/m): each is rounded against the other.
    assert energy(kp, sim.qpos[0], sim.qvel[0]) == pytest.approx(energy(kp, 0.3, 1.0), rel=1e-11)


@every(integrator=IMPLICIT, ratio=RATIOS)
def test_a_servo_is_a_spring(ratio, integrator):
    """A position servo at zero and a joint with its stiffness and damping move alike to rounding."""
    sim, kp = servo(ratio, 0.3, integrator)
    other = spring(kp, 2 * 0.3 * np.sqrt(kp * MASS), integrator)
    for s in (sim, other):
        s.set_state(qpos=[0.3], qvel=[1.0])
        s.step(nstep=50)
    scale = np.hypot(sim.qpos[0] * ratio / H, sim.qvel[0])
    assert abs(sim.qvel[0] - other.qvel[0]) <= 1e-10 * scale + 1e-25
    assert abs(sim.qpos[0] - other.qpos[0]) * ratio / H <= 1e-10 * scale + 1e-25


@every(integrator=IMPLICIT, where=["servo", "joint"], ratio=RATIOS)
def test_a_bounded_servo_accelerates_with_its_bound_and_settles(where, ratio, integrator):
    """Far from its target it pushes with its bound exactly, near it it settles as without one."""
    bound, lag = 2.0, 0.2
    extra = f'forcerange="-{bound} {bound}"' if where == "servo" else ""
    joint = f'actuatorfrcrange="-{bound} {bound}"' if where == "joint" else ""
    kp = MASS * (ratio / H) ** 2
    actuator = f'<position joint="rail" kp="{kp}" kv="{lag * kp}" {extra}/>'
    sim = simulate(SERVO.format(mass=MASS, joint=joint, actuator=actuator), timestep=H, integrator=integrator)
    sim.step([1.0])
    assert sim.qvel[0] == pytest.approx(H * bound / MASS, rel=1e-9)
    sim.step([1.0], nstep=5000)
    # Beyond the acceleration it slides along kp x + kv v = 0, which ends as exp(-t / lag): e^-40 of a metre after 8 s. A servo that
    # chattered would keep the speed that its bound gives in half a step.
    assert abs(sim.qvel[0]) < 1e-9
    assert sim.qpos[0] == pytest.approx(1.0, abs=1e-9 + H**2 * bound / MASS)


@every(integrator=IMPLICIT, kind=["position", "velocity"])
def test_a_bounded_servo_presses_a_wall_with_its_bound(kind, integrator):
    """The wall carries what the servo may push, not what its stiffness would: in rest the contact's force is the bound."""
    bound = 3.0
    actuator = {"position": 'position joint="rail" kp="1e6" kv="1e3"', "velocity": 'velocity joint="rail" kv="1e5"'}[kind]
    text = f"""<mujoco><option gravity="0 0 0"/><worldbody><geom type="plane" size="1 1 1" euler="0 -90 0" pos=".5 0 0"/>
      <body><joint name="rail" type="slide" axis="1 0 0"/><geom type="sphere" size=".1" mass="{MASS}" friction="0 0 0"/></body></worldbody>
      <actuator><{actuator} forcerange="-{bound} {bound}"/></actuator></mujoco>"""
    sim = simulate(text, timestep=H, integrator=integrator)
    sim.step([1.0], nstep=2000)
    (contact,) = sim.contacts()
    assert contact["force"][0] == pytest.approx(bound, rel=1e-6)
    assert abs(sim.qvel[0]) < 1e-9


@pytest.mark.parametrize(("kp", "kv", "bound"), [(300.0, 20.0, 3.0), (600.0, 30.0, 5.0)])
def test_bounded_servos_of_a_chain_do_not_hold_one_another_at_their_bounds(kp, kv, bound):
    """Three coupled joints whose targets jump: at 2 ms and 1 ms they follow the motion at 31 us."""
    # A servo at its bound gives in to its neighbours, and neighbours leave their bounds when it does. The error at 2 ms is below a fortieth
    # of the motion of 1 rad, and at 1 ms below a tenth of that. A search that never releases a servo is wrong by 0.2 rad at 2 ms.
    links = "".join(
        f'<body pos="0 0 {0.2 if k else 0}"><joint name="j{k}" axis="0 1 0"/>'
        '<geom type="capsule" size=".03" fromto="0 0 0 0 0 .2" mass="1" contype="0" conaffinity="0"/>'
        for k in range(3)
    )
    made = "".join(f'<position joint="j{k}" kp="{kp}" kv="{kv}" forcerange="-{bound} {bound}"/>' for k in range(3))
    text = f'<mujoco><option gravity="0 0 0"/><worldbody>{links}{"</body>" * 3}</worldbody><actuator>{made}</actuator></mujoco>'

    def end(h: float):
        sim = simulate(text, timestep=h)
        for target in ([0.5, -0.7, 0.4], [-0.5, 0.6, 0.0]):
            sim.step(target, nstep=round(0.1 / h))
        return sim.qpos.copy()

    exact = end(2e-3 / 64)
    assert np.abs(end(2e-3) - exact).max() < 0.025
    assert np.abs(end(1e-3) - exact).max() < 0.0025


@every(integrator=IMPLICIT, ratio=RATIOS, chain=[True, False])
def test_a_servo_on_a_tendon_is_stable(chain, ratio, integrator):
    """On one chain the moment fits the matrix; across branches an added inertia takes its place. The spring's energy stays bounded."""
    kp = (ratio / H) ** 2
    parts = {"open": "", "close": "</body>"} if chain else {"open": "</body>", "close": ""}
    sim = simulate(TENDON.format(kp=kp, kv=0, **parts), timestep=H, integrator=integrator, qpos=[0.1, -0.2], qvel=[0.3, 0.1])

    def total() -> float:
        return sum(sim.energy()) + kp * (sim.qpos[0] - 0.7 * sim.qpos[1]) ** 2 / 2

    start = total()
    sim.step(nstep=2000)
    if chain and integrator == "midpoint":
        assert total() == pytest.approx(start, rel=1e-11)
    # Across branches the conserved energy is that of the added inertia, at most 1 + ratio^2 (1 + .7)^2 / 4 times the masses'.
    assert total() <= start * (1 + (1.7 * ratio) ** 2 / 2)


def test_what_feeds_energy_stays_explicit():
    """Negative stiffness must not take from the mass matrix, which would become singular at h^2 |k| / 4 = m."""
    k = 4 * MASS / H**2
    text = SERVO.format(mass=MASS, joint="", actuator=f'<general joint="rail" biastype="affine" biasprm="0 {k} 0"/>')
    for integrator in IMPLICIT:
        sim = simulate(text, timestep=H, integrator=integrator, qpos=[1e-6], steps=1)
        assert sim.status == stepper.Status.OK
        assert sim.qvel[0] == pytest.approx(1e-6 * H * k / MASS, rel=1e-6)  # The explicit force of a joint at rest, by both rules.


@every(integrator=IMPLICIT, stiffness=[1e2, 1e6, 1e10])
def test_ball_and_free_joint_springs_are_stable(stiffness, integrator):
    """A stiff rotation spring with a spin that its linearisation is blind to: kinetic energy stays below what there was."""
    for joint in ('type="ball"', 'type="free"'):
        text = f"""<mujoco><option gravity="0 0 0"/><worldbody><body><joint {joint} stiffness="{stiffness}"/>
          <geom type="box" size=".1 .2 .3"/></body></worldbody></mujoco>"""
        sim = simulate(text, timestep=H, integrator=integrator)
        qvel = np.array([0.1, 0.2, 0.3, 1.0, 2.0, -1.0])[-sim.model.nv :]
        sim.set_state(qvel=qvel)
        start = sum(sim.energy())
        for _ in range(1000):
            sim.step()
            # The rotation spring is linear to second order in the angle of a step.
            assert sum(sim.energy()) < start * 1.1


@pytest.mark.parametrize("integrator", ["midpoint", "euler", "implicit"])
def test_a_saturated_servo_beside_a_drive_is_resolved(integrator):
    """Euler's rule has implicit drives and explicit position servos: one that rests at its bound does not change."""
    link = '<body pos="0 {y} 0"><joint name="{name}" axis="0 1 0"/><geom type="capsule" size=".03" fromto="0 0 0 .3 0 0"/></body>'
    model = stepper.load(f"""<mujoco><worldbody>{link.format(y=0, name="a")}{link.format(y=1, name="b")}</worldbody>
      <actuator><motor name="a" joint="a"/><position name="b" joint="b" kp="50" kv="1" forcerange="-.1 .1"/></actuator></mujoco>""")
    drive = ActuatorModel({"a": Drive(servo=PID(kp=5, kd=0.1), limits=(-1, 1))})
    sim = stepper.Stepper(model, options=stepper.Options(integrator=integrator), actuators=drive)
    for _ in range(50):
        sim.step([0.1, 1.0])
        assert sim.status == stepper.Status.OK
        assert sim.actuator_saturation[1] == 1


@every(integrator=["midpoint", "euler", "implicit"], on_site=["motor", "position"])
def test_a_bounded_sum_contains_forces_on_sites(integrator, on_site):
    """A servo on the joint asks for 1 N m, an actuator on a site for 5 N m, and the bound of their sum is 2 N m."""
    site = 'site="s" gear="0 5 0 0 0 0"'
    actuator = f"<motor {site}/>" if on_site == "motor" else f'<position {site} kp="1" kv="1"/>'
    model = stepper.load(f"""<mujoco><option gravity="0 0 0"/><worldbody><body>
      <joint name="a" axis="0 0 1" actuatorfrcrange="-2 2"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 .5"/>
      <site name="s" pos="1 0 0"/></body></worldbody>
      <actuator><position joint="a" kp="1"/>{actuator}</actuator></mujoco>""")
    sim = stepper.Stepper(model, options=stepper.Options(integrator=integrator, timestep=H))
    sim.step([1.0, 1.0])
    # Rounding of the inverse inertia.
    assert sim.qvel[0] == pytest.approx(H * 2 / 0.5, rel=1e-14)
    assert sim.actuator_saturation.tolist() == [1, 1]


@pytest.mark.parametrize(("contact", "integrator"), [(law, name) for law, names in LAWS.items() for name in names])
def test_a_drive_at_its_limit_counts_as_saturated(contact, integrator):
    model = stepper.load("""<mujoco><option gravity="0 0 0"/><worldbody>
      <body><joint name="a" axis="0 0 1"/><geom size=".2" mass="1"/></body></worldbody>
      <actuator><motor name="m" joint="a"/></actuator></mujoco>""")
    drive = ActuatorModel({"m": Drive(servo=PID(kp=50, kd=0.1), limits=(-1, 1))})
    sim = stepper.Stepper(model, options=stepper.Options(contact=contact, integrator=integrator), actuators=drive)
    sim.step([1.0], nstep=10)
    assert sim.actuator_saturation.tolist() == [10]
