"""Batches of a study's episodes, which are stepped together, and whose results (rows) are stored in the journal.

An episode belongs to a point: values of the parameters, and the name of the settings for which they are used. All points of a batch have
the same settings. Batches depend only on the points, not on the rows in the journal. After an interruption, an unfinished batch is repeated
as a whole, and only its missing rows are stored.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from stepper._hints import did_you_mean
from stepper._options import Options, Precision
from stepper.lab.study import controllers
from stepper.lab.study.journal import Journal, Row
from stepper.lab.study.outcomes import Watch
from stepper.lab.study.parameters import Parameter, Value, Values, actuator_model, model_fields, sensor_model
from stepper.lab.study.worlds import MUJOCO_SETTINGS, ParameterValues, Plan, World, make_world, own_fields, stacked
from stepper.shared.fields import RANDOMIZED

if TYPE_CHECKING:
    from stepper.lab.study.study import Study

Array = NDArray[np.float64]

USUAL = "stepper"
"""Name of the settings that are the options of the study itself."""
_LACKING = {"midpoint", "auto"}
"""Values of the options `integrator` and `solver` that MuJoCo does not have."""


@dataclass(frozen=True)
class Point:
    """Point of a study: values of its parameters, and settings.

    Attributes:
        values: Values of parameters by name; absent parameters keep the model's numbers.
        setting: Name of the settings.
    """

    values: Values
    setting: str = USUAL


def inapplicable(study: Study, setting: str, parameter: Parameter) -> str | None:
    """Reason why a parameter has no effect with the settings of this name; None if it has an effect."""
    given = study.setting(setting)
    if parameter.kind == "options" and parameter.leaf in given:
        return f"these settings fix {parameter.leaf}"
    if given.get("engine") == "mujoco":
        return _lacking(parameter)
    if parameter.parsed.field == "geom_restitution" and given.get("contact", study.options.contact) == "mujoco":
        return "MuJoCo's law of contact has no restitution"
    return None


def _lacking(parameter: Parameter) -> str | None:
    """Reason why the engine MuJoCo cannot apply a parameter; None if it can."""
    if parameter.kind in ("sensor", "actuator"):
        return "MuJoCo has no sensor errors and no drives"
    if parameter.kind == "options" and parameter.leaf not in MUJOCO_SETTINGS:
        return f"MuJoCo has no {parameter.leaf}"
    if parameter.kind == "options" and (words := _LACKING & {*parameter.levels(), parameter.nominal}):
        return f"MuJoCo has no {parameter.leaf} {', '.join(sorted(map(str, words)))}"
    if parameter.parsed.field in ("geom_restitution", "geom_concave", "eq_stiffness", "eq_damping"):
        return f"MuJoCo has no {parameter.parsed.field}"
    return None


def nominal_of(study: Study, setting: str) -> dict[str, Value]:
    """Nominal values by name of the parameters that have an effect with the settings of this name."""
    return {name: value for name, value in study.nominal.items() if not inapplicable(study, setting, study.parameters[name])}


def point_at(study: Study, values: Mapping[str, Value], setting: str = USUAL) -> Point:
    """Point with given values of parameters by name; the others are nominal."""
    chosen = nominal_of(study, setting)
    for name, value in values.items():
        if name not in study.parameters:
            known = ", ".join(study.parameters) or "none"
            raise ValueError(f"{study.name} has no parameter {name!r}{did_you_mean(name, study.parameters) or ','} there are: {known}")
        if reason := inapplicable(study, setting, study.parameters[name]):
            raise ValueError(f"parameter {name!r} has no effect with the settings {setting!r}: {reason}; leave it out")
        study.parameters[name].check_value(value, f"parameter {name!r}")
        chosen[name] = value
    return Point(chosen, setting)


@dataclass(frozen=True)
class _Batch:
    """Episodes that are stepped together: point and number of each episode, and the name of their common settings."""

    setting: str
    episodes: tuple[tuple[Point, int], ...]


def run_points(study: Study, points: Sequence[Point], journal: Journal, progress: Callable[[float], None] | None = None) -> list[Row]:
    """Results of all episodes at some points. Episodes whose results are already in the journal are not run again.

    Returns:
        Rows of all episodes: those of the first point, then those of the second, and so on.

    Raises:
        ValueError: A time step does not divide the control period, or a value of a parameter is invalid for the model.
    """
    keys = {(_name(point), e): study.key(point.values, point.setting, e) for point in points for e in range(study.episodes)}
    batches = list(_batches(study, points))
    missing = {
        k: [key for point, e in batch.episodes if (key := keys[_name(point), e]) not in journal.rows] for k, batch in enumerate(batches)
    }
    left = [k for k, own in missing.items() if own]
    if progress and not left:
        progress(1.0)
    for done, k in enumerate(left):
        batch = batches[k]
        made = run_episodes(study, batch.setting, [point.values for point, _ in batch.episodes], [e for _, e in batch.episodes])
        rows = {keys[_name(point), e]: row for (point, e), row in zip(batch.episodes, made, strict=True)}
        journal.append({"key": key} | rows[key] for key in dict.fromkeys(missing[k]))
        if progress:
            progress((len(batches) - len(left) + done + 1) / len(batches))
    # Keys do not contain the names of settings and parameters, which may have changed since a row was written.
    return [
        journal.rows[keys[_name(point), e]] | {"setting": point.setting, "parameters": dict(point.values)}
        for point in points
        for e in range(study.episodes)
    ]


def _name(point: Point) -> str:
    """Text that identifies a point: its settings and parameter values."""
    return json.dumps([point.setting, sorted(point.values.items())])


def _batches(study: Study, points: Sequence[Point]) -> Iterator[_Batch]:
    """Yields batches for all episodes at some points; each batch has episodes that can be stepped together."""
    groups: dict[str, list[Point]] = {}
    noisy = together(study)
    for point in {_name(point): point for point in points}.values():
        # Sensor errors depend on the index in the batch. Every point is then one batch, so that an episode has the same errors at every
        # point, and episodes differ in their errors.
        key = _name(point) if noisy else group_of(study, point)
        groups.setdefault(key, []).append(point)
    for group in groups.values():
        episodes = [(point, e) for point in group for e in range(study.episodes)]
        size = len(episodes) if noisy else study.batch
        for first in range(0, len(episodes), size):
            yield _Batch(group[0].setting, tuple(episodes[first : first + size]))


def together(study: Study) -> bool:
    """Whether all episodes with the same parameter values must be one batch, because sensor errors depend on the index in the batch."""
    return study.sensors is not None or any(p.kind == "sensor" for p in study.parameters.values())


def group_of(study: Study, point: Point) -> str:
    """Text that is equal for two points of a study if their episodes can be stepped in one batch."""
    shared = {name: value for name, value in point.values.items() if study.parameters[name].kind == "options"}
    fields = model_fields(study.parameters, study.loaded[0], [point.values])
    engine, _, options, _ = options_of(study, point.setting, point.values)
    own = own_fields(options) if engine == "stepper" else frozenset(RANDOMIZED)
    digests = {field: hashlib.sha256(rows.tobytes()).hexdigest() for field, rows in fields.items() if field not in own}
    return json.dumps([point.setting, sorted(shared.items()), sorted(digests.items())])


def options_of(study: Study, setting: str, values: Values, **changed: Any) -> tuple[str, Precision, Options, dict[str, Any]]:
    """Engine, precision and options of the step, and a dictionary of the options that differ from those of the study.

    Args:
        study: The study.
        setting: Name of the settings. Options in these settings take precedence over parameters that set the same option.
        values: Values of the parameters in one environment.
        **changed: Further changed settings.
    """
    given: dict[str, Any] = {study.parameters[n].leaf: v for n, v in values.items() if study.parameters[n].kind == "options"}
    given |= study.setting(setting) | changed
    engine, precision = given.pop("engine", "stepper"), given.pop("precision", study.precision)
    return engine, precision, replace(study.options, **given) if engine == "stepper" else study.options, given


def _check_shared_options(study: Study, values_by_env: Sequence[Values]) -> None:
    """Raises ValueError if environments of a batch differ in a parameter that is an option of the step, such as the timestep."""
    names = [name for name, parameter in study.parameters.items() if parameter.kind == "options"]
    for env, values in enumerate(values_by_env):
        for name in names:
            first, own = values_by_env[0].get(name), values.get(name)
            if first != own:
                raise ValueError(
                    f"parameter {name!r} is {first} in environment 0 and {own} in environment {env}: it is an option of the step, which "
                    "the environments of a batch share; run them in separate batches"
                )


def world_of(study: Study, setting: str, values_by_env: Sequence[Values], **changed: Any) -> World:
    """World (environments of one engine) of a study, with one environment for each set of parameter values.

    Args:
        study: The study.
        setting: Name of the settings, which all environments share.
        values_by_env: Values of the parameters by name, for each environment.
        **changed: Further settings by name, such as timestep=0.001 or engine="mujoco"; sensors=None for ideal sensors.
    """
    model, compiled = study.loaded
    ideal = changed.pop("sensors", "given") is None
    engine, precision, options, given = options_of(study, setting, values_by_env[0], **changed)
    _check_shared_options(study, values_by_env)
    if engine != "stepper" and options.timestep is not None:
        given.setdefault("timestep", options.timestep)
    plan = Plan(
        model=model,
        fields=model_fields(study.parameters, model, values_by_env),
        options=options,
        precision=precision,
        mujoco=given if engine == "mujoco" else None,
        compiled=compiled,
        sensors=None if ideal else sensor_model(study.parameters, study.sensors, model, values_by_env),
        actuators=actuator_model(study.parameters, study.actuators, model, values_by_env),
        threads=study.threads,
    )
    world = make_world(plan, len(values_by_env))
    world.ideal = ideal
    if study.keyframe is not None:
        world.default_qpos = np.array(model.keyframe(study.keyframe).qpos)
    names = dict.fromkeys(name for values in values_by_env for name in values)
    unchanged = {name: study.parameters[name].unchanged for name in study.parameters}
    world.parameters = ParameterValues(
        {
            name: stacked([values.get(name, value) for values in values_by_env])
            for name, value in (unchanged | dict.fromkeys(names.keys() - unchanged.keys())).items()
            if name in names or value is not None
        }
    )
    return world


def begin(study: Study, world: World, episodes: Sequence[int]) -> None:
    """Starts the episodes with the given numbers in the environments of a world."""
    world.seed_episodes(study.seed, episodes, study.control_period)
    qpos, qvel = starts(study, world, episodes)
    world.start(qpos, qvel, study.keyframe, study.seed)


def starts(study: Study, world: World, episodes: Sequence[int]) -> tuple[Array, Array]:
    """Initial positions (num_envs, nq), m and rad, and velocities (num_envs, nv), m/s and rad/s, of episodes with these numbers."""
    model, generators = world.model, study.generators(episodes)
    if study.start is not None:
        qpos, qvel = _started(study.start(world, generators), world)
    elif study.keyframe is not None:
        key = model.keyframe(study.keyframe)
        qpos, qvel = np.tile(key.qpos, (world.num_envs, 1)), np.tile(key.qvel, (world.num_envs, 1))
    else:
        qpos, qvel = np.tile(np.asarray(model.qpos0, float), (world.num_envs, 1)), np.zeros((world.num_envs, model.nv))
    if study.qpos_noise:
        qpos = model.integrate_pos(qpos, study.qpos_noise * np.array([g.standard_normal(model.nv) for g in generators]))
    if study.qvel_noise:
        qvel = qvel + study.qvel_noise * np.array([g.standard_normal(model.nv) for g in generators])
    return qpos, qvel


def _started(made: Any, world: World) -> tuple[Array, Array]:
    """Positions and velocities that the study's function `start` has returned, as arrays (num_envs, ...) after a check."""
    shapes = (world.num_envs, world.model.nq), (world.num_envs, world.model.nv)
    parts = [np.array(part, float) for part in made] if isinstance(made, tuple | list) and len(made) == 2 else []
    if [part.shape for part in parts] != list(shapes):
        found = " and ".join(str(part.shape) for part in parts) or f"{type(made).__name__} of shape {np.shape(made)}"
        raise ValueError(f"start returned {found}, must return qpos {shapes[0]} and qvel {shapes[1]}, one row per environment")
    return parts[0], parts[1]


def steps_of(study: Study, timestep: float) -> int:
    """Number of time steps (timestep in s) per control period."""
    count = round(study.control_period / timestep)
    if count < 1 or abs(count * timestep - study.control_period) > 1e-6 * study.control_period:
        near = " or ".join(f"{study.control_period / n:g}" for n in sorted({max(1, count - 1), max(1, count), max(1, count + 1)}))
        raise ValueError(
            f"the time step, {timestep:g} s, does not divide the control period, {study.control_period:g} s: "
            f"choose a time step of {near} s, or a control period that is a multiple of {timestep:g} s"
        )
    return count


def running(study: Study, world: World, episodes: Sequence[int], *, by_step: bool = False) -> Iterator[bool]:
    """Runs episodes to their end, as a generator that pauses after every step or control period.

    Yields:
        Whether outcomes must be measured now: at the start and after every control period.

    Raises:
        ValueError: The controller keeps state between batches and has no method `begin`.
    """
    nstep = steps_of(study, world.timestep)
    begin(study, world, episodes)
    controller = study.batch_controller()
    state_check = controllers.StateCheck(controller)
    if hasattr(controller, "begin"):
        controller.begin(world)
    yield True
    for _ in range(study.num_control_steps):
        world.last_ctrl = ctrl = None if controller is None else controller(world)
        _check_controls(controller, world, ctrl)
        if not by_step:
            world.advance(ctrl, nstep)
            yield True
            continue
        for left in reversed(range(nstep)):
            world.advance(ctrl, 1)
            yield left == 0
    state_check.check()


def _check_controls(controller: Any, world: World, ctrl: Any) -> None:
    """Raises ValueError if controls have a wrong shape, or are not finite in an episode whose state is finite."""
    if ctrl is None:
        return
    n, nu = world.num_envs, world.model.nu
    if np.shape(ctrl) not in ((n, nu), (nu,)):
        is_column, is_turned = nu == 1 and np.shape(ctrl) == (n,), np.shape(ctrl) == (nu, n)
        remedy = "; controls[:, None] has this shape" if is_column else "; controls.T has this shape" if is_turned else ""
        raise ValueError(
            f"the controller {controllers.name_of(controller)} returned the shape {np.shape(ctrl)}, must be (num_envs, nu), which is "
            f"({n}, {nu}), or (nu,), or None{remedy}"
        )
    if np.isfinite(ctrl).all():
        return
    rows = np.broadcast_to(np.asarray(ctrl, float), (world.num_envs, world.model.nu))
    found = np.argwhere(~np.isfinite(rows) & ~world.diverged[:, None])
    if len(found):
        env, actuator = (int(k) for k in found[0])
        name = world.model.actuator(actuator).name or f"#{actuator}"
        raise ValueError(
            f"the controller {controllers.name_of(controller)} gives actuator {name!r} the control {rows[env, actuator]} at "
            f"{world.time[env]:g} s of episode {int(world.episodes[env])}: controls must be finite"
        )


def outcomes_of(watch: Watch, world: World) -> dict[str, Array]:
    """Final value of every outcome by name, (num_envs,), in its unit; NaN, which counts as a failure, if the episode diverged."""
    return {name: np.where(world.diverged, np.nan, value) for name, value in watch.values(world).items()}


def run_batch(study: Study, world: World, episodes: Sequence[int], on_step: Callable[[World], None] | None = None) -> dict[str, Array]:
    """Runs episodes to their end, one in each environment, and returns their outcomes as `outcomes_of`.

    The function `on_step` is called after every time step.
    """
    watch: Watch | None = None
    for number, looks in enumerate(running(study, world, episodes, by_step=on_step is not None)):
        if on_step is not None and number:
            on_step(world)
        if looks and watch is not None:
            watch.record(world)
        watch = watch or Watch(tuple(study.all_outcomes), world)
    assert watch is not None
    return outcomes_of(watch, world)


def run_episodes(study: Study, setting: str, values_by_env: Sequence[Values], episodes: Sequence[int], **changed: Any) -> list[Row]:
    """Runs a batch of episodes in new environments, and returns their rows (results), without the keys under which the journal stores them.

    Args:
        study: The study.
        setting: Name of the settings.
        values_by_env: Values of the parameters by name, for each episode.
        episodes: Numbers of the episodes.
        **changed: Further settings that differ from the study's, by name, such as timestep=0.001 or engine="mujoco".
    """
    return rows_in(world_of(study, setting, values_by_env, **changed), study, setting, values_by_env, episodes)


def rows_in(world: World, study: Study, setting: str, values_by_env: Sequence[Values], episodes: Sequence[int]) -> list[Row]:
    """Runs a batch of episodes in given environments, and returns their results as rows, without the keys of rows in the journal."""
    outcomes = run_batch(study, world, episodes)
    outcome, quality, settings = study.success_outcome, world.solver_quality(), world.settings()
    success = None if outcome is None else outcome.succeeds(outcomes[outcome.name])
    settings_digest = hashlib.sha256(json.dumps(study.resolved_settings(), sort_keys=True, default=str).encode()).hexdigest()[:16]
    return [
        {
            "setting": setting,
            "parameters": dict(values),
            "episode": int(episode),
            "seed": study.seed,
            "outcomes": {name: float(value[env]) for name, value in outcomes.items()},
            "success": None if success is None else bool(success[env]),
            "quality": {name: number(value[env]) for name, value in quality.items()},
            "settings": settings,
            "resolved_settings": settings_digest,
        }
        for env, (values, episode) in enumerate(zip(values_by_env, episodes, strict=True))
    ]


def number(value: Any) -> int | float:
    """Python number of a NumPy number."""
    return int(value) if isinstance(value, np.integer) else float(value)
