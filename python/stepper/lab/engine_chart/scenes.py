"""Built-in scenes with known solutions, and functions that compute their errors.

To add a scene, write a function that returns a `Scene`, and add it to `SCENES`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stepper._options import Options
from stepper.lab.engines import Array, Engine, EngineBatch, MujocoEngine, StepperEngine
from stepper.shared.machine import require

TIMESTEPS = (1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2)
"""Default time steps, s. Each divides every scene's duration."""

GRAVITY = 9.81


@dataclass(frozen=True)
class Scene:
    """Scene of a chart.

    Attributes:
        name: Name on the command line and in file names.
        title: Title of the picture.
        mjcf: Model, as MJCF text.
        start: Function of a batch and the time step (s) that returns the initial qpos (nq,), m and rad, and qvel (nv,), m/s and rad/s. It
            may step the batch to let it settle.
        duration: Simulated time, s.
        error: Function of qpos at the start and at the end, (nq,) each, that returns the error.
        error_label: Label of the error's axis, with its unit.
        reference: Description of the known solution.
        engines: Engines with settings, one for each line of the chart.
        timesteps: Time steps, s.
    """

    name: str
    title: str
    mjcf: str
    start: Callable[[EngineBatch, float], tuple[Array, Array]]
    duration: float
    error: Callable[[Array, Array], float]
    error_label: str
    reference: str
    engines: tuple[Engine, ...]
    timesteps: tuple[float, ...] = TIMESTEPS


# A 5-link chain that swings in a plane without damping.

CHAIN_LINKS = 5
CHAIN_DURATION = 1.0  # s
CHAIN_RTOL = 1e-12  # relative tolerance of the reference


def _chain_mjcf() -> str:
    """MJCF of the chain of hinges without contacts."""
    link = '<body pos="0 0 {z}"><joint type="hinge" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -.2" size=".02" mass=".25"/>'
    bodies = "".join(link.format(z=1.5 if i == 0 else -0.2) for i in range(CHAIN_LINKS)) + "</body>" * CHAIN_LINKS
    return f"""<mujoco model="chain"><option gravity="0 0 -{GRAVITY}"/>
      <default><geom contype="0" conaffinity="0"/></default><worldbody>{bodies}</worldbody></mujoco>"""


def chain_state() -> tuple[Array, Array]:
    """Initial state of the chain at rest, straight and horizontal: qpos (5,), rad, and qvel (5,), rad/s."""
    qpos = np.zeros(CHAIN_LINKS)
    qpos[0] = 0.5 * math.pi
    return qpos, np.zeros(CHAIN_LINKS)


def chain_reference(rtol: float = CHAIN_RTOL) -> Array:
    """Joint angles of the chain after its duration (1 s), (5,), rad, with a relative and absolute tolerance `rtol`.

    SciPy's DOP853 integrates q'' = -M(q)^-1 bias(q, q'), with M and bias from MuJoCo. The time stepping of the engines is not used.
    """
    mujoco = require("mujoco", "for the reference solution of the chain")
    integrate = require("scipy.integrate", "for the reference solution of the chain")
    model = mujoco.MjModel.from_xml_string(_chain_mjcf())
    data = mujoco.MjData(model)

    def rate(_: float, state: Array) -> Array:
        data.qpos[:], data.qvel[:] = np.split(state, 2)
        mujoco.mj_forward(model, data)
        return np.concatenate([data.qvel, data.qacc_smooth])

    solution = integrate.solve_ivp(
        rate, (0.0, CHAIN_DURATION), np.concatenate(chain_state()), method="DOP853", rtol=rtol, atol=rtol, t_eval=[CHAIN_DURATION]
    )
    if not solution.success:
        raise RuntimeError(f"the reference solution of the chain failed: {solution.message}")
    return np.asarray(solution.y[:CHAIN_LINKS, -1])


def chain() -> Scene:
    """Scene with a chain of 5 hinged links that falls from the horizontal.

    The error is the largest error of a joint angle after 1 s, rad.
    """
    right = chain_reference()
    agree = float(np.max(np.abs(right - chain_reference(1e-11))))
    return Scene(
        name="chain",
        title=f"5-link chain, falls from the horizontal, {CHAIN_DURATION:g} s, no damping",
        mjcf=_chain_mjcf(),
        start=lambda _run, _dt: chain_state(),
        duration=CHAIN_DURATION,
        error=lambda _start, end: float(np.max(np.abs(end - right))),
        error_label="largest error of a joint angle [rad]",
        reference=f"DOP853 (scipy), rtol = atol = {CHAIN_RTOL:g}; differs by {agree:.1e} rad from rtol 1e-11",
        engines=(
            StepperEngine("euler", Options(integrator="euler")),
            StepperEngine("midpoint", Options(integrator="midpoint")),
            StepperEngine("rk4", Options(integrator="rk4")),
            StepperEngine("rk4, 8 environments in lanes", Options(integrator="rk4"), batch=8),
            MujocoEngine("Euler"),
            MujocoEngine("implicitfast", integrator="IMPLICITFAST"),
            MujocoEngine("RK4", integrator="RK4"),
        ),
    )


# A box that slides until friction stops it.

BOX_SPEED = 2.0  # m/s
BOX_FRICTION = 0.5
BOX_ANGLE = math.radians(30.0)
BOX_DURATION = 1.0  # s
BOX_SETTLE = 1.0  # s, before the box gets its speed
BOX_HALF = (0.1, 0.1, 0.05)  # m


def _box_mjcf() -> str:
    """MJCF of a box on a plane."""
    size = " ".join(map(str, BOX_HALF))
    return f"""<mujoco model="box"><option gravity="0 0 -{GRAVITY}"/>
      <default><geom friction="{BOX_FRICTION} 0 0"/></default>
      <worldbody><geom type="plane" size="5 5 1"/>
      <body pos="0 0 {BOX_HALF[2]}"><freejoint/><geom type="box" size="{size}" mass="1"/></body></worldbody></mujoco>"""


def _box_start(run: EngineBatch, dt: float) -> tuple[Array, Array]:
    """Initial qpos and qvel of the box: settled on the floor, with its initial speed. No engine then starts by sinking into the floor."""
    qpos = np.array([0.0, 0.0, BOX_HALF[2], 1.0, 0.0, 0.0, 0.0])
    run.reset(qpos, np.zeros(6))
    run.step(nstep=round(BOX_SETTLE / dt))
    qvel = np.zeros(6)
    qvel[:2] = BOX_SPEED * math.cos(BOX_ANGLE), BOX_SPEED * math.sin(BOX_ANGLE)
    return run.qpos[0], qvel


def box() -> Scene:
    """Scene with a box that slides along the floor, 30 degrees off the axes.

    The error is the distance between the box's position after 1 s and the known solution, m.
    """
    distance = BOX_SPEED**2 / (2.0 * BOX_FRICTION * GRAVITY)
    right = distance * np.array([math.cos(BOX_ANGLE), math.sin(BOX_ANGLE)])
    return Scene(
        name="box",
        title=f"sliding box, v0 = {BOX_SPEED:g} m/s at 30 degrees to the axes, friction {BOX_FRICTION:g}, {BOX_DURATION:g} s",
        mjcf=_box_mjcf(),
        start=_box_start,
        duration=BOX_DURATION,
        error=lambda start, end: float(np.linalg.norm(end[:2] - start[:2] - right)),
        error_label="distance from the exact position after 1 s [m]",
        reference=f"v0^2 / (2 mu g) = {distance:.6f} m, straight ahead (closed form)",
        engines=(
            StepperEngine("euler", Options(integrator="euler")),
            StepperEngine("midpoint", Options(integrator="midpoint")),
            StepperEngine("midpoint, 8 environments in lanes", Options(integrator="midpoint"), batch=8),
            MujocoEngine("defaults (Euler, pyramidal)"),
            MujocoEngine("implicitfast, elliptic", "IMPLICITFAST", "ELLIPTIC"),
            MujocoEngine("implicitfast, elliptic, impratio 100", "IMPLICITFAST", "ELLIPTIC", impratio=100.0),
            MujocoEngine("implicitfast, elliptic, impratio 10, noslip 10", "IMPLICITFAST", "ELLIPTIC", impratio=10.0, noslip=10),
        ),
    )


SCENES: dict[str, Callable[[], Scene]] = {"chain": chain, "box": box}
"""Built-in scenes of `stepper chart` by name."""
