"""Parameters of a planar walker that a trained policy depends on, for `stepper calibrate`.

The policy was trained in Gymnasium's Walker2d-v5, where it observes the true state. Here its observations have noise,
and its motors have delay, dry friction and uncertain torque. The outcome is the way in 1.2 s. Whether the walker falls later is chaotic: no
tolerance that was tried predicts it.

    stepper calibrate examples/studies/walker_transfer.py --margin 0.2
    stepper calibrate examples/studies/walker_transfer.py --margin 0.2 --setting "hard contact"

docs/benchmarks/reality.md has results.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import stepper
import stepper.policies
from stepper.lab import Outcome, Parameter

POLICY = stepper.policies.load(Path(__file__).resolve().parent.parent / "policies/walker2d.npz")

MODEL = Path(gymnasium.__file__).parent / "envs/mujoco/assets/walker2d_v5.xml"


def walk(now: Any) -> Any:
    """Controls of the policy, (num_envs, 6): it observes positions without x and clipped velocities, both with noise."""
    place, rate = (now.rng(name).normal(n) for name, n in (("encoders", 8), ("rates", 9)))
    qpos = now.qpos[:, 1:] + now.parameters["encoder noise"][:, None] * place
    qvel = now.qvel + now.parameters["rate noise"][:, None] * rate
    return POLICY(np.concatenate([qpos, np.clip(qvel, -10.0, 10.0)], axis=1))


study = stepper.lab.Study(
    name="walker_transfer",
    model=str(MODEL),
    controller=walk,
    outcomes=[
        Outcome(name="way", measure="body torso x", reduce="change", unit="m"),
        Outcome(name="lowest trunk", measure=lambda now: now.qpos[:, 1], reduce="min", unit="m"),
    ],
    parameters={
        "friction": Parameter("geom_friction[*][0]", operation="scale", low=0.7, high=1.2, source="rubber, dusty to clean"),
        "torque": Parameter("actuator_gainprm[*][0]", operation="scale", low=0.9, high=1.1, source="servos, hot to cold"),
        "damping": Parameter("dof_damping[*_joint]", operation="scale", low=0.5, high=2.0, source="grease of gears, warm to cold"),
        "dry friction": Parameter("dof_frictionloss[*_joint]", low=0.0, high=0.5, nominal=0.1, unit="N m", source="gears, new to worn"),
        "motor delay": Parameter("actuator.delay", low=0.0, high=0.002, nominal=0.0, unit="s", source="fast buses, 0 to 2 ms"),
        "encoder noise": Parameter("controller", low=0.0, high=0.005, nominal=0.001, unit="rad", source="magnetic encoders"),
        "rate noise": Parameter("controller", low=0.0, high=0.1, nominal=0.02, unit="rad/s", source="differences of encoders"),
    },
    settings={"hard contact": {"contact": "hard", "integrator": "midpoint"}},
    options=stepper.Options(contact="mujoco", integrator="rk4"),
    seconds=1.2,
    control=0.008,
    episodes=8,
    batch=512,
    qpos_noise=0.005,
    qvel_noise=0.005,
)
