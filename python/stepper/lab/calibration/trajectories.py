"""Calibration on measured trajectories of a real system: the smallest set of parameters whose fit predicts as well as a fit of all.

Each episode of the study is a measured trajectory, and the outcome is the error of its prediction. Sets are chosen on the first
trajectories and checked on the others.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from stepper.lab.calibration.fit import Fit, bootstrap, fit
from stepper.lab.calibration.search import Array, smallest_set
from stepper.lab.study.batches import USUAL, point_at, run_points
from stepper.lab.study.document import Document, Section
from stepper.lab.study.intervals import least_share
from stepper.lab.study.journal import Results
from stepper.lab.study.ranking import varied
from stepper.lab.study.report import study_of
from stepper.lab.study.study import Study
from stepper.lab.study.sweep import measured
from stepper.shared.arguments import check_number, check_whole
from stepper.shared.progress import ProgressCallback

_SAMPLES, _ROUNDS = 32, 12
"""Number of samples per round of a fit, and number of rounds."""


@dataclass(frozen=True)
class FittedSet:
    """Set of parameters that were fitted together; all others are nominal.

    Attributes:
        names: Names of the fitted parameters.
        fit: Fitted values, in the order of `names`.
        errors: Error of each trajectory, (trajectories,), in the unit of the outcome: fitted ones first, then those held out.
    """

    names: tuple[str, ...]
    fit: Fit
    errors: Array


@dataclass(frozen=True)
class TrajectoryCalibration:
    """Result of `calibrate_on_trajectories`.

    Attributes:
        study: The study.
        fitted: Number of trajectories that were fitted.
        margin: Largest increase of the error, in the unit of the outcome.
        every: Fit of all parameters.
        chosen: Fit of the smallest set.
        others: Fits of further sets that were tried.
        document: The report.
        files: Files that were written.
    """

    study: Study
    fitted: int
    margin: float
    every: FittedSet
    chosen: FittedSet
    others: tuple[FittedSet, ...]
    document: Document
    files: tuple[Path, ...]

    @property
    def violations(self) -> int:
        """Number of held-out trajectories whose error with the smallest set exceeds that with all parameters by more than the margin."""
        return self._violations_of(self.chosen)

    @property
    def share(self) -> float:
        """Fraction of such trajectories for which the margin holds, with 95 % confidence: 0.05^(1/n) for n held out without a violation."""
        held_out = len(self.every.errors) - self.fitted
        return least_share(held_out - self.violations, held_out)

    def _violations_of(self, own: FittedSet) -> int:
        return int((own.errors[self.fitted :] - self.every.errors[self.fitted :] > self.margin).sum())


def calibrate_on_trajectories(
    study: Study | str | os.PathLike[str],
    out: str | os.PathLike[str] = "out",
    *,
    fitted: int,
    margin: float,
    parameters: Sequence[str] | None = None,
    setting: str = USUAL,
    progress: ProgressCallback | None = None,
) -> TrajectoryCalibration:
    """Finds the smallest set of parameters whose fit predicts trajectories as well as a fit of all parameters, to within a margin.

    A set passes if its mean error of the fitted trajectories exceeds that of the fit of all parameters by at most the margin. The other
    trajectories are run once, at the end. With n of them, all within the margin, the claim is: the margin holds for at least a fraction
    0.05^(1/n) of such trajectories, with 95 % confidence.

    Args:
        study: A study whose episodes are measured trajectories and whose main outcome is the error of a prediction, or its file.
        out: Output folder. The files are in OUT/NAME, a subfolder with the name of the study.
        fitted: Number of trajectories that are fitted, the first episodes of the study.
        margin: Largest increase of the error, in the unit of the outcome.
        parameters: Names, or selectors with a range; None selects all parameters with low and high.
        setting: Name of the settings.
        progress: Progress callback with a text and the fraction done.

    Returns:
        The result. OUT/NAME has trajectories.html and trajectories.md.

    Raises:
        ValueError: The study has no outcome or parameter with a range, or no trajectory is left to check, or the margin is not above 0.
    """
    study = study_of(study)
    check_number("margin", margin, above=0.0)
    check_whole("fitted", fitted, least=1)
    if fitted >= study.episodes:
        raise ValueError(
            f"fitted is {fitted}, must be below the study's episodes, {study.episodes}, so that trajectories are left to check"
        )
    study, names = varied(study, parameters, setting, 1)
    ends = np.array([[study.parameters[name].low, study.parameters[name].high] for name in names], float)
    sets: dict[frozenset[int], FittedSet] = {}
    with Results(study, out) as results:

        def errors(chosen: Sequence[int], samples: Array, count: int = fitted) -> Array:
            """Errors of the first trajectories, (samples, count); infinite if the episode diverged."""
            some, own = replace(study, episodes=count), [names[k] for k in chosen]
            points = [point_at(some, dict(zip(own, row.tolist(), strict=True)), setting) for row in samples]
            rows = run_points(some, points, results.journal)
            found = np.array([row["outcomes"][measured(some)] for row in rows], float).reshape(len(points), count)
            return np.where(np.isfinite(found), found, np.inf)

        def fitted_set(chosen: set[int]) -> FittedSet:
            """Fit of a set of parameters. The held-out trajectories are not run."""
            if (key := frozenset(chosen)) not in sets:
                own = sorted(chosen)
                search = partial(fit, samples=_SAMPLES, elite=_SAMPLES // 3, rounds=_ROUNDS, seed=study.seed)
                nothing = Fit(np.zeros(0), np.zeros(0), np.nan, 0)
                found = search(lambda samples: errors(own, samples).mean(axis=1), *ends[own].T) if own else nothing
                sets[key] = FittedSet(tuple(names[k] for k in own), found, errors(own, found.values[None])[0])
            if progress:
                progress(f"calibrate {study.name}", min(0.99, len(sets) / (2.0 * len(names) + 2.0)))
            return sets[key]

        every = set(range(len(names)))

        def excess(chosen: set[int]) -> float:
            return float(np.mean(fitted_set(chosen).errors - fitted_set(every).errors))

        best = smallest_set(lambda chosen: excess(chosen) <= margin, np.array([excess(every - {k}) for k in every]))
        whole = {}
        for key, own in sets.items():
            whole[key] = replace(own, errors=errors(sorted(key), own.fit.values[None], study.episodes)[0])
        chosen = whole.pop(frozenset(best))
        everything = whole.pop(frozenset(every), chosen)
        others = tuple(sorted(whole.values(), key=lambda own: (-len(own.names), own.names)))
        found = TrajectoryCalibration(study, fitted, margin, everything, chosen, others, Document(""), ())
        document = Document(f"Calibration of {study.name} on measured trajectories", [_answer(found), _sets(found)])
        files = tuple(document.save(results.folder, "trajectories"))
    return replace(found, document=document, files=files)


def _answer(found: TrajectoryCalibration) -> Section:
    """Section with the smallest set, its fitted values and the claim."""
    held_out, margin = len(found.every.errors) - found.fitted, f"{found.margin:g} {found.study.all_outcomes[0].unit}".strip()
    words = [
        f"To fit: {', '.join(found.chosen.names) or 'nothing'}. The other parameters may keep nominal values.",
        f"Chosen on {found.fitted} trajectories, checked on {held_out}, by {measured(found.study)}. Margin: {margin} above the "
        "error with all parameters fitted.",
        f"{found.violations} of {held_out} held-out trajectories exceed the margin. So it holds for at least {found.share:.1%} of such "
        "trajectories, with 95 % confidence. Nothing is claimed about trajectories of another kind.",
    ]
    rows = []
    for label, own in (("smallest set", found.chosen), ("all parameters", found.every)):
        for k, name in enumerate(own.names):
            parameter = found.study.parameters[name]
            rows.append([label, name, float(own.fit.values[k]), float(own.fit.spread[k]), parameter.unit, parameter.source])
    return Section("Answer", words, ("fit", "parameter", "value", "spread", "unit", "source of the range"), rows)


def _sets(found: TrajectoryCalibration) -> Section:
    """Section with the errors of all sets that were tried."""
    rows = []
    for own in (found.every, found.chosen, *found.others):
        held_out = own.errors[found.fitted :]
        interval = "{:.4g} to {:.4g}".format(*bootstrap(held_out)) if np.isfinite(held_out).all() else "-"
        rows.append([
            ", ".join(own.names) or "nothing",
            float(own.errors[: found.fitted].mean()),
            float(held_out.mean()),
            interval,
            f"{found._violations_of(own)} of {len(held_out)}",
        ])  # fmt: skip
    head = ("fitted", "mean error, fitted trajectories", "mean error, held out", "95 %, bootstrap", "held out above the margin")
    return Section("Sets that were tried", ["The first row has all parameters, the second the smallest set."], head, rows)
