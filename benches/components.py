"""Cost of parts of a step on one pinned core: sensors, drives, derived quantities and states.

    python benches/components.py                  # all tables
    python benches/components.py drives --quick   # rough figures of some: sensors, drives, quantities, states, batch

docs/benchmarks/components.md has all tables but `batch`, which is in docs/benchmarks/performance.md. Calls that a table compares take
turns, and the results are medians of processor time.
"""

import argparse
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any, get_args

import mujoco
import numpy as np
import stepper
from derivatives import median_time, path_of, touching
from sections import Table
from stepper import ActuatorModel, Drive, Model, Options, SensorModel, Stepper, Transfer, load
from stepper._options import Precision
from stepper.actuators import PID, DCMotor
from stepper.lab.demo.race import Plan, humanoid_path, random_control
from stepper.shared.machine import one_core, provenance

HUMANOIDS = 128
"""Number of humanoids with sensors or drives."""

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
"""Sensor errors of the table `sensors`."""


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
    spec = mujoco.MjSpec.from_file(humanoid_path())
    objects, kinds = mujoco.mjtObj, mujoco.mjtSensor
    for joint in spec.joints:
        if joint.type == mujoco.mjtJoint.mjJNT_HINGE:
            for word, kind in (("pos", kinds.mjSENS_JOINTPOS), ("vel", kinds.mjSENS_JOINTVEL)):
                spec.add_sensor(name=f"{joint.name}_{word}", type=kind, objtype=objects.mjOBJ_JOINT, objname=joint.name)
    spec.add_sensor(name="attitude", type=kinds.mjSENS_FRAMEQUAT, objtype=objects.mjOBJ_XBODY, objname="torso")
    return load(spec.compile())


def sensor_times(model: Model, plan: Plan, precision: Precision) -> dict[str, list[float]]:
    """Times per environment step, us, for each variant of sensor errors in `TRANSFERS`: one for each turn."""
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


def sensors(quick: bool) -> None:
    """Print the step time of humanoids with sensors, and its ratios to the times without reads and with ideal sensors.

    dm_control's humanoid has 66 readings (IMU, forces and torques at the leg joints, touch). The variant "with joints" adds position and
    velocity of all joints and an orientation. All batches get the same random controls.
    """
    plan = Plan(num_envs=HUMANOIDS, steps=100 if quick else 1000)
    table = Table("humanoid", "readings", "precision", "errors", "us/step", "vs not read", "vs ideal")
    for title, model in (("of the file", load(Path(humanoid_path()))), ("with joints", with_joints())):
        for precision in get_args(Precision):
            times = {name: np.array(row) for name, row in sensor_times(model, plan, precision).items()}
            unread, ideal = list(times.values())[:2]
            for name, row in times.items():
                ratios = (f"{median(row / base) - 1:+.1%}" for base in (unread, ideal))
                table.add(title, model.nsensordata, precision, name, f"{median(row):.2f}", *ratios)


MOTOR = DCMotor(stall_torque=1.5, no_load_speed=1500.0, rotor_inertia=1e-6)
SERVO = PID(kp=0.001, ki=0.001, kd=0.0001, integral_limit=0.1)
SAMPLED = replace(SERVO, period=0.01)
CHAIN = Drive(delay=0.0073, lag=0.01, limits=(-0.8, 0.8), motor=MOTOR, servo=SAMPLED)
DRIVES = {
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
"""Drives of the table `drives`."""
ROUGH = "MJCF's frictionloss"
"""Name of the table's row without drives but with dry friction of 0.3 N m on every hinge, for comparison."""
NSTEP = 5
"""Number of steps per call of the table `drives`."""


def drives(quick: bool) -> None:
    """Print the step time of humanoids with a drive on all actuators, and its ratio to the time without drives.

    The step time depends on the motion, so all variants start each call from the same states. These states come from a run without
    drives, under random control.
    """
    model, calls = load(humanoid_path()), 40 if quick else 160
    controls = np.random.default_rng(0).uniform(-1, 1, (calls, HUMANOIDS, model.nu))
    plain, states = Stepper(model, HUMANOIDS), []
    for ctrl in controls:
        states.append((plain.qpos, plain.qvel))
        plain.step(ctrl, nstep=NSTEP)
    table = Table("drive on all actuators", "us/step", "ratio")
    rough = model.replace(dof_frictionloss=np.where(np.arange(model.nv) < 6, 0.0, 0.3))
    for name, drive in (*DRIVES.items(), (ROUGH, None)):
        actuators = None if drive is None else ActuatorModel(default=drive)
        driven = Stepper(rough if name == ROUGH else model, HUMANOIDS, actuators=actuators)
        pairs: list[list[float]] = []
        for ctrl, (qpos, qvel) in zip(controls, states, strict=True):
            pairs.append([])
            for sim in (plain, driven):
                sim.set_state(qpos, qvel)
                start = time.process_time()
                sim.step(ctrl, nstep=NSTEP)
                pairs[-1].append((time.process_time() - start) / HUMANOIDS / NSTEP * 1e6)
        late = pairs[calls // 4 :]  # The humanoids have fallen by then.
        table.add(name, f"{median(b for _, b in late):.2f}", f"{median(b / a for a, b in late):.3f}")


ENVS, RAYS = 256, 187
"""Numbers of environments of the tables `quantities` and `states`, and of rays per environment."""


def quantities(quick: bool) -> None:
    """Print the times of mass matrix, forces, accelerations and rays after a change of the state, with those of `mj_multiRay`.

    The models are a humanoid of capsules on a plane, and a quadruped on a height field of 201 by 201 points.
    """
    count = 5 if quick else 31
    table = Table(
        *("", "mass_matrix, us", "qfrc_bias, us", "qacc_smooth, us", "inverse_dynamics, us", "rays, ns each", "mj_multiRay, ns each")
    )
    points = np.random.default_rng(0).uniform(-1, 1, (RAYS, 3)) * [0.8, 0.5, 0.0] + [0, 0, 2.0]
    down, geoms, distances = np.tile([0.0, 0.0, -1.0], (RAYS, 1)), np.empty(RAYS, np.int32), np.empty(RAYS)
    for robot in ("dm_control/humanoid", "dm_control/quadruped"):
        m = mujoco.MjModel.from_xml_path(path_of(robot))
        data = mujoco.MjData(m)
        mujoco.mj_forward(m, data)
        settings = (data, points[0], down.ravel(), None, 1, -1, geoms, distances, None, RAYS, 1e10)
        for precision in get_args(Precision):
            sim = Stepper(load(path_of(robot)), ENVS, threads=1, precision=precision)
            sim.step(nstep=5)
            zeros, state = np.zeros(sim.model.nv), sim.get_state()
            reads = (partial(getattr, sim, name) for name in ("qfrc_bias", "qacc_smooth"))
            calls: list[Callable[[], Any]] = [sim.mass_matrix, *reads, partial(sim.inverse_dynamics, zeros)]
            cells = [f"{1e6 * median_time(call, count, partial(sim.set_state, state)) / ENVS:.2f}" for call in calls]
            rays = median_time(partial(sim.rays, points, down), count) / ENVS, median_time(partial(mujoco.mj_multiRay, m, *settings), count)
            table.add(f"{robot}, {precision}", *cells, *(f"{1e9 * seconds / RAYS:.0f}" for seconds in rays))


def states(quick: bool) -> None:
    """Print the time to save, restore and copy states of single environments of quadrupeds, compared with the time of a step."""
    sim, ctrl = touching("dm_control/quadruped", Options(), ENVS)
    begin, kept = sim.get_state(), [sim.get_state(env) for env in range(ENVS)]
    sources = np.random.default_rng(0).integers(0, ENVS, ENVS)
    rows: dict[str, Callable[[], Any]] = {
        "a step": lambda: sim.step(ctrl),
        "a step of the first quarter": lambda: sim.step(ctrl, envs=np.arange(ENVS) < ENVS // 4),
        "a step of every fourth": lambda: sim.step(ctrl, envs=np.arange(ENVS) % 4 == 0),
        "sim.copy_state(sources) from random sources": lambda: sim.copy_state(sources),
        "sim.get_state(env) of each": lambda: [sim.get_state(env) for env in range(ENVS)],
        "sim.set_state(states) of all": lambda: sim.set_state(kept),
        "sim.get_state()": sim.get_state,
        "sim.set_state(kept)": lambda: sim.set_state(begin),
    }
    table = Table(f"{ENVS} environments", "us per environment")
    for name, call in rows.items():
        table.add(name, f"{1e6 * median_time(call, 5 if quick else 31, lambda: sim.set_state(begin)) / ENVS:.1f}")


def batch(quick: bool) -> None:
    """Print the time to save and restore the state of all quadrupeds of a batch, compared with the time of a step."""
    table = Table("environments", "state, bytes each", "step, us each", "get_state()", "set_state(state)", "set_state(qpos, qvel)")
    for num_envs in (1, 32) if quick else (1, 32, 1024):
        sim, ctrl = touching("dm_control/quadruped", Options(), num_envs)
        state, qpos, qvel = sim.get_state(), np.array(sim.qpos), np.array(sim.qvel)

        back = partial(sim.set_state, state)
        calls = (partial(sim.step, ctrl), back), (sim.get_state,), (back,), (partial(sim.set_state, qpos, qvel),)
        times = [median_time(call, 31, *before) for call, *before in calls]
        table.add(num_envs, f"{state.nbytes / num_envs:.0f}", *(f"{1e6 * each / num_envs:.2f}" for each in times))


def main() -> None:
    """Print some or all tables."""
    tables = {table.__name__: table for table in (sensors, drives, quantities, states, batch)}
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tables", nargs="*", choices=[*tables, []], help="tables to measure [all]")
    parser.add_argument("--quick", action="store_true", help="rough figures: a quarter of the calls or fewer")
    given = parser.parse_args()
    machine = provenance()
    print(f"{machine['cpu']}, CPU level {machine['cpu_level']}, load {machine['load_average']}, {machine['versions']}")
    with one_core(), warnings.catch_warnings():
        warnings.simplefilter("ignore", stepper.ModelWarning)
        for name in given.tables or tables:
            print()
            tables[name](given.quick)


if __name__ == "__main__":
    main()
