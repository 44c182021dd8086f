"""What environments say of pictures before any is drawn: no OpenGL here. `make viewer` draws them."""

import os
import pickle
import subprocess
import sys

import gymnasium
import numpy as np
import pytest
import stepper
from stepper.envs import TASKS, StepperEnv, StepperVectorEnv
from stepper.viewer import LooksError, Renderer


@pytest.mark.parametrize("name", sorted(TASKS))
def test_the_free_camera_is_gymnasiums(name):
    module = sys.modules[type(gymnasium.make(f"{name}-v5").unwrapped).__module__]
    theirs = dict(getattr(module, "DEFAULT_CAMERA_CONFIG", {}))
    # A camera that tracks the world's body (0) or nothing (-1) is fixed, and stepper's settings leave the entry out.
    if theirs.get("trackbodyid", 0) < 1:
        theirs.pop("trackbodyid", None)
    # Without settings it shows the extent of the model.
    if not theirs.keys() & {"distance", "lookat"}:
        theirs["distance"] = gymnasium.make(f"{name}-v5").unwrapped.model.stat.extent
    ours = dict(TASKS[name].camera)
    np.testing.assert_array_equal(ours.pop("lookat", ()), np.round(theirs.pop("lookat", ()), 12))
    assert ours == theirs


def test_environments_say_how_they_are_drawn():
    env = gymnasium.make("stepper/Hopper-v5", render_mode="rgb_array")
    assert env.render_mode == "rgb_array"
    assert env.unwrapped.metadata["render_modes"] == StepperVectorEnv("Hopper", 2).metadata["render_modes"] == ["rgb_array"]
    assert StepperEnv("Hopper").render() is None
    assert StepperVectorEnv("Hopper", 2).render() is None


@pytest.mark.parametrize(("settings", "said"), [
    ({"camera_id": 0, "camera_name": "track"}, "give one of them"),
    ({"camera_name": "track", "default_camera_config": {}}, "give one of them"),
    ({"camera_name": "front"}, "there is no camera 'front'; the cameras are: 'track'"),
    ({"camera_id": 1}, "must be from 0 to 0, or -1"),
    ({"default_camera_config": {"zoom": 2}}, "camera_config has ['zoom'], must contain only: distance"),
    ({"default_camera_config": {"trackbodyid": 9}}, "trackbodyid is 9"),
    ({"width": 0}, "0 x 480"),
])  # fmt: skip
def test_what_is_wrong_with_a_camera_is_said(settings, said):
    with pytest.raises(ValueError) as error:
        StepperEnv("Hopper", render_mode="rgb_array", **settings).render()
    assert said in str(error.value)


def test_a_model_without_a_source_has_no_looks():
    model = stepper.Model.from_bytes(stepper.load("<mujoco><worldbody><body name='unseen'/></worldbody></mujoco>").to_bytes())
    changed = model.replace(body_pos=[[0, 0, 0], [0, 0, 1]])
    # Equal models look the same, and so do variants of them.
    assert all(stepper.loading.origin_of(known) is not None for known in (model, changed))
    for k in range(stepper.loading.origins.KEPT + 1):
        stepper.load(f"<mujoco><worldbody><body name='other{k}'/></worldbody></mujoco>")
    assert stepper.loading.origin_of(model) is None
    with pytest.raises(LooksError, match=r"load the model from that file with stepper\.load, or pass the file as source"):
        Renderer(model)


def test_the_source_of_another_model_is_refused():
    with pytest.raises(LooksError, match="number 0 is box '' of body 0 instead of sphere"):
        Renderer(
            stepper.load("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>"),
            source="<mujoco><worldbody><geom type='box' size='1 1 1'/></worldbody></mujoco>",
        )


def test_a_copy_knows_what_it_looks_like():
    """Where other models were loaded since, too: in another process, say."""
    env = StepperEnv("Hopper", render_mode="rgb_array")
    copied = pickle.loads(pickle.dumps(env))
    assert copied._drawing._origin == env._drawing._origin
    assert str(copied._drawing._origin.source).endswith("hopper.xml")


def test_a_model_that_is_read_once_is_known_whenever_it_is_made():
    """However many others were loaded between."""
    pytest.importorskip("dm_control")
    for _ in range(2):
        for name in ("cheetah-run", "swimmer-swimmer6", "cartpole-balance"):
            env = gymnasium.make(f"stepper/dm_control.{name}-v0", render_mode="rgb_array").unwrapped
            assert env._drawing._origin is not None
        for k in range(stepper.loading.origins.KEPT + 1):
            stepper.load(f"<mujoco><worldbody><body name='between{k}'/></worldbody></mujoco>")


@pytest.mark.parametrize("names", ["passing{}", "again"])
def test_a_model_that_exists_is_known_however_many_others_were_loaded(names):
    """Others of different names, or one again and again."""
    first = stepper.load(f"<mujoco><worldbody><body name='before {names}'/></worldbody></mujoco>")
    for k in range(3 * stepper.loading.origins.KEPT):
        stepper.load(f"<mujoco><worldbody><body name='{names.format(k)}'/></worldbody></mujoco>")
    assert stepper.loading.origin_of(first) is not None


def test_files_are_remembered_longer_than_texts(tmp_path, monkeypatch):
    monkeypatch.setattr(stepper.loading.origins, "KEPT_FILES", 20)

    def loaded(name):
        file = tmp_path / f"{name}.xml"
        file.write_text(f"<mujoco><worldbody><body name='{name}'/></worldbody></mujoco>")
        return stepper.load(str(file))

    # Another model of the same looks: nothing that was loaded exists any longer.
    first = stepper.Model.from_bytes(loaded("first").to_bytes())
    for k in range(20):
        stepper.load(f"<mujoco><worldbody><body name='text{k}'/></worldbody></mujoco>")
        loaded(f"file{k}")
    assert stepper.loading.origin_of(first).source == str(tmp_path / "first.xml")
    loaded("one_more")
    assert stepper.loading.origin_of(first) is None


_WITHOUT_EGL = """
import ctypes, ctypes.util, os
load, find = ctypes.CDLL.__init__, ctypes.util.find_library
def without(self, name, *args, **kwargs):
    if "EGL" in str(name):
        raise OSError(f"{name}: cannot open shared object file")
    load(self, name, *args, **kwargs)
ctypes.CDLL.__init__ = without
ctypes.util.find_library = lambda name: None if "EGL" in name else find(name)
from stepper.envs import StepperEnv
env = StepperEnv("Hopper", render_mode="rgb_array")
for _ in range(2):
    try:
        env.render()
    except RuntimeError as error:
        print(error)
    print(os.environ.get("MUJOCO_GL"))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="EGL is chosen on Linux alone")
def test_without_egl_it_says_what_to_install():
    """Every time, and what was tried is not taken for the user's choice."""
    settings = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL")}
    ended = subprocess.run([sys.executable, "-W", "ignore", "-c", _WITHOUT_EGL], capture_output=True, text=True, check=False, env=settings)
    assert ended.stdout.count("cannot draw with MUJOCO_GL=egl") == 2, ended.stderr
    assert ended.stdout.count("\nNone\n") == 2


def test_without_a_platform_for_opengl_it_says_what_to_install():
    code = "from stepper.envs import StepperEnv; StepperEnv('Hopper', render_mode='rgb_array').render()"
    settings = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")} | {"MUJOCO_GL": "glfw"}
    ended = subprocess.run([sys.executable, "-W", "ignore", "-c", code], capture_output=True, text=True, check=False, env=settings)
    assert "cannot draw with MUJOCO_GL=glfw" in ended.stderr
    assert "MUJOCO_GL=egl (Debian: apt install" in ended.stderr
