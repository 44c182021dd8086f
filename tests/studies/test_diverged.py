"""Episodes that an engine loses: a state that is not finite, or MuJoCo that begins anew by itself. They are no success of anyone."""

import math

import numpy as np
import pytest
import stepper
from stepper.lab.accuracy.traces import Distance, run
from stepper.lab.study.failure_causes import DIVERGED

# MuJoCo's Euler rule takes a spring explicitly: its oscillation grows where kp dt^2 / I is above 4, and it is 4000 here. Stepper's midpoint
# rule takes it implicitly.
STIFF = """<mujoco model="stiff"><option timestep=".002"/><worldbody><body name="arm"><joint name="hinge" axis="0 1 0"/>
  <geom size=".01" pos="0 0 -.1" mass=".1"/></body></worldbody>
  <actuator><position name="servo" joint="hinge" kp="1e6"/></actuator></mujoco>"""
MEASURES = (
    stepper.lab.Outcome(name="angle", measure="joint hinge", success="> -1e9"),
    stepper.lab.Outcome(name="widest", measure="joint hinge", reduce="max"),
)


def study(**changed):
    """Whatever is finite is a success."""
    given = {"model": STIFF, "name": "stiff", "outcomes": MEASURES, "seconds": 0.1, "episodes": 3, "qvel_noise": 0.1}
    servo = stepper.lab.Parameter("actuator_kp", operation="scale", low=0.9, high=1.1)
    mass = stepper.lab.Parameter("body_mass", operation="scale", low=0.9, high=1.1)
    engines = {"MuJoCo": {"engine": "mujoco"}, "finer": {"engine": "mujoco", "timestep": 1e-5}}
    return stepper.lab.Study(**(given | {"parameters": {"stiffness": servo, "mass": mass}, "settings": engines} | changed))


def runaway(now):
    """Torque along the velocity, which each control makes many times as much."""
    return 1e4 * now.read("qvel", "hinge")


def test_episodes_that_mujoco_begins_anew_are_failures_of_physics(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = stepper.lab.report(study(parameters={}), tmp_path)
    lost = [row for row in found.sweep.table.rows if row["setting"] == "MuJoCo"]
    assert [row["success"] for row in lost] == [False] * 3
    assert all(math.isnan(value) for row in lost for value in row["outcomes"].values())
    assert {(v.row["setting"], v.cause, v.rule) for v in found.verdicts if v.row["setting"] == "MuJoCo"} == {
        ("MuJoCo", "physics", DIVERGED)
    }
    counts = {level.setting: (level.successes, level.unsolved, level.diverged) for level in found.sweep.levels}
    assert counts.items() >= {"stepper": (3, 0, 0), "finer": (3, 0, 0), "MuJoCo": (0, 3, 3)}.items()
    told = str(found)
    assert "Diverged, and so no success: 3 with MuJoCo" in told
    assert f"| physics | {DIVERGED} |" in told
    # MuJoCo's own handler writes there.
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists()


def test_episodes_that_stepper_loses_are_failures_of_physics(tmp_path):
    """Euler's rule goes on until a step is not finite, and keeps the state before it, which is a success by its number."""
    spring = STIFF.replace("position", "motor").replace(' kp="1e6"', "")
    found = stepper.lab.report(
        study(model=spring, controller=runaway, parameters={}, settings={}, options=stepper.Options(integrator="euler"), seconds=1.0),
        tmp_path,
    )
    assert {(v.cause, v.rule) for v in found.verdicts if v.row["setting"] in ("stepper", "MuJoCo")} == {("physics", DIVERGED)}
    assert {level.setting: level.diverged for level in found.sweep.levels}.items() >= {"stepper": 3, "MuJoCo": 3}.items()


def test_the_mean_is_of_the_episodes_that_went_on(tmp_path):
    """Those of even numbers are driven away."""
    spring = STIFF.replace("position", "motor").replace(' kp="1e6"', "")

    def some(now):
        return np.where(now.episodes[:, None] % 2 == 0, runaway(now), 0.0)

    euler = stepper.Options(integrator="euler")
    given = study(model=spring, controller=some, parameters={}, settings={}, options=euler, seconds=1.0)
    found = stepper.lab.sweep(given, tmp_path)
    (level,) = found.sweep.levels
    assert (level.successes, level.diverged, level.episodes) == (1, 2, 3)
    assert level.mean == found.sweep.table["outcome.angle"][1]
    assert level.change[0] == 0.0
    # What stands still, or begins anew, is infinitely far from everything.
    trace = run(given, range(3))
    assert np.isinf(Distance("m", 1.0)(trace, trace)).tolist() == [True, False, True]


def test_a_ranking_counts_or_names_them(tmp_path):
    ranked = study(episodes=1, settings={"MuJoCo": {"engine": "mujoco"}})
    with pytest.raises(ValueError, match=r"as many episodes succeed at all 8 points, 0% of them"):
        stepper.lab.rank(ranked, tmp_path, samples=2, setting="MuJoCo")
    angle = stepper.lab.Outcome(name="angle", measure="joint hinge")
    with pytest.raises(ValueError, match=r"angle is not finite in 8 of 8 episodes \(8 of them diverged\)"):
        stepper.lab.rank(study(episodes=1, outcomes=angle), tmp_path / "number", samples=2, setting="MuJoCo")
    # About the stiffness with which the spring of MuJoCo's Euler rule begins to grow: 4 I / dt^2.
    edge = STIFF.replace('kp="1e6"', f'kp="{4 * 0.1 * 0.1**2 / 0.002**2}"')
    found = stepper.lab.rank(study(model=edge, episodes=1, seconds=2.0), tmp_path / "edge", samples=4, setting="MuJoCo")
    lost = int(np.isnan(found.table["outcome.angle"]).sum())
    assert 0 < lost < 16
    assert f"{lost} of 16 episodes diverged, and count as failures" in str(found)


@pytest.mark.parametrize("setting", ["stepper", "MuJoCo"])
def test_controls_that_are_not_finite_are_the_drives(setting):
    def late(now):
        return np.where(now.time < 0.05, 0.0, np.where(now.episodes == 1, np.nan, 0.0))[:, None]

    given = study(model=STIFF.replace("1e6", "1"), controller=late, settings={"MuJoCo": {"engine": "mujoco"}})
    with pytest.raises(ValueError, match=r"late gives actuator 'servo' the control nan at 0\.06 s of episode 1: controls must be finite"):
        given.episode({}, 1, setting=setting)
