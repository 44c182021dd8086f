"""Needs and weights: friction that a heap uses, pairs that may touch, and inverse weights that follow masses."""

import mujoco
import numpy as np
import pytest
import stepper
from stepper.lab import Outcome, Parameter, Study
from stepper.lab.accuracy import needs
from stepper.lab.accuracy.needs import pairs_that_may_touch, unused_pairs
from stepper.lab.accuracy.traces import Distance
from stepper.lab.study.batches import Point, group_of, run_episodes, run_points, world_of
from stepper.lab.study.journal import Journal
from stepper.lab.study.touching import touching
from stepper.lab.study.worlds import own_fields

MASS, G = 8.0, 9.81
BOXES = "".join(
    f'<body name="{name}" pos="{x} 0 {z}"><freejoint/><geom name="{name}" type="box" size=".1 .1 .1"/></body>'
    for name, x, z in (("low", 0, 0.1), ("top", 0, 0.3), ("slides", 3, 0.1))
)
# The box that slides lies on a geom of its own: the floor's friction is the heap's alone.
HEAP = f"""<mujoco><option timestep=".005"/><worldbody><geom name="floor" type="box" pos="0 0 -.05" size=".5 .5 .05"/>
  <geom name="ice" type="box" pos="3 0 -.05" size=".5 .5 .05"/>{BOXES}</worldbody>{{more}}</mujoco>"""
FAR = """<mujoco><option gravity="0 0 0"/><worldbody>
  <body name="a"><freejoint/><geom name="a" size=".1" {masks}/><geom name="ear" pos="0 0 .2" size=".05" contype="0" conaffinity="0"/></body>
  <body name="b" pos="{place} 0 0"><freejoint/><geom name="b" size=".1" {masks}/></body></worldbody>
  <contact><pair geom1="b" geom2="{pair}"/>{more}</contact></mujoco>"""


@pytest.fixture(autouse=True)
def saves(monkeypatch):
    """Everything that is taken out saves a tenth, whatever the clock says."""
    monkeypatch.setattr(needs, "saving", lambda own, less, trace: (0.1, 0.05))


def push(now):
    """An eighth of its weight on the upper box, a half more than friction on the other one."""
    now.xfrc_applied[:, 2, 0] = MASS * G / 8
    now.xfrc_applied[:, 3, 0] = MASS * G * 1.5


def heap(more=""):
    options = stepper.Options(tolerance=1e-6)
    return stepper.lab.Study(
        model=HEAP.format(more=more), name="heap", options=options, controller=push, seconds=0.1, episodes=1, control=0.02
    )


def test_the_used_part_of_a_cone_is_that_of_statics():
    study = heap()
    pairs = {pair.names: pair for pair in touching(study, range(1))}
    # Of all contacts together the push over the weight.
    assert pairs["low", "top"].used == pytest.approx(1 / 8, rel=1e-6)
    assert pairs["floor", "low"].used == pytest.approx(1 / 16, rel=1e-6)
    # A contact that slides is on its cone, to the solver's tolerance.
    assert pairs["ice", "slides"].used == pytest.approx(pairs["ice", "slides"].friction, rel=1e-4)
    assert pairs["ice", "slides"].slides == pytest.approx(1.0)


def test_an_explicit_pair_has_its_own_cone():
    study = heap('<contact><pair geom1="low" geom2="top" friction=".5 .5 .005 .0001 .0001"/></contact>')
    assert {pair.names: pair for pair in touching(study, range(1))}["low", "top"].friction == 0.5


def contacts(model, qpos):
    """Whether geoms of a configuration have a contact."""
    sim = stepper.Stepper(model)
    sim.reset(qpos=qpos)
    sim.step()
    return len(sim.contacts()["force"]) > 0


@pytest.mark.parametrize("masks", ["", 'contype="0" conaffinity="0"'])
@pytest.mark.parametrize("more", ["", '<exclude body1="a" body2="b"/>'])
def test_explicit_pairs_that_never_come_near_are_taken_out(tmp_path, masks, more):
    study = stepper.lab.Study(model=FAR.format(masks=masks, more=more, place=3, pair="a"), seconds=0.1, episodes=1, control=0.02)
    found, smaller = unused_pairs(study, range(1), {}, Distance("m", study.seconds), 1e-4)
    assert (found.count, found.of, found.error) == (1, 1, 0.0)
    smaller.save(tmp_path / "smaller.stepper")
    near = np.array(study.loaded[0].qpos0)
    near[7] = 0.15
    assert contacts(study.loaded[0], near)
    # Neither the explicit pair nor, without it, the masks of its geoms give a contact.
    assert not contacts(stepper.load(tmp_path / "smaller.stepper"), near)


def test_explicit_pairs_may_touch_and_excluded_ones_do_not():
    balls = "".join(
        f'<body name="{name}" pos="{x} 0 1"><freejoint/><geom name="{name}" size=".1" contype="{mask}" conaffinity="{mask}"/></body>'
        for name, x, mask in (("a", 0, 0), ("b", 0.15, 0), ("c", 2, 1), ("d", 3, 1))
    )
    scene = f'<mujoco><worldbody>{balls}</worldbody><contact><pair geom1="b" geom2="a"/><exclude body1="c" body2="d"/></contact></mujoco>'
    assert pairs_that_may_touch(*stepper.lab.Study.from_model(scene).loaded) == {(1, 2)}


def test_pairs_of_bodies_are_those_whose_masks_meet():
    arm = """<mujoco><worldbody><geom type="plane" size="1 1 1"/><body pos="0 0 1"><joint/><geom size=".1"/>
      <body pos="1 0 0"><joint/><geom size=".1"/><body pos="1 0 0"><joint/><geom size=".1" contype="0" conaffinity="2"/>
      </body></body></body></worldbody></mujoco>"""
    # The world with two links; parent and child never, and the last link's mask meets nobody's.
    assert pairs_that_may_touch(*stepper.lab.Study.from_model(arm).loaded) == {(0, 1), (0, 2)}


def test_bodies_without_joints_belong_to_their_parent():
    """A hand on the last link of two, with a camera on it, and a lamp of the world: as many pairs as MuJoCo's filters leave."""
    arm = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/><body name="lamp" pos="0 2 1"><geom size=".1"/></body>
      <body name="one" pos="0 0 1"><joint axis="0 1 0"/><geom size=".1"/><body name="two" pos="1 0 0"><joint axis="0 1 0"/><geom size=".1"/>
      <body name="hand" pos="1 0 0"><geom size=".1"/><body name="camera" pos="0 .3 0"><geom size=".1"/></body></body></body></body>
      </worldbody></mujoco>"""
    model, compiled = stepper.lab.Study.from_model(arm).loaded
    names = {frozenset(model.body_names[k] for k in pair) for pair in pairs_that_may_touch(model, compiled)}
    # Neither what is rigid nor a link and the next one, with all that is on them: the floor and the lamp with four bodies each.
    assert names == {frozenset((one, other)) for one in ("world", "lamp") for other in ("one", "two", "hand", "camera")}
    assert "8 of" in str(model.explain())


@pytest.mark.parametrize("command", ["chart", "tune"])
def test_a_model_without_joints_is_refused(command, tmp_path):
    still = '<mujoco model="statue"><worldbody><body><geom size=".1"/></body></worldbody></mujoco>'
    given = {"error": "1 mm", "horizon": "0.1 s"} if command == "tune" else {}
    with pytest.raises(ValueError, match="statue has no joints, so that nothing moves: give it some, as <freejoint/>"):
        getattr(stepper.lab, command)(still, tmp_path, **given)


# Inverse weights of MuJoCo's law follow masses in a study, as MuJoCo's own do after `mj_setConst`.

# A pendulum at its limit and a ball on the floor, of soft constraints: how far they give follows from the weights.
SCENE = """<mujoco><option timestep=".002" integrator="Euler"/><default><geom solref=".05 1"/><joint solreflimit=".05 1"/></default>
  <worldbody><geom name="floor" type="plane" size="2 2 .1"/>
  <body name="ball" pos="0 0 .1" simple="false"><freejoint/><geom name="ball" size=".1" mass="1"/></body>
  <body name="arm" pos="1 0 1"><joint name="hinge" axis="0 1 0" range="-1 .2" limited="true" armature=".01"/>
    <geom size=".05" pos=".3 0 0" mass="1"/></body></worldbody></mujoco>"""
OUTCOMES = [Outcome(name="height", measure="body ball z"), Outcome(name="angle", measure="joint hinge")]
PARAMETERS = {
    "body_mass[ball]": 20.0,
    "body_mass[arm]": 20.0,
    "body_inertia[arm]": 20.0,
    "body_ipos[arm][0]": 1.5,
    "dof_armature[hinge]": 50.0,
}


def study(selector, factor, **changed):
    given = {
        "model": SCENE,
        "outcomes": OUTCOMES,
        "seconds": 0.2,
        "episodes": 1,
        "options": stepper.Options(contact="mujoco", tolerance=1e-12),
    }
    parameters = {"p": Parameter(selector, operation="scale", low=0.5, high=factor)}
    settings = {"MuJoCo": {"engine": "mujoco", "tolerance": 1e-12, "iterations": 200}}
    return Study(**(given | {"parameters": parameters, "settings": settings} | changed))


@pytest.mark.parametrize(("selector", "factor"), PARAMETERS.items())
def test_a_study_moves_as_mujoco_does(selector, factor):
    found = study(selector, factor)
    ours, theirs = (run_episodes(found, setting, [{"p": factor}], [0])[0]["outcomes"] for setting in ("stepper", "MuJoCo"))
    for name in ours:
        # Both solve each step to 1e-12; a hundred steps of contact leave a thousandth of a micrometre.
        # With the weights of the model as loaded, outcomes are off by 5e-4 and more.
        assert ours[name] == pytest.approx(theirs[name], abs=1e-9)


@pytest.mark.parametrize("selector", PARAMETERS)
def test_each_value_is_a_batch_of_its_own_by_that_law_alone(selector):
    soft, hard = study(selector, 2.0), study(selector, 2.0, options=stepper.Options())
    points = [Point({"p": value}) for value in (1.0, 1.5, 2.0)]
    assert len({group_of(soft, point) for point in points}) == 3
    assert len({group_of(hard, point) for point in points}) == 1
    with pytest.raises(ValueError, match="differs between environments of a batch"):
        world_of(soft, "stepper", [{"p": 1.0}, {"p": 2.0}])
    assert world_of(hard, "stepper", [{"p": 1.0}, {"p": 2.0}]).num_envs == 2


def test_rows_do_not_depend_on_the_points_beside_them(tmp_path):
    found = study("body_mass[ball]", 20.0)
    values = [{"p": value} for value in (0.5, 1.0, 20.0)]
    with Journal(tmp_path / "journal", found.name) as journal:
        rows = run_points(found, [Point(own) for own in values], journal)
    alone = [run_episodes(found, "stepper", [own], [0])[0] for own in values]
    assert [row["outcomes"] for row in rows] == [row["outcomes"] for row in alone]


def test_every_field_that_moves_the_weights_is_shared():
    """All fields of `randomize`: whether MuJoCo's inverse weights change with the field."""
    compiled = mujoco.MjModel.from_xml_string(SCENE)

    def weights(m):
        return np.concatenate([m.body_invweight0.ravel(), m.dof_invweight0])

    before = weights(compiled)
    for field in stepper.shared.fields.RANDOMIZED:
        if not hasattr(compiled, field) or not getattr(compiled, field).size:
            continue
        m = compiled.__copy__()
        getattr(m, field)[:] *= 1.3
        getattr(m, field)[:] += 0.01 * (getattr(m, field) == 0) * (field == "body_ipos")
        mujoco.mj_setConst(m, mujoco.MjData(m))
        moved = not np.allclose(weights(m), before, rtol=1e-12)  # Rounding.
        assert moved == (field not in own_fields(stepper.Options(contact="mujoco"))), field
