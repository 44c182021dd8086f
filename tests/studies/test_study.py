"""Studies: what a row follows from, that nothing is lost or repeated, that parameters are what they say."""

import copy
import functools
import json
import math
import os
import random
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import stepper
from checks import raises
from stepper.cli import main
from stepper.cli.options import progress_kept_in
from stepper.lab import Outcome, Parameter, PolicyController, Study
from stepper.lab.study.batches import Point, begin, run_points, world_of
from stepper.lab.study.controllers import digest_of
from stepper.lab.study.episode import Episodes
from stepper.lab.study.failure_causes import LAW
from stepper.lab.study.intervals import least_share, trials_for, wilson
from stepper.lab.study.journal import JOURNAL, Results, rows_of
from stepper.lab.study.parameters import model_fields, selected
from stepper.lab.study.sweep import run_sweep
from stepper.lab.study.touching import deciding, touching

TRAY = """<mujoco model="tray"><option timestep=".005"/><worldbody><geom name="tray" type="box" size="2 2 .01" pos="0 0 -.01"/>
  <body name="object" pos="0 0 .02"><freejoint name="free"/><geom name="object" type="box" size=".05 .05 .02" mass=".3"/></body></worldbody>
  </mujoco>"""
ARM = """<mujoco><worldbody><body name="arm"><joint name="hinge" axis="0 1 0" damping=".1"/>
  <geom name="rod" type="capsule" size=".02" fromto="0 0 0 .3 0 0"/><site name="tip" pos=".3 0 0"/></body></worldbody>
  <actuator><position name="servo" joint="hinge" kp="5" kv=".5"/></actuator>
  <sensor><jointpos name="angle" joint="hinge"/></sensor></mujoco>"""
G, MASS, PUSH = 9.81, 0.3, 2.0
ANGLE = Outcome(name="angle", measure="joint hinge")
CHILD = """
import sys
sys.path.insert(0, sys.argv[2])
import test_study, stepper
from stepper.lab.study.journal import Journal
study = test_study.tray(batch=4)
append = Journal.append
def told(self, rows):
    append(self, rows)
    print("rows", flush=True)
    sys.stdin.readline()
Journal.append = told
from stepper.lab import rank, report, sweep
{"sweep": sweep, "report": report, "rank": lambda *given: rank(*given, samples=8)}[sys.argv[3]](study, sys.argv[1])
"""
COMMANDS = {"sweep": stepper.lab.sweep, "report": stepper.lab.report, "rank": functools.partial(stepper.lab.rank, samples=8)}


def swept(study, out):
    """Levels alone, without pages."""
    with Results(study, out) as results:
        return run_sweep(study, results.journal, cliffs=False)


def push(now):
    now.xfrc_applied[:, 1, 0] = now.parameters["push"]


def to_the_middle(now):
    return 0.5 - now.read("sensordata", "angle")


def scaled(gain, now):
    return np.full((now.num_envs, 1), gain)


def tray(**changed):
    given = {
        "model": TRAY,
        "name": "tray",
        "controller": push,
        "outcomes": Outcome(name="slid", measure="body object x", reduce="change", success="<= 1e-5", unit="m"),
        "parameters": {
            "push": Parameter("controller", nominal=PUSH, low=1.0, high=3.5, unit="N"),
            "friction": Parameter("geom_friction[*][0]", low=0.2, high=1.2),
            "mass": Parameter("body_mass", operation="scale", low=0.5, high=1.5),
        },
        "episodes": 3,
        "seconds": 0.4,
        "control": 0.02,
        "qvel_noise": 1e-9,
    }
    return Study(**(given | changed))


def test_cliffs_are_where_coulomb_has_them(tmp_path):
    with Results(tray(), tmp_path) as results:
        found = run_sweep(tray(), results.journal)
    ends = {cliff.parameter: cliff for cliff in found.cliffs}
    # x = a t^2 / 2 reaches 1e-5 m in 0.4 s with a = 1.25e-4 m/s^2: 1.3e-5 of mu and 4e-5 N, within a thousandth of each range.
    for name, exact in (("push", MASS * G), ("friction", PUSH / (MASS * G)), ("mass", PUSH / (MASS * G))):
        varied = tray().parameters[name]
        assert ends[name].high - ends[name].low <= 1e-3 * (varied.high - varied.low)
        assert ends[name].low - 1e-4 <= exact <= ends[name].high + 1e-4
    nominal = found.levels_of("")[0]
    assert (nominal.successes, nominal.episodes, nominal.unsolved) == (3, 3, 0)
    assert nominal.interval == wilson(3, 3)
    assert [level.share for level in found.levels_of("friction")] == [0, 0, 1, 1, 1]


def test_episodes_that_repeat_one_another_are_no_trials(tmp_path):
    told = str(stepper.lab.sweep(tray(qvel_noise=0.0, parameters={"push": tray().parameters["push"]}), tmp_path / "same", cliffs=False))
    assert "3 episodes have only 1 distinct result" in told
    assert "none, 1 different" in told
    same = swept(tray(qvel_noise=0.0), tmp_path).levels_of("")[0]
    assert (same.successes, same.episodes, same.different) == (3, 3, 1)
    assert np.isnan(same.interval).all()
    alone = swept(tray(qvel_noise=0.0, episodes=1), tmp_path).levels_of("")[0]
    assert alone.interval == wilson(1, 1)


def test_a_page_without_a_search_for_cliffs_says_so(tmp_path):
    found = stepper.lab.sweep(tray(), tmp_path, cliffs=False)
    shares = [level.share for level in found.sweep.levels_of("friction")]
    assert min(shares) < 0.5 < max(shares)
    assert "Not searched: cliffs=False, or --no-cliffs." in str(found)
    assert "nowhere" not in str(found)


def test_cliffs_of_values_in_any_order_and_of_any_width(tmp_path):
    friction = Parameter("geom_friction[*][0]", values=(1.2, 0.2))
    push_alone = {"push": tray().parameters["push"]}
    study = tray(parameters=push_alone | {"friction": friction}, episodes=1)
    with Results(study, tmp_path) as results:
        for wrong in (0.0, -1e-3, 1.0, math.nan):
            raises(ValueError, r"resolution is .*, must be between 0 and 1", run_sweep, study, results.journal, resolution=wrong)
        (cliff,) = run_sweep(study, results.journal, parameters=["friction"]).cliffs
        assert (cliff.below, cliff.above) == (0.0, 1.0)
        assert 0 < cliff.high - cliff.low <= 1e-3
        assert cliff.low - 1e-4 <= PUSH / (MASS * G) <= cliff.high + 1e-4
        # Narrower than a bracket can be: it ends at neighbouring numbers.
        (cliff,) = run_sweep(study, results.journal, parameters=["friction"], resolution=1e-300).cliffs
        assert cliff.high == np.nextafter(cliff.low, 2.0)


def test_an_environment_of_a_batch_is_the_model_with_its_numbers(tmp_path):
    """To the bit: what `Model.replace` gives, stepped alone."""
    study = tray(outcomes=Outcome(name="x", measure="body object x"))
    values = [{"push": 2.5, "friction": 0.3}, {"push": 2.5, "mass": 0.7}, {"push": 1.0}]
    with Results(study, tmp_path) as results:
        rows = run_points(study, [Point(own) for own in values], results.journal)
    model = study.loaded[0]
    friction = np.array(model.geom_friction)
    friction[:, 0] = 0.3
    models = [
        model.replace(geom_friction=friction),
        model.replace(body_mass=0.7 * model.body_mass, body_inertia=0.7 * model.body_inertia),
        model,
    ]
    for k, own in enumerate(models):
        for episode in range(study.episodes):
            sim = stepper.Stepper(own)
            sim.reset(qvel=1e-9 * np.random.default_rng([0, episode, 0]).standard_normal(6))
            sim.xfrc_applied[1, 0] = values[k]["push"]
            sim.step(nstep=80)
            assert rows[3 * k + episode]["outcomes"]["x"] == sim.qpos[0]


def test_servo_gains_and_element_names():
    parameters = {
        "stiffness": Parameter("actuator_kp[servo]", operation="scale", low=0.5, high=2.0),
        "damping": Parameter("actuator_kv", operation="set", low=0.5, high=2.0),
        "length": Parameter("geom_size[arm/rod][1]", operation="add", low=0.0, high=0.1),
    }
    world = world_of(Study(model=ARM, parameters=parameters), "stepper", [{"stiffness": 2.0, "damping": 1.5, "length": 0.05}, {}])
    own = world.sim.randomized
    np.testing.assert_array_equal(own["actuator_gainprm"][:, 0, 0], [10, 5])
    np.testing.assert_array_equal(own["actuator_biasprm"][:, 0, :3], [[0, -10, -1.5], [0, -5, -0.5]])
    np.testing.assert_allclose(own["geom_size"][:, 0, 1], [0.2, 0.15], rtol=1e-15)


@pytest.mark.parametrize(("how", "value", "expected"), [("set", 8.0, 8), ("scale", 2.0, 10), ("add", 1.0, 6)])
def test_a_servo_is_stiffer_by_every_change_of_its_gain(how, value, expected):
    """Gain and bias change together: a stiffness that is added to is no smaller in the bias."""
    parameters = {"stiffness": Parameter("actuator_kp", operation=how, low=0.5, high=9.0)}
    made = model_fields(parameters, stepper.load(ARM), [{"stiffness": value}])
    assert (made["actuator_gainprm"][0, 0, 0], made["actuator_biasprm"][0, 0, 1]) == (expected, -expected)


@pytest.mark.parametrize("order", [("mass", "inertia"), ("inertia", "mass")])
def test_masses_and_inertias_vary_together(order):
    targets = {"mass": "body_mass", "inertia": "body_inertia"}
    parameters = {name: Parameter(targets[name], operation="scale", low=0.5, high=4.0) for name in order}
    model = stepper.load(ARM)
    made = model_fields(parameters, model, [{"inertia": 4.0}, {"mass": 0.5}, {"inertia": 4.0, "mass": 0.5}, {}])
    # Powers of two: exact.
    for field, factors in (("body_inertia", (4, 0.5, 2, 1)), ("body_mass", (1, 0.5, 0.5, 1))):
        own = getattr(model, field)
        np.testing.assert_array_equal(made[field], [factor * own for factor in factors])


@pytest.mark.parametrize("said", [(None, 0.6, None, None), (0.6, None, None)])
def test_a_control_is_held_until_the_next_one(said):
    """That of the keyframe until the drive gives one, then the drive's."""
    keyed = ARM.replace("</mujoco>", '<keyframe><key name="up" qpos=".2" ctrl=".3"/></keyframe></mujoco>')
    study = Study(model=keyed, keyframe="up")
    given, held = (world_of(study, "stepper", [{}]) for _ in range(2))
    for world in (given, held):
        begin(study, world, [0])
    in_force = 0.3
    for ctrl in said:
        in_force = in_force if ctrl is None else ctrl
        given.step([[in_force]], 5)
        held.step(None if ctrl is None else [[ctrl]], 5)
        np.testing.assert_array_equal(given.qpos, held.qpos)


def test_settings_delays_and_errors_of_sensors_vary():
    parameters = {
        "step": Parameter("options.timestep", values=(0.001, 0.01)),
        "noise": Parameter("sensor.noise_std[angle]", low=0.0, high=0.1),
        "delay": Parameter("actuator.delay", low=0.0, high=0.02),
    }

    study = Study(model=ARM, controller=to_the_middle, parameters=parameters, outcomes=ANGLE, episodes=4)
    found = world_of(study, "stepper", [{"step": 0.01, "noise": 0.1, "delay": 0.02}] * 2)
    assert found.timestep == 0.01
    assert found.sim.sensors.named["angle"].noise_std.tolist() == [0.1, 0.1]
    assert found.sim.actuators.drive_of("servo").delay.tolist() == [0.02, 0.02]


def test_mujoco_beside(tmp_path):
    """Outcomes in MuJoCo of the same parameters. The robot is a servo without contacts, so that the engines differ little at 1 ms."""
    study = Study(
        model=ARM,
        controller=lambda now: np.full((now.num_envs, 1), 0.4),
        outcomes=[ANGLE, Outcome(name="z", measure="site tip z", reduce="min")],
        parameters={"mass": Parameter("body_mass", operation="scale", low=0.5, high=1.5)},
        settings={"MuJoCo": {"engine": "mujoco"}, "f32": {"precision": "f32"}},
        options=stepper.Options(timestep=0.001),
        episodes=1,
    )
    with Results(study, tmp_path) as results:
        found = run_sweep(study, results.journal, cliffs=False)
    ours, theirs, single = ([level.mean for level in found.levels_of("mass", name)] for name in ("stepper", "MuJoCo", "f32"))
    # MuJoCo's Euler rule is of first order: a degree's hundredth after one second.
    np.testing.assert_allclose(ours, theirs, rtol=2e-3)
    np.testing.assert_allclose(ours, single, rtol=1e-4)
    assert ours[0] != ours[1]
    assert set(found.table["settings.precision"]) == {"f64", "f32"}
    assert set(found.table["settings.engine"]) == {"stepper", "mujoco"}


def still(**changed):
    given = {
        "model": ARM,
        "controller": lambda now: np.full((now.num_envs, 1), 0.4),
        "outcomes": ANGLE,
        "episodes": 1,
        "seconds": 0.1,
    }
    return Study(**(given | changed))


def test_settings_that_are_compared_fix_what_they_name(tmp_path):
    """Also where a parameter has another nominal value."""
    parameters = {"iterations": Parameter("options.iterations", values=(20, 50), nominal=50)}
    study = still(parameters=parameters, settings={"five": {"iterations": 5}})
    found = swept(study, tmp_path)
    ran = {(row["setting"], row["settings"]["iterations"], row["parameters"].get("iterations")) for row in found.table.rows}
    assert ran == {("stepper", 20, 20), ("stepper", 50, 50), ("five", 5, None)}
    assert found.skipped == ("iterations with five: these settings fix iterations",)
    assert world_of(study, "five", [study.nominal]).settings()["iterations"] == 5


def test_nominal_values_that_mujoco_lacks_are_not_asked_of_it(tmp_path):
    parameters = {
        "noise": Parameter("sensor.noise_std", low=0.0, high=0.1, nominal=0.05),
        "bounce": Parameter("geom_restitution", low=0.0, high=1.0, nominal=0.5),
        "room": Parameter("options.max_contacts", values=(10, 20), nominal=20),
        "rule": Parameter("options.integrator", values=("midpoint", "euler"), nominal="midpoint"),
    }
    found = stepper.lab.report(still(parameters=parameters, name="alone"), tmp_path)
    assert "MuJoCo" not in found.study.settings
    assert "MuJoCo cannot run this study: it has no sensor errors" in str(found)
    del parameters["noise"]
    found = stepper.lab.report(still(parameters=parameters, name="beside"), tmp_path)
    values = {row["setting"]: row["parameters"] for row in found.sweep.table.rows if row["episode"] == 0}
    assert values["MuJoCo"] == {}
    assert values["stepper"].keys() == {"bounce", "room", "rule"}
    assert "MuJoCo cannot run" not in str(found)
    assert any("bounce with MuJoCo" in reason for reason in found.sweep.skipped)


def child(folder, command):
    helpers = Path(__file__).parents[1] / "helpers"
    path = os.pathsep.join([str(Path(stepper.__file__).parents[1]), str(helpers), os.environ.get("PYTHONPATH", "")])
    arguments = [sys.executable, "-c", CHILD, str(folder), str(Path(__file__).parent), command]
    return subprocess.Popen(arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=os.environ | {"PYTHONPATH": path})


@pytest.mark.parametrize(("command", "signals"), [
    ("sweep", [signal.SIGKILL, signal.SIGINT, signal.SIGKILL]), ("report", [signal.SIGKILL]), ("rank", [signal.SIGINT]),
])  # fmt: skip
def test_a_study_that_is_killed_goes_on_and_gives_the_same_table(tmp_path, command, signals):
    """A study is killed at random moments, some of them while it writes, until it is through."""
    COMMANDS[command](tray(batch=4), tmp_path / "whole")
    draw, journal = random.Random(1), tmp_path / "cut/tray" / JOURNAL
    for sent in signals:
        with child(tmp_path / "cut", command) as process:
            for _ in range(draw.randint(1, 4)):
                # It goes on by a batch each time that it is let: on a busy machine too it is not through when it is killed.
                assert process.stdout.readline() == "rows\n"
                process.stdin.write("\n")
                process.stdin.flush()
            time.sleep(draw.uniform(0.0, 0.02))
            process.send_signal(sent)
    before = rows_of(journal)
    COMMANDS[command](tray(batch=4), tmp_path / "cut")
    assert 0 < len(before) < len(rows_of(journal)), "the kills came before anything was written, or after all of it"
    assert rows_of(journal)[: len(before)] == before
    for name in ("rank_table.csv", "rank_table.npz", "rank.md") if command == "rank" else ("table.csv", "table.npz", f"{command}.md"):
        assert (tmp_path / "cut/tray" / name).read_bytes() == (tmp_path / "whole/tray" / name).read_bytes(), name


def test_what_the_model_leaves_out_is_noted_beside_the_rows(tmp_path):
    asks = """<mujoco><option integrator="RK4"/><worldbody><body name="b"><joint/><geom size=".1"/></body></worldbody>
      <sensor><user name="own" dim="1"/></sensor></mujoco>"""
    study = Study.from_model(asks, seconds=0.1, episodes=2, outcomes=Outcome(name="x", measure="body b x"))
    stepper.lab.sweep(study, tmp_path)
    (told,) = json.loads((tmp_path / "model" / "resolved_settings.json").read_text()).values()
    assert told["notes"] == study.notes
    assert any(note.startswith("sensor user without reading own: ") for note in told["notes"])
    assert any("RK4" in note for note in told["notes"])


def test_nothing_is_run_twice_and_what_changes_is_run_anew(tmp_path):
    study = tray()
    first = swept(study, tmp_path)
    journal = tmp_path / "tray" / JOURNAL
    count = len(rows_of(journal))
    again = swept(study, tmp_path)
    assert len(rows_of(journal)) == count
    assert first.levels == again.levels
    swept(tray(seed=1), tmp_path)
    assert len(rows_of(journal)) > count
    told = json.loads((tmp_path / "tray" / "resolved_settings.json").read_text())
    assert set(first.table["resolved_settings"]) < set(told)
    assert len(told) == 2


def servo_with_noise(**changed):
    sensors = stepper.SensorModel(default=stepper.Transfer(noise_std=0.1))
    parameters = {"damping": Parameter("dof_damping", operation="scale", low=0.5, high=1.5)}
    servo = {"name": "servo", "sensors": sensors, "controller": to_the_middle, "parameters": parameters, "episodes": 5, "seconds": 0.2}
    return still(**(servo | changed))


@pytest.mark.parametrize("made", [tray, servo_with_noise])
def test_the_batch_and_the_threads_change_no_bit(tmp_path, made):
    tables = [swept(made(batch=b, threads=t), tmp_path / f"{b} {t}").table for b, t in ((256, 1), (2, 2))]
    for name in tables[0].columns:
        np.testing.assert_array_equal(tables[0][name], tables[1][name])
    if made is servo_with_noise:
        assert len(set(tables[1]["outcome.angle"][:5])) == 5, "episodes repeat each other's noise"


def test_rows_carry_the_names_of_the_study_that_asks(tmp_path):
    """Settings under another name are the same rows, and two names of the same settings are both there."""
    swept(tray(settings={"few": {"iterations": 5}}), tmp_path)
    count = len(rows_of(tmp_path / "tray" / JOURNAL))
    table = swept(tray(settings={"five": {"iterations": 5}, "5": {"iterations": 5}}), tmp_path).table
    assert len(rows_of(tmp_path / "tray" / JOURNAL)) == count
    assert set(table["setting"]) == {"stepper", "five", "5"}


def test_rows_of_mujoco_follow_from_its_own_model():
    def keys(**option):
        words = " ".join(f'{name}="{value}"' for name, value in option.items())
        study = Study(model=ARM.replace("<worldbody>", f"<option {words}/><worldbody>"), settings={"MuJoCo": {"engine": "mujoco"}})
        return study.key({}, "stepper", 0), study.key({}, "MuJoCo", 0)

    (ours, theirs), (same, other) = keys(), keys(ls_tolerance="1e-3")
    assert ours == same
    assert theirs != other
    assert keys() == (ours, theirs)


class Gain:
    """A drive with a setting and a memory."""

    def __init__(self, gain):
        self.gain = gain

    def begin(self, now):
        self._count = 0

    def __call__(self, now):
        self._count += 1
        return np.full((now.num_envs, 1), self.gain)


def test_rows_follow_from_what_a_drive_is_and_not_from_its_memory():
    def key(drive):
        return Study(model=ARM, controller=drive).key({}, "stepper", 0)

    used = Gain(1.0)
    used.begin(None)
    assert key(Gain(1.0)) == key(used) != key(Gain(2.0))
    assert key(closed(np.zeros(1))) == key(closed(np.zeros(1)))


def closed(value):
    return lambda _: value


class Agent:
    """A policy with settings inside of settings, and a way back."""

    def __init__(self, gain, net=None):
        self.gain, self.net, self.parts = gain, net, {"self": self}

    def act(self, seen):
        return self.gain * seen


class Net:
    """What torch's modules are to a digest: weights and parts under an underscore, and a state."""

    def __init__(self, weight, *parts):
        self._parameters, self._modules = {"weight": weight}, dict(enumerate(parts))

    def state_dict(self):
        return self._parameters


class Tanh(Net):
    """Another part without weights."""


@pytest.mark.parametrize("drives", [
    [PolicyController(Agent(gain).act) for gain in (1.0, 2.0)],
    [lambda _, k=k: k for k in range(3)],
    [lambda _, *, k=k: k for k in range(3)],
    [lambda _: 0.1, lambda _: 0.2, functools.partial(scaled, 1), functools.partial(scaled, 2), push],
    [closed(np.ones(1)), closed(np.zeros(1))],
    [functools.partial(push, 1, 23), functools.partial(push, 12, 3), functools.partial(push, "1", 23), functools.partial(push, (1, 23))],
    [Gain([1, 23]), Gain([12, 3]), Gain([[1], 23]), Gain((1, 23)), Gain({1: 23}), Gain("[1, 23]")],
    [Gain(Gain(gain)) for gain in (1.0, 2.0)],
    [PolicyController(Agent(1.0, Net(np.full(2, weight))).act) for weight in (1.0, 2.0)],
    [Agent(1.0, Net(np.ones(2), part(None))).act for part in (Net, Tanh)],
    [Gain(np.random.default_rng(seed)) for seed in (0, 1)],
    [Gain(x) for x in (np.zeros(2), np.zeros(2, np.float32), np.zeros((2, 1)), np.array([0, None]))],
])  # fmt: skip
def test_whatever_a_drive_holds_counts(drives):
    assert len({digest_of(drive) for drive in drives}) == len(drives)
    assert [digest_of(drive) for drive in drives] == [digest_of(drive) for drive in copy.deepcopy(drives)]


def test_what_has_no_digest_is_named_with_the_remedy():
    held = threading.Lock()
    raises(TypeError, r"Gain has no digest.*cannot pickle '_thread\.lock'.* attribute `digest`", lambda: digest_of(Gain({"a": held})))
    told = Gain({"a": held})
    told.digest = "of the lock"
    other = Gain({"a": held})
    other.digest = "of another"
    assert digest_of(told) != digest_of(other)


def test_functions_policies_and_random_controls(tmp_path):
    played = []
    for k, drive in enumerate((lambda now: np.full(1, 0.3), PolicyController(lambda seen: 0.5 - seen), "random", None)):
        study = Study(model=ARM, controller=drive, outcomes=ANGLE, episodes=2, seconds=0.3)
        with Results(study, tmp_path / str(k)) as results:
            played.append([row["outcomes"]["angle"] for row in run_points(study, [Point({})], results.journal)])
    sim = stepper.Stepper(stepper.load(ARM))
    for _ in range(15):
        sim.step([0.3], nstep=10)
    assert played[0] == [sim.qpos[0]] * 2
    assert played[2][0] != played[2][1]
    assert len({row[0] for row in played}) == 4


STUDY = """
name = "servo"
model = "arm.xml"
controller = "drive.py:reach"
seconds = 0.5
episodes = 4
[options]
timestep = 0.005
[sensors."angle"]
noise_std = 0.01
[[outcomes]]
name = "reached"
measure = "joint hinge"
success = ">= 0.3"
[parameters.goal]
selector = "controller"
low = 0.1
high = 0.9
nominal = 0.8
unit = "rad"
source = "the task"
[settings."5 iterations"]
iterations = 5
"""


def write_study(folder, text=STUDY):
    (folder / "arm.xml").write_text(ARM)
    (folder / "drive.py").write_text("def reach(now):\n    return now.parameters['goal'][:, None]\n")
    (folder / "servo.toml").write_text(text)
    return folder / "servo.toml"


def test_a_study_from_a_file_and_its_pages(tmp_path):
    study = Study.from_file(write_study(tmp_path))
    assert study.options.timestep == 0.005
    assert study.sensors.named["angle"].noise_std == 0.01
    found = stepper.lab.report(study, tmp_path / "out")
    page = (tmp_path / "out/servo/report.html").read_text()
    assert "<img" in page
    assert "http" not in page.replace("http-equiv", "")
    titles = "State variables, Observation map, Contacts that decide, Perturbation table, Cliffs, Transfer gap, Causes of failures"
    for title in titles.split(", "):
        assert f"<h2>{title}</h2>" in page
    assert "noise_std 0.01" in page
    assert "MuJoCo cannot run this study: it has no sensor errors" in page
    assert found.sweep.table["settings.tolerance"].max() == 1e-4


@pytest.mark.parametrize(("wrong", "message"), [
    ("episodes = 4", "episodes = 0|episodes is 0, must be a whole number of at least 1"),
    ('name = "servo"', "nam = 2|the study has unknown entries \\['nam'\\]; did you mean name\\? it may have: actuators, batch"),
    ('unit = "rad"', "units = 2|parameter 'goal' has unknown entries \\['units'\\]; did you mean unit\\?"),
    ('success = ">= 0.3"', "succes = 2|outcome 1 has unknown entries \\['succes'\\]; did you mean success\\?"),
    ("[options]", "[options]\ntimestop = 1|options has unknown entries \\['timestop'\\]; did you mean timestep\\?"),
    ('success = ">= 0.3"', 'success = "big"|success is .big., must be a comparison'),
    ('measure = "joint hinge"', 'measure = "joint"|must be a function or a text'),
    ('controller = "drive.py:reach"', 'controller = "drive.py:no"|has no .no.'),
    ("nominal = 0.8", "|it has no nominal value"),
    ("high = 0.9", "high = 0.0|low is 0.1, must be below high"),
    ("iterations = 5", "iteration = 5|unknown \\['iteration'\\]; did you mean iterations"),
    ("seconds = 0.5", "seconds = 0.5\ncontrol = 0.0215|0.005 s, does not divide the control period, 0.0215 s: choose a time step of"),
])  # fmt: skip
def test_wrong_files_say_what_and_where(tmp_path, wrong, message):
    new, _, said = message.partition("|")
    assert wrong in STUDY
    raises(ValueError, said, stepper.lab.sweep, write_study(tmp_path, STUDY.replace(wrong, new)), tmp_path / "out")


def test_a_parameter_that_fits_nothing_is_named(tmp_path):
    for selector, said in (
        ("geom_friction[foot]", "no geom 'foot'"),
        ("geom_colour", "there is no field 'geom_colour'"),
        ("geom_frictions", "there is no field 'geom_frictions'; did you mean geom_friction"),
        ("options.timestop", r"no setting 'timestop'; did you mean timestep\?"),
        ("sensors.delay", "before the dot must be sensor, actuator or options; did you mean sensor"),
        ("sensor.delay", "no sensor fits"),
        ("options.speed", "settings are"),
    ):
        with pytest.raises(ValueError, match=said):
            stepper.lab.sweep(tray(parameters={"p": Parameter(selector, low=0, high=1)}), tmp_path)


@pytest.mark.parametrize(("selector", "said"), [
    ("sensor.latency", "a Transfer has no numeric attribute 'latency', it has: scale, scale_std"),
    ("sensor.nois_std", "no numeric attribute 'nois_std'; did you mean noise_std"),
    ("actuator.dely", "a Drive has no numeric attribute 'dely'; did you mean delay"),
    ("actuator.servo.kpp", "a PID has no numeric attribute 'kpp'; did you mean kp"),
    ("actuator.gearbox.kp", "a drive has no 'gearbox', use one of: motor, servo"),
])  # fmt: skip
def test_a_number_that_a_sensor_or_drive_lacks_is_named(selector, said):
    raises(ValueError, f"parameter 'p': .*{said}", lambda: random_force(parameters={"p": Parameter(selector, low=0, high=1)}))


def test_a_choice_among_words_takes_values():
    with pytest.raises(ValueError, match="low is 'hard', must be a number: a choice among words takes values"):
        Parameter("options.contact", low="hard", high="mujoco")
    raises(ValueError, "which is a choice among words: give values, not low and high", Parameter, "options.contact", low=0, high=1)
    raises(ValueError, "low is nan, must be a number", Parameter, "controller", low=math.nan, high=1.0)


def test_a_drive_that_reads_another_parameter_is_told_which_there_are():
    with pytest.raises(KeyError, match=r"no parameter 'puhs' with a value; did you mean push\? there are: push, mass"):
        tray(controller=lambda now: now.parameters["puhs"]).episode()


def shove(now):
    """Pushes the object with 2 N."""
    now.xfrc_applied[:, 1, 0] = 2.0


def test_a_selector_with_a_range_is_a_parameter_of_a_sweep(tmp_path):
    """The rows are those of a study that has the parameter, to the key."""
    text = "body_mass[object]=0.5..1.5"
    own = tray(parameters={"mass": Parameter("body_mass[object]", low=0.5, high=1.5)}, episodes=1, controller=shove)
    none = tray(parameters={}, episodes=1, controller=shove)
    one = stepper.lab.sweep(own, tmp_path / "one", cliffs=False).sweep.table.rows
    other = stepper.lab.sweep(none, tmp_path / "other", parameters=[text], cliffs=False).sweep.table.rows
    assert [row["outcomes"] for row in one] == [row["outcomes"] for row in other]
    assert [row["parameters"].get("body_mass[object]") for row in other] == [None, 0.5, 0.75, 1.0, 1.25, 1.5]
    with pytest.raises(ValueError, match=r"no parameter 'mas'; did you mean mass\? there are: mass; or give a selector with its range"):
        stepper.lab.sweep(own, tmp_path, parameters=["mas"])
    raises(ValueError, r"the range is '2', must be two numbers", stepper.lab.sweep, own, tmp_path, parameters=["gravity[2]=2"])


@pytest.mark.parametrize(("texts", "names"), [
    (["body_mass[object]=0.5..1.5", "body_mass['object']=0.5..1.5", "body_mass[-1]=.5..1.5"], ["body_mass[object]"]),
    (["geom_friction[tray,object][0]=0.1..1", "geom_friction[*][-3]=0.1..1"], ["geom_friction[tray,object][0]"]),
    (["geom_friction[1,0][0]=0.1..1", "geom_friction[object][0]=0.1..1"], ["geom_friction[1,0][0]", "geom_friction[object][0]"]),
    (["mass", "body_mass[object]=0.5..1.5"], ["mass"]),
    (["body_mass[object]=0.5..1.5", "mass"], ["body_mass[object]"]),
    (["mass", "heavy"], ["mass", "heavy"]),
    (["options.tolerance=1e-9..1e-6", " options.tolerance=1e-9..1e-6"], ["options.tolerance"]),
])  # fmt: skip
def test_two_spellings_of_a_selector_are_one_parameter(texts, names):
    parameters = {name: Parameter("body_mass[object]", low=0.5, high=1.5 + k) for k, name in enumerate(["mass", "heavy"])}
    model = tray().loaded[0]
    assert list(selected(parameters, texts, model)) == names
    with pytest.raises(
        ValueError, match=r"'body_mass\[1\]=0.5..9' and '.*', which set the same number of body_mass with different ranges: give one"
    ):
        selected(parameters, ["body_mass[object]=0.5..1.5", "body_mass[1]=0.5..9"], model)


def test_a_study_at_other_values_by_selector():
    study = tray(parameters={"mass": Parameter("body_mass[object]", operation="scale", low=0.5, high=1.5)}, controller=shove)
    row = study.episode({"mass": 1.5, "geom_friction[*][0]": 0.3})
    moved = study.at({"mass": 1.5, "geom_friction[*][0]": 0.3})
    assert moved.nominal == {"mass": 1.5, "geom_friction[*][0]": 0.3}
    assert moved.episode()["outcomes"] == row["outcomes"] != study.episode()["outcomes"]
    raises(ValueError, "there is no parameter 'frction'", study.at, {"frction": 0.3})
    raises(ValueError, "must be a finite number", study.at, {"gravity[2]": "low"})


def test_intervals():
    # R. G. Newcombe, Statistics in Medicine 17 (1998), table I: 81 of 263, 15 of 148, 0 of 20, 1 of 29.
    for (k, n), (low, high) in {
        (81, 263): (0.2553, 0.3662), (15, 148): (0.0624, 0.1605), (0, 20): (0.0, 0.1611), (1, 29): (0.0061, 0.1718),
    }.items():  # fmt: skip
        assert wilson(k, n) == (pytest.approx(low, abs=6e-5), pytest.approx(high, abs=6e-5))
    # All of n: the bound is 0.05^(1 / n).
    for n in (1, 10, 59):
        assert least_share(n, n) == pytest.approx(0.05 ** (1 / n), abs=1e-12)
    assert trials_for(0.95, 0.95) == 59
    assert least_share(0, 5) == 0.0
    # Coefficients beyond a float's range: scipy.stats.beta.ppf(0.05, 1800, 1889).
    assert least_share(1800, 3688) == pytest.approx(0.47440557934300115, abs=1e-9)


def blind(now):
    """Goes to 0.5 rad by what its sensor says."""
    return 0.5 + 3.0 * (0.5 - now.read("sensordata", "angle"))


def judged(tmp_path, **changed):
    angle = replace(ANGLE, success="<= 0.6", margin=1e-6)
    reached = {"controller": functools.partial(scaled, 0.5), "outcomes": angle, "episodes": 3, "seconds": 0.5}
    found = stepper.lab.report(still(**(reached | changed)), tmp_path)
    table = found.sweep.table
    # The table has the same words, in the rows of the verdicts alone.
    named = {(row["key"], cause) for row, cause in zip(table.rows, table["cause"].tolist(), strict=True) if cause}
    assert named == {(verdict.row["key"], verdict.cause) for verdict in found.verdicts}
    assert "cause" in (tmp_path / found.study.name / "table.csv").read_text().splitlines()[0].split(",")
    for verdict in found.verdicts:
        assert f"| {verdict.row['setting']} | {verdict.cause} | {verdict.rule} |" in str(found)
    return {(verdict.cause, verdict.rule.partition(":")[0]) for verdict in found.verdicts if verdict.row["setting"] == "stepper"}


def test_whose_a_failure_is(tmp_path):
    late = Outcome(name="angle", measure="joint hinge", success=">= 1.0")
    assert judged(tmp_path / "policy", outcomes=late) == {("controller", "failure even with ideal sensors and a finer time step")}
    biased = stepper.SensorModel(default=stepper.Transfer(bias=-0.4))
    assert judged(tmp_path / "senses", controller=blind, sensors=biased) == {("perception", "success with ideal sensors")}
    nothing = Outcome(name="angle", measure=lambda now: np.full(now.num_envs, np.nan), success=">= 0")
    assert {cause for cause, _ in judged(tmp_path / "nan", outcomes=nothing)} == {"evaluation"}


def test_a_time_step_that_decides_is_physics(tmp_path):
    """A free fall by semi-implicit Euler falls g t h / 2 too far: 2.45 mm in 0.1 s at 5 ms, half of it at half the step."""
    fall = 0.5 * G * 0.1**2
    change = Outcome(name="z", measure="body object z", reduce="change", success=f">= {-fall - 0.0018}")
    model, options = TRAY.replace('pos="0 0 .02"', 'pos="0 0 1"'), stepper.Options(integrator="euler")
    study = Study(model=model, name="fall", outcomes=change, options=options, episodes=2, seconds=0.1, control=0.02)
    found = stepper.lab.report(study, tmp_path)
    assert {(v.row["setting"], v.cause) for v in found.verdicts} >= {("stepper", "physics")}


def test_softness_is_judged_against_hard_contact_with_nominal_values(tmp_path):
    """A box that must bounce: from 0.1 m with a restitution of 0.8 it is 6 cm up again after 0.25 s; MuJoCo's law has none."""
    model, height = TRAY.replace('pos="0 0 .02"', 'pos="0 0 .12"'), Outcome(name="z", measure="body object z", success=">= 0.05")
    parameters = {"bounce": Parameter("geom_restitution", values=(0.7, 0.9), nominal=0.8)}
    study = Study(model=model, name="bounce", outcomes=height, parameters=parameters, episodes=1, seconds=0.25, control=0.025)
    found = stepper.lab.report(study, tmp_path)
    assert found.sweep.levels_of("")[0].successes == 1
    assert {v.rule for v in found.verdicts if v.row["setting"] == "MuJoCo's law"} == {LAW}


def test_a_report_says_how_many_episodes_it_looked_at(tmp_path):
    found = stepper.lab.report(tray(episodes=3, batch=2, controller=None, parameters={}, seconds=0.1), tmp_path)
    assert "Every step of 2 episodes at the nominal point" in str(found)


def test_contacts_that_decide(tmp_path):
    (pair,) = deciding(touching(tray(), range(2)))
    assert pair.names == ("tray", "object")
    # The weight for 0.4 s, and friction that carries the push: 2 N of 2.943 N.
    assert pair.impulse == pytest.approx(MASS * G * 0.4, rel=1e-6)
    assert pair.friction == 1.0
    swept = replace(tray().parameters["friction"], nominal=0.8)
    (pair,) = deciding(touching(tray(parameters=tray().parameters | {"friction": swept}), range(2)))
    assert pair.friction == 0.8
    assert pair.used == pytest.approx(PUSH / (MASS * G), rel=1e-6)
    assert pair.slides == 0.0


def test_one_outcome_decides():
    def outcome(name: str) -> Outcome:
        return Outcome(name=name, measure="joint a", reduce="max", success="<= 1")

    with pytest.raises(ValueError, match=r"outcomes \['high', 'far'\] have a success, must be one at most"):
        Study(model="<mujoco/>", seconds=1.0, outcomes=(outcome("high"), outcome("far")))


def random_force(**changed):
    """A study whose episodes differ in their controls, their starts and the errors of their sensors."""
    noise = stepper.SensorModel({"angle": stepper.Transfer(noise_std=0.01)})
    measured = Outcome(name="angle", measure="joint hinge", reduce="max", success=">= 0.1")
    given = {"model": ARM, "name": "arm", "controller": blind, "outcomes": measured, "sensors": noise, "seconds": 0.3, "qvel_noise": 0.5}
    gain = Parameter("actuator_kp", operation="scale", low=0.5, high=2.0)
    return Study(**(given | {"parameters": {"gain": gain}, "episodes": 3} | changed))


@pytest.mark.parametrize("changed", [{}, {"sensors": None}, {"sensors": None, "controller": "random"}], ids=["noise", "ideal", "random"])
def test_an_episode_alone_is_the_one_of_the_table_and_of_its_recording(tmp_path, changed):
    study = random_force(**changed)
    with Results(study, tmp_path) as results:
        rows = run_points(study, [Point({"gain": 0.7}), Point({"gain": 1.9})], results.journal)
    row = study.episode({"gain": 1.9}, 2, record=tmp_path / "recorded")
    assert {name: row[name] for name in ("outcomes", "success", "quality", "parameters", "episode")} == {
        name: rows[5][name] for name in ("outcomes", "success", "quality", "parameters", "episode")
    }
    assert rows[4]["outcomes"] != rows[5]["outcomes"]
    again = stepper.recording.verify(tmp_path / "recorded")
    assert again
    assert again.steps == study.num_control_steps
    assert study.episode({"gain": 1.9}, 2, seed=1)["outcomes"] != row["outcomes"]
    # Looked at step by step, twice over.
    steps = Episodes(study, {"gain": 1.9}, [2, 1]).repeated_steps()
    for _ in range(2):
        ends = [next(own for own in steps if own is not None) for _ in range(2)]
        for end in ends:
            assert end["angle"].tolist() == [rows[5]["outcomes"]["angle"], rows[4]["outcomes"]["angle"]]


def test_what_is_no_episode_is_named(tmp_path):
    study = tray(settings={"MuJoCo": {"engine": "mujoco"}, "5": {"iterations": 5}})
    for values, given, said in (
        ({"fricton": 0.5}, {}, r"no parameter 'fricton'; did you mean friction\? there are: push, friction, mass"),
        ({"push": "hard"}, {}, "parameter 'push' is 'hard', must be a number"),
        ({"mass": math.nan}, {}, "parameter 'mass' is nan, must be a finite number"),
        ({}, {"setting": "6"}, "no settings '6'"),
        ({}, {"number": -1}, "episode is -1, must be 0 or more"),
        ({}, {"setting": "MuJoCo", "record": tmp_path / "r"}, "run in MuJoCo, which cannot be viewed or recorded"),
    ):
        raises(ValueError, said, study.episode, values, **given)
    assert study.episode({"push": 2.0}, setting="MuJoCo")["settings"]["engine"] == "mujoco"
    raises(ValueError, "give the study more episodes", lambda: random_force().episode({}, 3))


class Counting:
    """Remembers how often it was asked."""

    def __init__(self):
        self._count, self._names, self._cache = 0, None, {}

    def __call__(self, now):
        self._count += 1
        return np.full((now.num_envs, 1), 0.01 * self._count)


class Caching(Counting):
    """What it keeps is the same in every batch."""

    def __call__(self, now):
        self._names = now.model.actuator_names
        self._cache["length"] = len(self._names)
        return np.full((now.num_envs, 1), 0.1)


class Forgetting(Counting):
    def begin(self, _):
        self._count = 0


def test_a_memory_that_no_begin_ends_is_found():
    def counting():
        count = 0

        def drive(now):
            nonlocal count
            count += 1
            return np.full((now.num_envs, 1), 0.01 * count)

        return drive

    for drive, name in ((Counting(), "_count"), (Counting().__call__, "_count"), (counting(), "count")):
        with pytest.raises(ValueError, match=rf"has changed {name} in a batch and has no method begin\(now\)"):
            random_force(controller=drive, sensors=None).episode()
    for drive in (Caching(), Forgetting(), blind):
        random_force(controller=drive, sensors=None).episode()
    with pytest.raises(ValueError, match="has changed _count in a batch"):
        random_force(controller=PolicyController(Remembering()), sensors=None).episode()


class Remembering(Counting):
    def __call__(self, observation):
        self._count += 1
        return np.full((len(observation), 1), 0.1)


def test_a_study_of_a_python_file_has_the_name_of_the_file(tmp_path):
    text = "from stepper.lab import Study\nstudy = Study(model={!r}{})\n"
    (tmp_path / "lift.py").write_text(text.format(ARM, ""))
    (tmp_path / "own.py").write_text(text.format(ARM, ', name="mine"'))
    assert Study.from_file(tmp_path / "lift.py").name == "lift"
    assert Study.from_file(tmp_path / "own.py").name == "mine"


def test_a_study_that_is_a_function_of_data_reads_the_folder_of_the_option(tmp_path, monkeypatch, capsys):
    """`--data` reaches the function with every command; without it, and with a study that takes no data, an error names the option."""
    file, plain = tmp_path / "fitted.py", write_study(tmp_path)
    made = f"Study(model={ARM!r}, seconds=float((data / 'length').read_text()))"
    file.write_text(f"from stepper.lab import Study\ndef study(data):\n    return {made}")
    (tmp_path / "length").write_text("0.5")
    assert (found := Study.from_file(file, tmp_path)).seconds == 0.5
    assert found.name == "fitted"
    none, own, absent = (), ("--data", tmp_path), ("--data", "absent")
    cases = ((file, none, "needs data"), (plain, own, "takes no data"), (file, absent, "absent/length"))
    for command in ("chart", "tune --error 1mm --horizon 1s", "sweep", "rank", "report", "calibrate --margin 1", "view"):
        name, *options = command.split()
        for source, data, message in cases:
            assert stepper_command(monkeypatch, name, source, *options, *data) == 1
            assert message in capsys.readouterr().err


def stepper_command(monkeypatch, *arguments):
    monkeypatch.setattr(sys, "argv", ["stepper", *map(str, arguments)])
    try:
        main()
    except SystemExit as end:
        return end.code
    return 0


def test_the_command_records_an_episode(tmp_path, monkeypatch, capsys):
    file = write_study(tmp_path)
    folder = tmp_path / "recorded"
    arguments = ("view", file, "--values", "goal=0.5", "--episode", "2", "--seed", "4", "--record", folder)
    assert stepper_command(monkeypatch, *arguments) == 0
    row = Study.from_file(file).episode({"goal": 0.5}, 2, seed=4)
    assert f"episode 2: reached {row['outcomes']['reached']:.6g}: a success" in capsys.readouterr().out
    assert stepper_command(monkeypatch, "replay", folder) == 0
    for given, said in (
        (("--values", "gaol=0.5"), "did you mean goal?"),
        (("--values", "goal"), "must be NAME=VALUE"),
        (("--contact", "hard"), "--contact has no effect on a study"),
    ):
        assert stepper_command(monkeypatch, "view", file, *given) == 1
        assert said in capsys.readouterr().err
    assert stepper_command(monkeypatch, "view", tmp_path / "arm.xml", "--episode", "1") == 1
    assert "--episode has no effect on a model" in capsys.readouterr().err


def test_an_interrupted_command_says_where_its_rows_are(capsys):
    with pytest.raises(KeyboardInterrupt), progress_kept_in(Path("out")):
        raise KeyboardInterrupt
    assert "finished rows are kept in out; the same command continues" in capsys.readouterr().err
