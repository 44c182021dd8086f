"""The recorded episode in benches/tests/episode, from which benches/src/replay.rs tests its reader.

After a change of the format of recordings, models or states:

    PYTHONPATH=python:tests/helpers .venv/bin/python tests/helpers/bench_episode.py
"""

import shutil
from pathlib import Path

import numpy as np
import stepper
from recordings import edit_header

EPISODE = Path(__file__).parents[2] / "benches/tests/episode"
PENDULUM = """
<mujoco><worldbody><body><joint name="hinge" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -.5" size=".05"/></body></worldbody>
<actuator><motor joint="hinge"/></actuator></mujoco>"""


def record(folder):
    """Records every kind of call that the reader of the benches repeats, without anything of the machine."""
    sim = stepper.Stepper(stepper.load(PENDULUM), 2)
    with sim.record(folder, note="pendulums"):
        sim.step([[0.1], [0.2]])
        sim.step([[0.3], [0.4]], nstep=2)
        sim.reset(np.array([False, True]), qpos=[[0.0], [0.4]])
        sim.step()
        sim.reset(np.array([1, 0]), qvel=[0.1], seed=3)
        sim.step(nstep=3)
        sim.qfrc_applied[:] = 0.5
        sim.step()
    edit_header(folder, lambda head: head.update(provenance={"versions": {"stepper": head["provenance"]["versions"]["stepper"]}}))


if __name__ == "__main__":
    shutil.rmtree(EPISODE, ignore_errors=True)
    record(EPISODE)
