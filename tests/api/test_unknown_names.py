"""Names that do not exist and mistakes that are common: the message names the argument, the right name and the remedy."""

import inspect
import re
import subprocess
import sys

import mujoco
import numpy as np
import pytest
import stepper
from checks import every, raises
from hypothesis import example, given, strategies as st
from models import simulate, stepper_model
from stepper._hints import _guesses
from stepper.derivatives import rollout
from stepper.lab.study.parameters import Parameter, check
from stepper.shared.fields import RANDOMIZED

SCENE = """<mujoco><worldbody><body name="ball"><joint name="x" type="slide" axis="1 0 0"/><geom name="ball" size=".1" mass="1"/>
<site name="tip"/></body></worldbody><actuator><motor joint="x"/></actuator></mujoco>"""
MODEL = stepper.load(SCENE)
SIM = stepper.Stepper(MODEL)
CTRL = np.zeros((2, 1))
LONGEST = 200
"""Characters of a message, about two lines of a terminal; all fields of `Model.replace` by name take 1,300."""

TAKERS = {
    "wrt": lambda name: SIM.linearize((name,)),
    "parameters": lambda name: rollout(SIM, CTRL, parameters=(name,)),
    "Stepper.randomize": lambda name: SIM.randomize(**{name: None}),
    "Model.replace": lambda name: MODEL.replace(**{name: 1.0}),
    "selector": lambda name: check({"p": Parameter(name, low=0.1, high=1.0)}, MODEL),
}
"""Calls that take the name of a field, by the argument that has it."""
TWO = stepper.Stepper(
    stepper.load(SCENE.replace("<joint", '<joint type="slide" axis="0 1 0"/><joint').replace("<motor", '<motor joint="x"/><motor')), 2
)
"""Two environments, each with two joints and two motors."""
ARM = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/><body name="arm" pos="1 0 1"><joint name="hip" axis="0 1 0"/>
  <geom name="arm" size=".1" pos=".3 0 0"/><site name="tip"/></body></worldbody><actuator><motor name="motor" joint="hip"/></actuator>
  <sensor><accelerometer name="imu" site="tip"/></sensor></mujoco>"""
ARM_MODEL = stepper.load(ARM)
ARM_SIM = stepper.Stepper(ARM_MODEL, 4)
ROOTS = {"sim": stepper.Stepper, "model": stepper.Model, "stepper": stepper, "mujoco": mujoco}
OWNERS = {
    "engine": (stepper, ARM_SIM, ARM_MODEL), "Stepper": (ARM_SIM,), "Model": (ARM_MODEL,), "State": (ARM_SIM.get_state(),),
    "Body": (ARM_MODEL.body("arm"),), "Geom": (ARM_MODEL.geom("arm"),), "Joint": (ARM_MODEL.joint("hip"),),
    "Site": (ARM_MODEL.site("tip"),), "Sensor": (ARM_MODEL.sensor("imu"),),
}  # fmt: skip
BALL = "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"


@st.composite
def typos(draw):
    """A field, and its name with a letter left out, doubled, replaced, or two letters exchanged."""
    field = draw(st.sampled_from(sorted(RANDOMIZED)))
    at = draw(st.integers(0, len(field) - 2))
    letter = draw(st.sampled_from("abcdefghijklmnopqrstuvwxyz_"))
    before, one, two, after = field[:at], field[at], field[at + 1], field[at + 2 :]
    wrong = draw(st.sampled_from([two, one + one + two, letter + two, two + one]))
    return field, before + wrong + after


@given(typos(), st.sampled_from(sorted(TAKERS)))
def test_a_field_with_a_slip_of_the_pen_is_suggested(typo, argument):
    field, name = typo
    if hasattr(stepper.Model, name):  # Another field: "body_pos" from "body_ipos".
        return
    with pytest.raises(ValueError, match=rf"\b{field}\b") as error:
        TAKERS[argument](name)
    assert argument in str(error.value)
    assert f"there is no field {name!r}" in str(error.value)
    assert len(str(error.value)) <= LONGEST


@pytest.mark.parametrize(("name", "remedy"), [
    ("geom_margin", "make a stepper.Stepper of model.replace(geom_margin=...)"),
    ("zzz", "help(stepper.Stepper.randomize) lists the fields"),
])  # fmt: skip
def test_what_randomize_does_not_take_is_said_to_be_elsewhere(name, remedy):
    with pytest.raises(stepper.ModelError) as error:
        SIM.randomize(**{name: np.ones(1)})
    message = str(error.value)
    assert message.startswith(f"Stepper.randomize: there is no field {name!r}; ")
    assert remedy in message
    assert len(message) <= LONGEST


@pytest.mark.parametrize(("parameters", "error", "message"), [
    (("typo",), ValueError, r"^parameters: there is no field 'typo'"),
    (("qpos",), ValueError, r"^parameters has 'qpos', but gradients by the state .* are always computed: remove the name"),
    (("ctrl",), ValueError, r"^parameters has 'ctrl'"),
    (("gravity", "gravity"), ValueError, r"^parameters has 'gravity' more than once"),
    ((3,), TypeError, r"^parameters is \(3,\), must be a sequence of names"),
    ("gravity", TypeError, r"^parameters is 'gravity', must be a sequence of names, for example \('gravity',\)"),
    (("geom_friction[bell]",), ValueError, r"^parameters has 'geom_friction\[bell\]': no geom 'bell'; did you mean ball"),
])  # fmt: skip
def test_a_rollout_names_the_argument_that_it_was_given(parameters, error, message):
    with pytest.raises(error) as raised:
        rollout(SIM, CTRL, parameters=parameters)
    raised.match(message)
    assert "wrt" not in str(raised.value)


@pytest.mark.parametrize(("wrt", "error", "message"), [
    ((), ValueError, r"^wrt is \(\), must have at least one name"),
    (("qvel", "qvel"), ValueError, "^wrt has 'qvel' more than once"),
    (("qpos[x]",), ValueError, r"^wrt has 'qpos\[x\]', but qpos has no named elements: write 'qpos' alone"),
])  # fmt: skip
def test_names_of_linearize(wrt, error, message):
    raises(error, message, SIM.linearize, wrt)


@pytest.mark.parametrize(("text", "hint"), [
    ("geom_friction[ball]", "write 'geom_friction[ball][0]' (sliding friction), 'geom_friction[ball][1]' (torsional friction)"),
    ("body_mas[ball]", "did you mean body_mass"),
    ("body_mass", "names no body: write 'body_mass[name]'"),
    ("body_mass[ball][0]", "body_mass has no columns here; leave them out"),
    ("mass:ball", "write field[names][columns], as 'geom_friction[floor,box][0]'"),
    ("geom_margin[ball]", "'geom_margin' cannot be identified"),
])  # fmt: skip
def test_identify_names_the_right_selector(text, hint):
    with pytest.raises(ValueError, match=r"^(parameters|'body_mass')") as error:
        stepper.sysid.identify(MODEL, [], [text])
    assert hint in str(error.value)


@pytest.mark.parametrize(("call", "message"), [
    (lambda: SIM.randomize(geom_friction=0.3), r"^geom_friction is 0\.3 \(float\), a single number, must be an array of shape \(1, 3\)$"),
    (lambda: TWO.randomize(gravity=-9.81), r"^gravity is -9\.81 \(float\), a single number, must be an array of shape \(2, 3\)$"),
    (lambda: MODEL.replace(body_mass=2), r"^body_mass is 2 \(int\), a single number, must be an array of shape \(2,\)$"),
    (lambda: TWO.step(0.5), r"^ctrl is 0\.5 \(float\), a single number, must be an array of shape \(2, 2\) or \(2,\)$"),
    (lambda: TWO.set_state(qpos=np.array(1.0)), r"^qpos has shape \(\), must be \(2, 2\) or \(2,\)$"),
    (lambda: MODEL.replace(body_mass=[2.0]), r"^body_mass has shape \(1,\), must be \(2,\)$"),
])  # fmt: skip
def test_a_single_number_for_an_array_is_named_as_one(call, message):
    raises(ValueError, message, call)


@example("geom_restitution", 0.5)  # One geom: a number has the shape of the model's array once it is an array.
@given(st.sampled_from(sorted(RANDOMIZED)), st.floats(0.1, 1.0))
def test_every_field_names_a_single_number(field, number):
    with pytest.raises(ValueError, match=f"^{field} is .* a single number, must be an array of shape") as error:
        TWO.randomize(**{field: number})
    assert str((2, *np.shape(getattr(TWO.model, field)))) in str(error.value)


@every(envs=[None, [1]], field=sorted(RANDOMIZED))
def test_values_of_one_environment_are_named_with_the_call_that_repeats_them(field, envs):
    own = np.asarray(getattr(TWO.model, field), float)
    if own.ndim == 0 or own.size == 0 or own.shape == (1,):
        pytest.skip("a single number, or none")
    must = (2 if envs is None else 1, *own.shape)
    with pytest.raises(ValueError, match=rf"must be {re.escape(str(must))}; np\.broadcast_to\(value, {re.escape(str(must))}\) gives all"):
        TWO.randomize(envs=envs, **{field: own})


def test_a_single_number_is_taken_where_one_is_meant():
    """Numbers of the model, and arrays of one number of a single environment."""
    assert MODEL.replace(timestep=0.001).timestep == 0.001
    SIM.step(0.5)
    SIM.set_state(qpos=0.1)
    assert SIM.qpos.tolist() == [0.1]


@pytest.mark.parametrize(("attempt", "hint"), [
    (lambda: SIM.contacts()["frc"], "no field of name frc"),
    (lambda: SIM.jacobian("tip"), "but a site is: jacobian(site='tip')"),
    (lambda: SIM.qpso, "did you mean qpos"),
    (lambda: SIM.geom_frictoin, "did you mean sim.model.geom_friction"),
    (lambda: SIM.flux, "a stepper.Stepper has no attribute 'flux'"),
    (lambda: MODEL.body_mas, "a stepper.Model has no attribute 'body_mas'; did you mean body_mass"),
    (lambda: setattr(SIM, "xfrc_aplied", 0), "no attribute 'xfrc_aplied'; did you mean xfrc_applied"),
    (lambda: setattr(MODEL.joint("x"), "axis", 1), "change the file"),
    (lambda: SIM.__array_interfac__, "has no attribute '__array_interfac__'"),
])  # fmt: skip
def test_an_unknown_attribute_has_a_hint(attempt, hint):
    with pytest.raises((AttributeError, KeyError, ValueError)) as error:
        attempt()
    assert hint in str(error.value)


def test_attributes_of_one_class_are_hints_of_the_other():
    for owner, other, place in ((MODEL, stepper.Stepper, "sim."), (SIM, stepper.Model, "model.")):
        for name in {name for name in dir(other) if name[0] != "_"} - {*dir(owner)}:
            with pytest.raises(AttributeError) as error:
                getattr(owner, name)
            assert f"{place}{name}" in str(error.value)


@pytest.mark.parametrize("field", sorted(RANDOMIZED))
def test_fields_of_randomize_are_hints_of_a_stepper(field):
    """Reading and assigning: the values of an environment are not those of the model."""
    for attempt in (lambda: getattr(SIM, field), lambda: setattr(SIM, field, 1.0)):
        raises(AttributeError, rf"sim\.model\.{field}", attempt)


def absent_names(text):
    """Names and keywords after sim, model, stepper or mujoco in a text that do not exist."""
    wrong = []
    for root, path, after in re.findall(r"(?<![\w.])(sim|model|stepper|mujoco)\.([\w.]*\w)(\([^()]*)?", text):
        thing = ROOTS[root]
        for name in path.split("."):
            if name not in dir(thing) and not hasattr(thing, name):
                wrong.append(f"{root}.{path}")
                break
            if name == "adapters":  # Imports of its modules need other libraries.
                break
            thing = {"model": stepper.Model, "recorder": stepper.Recorder}.get(name) or getattr(thing, name)
        else:
            keywords = re.findall(r"(\w+)=", after)
            known = inspect.signature(thing).parameters if keywords else {}
            fields = any(one.kind is one.VAR_KEYWORD for one in known.values())
            wrong += [f"{root}.{path}({keyword}=)" for keyword in keywords if keyword not in known and not fields]
    return wrong


@pytest.mark.parametrize("section", _guesses())
def test_replacements_exist(section):
    for text in {*_guesses()[section].values()}:
        assert absent_names(text) == [], text


def test_names_of_the_engine_are_absent_from_it():
    for name in _guesses()["engine"]:
        assert not all(hasattr(owner, name) for owner in (stepper, ARM_SIM, ARM_MODEL)), name
    for section, owner in {"Model": ARM_MODEL, "Stepper": ARM_SIM, "State": ARM_SIM.get_state(), "Body": ARM_MODEL.body(1)}.items():
        assert [name for name in _guesses()[section] if hasattr(owner, name)] == []


@pytest.mark.parametrize("section", OWNERS)
def test_every_listed_attribute_is_answered_with_its_replacement(section):
    for name, text in _guesses()[section].items():
        for owner in (owner for owner in OWNERS[section] if not hasattr(owner, name)):
            with pytest.raises(AttributeError) as error:
                getattr(owner, name)
            own = _guesses().get(type(owner).__name__, {}).get(name, text)
            assert own.removeprefix(": ") in str(error.value), (owner, name)


def test_every_listed_field_is_answered_with_its_replacement():
    for name, text in _guesses()["fields"].items():
        with pytest.raises(ValueError, match="there is no field") as error:
            ARM_SIM.randomize(**{name: 1.0})
        assert text.removeprefix(": ") in str(error.value), name


@pytest.mark.parametrize("name", ["contacts", "energy", "mass_matrix", "memory", "momentum", "worst_row"])
def test_a_method_without_parentheses_is_an_error_with_the_call(name):
    """Comparisons, sums, loops, texts and truth values of a method raise an error, because they were meant for its result."""
    method = getattr(ARM_SIM, name)
    for use in (
        *(bool, float, iter, len, np.asarray, np.sum, "{:.3f}".format),
        *(lambda x: x == 0.0, lambda x: x != 0.0, lambda x: x > 0.0, lambda x: x[0], lambda x: 2 * x, lambda x: x + 1, lambda x: 1 - x),
    ):
        raises(TypeError, rf"^sim\.{name} is a method: write sim\.{name}\(\)$", use, method)
    assert f"sim.{name}() calls it" in repr(method)
    assert inspect.signature(method) == inspect.signature(method.__wrapped__)
    assert method.__doc__ == getattr(stepper.Stepper, name).__doc__
    with pytest.raises(AttributeError, match=r"has no attribute|without an attribute '__array_interfac__'$"):
        getattr(method, "__array_interfac__")  # noqa: B009


@pytest.fixture
def sim():
    return simulate(stepper_model("dm_control/humanoid"), 3)


@pytest.mark.parametrize(("mistake", "kind", "message"), [
    (lambda sim: sim.reset([0.0, 1.0]), TypeError, r"envs has 0\.0, of type float64: give a mask \(3,\) of bool, or indices"),
    (lambda _: stepper.Stepper("hopper.xml"), TypeError, r"model is 'hopper.xml' \(str\), must be a stepper.Model: stepper\.load\(...\)"),
    (lambda _: simulate(BALL).reset(keyframe="up"), KeyError, r"no keyframe .*up.*this model has none; give reset\(qpos=..., qvel=...\)"),
    (lambda _: simulate(BALL).reset(keyframe=0), KeyError, r"no keyframe 0: this model has none; give reset\(qpos=..., qvel=...\)"),
    (lambda sim: sim.reset(keyframe=1.5), TypeError, "keyframe, if it is no name, is 1.5"),
    (lambda sim: sim.get_state(env=3), IndexError, "env is 3, must be below 3"),
    (lambda _: stepper.load(BALL, package_dirs="meshes"), TypeError, "package_dirs is 'meshes', must be a list of folders"),
    (lambda _: stepper.load(BALL, package_dirs=[3]), TypeError, r"an entry of package_dirs is 3 \(int\), must be a path"),
    (lambda _: stepper.load(BALL, strict="no"), TypeError, "strict is 'no', must be True or False"),
    (lambda _: stepper.load(BALL, overlaps="drop"), ValueError, 'overlaps is \'drop\', must be "keep" or "exclude"'),
    (lambda sim: setattr(sim, "recorder", 2.5), TypeError, r"recorder is 2\.5 .* must be None or have the methods step, reset"),
    (lambda sim: sim.inverse_dynamics([["a"]]), TypeError, r"qacc is \[\['a'\]\], must be an array of numbers"),
    (lambda sim: sim.inverse_dynamics(np.full(sim.model.nv, np.nan)), ValueError, r"qacc\[0\] is nan, must be a finite number"),
    (lambda _: simulate(BALL).inverse_dynamics([1.0]), ValueError, r"qacc has shape \(1,\), must be \(6,\)$"),
    (lambda sim: sim.linearize(3), TypeError, r"wrt is 3, must be a sequence of names"),
    (lambda sim: sim.linearize(nstep="a"), TypeError, "nstep is 'a', must be a whole number of at least 1"),
    (lambda sim: sim.linearize(nstep=None), TypeError, "nstep is None, must be a whole number of at least 1"),
    (lambda sim: sim.linearize(nstep=0), ValueError, "nstep is 0, must be a whole number of at least 1"),
    (lambda sim: sim.linearize(method=np.zeros(2)), ValueError, r"method is array\(.*, must be 'fd' or 'implicit'"),
    (lambda sim: sim.linearize(centered=None), TypeError, "centered is None, must be True or False"),
    (lambda sim: sim.linearize(method=2), ValueError, "method is 2, must be 'fd' or 'implicit'"),
    (lambda sim: sim.linearize(centered=2), TypeError, "centered is 2, must be True or False"),
    (lambda sim: sim.linearize(sensors="no"), TypeError, "sensors is 'no', must be True or False"),
    (lambda sim: sim.set_state(sim.qpos, keep_warmstart=1), TypeError, "keep_warmstart is 1, must be True or False"),
    (lambda sim: sim.linearize(ctrl=[["a"]]), TypeError, r"ctrl is \[\['a'\]\], must be an array of numbers"),
    (lambda _: stepper.derivatives.rollout("sim", np.zeros(3)), TypeError, r"sim is 'sim' \(str\), must be a stepper.Stepper"),
    (lambda sim: stepper.derivatives.rollout(sim, np.zeros((2, sim.model.nu)), True), TypeError, "nstep is True, must be a whole number"),
    (lambda sim: stepper.derivatives.rollout(sim, np.zeros((2, sim.model.nu)), every=0), ValueError, "every is 0, must be a whole number"),
    (lambda sim: sim.randomize({"gravity[2]": "down"}), TypeError, r"'gravity\[2\]' is 'down', must be an array of numbers"),
    (lambda sim: sim.model.replace({"geom_friction": [[1], [2, 3]]}), TypeError, "must be an array of numbers, with rows of equal length"),
    (lambda sim: sim.step(frame_skip=2), TypeError, r"Stepper.step\(\) takes no 'frame_skip'; there are: ctrl, nstep"),
    (lambda sim: setattr(sim.model.body(1), "mass", 2.0), AttributeError, r"mass of a .*body cannot .*: model.replace\(body_mass="),
    (lambda sim: setattr(sim.model.joint(0), "damping", 2.0), AttributeError, r"damping of a .*joint cannot .*model.replace\(dof_damping="),
    (lambda sim: setattr(sim.model.body(1), "parentid", 2), AttributeError, "parentid of .* is defined in the model's file"),
    (lambda sim: sim.rays([0, 0, 1], [0, 0, -1]), ValueError, r"points has shape \(3,\), must be \(n, 3\) for n rays, as \[\[0, 0, 1\]\]"),
    (lambda sim: sim.model.replace(body_mass={"torso": 2.0}), TypeError, r"body_mass is a dict, .* {'body_mass\[element\]': value}"),
    (lambda sim: sim.randomize(geom_friction={"floor": 0.2}), TypeError, r"geom_friction is a dict, .* {'geom_friction\["),
    (lambda sim: sim.randomize(body_mass=[[1.0]], body_mas=2), stepper.ModelError, "there is no field 'body_mas'; did you mean body_mass"),
    (lambda sim: sim.rays(pnt=[[0, 0, 1]], vec=[[0, 0, -1]]), TypeError, "takes no 'pnt'; did you mean points"),
    (lambda sim: sim.rollout(actions=[[1.0]]), TypeError, r"takes no 'actions'; there are: ctrl"),
    (lambda sim: sim.rollout(), TypeError, r"Stepper.rollout\(\) lacks the argument ctrl"),
    (lambda sim: sim.read("geom_friction"), ValueError, r"there is no quantity 'geom_friction'"),
    (lambda sim: sim.record(3), TypeError, r"path is 3 \(int\), must be a path"),
    (lambda sim: sim.record("run", chunk="8"), TypeError, r"chunk \(bytes\) is '8', must be a whole number of at least 1"),
    (lambda _: stepper.recording.verify(3), TypeError, r"path is 3 \(int\), must be a path"),
    (lambda _: stepper.policies.load(3), TypeError, r"path is 3 \(int\), must be a path"),
    (lambda _: stepper.policies.load("none.npz"), FileNotFoundError, "there is no policy file 'none.npz'"),
    (lambda _: stepper.policies.evaluate(3, "stepper/Hopper-v5"), TypeError, "policy is 3, must be a stepper.policies.Policy"),
    (lambda _: stepper.policies.evaluate(np.zeros_like, 3), TypeError, "env is 3, must be the id of an environment"),
    (lambda _: stepper.policies.evaluate(np.zeros_like, "x", episodes="8"), TypeError, "episodes is '8', must be a whole number"),
])  # fmt: skip
def test_a_mistake_is_told_what_to_do(sim, mistake, kind, message):
    raises(kind, message, mistake, sim)


def test_contacts_of_all_environments_are_one_array(sim):
    qpos = np.tile(sim.model.qpos0, (3, 1))
    qpos[:, 2] = [0.05, 5.0, 0.2]
    sim.set_state(qpos=qpos)
    sim.step()
    every = sim.contacts()
    assert set(every["env"].tolist()) == {0, 2}
    assert every.dtype.names[0] == "env"
    for env in range(3):
        one = sim.contacts(env)
        for name in one.dtype.names:
            assert np.array_equal(every[every["env"] == env][name], one[name]), name
    every["pos"][:] = 0  # an array of one's own


def test_sensordata_ideal_is_made_once():
    """And anew when anything changes that it depends on."""
    scene = """<mujoco><worldbody><body name="hand" mocap="true" pos="0 0 1"/>
      <body name="arm"><joint name="hinge"/><geom size=".1" pos=".2 0 0"/><site name="tip" pos=".2 0 0"/></body></worldbody>
      <actuator><motor joint="hinge"/></actuator>
      <sensor><framepos objtype="xbody" objname="hand"/><accelerometer site="tip"/><jointpos joint="hinge"/></sensor></mujoco>"""
    sim = stepper.Stepper(stepper.load(scene), 2)

    def check():
        """Reads twice, and compares with a stepper that has never read."""
        first, second = sim.sensordata_ideal, sim.sensordata_ideal
        assert first is not second
        assert np.array_equal(first, second)
        other = simulate(sim.model, 2, qpos=sim.get_state())
        other.mocap_pos, other.qfrc_applied = sim.mocap_pos, sim.qfrc_applied
        if "gravity" in sim.randomized:
            other.randomize(gravity=sim.randomized["gravity"])
        assert np.array_equal(first, other.sensordata_ideal)
        return first

    changes = [
        lambda: None,
        lambda: sim.step(np.ones(1)),
        lambda: (sim.mocap_pos.__setitem__((0, 0), [1, 2, 3]), sim.step()),
        lambda: sim.reset([True, False]),
        lambda: sim.set_state(qpos=[0.3]),
        lambda: sim.qfrc_applied.__setitem__((0, 0), 4.0),
        lambda: sim.randomize(gravity=np.array([[0, 0, -1], [0, 0, -2]], float)),
        lambda: sim.rollout(np.zeros((2, 1))),
    ]
    before = None
    for change in changes:
        change()
        now = check()
        assert before is None or not np.array_equal(now, before)
        before = now


@pytest.mark.parametrize("version", ["3.3.0", "2.1", None])
def test_another_mujoco_is_refused_with_the_version_that_is_needed(tmp_path, version):
    (tmp_path / "mujoco.py").write_text(f"class MjModel: pass\n__version__ = {version!r}\n" if version else "class MjModel: pass\n")
    program = f"""
import sys; sys.path.insert(0, {str(tmp_path)!r})
import stepper, mujoco
for source in ('<mujoco/>', mujoco.MjModel()):
    try: stepper.load(source)
    except ImportError as error: print(error)
"""
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    lines = run.stdout.strip().splitlines()
    assert len(lines) == 2
    for line in lines:
        assert f"are read by MuJoCo 4, and MuJoCo {version or 'of an unknown version'} is installed here" in line
        assert 'pip install "stepper-sim[mjcf]"' in line
