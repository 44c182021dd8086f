"""Tasks in which a legged robot follows a commanded velocity, on a plane or on generated terrain."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar

import numpy as np

from stepper._stepper import Model
from stepper.actuators import ActuatorModel, DCMotor, Drive
from stepper.envs.actions import Servo
from stepper.envs.commands import VelocityCommand
from stepper.envs.events import Event, at_reset, every, push
from stepper.envs.locomotion import rewards as terms
from stepper.envs.observations import Observation
from stepper.envs.quantities import action_rate, base_angvel, base_linvel, gravity, joint_pos, joint_vel
from stepper.envs.rewards import Reward
from stepper.envs.task import Array, Reset, Task, TaskView, Terms
from stepper.envs.terrain import Flat, PyramidSlope, PyramidStairs, RandomRough, Terrain, TerrainCurriculum, Wave
from stepper.shared.arguments import check_fields, check_number
from stepper.shared.draws import add, scale, uniform
from stepper.shared.rotations import about_vertical

Range = tuple[float, float]

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
_SCAN_UNIT = 5.0
"""Height difference of the scan that is observed as 1, m."""
_LEAST_PROGRESS = 0.5
"""Fraction of the commanded distance below which an environment moves to an easier row of the terrain."""
_ERRORS = {"linvel": 0.5, "angvel": 0.2, "gravity": 0.05, "joint_pos": 0.01, "joint_vel": 1.5, "scan": 0.1 / _SCAN_UNIT}
"""Half widths of mjlab's uniform observation noise: m/s, rad/s, 1, rad, rad/s, 5 m."""


_TWIST = VelocityCommand(every=(10.0, 10.0), x=(-1.0, 1.0), y=(-0.5, 0.5), yaw=(-1.0, 1.0), standing=0.1)
"""Commands on a plane."""
_ROUGH_TWIST = VelocityCommand(
    every=(3.0, 8.0),
    x=(-1.0, 1.0),
    y=(-1.0, 1.0),
    yaw=(-0.5, 0.5),
    standing=0.1,
    turning=0.3,
    forward=0.2,
    stages=((120_000, {"x": (-1.5, 2.0), "yaw": (-0.7, 0.7)}), (240_000, {"x": (-2.0, 3.0)})),
)
"""Commands on rough terrain, with the stages of their curriculum."""


@cache
def bumps(height: float) -> Terrain:
    """Terrain of 40 m by 40 m with bumps of up to `height`, m, which are about a metre wide, and a flat border."""
    return Terrain(
        sub_terrains={"bumps": RandomRough(height_range=(height, height), spacing=1.0)},
        num_rows=1,
        size=40.0,
        border_width=20.0,
        horizontal_scale=0.25,
    )


@dataclass(frozen=True, kw_only=True)
class VelocityTask(Task):
    """Task: follow a commanded velocity in x, y and about z, in the frame of the base. Base class of the tasks for specific robots.

    The base is the first body and has a free joint. The model needs a position servo for each of the other joints, in the order of these
    joints, and a keyframe "stance" near which episodes start. Terrain is a geom "terrain". An action of 1 moves a set point from the
    stance by a quarter of the servo's largest torque. Each episode draws friction of the feet, mass and centre of mass of the base, and
    gains of the servos. It also draws a latency of the actions. Pushes come at random times.

    On terrain, an environment whose robot leaves its tile starts its next episode on a harder row. If the robot covers less than half of
    the commanded distance, the next episode starts on an easier row.

    Attributes:
        frame_skip: Time steps per action.
        episode_seconds: Time limit of an episode, s.
        twist: Commanded velocities.
        terrain: Terrain; None is a plane.
        roughness: Largest height of bumps of the ground, m, in place of `terrain`; 0 means none.
        scan: Whether heights of the ground at 187 points around the base are observed.
        noise: Factor of mjlab's observation noise and encoder errors; 0 means none.
        push: Factor of the pushes (`PUSHES`); 0 means none.
        friction: Lowest and highest friction coefficient of the feet.
        mass_scale: Lowest and highest factor of the mass of the base.
        gain_scale: Lowest and highest factor of the gains of the servos.
        center_shift: Largest shifts of the base's centre of mass along x, y and z, m.
        max_latency: Largest latency of the actions, in time steps: at most frame_skip.
        max_init_level: Hardest row of the terrain (0 is the easiest) in which environments start after a reset with a seed.
        motors: Whether servos have the torque-speed curves and the dry friction of motors (`MOTORS`) instead of torques at any speed.

    Raises:
        TypeError: The terrain is no `Terrain`.
        ValueError: A number is out of its range, or a class without `MOTORS` gets motors=True. Environments of the task raise ValueError if
            the model lacks a part named above.
    """

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
    MOTORS: ClassVar[Mapping[str, tuple[float, float, float]]] = {}
    """Stall torque (N m), no-load speed (rad/s) and dry friction (N m) of the motors, by a part of the actuator's name.

    The first part that the name contains counts; "" is a part of every name.
    """
    PUSHES: ClassVar[Mapping[str, float]] = {"x": 0.5, "y": 0.5}
    """Largest changes of the base's velocity by a push, m/s and rad/s, by argument of `push`."""
    PUSH_SECONDS: ClassVar[Range] = (2.5, 9.0)
    """Shortest and longest time between two pushes, s."""
    bound: ClassVar[float] = 2.0
    """Largest action."""
    lowest: ClassVar[float | None] = None
    """Height of the base above the ground below which an episode terminates, m; None means no limit."""
    steepest: ClassVar[float | None] = 0.5
    """Cosine of the largest tilt of the base. An episode terminates at a larger tilt; None means no limit."""
    encoder_error: ClassVar[float] = 0.0
    """Largest error of an encoder, which lasts for an episode, rad."""
    initial: ClassVar[Mapping[str, Any]] = {"lift": (0.0, 0.0), "angle": 0.1, "speed": 0.3}
    """Initial noise: range of the lift of the base, m; largest noise of joint angles, rad, and of the base's velocity, m/s and rad/s."""
    keyframe = "stance"

    frame_skip: int = 4
    episode_seconds: float = 20.0
    twist: VelocityCommand = _TWIST
    terrain: Terrain | None = None
    roughness: float = 0.0
    scan: bool = False
    noise: float = 0.0
    push: float = 1.0
    friction: Range = (0.4, 1.2)
    mass_scale: Range = (0.8, 1.2)
    gain_scale: Range = (0.9, 1.1)
    center_shift: tuple[float, float, float] = (0.02, 0.02, 0.02)
    max_latency: int = 4
    max_init_level: int = 5
    motors: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.terrain, Terrain | None):
            raise TypeError(f"terrain is {self.terrain!r}, must be a Terrain of stepper.envs.terrain, such as Terrain(sub_terrains=...)")
        check_fields(self)
        check_number("roughness", self.roughness, least=0.0, most=1.0)
        for name in ("noise", "push"):
            check_number(name, getattr(self, name), least=0.0)
        if not 0 <= self.max_latency <= self.frame_skip:
            raise ValueError(f"max_latency is {self.max_latency}, must be from 0 to frame_skip, which is {self.frame_skip}")
        if self.motors and not self.MOTORS:
            raise ValueError(f"{type(self).__name__} has no `MOTORS`: define the curves of its motors in the class, or leave motors=False")

    @property
    def ground(self) -> Terrain | None:
        """Terrain of the scene: `terrain`, or bumps of the height `roughness`; None is a plane."""
        return bumps(self.roughness) if self.roughness else self.terrain

    def ground_height(self, xy: Array) -> Array:
        """Height of the ground, m, at points (..., 2), m."""
        return np.zeros(xy.shape[:-1]) if self.ground is None else self.ground.height(xy)

    @property
    def levels(self) -> TerrainCurriculum:
        """Curriculum that selects the row of the terrain (the difficulty) for each episode of an environment."""
        if self.ground is None:
            raise ValueError("a plane has no levels: give the task a terrain")
        spread = 0.35 * self.ground.size if self.roughness else 0.5
        return TerrainCurriculum(terrain=self.ground, max_init_level=self.max_init_level, spread=spread)

    @property
    def carried(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names in `episode_state` that persist into the next episode: those of the terrain."""
        return () if self.ground is None else TerrainCurriculum.carried

    @property
    def commands(self) -> Mapping[str, VelocityCommand]:
        """The command "twist"."""
        return {"twist": self.twist}

    @property
    def actions(self) -> Servo:
        """Set points of all servos, relative to the stance."""
        return Servo("*", scale=terms.action_scale, offset=_set_points, bound=self.bound, delay=(0, self.max_latency))

    def actuators(self) -> ActuatorModel | None:
        """Actuator model with torque-speed curves and friction of the motors; None if `motors` is False."""
        if not self.motors:
            return None
        drives = {}
        for name in self.model().actuator_names:
            stall, speed, friction = next(numbers for part, numbers in self.MOTORS.items() if part in name)
            drives[name] = Drive(motor=DCMotor(stall_torque=stall, no_load_speed=speed), friction=friction)
        return ActuatorModel(drives)

    def observations(self) -> tuple[Observation, ...]:
        """Observation: velocities of the base, gravity, joint angles, joint velocities, last action, command, height scan.

        Velocities of the base (linear and angular) and the direction of gravity are in the frame of the base. Joint angles are encoder
        readings minus the stance. The height scan is left out without `scan`.
        """
        width = {name: self.noise * error for name, error in _ERRORS.items()}
        rows = (
            Observation("base_lin_vel", func=base_linvel, noise=width["linvel"], unit="m/s"),
            Observation("base_ang_vel", func=base_angvel, noise=width["angvel"], unit="rad/s"),
            Observation("projected_gravity", func=_sensed_gravity),
            Observation("joint_pos", func=_encoders, noise=width["joint_pos"], unit="rad"),
            Observation("joint_vel", func=joint_vel, noise=width["joint_vel"], unit="rad/s"),
            Observation("actions", func=lambda now: now.action),
            Observation("command", func=lambda now: now.command(), unit="m/s, rad/s"),
        )
        scan = Observation("height_scan", func=_scan, noise=width["scan"], unit="5 m")
        return (*rows, scan) if self.scan else rows

    def rewards(self) -> Mapping[str, Reward]:
        """Terms of the reward of an action: agreement with the command (0 to 1), less costs of rough motion."""
        made = {
            "track_linear_velocity": Reward(terms.track_linear_velocity, 1.0, per_second=False, vertical=False),
            "track_angular_velocity": Reward(terms.track_angular_velocity, 0.5, per_second=False, variance=0.25, tilting=False),
        }
        costs: dict[Callable[..., Array], float] = {
            terms.vertical_velocity: -0.5,
            terms.body_ang_vel: -0.02,
            terms.flat_orientation: -2.0,
            terms.joint_deviation: -0.1,
            terms.joint_torques: -1e-5,
            terms.set_point_rate: -0.02,
        }
        return made | {function.__name__: Reward(function, weight, per_second=False) for function, weight in costs.items()}

    def reward(self, now: TaskView) -> tuple[Array, Terms]:
        """Reward: sum of the weighted terms, at least 0. The info "tracking_error" is the velocity error in x and y, m/s."""
        total = sum(now.reward_terms.values(), np.zeros(len(now.action)))
        return np.maximum(total, 0.0), {"tracking_error": terms.tracking_error(now)}

    def events(self) -> tuple[Event, ...]:
        """Friction of the feet, mass and centre of mass of the base, gains of the servos, and pushes."""
        feet = ",".join(repr(name) for names in self.FEET.values() for name in names)
        shift = np.array(self.center_shift)
        events = [
            at_reset(f"geom_friction[{feet}][0]", uniform(*self.friction, shared=True)),
            at_reset("body_mass[1]", scale(*self.mass_scale)),
            at_reset("body_ipos[1]", add(-shift, shift)),
            at_reset(("actuator_kp", "actuator_kv"), scale(*self.gain_scale)),
        ]
        # An event that changes nothing costs time at every reset.
        varies = (True, self.mass_scale != (1.0, 1.0), bool(shift.any()), self.gain_scale != (1.0, 1.0))
        events = [event for event, is_used in zip(events, varies, strict=True) if is_used]
        pushes = {name: (-self.push * size, self.push * size) for name, size in self.PUSHES.items()}
        body = self.model().body_names[1]
        return (*events, every(self.PUSH_SECONDS, push(body, **pushes))) if self.push else tuple(events)

    def terminated(self, now: TaskView) -> Array:
        """Whether the base is too far from upright (`steepest`) or too low (`lowest`), or a geom of `THIGHS` collides, (num_envs,)."""
        fallen = np.zeros(len(now.action), dtype=bool)
        if self.steepest is not None:
            fallen |= ~(-gravity(now)[:, 2] > self.steepest)
        if self.lowest is not None:
            fallen |= ~(now.qpos[:, 2] - self.ground_height(now.qpos[:, :2]) > self.lowest)
        return fallen if self.ground is None else fallen | terms.touches_terrain(now, self.THIGHS)

    def truncated(self, now: TaskView) -> Array | None:
        """Whether the base is outside the terrain or within 0.3 m of the terrain's edge, (num_envs,) bool."""
        return None if self.ground is None else self.ground.leaves(now.qpos[:, :2])

    def info(self, now: TaskView) -> Terms:
        """Info: the velocity command and, on terrain, the level (row of the terrain) of each environment."""
        level = {} if self.ground is None else {"terrain_level": np.array(now.episode_state["terrain_level"])}
        return {"command": now.command(), **level}

    def episode_state(self, num_envs: int) -> Terms:
        """Arrays for encoder errors, levels of the terrain, and swings of the feet on terrain."""
        state: Terms = {"encoder_error": np.zeros((num_envs, self.model().nu))}
        if self.ground is None:
            return state
        feet = len(self.FEET)
        swings = {name: np.zeros((num_envs, feet)) for name in ("peak", "swing", "air_time")}
        return state | self.levels.episode_state(num_envs) | swings | {"landed": np.zeros((num_envs, feet), dtype=bool)}

    def reset(self, reset: Reset) -> None:
        """Initial states: the stance with noise (`initial`) and a random heading, on terrain near the middle of the environment's tile."""
        rng, noise = reset.rng, self.initial
        least, most = noise["lift"]
        reset.qpos[:, 2] += rng.uniform(least, most, 1)[:, 0]
        reset.qpos[:, 3:7] = about_vertical(rng.uniform(-np.pi, np.pi, 1)[:, 0])
        reset.qpos[:, 7:] += rng.uniform(-noise["angle"], noise["angle"], reset.qpos.shape[1] - 7)
        reset.qvel[:, :6] = rng.uniform(-noise["speed"], noise["speed"], 6)
        if self.ground is not None:
            self.levels.place(reset)
        error = self.noise * self.encoder_error
        reset.episode_state["encoder_error"] = rng.uniform(-error, error, reset.sim.model.nu)

    def advance(self, now: TaskView) -> None:
        """Steps the simulation by one action, and records swings and landings of the feet on terrain."""
        now.step()
        if self.ground is None:
            return
        state = now.episode_state
        on_ground, heights = terms.foot_forces(now) > 0.0, terms.foot_heights(now)
        state["landed"][:] = on_ground & (state["peak"] > 0.0)
        state["swing"][:] = np.where(state["landed"], state["peak"], 0.0)
        state["air_time"][:] = np.where(on_ground, 0.0, state["air_time"] + now.dt)
        state["peak"][:] = np.where(on_ground, 0.0, np.maximum(state["peak"], heights))

    def on_end(self, now: TaskView, envs: Array) -> None:
        """Chooses harder or easier terrain for the next episode of the environments `envs`.

        If the robot left its tile, the environment moves to the next harder row of the terrain. Otherwise, if the robot covered less than
        half of the commanded distance, the environment moves to the next easier row.
        """
        if self.ground is None:
            return
        state = now.episode_state
        distance = self.levels.distance(state, envs, now.qpos[envs])
        commanded = np.hypot(*now.command()[envs, :2].T) * self.episode_seconds
        self.levels.move(state, envs, up=distance > self.ground.size / 2, down=distance < _LEAST_PROGRESS * commanded)


@dataclass(frozen=True, kw_only=True)
class RoughTask(VelocityTask):
    """Velocity task with terrain, observations, rewards, random events and curricula of mjlab's rough velocity tasks.

    A command lasts 3 to 8 s, and commands become faster after 120,000 and 240,000 actions of an environment. Pushes come every 1 to 3 s.
    """

    PUSHES: ClassVar[Mapping[str, float]] = {"x": 0.5, "y": 0.5, "z": 0.4, "roll": 0.52, "pitch": 0.52, "yaw": 0.78}
    PUSH_SECONDS: ClassVar[Range] = (1.0, 3.0)
    bound: ClassVar[float] = 4.0
    steepest: ClassVar[float | None] = None
    encoder_error = 0.015
    initial: ClassVar[Mapping[str, Any]] = {"lift": (0.01, 0.05), "angle": 0.0, "speed": 0.0}

    twist: VelocityCommand = _ROUGH_TWIST
    terrain: Terrain | None = ROUGH
    scan: bool = True
    noise: float = 1.0
    friction: Range = (0.3, 1.2)
    mass_scale: Range = (1.0, 1.0)
    gain_scale: Range = (1.0, 1.0)
    center_shift: tuple[float, float, float] = (0.025, 0.025, 0.03)
    max_latency: int = 0

    def rewards(self) -> Mapping[str, Reward]:
        """Terms of mjlab's reward, with weights per second."""
        weights: dict[Callable[..., Array], float] = {
            terms.track_linear_velocity: 2.0,
            terms.track_angular_velocity: 2.0,
            terms.upright: 1.0,
            terms.pose: 1.0,
            terms.body_ang_vel: 0.0,
            terms.dof_pos_limits: -1.0,
            action_rate: -0.1,
            terms.air_time: 0.0,
            terms.foot_clearance: -2.0,
            terms.foot_swing_height: -0.25,
            terms.foot_slip: -0.1,
            terms.soft_landing: -1e-5,
        }
        collisions = {
            f"{part}_collision": Reward(terms.collision, 0.0, part=name) for part, name in (("shank", "SHANKS"), ("trunk", "TRUNK"))
        }
        return {function.__name__: Reward(function, weight) for function, weight in weights.items()} | collisions

    def reward(self, now: TaskView) -> tuple[Array, Terms]:
        """Reward: sum of the weighted terms. The info "tracking_error" is the velocity error in x and y, m/s."""
        total = sum(now.reward_terms.values(), np.zeros(len(now.action)))
        return total, {"tracking_error": terms.tracking_error(now)}


def stance(model: Model) -> Array:
    """Joint angles of the keyframe "stance", (nu,), rad."""
    angles: Array = np.array(model.keyframe("stance").qpos[7:])
    return angles


def _set_points(now: TaskView) -> Array:
    """Set points of the servos for the action 0, (num_envs, nu), rad: the stance, minus the errors of the encoders."""
    points: Array = now.default_qpos[7:] - now.episode_state["encoder_error"]
    return points


def _encoders(now: TaskView) -> Array:
    """Encoder readings (joint angles with errors) minus the stance: (num_envs, nu) rad."""
    readings: Array = joint_pos(now) + now.episode_state["encoder_error"]
    return readings


def _sensed_gravity(now: TaskView) -> Array:
    """Unit vector downwards in the frame of the base, (num_envs, 3), which the observation noise turns."""
    if not now.task.noise:
        return gravity(now)
    width = now.task.noise * _ERRORS["gravity"]
    turned = gravity(now) + now.rng("projected_gravity").uniform(-width, width, 3)
    unit: Array = turned / np.sqrt(np.einsum("ni,ni->n", turned, turned))[:, None]
    return unit


def _scan(now: TaskView) -> Array:
    """Height of the base above the points of the height scan, (num_envs, 187), in units of 5 m."""
    heights: Array = (now.qpos[:, 2:3] - terms.ground_scan(now)) / _SCAN_UNIT
    return heights
