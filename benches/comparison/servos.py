"""Step time and error of robots whose servos are at the bounds of their force.

The script measures the build of stepper that Python imports. The robots are the Go1 and the G1 of `many_contacts`, whose files are
downloaded to `--cache`, and arms of seven joints with the torque limits of a Panda. A factor multiplies all torque limits. Servo targets
are random and change every 40 ms. The error is that of the configuration after 0.2 s, in rad and m, compared with a simulation at a time
step of 31 us.

    PYTHONPATH=old/python:benches python benches/comparison/servos.py
    PYTHONPATH=new/python:benches python benches/comparison/servos.py
"""

import argparse
import time
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from many_contacts.assets import Assets
from many_contacts.scenes import unitree
from stepper import Options, Stepper, load

NUM_ENVS, COMPARED, STEPS, TURNS, CHANGE, END = 128, 32, 200, 5, 0.04, 0.2
"""Settings of the measurement.

The first four are the number of environments in the time measurement, that in the error measurement, steps per turn, and turns. The last
two are the time between two servo targets, and the simulated time at which errors are measured, s.
"""
EFFORTS = (87, 87, 87, 87, 12, 12, 12)
"""Torque limits of a Panda, N m."""


def arm(kp: float, kv: float, share: float) -> Any:
    """Arm of seven joints with position servos, without contacts.

    Args:
        kp: Stiffness of the servos, N m/rad.
        kv: Damping of the servos, N m s/rad.
        share: Torque limits of the arm as a fraction of a Panda's.
    """
    s = mujoco.MjSpec()
    s.option.timestep = 2e-3
    body = s.worldbody
    for k, effort in enumerate(EFFORTS):
        body = body.add_body(pos=[0, 0, 0.15 if k else 0.3])
        body.add_joint(name=f"j{k}", axis=[0, k % 2, 1 - k % 2], damping=[0.1, 0, 0], armature=0.05)
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[0.04, 0, 0], fromto=[0, 0, 0, 0, 0, 0.15], mass=3 - k / 3, contype=0, conaffinity=0
        )
        act = s.add_actuator(name=f"j{k}", target=f"j{k}", trntype=mujoco.mjtTrn.mjTRN_JOINT, biastype=mujoco.mjtBias.mjBIAS_AFFINE)
        act.gainprm[0], act.biasprm[1], act.biasprm[2] = kp, -kp, -kv
        act.forcelimited, act.forcerange = True, [-share * effort, share * effort]
    return s


def robot(walker: unitree.Walker, assets: Assets, share: float) -> Any:
    """Model specification (`MjSpec`) of a robot on a plane, with the fraction `share` of its torque limits."""
    s = unitree.spec(walker, assets)
    for act in s.actuators:
        act.forcerange = share * act.forcerange
    return s


def run(sim: Stepper, script: tuple[Any, Any], steps: int) -> tuple[Any, float]:
    """Positions of a batch after steps with prescribed servo targets, each for `CHANGE` s, and the processor time, s."""
    (start, targets), n, h = script, len(sim.qpos), sim.options.timestep
    assert h is not None
    sim.reset()
    sim.set_state(qpos=start[:n])
    begin = time.process_time()
    for i in range(steps):
        sim.step(targets[int(i * h / CHANGE + 1e-6) % len(targets)][:n])
    return sim.qpos.copy(), time.process_time() - begin


def main() -> None:
    """Print a markdown table with step time and error of each robot with bounded servos."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cache", type=Path, default=Path("out/corpus"), help="folder of the downloads [out/corpus]")
    parser.add_argument("--precision", default="f64", choices=("f64", "f32"))
    given = parser.parse_args()
    assets, rng = Assets(given.cache), np.random.default_rng(0)
    makers: dict[str, Callable[[], Any]] = {
        "arm, soft servos": lambda: arm(600, 50, 0.3),
        "arm, stiff servos": lambda: arm(1e5, 1e3, 0.3),
        "arm, unbounded": lambda: arm(600, 50, 1e6),
        **{
            f"{n}, {e:g} of its efforts": partial(robot, w, assets, e)
            for n, w in (("go1", unitree.GO1), ("g1", unitree.G1))
            for e in (1, 0.3)
        },
    }
    warnings.simplefilter("ignore")
    print("| robot | step, us | error at 2 ms | error at 1 ms |\n|---|---|---|---|")
    for name, make in makers.items():
        compiled = make().compile()
        walker = {"go1": unitree.GO1, "g1": unitree.G1}.get(name.split(",")[0])
        if walker:
            script = unitree.script(walker, compiled, NUM_ENVS, np.random.default_rng(0))
            inputs = script.qpos, script.control
        else:
            inputs = rng.uniform(-0.3, 0.3, (NUM_ENVS, compiled.nq)), rng.uniform(-2, 2, (30, NUM_ENVS, compiled.nu))
        model = load(compiled, strict=False)

        def sim(h: float, n: int, model: Any = model) -> Stepper:
            return Stepper(model, n, options=Options(timestep=h), precision=given.precision, threads=1)

        timed = sim(float(compiled.opt.timestep), NUM_ENVS)
        cost = np.median([run(timed, inputs, STEPS)[1] for _ in range(TURNS)]) / STEPS / NUM_ENVS * 1e6
        exact, _ = run(sim(2e-3 / 64, COMPARED), inputs, round(END / 2e-3) * 64)
        errors = [np.abs(run(sim(h, COMPARED), inputs, round(END / h))[0] - exact).max(axis=1).mean() for h in (2e-3, 1e-3)]
        print(f"| {name} | {cost:.2f} | {errors[0]:.1e} | {errors[1]:.1e} |", flush=True)


if __name__ == "__main__":
    main()
