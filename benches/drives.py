"""Cost of drives (models of a servo, its motor and its delays): step time of a humanoid with and without a drive on each actuator.

Calls with and without drives alternate, and the reported times are medians over calls. The step time depends on the motion, so all
variants start each call from the same states. These states come from a run without drives, under random control.

    taskset -c 1 python benches/drives.py
"""

import argparse
import time
from dataclasses import replace
from statistics import median

import numpy as np
from stepper import ActuatorModel, Drive, Stepper, load
from stepper.actuators import PID, DCMotor
from stepper.lab.demo.race import humanoid_path

MOTOR = DCMotor(stall_torque=1.5, no_load_speed=1500.0, rotor_inertia=1e-6)
SERVO = PID(kp=0.001, ki=0.001, kd=0.0001, integral_limit=0.1)
SAMPLED = replace(SERVO, period=0.01)
CHAIN = Drive(delay=0.0073, lag=0.01, limits=(-0.8, 0.8), motor=MOTOR, servo=SAMPLED)
STAGES = {
    "none (again)": None,
    "delay": Drive(delay=0.0073),
    "lag": Drive(lag=0.01),
    "delay, lag, limits": Drive(delay=0.0073, lag=0.01, limits=(-0.8, 0.8)),
    "motor, torque": Drive(motor=MOTOR),
    "motor, voltage": Drive(motor=replace(MOTOR, control="voltage")),
    "PID at 100 Hz": Drive(servo=SAMPLED),
    "PID, continuous": Drive(servo=SERVO),
    "delay, lag, limits, motor": replace(CHAIN, servo=None),
    "the same, PID at 100 Hz": CHAIN,
    "the same, friction": replace(CHAIN, friction=0.005, motor=replace(MOTOR, efficiency=0.85)),
}
ROUGH = "MJCF's frictionloss"
"""Name of the table's row without drives but with dry friction of 0.3 N m on every hinge, for comparison."""


def main() -> None:
    """Print a markdown table with the relative step time of each kind of drive."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--num-envs", type=int, default=128)
    parser.add_argument("--calls", type=int, default=200)
    parser.add_argument("--nstep", type=int, default=5)
    parser.add_argument("--precision", default="f64")
    options = parser.parse_args()
    model = load(humanoid_path())
    n = options.num_envs
    rng = np.random.default_rng(0)
    controls = rng.uniform(-1, 1, (options.calls, n, model.nu))
    # Calls with and without drives alternate, and both start from the same state.
    plain = Stepper(model, n, precision=options.precision)
    states = []
    for ctrl in controls:
        states.append((plain.qpos, plain.qvel))
        plain.step(ctrl, nstep=options.nstep)
    print(f"{n} humanoids, {options.precision}, {options.calls} calls of {options.nstep} steps")
    print(f"{'drive on all actuators':<26}{'us/step':>10}{'ratio':>8}")
    rough = model.replace(dof_frictionloss=np.where(np.arange(model.nv) < 6, 0.0, 0.3))
    for name, drive in (*STAGES.items(), (ROUGH, None)):
        scene = rough if name == ROUGH else model
        driven = Stepper(scene, n, precision=options.precision, actuators=None if drive is None else ActuatorModel(default=drive))
        pairs: list[tuple[float, float]] = []
        for ctrl, (qpos, qvel) in zip(controls, states, strict=True):
            clock = []
            for sim in (plain, driven):
                sim.set_state(qpos, qvel)
                start = time.process_time()
                sim.step(ctrl, nstep=options.nstep)
                clock.append((time.process_time() - start) / n / options.nstep * 1e6)
            pairs.append((clock[0], clock[1]))
        late = pairs[options.calls // 4 :]  # The humanoids have fallen by then.
        print(f"{name:<26}{median(b for _, b in late):>10.2f}{median(b / a for a, b in late):>8.3f}", flush=True)


if __name__ == "__main__":
    main()
