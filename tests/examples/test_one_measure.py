"""One function reads a stepper, a moment of an environment and the world of a study."""

import numpy as np
import one_measure
import pytest
import stepper
from stepper.lab.study.batches import begin, world_of
from stepper.lab.study.worlds import World

pytest.importorskip("gymnasium")
READINGS = {
    "qpos": lambda now: now.qpos,
    "qvel": lambda now: now.qvel,
    "xpos": lambda now: now.xpos,
    "site_xpos": lambda now: now.read("site_xpos", ["hand", "target"]),
    "joint": lambda now: now.read("qpos", "elbow"),
    "time": lambda now: now.time,
    "contacts": lambda now: now.contacts()["distance"],
    "energy": lambda now: np.stack(now.energy(), axis=-1),
    "model": lambda now: np.full(now.num_envs, now.model.nv * now.timestep),
}


def test_one_function_is_a_reward_an_observation_and_an_outcome():
    found = one_measure.measured()
    assert set(found.values()) == {found["stepper"]}
    # It moves: the hand begins sqrt(0.4^2 + 0.4^2) = 0.566 m from the target.
    assert 0.3 < found["stepper"] < 0.565


@pytest.mark.parametrize("name", READINGS)
def test_readings_are_the_same_everywhere(name):
    """Attributes, methods and `read`, in a stepper, a moment and a world at the same state."""
    measure, seen = READINGS[name], {}

    class Seen(one_measure.Reach):
        def reward(self, now):
            seen["moment"] = np.array(measure(now))
            return super().reward(now)

    sim = stepper.Stepper(stepper.load(one_measure.SCENE), num_envs=2)
    sim.step(one_measure.CTRL, nstep=one_measure.STEPS)
    env = stepper.envs.StepperVectorEnv(Seen(), num_envs=2)
    env.reset(seed=0)
    env.step(np.tile(one_measure.CTRL, (2, 1)))
    study = stepper.lab.Study(model=one_measure.SCENE, seconds=0.2, control=0.2)
    world = world_of(study, "stepper", [{}, {}])
    begin(study, world, [0, 1])
    world.advance(one_measure.CTRL, one_measure.STEPS)
    assert np.array_equal(seen["moment"], measure(sim))
    # The world's clock adds up whole calls, the stepper's steps: rounding of 20 additions.
    np.testing.assert_allclose(measure(world), measure(sim), rtol=1e-14)


@pytest.mark.parametrize("name", ["qpos", "xpos", "site_xpos", "joint", "time", "contacts"])
def test_mujoco_reads_alike(name):
    """The same names at the same state; contacts of a ball in a plane with their forces."""
    study = stepper.lab.Study(model=one_measure.SCENE, settings={"peer": {"engine": "mujoco"}})
    found = []
    for setting in ("stepper", "peer"):
        world = world_of(study, setting, [{}, {}])
        world.start(np.full((2, 2), 0.3), np.zeros((2, 2)), None, 0)
        found.append(READINGS[name](world))
    np.testing.assert_allclose(*found, atol=1e-12)


def test_contacts_of_mujoco_have_the_columns_of_a_stepper():
    scene = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/><body pos="0 0 .099"><freejoint/>
      <geom size=".1" mass="2"/></body></worldbody></mujoco>"""
    study = stepper.lab.Study(model=scene, settings={"peer": {"engine": "mujoco"}})
    world = world_of(study, "peer", [{}, {}])
    model = study.loaded[0]
    world.start(np.tile(model.qpos0, (2, 1)), np.zeros((2, 6)), None, 0)
    world.advance(None, 500)
    contacts = world.contacts()
    assert contacts.dtype == stepper.Stepper(model, 2).contacts().dtype
    assert contacts["env"].tolist() == [0, 1]
    assert contacts["geom"].tolist() == [[0, 1]] * 2
    # At rest the ball's weight, within a thousandth after one second.
    np.testing.assert_allclose(contacts["force"][:, 0], 2 * 9.81, rtol=1e-3)
    np.testing.assert_allclose(world.body_contact_force[:, 1, 2], 2 * 9.81, rtol=1e-3)


@pytest.mark.parametrize(("name", "hint"), [("xpso", "did you mean xpos"), ("reset", "has no attribute 'reset'")])
def test_a_world_is_for_reading(name, hint):
    world = world_of(stepper.lab.Study(model=one_measure.SCENE), "stepper", [{}])
    with pytest.raises(AttributeError) as error:
        getattr(world, name)
    assert hint in str(error.value)
    assert isinstance(world, World)


def test_methods_of_a_moment_end_with_it():
    """A reading of a moment that is over is an error, by attribute, `read` and method alike."""
    kept = []

    class Keeps(one_measure.Reach):
        def reward(self, now):
            now.contacts()
            kept.append(now)
            return super().reward(now)

    env = stepper.envs.StepperVectorEnv(Keeps(), num_envs=2)
    env.reset(seed=0)
    for _ in range(2):
        env.step(np.tile(one_measure.CTRL, (2, 1)))
    for read in (lambda now: now.xquat, lambda now: now.read("xquat"), lambda now: now.contacts()):
        with pytest.raises(RuntimeError, match="read it before the next step"):
            read(kept[0])
