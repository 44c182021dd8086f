"""Study of gymnasium-robotics' Fetch arm (`pip install --no-deps gymnasium-robotics`) and its cube with random controls.

The results are in docs/benchmarks/studies.md.
"""

import stepper
from stepper.shared.machine import package_file

study = stepper.lab.Study(
    name="fetch",
    model=package_file("gymnasium_robotics", "envs/assets/fetch/pick_and_place.xml", "for its Fetch"),
    controller="random",
    seconds=0.5,
    episodes=8,
    qvel_noise=0.05,
)
