"""Logs for the Rerun viewer: poses, contacts and scalars of environments over time."""

from __future__ import annotations

import os
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from stepper._stepper import Model, Stepper
from stepper.shared.machine import require
from stepper.shared.progress import ProgressCallback, silent
from stepper.viewer.frames import Envs, Frame, frame_of, parameter_of, shown_envs, sizes_of
from stepper.viewer.live import scene_for
from stepper.viewer.looks import Array
from stepper.viewer.player import recorded_scene
from stepper.viewer.recordings import RecordedRun
from stepper.viewer.shapes import Scene, instances
from stepper.viewer.window import FORCE, TENDON_COLOUR

TIMELINE = "simulated"
"""Name of the timeline: simulated time of the first environment, s, which continues over resets."""
LOGGED = 4
"""Largest number of environments that are logged by default."""


class RerunLog:
    """Writes a log of a running simulation, a .rrd file for the Rerun viewer; a context manager. `close` completes the file.

        with stepper.viewer.RerunLog(sim, "run.rrd") as log:
            for _ in range(1000):
                sim.step()
                log.log()

    The log has for each environment the bodies with their geoms, spatial tendons, and contacts with forces. It also has scalars: residual,
    max_penetration, number of contacts, status, potential and kinetic energy.

    Args:
        sim: The stepper.
        path: File to write; an existing one is replaced.
        envs: Number of environments to log, a mask (num_envs,), or indices; None selects all environments, but at most 4.
        source: Source of the model with colours and meshes, such as an MJCF file; see `stepper.viewer.View`.

    Raises:
        MissingPackageError: Rerun is not installed.
        ValueError: `envs` is not valid for the stepper.
        OSError: The file cannot be written.
    """

    def __init__(self, sim: Stepper, path: str | os.PathLike[str], *, envs: Envs = None, source: Any = None):
        self._sim, self.envs = sim, shown_envs(sim, envs, LOGGED)
        self._writer = _Writer(path, scene_for(sim.model, source), sim, self.envs)
        self._passed, self._before = 0.0, 0.0

    def log(self) -> None:
        """Adds the current state to the log."""
        frame = frame_of(self._sim, self.envs, energy=True)
        now = float(frame.time[0])
        # Continue the time when a reset sets it back.
        self._passed += now - self._before if now >= self._before else now
        self._before = now
        self._writer.write(self._passed, frame)

    def close(self) -> None:
        """Writes the remaining data and closes the file."""
        self._writer.close()

    def __enter__(self) -> RerunLog:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


def log_rerun(
    recording: str | os.PathLike[str],
    path: str | os.PathLike[str],
    *,
    envs: Envs = None,
    source: Any = None,
    progress: ProgressCallback | None = None,
) -> int:
    """Converts a recording to a .rrd file for the Rerun viewer, with the contents of `RerunLog`.

    Args:
        recording: Folder that `Stepper.record` wrote.
        path: File to write; an existing one is replaced.
        envs: Number of environments to log, a mask (num_envs,), or indices; None selects all environments, but at most 4.
        source: Source of the recorded model with colours and meshes, such as an MJCF file; see `stepper.viewer.Player`.
        progress: Function that is called with "log" and the fraction of the frames that were written.

    Returns:
        Number of frames in the recording.

    Raises:
        RecordingError: The recording cannot be read.
        MissingPackageError: Rerun is not installed.
    """
    run = RecordedRun(recording, envs, most=LOGGED)
    writer = _Writer(path, recorded_scene(run, source), run.sim, run.envs)
    passed, before = 0.0, 0.0
    try:
        for index in range(len(run)):
            now = float(run.time[index])
            passed += now - before if now >= before else now
            before = now
            writer.write(passed, run[index])
            (progress or silent)("log", (index + 1) / len(run))
    finally:
        writer.close()
    return len(run)


class _Writer:
    """Writer of a log file (.rrd) for the Rerun viewer. The constructor writes the planes, which do not change; `write` adds a frame.

    Args:
        path: File to write.
        scene: Drawing of the model.
        sim: The stepper.
        envs: Indices of the environments to log.
    """

    def __init__(self, path: str | os.PathLike[str], scene: Scene, sim: Stepper, envs: Array):
        self._rr = rr = require("rerun", "to write logs for Rerun")
        file = Path(path)
        if not file.parent.is_dir():
            raise FileNotFoundError(f"there is no folder {file.parent}: create it, or choose another path")
        self._sim, self._model, self._scene, self._envs = sim, sim.model, scene, envs
        self._names = [_body_paths(sim.model, int(env)) for env in envs]
        self._weight = max(float(np.sum(sim.model.body_mass[1:]) * np.linalg.norm(sim.model.gravity)), 1e-9)
        self._extent = scene.extent
        self._stream = rr.RecordingStream(sim.model.name or "stepper")
        self._stream.save(str(file))
        self._stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        self._body = [sim.model.geom(g).bodyid for g in range(sim.model.ngeom)]
        self._shapes: Array | None = None
        for bodies in self._names:
            self._log_planes(bodies)

    def write(self, seconds: float, frame: Frame) -> None:
        """Adds a frame to the log at a time of the timeline, s."""
        rr, stream = self._rr, self._stream
        stream.set_time(TIMELINE, duration=seconds)
        self._log_geoms()
        contacts = np.bincount(frame.contact_env, minlength=len(self._envs))
        for row, (env, bodies) in enumerate(zip(self._envs, self._names, strict=True)):
            for body, name in enumerate(bodies):
                if body:
                    quat = np.roll(frame.xquat[row, body], -1)
                    stream.log(name, rr.Transform3D(translation=frame.xpos[row, body], quaternion=quat))
            touching = frame.contact_env == row
            force = frame.contact_force[touching]
            arrows = rr.Arrows3D(
                origins=frame.contact_pos[touching],
                vectors=force * (FORCE * self._extent / self._weight),
                colors=[230, 60, 40],
                radii=0.004 * self._extent,
                labels=[f"{size:.3g} N" for size in np.linalg.norm(force, axis=1)],
                show_labels=False,
            )
            stream.log(f"env_{env}/contacts", arrows)
            if frame.tendons.shape[1]:
                strips = rr.LineStrips3D(frame.tendons[row], colors=list(TENDON_COLOUR), radii=0.002 * self._extent)
                stream.log(f"env_{env}/tendons", strips)
            scalars = {
                "residual": frame.residual[row],
                "max_penetration": frame.max_penetration[row],
                "contacts": contacts[row],
                "energy/potential": frame.energy[row, 0],
                "energy/kinetic": frame.energy[row, 1],
                "status": frame.status[row],
            }
            for name, value in scalars.items():
                stream.log(f"scalars/env_{env}/{name}", rr.Scalars(float(value)))

    def close(self) -> None:
        """Writes remaining data and closes the file."""
        self._stream.flush()
        self._stream.disconnect()

    def _log_geoms(self) -> None:
        """Adds the shapes of the geoms to the log, in the frames of their bodies: all in the first frame, later only changed ones."""
        sizes, places = sizes_of(self._sim, self._envs, self._scene), parameter_of(self._sim, "geom_pos", self._envs)
        shapes = np.concatenate([sizes, places], axis=2)
        new = np.ones(shapes.shape[:2], bool) if self._shapes is None else np.any(shapes != self._shapes, axis=2)
        self._shapes = shapes
        for row in np.flatnonzero(np.any(new, axis=1)).tolist():
            self._log_shapes(self._names[row], sizes[row], places[row], new[row])

    def _log_shapes(self, bodies: list[str], sizes: Array, places: Array, chosen: Array) -> None:
        """Adds the shapes of some geoms of an environment to the log.

        Args:
            bodies: Paths of the environment's bodies in the log.
            sizes: Sizes of the geoms, (ngeom, 3), m.
            places: Positions of the geoms in their bodies, (ngeom, 3), m.
            chosen: Mask of the geoms to add, (ngeom,).
        """
        model, rr = self._model, self._rr
        for part in self._scene.parts:
            place, turn, scale = instances(part, sizes[None], places[None], np.asarray(model.geom_quat)[None])
            for k, g in enumerate(part.geom):
                if not chosen[g]:
                    continue
                vertices = _rotated(part.mesh.vertices * scale[k], turn[k]) + place[k]
                mesh = rr.Mesh3D(
                    vertex_positions=vertices.astype(np.float32),
                    triangle_indices=part.mesh.faces,
                    albedo_factor=np.round(255 * part.rgba[k]).astype(np.uint8),
                )
                name = model.geom(int(g)).name or f"geom_{g}"
                self._stream.log(f"{bodies[self._body[g]]}/{_path_part(name)}/{k}_{_path_part(part.name)}", mesh)

    def _log_planes(self, bodies: list[str]) -> None:
        """Adds the planes of an environment to the log; `bodies` are the paths of the environment's bodies in the log."""
        model, rr, scene = self._model, self._rr, self._scene
        at, quat = np.asarray(model.geom_pos), np.asarray(model.geom_quat)
        for g in scene.planes:
            side = 5 * scene.extent
            corners = _rotated(np.array([[-side, -side, 0], [side, -side, 0], [side, side, 0], [-side, side, 0]]), quat[g]) + at[g]
            faces = np.array([[0, 1, 2], [0, 2, 3]])
            mesh = rr.Mesh3D(vertex_positions=corners, triangle_indices=faces, albedo_factor=np.round(255 * scene.rgba[g]).astype(np.uint8))
            self._stream.log(f"{bodies[self._body[g]]}/{_path_part(model.geom(g).name or f'geom_{g}')}", mesh, static=True)


def _body_paths(model: Model, env: int) -> list[str]:
    """Paths in the log of all bodies of an environment, such as "env_0/torso"."""
    return [f"env_{env}/world"] + [f"env_{env}/{_path_part(model.body(b).name or f'body_{b}')}" for b in range(1, model.nbody)]


def _path_part(name: str) -> str:
    """Name as a part of a path in the log: characters other than letters, digits, "_", "-" and "." are replaced by "_"."""
    return "".join(letter if letter.isalnum() or letter in "_-." else "_" for letter in name)


def _rotated(points: Array, quat: Array) -> Array:
    """Points, (n, 3), rotated by a unit quaternion (w, x, y, z)."""
    axis = quat[1:]
    half = np.cross(axis, points) + quat[0] * points
    turned: Array = points + 2.0 * np.cross(axis, half)
    return turned
