"""The vehicle of the example tows sledges as momentum, Newton's law and Coulomb's law say."""

from pathlib import Path

import numpy as np
import pytest
import tow

# Heavier sledges stop while the vehicle brakes.
MASSES = np.array([2.0, 10.0, 15.0])


@pytest.mark.parametrize("brake", [40.0, 58.0, 60.0, 80.0])
def test_tow_is_that_of_the_theory(brake):
    """The rope is taut below mu M g = 58.86 N and slack above."""
    sim, found = tow.tow(MASSES, brake)
    expected = tow.theory(MASSES, brake)
    # The jerk takes two steps, in which the vehicle gains less than F / M times their length.
    np.testing.assert_allclose(found["jerk"], expected["jerk"], rtol=0, atol=2 * sim.timestep * tow.FORCE / tow.VEHICLE)
    # Forces of a sliding contact and a taut rope are exact up to the solver's tolerance.
    for name in ("pull", "brake"):
        np.testing.assert_allclose(found[name], expected[name], rtol=1e-6, atol=1e-6)
    # A rope at its limit is at most a micrometre from it, and the free motion is exact to half a step of the relative speed, 0.21 m/s.
    np.testing.assert_allclose(found["slack"], expected["slack"], rtol=0, atol=1e-6 + 0.11 * sim.timestep)
    assert (found["slack"] > 1e-4).all() == (brake > tow.FRICTION * tow.VEHICLE * tow.GRAVITY)


def test_the_page_has_the_table_that_the_command_prints(capsys):
    tow.main()
    assert capsys.readouterr().out in (Path(tow.__file__).parent / "README.md").read_text()
