"""Base of tasks in which a legged robot follows a commanded velocity."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from stepper._stepper import Model
from stepper.actuators import ActuatorModel, DCMotor, Drive
from stepper.envs.assets import cache_per_model
from stepper.envs.locomotion import terrain
from stepper.envs.locomotion.base import check_sizes, check_weights, frame, linear_velocity, stance
from stepper.envs.task import Array, Moment, Observation, Reset, Task, Terms, per_moment, square_sum
from stepper.sensors import SensorModel, SensorSpec, Transfer
from stepper.shared.arguments import check_fields
from stepper.shared.rotations import about_vertical

_COMMANDS, _PUSHES = 2, 3
"""Number of commands per episode, one after the other; number of pushes per episode."""
_STANDING_SHARE = 0.1
"""Fraction of the commands that are zero (stand still)."""
_START_RANGE = 0.7 * terrain.HALF
"""Largest distance in x and y of an initial position from the middle of the bumpy ground, m."""
_GRID = np.stack(np.meshgrid(*[np.linspace(-1.0, 1.0, 5)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
"""Points of the observed grid of ground heights, ahead and to the left of the base, (25, 2), in multiples of `VelocityTask.sight`."""
_FOOTPRINT = np.stack(np.meshgrid(*[np.linspace(-0.4, 0.4, 9)] * 2), axis=-1).reshape(-1, 2)
"""Points around the base, (81, 2) m. The highest ground at these points sets the initial height of the base."""


@dataclass(frozen=True, kw_only=True)
class VelocityTask(Task):
    """Task: follow a commanded velocity in x, y and about z, in the frame of the base. Base class of the tasks for specific robots.

    The base is the first body and has a free joint.

    The model needs a servo for each of the other joints, in the order of these joints, and a keyframe "stance" near which episodes start.
    Actions are set points of the servos. Each episode draws friction of the feet, mass and centre of mass of the base, and gains of the
    servos. It also draws a latency of the actions, three sudden pushes, and two commands. One command in ten is to stand still.

    Attributes:
        frame_skip: Time steps per action.
        max_command: Largest magnitudes of the commanded velocities along x and y (m/s) and about z (rad/s).
        max_latency: Largest latency of the actions, in time steps: at most frame_skip.
        max_push: Largest change of the base's velocity by a push, along x and along y, m/s.
        episode_steps: Actions per episode, over which commands and pushes are spread.
        friction: Lowest and highest friction coefficient of the feet, which are the geoms with "foot" in their names.
        mass_scale: Lowest and highest factor of the mass of the base.
        gain_scale: Lowest and highest factor of the gains of the servos.
        center_shift: Largest shift of the base's centre of mass in each direction, m.
        noise: Factor of the sensor errors `ERRORS`; 0 means none. With errors, the IMU's velocity and rates of turn, the vertical and the
            encoders are noisy.
        motors: Whether servos have the torque-speed curves and the dry friction of motors (`MOTORS`) instead of torques at any speed.
        roughness: Largest height of the ground's bumps, m, which are about a metre wide; 0 means flat ground.
        sight: Half width of the observed grid of ground heights, m. The grid has 25 points around the base, and turns with the heading of
            the base. The heights are relative to the base. 0 means no grid.
        weights: Weights of some or all terms of the reward, by name; other terms have those of `WEIGHTS`.

    Raises:
        TypeError: The class does not define `lowest`, or weights is no mapping.
        ValueError: A latency, roughness, noise or sight is out of its range, a weight belongs to no term or is not finite, or a class
            without `MOTORS` gets motors=True. Environments of the task raise ValueError if the model lacks a part named above.
    """

    WEIGHTS: ClassVar[Mapping[str, float]] = {
        "linear": 1.0,
        "angular": 0.5,
        "bounce": 0.5,
        "roll": 0.02,
        "tilt": 2.0,
        "pose": 0.1,
        "torque": 1e-5,
        "change": 0.02,
    }
    """Weights of the terms of the reward (see the method `terms`), by name."""
    ERRORS: ClassVar[Mapping[str, float]] = {
        "linear_velocity": 0.5,
        "angular_velocity": 0.2,
        "vertical": 0.05,
        "angles": 0.01,
        "rates": 1.5,
    }
    """Half widths of the uniform sensor errors, by row of the observation table, from mjlab: m/s, rad/s, 1, rad, rad/s."""
    MOTORS: ClassVar[Mapping[str, tuple[float, float, float]]] = {}
    """Stall torque (N m), no-load speed (rad/s) and dry friction (N m) of the motors, by a part of the actuator's name.

    The first part that the name contains counts; "" is a part of every name.
    """
    imu: ClassVar[str] = "imu"
    """Site of the IMU."""
    lowest: ClassVar[float]
    """Height of the base above the ground below which an episode terminates, m. Subclasses must define it."""
    steepest: ClassVar[float] = 0.5
    """Cosine of the largest tilt of the base. An episode terminates at a larger tilt."""

    frame_skip: int = 4
    max_command: tuple[float, float, float] = (1.0, 0.5, 1.0)
    max_latency: int = 4
    max_push: float = 0.5
    episode_steps: int = 1000
    friction: tuple[float, float] = (0.4, 1.2)
    mass_scale: tuple[float, float] = (0.8, 1.2)
    gain_scale: tuple[float, float] = (0.9, 1.1)
    center_shift: float = 0.02
    noise: float = 0.0
    motors: bool = False
    roughness: float = 0.0
    sight: float = 0.0
    weights: Mapping[str, float] | None = None

    def __post_init__(self) -> None:
        if not hasattr(self, "lowest"):
            raise TypeError(
                f"{type(self).__name__} has no `lowest`: define it in the class, the height of the base (m) at which an episode ends"
            )
        check_fields(self)
        if not 0 <= self.max_latency <= self.frame_skip:
            raise ValueError(f"max_latency is {self.max_latency}, must be from 0 to frame_skip, which is {self.frame_skip}")
        if not 0.0 <= self.roughness <= 1.0:
            raise ValueError(f"roughness is {self.roughness}, must be from 0 to 1 m")
        check_sizes(self, "noise", "sight")
        if self.motors and not self.MOTORS:
            raise ValueError(f"{type(self).__name__} has no `MOTORS`: define the curves of its motors in the class, or leave motors=False")
        check_weights(self.weights, self.WEIGHTS)

    def robot(self) -> Model:
        """Model of the robot on its ground, with a servo for each joint and a keyframe "stance". Subclasses must define it."""
        raise NotImplementedError(f"{type(self).__name__} has no `robot`: define the method, which returns the model")

    def model(self) -> Model:
        """Model of the robot, with additional sensors if `noise` is above 0."""
        return _sensed(self.robot(), self.imu) if self.noise else self.robot()

    def sensors(self) -> SensorModel | None:
        """Sensor model with uniform errors of the observed quantities; None if `noise` is 0."""
        if not self.noise:
            return None
        errors = {row: Transfer(noise="uniform", noise_std=self.noise * width / math.sqrt(3.0)) for row, width in self.ERRORS.items()}
        joints = self.robot().joint_names[1:]
        named = {row: errors[row] for row in ("linear_velocity", "angular_velocity", "vertical")}
        return SensorModel({**named, **{f"{row} {joint}": errors[row] for row in ("angles", "rates") for joint in joints}})

    def actuators(self) -> ActuatorModel | None:
        """Actuator model with torque-speed curves and friction of the motors; None if `motors` is False."""
        if not self.motors:
            return None
        drives = {}
        for name in self.robot().actuator_names:
            stall, speed, friction = next(numbers for part, numbers in self.MOTORS.items() if part in name)
            drives[name] = Drive(motor=DCMotor(stall_torque=stall, no_load_speed=speed), friction=friction)
        return ActuatorModel(drives)

    def episode_state(self, num_envs: int) -> Terms:
        """Arrays of the episodes: number of actions, commands, pushes, latency, last action and the action before it."""
        model = self.model()
        self._check(model)
        start = stance(model)
        return {
            "step": np.zeros(num_envs, dtype=np.int64),
            "commands": np.zeros((num_envs, _COMMANDS, 3)),
            "push_steps": np.zeros((num_envs, _PUSHES), dtype=np.int64),
            "pushes": np.zeros((num_envs, _PUSHES, 2)),
            "latency": np.zeros(num_envs, dtype=np.int64),
            "last": np.tile(start, (num_envs, 1)),
            "before": np.tile(start, (num_envs, 1)),
        }

    def _check(self, model: Model) -> None:
        """Raises ValueError if the model lacks the keyframe "stance", a foot geom, or (with `roughness`) the geom "terrain"."""
        if "stance" not in model.keyframe_names:
            raise ValueError('the model has no keyframe "stance", from which episodes start: give it <key name="stance" qpos=.../>')
        if not any("foot" in name for name in model.geom_names):
            raise ValueError('no geom has "foot" in its name, and the task draws friction for the feet: name their geoms as "left_foot"')
        if self.roughness and "terrain" not in model.geom_names:
            raise ValueError(f'roughness is {self.roughness}, and the model has no geom "terrain": add `terrain.elements` to it')

    def observations(self) -> tuple[Observation, ...]:
        """Observation, (12 + 3 nu,): velocities, vertical direction, command, joint angles, joint velocities, last action.

        Velocities (linear and angular) and the vertical direction are those of the base, in its frame. Joint angles and last action are
        relative to the stance. With `sight`, 25 heights of the ground follow.
        """
        ground = (Observation("ground", func=_ground_around, unit="m"),) if self.sight else ()
        read = _readings
        return (
            Observation("linear_velocity", func=read("linear_velocity") if self.noise else linear_velocity, unit="m/s"),
            Observation("angular_velocity", func=read("angular_velocity") if self.noise else lambda now: now.qvel[:, 3:6], unit="rad/s"),
            Observation("vertical", func=read("vertical") if self.noise else vertical),
            Observation("command", func=command, unit="m/s, rad/s"),
            Observation("angles", func=lambda now: (read("angles")(now) if self.noise else now.qpos[:, 7:]) - stance_of(now), unit="rad"),
            Observation("rates", func=read("rates") if self.noise else lambda now: now.qvel[:, 6:], unit="rad/s"),
            Observation("last_action", func=lambda now: now.episode_state["last"] - stance_of(now), unit="rad"),
            *ground,
        )

    def terms(self, now: Moment) -> Terms:
        """Unweighted terms of the reward, (num_envs,) each: agreement with the command (0 to 1), and negative costs of rough motion."""
        velocity, angular, wanted = linear_velocity(now), now.qvel[:, 3:6], command(now)
        return {
            "linear": np.exp(-square_sum(velocity[:, :2] - wanted[:, :2]) / 0.25),
            "angular": np.exp(-np.square(angular[:, 2] - wanted[:, 2]) / 0.25),
            "bounce": -np.square(velocity[:, 2]),
            "roll": -square_sum(angular[:, :2]),
            "tilt": -square_sum(vertical(now)[:, :2]),
            "pose": -square_sum(now.qpos[:, 7:] - stance_of(now)),
            "torque": -square_sum(now.actuator_force),
            "change": -square_sum(now.episode_state["last"] - now.episode_state["before"]),
        }

    def reward(self, now: Moment) -> tuple[Array, Terms]:
        """Reward: sum of the weighted terms, at least 0. The info "tracking_error" is the velocity error in x and y, m/s."""
        weights = {**self.WEIGHTS, **(self.weights or {})}
        terms = {f"reward_{name}": weights[name] * term for name, term in self.terms(now).items()}
        error = np.sqrt(square_sum(linear_velocity(now)[:, :2] - command(now)[:, :2]))
        # A loop, because np.sum would add the terms in another order for a single environment, with other rounding.
        total: Array = sum(terms.values(), np.zeros(len(error)))
        return np.maximum(total, 0.0), {"tracking_error": error} | terms

    def terminated(self, now: Moment) -> Array:
        """Whether the base is too far from upright (`steepest`) or too low above the ground (`lowest`), (num_envs,)."""
        above = now.qpos[:, 2] - self.ground(now.qpos[:, :2])
        fallen: Array = ~((vertical(now)[:, 2] > self.steepest) & (above > self.lowest))
        return fallen

    def ground(self, xy: Array) -> Array:
        """Height of the ground, m, at points (..., 2), m."""
        heights: Array = self.roughness * terrain.height(xy) if self.roughness else np.zeros(xy.shape[:-1])
        return heights

    def info(self, now: Moment) -> Terms:
        """Info: current velocity command."""
        return {"command": command(now)}

    def reset(self, reset: Reset) -> None:
        """Draws initial states, and commands, pushes, latency and model parameters of the new episodes.

        Initial states are the stance with noise, random heading and velocity; on bumpy ground at a random position above the surface.
        """
        qpos, qvel, rng = reset.qpos, reset.qvel, reset.rng
        turn = rng.uniform(-np.pi, np.pi, 1)[:, 0]
        qpos[:] = self.model().keyframe("stance").qpos
        qpos[:, 3:7] = about_vertical(turn)
        qpos[:, 7:] += rng.uniform(-0.1, 0.1, qpos.shape[1] - 7)
        qvel[:, :6] = rng.uniform(-0.3, 0.3, 6)
        if self.roughness:
            qpos[:, :2] = rng.uniform(-_START_RANGE, _START_RANGE, 2)
            qpos[:, 2] += self.ground(qpos[:, None, :2] + _FOOTPRINT).max(axis=1)
        count, model = len(rng.envs), reset.sim.model
        commands = rng.uniform(-1.0, 1.0, 3 * _COMMANDS).reshape(count, _COMMANDS, 3) * self.max_command
        commands[rng.uniform(0.0, 1.0, _COMMANDS) < _STANDING_SHARE] = 0.0
        spread = (np.arange(_PUSHES) + rng.uniform(0.2, 0.8, _PUSHES)) * (self.episode_steps / _PUSHES)
        initial = {
            "step": 0,
            "commands": commands,
            "push_steps": spread.astype(np.int64),
            "pushes": self.max_push * rng.uniform(-1.0, 1.0, 2 * _PUSHES).reshape(count, _PUSHES, 2),
            "latency": (rng.uniform(0.0, 1.0, 1)[:, 0] * (self.max_latency + 1)).astype(np.int64),
            "last": stance(model),
            "before": stance(model),
        }
        for name, values in initial.items():
            reset.episode_state[name][:] = values
        varied = ("geom_friction", "body_mass", "body_ipos", "actuator_gainprm", "actuator_biasprm")
        rows = {name: np.repeat(np.asarray(getattr(model, name))[None], count, axis=0) for name in varied}
        rows["geom_friction"][:, [k for k, name in enumerate(model.geom_names) if "foot" in name], 0] = rng.uniform(*self.friction, 1)
        rows["body_mass"][:, 1] *= rng.uniform(*self.mass_scale, 1)[:, 0]
        rows["body_ipos"][:, 1] += rng.uniform(-self.center_shift, self.center_shift, 3)
        gains = rng.uniform(*self.gain_scale, model.nu)[:, :, None]
        rows["actuator_gainprm"] *= gains
        rows["actuator_biasprm"] *= gains
        reset.sim.randomize(envs=reset.envs, **rows)

    def advance(self, now: Moment) -> None:
        """Pushes the base in environments whose push is due, and steps the simulation by one action.

        During the latency the previous action still acts.
        """
        episode_state, sim = now.episode_state, now.sim
        episode_state["step"] += 1
        pushed = episode_state["push_steps"] == episode_state["step"][:, None]
        if pushed.any():
            qvel = np.array(sim.qvel, dtype=np.float64)
            qvel[:, :2] += np.einsum("nk,nki->ni", pushed, episode_state["pushes"])
            sim.set_state(qvel=qvel, envs=pushed.any(axis=1), keep_warmstart=True)
        episode_state["before"][:] = episode_state["last"]
        episode_state["last"][:] = now.action
        status = np.zeros(len(now.action), dtype=np.uint32)
        for k in range(self.frame_skip):
            waits = episode_state["latency"] > k
            sim.step(np.where(waits[:, None], episode_state["before"], now.action))
            status |= sim.status
        now.keep("status", status)


@cache_per_model
def _sensed(robot: Model, imu: str) -> Model:
    """Copy of the robot's model with added sensors of velocities, vertical and joints, which the task observes.

    `imu` is the name of the site of the IMU (inertial measurement unit).
    """
    base, world = robot.body_names[1], robot.body_names[0]
    readings = {
        "linear_velocity": SensorSpec(type="velocimeter", site=imu),
        "angular_velocity": SensorSpec(type="gyro", site=imu),
        "vertical": SensorSpec(type="framezaxis", body=world, reference_body=base),
    }
    joints = robot.joint_names[1:]
    readings |= {f"angles {joint}": SensorSpec(type="jointpos", joint=joint) for joint in joints}
    readings |= {f"rates {joint}": SensorSpec(type="jointvel", joint=joint) for joint in joints}
    return robot.with_sensors(readings)


def _readings(row: str) -> Callable[[Moment], Array]:
    """Function of a moment (view of all environments) that returns the sensor readings of a row of the observation, (num_envs, n).

    `row` is the name of the row in the observation table, which is the beginning of the sensors' names.
    """

    def read(now: Moment) -> Array:
        first, count = _columns(now.sim.model, row)
        values: Array = now.sensordata[:, first : first + count]
        return values

    return read


@cache_per_model
def _columns(model: Model, row: str) -> tuple[int, int]:
    """Columns in `sensordata` that contain one part of the observation: index of the first column, and number of columns.

    Args:
        model: Model of the robot.
        row: Name of the part, such as "angles". Its sensors are adjacent and have this name, or this name followed by the name of a joint.
    """
    found = [sensor for sensor in map(model.sensor, range(len(model.sensor_names))) if re.fullmatch(f"{row}( .*)?", sensor.name)]
    return found[0].adr, sum(sensor.dim for sensor in found)


def stance_of(now: Moment) -> Array:
    """Joint angles of the keyframe "stance", near which episodes start, (nu,), rad."""
    return stance(now.sim.model)


def _ground_around(now: Moment) -> Array:
    """Heights of the ground minus the height of the base at the points of the observed grid, (num_envs, 25) m."""
    ahead = frame(now)[:, :2, 0]
    ahead = ahead / np.maximum(np.sqrt(square_sum(ahead)), 1e-9)[:, None]
    left = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    offsets = now.task.sight * _GRID
    places = now.qpos[:, None, :2] + offsets[:, :1] * ahead[:, None] + offsets[:, 1:] * left[:, None]
    heights: Array = now.task.ground(places) - now.qpos[:, 2:3]
    return heights


def vertical(now: Moment) -> Array:
    """Vertical unit vector in the frame of the base, (num_envs, 3)."""
    upwards: Array = frame(now)[:, 2]
    return upwards


@per_moment
def command(now: Moment) -> Array:
    """Current velocity command along x and y (m/s) and about z (rad/s), in the frame of the base, (num_envs, 3)."""
    episode_state = now.episode_state
    length = -(-now.task.episode_steps // _COMMANDS)
    which = np.minimum(episode_state["step"] // length, _COMMANDS - 1)
    wanted: Array = episode_state["commands"][np.arange(len(which)), which]
    return wanted
