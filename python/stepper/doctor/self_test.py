"""Self-test of `stepper doctor`: the SHA-256 of a short trajectory with contacts, limits and servos.

The model is in `scene.stepper` and the expected SHA-256 in `digest.txt`; `python tests/helpers/self_test_scene.py` writes both files.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Literal

import numpy as np

from stepper._options import Options, Precision
from stepper._stepper import Model, Stepper

FOLDER = Path(__file__).parent
SCENE = FOLDER / "scene.stepper"
DIGEST = FOLDER / "digest.txt"
LONGEST = 120.0
"""Largest duration of the self-test at one CPU level, s. It takes 0.3 s on an idle machine."""
_ENVS = 19
"""Number of environments of the self-test. It is no multiple of any SIMD width, so that some lanes are empty."""
_CALLS, _STEPS = 50, 4


def trajectory_digest() -> str:
    """SHA-256 of the self-test's trajectories with both precisions and both contact laws, at the CPU level of this process."""
    model = Model.from_file(SCENE)
    digest = hashlib.sha256()
    precisions: tuple[Precision, ...] = ("f64", "f32")
    laws: tuple[Literal["hard", "mujoco"], ...] = ("hard", "mujoco")
    for precision in precisions:
        for law in laws:
            for bits in _trajectory(Stepper(model, _ENVS, precision=precision, options=Options(contact=law))):
                digest.update(bits)
    return digest.hexdigest()


def expected_digest() -> str:
    """Expected SHA-256 of the self-test's trajectories, from the file digest.txt."""
    return DIGEST.read_text(encoding="ascii").strip()


def digest_at(level: str) -> str:
    """SHA-256 of the self-test's trajectories, computed by a new process at a CPU level."""
    command = [sys.executable, "-P", "-c", f"from {__name__} import trajectory_digest; print(trajectory_digest())"]
    environment = os.environ | {"STEPPER_CPU_LEVEL": level}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=LONGEST, check=False)
    if done.returncode != 0:
        output = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
        raise RuntimeError(f"the self-test failed at CPU level {level}: {output[-1]}")
    return done.stdout.strip()


def _trajectory(sim: Stepper) -> Iterator[bytes]:
    """Yields the bytes of positions, velocities and residuals along a trajectory with fixed initial velocities and controls."""
    sim.set_state(qvel=np.linspace(-0.5, 0.5, _ENVS * sim.model.nv).reshape(_ENVS, -1))
    ctrl = np.linspace(-1.0, 1.0, _ENVS * sim.model.nu).reshape(_ENVS, -1)
    for _ in range(_CALLS):
        sim.step(ctrl, nstep=_STEPS)
        for array in (sim.qpos, sim.qvel, sim.residual):
            yield np.asarray(array).tobytes()
