"""Tuning (`stepper.lab.tune`): the cheapest settings within an error budget, tested on held-out episodes; unused pairs of bodies."""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper._options import Options
from stepper._stepper import Model
from stepper.lab.accuracy.candidates import hard_lines, timesteps
from stepper.lab.accuracy.costs import costs
from stepper.lab.accuracy.needs import UnusedPairs, unused_pairs
from stepper.lab.accuracy.reference import Reference, check_moves, converge, patience, with_trajectories
from stepper.lab.accuracy.traces import Distance, Trace, quantity, run, runs
from stepper.lab.study.batches import steps_of
from stepper.lab.study.document import Document, Section, check_pages, counted
from stepper.lab.study.intervals import least_share, trials_for
from stepper.lab.study.study import Study
from stepper.shared.arguments import check_fraction, check_whole, path_of
from stepper.shared.files import locked, write_text
from stepper.shared.machine import one_core, provenance
from stepper.shared.progress import ProgressCallback

Array = NDArray[np.float64]
_REFERENCE_SHARE = 0.1
"""Target uncertainty of the reference, as a fraction of the error budget."""
_RETRY_RATIO = 0.8
"""Largest ratio of errors for a further test: error of a candidate divided by the error of the candidate that failed before.

Tests are on held-out episodes. A candidate with a similar error would fail, too.
"""

_BISECTIONS = 3
"""Number of rounds of bisection between the longest time step within the error budget and the next longer one."""
_RETIMED_RATIO = 1.25
"""Largest ratio of costs for a second timing: cost of a candidate divided by the lowest cost of all candidates within the budget."""
OWN = "the study's own"
"""Name that `tune` gives to the settings of the study in the list of candidate settings."""
_HELD_OUT_BATCH = 16
"""Number of held-out episodes in one batch."""
_CONFIDENCE = 0.95
"""Confidence of the bounds of all trials together."""


@dataclass(eq=False)
class Candidate:
    """Candidate settings, with their error and cost.

    Attributes:
        settings: Settings by name that differ from the study's, with the time step.
        name: Name of the settings.
        error: Largest error of the training episodes plus the reference's uncertainty, m or rad. Infinite if an episode diverged or the
            run was stopped because it took far longer than the reference.
        us_single_env: Microseconds of one core for a simulated second of one environment, stepped alone; NaN if it was not measured.
            Settings whose error exceeds the budget are not measured, except for the study's settings.
        batch: Microseconds of one core for a simulated second of one environment, stepped in a batch; NaN if it was not measured.
        stopped: Whether the run was stopped.
    """

    settings: dict[str, Any]
    name: str
    error: float
    us_single_env: float = math.nan
    batch: float = math.nan
    stopped: bool = False


@dataclass(frozen=True)
class Trial:
    """Test of a candidate on held-out episodes, which were not used to choose it.

    Attributes:
        candidate: The candidate.
        episodes: Number of distinct held-out episodes; duplicates are not counted.
        held: Number of these episodes that passed: their error plus the reference's uncertainty is within the budget.
        unknown: Number of episodes whose reference is uncertain by more than half the budget; they count as failures.
        worst: Largest error, m or rad.
        share: Lower bound of the fraction of episodes that are within the budget, among all possible episodes.
        confidence: Confidence of that bound: 1 - 0.05 / 2^k in trial k, so that all bounds together have the confidence 95 %.
    """

    candidate: Candidate
    episodes: int
    held: int
    unknown: int
    worst: float
    share: float
    confidence: float


@dataclass(frozen=True)
class Tuning:
    """Result of `tune`.

    Attributes:
        study: The study.
        budget: Allowed error, m or rad.
        distance: Definition of errors: unit and horizon.
        chosen: The cheapest settings that passed the test on held-out episodes; None if there are none.
        options: Options for `stepper.Stepper` with the chosen settings; None without chosen settings.
        precision: Precision of the chosen settings; None without chosen settings.
        usual: Candidate with the study's settings.
        candidates: All candidates, those within the budget first, by cost.
        trials: Tests of candidates on held-out episodes, in order.
        unused: Pairs of bodies that never came near each other; None if there are none, or if they were not searched.
        smaller: Model that excludes these pairs from contact; None if that changes the motion by more than the budget, or saves nothing.
        document: The tuning as a document.
        files: Files that were written.
    """

    study: Study
    budget: float
    distance: Distance
    chosen: Candidate | None
    options: Options | None
    precision: str | None
    usual: Candidate
    candidates: tuple[Candidate, ...]
    trials: tuple[Trial, ...]
    unused: UnusedPairs | None
    smaller: Model | None
    document: Document
    files: tuple[Path, ...]

    def __str__(self) -> str:
        return self.document.markdown()


def tune(
    source: Any,
    out: str | os.PathLike[str] = "out",
    *,
    error: str,
    horizon: str | float,
    coverage: float = 0.9,
    episodes: int = 12,
    alone: bool = False,
    reduce: bool = True,
    progress: ProgressCallback | None = None,
) -> Tuning:
    """Finds the cheapest settings of hard contact within an error budget, and pairs of bodies that need no contact.

    Settings are chosen on some episodes and tested on others (held out). With 95 % confidence, at least the fraction `coverage` of
    episodes is within the budget. Errors are those of time step, solver and precision. They are measured relative to a
    reference with the same contact law that is converged to a tenth of the budget.

    Args:
        source: A study or its file; or a model, as for `stepper.load`, which gets random controls.
        out: Output folder. The files are in OUT/NAME, a subfolder with the name of the study.
        error: Error budget with its unit: "1 mm", "0.5 deg".
        horizon: Simulated time up to which the error must stay within the budget: "1 s", "500 ms", or a number of seconds.
        coverage: Fraction of episodes that must stay within the budget.
        episodes: Number of episodes on which settings are chosen.
        alone: Whether to minimise the cost of a single environment instead of a batch.
        reduce: Whether to search for pairs of bodies that never come near each other.
        progress: Progress callback with a text and the fraction done.

    Returns:
        The tuning. OUT/NAME has tune.html, tune.md, tune.json, and smaller.stepper if pairs were excluded.

    Raises:
        ValueError: A budget or horizon is invalid, the model has no joints, the study has MuJoCo's contact law, or it has too few distinct
            episodes for a test.
        BlockingIOError: Another run writes to OUT/NAME.
    """
    budget, unit = quantity(error, name="error", units=("m", "rad"))
    seconds, _ = quantity(horizon, name="horizon", units=("s",))
    check_fraction("coverage", coverage)
    check_whole("episodes", episodes, least=1)
    check_pages()
    study = Study.from_model(source)
    if study.options.contact != "hard":
        raise ValueError('the study has contact="mujoco", and tuning chooses settings of hard contact: give it contact="hard"')
    study = replace(
        check_moves(study),
        threads=1,
        seconds=max(study.control_period, math.ceil(round(seconds / study.control_period, 9)) * study.control_period),
    )
    report_progress: ProgressCallback = progress or (lambda _what, _done: None)
    distance = Distance(unit, seconds)
    enough = trials_for(coverage, 1 - (1 - _CONFIDENCE) / 2)
    if (count := len(_distinct(study, range(episodes, episodes + enough), {}))) < enough:
        raise ValueError(
            f"{study.name}: {count} of {enough} held-out episodes are distinct, and a coverage of {coverage} needs all of them; give it "
            "qpos_noise, qvel_noise, a random start or controller, or more recorded episodes, or lower the coverage"
        )
    with locked(path_of("out", out) / study.name) as folder:
        reference = converge(
            study, range(episodes), distance, target=_REFERENCE_SHARE * budget, progress=lambda done: report_progress("reference", done)
        )
        reference = with_trajectories(study, range(episodes), reference, distance)
        usual, candidates = _candidates(study, range(episodes), distance, reference, budget, alone=alone, report_progress=report_progress)
        candidates.sort(key=lambda own: (not own.error <= budget, getattr(own, _cost(alone))))
        trials: list[Trial] = []
        chosen = None
        first = episodes
        bound = budget
        exhausted = False
        for candidate in candidates:
            if not candidate.error <= bound:
                continue
            doubt = (1 - _CONFIDENCE) / 2.0 ** (len(trials) + 1)
            count = trials_for(coverage, 1 - doubt)
            held_out = _distinct(study, range(first, first + count), candidate.settings)
            if len(held_out) < count:
                exhausted = True
                break
            trials.append(_trial(study, candidate, held_out, distance, budget, confidence=1 - doubt))
            first += count
            report_progress("held-out episodes", len(trials) / (len(trials) + 1))
            if trials[-1].share >= coverage:
                chosen = candidate
                break
            # Candidates with a similar error would fail on held-out episodes too.
            bound = _RETRY_RATIO * candidate.error
        report_progress("held-out episodes", 1.0)
        # Pairs are searched with settings that do not diverge.
        seen = chosen or (usual if math.isfinite(usual.error) else min(candidates, key=lambda own: own.error))
        searches = reduce and math.isfinite(seen.error)
        unused, smaller = unused_pairs(study, range(episodes), seen.settings, distance, budget) if searches else (None, None)
        report_progress("unused pairs", 1.0)
        options, precision = _options(study, chosen)
        document = Document(f"Tuning of {study.name}")
        searched = (tuple(candidates), tuple(trials), unused)
        found = Tuning(*(study, budget, distance, chosen, options, precision, usual, *searched, smaller, document, ()))
        document.sections += _sections(found, reference, coverage=coverage, alone=alone, exhausted=exhausted)
        return replace(found, files=tuple(_save(found, folder)))


def _cost(alone: bool) -> str:
    """Name of the attribute of `Candidate` with the cost to minimise: that of a single environment, or that in a batch."""
    return "us_single_env" if alone else "batch"


def _lines(study: Study) -> list[tuple[str, dict[str, Any]]]:
    """Candidate settings as pairs of a name and changed settings, without duplicates.

    First come the study's settings in both precisions, then the settings of a chart for hard contact.
    """
    other = "f32" if study.precision == "f64" else "f64"
    named: list[tuple[str, dict[str, Any]]] = [(OWN, {}), (f"{OWN}, {other}", {"precision": other})]
    # Settings of a chart without a precision have 64 bits, whatever the precision of the study.
    named += [(line.name, {"precision": "f64"} | line.settings) for line in hard_lines()]
    kept: dict[str, tuple[str, dict[str, Any]]] = {}
    for name, given in named:
        rest = {key: value for key, value in given.items() if key != "precision"}
        options = asdict(replace(study.options, **rest))
        resolved = options | {"integrator": options["integrator"] or "midpoint", "precision": given.get("precision", study.precision)}
        kept.setdefault(json.dumps(resolved, sort_keys=True, default=str), (name, given))
    return list(kept.values())


def _candidates(
    study: Study,
    episodes: Sequence[int],
    distance: Distance,
    reference: Reference,
    budget: float,
    *,
    alone: bool,
    report_progress: ProgressCallback,
) -> tuple[Candidate, list[Candidate]]:
    """Finds and measures candidate settings, and returns the candidate with the study's settings, and all candidates including it.

    First, all settings are run at the time step of the study, and at longer and shorter ones by factors of two. Some settings
    may become the cheapest at longer time steps. They also run between the longest time step within the budget and the next longer one.
    """
    timestep = study.options.timestep or float(study.loaded[0].timestep)
    own = steps_of(study, timestep)
    counts = sorted({own, *(steps_of(study, dt) for dt in timesteps(study, coarser=4, finer=4))})
    lines = _lines(study)
    traces: dict[int, Trace] = {}

    def ran(chosen: Sequence[tuple[str, dict[str, Any], int]], done: tuple[float, float]) -> list[Candidate]:
        """Candidates from names, changed settings and numbers of time steps per control period, after their runs."""
        # The study's time step keeps its exact value; others are the control period divided by a whole number.
        settings = [line | {"timestep": timestep if steps == own else study.control_period / steps} for _, line, steps in chosen]
        patient = [patience(study, reference.trace, own["timestep"]) for own in settings]
        made = runs(
            study, episodes, settings, patient, progress=lambda part: report_progress("candidates", done[0] + (done[1] - done[0]) * part)
        )
        candidates = []
        for (name, *_), given, trace in zip(chosen, settings, made, strict=True):
            error = (
                math.inf if trace.stopped else float((distance(trace, reference.ground_truth) + reference.ground_truth_uncertainty).max())
            )
            candidates.append(Candidate(given, name, error, stopped=trace.stopped))
            traces[id(candidates[-1])] = trace
        return candidates

    def time(some: Sequence[Candidate], repeats: int, done: tuple[float, float]) -> None:
        with one_core():
            spent = costs(
                study,
                [one.settings for one in some],
                [traces[id(one)] for one in some],
                repeats=repeats,
                seconds=0.004,
                progress=lambda part: report_progress("costs", done[0] + (done[1] - done[0]) * part),
            )
        for one, cost in zip(some, spent, strict=True):
            one.us_single_env, one.batch = cost

    def steps(one: Candidate) -> int:
        return steps_of(study, one.settings["timestep"])

    def cost(one: Candidate) -> float:
        return float(getattr(one, _cost(alone)))

    found = ran([(name, line, count) for name, line in lines for count in counts], (0.0, 0.8))
    usual = next(one for one in found if one.name == OWN and steps(one) == own)
    # Settings within the budget are timed, and the study's settings unless they diverge.
    keep = [one for one in found if one.error <= budget]
    first = [usual] if math.isfinite(usual.error) else []
    time([*first, *(one for one in keep if one is not usual)], 3, (0.0, 0.5))
    between: list[Candidate] = []
    for _ in range(_BISECTIONS if keep else 0):
        best = min(cost(one) for one in keep if one not in between)
        chosen = []
        for name, line in lines:
            of_line = [one for one in found if one.name == name]
            longest = min((steps(one) for one in of_line if one.error <= budget), default=None)
            if longest is None:
                continue
            failed = max((steps(one) for one in of_line if steps(one) < longest), default=longest)
            middle = (failed + longest) // 2
            timed = min((one for one in of_line if math.isfinite(cost(one))), key=steps)
            # The bound assumes that a longer step costs at least as much.
            if failed < middle < longest and cost(timed) * (failed + 1) / steps(timed) < best:
                chosen.append((name, line, middle))
        made = ran(chosen, (0.8, 1.0))
        found += made
        between += [one for one in made if one.error <= budget]
        keep += [one for one in made if one.error <= budget]
        if not chosen:
            break
    report_progress("candidates", 1.0)
    if keep:
        near = _RETIMED_RATIO * min(cost(one) for one in keep if math.isfinite(cost(one)))
        # The second timing alternates between the candidates, so that changes of the machine's load do not decide their order.
        time([*first, *between, *(one for one in keep if one is not usual and cost(one) <= near)], 7, (0.5, 1.0))
    report_progress("costs", 1.0)
    return usual, found


def _distinct(study: Study, episodes: range, settings: Mapping[str, Any]) -> list[int]:
    """Numbers of the episodes in a range that are no duplicates: motion or controls differ from those of every earlier episode.

    Earlier episodes are all episodes from 0, also those before the range.
    """
    trace = run(study, range(episodes.stop), **settings)
    seen: set[bytes] = set()
    found = []
    for e in range(episodes.stop):
        own = (trace.qpos[e], trace.qvel[e], trace.ctrl[:, e], trace.applied[:, e], trace.points[:, e], trace.xquat[:, e])
        digest = hashlib.sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in own)).digest()
        if digest not in seen and e >= episodes.start:
            found.append(e)
        seen.add(digest)
    return found


def _trial(study: Study, candidate: Candidate, episodes: Sequence[int], distance: Distance, budget: float, *, confidence: float) -> Trial:
    """Tests a candidate on held-out episodes."""
    parts = [
        _held_out(candidate, distance, budget, study, episodes[k : k + _HELD_OUT_BATCH]) for k in range(0, len(episodes), _HELD_OUT_BATCH)
    ]
    apart, unsure = (np.concatenate(own) for own in zip(*parts, strict=True))
    unknown = unsure > 0.5 * budget
    held = int(np.count_nonzero((apart + unsure <= budget) & ~unknown))
    share = least_share(held, len(episodes), confidence)
    return Trial(candidate, len(episodes), held, int(unknown.sum()), float(apart.max()), share, confidence)


def _held_out(candidate: Candidate, distance: Distance, budget: float, study: Study, episodes: Sequence[int]) -> tuple[Array, Array]:
    """Errors of a candidate in held-out episodes, and the uncertainty of their reference, (episodes,) each, m or rad.

    All errors are infinite if the run was stopped.
    """
    reference = with_trajectories(study, episodes, converge(study, episodes, distance, target=_REFERENCE_SHARE * budget), distance)
    patient = patience(study, reference.trace, candidate.settings["timestep"])
    trace = run(study, episodes, patience=patient, **candidate.settings)
    return np.full(len(episodes), np.inf) if trace.stopped else distance(trace, reference.ground_truth), reference.ground_truth_uncertainty


def _options(study: Study, chosen: Candidate | None) -> tuple[Options | None, str | None]:
    """Options of the step and precision of a candidate. Both are None if there is no candidate."""
    if chosen is None:
        return None, None
    given = dict(chosen.settings)
    precision = given.pop("precision", study.precision)
    return replace(study.options, **given), precision


def words_of(options: Options, precision: str | None) -> str:
    """Python expression that creates `options`, without arguments that have default values.

    If the precision is not "f64", the argument `precision` of `Stepper` follows after a comma.
    """
    usual = Options()
    own = {f.name: getattr(options, f.name) for f in fields(Options) if getattr(options, f.name) != getattr(usual, f.name)}
    arguments = ", ".join(f"{name}={value!r}" for name, value in own.items())
    return f"stepper.Options({arguments})" + ("" if precision == "f64" else f', precision="{precision}"')


def _sections(found: Tuning, reference: Reference, *, coverage: float, alone: bool, exhausted: bool) -> list[Section]:
    """Sections of the report of `tune`."""
    unit, cost = found.distance.unit, _cost(alone)
    words = [f"Budget: {found.budget:g} {unit} up to {found.distance.horizon:g} s. Reference: {reference.words}."]
    if found.chosen is not None and found.options is not None:
        trial = found.trials[-1]
        words += [
            f"`{words_of(found.options, found.precision)}`",
            f"It takes {getattr(found.chosen, cost):.4g} us of one core for a simulated second of one environment. "
            f"{_compared(found, cost)}",
            f"{trial.held} of {trial.episodes} held-out episodes are within the budget: with {trial.confidence:.1%} confidence at least "
            f"{trial.share:.1%} of episodes are (required: {coverage:.0%}, with {_CONFIDENCE:.0%} over all trials). The largest "
            f"error is {trial.worst:.2g} {unit}.",
        ]
    else:
        best = min(found.candidates, key=lambda own: own.error)
        words.append(
            f"No settings are proved to keep the budget. The least error is {best.error:.2g} {unit}, of {best.name} at "
            f"{1e3 * best.settings['timestep']:g} ms, and includes the uncertainty of the reference, "
            f"{reference.ground_truth_uncertainty.max():.2g} {unit}. "
            f"The reference is accurate to {reference.target:.2g} {unit} up to {reference.known.min():.3g} s in all episodes, and up to "
            f"{np.median(reference.known):.3g} s in half of them: give a shorter horizon, or a larger error."
            f" {_usual_error(found.usual, unit)}"
        )
    if exhausted:
        words.append(
            "The study has too few distinct episodes to test the next candidate: give it qpos_noise, qvel_noise, a random start or "
            "controller, or more recorded episodes."
        )
    trials = [
        [t.candidate.name, 1e3 * t.candidate.settings["timestep"], t.held, t.episodes, t.unknown, t.worst, t.share, t.confidence]
        for t in found.trials
    ]
    heads = ("settings", "time step, ms", "within", "episodes", "uncertain", f"largest error, {unit}", "share at least", "confidence")
    kept = [own for own in found.candidates if own.error <= found.budget]
    stopped = sum(own.stopped for own in found.candidates)
    rows = [[own.name, 1e3 * own.settings["timestep"], own.error, own.us_single_env, own.batch] for own in kept[:20]]
    return [
        Section("Result", words),
        Section(
            "Proof",
            ["Held-out episodes, on which the settings were not chosen; each trial has new ones."] if trials else ["No candidate to test."],
            heads,
            trials,
        ),
        Section(
            "Candidates within the budget",
            [
                f"{len(kept)} of {len(found.candidates)}, the cheapest first; errors are the largest in the training episodes."
                + (f" {counted(stopped, 'run')} took far longer than the reference and had to be stopped." if stopped else "")
            ],
            ("settings", "time step, ms", f"error, {unit}", "alone, us", "batch, us"),
            rows,
        ),
        _unused_section(found),
    ]


def _unused_section(found: Tuning) -> Section:
    """Section of the report with the pairs of bodies that never came near each other, and the effect of their exclusion."""
    title, unused = "Unused pairs of bodies", found.unused
    if unused is None:
        return Section(title, ["None: the search was off, or all pairs come near each other."])
    stay = f"They stay, because that {'saves nothing' if unused.error <= found.budget else 'changes too much'}."
    words = (
        f"{unused.count} of {unused.of} pairs of bodies that may collide never came near enough to touch within a step, in the training "
        f"episodes. Their exclusion changes the motion by at most {unused.error:.2g} {found.distance.unit} and saves {unused.saved:.0%} of "
        f"the time, at least {unused.min_saved:.0%} in seven of eight rounds. "
        f"{stay if found.smaller is None else 'smaller.stepper excludes them.'}"
    )
    return Section(title, [words])


def _compared(found: Tuning, cost: str) -> str:
    """Sentence that compares the chosen settings with the study's settings: the ratio of their costs, and the error of the latter."""
    assert found.chosen is not None
    usual = found.usual
    if found.chosen is usual:
        return "These are the study's own settings."
    if not math.isfinite(usual.error):
        return _usual_error(usual, found.distance.unit)
    spent = getattr(usual, cost)
    times = spent / getattr(found.chosen, cost)
    error = f"{usual.error:.2g} {found.distance.unit}"
    return f"The study's own settings take {spent:.4g} us, {times:.2f} times as much; their error is {error}."


def _usual_error(usual: Candidate, unit: str) -> str:
    """Sentence on the error of the study's own settings, or on the reason why it is not known."""
    if usual.stopped:
        return "With the study's own settings, episodes were stopped: they took far longer than the reference, as diverging motions do."
    if not math.isfinite(usual.error):
        return "With the study's own settings, an episode diverges."
    return f"The study's own settings have an error of {usual.error:.2g} {unit}."


def _save(found: Tuning, folder: Path) -> list[Path]:
    """Writes the report, tune.json and the smaller model to a folder, and returns the paths of the files."""
    files = found.document.save(folder, "tune")
    contents = {
        "budget": found.budget,
        "unit": found.distance.unit,
        "horizon": found.distance.horizon,
        "settings": found.chosen.settings if found.chosen else None,
        "usual": vars(found.usual),
        "candidates": [vars(own) for own in found.candidates],
        "trials": [vars(own) | {"candidate": vars(own.candidate)} for own in found.trials],
        "resolved_settings": found.study.resolved_settings(),
        "provenance": provenance(),
    }
    files.append(write_text(folder / "tune.json", json.dumps(_plain(contents), indent=2, default=str, allow_nan=False) + "\n"))
    if found.smaller is not None:
        files.append(folder / "smaller.stepper")
        found.smaller.save(files[-1])
    return files


def _plain(value: Any) -> Any:
    """Copy of nested data with None for numbers that are not finite, which JSON cannot represent."""
    if isinstance(value, dict):
        return {name: _plain(own) for name, own in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(own) for own in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
