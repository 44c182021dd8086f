"""Accuracy and time of `Stepper.linearize`, for docs/benchmarks/derivatives.md. Uses one process on one pinned core.

Usage:

    python benches/derivatives.py                # all tables
    python benches/derivatives.py implicit   # one of: implicit, time
"""

import sys
import time
import warnings
from collections.abc import Callable
from functools import partial
from typing import Any, Literal

import mujoco
import numpy as np
import stepper
from numpy.typing import NDArray
from sections import Table
from stepper import Options
from stepper.derivatives import Linearization
from stepper.doctor import cpu_levels
from stepper.shared.machine import cpu_name, one_core, package_file

Array = NDArray[np.float64]

FOLDERS = {"gymnasium": "envs/mujoco/assets", "dm_control": "suite"}
ROBOTS = (
    *("gymnasium/ant", "gymnasium/half_cheetah", "gymnasium/hopper", "gymnasium/humanoid", "gymnasium/walker2d_v5"),
    *("dm_control/cheetah", "dm_control/hopper", "dm_control/humanoid", "dm_control/quadruped", "dm_control/walker"),
)
SETTINGS = {
    "hard": Options(),
    "hard, smooth at rest": Options(stabilization="baumgarte", baumgarte=1.0, slop=0.0, integrator="euler"),
    "mujoco": Options(contact="mujoco"),
}
WRT = ("qpos", "qvel", "act", "ctrl")


def path_of(robot: str) -> str:
    """MJCF file of a robot, "PACKAGE/NAME", in an installed package."""
    package, name = robot.split("/")
    return package_file(package, f"{FOLDERS[package]}/{name}.xml", "for its robots")


def touching(robot: str, options: Options, num_envs: int, amplitude: float = 0.3) -> tuple[stepper.Stepper, Array]:
    """Stepper with robots on the floor, and random controls for the next step.

    The robots have made 200 steps with random controls between -`amplitude` and `amplitude`, which changed every 20 steps.
    """
    model, rng = stepper.load(path_of(robot), strict=False), np.random.default_rng(0)
    sim = stepper.Stepper(model, num_envs, options=options)
    for _ in range(10):
        sim.step(rng.uniform(-amplitude, amplitude, (num_envs, model.nu)), nstep=20)
    return sim, rng.uniform(-amplitude, amplitude, (num_envs, model.nu))


def matrix(lin: Linearization) -> Array:
    """Derivative matrices A (by the state) and B (by the controls) of each environment, side by side: (num_envs, n, n + nu)."""
    return np.concatenate([lin.A, lin.B], axis=2)


def implicit(num_envs: int = 24) -> None:
    """Print the relative error of implicit derivatives, compared with extrapolated central differences of whole steps."""
    table = Table("robot", "options", "environments", "columns away from kinks", "error below max(1e-6, that of fd)", "median", "99 %")
    laws = {
        "split, Euler": Options(integrator="euler"),
        "split, implicit rule": Options(integrator="implicit"),
        "split, midpoint (default)": Options(),
        "hard, smooth at rest": SETTINGS["hard, smooth at rest"],
        "hard, no correction": Options(stabilization="none", integrator="euler"),
        "hard, midpoint": Options(stabilization="baumgarte", baumgarte=1.0, slop=0.0),
        "hard, implicit rule": Options(stabilization="baumgarte", baumgarte=1.0, slop=0.0, integrator="implicit"),
        "mujoco, Euler": Options(contact="mujoco", integrator="euler"),
        "mujoco, implicitfast": Options(contact="mujoco", integrator="implicitfast"),
    }
    for robot in ROBOTS:
        for law, options in laws.items():
            sim, ctrl = touching(robot, options, num_envs)
            own, differences = sim.linearize(ctrl=ctrl, method="implicit"), sim.linearize(ctrl=ctrl, extrapolate=True)
            a, b, nv = matrix(own), matrix(differences), sim.model.nv
            largest = [np.maximum(np.abs(b[:, rows]).max(axis=1), 1.0) for rows in (slice(0, nv), slice(nv, None))]
            apart = [np.abs(a - b)[:, rows].max(axis=1) for rows in (slice(0, nv), slice(nv, None))]
            off = np.max([d / size for d, size in zip(apart, largest, strict=True)], axis=0)
            error = np.concatenate([differences.errors[name] for name in WRT], axis=-1).max(axis=1)
            # Kinks that either method detects. Finite differences miss the end of a contact's damping, if equalities move the contact.
            kinks = np.concatenate([differences.kinks[name] | own.kinks[name] for name in WRT], axis=-1)
            smooth = (kinks == 0) & own.implicit[:, None]
            good = ((off < 1e-6) | (off < error))[smooth].mean()
            quantiles = (f"{off_quantile:.0e}" for off_quantile in np.quantile(off[smooth], (0.5, 0.99)))
            table.add(robot, law, f"{own.implicit.mean():.0%}", f"{smooth.mean():.1%}", f"{good:.2%}", *quantiles)


def median_time(call: Callable[[], Any], count: int, before: Callable[[], Any] = lambda: None) -> float:
    """Processor time of a call, s: median of `count` calls, after a warm-up call. `before` runs before each call, untimed."""
    before()
    call()
    times = []
    for _ in range(count):
        before()
        begin = time.thread_time()
        call()
        times.append(time.thread_time() - begin)
    return float(np.median(times))


def cost(num_envs: int = 32) -> None:
    """Print the time of `linearize` for robots in contact, by finite differences (fd) and implicitly, compared with mjd_transitionFD."""
    fd = ("in steps", "mjd_transitionFD, us", "speedup")
    implicitly = ("implicit central, us", "in steps", "implicit one-sided, us", "in steps")
    table = Table("robot", "options", "contacts", "columns", "step, us", "central fd, us", *fd, "one-sided fd, us", *fd, *implicitly)
    per = 1e6 / num_envs
    for robot in ("gymnasium/ant", "dm_control/quadruped", "gymnasium/hopper"):
        more = {"hard, Euler": Options(integrator="euler"), "mujoco, implicitfast": Options(contact="mujoco", integrator="implicitfast")}
        for law, options in (SETTINGS | more).items():
            sim, ctrl = touching(robot, options, num_envs)
            state = sim.get_state()

            stepped = median_time(partial(sim.step, ctrl), 51, partial(sim.set_state, state))
            sim.set_state(state)
            columns = 2 * sim.model.nv + sim.model.na + sim.model.nu
            cells = [f"{len(sim.contacts()) / num_envs:.1f}", f"{columns}", f"{stepped * per:.1f}"]
            for centered in (True, False):
                ours = linearization_time(sim, ctrl, "fd", centered)
                theirs = transition_time(robot, sim, ctrl, centered)
                cells += [f"{ours * per:.0f}", f"{ours / stepped:.0f}", f"{theirs * 1e6:.0f}", f"{theirs * num_envs / ours:.1f}"]
            for centered in (True, False):
                # Implicit derivatives do not exist for the integrator rk4.
                if sim.options.contact == "mujoco" and sim.options.integrator != "implicitfast":
                    cells += ["", ""]
                    continue
                ours = linearization_time(sim, ctrl, "implicit", centered)
                cells += [f"{ours * per:.0f}", f"{ours / stepped:.0f}"]
            table.add(robot, law, *cells)


def linearization_time(sim: stepper.Stepper, ctrl: Array, method: Literal["fd", "implicit"], centered: bool) -> float:
    """Processor time of one call of `linearize`, for all environments, s: median of nine calls."""
    return median_time(lambda: sim.linearize(ctrl=ctrl, method=method, centered=centered), 9)


def transition_time(robot: str, sim: stepper.Stepper, ctrl: Array, centered: bool) -> float:
    """Processor time of mjd_transitionFD for one environment, s: median over environments, with the integrator implicitfast."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = mujoco.MjModel.from_xml_path(path_of(robot))
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    data, times = mujoco.MjData(model), []
    n = 2 * model.nv + model.na
    A, B = np.zeros((n, n)), np.zeros((n, model.nu))
    for env in range(len(ctrl)):
        data.qpos[:], data.qvel[:], data.ctrl[:] = sim.qpos[env], sim.qvel[env], ctrl[env]
        mujoco.mj_forward(model, data)
        begin = time.thread_time()
        mujoco.mjd_transitionFD(model, data, 1e-6, int(centered), A, B, None, None)
        times.append(time.thread_time() - begin)
    return float(np.median(times))


if __name__ == "__main__":
    warnings.filterwarnings("ignore")
    mujoco.set_mju_user_warning(lambda message: None)
    parts: dict[str, Callable[[], None]] = {"implicit": implicit, "time": cost}
    with one_core():
        print(f"{cpu_name()}, CPU level {cpu_levels()[-1]}, MuJoCo {mujoco.__version__}\n")
        for part in sys.argv[1:] or parts:
            parts[part]()
            print()
