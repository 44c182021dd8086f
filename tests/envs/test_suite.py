"""Tasks of dm_control's suite have its observations and rewards, and starts of its distribution."""

import copy
import warnings
from dataclasses import replace

import gymnasium
import mujoco
import numpy as np
import pytest
import stepper
from envs.cases import kolmogorov_smirnov
from stepper.envs import StepperEnv, StepperVectorEnv
from stepper.envs.suite import SUITE
from stepper.envs.suite.base import reading
from stepper.envs.suite.quadruped import _Bowl

suite = pytest.importorskip("dm_control.suite")
OTHERWISE = {"dog": {"inertial_sensors": 3, "foot_forces": 12, "touch_sensors": 4}, "quadruped": {"accelerometer": 3, "force_torque": 24}}
"""How many of the first numbers of rows of observations are stepper's own, by domain: see `stepper.envs.suite.quadruped` and `dog`."""


@pytest.fixture(autouse=True, scope="module")
def fields_that_mujoco_has():
    """dm_control looks for fields of MuJoCo's structures by a list of its own, which names some that MuJoCo 4 does not have any more."""
    from dm_control.mujoco.wrapper.mjbindings import sizes

    for name, struct in (("mjmodel", mujoco.MjModel), ("mjdata", mujoco.MjData)):
        fields = sizes.array_sizes[name]
        for gone in [field for field in fields if not hasattr(struct, field)]:
            del fields[gone]


@pytest.fixture(autouse=True, scope="module")
def no_rendering():
    """A new terrain makes dm_control's quadruped open a renderer, which needs OpenGL."""
    from dm_control.suite.quadruped import Physics

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Physics, "contexts", None)
        yield


def named(name):
    return f"stepper/dm_control.{name}-v0"


def flat(observation):
    return np.concatenate([np.ravel(value) for value in observation.values()])


def bounds(spec):
    """Least and largest actions; dm_control has MuJoCo's largest number where there are none."""
    return tuple(np.where(np.abs(bound) < mujoco.mjMAXVAL, bound, np.sign(bound) * np.inf) for bound in (spec.minimum, spec.maximum))


def pair(name):
    """dm_control's environment and ours, both with solvers that converge."""
    with warnings.catch_warnings(action="ignore"):
        theirs = suite.load(*name.split("-", 1), task_kwargs={"random": 0})
    model = theirs.physics.model.ptr
    # MuJoCo takes frames that nearly coincide as one.
    model.body_sameframe[:] = model.geom_sameframe[:] = model.site_sameframe[:] = 0
    option = model.opt
    option.solver, option.tolerance, option.iterations = mujoco.mjtSolver.mjSOL_NEWTON, 1e-14, 200
    kind, arguments = SUITE[name]
    task = kind(**arguments)
    if "terrain" in task.model().geom_names:
        theirs.physics.elevation = stepper.sensors.HeightField(task.model(), "terrain").elevation
    return theirs, StepperEnv(task, options=replace(stepper.Options.from_model(task.model()), tolerance=1e-12, iterations=200))


def follow(theirs, ours):
    """Gives ours the state of dm_control's, and its target."""
    physics, model = theirs.physics, ours.sim.model
    if "terrain" in model.geom_names:
        copy_tile(physics, ours)
    physics.forward()
    if "target" in model.geom_names:
        target = model.geom("target").id
        places = np.array(model.geom_pos)[None].copy()
        places[0, target] = physics.named.model.geom_pos["target"]
        ours.sim.randomize(geom_pos=places)
    for body in (body for body in map(model.body, range(model.nbody)) if body.mocapid >= 0):
        # Those of the finger and of the manipulator; the finger's target is a site.
        named = physics.named.data
        ours.sim.mocap_pos[0, body.mocapid] = named.site_xpos["target"] if body.name == "target" else named.xpos[body.name]
        ours.sim.mocap_quat[0, body.mocapid] = [1.0, 0.0, 0.0, 0.0] if body.name == "target" else named.xquat[body.name]
    if "directions" in ours.now.episode_state:
        ours.now.episode_state["directions"][0] = np.reshape(physics.model.wrap_prm, (2, 2))
    if model.na:
        ours.sim.set_state(act=physics.data.act[None].copy())
    ours.set_state(physics.data.qpos.copy(), physics.data.qvel.copy())


def copy_tile(physics, ours):
    """Gives dm_control's height field the tile of ours whose middle is at the origin."""
    heights, place = physics.elevation, ours.sim.geom_xpos[0, ours.sim.model.geom("terrain").id]
    side = physics.model.hfield_nrow[0]
    column, row = (round(edge / 0.3) for edge in 120.0 - place[:2] - 30.0)
    physics.model.hfield_size[0, 2:] = heights.max(), 0.5
    physics.model.hfield_data[:] = (heights[row : row + side, column : column + side] / heights.max()).ravel()
    physics.named.model.geom_pos["terrain", "z"] = place[2]


def compared(name, structure):
    """Which numbers of an observation should be dm_control's: (n,) bool."""
    own = OTHERWISE.get(name.partition("-")[0], {})
    return np.array([k >= own.get(row, 0) for row, size in structure.items() for k in range(size)])


def has_other_points(theirs, action):
    """Whether steps of an action have contacts whose points stepper chooses in its own way."""
    # Those are contacts of ellipsoids, of cylinders, of two boxes, and of a geom with several triangles of a height field.
    data, geom = copy.copy(theirs.physics.data.ptr), mujoco.mjtGeom
    data.ctrl[:] = action
    for _ in range(round(theirs.control_timestep() / theirs.physics.timestep())):
        mujoco.mj_step(data.model, data)
        types = data.model.geom_type[data.contact.geom]
        if np.isin(types, [geom.mjGEOM_ELLIPSOID, geom.mjGEOM_CYLINDER]).any() or (types == geom.mjGEOM_BOX).all(axis=1).any():
            return True
        over_field = data.contact.geom[(types == geom.mjGEOM_HFIELD).any(axis=1)]
        if len(np.unique(over_field, axis=0)) < len(over_field):
            return True
    return False


def near_goal(physics, domain):
    """A state in which dm_control's rewards are large."""
    data = physics.data
    posed_below = {"cheetah", "finger", "fish", "manipulator", "quadruped", "reacher", "swimmer"}
    if domain not in posed_below:
        data.qpos[:] = physics.model.qpos0
    if domain in {"cheetah", "dog", "walker", "hopper"}:
        data.qvel[:] = 0.0
        data.qvel[0 if domain != "walker" else 1] = 8.0
    if domain == "finger":
        data.qvel[-1] = -20.0
        physics.forward()
        physics.named.model.site_pos["target"] = physics.named.data.site_xpos["tip"] + 0.01
    if domain == "dog" and "ball_root" in physics.named.data.qpos.axes.row.names:
        physics.named.data.qpos["ball_root"][:3] = 0.12, 0.0, 0.06
    if domain == "quadruped":
        data.qpos[:7] = [0.3, 0.1, 1.0, 1.0, 0.0, 0.0, 0.0]
        data.qvel[0] = 6.0
        if hasattr(physics, "elevation"):
            data.qpos[:3] = 18.0, 5.0, 5.0
    if domain == "manipulator":
        thing = "peg" if "peg" in physics.named.data.xpos.axes.row.names else "ball"
        # In a receptacle a peg touches boxes, whose contacts with capsules MuJoCo chooses in its own way.
        physics.forward()
        physics.named.model.body_pos[f"target_{thing}"] = physics.named.data.xpos[thing] + 0.002
        physics.named.model.body_quat[f"target_{thing}"] = physics.named.data.xquat[thing]
    if domain == "stacker":
        data.qvel[:] = 0.0
        qpos = physics.named.data.qpos
        boxes = [name[:-2] for name in qpos.axes.row.names if name.endswith("_z")]
        for k, box in enumerate(boxes):
            qpos[[f"{box}_x", f"{box}_z"]] = 0.2 + 0.01 * (-1.0) ** k, 0.0222 + 0.0442 * k
        physics.forward()
        physics.named.model.body_pos["target"] = physics.named.data.xpos["box1"] + 0.002
    if domain == "reacher":
        physics.forward()
        physics.named.model.geom_pos["target", :2] = physics.named.data.geom_xpos["finger", :2] + 0.003
    if domain == "swimmer":
        physics.forward()
        physics.named.model.geom_pos["target", :2] = physics.named.data.geom_xpos["nose", :2] + 0.2
    if domain == "fish":
        data.qpos[3:7] = [1.0, 0.0, 0.0, 0.0]
        physics.forward()
        physics.named.model.geom_pos["target"] = physics.named.data.geom_xpos["mouth"] + 0.01


def expected_reward(theirs, step, ours):
    """dm_control's reward; the dog's for what stepper's sensors say of its soles."""
    if not hasattr(theirs.physics, "touch_sensors"):
        return step.reward
    theirs.physics.touch_sensors = lambda: reading(ours.now, "palm_L", "palm_R", "sole_L", "sole_R")[0]
    return theirs.task.get_reward(theirs.physics)


@pytest.mark.parametrize("name", sorted(SUITE))
def test_every_step_is_dm_controls(name):
    theirs, ours = pair(name)
    ours.reset(seed=0)
    rng = np.random.default_rng(0)
    low, high = (np.where(np.isfinite(bound), bound, np.sign(bound)) for bound in bounds(theirs.action_spec()))
    domain, kept = name.partition("-")[0], compared(name, ours.observation_structure)
    rewards, left_out = [], 0
    for k in range(120):
        if k % 20 == 0:
            theirs.reset()
        if k % 20 == 10:
            near_goal(theirs.physics, domain)
        if k % 20 == 15 and "cartpole" in name:
            theirs.physics.data.qpos[1] = 0.3
        follow(theirs, ours)
        action = rng.uniform(low, high)
        other_points = (domain == "dog" or "escape" in name) and has_other_points(theirs, action)
        step = theirs.step(action)
        found, reward, terminated, truncated, _ = ours.step(action)
        if other_points:
            left_out += 1
            continue
        # Both solve the same convex problem to round-off, some 1e-14 of velocities of up to 1e2, and an action is up to ten steps.
        np.testing.assert_allclose(found[kept], flat(step.observation)[kept], rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(reward, expected_reward(theirs, step, ours), atol=1e-8)
        assert not (terminated or truncated)
        rewards.append(reward)
    assert left_out < 40
    # Of all tasks, rewards were seen that are and that are not; a step of the humanoid falls short of 10 m/s.
    assert max(rewards) > (0.1 if "run" in name else 0.4)
    assert max(rewards) - min(rewards) > 0.1


def test_a_dog_that_stands_feels_what_dm_controls_does():
    theirs, ours = pair("dog-stand")
    theirs.reset(), ours.reset(seed=0)
    data = theirs.physics.data
    data.qpos[:], data.qvel[:], data.act[:] = theirs.physics.model.qpos0, 0.0, 0.0
    kept = np.concatenate([np.full(size, row == "touch_sensors") for row, size in ours.observation_structure.items()])
    for _ in range(30):
        follow(theirs, ours)
        step = theirs.step(np.zeros(38))
        found, reward, *_ = ours.step(np.zeros(38))
        np.testing.assert_allclose(found[kept], step.observation["touch_sensors"], rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(reward, step.reward, atol=1e-8)
    assert found[kept].min() > 1.0


@pytest.mark.parametrize("name", sorted(SUITE))
def test_spaces_and_times_are_dm_controls(name):
    with warnings.catch_warnings(action="ignore"):
        theirs = suite.load(*name.split("-", 1))
    ours = gymnasium.make(named(name))
    spec = theirs.action_spec()
    assert ours.action_space.shape == spec.shape
    np.testing.assert_array_equal([ours.action_space.low, ours.action_space.high], np.float32(bounds(spec)))
    assert ours.observation_space.shape == flat(theirs.reset().observation).shape
    assert ours.unwrapped.dt == pytest.approx(theirs.control_timestep(), rel=1e-12)
    assert (ours.spec.max_episode_steps or np.inf) == pytest.approx(theirs._step_limit, rel=1e-12)


@pytest.mark.parametrize("name", sorted(SUITE))
def test_starts_are_drawn_from_dm_controls_distribution(name):
    """Numbers of 150 first observations of ours among as many of theirs: Kolmogorov and Smirnov's distance."""
    with warnings.catch_warnings(action="ignore"):
        theirs = suite.load(*name.split("-", 1), task_kwargs={"random": 1})
    ours = StepperVectorEnv(SUITE[name][0], 150, **SUITE[name][1])
    # Under the dog's first forces its muscles pull, in dm_control they do not yet.
    kept = compared(name, ours.observation_structure) if name.startswith("dog") else slice(None)
    found = ours.reset(seed=0)[0][:, kept]
    expected = np.array([flat(theirs.reset().observation) for _ in range(150)])[:, kept]
    # Numbers that are the same but for round-off are no distribution.
    for one, other in zip(np.round(found.T, 9), np.round(expected.T, 9), strict=True):
        # Of two samples of 150 of one distribution it exceeds 0.27 once in 3e4 times, and there are some 600 numbers.
        assert kolmogorov_smirnov(one, other) < 0.27


@pytest.mark.parametrize("seed", [0, 7])
def test_springs_of_the_regulator_are_dm_controls(seed):
    with warnings.catch_warnings(action="ignore"):
        theirs = suite.load("lqr", "lqr_6_2", task_kwargs={"random": seed})
    ours = StepperEnv(SUITE["lqr-lqr_6_2"][0], bodies=6, driven=2, model_seed=seed)
    np.testing.assert_array_equal(ours.sim.model.jnt_stiffness, np.ravel(theirs.physics.model.jnt_stiffness))


def test_the_regulator_ends_at_rest():
    envs = StepperVectorEnv(SUITE["lqr-lqr_2_1"][0], 2)
    envs.reset(seed=0)
    envs.sim.set_state(qpos=[[1e-8, 0.0], [1e-5, 0.0]], qvel=np.zeros((2, 2)))
    assert envs.step(np.zeros((2, 1)))[2].tolist() == [True, False]


@pytest.mark.parametrize(("name", "arguments", "message"), [
    ("cartpole-balance", {"poles": 0}, "poles is 0, must be at least 1"),
    ("lqr-lqr_2_1", {"driven": 3}, "driven is 3 and bodies is 2: at least one mass must be driven"),
    ("lqr-lqr_2_1", {"model_seed": -1}, "model_seed is -1, must be from 0"),
    ("stacker-stack_2", {"boxes": 5}, "boxes is 5, must be from 1 to 4"),
])  # fmt: skip
def test_wrong_arguments_are_named(name, arguments, message):
    with pytest.raises(ValueError, match=message):
        gymnasium.make(named(name), **arguments)


@pytest.mark.parametrize("seed", [0, 7])
def test_a_bowl_is_dm_controls(seed):
    """Heights of a tile from dm_control's random numbers are dm_control's to 1e-6 m, because MuJoCo rounds heights of 5 m to 32 bits."""
    with warnings.catch_warnings(action="ignore"):
        theirs = suite.load("quadruped", "escape", task_kwargs={"random": seed})
    theirs.reset()
    line = np.linspace(-30.0, 30.0, 201)
    heights = _Bowl().heights(line, line, 60.0, 0.0, np.random.RandomState(seed))
    np.testing.assert_allclose(heights, 5.0 * theirs.physics.model.hfield_data.reshape(201, 201), atol=1e-6)


def test_episodes_start_over_the_middles_of_all_bowls():
    """The score counts from the middle of a bowl, so the ring of hills of 15 m is around the robot wherever the terrain is."""
    ours = StepperVectorEnv(SUITE["quadruped-escape"][0], 200, escape=True)
    ours.reset(seed=0)
    np.testing.assert_array_equal(ours.sim.qpos[:, :2], 0.0)
    assert len(np.unique(ours.sim.geom_xpos[:, ours.sim.model.geom("terrain").id, :2], axis=0)) == 16
    angles = np.linspace(0.0, 2.0 * np.pi, 50)
    rings = np.stack([np.cos(angles), np.sin(angles)], axis=1) * [[[0.5]], [[15.0]], [[30.0]]]
    ground = stepper.sensors.HeightField(ours.sim.model, "terrain")
    middle, hills, border = np.split(ground.heights(ours.sim, rings.reshape(-1, 2)), 3, axis=1)
    assert middle.max() < 0.2
    assert hills.mean(axis=1).min() > 2.0
    assert border.max() < 0.1
    assert (ours.sim.qpos[:, 2] < 1.2).all()
