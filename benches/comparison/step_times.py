"""Worker process of versions.py: measures step times of the build of stepper that it imports.

This script runs with old builds too, as it uses only features that the first version had.

Usage:

    python benches/comparison/step_times.py INTEGRATOR PRECISION NUM_ENVS
"""

import json
import os
import sys
import time
import warnings
from typing import Any

import numpy as np
from stepper import Options, Stepper, load

WARM_UP, STEPS = 50, 150
"""Numbers of steps of each measurement: steps before the time is taken, and timed steps."""


def main(integrator: str, precision: Any, num_envs: int) -> None:
    """Answer requests until standard input ends.

    A request is a line with the path of a model file and a seed, as a JSON list. The answer is a line with the time per environment step
    in us.
    """
    warnings.simplefilter("ignore")
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    settings: dict[str, Any] = {} if integrator == "default" else {"integrator": integrator}
    sims = {}
    for line in sys.stdin:
        path, seed = json.loads(line)
        if path not in sims:
            model = load(path, strict=False)
            sims[path] = (model, Stepper(model, num_envs, options=Options(**settings), precision=precision, threads=1))
        model, sim = sims[path]
        low, high = np.nan_to_num(np.asarray(model.actuator_ctrlrange), neginf=-1.0, posinf=1.0).T
        controls = np.random.default_rng(seed).uniform(low, high, (WARM_UP + STEPS, num_envs, len(low)))
        sim.reset()
        for control in controls[:WARM_UP]:
            sim.step(control)
        begin = time.process_time()
        for control in controls[WARM_UP:]:
            sim.step(control)
        print((time.process_time() - begin) / STEPS / num_envs * 1e6, flush=True)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]))
