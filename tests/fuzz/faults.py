"""Kinds of inputs that go wrong on purpose, one time in four: what the runner has to find."""

import os
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from fuzz.cases import Case


def _raise() -> None:
    raise KeyError("nobody expects it")


def _rarely(fault: Callable[[], object]) -> Case:
    def run(rng: np.random.Generator, folder: Path) -> None:
        (folder / "input").write_text("kept")
        if rng.integers(4) == 0:
            fault()

    return Case(run, ())


FAULTS = {
    "raises": _rarely(_raise),
    "aborts": _rarely(os.abort),
    "exits": _rarely(lambda: os._exit(0)),
    "eats": _rarely(lambda: bytearray(1 << 40)),
    "hangs": _rarely(lambda: time.sleep(600)),
}
