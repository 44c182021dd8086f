"""`stepper calibrate`: known smallest sets, certificates that hold and that fail, and fits to trajectories."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from checks import raises
from stepper import lab
from stepper.lab.calibration.fit import bootstrap, fit
from stepper.lab.calibration.search import (
    SHARE,
    UNMEASURED,
    Array,
    Certificate,
    Search,
    Space,
    Trial,
    confidence_of,
    worlds_for,
)
from stepper.lab.study.intervals import greatest_share, least_share

MARGIN, SEEDS, WORLDS = 0.1, 40, 208
SPACE = Space(np.zeros(6), np.ones(6), np.full(6, 0.5))
MODEL = '<mujoco><worldbody><body><joint type="slide"/><geom size=".1"/></body></worldbody></mujoco>'


def additive(x: Array) -> Array:
    """Sum in which two parameters matter, and two others add less than half the margin together."""
    return np.asarray(2.0 * x[:, 0] + x[:, 1] + 0.04 * x[:, 2] + 0.04 * x[:, 3])


def interacting(x: Array) -> Array:
    """Product in which neither of two parameters matters if the other is nominal, plus a third parameter."""
    return np.asarray(4.0 * (x[:, 0] - 0.5) * (x[:, 1] - 0.5) + x[:, 2])


def cliff(x: Array) -> Array:
    """Success that ends steeply where the sum of two parameters exceeds 1.2; far from there nothing matters."""
    return np.asarray(1.0 / (1.0 + np.exp((x[:, 0] + 0.5 * x[:, 1] - 1.2) / 0.02)))


def difference(outcome: Callable[[Array], Array]) -> Callable[[Array, Array], Array]:
    """Difference of an outcome between worlds and models."""
    return lambda worlds, models: np.abs(outcome(worlds) - outcome(models))


def searched(outcome: Callable[[Array], Array], seed: int, importance: Array | None = None) -> Search:
    """Search with a known outcome."""
    weights = np.arange(6.0) if importance is None else importance
    return Search(difference(outcome), SPACE, MARGIN, weights, count=WORLDS, rng=np.random.default_rng(seed))


KNOWN = [(additive, {0, 1}), (interacting, {0, 1, 2}), (cliff, {0, 1})]


@pytest.mark.parametrize(("outcome", "truth"), KNOWN, ids=lambda known: getattr(known, "__name__", ""))
def test_the_search_finds_known_smallest_sets(outcome: Callable[[Array], Array], truth: set[int]) -> None:
    """The set is the known one in at least 95 % of seeds, even if the order of importance is wrong."""
    assert [set(searched(outcome, seed).smallest()) for seed in range(SEEDS)].count(truth) >= 0.95 * SEEDS


@pytest.mark.parametrize(("outcome", "truth"), KNOWN, ids=lambda known: getattr(known, "__name__", ""))
def test_certificates_hold_on_fresh_worlds(outcome: Callable[[Array], Array], truth: set[int]) -> None:
    """Whenever a certificate of the found tolerances holds, at most 5 % of 20,000 fresh worlds exceed the margin, in 95 % of the seeds."""
    # With 20,000 worlds the standard error of a fraction of 5 % is 0.15 %.
    right = tried = 0
    for seed in range(20):
        search = searched(outcome, seed)
        tolerances = search.widest(search.smallest())
        certificate = Certificate(search.trial(tolerances, *SPACE.draw(np.random.default_rng([seed, 1]), WORLDS)), 0.95, 1, 1)
        if certificate.holds:
            tried += 1
            many = search.trial(tolerances, *SPACE.draw(np.random.default_rng([seed, 2]), 20_000))
            right += many.violations <= (1.0 - SHARE + 0.003) * many.worlds
    assert tried >= 10
    assert right >= 0.95 * tried


def test_tolerances_of_an_additive_outcome_are_the_widest() -> None:
    """For the additive outcome, errors of 2 a and b must stay within what the two unmeasured parameters leave of the margin."""
    # These add at most 0.04, so that 2 a + b <= 0.06 always passes, and 2 a + b > 0.14 always fails where the signs agree.
    for seed in range(5):
        search = searched(additive, seed)
        tolerances = search.widest(search.smallest())
        assert 2.0 * tolerances[0] + tolerances[1] <= 0.14
        doubled = [np.where(np.arange(6) == k, 2.0 * tolerances, tolerances) for k in (0, 1)]
        assert not any(search.passes(other) for other in doubled)


def test_a_certificate_that_should_fail_does() -> None:
    """With a true fraction of 10 % of worlds above the margin, a certificate of 208 worlds holds by chance with a probability below 1 %."""
    # In 40 seeds the probability of two or more such certificates is below 6 %; the seeds are fixed, and none occurs.
    outcome = lambda x: (x[:, 0] < 0.1).astype(float)  # noqa: E731
    for seed in range(SEEDS):
        search = searched(outcome, seed)
        trial = search.trial(np.full(6, UNMEASURED), *SPACE.draw(np.random.default_rng([seed, 3]), WORLDS))
        assert not Certificate(trial, 0.95, 1, 1).holds


def test_certificates_at_the_limit_err_in_five_percent() -> None:
    """With exactly 5 % of worlds above the margin, the probability that a certificate holds is at most 1 - confidence."""
    rng = np.random.default_rng(0)
    for confidence in (0.95, confidence_of(3)):
        counts = rng.binomial(59, 0.05, 4000)
        holding = [Certificate(Trial(int(v), 59, np.zeros(59)), confidence, 1, 1).holds for v in counts]
        # Four standard errors of a fraction of 5 % of 4,000 are 1.4 %.
        assert np.mean(holding) <= 1.0 - confidence + 0.014


def test_numbers_of_worlds_are_those_of_the_binomial_bound() -> None:
    """59 worlds without a violation certify 95 % with 95 % confidence; n trajectories without one certify 0.05^(1/n)."""
    assert worlds_for(0, 1) == 59
    assert greatest_share(0, 59) <= 0.05 < greatest_share(0, 58)
    assert greatest_share(worlds := 0, worlds_for(0, 3), confidence_of(3)) <= 0.05
    assert worlds == 0
    assert pytest.approx(least_share(20, 20), rel=1e-12) == 0.05 ** (1 / 20)
    assert Trial(0, 59, np.arange(59.0)).quantile(0.95) == 58.0


def test_models_of_worlds_stay_within_the_ranges() -> None:
    """Measured values differ from the true ones by exactly the tolerance, or less at both ends; others are nominal."""
    worlds, signs = SPACE.draw(np.random.default_rng(0), 500)
    models = SPACE.model(worlds, signs, np.array([0.25, 0.0, UNMEASURED, 0.01, 0.5, UNMEASURED]))
    assert (models >= 0.0).all()
    assert (models <= 1.0).all()
    assert np.allclose(np.abs(models - worlds)[:, :2], [0.25, 0.0], atol=1e-15)
    assert (models[:, [2, 5]] == 0.5).all()


def test_fit_finds_the_bottom_of_a_rough_loss() -> None:
    """The fit of a parabola with ripples of a tenth of its depth is near the bottom, for all seeds."""

    def loss(samples: Array) -> Array:
        ripples = 0.05 * np.sin(80.0 * samples).sum(axis=1)
        return np.asarray(((samples - 0.3) ** 2).sum(axis=1) + ripples)

    for seed in range(10):
        found = fit(loss, np.zeros(2), np.ones(2), seed=seed)
        # The ripples have a period of 0.079; 0.12 covers the neighbours of the lowest ripple.
        assert np.abs(found.values - 0.3).max() < 0.12
    raises(ValueError, "narrow the bounds", fit, lambda samples: np.full(len(samples), np.nan), np.zeros(2), np.ones(2))


def test_a_fit_that_starts_at_given_values_is_never_worse() -> None:
    """The search improves a start beside the bottom, and keeps a start in a hole that it cannot find, 0.001 wide."""
    start, hole = np.array([0.4, 0.25, 0.3]), np.array([0.8, 0.9, 0.7])

    def bowl(samples: Array) -> Array:
        return np.asarray(((samples - 0.3) ** 2).sum(axis=1))

    def deep(samples: Array) -> Array:
        return bowl(samples) - 2.0 * (np.abs(samples - hole).max(axis=1) < 0.0005)

    for seed in range(10):
        improved = fit(bowl, np.zeros(3), np.ones(3), seed=seed, start=start)
        assert improved.loss < 0.5 * bowl(start[None])[0]
        kept = fit(deep, np.zeros(3), np.ones(3), seed=seed, start=hole)
        assert np.array_equal(kept.values, hole)
        assert kept.loss == deep(hole[None])[0]


def test_bootstrap_covers_the_mean() -> None:
    """95 % intervals of the mean of 50 normal numbers cover it in 89 to 99 % of 200 samples, four standard errors around 94 %."""
    rng = np.random.default_rng(0)
    covered = [low <= 0.0 <= high for low, high in (bootstrap(rng.standard_normal(50), resamples=400) for _ in range(200))]
    assert 0.87 <= np.mean(covered) <= 1.0


def toy(**changed: object) -> lab.Study:
    """Study in which success depends on slope and wind, and not on colour."""
    study = lab.Study(
        name="toy",
        model=MODEL,
        outcomes=lab.Outcome(
            name="climbed",
            measure=lambda now: now.parameters["slope"] + 0.5 * now.parameters["wind"] + 0.1 * now.episodes / 8.0,
            success="<= 0.8",
        ),
        parameters={name: lab.Parameter("controller", nominal=0.5, low=0.0, high=1.0) for name in ("colour", "slope", "wind")},
        seconds=0.002,
        control=0.002,
        episodes=8,
        batch=4096,
    )
    return replace(study, **changed)  # type: ignore[arg-type]


def test_calibrate_a_study(tmp_path: Path) -> None:
    """The set of a study is the known one, its certificate holds on worlds that this test draws, and a second run repeats no episode."""
    found = lab.calibrate(toy(), tmp_path, margin=0.3, samples=32, worlds=93, tries=2)
    assert {own.name for own in found.parameters} == {"slope", "wind"}
    assert found.unmeasured == ("colour",)
    assert found.holds
    assert found.nominal.violations > 5
    assert found.doubled.violations > found.certificates[-1].trial.violations

    def share(slope: Array, wind: Array) -> Array:
        climbed = slope[:, None] + 0.5 * wind[:, None] + 0.1 * np.arange(8) / 8.0
        return np.asarray((climbed <= 0.8).mean(axis=1))

    rng = np.random.default_rng(12345)
    truth, signs = rng.uniform(size=(20_000, 2)), rng.choice([-1.0, 1.0], (20_000, 2))
    tolerance = {own.name: own.tolerance for own in found.parameters}
    errors = signs * [tolerance["slope"], tolerance["wind"]]
    model = truth + np.where((truth + errors < 0.0) | (truth + errors > 1.0), -errors, errors)
    # 0.05 is the claim. The standard error of the fraction of 20,000 worlds is 0.0015.
    assert (np.abs(share(*truth.T) - share(*model.T)) > 0.3 + 1e-9).mean() <= 0.05
    stored = json.loads((tmp_path / "toy/calibrate.json").read_text())
    assert stored["holds"]
    assert set(stored["measure"]) == {"slope", "wind"}
    text = (tmp_path / "toy/calibrate.md").read_text()
    assert "To measure: slope, wind." in text
    assert "What was assumed" in text

    again = lab.calibrate(toy(), tmp_path, margin=0.3, samples=32, worlds=93, tries=2)
    assert again.document.markdown() == found.document.markdown()
    assert len(again.table) == len(found.table)


def test_given_tolerances_are_certified_without_a_search(tmp_path: Path) -> None:
    """Tolerances that are fine enough get a certificate for exactly these, and those of a set without the slope get none."""
    found = lab.calibrate(toy(), tmp_path, margin=0.3, samples=16, worlds=93, tolerances={"wind": 0.02, "slope": 0.01})
    assert found.holds
    assert {own.name: own.tolerance for own in found.parameters} == pytest.approx({"wind": 0.02, "slope": 0.01})
    assert len(found.certificates) == 1
    assert found.certificates[0].confidence == 0.95
    assert "given, not searched" in (tmp_path / "toy/calibrate.md").read_text()
    without = lab.calibrate(toy(), tmp_path, margin=0.3, samples=16, worlds=93, tolerances={"wind": 0.02})
    # The slope alone decides in which of the worlds around the threshold success ends.
    assert not without.holds
    for tolerances, text in (({"gust": 0.1}, "no parameters that vary"), ({"wind": 0.0}, "tolerance of wind")):
        with pytest.raises(ValueError, match=text):
            lab.calibrate(toy(), tmp_path, margin=0.3, samples=16, worlds=93, tolerances=tolerances)


def test_parameters_that_do_not_vary_are_nominal(tmp_path: Path) -> None:
    """A parameter that is left out of a calibration has its nominal value in worlds and models, not that of the model."""
    outcome = lab.Outcome(name="climbed", measure=lambda now: now.parameters["slope"] + 2.0 * (now.parameters["colour"] != 0.5))
    study = toy(name="left_out", outcomes=outcome)
    found = lab.calibrate(study, tmp_path, margin=0.2, samples=16, worlds=59, parameters=["slope", "wind"], tolerances={"slope": 0.1})
    assert found.holds
    assert all(row["parameters"]["colour"] == 0.5 and row["outcomes"]["climbed"] <= 1.0 for row in found.table.rows)


def test_calibrate_a_number(tmp_path: Path) -> None:
    """Without a condition of success, errors of episodes do not cancel: a parameter that acts with opposite signs must be measured."""
    outcome = lab.Outcome(name="drift", measure=lambda now: np.where(now.episodes % 2, 1.0, -0.9) * now.parameters["wind"])
    study = toy(name="drift", outcomes=outcome, parameters={name: toy().parameters[name] for name in ("slope", "wind")})
    found = lab.calibrate(study, tmp_path, margin=0.2, samples=16, worlds=59, tries=1)
    assert [own.name for own in found.parameters] == ["wind"]
    # The mean absolute difference is 0.95 of the error, so tolerances up to 0.21 always pass, and 0.125 is the next power of 2.
    assert found.parameters[0].tolerance == 0.125


def test_calibrate_on_trajectories(tmp_path: Path) -> None:
    """A parameter that explains trajectories is in the set, one that does not is left out, and the claim is 0.05^(1/n)."""
    truth = 0.8

    def error(now: lab.World) -> Array:
        return np.abs(now.parameters["slope"] - truth) + 0.001 * now.parameters["colour"] + 0.01 * (now.episodes % 3)

    study = toy(
        name="recorded",
        outcomes=lab.Outcome(name="error", measure=error, unit="m"),
        parameters={name: toy().parameters[name] for name in ("colour", "slope")},
        episodes=24,
    )
    found = lab.calibrate_on_trajectories(study, tmp_path, fitted=12, margin=0.02)
    assert found.chosen.names == ("slope",)
    # The loss is a cone, whose bottom the elite brackets; the margin is 0.02.
    assert found.chosen.fit.values[0] == pytest.approx(truth, abs=0.02)
    assert found.violations == 0
    assert found.share == pytest.approx(0.05 ** (1 / 12), rel=1e-9)
    assert "To fit: slope." in (tmp_path / "recorded/trajectories.md").read_text()


@pytest.mark.parametrize(("changed", "text"), [
    ({"margin": 0.0}, "margin"),
    ({"margin": 0.1, "worlds": 58, "tries": 1}, "at least 59"),
    ({"margin": 0.1, "samples": 3}, "power of 2"),
])  # fmt: skip
def test_wrong_arguments(tmp_path: Path, changed: dict[str, float], text: str) -> None:
    """Errors name the argument and what it must be."""
    with pytest.raises(ValueError, match=text):
        lab.calibrate(toy(), tmp_path, **changed)  # type: ignore[arg-type]
    raises(ValueError, "fitted is 8", lambda: lab.calibrate_on_trajectories(toy(), tmp_path, fitted=8, margin=0.1))


def test_outcomes_that_jump_have_no_tolerance() -> None:
    """An outcome that is a hash of a parameter passes with no tolerance, and the error has a remedy."""
    search = searched(lambda x: (x[:, 0] * 1e7 * np.sqrt(2.0)) % 1.0, 0)
    raises(ValueError, "jumps or is chaotic", search.widest, [0])
