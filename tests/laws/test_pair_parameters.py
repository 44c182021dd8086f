"""Numbers of explicit pairs: contacts have them in place of the geoms' numbers, and nothing that a pair overrides is lost in silence."""

import numpy as np
import pytest
import stepper
from hypothesis import example, given, settings
from hypothesis import strategies as st
from stepper.shared.fields import RANDOMIZED

FREE = '<body name="{0}" pos="{1} 0 .05"><freejoint/><geom name="{0}" type="box" size=".1 .1 .05" mass="1"/></body>'
SCENE = f"""
<mujoco><worldbody><geom name="floor" type="plane" size="9 9 1"/>{FREE.format("paired", 0)}{FREE.format("loose", 1)}</worldbody>
<contact><pair name="{{name}}" geom1="floor" geom2="paired" friction=".3 .3 .01 .001 .001" condim="{{condim}}"/></contact></mujoco>"""
SPEED = 1.0


def model(name: str = "sole", condim: int = 3) -> stepper.Model:
    return stepper.load(SCENE.format(name=name, condim=condim))


def distances(sim: stepper.Stepper) -> np.ndarray:
    """How far both boxes slide from a speed of 1 m/s, (num_envs, 2) m."""
    velocity = np.zeros((sim.num_envs, 12))
    velocity[:, [0, 6]] = SPEED
    sim.set_state(qvel=velocity)
    start = sim.qpos[:, [0, 7]]
    sim.step(nstep=800)
    return np.asarray(sim.qpos[:, [0, 7]] - start)


def coulomb(friction):
    return SPEED**2 / (2 * 9.81 * np.asarray(friction))


def test_friction_of_a_pair_is_randomized():
    friction = np.array([0.2, 0.4, 0.8])
    sim = stepper.Stepper(model(), 3)
    own = np.tile(sim.model.pair_friction, (3, 1, 1))
    own[:, 0, 0] = friction
    sim.randomize(pair_friction=own)
    assert np.array_equal(sim.randomized["pair_friction"], own)
    found = distances(sim)
    # A step of 2 ms at 1 m/s is 2 mm, and the box stops within one.
    assert np.abs(found[:, 0] - coulomb(friction)).max() < 2e-3
    assert np.abs(found[:, 1] - coulomb(1.0)).max() < 2e-3
    for env in range(3):
        alone = stepper.Stepper(sim.model.replace(pair_friction=own[env]), 1)
        assert np.array_equal(distances(alone)[0], found[env])
    sim.randomize()
    assert sim.randomized == {}


def test_restitution_of_a_pair_is_randomized():
    sim = stepper.Stepper(model(), 2)
    sim.randomize(pair_restitution=np.array([[0.0], [0.5]]))
    sim.set_state(qvel=np.array([0, 0, -1.0, 0, 0, 0] * 2))
    sim.step(nstep=5)
    # Newton's law: a half of the speed of 1 m/s, less what gravity takes in five steps.
    assert np.allclose(sim.qvel[:, [2, 8]], [[0, 0], [0.5, 0]], atol=5 * 0.002 * 9.81 + 1e-6)


@pytest.mark.parametrize(("field", "pair_field"), [("geom_friction", "pair_friction"), ("geom_restitution", "pair_restitution")])
def test_what_a_pair_overrides_is_refused_unless_the_pair_is_given(field, pair_field):
    sim = stepper.Stepper(model(), 2)
    for geom, refused in (("paired", True), ("floor", True), ("loose", False)):
        values = np.tile(getattr(sim.model, field), (2, *[1] * np.ndim(getattr(sim.model, field))))
        values[1, sim.model.geom(geom).id] = 0.25
        if not refused:
            sim.randomize(**{field: values})
            assert np.array_equal(sim.randomized[field], values)
            sim.randomize()
            continue
        with pytest.raises(stepper.ModelError) as error:
            sim.randomize(**{field: values})
        for part in ("environment 1", f'geom "{geom}"', field, 'explicit pair "sole"', f"give {pair_field} too"):
            assert part in str(error.value)
        assert sim.randomized == {}, "nothing is changed"
        own = np.tile(getattr(sim.model, pair_field), (2, *[1] * np.ndim(getattr(sim.model, pair_field))))
        sim.randomize(**{field: values, pair_field: own})
        assert set(sim.randomized) == {field, pair_field}
        sim.randomize(**{field: values})
        with pytest.raises(stepper.ModelError, match="explicit pair"):
            sim.randomize(**{pair_field: None})
        sim.randomize()


def test_pairs_given_to_one_environment_count_for_all():
    """As `randomize` documents: the pairs of the others keep the model's numbers."""
    sim = stepper.Stepper(model(), 2)
    friction = np.tile(sim.model.geom_friction, (2, 1, 1))
    friction[1, sim.model.geom("paired").id] = 0.25
    first = np.array([True, False])
    sim.randomize(first, pair_friction=np.full((2, 1, 3), 0.5))
    sim.randomize(~first, geom_friction=friction)
    assert np.array_equal(sim.randomized["pair_friction"][1], sim.model.pair_friction)


def test_a_mask_leaves_the_other_environments_rows_alone():
    sim = stepper.Stepper(model(), 2)
    values = np.tile(sim.model.geom_friction, (2, 1, 1))
    values[1] = 0.25
    sim.randomize(np.array([True, False]), geom_friction=values)


@pytest.mark.parametrize(("field", "pair_field"), [
    ("geom_friction", "pair_friction"), ("geom_restitution", "pair_restitution"), ("geom_margin", "pair_margin"),
    ("geom_gap", "pair_gap"), ("geom_condim", "pair_dim"), ("geom_solref", "pair_solref"), ("geom_solimp", "pair_solimp"),
    ("geom_solmix", "pair_solref"), ("geom_stiffness", "pair_stiffness"),
])  # fmt: skip
def test_replace_has_the_same_rule(field, pair_field):
    scene = model()
    values = np.array(getattr(scene, field))
    values[1] = {"geom_condim": 1, "geom_stiffness": 1e5}.get(field, 0.5 * values[1] + 0.01)
    with pytest.raises(stepper.ModelError, match=rf'geom "paired": {field} .* explicit pair "sole" instead; give {pair_field} too'):
        scene.replace(**{field: values})
    both = scene.replace(**{field: values, pair_field: getattr(scene, pair_field)})
    assert np.array_equal(getattr(both, field), values)


def test_a_pair_without_friction_overrides_none():
    scene = model(condim=1)
    assert scene.replace(geom_friction=0.5 * np.asarray(scene.geom_friction)).geom_friction[1, 0] == 0.5


def test_pairs_are_elements():
    scene = model()
    pair = scene.pair("sole")
    assert (scene.npair, scene.pair_names, pair.id, pair.geom1, pair.geom2, pair.dim) == (1, ["sole"], 0, 0, 1, 3)
    assert pair.friction.tolist() == scene.pair_friction[0].tolist() == [0.3, 0.01, 0.001]
    with pytest.raises(KeyError, match="did you mean sole"):
        scene.pair("soul")


def test_derivatives_by_friction_of_a_pair_are_those_of_its_contacts():
    sim = stepper.Stepper(model(), options=stepper.Options(tolerance=1e-12))
    sim.set_state(qvel=[1.0, 0, 0, 0, 0, 0] * 2)
    sim.step(nstep=2)
    found = sim.linearize(("pair_friction[sole]", "geom_friction[loose]"))
    # Sliding takes mu g h of the speed in a step.
    slope = -9.81 * 0.002
    velocities = found.blocks["pair_friction[sole]"][sim.model.nv :]
    assert np.isclose(velocities[0, 0], slope, rtol=1e-6)
    assert np.abs(velocities[6:]).max() < 1e-6
    with pytest.raises(stepper.ModelError, match="explicit pair"):
        sim.linearize(("geom_friction[paired]",))
    assert np.abs(sim.linearize(("geom_friction[paired]", "pair_friction")).blocks["geom_friction[paired]"]).max() < 1e-6


def test_kinks_are_seen_at_the_friction_of_the_pair():
    """A box that friction just holds is as near to slipping with the pair's friction as with geoms of the same friction."""
    text = SCENE.format(name="", condim=3)
    pair = text[text.index("<contact>") : text.index("</mujoco>")]
    paired, plain = stepper.load(text), stepper.load(text.replace(pair, "").replace("<geom", '<geom friction=".3 .01 .001"'))
    found = []
    for scene in (paired, plain):
        sim = stepper.Stepper(scene, options=stepper.Options(tolerance=1e-12))
        sim.qfrc_applied[0] = 0.99 * 0.3 * 9.81
        sim.step(nstep=3)
        found.append(sim.linearize(("qvel",)))
    assert np.isfinite(found[1].kink_distance)
    # Both solve the same problem to 1e-12 m/s, of which the numbers that vanish at a kink have nine digits.
    assert np.isclose(found[0].kink_distance, found[1].kink_distance, rtol=1e-3)
    assert np.array_equal(found[0].kinks["qvel"], found[1].kinks["qvel"])


def test_identification_has_the_same_rule():
    from stepper.sysid.parameters import bind

    scene = model(name="")
    with pytest.raises(ValueError, match=r"geom_friction\[paired\]\[0\].*explicit pair \"#0\".*identify 'pair_friction\[0\]\[0\]' too"):
        bind(["geom_friction[paired][0]"], scene)
    assert [block.labels for block in bind(["geom_friction[loose][0]"], scene)] == [("geom_friction[loose][0]",)]
    blocks = bind(["geom_friction[paired][0]", "pair_friction[0][0]", "pair_restitution[0]"], scene)
    assert [block.labels[0] for block in blocks] == ["geom_friction[paired][0]", "pair_friction[0][0]", "pair_restitution[0]"]


def test_a_study_has_the_same_rule():
    from stepper.lab.study.parameters import Parameter, check

    friction = Parameter("geom_friction[paired][0]", low=0.1, high=1.0)
    with pytest.raises(ValueError, match=r"parameter 'mu'.*explicit pair \"sole\".*give a parameter \"pair_friction\[sole\]"):
        check({"mu": friction}, model())
    of_pair = Parameter("pair_friction[floor/paired][0]", low=0.1, high=1.0)
    check({"mu": friction, "nu": of_pair}, model())


def test_the_table_of_fields_is_that_of_the_binary():
    sim, taken = stepper.Stepper(model(), 1), []
    for field in (name for name in dir(stepper.Model) if isinstance(getattr(stepper.Model, name), property)):
        try:
            sim.randomize(**{field: None})
            taken.append(field)
        except stepper.ModelError:
            continue
    assert sorted(taken) == sorted(RANDOMIZED)


GEOMS = ("floor", "a", "b", "c")
FRICTION = st.sampled_from([0.1, 0.5, 1.0])
PAIRS = st.lists(st.tuples(st.sampled_from(GEOMS[:1] + GEOMS[1:3]), st.sampled_from(GEOMS[2:]), FRICTION), max_size=3)


@settings(max_examples=40, deadline=None)
@example([("a", "b", 0.1), ("floor", "b", 0.1)], [0.1] * 4, [0.1, 0.5, 0.1])
@given(PAIRS, st.lists(FRICTION, min_size=4, max_size=4), st.none() | st.lists(FRICTION, min_size=3, max_size=3))
def test_drawn_friction_acts_or_is_refused(pairs, friction, drawn):
    """An environment has the bits of a stepper of the model that its author gave the same numbers, or the draw is an error."""
    # In the order of the compiled model, which is that of the bodies.
    pairs = sorted((pair for pair in pairs if pair[0] != pair[1]), key=lambda pair: sorted(map(GEOMS.index, pair[:2])))
    drawn = drawn[: len(pairs)] if drawn is not None and pairs else None
    sim = stepper.Stepper(_scene(pairs, [1.0] * 4), 1)
    fields = {"geom_friction": _rows(friction)} | ({} if drawn is None else {"pair_friction": _rows(drawn)})
    overridden = any(friction[GEOMS.index(geom)] != 1.0 for pair in pairs for geom in pair[:2])
    if overridden and drawn is None:
        with pytest.raises(stepper.ModelError, match="explicit pair"):
            sim.randomize(**fields)
        return
    sim.randomize(**fields)
    authored = stepper.Stepper(
        _scene([(a, b, mu) for (a, b, _), mu in zip(pairs, drawn or [mu for *_, mu in pairs], strict=True)], friction), 1
    )
    for one in (sim, authored):
        one.set_state(qvel=[0.3, 0.1, 0, 0, 0, 0] * 3)
        one.step(nstep=5)
    assert np.array_equal(sim.qvel, authored.qvel)


def _rows(friction):
    return np.array([[[mu, 0.005, 0.0001] for mu in friction]])


def _scene(pairs, friction):
    box = '<body pos="0 0 {z}"><freejoint/><geom name="{name}" type="box" size=".1 .1 .05" friction="{mu} .005 .0001"/></body>'
    boxes = "".join(box.format(z=0.05 + 0.1 * k, name=name, mu=friction[k + 1]) for k, name in enumerate(GEOMS[1:]))
    listed = "".join(f'<pair geom1="{a}" geom2="{b}" friction="{mu} {mu} .005 .0001 .0001"/>' for a, b, mu in pairs)
    return stepper.load(
        f'<mujoco><worldbody><geom name="floor" type="plane" size="9 9 1" friction="{friction[0]} .005 .0001"/>{boxes}</worldbody>'
        f"<contact>{listed}</contact></mujoco>"
    )
