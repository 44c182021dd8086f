"""Study of dm_control's fish (`pip install --no-deps dm_control`) with random controls in water: docs/benchmarks/studies.md."""

import stepper
from stepper.shared.machine import package_file

study = stepper.lab.Study(
    name="fish",
    model=package_file("dm_control", "suite/fish.xml", "for its fish"),
    controller="random",
    outcomes=[
        stepper.lab.Outcome(name="way", measure="body torso", reduce="change", unit="m"),
        stepper.lab.Outcome(name="speed", measure="jointvel tail1", reduce="max", success=">= 5", unit="rad/s"),
    ],
    parameters={
        "density": stepper.lab.Parameter("density", low=500.0, high=5000.0, unit="kg/m3", source="half of water to what the file has"),
        "mass": stepper.lab.Parameter("body_mass", operation="scale", low=0.5, high=2.0, source="a guess"),
        "damping": stepper.lab.Parameter("dof_damping", operation="scale", low=0.2, high=5.0, source="a guess"),
    },
    seconds=2.0,
    episodes=8,
    qvel_noise=0.1,
)
