"""Logs for Rerun have what happened."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import stepper
from stepper.viewer import RerunLog, log_rerun

SCENE = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 .1"/>
  <body name="box" pos="0 0 .12"><freejoint/>
  <geom name="cube" type="box" size=".1 .1 .1" mass="2" rgba="1 0 0 1"/></body></worldbody></mujoco>"""


def printed(file):
    """What Rerun's own command says is in a file."""
    command = [str(Path(sys.executable).with_name("rerun")), "rrd", "print", "-vvv", str(file)]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


@pytest.mark.parametrize("of", ["a simulation", "a recording"])
def test_a_log_has_places_contacts_and_scalars(tmp_path, of):
    sim = stepper.Stepper(stepper.load(SCENE), 2)
    file = tmp_path / "run.rrd"
    if of == "a simulation":
        with RerunLog(sim, file, envs=[1]) as log:
            for _ in range(20):
                sim.step()
                log.log()
    else:
        with sim.record(tmp_path / "run"):
            for _ in range(20):
                sim.step()
        assert log_rerun(tmp_path / "run", file, envs=[1]) == 20
    text = printed(file)
    for entity in ("/env_1/box", "/env_1/box/cube", "/env_1/world/floor", "/env_1/contacts", "/scalars/env_1/residual"):
        assert entity in text, entity
    assert "/env_0/box" not in text
    assert "simulated" in text
    # The last place of the box, in single precision, and its energy.
    height = np.float32(sim.xpos[1, 1, 2])
    assert str(height)[:6] in text
    assert f"{sim.energy()[0][1]:.6f}"[:6] in text


def test_a_log_has_spatial_tendons(tmp_path):
    """The log has the wrapped path of a tendon as a line."""
    scene = """<mujoco><worldbody><site name="hook" pos="0 0 1"/>
      <body pos=".6 0 .3"><freejoint/><geom size=".05"/><site name="load"/></body></worldbody>
      <tendon><spatial><site site="hook"/><site site="load"/></spatial></tendon></mujoco>"""
    with RerunLog(stepper.Stepper(stepper.load(scene)), tmp_path / "run.rrd") as log:
        log.log()
    text = printed(tmp_path / "run.rrd")
    assert "/env_0/tendons" in text
    assert "LineStrips3D" in text


def test_a_folder_that_is_not_there_is_named(tmp_path):
    sim = stepper.Stepper(stepper.load(SCENE))
    with pytest.raises(FileNotFoundError, match=r"there is no folder .*none"):
        RerunLog(sim, tmp_path / "none" / "a.rrd")


def test_a_log_has_the_sizes_that_environments_have(tmp_path):
    sim = stepper.Stepper(stepper.load(SCENE), 2)
    file, sizes = tmp_path / "run.rrd", np.tile(sim.model.geom_size, (2, 1, 1))
    with RerunLog(sim, file) as log:
        log.log()
        sizes[1, 1] = 0.7
        sim.randomize(geom_size=sizes)
        sim.step()
        log.log()
        sim.step()
        log.log()
    text = printed(file)
    # The first moment has the boxes of both environments, the second that of the second; nothing changed until the third.
    for env, count in ((0, 1), (1, 2)):
        rows = re.findall(rf"with (\d+) rows? \([^)]*\) - /env_{env}/box/cube/", text)
        assert sum(map(int, rows)) == count
    assert "-0.7, -0.7" in text
