"""Table that `stepper demo` prints: speeds and errors of stepper and MuJoCo."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from stepper.shared.machine import require

Figures = dict[str, Any]
"""Results of the demo or of one engine, by name."""
LENGTHS = ((1.0, "m"), (1e-3, "mm"), (1e-6, "um"), (1e-9, "nm"))
"""Units of length, the longest first: the length of the unit in metres, and its symbol."""


def length(metres: float) -> str:
    """Text of a length with a suitable unit, such as "3.2 mm"."""
    for unit, name in LENGTHS:
        if abs(metres) >= unit:
            return f"{metres / unit:.3g} {name}"
    return f"{metres:.1e} m"


def _phases(values: dict[str, float], form: str) -> str:
    """Text with one number for each phase of the race ("control", "rest"), in a format such as ".2f"."""
    return " / ".join(format(value, form) for value in values.values())


def _rows(peers: Sequence[str]) -> list[tuple[str, Callable[[Figures], str]]]:
    """Rows of the demo's table: pairs of a label, and a function from the results of an engine to the text of the table's cell."""
    return [
        ("environments", lambda f: f"{f['num_envs']:,}"),
        ("steps per second, one core, control / rest", lambda f: _phases(f["steps_per_second_one_core"], ",.0f")),
        *[(f"  times {name}", lambda f, name=name: _phases(f["ratio_one_core"][name], ".2f")) for name in peers],
        ("steps per second, all cores, control", lambda f: _phases(f["steps_per_second_all_cores"], ",.0f")),
        ("largest penetration", lambda f: length(f["worst_penetration"])),
        ("penetration after rest", lambda f: length(f["at_the_end"]["penetration"])),
        ("contacts per humanoid, control / rest", lambda f: _phases(f["contacts_mean"], ".2f")),
        ("kinetic energy after rest, mean", lambda f: f"{f['at_the_end']['kinetic_mean']:.2e} J"),
        ("kinetic energy after rest, largest", lambda f: f"{f['at_the_end']['kinetic_max']:.2e} J"),
        ("worst residual of any step, m/s", lambda f: _certified(f, lambda c: f"{c['worst_residual']:.1e}")),
        ("environment-steps not converged", lambda f: _certified(f, lambda c: f"{100.0 * c['not_converged'] / c['env_steps']:.2g} %")),
        ("environment-steps not finite", lambda f: _certified(f, lambda c: f"{c['non_finite']:,}")),
        ("environment-steps with contacts left out", lambda f: _certified(f, lambda c: f"{c['contacts_full']:,}")),
        (
            "solver iterations per step (sweeps and Newton steps), mean",
            lambda f: _certified(f, lambda c: f"{c['sweeps'] / c['env_steps']:.1f}"),
        ),
        ("same bits on one and on all cores", lambda f: {True: "yes", False: "NO"}.get(f.get("same_bits_on_one_and_all_cores"), "")),
    ]


def _certified(figures: Figures, form: Callable[[Figures], str]) -> str:
    """Text on how well an engine solved its steps, by phase; "not reported" for MuJoCo."""
    return " / ".join(form(statistics) for statistics in figures.get("solver_statistics", {}).values()) or "not reported"


def _notes(figures: Figures) -> list[str]:
    """Notes below the demo's table: settings, method of measurement and machine."""
    plan, engines = figures["plan"], figures["engines"]
    ours = next(f for f in engines.values() if "options" in f)
    options, came_from = ours["options"], figures["provenance"]
    versions = came_from["versions"]
    return [
        f"{figures['model']}, dt {ours['timestep'] * 1e3:g} ms; {plan['steps']} steps of random control (uniform in ctrlrange, new every "
        f"{plan['hold']} steps, seed {plan['seed']}), then {plan['rest']} steps without control.",
        f"stepper: integrator {options['integrator'] or 'midpoint'}, solver {options['solver']}, at most {options['iterations']} "
        f"iterations, tolerance {options['tolerance']:g} m/s, stabilization {options['stabilization']}. "
        f"MuJoCo {versions.get('mujoco-core')}: "
        "mujoco.batch.Batch, Newton, sensors off, same dt; its defaults are Euler and the pyramidal cone.",
        f"Engines take turns of {plan['chunk']} steps in one process, on core {figures['core']} (processor time), then on "
        f"all {figures['num_cores']} cores (wall time); one call per step; numbers and ratios are medians over the turns.",
        f"MuJoCo steps the first {plan['peers']} humanoids only, with the same controls, to save time.",
        f"Contacts (nearer than 0.1 mm), penetration and energy follow from MuJoCo's collision detection and inertia at each engine's "
        f"qpos and qvel, on the first {plan['peers']} humanoids, every {plan['chunk']} steps.",
        f"Machine: {came_from['cpu']}, load {came_from['load_average']}, CPU level {came_from['cpu_levels'][-1]}; "
        f"stepper {versions['stepper']}.",
    ]


def show(figures: Figures) -> None:
    """Prints the table of speeds and errors, with notes on the measurement.

    Args:
        figures: Results of `stepper.lab.demo.race.measure`.
    """
    consoles, tables = require("rich.console", "to print the table"), require("rich.table", "to print the table")
    console = consoles.Console(highlight=False)
    if not console.is_terminal:
        console = consoles.Console(highlight=False, width=150)
    table = tables.Table(title="Humanoids that fall and come to rest")
    table.add_column("")
    for name in figures["engines"]:
        table.add_column(name, justify="right")
    engines = list(figures["engines"].values())
    for label, cell in _rows(list(engines[0]["ratio_one_core"])):
        table.add_row(label, *[cell(engine) for engine in engines])
    console.print(table)
    for note in _notes(figures):
        console.print(note, markup=False)
