"""Cost of sensors: step time of humanoids with sensors, divided by the step time without sensors, as a markdown table.

dm_control's humanoid has 66 readings (IMU, forces and torques at the leg joints, touch). The variant "with joints" adds position and
velocity of all joints and an orientation. All batches get the same random controls, in turns, in one process on one core. The
results are medians of processor time over turns. See docs/benchmarks/components.md.
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import get_args

import numpy as np
from stepper import Model, SensorModel, Stepper, Transfer, load
from stepper._options import Precision
from stepper.lab.demo.race import Plan, humanoid_path, random_control
from stepper.shared.machine import one_core, provenance, require

FULL = Transfer(
    scale_std=0.01, misalignment_std=0.01, bias_std=0.01, drift_std=0.01, drift_time=10.0, noise_density=1e-3, quantum=1e-3,
    limits=(-1e3, 1e3), period=0.005, delay=0.01, jitter=0.002, dropout=0.01,
)  # fmt: skip
TRANSFERS = {
    "sensors not read": None,
    "ideal": None,
    "a bias": Transfer(bias_std=0.01),
    "noise": Transfer(noise_std=0.01),
    "everything": FULL,
    "all but drift and noise": replace(FULL, drift_std=0.0, noise_density=None),
    "all but delay and jitter": replace(FULL, delay=0.0, jitter=0.0),
}


def equipped(model: Model, transfer: Transfer | None) -> SensorModel | None:
    """Sensor model with the errors of a transfer function on every sensor. The result is None if `transfer` is None.

    The orientation sensor, which measures a unit quaternion, gets no scale error, no misalignment and no limits.
    """
    if transfer is None:
        return None
    turned = replace(transfer, scale_std=0.0, misalignment_std=0.0, limits=None)
    return SensorModel({"attitude": turned} if "attitude" in model.sensor_names else {}, default=transfer)


def with_joints() -> Model:
    """Humanoid with added joint encoders and an orientation sensor."""
    mujoco = require("mujoco", "to add sensors to the humanoid")
    spec = mujoco.MjSpec.from_file(humanoid_path())
    objects, kinds = mujoco.mjtObj, mujoco.mjtSensor
    for joint in spec.joints:
        if joint.type == mujoco.mjtJoint.mjJNT_HINGE:
            for word, kind in (("pos", kinds.mjSENS_JOINTPOS), ("vel", kinds.mjSENS_JOINTVEL)):
                spec.add_sensor(name=f"{joint.name}_{word}", type=kind, objtype=objects.mjOBJ_JOINT, objname=joint.name)
    spec.add_sensor(name="attitude", type=kinds.mjSENS_FRAMEQUAT, objtype=objects.mjOBJ_XBODY, objname="torso")
    return load(spec.compile())


def measure(model: Model, plan: Plan, precision: Precision) -> dict[str, list[float]]:
    """Measure the time per environment step, us, for each variant of sensor errors in `TRANSFERS`."""
    sims = {
        name: Stepper(model, plan.num_envs, sensors=equipped(model, transfer), precision=precision) for name, transfer in TRANSFERS.items()
    }
    control = random_control(humanoid_path(), plan)
    times: dict[str, list[float]] = {name: [] for name in sims}
    for begin in range(0, plan.steps, plan.chunk):
        steps = range(begin, min(begin + plan.chunk, plan.steps))
        for name, sim in sims.items():
            start = time.process_time()
            for k in steps:
                sim.step(control[k // plan.hold])
                if name != "sensors not read":
                    sim.sensordata  # noqa: B018  (the read is timed)
            times[name].append(1e6 * (time.process_time() - start) / (len(steps) * plan.num_envs))
    return times


def main() -> None:
    """Measure the cost of sensors for all variants of the humanoid, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--num-envs", type=int, default=128, help="number of humanoids [128]")
    parser.add_argument("--steps", type=int, default=1000, help="number of steps with random controls [1000]")
    args = parser.parse_args()
    plan = Plan(num_envs=args.num_envs, steps=args.steps)
    with one_core():
        print("| humanoid | readings | precision | errors | us/step | vs not read | vs ideal |\n|---|---|---|---|---|---|---|")
        for title, model in (("of the file", load(Path(humanoid_path()))), ("with joints", with_joints())):
            for precision in get_args(Precision):
                times = {name: np.array(row) for name, row in measure(model, plan, precision).items()}
                first, second = list(times.values())[:2]
                for name, row in times.items():
                    ratios = (f"{median(row / base) - 1:+.1%}" for base in (first, second))
                    print(f"| {title} | {model.nsensordata} | {precision} | {name} | {median(row):.2f} | {' | '.join(ratios)} |")
    machine = provenance()
    print(f"\n{plan.num_envs} humanoids, {plan.steps} steps; {machine['cpu']}, load {machine['load_average']}, {machine['versions']}")


if __name__ == "__main__":
    main()
