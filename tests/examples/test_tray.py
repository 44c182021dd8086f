"""Examples: trays, pushes, tows, hands and suction cups do what the textbook and the page of the examples say."""

from pathlib import Path

import identified_cheetah
import noisy_joints
import numpy as np
import push
import pytest
import stepper
import suction
import tendon_hand
import tow
import tray
from dm_control.suite import cartpole
from identified_cheetah import FRICTION, identified, nominal, recorded, returns, robot
from noisy_joints import IDEAL, NOISY, STEPS, scores
from tray import CASES, MASS, PUSH, G, threshold

DTS = sorted({0.001, 0.02, *(dt for _, dt in CASES)})
# Heavier sledges stop while the vehicle brakes.
MASSES = np.array([2.0, 10.0, 15.0])
LIFTED_MASSES = np.linspace(0.5, 2.5, 101)


@pytest.mark.parametrize("dt", DTS)
@pytest.mark.parametrize("mu", [mu for mu, _ in CASES])
def test_it_holds_if_and_only_if_friction_can(mu, dt):
    done = tray.push(mu, dt)
    expected = max(0.0, PUSH / MASS - mu * G)
    # Speed to a solver residual of 1e-6 m/s, after a second; one that stays stays exactly, but for rounding.
    assert done.acceleration == pytest.approx(expected, abs=1e-6 if expected else 1e-9)
    assert done.residual <= 1e-6


@pytest.mark.parametrize(("mu", "dt"), CASES)
def test_it_begins_to_slide_at_mu_n(mu, dt):
    # What tells sliding from rest is 1e-6 m/s after 0.2 s: 1.5e-6 N for 0.3 kg.
    assert threshold(mu, dt) == pytest.approx(mu * MASS * G, abs=3e-6)


def test_the_box_comes_to_the_goal():
    plan = push.push(verbose=False)
    # It begins 0.16 m away; examples/README.md says 1 mm.
    assert np.linalg.norm(plan.qpos[-1, :2] - [0.15, 0.06]) < 5e-3


@pytest.mark.parametrize("tension", [10.0, 40.0])
def test_the_largest_balls_are_those_of_the_page(tension):
    masses = np.linspace(0.01, 0.6, 60)
    still, shaken = tendon_hand.largest(tension, masses)
    line = f"| {tension:.0f} N | {still:.2f} kg | {shaken:.2f} kg |"
    assert line in (Path(tendon_hand.__file__).parent / "README.md").read_text(encoding="utf-8")
    assert masses[0] < still < masses[-1]


def test_a_ball_that_is_held_rests_in_the_hand():
    sim, moved = tendon_hand.hold(np.array([0.2]), 40.0)
    # At rest the ball does not move against the hand by more than a contact's slop, 0.1 mm.
    assert moved[0, 0] < 1e-4
    assert sim.status == 0


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


def thresholds(sideways: float, contact: str = "hard") -> list[float]:
    """Largest masses that are lifted and carried, kg."""
    _, moved = suction.pick(LIFTED_MASSES, sideways, stepper.Options(contact=contact))
    return [LIFTED_MASSES[moved[:, column] < suction.STAYS].max(initial=0.0) for column in (0, 1)]


@pytest.mark.parametrize("sideways", [2.0, 3.0, 4.0])
def test_thresholds_are_those_of_the_theory(sideways):
    lifted, carried = thresholds(sideways)
    step = LIFTED_MASSES[1] - LIFTED_MASSES[0]
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


@pytest.mark.parametrize("seed", range(3))
def test_perfect_sensors_inflate_the_score(seed):
    ideal, noisy = scores(IDEAL, seed, 16), scores(NOISY, seed, 16)
    # With ideal sensors the pole stands: all but a thousandth of the score, in every episode.
    assert ideal.min() > 0.99 * STEPS
    # 0.01 rad are 1.4 rad/s on a rate that is a difference over 10 ms: the controller loses in every episode, from the same starts, and by
    # ten standard errors on the mean.
    lost = ideal - noisy
    assert lost.min() > 0
    assert lost.mean() > 10 * lost.std() / np.sqrt(len(lost))


def test_it_is_reproducible():
    first, again, other = scores(NOISY, 7, 8), scores(NOISY, 7, 8), scores(NOISY, 8, 8)
    np.testing.assert_array_equal(first, again)
    assert not np.any(first == other)
    assert noisy_joints.table(range(1)) == noisy_joints.table(range(1))


class Physics:
    """What dm_control's task asks of its physics, of one state."""

    def __init__(self, qpos, qvel, ctrl):
        self.cart_position = lambda: qpos[0]
        self.pole_angle_cosine = lambda: np.cos(qpos[1:])
        self.angular_vel = lambda: qvel[1:]
        self.control = lambda: ctrl


def test_the_reward_is_dm_controls():
    task = cartpole.Balance(swing_up=False, sparse=False, random=0)
    rng = np.random.default_rng(0)
    for _ in range(100):
        qpos, qvel, ctrl = rng.normal(size=2), 3 * rng.normal(size=2), rng.uniform(-1, 1, 1)
        found = noisy_joints.reward(qpos[None], qvel[None], ctrl)
        np.testing.assert_allclose(found, task.get_reward(Physics(qpos, qvel, ctrl)), rtol=1e-14)


def test_what_is_identified_is_the_robot_and_can_be_drawn_from(tmp_path):
    recorded(tmp_path / "run", runs=1)
    found = identified(tmp_path / "run")
    mass, friction = found.interval(0.999)
    # The model is far outside of what is said, the robot inside.
    assert mass[0] < identified_cheetah.MASS < mass[1]
    assert friction[0] < FRICTION < friction[1]
    assert mass[0] > nominal().body("torso").mass
    assert friction[1] < nominal().geom_friction[0][0]
    total = returns(found.sample(4), episodes=4, actions=5)
    assert total.shape == (4,)
    # The draws are what runs: other returns than the model's from the same starts.
    assert (total != returns({}, episodes=4, actions=5)).all()
    assert robot(nominal()).body("torso").mass == identified_cheetah.MASS
