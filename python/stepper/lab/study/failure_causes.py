"""Causes of failures, found by repeating a failed episode with one change at a time, such as ideal sensors (a trial).

The first rule of `rules_of` that applies gives the cause; docs/reference/studies.md has them in order. A controller with internal state
restarts in every run.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stepper.lab.study.batches import USUAL, Point, group_of, run_episodes
from stepper.lab.study.journal import Journal, Row, diverged
from stepper.lab.study.study import Study
from stepper.lab.study.sweep import UNSOLVED

FINER = 2
"""Ratio of the episode's time step to the time step of the trial "finer", which tests whether physics caused the failure."""
TIGHTER = 1e-2
"""Ratio of the tolerance in the trial "finer" to the tolerance of the episode.

An episode with 32 bits keeps its tolerance, and is repeated with 64 bits.
"""

# Rules, as texts for tables.
EVALUATION = "the outcome is not finite, or within its margin of the threshold"
DIVERGED = "the episode diverged: a state was not finite or huge, or the engine reset itself"
STATUS = "a step has one of the flags NOT_CONVERGED, NON_FINITE, CONTACTS_FULL, UNRESOLVED, TUNNELLED and INFEASIBLE"
PERCEPTION = "success with ideal sensors"
STEP = f"success with ideal sensors, 1/{FINER} of the time step and {TIGHTER:g} of the tolerance"
LAW = "success with ideal sensors and hard contact: the softness of contact causes the failure"
CONTROLLER = "failure even with ideal sensors and a finer time step"
SCENE = "failure even with a finer time step: the study has no controller, so the model, its parameters and its start cause the failure"


def rules_of(study: Study) -> list[tuple[str, str]]:
    """Pairs of a cause of failure and the rule that detects it, as texts, in the order in which the rules are tested.

    Rules about parts that the study lacks are left out: sensor errors, soft contact, a controller.
    """
    soft = any("mujoco" in (study.options.contact, study.setting(name).get("contact")) for name in (*study.settings, USUAL))
    rules = (
        ("physics", DIVERGED, True),
        ("physics", STATUS, True),
        ("evaluation", EVALUATION, True),
        ("perception", PERCEPTION, _has_sensor_errors(study, study.parameters)),
        ("physics", STEP, True),
        ("physics", LAW, soft),
        (*_last_rule(study), True),
    )
    return [(cause, rule) for cause, rule, applies in rules if applies]


def _last_rule(study: Study) -> tuple[str, str]:
    """Cause and rule of failures that no trial explains."""
    has_controller = study.controller is not None and (study.controller != "random" or study.loaded[0].nu > 0)
    return ("controller", CONTROLLER) if has_controller else ("scene", SCENE)


def _has_sensor_errors(study: Study, parameters: Iterable[str]) -> bool:
    """Whether sensors have errors, in a study or by one of some parameters."""
    return study.sensors is not None or any(study.parameters[name].kind == "sensor" for name in parameters)


@dataclass(frozen=True)
class Verdict:
    """Cause of the failure of one episode.

    Attributes:
        row: Result of the episode.
        cause: Cause: "physics", "perception", "controller", "scene" or "evaluation".
        rule: Rule that detected the cause, as a text.
    """

    row: Row
    cause: str
    rule: str


def causes_of(study: Study, rows: Sequence[Row], journal: Journal) -> list[Verdict]:
    """Cause of each failure in stepper, and of each episode that diverged in MuJoCo."""
    failed = {row["key"]: row for row in rows if row["success"] is False and (row["settings"]["engine"] == "stepper" or diverged(row))}
    verdicts = {key: _cause_in(study, row) for key, row in failed.items()}
    for name, change, cause, rule in _TRIALS:
        left = [row for key, row in failed.items() if verdicts[key] is None and _applies(study, name, row)]
        for row, repeated in zip(left, _repeated(study, left, journal, name, change), strict=True):
            if repeated["success"]:
                verdicts[row["key"]] = (cause, rule)
    return [Verdict(row, *(verdicts[key] or _last_rule(study))) for key, row in failed.items()]


def _cause_in(study: Study, row: Row) -> tuple[str, str] | None:
    """Cause of the failure of an episode, and the rule that detects it, if they follow from the episode's row (result) alone.

    None if the episode must be repeated to find the cause.
    """
    outcome = study.success_outcome
    assert outcome is not None
    assert outcome.threshold is not None
    if diverged(row):
        return "physics", DIVERGED
    if int(row["quality"]["status"]) & UNSOLVED:
        return "physics", STATUS
    value = row["outcomes"][outcome.name]
    if not np.isfinite(value) or abs(value - outcome.threshold) <= outcome.margin:
        return "evaluation", EVALUATION
    return None


def _applies(study: Study, trial: str, row: Row) -> bool:
    """Whether an episode can change if it is repeated with the settings of a trial.

    With ideal sensors it changes only if the sensors have errors, and with hard contact only if contact was soft.
    """
    if trial == "hard contact":
        return bool(row["settings"]["contact"] != "hard")
    return trial == "finer" or _has_sensor_errors(study, row["parameters"])


def _finer(settings: dict[str, Any]) -> dict[str, Any]:
    """Settings of the trial "finer" that differ from an episode's `settings`.

    They are a shorter time step, ten times the iterations, ideal sensors, and a smaller tolerance (or 64 bits in place of 32).
    """
    better: dict[str, Any] = {"timestep": settings["timestep"] / FINER, "iterations": 10 * settings["iterations"], "sensors": None}
    # With 32 bits a hundredth of the tolerance cannot be reached; 64 bits replace it in the trial.
    return better | ({"precision": "f64"} if settings["precision"] == "f32" else {"tolerance": TIGHTER * settings["tolerance"]})


_TRIALS: tuple[tuple[str, Callable[[dict[str, Any]], dict[str, Any]], str, str], ...] = (
    ("ideal sensors", lambda _: {"sensors": None}, "perception", PERCEPTION),
    ("finer", _finer, "physics", STEP),
    ("hard contact", lambda _: {"contact": "hard", "integrator": None, "sensors": None}, "physics", LAW),
)
"""Trials, which are repetitions of a failed episode with changed settings.

An entry has the name of the trial, and a function from the settings of the episode to the changed settings. The last two texts are the
cause of the failure and the rule, if the repetition succeeds.
"""


def _repeated(
    study: Study, rows: Sequence[Row], journal: Journal, name: str, change: Callable[[dict[str, Any]], dict[str, Any]]
) -> list[Row]:
    """Results (rows) of given episodes, which are repeated with changed settings."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        key = json.dumps([group_of(study, Point(row["parameters"], row["setting"])), row["settings"]], sort_keys=True)
        groups.setdefault(key, []).append(row)
    for group in groups.values():
        for first in range(0, len(group), study.batch):
            some = group[first : first + study.batch]
            missing = {_key(row, name) for row in some} - journal.rows.keys()
            if missing:
                # The row lacks nominal values without effect in the episode. In the trial they may have one, such as restitution with hard
                # contact.
                values_by_env, episodes = [study.nominal | row["parameters"] for row in some], [row["episode"] for row in some]
                made = run_episodes(study, some[0]["setting"], values_by_env, episodes, **change(some[0]["settings"]))
                found = {_key(row, name): repeated for row, repeated in zip(some, made, strict=True)}
                journal.append({"key": key} | repeated for key, repeated in found.items() if key in missing)
    return [journal.rows[_key(row, name)] for row in rows]


def _key(row: Row, name: str) -> str:
    """Key under which the journal stores the repetition of a failed episode with the changed settings of a trial."""
    return f"{row['key']}, {name}"
