"""Base class of tasks, and the view of the batch (`TaskView`) from which tasks compute observations and rewards."""

from __future__ import annotations

import inspect
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from operator import attrgetter
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from stepper._hints import no_attribute, raise_error_of_property
from stepper._stepper import Model, Stepper
from stepper.actuators import ActuatorModel
from stepper.envs.actions import Servo, actions_of
from stepper.envs.assets import cache_per_model, load_quietly, model_file
from stepper.envs.events import Event
from stepper.envs.observations import Group, Observation
from stepper.envs.rewards import Reward
from stepper.sensors import SensorModel
from stepper.shared.streams import Rng
from stepper.shared.view import BatchView

Array = NDArray[Any]
Terms: TypeAlias = dict[str, Array]
"""Arrays (num_envs, ...) by name, such as terms of a reward or entries of an info dict."""
Contact: TypeAlias = Literal["mujoco", "hard"]
"""Contact law: MuJoCo's soft contact, or hard contact."""
Camera: TypeAlias = Mapping[str, Any]
"""Settings of a free camera: distance (m), azimuth, elevation (degrees), lookat (3,) in m, trackbodyid; see `stepper.viewer.Renderer`."""


_OWN = (
    *("sim", "model", "num_envs", "task", "dt", "action", "previous_action", "reward_terms", "default_qpos", "episode_state", "velocity"),
    *("_terms", "_streams", "_flags", "_expired", "_revision_of"),
)
"""Names of the attributes of a `TaskView` that are pickled. Other attributes are quantities, which can be read from the stepper again."""


def revision_of(model: Model) -> Callable[[Stepper], Array]:
    """Function that reads an array of a stepper. After each change of state, parameters, controls or applied forces it is another object.

    Of all such arrays it is the cheapest: `closed_eq_data`, empty, for a model without equalities, otherwise `actuator_force`.
    """
    return attrgetter("actuator_force" if len(model.eq_active0) else "closed_eq_data")


class TaskView(BatchView):
    """View of the batch after a step or a reset, from which a task computes observations, rewards and terminations.

    Every quantity of a `Stepper` (`now.qpos`, `now.xpos`, `now.sensordata`) is an attribute, an array (num_envs, ...). The value is that of
    the stepper's present state. The view stores it until the stepper changes: in `Task.advance`, a read after `now.sim.step(...)` gives the
    new value. The next action or reset ends the view. Then quantities that were read keep their values, and others raise RuntimeError.
    `read(name, of)` and `contacts()` work as in `Stepper`.

    Attributes:
        sim: The stepper.
        model: Model of the scene.
        num_envs: Number of environments.
        task: The task.
        dt: Time between two observations, s.
        action: Actions of the last step, (num_envs, n); zero in environments that were just reset. n is nu, unless the task defines
            `action_bounds` or `actions`.
        previous_action: Actions of the step before the last one, in the format of `action`.
        reward_terms: Weighted terms of the last step (`Task.rewards`), (num_envs,) by name, when `Task.reward` is called.
        default_qpos: Reference configuration, (nq,), m and rad: that of the keyframe `Task.keyframe`, or `qpos0` of the model.
        episode_state: Arrays (num_envs, ...) by name with data of the episodes that the stepper does not store; see `Task.episode_state`.
        velocity: Mean rate of change of `Task.position` over the last action, in the unit of the position per s. It is zero in
            environments that were just reset, and None for tasks without a position.
    """

    _flags: Array | None = None
    _expired = False
    _revision: Array | None = None

    def __init__(self, parts: Sequence[Any], action: Array, previous_action: Array):
        self.sim, self.task, self.dt, self.model, self.num_envs, self._revision_of = parts[:6]
        self.default_qpos, self.episode_state, self._terms, self._streams = parts[6:]
        self.action, self.previous_action = action, previous_action
        self.velocity: Any = None
        self.reward_terms: Terms = {}
        self._values: dict[str, Any] = {}

    def forget(self) -> None:
        """Drops the stored values, so that quantities are read again."""
        self._revision, self._values = None, {}

    def stored(self) -> dict[str, Any]:
        """Returns stored values by name: of the stepper's present state, or of the last state that an ended view has read."""
        if self._revision is not (present := self._revision_of(self.sim)) and not self._expired:
            self._revision, self._values = present, {}
        return self._values

    def __getattr__(self, name: str) -> Any:
        # Python calls this only for attributes that do not exist; quantities are properties (`_quantity`).
        raise_error_of_property(self, name)
        if name.startswith("_"):
            raise AttributeError(name)
        values = self.stored()
        if name in values:
            return values[name]
        self._check_present(name)
        try:
            return getattr(self.sim, name)
        except AttributeError:
            if hasattr(type(self.sim), name):
                raise
            raise no_attribute(TaskView, name, {*dir(Stepper), *_OWN}) from None

    def _check_present(self, name: str) -> None:
        """Raises RuntimeError if this view has ended, so that the quantity `name` can no longer be read."""
        if self._expired:
            raise RuntimeError(f"{name} is a quantity of a past moment, which was not read then: read it before the next step or reset")

    if not TYPE_CHECKING:

        def __getitem__(self, name: Any) -> Any:
            raise TypeError(
                f"now[{name!r}] is not defined: quantities are attributes, as now.qpos, and now.read(name, of) selects elements"
            )

    @property
    def steps(self) -> Array:
        """Number of actions and resets of each environment since it was seeded, (num_envs,) uint64, for curricula."""
        ages: Array = self._streams.ages
        return ages

    def command(self, name: str | None = None) -> Array:
        """Returns the present commands of a `Command` of the task, (num_envs, n), in its unit.

        Args:
            name: Name of the command in `Task.commands`. None selects the only one.

        Raises:
            KeyError: The task has no such command.
        """
        commands = self._terms.commands
        if name is None and len(commands) == 1:
            name = next(iter(commands))
        if name not in commands:
            raise KeyError(f"{type(self.task).__name__}.commands has no {name!r}, it has {', '.join(commands) or 'none'}")
        values, key = self.stored(), f"command {name}"
        if key not in values:
            values[key] = commands[name].value(self, self._terms.drawn[name])
        value: Array = values[key]
        return value

    def parameter(self, selector: str) -> Array:
        """Returns the present values of parameters, (num_envs, n), in their unit, by a selector such as "geom_friction[*_foot][0]".

        Raises:
            ValueError: An unknown field or element.
        """
        values, key = self.stored(), f"parameter {selector}"
        if key not in values:
            values[key] = self._terms.events.parameter(self.sim, selector)
        value: Array = values[key]
        return value

    def step(self, action: Array | None = None, nstep: int | None = None) -> None:
        """Steps the simulation by the actions of this step, converted to controls by `Task.actions`. For `Task.advance`.

        Args:
            action: Actions in place of `action`, (num_envs, n).
            nstep: Number of time steps; None selects `Task.frame_skip`.
        """
        action = self.action if action is None else action
        self._terms.step(self, action, self.previous_action, self.task.frame_skip if nstep is None else nstep)

    def _step(self, ctrl: Array, nstep: int = 1) -> None:
        """Makes time steps with controls, (num_envs, nu), and adds their flags to `status`."""
        self.sim.step(ctrl, nstep)
        self._flags = self.sim.status if self._flags is None else self._flags | self.sim.status

    @property
    def status(self) -> Array:
        """Flags of `Stepper.status`, (num_envs,) uint32, of all time steps of the last action."""
        self._check_present("status")
        flags: Array = self.sim.status if self._flags is None else self._flags | self.sim.status
        return flags

    def _expire(self) -> None:
        """Ends this view of the batch: quantities that were not read before raise RuntimeError from now on."""
        self._expired = True

    def __getstate__(self) -> dict[str, Any]:
        # Other quantities can be read from the stepper again.
        return {name: getattr(self, name) for name in _OWN} | {"_revision": None, "_values": {}}


def _quantity(name: str) -> property:
    """Property of `TaskView` with a quantity of its stepper, which is stored until the stepper changes."""

    def quantity(now: TaskView) -> Any:
        values = now.stored()
        if name in values:
            return values[name]
        now._check_present(name)
        value = getattr(now.sim, name)
        if isinstance(value, np.ndarray):
            value = np.asarray(value)  # A plain array: `Stepper` returns a subclass of ndarray, with which arithmetic is slower.
        values[name] = value
        return value

    return property(quantity, doc=getattr(Stepper, name).__doc__)


for _name in dir(Stepper):
    if inspect.isdatadescriptor(getattr(Stepper, _name)) and not hasattr(TaskView, _name) and _name not in _OWN:
        setattr(TaskView, _name, _quantity(_name))


def with_zero_rows(values: Array, envs: Array) -> Array:
    """A copy of values (num_envs, ...) with zero rows for some environments, a mask (num_envs,) or indices (n,)."""
    made = np.array(values)
    made[envs] = 0
    return made


class Reset:
    """Environments that start a new episode, or have an event: the argument of `Task.reset` and of functions of events.

    All arrays have one row for each of the n environments, and so have the draws of `rng`. Write to the arrays, or assign to them:
    `reset.qpos[:, 2] += 0.1` and `reset.qpos = poses` both set initial positions. In an event within an episode, the arrays have the
    present values, and `episode_state` is empty.

    Attributes:
        sim: The stepper. These environments still have the state in which their last episode ended. `sim.randomize(..., envs=reset.envs)`
            sets parameters.
        envs: Indices of the environments, (n,).
        qpos: Initial positions, (n, nq), m and rad: those of the keyframe `Task.keyframe`, or `qpos0` of the model.
        qvel: Initial velocities, (n, nv), m/s and rad/s: zero.
        act: Initial activations, (n, na): zero.
        mocap_pos: Initial positions of the mocap bodies, (n, nmocap, 3), m: those of the model.
        mocap_quat: Initial orientations of the mocap bodies, (n, nmocap, 4): those of the model.
        episode_state: Arrays (n, ...) by name: the rows of `Task.episode_state` with the initial values of the new episodes.
        rng: Random number generator of these environments: `rng.uniform(low, high, size)` returns an array (n, size).
    """

    sim: Stepper
    envs: Array
    qpos: Array
    qvel: Array
    act: Array
    mocap_pos: Array
    mocap_quat: Array
    episode_state: Terms
    rng: Rng
    _default_qpos: Array
    _present: bool

    def __init__(
        self, sim: Stepper, envs: Array, episode_state: Terms, rng: Rng, *, default_qpos: Array | None = None, present: bool = False
    ):
        default_qpos = np.asarray(sim.model.qpos0) if default_qpos is None else default_qpos
        vars(self).update(sim=sim, envs=envs, episode_state=episode_state, rng=rng, _default_qpos=default_qpos, _present=present)

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            if name not in _INITIAL:
                raise no_attribute(Reset, name, [name for name in inspect.get_annotations(Reset) if name[0] != "_"])
            # Arrays are created at the first read, because few tasks use all of them.
            if self._present:
                vars(self)[name] = np.array(getattr(self.sim, name)[self.envs], dtype=np.float64)
            else:
                initial = self._default_qpos if name == "qpos" else _INITIAL[name](self.sim.model)
                vars(self)[name] = np.empty((len(self.envs), *initial.shape))
                vars(self)[name][:] = initial
            return vars(self)[name]

    def __setattr__(self, name: str, value: Any) -> None:
        array = getattr(self, name)
        if not isinstance(array, np.ndarray):
            raise AttributeError(f"{name} of a reset cannot be assigned: write to its arrays, or call its methods")
        if value is not array:  # As in `reset.qpos += 0.1`.
            array[...] = value

    def apply(self, seeds: Array | None, is_new: Array) -> None:
        """Starts the episodes in the stepper.

        Args:
            seeds: Seeds of the sensor errors, (n,) uint64; None for a stepper without sensor errors.
            is_new: Environments whose sensor errors get their seed, (n,) bool. Those of the others go on.
        """
        self.sim.reset(self.envs, qpos=self.qpos, qvel=self.qvel)
        if seeds is not None and is_new.any():
            self.sim.reset(self.envs[is_new], qpos=self.qpos[is_new], qvel=self.qvel[is_new], seed=seeds[is_new])
        self.apply_state(("act", "mocap_pos", "mocap_quat"))

    def apply_state(self, names: Sequence[str] = ("qpos", "qvel", "act", "mocap_pos", "mocap_quat")) -> None:
        """Writes those of the arrays `names` that were read or set to the stepper."""
        made = vars(self)
        if state := {name: made[name] for name in names if name in made and name[:5] != "mocap"}:
            self.sim.set_state(**state, envs=self.envs, keep_warmstart=self._present)
        for name in names:
            if name in made and name[:5] == "mocap":
                getattr(self.sim, name)[self.envs] = made[name]

    def call(self, function: Callable[[Reset], None], rows: Array) -> None:
        """Calls a function for some of these environments, given by a mask (n,)."""
        if rows.all():
            function(self)
        elif rows.any():
            state = {name: values[rows] for name, values in self.episode_state.items()}
            some = Reset(self.sim, self.envs[rows], state, self.rng.of(rows), default_qpos=self._default_qpos, present=self._present)
            for name in _INITIAL.keys() & vars(self).keys():
                vars(some)[name] = vars(self)[name][rows]
            function(some)
            for name in _INITIAL.keys() & vars(some).keys():
                getattr(self, name)[rows] = vars(some)[name]
            for name, values in state.items():
                self.episode_state[name][rows] = values


@cache_per_model
def _mocap_bodies(model: Model) -> list[Any]:
    """Mocap bodies of a model, in the order of their poses."""
    return sorted((body for body in map(model.body, range(model.nbody)) if body.mocapid >= 0), key=lambda body: body.mocapid)


_INITIAL: dict[str, Callable[[Model], Array]] = {
    "qpos": lambda model: np.asarray(model.qpos0),
    "qvel": lambda model: np.zeros(model.nv),
    "act": lambda model: np.zeros(model.na),
    "mocap_pos": lambda model: np.array([body.pos for body in _mocap_bodies(model)]).reshape(-1, 3),
    "mocap_quat": lambda model: np.array([body.quat for body in _mocap_bodies(model)]).reshape(-1, 4),
}
"""Functions of the model that return the initial values of the arrays of a `Reset`, by name."""


class Task(ABC):
    """Task of a reinforcement-learning environment: scene, observations, reward and resets. Abstract.

    Write a task as a frozen dataclass, whose fields are arguments of `gymnasium.make`. All methods work on whole batches: the leading axis
    of arrays is that of the environments.
    """

    contact: ClassVar[Contact] = "hard"
    """Default contact law of environments of this task."""
    camera: ClassVar[Camera] = {}
    """Settings of the camera for pictures. A camera "track" in the model's file, or camera arguments of the environment, replace them."""
    lamp: ClassVar[bool] = True
    """Whether pictures of a scene without a light get an added light. False in Gymnasium's tasks, to reproduce Gymnasium's pictures."""
    carried: ClassVar[tuple[str, ...]] = ()
    """Names in `episode_state` whose values persist into the next episode, such as the level of a curriculum, until a reset with a seed."""
    keyframe: ClassVar[str | None] = None
    """Name of the keyframe with the reference configuration, in which episodes begin; None selects `qpos0` of the model."""
    episode_seconds: float | None = None
    """Time after which an episode is truncated, s, if the environment has no `max_episode_steps`; None means no limit."""
    frame_skip: int
    """Number of time steps per action."""

    @property
    def actions(self) -> Servo | tuple[Servo, ...] | None:
        """Conversion of actions to controls by a `Servo`, or several. None means that actions are controls."""
        return None

    @property
    def commands(self) -> Mapping[str, Any]:
        """Commands by name, of `stepper.envs.commands`; `now.command(name)` has their values."""
        return {}

    @abstractmethod
    def model(self) -> Model:
        """Returns the model of the scene."""

    def sensors(self) -> SensorModel | None:
        """Returns the sensor model (noise, delay, bias), for tasks that observe `now.sensordata`; None means ideal sensors.

        The random numbers depend on the seed of an environment, and on the environment's index in the batch.
        """
        return None

    def actuators(self) -> ActuatorModel | None:
        """Returns the actuator model between controls and forces: motors with curves, lags, delays; None means ideal actuators."""
        return None

    def action_bounds(self, model: Model) -> tuple[Array, Array]:
        """Returns lower and upper bounds of the actions, (n,) each, in the units of the task.

        The default is the bounds of `actions`, or the control ranges. A task with other actions, such as motions of a hand, converts them
        to controls in `advance`.

        Raises:
            ValueError: An actuator has no control range, and the task has no `actions`.
        """
        if (servos := actions_of(self, model)) is not None:
            return -servos.bounds, servos.bounds
        low, high = model.actuator_ctrlrange.T
        for k, ends in enumerate(zip(low, high, strict=True)):
            if not np.isfinite(ends).all():
                name = model.actuator_names[k] or k
                remedy = 'write actions = Servo("*", scale=..., bound=1.0) in the class, or define action_bounds(self, model)'
                raise ValueError(
                    f"actuator {name!r} has no ctrlrange, so the actions of {type(self).__name__} have no bounds, to which learners scale: "
                    f"give ctrlrange in the file, {remedy}"
                )
        return low, high

    @abstractmethod
    def observations(self) -> tuple[Observation, ...] | Mapping[str, tuple[Observation, ...] | Group]:
        """Returns the table of the observed quantities. The observation of an environment concatenates the rows of this table.

        A dictionary has several tables, which are observation groups: "policy" for the policy, and usually "critic" for the critic.
        Environments return the group "policy", or with `groups=True` a dictionary of all groups.
        """

    def rewards(self) -> Mapping[str, Reward]:
        """Returns the terms of the reward by name, for tasks without a method `reward`.

        The info dict has each weighted term of a step as "reward_NAME", and its sum over the episode as "return_NAME". The argument
        `rewards` of an environment replaces weights.
        """
        return {}

    def reward(self, now: TaskView) -> Array | tuple[Array, Terms]:
        """Returns the rewards of the last step, (num_envs,), or a pair of them and further entries for the info dict.

        The default is the sum of the weighted terms of `rewards`.

        Args:
            now: View of the batch after the step. `now.reward_terms` has the weighted terms of `rewards`.
        """
        # A loop, because np.sum would add the terms in another order for a single environment, with other rounding.
        return sum(now.reward_terms.values(), np.zeros(len(now.action)))

    def events(self) -> tuple[Event, ...]:
        """Returns random events: parameters that are drawn at the start, at resets or at intervals, and pushes."""
        return ()

    def reset(self, reset: Reset) -> None:  # noqa: B027
        """Sets the beginning of new episodes: initial states, commands and other values of `episode_state`, parameters.

        Args:
            reset: Environments that start an episode, with arrays of one row for each of them. Initial states are written to
                `reset.qpos` and `reset.qvel`, values of the episode to `reset.episode_state`.
        """

    def episode_state(self, num_envs: int) -> Terms:
        """Returns the initial values of data of the episodes that the stepper does not store, such as commands and previous actions.

        Returns:
            Arrays (num_envs, ...) by name, the initial `now.episode_state`. `reset`, `advance` and `on_end` write to them. Each episode
            starts with the rows returned here, except for names in `carried`.
        """
        return {}

    def on_end(self, now: TaskView, envs: Array) -> None:  # noqa: B027
        """Hook that is called before environments start their next episode, even if `reset` ends the current episode early.

        The hook is not called for episodes without an action. A curriculum measures the progress of the episode here, and changes the level
        of the environment in `now.episode_state`, under a name in `carried`.

        Args:
            now: View of the batch at the end of these episodes.
            envs: Indices of the environments, (n,).
        """

    def terminated(self, now: TaskView) -> Array | None:
        """Whether each episode ends with a failure, (num_envs,) bool. None means that no episode fails."""
        return None

    def truncated(self, now: TaskView) -> Array | None:
        """Whether the task truncates each episode, (num_envs,) bool, for example because the robot left the terrain without a failure.

        None means that the task truncates no episode. The limit `max_episode_steps` of an environment truncates independently.
        """
        return None

    def position(self, now: TaskView) -> Array | None:
        """Returns the quantity, (num_envs, ...), whose rate of change over the last action is `now.velocity`; None for no velocity.

        The quantity is evaluated in the states before and after the action.
        """
        return None

    def info(self, now: TaskView) -> Terms:
        """Returns extra fields of the info dict after a reset and after a step."""
        return {}

    def advance(self, now: TaskView) -> None:
        """Steps the simulation by one action: `now.step()`. An override can store quantities between time steps in `now.episode_state`."""
        now.step()


class MujocoTask(Task):
    """Task of Gymnasium's MuJoCo environments, version 5.

    Subclasses define the field `xml_file`: a file of Gymnasium, or a path that begins with "/", "." or "~".
    """

    contact = "mujoco"
    lamp = False
    xml_file: str

    def model(self) -> Model:
        """Returns the model of the scene, loaded from the file `xml_file`.

        Raises:
            TypeError: The class has no `xml_file`.
        """
        if not hasattr(self, "xml_file"):
            raise TypeError(f'{type(self).__name__} has no xml_file, the file of its model: add the field `xml_file: str = "hopper.xml"`')
        return load_quietly(model_file(self.xml_file))


def within(value: Array, bounds: tuple[float, float]) -> Array:
    """Whether each number of an array lies strictly between two bounds: a bool array of the same shape."""
    low, high = bounds
    inside: Array = (low < value) & (value < high)
    return inside


def all_within(value: Array, bounds: tuple[float, float]) -> Array:
    """Whether all numbers of each environment lie strictly between two bounds: (num_envs,) bool for values (num_envs, n)."""
    low, high = bounds
    if low < value.min() and value.max() < high:  # A fast test that nearly always succeeds.
        return np.ones(len(value), dtype=bool)
    inside: Array = np.logical_and.reduce(within(value, bounds), axis=1)
    return inside


def square_sum(value: Array) -> Array:
    """Returns the sum of the squares of all numbers of each environment, (num_envs,), for an array (num_envs, ...)."""
    flat = value if value.ndim == 2 else value.reshape(len(value), -1)
    sums: Array = np.einsum("ij,ij->i", flat, flat)
    return sums
