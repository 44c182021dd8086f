"""Process that measures one model file: `python -m corpus.measure PACKAGE FILE --cache DIR`.

The process writes the measurements (a row of the corpus table) to standard output, as JSON. Standard input has the digests of the models
that have already been measured, as a JSON list.
"""

import argparse
import dataclasses
import functools
import hashlib
import json
import sys
import time
from pathlib import Path

import mujoco
import numpy as np
import stepper
from rows import flatten

from corpus.download import unpacked
from corpus.dynamics import agreement
from corpus.episode import Limits, random_episode, rest_episode
from corpus.files import FragmentError, compile_model, digest
from corpus.packages import PACKAGES, Package
from corpus.row import FAILED, FRAGMENT, MEASURED, REFUSED, SAME, STILL, Row

SEED = 0


@functools.cache
def library() -> str:
    """Digest of the installed build of stepper: its binary and its Python files."""
    folder = Path(stepper.__file__).parent
    contents = hashlib.sha256()
    for path in sorted(p for p in folder.rglob("*") if p.suffix in (".py", ".so", ".pyd")):
        contents.update(path.read_bytes())
    return contents.hexdigest()[:12]


def measure(package: Package, folder: Path, file: str, known: set[str]) -> Row:
    """Row of the corpus table with the measurements of one file, or with its error. Models of `known` digests are not measured again."""
    row = Row(package.name, package.version, file, library(), MEASURED)
    begin = time.perf_counter()
    try:
        m = compile_model(folder, file)
    except FragmentError as error:
        return dataclasses.replace(row, outcome=FRAGMENT, note=str(error))
    seconds = time.perf_counter() - begin
    row = dataclasses.replace(row, model=digest(m), compile_seconds=seconds, timestep=m.opt.timestep)
    row = dataclasses.replace(row, nv=m.nv, nu=m.nu, nbody=m.nbody, ngeom=m.ngeom, nmesh=m.nmesh)
    if m.nv == 0:
        return dataclasses.replace(row, outcome=STILL)
    if row.model in known:
        return dataclasses.replace(row, outcome=SAME)
    try:
        return _compare(row, m)
    except stepper.ModelError as error:
        return dataclasses.replace(row, outcome=REFUSED, note=str(error))
    except Exception as error:  # Each error is a result of the measurement.
        return dataclasses.replace(row, outcome=FAILED, note=f"{type(error).__name__}: {error}")


def _compare(row: Row, m: mujoco.MjModel) -> Row:
    """Copy of a row with the results of the comparison of a compiled model in stepper and MuJoCo."""
    begin = time.perf_counter()
    model = stepper.load(m, strict=False)
    row = dataclasses.replace(row, load_seconds=time.perf_counter() - begin)
    try:
        stepper.load(m)
        row = dataclasses.replace(row, strict=True)
    except stepper.ModelError as error:
        row = dataclasses.replace(row, missing="; ".join(_missing(str(error), model)))
    rng = np.random.default_rng(SEED)
    data = mujoco.MjData(m)
    mujoco.mj_forward(m, data)
    limits = Limits(m)
    hinge, slide = limits.worst(limits.outside)
    mass, bias, acceleration = agreement(m, model, rng)
    return dataclasses.replace(
        row,
        overlap=max((-contact.dist for contact in data.contact), default=0.0),
        hinge_outside=hinge,
        slide_outside=slide,
        mass_error=mass,
        bias_error=bias,
        acceleration_error=acceleration,
        random=random_episode(m, model, rng),
        rest=rest_episode(m, model, rng),
    )


def _missing(refusal: str, model: stepper.Model) -> list[str]:
    """Kinds of unsupported MJCF elements because of which `stepper.load` rejects a model."""
    lines = [line.strip() for line in refusal.splitlines()]
    return sorted({kind for kind, name, _ in model.omitted if any(line.startswith(f"{kind} {name}") for line in lines)})


def main() -> None:
    """Measure the model file that the command line names, and write the measurements to standard output as JSON."""
    parser = argparse.ArgumentParser(prog="corpus.measure", description=__doc__)
    parser.add_argument("package")
    parser.add_argument("file")
    parser.add_argument("--cache", type=Path, required=True)
    args = parser.parse_args()
    mujoco.set_mju_user_warning(lambda _: None)  # No MUJOCO_LOG.TXT: the data count the warnings.
    package = next(p for p in PACKAGES if p.name == args.package)
    row = measure(package, unpacked(package, args.cache), args.file, set(json.load(sys.stdin)))
    json.dump(flatten(row), sys.stdout)


if __name__ == "__main__":
    main()
