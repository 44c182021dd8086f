"""Published certificates of robots (docs/benchmarks/calibration.csv) on worlds that no search and no certificate used."""

from importlib.util import find_spec
from pathlib import Path

import pytest
from certificates import ROWS, published, violations
from scipy.stats import binom
from stepper.lab.calibration.search import SHARE
from stepper.lab.study.intervals import greatest_share

WORLDS, SEED = 96, (20261130, 62)
"""Number of fresh worlds of each certificate, and a seed with a length that `calibrate` does not have and numbers it does not use."""


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row['task']}, {row['law']}")
def test_published_certificates_hold_on_fresh_worlds(row: dict[str, str], tmp_path: Path) -> None:
    """No more fresh worlds exceed the margin than the bound allows. Without measurements more do, where the published share is 25 %.

    True certificates fail the comparison of found and allowed worlds with a probability below 1e-4, all together. If 25 % of worlds exceed
    the margin, the test finds it with a probability of at least 0.96, and with 0.75 if 20 % do. A share of 10 % mostly remains unseen.
    """
    if row["study"] != "walker_transfer.py" and find_spec("robosuite") is None:
        pytest.skip("robosuite, whose arm this is, is not installed: make study-libraries")
    bound = greatest_share(int(row["violations"]), int(row["worlds"]), float(row["confidence"]))
    assert bound <= 1.0 - SHARE
    allowed = binom.isf(1e-4 / len(ROWS), WORLDS, bound)

    found = dict(violations(row, {"published": published(row), "nothing": {}}, WORLDS, SEED, tmp_path))
    assert found["published"] <= allowed
    # Elsewhere models without measurements err in a few worlds more than the bound allows, so that they prove nothing here.
    if int(row["unmeasured"]) >= 0.25 * int(row["worlds"]):
        assert found["nothing"] > allowed
