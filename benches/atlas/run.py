"""Sweep of all scenes, engines and time steps, with errors and costs."""

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from atlas.scene import Engine, Scene
from atlas.world import CannotRunError, DivergedError, TooSlowError, World

HELD, FAILS, CANNOT = "holds", "fails", "cannot run"


@dataclass(frozen=True)
class Row:
    """Result of running one scene in one engine at one time step.

    Attributes:
        number: Number of the scene.
        name: Name of the scene.
        engine: Name of the engine with its setting.
        dt: Time step, s.
        outcome: Verdict: "holds", "fails" or "cannot run".
        error: Error in the unit of the scene. Infinite if the run diverged, NaN if the engine cannot run the scene.
        tolerance: Largest error at which the scene holds (passes).
        unit: Unit of error and tolerance.
        cost: Processor time per simulated second of one environment, s/s.
        flags: Status flags of the engine, each with its count as in `World.flags`.
        note: Reason why the scene cannot run or how it diverged.
    """

    number: str
    name: str
    engine: str
    dt: float
    outcome: str
    error: float
    tolerance: float
    unit: str
    cost: float
    flags: str
    note: str = ""


class _Metered:
    """Wrapper of an engine that keeps all started environments, from which it computes their cost and status flags."""

    def __init__(self, engine: Engine) -> None:
        self.engine = engine
        self.name = engine.name
        self.worlds: list[World] = []

    def start(self, mjcf: str, dt: float, num_envs: int = 1, *, restitution: float | None = None, iterations: int | None = None) -> World:
        world = self.engine.start(mjcf, dt, num_envs, restitution=restitution, iterations=iterations)
        self.worlds.append(world)
        return world

    def cost(self) -> tuple[float, str]:
        """Processor time per simulated second of an environment, s/s, and status flags with their counts, over all started environments."""
        seconds = sum(w.seconds * w.num_envs for w in self.worlds)
        cpu, flags = sum(w.cpu for w in self.worlds), sum((w.flags for w in self.worlds), Counter())
        return (cpu / seconds if seconds > 0.0 else math.nan), " ".join(f"{name}:{count}" for name, count in flags.items())


def run(scene: Scene, engine: Engine, dt: float) -> Row:
    """Run one scene in one engine at one time step."""
    metered = _Metered(engine)
    note = ""
    try:
        error = float(scene.measure(metered, dt))
    except CannotRunError as reason:
        error, note = math.nan, str(reason)
    except (DivergedError, TooSlowError) as reason:
        error, note = math.inf, str(reason)
    outcome = CANNOT if math.isnan(error) and note else HELD if scene.holds(error, dt) else FAILS
    return Row(scene.number, scene.name, engine.name, dt, outcome, error, scene.tolerance(dt), scene.unit, *metered.cost(), note)


def sweep(scenes: Sequence[Scene], engines: Sequence[Engine], progress: Callable[[Row], None]) -> list[Row]:
    """Run all scenes in all engines at all time steps of the scenes. Returns the results, and calls `progress` with each new result."""
    rows = []
    for scene in scenes:
        for dt in scene.dts:
            for engine in engines:
                rows.append(run(scene, engine, dt))
                progress(rows[-1])
    return rows
