"""Convergence of trajectories of robots in contact: errors with the time steps dt (that of the model), dt / 2 and dt / 4.

The reference solution has the time step dt / 64.

After 120 steps of random controls, 256 environments of each robot are simulated for 40 ms with constant controls. The error of an
environment is the largest error of a coordinate, m or rad. The table has the median, the third quartile and the ninth decile over
environments. To compare two builds, run the script with each; the references are computed once and stored in a folder.

    PYTHONPATH=old/python:benches python -m comparison.refinement out/references
    PYTHONPATH=new/python:benches python -m comparison.refinement out/references

With tolerances of the solver, the columns are these tolerances, in m/s, at the time step dt.

    PYTHONPATH=benches python -m comparison.refinement out/references --tolerances 1e-10 1e-6 1e-5 1e-4 1e-3
"""

import argparse
import sys
import warnings
from pathlib import Path

import numpy as np
from comparison.versions import MODELS
from numpy.typing import NDArray
from stepper import Model, Options, Stepper, load
from stepper.shared.machine import MissingPackageError, package_file

Array = NDArray[np.float64]

NUM_ENVS, WARM_UP, SECONDS = 256, 120, 0.04
REFINED = 64
"""Number of steps of the reference solution per time step of the model."""
REFERENCE_TOLERANCE = 1e-10
"""Tolerance of the solver in the reference solution, m/s."""
QUANTILES = (0.5, 0.75, 0.9)
"""Quantiles of the errors over environments in the table."""


def main() -> None:
    """Print a markdown table with the trajectory errors of each robot at three time steps."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("references", type=Path, help="folder of the references; missing ones are computed")
    parser.add_argument("--tolerances", type=float, nargs="+", metavar="TOLERANCE", help="tolerances of the solver, m/s")
    args = parser.parse_args()
    folder = args.references
    folder.mkdir(parents=True, exist_ok=True)
    warnings.simplefilter("ignore")
    columns = {f"dt / {parts}": (parts, None) for parts in (1, 2, 4)}
    if args.tolerances:
        columns = {f"{tolerance:g} m/s": (1, tolerance) for tolerance in args.tolerances}
    print(f"| robot | {' | '.join(columns)} |\n|---{'|---' * len(columns)}|")
    for package, file in MODELS:
        try:
            path = package_file(package, file, "to step its robots")
        except MissingPackageError as error:
            print(f"skipped {file}: {error}", file=sys.stderr)
            continue
        name = f"{package}/{Path(file).stem}"
        model = load(str(path), strict=False)
        kept = folder / f"{name.replace('/', '_')}.npz"
        if not kept.exists():
            qpos, qvel, ctrl, reached = reference(model)
            np.savez(kept, qpos=qpos, qvel=qvel, ctrl=ctrl, reached=reached)
        with np.load(kept) as there:
            given = dict(there)
        cells = []
        for parts, tolerance in columns.values():
            reached = final_qpos(model, (given["qpos"], given["qvel"], given["ctrl"]), parts, tolerance)
            errors = np.abs(reached - given["reached"]).max(axis=1)
            cells.append(" ".join(f"{q:.2e}" for q in np.quantile(errors, QUANTILES)))
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


def reference(model: Model) -> tuple[Array, Array, Array, Array]:
    """Inputs and reference solution of the comparison for all environments of a model.

    Returns:
        Initial qpos and qvel after random controls, constant controls, and final qpos of the reference.
    """
    low, high = np.nan_to_num(np.asarray(model.actuator_ctrlrange), neginf=-1.0, posinf=1.0).T
    sim, rng = Stepper(model, NUM_ENVS), np.random.default_rng(1)
    for _ in range(WARM_UP):
        sim.step(rng.uniform(low, high, (NUM_ENVS, len(low))))
    given = np.array(sim.qpos), np.array(sim.qvel), rng.uniform(low, high, (NUM_ENVS, len(low))) / 2
    return *given, final_qpos(model, given, REFINED, REFERENCE_TOLERANCE)


def final_qpos(model: Model, given: tuple[Array, Array, Array], parts: int, tolerance: float | None) -> Array:
    """Final positions, (num_envs, nq), from given initial states and controls."""
    (qpos, qvel, ctrl), dt = given, float(model.timestep)
    steps = max(4, round(SECONDS / dt))
    sim = Stepper(model, NUM_ENVS, options=Options(timestep=dt / parts, tolerance=tolerance))
    sim.set_state(qpos=qpos, qvel=qvel)
    sim.step(ctrl, nstep=steps * parts)
    return np.array(sim.qpos)


if __name__ == "__main__":
    main()
