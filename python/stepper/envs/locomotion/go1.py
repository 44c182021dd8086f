"""Unitree's Go1 follows a commanded velocity, as locomotion people train it: randomised, pushed, with latency."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar
from xml.etree import ElementTree

import numpy as np

from stepper._stepper import Model, Stepper
from stepper.envs.assets import load_quietly, read_once
from stepper.envs.streams import Draws
from stepper.envs.task import Array, Camera, Moment, Quantity, Task, Terms, per_moment, square_sum
from stepper.shared.machine import package_file

_FILE = "asset_zoo/robots/unitree_go1/xmls/go1.xml"
_HEIGHT = 0.278
"""Of the trunk at the beginning, m."""
_STANCE = {"hip": 0.1, "thigh": 0.9, "calf": -1.8}
"""Angles at the beginning, rad; hips point outwards."""
_ROTOR = 0.000111842
"""Inertia of a motor's rotor, kg m^2, from Unitree's description of the robot."""
_GEAR = {"hip": 6.0, "thigh": 6.0, "calf": 9.0}
_TORQUE = {"hip": 23.7, "thigh": 23.7, "calf": 35.55}
"""Largest torques, N m."""
_FREQUENCY, _DAMPING_RATIO = 2.0 * np.pi * 10.0, 2.0
"""Of the servos with the inertia of the rotors alone, rad/s: from these mjlab takes their gains."""
_REACH = 0.5
"""A servo's set point is at most this many times what gives its largest torque away from the stance."""
_STEEPEST = 0.5
"""Cosine of the inclination of the trunk at which an episode ends."""
_LOWEST = 0.15
"""Height of the trunk at which it ends, m."""
_GREY, _LIGHT = "0.25 0.25 0.28 1", "0.75 0.75 0.78 1"
"""Colours of what touches the ground, and of the rest."""
_FOOT, _CLEAR = 0.023, 0.01
"""Radius of a foot, and its height above which it is in the air, m."""
_SHORTEST, _LONGEST = 0.1, 0.3
"""Times in the air, s: a foot that lands gains by what is beyond the first, up to the second."""
_STANDS = 0.1
"""Length of a command below which it is one to stand."""
_COMMANDS, _PUSHES = 2, 3
"""Commands of an episode, one after the other; pushes of an episode."""


@dataclass(frozen=True, kw_only=True)
class Go1Velocity(Task):
    """Follow a velocity in x and y and about z, commanded in the frame of the trunk, on flat ground.

    The robot is mjlab's, whose package has to be installed (`pip install --no-deps mjlab`) and of which only the file is read. Feet, trunk
    and head touch the ground, and no other part. Actions are set points of the servos, rad. Each episode has its own parameters (friction
    of the feet, mass and centre of mass of the trunk, gains of the servos), a latency of the actions, two commands, one of ten of which is
    to stand, and three pushes, which change the trunk's velocity at once.

    Attributes:
        frame_skip: Steps of 5 ms for each action.
        max_command: Largest commands, m/s and rad/s.
        max_latency: Largest latency, steps of 5 ms: at most frame_skip, as an action is late by one action at most.
        max_push: Largest change of the velocities in x and y, m/s.
        episode_steps: Actions of an episode, in which commands and pushes are spread.
        friction: Least and largest friction of the feet.
        mass_scale: Least and largest mass of the trunk, times its own.
        gain_scale: Least and largest gains of the servos, times their own.
        center_shift: Largest shift of the trunk's centre of mass in each direction, m.
        weights: Weights of the terms of the reward, of some or all; the others are those of `WEIGHTS`.

    Raises:
        ValueError: A latency out of its range, a weight of a term that there is not.
    """

    camera: ClassVar[Camera] = {"trackbodyid": 1, "distance": 2.0, "azimuth": 120.0, "elevation": -20.0}

    frame_skip: int = 4
    max_command: tuple[float, float, float] = (1.0, 0.5, 1.0)
    max_latency: int = 4
    max_push: float = 0.5
    episode_steps: int = 1000
    friction: tuple[float, float] = (0.4, 1.2)
    mass_scale: tuple[float, float] = (0.8, 1.2)
    gain_scale: tuple[float, float] = (0.9, 1.1)
    center_shift: float = 0.02
    weights: Mapping[str, float] | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.max_latency <= self.frame_skip:
            raise ValueError(f"max_latency is {self.max_latency}, must be from 0 to frame_skip, which is {self.frame_skip}")
        if unknown := sorted(set(self.weights or {}) - set(WEIGHTS)):
            raise ValueError(f"weights has {unknown}, terms of the reward are {', '.join(WEIGHTS)}")

    def model(self) -> Model:
        """The robot on a plane, with servos."""
        return _scene()

    def memory(self, num_envs: int) -> Terms:
        """Commands and pushes of the episodes, the last two actions, and how long each foot is in the air."""
        return {
            "step": np.zeros(num_envs, dtype=np.int64),
            "commands": np.zeros((num_envs, _COMMANDS, 3)),
            "push_steps": np.zeros((num_envs, _PUSHES), dtype=np.int64),
            "pushes": np.zeros((num_envs, _PUSHES, 2)),
            "latency": np.zeros(num_envs, dtype=np.int64),
            "last": np.tile(_stance(), (num_envs, 1)),
            "before": np.tile(_stance(), (num_envs, 1)),
            "air": np.zeros((num_envs, 4)),
            "stride": np.zeros(num_envs),
        }

    def quantities(self) -> tuple[Quantity, ...]:
        """Velocities and vertical of the trunk in its frame, command, angles and last action beside the stance, their rates: (48,)."""
        return (
            Quantity("linear_velocity", of=_linear_velocity),
            Quantity("angular_velocity", of=lambda now: now.qvel[:, 3:6]),
            Quantity("vertical", of=_vertical),
            Quantity("command", of=_command),
            Quantity("angles", of=lambda now: now.qpos[:, 7:] - _stance()),
            Quantity("rates", of=lambda now: now.qvel[:, 6:]),
            Quantity("last_action", of=lambda now: now.memory["last"] - _stance()),
        )

    def reward(self, now: Moment) -> tuple[Array, Terms]:
        """How well the command is followed, less what is rough; "tracking_error" is the distance from the command in x and y, m/s."""
        velocity, angular, command = _linear_velocity(now), now.qvel[:, 3:6], _command(now)
        error = square_sum(velocity[:, :2] - command[:, :2])
        terms = {
            "linear": np.exp(-error / 0.25),
            "angular": np.exp(-np.square(angular[:, 2] - command[:, 2]) / 0.25),
            "bounce": -np.square(velocity[:, 2]),
            "roll": -square_sum(angular[:, :2]),
            "tilt": -square_sum(_vertical(now)[:, :2]),
            "pose": -square_sum(now.qpos[:, 7:] - _stance()),
            "torque": -square_sum(now.actuator_force),
            "change": -square_sum(now.memory["last"] - now.memory["before"]),
            "stride": now.memory["stride"] * (square_sum(command) > _STANDS**2),
        }
        weights = {**WEIGHTS, **(self.weights or {})}
        total: Array = sum((weights[name] * term for name, term in terms.items()), np.zeros(len(error)))
        return np.maximum(total, 0.0), {"tracking_error": np.sqrt(error)} | {
            f"reward_{name}": weights[name] * terms[name] for name in terms
        }

    def healthy(self, now: Moment) -> Array:
        """The trunk is upright and off the ground."""
        healthy: Array = (_vertical(now)[:, 2] > _STEEPEST) & (now.qpos[:, 2] > _LOWEST)
        return healthy

    def info(self, now: Moment) -> Terms:
        """The command."""
        return {"command": _command(now)}

    def start(self, qpos: Array, qvel: Array, draws: Draws) -> None:
        """In its stance with some noise, in any direction, with some velocity."""
        turn = draws.uniform(-np.pi, np.pi, 1)[:, 0]
        qpos[:, 2] = _HEIGHT
        qpos[:, 3:7] = np.stack([np.cos(turn / 2.0), 0.0 * turn, 0.0 * turn, np.sin(turn / 2.0)], axis=1)
        qpos[:, 7:] = _stance() + draws.uniform(-0.1, 0.1, 12)
        qvel[:, :6] = draws.uniform(-0.3, 0.3, 6)

    def prepare(self, sim: Stepper, memory: Terms, mask: Array, draws: Draws) -> None:
        """Commands, pushes, latency and parameters."""
        count = len(draws.envs)
        commands = draws.uniform(-1.0, 1.0, 3 * _COMMANDS).reshape(count, _COMMANDS, 3) * self.max_command
        commands[draws.uniform(0.0, 1.0, _COMMANDS) < 0.1] = 0.0
        spread = (np.arange(_PUSHES) + draws.uniform(0.2, 0.8, _PUSHES)) * (self.episode_steps / _PUSHES)
        now = {
            "step": 0,
            "commands": commands,
            "push_steps": spread.astype(np.int64),
            "pushes": self.max_push * draws.uniform(-1.0, 1.0, 2 * _PUSHES).reshape(count, _PUSHES, 2),
            "latency": (draws.uniform(0.0, 1.0, 1)[:, 0] * (self.max_latency + 1)).astype(np.int64),
            "last": _stance(),
            "before": _stance(),
            "air": 0.0,
            "stride": 0.0,
        }
        for name, values in now.items():
            memory[name][mask] = values
        model = sim.model
        feet = [k for k, name in enumerate(model.geom_names) if name.endswith("foot_collision")]
        trunk = model.body("trunk").id
        own = ("geom_friction", "body_mass", "body_ipos", "actuator_gain", "actuator_bias")
        rows = {name: np.tile(value, (count, *[1] * value.ndim)) for name in own for value in [np.asarray(getattr(model, name))]}
        rows["geom_friction"][:, feet, 0] = draws.uniform(*self.friction, 1)
        rows["body_mass"][:, trunk] *= draws.uniform(*self.mass_scale, 1)[:, 0]
        rows["body_ipos"][:, trunk] += draws.uniform(-self.center_shift, self.center_shift, 3)
        gains = draws.uniform(*self.gain_scale, model.nu)[:, :, None]
        rows["actuator_gain"] *= gains
        rows["actuator_bias"] *= gains
        fields = {name: np.zeros((len(mask), *value.shape[1:])) for name, value in rows.items()}
        for name, value in rows.items():
            fields[name][mask] = value
        sim.randomize(mask, **fields)

    def advance(self, now: Moment) -> None:
        """Makes the steps: those within the latency with the action before."""
        memory, sim = now.memory, now.sim
        memory["step"] += 1
        pushed = memory["push_steps"] == memory["step"][:, None]
        if pushed.any():
            envs = pushed.any(axis=1)
            qvel = np.array(sim.qvel, dtype=np.float64)
            qvel[:, :2] += np.einsum("nk,nki->ni", pushed, memory["pushes"])
            sim.set_state(qvel=qvel, mask=envs, cold=False)
        memory["before"][:] = memory["last"]
        memory["last"][:] = now.action
        status = np.zeros(len(now.action), dtype=np.uint32)
        for k in range(self.frame_skip):
            waits = memory["latency"] > k
            sim.step(np.where(waits[:, None], memory["before"], now.action))
            status |= sim.status
        now.keep("status", status)
        air = memory["air"]
        stands = sim.site_xpos[:, _feet(), 2] < _FOOT + _CLEAR
        landed = stands & (air > 0.0)
        memory["stride"][:] = np.where(landed, np.minimum(air, _LONGEST) - _SHORTEST, 0.0).sum(axis=1)
        memory["air"][:] = np.where(stands, 0.0, air + now.dt)


WEIGHTS: Mapping[str, float] = {
    "linear": 1.0,
    "angular": 0.5,
    "bounce": 0.5,
    "roll": 0.02,
    "tilt": 2.0,
    "pose": 0.1,
    "torque": 1e-4,
    "change": 0.05,
    "stride": 3.0,
}
"""Weights of the terms of the reward."""


@per_moment
def _frame(now: Moment) -> Array:
    """Axes of the trunk in the world, columns: (num_envs, 3, 3)."""
    w, x, y, z = now.qpos[:, 3:7].T
    rows = [
        *(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        *(2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        *(2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    ]
    return np.stack(rows, axis=1).reshape(-1, 3, 3)


@per_moment
def _linear_velocity(now: Moment) -> Array:
    """Velocity of the trunk in its own frame, m/s: (num_envs, 3)."""
    local: Array = np.einsum("ni,nij->nj", now.qvel[:, :3], _frame(now))
    return local


def _vertical(now: Moment) -> Array:
    """The vertical in the frame of the trunk: (num_envs, 3)."""
    vertical: Array = _frame(now)[:, 2]
    return vertical


@per_moment
def _command(now: Moment) -> Array:
    """The command in force: (num_envs, 3), m/s and rad/s."""
    memory = now.memory
    length = -(-now.task.episode_steps // _COMMANDS)
    which = np.minimum(memory["step"] // length, _COMMANDS - 1)
    command: Array = memory["commands"][np.arange(len(which)), which]
    return command


@functools.cache
def _feet() -> list[int]:
    """Sites in the middle of the feet."""
    return [k for k, name in enumerate(_scene().site_names) if name in ("FR", "FL", "RR", "RL")]


@functools.cache
def _stance() -> Array:
    """Angles at the beginning, in the order of the legs in the file, rad: (12,)."""
    model = _scene()
    angles = []
    for name in model.joint_names[1:]:
        leg, kind, _ = name.split("_")
        angles.append(_STANCE[kind] * (-1.0 if kind == "hip" and leg.endswith("L") else 1.0))
    return np.array(angles)


@read_once
def _scene() -> Model:
    """The robot of mjlab on a plane: what it only looks like left out, servos and rotors added, as mjlab's own code says them."""
    file = Path(package_file("mjlab", _FILE, "for its Go1, whose file it has"))
    tree = ElementTree.fromstring(file.read_text("utf-8"))
    make = type(tree)
    for asset in tree.findall("asset"):
        tree.remove(asset)
    for parent in tree.iter():
        for child in list(parent):
            name = child.get("name", "")
            if child.tag in ("light", "camera") or child.get("class") == "visual":
                parent.remove(child)
            elif child.tag == "geom" and name:
                touches = name.endswith("foot_collision") or name in ("trunk_collision", "head_collision")
                # In group 0 renderers draw it: what the file has for them to draw is left out.
                child.attrib |= {"contype": str(int(touches)), "conaffinity": "0", "group": "0", "rgba": _GREY if touches else _LIGHT}
                if name.endswith("foot_collision"):
                    child.attrib |= {"priority": "1", "friction": "0.8 0.005 0.0005", "condim": "3"}
    tree.insert(0, make("option", timestep="0.005", integrator="implicitfast"))
    world = tree.find("worldbody")
    if world is None:
        raise ValueError(f"{file} has no worldbody: this version of mjlab is not known")
    world.insert(0, make("geom", name="floor", type="plane", size="0 0 0.05", contype="0", conaffinity="1", material="floor"))
    world.insert(0, make("light", directional="true", castshadow="false", pos="0 0 5", dir="0.3 0.2 -1"))
    looks = make("asset")
    looks.append(
        make("texture", name="squares", type="2d", builtin="checker", width="64", height="64", rgb1=".30 .35 .40", rgb2=".36 .41 .46")
    )
    looks.append(make("material", name="floor", texture="squares", texrepeat="2 2", texuniform="true"))
    tree.append(looks)
    actuators = make("actuator")
    tree.append(actuators)
    for joint in tree.iter("joint"):
        name = joint.get("name", "")
        leg, kind, _ = name.split("_")
        inertia = _ROTOR * _GEAR[kind] ** 2
        stiffness = inertia * _FREQUENCY**2
        stance = _STANCE[kind] * (-1.0 if kind == "hip" and leg.endswith("L") else 1.0)
        reach = _REACH * _TORQUE[kind] / stiffness
        joint.set("armature", repr(inertia))
        servo = {"kp": stiffness, "kv": 2.0 * _DAMPING_RATIO * inertia * _FREQUENCY}
        bounds = {"ctrlrange": (stance - reach, stance + reach), "forcerange": (-_TORQUE[kind], _TORQUE[kind])}
        attributes = {key: repr(float(value)) for key, value in servo.items()}
        attributes |= {key: f"{float(low)!r} {float(high)!r}" for key, (low, high) in bounds.items()}
        actuators.append(make("position", {"name": name, "joint": name, **attributes}))
    return load_quietly(tree)
