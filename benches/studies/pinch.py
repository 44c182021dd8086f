"""Creep of pinched capsules, the cases of google-deepmind/mujoco #3328: docs/explanation/known_problems.md, docs/benchmarks/published.md.

Two pads on damped slides press a horizontal capsule of 45 g with a force F each, 19 to 95 times what friction needs. Its weight must not
move it. The outcomes are speeds after a second, which are 0 by Coulomb's law, for three kinds of contact.

    stepper report benches/studies/pinch.py
"""

from typing import Any

import mujoco
import numpy as np
import stepper
from numpy.typing import NDArray

RADIUS, MASS, FRICTION, SQUEEZE = 0.004, 0.045, 0.7, 0.002
"""Radius of the capsule, m; its mass, kg; friction of all geoms; distance of the pads' targets behind its surface, m."""
CONTACTS = {"creep": "", "creep, condim 6": 'condim="6"', "creep, stiff": 'solref=".005 1"'}
"""Attributes of the geoms of a pinch by the name of its outcome. There is a pinch for each, side by side."""


def pinches() -> mujoco.MjModel:
    """Model of pads with a capsule between them, for each kind of contact."""
    bodies, servos = "", ""
    for k, geom in enumerate(CONTACTS.values()):
        for side in (-1, 1):
            bodies += f"""<body pos="{side * (RADIUS + 0.01)} {0.1 * k} 0">
              <joint name="pad{side}{k}" type="slide" axis="1 0 0" damping="50"/>
              <geom type="box" size=".01 .02 .02" mass=".2" {geom}/></body>"""
            servos += f'<position joint="pad{side}{k}" kp="6000"/>'
        bodies += f"""<body pos="0 {0.1 * k} 0"><freejoint/>
          <geom type="capsule" size="{RADIUS} .015" zaxis="0 1 0" mass="{MASS}" {geom}/></body>"""
    return mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="0.002"/><default><geom friction="{FRICTION} .005 .0001"/></default>
      <worldbody>{bodies}</worldbody><actuator>{servos}</actuator></mujoco>""")


def creep(name: str, k: int) -> stepper.lab.Outcome:
    """Speed at which a capsule sinks, um/s."""

    def speed(now: Any) -> NDArray[np.float64]:
        # A pinch has both slides first, then the linear and the angular velocity of the capsule.
        return np.asarray(1e6 * np.abs(now.qvel[:, 8 * k + 4]))

    return stepper.lab.Outcome(name=name, measure=speed, unit="um/s")


study = stepper.lab.Study(
    name="pinch",
    model=pinches,
    controller=lambda now: np.tile([SQUEEZE, -SQUEEZE] * len(CONTACTS), (now.num_envs, 1)),
    outcomes=[creep(name, k) for k, name in enumerate(CONTACTS)],
    parameters={
        "servo stiffness": stepper.lab.Parameter(
            "actuator_kp[*]", nominal=6000.0, values=(6000.0, 15000.0, 30000.0), unit="N/m", source="12, 30 and 60 N, as reported"
        )
    },
    settings={
        "MuJoCo, elliptic, impratio 10": {"engine": "mujoco", "cone": "elliptic", "impratio": 10.0},
        "MuJoCo, elliptic, impratio 1": {"engine": "mujoco", "cone": "elliptic", "impratio": 1.0},
        "MuJoCo, pyramidal, impratio 10": {"engine": "mujoco", "cone": "pyramidal", "impratio": 10.0},
        "MuJoCo, pyramidal, impratio 1": {"engine": "mujoco", "cone": "pyramidal", "impratio": 1.0},
        "MuJoCo, elliptic, impratio 10, noslip 10": {"engine": "mujoco", "cone": "elliptic", "impratio": 10.0, "noslip_iterations": 10},
        "MuJoCo's law in stepper": {"contact": "mujoco"},
    },
    seconds=1.0,
    control=0.02,
    episodes=1,
)
