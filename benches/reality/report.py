"""Results of `python -m reality`: a file per data set in docs/benchmarks, and the picture of docs/benchmarks/reality.md."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from stepper.lab.calibration.fit import bootstrap
from stepper.shared.files import read_csv, write_csv, write_figure
from stepper.shared.machine import require

from reality.tosses import EXPERIMENTS, PUBLISHED_STEP, REFINED, Experiment

BENCHMARKS = Path(__file__).parents[2] / "docs/benchmarks"
Row = dict[str, str]


SETS = {"cube_toss": "reality.csv", "elbow_toss": "reality_elbow.csv", "multiarm_pendulum": "reality_pendulum.csv"}
"""File of docs/benchmarks with the results of each data set."""


def shown(value: object) -> object:
    """Number with six significant digits; other values are unchanged."""
    return f"{value:.6g}" if isinstance(value, float) else value


def write_rows(path: Path, rows: Sequence[Mapping[str, Any]]) -> Path:
    """Write rows to a CSV file, numbers with six significant digits, and return its path."""
    return write_csv(path, [rows[0], *(map(shown, row.values()) for row in rows)])


def read_rows(path: Path) -> list[Row]:
    """Rows of a CSV file."""
    head, *rows = read_csv(path, "table of results")
    return [dict(zip(head, row, strict=True)) for row in rows]


def update_docs(folder: Path) -> None:
    """Write the results of the engines in a folder to docs/benchmarks/reality*.csv, and draw docs/benchmarks/reality.png.

    Data sets and engines without results keep their rows.

    Raises:
        ValueError: The folder has no results.
    """
    results = {name: rows for name in SETS if (rows := [row for path in sorted(folder.glob(f"{name} *.csv")) for row in read_rows(path)])}
    if not results:
        raise ValueError(f"{folder} has no results: run `python -m reality` without --update-docs first")
    for name, rows in results.items():
        renewed, path = {row["engine"] for row in rows}, BENCHMARKS / SETS[name]
        every = [row for row in read_rows(path) if row["engine"] not in renewed] + rows
        write_rows(path, every)
        if name == "cube_toss":
            _draw(every, BENCHMARKS / "reality.png")


def _draw(rows: Sequence[Row], path: Path) -> None:
    """Draw median errors of held-out tosses with intervals, and their growth with the time since the first contact."""
    figure = require("matplotlib.figure", "to draw results").Figure(figsize=(10.5, 3.8), dpi=130, layout="constrained")
    panels = figure.subplots(1, 3)
    engines = list(dict.fromkeys(row["engine"] for row in rows))
    places = np.arange(len(engines))[::-1]
    colours = {name: f"C{k}" for k, name in enumerate(engines)}
    for panel, statistic in zip(panels[:2], ("mean", "median"), strict=True):
        for nuisances, shift, marker in (("none", 0.12, "o"), ("fitted", -0.12, "s")):
            for engine, place in zip(engines, places, strict=True):
                own = [row for row in held_out(rows, nuisances) if row["engine"] == engine]
                if own:
                    value, low, high = (float(own[0][name]) for name in (statistic, f"{statistic}_low", f"{statistic}_high"))
                    panel.hlines(place + shift, low, high, color=colours[engine])
                    panel.plot(value, place + shift, marker, color=colours[engine])
        panel.set_yticks(places, engines if panel is panels[0] else [""] * len(engines))
        panel.set_xlabel(f"{statistic} error, 95 %")
        panel.set_xlim(left=0.0)
    for engine in engines:
        own = [row for row in rows if (row["engine"], row["half"], row["nuisances"]) == (engine, "held out", "fitted") and row["horizon_s"]]
        panels[2].semilogy(*([float(row[name]) for row in own] for name in ("horizon_s", "median")), color=colours[engine])
    panels[2].set_xlabel("time since the first contact, s")
    panels[2].set_ylabel("median error then")
    for panel in panels:
        panel.grid(visible=True, color="#dddddd")
        panel.set_axisbelow(True)
    title = "Held-out tosses, a colour per engine. Circles: published protocol; squares and right: nuisance parameters fitted"
    figure.suptitle(title, fontsize=10)
    write_figure(path, figure)


def held_out(rows: Sequence[Row], nuisances: str, timestep: float = PUBLISHED_STEP) -> list[Row]:
    """Rows of the held-out tosses over their whole length, at a time step in s."""
    chosen = [row for row in rows if (row["half"], row["horizon_s"], row["nuisances"]) == ("held out", "", nuisances)]
    return [row for row in chosen if abs(float(row["timestep_s"]) - timestep) < 1e-6]


def update_pairs(data: Path) -> Path:
    """Write docs/benchmarks/reality_pairs.csv, with the parameters in the files of results and the tosses in the folder `data`."""
    rows: list[dict[str, object]] = []
    for experiment in EXPERIMENTS:
        rows += _pairs(read_rows(BENCHMARKS / SETS[experiment.name]), data, experiment)
    return write_rows(BENCHMARKS / "reality_pairs.csv", rows)


def _pairs(rows: Sequence[Row], data: Path, experiment: Experiment) -> Iterator[dict[str, object]]:
    """Differences of the mean errors of two engines, paired over the held-out tosses. Engines whose packages are missing are left out."""
    for nuisances in ("none", "fitted"):
        errors = {}
        for row, engine in itertools.product(held_out(rows, nuisances), experiment.made_engines()):
            if row["engine"] == engine.name:
                values = {name: float(value) for name, value in (text.rsplit(" ", 1) for text in row["parameters"].split("; "))}
                table = experiment.table(**{own.name: values.pop(own.name) for own in fields(experiment.table) if own.name in values})
                tosses = experiment.tosses(data, table.gravity)[1::2]
                error = experiment.errors(engine.poses(values, table, tosses, REFINED[-1]), tosses)[0]
                errors[engine.name] = np.nanmean(error[:, : experiment.samples], axis=1)
        for first, second in itertools.combinations(errors, 2):
            more = errors[first] - errors[second]
            about: dict[str, object] = {"data_set": experiment.name, "nuisances": nuisances, "engine": first, "other": second}
            about["tosses"] = len(more)
            yield about | dict(zip(("more", "low", "high"), (f"{value:.4f}" for value in (more.mean(), *bootstrap(more))), strict=True))
