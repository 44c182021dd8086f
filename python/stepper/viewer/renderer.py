"""Pictures by MuJoCo's renderer."""

from __future__ import annotations

import importlib
import os
import sys
import weakref
from collections.abc import Mapping
from typing import Any

import numpy as np

from stepper._stepper import Model, Stepper
from stepper.shared.machine import require
from stepper.viewer.looks import Array, LooksError, looks_of, row, sized_geoms

TRACK = "track"
"""Default camera, if the file has it: in Gymnasium's files it follows the robot."""
SHADOWS = 1024
"""Most pixels of a map of shadows on a side. MuJoCo's 4,096 take most of a picture's time where no graphics card draws it, and pictures of
this size look the same."""
_LAMP = {"ambient": 0.15, "diffuse": 0.55, "specular": 0.2}
"""Parts of the light of a lamp, white. Pictures are then as bright as those of the same scene with a light in its file."""
_SLANT = (-0.3, 0.4, -1.0)
"""Direction in which it shines, so that no two sides of a box look alike."""
_CONFIG = ("distance", "azimuth", "elevation", "lookat", "trackbodyid")


class Renderer:
    """Renderer of pictures of a `Stepper`'s environments, by MuJoCo's renderer, which needs a platform for OpenGL.

    On Linux without a screen it uses EGL, unless the environment variable MUJOCO_GL is set.

    Args:
        model: The scene.
        width: Width of a picture in pixels.
        height: Height of a picture in pixels.
        camera: Name or index of a camera of the file. None is the first of these: a free camera by `camera_config`, the file's camera
            "track", a free camera by `default_config`.
        camera_config: Settings of a free camera: distance (m), azimuth and elevation (degrees), lookat (3,) in m, and trackbodyid. The
            camera
            follows the centre of mass of that body's subtree in x and y; -1 is none.
        default_config: Default of `camera_config`, from a task.
        source: Source of the model, as for `stepper.load`; None is the one from which this process loaded it.
        lamp: Whether to add a light to a scene without one. MuJoCo's headlight alone gives nearly black pictures.

    Raises:
        LooksError: The MJCF of the model is missing, or is of another model.
        MissingPackageError: MuJoCo or its renderer is not installed.
        RuntimeError: No platform for OpenGL is available; the message lists packages to install.
        ValueError: An unknown camera, or an unknown setting of a camera.
    """

    def __init__(
        self,
        model: Model,
        width: int = 480,
        height: int = 480,
        *,
        camera: str | int | None = None,
        camera_config: Mapping[str, Any] | None = None,
        default_config: Mapping[str, Any] | None = None,
        source: Any = None,
        lamp: bool = True,
    ):
        if camera is not None and camera_config is not None:
            raise ValueError("camera and camera_config are both given: give one of them")
        if width < 1 or height < 1:
            raise ValueError(f"the size of a picture is {width} x {height}, must be 1 x 1 or more")
        self._mujoco = mujoco = require("mujoco", "to draw pictures")
        m = looks_of(model, source)
        if m is None:
            raise LooksError(
                "to draw a model, MuJoCo needs the MJCF that it came from, which a saved model or a description does not have: "
                "load the model with stepper.load from its file, or give the file as source"
            )
        m.vis.global_.offwidth, m.vis.global_.offheight = max(width, m.vis.global_.offwidth), max(height, m.vis.global_.offheight)
        m.vis.quality.shadowsize = min(m.vis.quality.shadowsize, SHADOWS)
        self._model, self._m, self._d = model, m, mujoco.MjData(m)
        self._sized = sized_geoms(model)
        self._lamp = lamp and m.nlight == 0
        mujoco.mj_forward(m, self._d)
        self._camera, self._follows = self._chosen(camera, camera_config, default_config)
        self._lookat, self._start = self._camera.lookat.copy(), self._d.subtree_com[self._follows].copy()
        self._renderer = _renderer(mujoco, m, width, height)
        # Also when Python ends, while there is still OpenGL to free it with.
        self._freeing = weakref.finalize(self, self._renderer.close)

    def render(self, sim: Stepper, env: int = 0) -> Array:
        """Picture of an environment's present state, (height, width, 3) uint8."""
        mujoco, m, d = self._mujoco, self._m, self._d
        d.qpos[:] = row(sim, "qpos", env)
        if m.nmocap:
            d.mocap_pos[:], d.mocap_quat[:] = row(sim, "mocap_pos", env), row(sim, "mocap_quat", env)
        for name, some in (("geom_pos", slice(None)), ("geom_size", self._sized)):
            values = getattr(self._model, name)
            if name in sim.randomized:
                values = np.asarray(sim.randomized[name]).reshape(-1, *values.shape)[env]
            getattr(m, name)[some] = values[some]
        mujoco.mj_kinematics(m, d)
        mujoco.mj_comPos(m, d)
        mujoco.mj_camlight(m, d)
        mujoco.mj_tendon(m, d)
        if self._follows:
            self._camera.lookat[:2] = (self._lookat + d.subtree_com[self._follows] - self._start)[:2]
        self._renderer.update_scene(d, self._camera)
        if self._lamp:
            _add_lamp(mujoco, self._renderer.scene)
        picture: Array = self._renderer.render()
        return picture

    def close(self) -> None:
        """Frees the memory of the graphics card."""
        self._freeing()

    def _chosen(self, camera: str | int | None, config: Mapping[str, Any] | None, default: Mapping[str, Any] | None) -> tuple[Any, int]:
        """MuJoCo's camera, and the body that it follows if it is a free one; 0 is none."""
        mujoco, m = self._mujoco, self._m
        names = [m.camera(k).name for k in range(m.ncam)]
        if camera is None and config is None and TRACK in names:
            camera = TRACK
        chosen = mujoco.MjvCamera()
        if camera is None:
            return chosen, self._free(chosen, config if config is not None else default or {})
        if isinstance(camera, str) and camera not in names:
            raise ValueError(f"there is no camera {camera!r}, there are: {', '.join(map(repr, names)) or 'none'}")
        index = names.index(camera) if isinstance(camera, str) else camera
        if not -1 <= index < m.ncam:
            raise ValueError(f"the camera is {index}, must be from 0 to {m.ncam - 1}, or -1 for a free one")
        if index < 0:
            return chosen, self._free(chosen, default or {})
        chosen.type, chosen.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, index
        return chosen, 0

    def _free(self, camera: Any, config: Mapping[str, Any]) -> int:
        """Makes a free camera of numbers, which begins with all of the scene in view as Gymnasium's does; the body that it follows."""
        if unknown := set(config) - set(_CONFIG):
            raise ValueError(f"camera_config has {sorted(unknown)}, must be of: {', '.join(_CONFIG)}")
        camera.type = self._mujoco.mjtCamera.mjCAMERA_FREE
        camera.lookat[:] = np.median(self._d.geom_xpos, axis=0)
        camera.distance = self._m.stat.extent
        for name, value in config.items():
            if name == "lookat":
                camera.lookat[:] = value
            elif name != "trackbodyid":
                setattr(camera, name, value)
        body = int(config.get("trackbodyid", -1))
        if body >= self._m.nbody:
            raise ValueError(f"trackbodyid is {body}, must be less than {self._m.nbody}")
        return max(body, 0)


def _add_lamp(mujoco: Any, scene: Any) -> None:
    """Adds a distant light, with shadows, to what is drawn."""
    light = scene.lights[scene.nlight]
    scene.nlight += 1
    light.type, light.headlight, light.castshadow, light.texid = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, 0, 1, -1
    light.dir[:] = np.array(_SLANT) / np.linalg.norm(_SLANT)
    light.pos[:] = -10.0 * np.array(_SLANT)
    for name, value in _LAMP.items():
        getattr(light, name)[:] = value


def _renderer(mujoco: Any, m: Any, width: int, height: int) -> Any:
    """MuJoCo's renderer, with an OpenGL context that this machine has."""
    if not hasattr(mujoco, "Renderer"):
        raise RuntimeError('this build of MuJoCo has no renderer: pip install "mujoco>=4.0,<5"')
    chosen = os.environ.get("MUJOCO_GL")
    try:
        _choose_platform()
        return mujoco.Renderer(m, height, width)
    # What OpenGL lacks is said by libraries in many ways: missing functions of a library that is not there among them.
    except Exception as error:
        platform = os.environ.get("MUJOCO_GL") or "glfw"
        # What was chosen here and does not work is not the user's choice.
        if chosen is None:
            os.environ.pop("MUJOCO_GL", None)
        else:
            os.environ["MUJOCO_GL"] = chosen
        raise RuntimeError(
            f"MuJoCo's renderer cannot draw here by MUJOCO_GL={platform} ({type(error).__name__}: {error}). Without a screen it draws by "
            "MUJOCO_GL=egl (Debian: apt install libegl1 libgl1-mesa-dri, or the driver of a graphics card) or by MUJOCO_GL=osmesa "
            '(apt install libosmesa6), set before Python starts; both need pip install "stepper-sim[viewer]"'
        ) from error


def _choose_platform() -> None:
    """Chooses EGL where there is no screen and the user chose nothing: MuJoCo's choice would be GLFW, which needs one."""
    screen = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if sys.platform != "linux" or screen or os.environ.get("MUJOCO_GL"):
        return
    os.environ["MUJOCO_GL"] = "egl"
    # It reads the variable when it is imported, as MuJoCo was long before.
    importlib.reload(importlib.import_module("mujoco.rendering.classic.gl_context"))
