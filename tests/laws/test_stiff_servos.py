"""Stiff servos and springs, h sqrt(k/m) from 0.5 to 100, and servos at the bounds of their force (scene 22 has the plain case).

They settle without oscillation that grows. Explicit springs need h^2 k/m < 4. Both implicit rules are unconditionally stable (Hairer &
Wanner, Solving Ordinary Differential Equations II, section IV.3): the midpoint rule conserves the energy of a spring without damper,
backward Euler's removes it.
"""

import numpy as np
import pytest
import stepper
from models import simulate

H, MASS = 2e-3, 0.7
RATIOS = [0.5, 1.9, 2.1, 10.0, 100.0]
DAMPING_RATIOS = [0.0, 0.1, 1.0, 10.0]
IMPLICIT = ["midpoint", "implicit"]

SERVO = """<mujoco><option gravity="0 0 0"/><worldbody><body><joint name="rail" type="slide" axis="1 0 0" {joint}/>
  <inertial pos="0 0 0" mass="{mass}" diaginertia=".1 .1 .1"/></body></worldbody><actuator>{actuator}</actuator></mujoco>"""


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


@pytest.mark.parametrize("integrator", IMPLICIT)
@pytest.mark.parametrize("zeta", DAMPING_RATIOS)
@pytest.mark.parametrize("ratio", RATIOS)
def test_energy_never_grows(ratio, zeta, integrator):
    """Both rules are contractive for a linear oscillator: no step gains energy beyond rounding, and damping ends the motion."""
    sim, kp = servo(ratio, zeta, integrator)
    sim.set_state(qpos=[0.3], qvel=[1.0])
    before = first = energy(kp, 0.3, 1.0)
    for _ in range(2000):
        sim.step()
        now = energy(kp, sim.qpos[0], sim.qvel[0])
        assert now <= before * (1 + 1e-12) + 1e-24 * first
        before = now
    if integrator == "implicit":
        # |amplification|^2 of backward Euler is 1/(1 + ratio^2) at the most.
        assert before <= max(first * (1 + ratio**2) ** -1000.0, 1e-20 * first)


@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("of", ["servo", "spring"])
def test_the_midpoint_rule_keeps_a_linear_springs_energy(of, ratio):
    """To rounding: 1e-16 in each of 10,000 steps, which add up as a walk or at worst as a sum."""
    kp = MASS * (ratio / H) ** 2
    sim = servo(ratio, 0.0, "midpoint")[0] if of == "servo" else spring(kp, 0.0, "midpoint")
    sim.set_state(qpos=[0.3], qvel=[1.0])
    sim.step(nstep=10_000)
    # q and v of a stiff spring differ in size by sqrt(k/m): each is rounded against the other.
    assert energy(kp, sim.qpos[0], sim.qvel[0]) == pytest.approx(energy(kp, 0.3, 1.0), rel=1e-11)


@pytest.mark.parametrize("integrator", IMPLICIT)
@pytest.mark.parametrize("ratio", RATIOS)
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


@pytest.mark.parametrize("integrator", IMPLICIT)
@pytest.mark.parametrize("where", ["servo", "joint"])
@pytest.mark.parametrize("ratio", RATIOS)
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
    # chattered would keep the speed that its bound gives in half a step. The midpoint rule damps what it cannot resolve slowly, by
    # (1 - x)/(1 + x) a step with x = h kv / 2 m, and no slower.
    x = H * lag * kp / (2 * MASS)
    slow = ((x - 1) / (x + 1)) ** 4000 if integrator == "midpoint" and x > 1 else 0.0
    assert abs(sim.qvel[0]) < 1e-9 + H * bound / (2 * MASS) * slow
    assert sim.qpos[0] == pytest.approx(1.0, abs=1e-9 + H**2 * bound / MASS)


@pytest.mark.parametrize("integrator", IMPLICIT)
@pytest.mark.parametrize("kind", ["position", "velocity"])
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


TENDON = """<mujoco><option gravity="0 0 0"/><worldbody>
  <body><joint name="a" type="slide" axis="1 0 0"/><inertial pos="0 0 0" mass="1" diaginertia=".1 .1 .1"/>{open}
  <body><joint name="b" type="slide" axis="1 0 0"/><inertial pos="0 0 0" mass="2" diaginertia=".1 .1 .1"/></body>{close}</worldbody>
  <tendon><fixed name="t"><joint joint="a" coef="1"/><joint joint="b" coef="-.7"/></fixed></tendon>
  <actuator><position tendon="t" kp="{kp}" kv="{kv}"/></actuator></mujoco>"""


@pytest.mark.parametrize("integrator", IMPLICIT)
@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("chain", [True, False])
def test_a_servo_on_a_tendon_is_stable(chain, ratio, integrator):
    """On one chain the moment fits the matrix; across branches an added inertia takes its place. The spring's energy stays bounded."""
    kp = (ratio / H) ** 2
    parts = {"open": "", "close": "</body>"} if chain else {"open": "</body>", "close": ""}
    sim = simulate(TENDON.format(kp=kp, kv=0, **parts), timestep=H, integrator=integrator)
    sim.set_state(qpos=[0.1, -0.2], qvel=[0.3, 0.1])

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
        sim = simulate(text, timestep=H, integrator=integrator)
        sim.set_state(qpos=[1e-6])
        sim.step()
        assert sim.status == stepper.Status.OK
        assert sim.qvel[0] == pytest.approx(1e-6 * H * k / MASS, rel=1e-6)  # The explicit force of a joint at rest, by both rules.


@pytest.mark.parametrize("integrator", IMPLICIT)
@pytest.mark.parametrize("stiffness", [1e2, 1e6, 1e10])
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
