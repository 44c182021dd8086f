"""Tables that others have published, rerun: docs/benchmarks/published.md.

`python -m reality.published TABLE` prints a table and writes it to docs/benchmarks. "grasp" holds a block near the critical friction, in
a scene of ours or in that of --scene, motrixsim's scene_pick_cube.xml.

"piles" are a pyramid of boxes and a pile of hulls with Box3D's sizes. "go1" steps 1,024 robots of motrixsim's go1/scene.xml.
"""

import argparse
import contextlib
import itertools
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import stepper
from atlas.engines import DEFAULTS, Mujoco, Stepper
from atlas.mjcf import numbers
from atlas.world import Array, TooSlowError, World
from stepper.lab.engines import MujocoBatch, MujocoEngine, StepperBatch
from stepper.shared.files import existing

from reality.report import BENCHMARKS, shown, write_rows

Row = dict[str, Any]
FACTORS = (0.90, 0.98, 1.00, 1.02, 1.10, 1.20)
"""Friction in relation to the critical one: those published, and 1.20."""
GRASP_DT, PHASE, SETTLE, HELD, WINDOW = 0.002, 1.0, 0.4, 0.6, 0.2
"""Time step of the grasp; lengths of a phase, of the rest after the lift, of the hold, and of the force's mean at its end, s."""
SLIP_TIME = 5.0
"""Length of the published slip test, s."""
GRIPPER = Path(__file__).parent / "gripper.xml"
"""Scene of the grasp without the published one."""
GRASPED = ("obj", "left_finger", "right_finger")
"""Bodies whose friction is varied."""


def loaded(scene: Path) -> Any:
    """Specification of a scene from a file. Meshes, which only the eye needs there, and sensors are left out."""
    spec = mujoco.MjSpec.from_file(str(scene))
    for geom in [*spec.geoms]:
        geom.material = ""
        if geom.meshname:
            spec.delete(geom)
    for element in [*spec.meshes, *spec.materials, *spec.textures, *spec.sensors]:
        spec.delete(element)
    return spec


def mjcf(spec: Any, friction: float | None = None) -> str:
    """MJCF of a specification. A number is the coefficient of friction of block and fingers; None keeps those of the scene."""
    for body in GRASPED if friction is not None else ():
        for geom in spec.body(body).geoms:
            geom.friction[0] = friction
    spec.compile()
    return str(spec.to_xml())


def held(engine: Stepper | Mujoco, spec: Any) -> tuple[Array, float, float, float]:
    """Positions (nq,) of a held block, the force of both fingers on it, N, its weight, N, and its horizontal offset from the pads, m."""
    world = engine.start(mjcf(spec), GRASP_DT)
    keys = {name: world.model.key(name).ctrl.copy() for name in ("home", "grasp", "lift")}
    world.set(world.model.key("home").qpos, np.zeros(world.model.nv))
    opened, closed = keys["grasp"][-1], keys["lift"][-1]
    path = [(keys["home"], opened), (keys["lift"], opened), (keys["grasp"], opened), (keys["grasp"], closed), (keys["lift"], closed)]
    steps = round(PHASE / GRASP_DT)
    for (first, before), (last, after) in itertools.pairwise(path):
        for k in range(steps):
            done = k / steps
            world.step(ctrl=np.r_[first[:-1] + done * (last - first)[:-1], before + done * (after - before)])
    world.run(SETTLE + HELD - WINDOW, keys["lift"])
    force = world.mean(lambda: pressed(world), WINDOW, GRASP_DT)
    model, now = world.model, world.at()
    weight = float(model.body("obj").mass[0]) * float(np.linalg.norm(model.opt.gravity))
    fingers = np.isin(model.geom_bodyid, [world.body(name) for name in GRASPED[1:]]) & (model.geom_conaffinity > 0)
    offset = float(np.linalg.norm((now.geom_xpos[fingers].mean(axis=0) - now.xpos[world.body("obj")])[:2]))
    return world.qpos[0], force, weight, offset


def pressed(world: World) -> float:
    """Sum of the normal forces of both fingers on the block, N."""
    bodies, block = world.model.geom_bodyid, world.body("obj")
    fingers = {world.body(name) for name in GRASPED[1:]}
    pairs = ((touch, {int(bodies[g]) for g in touch.geoms}) for touch in world.touches())
    return sum(touch.force for touch, pair in pairs if block in pair and pair & fingers)


def grasp(scene: Path | None) -> Iterator[Row]:
    """Rows of the slip test: drop of a block, m, by engine and friction."""
    for engine in grasp_engines():
        spec = loaded(scene or GRIPPER)
        qpos, force, weight, offset = held(engine, spec)
        for factor in FACTORS:
            world = engine.start(mjcf(spec, factor * weight / force), GRASP_DT)
            world.set(qpos, np.zeros(world.model.nv))
            block = world.body("obj")
            ctrl, before, low = world.model.key("lift").ctrl, float(world.at().xpos[block, 2]), np.inf
            for _ in range(round(SLIP_TIME / 0.01)):
                world.run(0.01, ctrl)
                low = min(low, float(world.at().xpos[block, 2]))
            yield {
                "scene": "own" if scene is None else "published", "engine": engine.name, "force_N": force, "weight_N": weight,
                "offset_mm": 1e3 * offset, "factor": factor, "friction": factor * weight / force, "drop_mm": 1e3 * (before - low),
            }  # fmt: skip


def grasp_engines() -> list[Stepper | Mujoco]:
    """Engines of the grasp. The published ones of MuJoCo are the pyramidal ones."""

    def of(name: str, **settings: Any) -> Mujoco:
        return Mujoco(f"MuJoCo, {name}", MujocoEngine(name, DEFAULTS | settings))

    return [
        Stepper("stepper"),
        of("Euler, pyramidal"),
        of("implicitfast, pyramidal", integrator="implicitfast"),
        of("implicitfast, elliptic", integrator="implicitfast", cone="elliptic"),
        of("elliptic, impratio 10, noslip 10", integrator="implicitfast", cone="elliptic", impratio=10.0, noslip_iterations=10),
    ]


PILE_DT, PILE_GRAVITY, PILE_FRICTION = 1.0 / 60.0, 10.0, 0.6
"""Time step, s, gravity, m/s^2, and friction of Box3D's benchmark."""
SIZES = {"pyramid": (100, 20, 200), "hulls": (80, 10, 500)}
"""Number of rows or layers of each published pile, that of Box3D's debug build, and number of steps."""
LIMIT = 30.0
"""Processor time after which an engine is stopped in a pile, s."""


def pyramid(rows: int) -> str:
    """MJCF of Box3D's large pyramid: boxes of 1 m and 100 kg in a plane, `rows` in the lowest row."""
    places = [((i + 1) * 0.5 + (j - i) - 0.5 * rows, 0.0, i + 0.5) for i in range(rows) for j in range(i, rows)]
    return pile('type="box" size=".5 .5 .5" density="100"', places)


def hulls(layers: int) -> str:
    """MJCF of Box3D's convex pile: 64 hulls per layer, each of 32 random points on a sphere of 2 m, which collapse. The points are ours."""
    points = np.random.default_rng(0).normal(size=(32, 3))
    points *= 2.0 / np.linalg.norm(points, axis=1, keepdims=True)
    places = [(4.0 * (x - 4), 4.0 * (y - 4), 2.0 + 4.0 * z) for z in range(layers) for y in range(8) for x in range(8)]
    return pile('type="mesh" mesh="hull"', places, f'<asset><mesh name="hull" vertex="{numbers(points.ravel())}"/></asset>')


def pile(geom: str, places: Sequence[tuple[float, ...]], assets: str = "") -> str:
    """MJCF of equal free bodies on a floor."""
    bodies = "".join(f'<body pos="{numbers(place)}"><freejoint/><geom {geom}/></body>' for place in places)
    return f"""<mujoco><option gravity="0 0 {-PILE_GRAVITY}"/><size memory="8G"/>
      <default><geom friction="{PILE_FRICTION} 0 0"/></default>{assets}
      <worldbody><geom type="plane" size="400 400 1"/>{bodies}</worldbody></mujoco>"""


def piles(named: str, *, small: bool) -> Iterator[Row]:
    """Rows of the piles with `named` in "PILE, ENGINE": milliseconds of one core per step, without the first, as published.

    `small` piles are those of Box3D's debug build.
    """
    fast = stepper.Options(integrator="euler", stabilization="baumgarte", tolerance=1e-3)
    engines: list[Stepper | Mujoco] = [
        Stepper("stepper, fast", fast),
        Stepper("stepper"),
        Mujoco("MuJoCo", MujocoEngine("defaults", DEFAULTS)),
    ]
    for name, (rows, few, steps) in SIZES.items():
        size = few if small else rows
        text = {"pyramid": pyramid, "hulls": hulls}[name](size)
        for engine in engines:
            if named not in f"{name}, {engine.name}":
                continue
            world = engine.start(text, PILE_DT)
            before = world.qpos[0].reshape(-1, 7)[:, 2]
            world.limit = LIMIT
            done, first = 0, 0.0
            with contextlib.suppress(TooSlowError):
                world.step()
                first = world.cpu
                for done in range(1, steps):  # noqa: B007  (the number of steps is read after a stop)
                    world.step()
            touches = world.touches()
            yield {
                "scene": name, "size": size, "bodies": world.model.nbody - 1, "engine": engine.name, "steps": done, "of_steps": steps - 1,
                "first_ms": 1e3 * first, "ms_per_step": 1e3 * (world.cpu - first) / max(done, 1), "total_ms": 1e3 * (world.cpu - first),
                "contacts": len(touches), "largest_sinking_m": float((before - world.qpos[0].reshape(-1, 7)[:, 2]).max()),
                "unsolved": world.flags["NOT_CONVERGED"],
            }  # fmt: skip


def go1(scene: Path, num_envs: int, steps: int, threads: int) -> Iterator[Row]:
    """Rows of the parallel robots by engine: steps with controls of 0 from the reference pose, one per call, as published."""
    text = mjcf(loaded(scene))
    model = stepper.load(text)
    makers: list[Callable[[], Any]] = [
        lambda: StepperBatch(model, num_envs, precision="f32", threads=threads),
        lambda: StepperBatch(model, num_envs, threads=threads),
        lambda: MujocoBatch(mujoco.MjModel.from_xml_string(text), num_envs, threads=threads),
        lambda: MotrixBatch(text, num_envs),
    ]
    for make in makers:
        try:
            batch = make()
        except ModuleNotFoundError:
            continue
        wall, cpu = time.perf_counter(), time.process_time()
        for _ in range(steps):
            batch.step()
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        count, height = num_envs * steps, float(np.mean(batch.qpos[:, 2]))
        yield {
            "engine": batch.name, "environments": num_envs, "steps": steps, "threads": threads, "wall_s": wall, "processor_s": cpu,
            "steps_per_s": count / wall, "steps_per_core_s": count / cpu, "height_m": height,
        }  # fmt: skip


class MotrixBatch:
    """Batch of environments in motrixsim (PyPI), which has no setting for the number of threads: pin the process to cores."""

    def __init__(self, text: str, num_envs: int):
        import motrixsim  # noqa: PLC0415  (optional)

        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "scene.xml")
            path.write_text(text)
            self._model = motrixsim.load_model(str(path))
        self._data = motrixsim.SceneData(self._model, batch=(num_envs,))
        self.name = "motrixsim"

    @property
    def qpos(self) -> Array:
        """Positions, (num_envs, nq), m and rad."""
        return np.asarray(self._data.dof_pos)

    def step(self) -> None:
        """Steps all environments once."""
        self._model.step(self._data)


def main() -> None:
    """Rerun a published table, print it, and write it to docs/benchmarks/published_TABLE.csv."""
    parser = argparse.ArgumentParser(prog="python -m reality.published", description=__doc__)
    parser.add_argument("table", choices=("grasp", "piles", "go1"))
    parser.add_argument("--scene", type=Path, help="published scene, MJCF")
    parser.add_argument("--small", action="store_true", help="piles of 20 rows and of 10 layers, as in Box3D's debug build")
    parser.add_argument("--named", default="", help='part of "PILE, ENGINE", the names of the piles that are run [all]')
    parser.add_argument("--num-envs", type=int, default=1024, help="environments of go1 [1024]")
    parser.add_argument("--steps", type=int, default=3000, help="steps of go1 [3000]")
    parser.add_argument("--threads", type=int, default=2, help="threads of go1 [2]")
    parser.add_argument("--out", type=Path, default=BENCHMARKS, help="folder of the file [docs/benchmarks]")
    given = parser.parse_args()
    if given.table == "go1" and given.scene is None:
        parser.error("no scene: give motrixsim's go1/scene.xml with --scene (git clone https://github.com/Motphys/motrixsim-docs)")
    if given.scene is not None:
        existing(given.scene, "scene")
    warnings.simplefilter("ignore", stepper.ModelWarning)
    tables = {
        "grasp": lambda: grasp(given.scene),
        "piles": lambda: piles(given.named, small=given.small),
        "go1": lambda: go1(given.scene, given.num_envs, given.steps, given.threads),
    }
    rows = []
    for row in tables[given.table]():
        rows.append(row)
        print("; ".join(f"{name} {shown(value)}" for name, value in row.items()), flush=True)
    if not rows:
        parser.error(f"no pile and engine is called {given.named!r}")
    suffix = "_published_scene" if given.table == "grasp" and given.scene else "_small" if given.small else ""
    print(write_rows(given.out / f"published_{given.table}{suffix}.csv", rows))


if __name__ == "__main__":
    main()
