"""Pictures of environments from MuJoCo's renderer."""

from __future__ import annotations

import importlib
import itertools
import os
import sys
import weakref
from collections.abc import Mapping
from types import TracebackType
from typing import Any

import numpy as np

from stepper._stepper import Model, Stepper
from stepper.shared.arguments import check_kind, check_mapping, check_whole
from stepper.shared.machine import require
from stepper.viewer.looks import Array, LooksError, looks_of, row, sized_geoms

TRACK = "track"
"""Name of the camera that is used by default if the model has it. In Gymnasium's models it follows the robot."""
SHADOWS = 1024
"""Largest size of a shadow map, pixels.

Without a graphics card, MuJoCo's default of 4,096 takes most of the time of a picture. Pictures with both
sizes hardly differ.
"""
_LAMP = {"ambient": 0.15, "diffuse": 0.55, "specular": 0.2}
"""Ambient, diffuse and specular brightness, from 0 to 1, of the white lamp that is added to scenes without a light.

Pictures are as bright as those of the same scene with a light in the MJCF.
"""
_SLANT = (-0.3, 0.4, -1.0)
"""Direction of the light of the added lamp. It is oblique, so that the visible sides of a box differ in brightness."""
_CONFIG = ("distance", "azimuth", "elevation", "lookat", "trackbodyid")


class Renderer:
    """Draws environments of a `Stepper` with MuJoCo's renderer, which needs OpenGL; a context manager.

    On Linux without a screen it uses EGL, unless the environment variable MUJOCO_GL is set.

    Args:
        model: The model.
        width: Width of a picture in pixels.
        height: Height of a picture in pixels.
        camera: Name or index of a camera of the model. None selects the first available of these: a free camera with `camera_config`, the
            model's camera "track", a free camera with `default_config`.
        camera_config: Settings of a free camera: distance (m), azimuth and elevation (degrees), lookat (3,) in m, and trackbodyid. In x
            and y the camera follows the centre of mass of that body's subtree; with -1 it follows none. Without a distance, the first
            picture shows all that moves. With a distance alone, the camera looks at the median of the geoms' positions, as Gymnasium's.
        default_config: Settings of the free camera if there is neither `camera_config` nor a camera "track". Tasks set it.
        source: Source of the model, such as an MJCF file; see `stepper.load`. None uses the source from which this process loaded it.
        add_light: Whether to add a light to a scene without one. MuJoCo's headlight alone gives nearly black pictures.

    Raises:
        LooksError: The source of the model is unknown, or belongs to another model.
        MissingPackageError: MuJoCo or its renderer is not installed.
        RuntimeError: No platform for OpenGL is available; the message lists packages to install.
        ValueError: An unknown camera, or an unknown setting of a camera.
    """

    def __init__(
        self,
        model: Model,
        *,
        width: int = 480,
        height: int = 480,
        camera: str | int | None = None,
        camera_config: Mapping[str, Any] | None = None,
        default_config: Mapping[str, Any] | None = None,
        source: Any = None,
        add_light: bool = True,
    ):
        check_kind("model", model, Model, "stepper.viewer.Renderer(sim.model).render(sim)")
        check_whole("width", width)
        check_whole("height", height)
        if not isinstance(camera, str | int | None):
            raise TypeError(f"camera is {camera!r}, must be a name or an index; camera_config={{'distance': ...}} sets a free camera")
        if camera_config is not None:
            check_mapping("camera_config", camera_config, "{'distance': 2.0, 'azimuth': 90.0}")
        if camera is not None and camera_config is not None:
            raise ValueError("camera and camera_config are both given: give one of them")
        if width < 1 or height < 1:
            raise ValueError(f"the size of a picture is {width} x {height}, must be 1 x 1 or more")
        self._mujoco = mujoco = require("mujoco", "to draw pictures")
        m = looks_of(model, source)
        if m is None:
            raise LooksError(
                "to draw a model, MuJoCo needs its MJCF or URDF file, which a saved model does not contain: "
                "load the model from that file with stepper.load, or pass the file as source"
            )
        m.vis.global_.offwidth, m.vis.global_.offheight = max(width, m.vis.global_.offwidth), max(height, m.vis.global_.offheight)
        m.vis.quality.shadowsize = min(m.vis.quality.shadowsize, SHADOWS)
        self._model, self._m, self._d = model, m, mujoco.MjData(m)
        self._sized = sized_geoms(model)
        self._add_light = add_light and m.nlight == 0
        mujoco.mj_forward(m, self._d)
        self._unframed: set[str] = set()
        self._camera, self._follows = self._chosen(camera, camera_config, default_config)
        self._lookat, self._start = self._camera.lookat.copy(), self._d.subtree_com[self._follows].copy()
        self._aspect = width / height
        self._renderer = _renderer(mujoco, m, width, height)
        # Python also calls this finalizer at its exit, before OpenGL is unloaded.
        self._freeing = weakref.finalize(self, self._renderer.close)

    def render(self, sim: Stepper, env: int = 0) -> Array:
        """Picture of the current state of an environment, (height, width, 3) uint8, RGB.

        Args:
            sim: Stepper of the renderer's model.
            env: Index of the environment; negative indices count from the end.
        """
        check_kind("sim", sim, Stepper, "stepper.viewer.Renderer(sim.model).render(sim)")
        count = sim.num_envs or 1
        check_whole("env", env, least=-count, most=count - 1)
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
        if self._unframed:
            self._frame()
        if self._follows:
            self._camera.lookat[:2] = (self._lookat + d.subtree_com[self._follows] - self._start)[:2]
        self._renderer.update_scene(d, self._camera)
        if self._add_light:
            _add_lamp(mujoco, self._renderer.scene)
        picture: Array = self._renderer.render()
        return picture

    def close(self) -> None:
        """Closes the renderer and frees its memory on the graphics card."""
        self._freeing()

    def __enter__(self) -> Renderer:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def _chosen(self, camera: str | int | None, config: Mapping[str, Any] | None, default: Mapping[str, Any] | None) -> tuple[Any, int]:
        """MuJoCo's camera for the camera arguments of `Renderer`, and the index of the body that a free camera follows.

        The index is 0 if the camera follows no body.
        """
        mujoco, m = self._mujoco, self._m
        names = [m.camera(k).name for k in range(m.ncam)]
        if camera is None and config is None and TRACK in names:
            camera = TRACK
        chosen = mujoco.MjvCamera()
        if camera is None:
            return chosen, self._free(chosen, config if config is not None else default or {})
        if isinstance(camera, str) and camera not in names:
            raise ValueError(f"there is no camera {camera!r}; the cameras are: {', '.join(map(repr, names)) or 'none'}")
        index = names.index(camera) if isinstance(camera, str) else camera
        if not -1 <= index < m.ncam:
            raise ValueError(f"the camera is {index}, must be from 0 to {m.ncam - 1}, or -1 for a free one")
        if index < 0:
            return chosen, self._free(chosen, default or {})
        chosen.type, chosen.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, index
        return chosen, 0

    def _free(self, camera: Any, config: Mapping[str, Any]) -> int:
        """Sets a free camera from its settings, and returns the index of the body that it follows, or 0 if it follows none.

        Settings that follow from the first picture are set by `_frame`.
        """
        if unknown := set(config) - set(_CONFIG):
            raise ValueError(f"camera_config has {sorted(unknown)}, must contain only: {', '.join(_CONFIG)}")
        camera.type = self._mujoco.mjtCamera.mjCAMERA_FREE
        camera.lookat[:] = np.median(self._d.geom_xpos, axis=0)
        self._unframed = {"distance", "lookat"} - set(config) if "distance" not in config else set()
        for name, value in config.items():
            if name == "lookat":
                camera.lookat[:] = value
            elif name != "trackbodyid":
                setattr(camera, name, value)
        body = int(config.get("trackbodyid", -1))
        if body >= self._m.nbody:
            raise ValueError(f"trackbodyid is {body}, must be less than {self._m.nbody}")
        return max(body, 0)

    def _frame(self) -> None:
        """Points the free camera at all that moves at the current pose, for settings that the user did not give."""
        centres, radii = region_of(self._mujoco, self._m, self._d)
        if "lookat" in self._unframed:
            self._lookat[:] = self._camera.lookat[:] = middle_of(centres, radii)
            self._start = self._d.subtree_com[self._follows].copy()
        self._camera.distance = distance_to(centres, radii, self._camera, self._m.vis.global_.fovy, self._aspect)
        self._unframed = set()


def _add_lamp(mujoco: Any, scene: Any) -> None:
    """Adds a distant light with shadows to a scene of MuJoCo's renderer."""
    light = scene.lights[scene.nlight]
    scene.nlight += 1
    light.type, light.headlight, light.castshadow, light.texid = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, 0, 1, -1
    light.dir[:] = np.array(_SLANT) / np.linalg.norm(_SLANT)
    light.pos[:] = -10.0 * np.array(_SLANT)
    for name, value in _LAMP.items():
        getattr(light, name)[:] = value


def _renderer(mujoco: Any, m: Any, width: int, height: int) -> Any:
    """MuJoCo's renderer for a compiled model, with an OpenGL context that is available on this machine."""
    if not hasattr(mujoco, "Renderer"):
        raise RuntimeError('this build of MuJoCo has no renderer: pip install "mujoco>=4.0,<5"')
    chosen = os.environ.get("MUJOCO_GL")
    try:
        _choose_platform()
        return mujoco.Renderer(m, height, width)
    # Libraries report missing parts of OpenGL by various exceptions, such as AttributeError for a missing library.
    except Exception as error:
        platform = os.environ.get("MUJOCO_GL") or "glfw"
        # Restore the variable, because the platform chosen here does not work.
        if chosen is None:
            os.environ.pop("MUJOCO_GL", None)
        else:
            os.environ["MUJOCO_GL"] = chosen
        raise RuntimeError(
            f"MuJoCo's renderer cannot draw with MUJOCO_GL={platform} ({type(error).__name__}: {error}). Without a screen, use "
            "MUJOCO_GL=egl (Debian: apt install libegl1 libgl1-mesa-dri, or the driver of a graphics card) or MUJOCO_GL=osmesa "
            '(apt install libosmesa6), set before Python starts; both need pip install "stepper-sim[viewer]"'
        ) from error


def _choose_platform() -> None:
    """Sets MUJOCO_GL=egl on Linux without a screen, unless it is set. MuJoCo's default is GLFW, which needs a screen."""
    screen = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if sys.platform != "linux" or screen or os.environ.get("MUJOCO_GL"):
        return
    os.environ["MUJOCO_GL"] = "egl"
    # The module reads the variable at its import, and MuJoCo has imported it before.
    importlib.reload(importlib.import_module("mujoco.rendering.classic.gl_context"))


_MARGIN = 1.1
"""Ratio of the camera's distance to the smallest one at which the region is inside the picture."""
_CORNERS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))


def region_of(mujoco: Any, m: Any, d: Any) -> tuple[Array, Array]:
    """Balls around all that moves at the pose of a `mujoco.MjData`: centres (n, 3) and radii (n,), m.

    The balls of radius 0 are corners of the boxes around moving geoms. A robot whose first joint is a hinge or ball joint adds the ball
    that it sweeps around this joint. Without a moving geom, fixed geoms count, without planes.
    """
    extended = m.geom_type != mujoco.mjtGeom.mjGEOM_PLANE
    moving = extended & (m.body_weldid[m.geom_bodyid] != 0)
    shown = np.flatnonzero(moving if moving.any() else extended)
    if not len(shown):
        return np.zeros((1, 3)), np.ones(1)
    boxes = m.geom_aabb[shown]
    local = boxes[:, None, :3] + _CORNERS * boxes[:, None, 3:]
    corners = d.geom_xpos[shown, None] + np.einsum("gij,gkj->gki", d.geom_xmat[shown].reshape(-1, 3, 3), local)
    centres, radii = [corners.reshape(-1, 3)], [np.zeros(8 * len(shown))]
    turning = {int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_BALL)}
    for joint in range(m.njnt):
        body = int(m.jnt_bodyid[joint])
        if int(m.jnt_type[joint]) not in turning or m.body_weldid[m.body_parentid[body]] != 0:
            continue
        carried = [k for k, geom in enumerate(shown) if _is_below(m, int(m.geom_bodyid[geom]), body)]
        if carried:
            anchor = d.xanchor[joint]
            centres.append(anchor[None])
            radii.append(np.array([np.linalg.norm(corners[carried] - anchor, axis=2).max()]))
    return np.concatenate(centres), np.concatenate(radii)


def _is_below(m: Any, body: int, ancestor: int) -> bool:
    """Whether a body is another one or a descendant of it."""
    while body > ancestor:
        body = int(m.body_parentid[body])
    return body == ancestor


def middle_of(centres: Array, radii: Array) -> Array:
    """Centre of the box around balls, (3,), m."""
    middle: Array = ((centres - radii[:, None]).min(axis=0) + (centres + radii[:, None]).max(axis=0)) / 2
    return middle


def distance_to(centres: Array, radii: Array, camera: Any, fovy: float, aspect: float) -> float:
    """Distance from its point of interest at which a free camera shows balls, m.

    Args:
        centres: Centres of the balls, (n, 3), m.
        radii: Radii of the balls, (n,), m.
        camera: The `mujoco.MjvCamera`, with azimuth, elevation and lookat.
        fovy: Vertical field of view, degrees.
        aspect: Width of the picture divided by its height.
    """
    azimuth, elevation = np.radians([camera.azimuth, camera.elevation])
    right = np.array([np.sin(azimuth), -np.cos(azimuth), 0.0])
    forward = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    offsets = centres - camera.lookat
    upward = np.tan(np.radians(fovy) / 2)
    # A ball touches the side plane of the view: |lateral| cos(half) + radius = (distance + depth) sin(half).
    needed = [
        (np.abs(offsets @ axis) + radii * np.sqrt(1.0 + slope**2)) / slope - offsets @ forward
        for axis, slope in ((right, upward * aspect), (np.cross(right, forward), upward))
    ]
    return float(_MARGIN * np.max(needed))
