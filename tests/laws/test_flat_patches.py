"""Of the contacts of a flat patch those at its corners are kept: they carry all that the others could."""

import numpy as np
import pytest
import stepper

CAPSULES = 7


def sole(which: range, friction: str = "0.8", lift: float = 0.0) -> stepper.Model:
    """A body on a sole of parallel capsules side by side, every second of them higher by `lift`."""

    def capsule(k: int) -> str:
        size, pos = f"0.01 {0.07 if k in (0, CAPSULES - 1) else 0.06}", f"0 {0.02 * (k - 3)} {-0.05 + lift * (k % 2)}"
        mu = friction if k != 3 else "0.8"
        return f'<geom type="capsule" size="{size}" pos="{pos}" euler="0 90 0" friction="{mu} 0 0"/>'

    geoms = "".join(map(capsule, which))
    return stepper.load(
        '<mujoco><worldbody><geom type="plane" size="0 0 1" friction="0 0 0"/><body pos="0 0 0.06"><freejoint/>'
        f'<inertial pos="0 0 0.05" mass="2" diaginertia="0.02 0.015 0.01"/>{geoms}</body></worldbody></mujoco>'
    )


def slid(model: stepper.Model, velocity: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray, int]:
    """Where a sole is after half a second, its velocity, and its contacts on the way at the most."""
    sim = stepper.Stepper(model, num_envs=1, options=stepper.Options(tolerance=1e-6))
    sim.set_state(qvel=velocity)
    most = 0
    for _ in range(250):
        sim.step()
        most = max(most, len(sim.contacts()))
    return sim.qpos.copy(), sim.qvel.copy(), most


@pytest.mark.parametrize("velocity", [(0, 0, 0, 0, 0, 0), (0.5, 0.2, 0, 0, 0, 0), (0.4, 0, 0, 0, 0, 3.0)])
def test_a_sole_of_many_capsules_moves_as_its_corners(velocity):
    whole, corners = slid(sole(range(CAPSULES)), velocity), slid(sole(range(0, CAPSULES, CAPSULES - 1)), velocity)
    assert (whole[2], corners[2]) == (4, 4)
    # Contacts that touch are the same, those that are only near are not while a sole tips: steps are solved to 1e-6 m/s, for half a second.
    np.testing.assert_allclose(whole[0], corners[0], atol=1e-6)
    np.testing.assert_allclose(whole[1], corners[1], atol=1e-5)


def test_contacts_that_the_corners_do_not_replace_stay():
    assert slid(sole(range(CAPSULES), friction="0.5"), (0.5, 0, 0, 0, 0, 0))[2] == 6, "another coefficient of friction"
    assert slid(sole(range(CAPSULES), lift=-0.001), (0.0,) * 6)[2] > 4, "capsules below the plane of the others"
