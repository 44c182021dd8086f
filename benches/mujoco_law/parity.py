"""Comparison of one step of stepper and of MuJoCo from the same states of a model."""

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import stepper
from numpy.typing import NDArray

Array = NDArray[np.float64]

AGREES = 1e-9
"""Largest difference of velocities after a step that counts as agreement, relative to 1 + max |qvel|.

If the results of MuJoCo's own solvers differ by more in a state, their difference is the bound instead.
"""
SAME_DISTANCE = 1e-9
"""Largest difference of the distances of equal contacts, m."""
_EPISODE = 20
"""Number of states per episode."""
_BLOWN_UP = 1e3
"""Velocity above which an episode is reset, rad/s or m/s. Some models diverge in MuJoCo from random states."""
_ATTEMPTS = 10
"""Largest number of attempts to find each state."""
_NOISE = (0.02, 0.3)
"""Standard deviations of the initial configuration (on the tangent space, rad or m) and velocity (rad/s or m/s) of an episode."""


@dataclass(frozen=True)
class States:
    """States of a model, with the results of one step of MuJoCo.

    Attributes:
        qpos: Positions, (states, nq).
        qvel: Velocities, (states, nv).
        act: Activations, (states, na).
        ctrl: Controls, (states, nu).
        after: Velocities after a step with Newton's solver, (states, nv).
        spread: Largest difference to the result of the conjugate gradient solver, relative to 1 + max |qvel|, (states,).
        contacts: Touching contacts of each state, sorted: both geoms and distance.
    """

    qpos: Array
    qvel: Array
    act: Array
    ctrl: Array
    after: Array
    spread: Array
    contacts: list[list[tuple[int, int, float]]]


@dataclass(frozen=True)
class Parity:
    """Agreement between stepper and MuJoCo after one step from the same states of a model.

    Attributes:
        states: Number of states.
        touching: Fraction of the states with contacts.
        same: Fraction of the states in which both engines find the same contacts: geoms, number and distance.
        error: Difference of velocities after the step, relative to 1 + max |qvel|, for states with equal contacts, (n,).
        spread: Difference between the results of MuJoCo's own solvers, relative to 1 + max |qvel|, in the same n states, (n,).
        newton_steps: Mean number of Newton steps of stepper's solver.
        residual: Largest residual of stepper's solver, m/s.
    """

    states: int
    touching: float
    same: float
    error: Array
    spread: Array
    newton_steps: float
    residual: float

    @property
    def agrees(self) -> float:
        """Fraction of the states with equal contacts in which the velocities after the step agree; 1 if there are no such states."""
        return float(np.mean(self.error <= np.maximum(AGREES, self.spread))) if len(self.error) else 1.0


def prepare(compiled: Any) -> None:
    """Set a compiled model to Newton's solver with the tightest tolerances, without noslip iterations."""
    opt = compiled.opt
    opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
    opt.tolerance, opt.ls_tolerance, opt.iterations, opt.noslip_iterations = 1e-14, 1e-8, 200, 0


def states(compiled: Any, count: int, seed: int = 0) -> States:
    """Collect states from MuJoCo's simulation with random controls, and simulate one step of MuJoCo from each."""
    data, rng = mujoco.MjData(compiled), np.random.default_rng(seed)
    limited = compiled.actuator_ctrllimited[:, None].astype(bool)
    low, high = np.where(limited, compiled.actuator_ctrlrange, [-1.0, 1.0]).T
    found: dict[str, list[Any]] = {name: [] for name in ("qpos", "qvel", "act", "ctrl", "after", "spread", "contacts")}
    for attempt in range(_ATTEMPTS * count):
        if len(found["qpos"]) == count:
            break
        if attempt % _EPISODE == 0:
            _begin(compiled, data, rng)
        for _ in range(int(rng.integers(5, 40))):
            if rng.random() < 0.2:
                data.ctrl[:] = rng.uniform(low, high)
            mujoco.mj_step(compiled, data)
        mujoco.mj_normalizeQuat(compiled, data.qpos)
        if not np.abs(data.qvel).max(initial=0.0) < _BLOWN_UP:
            _begin(compiled, data, rng)
            continue
        here = {"qpos": data.qpos.copy(), "qvel": data.qvel.copy(), "act": data.act.copy(), "ctrl": data.ctrl.copy()}
        contacts, after = _step(compiled, data, here, mujoco.mjtSolver.mjSOL_NEWTON)
        _, other = _step(compiled, data, here, mujoco.mjtSolver.mjSOL_CG)
        scale = 1.0 + np.abs(here["qvel"]).max(initial=0.0)
        found["after"].append(after)
        found["spread"].append(np.abs(other - after).max() / scale)
        found["contacts"].append(contacts)
        for name, value in here.items():
            found[name].append(value)
            getattr(data, name)[:] = value
        mujoco.mj_forward(compiled, data)
    if not found["qpos"]:
        raise ValueError("all states of random controls diverge in MuJoCo: leave the model out")
    lists = found.pop("contacts")
    return States(**{name: np.array(values) for name, values in found.items()}, contacts=lists)


def _begin(compiled: Any, data: Any, rng: np.random.Generator) -> None:
    """Set a random state around the first keyframe, or around the reference configuration if the model has no keyframe."""
    mujoco.mj_resetData(compiled, data)
    if compiled.nkey:
        mujoco.mj_resetDataKeyframe(compiled, data, 0)
    mujoco.mj_integratePos(compiled, data.qpos, rng.normal(0.0, _NOISE[0], compiled.nv), 1.0)
    data.qvel[:] = rng.normal(0.0, _NOISE[1], compiled.nv)
    mujoco.mj_forward(compiled, data)


def _step(compiled: Any, data: Any, start: dict[str, Array], solver: Any) -> tuple[list[tuple[int, int, float]], Array]:
    """Contacts at a state, and velocity after one step of MuJoCo without warm start."""
    for name, value in start.items():
        getattr(data, name)[:] = value
    data.qacc_warmstart[:] = 0.0
    was = compiled.opt.solver, compiled.opt.iterations
    compiled.opt.solver, compiled.opt.iterations = solver, 3000
    mujoco.mj_forward(compiled, data)
    contacts = sorted((int(c.geom[0]), int(c.geom[1]), float(c.dist)) for c in data.contact if c.exclude == 0)
    data.qacc_warmstart[:] = 0.0
    mujoco.mj_step(compiled, data)
    compiled.opt.solver, compiled.opt.iterations = was
    return contacts, data.qvel.copy()


def compare(model: stepper.Model, found: States, **options: Any) -> Parity:
    """Compare one step of stepper with the step of MuJoCo, from all given states. `options` are further arguments of `Options`."""
    count = len(found.qpos)
    settings = stepper.Options(contact="mujoco", tolerance=1e-13, iterations=100, **options)
    sim = stepper.Stepper(model, num_envs=count, options=settings)
    sim.set_state(qpos=found.qpos, qvel=found.qvel, act=found.act)
    same = _same_contacts(model, found)
    sim.step(found.ctrl)
    scale = 1.0 + np.abs(found.qvel).max(axis=1)
    error = np.abs(sim.qvel - found.after).max(axis=1) / scale
    return Parity(
        states=count,
        touching=float(np.mean([bool(contacts) for contacts in found.contacts])),
        same=float(same.mean()),
        error=error[same],
        spread=found.spread[same],
        newton_steps=float(np.mean(sim.newton_steps)),
        residual=float(np.max(sim.residual)),
    )


def _same_contacts(model: stepper.Model, found: States) -> NDArray[np.bool_]:
    """Mask of the states with equal contacts. Uses an Euler step, which detects contacts at the initial state."""
    sim = stepper.Stepper(model, num_envs=len(found.qpos), options=stepper.Options(contact="mujoco", integrator="euler"))
    sim.set_state(qpos=found.qpos, qvel=found.qvel, act=found.act)
    sim.step(found.ctrl)
    margin = np.asarray(model.geom_margin, float)
    same = np.zeros(len(found.qpos), np.bool_)
    for env, theirs in enumerate(found.contacts):
        # Distances of stepper are relative to the margin.
        ours = sorted((int(a), int(b), float(margin[a] + margin[b] + d)) for (a, b), d in _pushing(sim.contacts(env)))
        pairs = [c[:2] for c in ours] == [c[:2] for c in theirs]
        same[env] = pairs and all(abs(a[2] - b[2]) < SAME_DISTANCE for a, b in zip(ours, theirs, strict=True))
    return same


def _pushing(contacts: Any) -> list[tuple[Any, float]]:
    """Geoms and distance of the overlapping contacts."""
    return [(c["geom"], float(c["distance"])) for c in contacts if c["distance"] < 0.0]
