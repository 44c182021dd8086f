"""Frames of a recording, accessible by index."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from stepper.loading import Origin
from stepper.recording.format import HEADER, Arrays, RecordingError, read_header, read_rows, reading, warn_of_end
from stepper.recording.verify import apply_parameters, recorded_stepper
from stepper.shared.fields import APPLIED
from stepper.viewer.frames import Envs, Frame, frame_of, shown_envs
from stepper.viewer.looks import Array

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
            self.sim = recorded_stepper(folder, head, None, None)
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
