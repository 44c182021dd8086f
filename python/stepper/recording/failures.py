"""Causes of failed episodes: the status of the steps, attributed to physics, sensing or action."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from stepper._status import Status

if TYPE_CHECKING:
    from stepper._stepper import Stepper

KEPT = 1000
"""Failures of each cause that are kept one by one; all are counted."""

CAUSES = {
    ("action", "non-finite"): "a control is NaN or infinite; the environment kept its state",
    ("action", "clipped"): "a control lies outside its range and was clipped",
    ("action", "saturated"): "the effort of an actuator was cut to its bounds",
    ("physics", "non-finite"): "the step was not finite though its controls were; the environment kept its state",
    ("physics", "residual"): "the residual is above the tolerance",
    ("physics", "contacts full"): "there were more contacts than room",
    ("physics", "unresolved"): "the time step was too long for the motion",
    ("physics", "tunnelled"): "something moved so fast that it may have passed through something thin",
    ("physics", "infeasible"): "what constraints demand cannot be met, and impulses prove it",
    ("physics", "deep"): "geoms overlap by more than 1 mm",
    ("physics", "over limit"): "a joint or tendon is beyond its range by more than 0.01 rad or m",
    ("physics", "equality violated"): "the position error of an equality is above 1 mm or 1 mrad",
    ("sensing", "saturation"): "a reading was clipped to the limits of its sensor",
    ("sensing", "dropout"): "a sample of a sensor was lost, and the one before stayed held",
}
"""Whose fault, and what happened."""


class Failures:
    """Counts of failures by cause, sensor and actuator, with the places of the first ones."""

    def __init__(self, sim: Stepper):
        bounds = np.asarray(sim.model.actuator_ctrlrange).reshape(-1, 2)
        self._low, self._high = bounds[:, 0].copy(), bounds[:, 1].copy()
        if sim.actuators is not None:
            drives = [sim.actuators.drive_of(name or f"#{index}") for index, name in enumerate(sim.model.actuator_names)]
            servos = [index for index, drive in enumerate(drives) if drive is not None and drive.servo is not None]
            # A set point of a servo has no range.
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

    def look(
        self, row: int, fields: dict[str, np.ndarray[Any, Any]], faults: np.ndarray[Any, Any], saturation: np.ndarray[Any, Any]
    ) -> None:
        """Counts the failures in one row of a recording.

        Args:
            row: Number of the row.
            fields: See `stepper.recording.format.FIELDS`.
            faults: Counts of sensor faults, (num_envs, nsensor), a number of `Stepper.sensor_faults`.
            saturation: Flags of saturated actuators, (num_envs, nu), of `Stepper.actuator_saturation`.
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

        def says(flag: Status) -> np.ndarray[Any, Any]:
            return (status & flag.value).astype(bool)

        found = {
            ("action", "non-finite"): bad,
            ("action", "clipped"): outside,
            ("physics", "non-finite"): says(Status.NON_FINITE) & ~bad,
            ("physics", "residual"): says(Status.NOT_CONVERGED),
            ("physics", "contacts full"): says(Status.CONTACTS_FULL),
            ("physics", "unresolved"): says(Status.UNRESOLVED),
            ("physics", "tunnelled"): says(Status.TUNNELLED),
            ("physics", "infeasible"): says(Status.INFEASIBLE),
            ("physics", "deep"): says(Status.DEEP),
            ("physics", "over limit"): says(Status.OVER_LIMIT),
            ("physics", "equality violated"): says(Status.EQUALITY_VIOLATED),
            **{cause: np.any(counts, axis=1) for cause, counts in counted.items()},
        }
        for cause, where in found.items():
            environments = np.flatnonzero(where)
            self._count[cause] += len(environments)
            room = KEPT - len(self._first[cause])
            self._first[cause] += [(row, int(env)) for env in environments[:room]]

    def summary(self) -> list[dict[str, Any]]:
        """All failures: cause, flag, number of calls of `step` over all environments, and the first (row, environment) pairs.

        Failures of sensing also have "readings", the number for each sensor. Saturation also has "steps", the number for each actuator.
        """
        found = [
            {"whose": whose, "what": what, "meaning": CAUSES[whose, what], "count": count, "first": self._first[whose, what]}
            for (whose, what), count in self._count.items()
            if count
        ]
        for entry in found:
            if (counted := self._each.get((str(entry["whose"]), str(entry["what"])))) is not None:
                word, names, counts = counted
                entry[word] = {name: int(count) for name, count in zip(names, counts, strict=True) if count}
        return found
