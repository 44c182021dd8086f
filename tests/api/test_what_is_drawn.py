"""What viewers draw: shapes and their places, moments of recordings, bodies that are dragged. It takes neither viser nor OpenGL."""

import sys
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
import stepper
import stepper.cli.view
from checks import every, raises
from geometry import matrix
from hypothesis import given, settings, strategies as st
from models import SOURCES
from stepper.cli import main
from stepper.viewer import shapes
from stepper.viewer.frames import frame_of, shown_envs, sizes_of
from stepper.viewer.live import Drag, View, effective_mass, scene_for
from stepper.viewer.looks import looks_of
from stepper.viewer.player import RecordedRun
from stepper.viewer.renderer import distance_to, middle_of, region_of
from stepper.viewer.shapes import instances, scene_of

ROOT = Path(__file__).parents[2]
BALL = "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
ALL_KINDS = """<mujoco><asset>
  <mesh name="wedge" vertex="0 0 0  .3 0 0  0 .3 0  0 0 .3"/>
  <hfield name="hills" nrow="5" ncol="7" size="1 2 .5 .1" elevation="{}"/>
  <texture name="checks" type="2d" builtin="checker" rgb1="0 0 0" rgb2="1 .5 0" width="64" height="64"/>
  <material name="tiles" texture="checks"/><material name="paint" rgba="0 1 0 1"/>
</asset><worldbody>
  <geom name="floor" type="plane" size="0 0 .1" material="tiles"/>
  <geom name="ground" type="hfield" hfield="hills" pos="5 0 0"/>
  <geom name="table" type="plane" size=".2 .1 .1" pos="0 0 .5"/>
  <body pos="0 0 1" euler="20 40 60"><freejoint/>
    <geom name="ball" size=".1" rgba="1 0 0 1"/>
    <geom name="egg" type="ellipsoid" size=".1 .2 .3" pos=".5 0 0" material="paint"/>
    <geom name="pill" type="capsule" size=".1 .2" pos="1 0 0" euler="0 90 30" rgba="0 0 1 .5"/>
    <geom name="can" type="cylinder" size=".1 .2" pos="1.5 0 0"/>
    <geom name="brick" type="box" size=".1 .2 .3" pos="2 0 0"/>
    <geom name="wedge" type="mesh" mesh="wedge" pos="2.5 0 0"/>
    <geom name="ghost" size=".1" rgba="1 1 1 0"/>
  </body>
</worldbody></mujoco>""".format(" ".join(f"{(7 * k) % 11}" for k in range(35)))
ARM = """<mujoco><worldbody><geom type="plane" size="0 0 1"/><geom name="far wall" type="box" size="1 1 1" pos="50 0 0"/>
  <body pos="0 0 1"><joint name="first" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 {reach} 0 0" size=".02"/>
  <body pos="{reach} 0 0"><joint axis="0 1 0"/><geom size=".05" pos=".2 0 0"/></body></body></worldbody></mujoco>"""
FREE = """<mujoco><worldbody><geom type="plane" size="5 5 1"/><body pos="{} {} {}"><freejoint/>
  <geom type="{}" size="{} {} {}" euler="{} {} {}"/></body><body pos="2 0 0"><freejoint/><geom size=".3"/></body></worldbody></mujoco>"""


def volume(mesh):
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces].astype(float), 1, 0)
    return np.einsum("ni,ni->", a, np.cross(b, c)) / 6


@pytest.mark.parametrize(("mesh", "exact"), [
    (shapes._SPHERE, 4 / 3 * np.pi), (shapes._CYLINDER, 2 * np.pi), (shapes._BOX, 8),
])  # fmt: skip
def test_meshes_are_closed_and_face_outwards(mesh, exact):
    # Chords of 24 segments and 12 rings lie within the round surface, by 3 % of the volume.
    assert 0.97 * exact <= volume(mesh) <= exact * (1 + 1e-6)
    assert mesh.faces.min() == 0
    assert mesh.faces.max() < len(mesh.vertices)


def test_every_kind_is_drawn():
    model = stepper.load(ALL_KINDS)
    scene = scene_of(model, looks_of(model))
    drawn = {}
    for part in scene.parts:
        for g in part.geom:
            drawn.setdefault(model.geom_names[g], []).append(part.name.split()[0])
    assert drawn == {
        "ground": ["hfield"], "table": ["plane"], "ball": ["sphere"], "egg": ["sphere"], "pill": ["tube", "sphere", "sphere"],
        "can": ["cylinder"], "brick": ["box"], "wedge": ["mesh"],
    }  # fmt: skip
    assert [model.geom_names[g] for g in scene.planes] == ["floor"]
    assert scene.missing == ()
    colours = dict(zip(model.geom_names, scene.rgba, strict=True))
    np.testing.assert_allclose(colours["ball"], [1, 0, 0, 1])
    np.testing.assert_allclose(colours["egg"], [0, 1, 0, 1])
    np.testing.assert_allclose(colours["pill"], [0, 0, 1, 0.5])
    # The mean of black and orange, by bytes of a texture.
    np.testing.assert_allclose(colours["floor"], [0.5, 0.25, 0, 1], atol=0.01)


def test_a_saved_model_is_drawn_without_its_source(tmp_path):
    stepper.load(ALL_KINDS).save(tmp_path / "model")
    for k in range(stepper.loading.origins.KEPT + 1):  # Until nobody remembers where it came from.
        stepper.load(f"<mujoco><worldbody><body name='{k}'/></worldbody></mujoco>")
    model = stepper.load(tmp_path / "model")
    with pytest.warns(UserWarning, match=r"2 geoms are not drawn \(ground, wedge\).*Pass the MJCF as source"):
        scene = scene_for(model, None)
    assert {model.geom_names[g] for part in scene.parts for g in part.geom} == {"ball", "egg", "pill", "can", "brick", "ghost"}
    assert scene_for(model, ALL_KINDS).missing == ()


def test_a_height_field_is_drawn_where_rays_meet_it():
    model = stepper.load(ALL_KINDS)
    looks = looks_of(model)
    ground = model.geom("ground").id
    part = next(part for part in scene_of(model, looks).parts if ground in part.geom)
    data = mujoco.MjData(looks)
    mujoco.mj_forward(looks, data)
    middles = part.mesh.vertices[part.mesh.faces].mean(axis=1)
    assert len(middles) == 2 * 4 * 6
    found = np.zeros(1, np.int32)
    for place in middles + data.geom_xpos[ground]:
        above = place + np.array([0.0, 0.0, 3.0])
        distance = mujoco.mj_ray(looks, data, above, np.array([0.0, 0, -1]), None, 1, -1, found)
        assert found[0] == ground
        # Vertices are of single precision, and MuJoCo's cells are split along the same diagonal.
        assert distance == pytest.approx(3, abs=1e-5)


def test_instances_are_where_mujoco_has_the_geoms():
    """Surfaces of all shapes of a robot, in two environments with sizes of their own."""
    model = stepper.load(ALL_KINDS)
    sim = stepper.Stepper(model, 2)
    sizes = np.stack([model.geom_size, 1.5 * model.geom_size])
    sim.randomize(geom_size=sizes)
    sim.set_state(qvel=[0, 0, 3, 1, 2, 3])
    sim.step(nstep=50)
    frame, scene = frame_of(sim, np.arange(2)), scene_of(model, looks_of(model))
    looks = looks_of(model)
    for env in range(2):
        data = mujoco.MjData(looks)
        data.qpos[:] = sim.qpos[env]
        mujoco.mj_forward(looks, data)
        for part in scene.parts:
            place, quat, scale = (
                rows.reshape(2, len(part.geom), -1)[env] for rows in instances(part, sizes, frame.geom_xpos, frame.geom_xquat)
            )
            for k, g in enumerate(part.geom):
                kind = model.geom(int(g)).type
                if kind in ("plane", "mesh", "hfield"):
                    continue
                points = part.mesh.vertices * scale[k] @ matrix(quat[k]).T + place[k]
                local = (points - data.geom_xpos[g]) @ data.geom_xmat[g].reshape(3, 3)
                x, y, z = sizes[env, g]
                outside = {
                    "sphere": np.linalg.norm(local, axis=1) / x,
                    "ellipsoid": np.linalg.norm(local / [x, y or 1, z or 1], axis=1),
                    "capsule": np.linalg.norm(local - np.clip(local, [0, 0, -y], [0, 0, y]), axis=1) / x,
                    "cylinder": np.maximum(np.linalg.norm(local[:, :2], axis=1) / x, np.abs(local[:, 2]) / (y or 1)),
                    "box": np.max(np.abs(local / [x, y or 1, z or 1]), axis=1),
                }[kind]
                # Every vertex is on the surface; those of a capsule's spheres that are inside it, and centres of lids, are not.
                assert outside.max() == pytest.approx(1, abs=1e-5)
                assert np.median(outside) == pytest.approx(1, abs=1e-5) or kind == "capsule"


@pytest.mark.parametrize("num_envs", [None, 3])
def test_sizes_are_those_that_environments_have(num_envs):
    """Those that are randomized, and the scene's again after; tiles and meshes keep theirs."""
    model = stepper.load(ALL_KINDS)
    scene, envs = scene_of(model, looks_of(model)), np.arange(num_envs or 1)[-2:]
    sim = stepper.Stepper(model, num_envs)
    np.testing.assert_array_equal(sizes_of(sim, envs, scene), np.tile(scene.sizes, (len(envs), 1, 1)))
    given = 1.1 * (1.0 + np.arange(num_envs or 1)[:, None, None]) * model.geom_size
    sim.randomize(geom_size=given if num_envs else given[0], geom_pos=np.broadcast_to(model.geom_pos, given.shape) if num_envs else None)
    found = sizes_of(sim, envs, scene)
    for g in range(model.ngeom):
        expected = given[envs, g] if model.geom(g).type in ("sphere", "ellipsoid", "capsule", "cylinder", "box") else scene.sizes[g]
        np.testing.assert_array_equal(found[:, g], np.broadcast_to(expected, (len(envs), 3)), err_msg=model.geom_names[g])
    np.testing.assert_array_equal(found[0, model.geom("table").id], [0.2, 0.1, 0.1])
    sim.randomize()
    np.testing.assert_array_equal(sizes_of(sim, envs, scene), np.tile(scene.sizes, (len(envs), 1, 1)))


def test_groups_that_only_collide_are_hidden_behind_what_is_seen():
    """As robosuite's robots have them: collision meshes in group 0, visual meshes in group 1."""

    def groups(*geoms):
        bodies = "".join(f'<geom size=".1" group="{group}" contype="{solid}" conaffinity="{solid}"/>' for group, solid in geoms)
        model = stepper.load(
            f"<mujoco><worldbody><body><freejoint/>{bodies}<inertial pos='0 0 0' mass='1' diaginertia='1 1 1'/></body></worldbody></mujoco>"
        )
        return scene_of(model, looks_of(model)).shown

    assert groups((0, 1)) == {0}
    assert groups((0, 1), (1, 0)) == {1}
    assert groups((0, 1), (0, 0), (1, 0)) == {0, 1}
    assert groups((2, 0), (3, 1)) == {2}


@pytest.fixture
def recorded(tmp_path):
    """A recording in which environments are reset, randomized and pushed, with all moments as they were."""
    model = stepper.load(SOURCES["dm_control/humanoid"], strict=False)
    sim = stepper.Stepper(model, 5)
    rng, moments = np.random.default_rng(0), []
    chosen = np.array([1, 3])
    with sim.record(tmp_path / "run"):
        for k in range(40):
            if k == 10:
                sim.randomize(body_mass=model.body_mass * rng.uniform(0.5, 2, (5, 1)))
            if k == 15:
                sim.reset(np.arange(5) < 3)
            if k == 20:
                sim.xfrc_applied[3, 1, 2] = 500.0
            if k == 25:
                sim.randomize()
            sim.step(rng.uniform(-0.3, 0.3, (5, model.nu)), nstep=5)
            moments.append(frame_of(sim, chosen))
    return tmp_path / "run", chosen, moments


def test_moments_of_a_recording_are_those_that_were(recorded):
    folder, chosen, moments = recorded
    run = RecordedRun(folder, chosen.tolist())
    assert len(run) == len(moments)
    assert run.source.source.endswith("humanoid.xml")
    # In any order: parameters and forces follow.
    touching = 0
    for index in (39, 0, 12, 30, 9, 10, 24, 25, 15):
        found, was = run[index], moments[index]
        for field in fields(found):
            if not field.name.startswith("contact"):
                np.testing.assert_array_equal(getattr(found, field.name), getattr(was, field.name), err_msg=f"{field.name} {index}")
        assert set(found.contact_env) <= {0, 1}
        touching += len(found.contact_env)
    assert touching > 0
    # Contacts are those of the next step.
    np.testing.assert_allclose(run[-1].time, moments[-1].time)
    assert run.sim.qpos.shape[0] == 5


def test_contacts_of_a_recording_bear_the_weight(tmp_path):
    model = stepper.load("""<mujoco><worldbody><geom type='plane' size='1 1 1'/>
      <body pos='0 0 .1'><freejoint/><geom type='box' size='.1 .1 .1' mass='2'/></body></worldbody></mujoco>""")
    sim = stepper.Stepper(model)
    with sim.record(tmp_path / "run"):
        for _ in range(20):
            sim.step()
    moment = RecordedRun(tmp_path / "run")[10]
    np.testing.assert_allclose(moment.contact_force.sum(axis=0), [0, 0, 2 * 9.81], atol=1e-4)  # It comes to rest within some steps.
    assert moment.geom_xpos.shape == (1, 2, 3)


def test_what_is_wrong_with_a_view_is_said(tmp_path):
    sim = stepper.Stepper(stepper.load(BALL), 3)
    raises(ValueError, r"envs is 4, must be a number of environments up to 3", shown_envs, sim, 4, 16)
    raises(IndexError, "envs has 3, there are environments 0 to 2", shown_envs, sim, [3], 16)
    np.testing.assert_array_equal(shown_envs(sim, None, 2), [0, 1])
    with sim.record(tmp_path / "empty"):
        pass
    raises(stepper.recording.RecordingError, "the recording contains no step to show", RecordedRun, tmp_path / "empty")


def test_the_mass_that_is_felt_is_that_of_a_free_body():
    sim = stepper.Stepper(
        stepper.load("""<mujoco><option gravity="0 0 0"/><worldbody>
        <body pos="0 0 1"><freejoint/><geom size=".1" mass="3"/></body>
        <body pos="1 0 0"><joint type="slide" axis="0 0 1"/><geom size=".1" mass="2"/></body>
        <body pos="2 0 0"><geom size=".1" mass="2"/></body>
    </worldbody></mujoco>"""),
        2,
    )
    assert effective_mass(sim, 1, 1, np.array([0.0, 0, 1])) == pytest.approx(3)
    assert effective_mass(sim, 1, 2, np.array([1.0, 0, 0])) == pytest.approx(3 * 2)  # It moves in one of three directions.
    assert Drag.begin(sim, 1, 3, np.array([2.0, 0, 0])) is None


@every(num_envs=[None, 2], strength=[1.0, 30.0])
def test_a_dragged_body_comes_to_the_pointer(num_envs, strength):
    model = stepper.load(SOURCES["dm_control/humanoid"], strict=False).replace(gravity=[0, 0, 0])
    sim = stepper.Stepper(model, num_envs)
    env, hand = (num_envs or 1) - 1, model.body("right_hand").id
    at = np.asarray(sim.xpos)[hand] if num_envs is None else np.asarray(sim.xpos)[env, hand]
    drag = Drag.begin(sim, env, hand, at + np.array([0, 0, 0.02]))
    drag.target = at + np.array([0.3, -0.2, 0.6])
    for _ in range(1000):
        forces = sim.xfrc_applied if num_envs is None else sim.xfrc_applied[env]
        forces[hand] = drag.wrench(sim, strength)
        sim.step()
    assert np.linalg.norm(drag.at(sim) - drag.target) < 0.02
    assert not np.any(sim.status & stepper.Status.NON_FINITE)
    if num_envs:
        np.testing.assert_array_equal(sim.qvel[0], 0)  # The neighbour stays.


def dragging(sim):
    """A view without a window that pulls a body of the last environment, and where its forces are: (nbody, 6)."""
    view = object.__new__(View)
    view.sim, view._applied, view._drag = sim, None, None
    forces = sim.xfrc_applied if sim.num_envs is None else sim.xfrc_applied[-1]
    view._apply(((sim.num_envs or 1) - 1, 1, np.arange(1.0, 7.0)))
    return view, forces


@pytest.mark.parametrize("num_envs", [None, 2])
def test_a_pull_leaves_nothing_behind(num_envs):
    sim = stepper.Stepper(stepper.load(BALL), num_envs)
    sim.xfrc_applied[...] = 0.1
    view, forces = dragging(sim)
    np.testing.assert_array_equal(forces[1], 0.1 + np.arange(1.0, 7.0))
    view._apply(((num_envs or 1) - 1, 1, np.arange(7.0, 13.0)))
    np.testing.assert_array_equal(forces[1], 0.1 + np.arange(7.0, 13.0))
    sim.step()
    view._release()
    np.testing.assert_array_equal(sim.xfrc_applied, 0.1)


@every(steps=[0, 1], mask=[None, np.array([False, True])])
def test_a_pull_ends_with_a_reset(steps, mask):
    sim = stepper.Stepper(stepper.load(BALL), 2)
    view, _ = dragging(sim)
    for _ in range(steps):
        sim.step()
    sim.reset(mask)
    view._release()
    assert not np.any(sim.xfrc_applied)


def test_forces_that_the_user_writes_during_a_pull_stay():
    view, forces = dragging(stepper.Stepper(stepper.load(BALL), 2))
    forces[1, 2] = -30.0
    view._release()
    np.testing.assert_array_equal(forces[1], [0, 0, -30, 0, 0, 0])


@pytest.fixture
def command(monkeypatch, capsys):
    """Runs `stepper view` with arguments, and gives what it says of an error."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["stepper", "view", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        assert ended.value.code == 1
        return capsys.readouterr().err

    return run


@pytest.mark.parametrize(("arguments", "said"), [
    (("nothing.xml",), "nothing.xml"),
    (("nothing/Nothing-v5",), "is neither a file nor a recording nor an environment"),
    (("CartPole-v1",), "CartPole-v1 is an environment of another simulator"),
    (("tests",), "tests is a folder without run.json"),
    (("examples/policies/ant.npz",), "is a policy, and runs in an environment: film it with stepper evaluate"),
    (("a.xml", "--record", "run"), "--record has no effect on a model, and a.xml is one"),
    (("a.xml", "--contact", "soft"), "contact is 'soft', must be 'hard' or 'mujoco'"),
    (("a.xml", "--actions", "none"), "actions is 'none', must be 'random' or 'zero'"),
    (("a.xml", "--actions", "zero"), "--actions has no effect on a model, and a.xml is one"),
    (("stepper/Hopper-v5", "--keyframe", "home"), "--keyframe has no effect on an environment, and stepper/Hopper-v5 is one"),
    # Its name has what might be the ending of a file.
    (("stepper/dm_control.nothing-nothing-v0",), "is neither a file nor a recording nor an environment"),
])  # fmt: skip
def test_the_command_says_what_is_wrong(command, monkeypatch, arguments, said):
    monkeypatch.chdir(ROOT)
    assert said in command(*arguments)


@pytest.mark.parametrize("option", [("--contact", "hard"), ("--keyframe", "0"), ("--actions", "zero")])
def test_a_recording_has_its_own_settings(command, tmp_path, option):
    sim = stepper.Stepper(stepper.load(BALL))
    with sim.record(tmp_path / "run"):
        sim.step()
    assert f"{option[0]} has no effect on a recording" in command(str(tmp_path / "run"), *option)


def test_a_task_of_dm_control_is_shown(monkeypatch):
    pytest.importorskip("dm_control")
    shown = []
    monkeypatch.setattr(
        stepper.cli.view, "View", lambda sim, **_: shown.append(sim) or SimpleNamespace(url="", run=lambda advance: advance())
    )
    monkeypatch.setattr(sys, "argv", ["stepper", "view", "stepper/dm_control.cartpole-balance-v0", "--num-envs", "2"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
    assert shown[0].num_envs == 2
    assert np.all(shown[0].time > 0)


def test_without_viser_it_says_what_to_install(command, monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "viser", None)
    (tmp_path / "a.xml").write_text(BALL)
    said = command(str(tmp_path / "a.xml"))
    assert 'viser is needed for the view in the browser, and is not installed: pip install "stepper-sim[viewer]"' in said


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
    """All corners of both bodies are in the picture, and the outermost is beyond a third of the way from its middle to an edge."""
    # The near side of the scene sets the distance of the camera, so that corners on the far side may be closer to the middle.
    m = mujoco.MjModel.from_xml_string(FREE.format(*pose, kind, *size, *angles))
    azimuth, elevation, aspect = view
    d, camera = framed(m, azimuth, elevation, aspect)
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    points = np.concatenate([
        d.geom_xpos[k] + (m.geom_aabb[k, :3] + corners * m.geom_aabb[k, 3:]) @ d.geom_xmat[k].reshape(3, 3).T for k in (1, 2)
    ])  # fmt: skip
    assert 0.33 < np.abs(in_the_picture(m, d, camera, points, aspect)).max() < 1.0


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
