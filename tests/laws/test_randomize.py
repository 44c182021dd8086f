"""Parameters per environment: each environment is, bit for bit, one of a stepper of its own model.

All comparisons are of raw bytes. Both sides read numbers that come out of one function (`Plan::params_of`) and do the same
operations with them, so that not even rounding may differ.
"""

import functools

import numpy as np
import pytest
import stepper
from meadow import FIELDS, MEADOW
from models import contact_bits, stepper_model

N, CALLS, NSTEP = 11, 40, 3


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


@pytest.mark.parametrize("name", FIELDS)
@pytest.mark.parametrize("scene", MODELS)
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


@pytest.mark.parametrize("precision", ["f64", "f32"])
@pytest.mark.parametrize("integrator", ["midpoint", "implicit", "euler", "rk4"])
@pytest.mark.parametrize("scene", MODELS)
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
