"""View of a running simulation, with pause, step, speed, reset and dragging of bodies."""

from __future__ import annotations

import threading
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np

from stepper._stepper import Model, Stepper
from stepper.shared.arguments import check_kind
from stepper.shared.rotations import matrices
from stepper.viewer.frames import Envs, frame_of, shown_envs, sizes_of, values_of
from stepper.viewer.looks import Array, looks_of, row
from stepper.viewer.shapes import Scene, scene_of
from stepper.viewer.window import Served, Window

FREQUENCY = 10.0
"""Angular frequency of the spring that drags a body, rad/s.

The stiffness is the frequency squared times the effective mass at the dragged point. The frequency is that of
MuJoCo's viewer: the square root of the default of visual/map/stiffness, 100.
"""


@dataclass
class Drag:
    """Spring and damper that pull a point of a body, as in MuJoCo's viewer. The damping is critical for the effective mass at the point.

    Attributes:
        env: Index of the environment.
        body: Index of the body.
        point: Pulled point in the body's frame, (3,), m.
        target: Position of the pointer in the world, (3,), m.
        mass: Effective mass at the point, kg.
    """

    env: int
    body: int
    point: Array
    target: Array
    mass: float

    @classmethod
    def begin(cls, sim: Stepper, env: int, body: int, place: Array) -> Drag | None:
        """Starts to drag a body.

        Args:
            sim: The stepper.
            env: Index of the environment.
            body: Index of the body.
            place: Point of the body, in world coordinates, (3,), m.

        Returns:
            The spring and damper; None if the body cannot move.
        """
        mass = effective_mass(sim, env, body, place)
        if mass is None:
            return None
        rotation, origin = matrices(_row(sim, "xquat", env)[body]), _row(sim, "xpos", env)[body]
        return cls(env, body, rotation.T @ (place - origin), np.array(place), mass)

    def at(self, sim: Stepper) -> Array:
        """Position of the pulled point in the world, (3,), m."""
        rotation = matrices(_row(sim, "xquat", self.env)[self.body])
        place: Array = _row(sim, "xpos", self.env)[self.body] + rotation @ self.point
        return place

    def wrench(self, sim: Stepper, strength: float = 1.0) -> Array:
        """Force and torque by which spring and damper pull the body, (6,) in world axes, N and N m, for `Stepper.xfrc_applied`.

        The torque is about the body's centre of mass. `strength` is a factor of the stiffness.
        """
        origin, rotation = _row(sim, "xpos", self.env)[self.body], matrices(_row(sim, "xquat", self.env)[self.body])
        place = self.at(sim)
        spin = _row(sim, "body_angvel", self.env)[self.body]
        velocity = _row(sim, "body_linvel", self.env)[self.body] + np.cross(spin, place - origin)
        stiffness = strength * self.mass * FREQUENCY**2
        force = stiffness * (self.target - place) - 2 * np.sqrt(stiffness * self.mass) * velocity
        centre = origin + rotation @ sim.model.body_ipos[self.body]
        return np.concatenate([force, np.cross(place - centre, force)])


def effective_mass(sim: Stepper, env: int, body: int, place: Array) -> float | None:
    """Effective mass at a point of a body, kg: the harmonic mean of the masses for forces along x, y and z.

    The result is None if the point cannot move. The point `place`, (3,), m, is in world coordinates.
    """
    matrices_of_mass = np.asarray(sim.mass_matrix(), np.float64)
    mass = matrices_of_mass if sim.num_envs is None else matrices_of_mass[env]
    if not len(mass):
        return None
    jacobian = sim.jacobian(body=body)
    rows = np.asarray(jacobian if sim.num_envs is None else jacobian[env], np.float64)
    arm = place - _row(sim, "xpos", env)[body]
    moved = rows[:3] + np.cross(rows[3:].T, arm).T
    mobility = float(np.trace(moved @ np.linalg.solve(mass, moved.T))) / 3.0
    return 1.0 / mobility if mobility > 0 else None


def _row(sim: Stepper, name: str, env: int) -> Array:
    """Values of a quantity of a stepper in one environment, (...) float64, in its unit."""
    values: Array = values_of(sim, name, np.array([env]))[0]
    return values.astype(np.float64)


SHOWN = 16
"""Largest number of environments that are shown by default."""
SPEEDS = ("0.1", "0.25", "0.5", "1", "2", "4", "as fast as it can")
SLIDERS = 12
"""Largest number of actuators for which the folder of control sliders is open initially."""
_MAX_LAG = 0.25
"""Largest lag behind real time that the view catches up, s. If a slow simulation lags more, the view skips the excess."""


class _Applied(NamedTuple):
    """Force and torque by which a dragged body is pulled, stored so that they can be removed from `xfrc_applied`.

    `without` and `with_it` are the values of `xfrc_applied` at the body without and with the pull, (6,) each, N and N m.
    """

    env: int
    body: int
    without: Array
    with_it: Array


def scene_for(model: Model, source: Any) -> Scene:
    """Drawing of a model, with a warning about meshes and height fields that are not drawn because the source of the model is unknown.

    Args:
        model: The model.
        source: Source of the model, such as an MJCF file; see `stepper.load`. None uses the source from which the model was loaded.
    """
    scene = scene_of(model, looks_of(model, source))
    if scene.missing:
        names = ", ".join(model.geom(g).name or f"#{g}" for g in scene.missing[:5])
        warnings.warn(
            f"{len(scene.missing)} geoms are not drawn ({names}{', ...' if len(scene.missing) > 5 else ''}): the shapes of meshes and "
            "height fields are only in the MJCF. Pass the MJCF as source, or load the model from it with stepper.load",
            UserWarning,
            stacklevel=4,
        )
    return scene


class View(Served):
    """View of a running `Stepper` in the browser, with a web server; a context manager.

        with stepper.viewer.view(sim) as view:
            while view.open:
                sim.step(policy(sim))
                view.update()

    Drag a body with Ctrl and the left mouse button. The force and torque of a spring are then added to `sim.xfrc_applied`. A
    reset, or a value that the program writes there, replaces them.

    Args:
        sim: The stepper.
        envs: Number of environments to show, a mask (num_envs,), or indices; None selects all environments, but at most 16.
        source: Source of the model with colours and meshes, such as an MJCF file; see `stepper.load`. None uses the source from which this
            process loaded the model. If it is unknown, colours are plain, and meshes and height fields are not drawn.
        host: Address of the server; the default accepts connections from this machine only.
        port: Port of the server; if it is in use, the next free one.
        reset: Function that the button "reset" calls; None selects `sim.reset()`.

    Raises:
        LooksError: The source belongs to another model.
        MissingPackageError: viser is not installed.
        ValueError: `envs` is not valid for the stepper.
    """

    def __init__(
        self,
        sim: Stepper,
        *,
        envs: Envs = None,
        source: Any = None,
        host: str = "127.0.0.1",
        port: int = 8080,
        reset: Callable[[], Any] | None = None,
    ):
        check_kind("sim", sim, Stepper, "stepper.viewer.view(stepper.Stepper(model))")
        self.sim, self.envs = sim, shown_envs(sim, envs, SHOWN)
        self._reset = sim.reset if reset is None else reset
        # Stored here, because callbacks from the browser may come during a step, when the stepper cannot be read.
        self._body_of = [sim.model.geom(g).bodyid for g in range(sim.model.ngeom)]
        self.window = Window(scene_for(sim.model, source), sim.model, len(self.envs), host=host, port=port)
        self._lock = threading.Lock()
        self._requested_reset, self._steps, self._wake = False, 0, threading.Event()
        self._drag: Drag | None = None
        self._grabbed: tuple[int, int, Array] | None = None
        self._target: Array | None = None
        self._applied: _Applied | None = None
        self._time, self._clock = self._now(), time.monotonic()
        self._panel()
        self.window.on_pull(self._dragged)
        self.show()

    @property
    def paused(self) -> bool:
        """Whether the view is paused. `update` then waits."""
        return bool(self._pause.value)

    @paused.setter
    def paused(self, value: bool) -> None:
        self._pause.value = value
        self._wake.set()

    def update(self) -> None:
        """Shows the current state at the frame rate and keeps real time. Call it after every step, or after every few steps.

        It waits until real time, multiplied by the chosen speed, reaches the simulated time. While the view is paused, it waits until the
        user continues, makes a single step or resets.
        """
        if not self.open:
            self._release()
            return
        self._pull()
        if self.window.due():
            self.show()
        self._keep_time()
        if self.paused and self._steps == 0:
            self.show()
            while self.open and self.paused and self._steps == 0 and not self._requested_reset:
                self._wake.wait(0.1)
                self._wake.clear()
            self._clock = time.monotonic()
        with self._lock:
            self._steps = max(self._steps - 1, 0)
            requested, self._requested_reset = self._requested_reset, False
        if requested:
            self._release()
            self._reset()
            self.show()

    def run(self, advance: Callable[[], Any] | None = None) -> None:
        """Steps and shows the simulation until the view is closed or Ctrl-C is pressed.

        Args:
            advance: Function without arguments that makes one step. With None, `sim.step` makes the steps, with controls from sliders: one
                slider per actuator, for all environments together.
        """
        step = self._sliders() if advance is None else advance
        try:
            while self.open:
                step()
                self.update()
        except KeyboardInterrupt:
            pass
        finally:
            self.close()
            self._release()

    def show(self) -> None:
        """Shows the current state immediately."""
        pull = None
        if self._drag is not None:
            shift = self.window.offsets[int(np.flatnonzero(self.envs == self._drag.env)[0])]
            pull = np.stack([self._drag.at(self.sim), self._drag.target]) + shift
        self.window.show(frame_of(self.sim, self.envs), sizes_of(self.sim, self.envs, self.window.scene), pull=pull)

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        super().__exit__(kind, error, trace)
        self._release()

    def _panel(self) -> None:
        """Adds the buttons and sliders of the folder "Run"."""
        gui = self.window.server.gui
        with gui.add_folder("Run"):
            self._pause = gui.add_checkbox("pause", False)
            step, reset = gui.add_button("step"), gui.add_button("reset")
            self._speed = gui.add_dropdown("speed", SPEEDS, initial_value="1")
            self._strength = gui.add_slider("pull strength", min=0.1, max=30.0, step=0.1, initial_value=3.0)
            gui.add_markdown("Drag a body with Ctrl and the left button.")
        self._pause.on_update(lambda _: self._wake.set())
        step.on_click(lambda _: self.step_once())
        reset.on_click(lambda _: self.request_reset())

    def step_once(self) -> None:
        """Pauses the view and makes a single step, like the button "step"."""
        with self._lock:
            self._steps += 1
        self.paused = True

    def request_reset(self) -> None:
        """Resets the simulation at the next `update`, like the button "reset"."""
        with self._lock:
            self._requested_reset = True
        self._wake.set()

    def _sliders(self) -> Callable[[], None]:
        """Adds a folder with a slider for each control, and returns a function that makes a step with their values."""
        model, gui = self.sim.model, self.window.server.gui
        held = np.atleast_2d(np.asarray(self.sim.ctrl))[int(self.envs[0])]
        sliders = []
        with gui.add_folder("Controls", expand_by_default=model.nu <= SLIDERS, visible=model.nu > 0):
            for k in range(model.nu):
                actuator = model.actuator(k)
                low, high = np.where(np.isfinite(actuator.ctrlrange), actuator.ctrlrange, [-1.0, 1.0]).tolist()
                start = float(np.clip(held[k], low, high))
                label = actuator.name or f"#{k}"
                sliders.append(gui.add_slider(label, min=low, max=high, step=max((high - low) / 200, 1e-9), initial_value=start))

        def step() -> None:
            self.sim.step(np.array([slider.value for slider in sliders]) if sliders else None)

        return step

    def _now(self) -> float:
        """Simulated time of the first shown environment, s."""
        return float(row(self.sim, "time", int(self.envs[0])))

    def _keep_time(self) -> None:
        """Sleeps until real time, multiplied by the chosen speed, reaches the simulated time."""
        now, clock = self._now(), time.monotonic()
        passed, self._time = max(now - self._time, 0.0), now
        if self._speed.value == SPEEDS[-1]:
            self._clock = clock
            return
        self._clock = max(self._clock + passed / float(self._speed.value), clock - _MAX_LAG)
        if self._clock > clock:
            time.sleep(self._clock - clock)

    def _dragged(self, phase: str, k: int, geom: int, place: Array) -> None:
        """Stores an event of dragging from the browser for the next `update`; see `Window.on_pull` for the arguments."""
        with self._lock:
            if phase == "start":
                self._grabbed = (int(self.envs[k]), self._body_of[geom], place)
            self._target = None if phase == "end" else place

    def _pull(self) -> None:
        """Starts, continues or ends dragging as the last event of the browser requires, and applies the force for the next step."""
        with self._lock:
            grabbed, self._grabbed, target = self._grabbed, None, self._target
        if grabbed is not None:
            self._release()
            self._drag = Drag.begin(self.sim, *grabbed)
        if target is None:
            self._release()
        elif self._drag is not None:
            self._drag.target = target
            self._apply((self._drag.env, self._drag.body, self._drag.wrench(self.sim, self._strength.value)))

    def _release(self) -> None:
        """Ends dragging of a body and removes its force from `xfrc_applied`."""
        self._drag = None
        self._apply(None)

    def _apply(self, wrench: tuple[int, int, Array] | None) -> None:
        """Replaces the force and torque of dragging in `xfrc_applied`; other applied forces remain.

        The wrench has the index of the environment and of the body, and (6,), N and N m. None only removes the previous ones.
        """
        forces = self.sim.xfrc_applied if self.sim.num_envs is not None else self.sim.xfrc_applied[None]
        if self._applied is not None:
            # Entries that changed since then were written by a reset or by the program, without this wrench.
            current = forces[self._applied.env, self._applied.body]
            current[:] = np.where(current == self._applied.with_it, self._applied.without, current)
        self._applied = None
        if wrench is not None:
            env, body, values = wrench
            without = np.array(forces[env, body], subok=False)
            forces[env, body] += values
            self._applied = _Applied(env, body, without, np.array(forces[env, body], subok=False))


def view(sim: Stepper, **settings: Any) -> View:
    """Opens a view of a stepper in the browser and prints its address; the arguments are those of `View`."""
    opened = View(sim, **settings)
    print(f"{opened.url} shows {len(opened.envs)} of {sim.num_envs or 1} environments")
    return opened
