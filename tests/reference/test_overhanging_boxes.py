"""Points of two boxes of which one reaches over the edge of the other, their faces inclined a little, beside MuJoCo's."""

import mujoco
import numpy as np
import pytest
import stepper
from rotations import about, product

SCENE = """
<mujoco>
  <option gravity="0 0 0"/>
  <worldbody>
    <body name="below"><freejoint/><geom type="box" size="0.008 0.008 0.004" mass="0.1"/></body>
    <body name="above" pos="0 0 0.025"><freejoint/><geom type="box" size="0.021 0.021 0.021" mass="0.1"/></body>
  </worldbody>
</mujoco>
"""
DEPTH = 1.5e-4
"""Overlap of the faces, m."""


def poses(aside: float, tilt: float, count: int) -> np.ndarray:
    """The box above shifted by `aside` (m), turned by up to 0.3 rad about the vertical, and inclined by `tilt` (rad): (count, 14)."""
    rng = np.random.default_rng(0)
    qpos = np.zeros((count, 14))
    qpos[:, 3] = 1.0
    for row in qpos:
        axis = rng.normal(size=2)
        turn, inclined = about([0, 0, 1], rng.uniform(-0.3, 0.3)), about([*axis / np.linalg.norm(axis), 0], tilt)
        row[7:10], row[10:] = (0.003, aside, 0.025 - DEPTH), product(inclined, turn)
    return qpos


def single(aside: float, tilt: float, count: int = 200) -> tuple[int, int]:
    """Pairs of `count` that touch in one point alone: here, and in MuJoCo."""
    qpos = poses(aside, tilt, count)
    sim = stepper.Stepper(stepper.load(SCENE), count)
    sim.reset(qpos=qpos)
    sim.step()
    ours = np.bincount(sim.contacts()["env"], minlength=count)
    model = mujoco.MjModel.from_xml_string(SCENE)
    data, theirs = mujoco.MjData(model), np.zeros(count, dtype=int)
    for env in range(count):
        data.qpos[:] = qpos[env]
        mujoco.mj_forward(model, data)
        theirs[env] = data.ncon
    assert ours.min() >= 1
    return int((ours == 1).sum()), int((theirs == 1).sum())


@pytest.mark.parametrize("tilt", [1e-6, 1e-4, 4e-4])
@pytest.mark.parametrize("aside", [0.002, 0.018])
def test_boxes_within_and_over_an_edge_touch_in_patches(aside, tilt):
    """Inclined by less than a tenth of what the faces overlap over their length: where edges cross the faces are as near all around."""
    assert single(aside, tilt) == (0, 0)


@pytest.mark.parametrize("tilt", [1e-4, 1e-3])
def test_overhanging_boxes_touch_where_mujocos_do(tilt):
    """Same normals and distances under MuJoCo's law, in every pair, to the rounding of poses."""
    qpos = poses(0.018, tilt, 50)
    sim = stepper.Stepper(stepper.load(SCENE), len(qpos), options=stepper.Options(contact="mujoco"))
    sim.reset(qpos=qpos)
    sim.step()
    contacts = sim.contacts()
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    for env, q in enumerate(qpos):
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        own = contacts[contacts["env"] == env]
        np.testing.assert_allclose(np.abs(own["normal"] @ data.contact.frame[0, :3]), 1.0, atol=1e-14)
        np.testing.assert_allclose(np.sort(own["distance"]), np.sort(data.contact.dist), atol=1e-14)


@pytest.mark.parametrize(
    "above",
    ['type="box" size="0.021 0.021 0.021"', 'type="mesh" mesh="cube"', 'type="capsule" size="0.021 0.021" euler="0 90 0"'],
    ids=["box", "mesh", "capsule"],
)
@pytest.mark.parametrize("tilt", [1e-4, 1e-3])
def test_what_reaches_over_an_edge_touches_along_all_that_is_near(above, tilt):
    """A box, a mesh of the same shape and a lying capsule over the edge of a box: four points and two, at true distances."""
    corners = " ".join(f"{x} {y} {z}" for x in (-0.021, 0.021) for y in (-0.021, 0.021) for z in (-0.021, 0.021))
    xml = SCENE.replace("<worldbody>", f'<asset><mesh name="cube" vertex="{corners}"/></asset><worldbody>')
    xml = xml.replace('type="box" size="0.021 0.021 0.021"', above)
    qpos = poses(0.004 if "capsule" in above else 0.018, tilt, 50)
    sim = stepper.Stepper(stepper.load(xml), len(qpos))
    sim.reset(qpos=qpos)
    sim.step()
    contacts = sim.contacts()
    assert (np.bincount(contacts["env"], minlength=len(qpos)) == (2 if "capsule" in above else 4)).all()
    # No point is deeper than the faces' overlap and what an inclination lifts over their length.
    assert (np.abs(contacts["distance"] + DEPTH) <= 0.04 * tilt).all()
