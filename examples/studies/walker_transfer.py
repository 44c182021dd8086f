"""Which parameters of a planar walker must be measured, so that a trained policy walks as often on the robot as in the simulator.

The policy was trained in Gymnasium's Walker2d-v5, where it observes the true state. Here it observes encoders and an inertial unit with
delay and noise, and its motors have delay, dry friction and uncertain torque.

    stepper calibrate examples/studies/walker_transfer.py --margin 0.15
    stepper calibrate examples/studies/walker_transfer.py --margin 0.15 --setting "hard contact"
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
import stepper
import stepper.policies
from stepper.lab import Outcome, Parameter

POLICY = stepper.policies.load(Path(__file__).resolve().parent.parent / "policies/walker2d.npz")
LOWEST = 0.8
"""Height of the trunk below which the walker has fallen, m."""


def robot() -> Any:
    """Gymnasium's model, with sensors of the positions and velocities of its joints, the three of the trunk among them."""
    spec = mujoco.MjSpec.from_file(str(Path(gymnasium.__file__).parent / "envs/mujoco/assets/walker2d_v5.xml"))
    names = [joint.name for joint in spec.joints]
    for kind, some in (("JOINTPOS", names[1:]), ("JOINTVEL", names)):
        for name in some:
            sensor = f"{kind[5:].lower()}_{name}"
            spec.add_sensor(name=sensor, type=getattr(mujoco.mjtSensor, f"mjSENS_{kind}"), objtype=mujoco.mjtObj.mjOBJ_JOINT, objname=name)
    return spec.compile()


def walk(now: Any) -> Any:
    """Controls of the policy, (num_envs, 6), from the sensors: positions without x, and velocities clipped to 10 m/s and rad/s."""
    readings = now.sensordata
    return POLICY(np.concatenate([readings[:, :8], np.clip(readings[:, 8:], -10.0, 10.0)], axis=1))


study = stepper.lab.Study(
    name="walker_transfer",
    model=robot,
    controller=walk,
    outcomes=[
        Outcome(name="lowest trunk", measure=lambda now: now.qpos[:, 1], reduce="min", success=f">= {LOWEST}", unit="m"),
        Outcome(name="way", measure="body torso x", reduce="change", unit="m"),
    ],
    parameters={
        "friction": Parameter("geom_friction[*][0]", operation="scale", low=0.7, high=1.2, source="rubber, dusty to clean"),
        "torque": Parameter("actuator_gear[*][0]", operation="scale", low=0.9, high=1.1, source="torque constants of servos, hot to cold"),
        "damping": Parameter("dof_damping[*_joint]", operation="scale", low=0.5, high=2.0, source="grease of gears, warm to cold"),
        "dry friction": Parameter("dof_frictionloss[*_joint]", low=0.0, high=0.5, nominal=0.1, unit="N m", source="gears, new to worn"),
        "motor delay": Parameter("actuator.delay", low=0.0, high=0.002, nominal=0.0, unit="s", source="fast buses, 0 to 2 ms"),
        "sensor delay": Parameter("sensor.delay[*]", low=0.0, high=0.002, nominal=0.0, unit="s", source="fast buses, 0 to 2 ms"),
        "encoder noise": Parameter("sensor.noise_std[pos_*]", low=0.0, high=0.005, nominal=0.001, unit="rad", source="magnetic encoders"),
        "rate noise": Parameter("sensor.noise_std[vel_*]", low=0.0, high=0.1, nominal=0.02, unit="rad/s", source="differences of encoders"),
    },
    settings={"hard contact": {"contact": "hard", "integrator": "midpoint"}},
    options=stepper.Options(contact="mujoco", integrator="rk4"),
    seconds=3.0,
    control=0.008,
    episodes=16,
    qpos_noise=0.005,
    qvel_noise=0.005,
)
