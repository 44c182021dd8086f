"""Inverse weights of MuJoCo's law follow masses in a study, as MuJoCo's own do after `mj_setConst`."""

import mujoco
import numpy as np
import pytest
import stepper
from stepper.lab import Outcome, Parameter, Study
from stepper.lab.study.batches import Point, group_of, run_episodes, run_points, world_of
from stepper.lab.study.journal import Journal
from stepper.lab.study.worlds import own_fields

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
