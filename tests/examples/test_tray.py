"""The tray's answers do not depend on the time step."""

import pytest
from tray import CASES, MASS, PUSH, G, push, threshold

DTS = sorted({0.001, 0.02, *(dt for _, dt in CASES)})


@pytest.mark.parametrize("dt", DTS)
@pytest.mark.parametrize("mu", [mu for mu, _ in CASES])
def test_it_holds_if_and_only_if_friction_can(mu, dt):
    done = push(mu, dt)
    expected = max(0.0, PUSH / MASS - mu * G)
    # Speed to a solver residual of 1e-6 m/s, after a second; one that stays stays exactly, but for rounding.
    assert done.acceleration == pytest.approx(expected, abs=1e-6 if expected else 1e-9)
    assert done.residual <= 1e-6


@pytest.mark.parametrize(("mu", "dt"), CASES)
def test_it_begins_to_slide_at_mu_n(mu, dt):
    # What tells sliding from rest is 1e-6 m/s after 0.2 s: 1.5e-6 N for 0.3 kg.
    assert threshold(mu, dt) == pytest.approx(mu * MASS * G, abs=3e-6)
