"""Result of an identification: estimate and distribution of the parameters, with samples for `Stepper.randomize`."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from stepper._stepper import Model
from stepper.actuators import ActuatorModel
from stepper.shared.arguments import check_fraction, check_whole, path_of
from stepper.shared.fields import RANDOMIZED
from stepper.shared.files import explained, read_text, write_text
from stepper.shared.machine import require
from stepper.sysid.combinations import Combination
from stepper.sysid.inertia import Array
from stepper.sysid.parameters import Block, FitParameter, bind, natural, split, value_slopes, write
from stepper.sysid.uncertainty import RIDGE, root_of

Mask: TypeAlias = np.ndarray[Any, np.dtype[np.bool_]]
FORMAT = 4
"""Version of the file format of `Identification.save`."""


@dataclass(frozen=True)
class Search:
    """End of one search of `identify`.

    Attributes:
        theta: Parameter vector at the end of the search, (n,).
        cost: Half the sum of the squares of all residuals.
        converged: Whether the search converged within `max_evaluations`.
    """

    theta: Array
    cost: float
    converged: bool


@dataclass(frozen=True)
class Identification:
    """Result of `identify`: a normal distribution of the parameter vector theta.

    Theta contains logarithms of positive quantities, log-Cholesky parameters of inertias, and the values of other parameters.

    Attributes:
        model: Model that was given to `identify`.
        parameters: Identified parameters.
        theta: Estimate of the parameter vector, (n,).
        covariance: Covariance of theta, (n, n). The variance of undetermined parameters follows from their bounds.
        scale: Size of a significant change of theta, (n,): 1 for logarithms.
        determined: Whether the data determine each value, (n,).
        combinations: Combinations of parameters that the data determine, although they do not determine each parameter.
        freedom: Degrees of freedom: number of readings minus number of parameters.
        noise: Standard deviations of the readings by channel, in the unit of the channel: given by the user, or estimated.
        residual: Root mean square of the residuals by channel, in its unit.
        searches: Ends of the searches, the best first; searches that reached the same minimum count once.
        evaluations: Number of evaluated points, each with its Jacobian.
        steps: Number of simulated time steps, summed over environments.
        seconds: Duration of the identification, s.
        warnings: Parameters that the data do not determine, and readings that the model does not explain.
    """

    model: Model
    parameters: tuple[FitParameter, ...]
    theta: Array
    covariance: Array
    scale: Array
    determined: Mask
    combinations: tuple[Combination, ...]
    freedom: int
    noise: Mapping[str, list[float]]
    residual: Mapping[str, list[float]]
    searches: tuple[Search, ...]
    evaluations: int
    steps: int
    seconds: float
    warnings: tuple[str, ...]

    @cached_property
    def blocks(self) -> list[Block]:
        """List with one `Block` per parameter: the entries of the parameter vector theta that belong to this parameter."""
        return bind(self.parameters, self.model)

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of the values, (n,), such as "body_mass[box]"."""
        return tuple(label for block in self.blocks for label in block.labels)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the values, (n,)."""
        return tuple(unit for block in self.blocks for unit in block.units)

    @property
    def values(self) -> Array:
        """Estimated values in their units, (n,)."""
        return natural(self.blocks, self.theta)

    @property
    def std(self) -> Array:
        """Standard deviations of the values in their units, (n,), to first order; infinite for values that the data do not determine."""
        G = value_slopes(self.blocks, self.theta)
        return np.where(self.determined, np.sqrt(np.einsum("ij,jk,ik->i", G, self.covariance, G)), np.inf)

    def interval(self, confidence: float = 0.95) -> Array:
        """Returns the confidence intervals of the values, (n, 2).

        For a positive quantity, the interval is symmetric in its logarithm. Intervals are clipped to the bounds. Intervals of values that
        the data do not determine are infinite: from 0 for a positive quantity, otherwise from minus infinity. See `combinations`.

        Raises:
            ValueError: The confidence is not between 0 and 1.
        """
        check_fraction("confidence", confidence)
        t = t_quantile(confidence, self.freedom)
        spread = np.sqrt(np.diag(self.covariance))
        std = np.where(self.determined, self.std, 0.0)
        pieces = zip(self.blocks, *(split(self.blocks, x) for x in (self.theta, spread, self.values, std)), strict=True)
        out, widest = [], []
        for block, theta, of_theta, value, of_value in pieces:
            if block.parameter.kind in ("body_inertial", "body_inertia"):
                ends = [np.maximum(value - t * of_value, block.least), value + t * of_value]
            else:
                ends = [block.natural(np.clip(theta + sign * t * of_theta, block.low, block.high)) for sign in (-1, 1)]
            out.append(np.stack(ends, axis=1))
            widest.append(np.stack([block.least, np.full(block.size, np.inf)], axis=1))
        return np.where(self.determined[:, None], np.concatenate(out), np.concatenate(widest))

    def __getitem__(self, label: str) -> float:
        """Estimate of a parameter by its label, in its unit: `result["body_mass[box]"]`."""
        if label not in self.labels:
            raise KeyError(f"there is no {label!r}, there are: {', '.join(self.labels)}")
        return float(self.values[self.labels.index(label)])

    @property
    def estimate(self) -> Model:
        """Model with the estimated parameters. It does not contain delays of actuators (see `drives`) or parameters of sensors."""
        fields = write(self.blocks, self.theta[None], self.model).fields
        return self.model.replace(**{name: array[0] for name, array in fields.items()}) if fields else self.model

    def drives(self, known: ActuatorModel | None = None) -> ActuatorModel | None:
        """Returns an actuator model with the identified delays; None if no delay was identified.

        Args:
            known: Actuator model with the other attributes of the drives.
        """
        made = write(self.blocks, self.theta[None], self.model).actuators(known, np.zeros(1, int))
        if made is None or known is None:
            return made
        return ActuatorModel({**known.named, **made.named}, default=known.default)

    def draw(self, count: int, seed: int = 0) -> Array:
        """Returns random parameter vectors theta from the distribution, clipped to the bounds, (count, n)."""
        check_whole("count", count, least=1)
        check_whole("seed", seed, least=0)
        low, high = (np.concatenate([getattr(block, end) for block in self.blocks]) for end in ("low", "high"))
        root = root_of(self.covariance, RIDGE)
        drawn = self.theta + np.random.default_rng(seed).standard_normal((count, len(self.theta))) @ root.T
        return np.clip(drawn, low, high)

    def sample(self, count: int, *, seed: int = 0, actuators: ActuatorModel | None = None) -> dict[str, Any]:
        """Returns random parameters from the distribution, for `sim.randomize(**result.sample(sim.num_envs))`.

        The stepper's model must be `result.estimate`, or another model with the same elements.

        Args:
            count: Number of environments.
            seed: Seed of the random numbers.
            actuators: The stepper's actuator model, if delays were identified.

        Returns:
            Arrays by field, (count, ...), in the field's unit.

        Raises:
            ValueError: Principal axes of an inertia were identified, which all environments of a stepper share: see `models`.
        """
        variants = write(self.blocks, self.draw(count, seed), self.model)
        if shared := sorted(set(variants.fields) - RANDOMIZED.keys()):
            raise ValueError(f"all environments of a stepper share {', '.join(shared)}; make a stepper of each of result.models({count})")
        delays = variants.actuators(actuators)
        return {**variants.fields, **({} if delays is None else {"actuators": delays})}

    def models(self, count: int, *, seed: int = 0) -> list[Model]:
        """Returns models with random parameters from the distribution, one model per draw.

        Unlike `sample`, it also works for parameters that all environments of a stepper share.
        """
        fields = write(self.blocks, self.draw(count, seed), self.model).fields
        return [self.model.replace(**{name: array[k] for name, array in fields.items()}) for k in range(count)]

    def weakest(self) -> tuple[float, dict[str, float]]:
        """Returns the least determined combination of parameters.

        Returns:
            Its standard deviation in units of the scales, and its coefficients by label, the largest first. For example {"body_mass[box]":
            0.7, "geom_friction[box][0]": -0.7} is the ratio of two positive quantities.
        """
        labels = [f"{block.parameter}[{k}]" if block.size > 1 else block.labels[0] for block in self.blocks for k in range(block.size)]
        values, vectors = np.linalg.eigh(self.covariance / np.outer(self.scale, self.scale))
        direction = vectors[:, -1] * np.sign(vectors[np.abs(vectors[:, -1]).argmax(), -1])
        parts = sorted(zip(labels, direction, strict=True), key=lambda part: -abs(part[1]))
        return float(np.sqrt(values[-1])), {label: float(part) for label, part in parts if abs(part) > 0.1}

    def advice(self) -> str:
        """Returns a suggestion for the next measurement, as a sentence."""
        std, parts = self.weakest()
        first = next(iter(parts))
        block = next(b for b in self.blocks for k in range(b.size) if first in (b.labels[0], f"{b.parameter}[{k}]"))
        what = f"parameter is {first}"
        if len(parts) > 1:
            what = "combination is " + " ".join(f"{part:+.2f} {label}" for label, part in parts.items())
        return f"the least certain {what} (standard deviation {std:.2g} of its scale): {block.hint}"

    def table(self) -> str:
        """Returns a Markdown table of values, 95 % intervals, units and start values."""
        lines = ["| | value | 95 % interval | unit | in the model |", "|---|---|---|---|---|"]
        start = natural(self.blocks, np.concatenate([block.start for block in self.blocks]))
        rows = zip(self.labels, self.values, self.interval(), self.units, start, self.determined, strict=True)
        for label, value, (low, high), unit, before, known in rows:
            interval_text = f"{low:.5g} to {high:.5g}" if known else "not determined"
            lines.append(f"| {label} | {value:.5g} | {interval_text} | {unit} | {before:.5g} |")
        return "\n".join(lines)

    def __str__(self) -> str:
        left = ", ".join(f"{name} {' '.join(f'{x:.3g}' for x in values)}" for name, values in self.residual.items())
        lines = [
            self.table(),
            *(f"determined together: {together}" for together in self.combinations),
            f"residuals (root mean square): {left}",
            f"next: {self.advice()}",
        ]
        return "\n".join([*lines, *(f"warning: {text}" for text in self.warnings)])

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the result to a JSON file, which `load` reads."""
        kept = {
            "format": FORMAT,
            "model": self.model.digest,
            "parameters": [asdict(parameter) for parameter in self.parameters],
            "searches": [{"theta": s.theta.tolist(), "cost": s.cost, "converged": s.converged} for s in self.searches],
            "values": dict(zip(self.labels, self.values.tolist(), strict=True)),
            "interval": dict(zip(self.labels, self.interval().tolist(), strict=True)),
        }
        kept["combinations"] = [asdict(together) for together in self.combinations]
        for name in ("theta", "covariance", "scale", "determined"):
            kept[name] = getattr(self, name).tolist()
        for name in ("freedom", "noise", "residual", "evaluations", "steps", "seconds", "warnings"):
            kept[name] = getattr(self, name)
        write_text(path_of("path", path), json.dumps(kept, indent=2) + "\n")

    @classmethod
    def load(cls, path: str | os.PathLike[str], model: Model) -> Identification:
        """Reads a result from a file that `save` wrote.

        Args:
            path: Path of the file.
            model: Model that was given to `identify`.

        Raises:
            ValueError: The file has another format or belongs to another model.
        """
        file = path_of("path", path)
        text = read_text(file, "identification")
        with explained(file, "give a file that Identification.save wrote, with the model that was given to identify"):
            kept = json.loads(text)
            if not isinstance(kept, dict) or kept.get("format") != FORMAT:
                raise ValueError(f"it is no identification in format {FORMAT}, which this version reads")
            if kept["model"] != model.digest:
                raise ValueError(f"it is of model {kept['model'][:12]}, the model given is {model.digest[:12]}")
            parameters = tuple(
                FitParameter(p["selector"], p["start"], *(None if p[name] is None else tuple(p[name]) for name in ("bounds", "prior")))
                for p in kept["parameters"]
            )
            numbers: dict[str, Any] = {name: np.array(kept[name]) for name in ("theta", "covariance", "scale", "determined")}
            numbers |= {name: kept[name] for name in ("freedom", "noise", "residual", "evaluations", "steps", "seconds")}
            return cls(
                model=model,
                parameters=parameters,
                searches=tuple(Search(np.array(s["theta"]), s["cost"], s["converged"]) for s in kept["searches"]),
                combinations=tuple(Combination(**(c | {"interval": tuple(c["interval"])})) for c in kept["combinations"]),
                warnings=tuple(kept["warnings"]),
                **numbers,
            )


def t_quantile(confidence: float, freedom: int) -> float:
    """Half width of an interval of Student's t distribution, in standard deviations.

    Args:
        confidence: Probability of the interval.
        freedom: Degrees of freedom.
    """
    return float(require("scipy.stats", "for intervals").t.ppf((1 + confidence) / 2, freedom))
