"""Web page that shows environments side by side."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any, Self

import numpy as np

from stepper._status import Status
from stepper._stepper import Model
from stepper.shared.machine import require
from stepper.viewer.frames import Frame
from stepper.viewer.looks import Array
from stepper.viewer.shapes import FLAT, Part, Scene, instances

FRAMES = 30.0
"""Largest number of frames per second that are sent to the browser."""
FORCE = 0.5
"""Length of the arrow for a force that equals the model's weight, as a fraction of the scene's extent."""
TILES = 48
"""Largest number of square tiles along a side of a drawn floor."""
TENDON_COLOUR = (210, 70, 70)
"""Colour of tendons: red, green and blue, from 0 to 255."""
_CONTACT_COLOUR, _FORCE_COLOUR, _PULL_COLOUR = (255, 200, 40), (230, 60, 40), (40, 160, 255)
_FLOOR = (0.42, 0.46, 0.52)


class Served:
    """Base class of a view and a player, which have a window in the browser; a context manager."""

    window: Window

    @property
    def url(self) -> str:
        """Address (URL) of the view."""
        return self.window.url

    @property
    def open(self) -> bool:
        """Whether the view is open; False after `close`."""
        return self.window.open

    def close(self) -> None:
        """Stops the web server. Any thread may call it."""
        self.window.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


class Window:
    """Web server with a page that shows environments side by side.

    Args:
        scene: Drawing of the model.
        model: The model.
        count: Number of environments to show.
        host: Address of the server; "0.0.0.0" also accepts connections from other machines.
        port: Port of the server; if it is in use, the next free one.
        title: Title of the page.
    """

    def __init__(
        self,
        scene: Scene,
        model: Model,
        count: int,
        *,
        host: str = "127.0.0.1",
        port: int = 8080,
        title: str = "",
    ):
        viser = require("viser", "for the view in the browser")
        self.scene, self._model, self.count = scene, model, count
        self.server = viser.ViserServer(host=host, port=port, label=title or model.name or "stepper", verbose=False)
        self._spacing = 1.5 * scene.extent
        self._sizes = np.tile(scene.sizes, (count, 1, 1))
        self._lock = threading.Lock()
        self._weight = max(float(np.sum(model.body_mass[1:]) * np.linalg.norm(model.gravity)), 1e-9)
        self._frame: Frame | None = None
        self._pull: Array | None = None
        self._start: Array | None = None
        self._sent = 0.0
        self.open = True
        self._build()
        self._panel()

    @property
    def url(self) -> str:
        """Address (URL) of the page."""
        host = self.server.get_host()
        return f"http://{'localhost' if host in ('0.0.0.0', '127.0.0.1') else host}:{self.server.get_port()}"

    @property
    def frame(self) -> Frame | None:
        """Frame that is shown in the browser; None before the first one."""
        return self._frame

    @property
    def pull(self) -> Array | None:
        """Ends of the spring of a dragged body, (2, 3), m; None if no body is dragged."""
        return self._pull

    @property
    def offsets(self) -> Array:
        """Positions of the shown environments in a square grid, (n, 3), m."""
        columns = int(np.ceil(np.sqrt(self.count)))
        k = np.arange(self.count)
        across = (k % columns - (columns - 1) / 2) * self._spacing
        back = (k // columns - (-(-self.count // columns) - 1) / 2) * self._spacing
        return np.stack([across, back, np.zeros(self.count)], axis=1)

    def show(self, frame: Frame, sizes: Array, *, pull: Array | None = None) -> None:
        """Sends a frame to the browser.

        Args:
            frame: The frame.
            sizes: Sizes of the drawn geoms, (n, ngeom, 3), m.
            pull: Ends of the spring of a dragged body, (2, 3), m; None if no body is dragged.
        """
        with self._lock:
            self._frame, self._sizes, self._pull = frame, sizes, pull
            if self._start is None:
                self._start = frame.center.copy()
        self._draw()
        self._write(frame)

    def due(self) -> bool:
        """Whether at least 1 / `FRAMES` seconds have passed since the last frame, so that the next frame should be sent now.

        A call that returns True counts as the sending of a frame: the following frame is due 1 / `FRAMES` seconds after this call.
        """
        now = time.monotonic()
        if now - self._sent < 1.0 / FRAMES:
            return False
        self._sent = now
        return True

    def close(self) -> None:
        """Stops the web server."""
        if self.open:
            self.open = False
            self.server.stop()

    def on_pull(self, respond: Callable[[str, int, int, Array], None]) -> None:
        """Registers a function that is called while the user drags a geom with Ctrl: `respond(phase, row, geom, place)`.

        `phase` is "start", "update" or "end". `row` is the index of the environment among those shown, and `geom` the index of the geom.
        `place` is the position of the pointer, (3,), m, in the coordinates of the environment.
        """
        for part, handle in zip(self.scene.parts, self._parts, strict=True):
            self._listen(part, handle, respond)

    def _listen(self, part: Part, handle: Any, respond: Callable[[str, int, int, Array], None]) -> None:
        """Registers the function of `on_pull` for one mesh, which draws one or more geoms, and its viser handle for all copies."""

        # An asynchronous callback receives the phases in order.
        async def dragged(event: Any) -> None:
            row, k = divmod(int(event.instance_index or 0), len(part.geom))
            place = event.start_position if event.phase == "start" else event.end_position
            respond(event.phase, row, int(part.geom[k]), np.array(place) - self.offsets[row] - np.array(self._root.position))

        handle.on_drag("left", modifier="cmd/ctrl")(dragged)

    def _build(self) -> None:
        """Creates the scene in the browser: lights, camera, meshes, floors, tendons, contacts and forces."""
        server, extent = self.server, self.scene.extent
        across = self._spacing * (np.ceil(np.sqrt(self.count)) - 1) + 2.0 * extent
        server.scene.set_up_direction("+z")
        # The default lights of viser, an environment map and a sun with three shadow maps, make colours pale and, without a graphics
        # card, draw bands on floors.
        server.scene.configure_environment_map(None)
        server.scene.configure_default_lights(enabled=False)
        server.scene.add_light_hemisphere("/sky", sky_color=(255, 255, 255), ground_color=(160, 155, 150), intensity=1.3)
        server.scene.add_light_directional("/sun", intensity=2.0, position=(0.5 * across, -0.7 * across, 2.0 * across), cast_shadow=True)
        # No share button, because it opens a tunnel to the internet.
        server.gui.configure_theme(show_logo=False, show_share_button=False)
        # The camera looks to the right of the middle, because the panel covers the right side of the page.
        server.initial_camera.look_at = np.add(self.scene.center, [0.12 * across, 0.0, 0.0])
        server.initial_camera.position = np.add(self.scene.center, [0.4 * across, -1.0 * across, 0.4 * across])
        server.initial_camera.fov = np.radians(45.0)
        self._root = server.scene.add_frame("/scene", show_axes=False)
        still = np.zeros((self.count, self._model.ngeom, 3)), np.tile([1.0, 0, 0, 0], (self.count, self._model.ngeom, 1))
        placed = [instances(part, self._sizes, *still) for part in self.scene.parts]
        self._parts = [self._add(k, part, *given) for k, (part, given) in enumerate(zip(self.scene.parts, placed, strict=True))]
        self._scales = [scale for _, _, scale in placed]
        self._floors = [self._floor(g) for g in self.scene.planes]
        self._contacts = server.scene.add_point_cloud(
            "/scene/contacts", np.zeros((1, 3), np.float32), _CONTACT_COLOUR, point_size=0.025 * extent, point_shape="circle",
            precision="float32", visible=False,
        )  # fmt: skip
        arrow = {"shaft_radius": 0.006 * extent, "head_radius": 0.014 * extent, "head_length": 0.04 * extent, "visible": False}
        self._forces = server.scene.add_arrows("/scene/forces", np.zeros((1, 2, 3), np.float32), _FORCE_COLOUR, **arrow)
        self._tendons = server.scene.add_line_segments(
            "/scene/tendons", np.zeros((1, 2, 3), np.float32), TENDON_COLOUR, line_width=3.0, visible=False
        )
        self._pulls = server.scene.add_arrows("/scene/pull", np.zeros((1, 2, 3), np.float32), _PULL_COLOUR, **arrow)

    def _add(self, k: int, part: Part, place: Array, quat: Array, scale: Array) -> Any:
        """Adds all copies of one mesh, in all environments, to the scene in the browser, and returns viser's handle of these copies.

        The n copies have positions (n, 3), m, orientations (n, 4), quaternions (w, x, y, z), and scale factors of the axes, (n, 3).
        """
        colours = np.round(255 * np.tile(part.rgba, (self.count, 1))).astype(np.uint8)
        return self.server.scene.add_batched_meshes_simple(
            f"/scene/{k} {part.name}", part.mesh.vertices, part.mesh.faces, quat, place,
            batched_scales=scale, batched_colors=colours[:, :3], lod="off", flat_shading=part.mesh.flat,
            batched_opacities=None if np.all(part.rgba[:, 3] >= 1) else np.tile(part.rgba[:, 3], self.count),
            side="double" if part.name == "plane" else "front", cast_shadow=part.name != "plane", visible=part.group in self.scene.shown,
        )  # fmt: skip

    def _floor(self, geom: int) -> Any:
        """Adds a floor of tiles for a plane, shared by all environments, and returns its handle; the floor ends in fog."""
        extent = self.scene.extent
        side = 20 * extent + 4 * self._spacing * np.sqrt(self.count)
        tile = max(10.0 ** np.round(np.log10(0.4 * extent)), side / TILES)
        half = int(np.ceil(side / tile / 2))
        x, y = (index.ravel() for index in np.meshgrid(np.arange(-half, half), np.arange(-half, half)))
        colour = self.scene.rgba[geom, :3] if np.ptp(self.scene.rgba[geom, :3]) > 0 else np.array(_FLOOR)
        shade = np.where((x + y) % 2 == 0, 0.85, 1.0)
        self.server.scene.configure_fog(0.25 * side, 0.6 * side)
        return self.server.scene.add_batched_meshes_simple(
            f"/scene/plane {geom}", FLAT.vertices, FLAT.faces, np.tile([1.0, 0, 0, 0], (len(x), 1)),
            np.stack([(x + 0.5) * tile, (y + 0.5) * tile, 0 * x], axis=1), batched_scales=np.full(len(x), tile / 2), lod="off",
            batched_colors=np.round(255 * shade[:, None] * colour).astype(np.uint8), side="double", cast_shadow=False,
        )  # fmt: skip

    def _panel(self) -> None:
        """Adds the text and the controls of the folder "Show"."""
        gui = self.server.gui
        self.text = gui.add_markdown("")
        with gui.add_folder("Show"):
            self._show_contacts = gui.add_checkbox("contacts", True)
            self._show_forces = gui.add_checkbox("contact forces", True)
            self._force_scale = gui.add_slider("force scale", min=-2.0, max=2.0, step=0.1, initial_value=0.0, hint="powers of ten")
            names = ["none", *map(str, range(self.count))]
            self._follow = gui.add_dropdown("follow", names, initial_value="none") if self.count < 100 else None
            if self.count > 1:
                self._gap = gui.add_slider(
                    "spacing", min=0.0, max=4.0 * self.scene.extent, step=0.01 * self.scene.extent,
                    initial_value=min(self._spacing, 4.0 * self.scene.extent),
                )  # fmt: skip
                self._gap.on_update(lambda _: self._move(self._gap.value))
            groups = sorted({part.group for part in self.scene.parts})
            for group in groups if len(groups) > 1 else []:
                box = gui.add_checkbox(f"geom group {group}", group in self.scene.shown)
                box.on_update(lambda event, group=group: self._reveal(group, event.target.value))
        for control in (self._show_contacts, self._show_forces, self._force_scale, self._follow):
            if control is not None:
                control.on_update(lambda _: self._draw())

    def _move(self, spacing: float) -> None:
        """Sets the distance between neighbouring environments, m, and draws the scene again."""
        self._spacing = spacing
        self._draw()

    def _reveal(self, group: int, shown: bool) -> None:
        """Shows or hides the geoms of one of MuJoCo's geom groups."""
        for part, handle in zip(self.scene.parts, self._parts, strict=True):
            if part.group == group:
                handle.visible = shown

    def _draw(self) -> None:
        """Sends the current frame to the browser.

        The thread that steps calls this method. If the user changes a control, a thread of viser calls it.
        """
        with self._lock, self.server.atomic():
            frame, pull = self._frame, self._pull
            if frame is None or not self.open:
                return
            offsets = self.offsets
            xpos = frame.geom_xpos + offsets[:, None]
            self._root.position = self._shift(frame)
            for k, (part, handle) in enumerate(zip(self.scene.parts, self._parts, strict=True)):
                handle.batched_positions, handle.batched_wxyzs, scales = instances(part, self._sizes, xpos, frame.geom_xquat)
                if not np.array_equal(scales, self._scales[k]):
                    handle.batched_scales = self._scales[k] = scales
            for geom, handle in zip(self.scene.planes, self._floors, strict=True):
                handle.position, handle.wxyz = frame.geom_xpos[0, geom], frame.geom_xquat[0, geom]
            if frame.tendons.shape[1]:
                paths = frame.tendons + offsets[:, None, None]
                self._tendons.points = np.stack([paths[:, :, :-1], paths[:, :, 1:]], axis=3).reshape(-1, 2, 3).astype(np.float32)
                self._tendons.visible = True
            self._draw_contacts(frame, offsets)
            if pull is not None:
                self._pulls.points = pull[None].astype(np.float32)
            self._pulls.visible = pull is not None

    def _draw_contacts(self, frame: Frame, offsets: Array) -> None:
        """Sends the positions and force arrows of contacts to the browser; `offsets` are the positions of the environments, (n, 3), m."""
        pressed = np.linalg.norm(frame.contact_force, axis=1) > 1e-6 * self._weight
        place = (frame.contact_pos + offsets[frame.contact_env])[pressed].astype(np.float32)
        if len(place):
            length = 10.0**self._force_scale.value * FORCE * self.scene.extent / self._weight
            self._contacts.points = place
            self._forces.points = np.stack([place, place + length * frame.contact_force[pressed]], axis=1).astype(np.float32)
        self._contacts.visible = bool(len(place)) and self._show_contacts.value
        self._forces.visible = bool(len(place)) and self._show_forces.value

    def _shift(self, frame: Frame) -> tuple[float, float, float]:
        """Displacement (x, y, 0) of the scene, m, that keeps the followed environment's centre of mass at its initial x and y.

        The displacement is 0 if the user follows no environment.
        """
        chosen = "none" if self._follow is None else self._follow.value
        if chosen == "none" or self._start is None:
            return (0.0, 0.0, 0.0)
        x, y, _ = (self._start[int(chosen)] - frame.center[int(chosen)]).tolist()
        return (x, y, 0.0)

    def _write(self, frame: Frame) -> None:
        """Updates the text in the browser's panel: time, residual, penetration depth and status."""
        flags = Status(int(np.bitwise_or.reduce(frame.status)))
        wrong = flags.name if flags else "OK"
        lines = [
            f"**{self._model.name or 'model'}**, {self.count} shown" if self.count > 1 else f"**{self._model.name or 'model'}**",
            f"time {frame.time[0]:.3f} s",
            f"residual {frame.residual.max():.1e} m/s, penetration {1e3 * frame.max_penetration.max():.2f} mm",
            f"status {wrong}",
        ]
        text = "  \n".join(lines)
        if self.text.content != text:
            self.text.content = text
