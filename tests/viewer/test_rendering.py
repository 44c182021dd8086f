"""Pictures of environments by MuJoCo's renderer: Gymnasium's own, pixel for pixel, and films."""

import film
import gymnasium
import imageio.v3 as imageio
import numpy as np
import pytest
import stepper
from checks import every
from gymnasium.utils.env_checker import check_env
from stepper.envs import TASKS, StepperEnv, StepperVectorEnv
from stepper.viewer import Renderer
from stepper.viewer.renderer import SHADOWS

SIZE = {"width": 200, "height": 150}
TRACKED = sorted(set(TASKS) - {"InvertedPendulum", "InvertedDoublePendulum", "Pusher", "Reacher"})


def gymnasiums(name, qpos, qvel, **settings):
    """Gymnasium's picture of a state."""
    if name == "InvertedDoublePendulum":  # It forgets the configuration that its file has.
        settings = {"default_camera_config": {n: np.array(v) if n == "lookat" else v for n, v in TASKS[name].camera.items()}}
    env = gymnasium.make(f"{name}-v5", render_mode="rgb_array", **SIZE, **settings).unwrapped
    env.model.vis.quality.shadowsize = SHADOWS
    env.reset(seed=0)
    env.set_state(env.model.qpos0, np.zeros(env.model.nv))
    env.render()  # Its free camera looks at where the geoms are in the first picture.
    env.set_state(qpos, qvel)
    picture = env.render()
    env.close()
    return picture


@every(name=sorted(TASKS), camera=["of the file", "free"])
def test_pictures_are_gymnasiums(name, camera):
    if camera == "of the file" and name not in TRACKED:
        pytest.skip("the file has no camera")
    settings = {"camera_id": -1} if camera == "free" else {"camera_name": "track"}
    env = StepperEnv(name, render_mode="rgb_array", **SIZE, **settings)
    env.reset(seed=3)
    start = env.render()
    for _ in range(10):
        env.step(env.action_space.high)
    qpos, qvel = env.sim.qpos[0].copy(), env.sim.qvel[0]
    if camera == "free" and TASKS[name].camera.get("trackbodyid"):
        # Gymnasium's free camera stays where it is; ours follows the robot, so that they agree where it starts.
        env.set_state(env.sim.model.qpos0, np.zeros(env.sim.model.nv))
        qpos, qvel = env.sim.model.qpos0, np.zeros(env.sim.model.nv)
    ours, theirs = env.render(), gymnasiums(name, qpos, qvel, **settings)
    assert ours.shape == (150, 200, 3)
    assert ours.dtype == np.uint8
    # Positions differ by rounding (of quaternions, which MuJoCo takes as they are), which can turn a pixel at an edge.
    assert np.mean(np.any(ours != theirs, axis=2)) < 1e-3
    assert np.mean(np.any(ours != start, axis=2)) > 1e-3, "it moved"
    env.close()


def test_the_free_camera_follows():
    """The same picture, of a floor of which a period went by, ten squares further."""
    env = StepperEnv("Hopper", render_mode="rgb_array", **SIZE, camera_id=-1)
    env.reset(seed=0)
    qpos = env.sim.model.qpos0
    pictures = []
    for x in (0.0, 30.0):
        moved = qpos.copy()
        moved[0] = x
        env.set_state(moved, np.zeros(env.sim.model.nv))
        pictures.append(env.render().astype(int))
    # The hopper is all that is brown; the floor is black and white.
    brown = [picture[..., 0] > picture[..., 2] + 40 for picture in pictures]
    assert brown[0].sum() > 100
    assert np.mean(brown[0] == brown[1]) > 0.99


def test_a_batch_has_the_pictures_of_its_environments():
    envs = StepperVectorEnv("HalfCheetah", 3, render_mode="rgb_array", **SIZE)
    envs.reset(seed=7)
    for _ in range(5):
        envs.step(np.tile(envs.single_action_space.high, (3, 1)))
    frames = envs.render()
    assert isinstance(frames, tuple)
    one = StepperEnv("HalfCheetah", render_mode="rgb_array", **SIZE)
    one.reset(seed=8)
    for _ in range(5):
        one.step(one.action_space.high)
    np.testing.assert_array_equal(frames[1], one.render())
    assert not np.array_equal(frames[0], frames[1])
    envs.close()


def test_what_an_environment_has_of_its_own_is_seen():
    model = stepper.load("""<mujoco><worldbody>
      <light pos="0 0 5"/><camera name="track" pos="0 0 5"/>
      <body name="ball"><freejoint/><geom name="ball" size="0.2" rgba="1 0 0 1"/></body>
      <body name="hand" mocap="true" pos="1 0 0"><geom type="box" size="0.1 0.1 0.1" rgba="0 0 1 1" contype="0" conaffinity="0"/></body>
    </worldbody></mujoco>""")
    sim = stepper.Stepper(model, 2)
    sim.randomize(geom_size=np.stack([model.geom_size, 2 * model.geom_size]))
    hands = sim.mocap_pos.copy()
    hands[1] += [0, 1, 0]
    sim.mocap_pos = hands
    renderer = Renderer(model, width=200, height=200)
    first, second = renderer.render(sim, 0).astype(int), renderer.render(sim, 1).astype(int)
    red = [int(((p[..., 0] > 80) & (p[..., 2] < 60)).sum()) for p in (first, second)]
    assert red[1] == pytest.approx(4 * red[0], rel=0.2)  # An area, seen in perspective.
    blue = [np.argwhere((p[..., 2] > 80) & (p[..., 0] < 60)).mean(axis=0) for p in (first, second)]
    assert blue[0][0] - blue[1][0] > 20  # Up in the picture.
    assert abs(blue[0][1] - blue[1][1]) < 3
    np.testing.assert_array_equal(renderer.render(sim, 0), first)


@every(kind=["box", "sphere", "cylinder"], light=["", '<light pos="0 0 3"/>'])
def test_a_scene_without_a_light_gets_one(kind, light):
    """Its picture is as bright as that of a scene with a light, and its bodies throw shadows."""
    source = f'''<mujoco><worldbody>{light}<geom type="plane" size="2 2 .1"/><body pos="0 0 .3"><freejoint/>
      <geom type="{kind}" size=".1 .1 .1" rgba=".8 .3 .2 1"/></body></worldbody></mujoco>'''
    model = stepper.load(source)
    sim = stepper.Stepper(model)
    bright, dark = (Renderer(model, **SIZE, add_light=lamp).render(sim).astype(int) for lamp in (True, False))
    assert bright.mean() > 80  # of 255; MuJoCo's headlight alone leaves 45
    assert (bright == dark).all() == bool(light)
    floor = bright[np.ptp(bright, axis=2) < 5]  # It is grey.
    assert np.percentile(floor, 95) - np.percentile(floor, 1) > 30  # A shadow on it.


def test_gymnasium_films_it(tmp_path):
    env = gymnasium.make("stepper/HalfCheetah-v5", render_mode="rgb_array", **SIZE)
    with gymnasium.wrappers.RecordVideo(env, str(tmp_path)) as filmed:
        filmed.reset(seed=0)
        filmed.action_space.seed(0)
        for _ in range(20):
            filmed.step(filmed.action_space.sample())
    film = imageio.imread(tmp_path / "rl-video-episode-0.mp4", plugin="FFMPEG")
    assert film.shape[1:] == (150, 200, 3)
    assert len(film) in (20, 21)
    assert np.abs(film[0].astype(int) - film[-1]).max() > 60, "it moves"


def test_gymnasiums_checker_accepts_what_it_draws():
    check_env(gymnasium.make("stepper/Hopper-v5", render_mode="rgb_array").unwrapped)


def test_its_policies_are_there():
    assert [name for name in film.ROBOTS if not (film.POLICIES / f"{name}.npz").exists()] == []


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_its_pictures_move():
    name, camera = film.ROBOTS["half_cheetah"]
    first, second = film.pictures(film.POLICIES / "half_cheetah.npz", name, camera, seconds=2 / film.RATE)
    assert first.shape == (film.HEIGHT, film.WIDTH, 3)
    assert np.any(first != second)
