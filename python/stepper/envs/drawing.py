"""Pictures of environments for `render_mode="rgb_array"`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Literal, TypeAlias, get_args

from stepper.envs.batch import Batch
from stepper.envs.task import Array
from stepper.loading import origin_of
from stepper.viewer import Renderer

RenderMode: TypeAlias = Literal["rgb_array"]
RENDER_MODES: tuple[str, ...] = get_args(RenderMode)


class Drawing:
    """Pictures of environments, drawn by a renderer that is created for the first picture and is not pickled.

    Args:
        batch: The environments.
        render_mode: "rgb_array", or None for no pictures.
        **settings: `width`, `height`, `camera` and `camera_config` of `stepper.viewer.Renderer`.

    Raises:
        ValueError: An unknown render mode.
    """

    def __init__(self, batch: Batch, render_mode: str | None, **settings: Any):
        if render_mode not in (None, *RENDER_MODES):
            raise ValueError(
                f'render_mode is {render_mode!r}, must be "rgb_array", or None for no pictures. To see environments move, make them '
                "without, and call stepper.viewer.view(env.unwrapped.sim); or, for one environment, put it into "
                "gymnasium.wrappers.HumanRendering"
            )
        self._batch, self._settings = batch, settings
        self._origin = None if render_mode is None else origin_of(batch.sim.model)
        self._renderer: Renderer | None = None

    def frames(self, envs: Iterable[int]) -> tuple[Array, ...]:
        """Pictures of the environments with these indices, (height, width, 3) uint8 each."""
        if self._renderer is None:
            batch = self._batch
            task = batch.task
            self._renderer = Renderer(
                batch.sim.model, source=self._origin, default_config=task.camera, add_light=task.lamp, **self._settings
            )
        return tuple(self._renderer.render(self._batch.sim, env) for env in envs)

    def close(self) -> None:
        """Frees the renderer."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_renderer": None}


def camera_settings(
    width: int, height: int, camera_id: int | None, camera_name: str | None, camera_config: Mapping[str, Any] | None
) -> dict[str, Any]:
    """Camera settings of a renderer from the camera arguments of Gymnasium's environments.

    Args:
        width: Width of a picture in pixels.
        height: Height of a picture in pixels.
        camera_id: Index of a camera; None selects `camera_name` or the default.
        camera_name: Name of a camera; None selects `camera_id` or the default.
        camera_config: Settings of a free camera.

    Returns:
        The settings "width", "height", "camera" and "camera_config" by name.
    """
    if camera_id is not None and camera_name is not None:
        raise ValueError(f"camera_id={camera_id} and camera_name={camera_name!r} were given: give one of them")
    camera = camera_id if camera_name is None else camera_name
    return {"width": width, "height": height, "camera": camera, "camera_config": camera_config}
