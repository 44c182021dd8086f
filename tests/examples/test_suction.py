"""The suction cup of the example lifts and carries what Coulomb's law and Newton's law allow."""

import numpy as np
import pytest
import stepper
import suction

MASSES = np.linspace(0.5, 2.5, 101)


def thresholds(sideways: float, contact: str = "hard") -> list[float]:
    """Largest masses that are lifted and carried, kg."""
    _, moved = suction.pick(MASSES, sideways, stepper.Options(contact=contact))
    return [MASSES[moved[:, column] < suction.STAYS].max(initial=0.0) for column in (0, 1)]


@pytest.mark.parametrize("sideways", [2.0, 3.0, 4.0])
def test_thresholds_are_those_of_the_theory(sideways):
    lifted, carried = thresholds(sideways)
    step = MASSES[1] - MASSES[0]
    assert lifted == pytest.approx(suction.FORCE / (suction.GRAVITY + suction.LIFT), abs=step)
    # A box that slides by 2 mm in 0.2 s accelerates by 0.1 m/s^2 relative to the cup, by which the threshold of the mass is blurred.
    theory = suction.FRICTION * suction.FORCE / (sideways + suction.FRICTION * suction.GRAVITY)
    blur = theory * 0.1 / (sideways + suction.FRICTION * suction.GRAVITY)
    assert carried == pytest.approx(theory, abs=step + blur)


def test_mujocos_law_lifts_the_same_and_creeps():
    lifted, carried = thresholds(3.0, "mujoco")
    assert lifted == pytest.approx(suction.FORCE / (suction.GRAVITY + suction.LIFT), abs=0.03)
    assert carried == 0


def test_the_picture_of_readme():
    """The figures on the page of the examples are those that the command prints."""
    page = (suction.__file__.rsplit("/", 1)[0]) + "/README.md"
    _, moved = suction.pick(np.linspace(0.5, 2.5, 201))
    found = [np.linspace(0.5, 2.5, 201)[moved[:, column] < suction.STAYS].max() for column in (0, 1)]
    with open(page) as text:
        assert f"| hard | {found[0]:.2f} kg | {found[1]:.2f} kg |" in text.read()
