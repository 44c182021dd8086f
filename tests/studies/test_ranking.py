"""Rankings: indices of functions whose indices are known, studies that cannot be ranked, the command."""

import numpy as np
import pytest
import stepper
from stepper.lab.study.journal import JOURNAL, rows_of
from typer.testing import CliRunner

BALL = '<mujoco><worldbody><body name="ball"><freejoint/><geom size=".1"/></body></worldbody></mujoco>'
# Ishigami's function, with a = 7 and b = 0.1: T. Ishigami and T. Homma, "An importance quantification technique in uncertainty analysis for
# computer models" (1990); its indices in Saltelli's "Sensitivity analysis" (2000), table 2.8.
FIRST, TOTAL = (0.3139, 0.4424, 0.0), (0.5576, 0.4424, 0.2437)


def ishigami(now):
    x, y, z = (np.asarray(now.parameters[name], float) for name in "xyz")
    return np.sin(x) + 7.0 * np.sin(y) ** 2 + 0.1 * z**4 * np.sin(x)


def of(measure, success=None, **changed):
    ranges = {name: stepper.lab.Parameter("controller", nominal=0.0, low=-np.pi, high=np.pi, unit="rad") for name in "xyz"}
    outcome = stepper.lab.Outcome(name="value", measure=measure, success=success)
    given = {"model": BALL, "name": "known", "outcomes": outcome, "parameters": ranges, "seconds": 0.002, "control": 0.002, "episodes": 1}
    return stepper.lab.Study(**(given | changed))


def test_indices_of_ishigamis_function(tmp_path):
    found = stepper.lab.rank(of(ishigami), tmp_path, samples=512)
    by_name = {own.parameter: own for own in found.ranks}
    assert [own.parameter for own in found.ranks] == ["x", "y", "z"]
    for name, first, total in zip("xyz", FIRST, TOTAL, strict=True):
        own = by_name[name]
        # The bootstrap's 95 % interval at 512 points is some 0.1 wide; half of that more, since one in twenty lies outside.
        assert own.first_interval[0] - 0.05 <= first <= own.first_interval[1] + 0.05
        assert own.total_interval[0] - 0.05 <= total <= own.total_interval[1] + 0.05
        assert own.total_interval[0] < own.total < own.total_interval[1]
    # z acts through x alone, whose thirds it does not move: the mean of the function is a / 2.
    assert found.outcome == pytest.approx(3.5, abs=0.3)
    assert by_name["z"].thirds == pytest.approx([3.5] * 3, abs=0.6)
    assert len(found.table) == 512 * 5


def test_a_success_is_ranked_by_its_share_and_nothing_is_run_twice(tmp_path):
    """A half of the range of x succeeds, whatever the others are."""
    study = of(lambda now: np.asarray(now.parameters["x"], float), success="> 0")
    found = stepper.lab.rank(study, tmp_path, samples=32)
    first, *others = found.ranks
    assert first.parameter == "x"
    assert first.total == pytest.approx(1.0, abs=0.3)
    assert all(own.total == own.first == 0.0 for own in others)
    # A third of the range on either side has one outcome; Wilson's interval never ends at certainty.
    assert (first.thirds[0], first.thirds[2]) == (0.0, 1.0)
    assert first.intervals[0][1] > 0.0
    journal = rows_of(tmp_path / "known" / JOURNAL)
    assert stepper.lab.rank(study, tmp_path, samples=32).ranks == found.ranks
    assert rows_of(tmp_path / "known" / JOURNAL) == journal
    for name in ("rank.html", "rank.md", "rank.png", "rank_table.csv", "rank_table.npz"):
        assert (tmp_path / "known" / name).stat().st_size > 500
    assert "in rank_table.csv" in (tmp_path / "known/rank.md").read_text()


def test_the_table_of_a_sweep_stays(tmp_path):
    study = of(lambda now: np.asarray(now.parameters["x"], float), success="> 0")
    stepper.lab.sweep(study, tmp_path, cliffs=False)
    before = [(tmp_path / "known" / name).read_bytes() for name in ("table.csv", "table.npz")]
    stepper.lab.rank(study, tmp_path, samples=4)
    assert [(tmp_path / "known" / name).read_bytes() for name in ("table.csv", "table.npz")] == before


@pytest.mark.parametrize(("study", "given", "message"), [
    (of(ishigami), {"samples": 48}, "samples is 48, must be a power of 2"),
    (
        of(lambda now: np.asarray(now.parameters["x"], float) * np.asarray(now.parameters["y"], float), success="> 4", seed=4),
        {"samples": 2},
        "the outcome is the same at all 4 independent points and differs at others",
    ),
    (of(ishigami), {"parameters": ["w"]}, "there is no parameter 'w', there are: x, y, z; or give a selector with its range"),
    (of(ishigami), {"parameters": ["x"]}, "1 parameter with low and high, must have at least 2"),
    (of(ishigami), {"setting": "fast"}, "no settings 'fast'"),
    (of(ishigami, outcomes=None), {}, "no outcome"),
    (of(lambda now: np.zeros(now.num_envs)), {"samples": 2}, "value is the same at all 10 points"),
    (of(ishigami, success="> 1e9"), {"samples": 2}, "as many episodes succeed at all 10 points, 0% of them by value > 1e9, so that no"),
    (of(lambda now: np.log(np.asarray(now.parameters["x"], float))), {"samples": 4}, "value is not finite in"),
    (
        of(ishigami, parameters={"step": stepper.lab.Parameter("options.timestep", low=0.001, high=0.002)}),
        {"parameters": ["step"]},
        "is an option of the step",
    ),
])  # fmt: skip
@pytest.mark.filterwarnings("ignore:invalid value encountered in log")
def test_what_cannot_be_ranked_is_named(tmp_path, study, given, message):
    with pytest.raises(ValueError, match=message):
        stepper.lab.rank(study, tmp_path, **given)


def test_the_command(tmp_path, monkeypatch):
    from stepper.cli.app import application

    monkeypatch.chdir(tmp_path)
    (tmp_path / "ball.xml").write_text(BALL.replace('<geom size=".1"/>', '<geom name="ball" size=".1"/>'))
    (tmp_path / "fall.toml").write_text("""
model = "ball.xml"
seconds = 0.1
episodes = 1
[[outcomes]]
name = "fall"
measure = "body ball z"
[parameters.gravity]
selector = "gravity[2]"
low = -10.0
high = -1.0
[parameters.mass]
selector = "body_mass"
operation = "scale"
low = 0.5
high = 2.0
""")
    told = CliRunner().invoke(application(), ["rank", "fall.toml", "--samples", "16"])
    assert told.exit_code == 0, told.output
    # Masses fall alike.
    assert told.output.index("| gravity |") < told.output.index("| mass |")
    assert "wrote out/fall/rank.html" in told.output
