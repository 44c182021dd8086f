"""Documents of a study: `sweep`, and `report` with sensors, contacts, settings, differences between engines, and causes of failures."""

from __future__ import annotations

import dataclasses
import math
import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stepper.lab.study.batches import USUAL, nominal_of
from stepper.lab.study.document import Document, Section, cell, counted
from stepper.lab.study.draw import draw
from stepper.lab.study.failure_causes import Verdict, causes_of, rules_of
from stepper.lab.study.journal import Results, Table, diverged
from stepper.lab.study.outcomes import Outcome
from stepper.lab.study.parameters import Parameter
from stepper.lab.study.study import Study
from stepper.lab.study.sweep import CLIFF, RESOLUTION, Level, Sweep, measured, ordered_outcomes, run_sweep
from stepper.lab.study.touching import Pair, deciding, touching
from stepper.sensors import Transfer
from stepper.shared.machine import package_version
from stepper.shared.progress import ProgressCallback

LAW, PEER = "MuJoCo's law", "MuJoCo"
"""Names of the two settings that `report` adds to a study: MuJoCo's contact law in stepper, and the engine MuJoCo."""


@dataclass(frozen=True)
class Report:
    """Result of `sweep` or `report`.

    Attributes:
        study: The study, with the settings that the report added.
        sweep: Result of the sweep: statistics at each value of a parameter, values at which success ends, and table of the episodes.
        verdicts: Causes of the failures; empty for `sweep`.
        document: The report as a document.
        files: Files that were written.
    """

    study: Study
    sweep: Sweep
    verdicts: tuple[Verdict, ...]
    document: Document
    files: tuple[Path, ...]

    def __str__(self) -> str:
        return self.document.markdown()


def sweep(
    study: Study | str | os.PathLike[str],
    out: str | os.PathLike[str] = "out",
    *,
    parameters: Sequence[str] | None = None,
    cliffs: bool = True,
    resolution: float = RESOLUTION,
    progress: ProgressCallback | None = None,
) -> Report:
    """Sweeps each parameter of a study over its range, one at a time, and locates the values at which success ends (cliffs).

    Finished episodes are stored in OUT/NAME/journal.sqlite and not repeated.

    Args:
        study: A study, or its file.
        out: Output folder. The files are in OUT/NAME, a subfolder with the name of the study.
        parameters: Names, or selectors with a range, such as "geom_friction[floor][0]=0.2..1"; None selects all parameters of the study.
        cliffs: Whether to locate the values at which success ends, by bisection.
        resolution: Width of the interval to which a cliff is located, as a fraction of the parameter's range, between 0 and 1.
        progress: Progress callback with a text and the fraction done.

    Returns:
        The sweep. OUT/NAME has table.csv, table.npz, sweep.html, sweep.md, sweep.png, resolved_settings.json.

    Raises:
        ValueError: The study has no outcome, a parameter is unknown, `resolution` is out of range, or a time step does not divide the
            control period.
        JournalError: The journal is damaged, or belongs to another study.
        BlockingIOError: Another run writes to OUT/NAME.
    """
    study = study_of(study)
    with Results(study, out) as results:
        found = run_sweep(study, results.journal, parameters=parameters, cliffs=cliffs, resolution=resolution, progress=progress)
        document = Document(f"Sweep of {study.name}")
        document.sections += [
            *_perturbations(found, results.folder),
            *_cliffs(found, searched=cliffs),
            *settings_sections(study, len(found.table)),
        ]
        files = [*found.table.save(results.folder), *document.save(results.folder, "sweep")]
    return Report(found.study, found, (), document, tuple(files))


def report(
    study: Study | str | os.PathLike[str], out: str | os.PathLike[str] = "out", *, progress: ProgressCallback | None = None
) -> Report:
    """Writes the simulator report of a study.

    The report describes state and sensors, decisive contacts, settings, effects of parameters, differences between engines, and causes of
    failures.

    Args:
        study: A study, or its file.
        out: Output folder. The files are in OUT/NAME, a subfolder with the name of the study.
        progress: Progress callback with a text and the fraction done.

    Returns:
        The report. OUT/NAME has report.html, report.md and the files of `sweep`.

    Raises:
        ValueError: The study has no outcome, or a time step does not divide the control period.
        JournalError: The journal is damaged, or belongs to another study.
        BlockingIOError: Another run writes to OUT/NAME.
    """
    study = with_peers(study_of(study))
    with Results(study, out) as results:
        found = run_sweep(study, results.journal, progress=progress)
        some = range(min(study.episodes, study.batch))
        seen = touching(study, some)
        verdicts = causes_of(study, found.table.rows, results.journal)
        causes = {verdict.row["key"]: verdict.cause for verdict in verdicts}
        found = dataclasses.replace(found, table=Table(found.table.rows, causes if study.success_outcome else None))
        document = Document(f"Simulator report of {study.name}")
        document.sections += [
            *_summary(study, found, verdicts),
            *_state(study),
            *_observation(study),
            *_drives(study),
            *_contacts(study, seen, len(some)),
            *_settings(study, found),
            *_perturbations(found, results.folder),
            *_cliffs(found),
            *_transfer(study, found),
            *([study.trajectories.section(study)] if study.trajectories else []),
            *_failures(verdicts, found),
            *_left_out(study),
            *settings_sections(study, len(found.table)),
        ]
        files = [*found.table.save(results.folder), *document.save(results.folder, "report")]
    return Report(study, found, tuple(verdicts), document, tuple(files))


def study_of(source: Study | str | os.PathLike[str]) -> Study:
    """Study from an argument that is a study or the path of a study file."""
    if isinstance(source, Study):
        return source
    if not isinstance(source, str | os.PathLike):
        raise TypeError(f"study is {source!r} ({type(source).__name__}), must be a stepper.lab.Study or the path of a study's file")
    return Study.from_file(Path(source))


def with_peers(study: Study) -> Study:
    """Copy of a study with two more alternative settings: MuJoCo's contact law in stepper, and the engine MuJoCo.

    MuJoCo's contact law is added only to a study with hard contact, the engine MuJoCo only if it can run the study. Neither is added if
    settings of the study already have it.
    """
    given = {name: study.setting(name) for name in study.settings}
    more: dict[str, dict[str, Any]] = {}
    if study.options.contact == "hard" and not any(own.get("contact") == "mujoco" for own in given.values()):
        more[LAW] = {"contact": "mujoco", "integrator": None}
    if not _has_peer(study) and no_peer(study) is None:
        more[PEER] = {"engine": "mujoco"}
    return dataclasses.replace(study, settings={**more, **study.settings})


def _has_peer(study: Study) -> bool:
    """Whether any settings of the study run in MuJoCo."""
    return any(own.get("engine") == "mujoco" for own in study.settings.values())


def no_peer(study: Study) -> str | None:
    """Reason why MuJoCo cannot run a study; None if it can."""
    model, compiled = study.loaded
    if package_version("mujoco-core") is None:
        return "it is not installed"
    if compiled is None:
        return "the model has no source that MuJoCo can read"
    has_models = any(study.parameters[name].kind in ("sensor", "actuator") for name in study.nominal)
    if has_models or study.sensors is not None or study.actuators is not None:
        return "it has no sensor errors and no drives"
    if model.nu != compiled.nu or model.nsensordata != compiled.nsensordata:
        return "stepper leaves out actuators or sensors of the model, so that controls and readings are not the same"
    return None


# Functions that make the sections of the documents.


def _summary(study: Study, found: Sweep, verdicts: Sequence[Verdict]) -> list[Section]:
    """Section with the main results of a study."""
    nominal = found.levels_of("")[0]
    model = f" of model `{name}`" if (name := study.loaded[0].name) else ""
    words = [
        f"`{study.name}`{model}: {counted(study.episodes, 'episode')} of {study.seconds:g} s at every point, "
        f"{len(found.table)} rows in all."
    ]
    if study.success_outcome:
        outcome = study.success_outcome
        words.append(
            f"{outcome.name} {outcome.success} {outcome.unit}: {nominal.successes} of {nominal.episodes} at the "
            f"nominal point (95 %: {_interval(nominal)})."
        )
    if found.ranking:
        what = "the share of successes" if study.success_outcome else measured(study)
        words.append(f"Range of {what} over each parameter: " + ", ".join(f"{name} {cell(value)}" for name, value in found.ranking) + ".")
    if lost := Counter(row["setting"] for row in found.table.rows if diverged(row)):
        counts_of = ", ".join(f"{count} with {setting}" for setting, count in lost.most_common())
        words.append(f"Diverged, and so no success: {counts_of}, of {len(found.table)} episodes.")
    if verdicts:
        counts = Counter(verdict.cause for verdict in verdicts)
        words.append("Failures: " + ", ".join(f"{cause} {count}" for cause, count in counts.most_common()) + ".")
    return [Section("Summary", words)]


def _state(study: Study) -> list[Section]:
    """Section with the joints, ranges and units of the state."""
    model, _ = study.loaded
    rows = []
    for k in range(model.njnt):
        joint = model.joint(k)
        low, high = joint.range
        unit = {"hinge": "rad", "slide": "m", "ball": "quaternion", "free": "m, quaternion"}[joint.type]
        limits = f"{low:.4g} to {high:.4g}" if joint.limited else "none"
        numbers = (joint.damping, joint.stiffness, joint.armature, joint.frictionloss)
        rows.append([joint.name or f"#{k}", joint.type, model.body(joint.bodyid).name, joint.qposadr, joint.dofadr, unit, limits, *numbers])
    head = ("joint", "type", "body", "qpos", "qvel", "unit", "limits", "damping", "stiffness", "armature", "dry friction")
    words = [
        f"qpos ({model.nq}), qvel ({model.nv}), activations ({model.na}); controls ({model.nu}), each held for {study.control_period:g} s. "
        "The next state follows from these, and from the internal state of sensors and drives, if there are any."
    ]
    return [Section("State variables", words, head, rows)]


def _observation(study: Study) -> list[Section]:
    """Section with the sensors and their transfer functions."""
    model, _ = study.loaded
    head = ("sensor", "type", "readings", "transfer function")
    rows = []
    for k, sensor in enumerate(model.sensors):
        own = study.sensors.transfers(model, 1)[k] if study.sensors else None
        rows.append(
            [sensor["name"] or f"#{k}", sensor["type"], f"{sensor['adr']} to {sensor['adr'] + sensor['dim'] - 1}", _transfer_words(own)]
        )
    words = ["Errors act in this order: scale and misalignment, bias, drift, noise, quantisation, limits, sample and hold, delay, dropout."]
    return [Section("Observation map", words if rows else ["The model has no sensors."], head, rows)]


def _transfer_words(own: dict[str, Any] | None) -> str:
    """Text with the entries of a sensor's transfer function that differ from those of an ideal sensor; "ideal" if none differ."""
    ideal = Transfer()._row(1)
    entries = (
        []
        if own is None
        else [f"{name} {value[0] if isinstance(value, list) and value else value}" for name, value in own.items() if value != ideal[name]]
    )
    return ", ".join(entries) or "ideal"


def _drives(study: Study) -> list[Section]:
    """Section with the actuators and their drives."""
    model, _ = study.loaded
    rows = []
    for k in range(model.nu):
        actuator = model.actuator(k)
        drive = study.actuators.drive_of(actuator.name or f"#{k}") if study.actuators else None
        ends = [
            f"{low:.4g} to {high:.4g}" if np.isfinite([low, high]).any() else "none"
            for low, high in (actuator.ctrlrange, actuator.forcerange)
        ]
        gain, bias = (" ".join(f"{x:.4g}" for x in values) for values in (actuator.gainprm[:3], actuator.biasprm[:3]))
        gear = " ".join(f"{x:.4g}" for x in (actuator.gear if actuator.trntype == "site" else actuator.gear[:1]))
        rows.append([actuator.name or f"#{k}", actuator.trntype, gear, gain, bias, *ends, "ideal" if drive is None else repr(drive)])
    head = ("actuator", "on", "gear", "gain", "bias", "controls", "forces", "drive")
    return [Section("Actuators", [] if rows else ["The model has no actuators."], head, rows)]


def _contacts(study: Study, seen: Sequence[Pair], episodes: int) -> list[Section]:
    """Section with the contact pairs: durations, impulses and friction."""
    model, _ = study.loaded
    head = (
        *("pair", "pressed, share of time", "impulse, N s", "peak, N", "friction in force", "largest ratio used", "impulse at that bound"),
        *("condim", "restitution", "solref", "solimp"),
    )
    rows = []
    for pair in deciding(seen):
        both = [model.geom(g) for g in pair.geoms]
        soft = [np.asarray(getattr(model, name))[list(pair.geoms)] for name in ("geom_solref", "geom_solimp")]
        softness = [" / ".join(dict.fromkeys(" ".join(f"{x:g}" for x in own) for own in values)) for values in soft]
        rows.append([
            *(" - ".join(pair.names), pair.time, pair.impulse, pair.peak, pair.friction, pair.used, pair.slides),
            *(max(g.condim for g in both), max(g.restitution for g in both), *softness),
        ])  # fmt: skip
    words = [
        f"Every step of {counted(episodes, 'episode')} at the nominal point, with the study's own settings: pairs of geoms with a "
        f"hundredth of the impulse of all, or a tenth of the greatest force; {len(seen) - len(rows)} others came near. Friction "
        "in force is the larger of the two geoms', or that of the geom with the higher priority. Hard contact reads neither solref nor "
        "solimp; MuJoCo's law does."
    ]
    return [Section("Contacts that decide", words if rows else ["Nothing touches at the nominal point."], head, rows)]


def _settings(study: Study, found: Sweep) -> list[Section]:
    """Section of the report with all options of the study, and with the options that its alternative settings change."""
    columns: dict[str, dict[str, Any]] = {}
    for row in found.table.rows:
        columns.setdefault(row["setting"], row["settings"])
    usual = columns[USUAL]
    rows = [[setting, _differences(own, {} if setting == USUAL else usual)] for setting, own in columns.items()]
    words = [
        "All settings of the study, and the differences of the others from these. Tolerances of stepper are residuals in m/s; MuJoCo "
        "defines its tolerance differently."
    ]
    return [Section("Solver settings in force", words, ("settings", "values"), rows)]


def _differences(own: dict[str, Any], usual: dict[str, Any]) -> str:
    """Text with the options that differ between some settings and those of the study, such as "iterations 5".

    "no NAME" marks an option that the engine does not have. Without differences the text is "the same".
    """
    names = list(dict.fromkeys((*usual, *own)))
    changed = [name for name in names if own.get(name) != usual.get(name)]
    changes = [f"no {name}" if own.get(name) is None else f"{name} {cell(own[name])}" for name in changed]
    return ", ".join(changes) or "the same"


def _perturbations(found: Sweep, folder: Path) -> list[Section]:
    """Sections with the parameters and their effects on all outcomes. The first effects have a picture, which is written to `folder`."""
    study = found.study
    main, *others = ordered_outcomes(study)
    shares = ("successes", "share", "95 %") if study.success_outcome else ()
    head = ("settings", "parameter", "value", *shares, f"mean {_with_unit(main)}", *_CHANGE, "unsolved", "diverged")
    rows = [
        [*_place(study, level), *_shares_of(study, level), level.mean, *level.change, level.unsolved, level.diverged]
        for level in found.levels
    ]
    words = [
        f"One parameter at a time, {counted(study.episodes, 'episode')} each, the same starts and random numbers at every point. "
        "Intervals are Wilson's. Changes are differences from the same episodes at the nominal point, +- one standard error. Unsolved "
        "episodes have a step that was not solved, not finite or unresolved. Diverged ones among them had a state that was not finite or "
        "huge, or MuJoCo reset itself; they have no outcome, count as failures, and are left out of means.",
        *_repeated(found.levels),
        *(f"Not run: {reason}." for reason in found.skipped),
    ]
    sections = [*_ranges(study), Section("Perturbation table", words, head, rows, _picture(found, folder))]
    for outcome in others:
        head = ("settings", "parameter", "value", f"mean {_with_unit(outcome)}", "spread", *_CHANGE)
        rows = [[*_place(study, level), own.mean, own.spread, *own.change] for level in found.levels for own in [level.of(outcome.name)]]
        sections.append(Section(f"Outcome {outcome.name}", ["The same episodes as above."], head, rows))
    return sections


_CHANGE = ("change from nominal", "+-")
"""Headings of the columns with the mean change of an outcome and its standard error."""


def _with_unit(part: Outcome | Parameter, name: str = "") -> str:
    """Name of an outcome or a parameter with its unit: "height, m". A line of a table does not break within the unit."""
    name = name or getattr(part, "name", "")
    unit = part.unit.replace(" ", "\u00a0")
    return f"{name}, {unit}" if unit else name


def _place(study: Study, level: Level) -> list[Any]:
    """Cells of a table with the settings, the parameter and its value."""
    parameter = study.parameters.get(level.parameter)
    return [level.setting, "nominal" if parameter is None else _with_unit(parameter, level.parameter), level.value]


def _shares_of(study: Study, level: Level) -> list[Any]:
    """Cells of a table with the number and share of successes and the interval of the share; none without a condition of success."""
    return [level.successes, level.share, _interval(level)] if study.success_outcome else []


def _ranges(study: Study) -> list[Section]:
    """Section with the ranges of the parameters and their sources; none without parameters."""
    head = ("parameter", "selector", "operation", "nominal", "low", "high", "source")
    rows = [
        [_with_unit(own, name), f"`{own.selector}`", own.operation, study.nominal.get(name), own.low, own.high, own.source]
        for name, own in study.parameters.items()
    ]
    return [Section("Parameters", (), head, rows)] if rows else []


def _repeated(levels: Sequence[Level]) -> list[str]:
    """Paragraph that explains why some levels (values of a parameter) have no confidence interval. The list is empty if all have one."""
    fewest = min((level for level in levels), key=lambda level: level.different / level.episodes)
    if fewest.different == fewest.episodes:
        return []
    return [
        "Levels with equal episodes have no interval, because equal episodes are not independent trials: at one level "
        f"{counted(fewest.episodes, 'episode')} have only {counted(fewest.different, 'distinct result')}. Give the study qpos_noise, "
        "qvel_noise, a random start or controller, or episodes=1."
    ]


def _interval(level: Level) -> str:
    """Text of the confidence interval of the success rate at one value of a parameter (level).

    A level whose episodes repeat one another has no interval; the text is then the number of different episodes.
    """
    if level.different < level.episodes:
        return f"none, {level.different} different"
    return "{:.3f} to {:.3f}".format(*level.interval)


def _picture(found: Sweep, folder: Path) -> Path | None:
    """Draws the sweep, and returns the path of the picture. None if Matplotlib is not installed or the study has no parameters."""
    if package_version("matplotlib") is None or not found.study.parameters:
        return None
    return draw(found, folder / "sweep.png")


def _cliffs(found: Sweep, *, searched: bool = True) -> list[Section]:
    """Sections on cliffs, the values of parameters at which success ends."""
    if found.study.success_outcome is None:
        return []
    if not searched:
        return [Section("Cliffs", ["Not searched: cliffs=False, or --no-cliffs."])]
    head = ("settings", "parameter", "at", "+-", "share below", "share above")
    rows: list[list[Any]] = []
    for setting in (USUAL, *found.study.settings):
        for name in found.study.parameters:
            own = [c for c in found.cliffs if (c.setting, c.parameter) == (setting, name)]
            rows += [[setting, name, (c.low + c.high) / 2, (c.high - c.low) / 2, c.below, c.above] for c in own] or _no_cliff(
                found.levels_of(name, setting)
            )
    words = [
        "Where the share of successes crosses one half, located by bisection between neighbouring values of the table. The number after +- "
        "is the width of the bisection. It excludes the error of the time step: repeat the sweep with half the time step to see that."
    ]
    words = words if found.cliffs else ["The share of successes crosses one half nowhere within the ranges of the parameters."]
    return [Section("Cliffs", words, head, rows)]


def _no_cliff(levels: Sequence[Level]) -> list[list[Any]]:
    """Row of the report's table of cliffs for a parameter at whose values success does not end. Without levels there is no row."""
    if not levels:
        return []
    numbers = not any(isinstance(level.value, str) for level in levels)
    own = sorted(levels, key=lambda level: float(level.value or 0)) if numbers else list(levels)
    above = [level.share >= CLIFF for level in own]
    if len({level.successes for level in own}) == 1:
        found = "same number of successes"
    elif len(set(above)) == 1:
        found = f"share of successes {'at least' if above[0] else 'below'} one half"
    else:
        found = "share of successes crosses one half, not located,"
    values = [cell(level.value) for level in own]
    place = f"between {values[0]} and {values[-1]}" if numbers else f"with {', '.join(values)}"
    return [[own[0].setting, own[0].parameter, f"{found} {place}", None, own[0].share, own[-1].share]]


def _transfer(study: Study, found: Sweep) -> list[Section]:
    """Section that compares the outcomes of the study's settings with those of its other settings and engines."""
    own = [level for level in found.levels_of("")]
    head = ("settings", "successes", "95 %", "outcome", "mean", "spread", "mean difference", "+-", "another success", "diverged")
    base = _nominal_rows(found, USUAL)
    rows = []
    for setting in [USUAL, *study.settings]:
        level, mine = found.levels_of("", setting)[0], _nominal_rows(found, setting)
        both = [(row, base[e]) for e, row in mine.items() if not diverged(row) and not diverged(base[e])]
        otherwise = sum(row["success"] != base[e]["success"] for e, row in mine.items())
        share = ["-", "-"] if level.successes is None else [f"{level.successes} of {level.episodes}", _interval(level)]
        counts = [otherwise if own[0].successes is not None else "-", level.diverged]
        for outcome in ordered_outcomes(study):
            gap = np.array([row["outcomes"][outcome.name] - other["outcomes"][outcome.name] for row, other in both])
            error = float(gap.std(ddof=1) / math.sqrt(len(gap))) if len(gap) > 1 else math.nan
            apart = float(gap.mean()) if len(gap) else math.nan
            values = level.of(outcome.name)
            rows.append([setting, *share, _with_unit(outcome), values.mean, values.spread, apart, error, *counts])
    reason = None if _has_peer(study) else no_peer(study)
    words = [
        "The same episodes at the nominal point with other settings and engines; differences are from the study's own settings. Another "
        "success: number of episodes that succeed with one of the two settings alone."
    ]
    return [Section("Transfer gap", words + ([f"MuJoCo cannot run this study: {reason}."] if reason else []), head, rows)]


def _nominal_rows(found: Sweep, setting: str) -> dict[int, dict[str, Any]]:
    """Results (rows) of the episodes with nominal values of all parameters and with given settings, by number of the episode."""
    nominal = nominal_of(found.study, setting)
    return {row["episode"]: row for row in found.table.rows if row["setting"] == setting and row["parameters"] == nominal}


def _failures(verdicts: Sequence[Verdict], found: Sweep) -> list[Section]:
    """Section with the causes of failed episodes."""
    if found.study.success_outcome is None:
        return []
    counts = Counter((verdict.row["setting"], verdict.cause, verdict.rule) for verdict in verdicts)
    places = [USUAL, *found.study.settings]
    rows: list[list[Any]] = []
    for (setting, cause, rule), count in sorted(counts.items(), key=lambda entry: (places.index(entry[0][0]), -entry[1])):
        row = next(v.row for v in verdicts if (v.row["setting"], v.cause, v.rule) == (setting, cause, rule))
        values = ", ".join(f"{name} {cell(value)}" for name, value in row["parameters"].items()) or "nominal"
        rows.append([setting, cause, rule, count, f"{values}, episode {row['episode']}"])
    words = [
        "All failed episodes of stepper at all points above, and those of MuJoCo that diverged. Each is repeated with one part made ideal "
        "at a time, and the first rule that applies gives the cause, which is also in the column cause of table.csv:",
        ". ".join(f"{cause}: {rule}" for cause, rule in rules_of(found.study)) + ".",
    ]
    return [
        Section(
            "Causes of failures",
            words if rows else ["No episode of stepper failed, and none of MuJoCo diverged."],
            ("settings", "cause", "rule", "episodes", "first"),
            rows,
        )
    ]


def _left_out(study: Study) -> list[Section]:
    """Section with the elements of the source that the model leaves out."""
    return [Section("Left out of the model", study.notes or ["Nothing."])]


def settings_sections(study: Study, count: int, table: str = "table") -> list[Section]:
    """Section "In force" of a document: digests (SHA-256), versions and seed on which the study's results depend.

    It also names the files in which the settings of each episode and all digests and versions are stored.
    """
    used = study.resolved_settings()
    rows = [
        ["model", used["model"]["sha256"]],
        ["controller", f"{used['controller']['name']} {used['controller']['sha256']}"],
        *([f"outcome {outcome['name']}", f"{outcome['measure']} {outcome['sha256']}"] for outcome in used["outcomes"]),
        ["versions", ", ".join(f"{name} {version}" for name, version in used["versions"].items())],
        ["binary", used["binary"]],
        ["seed", used["seed"]],
        [
            "rows",
            f"{count}, each with its parameters, settings and tolerance in {table}.csv; resolved_settings.json has the rest, with notes",
        ],
    ]
    return [Section("In force", [], ("", ""), rows)]
