"""Engines that toss a free body onto a table: those of the atlas, Bullet and Drake, each with the parameters that are fitted."""

import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache
from importlib.util import find_spec
from typing import Any

import numpy as np
import stepper
from atlas.engines import DEFAULTS, Mujoco, Rapier, Stepper
from atlas.mjcf import numbers
from atlas.world import DivergedError
from numpy.typing import ArrayLike, NDArray
from stepper.lab.engines import MujocoEngine
from stepper.shared.rotations import matrices

from reality.data import HALF, PERIOD, Toss, unit

Array = NDArray[np.float64]
Motion = Callable[[Array, Array, Array, Array], Iterator[Array]]
MASS, INERTIA = 0.37, 0.00081
"""Mass of the cube, kg, and its moments of inertia, kg m^2."""


@dataclass(frozen=True)
class Table:
    """Differences of the experiment from its nominal description, the same for all engines.

    Attributes:
        gravity: Gravity with the nominal sample period, m/s^2. A clock or length with an error changes it.
        offset: Height of the table, m.
        radius: Radius of the cube's corners, m; 0 makes a box with sharp corners.
    """

    gravity: float = 9.81
    offset: float = 0.0
    radius: float = 0.0

    def corners(self, half: ArrayLike = HALF) -> Array:
        """Centres of the balls that a box with rounded corners has in its corners, (8, 3), m. On a plane it touches with these alone."""
        signs: Array = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
        return signs * (np.asarray(half) - self.radius)

    def box(self, half: ArrayLike = HALF, centre: ArrayLike = 0.0) -> str:
        """Geoms of a box in MJCF, from its half widths and its centre, (3,) or a number for all, m. It has balls in rounded corners."""
        half, centre = np.broadcast_to(half, 3), np.broadcast_to(centre, 3)
        if not self.radius:
            return f'<geom type="box" size="{numbers(half)}" pos="{numbers(centre)}"/>'
        return "".join(f'<geom type="sphere" size="{self.radius!r}" pos="{numbers(corner)}"/>' for corner in self.corners(half) + centre)

    def mjcf(self, geom: str, option: str = "") -> str:
        """Model of the table and the cube in MJCF."""
        return f"""<mujoco><option gravity="{numbers([0, 0, -self.gravity])}">{option}</option><default><geom {geom}/></default><worldbody>
          <geom type="plane" size="5 5 1" pos="{numbers([0, 0, self.offset])}"/><body name="cube"><freejoint/>
          <inertial pos="0 0 0" mass="{MASS}" diaginertia="{INERTIA} {INERTIA} {INERTIA}"/>{self.box()}</body></worldbody></mujoco>"""


@dataclass(frozen=True)
class TossEngine(ABC):
    """Engine with parameters that are fitted to tosses.

    Attributes:
        name: Name in tables.
        bounds: Bounds of each fitted parameter by name. Parameters whose name begins with "log " are decimal logarithms.
        stride: Every how many-th toss is used in fits. Engines that step one environment at a time use fewer tosses.
    """

    name: str
    bounds: dict[str, tuple[float, float]]
    stride: int = 1

    def values(self, sample: Array) -> dict[str, float]:
        """Values of the parameters by name, from a sample in the order of `bounds`, (parameters,)."""
        pairs = zip(self.bounds, sample.tolist(), strict=True)
        return {name.removeprefix("log "): 10.0**value if name.startswith("log ") else value for name, value in pairs}

    @abstractmethod
    def poses(self, values: dict[str, float], table: Table, tosses: Sequence[Toss], substeps: int) -> Array:
        """Simulated poses at the sample times, (tosses, samples, 7); samples after the end of a toss are unused."""


@dataclass(frozen=True)
class OfAtlas(TossEngine):
    """Engine of the failure atlas: stepper, MuJoCo or rapier. All tosses are one batch.

    In stepper, stiffness and damping make the table a spring with a damper, as in Bullet and Drake.

    Attributes:
        engine: The engine.
    """

    engine: Any = None

    def poses(self, values: dict[str, float], table: Table, tosses: Sequence[Toss], substeps: int) -> Array:
        """Simulated poses at the sample times, (tosses, samples, 7); see `TossEngine.poses`."""
        geom, option = f'friction="{values["friction"]!r} 0.001 0.001"', ""
        if "impedance" in values:
            reference, impedance = numbers([-values["stiffness"], -values["damping"]]), numbers([values["impedance"]] * 2)
            geom += f' solref="{reference}" solimp="{impedance} 0.001 0.5 2"'
            option = '<flag refsafe="disable"/>'
        world = self.engine.start(table.mjcf(geom, option), PERIOD / substeps, len(tosses), restitution=values.get("restitution"))
        if "stiffness" in values and "impedance" not in values:
            # Only the table is compliant.
            model, rest = world.sim.model, np.ones(world.sim.model.ngeom - 1)
            soft = model.replace(
                geom_stiffness=np.r_[values["stiffness"], rest * np.inf], geom_damping=np.r_[values["damping"], 0.0 * rest]
            )
            world.sim = stepper.Stepper(soft, len(tosses), options=world.sim.options)
        world.set(*states(tosses))
        made = np.full((len(tosses), max(len(toss.pose) for toss in tosses), world.qpos.shape[1]), np.nan)
        # A run that diverges has NaN from there on.
        with suppress(DivergedError):
            for number in range(made.shape[1]):
                if number:
                    world.step(substeps)
                made[:, number] = world.qpos
        return made


@dataclass(frozen=True)
class OneByOne(TossEngine):
    """Engine that simulates one toss after the other.

    Attributes:
        motion: Function of the fitted parameters, the model, and the number of time steps per sample. It returns a function of a position,
            m, orientation (w, x, y, z), velocity, m/s, and angular velocity, rad/s, in world axes, that yields the poses at the sample
            times, (7,).
    """

    motion: Callable[[dict[str, float], Table, int], Motion] = field(kw_only=True)

    def poses(self, values: dict[str, float], table: Table, tosses: Sequence[Toss], substeps: int) -> Array:
        """Simulated poses at the sample times, (tosses, samples, 7); see `TossEngine.poses`."""
        made = np.full((len(tosses), max(len(toss.pose) for toss in tosses), 7), np.nan)
        motion = self.motion(values, table, substeps)
        for toss, rows in zip(tosses, made, strict=True):
            q = unit(toss.start[3:7])
            samples = motion(toss.start[:3], q, toss.start[7:10], matrices(q) @ toss.start[10:])
            rows[: len(toss.pose)] = list(itertools.islice(samples, len(toss.pose)))
        return made


@cache
def _bullet() -> Any:
    """The module `pybullet`, connected to a simulation without a window."""
    import pybullet  # noqa: PLC0415  (optional)

    pybullet.connect(pybullet.DIRECT)
    return pybullet


def bullet(values: dict[str, float], table: Table, substeps: int) -> Motion:
    """Tosses in Bullet, with compliant contact as in the published comparison: stiffness and damping of the table."""
    p = _bullet()
    p.resetSimulation()
    p.setGravity(0.0, 0.0, -table.gravity)
    p.setTimeStep(PERIOD / substeps)
    plane = p.createMultiBody(0.0, p.createCollisionShape(p.GEOM_BOX, halfExtents=[5, 5, 1]), basePosition=[0, 0, table.offset - 1.0])
    if table.radius:
        corners = table.corners().tolist()
        shape = p.createCollisionShapeArray(
            shapeTypes=[p.GEOM_SPHERE] * 8, radii=[table.radius] * 8, collisionFramePositions=corners, halfExtents=[[0, 0, 0]] * 8
        )
    else:
        shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[HALF] * 3)
    cube = p.createMultiBody(MASS, shape)
    p.changeDynamics(cube, -1, localInertiaDiagonal=[INERTIA] * 3, linearDamping=0.0, angularDamping=0.0, lateralFriction=0.5)
    p.changeDynamics(plane, -1, lateralFriction=values["friction"], contactStiffness=values["stiffness"], contactDamping=values["damping"])

    def toss(place: Array, q: Array, velocity: Array, spin: Array) -> Iterator[Array]:
        p.resetBasePositionAndOrientation(cube, place, np.roll(q, -1))
        p.resetBaseVelocity(cube, velocity, spin)
        while True:
            at, (x, y, z, w) = p.getBasePositionAndOrientation(cube)
            yield np.array([*at, w, x, y, z])
            for _ in range(substeps):
                p.stepSimulation()

    return toss


def drake_tosses(values: dict[str, float], table: Table, substeps: int) -> Motion:
    """Tosses in Drake, discrete with point contact and the approximation "similar" to Coulomb's law."""
    import pydrake.all as drake  # noqa: PLC0415  (optional)

    builder = drake.DiagramBuilder()
    config = drake.MultibodyPlantConfig(time_step=PERIOD / substeps, contact_model="point", discrete_contact_approximation="similar")
    plant, _ = drake.AddMultibodyPlant(config, builder)
    plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, -table.gravity])
    body = plant.AddRigidBody("cube", drake.SpatialInertia(MASS, [0, 0, 0], drake.UnitInertia(*[INERTIA / MASS] * 3)))
    properties = drake.ProximityProperties()
    drake.AddContactMaterial(
        properties=properties,
        dissipation=values["dissipation"],
        point_stiffness=values["stiffness"],
        friction=drake.CoulombFriction(values["friction"], values["friction"]),
    )
    plant.RegisterCollisionGeometry(plant.world_body(), drake.RigidTransform([0, 0, table.offset]), drake.HalfSpace(), "table", properties)
    # A box has one contact point with a half space in Drake, so the cube has small balls in its corners.
    rounded = replace(table, radius=table.radius or 1e-4)
    for k, corner in enumerate(rounded.corners()):
        plant.RegisterCollisionGeometry(body, drake.RigidTransform(corner), drake.Sphere(rounded.radius), f"corner{k}", properties)
    plant.Finalize()
    simulator = drake.Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())

    def toss(place: Array, q: Array, velocity: Array, spin: Array) -> Iterator[Array]:
        plant.SetPositions(context, np.r_[q, place])
        plant.SetVelocities(context, np.r_[spin, velocity])
        simulator.get_mutable_context().SetTime(0.0)
        simulator.Initialize()
        for number in itertools.count(1):
            yield np.roll(plant.GetPositions(context), 3)
            simulator.AdvanceTo(number * PERIOD)

    return toss


def states(tosses: Sequence[Toss]) -> tuple[Array, Array]:
    """Initial qpos, (tosses, nq), and qvel, (tosses, nq - 1), m, rad, m/s and rad/s; the only quaternion is that of a free joint."""
    start = np.array([toss.start for toss in tosses])
    nq = (start.shape[1] + 1) // 2
    return start[:, :nq], start[:, nq:]


SOFT = {"log stiffness": (2.5, 5.5), "log damping": (0.7, 2.7)}
"""Bounds of MuJoCo's contact stiffness and damping, by name."""
_COMPLIANT = {"friction": (0.08, 0.35), "log stiffness": (2.5, 4.5), "log damping": (0.3, 2.5)}
_DISSIPATIVE = {"friction": (0.05, 0.4), "log stiffness": (3.0, 5.5), "dissipation": (0.0, 2.0)}
_RIGID = {"friction": (0.08, 0.35), "restitution": (0.0, 0.4)}


def engines() -> list[TossEngine]:
    """All engines of the comparison whose packages are installed."""
    fitted = {"friction": (0.08, 0.45), **SOFT, "impedance": (0.5, 0.98)}
    made: list[TossEngine] = [
        OfAtlas("stepper", _RIGID, engine=Stepper("stepper")),
        OfAtlas("stepper, compliant table", _COMPLIANT, engine=Stepper("stepper")),
        OfAtlas("MuJoCo, pyramidal cone", fitted, 2, Mujoco("MuJoCo", MujocoEngine("pyramidal", DEFAULTS))),
        OfAtlas("MuJoCo, elliptic cone", fitted, 2, Mujoco("MuJoCo", MujocoEngine("elliptic", DEFAULTS | {"cone": "elliptic"}))),
    ]
    optional: dict[str, TossEngine] = {
        "rapier3d": OfAtlas("rapier", _RIGID, 6, Rapier("rapier")),
        "pybullet": OneByOne("Bullet", _COMPLIANT | {"friction": (0.1, 0.9)}, motion=bullet),
        "pydrake": OneByOne("Drake", _DISSIPATIVE, 6, motion=drake_tosses),
    }
    return made + [engine for module, engine in optional.items() if find_spec(module)]
