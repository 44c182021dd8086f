"""What a study shows: pictures whose points stand at their values, pages of a bounded width, progress that is written as it is made."""

import html
import math
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import stepper
from hypothesis import given, settings, strategies as st
from stepper.cli.app import application
from stepper.lab.study.document import Document, Section, cell
from stepper.lab.study.draw import WIDEST, figure_of
from stepper.lab.study.journal import Table
from stepper.lab.study.report import _differences, _no_cliff
from stepper.lab.study.sweep import Cliff, Level, Sweep
from stepper.shared.files import existing, os_error_message
from stepper.shared.progress import show_progress

EXAMPLES = Path(__file__).parents[2] / "examples"
BLOCK = """<mujoco model="block and plane"><option timestep="0.004"/><worldbody><geom type="plane" size="3 3 1" friction=".3"/>
<body name="block" pos="0 0 .05"><freejoint/><geom type="box" size=".05 .05 .05" mass="1" friction=".3"/></body></worldbody></mujoco>"""
words = st.text("abcdefghij klmno", min_size=1, max_size=60).filter(lambda text: text.strip() not in ("", "stepper"))


def start(now, _):
    velocity = np.zeros((now.num_envs, 6))
    velocity[:, 0] = 1.0
    return np.tile(now.model.qpos0, (now.num_envs, 1)), velocity


def study(parameters, names):
    return stepper.lab.Study(
        name="sliding distance",
        model=BLOCK,
        start=start,
        parameters={name: stepper.lab.Parameter("geom_friction[*][0]", low=0.1, high=1.0) for name in parameters},
        outcomes=[stepper.lab.Outcome(name="slide", measure="body block x", reduce="change", success="<= 0.2", unit="m")],
        settings={name: {"iterations": 5 + k} for k, name in enumerate(names)},
        seconds=1.2,
        control=0.008,
        episodes=1,
    )


def level(setting, parameter, value):
    """One whose episode slides as far as Coulomb has it, v^2 / (2 mu g)."""
    slide = 1 / (2 * 9.81 * value)
    return Level(setting, parameter, value, 1, int(slide <= 0.2), 1, (0.0, 1.0), slide, math.nan, (0.0, math.nan), 0, 0)


@settings(max_examples=15, deadline=None)
@given(st.lists(words, min_size=1, max_size=7, unique=True), st.lists(words, max_size=12, unique=True), st.data())
def test_points_stand_at_their_values_and_pictures_fit_a_page(parameters, names, data):
    """For any number of parameters and settings, with names of any length."""
    own = study(parameters, names)
    values = st.lists(st.floats(0.1, 1.0), min_size=2, max_size=4, unique=True)
    every = [(setting, name) for setting in ("stepper", *names) for name in parameters]
    tried = {cell: (data.draw(values), data.draw(values)) for cell in every[:6]}
    levels, between = ([level(*cell, value) for cell, pair in tried.items() for value in pair[k]] for k in (0, 1))
    cliffs = [Cliff(*cell, 0.25, 0.26, 0.0, 1.0) for cell in tried]
    figure = figure_of(Sweep(own, tuple(levels), tuple(cliffs), Table([]), (), tuple(between)))
    # Panels of outcomes are below those of shares.
    lines = {line.get_gid(): line for panel in figure.axes for line in panel.lines if line.get_gid()}
    assert lines
    for (setting, name), pair in tried.items():
        value = np.array(sorted([*pair[0], *pair[1]]))
        np.testing.assert_array_equal(lines[f"{name}/{setting}"].get_xydata(), np.column_stack([value, 1 / (2 * 9.81 * value)]))
    figure.canvas.draw()
    width, height = figure.canvas.get_width_height()
    assert width <= WIDEST
    for legend in figure.legends:
        box = legend.get_window_extent()
        # A pixel of rounding.
        assert box.x0 >= -1
        assert box.x1 <= width + 1
        assert box.y0 >= -1
        assert box.y1 <= height + 1


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """Sweep over friction with a second setting, with values of its bisection."""
    return stepper.lab.sweep(study(["friction"], ["5 iterations"]), tmp_path_factory.mktemp("sweep")).sweep


def test_a_cliff_is_as_steep_as_it_is_known(found):
    """The line of shares crosses one half between the ends of the bracket, and bisected points carry the outcome."""
    (cliff, _) = found.cliffs
    points = found.points("friction")
    assert len(points) > len(found.levels_of("friction"))
    x, shares = np.array([p.value for p in points]), np.array([p.share for p in points])
    k = int(np.flatnonzero(np.diff(shares >= 0.5))[0])
    assert (x[k], x[k + 1]) == (cliff.low, cliff.high)
    # Coulomb's distance; the contact takes 1 mm at the start.
    np.testing.assert_allclose([p.mean for p in points], 1 / (2 * 9.81 * x), atol=0.003)


def test_curves_are_outcomes_over_the_parameter(found):
    """Parameter to the right and outcome upwards, points of the bisection and marks of all settings at their values on the screen."""
    figure = figure_of(found)
    figure.canvas.draw()
    shares, outcomes = figure.axes
    assert [panel.get_xlabel() for panel in figure.axes] == ["friction", "friction"]
    assert [panel.get_ylabel() for panel in figure.axes] == ["fraction of successes", "slide, m"]
    curves = {line.get_gid(): line for line in outcomes.lines if line.get_gid()}
    x, y = curves["friction/stepper"].get_xydata().T
    bisected = [point.value for point in found.bisected if point.setting == "stepper"]
    assert bisected
    assert set(bisected) < set(x)
    # Coulomb's distance; the contact takes 1 mm at the start.
    np.testing.assert_allclose(y, 1 / (2 * 9.81 * x), atol=0.003)
    for panel, of in ((shares, "share"), (outcomes, "mean")):
        assert len(panel.containers) == 2
        for setting, marks in zip(("stepper", "5 iterations"), panel.containers, strict=True):
            line = next(line for line in panel.lines if line.get_gid() == f"friction/{setting}")
            for drawn, points in ((line, found.points("friction", setting)), (marks[0], found.levels_of("friction", setting))):
                places = np.array([(point.value, getattr(point, of)) for point in points])
                # On the screen, so that an offset of a marker counts too; a thousandth of a pixel is rounding.
                seen = drawn.get_transform().transform(drawn.get_xydata())
                np.testing.assert_allclose(seen, panel.transData.transform(places), atol=1e-3)
        ends = sorted(line.get_xdata()[0] for line in panel.lines if line.get_linestyle() == ":")
        assert ends == sorted((cliff.low + cliff.high) / 2 for cliff in found.cliffs)


@pytest.mark.parametrize("count", [0, 7, 20])
def test_tables_of_a_page_do_not_widen_with_settings(tmp_path, count):
    own = study(["friction"], [f"{k + 1} iterations and a name that is rather long" for k in range(count)])
    document = stepper.lab.report(own, tmp_path).document
    # 68 rem are 1,088 pixels; eleven columns of wrapped words fit.
    assert max(len(section.head) for section in document.sections) <= 11
    assert "overflow-wrap: anywhere" in document.html()
    assert "nowrap" not in document.html()


def pendulum(**changed):
    """A pendulum without actuators and sensors, with three outcomes, of which one decides."""
    angle, speed, low = (
        stepper.lab.Outcome(name=name, measure=measure, unit=unit, **more)
        for name, measure, unit, more in (
            ("angle", "joint hinge", "rad", {}),
            ("fastest", "jointvel hinge", "rad/s", {"reduce": "max"}),
            ("lowest", "body rod z", "m", {"success": ">= -1", "reduce": "min"}),
        )
    )
    given = {
        "model": "<mujoco><worldbody><body name='rod'><joint name='hinge' axis='0 1 0'/><geom size='.1' pos='.3 0 0'/></body></worldbody>"
        "</mujoco>",
        "name": "pendulum",
        "outcomes": [angle, speed, low],
        "parameters": {"mass": stepper.lab.Parameter("body_mass[1]", operation="scale", low=0.5, high=2.0, source="a scale")},
        "seconds": 0.2,
        "episodes": 2,
        "qvel_noise": 0.1,
    }
    return stepper.lab.Study(**(given | changed))


@pytest.mark.parametrize("command", [stepper.lab.sweep, stepper.lab.report])
def test_all_outcomes_of_a_study_are_on_its_pages(tmp_path, command):
    found = command(pendulum(), tmp_path)
    page = (tmp_path / f"pendulum/{command.__name__}.html").read_text()
    table = found.sweep.table
    first = table["setting"] == "stepper"
    for name, unit in (("angle", "rad"), ("fastest", "rad/s"), ("lowest", "m")):
        assert f"<th>mean {name}, {unit}</th>" in page
        assert f"{name}, {unit}" in {panel.get_ylabel() for panel in figure_of(found.sweep).axes}
        for level in found.sweep.levels_of("mass"):
            values = table[f"outcome.{name}"][first & (table["parameters.mass"] == level.value)]
            assert level.of(name).mean == pytest.approx(values.mean(), rel=1e-12)
            assert f"<td class=n>{cell(level.of(name).mean)}</td>" in page
    assert found.sweep.levels[0].of("lowest") is found.sweep.levels[0]
    assert "a scale" in page


@pytest.mark.parametrize(
    ("controller", "cause"), [(None, "scene"), ("random", "scene"), (lambda now: np.zeros((now.num_envs, 0)), "controller")]
)
def test_causes_are_among_what_the_study_has(tmp_path, controller, cause):
    """A study without controller, sensors and soft contact has no failures of them, and no rules about them."""
    never = stepper.lab.Outcome(name="angle", measure="joint hinge", success=">= 100")
    found = stepper.lab.report(pendulum(outcomes=never, controller=controller, name="never"), tmp_path)
    assert {verdict.cause for verdict in found.verdicts} == {cause}
    (rules,) = [section for section in found.document.sections if section.title == "Causes of failures"]
    assert ("controller:" in rules.words[1]) == (cause == "controller")
    assert "perception:" not in rules.words[1]


def test_intervals_and_units_do_not_break_in_tables():
    page = Document("page", [Section("table", (), ("95 %",), [["0.676 to 1.000"], ["-0.5 to -0.1"], ["2 of 3 to the left"]])]).html()
    assert "0.676\u00a0to\u00a01.000" in page
    assert "-0.5\u00a0to\u00a0-0.1" in page
    assert "2 of 3 to the left" in page


def test_pages_escape_what_they_are_given(tmp_path):
    """Names of models and files may hold anything; only `code` in back quotes is markup."""
    picture = tmp_path / "dot.png"
    picture.write_bytes(b"\x89PNG")
    name = """<script>"a" & 'b'</script>"""
    page = Document(name, [Section(name, [f"`{name}`"], [name], [[name, 1, True, None]], picture, f"{name}\n")]).html()
    assert "<script" not in page
    assert html.unescape(page).count(name) == 8
    assert "<code>&lt;script&gt;" in page
    assert "<td class=n>1</td><td>True</td><td>-</td>" in page
    assert 'src="data:image/png;base64,iVBORw=="' in page


@pytest.mark.parametrize("command", [
    ["sweep", "study.toml"], ["report", "study.toml"], ["rank", "study.toml"], ["chart", "study.toml"],
    ["tune", "study.toml", "--error", "1 mm", "--horizon", "0.1 s"], ["explain", "model.xml", "--out", "out"],
])  # fmt: skip
def test_without_jinja2_nothing_runs_and_the_remedy_is_named(tmp_path, monkeypatch, capsys, command):
    """The page is written last: an error there would come after hours of running."""
    from stepper.cli.app import main

    monkeypatch.setitem(sys.modules, "jinja2", None)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "model.xml").write_text(BLOCK)
    (tmp_path / "study.toml").write_text("""model = "model.xml"
[[outcomes]]
name = "x"
measure = "body block x"
[parameters.mass]
selector = "body_mass[block]"
low = 0.5
high = 2.0
[parameters.gravity]
selector = "gravity[2]"
low = -10.0
high = -9.0
""")
    monkeypatch.setattr(sys, "argv", ["stepper", *command])
    with pytest.raises(SystemExit):
        main()
    remedy = 'stepper: jinja2 is needed to write HTML reports, and is not installed: pip install "stepper-sim[cli]"'
    assert capsys.readouterr().err.splitlines()[-1] == remedy
    assert [path.name for path in tmp_path.iterdir() if path.is_dir()] == []


def test_a_report_is_named_after_its_study(tmp_path):
    found = stepper.lab.report(study(["friction"], []), tmp_path)
    assert found.document.title == "Simulator report of sliding distance"
    assert found.document.sections[0].words[0].startswith("`sliding distance` of model `block and plane`: ")
    assert found.files[0].parent == tmp_path / "sliding distance"


def test_differences_of_settings_are_told():
    usual, other = {"iterations": 50, "slop": 1e-5, "cone": None}, {"iterations": 5, "cone": "pyramidal"}
    assert _differences(usual, {}) == "iterations 50, slop 1e-05"
    assert _differences(other, usual) == "iterations 5, no slop, cone pyramidal"
    assert _differences(usual, usual) == "the same"


def test_progress_into_a_file_is_written_at_once(capfd):
    """A line for every tenth, before the next one is made."""
    with show_progress() as progress:
        seen = []
        for k in range(101):
            progress("sweep", k / 100)
            seen.append(capfd.readouterr().err)
    assert [k for k, text in enumerate(seen) if text] == list(range(0, 101, 10))
    assert seen[30] == "sweep: 30 %\n"


def test_progress_has_an_estimate_of_the_remaining_time(capfd, monkeypatch):
    """As long for each part as for those before it; none before the first part and below a second."""
    clock = iter([0.0, 10.0, 40.0, 400.0, 4000.0])
    monkeypatch.setattr(time, "monotonic", lambda: next(clock))
    with show_progress() as progress:
        for done in (0.2, 0.4, 0.5, 0.6, 1.0):
            progress("sweep", done)
    said = ["sweep: 20 %", "sweep: 40 %, 30 s left", "sweep: 50 %, 67 s left", "sweep: 60 %, 7 min left", "sweep: 100 %"]
    assert capfd.readouterr().err.splitlines() == said


@pytest.mark.parametrize(("command", "words"), [
    (["evaluate", "{policy}", "stepper/Hopper-v5", "--episodes", "2"], ["stepper/Hopper-v5: 100 %"]),
    (["replay", "{recording}"], ["replay: 100 %"]),
])  # fmt: skip
def test_commands_show_their_progress(tmp_path, capfd, command, words):
    places = {"recording": tmp_path / "run", "policy": tmp_path / "hopper.npz"}
    if "{recording}" in command:
        sim = stepper.Stepper(stepper.load(BLOCK))
        with sim.record(places["recording"]):
            for _ in range(5):
                sim.step()
    if "{policy}" in command:
        places["policy"].write_bytes((EXAMPLES / "policies/hopper.npz").read_bytes())
    application()([part.format(**places) for part in command], standalone_mode=False)
    said = capfd.readouterr().err
    for line in words:
        assert f"{line}\n" in said


def test_progress_into_a_pipe_comes_before_the_end():
    """As `stepper report ... | cat` has it."""
    code = "from stepper.shared.progress import show_progress\nwith show_progress() as progress:\n    progress('sweep', 0.5)\n    input()"
    child = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert child.stderr is not None
    assert child.stderr.readline() == "sweep: 50 %\n"
    child.communicate("\n")


@pytest.mark.parametrize("kind", [FileNotFoundError, IsADirectoryError, NotADirectoryError, PermissionError, FileExistsError, OSError])
def test_errors_of_the_system_in_words(kind):
    import errno

    number = {
        FileNotFoundError: errno.ENOENT, IsADirectoryError: errno.EISDIR, NotADirectoryError: errno.ENOTDIR,
        PermissionError: errno.EACCES, FileExistsError: errno.EEXIST, OSError: errno.ENOSPC,
    }[kind]  # fmt: skip
    error = OSError(number, "words of the system", "place/file")
    assert type(error) is kind
    told = os_error_message(error)
    assert "'place/file'" in told
    assert "Errno" not in told
    assert "give" in told
    with pytest.raises(FileNotFoundError, match=r"there is no model file 'place/file' in .*; check the name"):
        existing("place/file", "model")


def cliffs_table(text):
    """Rows of the table of cliffs in a page, as lists of cells."""
    lines = text.partition("## Cliffs")[2].partition("## In force")[0].splitlines()
    return [[cell.strip() for cell in line.strip("| ").split("|")] for line in lines if line.startswith("|")][2:]


def test_parameters_without_a_cliff_are_listed_with_their_range(tmp_path):
    """Episodes with a number below "share" succeed, whatever moves: 4 of 4 at the nominal point."""
    below = stepper.lab.Outcome(
        name="below", measure=lambda now: np.where(now.episodes < now.parameters["share"], 1.0, -1.0), success="> 0"
    )
    parameters = {
        "share": stepper.lab.Parameter("controller", nominal=4, low=0, high=4),
        "most": stepper.lab.Parameter("geom_friction[*][0]", low=0.5, high=1.0),
        "iterations": stepper.lab.Parameter("options.iterations", values=(5, 50)),
        "solver": stepper.lab.Parameter("options.solver", values=("auto", "newton")),
    }
    study = stepper.lab.Study(
        model=BLOCK,
        parameters=parameters,
        outcomes=below,
        settings={"MuJoCo": {"engine": "mujoco"}},
        episodes=4,
        seconds=0.008,
        control=0.004,
    )
    rows = {(row[0], row[1]): row[2:] for row in cliffs_table(str(stepper.lab.sweep(study, tmp_path)))}
    for setting in ("stepper", "MuJoCo"):
        # The share of successes is 1/4 at 1 and 1/2 at 2; episodes compare with whole numbers.
        assert 1 <= float(rows[setting, "share"][0]) < 2
        assert rows[setting, "most"] == ["same number of successes between 0.5 and 1", "-", "1", "1"]
    assert rows["stepper", "iterations"] == ["same number of successes between 5 and 50", "-", "1", "1"]
    assert rows["stepper", "solver"] == ["same number of successes with auto, newton", "-", "1", "1"]
    assert ("MuJoCo", "solver") not in rows  # MuJoCo has no solver auto, which the page says elsewhere.


@pytest.mark.parametrize(("successes", "told"), [
    ([2, 2, 2], "same number of successes between 0.1 and 0.3"),
    ([4, 3, 2], "share of successes at least one half between 0.1 and 0.3"),
    ([1, 0, 1], "share of successes below one half between 0.1 and 0.3"),
    ([4, 0, 0], "share of successes crosses one half, not located, between 0.1 and 0.3"),
])  # fmt: skip
def test_a_row_without_a_cliff_says_whether_outcomes_changed(successes, told):
    levels = [
        Level("stepper", "p", value, 4, count, 4, (0.0, 1.0), 0.0, math.nan, (0.0, math.nan), 0, 0)
        for value, count in zip([0.3, 0.2, 0.1], successes, strict=True)
    ]
    assert _no_cliff(levels) == [["stepper", "p", told, None, successes[-1] / 4, successes[0] / 4]]
