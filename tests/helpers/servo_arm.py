"""An arm with a motor and two sensors, and where a drive leaves it: what policies of all kinds are tried on."""

from pathlib import Path
from typing import Any

import stepper

ARM = """<mujoco><option timestep=".002"/><worldbody><body><joint name="hinge" axis="0 1 0" damping="1"/><geom size=".05" pos=".2 0 0"/>
  </body></worldbody><actuator><motor name="motor" joint="hinge"/></actuator>
  <sensor><jointpos name="angle" joint="hinge"/><jointvel name="rate" joint="hinge"/></sensor></mujoco>"""


def angles(drive: Any, folder: Path, batch: int = 64) -> list[float]:
    """Angle of the arm after each of four episodes from starts of their own, with a folder for every size of a batch."""
    study = stepper.lab.Study(
        model=ARM,
        controller=drive,
        seconds=0.4,
        episodes=4,
        batch=batch,
        qpos_noise=0.3,
        outcomes=stepper.lab.Outcome(name="angle", measure="joint hinge"),
    )
    return [row["outcomes"]["angle"] for row in stepper.lab.sweep(study, folder / f"batches of {batch}").sweep.table.rows]
