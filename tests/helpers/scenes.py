"""What the failure scenes share: the settings that a user may choose, and single bodies on a plane."""

import numpy as np
import pytest

G = 9.81
DTS = [1e-4, 1e-3, 5e-3, 2e-2]
CHOICES = [{"integrator": i, "stabilization": s} for i in ("euler", "midpoint") for s in ("baumgarte", "split")]

every_dt = pytest.mark.parametrize("dt", DTS)
every_choice = pytest.mark.parametrize("choice", CHOICES, ids=lambda c: "-".join(c.values()))


def on_plane(geom: str, friction: float, height: float, slope: float = 0.0) -> str:
    """A body with one geom that touches a plane inclined about the y axis (rad), downhill towards +x; height is from plane to centre."""
    x, z = (float(height * part) for part in (np.sin(slope), np.cos(slope)))
    return f"""<mujoco><compiler angle="radian"/><option gravity="0 0 -{G}"/><default><geom friction="{friction} 0 0"/></default>
      <worldbody><geom type="plane" size="0 0 1" euler="0 {slope} 0"/>
      <body pos="{x} 0 {z}" euler="0 {slope} 0"><freejoint/><geom {geom}/></body></worldbody></mujoco>"""


BOX = 'type="box" size=".2 .15 .05" mass="1.3"'
