"""Closed loops. The gap goes to zero, the energy stays, also through the singularity where all links are in line."""

import mujoco
import numpy as np
import pytest
import stepper
from equalities import rows_of
from models import SOURCES, forward, simulate


def four_bar(crank: float, coupler: float, rocker: float, base: float, *, extra: str = "") -> str:
    """A planar four-bar: two links in a chain and a third from the ground, closed by a connect in three dimensions."""
    link = '<geom type="capsule" size=".02" fromto="0 0 0 {0} 0 0" contype="0" conaffinity="0"/>'
    # The crank stands upright; the triangle of coupler, rocker and the line from the crank's end to the rocker's foot closes the loop.
    diagonal = np.hypot(base, crank)
    phi = np.arctan2(-crank, base) + np.arccos((coupler**2 + diagonal**2 - rocker**2) / (2 * coupler * diagonal))
    psi = np.arctan2(crank + coupler * np.sin(phi), coupler * np.cos(phi) - base)
    return f"""<mujoco><compiler angle="radian"/><worldbody>
      <body name="crank" euler="0 {-np.pi / 2} 0"><joint name="drive" axis="0 -1 0"/>{link.format(crank)}
        <body name="coupler" pos="{crank} 0 0" euler="0 {np.pi / 2 - phi} 0"><joint axis="0 -1 0"/>{link.format(coupler)}</body></body>
      <body name="rocker" pos="{base} 0 0" euler="0 {-psi} 0"><joint axis="0 -1 0"/>{link.format(rocker)}</body></worldbody>
      <equality><connect body1="coupler" body2="rocker" anchor="{coupler} 0 0"/>{extra}</equality></mujoco>"""


def gap(model: mujoco.MjModel, sim) -> float:
    return np.abs(rows_of(model, forward(model, sim.qpos, sim.qvel)).error).max()


LOOPS = {
    "crank and rocker": four_bar(0.2, 0.5, 0.4, 0.45),
    "parallelogram": four_bar(0.3, 0.5, 0.3, 0.5),
    "kite": four_bar(0.2, 0.2, 0.4, 0.4),
    "closed twice": four_bar(0.2, 0.5, 0.4, 0.45, extra='<connect body1="rocker" body2="coupler" anchor=".4 0 0"/>'),
    "welded base": four_bar(0.2, 0.5, 0.4, 0.45, extra='<connect body1="rocker" body2="world" anchor="0 0 0"/>'),
}
"""A kite and a parallelogram pass through configurations with all links in line, where the loop's rows are dependent and it may branch."""


def turning(model: mujoco.MjModel, sim, speed: float) -> None:
    """Sets the loop in motion: the velocity nearest to a turning crank that keeps the loop closed."""
    qvel = np.zeros(model.nv)
    qvel[0] = speed
    rows = rows_of(model, forward(model, model.qpos0, qvel)).jacobian
    free = np.linalg.svd(rows)[2][np.linalg.matrix_rank(rows, tol=1e-9) :]
    along = free.T @ (free @ qvel)
    sim.set_state(qvel=along * speed / along[0])


@pytest.mark.parametrize("stabilization", ["baumgarte", "split"])
@pytest.mark.parametrize("name", LOOPS)
def test_the_loop_stays_closed_and_keeps_its_energy(name, stabilization):
    """Ten seconds of turning at 2 and 1 ms: the gap falls as h^3 at the least as h^2, the loss of energy as h^2, and nothing is gained.

    Baumgarte's term does work on the gaps, which falls as h^2 too; where rows become dependent (the kite in line) that is more than the
    second order's error.
    """
    model = mujoco.MjModel.from_xml_string(LOOPS[name])
    gained, lost, gaps = [], [], []
    for h in (2e-3, 1e-3):
        sim = simulate(model, stabilization=stabilization, timestep=h)
        turning(model, sim, 6.0)
        start, kinetic, energies, open_by = sum(sim.energy()), sim.energy()[1], [], []
        for _ in range(round(10 / h) // 20):
            sim.step(nstep=20)
            energies.append(sum(sim.energy()) - start)
            open_by.append(gap(model, sim))
            assert sim.status == stepper.Status.OK
        gained.append(max(energies) / kinetic)
        lost.append(-min(energies) / kinetic)
        gaps.append(max(open_by))
    assert gaps[1] < gaps[0] / 3.5 + 1e-12  # Rounding of positions of order 1 m, gathered over 10^4 steps.
    singular = name == "kite"
    if stabilization == "baumgarte":
        # Less than half of the 6e-3 that inertial forces at the velocity of the last step's impulses used to take out at 1 ms.
        assert gained[1] < (0.2 if singular else 3e-3)
        assert singular or gained[1] < gained[0] / 3
    else:
        assert gained[1] < 1e-3
    if not singular:
        assert lost[1] < lost[0] / 3
        assert lost[1] < 0.02


def test_a_torn_loop_closes_and_rests():
    """Thrown together with a gap of 0.1 m and damped: at rest it is closed to rounding, far below the slop of contacts."""
    model = mujoco.MjModel.from_xml_string(LOOPS["crank and rocker"])
    model.dof_damping[:] = 0.5
    for stabilization in ("baumgarte", "split"):
        sim = simulate(model, stabilization=stabilization)
        sim.set_state(qpos=[0.1, -0.1, 0.2])
        assert gap(model, sim) > 0.05
        sim.step(nstep=5000)
        assert gap(model, sim) < 1e-9
        assert np.abs(sim.qvel).max() < 1e-6


def test_couplings_cost_no_sweeps():
    """They are taken out of every other row and solved once: sweeps of the quadruped go over contacts and limits alone."""
    model = mujoco.MjModel.from_xml_path(str(SOURCES["dm_control/quadruped"]))
    sweeps = []
    for coupled in (True, False):
        model.eq_active0[:] = coupled
        sim = simulate(model, num_envs=16)
        rng, taken = np.random.default_rng(0), []
        for _ in range(30):
            ctrl = rng.uniform(-1, 1, (16, model.nu))
            for _ in range(4):
                sim.step(ctrl)
                taken.append(sim.iterations)
        sweeps.append(np.mean(taken))
    # 1.2 times as many, since what moves is not the same; as rows among the others couplings took 2.4 times as many.
    assert sweeps[0] < 1.6 * sweeps[1]
