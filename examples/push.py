"""Planar pushing of a box to a goal, by the iterative linear-quadratic regulator (iLQR) with `Stepper.linearize`.

Two motors drive a ball that pushes a box on the floor. The plan is a sequence of forces. Each iteration linearizes all steps of the plan as
one batch, and solves the linear-quadratic problem for changes of the forces and feedback gains. It then tries several step lengths as one
batch (Li and Todorov 2004; Tassa, Erez and Todorov 2012).

    python examples/push.py         # with MuJoCo's contact law
    python examples/push.py hard    # with hard contact
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
import stepper
from numpy.typing import NDArray
from stepper.derivatives.rollout import to_tangent

Array = NDArray[np.float64]

SCENE = """
<mujoco>
  <option timestep="0.004"/>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1" friction=".3"/>
    <body name="box" pos="0 0 .05">
      <freejoint/>
      <geom name="box" type="box" size=".05 .05 .05" mass=".5" friction=".3"/>
    </body>
    <body name="pusher" pos="-.08 .01 .04">
      <joint name="x" type="slide" axis="1 0 0" damping="4"/>
      <joint name="y" type="slide" axis="0 1 0" damping="4"/>
      <geom name="pusher" type="sphere" size=".02" mass=".3" friction=".3"/>
    </body>
  </worldbody>
  <actuator>
    <motor joint="x" ctrllimited="false"/>
    <motor joint="y" ctrllimited="false"/>
  </actuator>
</mujoco>
"""
LAWS = {
    "mujoco": stepper.Options(contact="mujoco"),
    "hard": stepper.Options(integrator="euler", stabilization="baumgarte", baumgarte=1.0, slop=0.0),
}
"""Options by name of the contact law.

The options of hard contact make a step differentiable at the state of a box at rest (docs/how-to/derivatives.md).
"""
HOLD = 5
"""Simulation steps per control."""
LENGTHS = 0.5 ** np.arange(10)
"""Step lengths of the line search."""


@dataclass(frozen=True)
class Goal:
    """Goal with the weights of its cost.

    Attributes:
        place: Position of the box at the end, (2,), m.
        miss: Weight of the squared distance at the end, 1/m^2.
        speed: Weight of the squared speed at the end, s^2/m^2.
        effort: Weight of the squared forces, 1/N^2.
    """

    place: Array
    miss: float = 1e3
    speed: float = 1.0
    effort: float = 1e-3

    def cost(self, ctrl: Array, qpos: Array, qvel: Array) -> Array:
        """Costs of plans, (plans,), from ctrl (T, plans, 2) and the final qpos (plans, nq) and qvel (plans, nv)."""
        miss = np.square(qpos[:, :2] - self.place).sum(axis=1)
        total: Array = self.miss * miss + self.speed * np.square(qvel[:, :2]).sum(axis=1) + self.effort * np.square(ctrl).sum(axis=(0, 2))
        return total

    def ends(self, model: stepper.Model, qpos: Array, qvel: Array) -> tuple[Array, Array]:
        """Gradient (n,) and Hessian (n, n) of a plan's cost with respect to its final state, on the tangent space, with n = 2 nv.

        Args:
            model: The model.
            qpos: Final positions, (nq,).
            qvel: Final velocities, (nv,).
        """
        numbers = np.zeros(model.nq)
        numbers[:2] = 2 * self.miss * (qpos[:2] - self.place)
        speeds = np.zeros(model.nv)
        speeds[:2] = 2 * self.speed * qvel[:2]
        hessian = np.zeros(2 * model.nv)
        hessian[:2], hessian[model.nv : model.nv + 2] = 2 * self.miss, 2 * self.speed
        return np.concatenate([to_tangent(model, qpos, numbers), speeds]), np.diag(hessian)


@dataclass
class Plan:
    """Sequence of forces with the states of its simulation.

    Attributes:
        ctrl: Forces, (T, 2), N.
        qpos, qvel: States before each control and at the end, (T + 1, nq) and (T + 1, nv).
        cost: Cost by `Goal.cost`.
    """

    ctrl: Array
    qpos: Array
    qvel: Array
    cost: float


def tried(sim: stepper.Stepper, goal: Goal, plan: Plan | Array, changes: Array, gains: Array) -> Plan:
    """Best plan of a line search, whose step lengths are simulated as one batch.

    The forces of a candidate are those of the previous plan, plus the changes times a step length. Feedback on the deviation from the
    previous plan's states is added.

    Args:
        sim: Stepper with one environment per step length.
        goal: Goal with the cost.
        plan: Previous plan, or initial forces (T, 2), N.
        changes: Changes of the forces, (T, 2), N.
        gains: Feedback gains, (T, 2, 2 nv), for deviations of the positions and velocities.
    """
    model, count = sim.model, len(sim.qpos)
    sim.reset()
    before = plan.ctrl if isinstance(plan, Plan) else plan
    ctrl, qpos, qvel = np.zeros((len(before), count, 2)), [np.array(sim.qpos)], [np.array(sim.qvel)]
    for t, own in enumerate(before):
        ctrl[t] = own
        if isinstance(plan, Plan):
            off = model.differentiate_pos(np.tile(plan.qpos[t], (count, 1)), sim.qpos)
            state = np.concatenate([off, sim.qvel - plan.qvel[t]], axis=1)
            ctrl[t] += LENGTHS[:count, None] * changes[t] + state @ gains[t].T
        sim.step(ctrl[t], nstep=HOLD)
        qpos.append(np.array(sim.qpos))
        qvel.append(np.array(sim.qvel))
    costs = goal.cost(ctrl, qpos[-1], qvel[-1])
    best = int(np.argmin(costs))
    return Plan(ctrl[:, best], np.stack(qpos)[:, best], np.stack(qvel)[:, best], float(costs[best]))


def improve(moments: stepper.Stepper, goal: Goal, plan: Plan, regularization: float) -> tuple[Array, Array, float]:
    """Changes and feedback that improve a plan, by one iteration of the iterative linear-quadratic regulator.

    Args:
        moments: Stepper with one environment per step of the plan.
        goal: Goal with the cost.
        plan: The plan.
        regularization: Number that is added to the diagonal of the cost's second derivatives with respect to the forces.

    Returns:
        Changes of the forces, (T, 2), feedback gains, (T, 2, 2 nv), and the fraction of steps near a kink. At a kink, such as a change
        of contacts, a step has no derivative.
    """
    T = len(plan.ctrl)
    moments.set_state(plan.qpos[:-1], plan.qvel[:-1])
    lin = moments.linearize(ctrl=plan.ctrl, nstep=HOLD)
    value, curvature = goal.ends(moments.model, plan.qpos[-1], plan.qvel[-1])
    changes, gains = np.zeros((T, 2)), np.zeros((T, 2, len(value)))
    for t in reversed(range(T)):
        A, B = lin.A[t], lin.B[t]
        by_state, by_control = A.T @ value, B.T @ value + 2 * goal.effort * plan.ctrl[t]
        cross, own = B.T @ curvature @ A, B.T @ curvature @ B + (2 * goal.effort + regularization) * np.eye(2)
        changes[t], gains[t] = -np.linalg.solve(own, by_control), -np.linalg.solve(own, cross)
        value = by_state + cross.T @ changes[t]
        curvature = A.T @ curvature @ A + cross.T @ gains[t]
        curvature = 0.5 * (curvature + curvature.T)
    return changes, gains, float(np.mean(lin.near_kink))


STARTS = (1.35, 1.4, 1.45, 1.5)
"""Initial constant forces along x, N, one for each run. The cost has several local minima, as the ball can slide off the box."""


def push(
    law: str = "mujoco", place: tuple[float, float] = (0.15, 0.06), controls: int = 40, rounds: int = 60, *, verbose: bool = True
) -> Plan:
    """Plan that pushes the box to a place: the best of several plans, each optimised from another initial force.

    Args:
        law: Name of the contact law.
        place: Goal of the box in x and y, m.
        controls: Number of forces in a plan, each for 20 ms.
        rounds: Largest number of iterations.
        verbose: Whether to print the costs.
    """
    plans = [_plan(law, Goal(np.array(place)), np.tile([start, 0.0], (controls, 1)), rounds, verbose=verbose) for start in STARTS]
    return min(plans, key=lambda plan: plan.cost)


def _plan(law: str, goal: Goal, start: Array, rounds: int, *, verbose: bool) -> Plan:
    """Plan optimised from initial forces.

    Args:
        law: Name of the contact law.
        goal: Goal with the cost.
        start: Initial forces, (controls, 2), N.
        rounds: Largest number of iterations.
        verbose: Whether to print the costs.
    """
    model = stepper.load(SCENE)
    first, trials, moments = (stepper.Stepper(model, n, options=LAWS[law]) for n in (1, len(LENGTHS), len(start)))
    # The initial forces push the ball into the box: without contact, the gradient of the cost with respect to the forces is zero.
    plan = tried(first, goal, start, np.zeros(0), np.zeros(0))
    regularization = 1e-4
    for k in range(rounds):
        changes, gains, kinks = improve(moments, goal, plan, regularization)
        better = tried(trials, goal, plan, changes, gains)
        if better.cost < plan.cost:
            plan, regularization = better, max(regularization / 3, 1e-6)
        else:
            regularization *= 10
        if verbose:
            miss = 1e3 * np.linalg.norm(plan.qpos[-1, :2] - goal.place)
            print(f"round {k + 1:2}: cost {plan.cost:8.4f}, distance to the goal {miss:6.2f} mm, {kinks:.0%} of the steps near a kink")
        if regularization > 1e6:
            break
    return plan


if __name__ == "__main__":
    found = push(sys.argv[1] if len(sys.argv) > 1 else "mujoco")
    print(f"the box ends at x {found.qpos[-1, 0]:.3f} m, y {found.qpos[-1, 1]:.3f} m; largest force {np.abs(found.ctrl).max():.1f} N")
