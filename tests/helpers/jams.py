"""Scenes whose bodies begin within one another."""

import numpy as np

OVERLAP = """<mujoco><worldbody><geom name="wall" size=".05"/><body><joint {joint}/>
<geom name="rod" type="capsule" size=".02" fromto="0 0 0 .3 0 0"/></body></worldbody></mujoco>"""
"""Rod whose contact has a normal that passes through its joint, with the attributes of the joint as a field."""

SLOT = """<mujoco><option gravity="0 0 0"/><worldbody>
<geom name="right" type="box" size=".05 .1 .1" pos=".15 0 0"/><geom name="left" type="box" size=".05 .1 .1" pos="-.15 0 0"/>
<body><joint type="slide" axis="1 0 0"/><geom name="block" type="box" size="{half} .05 .05"/></body></worldbody></mujoco>"""
"""Block on a slide in a slot of the half width 0.1 m, with its half width in m as a field."""


def arms(seed: int) -> str:
    """Two chains of two to four boxes on hinges in any direction, a quarter of a metre apart, with damping."""
    rng = np.random.default_rng(seed)
    links, chains = rng.integers(2, 5), ""
    for x in (-0.12, 0.12):
        chain = ""
        for k in range(links):
            axis = rng.normal(size=3)
            axis /= np.linalg.norm(axis)
            size = rng.uniform(0.03, 0.08, 3)
            pos = np.array([x, 0, 0.5]) if k == 0 else rng.uniform(-0.08, 0.08, 3) + np.array([0, 0, 0.08])
            angles = rng.uniform(-180, 180, 3)
            if k == 0:
                pos = pos + rng.uniform(-0.05, 0.05, 3)
            at = rng.uniform(-0.05, 0.05, 3)
            chain += (
                f'<body pos="{_text(pos)}"><joint axis="{_text(axis)}" damping=".1"/><geom type="box" size="{_text(size)}" '
                f'pos="{_text(at)}" euler="{_text(angles)}" mass="{rng.uniform(0.2, 2)}"/>'
            )
        chains += chain + "</body>" * links
    return f'<mujoco><option timestep=".002"/><worldbody>{chains}</worldbody></mujoco>'


def _text(numbers: np.ndarray) -> str:
    return " ".join(map(str, numbers))
