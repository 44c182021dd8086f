"""Wheels: cylinders with torsional and rolling friction, on a floor, steered, and jammed between axle and body."""

import numpy as np
import pytest
import stepper
from stepper import Options, Status


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
    sim = stepper.Stepper(stepper.load(car()), num_envs=32, options=Options(integrator=integrator, tolerance=1e-6))
    rng, unsolved, most = np.random.default_rng(0), 0, 0.0
    for step in range(400):
        if step % 10 == 0:
            ctrl = rng.uniform([-1, -1, -0.785], [1, 1, 0.785], (32, 3))
        sim.step(ctrl)
        assert not np.any(sim.status & Status.NON_FINITE)
        unsolved += np.count_nonzero(sim.status & Status.NOT_CONVERGED)
        contacts = sim.contacts()
        most = max(most, np.abs(contacts["force"][sim.status[contacts["env"]] == Status.OK]).max(initial=0.0))
    assert unsolved / (32 * 400) <= 1e-3
    # What a residual of 1e-6 m/s leaves open of their work within a step, 4 ms 1e-6 m/s F, is less than the energy of the 5 kg at 1 m/s.
    assert most < 2.5 / (4e-3 * 1e-6)
