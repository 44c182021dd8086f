"""Declared parts of a task: reward terms, events, commands and actions."""

from dataclasses import dataclass
from types import MappingProxyType

import gymnasium
import numpy as np
import pytest
import stepper
from checks import raises
from stepper.envs import (
    Observation,
    Reward,
    Servo,
    StepperVectorEnv,
    Task,
    add,
    at_reset,
    at_start,
    every,
    log_uniform,
    push,
    scale,
    uniform,
)
from stepper.envs.commands import Command, VelocityCommand
from stepper.envs.quantities import action_rate, base_linvel, gravity, heading, in_base, joint_pos, joint_vel

ROBOT = """<mujoco><option timestep="0.01"/><worldbody><geom name="floor" type="plane" size="9 9 1"/>
  <body name="trunk" pos="0 0 .5"><freejoint name="root"/><geom name="trunk" type="box" size=".2 .1 .05" mass="5"/>
    <body name="leg" pos=".1 0 0"><joint name="hip" axis="0 1 0"/><geom name="left_foot" size=".05" pos="0 .1 -.3" mass="1"/></body>
    <body name="arm" pos="-.1 0 0"><joint name="elbow" axis="0 1 0"/><geom name="right_foot" size=".05" pos="0 -.1 -.3" mass="1"/></body>
  </body></worldbody>
  <actuator><position name="hip" joint="hip" kp="20" kv="1"/><position name="elbow" joint="elbow" kp="20" kv="1"/></actuator>
  <keyframe><key name="stance" qpos="0 0 .35 1 0 0 0 .2 -.3" ctrl=".2 -.3"/></keyframe></mujoco>"""
MODEL = stepper.load(ROBOT)
CART = """<mujoco><worldbody><body name="cart" quat=".7071067811865476 0 0 .7071067811865476"><joint name="x" type="slide" axis="1 0 0"/>
  <geom size=".1" mass="1"/><body name="pole"><joint name="hinge" axis="0 1 0"/>
  <geom type="capsule" size=".02" fromto="0 0 0 0 0 .5" mass=".1"/>
  </body></body></worldbody><actuator><motor joint="x" ctrlrange="-1 1"/></actuator></mujoco>"""


def speed(now, target=0.0):
    return base_linvel(now)[:, 0] - target


@dataclass(frozen=True, kw_only=True)
class Robot(Task):
    """A robot with all declared parts."""

    keyframe = "stance"
    actions = Servo("*", scale={"hip": 0.5, "*": 0.25}, bound=2.0, delay=(0, 2))
    frame_skip: int = 2

    @property
    def commands(self):
        return {"twist": VelocityCommand(every=(0.04, 0.1), x=(-1.0, 1.0), yaw=(-0.5, 0.5), turning=0.5, standing=0.2)}

    def model(self):
        return MODEL

    def observations(self):
        return (
            *map(Observation, (base_linvel, gravity, joint_pos, joint_vel)),
            Observation("twist", func=lambda now: now.command("twist")),
            Observation("action"),
            Observation("body_mass[trunk]"),
        )

    def rewards(self):
        return {"speed": Reward(speed, 2.0, target=0.1), "rate": Reward(action_rate, -0.1, per_second=False), "off": Reward(speed, 0.0)}

    def events(self):
        return (
            at_start("geom_friction[*_foot][0]", uniform(0.3, 1.2, shared=True)),
            at_reset("body_mass[trunk]", scale(0.8, 1.2)),
            at_reset("body_ipos[trunk]", add([-0.02, -0.02, -0.01], [0.02, 0.02, 0.01])),
            at_reset(("actuator_kp", "actuator_kv"), scale(0.5, 2.0)),
            every((0.05, 0.1), push("trunk", x=(-1.0, 1.0), yaw=(-0.5, 0.5))),
            every((0.06, 0.06), "geom_friction[floor][0]", log_uniform(0.1, 1.0)),
        )


def made(num_envs=4, **given):
    return StepperVectorEnv(Robot(), num_envs, **({"max_episode_steps": 9} | given))


def test_terms_are_weighted_and_summed_over_episodes():
    """Each entry equals weight times term (times dt if per second), and the return of a term is its sum, because the episode adds them."""
    envs = made(max_episode_steps=5, autoreset_mode="SAME_STEP")
    envs.reset(seed=0)
    sums = dict.fromkeys(("speed", "rate"), 0.0)
    for k in range(5):
        before = envs.now.action
        action = np.full((4, 2), 0.1 * k)
        _, reward, _, _, info = envs.step(action)
        final = info["final_info"] if k == 4 else info
        terms = {name: final[f"reward_{name}"] for name in sums}
        np.testing.assert_allclose(sum(terms.values()), reward, rtol=1e-12)
        np.testing.assert_allclose(terms["rate"], -0.1 * np.square(action - before).sum(axis=1))
        if k < 4:
            np.testing.assert_allclose(terms["speed"], 2.0 * envs.dt * (base_linvel(envs.now)[:, 0] - 0.1))
        for name, term in terms.items():
            sums[name] = sums[name] + term
            np.testing.assert_allclose(final[f"return_{name}"], sums[name], rtol=1e-12)
    assert "reward_off" not in info
    assert not any(total.any() for total in envs._batch.terms.rewards.sums.values())


def test_the_argument_rewards_replaces_weights():
    envs = made(rewards={"rate": -1.0, "off": 1.0})
    envs.reset(seed=0)
    *_, info = envs.step(np.ones((4, 2)))
    np.testing.assert_allclose(info["reward_rate"], -2.0)
    assert "reward_off" in info
    raises(ValueError, r"rewards has 'rats', which is no term of the reward of Robot; did you mean rate\?", made, rewards={"rats": 1.0})
    raises(ValueError, r"rewards\['rate'\] is nan, must be a finite number", made, rewards={"rate": np.nan})
    raises(ValueError, r"Hopper has no method `rewards`", gymnasium.make_vec, "stepper/Hopper-v5", num_envs=1, rewards={"rate": 1.0})


def test_parameters_are_drawn_when_their_event_says():
    """Friction of the feet changes at seeds alone, masses at every reset, friction of the floor every 0.06 s."""
    envs = made(num_envs=300, max_episode_steps=None)
    friction, mass, gains = [], [], []

    def note():
        drawn = envs.sim.randomized
        friction.append(drawn["geom_friction"][:, :, 0].copy())
        mass.append(drawn["body_mass"][:, 1].copy())
        gains.append(
            (drawn["actuator_gainprm"][:, :, 0] / 20.0, drawn["actuator_biasprm"][:, :, 1] / -20.0, -drawn["actuator_biasprm"][:, :, 2])
        )

    envs.reset(seed=0), note()
    for _ in range(3):
        envs.step(np.zeros((300, 2)))
    note()
    envs.reset(), note()
    envs.reset(seed=1), note()
    feet = [MODEL.geom(name).id for name in ("left_foot", "right_foot")]
    np.testing.assert_array_equal(friction[0][:, feet[0]], friction[0][:, feet[1]])
    np.testing.assert_array_equal(friction[0][:, feet], friction[2][:, feet])
    assert (friction[0][:, feet] != friction[3][:, feet]).all()
    assert (friction[0][:, 0] == 1.0).all()
    assert (friction[1][:, 0] != 1.0).all()
    np.testing.assert_array_equal(friction[1][:, feet], friction[0][:, feet])
    np.testing.assert_array_equal(mass[0], mass[1])
    assert (mass[1] != mass[2]).all()
    assert (4.0 <= mass[0].min() < 4.1, 5.9 < mass[0].max() <= 6.0) == (True, True)
    for kp_gain, kp_bias, kv in gains:
        np.testing.assert_allclose(kp_gain, kp_bias)
        np.testing.assert_allclose(kp_gain, kv)
        assert (kp_gain[:, 0] != kp_gain[:, 1]).all()
    floor = friction[1][:, 0]
    assert abs(np.log(floor).mean() - np.log(np.sqrt(0.1))) < 0.15  # A deviation of 0.66 / sqrt(300) = 0.04.


def test_pushes_change_velocities_in_the_world_at_their_times():
    """Between two pushes the time is 0.06 to 0.1 s: 3 to 5 actions of 0.02 s, because times are rounded to whole actions."""

    class Floating(Robot):
        commands = MappingProxyType({"twist": VelocityCommand()})
        actions = Servo("*", scale=0.0)

        def events(self):
            return (every((0.06, 0.1), push("trunk", x=(2.0, 2.0), yaw=(1.0, 1.0))),)

        def reset(self, reset):
            reset.qpos[:, 2] = 50.0
            reset.sim.randomize({"gravity": 0.0}, envs=reset.envs)

    envs = StepperVectorEnv(Floating(), 50)
    envs.reset(seed=0)
    times = []
    for k in range(40):
        before = np.array(envs.sim.qvel[:, 0])
        envs.step(np.zeros((50, 2)))
        pushed = envs.sim.qvel[:, 0] - before > 1.0
        times += [(k, env) for env in np.flatnonzero(pushed)]
    gaps = [b - a for env in range(50) for a, b in zip(*[[k for k, other in times if other == env][j:] for j in (0, 1)], strict=False)]
    assert set(gaps) == {3, 4, 5}
    for body, said in (("leg", "push: body 'leg' has no free joint"), ("trnk", "'trnk'")):
        wrong = type("Wrong", (Floating,), {"events": lambda self, body=body: (every((0.02, 0.02), push(body, x=(1.0, 1.0))),)})
        with pytest.raises((KeyError, ValueError), match=said):
            StepperVectorEnv(wrong(), 1)
    with pytest.raises(ValueError, match=r"yaw of push is .* lower number first"):
        push("trunk", yaw=(1.0, -1.0))


@dataclass(frozen=True, kw_only=True)
class CartPole(Task):
    """Balance a pole on a cart of random mass, which is pushed."""

    episode_seconds: float = 2.0
    frame_skip: int = 5

    def model(self):
        return stepper.load(CART)

    def observations(self):
        return Observation("qpos"), Observation("qvel", noise=0.01)

    def rewards(self):
        return {"upright": Reward(lambda now: np.cos(now.qpos[:, 1])), "effort": Reward(lambda now: now.action[:, 0] ** 2, -0.1)}

    def events(self):
        return (at_reset("body_mass[pole]", scale(0.5, 2.0)), every((0.1, 0.1), push("cart", y=(1.0, 1.0))))

    def reset(self, reset):
        reset.qpos[:, 1] = reset.rng.uniform(-0.1, 0.1, 1)[:, 0]

    def terminated(self, now):
        return np.abs(now.qpos[:, 1]) > 1.5


def test_a_cart_is_pushed_along_its_slide():
    """A push of 1 m/s along y changes the slide's velocity by 1 m/s, because its axis x is turned to y."""
    envs = StepperVectorEnv(CartPole(), 3)
    envs.reset(seed=0)
    rates = [np.array(envs.sim.qvel[:, 0])]
    for _ in range(10):
        envs.step(np.zeros((3, 1)))
        rates.append(np.array(envs.sim.qvel[:, 0]))
    changes = np.diff(rates, axis=0)
    np.testing.assert_allclose(changes[9], 1.0, atol=0.1)
    assert np.abs(changes[:9]).max() < 0.1


@pytest.mark.parametrize(("field", "value", "said"), [
    ("every", 5.0, "two numbers"), ("every", (8, 3), "lower number first"), ("every", (-3, -1), "above 0"), ("x", 1.0, "two numbers"),
    ("yaw", (1, -1), "lower number first"), ("standing", -3, "from 0 to 1"), ("forward", 3.0, "from 0 to 1"),
])  # fmt: skip
def test_commands_that_cannot_be_drawn_are_refused(field, value, said):
    """The error names the field and what it must be."""
    with pytest.raises((TypeError, ValueError), match=f"{field} of VelocityCommand .*{said}"):
        VelocityCommand(**{field: value})


def test_commands_are_those_of_the_observation_that_the_action_follows():
    """The reward of an action uses the command that its policy saw, because commands are drawn again after the reward."""
    seen = []

    class Notes(Robot):
        def reward(self, now):
            seen.append(now.command().copy())
            return super().reward(now)

    envs = StepperVectorEnv(Notes(), 30)
    observation = envs.reset(seed=0)[0]
    columns = slice(10, 13)
    changes = 0
    for _ in range(20):
        shown = observation[:, columns]
        observation = envs.step(np.zeros((30, 2)))[0]
        assert np.isclose(seen[-1][:, :2], shown[:, :2]).all()
        changes += (observation[:, 10] != shown[:, 0]).sum()
    assert changes > 30 * 20 * 0.02 / 0.11
    assert 0 < (np.abs(observation[:, columns]) == 0.0).all(axis=1).sum() < 20


def test_a_turning_command_turns_to_its_heading():
    class Turning(Robot):
        commands = MappingProxyType({"twist": VelocityCommand(yaw=(-0.5, 0.5), turning=1.0, heading=(1.0, 1.0))})

    envs = StepperVectorEnv(Turning(), 3)
    envs.reset(seed=0)
    np.testing.assert_allclose(envs.now.command()[:, 2], np.clip(0.5 * (1.0 - heading(envs.now)), -0.5, 0.5))


def test_stages_of_commands_widen_their_ranges():
    command = VelocityCommand(x=(0.0, 0.1), stages=((100, {"x": (1.0, 2.0)}), (200, {"yaw": (-3.0, 3.0)})))
    envs = StepperVectorEnv(Robot(), 300)
    envs.reset(seed=0)
    drawn = command.draw(envs._batch.streams and stepper.envs.Rng(envs._batch.streams, np.arange(300)), np.repeat([0, 100, 200], 100))
    assert drawn[:100, 0].max() <= 0.1
    assert drawn[100:, 0].min() >= 1.0
    assert not drawn[:200, 2].any()
    assert np.abs(drawn[200:, 2]).max() > 2.0


def test_actions_have_scale_offset_bounds_and_delay():
    envs = made(num_envs=60, max_episode_steps=None)
    np.testing.assert_array_equal(envs.single_action_space.high, [2.0, 2.0])
    envs.reset(seed=0)
    np.testing.assert_allclose(envs.sim.qpos[:, 7:], np.tile([0.2, -0.3], (60, 1)))
    envs.step(np.ones((60, 2)))
    delays = envs._batch.terms.delay
    assert set(delays) == {0, 1, 2}
    # With a delay of both time steps the action before, zero, still acts.
    np.testing.assert_allclose(envs.sim.ctrl, np.where((delays > 1)[:, None], [0.2, -0.3], [0.7, -0.05]))
    unbounded = type("Unbounded", (Robot,), {"actions": None})
    with pytest.raises(ValueError, match=r"actuator 'hip' has no ctrlrange, so the actions of Unbounded have no bounds.*actions = Servo"):
        StepperVectorEnv(unbounded(), 1)
    for servos, message in (
        (Servo("knee"), "no actuator 'knee'"),
        ((Servo("*"), Servo("hip")), "has actuator 'hip' in two servos"),
        (Servo("*", offset="stand"), "the model has no keyframe 'stand'; keyframes are stance"),
        (Servo("*", scale={"hip": 1.0}), "scale has no pattern that fits 'elbow'"),
    ):
        with pytest.raises(ValueError, match=message):
            StepperVectorEnv(type("Wrong", (Robot,), {"actions": servos})(), 1)


def test_quantities_of_the_base_are_in_its_frame():
    envs = made()
    envs.reset(seed=0)
    half = np.sqrt(0.5)
    envs.set_state(np.tile([0, 0, 1, half, 0, 0, half, 0.3, -0.3], (4, 1)), np.tile([1.0, 2, 3, 0, 0, 0, 4, 5], (4, 1)))
    np.testing.assert_allclose(base_linvel(envs.now)[0], [2.0, -1.0, 3.0], atol=1e-12)
    np.testing.assert_allclose(gravity(envs.now)[0], [0.0, 0.0, -1.0], atol=1e-12)
    np.testing.assert_allclose(heading(envs.now), np.pi / 2.0)
    np.testing.assert_allclose(joint_pos(envs.now)[0], [0.1, 0.0], atol=1e-12)
    np.testing.assert_allclose(joint_vel(envs.now)[0], [4.0, 5.0])
    np.testing.assert_allclose(in_base(envs.now, np.tile([0.0, 1.0, 0.0], (4, 1)))[0], [1.0, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize(("given", "error", "message"), [
    ({"events": lambda self: (at_reset("body_mass[tronk]", scale(0.8, 1.2)),)}, ValueError, "no body 'tronk'; did you mean trunk"),
    ({"events": lambda self: (at_reset("body_mas[trunk]", scale(0.8, 1.2)),)}, ValueError, "body_mass"),
    ({"events": lambda self: (at_reset("body_mass", scale(1, 2)), at_start("body_mass[leg]", scale(1, 2)))},
     ValueError, "set the same number of body_mass"),
    ({"events": lambda self: (at_reset(("body_mass", "actuator_kp"), scale(1, 2)),)}, ValueError, "share random numbers but select"),
    ({"events": lambda self: at_reset("body_mass", scale(1, 2))}, TypeError, "events returns .*, must return a tuple"),
    ({"commands": {"twist": (0, 1)}}, TypeError, r"Wrong.commands is .*, must be commands by name"),
    ({"rewards": lambda self: {"speed": speed}}, TypeError, "rewards returns .*, must return terms by name"),
    ({"rewards": lambda self: {"speed": Reward(base_linvel)}},
     ValueError, r"the term 'speed' of Wrong.rewards returns an array of shape \(2, 3\)"),
    ({"keyframe": "stand"}, ValueError, "Wrong.keyframe is 'stand', which the model has not"),
])  # fmt: skip
def test_wrong_parts_are_errors(given, error, message):
    with pytest.raises(error, match=message):
        envs = StepperVectorEnv(type("Wrong", (Robot,), given)(), 2)
        envs.reset(seed=0), envs.step(np.zeros((2, 2)))


@pytest.mark.parametrize(("make", "error", "message"), [
    (lambda: uniform(1.0, 0.5), ValueError, r"uniform\(1.0, 0.5\): the bounds must be finite numbers, the lower one first"),
    (lambda: scale(0.0, np.inf), ValueError, "the bounds must be finite"),
    (lambda: log_uniform(0.0, 1.0), ValueError, "the bounds must be above 0"),
    (lambda: at_reset("body_mass"), TypeError, r"at_reset gets 'body_mass' and None, must get a selector and random values"),
    (lambda: at_start(speed, uniform(0, 1)), TypeError, r"at_start gets a function and .*, must get"),
    (lambda: every((3.0, 1.0), speed), ValueError, r"every gets the times \(3.0, 1.0\)"),
    (lambda: Reward("speed"), TypeError, "func of a Reward is 'speed', must be a function of now"),
    (lambda: Reward(speed, None), ValueError, "the weight of a Reward is None"),
    (lambda: Servo(bound=0.0), ValueError, "bound of Servo is 0.0"),
])  # fmt: skip
def test_wrong_arguments_are_errors(make, error, message):
    raises(error, message, make)


def test_an_observation_is_scaled_after_it_is_clipped():
    class Scaled(Robot):
        def observations(self):
            return (Observation("qpos", scale=0.5), Observation("clipped", func=lambda now: now.qpos, clip=(-0.1, 0.3), scale=10.0))

    envs = StepperVectorEnv(Scaled(), 3)
    observation = envs.reset(seed=0)[0]
    np.testing.assert_array_equal(observation[:, :9], 0.5 * envs.sim.qpos)
    np.testing.assert_allclose(observation[:, 9:], 10.0 * np.clip(envs.sim.qpos, -0.1, 0.3))
    raises(ValueError, "scale of Observation 'qpos' is nan", Observation, "qpos", scale=np.nan)


def test_a_function_at_the_start_gets_seeded_environments_alone():
    seen = []

    class Notes(Robot):
        def events(self):
            return (at_start(lambda reset: seen.append(reset.envs.tolist())), at_reset(lifts))

    def lifts(reset):
        reset.qpos[:, 2] += 1.0

    envs = StepperVectorEnv(Notes(), 3)
    envs.reset(seed=0)
    envs.reset(seed=[None, 7, None])
    envs.reset()
    assert seen == [[0, 1, 2], [1]]
    np.testing.assert_allclose(envs.sim.qpos[:, 2], 1.35)


def test_a_command_of_a_user_is_drawn_and_computed():
    @dataclass(frozen=True, kw_only=True)
    class Height(Command):
        size = 1

        def draw(self, rng, steps):
            return rng.uniform(0.2, 0.3, 1)

        def value(self, now, drawn):
            return drawn - now.qpos[:, 2:3]

    envs = StepperVectorEnv(type("High", (Robot,), {"commands": {"twist": VelocityCommand(), "height": Height()}})(), 5)
    envs.reset(seed=0)
    above = envs.now.command("height")[:, 0] + envs.sim.qpos[:, 2]
    assert ((above >= 0.2) & (above <= 0.3)).all()
    assert len(set(above)) == 5
    raises(KeyError, "commands has no 'hight', it has twist, height", envs.now.command, "hight")


def test_an_episode_lasts_its_seconds():
    envs = StepperVectorEnv(type("Short", (Robot,), {"episode_seconds": 0.06})(), 2)
    envs.reset(seed=0)
    assert [envs.step(np.zeros((2, 2)))[3].all() for _ in range(3)] == [False, False, True]


def test_randomize_takes_random_values():
    """Values follow from the environment and the seed, and another call gives others; factors and addends are of the model's values."""
    sim, other = (stepper.Stepper(MODEL, 200) for _ in range(2))
    values = {
        "geom_friction[*_foot][0]": stepper.uniform(0.3, 1.2),
        "body_mass[trunk]": stepper.scale(0.8, 1.2),
        "gravity[2]": stepper.add(-1, 1),
    }
    sim.randomize(values), other.randomize(values, envs=np.arange(200))
    for name, value in sim.randomized.items():
        np.testing.assert_array_equal(value, other.randomized[name])
    mass, friction = sim.randomized["body_mass"][:, 1].copy(), sim.randomized["geom_friction"][:, 2:, 0]
    assert (4.0 <= mass.min() < 4.1, 5.9 < mass.max() <= 6.0) == (True, True)
    assert (friction[:, 0] != friction[:, 1]).all()
    sim.randomize(values, envs=[3])
    assert sim.randomized["body_mass"][3, 1] != mass[3]
    np.testing.assert_array_equal(np.delete(sim.randomized["body_mass"][:, 1], 3), np.delete(mass, 3))
    other.randomize({"body_mass[trunk]": None}), other.randomize({"body_mass[trunk]": stepper.scale(0.8, 1.2, seed=1)})
    assert (other.randomized["body_mass"][:, 1] != mass).all()
    with pytest.raises(TypeError, match=r"is random, must be numbers; sim\.randomize takes random values"):
        MODEL.replace({"body_mass[trunk]": stepper.uniform(1, 2)})


@dataclass(frozen=True, kw_only=True)
class Ending(Task):
    """Every action ends the episode of environment 1."""

    frame_skip: int = 2

    def model(self):
        return stepper.load(CART)

    def observations(self):
        return (Observation("qpos"),)

    def rewards(self):
        return {"speed": Reward(lambda now: 1.0 + now.qvel[:, 0])}

    def terminated(self, now):
        return np.arange(now.num_envs) == 1

    def info(self, now):
        return {"term": now.reward_terms.get("speed", np.zeros(now.num_envs)), "flags": now.status}


@pytest.mark.parametrize("mode", ["NEXT_STEP", "SAME_STEP"])
def test_the_info_of_an_environment_does_not_depend_on_neighbours_that_end(mode):
    several, alone = (StepperVectorEnv(Ending(), n, autoreset_mode=mode) for n in (2, 1))
    for envs in (several, alone):
        envs.reset(seed=0)
    for _ in range(3):
        (*_, found), (*_, wanted) = (envs.step(np.full((envs.num_envs, 1), 0.5)) for envs in (several, alone))
        assert found["term"][0] == wanted["term"][0] > 0
        assert found["flags"][0] == wanted["flags"][0]
