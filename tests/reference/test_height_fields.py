"""Heights under places are where MuJoCo's rays meet the field, and where what falls comes to rest."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
import stepper
from models import SOURCES, stepper_model
from stepper.sensors import HeightField


def scene(turn=30.0, rows=7, columns=11):
    hills = " ".join(f"{x:.6f}" for x in np.random.default_rng(2).uniform(0, 1, rows * columns))
    return f"""<mujoco><asset><hfield name="hills" nrow="{rows}" ncol="{columns}" size="2 1.5 .4 .1" elevation="{hills}"/></asset>
      <worldbody><geom name="ground" type="hfield" hfield="hills" pos=".3 -.2 .15" euler="0 0 {turn}"/>
      <geom name="floor" type="plane" size="1 1 1" pos="0 0 -9"/>
      <body name="base" pos=".1 .2 2"><freejoint/><geom name="ball" size=".05"/></body></worldbody></mujoco>"""


def downwards(m, data, x, y):
    """Height at which a ray of MuJoCo's from above meets the ground."""
    geom = np.array([-1], np.int32)
    far = mujoco.mj_ray(m, data, np.array([x, y, 5.0]), np.array([0.0, 0.0, -1.0]), None, 1, -1, geom, None)
    return 5.0 - far, geom[0]


def test_heights_are_where_mujocos_rays_meet_the_field():
    m = mujoco.MjModel.from_xml_string(scene())
    data = mujoco.MjData(m)
    data.qpos[:3] = 50.0
    mujoco.mj_forward(m, data)
    model = stepper.load(scene())
    ground, sim = HeightField(model, "ground"), stepper.Stepper(model, 3)
    places = np.random.default_rng(0).uniform(-1.2, 1.2, (3, 200, 2))
    found = np.empty((3, 200))
    assert ground.heights(sim, places, out=found) is found
    inside = 0
    for k in range(3):
        for (x, y), height in zip(places[k], found[k], strict=True):
            expected, geom = downwards(m, data, x, y)
            if geom == 0:  # Beyond the border the ray meets the floor.
                inside += 1
                assert height == pytest.approx(expected, abs=1e-9)
            else:
                assert np.isnan(height)
    assert inside > 500
    np.testing.assert_array_equal(ground.heights(sim, places[0]), np.broadcast_to(found[0], (3, 200)))
    assert (ground.heights(sim, [[40.0, 0.0]], beyond=-1.0) == -1.0).all()


def test_a_scan_turns_with_the_body():
    model = stepper.load(scene())
    ground, sim = HeightField(model, "ground"), stepper.Stepper(model, 2)
    half = np.array([0.0, 0.6])
    quats = np.stack([np.cos(half), 0 * half, 0 * half, np.sin(half)], axis=1)
    sim.reset(qpos=np.hstack([[[0.1, 0.2, 2.0], [-0.3, 0.1, 1.0]], quats]))
    offsets = np.array([[0.4, 0.0], [0.0, 0.3], [-0.2, -0.1]])
    found = ground.scan(sim, "base", offsets)
    c, s = np.cos(1.2), np.sin(1.2)
    turned = offsets @ np.array([[c, s], [-s, c]])
    np.testing.assert_allclose(found[0], ground.heights(sim, offsets + np.array([0.1, 0.2]))[0], rtol=1e-12)
    np.testing.assert_allclose(found[1], ground.heights(sim, turned + np.array([-0.3, 0.1]))[1], rtol=1e-12)
    assert HeightField(model, "ground").scan(stepper.Stepper(model), 1, offsets).shape == (3,)


def test_an_environments_own_place_of_the_field_counts():
    model = stepper.load(scene(turn=0.0))
    ground, sim = HeightField(model, 0), stepper.Stepper(model, 2)
    pos = np.tile(model.geom_pos, (2, 1, 1))
    pos[1, 0] += [0.25, 0.1, 0.5]
    sim.randomize(geom_pos=pos)
    places = np.array([[[0.3, 0.1]], [[0.55, 0.2]]])
    heights = ground.heights(sim, places)
    assert heights[1] == pytest.approx(heights[0] + 0.5, abs=1e-12)


def test_what_falls_comes_to_rest_on_the_ground():
    """dm_control's escape terrain is its own in each episode; here are hills in its field, and balls between them."""
    model = stepper.load(scene(turn=0.0, rows=31, columns=41))
    ground, sim = HeightField(model, "ground"), stepper.Stepper(model, 8)
    rng = np.random.default_rng(5)
    qpos = np.tile(model.qpos0, (8, 1))
    qpos[:, :2] += rng.uniform(-0.5, 0.5, (8, 2))
    sim.reset(qpos=qpos)
    sim.step(nstep=1500)
    under = ground.heights(sim, sim.qpos[:, None, :2])[:, 0]
    above = sim.qpos[:, 2] - under
    # A ball of 5 cm lies in cells of 10 cm: above the point under it, and lower than it is wide.
    assert (above > 0.049).all()
    assert (above < 0.2).all()


def test_a_field_of_a_package_is_read():
    """dm_control's quadruped escapes over a field."""
    model = stepper_model("dm_control/quadruped", strict=False)
    fields = [k for k in range(model.ngeom) if model.geom(k).type == "hfield"]
    if not fields:
        pytest.skip("its file has no height field")
    m = mujoco.MjModel.from_xml_path(str(SOURCES["dm_control/quadruped"]))
    ground = HeightField(model, fields[0], source=str(SOURCES["dm_control/quadruped"]))
    assert ground.elevation.shape == (m.hfield_nrow[0], m.hfield_ncol[0])
    np.testing.assert_array_equal(ground.half, m.hfield_size[0, :2])


@pytest.mark.parametrize(("call", "said"), [
    (lambda model: HeightField(model, "ball"), "geom 'ball' is a sphere, must be a height field"),
    (lambda model: HeightField(model, "ground", source="<mujoco/>"), "the source is of another model"),
    (lambda model: HeightField(model, 0).heights(stepper.Stepper(model, 2), np.zeros((3, 4, 2))), r"places has shape \(3, 4, 2\)"),
    (lambda model: HeightField(model, "ground").scan(stepper.Stepper(model, 2), 1, np.zeros(2)), r"offsets has shape \(2,\)"),
    (lambda model: HeightField(stepper.load(scene().replace('euler="0 0 30.0"', 'euler="20 0 0"')), "ground"), "is inclined"),
])  # fmt: skip
def test_what_is_wrong_is_said(call, said):
    with pytest.raises(ValueError, match=said):
        call(stepper.load(scene()))


def test_a_model_whose_source_is_not_known_asks_for_it(tmp_path: Path):
    import subprocess
    import sys

    stepper.load(scene()).save(tmp_path / "hills.stepper")
    code = "import sys, stepper; m = stepper.load(sys.argv[1]); stepper.sensors.HeightField(m, 'ground')"
    ended = subprocess.run([sys.executable, "-c", code, str(tmp_path / "hills.stepper")], capture_output=True, text=True, check=False)
    assert "give source=" in ended.stderr
