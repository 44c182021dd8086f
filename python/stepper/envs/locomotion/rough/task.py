"""Base class of tasks in which a legged robot follows velocity commands over generated terrain."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from stepper._stepper import Model
from stepper.envs.locomotion.base import check_sizes, check_weights, in_base, linear_velocity, stance
from stepper.envs.locomotion.rough.commands import (
    STAGES,
    Stages,
    command,
    command_state,
    draw_commands,
    draw_push_times,
    push,
    resample_commands,
)
from stepper.envs.locomotion.rough.rewards import TERMS, terms_of, touches_terrain
from stepper.envs.locomotion.rough.state import action_scale, foot_forces, foot_heights, ground_scan
from stepper.envs.task import Array, Moment, Observation, Reset, Task, Terms, square_sum
from stepper.envs.terrain import Flat, PyramidSlope, PyramidStairs, RandomRough, Terrain, TerrainCurriculum, Wave
from stepper.shared.arguments import check_fields
from stepper.shared.rotations import about_vertical

ROUGH = Terrain(
    sub_terrains={
        "flat": Flat(proportion=0.2),
        "stairs": PyramidStairs(proportion=0.2),
        "stairs_inv": PyramidStairs(proportion=0.2, inverted=True),
        "slope": PyramidSlope(proportion=0.1, slope_range=(0.0, 1.0)),
        "slope_inv": PyramidSlope(proportion=0.1, slope_range=(0.0, 1.0), inverted=True),
        "rough": RandomRough(proportion=0.1, height_range=(0.02, 0.1)),
        "wave": Wave(proportion=0.1),
    },
    border_width=4.0,
)
"""Terrain of mjlab's rough velocity tasks, as a height field. Steps of stairs are up to 0.2 m high; in mjlab up to 0.1 m.
Each step of the stairs is a ramp 0.1 m long and a tread 0.2 m deep.
"""
_MAX_ACTION = 4.0
"""Largest action. In the stance, it gives the largest torque of its servo."""
_INITIAL_LIFT = (0.01, 0.05)
"""Smallest and largest initial height of the base above its height in the keyframe "stance", m."""
_MAX_ENCODER_BIAS = 0.015
"""Largest error of an encoder, rad."""
_MAX_COM_SHIFT = np.array([0.025, 0.025, 0.03])
"""Largest shifts of the base's centre of mass in x, y and z, m."""
_SCAN_UNIT = 5.0
"""Height difference of the scan that is observed as 1, m."""
_LEAST_PROGRESS = 0.5
"""Fraction of the commanded distance below which an environment moves to an easier row of the terrain."""


@dataclass(frozen=True, kw_only=True)
class RoughTask(Task):
    """Task: follow velocity commands over rough terrain. Observations, rewards, random events and curricula are mjlab's.

    Actions are offsets of the servos' set points from the stance; 1 gives a quarter of the largest torque. A command lasts 3 to 8 s.
    Each episode draws friction of the feet, centre of mass of the base and encoder errors. Pushes come every 1 to 3 s.
    An environment whose robot leaves its tile starts its next episode on a harder row of the terrain. If the robot covers less than half
    of the commanded distance, the next episode starts on an easier row. Commands become faster after 120,000 and 240,000 actions of an
    environment.

    Attributes:
        terrain: Terrain, which becomes the geom "terrain" of the model.
        frame_skip: Time steps per action.
        episode_steps: Number of actions per episode, from which the curriculum computes the commanded distance.
        noise: Factor of mjlab's observation noise and encoder errors; 0 means none.
        push: Factor of mjlab's pushes; 0 means none.
        friction: Lowest and highest friction coefficient of the feet.
        max_init_level: Hardest row (0 is the easiest) in which environments start after a reset with a seed.
        stages: Stages of the curriculum of commands. Each has the number of actions of an environment at which it begins, and bounds. The
            bounds are the lowest and highest velocity along x, the highest along y (m/s), and the highest about z (rad/s).
        weights: Weights of some or all terms of the reward, by name; other terms have those of `WEIGHTS`.

    Raises:
        TypeError: The terrain is no `Terrain`, or weights is no mapping.
        ValueError: A noise, push or max_init_level is negative or not finite, or a weight belongs to no term or is not finite.
    """

    WEIGHTS: ClassVar[Mapping[str, float]] = {
        "track_linear_velocity": 2.0,
        "track_angular_velocity": 2.0,
        "upright": 1.0,
        "pose": 1.0,
        "body_ang_vel": 0.0,
        "dof_pos_limits": -1.0,
        "action_rate": -0.1,
        "air_time": 0.0,
        "foot_clearance": -2.0,
        "foot_swing_height": -0.25,
        "foot_slip": -0.1,
        "soft_landing": -1e-5,
        "shank_collision": 0.0,
        "trunk_collision": 0.0,
    }
    """Weights of the terms of the reward, per s, because the reward is their weighted sum times the control period (s)."""
    FEET: ClassVar[Mapping[str, tuple[str, ...]]]
    """Names of the geoms of each foot, by the name of the foot's site."""
    THIGHS: ClassVar[tuple[str, ...]] = ()
    """Names of the geoms whose collision with the terrain terminates an episode."""
    SHANKS: ClassVar[tuple[str, ...]] = ()
    """Names of the geoms of the reward term "shank_collision"."""
    TRUNK: ClassVar[tuple[str, ...]] = ()
    """Names of the geoms of the reward term "trunk_collision"."""
    STANDING: ClassVar[Mapping[str, float]]
    """Tolerances of joint angles in the reward term "pose" for commands to stand, rad, by regular expression for the joint's name.

    The term is exp(-mean(e^2)), where e is the difference of a joint angle from the stance divided by its tolerance.
    """
    WALKING: ClassVar[Mapping[str, float]]
    """Tolerances of joint angles for commands to walk, in the format of `STANDING`."""
    RUNNING: ClassVar[Mapping[str, float]]
    """Tolerances of joint angles for commands to run, in the format of `STANDING`."""
    steepest: ClassVar[float | None] = None
    """Cosine of the largest tilt of the base. An episode terminates at a larger tilt; None means no limit."""
    carried = (*TerrainCurriculum.carried, "steps")

    terrain: Terrain = ROUGH
    frame_skip: int = 4
    episode_steps: int = 1000
    noise: float = 1.0
    push: float = 1.0
    friction: tuple[float, float] = (0.3, 1.2)
    max_init_level: int = 5
    stages: Stages = STAGES
    weights: Mapping[str, float] | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.terrain, Terrain):
            raise TypeError(f"terrain is {self.terrain!r}, must be a Terrain of stepper.envs.terrain, such as Terrain(sub_terrains=...)")
        check_fields(self)
        check_sizes(self, "noise", "push", "max_init_level")
        check_weights(self.weights, TERMS)

    @property
    def levels(self) -> TerrainCurriculum:
        """Curriculum that selects the row of the terrain (the difficulty) for each episode of an environment."""
        return TerrainCurriculum(terrain=self.terrain, max_init_level=self.max_init_level)

    def action_bounds(self, model: Model) -> tuple[Array, Array]:
        """Bounds of the actions, -4 and 4, (nu,) each. In the stance, an action at a bound gives the largest torque of its servo."""
        return np.full(model.nu, -_MAX_ACTION), np.full(model.nu, _MAX_ACTION)

    def observations(self) -> tuple[Observation, ...]:
        """Observation: velocities of the base, gravity, joint angles, joint velocities, last action, command, height scan.

        Velocities of the base (linear and angular) and the direction of gravity are in the frame of the base. Joint angles are encoder
        readings minus the stance.
        """
        k = self.noise
        return (
            Observation("base_lin_vel", func=linear_velocity, noise=0.5 * k, unit="m/s"),
            Observation("base_ang_vel", func=lambda now: now.qvel[:, 3:6], noise=0.2 * k, unit="rad/s"),
            Observation("projected_gravity", func=lambda now: in_base(now, np.tile([0.0, 0.0, -1.0], (len(now.qpos), 1))), noise=0.05 * k),
            Observation("joint_pos", func=_joint_pos, noise=0.01 * k, unit="rad"),
            Observation("joint_vel", func=lambda now: now.qvel[:, 6:], noise=1.5 * k, unit="rad/s"),
            Observation("actions", func=lambda now: now.episode_state["last"]),
            Observation("command", func=command, unit="m/s, rad/s"),
            Observation(
                "height_scan", func=lambda now: (now.qpos[:, 2:3] - ground_scan(now)) / _SCAN_UNIT, noise=0.1 / _SCAN_UNIT * k, unit="5 m"
            ),
        )

    def reward(self, now: Moment) -> tuple[Array, Terms]:
        """Reward: sum of the weighted terms times the control period. The info "tracking_error" is the velocity error in x and y, m/s."""
        terms = terms_of(now, {**self.WEIGHTS, **(self.weights or {})})
        error = np.sqrt(square_sum(linear_velocity(now)[:, :2] - command(now)[:, :2]))
        # A loop, because np.sum would add the terms in another order for a single environment, with other rounding.
        total: Array = now.dt * sum(terms.values(), np.zeros(len(error)))
        return total, {"tracking_error": error} | {f"reward_{name}": term for name, term in terms.items()}

    def terminated(self, now: Moment) -> Array:
        """Whether a geom of `THIGHS` collides with the terrain, or the tilt of the base is too large (`steepest`), (num_envs,)."""
        fallen: Array = touches_terrain(now, self.THIGHS)
        if self.steepest is not None:
            fallen |= ~(-in_base(now, np.tile([0.0, 0.0, -1.0], (len(fallen), 1)))[:, 2] > self.steepest)
        return fallen

    def truncated(self, now: Moment) -> Array:
        """Whether the base is outside the terrain or within 0.3 m of the terrain's edge, (num_envs,) bool."""
        return self.terrain.leaves(now.qpos[:, :2])

    def info(self, now: Moment) -> Terms:
        """Info: the velocity command, and the level (row of the terrain) of each environment."""
        return {"command": command(now), "terrain_level": np.array(now.episode_state["terrain_level"])}

    def episode_state(self, num_envs: int) -> Terms:
        """Arrays for commands, pushes, levels of the terrain, encoder errors, the last two actions, and swings of the feet."""
        nu, feet = len(self.model().actuator_names), len(self.FEET)
        joints = {name: np.zeros((num_envs, nu)) for name in ("last", "before", "encoder_bias")}
        swings = {"peak": np.zeros((num_envs, feet)), "swing": np.zeros((num_envs, feet)), "landed": np.zeros((num_envs, feet), dtype=bool)}
        swings["air_time"] = np.zeros((num_envs, feet))
        return command_state(num_envs) | self.levels.episode_state(num_envs) | joints | swings

    def reset(self, reset: Reset) -> None:
        """Draws initial states, commands, the time of the first push, encoder errors, friction of the feet and centre of mass of the base.

        Initial states are the stance with a random heading, 0.01 to 0.05 m above the ground, near the middle of the environment's tile.
        """
        qpos, rng, state = reset.qpos, reset.rng, reset.episode_state
        qpos[:] = self.model().keyframe("stance").qpos
        qpos[:, 2] += rng.uniform(*_INITIAL_LIFT, 1)[:, 0]
        qpos[:, 3:7] = about_vertical(rng.uniform(-np.pi, np.pi, 1)[:, 0])
        self.levels.place(reset)
        model, envs, dt = reset.sim.model, np.arange(len(reset.envs)), reset.sim.timestep * self.frame_skip
        draw_commands(state, envs, rng, dt, self.stages)
        draw_push_times(state, envs, rng, dt)
        state["encoder_bias"][:] = self.noise * rng.uniform(-_MAX_ENCODER_BIAS, _MAX_ENCODER_BIAS, model.nu)
        rows = {name: np.tile(getattr(model, name), (len(envs), 1, 1)) for name in ("geom_friction", "body_ipos")}
        feet = [model.geom(name).id for names in self.FEET.values() for name in names]
        rows["geom_friction"][envs[:, None], feet, 0] = rng.uniform(*self.friction, 1)
        rows["body_ipos"][envs, 1] += _MAX_COM_SHIFT * rng.uniform(-1.0, 1.0, 3)
        reset.sim.randomize(envs=reset.envs, **rows)

    def advance(self, now: Moment) -> None:
        """Replaces expired commands, applies pushes, steps the simulation by one action, and records swings and landings of the feet."""
        state, model = now.episode_state, now.sim.model
        state["steps"] += 1
        resample_commands(now, self.stages)
        push(now, self.push)
        state["before"][:] = state["last"]
        state["last"][:] = now.action
        now.sim.step(stance(model) + action_scale(model) * now.action - state["encoder_bias"], self.frame_skip)
        on_ground, heights = foot_forces(now) > 0.0, foot_heights(now)
        state["landed"][:] = on_ground & (state["peak"] > 0.0)
        state["swing"][:] = np.where(state["landed"], state["peak"], 0.0)
        state["air_time"][:] = np.where(on_ground, 0.0, state["air_time"] + now.dt)
        state["peak"][:] = np.where(on_ground, 0.0, np.maximum(state["peak"], heights))

    def on_end(self, now: Moment, envs: Array) -> None:
        """Chooses harder or easier terrain for the next episode of the environments `envs`.

        If the robot left its tile, the environment moves to the next harder row of the terrain. Otherwise, if the robot covered less than
        half of the commanded distance, the environment moves to the next easier row.
        """
        state = now.episode_state
        distance = self.levels.distance(state, envs, now.qpos[envs])
        commanded = np.hypot(*command(now)[envs, :2].T) * self.episode_steps * now.dt
        self.levels.move(state, envs, up=distance > self.terrain.size / 2, down=distance < _LEAST_PROGRESS * commanded)


def _joint_pos(now: Moment) -> Array:
    """Encoder readings (joint angles with errors) minus the stance: (num_envs, nu) rad."""
    angles: Array = now.qpos[:, 7:] - stance(now.sim.model) + now.episode_state["encoder_bias"]
    return angles
