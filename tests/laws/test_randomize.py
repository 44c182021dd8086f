"""Parameters per environment and per pair: each environment is, bit for bit, one of a stepper of its own model.

All comparisons are of raw bytes. Both sides read numbers that come out of one function (`Plan::params_of`) and do the same
operations with them, so that not even rounding may differ.
"""

import functools

import numpy as np
import pytest
import stepper
from checks import every, raises
from hypothesis import example, given, settings, strategies as st
from meadow import FIELDS, MEADOW
from models import contact_bits, simulate, stepper_model
from stepper.shared.fields import RANDOMIZED

N, CALLS, NSTEP = 11, 40, 3
GEOMS = ("floor", "a", "b", "c")
FRICTION = st.sampled_from([0.1, 0.5, 1.0])
PAIRS = st.lists(st.tuples(st.sampled_from(GEOMS[:1] + GEOMS[1:3]), st.sampled_from(GEOMS[2:]), FRICTION), max_size=3)


@functools.cache
def meadow() -> stepper.Model:
    return stepper.load(MEADOW)


MODELS = {"meadow": meadow, "humanoid": lambda: stepper_model("dm_control/humanoid")}


def draw(model: stepper.Model, names, n: int = N, seed: int = 0) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    return {name: FIELDS[name](model, n, rng) for name in names}


def start(model: stepper.Model, n: int = N):
    """Velocities and controls of environments that are all different."""
    rng = np.random.default_rng(1)
    return rng.normal(0, 0.5, (n, model.nv)), rng.uniform(-1, 1, (CALLS, n, model.nu))


def roll(sim: stepper.Stepper, envs=slice(None), n: int = N) -> stepper.Stepper:
    qvel, controls = start(sim.model, n)
    sim.set_state(qvel=qvel[envs])
    for ctrl in controls[:, envs]:
        sim.step(ctrl, nstep=NSTEP)
    return sim


def everything(sim: stepper.Stepper, env: int | None) -> list[bytes]:
    """Bits of all that can be read of an environment; None is the only one."""
    own = [sim.qpos, sim.qvel, sim.residual, np.uint32(sim.iterations), np.uint32(sim.status), sim.sensordata]
    own += [sim.mass_matrix(), sim.qfrc_bias, sim.qacc_smooth, *sim.energy(), *sim.momentum()]
    return [np.asarray(x if env is None else x[env]).tobytes() for x in own] + [np.asarray(contact_bits(sim.contacts(env or 0))).tobytes()]


@every(name=FIELDS, scene=MODELS)
def test_an_environment_is_one_of_its_own_model(scene, name):
    model = MODELS[scene]()
    fields = draw(model, [name])
    sim = stepper.Stepper(model, N)
    sim.randomize(**fields)
    roll(sim)
    plain = roll(stepper.Stepper(model, N))
    changes = not np.array_equal(fields[name], np.broadcast_to(getattr(model, name), fields[name].shape))
    assert changes == (everything(sim, 0) != everything(plain, 0))
    assert any(len(sim.contacts(env)) for env in range(N))
    for env in (0, 7, N - 1):
        own = stepper.Stepper(model.replace(**{name: fields[name][env]}))
        assert everything(sim, env) == everything(roll(own, env), None), env


@every(precision=["f64", "f32"], integrator=["midpoint", "implicit", "euler", "rk4"], scene=MODELS)
def test_all_fields_together(scene, integrator, precision):
    model = MODELS[scene]()
    fields, options = draw(model, FIELDS), stepper.Options(integrator=integrator)
    sim = stepper.Stepper(model, N, options=options, precision=precision, threads=2)
    sim.randomize(**fields)
    roll(sim)
    for env in (3, N - 1):
        own = stepper.Stepper(model.replace(**{name: values[env] for name, values in fields.items()}), options=options, precision=precision)
        assert everything(sim, env) == everything(roll(own, env), None), env


def test_a_crowd():
    """So many loose balls that their pairs are not listed: what a contact is like is found from both geoms as it is found."""
    balls = "".join(
        f'<body pos="{i % 9 * 0.21} {i // 9 * 0.21} {0.1 + 0.01 * (i % 5)}"><freejoint/>'
        f'<geom size="0.1" condim="{(1, 3, 4, 6)[i % 4]}" priority="{i % 7 == 0:d}"/></body>'
        for i in range(81)
    )
    model = stepper.load(f'<mujoco><worldbody><geom type="plane" size="9 9 1"/>{balls}</worldbody></mujoco>')
    fields = draw(model, ["body_mass", "geom_friction", "geom_restitution", "geom_pos"], n=3)
    fields["geom_size"] = model.geom_size * np.array([1.0, 1.04, 0.9])[:, None, None]
    sim = stepper.Stepper(model, 3)
    sim.randomize(**fields)
    for _ in range(60):
        sim.step()
    for env in range(3):
        own = stepper.Stepper(model.replace(**{name: values[env] for name, values in fields.items()}))
        for _ in range(60):
            own.step()
        assert len(own.contacts()) > 20
        assert everything(sim, env) == everything(own, None)


def test_a_mask_changes_those_environments_alone_and_fields_add_up():
    model = meadow()
    first, second = draw(model, ["body_mass", "gravity"]), draw(model, ["body_mass", "geom_friction"], seed=1)
    mask = np.arange(N) % 3 == 0
    sim = stepper.Stepper(model, N)
    sim.randomize(**first)
    sim.randomize(mask, **second)
    expected = {
        "body_mass": np.where(mask[:, None], second["body_mass"], first["body_mass"]),
        "geom_friction": np.where(mask[:, None, None], second["geom_friction"], model.geom_friction),
        "gravity": first["gravity"],
    }
    for name, values in sim.randomized.items():
        np.testing.assert_array_equal(values, expected.pop(name))
    assert not expected
    roll(sim)
    for env in (0, 1):
        own = stepper.Stepper(model.replace(**{name: values[env] for name, values in sim.randomized.items()}))
        assert everything(sim, env) == everything(roll(own, env), None)


def test_none_gives_the_models_numbers_back():
    model = meadow()
    fields = draw(model, FIELDS)
    sim = stepper.Stepper(model, N)
    roll(sim)
    plain = [everything(sim, env) for env in range(N)]

    def again():
        sim.reset()
        roll(sim)
        return [everything(sim, env) for env in range(N)]

    sim.randomize(**fields)
    assert again() != plain
    sim.randomize(np.arange(N) == 4)
    assert again()[4] == plain[4]
    sim.randomize(gravity=None)
    assert "gravity" not in sim.randomized
    sim.randomize(**dict.fromkeys(list(FIELDS)[1:]))
    assert again() == plain
    sim.randomize(**fields)
    again()
    sim.randomize()
    assert sim.randomized == {}
    assert sim.memory()["parameters"] == 0
    assert again() == plain


def test_memory_is_that_of_what_differs():
    model = stepper_model("dm_control/humanoid")
    sim = stepper.Stepper(model, 64)
    assert sim.memory()["parameters"] == 0
    sim.randomize(gravity=draw(model, ["gravity"], 64)["gravity"])
    # Three numbers as given and three in lanes per environment, and where these belong.
    assert sim.memory()["parameters"] == 64 * 2 * 3 * 8 + 3 * 4


def test_frictions_ranges_and_gains_may_vanish():
    """Zero is no change of structure where the model has a number."""
    model = meadow()
    fields = {name: getattr(model, name) * np.r_[0.0, 1.0].reshape(2, *[1] * getattr(model, name).ndim) for name in (
        "dof_frictionloss", "jnt_stiffness", "actuator_gainprm", "actuator_biasprm", "geom_friction", "gravity")}  # fmt: skip
    sim = stepper.Stepper(model, 2)
    sim.randomize(**fields)
    roll(sim, slice(2))
    assert np.isfinite(sim.qpos).all()
    plain = roll(stepper.Stepper(model, 2), slice(2))
    assert everything(sim, 1) == everything(plain, 1)
    own = roll(stepper.Stepper(model.replace(**{name: values[0] for name, values in fields.items()})), 0)
    # Rows of dry friction with no impulse are there in one and not in the other, so the solvers stop elsewhere within their tolerance.
    np.testing.assert_allclose(sim.qpos[0], own.qpos, atol=1e-5)


@pytest.mark.parametrize(("fields", "parts"), [
    ({"body_mass": np.ones((4, 3))}, ["body_mass has shape (4, 3), must be (4, 11)"]),
    ({"timestep": np.ones(4)}, ["no field 'timestep'", "all environments of a stepper share", "model.replace(timestep=...)"]),
    ({"timestep": None}, ["no field 'timestep'", "all environments of a stepper share"]),
    ({"body_mass": ("body_mass", (2, 1), -1.0)}, ["environment 2", 'body "ball"', "mass is -1 kg"]),
    ({"body_mass": ("body_mass", (2, 1), 0.0)}, ["environment 2", 'body "ball"', "body_mass is 0 kg", "give a mass above 0"]),
    ({"gravity": ("gravity", (3, 2), np.nan)}, ["environment 3", "gravity", "NaN"]),
    ({"jnt_stiffness": ("jnt_stiffness", (1, 0), 2.0)}, ["environment 1", 'joint "#0"', "jnt_stiffness is 2", "no spring", "replace("]),
    ({"dof_frictionloss": ("dof_frictionloss", (1, slice(6)), 2.0)}, ["environment 1", "dof_frictionloss is 2", "no dry friction"]),
    ({"dof_damping": ("dof_damping", (1, 0), 2.0)}, ["environment 1", 'field "dof_damping"', "same value"]),
    ({"jnt_range": ("jnt_range", (1, 7), (-np.inf, np.inf))}, ["environment 1", 'joint "elbow"', "the joint never reaches"]),
    ({"actuator_biasprm": ("actuator_biasprm", (1, 1, 1), -9.0)}, ["environment 1", 'actuator "motor"', 'its biastype is "none"']),
    ({"geom_size": ("geom_size", (1, 0, 0), 9.0)}, ["environment 1", 'field "geom_size"', "where the shape has no number"]),
    ({"geom_size": ("geom_size", (1, 2, 0), -9.0)}, ["environment 1", 'geom "ball"', "radius is -9"]),
])  # fmt: skip
def test_errors_name_field_environment_and_remedy(fields, parts):
    model = meadow()
    sim = stepper.Stepper(model, 4)
    for name, value in fields.items():
        if isinstance(value, tuple):
            fields[name] = np.broadcast_to(getattr(model, name), (4, *getattr(model, name).shape)).copy()
            fields[name][value[1]] = value[2]
    with pytest.raises(ValueError) as error:
        sim.randomize(**fields)
    for part in parts:
        assert part in str(error.value)
    assert sim.randomized == {}


def test_rows_without_the_mask_are_not_read():
    sim = stepper.Stepper(meadow(), 4)
    gravity = np.full((4, 3), np.nan)
    gravity[2] = 1.0
    sim.randomize(np.arange(4) == 2, gravity=gravity)
    np.testing.assert_array_equal(sim.randomized["gravity"], np.where(np.arange(4)[:, None] == 2, 1.0, meadow().gravity))


def test_parameters_and_drives_go_together():
    """Rotors are added to the armature that each environment has of its own, and friction to its dry friction."""
    model = stepper.load(
        """<mujoco><worldbody><body><joint name="hinge" axis="0 1 0" armature=".1" frictionloss=".02"/>
        <geom type="capsule" fromto="0 0 0 .5 0 0" size=".02"/></body></worldbody>
        <actuator><motor name="motor" joint="hinge"/></actuator></mujoco>"""
    )
    motor = stepper.actuators.DCMotor(stall_torque=1.0, no_load_speed=20.0, rotor_inertia=1e-3, gear=10.0, efficiency=0.8)
    drives = stepper.ActuatorModel({"motor": stepper.Drive(motor=motor, friction=0.01)})
    armature, mass, friction = np.array([[0.1], [0.2], [0.3]]), np.array([[0, 1.0], [0, 1.5], [0, 2.0]]), np.array([[0.02], [0.05], [0.01]])
    sim = stepper.Stepper(model, 3, actuators=drives)
    sim.randomize(dof_armature=armature, body_mass=mass, dof_frictionloss=friction)
    sim.step([1.0], nstep=200)
    for env in range(3):
        alone = stepper.Stepper(
            model.replace(dof_armature=armature[env], body_mass=mass[env], dof_frictionloss=friction[env]), actuators=drives
        )
        alone.step([1.0], nstep=200)
        assert abs(alone.qpos[0]) > 0.1
        assert np.array_equal(alone.qpos, sim.qpos[env])


# Numbers of explicit pairs: contacts have them in place of the geoms' numbers, and nothing that a pair overrides is lost in silence.

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
        raises(stepper.ModelError, "explicit pair", sim.randomize, **{pair_field: None})
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
    raises(KeyError, "did you mean sole", scene.pair, "soul")


def test_derivatives_by_friction_of_a_pair_are_those_of_its_contacts():
    sim = simulate(model(), tolerance=1e-12, qvel=[1.0, 0, 0, 0, 0, 0] * 2, steps=2)
    found = sim.linearize(("pair_friction[sole]", "geom_friction[loose]"))
    # Sliding takes mu g h of the speed in a step.
    slope = -9.81 * 0.002
    velocities = found.blocks["pair_friction[sole]"][sim.model.nv :]
    assert np.isclose(velocities[0, 0], slope, rtol=1e-6)
    assert np.abs(velocities[6:]).max() < 1e-6
    raises(stepper.ModelError, "explicit pair", sim.linearize, ("geom_friction[paired]",))
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
        raises(stepper.ModelError, "explicit pair", sim.randomize, **fields)
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
