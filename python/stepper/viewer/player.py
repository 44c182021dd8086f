"""Player for recordings in the browser, with play, pause, speed and a slider for the frame."""

from __future__ import annotations

import os
import threading
import time
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from stepper._stepper import ModelError
from stepper.loading import Origin
from stepper.recording.format import HEADER, Arrays, RecordingError, read_header, read_rows, reading, warn_of_end
from stepper.recording.verify import apply_parameters, recorded_stepper
from stepper.shared.fields import APPLIED
from stepper.viewer.frames import Envs, Frame, frame_of, shown_envs, sizes_of
from stepper.viewer.live import SHOWN, SPEEDS, scene_for
from stepper.viewer.looks import Array, LooksError
from stepper.viewer.shapes import Scene
from stepper.viewer.window import FRAMES, Served, Window

_STATE = ("qpos", "qvel", "act", "time")
"""Recorded fields of the state that a frame shows, and from which its contacts are computed."""
_RECORDED = ("status", "residual", "max_penetration")
"""Recorded fields that a frame takes from the recording without change."""


class RecordedRun:
    """Frames of some environments of a recording, with one frame per call of `step`.

    States come from the recording. Contacts are not recorded: for each frame the next step is computed again, with the recorded controls,
    applied forces and parameters.

    Args:
        path: Folder that `Stepper.record` wrote.
        envs: Number of environments to show, a mask (num_envs,), or indices; None selects all environments, but at most `most`.
        most: Largest number of environments with `envs=None`.

    Raises:
        RecordingError: The recording cannot be read, or contains no step.
        ValueError: `envs` is not valid for the recording.

    Attributes:
        sim: Stepper with the settings of the recorded one.
        envs: Indices of the environments, (n,).
        source: File from which the model was loaded, with its added floor and free base; None if it is unknown.
        time: Simulated time of the first environment after each call, s: (frames,).
    """

    def __init__(self, path: str | os.PathLike[str], envs: Envs = None, *, most: int = 16):
        folder = Path(path)
        head = read_header(folder)
        warn_of_end(folder, head)
        with reading(folder / HEADER):
            self.sim = recorded_stepper(folder, head)
            recorded = head["model"]
            source, floor = recorded.get("source"), recorded.get("floor")
            origin = Origin(source, floor=None if floor is None else float(floor), free_base=bool(recorded.get("free_base")))
            self.source = None if source is None else origin
        self.envs = shown_envs(self.sim, envs, most)
        self._single = self.sim.num_envs is None
        columns: dict[str, list[Array]] = {name: [] for name in (*_STATE, *_RECORDED, "ctrl")}
        self._applied: list[Arrays] = []
        self._parameters: list[tuple[int, Arrays]] = []
        applied: Arrays = {}
        for _, kind, arrays in read_rows(folder, head):
            if kind == "step":
                for name, rows in columns.items():
                    values = arrays[name]
                    rows.append(values if name == "ctrl" else (values[None] if self._single else values)[self.envs])
                self._applied.append(applied)
            elif kind == "applied":
                applied = {name: arrays[name] for name in APPLIED if name in arrays}
            elif kind == "reset":
                applied = {}
            elif kind in ("start", "randomize"):
                self._parameters.append((len(self._applied), arrays))
        if not self._applied:
            raise RecordingError(f"{folder}: the recording contains no step to show")
        self._columns = {name: np.array(rows) for name, rows in columns.items()}
        self._shown_row = -1
        self.time = self._columns["time"][:, 0]

    def __len__(self) -> int:
        """Number of frames."""
        return len(self._applied)

    def __getitem__(self, index: int) -> Frame:
        """Frame with an index, from 0; negative indices count from the end."""
        index = range(len(self))[index]
        self._set_parameters(index)
        state = {name: self._whole(name, self._columns[name][index]) for name in _STATE}
        mask = None if self._single else np.isin(np.arange(self.sim.num_envs or 1), self.envs)
        self.sim.reset()
        for name, values in self._applied[index].items():
            setattr(self.sim, name, values)
        self.sim.set_state(state["qpos"], state["qvel"], mask, act=state["act"], time=state["time"])
        here = frame_of(self.sim, self.envs)
        ctrl = self._columns["ctrl"][min(index + 1, len(self) - 1)]
        self.sim.step(ctrl[0] if self._single else ctrl)
        follows = frame_of(self.sim, self.envs)
        contacts = {name: getattr(follows, name) for name in ("contact_env", "contact_pos", "contact_force")}
        return replace(here, **contacts, **{name: self._columns[name][index] for name in _RECORDED})

    def _whole(self, name: str, values: Array) -> Array:
        """Values of a quantity in all environments: `values` in the shown environments, current values of the stepper in the others."""
        if self._single:
            first: Array = values[0]
            return first
        whole = np.array(getattr(self.sim, name), subok=False)
        whole[self.envs] = values
        return whole

    def _set_parameters(self, index: int) -> None:
        """Sets the parameters of the stepper's environments to those that the recorded environments had at the frame `index`."""
        due = sum(start <= index for start, _ in self._parameters)
        if due == self._shown_row:
            return
        self.sim.randomize()
        for _, arrays in self._parameters[:due]:
            apply_parameters(self.sim, dict(arrays))
        self._shown_row = due


class Player(Served):
    """View of a recording in the browser, with a web server; a context manager.

    Args:
        path: Folder that `Stepper.record` wrote.
        envs: Number of environments to show, a mask (num_envs,), or indices; None selects all environments, but at most 16.
        source: Source of the recorded model, with colours and meshes; None uses the file that the recording names, if it still exists.
        host: Address of the server; the default accepts connections from this machine only.
        port: Port of the server; if it is in use, the next free one.

    Raises:
        RecordingError: The recording cannot be read.
        LooksError: The argument `source` belongs to another model.
        MissingPackageError: viser is not installed.
        ValueError: `envs` is not valid for the recording.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        envs: Envs = None,
        source: Any = None,
        host: str = "127.0.0.1",
        port: int = 8080,
    ):
        self.run_of = RecordedRun(path, envs, most=SHOWN)
        model = self.run_of.sim.model
        self.window = Window(
            recorded_scene(self.run_of, source),
            model,
            len(self.run_of.envs),
            host=host,
            port=port,
            title=Path(path).resolve().name,
        )
        self._lock = threading.Lock()
        self._shown = -1
        self._requested: int | None = None
        self._play: Any
        self._speed: Any
        self._slider: Any
        self._panel()
        self.seek(0)

    def seek(self, index: int) -> None:
        """Shows the frame with an index, from 0."""
        with self._lock:
            if index != self._shown and self.open:
                self._shown = index
                self._slider.value = index
                frame = self.run_of[index]
                self.window.show(frame, sizes_of(self.run_of.sim, self.run_of.envs, self.window.scene))

    def run(self) -> None:
        """Plays the recording in a loop until the view is closed or Ctrl-C is pressed."""
        times = _clock_of(self.run_of)
        at, before = float(times[0]), time.monotonic()
        try:
            while self.open:
                time.sleep(1.0 / FRAMES)
                now = time.monotonic()
                if self._requested is not None:
                    index, self._requested = self._requested, None
                    at = float(times[index])
                    self.seek(index)
                elif self._play.value:
                    at += (now - before) * float(self._speed.value)
                    if at > times[-1]:
                        at = float(times[0])
                    self.seek(int(np.searchsorted(times, at, side="right")) - 1)
                before = now
        except KeyboardInterrupt:
            pass
        finally:
            self.close()

    def _panel(self) -> None:
        """Adds the controls of the folder "Play"."""
        gui = self.window.server.gui
        with gui.add_folder("Play"):
            self._play = gui.add_checkbox("play", True)
            self._speed = gui.add_dropdown("speed", SPEEDS[:-1], initial_value="1")
            last = max(len(self.run_of) - 1, 1)
            self._slider = gui.add_slider("frame", min=0, max=last, step=1, initial_value=0, disabled=len(self.run_of) == 1)
        self._slider.on_update(self._moved)

    def _moved(self, event: Any) -> None:
        """Callback of the slider for the frame: if the user moved it, pauses the recording and requests the frame."""
        if event.client is not None:  # None if `seek` moved the slider.
            self._play.value = False
            self._requested = min(int(event.target.value), len(self.run_of) - 1)


def recorded_scene(run: RecordedRun, source: Any = None) -> Scene:
    """Drawing of a recorded model.

    Args:
        run: The recording.
        source: Source of the model; None uses the file that is named in the recording, or no source if that cannot be read.
    """
    if source is None and run.source is not None:
        try:
            return scene_for(run.sim.model, run.source)
        except (LooksError, ModelError, OSError, ImportError) as error:
            warnings.warn(f"the recorded model is drawn without colours and meshes: {error}", UserWarning, stacklevel=2)
    return scene_for(run.sim.model, source)


def _clock_of(run: RecordedRun) -> Any:
    """Playing times of the frames, s: (frames,). They also increase at a reset, where the simulated time goes back."""
    steps = np.diff(run.time)
    usual = float(np.median(steps[steps > 0])) if np.any(steps > 0) else float(run.sim.timestep)
    return np.concatenate([[0.0], np.cumsum(np.where(steps > 0, steps, usual))])
