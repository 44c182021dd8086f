"""Task: a model, a table of observations, a reward, and a reset."""

from __future__ import annotations

import functools
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from stepper._hints import no_attribute
from stepper._other_names import RENAMED
from stepper._quantities import read
from stepper._stepper import Model, Stepper
from stepper.actuators import ActuatorModel
from stepper.envs.assets import load_quietly, model_file
from stepper.envs.streams import Rng, Streams
from stepper.sensors import SensorModel

Array = NDArray[Any]
Terms: TypeAlias = dict[str, Array]
"""Numbers by name, an array (num_envs, ...) each."""
Contact: TypeAlias = Literal["mujoco", "hard"]
"""Law of contact."""
Camera: TypeAlias = Mapping[str, Any]
"""Numbers of a free camera: distance (m), azimuth and elevation (degrees), lookat (3,) in m, trackbodyid; see `stepper.viewer.Renderer`."""


_OWN = ("sim", "task", "dt", "action", "default_qpos", "episode_state", "velocity", "_streams", "_kept", "_end", "_over")
"""Attributes of a moment that are not quantities of the stepper."""


class Moment:
    """View of the batch after a step or a reset, which observations, rewards and terminations of a task read.

    Every quantity of a `Stepper` (`now.qpos`, `now.xpos`, `now.sensordata`) is an attribute, an array (num_envs, ...). It is computed at
    its first use, which must precede the next step. `read(name, of)` and `contacts()` are those of `Stepper`.

    Attributes:
        sim: The stepper.
        task: The task.
        dt: Time between two observations, s.
        action: Actions of the step that led here, (num_envs, n); zero in environments that have just begun an episode. n is nu, except for
            a task with `action_bounds`.
        default_qpos: The model's reference configuration, (nq,), m and rad.
        episode_state: State of the episodes that the stepper does not have: arrays (num_envs, ...) by name; see `Task.episode_state`.
        velocity: Rate of change of `Task.position` over that step, per s; zero in environments that have just begun an episode, None for
            tasks without a position.
    """

    def __init__(self, sim: Stepper, task: Any, dt: float, action: Array, default_qpos: Array, *, episode_state: Terms, streams: Streams):
        self.sim, self.task, self.dt, self.action, self.default_qpos = sim, task, dt, action, default_qpos
        self.episode_state, self._streams = episode_state, streams
        self.velocity: Any = None
        self._kept: Terms = {}
        self._end: tuple[Array, Array] | None = None
        self._over = False

    def __getattr__(self, name: str) -> Any:
        # Python calls this only for attributes that do not exist yet.
        if name.startswith("_"):
            raise AttributeError(name)
        if name in RENAMED["Moment"]:
            raise no_attribute(Moment, name)
        if self._over:
            raise RuntimeError(f"{name} is a quantity of a past moment, which was not read then: read it before the next step or reset")
        value = self.task.healthy(self) if name == "healthy" else getattr(self.sim, name)
        if callable(value):
            return value  # A method reads the present state: whether the moment is over is checked at every use.
        if isinstance(value, np.ndarray):
            value = np.asarray(value)  # A plain array: `Stepper` gives subclasses, with which arithmetic is slower.
        self.__dict__[name] = value
        return value

    def read(self, name: str, of: str | int | Sequence[str | int] | None = None) -> Array:
        """Values of a quantity for all its elements, or for some by name or index, (num_envs, n, ...), in its unit; see `Stepper.read`."""
        return read(self, name, of)

    def rng(self, name: str) -> Rng:
        """Random numbers of all environments for this moment, for noise of an observation.

        They depend on the seed of an environment, on the steps and resets since, and on the name. Equal names give equal numbers, however
        often
        and in any order, so that reading an observation twice gives the same noise.

        Args:
            name: Name of the term, such as "height_scan".
        """
        return Rng(self._streams.fork(name), np.arange(len(self._streams.state)))

    def keep(self, name: str, value: Array) -> None:
        """Keeps the present value of a quantity, (num_envs, ...), in its unit, in place of the value at the end of the step."""
        self.__dict__[name] = self._kept[name] = value

    def end_step(self) -> None:
        """Notes the state at the end of the step, with which quantities of `keep` hold."""
        if self._kept:
            self._end = self.qpos, self.qvel

    def without_kept(self) -> Moment:
        """A moment of the same step without quantities of `keep`."""
        return self._same_step(self.action) if self._kept else self

    def _same_step(self, action: Array) -> Moment:
        shared: dict[str, Any] = {"episode_state": self.episode_state, "streams": self._streams}
        return Moment(self.sim, self.task, self.dt, action, self.default_qpos, **shared)

    def reread(self, changed: Array) -> Moment:
        """A new moment of the same step that reads all quantities again; this one is over.

        Args:
            changed: Environments that were reset or set, (num_envs,) bool: action and velocity are zero there. Quantities of `keep` stay
                in the others, unless their state is another one since.
        """
        made = self._same_step(cleared(self.action, changed))
        made.velocity = None if self.velocity is None else cleared(self.velocity, changed)
        if self._end is not None and not changed.all():
            moved = changed | np.any(self._end[0] != made.qpos, axis=1) | np.any(self._end[1] != made.qvel, axis=1)
            for name, value in self._kept.items():
                made.keep(name, select(moved, getattr(self.sim, name), value))
            made.end_step()
        self._over = True
        return made

    @property
    def kept(self) -> Terms:
        """Quantities of `keep` by name."""
        return self._kept

    def step_values(self) -> Terms:
        """Values of the step that led here by name: the action, and the velocity for tasks with a position."""
        return {name: value for name in ("action", "velocity") if (value := getattr(self, name)) is not None}

    def restored(self, step_values: Terms, kept: Terms, mask: Array) -> Moment:
        """A new moment after environments of a mask (num_envs,) took over another state.

        Args:
            step_values: `step_values` of the moment in that state.
            kept: Quantities of `keep` there.
            mask: Environments that took over the state, (num_envs,) bool.
        """
        made = self.reread(mask)
        for name, values in step_values.items():
            setattr(made, name, select(mask, values, getattr(made, name)))
        for name in {*kept, *made._kept}:
            present = getattr(made, name)
            made.keep(name, select(mask, kept.get(name, getattr(self.sim, name)), present))
        made.end_step()
        return made

    def finish(self) -> None:
        """Ends the moment: quantities that were not read cannot be read any more."""
        self._over = True

    def __getstate__(self) -> dict[str, Any]:
        # The stepper has the other quantities.
        return {name: self.__dict__[name] for name in _OWN} | self._kept


def select(mask: Array, one: Array, other: Array) -> Array:
    """Rows of `one` for the environments of a mask (num_envs,), of `other` for the rest."""
    return np.where(mask.reshape(-1, *[1] * (other.ndim - 1)), one, other)


def cleared(values: Array, mask: Array) -> Array:
    """A copy of values (num_envs, ...) with zero rows for the environments of a mask (num_envs,)."""
    made = np.array(values)
    made[mask] = 0
    return made


@dataclass(frozen=True)
class Observation:
    """Row of the table that makes an observation.

    Attributes:
        name: Name of the row. Without `func` it is a quantity of `Stepper`: "qpos", "qvel", "xpos".
        func: Function of a moment that computes the row, (num_envs, ...), in place of a quantity of `Stepper`.
        columns: Columns that are observed; None is all.
        clip: Bounds of the observed values; None is none.
        noise: Half width of uniform noise, which is added before `clip`. It follows from the seed of an environment, as `Moment.rng`.
        unit: Unit of a row with `func`, for tables of observations; empty for numbers without one.
    """

    name: str
    func: Callable[[Any], Array] | None = None
    columns: slice | None = None
    clip: tuple[float, float] | None = None
    noise: float = 0.0
    unit: str = ""

    def read(self, now: Moment) -> Array:
        """Values of a moment with noise before clipping, (num_envs, n), in the unit of the row."""
        value: Array = getattr(now, self.name) if self.func is None else self.func(now)
        flat = value.reshape(len(value), -1)
        flat = flat if self.columns is None else flat[:, self.columns]
        return flat + now.rng(self.name).uniform(-self.noise, self.noise, flat.shape[1]) if self.noise else flat


@dataclass(frozen=True)
class Reset:
    """The environments that begin an episode, for `Task.place`.

    Attributes:
        sim: The stepper. These environments still have the state in which their last episode ended.
        envs: Indices of the environments, (n,).
        qpos: Initial positions, (n, nq), m and rad: the model's reference, to be changed in place.
        qvel: Initial velocities, (n, nv), m/s and rad/s: zero, to be changed in place.
        episode_state: Arrays (num_envs, ...) of `Task.episode_state`, with the rows that the new episodes begin with. Change rows
            `episode_state[name][reset.envs]` alone.
        rng: Random numbers of these environments.
    """

    sim: Stepper
    envs: Array
    qpos: Array
    qvel: Array
    episode_state: Terms
    rng: Rng


class Task(ABC):
    """A task of many environments of one model.

    Write a task as a frozen dataclass, whose fields are arguments of `gymnasium.make`. All methods work on whole batches: the leading axis
    of
    arrays is that of the environments.
    """

    contact: ClassVar[Contact] = "hard"
    """Law of contact unless an environment is made with another."""
    camera: ClassVar[Camera] = {}
    """From where pictures are taken, unless the model's file has a camera "track" or an environment is made with another."""
    lamp: ClassVar[bool] = True
    """Whether pictures of a scene without a light get one: False in Gymnasium's tasks, whose pictures are Gymnasium's."""
    carried: ClassVar[tuple[str, ...]] = ()
    """Names of `episode_state` whose values go on in the next episode, as the level of a curriculum; a reset with a seed restores them."""
    frame_skip: int
    """Number of steps per action."""

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        for old, new in RENAMED["Task"].items():
            if callable(vars(cls).get(old)):
                raise TypeError(f"{cls.__name__} defines the method {old}, which is now called {new}: rename it")

    @abstractmethod
    def model(self) -> Model:
        """Model of the scene."""

    def sensors(self) -> SensorModel | None:
        """Sensor models, for tasks that observe `now.sensordata`. None: ideal sensors.

        Their random numbers depend on the seed of an environment and on its index in the batch.
        """
        return None

    def actuators(self) -> ActuatorModel | None:
        """Actuator model between controls and forces: motors with curves, lags, delays; None is ideal actuators."""
        return None

    def action_bounds(self, model: Model) -> tuple[Array, Array]:
        """Lower and upper bounds of the actions, (n,) each, in the units of the task: by default ranges of the model's controls.

        A task with other actions, such as motions of a hand, converts them to controls in `advance`.
        """
        low, high = model.actuator_ctrlrange.T
        return low, high

    @abstractmethod
    def observations(self) -> tuple[Observation, ...]:
        """Table of the observation, row by row."""

    @abstractmethod
    def reward(self, now: Moment) -> tuple[Array, Terms]:
        """Rewards of the step that led to a moment, (num_envs,), and additional entries of its info, such as terms of the reward."""

    def sample_state(self, qpos: Array, qvel: Array, rng: Rng) -> None:  # noqa: B027
        """Samples initial states of n episodes.

        Args:
            qpos: Positions, (n, nq), m and rad: the model's reference, to be changed in place.
            qvel: Velocities, (n, nv), m/s and rad/s: zero, to be changed in place.
            rng: Random numbers of these environments.
        """

    def place(self, reset: Reset) -> None:
        """Sets initial states that depend on `episode_state` or on the simulation, for example on the level of a terrain.

        The default calls `sample_state`. An override may call it too, and then move the sampled states.
        """
        self.sample_state(reset.qpos, reset.qvel, reset.rng)

    def episode_state(self, num_envs: int) -> Terms:
        """Initial values of `episode_state`, for data that the stepper does not have, such as commands and previous actions.

        Returns:
            Arrays (num_envs, ...) by name, which `now.episode_state` has; `place`, `on_reset`, `advance` and `on_end` write to them. Each
            episode begins with the rows that are returned here, but for names in `carried`.
        """
        return {}

    def on_reset(self, sim: Stepper, episode_state: Terms, mask: Array, rng: Rng) -> None:  # noqa: B027
        """Hook after the initial states are set: commands, parameters (`sim.randomize`), or steps until the robot rests.

        Args:
            sim: The stepper.
            episode_state: Arrays of `episode_state`. Change only rows of the mask, there and in the stepper.
            mask: Environments that begin, (num_envs,) bool.
            rng: Random numbers of these environments.
        """

    def on_end(self, now: Moment, envs: Array) -> None:  # noqa: B027
        """Hook before environments that made a step begin another episode, also where `reset` ends one early.

        A curriculum reads here how far an episode came, and changes its level in `now.episode_state`, under a name in `carried`.

        Args:
            now: The moment at the end of these episodes.
            envs: Indices of the environments, (n,).
        """

    def healthy(self, now: Moment) -> Array | None:
        """Whether the episode of each environment may continue, (num_envs,) bool; None is all. A moment has it as `now.healthy`."""
        return None

    def terminated(self, now: Moment) -> Array | None:
        """Whether the episode of each environment is over, (num_envs,) bool; None is none. The default is not healthy."""
        return None if now.healthy is None else ~now.healthy

    def truncated(self, now: Moment) -> Array | None:
        """Whether each episode is truncated without failure, for example outside a terrain, (num_envs,) bool; None is none."""
        return None

    def position(self, now: Moment) -> Array | None:
        """Quantity whose rate of change is `now.velocity`, (num_envs, ...); None without one.

        It is read from the states before and after the steps of an action, regardless of `now.keep`.
        """
        return None

    def info(self, now: Moment) -> Terms:
        """Extra fields of the info dict after a reset and after a step."""
        return {}

    def advance(self, now: Moment) -> None:
        """Makes the steps of `now.action`; `now.keep` holds quantities from within them."""
        now.sim.step(now.action, self.frame_skip)


class MujocoTask(Task):
    """Task of Gymnasium's MuJoCo environments, version 5.

    Subclasses have the field `xml_file`: a file of Gymnasium, or a path that begins with "/", "." or "~".
    """

    contact = "mujoco"
    lamp = False
    strict: ClassVar[bool] = True
    """Whether the model may leave nothing out."""
    xml_file: str

    def model(self) -> Model:
        """The scene of `xml_file`."""
        return load_quietly(model_file(self.xml_file), strict=self.strict)


def per_moment(function: Callable[[Moment], Array]) -> Callable[[Moment], Array]:
    """Decorator that caches a function of a moment, `function(now)`, for that moment."""

    @functools.wraps(function)
    def quantity(now: Moment) -> Array:
        name = f"of {function.__qualname__}"
        if name not in now.__dict__:
            now.__dict__[name] = function(now)
        value: Array = now.__dict__[name]
        return value

    return quantity


def within(value: Array, bounds: tuple[float, float]) -> Array:
    """Whether numbers, (...), lie strictly between two bounds."""
    low, high = bounds
    inside: Array = (low < value) & (value < high)
    return inside


def all_within(value: Array, bounds: tuple[float, float]) -> Array:
    """Whether all numbers of each environment, (num_envs, n), lie strictly between two bounds, (num_envs,)."""
    low, high = bounds
    if low < value.min() and value.max() < high:  # What is nearly always so, and quickly seen.
        return np.ones(len(value), dtype=bool)
    inside: Array = np.logical_and.reduce(within(value, bounds), axis=1)
    return inside


def square_sum(value: Array) -> Array:
    """Sums of the squares of each environment's numbers: (num_envs,)."""
    flat = value.reshape(len(value), -1)
    sums: Array = np.einsum("ij,ij->i", flat, flat)
    return sums
