"""Published certificates (docs/benchmarks/calibration.csv) and weaker alternatives, in fresh worlds.

It updates docs/benchmarks/calibration_weaker.csv: python tests/helpers/certificates.py TASK LAW WORLDS [SEED [NAME]]. It leaves out
each measured parameter, and doubles tolerances, one at a time and all together. With NAME it runs only alternatives with this text.
Alternatives stop after the first quarter of the worlds that decides them.
"""

import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from reality.report import BENCHMARKS, Row, read_rows, write_rows
from stepper import lab
from stepper.lab.calibration.calibrate import Comparison, _fractions, _space
from stepper.lab.study.intervals import greatest_share, least_share
from stepper.lab.study.journal import Results

ROWS, WEAKER, ROOT = read_rows(BENCHMARKS / "calibration.csv"), BENCHMARKS / "calibration_weaker.csv", BENCHMARKS.parents[1]
COLUMNS = ("set", "seed", "worlds", "violations", "least", "greatest")
LOOKS = (0.998, 0.998, 0.998, 0.956)  # Confidence of bounds after each quarter of the worlds: 95 % for all four.


def published(row: Row) -> dict[str, float]:
    """Tolerances of a certificate by parameter, in its unit."""
    return {name: float(size) for name, size in (text.rsplit(" ", 1) for text in row["measured"].split("; "))}


def violations(row: Row, sets: Mapping[str, Mapping[str, float]], worlds: int, seed: Sequence[int], out: Path) -> Iterator[tuple[str, int]]:
    """Name and number of worlds above the margin of sets of tolerances, all in the same worlds, in the episodes of a certificate."""
    # A certificate is one of the episodes of its study, which depend on its seed; worlds depend on `seed` alone.
    study = replace(lab.Study.from_file(ROOT / "examples/studies" / row["study"]), seed=int(row["seed"]))
    names, margin = list(study.parameters), float(row["margin"]) * (1.0 + 1e-9)
    space = _space(study, names)
    drawn, signs = space.draw(np.random.default_rng(seed), worlds)
    with Results(study, out) as results:
        difference = Comparison(study, names, row["setting"], results.journal, lambda _: None)
        for name, sizes in sets.items():
            yield name, int((~(difference(drawn, space.model(drawn, signs, _fractions(sizes, names, space))) <= margin)).sum())


def main(task: str, law: str, worlds: str, seed: str = "2", part: str = "") -> None:
    """Run the weaker alternatives of a certificate, print how many worlds exceed the margin, and update their rows of the file."""
    about, block, rows = {"task": task, "law": law}, int(worlds) // len(LOOKS), read_rows(WEAKER)
    sizes = published(row := next(row for row in ROWS if row.items() >= about.items()))
    sets = {"as certified": sizes, "nothing measured": {}, "all doubled": {name: 2.0 * size for name, size in sizes.items()}}
    sets |= {f"without {name}": {other: size for other, size in sizes.items() if other != name} for name in sizes if len(sizes) > 1}
    sets |= {f"{name} doubled": {**sizes, name: 2.0 * size} for name, size in sizes.items() if len(sizes) > 1}
    sets, counts = {name: own for name, own in sets.items() if part in name}, dict.fromkeys(sets, 0)
    for look, confidence in enumerate(LOOKS):
        out = ROOT / "out/certificates" / f"{row['study']} {law[:4]}"
        for name, above in violations(row, dict(sets), block, (20261201, int(seed), look), out):
            counts[name], count = counts[name] + above, (look + 1) * block
            low, high = (share(counts[name], count, confidence) for share in (least_share, greatest_share))
            rows = [other for other in rows if not other.items() >= (about | {"set": name}).items()]
            rows.append(about | dict(zip(COLUMNS, (name, seed, str(count), str(counts[name]), f"{low:.6f}", f"{high:.6f}"), strict=True)))
            print("; ".join(rows[-1].values()), flush=True)
            write_rows(WEAKER, rows)
            # These two always run in all worlds.
            if name not in ("as certified", "nothing measured") and not low <= 0.05 < high:
                del sets[name]


if __name__ == "__main__":
    main(*sys.argv[1:])
