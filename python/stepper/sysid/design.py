"""Design of experiments: ranking of motions by the information that they would give about the parameters.

Let J be the Jacobian of an experiment's readings, divided by their noise. The experiment adds J^T J to the inverse of the covariance.
The D-optimal experiment leaves the covariance with the smallest determinant. The Jacobian is evaluated at the estimate and at samples of
its distribution, and the logarithms of the determinants are averaged (Chaloner and Verdinelli 1995). The estimate alone would mislead.
An object that sticks at the estimated friction gives no information about friction, but may slide at another, equally likely friction.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from stepper._options import Options
from stepper._stepper import Stepper
from stepper.actuators import ActuatorModel
from stepper.shared.arguments import check_kind, check_mapping, check_number, check_whole
from stepper.sysid.data import Episode
from stepper.sysid.inertia import Array
from stepper.sysid.nullspace import FLAT_STD, ROUNDING
from stepper.sysid.residuals import Residuals
from stepper.sysid.result import Identification
from stepper.sysid.simulate import Simulator, find_channels, noise_of, solved


@dataclass(frozen=True)
class ExperimentScore:
    """Expected information of one experiment, as returned by `design`.

    Attributes:
        name: Name of the episode.
        gain: Information gain: half the logarithm of det(covariance before) / det(covariance after), mean over the samples.
        std: Standard deviations of the parameter vector theta after the experiment, (n,), medians over the samples; infinite for numbers
            that remain undetermined.
        shrinks: Ratios of the standard deviations after the experiment to those before it, (n,); 1 for numbers that remain undetermined.
        labels: Labels of the numbers in theta, (n,).
    """

    name: str
    gain: float
    std: Array
    shrinks: Array
    labels: tuple[str, ...]

    def __str__(self) -> str:
        parts = ", ".join(
            f"{label} to {100 * ratio:.0f} %" if np.isfinite(std) else f"{label} remains undetermined"
            for label, ratio, std in zip(self.labels, self.shrinks, self.std, strict=True)
        )
        return f"{self.name}: gain {self.gain:.2f}; intervals shrink: {parts}"


def design(
    found: Identification,
    experiments: Sequence[Episode],
    *,
    noise: Mapping[str, ArrayLike] | None = None,
    options: Options | None = None,
    actuators: ActuatorModel | None = None,
    draws: int = 8,
    step: float = 1e-5,
    threads: int = 0,
    seed: int = 0,
) -> list[ExperimentScore]:
    """Ranks experiments by their expected information, the best first.

    Args:
        found: Result of the identification so far.
        experiments: Controls and initial states of the experiments, such as `Episode(ctrl, {}, period, name="fast push")`. Readings are
            ignored.
        noise: Standard deviations of the channels that an experiment would measure, by name, each a number or (dim,), in the unit of the
            channel. None uses the channels and the noise of `found`.
        options: Options of the step, as in `identify`.
        actuators: Known attributes of the drives, as in `identify`.
        draws: Number of samples from the distribution of `found`, in addition to the estimate.
        step: Half width of the finite differences, as in `identify`.
        threads: Number of threads; 0 uses all cores.
        seed: Seed of the samples.

    Returns:
        One `ExperimentScore` per experiment, sorted by gain.

    Raises:
        TypeError: An argument has another type.
        KeyError: The model does not have a channel.
        ValueError: An experiment does not match the model, or a noise is not a standard deviation.
    """
    check_kind("found", found, Identification, "stepper.sysid.identify returns one")
    if not isinstance(experiments, Sequence) or not all(isinstance(experiment, Episode) for experiment in experiments):
        raise TypeError(f"experiments is {experiments!r}, must be a list of stepper.sysid.Episode, as [Episode(ctrl, {{}}, period)]")
    if not experiments:
        raise ValueError("experiments is empty, must have at least one stepper.sysid.Episode")
    check_whole("draws", draws, least=0)
    check_whole("seed", seed, least=0)
    check_number("step", step, above=0.0)
    if noise is not None:
        check_mapping("noise", noise, '{"wrist_force": 0.3}')
    given = dict(found.noise if noise is None else noise)
    settings = solved(options or Options())
    points = [theta / found.scale for theta in (found.theta, *(found.draw(draws, seed) if draws else ()))]
    before = np.linalg.inv(found.covariance / np.outer(found.scale, found.scale))
    std = np.sqrt(np.diag(np.linalg.inv(before)))
    labels = tuple(f"{block.parameter}[{k}]" if block.size > 1 else block.labels[0] for block in found.blocks for k in range(block.size))
    out = []
    for number, experiment in enumerate(experiments):
        episode = replace(experiment, name=experiment.name or f"experiment {number}")
        episode = _read(found, episode, list(given), settings, actuators)
        residuals = Residuals(Simulator(found.estimate, [episode], found.blocks, settings, threads=threads, actuators=actuators), step)
        residuals.sigma = np.concatenate([noise_of(channel, given[channel.name]) for channel in residuals.simulator.channels])
        gains, after = [], []
        slopes = [at.jacobian[: at.data, : residuals.n] for at in residuals.linearize(points)]
        for J in slopes:
            information = before + J.T @ J
            gains.append((np.linalg.slogdet(information)[1] - np.linalg.slogdet(before)[1]) / 2)
            after.append(np.sqrt(np.diag(np.linalg.inv(information))))
        open_ = _undetermined(found.information * np.outer(found.scale, found.scale) + slopes[0].T @ slopes[0])
        left = np.where(open_, np.inf, np.median(after, axis=0))
        out.append(ExperimentScore(episode.name, float(np.mean(gains)), left * found.scale, np.where(open_, 1.0, left / std), labels))
    return sorted(out, key=lambda prospect: -prospect.gain)


def _undetermined(information: Array) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Mask of the parameters that change along the null space of an information matrix by more than their standard deviation, (n,)."""
    values, axes = np.linalg.eigh(information)
    flat = values < FLAT_STD**-2
    std = np.sqrt((axes[:, ~flat] ** 2) @ (1 / values[~flat]))
    return np.asarray((np.abs(axes[:, flat]) > np.maximum(std, ROUNDING)[:, None]).any(axis=1))


def _read(found: Identification, episode: Episode, names: list[str], options: Options, actuators: ActuatorModel | None) -> Episode:
    """Copy of an experiment with sensor readings simulated with the estimated parameters.

    Args:
        found: Result of the identification so far.
        episode: The experiment: controls and initial state.
        names: Names of the channels to simulate.
        options: Options of the step.
        actuators: Known attributes of the drives.
    """
    model = found.estimate
    channels = find_channels(model, names)
    blank = {channel.name: np.zeros((len(np.asarray(episode.ctrl)), len(channel.columns))) for channel in channels}
    checked = replace(episode, readings=blank, start_std=None).checked(model)
    drives = found.drives(actuators)
    sim = Stepper(model, options=options, actuators=actuators if drives is None else drives)
    sim.set_state(checked.qpos, checked.qvel, act=checked.act)
    nstep = round(episode.period / float(sim.timestep))
    if nstep < 1 or abs(nstep * sim.timestep / episode.period - 1) > 1e-3:
        raise ValueError(f"{episode.name}: a sample every {episode.period:g} s is no whole number of time steps of {sim.timestep:g} s")
    made = sim.rollout(np.asarray(checked.ctrl), nstep, fields=sorted({channel.field for channel in channels}))
    return replace(checked, readings={channel.name: made[channel.field][:, list(channel.columns)] for channel in channels})
