"""Study of Unitree's G1 from mjlab (`pip install --no-deps mjlab`), standing with position servos: docs/benchmarks/studies.md.

The robot starts just above the floor with straight legs and small random velocities. In this study its wrists have no armature, so that the
damping of the servos is stiff. Euler's rule with explicit damping diverges at time steps of 0.125 ms and more.
"""

from typing import Any

import mujoco
import stepper
from stepper.shared.machine import package_file

KP, KD = 200.0, 10.0
"""Servo gains: stiffness, N m/rad, and damping, N m s/rad."""


def robot() -> Any:
    """Model of the G1 from the package mjlab on a plane, with a position servo for each hinge."""
    spec = mujoco.MjSpec.from_file(str(package_file("mjlab", "asset_zoo/robots/unitree_g1/xmls/g1.xml", "for Unitree's G1")))
    spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[5, 5, 1])
    for joint in spec.joints:
        if joint.type == mujoco.mjtJoint.mjJNT_HINGE:
            spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT).set_to_position(kp=KP, kv=KD)
    return spec.compile()


study = stepper.lab.Study(
    name="g1",
    model=robot,
    outcomes=[
        stepper.lab.Outcome(name="pelvis", measure="body pelvis z", reduce="min", success=">= 0.7", unit="m"),
        stepper.lab.Outcome(name="way", measure="body pelvis x", reduce="change", unit="m"),
    ],
    parameters={
        "friction": stepper.lab.Parameter("geom_friction[floor,*_foot*][0]", low=0.2, high=1.0, source="wet tiles to rubber on concrete"),
        "payload": stepper.lab.Parameter("body_mass[torso_link]", operation="scale", low=0.8, high=1.8, source="a rucksack"),
        "stiffness": stepper.lab.Parameter("actuator_kp", operation="scale", low=0.05, high=1.5, source="usual gains: 10 to 300 N m/rad"),
    },
    seconds=0.5,
    episodes=4,
    qvel_noise=0.1,
)
