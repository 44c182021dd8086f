"""Accuracy of rollout gradients, compared with finite differences of whole rollouts, for docs/benchmarks/derivatives.md.

Usage:

    python benches/rollout_gradients.py                    # random scenes, then the models of all registered tasks
    python benches/rollout_gradients.py scenes --count 20  # the first twenty scenes
"""

import argparse
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
import stepper
import stepper.envs
from numpy.typing import NDArray
from sections import Table
from stepper import Options
from stepper.derivatives import UndeterminedDerivative, rollout
from stepper.derivatives.rollout import from_tangent, to_tangent

Array = NDArray[np.float64]

WIDTHS = (1e-4, 1e-5, 1e-6)
"""Half widths of the differences of whole rollouts, for coordinates in SI units."""

SAME = 0.01
"""Largest relative difference of two finite differences that count as equal.

A derivative agrees with a finite difference if the two differ by at most twice this fraction, plus twice `FLOOR`.

Over the largest width of the differences, the curvature of a stiff contact (1e4 / s^2) changes a derivative by 1 %. Gradient methods are
insensitive to such errors: Adam divides by the size of the gradient.
"""

FLOOR = 1e-3
"""Absolute error of a derivative that is negligible, as a fraction of the larger of two numbers.

The numbers are 1 and the largest derivative in the same environment by coordinates of the same kind. An error of this size rotates the
gradient by a thousandth of a radian. See `SAME` for its use.
"""

NOISE = 1e-5
"""Noise of a finite difference with the smallest of the `WIDTHS`, with a solver tolerance of 1e-13 m/s.

The noise is a fraction of the larger of two numbers: 1, and the largest derivative in the same environment by coordinates of the same kind.
"""

LAWS = {"hard": Options(tolerance=1e-13), "mujoco": Options(contact="mujoco", tolerance=1e-13)}
"""Options by contact law: the defaults, with the solver tolerance that `linearize` uses.

Gradients and finite differences then come from the same function.
"""

AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}

START = {"rest": 250, "sliding": 250, "impact": 0, "separation": 250}
"""Number of steps before the rollout begins, by kind of motion."""


@dataclass(frozen=True)
class Scene:
    """Initial state and controls of a rollout.

    Attributes:
        name: Motion and bodies of the scene.
        sim: Stepper at the first state.
        ctrl: Controls, (T, num_envs, nu).
        nstep: Simulation steps per control.
    """

    name: str
    sim: stepper.Stepper
    ctrl: Array
    nstep: int


def bodies_on_a_floor(seed: int, options: Options, steps: int = 15) -> Scene:
    """Random scene: one to three boxes, spheres and capsules with motors, which rest, slide, collide with the floor or leave it."""
    rng = np.random.default_rng(seed)
    motion = list(START)[seed % len(START)]
    kinds = [str(kind) for kind in rng.choice(["box", "sphere", "capsule"], size=rng.integers(1, 4))]
    parts, motors, height = [], [], 0.0
    for i, kind in enumerate(kinds):
        a, b, c = rng.uniform(0.05, 0.15, 3)
        size, up = {"box": (f"{a} {b} {c}", c), "sphere": (f"{a}", a), "capsule": (f"{a} {b}", a)}[kind]
        turn = ' euler="90 0 0"' if kind == "capsule" else ""
        # Half of the bodies that follow a box lie on the box. All other bodies lie next to the previous one.
        on_top = i > 0 and rng.random() < 0.5 and kinds[i - 1] == "box"
        height = height + up if on_top else up
        x = f"{0.5 * i}" if not on_top else f"{0.5 * (i - 1)}"
        joints = "".join(f'<joint name="{axis}{i}" type="slide" axis="{d}"/>' for axis, d in AXES.items())
        parts.append(
            f'<body pos="{x} 0 {height}">{joints}<joint type="ball"/>'
            f'<geom type="{kind}" size="{size}" mass="{rng.uniform(0.2, 2.0)}"{turn}/></body>'
        )
        motors += [f'<motor joint="{axis}{i}"/>' for axis in "xyz"]
        height += up
    friction = rng.uniform(0.2, 1.0)
    model = stepper.load(
        f'<mujoco><option timestep="0.004"/><default><geom friction="{friction} 0.005 0.0001"/></default><worldbody>'
        f'<geom type="plane" size="9 9 1"/>{"".join(parts)}</worldbody><actuator>{"".join(motors)}</actuator></mujoco>'
    )
    sim = stepper.Stepper(model, 1, options=options)
    if motion == "impact":
        # All bodies start above the floor or the body below, and collide within the rollout.
        qpos = np.array(sim.qpos)
        qpos[0, [7 * i + 2 for i in range(len(kinds))]] += rng.uniform(0.01, 0.04)
        sim.set_state(qpos)
    if START[motion]:
        sim.step(nstep=START[motion])
    qvel = np.array(sim.qvel)
    for i in range(len(kinds)):
        own = slice(6 * i, 6 * i + 3)
        if motion == "sliding":
            qvel[0, own][:2] += rng.uniform(-1, 1, 2)
        elif motion == "impact":
            qvel[0, own] += [*rng.uniform(-0.5, 0.5, 2), rng.uniform(-2.0, -0.5)]
        elif motion == "separation":
            qvel[0, own][2] += rng.uniform(0.05, 0.5)
    if motion != "rest":
        sim.set_state(qvel=qvel)
    push = 0.2 if motion == "rest" else 2.0
    return Scene(f"{motion}: {', '.join(kinds)}", sim, rng.normal(scale=push, size=(steps, 1, model.nu)), 2)


def robots(seed: int, model: stepper.Model, name: str, options: Options, *, num_envs: int = 2, steps: int = 10) -> Scene:
    """Scene with a robot after 200 steps with random controls, for a rollout with further random controls."""
    rng = np.random.default_rng(seed)
    sim = stepper.Stepper(model, num_envs, options=options)
    low, high = np.clip(model.actuator_ctrlrange, -1.0, 1.0).T
    middle, half = 0.5 * (low + high), 0.3 * 0.5 * (high - low)
    for _ in range(20):
        sim.step(middle + half * rng.uniform(-1, 1, (num_envs, model.nu)), nstep=10)
    return Scene(name, sim, middle + half * rng.uniform(-1, 1, (steps, num_envs, model.nu)), 2)


@dataclass
class Judged:
    """Results of comparing derivatives with finite differences of whole rollouts.

    Attributes:
        counts: Number of derivatives by nearness of a kink ("no kink" or "near a kink") and verdict, such as "agrees". At a kink, such as a
            change of contacts, a step has no derivative. The key ("refused", "refused") has those that `Rollout.vjp` refused to compute.
        worst: Descriptions of the derivatives that disagree.
    """

    counts: Counter[tuple[str, str]]
    worst: list[str]

    def row(self, kind: str) -> list[int]:
        """Numbers of derivatives: all, those with a reliable finite difference, those that agree with it, those of the wrong sign."""
        own = {verdict: count for (k, verdict), count in self.counts.items() if k == kind}
        judged = sum(own.get(v, 0) for v in ("agrees", "differs", "wrong sign"))
        return [sum(own.values()), judged, own.get("agrees", 0), own.get("wrong sign", 0)]


def directions(scene: Scene, rng: np.random.Generator, count: int) -> Iterator[tuple[str, Array, Array]]:
    """Yield random coordinates by which a rollout is differentiated, `count` of each kind: "qpos", "qvel" and "ctrl".

    A coordinate is a tuple of its kind, a displacement of the first state, (2 nv,), and a displacement of the controls, (T, nu). One entry
    of the two displacements is 1, and all others are 0.
    """
    nv, (T, _, nu) = scene.sim.model.nv, scene.ctrl.shape
    for _ in range(count):
        for kind, first in (("qpos", 0), ("qvel", nv)):
            state = np.zeros(2 * nv)
            state[first + rng.integers(nv)] = 1.0
            yield kind, state, np.zeros((T, nu))
        if nu:
            ctrl = np.zeros((T, nu))
            ctrl[rng.integers(T), rng.integers(nu)] = 1.0
            yield "ctrl", np.zeros(2 * nv), ctrl


def judge(scene: Scene, seed: int, into: Judged, count: int = 4) -> None:
    """Compare derivatives of a random function of the last state of a rollout with finite differences of whole rollouts."""
    sim, model, rng = scene.sim, scene.sim.model, np.random.default_rng(seed)
    n, nv = len(sim.qpos), model.nv
    made = rollout(sim, scene.ctrl, scene.nstep)
    moved, speed = rng.normal(size=(2, n, nv))
    last, fast = np.zeros_like(made.qpos), np.zeros_like(made.qvel)
    last[-1], fast[-1] = from_tangent(model, made.qpos[-1], moved), speed
    chosen = list(directions(scene, rng, count))
    try:
        found = made.vjp(qpos=last, qvel=fast)
    except UndeterminedDerivative as error:
        into.counts["refused", "refused"] += n * len(chosen)
        into.worst.append(f"{scene.name}: {error}")
        return
    by_state = np.concatenate([to_tangent(model, sim.qpos, found.qpos), found.qvel], axis=1)
    scale = {"qpos": np.abs(by_state[:, :nv]).max(axis=1), "qvel": np.abs(by_state[:, nv:]).max(axis=1)}
    scale["ctrl"] = np.abs(found.ctrl).max(axis=(0, 2), initial=0.0)
    for env in range(n):
        kinked = "near a kink" if found.near_kink[:, env].any() else "no kink"
        ends = differences(scene, env, chosen, (moved[env], speed[env]), made.qpos[-1, env])
        for (kind, state, ctrl), (central, sides) in zip(chosen, ends, strict=True):
            ours = float(by_state[env] @ state + (found.ctrl[:, env] * ctrl).sum())
            verdict = verdict_of(ours, central, sides, max(float(scale[kind][env]), 1.0))
            into.counts[kinked, verdict] += 1
            if verdict in ("differs", "wrong sign"):
                into.worst.append(f"{scene.name}, env {env}, by {kind} {np.argmax(state)}, {kinked}: {ours:.6g}, differences {central}")


def verdict_of(ours: float, central: Array, sides: Array, scale: float) -> str:
    """Verdict on a derivative by comparison with finite differences of whole rollouts, with the half widths `WIDTHS`."""
    size, noise, floor = max(np.abs(central).max(), np.abs(sides).max()), NOISE * scale, FLOOR * scale
    if np.ptp(central) > SAME * size + noise:
        return "unreliable differences"
    if np.abs(sides[0] - sides[1]).max() > SAME * size + noise:
        return "corner"
    near = float(central[-1])
    if abs(ours - near) <= 2.0 * SAME * abs(near) + 2.0 * floor:
        return "agrees"
    return "wrong sign" if ours * near < 0.0 and min(abs(ours), abs(near)) > 2.0 * floor else "differs"


def differences(
    scene: Scene, env: int, chosen: list[tuple[str, Array, Array]], weights: tuple[Array, Array], end: Array
) -> list[tuple[Array, Array]]:
    """Finite differences of a function of a rollout's last state, along some coordinates.

    Args:
        scene: Initial state and controls.
        env: Index of the environment.
        chosen: Coordinates, as from `directions`.
        weights: Weights of the last positions (on the tangent space) and velocities in the function, (nv,) each.
        end: Last positions of the rollout without displacement, (nq,).

    Returns:
        Central differences (3,) and one-sided differences (2, 3) for each coordinate, with the half widths `WIDTHS`.
    """
    sim, model = scene.sim, scene.sim.model
    nv, sizes = model.nv, np.array([sign * h for h in WIDTHS for sign in (1, -1)])
    moves = np.concatenate([[np.zeros(2 * nv)], *(sizes[:, None] * state for _, state, _ in chosen)])
    pushes = np.concatenate([np.zeros((1, *chosen[0][2].shape)), *(sizes[:, None, None] * ctrl for _, _, ctrl in chosen)])
    copies = stepper.Stepper(model, len(moves), options=sim.options)
    copies.set_state(sim.get_state(env=env))
    qpos = model.integrate_pos(np.tile(sim.qpos[env], (len(moves), 1)), moves[:, :nv])
    copies.set_state(qpos, sim.qvel[env] + moves[:, nv:], keep_warmstart=True)
    made = copies.rollout(scene.ctrl[:, env, None] + pushes.transpose(1, 0, 2), scene.nstep, fields=["qpos", "qvel"])
    shift = model.differentiate_pos(np.tile(end, (len(moves), 1)), made["qpos"][-1])
    value = shift @ weights[0] + made["qvel"][-1] @ weights[1]
    rest = value[1:].reshape(len(chosen), len(WIDTHS), 2)
    h = np.array(WIDTHS)
    return [((a[:, 0] - a[:, 1]) / (2 * h), np.stack([(a[:, 0] - value[0]) / h, (value[0] - a[:, 1]) / h])) for a in rest]


def task_models() -> dict[str, stepper.Model]:
    """Models of the registered tasks, without duplicates."""
    found: dict[str, stepper.Model] = {}
    for name in sorted(name for name in gymnasium.registry if name.startswith("stepper/")):
        try:
            env: Any = gymnasium.make(name, disable_env_checker=True).unwrapped
        except ImportError as error:
            print(f"skipped {name}: {error}")
            continue
        if env.sim.model not in found.values():
            found[name] = env.sim.model
    return found


def main() -> None:
    """Compare gradients of rollouts with finite differences, and print a table and the derivatives that disagree."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", default=["scenes", "tasks"])
    parser.add_argument("--count", type=int, default=100, help="number of random scenes [100]")
    given = parser.parse_args()
    warnings.filterwarnings("ignore")
    models = task_models() if "tasks" in given.parts else {}
    counts = ("derivatives", "judged by differences", "agree", "wrong sign", "corner", "unreliable differences")
    table = Table("rollouts", "law", "kinks", *counts)
    disagreements = []
    for part in given.parts:
        for law, options in LAWS.items():
            judged = Judged(Counter(), [])
            if part == "scenes":
                for seed in range(given.count):
                    judge(bodies_on_a_floor(seed, options), seed, judged)
            for k, (name, model) in enumerate(models.items() if part == "tasks" else ()):
                judge(robots(k, model, name, options), k, judged)
            for kind in ("no kink", "near a kink"):
                total, known, good, wrong = judged.row(kind)
                rest = [judged.counts[kind, verdict] for verdict in ("corner", "unreliable differences")]
                share = f"{good / known:.2%}" if known else ""
                table.add(part, law, kind, total, known, share, wrong, *rest)
            table.add(part, law, "refused", judged.counts["refused", "refused"], "", "", "", "", "")
            disagreements += [f"{law}, {line}" for line in judged.worst]
    print("", *disagreements, sep="\n")


if __name__ == "__main__":
    main()
