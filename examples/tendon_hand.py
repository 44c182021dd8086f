"""Hand with three fingers that tendons drive: the largest ball that it holds by a tendon tension, at rest and shaken.

    python examples/tendon_hand.py              # largest masses by tension, as a table
    python examples/tendon_hand.py out/hand.gif # the same, and a film of one ball; needs the extra `viewer`, and OpenGL

Each finger has two joints and two tendons. A motor pulls the flexor, which runs through sites on the inner side. An elastic extensor wraps
around the joints on the outer side, and opens the finger. No motor drives a joint: what a finger touches decides how it closes.

The ball lies on a table under the hand while the fingers close. Then the table sinks. At last the hand is shaken sideways. The balls of the
environments differ in mass.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import stepper
from numpy.typing import NDArray

Array = NDArray[Any]

RADIUS, DEPTH = 0.035, 0.062
"""Radius of the ball, and distance of its centre below the palm, m."""
CLOSE, SINK, SHAKE = 0.5, 0.5, 1.0
"""Durations in which the fingers close, the table sinks, and the hand is shaken, s."""
SWING, RATE = 0.01, 2.0
"""Amplitude, m, and frequency, Hz, with which the hand is shaken."""
LOST = 0.01
"""Displacement relative to the hand of a ball that is lost, m."""
FINGER = """
<body pos="{x} {y} 0" euler="0 0 {angle}">
  <joint name="knuckle{k}" axis="0 1 0" range="-60 100"/>
  <geom type="capsule" fromto="0 0 0 0 0 -.05" size=".008" mass=".02"/>
  <site name="inner_a{k}" pos="-.008 0 -.02"/><site name="inner_b{k}" pos="-.008 0 -.04"/><site name="outer_b{k}" pos=".01 0 -.025"/>
  <body pos="0 0 -.05">
    <joint name="middle{k}" axis="0 1 0" range="-10 100"/>
    <geom type="capsule" fromto="0 0 0 0 0 -.035" size=".008" mass=".015"/>
    <geom name="pulley{k}" type="cylinder" size=".008 .004" euler="90 0 0" mass="0" contype="0" conaffinity="0"/>
    <site name="inner_c{k}" pos="-.008 0 -.015"/><site name="outer_c{k}" pos=".01 0 -.02"/><site name="side{k}" pos=".02 0 0"/>
  </body>
</body>"""
TENDONS = """
<spatial name="flexor{k}"><site site="palm_in{k}"/><site site="inner_a{k}"/><site site="inner_b{k}"/><site site="inner_c{k}"/></spatial>
<spatial name="extensor{k}" stiffness="200" damping="1"><site site="palm_out{k}"/><geom geom="base{k}" sidesite="palm_side{k}"/>
  <site site="outer_b{k}"/><geom geom="pulley{k}" sidesite="side{k}"/><site site="outer_c{k}"/></spatial>"""
PALM = """
<site name="palm_in{k}" pos="{xi} {yi} .01"/><site name="palm_out{k}" pos="{xo} {yo} .02"/><site name="palm_side{k}" pos="{xs} {ys} 0"/>
<geom name="base{k}" type="cylinder" pos="{x} {y} 0" size=".008 .004" zaxis="{xt} {yt} 0" mass="0" contype="0" conaffinity="0"/>"""


def scene() -> str:
    """MJCF of the hand, the ball and the table."""
    parts: dict[str, str] = {"palm": "", "fingers": "", "tendons": "", "motors": ""}
    for k in range(3):
        angle = 120 * k
        cos, sin = np.cos(np.radians(angle)), np.sin(np.radians(angle))
        ends = {"": 0.045, "i": 0.037, "o": 0.055, "s": 0.065}
        places = {f"{axis}{end}": r * c for end, r in ends.items() for axis, c in (("x", cos), ("y", sin))}
        numbers = {"k": k, "angle": angle, "xt": -sin, "yt": cos, **places}
        parts["palm"] += PALM.format(**numbers)
        parts["fingers"] += FINGER.format(**numbers)
        parts["tendons"] += TENDONS.format(**numbers)
        parts["motors"] += f'<motor tendon="flexor{k}" gear="-1"/>'
    return f"""
<mujoco>
  <option timestep="0.002"/>
  <visual><headlight ambient=".4 .4 .4" diffuse=".5 .5 .5"/></visual>
  <default>
    <geom friction="0.8 .001 0" condim="4" rgba=".75 .75 .8 1"/><joint damping=".002" armature="1e-5"/>
    <site size=".002" rgba=".2 .2 .2 1"/><tendon width=".0015" rgba=".1 .4 .9 1"/>
  </default>
  <asset><texture type="skybox" builtin="gradient" rgb1=".9 .95 1" rgb2=".6 .7 .8" width="32" height="32"/></asset>
  <worldbody>
    <light pos=".3 -.3 .8" dir="-.3 .3 -.8"/>
    <body name="palm" pos="0 0 .2">
      <joint name="shake" type="slide" axis="1 0 0"/>
      <geom type="cylinder" size=".06 .01" pos="0 0 .015" mass="1"/>{parts["palm"]}{parts["fingers"]}
    </body>
    <body name="ball" pos="0 0 {0.2 - DEPTH}">
      <freejoint/><geom name="ball" type="sphere" size="{RADIUS}" mass=".1" rgba=".9 .4 .1 1"/>
    </body>
    <body name="table" mocap="true" pos="0 0 {0.2 - DEPTH - RADIUS - 0.005}"><geom type="cylinder" size=".02 .005"/></body>
  </worldbody>
  <tendon>{parts["tendons"]}</tendon>
  <actuator>{parts["motors"]}<position joint="shake" kp="1e5" kv="600"/></actuator>
</mujoco>"""


def hold(masses: Array, tension: float, see: Callable[[stepper.Stepper], None] | None = None) -> tuple[stepper.Stepper, Array]:
    """Lets the hand hold one ball per mass.

    Args:
        masses: Masses of the balls, (num_envs,), kg.
        tension: Tension of each flexor, N.
        see: Function that gets the stepper 25 times a second.

    Returns:
        The stepper at the end, and the displacements of the balls relative to the hand, (num_envs, 2), m: after the table has sunk, and
        after the hand was shaken.
    """
    sim = stepper.Stepper(stepper.load(scene()), len(masses))
    sim.randomize({"body_mass[ball]": masses})
    ball, palm, h = sim.model.body("ball").id, sim.model.body("palm").id, sim.timestep
    start, moved = np.zeros(3), []
    top = sim.mocap_pos[0, 0, 2]
    for k in range(round((CLOSE + SINK + SHAKE) / h)):
        time = k * h
        sim.mocap_pos[:, 0, 2] = top - 0.2 * max(min(time - CLOSE, SINK), 0.0)
        swing = SWING * np.sin(2 * np.pi * RATE * max(time - CLOSE - SINK, 0.0))
        sim.step(np.tile([*np.full(3, tension * min(time / 0.3, 1.0)), swing], (len(masses), 1)))
        place = sim.xpos[:, ball] - sim.xpos[:, palm]
        if k == round(CLOSE / h):
            start = np.array(place)
        if k in (round((CLOSE + SINK) / h), round((CLOSE + SINK + SHAKE) / h) - 1):
            moved.append(np.linalg.norm(place - start, axis=1))
        if see is not None and k % round(0.04 / h) == 0:
            see(sim)
    return sim, np.stack(moved, axis=1)


def largest(tension: float, masses: Array) -> tuple[float, float]:
    """Largest masses up to which every ball is held at rest, and while the hand is shaken, kg; 0 if none is held."""
    kept = hold(masses, tension)[1] < LOST
    held = [masses[: int(np.logical_and.accumulate(column).sum())] for column in kept.T]
    return held[0].max(initial=0.0), held[1].max(initial=0.0)


def film(file: Path) -> None:
    """Write a film of a ball of 0.2 kg that tensions of 40 N hold."""
    # So that the table needs neither.
    from PIL import Image  # noqa: PLC0415
    from stepper.viewer import Renderer  # noqa: PLC0415

    frames: list[Any] = []
    camera = {"distance": 0.34, "azimuth": 60.0, "elevation": -12.0, "lookat": (0.0, 0.0, 0.155)}

    def see(sim: stepper.Stepper) -> None:
        frames.append(Image.fromarray(renderer.render(sim)))

    with Renderer(stepper.load(scene()), width=320, height=320, camera_config=camera) as renderer:
        hold(np.array([0.2]), 40.0, see)
    file.parent.mkdir(parents=True, exist_ok=True)
    frames[0].save(file, save_all=True, append_images=frames[1:], duration=40, loop=0)


def main() -> None:
    """Print the largest masses by tension, and write the film if its name is given."""
    print("| tension | held at rest | held while shaken |\n|---|---|---|")
    for tension in (5.0, 10.0, 20.0, 40.0):
        still, shaken = largest(tension, np.linspace(0.01, 0.6, 60))
        print(f"| {tension:.0f} N | {still:.2f} kg | {shaken:.2f} kg |")
    if len(sys.argv) > 1:
        film(Path(sys.argv[1]))


if __name__ == "__main__":
    main()
