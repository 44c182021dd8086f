"""Failures during a recording, by cause: physics, sensing or action."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from stepper._status import Status

if TYPE_CHECKING:
    from stepper._stepper import Stepper

KEPT = 1000
"""Largest number of failures of each kind whose row and environment are stored; all are counted."""

CAUSES = {
    ("action", "non-finite"): "a control is NaN or infinite; the bodies concerned kept their state",
    ("action", "clipped"): "a control lies outside its range and was clipped",
    ("action", "saturated"): "the effort of an actuator was limited to its bounds",
    ("physics", "non-finite"): "the next state was not finite although the controls were; the bodies concerned kept their state",
    ("physics", "residual"): "the residual is above the tolerance",
    ("physics", "contacts full"): "there were more contacts than Options.max_contacts",
    ("physics", "unresolved"): "the time step was too long for the motion",
    ("physics", "tunnelled"): "a geom moved so fast that it may have passed through a thin one",
    ("physics", "infeasible"): "the constraints contradict each other, as the impulses prove",
    ("physics", "deep"): "geoms overlap by more than 1 mm",
    ("physics", "over limit"): "a joint or tendon is beyond its range by more than 0.01 rad or m",
    ("physics", "equality violated"): "the position error of an equality is above 1 mm or 1 mrad",
    ("physics", "inaccurate"): "the shortest substeps exceeded Options.error",
    ("sensing", "saturation"): "a reading was clipped to the limits of its sensor",
    ("sensing", "dropout"): "a sample of a sensor was lost; the reading kept its last value",
}
"""Meaning of each failure, by its cause (action, physics or sensing) and its kind."""


class Failures:
    """Counts of failures in a recording by kind, sensor and actuator, with row and environment of the first ones."""

    def __init__(self, sim: Stepper):
        bounds = np.asarray(sim.model.actuator_ctrlrange).reshape(-1, 2)
        self._low, self._high = bounds[:, 0].copy(), bounds[:, 1].copy()
        if sim.actuators is not None:
            drives = [sim.actuators.drive_of(name or f"#{index}") for index, name in enumerate(sim.model.actuator_names)]
            servos = [index for index, drive in enumerate(drives) if drive is not None and drive.servo is not None]
            # The control of a servo is not limited to ctrlrange.
            self._low[servos], self._high[servos] = -np.inf, np.inf
        sensors = [sensor["name"] or f"#{index}" for index, sensor in enumerate(sim.model.sensors)]
        actuators = [name or f"#{index}" for index, name in enumerate(sim.model.actuator_names)]
        self._each = {
            ("sensing", "saturation"): ("readings", sensors, np.zeros(len(sensors), dtype=np.int64)),
            ("sensing", "dropout"): ("readings", sensors, np.zeros(len(sensors), dtype=np.int64)),
            ("action", "saturated"): ("steps", actuators, np.zeros(len(actuators), dtype=np.int64)),
        }
        self._count = dict.fromkeys(CAUSES, 0)
        self._first: dict[tuple[str, str], list[tuple[int, int]]] = {cause: [] for cause in CAUSES}

    def count(
        self, row: int, fields: dict[str, np.ndarray[Any, Any]], faults: np.ndarray[Any, Any], saturation: np.ndarray[Any, Any]
    ) -> None:
        """Counts the failures in one recorded call of `step`.

        Args:
            row: Index of the call among all recorded events (rows).
            fields: Recorded arrays of the call, by the names in `stepper.recording.format.FIELDS`.
            faults: Number of clipped and number of lost samples of each sensor, (num_envs, nsensor, 2), from `Stepper.sensor_faults`.
            saturation: Number of steps of the call in which each actuator saturated, (num_envs, nu), from `Stepper.actuator_saturation`.
        """
        ctrl = fields["ctrl"]
        faults, saturation = faults.reshape(len(ctrl), -1, 2), saturation.reshape(len(ctrl), -1)
        counted = {
            ("sensing", "saturation"): faults[:, :, 0],
            ("sensing", "dropout"): faults[:, :, 1],
            ("action", "saturated"): saturation,
        }
        for cause, counts in counted.items():
            self._each[cause][2][:] += counts.sum(axis=0, dtype=np.int64)
        status = np.atleast_1d(fields["status"])
        bad = ~np.all(np.isfinite(ctrl), axis=1)
        outside = np.any((ctrl < self._low) | (ctrl > self._high), axis=1) & ~bad

        def has(flag: Status) -> np.ndarray[Any, Any]:
            return (status & flag.value).astype(bool)

        found = {
            ("action", "non-finite"): bad,
            ("action", "clipped"): outside,
            ("physics", "non-finite"): has(Status.NON_FINITE) & ~bad,
            ("physics", "residual"): has(Status.NOT_CONVERGED),
            ("physics", "contacts full"): has(Status.CONTACTS_FULL),
            ("physics", "unresolved"): has(Status.UNRESOLVED),
            ("physics", "tunnelled"): has(Status.TUNNELLED),
            ("physics", "infeasible"): has(Status.INFEASIBLE),
            ("physics", "deep"): has(Status.DEEP),
            ("physics", "over limit"): has(Status.OVER_LIMIT),
            ("physics", "equality violated"): has(Status.EQUALITY_VIOLATED),
            ("physics", "inaccurate"): has(Status.INACCURATE),
            **{cause: np.any(counts, axis=1) for cause, counts in counted.items()},
        }
        for cause, where in found.items():
            environments = np.flatnonzero(where)
            self._count[cause] += len(environments)
            free = KEPT - len(self._first[cause])
            self._first[cause] += [(row, int(env)) for env in environments[:free]]

    def summary(self) -> list[dict[str, Any]]:
        """All failures that occurred, one dictionary per kind.

        Keys are "cause", "what" (the kind), "meaning", "count" and "first". The count is over all calls of `step` and all environments.
        The first failures are pairs: index of the call among all recorded events, and index of the environment. Failures of sensing also
        have "readings", the number of failed readings of each sensor. The failure "saturated" of actuators has "steps", the number of
        saturated steps of each actuator.
        """
        found = [
            {"cause": cause, "what": what, "meaning": CAUSES[cause, what], "count": count, "first": self._first[cause, what]}
            for (cause, what), count in self._count.items()
            if count
        ]
        for entry in found:
            if (counted := self._each.get((str(entry["cause"]), str(entry["what"])))) is not None:
                word, names, counts = counted
                entry[word] = {name: int(count) for name, count in zip(names, counts, strict=True) if count}
        return found
