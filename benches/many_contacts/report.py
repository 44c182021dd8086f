"""Tables of the benchmark of scenes with many contacts, for the terminal and docs/benchmarks/many_contacts.md."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from comparison.throughput import PEERS
from stepper.lab.study.document import markdown_table

from many_contacts.episodes import Floors
from many_contacts.measure import CHUNK, DROPPED, MEASURED_ENVS
from many_contacts.scene import Scene
from many_contacts.targets import MEAN, UNSOLVED, Row, grouped_mean, lines, percent, scale, target_of

HEAD = f"""# Scenes with many contacts

Speed on one core relative to `mujoco.batch`, and accuracy, for robots with many contact points, grasping hands and grippers, heaps and
walls.

    make many-contacts                                                                       # all scenes, an hour; writes this page
    PYTHONPATH=benches python -m many_contacts --scene g1 --num-envs 64 --precision f64 --quick   # one scene, seconds
    PYTHONPATH=benches python -m many_contacts --list                                        # list of scenes
    PYTHONPATH=benches python -m many_contacts --targets                                     # targets and results
    make floors                                                                              # the floors of all scenes; half an hour

The first run downloads mjlab, robosuite, gymnasium-robotics, dm-control, metaworld and gym-aloha, and reads only their model files. The
script writes the models of both engines to `out/many_contacts/`, and the figures to `out/many_contacts.json`.

## How it is measured

* Both engines step the same model, written to one MJCF file, with the same time step, starts, controls and random numbers, on one
  core, in turns of {CHUNK} steps. Times are processor times. A round repeats an episode from the same states; each turn has the median
  over rounds, and a phase is the sum of its turns. Steps after a reset are included, resets are not.
* **x** is the time of the faster of MuJoCo's two settings (`same`: implicitfast, Newton, elliptic cones; `own`: those of the model)
  divided by that of stepper. MuJoCo's batch has 64 environments; its time per environment does not depend on their number.
* Each engine simulates the whole episode, including phases that are not timed, so that states differ between engines. For long lead-ins
  (heaps, falling bodies), stepper simulates the first part once for all engines, solved to 1e-3 m/s. Each engine then has time to settle.
* **Floor** is the least time of the arithmetic of a step in lanes on this core ([performance](performance.md#the-floor)): the
  operations of eight environments, each alone, at the rates of independent operations. **Farthest above it** is the part of the step with
  the largest excess above its floor, and this excess as a share of the step. Operations of hulls and of Newton's method, which work on
  one environment at a time, are not counted: with many Newton steps, the floor is too low.
* **Unsolved** is the share of environment steps with NOT_CONVERGED; the target is {100 * UNSOLVED:g} % at most, and larger values are bold.
  Sweeps and Newton steps are means over environment steps.
* **Contacts** and the deepest **penetration** are of the first {MEASURED_ENVS} environments at the end of each turn, by MuJoCo's collision
  detection for all engines. **Slip** is the median over environments of the displacement of the held object in the frame of a finger
  during the phase (feet: relative to the floor). Objects with more than {1e3 * DROPPED:g} mm count as dropped.
* The mean over scenes is geometric; rows of one scene, and scenes of one kind (the lifted masses, the two heaps, the hand's objects,
  the humanoids), have the weight of one scene. Targets are in parentheses; they are a third higher with the CPU level avx512.
* Settings: default; `fine`, a tolerance of 1e-6 m/s; `fast` as in [performance](performance.md#beside-mujoco) (Euler's rule, a residual
  of 1e-3 m/s, position errors corrected by velocities); `pgs`, projected Gauss-Seidel without Newton's method."""
REASONS = """## Missed targets and their reasons

The column "at the floor" above is the speedup that the arithmetic alone would allow. The reasons for the difference, by the part that is
farthest above its floor:

* Feet, hands and grippers (g1, go1, panda, lift, hand): the solver. A group of lanes iterates until its slowest lane has converged. Each
  update of a contact depends on the one before. Lanes that do not converge go to Newton's method, one environment at a time. Without it
  (`pgs`) steps are up to 1.5 times as fast in f64.
* Panda while it closes its gripper, and the drawer: collision detection. Hulls and boxes are processed pair by pair, one environment at
  a time.
* Lifts: a step of ten contacts with torsional friction takes MuJoCo no longer than 10 to 14 us; here it takes four or five sweeps of
  contacts with four rows, and in f64 half a Newton step.
* The heap of thirty and the wall at the impact: hundreds of coupled rows. Newton's method on the exact law
  factors matrices of that size for each environment, 7 to 16 times a step in f64; MuJoCo's soft problem is convex, and starts near its
  minimum.
* Two arms: dry joint friction together with contacts; most sweeps do not converge, and Newton's method takes twelve steps.
* Robots under random control: no single part is far above its floor. Lanes wait for the slowest of their group, latency adds up, and
  forces are computed twice, so that the next state depends on the visible state alone
  ([why](../development/decisions/visible_state.md))."""
NOTES = f"""## Notes on the scenes

* g1, go1: mjlab trains them on rough ground; here the ground is flat, and friction and centres of mass are not randomised. A robot that
  leans by more than 70 degrees is reset.
* panda: servos in the model replace robosuite's controllers, which are Python code.
* two arms: ALOHA's joints have dry friction of 30 to 60 N m and no damping, and its fingers 30 N, which their servos of at most 7 N cannot
  overcome. With stepper's exact dry friction they stick; with MuJoCo's soft one they creep to their targets. This scene has a twentieth of
  the dry friction and damped servos, so that both engines move alike.
* hand: the unchanged model, including a second object without contacts, which shows the target and falls freely.
* drawer: the arm is welded to a mocap body, as in metaworld, so that a step has six hard equalities; the weld has
  metaworld's pose.
* g1 stands: with Euler's rule (`fast`) these stiff servos are unstable at 5 ms, and the robots fall; so do many with
  MuJoCo's `own` setting. Robots with a slip above {1e3 * DROPPED:g} mm have fallen.

Rows with few sweeps and many Newton steps gave up sweeps early, and Newton's method takes most of the time. `pgs` shows the speed of sweeps
alone, and the second table the share of steps that they leave unsolved."""


def _both(values: Iterable[object]) -> str:
    """Text of two values, for f64 and f32, separated by a slash."""
    return " / ".join(map(str, values))


def _mm(metres: float) -> str:
    """Text of a length in mm, from the length in m."""
    return f"{1e3 * metres:.2g}"


def _number(found: Row | None, name: str, form: str, unit: float = 1.0) -> str:
    """Text of one measured number for a table cell."""
    return "-" if found is None else format(unit * found[name], form)


def _slip(found: Sequence[float] | None) -> str:
    """Text of the median slip of held objects in mm, with the fraction of dropped objects in parentheses."""
    if found is None:
        return ""
    return _mm(found[0]) + (f" ({found[1]:.0%} dropped)" if found[1] else "")


def means(rows: Sequence[Row], column: str) -> float | None:
    """Geometric mean over scenes of the speedups in one table column, where scenes of the same group count as one scene."""
    return grouped_mean((row["group"], row["ours"][column]["ratio"]) for row in rows if column in row["ours"])


def speed(rows: Sequence[Row], floors: Floors, factor: float = 1.0) -> str:
    """Markdown table of step times, their floors, speedups over MuJoCo with targets, unsolved steps and solver iterations, by scene."""
    columns = list(dict.fromkeys(name for row in rows for name in row["ours"]))
    defaults = [name for name in columns if name.endswith(" default")]
    others = [name for name in columns if name not in defaults]
    precisions = _both(name.split()[0] for name in defaults)
    head = [
        "scene",
        "contacts",
        *(f"us {name.split()[0]}" for name in defaults),
        f"floor us {precisions}",
        f"farthest above it {precisions}",
    ]
    head += ["us MuJoCo same / own"]
    head += [f"{name.split()[0]} x (target)" for name in defaults] + [f"{_label(name)} x" for name in others]
    head += [f"unsolved % {precisions}", f"sweeps {precisions}", f"Newton steps {precisions}"]
    lines = []
    for row in rows:
        ours, theirs = row["ours"], row["theirs"]
        if not ours:
            lines.append([row["row"], row["note"]] + [""] * (len(head) - 2))
            continue
        first = next(iter(ours.values()))
        by_default, beside = [ours.get(name) for name in defaults], [ours.get(name) for name in others]
        targets = _targets(target_of(row["row"]), defaults, factor)
        anatomies = [floors.get((row["row"], row["num_envs"], name.split()[0])) for name in defaults]
        cells: list[object] = [row["row"], f"{first['contacts']:.1f}", *(_number(f, "microseconds", ".2f") for f in by_default)]
        cells += [_both("-" if a is None else f"{a.floor:.2f}" for a in anatomies)]
        cells += [_both("-" if a is None else "{} {:.0%}".format(*a.farthest) for a in anatomies)]
        cells += [_both(f"{theirs[peer]['microseconds']:.1f}" for peer in PEERS)]
        cells += ["-" if f is None else _reached(f["ratio"], target) for f, target in zip(by_default, targets, strict=True)]
        cells += [_number(f, "ratio", ".1f") for f in beside]
        cells += [_both("-" if f is None else percent(f["unsolved"]) for f in by_default)]
        cells += [_both(_number(f, count, ".1f") for f in by_default) for count in ("sweeps", "newton_steps")]
        lines.append(cells)
    cells = ["**geometric mean**", "", *("" for _ in defaults), "", "", ""]
    targets = _targets(MEAN, defaults, factor)
    cells += [_reached(means(rows, name) or 0.0, target) for name, target in zip(defaults, targets, strict=True)]
    cells += [f"**{means(rows, name):.1f}**" for name in others] + ["", "", ""]
    return markdown_table(head, [*lines, cells])


def _targets(target: tuple[float, float] | None, defaults: Sequence[str], factor: float) -> list[float | None]:
    """Target speedup over MuJoCo for each of some table columns."""
    by_precision = dict(zip(("f64", "f32"), target, strict=True)) if target else {}
    return [factor * by_precision[name.split()[0]] if target else None for name in defaults]


def _reached(ratio: float, target: float | None) -> str:
    """Table cell of a speedup over MuJoCo: `ratio` in bold type, and `target` in parentheses."""
    return f"**{ratio:.2g}**" + (f" ({target:.2g})" if target else "")


def _label(column: str) -> str:
    """Heading of the table column of stepper's precision and setting. `column` names both, such as "f64 default"; a default is left out."""
    precision, _, setting = column.partition(" ")
    return precision if setting == "default" else f"{setting} {precision}"


def accuracy(rows: Sequence[Row]) -> str:
    """Markdown table of contacts, penetration and slip of each engine and setting."""
    columns = list(dict.fromkeys(name for row in rows for name in row["ours"]))
    every = _both([*map(_label, columns), "MuJoCo same", "own"])
    lines = []
    for row in rows:
        if not row["ours"]:
            continue
        found = [*(row["ours"].get(name) for name in columns), *row["theirs"].values()]
        held = any(f is not None and f["slip"] for f in found)
        cells = [row["row"], _both(_number(f, "unsolved", ".2g", 100.0) for f in found[: len(columns)])]
        cells += [_both(_number(f, "contacts", ".1f") for f in found), _both(_number(f, "penetration", ".2g", 1e3) for f in found)]
        cells += [_both("-" if f is None else _slip(f["slip"]) for f in found) if held else ""]
        gave_up = [f"{name} {f['failed']} of {f['environments']}" for name, f in row["theirs"].items() if f["failed"]]
        gave_up += [f"{name} {f['non_finite']} steps" for name, f in row["ours"].items() if f["non_finite"]]
        cells += ["; ".join([row["note"]] * bool(row["note"]) + gave_up)]
        lines.append(cells)
    head = ["scene", "unsolved %", "contacts", "deepest penetration mm", "slip mm", "remarks"]
    return f"In each cell: {every}.\n\n" + markdown_table(head, lines)


def _timed(scene: Scene) -> str:
    """Names of the timed phases of a scene."""
    return ", ".join(phase.name for phase in scene.phases if phase.timed and phase.name)


@dataclass(frozen=True)
class Report:
    """Report of the benchmark of scenes with many contacts.

    Attributes:
        rows: Rows of many_contacts.json, in the order of the scenes.
        came_from: Provenance of the rows: machine, versions, time.
        floors: Floors (lower bounds of the step time, see episodes.py) of scenes and robots.
        robots: Content of throughput.json. None if the file does not exist.
    """

    rows: Sequence[Row]
    came_from: Mapping[str, Any]
    floors: Floors
    robots: Mapping[str, Any] | None

    def show(self) -> str:
        """Markdown tables of speed and accuracy for each number of environments, one after the other."""
        parts = []
        for num_envs in sorted({row["num_envs"] for row in self.rows}):
            some = [row for row in self.rows if row["num_envs"] == num_envs]
            parts.append(f"### {num_envs} environments\n\n{speed(some, self.floors, scale(self.came_from))}\n\n{accuracy(some)}")
        return "\n\n".join(parts)

    def targets(self) -> str:
        """Markdown table that compares the measured speedups over MuJoCo with their targets.

        If scenes were measured with several numbers of environments, the table has only the number with the most scenes.
        """
        numbers = Counter(row["num_envs"] for row in self.rows)
        num_envs = max(sorted(numbers), key=lambda n: numbers[n])
        some = [row for row in self.rows if row["num_envs"] == num_envs]
        head = [f"{num_envs} environments", "target", "reached", "at the floor", "farthest above its floor", "unsolved %"]
        table = markdown_table(head, lines(some, self.came_from, self.floors, self.robots))
        text = f"Each cell has f64 / f32. Missed targets are bold. At most {100 * UNSOLVED:g} % of the steps may be unsolved."
        factor = scale(self.came_from)
        if factor != 1.0:
            text += f" With {self.came_from['cpu_level']} targets are {factor:.2f} times those of AVX2."
        return f"{text}\n\n{table}"

    def page(self, scenes: Iterable[Scene]) -> str:
        """Content of the page docs/benchmarks/many_contacts.md: all tables, and the descriptions of `scenes`."""
        about = [[s.name, s.about, _timed(s)] for s in scenes]
        came_from = self.came_from
        versions = ", ".join(f"{name} {came_from['versions'][name]}" for name in ("stepper", "mujoco-core", "python"))
        rounds = sorted({row["rounds"] for row in self.rows if row["ours"]})
        machine = f"{came_from['cpu']}, CPU level {came_from['cpu_level']}, {came_from['utc'][:10]}; {versions}."
        shared = f"The machine was shared with other work (load {came_from['load_average']})"
        repeats = f"rounds of a scene: {rounds[0]} to {rounds[-1]}"
        measured = f"## Measured\n\n{machine}\n{shared}; {repeats}. A dash means not measured.\n\n{self.show()}"
        table = markdown_table(["scene", "what", "timed"], about)
        return "\n\n".join([HEAD, f"## Scenes\n\n{table}", f"## Targets\n\n{self.targets()}", REASONS, measured, NOTES]) + "\n"
