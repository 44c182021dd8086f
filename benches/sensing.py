"""What sensors cost: the time of a humanoids' step with them over the time without, one markdown table.

dm_control's humanoid has the 66 readings of its file (IMU, forces and torques at the joints of the legs, touch); "with joints" adds
position and velocity of all joints and an orientation. Batches take turns along the same random controls, in one process on one core;
processor time; the median over turns counts. See docs/sensors.md.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from stepper import Model, SensorModel, Stepper, Transfer, load
from stepper._crowd import Array
from stepper._demo import Plan, humanoid_path, random_control
from stepper._machine import one_core, provenance, require

NOISE = Transfer(noise_std=0.01)
FULL = Transfer(
    scale_std=0.01, misalignment_std=0.01, bias_std=0.01, drift_std=0.01, drift_time=10.0, noise_density=1e-3, quantum=1e-3,
    limits=(-1e3, 1e3), period=0.005, delay=0.01, jitter=0.002, dropout=0.01,
)  # fmt: skip
TURNED = Transfer(
    bias_std=0.01, drift_std=0.01, drift_time=10.0, noise_density=1e-3, quantum=1e-3, period=0.005, delay=0.01, jitter=0.002, dropout=0.01
)
"""The same without scale, misalignment and limits, which unit quaternions cannot have."""

Read = Callable[[Stepper], Any]


def nothing(_sim: Stepper) -> None:
    """Nobody reads."""


def observe(sim: Stepper) -> Array:
    """The readings, as a policy takes them."""
    return sim.observation


CASES: dict[str, tuple[SensorModel | None, Read]] = {
    "nothing is read": (None, nothing),
    "ideal, read": (None, observe),
    "noise alone, read": (SensorModel(default=NOISE), observe),
    "everything, read": (SensorModel({"attitude": TURNED}, default=FULL), observe),
}


def with_joints() -> Model:
    """The humanoid with encoders and an orientation besides the sensors of its file."""
    mujoco = require("mujoco", "to add sensors to the humanoid")
    spec = mujoco.MjSpec.from_file(humanoid_path())
    objects, kinds = mujoco.mjtObj, mujoco.mjtSensor
    for joint in spec.joints:
        if joint.type == mujoco.mjtJoint.mjJNT_HINGE:
            for word, kind in (("pos", kinds.mjSENS_JOINTPOS), ("vel", kinds.mjSENS_JOINTVEL)):
                spec.add_sensor(name=f"{joint.name}_{word}", type=kind, objtype=objects.mjOBJ_JOINT, objname=joint.name)
    spec.add_sensor(name="attitude", type=kinds.mjSENS_FRAMEQUAT, objtype=objects.mjOBJ_XBODY, objname="torso")
    return load(spec.compile())


def measure(model: Model, plan: Plan, cases: dict[str, tuple[SensorModel | None, Read]], precision: str) -> dict[str, list[float]]:
    """Microseconds per step and environment of every turn, by case."""
    sims = {name: Stepper(model, plan.num_envs, sensors=sensors, precision=precision) for name, (sensors, _) in cases.items()}
    control = random_control(humanoid_path(), plan)
    times: dict[str, list[float]] = {name: [] for name in cases}
    for begin in range(0, plan.steps, plan.chunk):
        for name, sim in sims.items():
            read = cases[name][1]
            start = time.process_time()
            for k in range(begin, min(begin + plan.chunk, plan.steps)):
                sim.step(control[k // plan.hold])
                read(sim)
            times[name].append(1e6 * (time.process_time() - start) / (plan.chunk * plan.num_envs))
    return times


def main() -> None:
    """Reads the arguments, measures, prints."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--num-envs", type=int, default=128, help="humanoids; default: 128")
    parser.add_argument("--steps", type=int, default=1000, help="steps of random control; default: 1000")
    args = parser.parse_args()
    plan = Plan(num_envs=args.num_envs, steps=args.steps)
    with one_core():
        print("| humanoid | readings | precision | sensors | us a step | over nothing | over ideal |\n|---|---|---|---|---|---|---|")
        for title, model in (("of the file", load(Path(humanoid_path()))), ("with joints", with_joints())):
            named = {"attitude"} <= set(model.sensor_names)
            cases = CASES if named else CASES | {"everything, read": (SensorModel(default=FULL), observe)}
            for precision in ("f64", "f32"):
                times = {name: np.array(row) for name, row in measure(model, plan, cases, precision).items()}
                first, second = list(times.values())[:2]
                for name, row in times.items():
                    ratios = (f"{median(row / base) - 1:+.1%}" for base in (first, second))
                    print(f"| {title} | {model.nsensordata} | {precision} | {name} | {median(row):.2f} | {' | '.join(ratios)} |")
    machine = provenance()
    print(f"\n{plan.num_envs} humanoids, {plan.steps} steps; {machine['cpu']}, load {machine['load_average']}, {machine['versions']}")


if __name__ == "__main__":
    main()
