"""Accuracy and time of `Stepper.linearize`, for docs/benchmarks/derivatives.md. Uses one process on one pinned core.

Usage:

    python benches/derivatives.py                 # all tables
    python benches/derivatives.py agreement time  # some of: agreement, implicit, smoothness, horizon, time, effort
"""

import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Literal

import mujoco
import numpy as np
import stepper
from numpy.typing import NDArray
from stepper import Options
from stepper.derivatives import Linearization, rollout
from stepper.derivatives.copies import nominal_of, parts_of
from stepper.derivatives.linearize import TOLERANCE
from stepper.derivatives.perturbations import blocks_of, stencil_of
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


def noise(sim: stepper.Stepper, lin: Linearization) -> Array:
    """Noise of an entry of the finite-difference matrices A and B of `linearize`, (num_envs,).

    The noise is four times the sum of solver residual and rounding of the velocities, divided by the difference step.
    """
    floor: Array = 4.0 * (lin.residual + 2.0**-52 * np.maximum(np.abs(sim.qvel).max(axis=1), 1.0)) / lin.step
    return floor


def agreement() -> None:
    """Print the fraction of entries of A and B of `linearize` that do not change if the difference step is halved.

    An entry agrees if its values with the whole and with half the difference step are equal within a tolerance. The tolerance is twice the
    noise plus 1e-6 of the largest entry of the same column and kind of rows: positions, velocities or activations. The table also has the
    fraction of columns near a kink (a change, such as of contacts or limits, at which a step has no derivative).
    """
    print("| robot | options | contacts | environments near a kink | columns near a kink | entries that agree | away from kinks |")
    print("|---|---|---|---|---|---|---|")
    for robot in ROBOTS:
        for law, options in SETTINGS.items():
            sim, ctrl = touching(robot, options, 24)
            one = sim.linearize(ctrl=ctrl)
            two = sim.linearize(ctrl=ctrl, step=0.5 * one.step)
            a, b = matrix(one), matrix(two)
            nv = sim.model.nv
            scale = np.concatenate(
                [
                    np.broadcast_to(np.abs(part).max(axis=1, keepdims=True, initial=0.0), part.shape)
                    for part in np.split(a, [nv, 2 * nv], axis=1)
                ],
                axis=1,
            )
            same = np.abs(a - b) <= 1e-6 * scale + 2.0 * noise(sim, one)[:, None, None]
            kinked = np.concatenate([one.kinks[name] for name in WRT], axis=1) != 0
            away = np.broadcast_to(~kinked[:, None], same.shape)
            shares = [one.near_kink.mean(), kinked.mean(), same.mean(), same[away].mean()]
            touch = len(sim.contacts()) / 24
            print(f"| {robot} | {law} | {touch:.1f} | {shares[0]:.0%} | {shares[1]:.1%} | {shares[2]:.2%} | {shares[3]:.2%} |", flush=True)


SMOOTH: dict[str, dict[str, Any]] = {
    "hard": {},
    "hard, stabilization none": {"stabilization": "none"},
    "hard, smooth at rest, midpoint": {"stabilization": "baumgarte", "baumgarte": 1.0, "slop": 0.0},
    "hard, smooth at rest, euler": {"stabilization": "baumgarte", "baumgarte": 1.0, "slop": 0.0, "integrator": "euler"},
    "mujoco": {"contact": "mujoco"},
}
"""Settings that the table of `smoothness` compares, by name: arguments of `Options`."""


def implicit(num_envs: int = 24) -> None:
    """Print the relative error of implicit derivatives, compared with extrapolated central differences of whole steps."""
    print("| robot | options | environments | columns away from kinks | error below max(1e-6, that of fd) | median | 99 % |")
    print("|---|---|---|---|---|---|---|")
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
            print(
                f"| {robot} | {law} | {own.implicit.mean():.0%} | {smooth.mean():.1%} | {good:.2%} "
                f"| {np.median(off[smooth]):.0e} | {np.quantile(off[smooth], 0.99):.0e} |",
                flush=True,
            )


def smoothness(num_envs: int = 64, points: int = 33, width: float = 1e-6) -> None:
    """Print the roughness of a step: how far the next state deviates from a smooth function of the state.

    Along a random direction, q+ and v+ (positions and velocities after a step) are computed at points on both sides of a state. The
    roughness is their largest deviation from a parabola that is fitted to each side.
    """
    print("| robot | options | tolerance, m/s | q+: median | 90 % | v+: median | 90 % |")
    print("|---|---|---|---|---|---|---|")
    places = np.linspace(-width, width, points)
    sides = [slice(0, points // 2), slice(points // 2 + 1, points)]
    for robot in ("dm_control/walker", "dm_control/quadruped", "gymnasium/ant"):
        for name, fields in SMOOTH.items():
            for tolerance in (1e-6, 1e-13):
                sim, ctrl = touching(robot, Options(**fields), num_envs)
                model, rng, found = sim.model, np.random.default_rng(1), []
                for env in range(num_envs):
                    line = places[:, None] * rng.normal(size=2 * model.nv)
                    copies = stepper.Stepper(model, points, options=Options(**fields, tolerance=tolerance))
                    copies.set_state(sim.get_state(env=env))
                    qpos = model.integrate_pos(np.tile(sim.qpos[env], (points, 1)), line[:, : model.nv])
                    copies.set_state(qpos, sim.qvel[env] + line[:, model.nv :], keep_warmstart=True)
                    copies.step(ctrl[env])
                    middle = np.tile(copies.qpos[points // 2], (points, 1))
                    ends = np.hstack([model.differentiate_pos(middle, copies.qpos), copies.qvel - copies.qvel[points // 2]])
                    off = np.zeros((2,))
                    for side in sides:
                        basis = np.vander(places[side] / width, 3)
                        rest = np.abs(ends[side] - basis @ np.linalg.lstsq(basis, ends[side], rcond=None)[0])
                        off = np.maximum(off, [rest[:, : model.nv].max(), rest[:, model.nv :].max()])
                    found.append(off)
                median, high = np.quantile(found, [0.5, 0.9], axis=0)
                print(
                    f"| {robot} | {name} | {tolerance:.0e} | {median[0]:.0e} | {high[0]:.0e} | {median[1]:.0e} | {high[1]:.0e} |",
                    flush=True,
                )


def horizon(steps: int = 32) -> None:
    """Print how well two gradients agree for a hopper: backpropagation through `steps` steps, and finite differences of whole rollouts."""
    print("| options | gradient by | cosine: median | worst of 8 | norm error, median | below 0.999999 | of these near a kink |")
    print("|---|---|---|---|---|---|---|")
    for law, options in SETTINGS.items():
        sim, _ = touching("gymnasium/hopper", options, 8)
        rng = np.random.default_rng(1)
        ctrl = rng.uniform(-0.3, 0.3, (steps, 8, sim.model.nu))
        made = rollout(sim, ctrl)
        weights = np.zeros_like(made.qpos)
        weights[-1] = rng.normal(size=sim.model.nq)
        speeds = np.zeros_like(made.qvel)
        speeds[-1] = rng.normal(size=sim.model.nv)
        found = made.vjp(qpos=weights, qvel=speeds)
        whole = by_whole_rollouts(sim, ctrl, weights[-1], speeds[-1])
        pairs = {
            "controls": (found.ctrl.transpose(1, 0, 2).reshape(8, -1), whole[0]),
            "first state": (np.hstack([found.qpos, found.qvel]), whole[1]),
        }
        for what, (ours, theirs) in pairs.items():
            lengths = np.linalg.norm(ours, axis=1), np.linalg.norm(theirs, axis=1)
            cosine = (ours * theirs).sum(axis=1) / (lengths[0] * lengths[1])
            length = np.median(np.abs(lengths[0] / lengths[1] - 1))
            parts = cosine < 0.999999
            kinked = int((parts & found.near_kink.any(axis=0)).sum())
            print(
                f"| {law} | {what} | {np.median(cosine):.9f} | {cosine.min():.6f} | {length:.1e} | {parts.sum()} | {kinked} |", flush=True
            )


def by_whole_rollouts(sim: stepper.Stepper, ctrl: Array, weights: Array, speeds: Array, h: float = 1e-6) -> tuple[Array, Array]:
    """Derivatives of a weighted sum of final positions and velocities, by central differences of whole rollouts.

    Args:
        sim: Stepper with the initial states.
        ctrl: Controls, (T, num_envs, nu).
        weights: Weights of the final positions in the sum, (num_envs, nq).
        speeds: Weights of the final velocities, (num_envs, nv).
        h: Half width of the differences.

    Returns:
        Derivatives by the controls, (num_envs, T nu), and by the initial state, (num_envs, 2 nv).
    """
    model, n = sim.model, len(sim.qpos)
    options = Options(**{**vars(sim.options), "tolerance": 1e-13})
    size = ctrl.shape[0] * model.nu
    moves = h * np.concatenate([np.eye(size + 2 * model.nv), -np.eye(size + 2 * model.nv)])
    out = np.empty((n, len(moves)))
    for env in range(n):
        copies = stepper.Stepper(model, len(moves), options=options)
        copies.set_state(sim.get_state(env=env))
        state = moves[:, size:]
        qpos = model.integrate_pos(np.tile(sim.qpos[env], (len(moves), 1)), state[:, : model.nv])
        copies.set_state(qpos, sim.qvel[env] + state[:, model.nv :], keep_warmstart=True)
        controls = ctrl[:, env, None] + moves[:, :size].reshape(len(moves), len(ctrl), -1).transpose(1, 0, 2)
        end = copies.rollout(controls, fields=["qpos", "qvel"])
        out[env] = end["qpos"][-1] @ weights[env] + end["qvel"][-1] @ speeds[env]
    slopes = (out[:, : size + 2 * model.nv] - out[:, size + 2 * model.nv :]) / (2 * h)
    return slopes[:, :size], slopes[:, size:]


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
    fd = " in steps | mjd_transitionFD, us | speedup |"
    print(f"| robot | options | contacts | columns | step, us | central fd, us |{fd} one-sided fd, us |{fd}", end="")
    print(" implicit central, us | in steps | implicit one-sided, us | in steps |")
    print("|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|")
    per = 1e6 / num_envs
    for robot in ("gymnasium/ant", "dm_control/quadruped", "gymnasium/hopper"):
        more = {"hard, Euler": Options(integrator="euler"), "mujoco, implicitfast": Options(contact="mujoco", integrator="implicitfast")}
        for law, options in (SETTINGS | more).items():
            sim, ctrl = touching(robot, options, num_envs)
            state = sim.get_state()

            def back(sim: stepper.Stepper = sim, state: stepper.State = state) -> None:
                sim.set_state(state)

            def step(sim: stepper.Stepper = sim, ctrl: Array = ctrl) -> None:
                sim.step(ctrl)

            stepped = median_time(step, 51, back)
            sim.set_state(state)
            columns = 2 * sim.model.nv + sim.model.na + sim.model.nu
            line = f"| {robot} | {law} | {len(sim.contacts()) / num_envs:.1f} | {columns} | {stepped * per:.1f} |"
            for centered in (True, False):
                ours = linearization_time(sim, ctrl, "fd", centered)
                theirs = transition_time(robot, sim, ctrl, centered)
                line += f" {ours * per:.0f} | {ours / stepped:.0f} | {theirs * 1e6:.0f} | {theirs * num_envs / ours:.1f} |"
            for centered in (True, False):
                # Implicit derivatives do not exist for the integrator rk4.
                if sim.options.contact == "mujoco" and sim.options.integrator != "implicitfast":
                    line += " | |"
                    continue
                ours = linearization_time(sim, ctrl, "implicit", centered)
                line += f" {ours * per:.0f} | {ours / stepped:.0f} |"
            print(line, flush=True)


def linearization_time(sim: stepper.Stepper, ctrl: Array, method: Literal["fd", "implicit"], centered: bool) -> float:
    """Processor time of one call of `linearize`, for all environments, s: median of nine calls."""
    return median_time(lambda: sim.linearize(ctrl=ctrl, method=method, centered=centered), 9)


def effort(num_envs: int = 32) -> None:
    """Print the time of a step in finite differences, and the fraction of this time that the contact solver takes.

    The fraction follows from the time of steps whose solver stops after one iteration. The column "warm-started" has the number of solver
    iterations if the solver starts from the solution of the unperturbed step.
    """
    print("| robot | options | step, us | sweeps, Newton steps | warm-started | step with one iteration, us | share of the solver |")
    print("|---|---|---|---|---|---|---|")
    for robot in ("gymnasium/ant", "dm_control/quadruped", "gymnasium/hopper"):
        for law, options in SETTINGS.items():
            times, counts = [], []
            for hurried in (False, True):
                sim, ctrl = touching(robot, options, num_envs)
                source = stepper.Stepper(sim.model, num_envs, options=replace(options, iterations=1, solver="pgs") if hurried else options)
                source.set_state(sim.get_state())
                blocks = blocks_of(sim.model, WRT)
                nominal = nominal_of(source, ctrl, blocks)
                stencil = stencil_of(sim.model, blocks, nominal.fields, step=1e-6, levels=1, centered=True)
                part = next(iter(parts_of(source, nominal, blocks, stencil, 1.0 if hurried else TOLERANCE)))
                copies, state = part.sim, part.sim.get_state()

                def again(copies: stepper.Stepper = copies, state: stepper.State = state, ctrl: Array = part.ctrl) -> float:
                    copies.set_state(state)
                    begin = time.thread_time()
                    copies.step(ctrl)
                    return time.thread_time() - begin

                again()
                times.append(float(np.median([again() for _ in range(15)])) / len(part.ctrl) * 1e6)
                counts.append(mean_effort(copies))
                # Repeat the step from the same perturbed states, but with the impulses of the unperturbed step as warm start.
                solved, where = copies.get_state(), np.arange(len(part.ctrl)) // part.count
                copies.set_state(state)
                before = [np.array(getattr(copies, name)) for name in ("qpos", "qvel", "act")]
                copies.set_state(solved)
                for env in range(where[-1] + 1):
                    copies.set_state(copies.get_state(env=env * part.count), envs=where == env)
                copies.set_state(before[0], before[1], act=before[2], keep_warmstart=True)
                copies.step(part.ctrl)
                counts.append(mean_effort(copies))
            whole, hurried_time = times
            print(
                f"| {robot} | {law} | {whole:.1f} | {counts[0][0]:.1f}, {counts[0][1]:.1f} | {counts[1][0]:.1f}, {counts[1][1]:.1f} "
                f"| {hurried_time:.1f} | {1 - hurried_time / whole:.0%} |",
                flush=True,
            )


def mean_effort(copies: stepper.Stepper) -> tuple[float, float]:
    """Mean numbers of the solver's Gauss-Seidel iterations and of its Newton steps in the last step, over all environments."""
    newton_steps = float(np.asarray(copies.newton_steps).mean())
    return float(np.asarray(copies.iterations).mean()) - newton_steps, newton_steps


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
    parts: dict[str, Callable[[], None]] = {
        "agreement": agreement,
        "implicit": implicit,
        "smoothness": smoothness,
        "horizon": horizon,
        "time": cost,
        "effort": effort,
    }
    with one_core():
        print(f"{cpu_name()}, CPU level {cpu_levels()[-1]}, MuJoCo {mujoco.__version__}\n")
        for part in sys.argv[1:] or parts:
            parts[part]()
            print()
