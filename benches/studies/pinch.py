"""Creep of a pinched capsule, the case of google-deepmind/mujoco #3328: docs/explanation/known_problems.md.

Two pads on damped slides press a horizontal capsule of 45 g with a force F each, 19 to 95 times what friction needs. Its weight must not
move it. The outcome is its speed after a second, which is 0 by Coulomb's law.

    stepper report benches/studies/pinch.py
"""

import mujoco
import numpy as np
import stepper

RADIUS, MASS, FRICTION, SQUEEZE = 0.004, 0.045, 0.7, 0.002
"""Radius of the capsule, m; its mass, kg; friction of all geoms; distance of the pads' targets behind its surface, m."""


def pads() -> mujoco.MjModel:
    """Model of the pads and the capsule between them."""
    pad = """<body pos="{x} 0 0"><joint name="{name}" type="slide" axis="1 0 0" damping="50"/>
      <geom type="box" size=".01 .02 .02" mass=".2"/></body>"""
    pads = "".join(pad.format(name=name, x=side * (RADIUS + 0.01)) for name, side in (("left", -1), ("right", 1)))
    servos = "".join(f'<position joint="{name}" kp="6000"/>' for name in ("left", "right"))
    return mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="0.002"/><default><geom friction="{FRICTION} .005 .0001"/></default>
      <worldbody>{pads}<body name="capsule"><freejoint/>
      <geom type="capsule" size="{RADIUS} .015" zaxis="0 1 0" mass="{MASS}"/></body></worldbody>
      <actuator>{servos}</actuator></mujoco>""")


study = stepper.lab.Study(
    name="pinch",
    model=pads,
    controller=lambda now: np.tile([SQUEEZE, -SQUEEZE], (now.num_envs, 1)),
    # qvel has both slides first, then the linear velocity of the capsule.
    outcomes=stepper.lab.Outcome(name="creep", measure=lambda now: 1e6 * np.abs(now.qvel[:, 4]), unit="um/s"),
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
