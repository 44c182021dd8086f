"""The table, on the terminal and in docs/benchmarks/many_contacts.md."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from many_contacts.episodes import Floors
from many_contacts.measure import CHUNK, DROPPED, LOOKED_AT, PEERS
from many_contacts.scene import MEAN, Scene
from many_contacts.targets import UNSOLVED, Row, grouped_mean, lines, percent, scale

HEAD = f"""# Where contacts are many

Robots that stand on many points, hands and grippers that hold, heaps and walls: how many times faster than `mujoco.batch` one core steps
them, and how accurately.

    make many-contacts                                                                       # all of it, an hour; this page
    PYTHONPATH=benches python -m many_contacts --scene g1 --num-envs 64 --precision f64 --quick   # one scene, seconds
    PYTHONPATH=benches python -m many_contacts --list                                        # what there is
    PYTHONPATH=benches python -m many_contacts --targets                                     # targets beside what was measured
    make floors                                                                              # the floors of all scenes; half an hour

The first time it downloads mjlab, robosuite, gymnasium-robotics, dm-control, metaworld and gym-aloha as archives, of which only files are
read. The models that both engines step are left in `out/many_contacts/`, the figures in `out/many_contacts.json`.

## How it is measured

* Both engines step the same model, written to one MJCF file, with the same time step, starts, controls and random numbers, on one
  core, in turns of {CHUNK} steps. Processor time; a round repeats everything from the same start, the median of the rounds counts for each
  turn, and the times of a phase's turns are summed. Steps that follow a new start are part of it, starts themselves are not.
* **x** is the time of the faster of MuJoCo's two settings (`same`: implicitfast, Newton, elliptic cones; `own`: what the model asks
  for) over that of stepper. MuJoCo's batch has 64 environments; its time for one does not depend on their number.
* Every engine plays the whole episode by itself, phases that are not timed included, so that each is in a state of its own. Where that
  takes long (heaps, bodies that fall) stepper makes the first part once for all, solved to 1e-3 m/s, and each engine then has time to
  find its rest.
* **Floor** is the least time that the arithmetic of the step could take in lanes on this core
  ([performance.md](performance.md#the-floor)): the operations of eight environments, each alone, at the rates of a loop of independent
  ones. **Farthest above it** is the part of the step that takes the most beyond its own floor, and how much of the step that is. Hulls
  and Newton's method work in plain numbers, one environment at a time, which are not counted: where rows say many Newton steps, the floor
  is lower than any method's.
* **Unsolved** is the share of environment-steps with NOT_CONVERGED, which should be {100 * UNSOLVED:g} % at most; more is bold. Sweeps and
  Newton steps are means over environment-steps.
* **Contacts** and the deepest **penetration** are of the first {LOOKED_AT} environments at the end of each turn, by MuJoCo's collision
  detection for all engines alike. **Slip** is the median over environments of how far what is held moved in the frame of a finger during
  the phase (feet: over the floor); what moved by more than {1e3 * DROPPED:g} mm counts as dropped.
* The mean over scenes is geometric; rows of one scene, and scenes of one kind (the lifted masses, the two heaps, the hand's objects,
  the humanoids), count once together, by their own geometric mean. Targets are in brackets, a third higher where the CPU level is avx512.
* Settings: default; `fast` as in [performance.md](performance.md#beside-mujoco) (Euler's rule, a residual of 1e-3 m/s, overlaps
  corrected in the velocity); `pgs`, sweeps alone, to see what is left to Newton's method."""
REASONS = """## What falls short, and why

The column "at the floor" above says how far the arithmetic of our method alone would go: beyond every target, by 1.1 (the wall that is
struck, in 32 bits) to six times. What stands between, by the part that is farthest above its own floor:

* Feet, hands and grippers (g1, go1, panda, lift, hand): the solve. A group of lanes sweeps until its slowest lane is done, each visit of a
  contact waits for the one before, and what sweeps leave goes to Newton's method, which works in plain numbers, one environment at a time.
  Sweeps alone (`pgs`) are up to 1.5 times as fast in f64.
* Panda while it holds, and the drawer: the narrow phase. Hulls and boxes are searched pair by pair, one environment at a time.
* Lifts: a step of ten contacts with torsional friction takes MuJoCo no longer than 10 to 14 us; here it takes four to six sweeps of
  contacts with six rows, and in f64 one or two Newton steps.
* The heap of thirty and the wall that is struck: hundreds of rows whose loads depend on one another. Newton's method on the exact law
  factors matrices of that size for each environment, 20 to 70 times a step in f64; MuJoCo's softened problem is convex, and starts next to
  its minimum.
* Two arms: dry friction in the joints beside contacts; sweeps leave 86 % of the steps, and Newton's method takes twenty steps.
* Robots under random control: no part is far above its floor by itself; lanes that wait for the slowest of their group, latency, and forces
  that are computed twice, so that the next state follows from the visible state
  ([visible_state.md](../development/decisions/visible_state.md)), add up."""
NOTES = f"""## What to know of the scenes

* g1, go1: mjlab trains them on rough ground; here the ground is flat, and friction and centres of mass are not randomised. A robot that
  leans by more than 70 degrees begins anew.
* panda: servos in the model, since robosuite's controllers are Python.
* two arms: ALOHA's joints have dry friction of 30 to 60 N m and no damping, and its fingers 30 N, which their servos of at most 7 N do not
  overcome: in stepper, where dry friction is hard, they stay where they are; in MuJoCo, where it is soft, they creep to their targets.
  Here a twentieth of it is left, and servos have damping, so that both engines do the same.
* hand: as the package ships it, with the second, untouchable object that shows the target and falls freely.
* drawer: the arm is welded to a mocap body, as metaworld does it, so that a step has six hard equalities; the weld's pose is the one that
  metaworld sets.
* g1 stands: with Euler's rule (`fast`) servos as stiff as these are beyond what 5 ms resolves, and the robots fall; so do many with
  MuJoCo's own setting. What slipped by more than {1e3 * DROPPED:g} mm there has fallen.

Where rows say few sweeps and many Newton steps, sweeps were given up early, and Newton's method takes the time: a look at `pgs` says how
fast the step would be if sweeps were enough, and the second table how much they leave unsolved."""


def _line(cells: Iterable[object]) -> str:
    return "| " + " | ".join(map(str, cells)) + " |"


def _table(head: Sequence[str], lines: Iterable[Sequence[object]]) -> str:
    return "\n".join([_line(head), _line(["---"] * len(head)), *map(_line, lines)])


def _both(values: Iterable[object]) -> str:
    return " / ".join(map(str, values))


def _mm(metres: float) -> str:
    return f"{1e3 * metres:.2g}"


def _number(found: Row | None, name: str, form: str, unit: float = 1.0) -> str:
    """A figure as a multiple of a unit, a dash where nothing was measured."""
    return "-" if found is None else format(unit * found[name], form)


def _slip(found: Sequence[float] | None) -> str:
    if found is None:
        return ""
    return _mm(found[0]) + (f" ({found[1]:.0%} dropped)" if found[1] else "")


def means(rows: Sequence[Row], column: str) -> float | None:
    """Geometric mean of a column's ratios over scenes, of which the rows of a group count once together."""
    return grouped_mean((row["group"], row["ours"][column]["ratio"]) for row in rows if column in row["ours"])


def speed(rows: Sequence[Row], floors: Floors, factor: float = 1.0) -> str:
    """Times beside their floors, ratios beside their targets, the share of unsolved steps, sweeps and Newton steps.

    Args:
        rows: Of many_contacts.json, of one number of environments.
        floors: Of their episodes.
        factor: What targets are multiplied by on this machine.
    """
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
        targets = [factor * row["target"][name.split()[0]] for name in defaults]
        looked = [floors.get((row["row"], row["num_envs"], name.split()[0])) for name in defaults]
        cells: list[object] = [row["row"], f"{first['contacts']:.1f}", *(_number(f, "microseconds", ".2f") for f in by_default)]
        cells += [_both("-" if a is None else f"{a.floor:.2f}" for a in looked)]
        cells += [_both("-" if a is None else "{} {:.0%}".format(*a.farthest) for a in looked)]
        cells += [_both(f"{theirs[peer]['microseconds']:.1f}" for peer in PEERS)]
        cells += ["-" if f is None else _reached(f["ratio"], target) for f, target in zip(by_default, targets, strict=True)]
        cells += [_number(f, "ratio", ".1f") for f in beside]
        cells += [_both("-" if f is None else percent(f["unsolved"]) for f in by_default)]
        cells += [_both(_number(f, count, ".1f") for f in by_default) for count in ("sweeps", "newton_steps")]
        lines.append(cells)
    cells = ["**geometric mean**", "", *("" for _ in defaults), "", "", ""]
    cells += [_reached(means(rows, name) or 0.0, factor * target) for name, target in zip(defaults, _targets(defaults), strict=True)]
    cells += [f"**{means(rows, name):.1f}**" for name in others] + ["", "", ""]
    return _table(head, [*lines, cells])


def _targets(defaults: Sequence[str]) -> list[float]:
    return [dict(zip(("f64", "f32"), MEAN, strict=True))[name.split()[0]] for name in defaults]


def _reached(ratio: float, target: float) -> str:
    return f"**{ratio:.2g}** ({target:.2g})"


def _label(column: str) -> str:
    precision, _, setting = column.partition(" ")
    return precision if setting == "default" else f"{setting} {precision}"


def accuracy(rows: Sequence[Row]) -> str:
    """Contacts, penetration and slip of every engine and setting."""
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
    return f"In each cell: {every}.\n\n" + _table(head, lines)


def _timed(scene: Scene) -> str:
    return ", ".join(phase.name for phase in scene.phases if phase.timed and phase.name)


@dataclass(frozen=True)
class Report:
    """All that was measured.

    Attributes:
        rows: Of many_contacts.json, in the order of the scenes.
        came_from: Their machine.
        floors: Of their episodes, and of those of the robots.
        robots: What throughput.json has, if it is there.
    """

    rows: Sequence[Row]
    came_from: Mapping[str, Any]
    floors: Floors
    robots: Mapping[str, Any] | None

    def show(self) -> str:
        """Both tables of every number of environments."""
        parts = []
        for num_envs in sorted({row["num_envs"] for row in self.rows}):
            some = [row for row in self.rows if row["num_envs"] == num_envs]
            parts.append(f"### {num_envs} environments\n\n{speed(some, self.floors, scale(self.came_from))}\n\n{accuracy(some)}")
        return "\n\n".join(parts)

    def targets(self) -> str:
        """Targets beside what was reached, of the number of environments that most scenes were measured with."""
        numbers = Counter(row["num_envs"] for row in self.rows)
        num_envs = max(sorted(numbers), key=lambda n: numbers[n])
        some = [row for row in self.rows if row["num_envs"] == num_envs]
        head = [f"{num_envs} environments", "target", "reached", "at the floor", "farthest above its floor", "unsolved %"]
        table = _table(head, lines(some, self.came_from, self.floors, self.robots))
        said = f"In each cell f64 / f32; what misses its target is bold, and at most {100 * UNSOLVED:g} % should be unsolved."
        factor = scale(self.came_from)
        if factor != 1.0:
            said += f" With {self.came_from['cpu_level']} targets are {factor:.2f} times those of AVX2."
        return f"{said}\n\n{table}"

    def page(self, scenes: Iterable[Scene]) -> str:
        """The page docs/benchmarks/many_contacts.md."""
        about = [[s.name, s.about, _timed(s), f"{s.target[0]:g} / {s.target[1]:g}"] for s in scenes]
        came_from = self.came_from
        versions = ", ".join(f"{name} {came_from['versions'][name]}" for name in ("stepper", "mujoco-core", "python"))
        rounds = sorted({row["rounds"] for row in self.rows if row["ours"]})
        machine = f"{came_from['cpu']}, CPU level {came_from['cpu_level']}, {came_from['utc'][:10]}; {versions}."
        shared = f"The machine was shared with other work (load {came_from['load_average']})"
        repeats = f"rounds of a scene: {rounds[0]} to {rounds[-1]}"
        measured = f"## Measured\n\n{machine}\n{shared}; {repeats}. A dash is what was not measured.\n\n{self.show()}"
        table = _table(["scene", "what", "timed", "target f64 / f32"], about)
        return "\n\n".join([HEAD, f"## Scenes\n\n{table}", f"## Targets\n\n{self.targets()}", REASONS, measured, NOTES]) + "\n"
