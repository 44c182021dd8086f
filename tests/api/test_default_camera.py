"""The free camera without settings shows all that moves; no OpenGL is needed."""

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from stepper.viewer.renderer import distance_to, middle_of, region_of

ARM = """<mujoco><worldbody><geom type="plane" size="0 0 1"/><geom name="far wall" type="box" size="1 1 1" pos="50 0 0"/>
  <body pos="0 0 1"><joint name="first" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 {reach} 0 0" size=".02"/>
  <body pos="{reach} 0 0"><joint axis="0 1 0"/><geom size=".05" pos=".2 0 0"/></body></body></worldbody></mujoco>"""
FREE = """<mujoco><worldbody><geom type="plane" size="5 5 1"/><body pos="{} {} {}"><freejoint/>
  <geom type="{}" size="{} {} {}" euler="{} {} {}"/></body><body pos="2 0 0"><freejoint/><geom size=".3"/></body></worldbody></mujoco>"""


def framed(m, azimuth=90.0, elevation=-45.0, aspect=4 / 3):
    """Data at the reference pose, and the camera that shows it."""
    d = mujoco.MjData(m)
    mujoco.mj_forward(m, d)
    region = region_of(mujoco, m, d)
    camera = mujoco.MjvCamera()
    camera.azimuth, camera.elevation, camera.lookat[:] = azimuth, elevation, middle_of(*region)
    camera.distance = distance_to(*region, camera, m.vis.global_.fovy, aspect)
    return d, camera


def in_the_picture(m, d, camera, points, aspect=4 / 3):
    """Coordinates of points in the picture, (n, 2): from -1 to 1 if they are inside. By MuJoCo's own camera of the scene."""
    scene, option = mujoco.MjvScene(m, maxgeom=100), mujoco.MjvOption()
    mujoco.mjv_updateScene(m, d, option, None, camera, mujoco.mjtCatBit.mjCAT_ALL, scene)
    eyes = [scene.camera[k] for k in range(2)]  # For stereo pictures; the camera is in the middle.
    eye = np.mean([view.pos for view in eyes], axis=0)
    forward, upward = np.array(eyes[0].forward, float), np.array(eyes[0].up, float)
    offsets = points - eye
    depth = offsets @ forward
    assert (depth > 0).all()
    half = np.tan(np.radians(m.vis.global_.fovy) / 2)
    return np.stack([offsets @ np.cross(forward, upward) / (half * aspect), offsets @ upward / half], axis=1) / depth[:, None]


@settings(max_examples=30, deadline=None)
@given(
    pose=st.tuples(*[st.floats(-3, 3)] * 3),
    kind=st.sampled_from(["box", "ellipsoid", "cylinder"]),
    size=st.tuples(*[st.floats(0.02, 2)] * 3),
    angles=st.tuples(*[st.floats(-180, 180)] * 3),
    view=st.tuples(st.floats(-180, 180), st.floats(-85, 85), st.floats(0.3, 3)),
)
def test_free_bodies_are_in_the_picture(pose, kind, size, angles, view):
    """All corners of both bodies are in the picture, and the outermost is beyond a third of the way from its middle to an edge.

    The near side of the scene sets the distance of the camera, so that corners on the far side may be closer to the middle.
    """
    m = mujoco.MjModel.from_xml_string(FREE.format(*pose, kind, *size, *angles))
    azimuth, elevation, aspect = view
    d, camera = framed(m, azimuth, elevation, aspect)
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    points = np.concatenate([
        d.geom_xpos[k] + (m.geom_aabb[k, :3] + corners * m.geom_aabb[k, 3:]) @ d.geom_xmat[k].reshape(3, 3).T for k in (1, 2)
    ])  # fmt: skip
    reach = np.abs(in_the_picture(m, d, camera, points, aspect)).max()
    assert 0.33 < reach < 1.0


@pytest.mark.parametrize("reach", [0.0, 0.3, 2.0])
def test_an_arm_stays_in_the_picture_when_it_turns(reach):
    """A wall 50 m away does not count, a turn of the first joint does."""
    m = mujoco.MjModel.from_xml_string(ARM.format(reach=reach + 0.01))
    d, camera = framed(m)
    assert camera.distance < 10 * (reach + 0.3)
    for angle in np.linspace(-3, 3, 13):
        d.qpos[0] = angle
        mujoco.mj_forward(m, d)
        assert np.abs(in_the_picture(m, d, camera, d.geom_xpos[2:])).max() < 1.0


def test_a_scene_in_which_nothing_moves_is_shown():
    m = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><geom type='plane' size='5 5 1'/><geom size='1' pos='9 0 0'/></worldbody></mujoco>"
    )
    _, camera = framed(m)
    assert camera.lookat.tolist() == [9, 0, 0]
    empty = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom type='plane' size='5 5 1'/></worldbody></mujoco>")
    assert 1 < framed(empty)[1].distance < 10
