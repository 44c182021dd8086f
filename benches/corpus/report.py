"""Writer of the page docs/benchmarks/corpus.md from rows, each with the measurements of one model file."""

import re
import statistics
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rows import provenance_section
from stepper.lab.study.document import markdown_table

from corpus import judge
from corpus.episode import NUDGE, PATIENCE, RANDOM_STEPS, REST_SECONDS
from corpus.packages import PACKAGES
from corpus.row import ABSENT, FAILED, FRAGMENT, LATE, MEASURED, REFUSED, STILL, Row

HEAD = f"""# Corpus of published robot models

Every model in {len(PACKAGES)} packages of the Python package index, unchanged, in stepper
and in MuJoCo. `make corpus` downloads the packages, measures the rows that [corpus.csv](corpus.csv) lacks
for this build, and writes this page.

A model is a file (MJCF, URDF or a compiled one) that MuJoCo can compile and that has degrees of freedom.
Files that compile to the same model count once. Both engines start in the reference pose, with the time
step of the model and stepper's default options:

* **random**: {RANDOM_STEPS} steps with new random controls for each step, uniform in their range, or in -1 to 1
  without a range;
* **rest**: {REST_SECONDS:g} s with all controls 0, from velocities of {NUDGE:g} rad/s and m/s in random
  directions, so that unstable equilibria fall over in both engines.

An episode ends early after {PATIENCE:g} s of processor time.

**Strict**: `stepper.load(model)` accepts the complete model. Other models are measured without the elements
that `strict=False` omits. **Agree**: mass matrix, bias force and acceleration without constraints agree
with MuJoCo's at random states, to a relative error of {judge.AGREES:g}.

A model **steps well** in stepper if

* no step of either episode is NON_FINITE, CONTACTS_FULL or UNRESOLVED,
* at most {judge.UNSOLVED:.1%} of the steps are NOT_CONVERGED,
* the mean kinetic energy is between a tenth and {judge.ENERGY:g} times MuJoCo's, if MuJoCo gives
  no warning; energies below {judge.ENERGY_FLOOR * 1e3:g} mJ count as {judge.ENERGY_FLOOR * 1e3:g} mJ,
* no hinge violates its range by more than {judge.HINGE_EXCESS:g} rad and no slide by more than
  {judge.SLIDE_EXCESS:g} m, in addition to the reference pose.

MuJoCo has one criterion: it gives no warning. corpus.csv has the violations of its soft limits. So the counts of the two engines
are not comparable. Most models that meet the criterion of MuJoCo and not those of stepper start in overlap or outside of their
ranges. They [only move less](#models-that-move-less-than-in-mujoco) in stepper, which removes overlap without adding velocity.
INFEASIBLE and TUNNELLED count the models with at least one such step. Energies below are means over an
episode, with the largest in parentheses.

"""


@dataclass(frozen=True)
class Corpus:
    """Rows (measurements of one file each) of all files of the corpus, with access to the distinct models among them.

    Attributes:
        rows: Rows of all files.
    """

    rows: Sequence[Row]

    def files(self, package: str) -> list[Row]:
        """Rows of all files of a package."""
        return [row for row in self.rows if row.package == package and row.file]

    @property
    def models(self) -> list[Row]:
        """Rows of the distinct models that can move, and of files that failed before they were compiled."""
        return _distinct(self.rows)

    def models_of(self, package: str) -> list[Row]:
        """Rows of the distinct models of a package. A model that several packages have is measured once."""
        measured = {row.model: row for row in self.models if row.model}
        return _distinct(measured.get(row.model, row) for row in self.files(package))


def _distinct(rows: Iterable[Row]) -> list[Row]:
    """Rows without repetitions of equal models, and without files that are not models."""
    kept = {row.model or row.key: row for row in rows if row.outcome in (MEASURED, REFUSED, FAILED, LATE)}
    return list(kept.values())


def write_markdown(path: Path, rows: Sequence[Row], notes: Mapping[str, object]) -> None:
    """Write the Markdown page with the results of the corpus to the file `path`."""
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


def _packages(corpus: Corpus) -> str:
    """Table of the packages: number of files, of models, and of models that satisfy each criterion."""
    counts: dict[str, Callable[[Row], bool]] = {
        "models": lambda _: True,
        "strict": lambda row: row.strict,
        "agree": lambda row: row.outcome == MEASURED and judge.agrees(row),
        "stepper: all criteria": lambda row: not judge.faults(row),
        "MuJoCo: no warning": lambda row: row.outcome == MEASURED and not judge.their_faults(row),
        "INFEASIBLE": lambda row: judge.worse_share(row, "infeasible") > 0,
        "TUNNELLED": lambda row: judge.worse_share(row, "tunnelled") > 0,
    }

    def line(name: str, files: int, models: Sequence[Row]) -> list[object]:
        return [name, files, *(sum(map(count, models)) for count in counts.values())]

    shown = [p for p in PACKAGES if corpus.files(p.name)]
    lines = [line(f"{p.name} {p.version}", len(corpus.files(p.name)), corpus.models_of(p.name)) for p in shown]
    lines.append(line("**all, each model once**", sum(bool(row.file) for row in corpus.rows), corpus.models))
    return markdown_table(["package", "files", *counts], lines) + "\n"


def _missing(corpus: Corpus) -> str:
    """Section with the elements that stepper does not support."""
    kinds = Counter(kind for row in corpus.models for kind in row.missing.split("; ") if kind)
    text = "## Unsupported elements\n\nKinds of elements that prevent strict loading, by the number of models.\n\n"
    alone = Counter(row.missing for row in corpus.models)
    return (
        text
        + markdown_table(["element", "models", "models with this kind alone"], [(kind, n, alone[kind]) for kind, n in kinds.most_common()])
        + "\n"
    )


def _name(row: Row) -> str:
    """Name of a model for a table, with the elements that were left out."""
    name = f"{row.package}: {row.file}"
    return f"{name}, without {row.missing}" if row.missing else name


def _figures(row: Row) -> str:
    """Text of all criteria that a model violates in stepper, with the measured values."""
    return "; ".join(" ".join(str(fault).split())[:300] for fault in judge.faults(row))


def _start(row: Row) -> str:
    """Text of the overlaps and limit violations of a model in the reference pose."""
    parts = [
        f"{row.overlap * 1e3:.2g} mm overlap" if row.overlap > 1e-4 else "",
        f"hinge {row.hinge_outside:.2g} rad outside" if row.hinge_outside > 1e-3 else "",
        f"slide {row.slide_outside * 1e3:.2g} mm outside" if row.slide_outside > 1e-4 else "",
    ]
    return ", ".join(part for part in parts if part)


def _only_less(row: Row) -> bool:
    """Whether a model violates only one criterion in stepper: that its kinetic energy is less than in MuJoCo."""
    return {fault.criterion for fault in judge.faults(row)} == {judge.LESS_ENERGY}


def _faulty(rows: Iterable[Row]) -> str:
    """Table of models that violate criteria. Variants of a scene with the same violations share a row."""
    alike: dict[object, list[Row]] = {}
    for row in rows:
        criteria = frozenset(fault.criterion for fault in judge.faults(row))
        alike.setdefault((row.package, Path(row.file).parent, criteria, row.nbody // 10, _start(row), row.missing), []).append(row)
    lines = []
    for first, *others in alike.values():
        name = f"{_name(first)}; and {len(others)} similar" if others else _name(first)
        shares = [judge.worse_share(row, "infeasible") for row in (first, *others)]
        lines.append((name, _figures(first), _start(first), f"{max(shares):.1%}"))
    return markdown_table(["model", "violated criteria", "reference pose", "INFEASIBLE, at most"], lines) + "\n"


def _worse(corpus: Corpus) -> str:
    """Section with the models that step well in MuJoCo (without warnings), and that violate a criterion of the module `judge` in stepper.

    Models that only have less kinetic energy than in MuJoCo are left out.
    """
    rows = [row for row in corpus.models if judge.faults(row) and not judge.their_faults(row) and not _only_less(row)]
    criteria = Counter(criterion for row in rows for criterion in {fault.criterion for fault in judge.faults(row)})
    text = f"## Models that step well in MuJoCo and not in stepper\n\n{len(rows)} models: "
    return text + ", ".join(f"{criterion} {n}" for criterion, n in criteria.most_common()) + ".\n\n" + _faulty(rows)


def _less_energy(corpus: Corpus) -> str:
    """Section with the models that have less kinetic energy than in MuJoCo, and no other fault."""
    rows = [row for row in corpus.models if _only_less(row) and not judge.their_faults(row)]
    text = f"""## Models that move less than in MuJoCo

{len(rows)} models violate only this criterion. If a joint starts outside its range or geoms start in
overlap, MuJoCo's soft constraints are loaded springs, while stepper corrects positions without adding
velocity. Its contacts also do not bounce.

"""
    return text + _faulty(rows) if rows else ""


def _warned(corpus: Corpus) -> str:
    """Section with the models for which MuJoCo gave warnings during an episode."""
    rows = [row for row in corpus.models if row.outcome == MEASURED and judge.their_faults(row)]
    text = "## Models that do not step well in MuJoCo\n\n"
    lines = [(_name(row), "; ".join(map(str, judge.their_faults(row))), _figures(row) or "steps well") for row in rows]
    return text + markdown_table(["model", "MuJoCo", "stepper"], lines) + "\n" if rows else ""


def _disagreeing(corpus: Corpus) -> str:
    """Section with the models whose smooth dynamics differ between the engines."""
    rows = [row for row in corpus.models if row.outcome == MEASURED and not judge.agrees(row)]
    text = "## Models whose smooth dynamics differ\n\nRelative errors, the worst of the random states.\n\n"
    lines = [(_name(r), *(f"{x:.1e}" for x in (r.mass_error, r.bias_error, r.acceleration_error))) for r in rows]
    return text + markdown_table(["model", "mass matrix", "bias force", "acceleration"], lines) + "\n" if rows else ""


def _loading(corpus: Corpus) -> str:
    """Section with the times to load meshes."""
    rows = [row for row in corpus.models if row.outcome == MEASURED and row.nmesh and row.load_seconds]
    if not rows:
        return ""
    ratios = [row.load_seconds / row.compile_seconds for row in rows]
    text = f"""## Time to load models with meshes

Time of stepper from the compiled model, compared with the time of MuJoCo's compiler. Over {len(rows)}
models the median ratio is {statistics.median(ratios):.2g}. The slowest:

"""
    slowest = sorted(rows, key=lambda row: -row.load_seconds)[:10]
    lines = [(f"{row.package}: {row.file}", row.nmesh, f"{row.load_seconds:.2g}", f"{row.compile_seconds:.2g}") for row in slowest]
    return text + markdown_table(["model", "meshes", "stepper, s", "MuJoCo, s"], lines) + "\n"


def _not_measured(corpus: Corpus) -> str:
    """Section with the files that are not models, and the reasons."""
    outcomes = Counter(row.outcome for row in corpus.rows)
    text = f"""## Files that are not models

MuJoCo rejects {outcomes[FRAGMENT]} files: fragments that other files include, and models with meshes of
unsupported formats. In {outcomes[STILL]} files nothing can move. corpus.csv has all reasons; the
frequent ones are:

"""
    reasons = Counter(_normalised_message(row.note) for row in corpus.rows if row.outcome == FRAGMENT)
    text += "".join(f"* {n} times: {why}\n" for why, n in reasons.most_common(12))
    return text + "".join(f"* not downloaded: {row.note}\n" for row in corpus.rows if row.outcome == ABSENT)


def _normalised_message(note: str) -> str:
    """Error message of MuJoCo's compiler without names and positions in the file, so that equal errors have equal texts."""
    message = re.split(r" Element | in package| line \d", note)[0]
    return re.sub(r"'[^']*'|\S*/\S*", "...", message).strip(" ,")


def _reasons() -> str:
    """Section with the reasons why the Python packages were selected for the corpus."""
    text = "## Reasons for the packages\n\n"
    return text + "".join(f"* {p.name}: {p.why}{f' ({p.because})' if p.because else ''}\n" for p in PACKAGES)


def _provenance(notes: Mapping[str, object], rows: Sequence[Row]) -> str:
    """Section of the report with the notes (machine and versions) and the number of measured files per build of stepper."""
    builds = ", ".join(f"{build} {n}" for build, n in Counter(row.stepper for row in rows).most_common())
    return f"{provenance_section(notes)}* files by build of stepper: {builds}\n"
