"""Sliding threshold of an object on a tray: pushed sideways, it slides if and only if the force exceeds mu times its weight.

The object of 0.3 kg weighs 2.94 N. At mu = 1.0 friction carries up to 2.94 N, and a push of 2 N does not move the object, however long the
time step. At mu = 0.55 friction carries up to 1.62 N, and the object slides with a = F/m - mu g. The script compares the result with this
theory at several time steps.

    python examples/tray.py               # both cases, and the force at which the object begins to slide
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import stepper

G = 9.81
MASS, PUSH = 0.3, 2.0
CASES = ((1.0, 0.005), (0.55, 0.008))
"""Cases: friction coefficient, and time step in s."""

SCENE = """
<mujoco model="tray">
  <option timestep="{dt}" gravity="0 0 -{g}"/>
  <default><geom friction="{mu} 0 0"/></default>
  <worldbody>
    <geom name="tray" type="box" size="2 2 0.01" pos="0 0 -0.01"/>
    <body name="object" pos="0 0 0.02"><freejoint/><geom name="object" type="box" size="0.05 0.05 0.02" mass="{mass}"/></body>
  </worldbody>
</mujoco>
"""


@dataclass(frozen=True)
class Pushed:
    """Result of a push.

    Attributes:
        speed: Speed at the end, m/s.
        acceleration: Mean acceleration, m/s^2.
        residual: Largest solver residual of all steps, m/s.
    """

    speed: float
    acceleration: float
    residual: float


def push(mu: float, dt: float, force: float = PUSH, seconds: float = 1.0) -> Pushed:
    """Let the object come to rest, and push it horizontally at its centre of mass, at an angle to the axes.

    Args:
        mu: Friction coefficient of tray and object.
        dt: Time step, s.
        force: Force of the push, N.
        seconds: Simulated time before the push, and duration of the push, s.
    """
    sim = stepper.Stepper(stepper.load(SCENE.format(dt=dt, g=G, mu=mu, mass=MASS)))
    steps = round(seconds / dt)
    sim.step(nstep=steps)
    sim.xfrc_applied[1, :2] = force * np.cos(0.3), force * np.sin(0.3)
    residual = 0.0
    for _ in range(steps):
        sim.step()
        residual = max(residual, float(sim.residual))
    speed = float(np.linalg.norm(sim.qvel[:2]))
    return Pushed(speed, speed / (steps * dt), residual)


def threshold(mu: float, dt: float) -> float:
    """Force at which the object begins to slide, N, by bisection."""
    low, high = 0.0, 2 * mu * MASS * G
    for _ in range(30):
        middle = (low + high) / 2
        low, high = (low, middle) if push(mu, dt, middle, seconds=0.2).speed > 1e-6 else (middle, high)
    return (low + high) / 2


def main() -> None:
    """Print theory and simulation of both cases at several time steps."""
    print(f"{MASS} kg on a tray, pushed with {PUSH} N for 1 s\n")
    print("  mu   dt s    mu N, N   theory m/s^2   simulated m/s^2   residual m/s   threshold N")
    for mu, usual in CASES:
        for dt in sorted({usual, 0.001, 0.002, 0.02}):
            done = push(mu, dt)
            expected = max(0.0, PUSH / MASS - mu * G)
            simulated = f"{done.acceleration:17.6f} {done.residual:14.1e} {threshold(mu, dt):13.5f}"
            print(f"{mu:5} {dt:6} {mu * MASS * G:9.4f} {expected:14.6f} {simulated}")


if __name__ == "__main__":
    main()
