"""A study that knows what is right: chart and tune measure from its closed form, and converge nothing."""

import math
import sys
from dataclasses import replace

import numpy as np
import pytest
import stepper
from stepper.lab.accuracy.candidates import lines
from stepper.lab.accuracy.measure import ChartBasis, measure
from stepper.lab.accuracy.reference import closed_form, converge, reference_of
from stepper.lab.accuracy.traces import Distance, run

MU, G = 0.5, 9.81
BLOCK = f"""<mujoco><option timestep=".005"/><worldbody><geom name="floor" type="plane" size="9 9 1" friction="{MU} 0 0"/>
  <body name="block" pos="0 0 .05"><joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>
  <geom type="box" size=".1 .1 .05" friction="{MU} 0 0"/></body></worldbody></mujoco>"""


def thrown(now, generators):
    """Along the floor, at half a metre a second and more."""
    qvel = np.zeros((now.num_envs, now.model.nv))
    qvel[:, 0] = [0.5 + 0.5 * g.random() for g in generators]
    return np.zeros((now.num_envs, now.model.nq)), qvel


def slides(now, time):
    """Friction takes mu g until the block stands."""
    begun = now.qvel[:, 0]
    t = np.minimum(time[:, None], begun / (MU * G))
    qpos, qvel = np.zeros((len(time), now.num_envs, 2)), np.zeros((len(time), now.num_envs, 2))
    qpos[..., 0] = now.qpos[:, 0] + begun * t - 0.5 * MU * G * t**2
    qvel[..., 0] = begun - MU * G * t
    return qpos, qvel


def block(**changed):
    way = stepper.lab.Outcome(name="way", measure="joint x", success=">= 0.03", unit="m")
    return stepper.lab.Study(
        **({"model": BLOCK, "name": "block", "seconds": 0.3, "start": thrown, "exact": slides, "outcomes": way} | changed)
    )


def test_a_closed_form_is_a_trace_with_its_outcomes():
    study = block()
    trace = closed_form(study, range(3))
    assert trace.reached == pytest.approx(0.3)
    begun = np.array([0.5 + 0.5 * g.random() for g in study.generators(range(3))])
    np.testing.assert_allclose(trace.outcomes["way"], begun**2 / (2 * MU * G), rtol=1e-12)
    np.testing.assert_allclose(trace.points[-1, :, 1, 0], begun**2 / (2 * MU * G), rtol=1e-12)
    # What is converged comes to the same, as well as it says.
    found = converge(replace(study, exact=None), range(3), Distance("m", 0.3), target=1e-6)
    assert np.all(Distance("m", 0.3)(found.trace, trace) <= 3.0 * found.uncertainty + 1e-9)


def test_a_chart_measures_from_it(tmp_path, monkeypatch):
    study = block()
    monkeypatch.setattr(sys.modules["stepper.lab.accuracy.chart"], "lines", lambda study, **given: lines(study, **given)[:2])
    found = stepper.lab.chart(study, tmp_path, quick=True, episodes=3)
    assert found.reference.exact
    assert "Reference: the closed form" in found.document.markdown()
    assert "its last two runs" not in found.document.markdown()
    # Known to the end, without a horizon.
    assert found.distance.horizon == pytest.approx(0.3)
    np.testing.assert_array_equal(found.reference.uncertainty, 0.0)
    (dot,) = [dot for dot in found.dots if dot.setting == "midpoint" and dot.timestep == 0.005]
    right, own = closed_form(study, range(3)), run(study, range(3), timestep=0.005)
    assert dot.error == pytest.approx(float(np.median(Distance("m", 0.3)(own, right))), abs=1e-12)
    # A box that slides does not tip over, so all of it is where friction ends within a step: at most half of mu g h^2.
    assert dot.error < 0.5 * MU * G * 0.005**2
    assert dot.outcome == pytest.approx(float(own.outcomes["way"].mean()), abs=1e-12)


def test_hard_contact_alone_is_measured_from_it_as_its_own_law():
    """MuJoCo's law, which lets a block creep and sink, is still converged, and the model's part of its error is from the closed form."""
    study, distance = replace(block(), threads=1), Distance("m", 0.3)
    right = reference_of(study, range(2), distance, target=1e-4)
    soft = [line for line in lines(study, quick=True) if line.law == "mujoco" and line.engine == "stepper"][:1]
    points, _, laws = measure(ChartBasis(study, range(2), distance, right, 3), soft, [0.005], lambda *_: None)
    assert not next(iter(laws.values())).exact
    assert points[0].errors["model"].min() > 1e-4


def test_a_tuning_is_proved_by_it(tmp_path):
    found = stepper.lab.tune(block(), tmp_path, error="0.2 mm", horizon="0.3 s", coverage=0.7, reduce=False)
    assert found.chosen is not None
    assert found.trials[-1].unknown == 0
    study = replace(block(), options=found.options, precision=found.precision)
    fresh = range(1000, 1020)
    apart = Distance("m", 0.3)(run(study, fresh), closed_form(study, fresh))
    assert np.count_nonzero(apart <= 2e-4) >= 14


def test_files_name_it(tmp_path):
    (tmp_path / "block.xml").write_text(BLOCK)
    (tmp_path / "known.py").write_text("def slides(now, time):\n    return None\n")
    (tmp_path / "block.toml").write_text('model = "block.xml"\nexact = "known.py:slides"\n')
    study = stepper.lab.Study.from_file(tmp_path / "block.toml")
    with pytest.raises(ValueError, match=r"block: exact, known\.py:slides, gives NoneType, must give two arrays, qpos and qvel"):
        closed_form(study, range(1))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda now, time: (slides(now, time)[0], slides(now, time)[1][1:]), r"qvel of shape \(15, 2, 2\), must be .*: \(16, 2, 2\)"),
        (
            lambda now, time: (slides(now, time)[0] + 1e-3, slides(now, time)[1]),
            r"begins 0\.001 away from the initial qpos of the episodes",
        ),
        (lambda now, time: (slides(now, time)[0] * math.nan, slides(now, time)[1]), "gives qpos that is not finite"),
    ],
)
def test_what_is_no_closed_form_of_the_episodes_is_named(wrong, message):
    with pytest.raises(ValueError, match=message):
        closed_form(block(exact=wrong), range(2))
    with pytest.raises(TypeError, match="exact is 'known', must be a function"):
        block(exact="known")
