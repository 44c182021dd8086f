"""Whose a failure is, told by running the failed episode again with one thing made ideal at a time.

The first rule that fits counts:

    physics      the episode diverged: a state was not finite or huge, or MuJoCo began anew by itself
    physics      the steps say that they failed (`Stepper.status`)
    evaluation   the outcome is not a number, or within its margin of the threshold
    perception   the episode succeeds with ideal sensors
    physics      the episode, with ideal sensors, succeeds at half the time step, solved a hundred times as well
    physics      where contact is soft: the episode, with ideal sensors, succeeds with hard contact
    policy       none of these: what drives it fails though the world was computed and seen as it is

A drive with a memory begins anew in every run.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stepper.lab.study.batches import group_of, run_episodes
from stepper.lab.study.journal import Journal, Row, diverged
from stepper.lab.study.points import Point
from stepper.lab.study.study import Study
from stepper.lab.study.sweep import UNSOLVED

FINER = 2
"""Ratio of the time steps of an episode and of the finer run that judges its physics."""
TIGHTER = 1e-2
"""Ratio of the tolerance of the finer run to that in force."""

EVALUATION = "the outcome is not finite, or no farther from its threshold than its margin"
DIVERGED = "the episode diverged: a state that is not finite or huge, or an engine that began anew by itself"
STATUS = "a step says that it was not solved, finite or resolved"
PERCEPTION = "success with ideal sensors"
STEP = f"success with ideal sensors at the time step over {FINER} and {TIGHTER:g} of the tolerance"
LAW = "success with ideal sensors and hard contact: the softness of the law decides"
POLICY = "fails though the world is computed more finely and seen as it is"
DECLARED = "the study says whose failures of this outcome are"

RULES = (
    ("physics", DIVERGED),
    ("as declared", DECLARED),
    ("physics", STATUS),
    ("evaluation", EVALUATION),
    ("perception", PERCEPTION),
    ("physics", STEP),
    ("physics", LAW),
    ("policy", POLICY),
)
"""In their order."""


@dataclass(frozen=True)
class Verdict:
    """Whose the failure of an episode is.

    Attributes:
        row: The episode.
        whose: "physics", "perception", "policy" or "evaluation".
        rule: By which it was told.
    """

    row: Row
    whose: str
    rule: str


def judge(study: Study, rows: Sequence[Row], journal: Journal) -> list[Verdict]:
    """Tells whose every failure is; runs go into the journal.

    Rows of episodes that succeed are left out, and those of MuJoCo but for the ones that diverged.
    """
    failed = {row["key"]: row for row in rows if row["success"] is False and (row["settings"]["engine"] == "stepper" or diverged(row))}
    verdicts = {key: _seen(study, row) for key, row in failed.items()}
    for name, change, whose, rule in _TRIALS:
        left = [row for key, row in failed.items() if verdicts[key] is None and _tells(study, name, row)]
        for row, again in zip(left, _again(study, left, journal, name, change), strict=True):
            if again["success"]:
                verdicts[row["key"]] = (whose, rule)
    return [Verdict(row, *(verdicts[key] or ("policy", POLICY))) for key, row in failed.items()]


def _seen(study: Study, row: Row) -> tuple[str, str] | None:
    """What the episode itself says; None where only another run can tell."""
    outcome = study.decisive
    assert outcome is not None
    assert outcome.threshold is not None
    if diverged(row):
        return "physics", DIVERGED
    if outcome.whose is not None:
        return outcome.whose, DECLARED
    if int(row["certificate"]["status"]) & UNSOLVED:
        return "physics", STATUS
    value = row["outcomes"][outcome.name]
    if not np.isfinite(value) or abs(value - outcome.threshold) <= outcome.margin:
        return "evaluation", EVALUATION
    return None


def _tells(study: Study, trial: str, row: Row) -> bool:
    """Whether a trial changes anything of an episode: its sensors had errors, its contact was soft."""
    if trial == "hard contact":
        return bool(row["settings"]["contact"] != "hard")
    return trial == "finer" or study.sensors is not None or any(study.parameters[name].kind == "sensor" for name in row["theta"])


def _finer(settings: dict[str, Any]) -> dict[str, Any]:
    better: dict[str, Any] = {"timestep": settings["timestep"] / FINER, "iterations": 10 * settings["iterations"], "sensors": None}
    # A hundredth of the tolerance of 32 bits is beyond them.
    return better | ({"precision": "f64"} if settings["precision"] == "f32" else {"tolerance": TIGHTER * settings["tolerance"]})


_TRIALS: tuple[tuple[str, Callable[[dict[str, Any]], dict[str, Any]], str, str], ...] = (
    ("ideal sensors", lambda _: {"sensors": None}, "perception", PERCEPTION),
    ("finer", _finer, "physics", STEP),
    ("hard contact", lambda _: {"contact": "hard", "integrator": None, "sensors": None}, "physics", LAW),
)
"""Name of a run, what it changes in the settings of an episode, and what success in it says."""


def _again(study: Study, rows: Sequence[Row], journal: Journal, name: str, change: Callable[[dict[str, Any]], dict[str, Any]]) -> list[Row]:
    """The same episodes with something changed."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        key = json.dumps([group_of(study, Point(row["theta"], row["setting"])), row["settings"]], sort_keys=True)
        groups.setdefault(key, []).append(row)
    for group in groups.values():
        for first in range(0, len(group), study.batch):
            some = group[first : first + study.batch]
            missing = {_key(row, name) for row in some} - journal.rows.keys()
            if missing:
                # A nominal value with no part in the episode's settings may have one in what is changed: restitution in hard contact.
                thetas, episodes = [study.nominal | row["theta"] for row in some], [row["episode"] for row in some]
                made = run_episodes(study, some[0]["setting"], thetas, episodes, **change(some[0]["settings"]))
                found = {_key(row, name): again for row, again in zip(some, made, strict=True)}
                journal.append({"key": key} | again for key, again in found.items() if key in missing)
    return [journal.rows[_key(row, name)] for row in rows]


def _key(row: Row, name: str) -> str:
    return f"{row['key']}, {name}"
