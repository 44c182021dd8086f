"""The process in which inputs are tried: `python -m fuzz.worker KIND FIRST END FOLDER`."""

import os
import resource
import shutil
import sys
import traceback
import warnings
from pathlib import Path

import numpy as np

from fuzz.cases import KINDS
from fuzz.faults import FAULTS

MEMORY = 6 << 30
"""Bytes of address space."""


def attempt(kind: str, seed: int, folder: Path) -> str:
    """Tries one input; returns what became of it, "finding ..." if nobody may expect that."""
    case = (KINDS | FAULTS)[kind]
    rng = np.random.default_rng([seed, *kind.encode()])
    try:
        case.run(rng, folder)
    except case.documented as error:
        return f"end {type(error).__name__}"
    except BaseException as error:
        traceback.print_exc(file=sys.stdout)
        return f"finding {type(error).__name__}: " + " ".join(str(error).split())[:300]
    return "end accepted"


def main(kind: str, first: str, end: str, place: str) -> None:
    """Tries inputs until one is a finding."""
    # What is written under a relative name is written there.
    os.chdir(place)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    warnings.simplefilter("ignore")
    np.seterr(all="ignore")
    for seed in range(int(first), int(end)):
        folder = Path(place)
        for old in folder.iterdir():
            shutil.rmtree(old) if old.is_dir() else old.unlink()
        print(f"begin {seed}", flush=True)
        outcome = attempt(kind, seed, folder)
        print(outcome, flush=True)
        if outcome.startswith("finding"):
            break


if __name__ == "__main__":
    main(*sys.argv[1:])
