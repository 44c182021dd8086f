"""Engines that toss a free body onto a table: those of the atlas, Bullet and Drake, each with the parameters that are fitted."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import stepper
from atlas.engines import DEFAULTS, Mujoco, Rapier, Stepper
from atlas.mjcf import numbers
from atlas.world import DivergedError
from numpy.typing import NDArray
from stepper.lab.engines import MujocoEngine

from reality.data import HALF, PERIOD, Toss

Array = NDArray[np.float64]
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

    def corners(self) -> Array:
        """Centres of the balls that a cube with rounded corners has in its corners, (8, 3), m. On a plane it touches with these alone."""
        return (HALF - self.radius) * np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])

    def mjcf(self, geom: str, option: str = "") -> str:
        """Model of the table and the cube in MJCF."""
        sizes = f'<geom type="box" size="{numbers([HALF] * 3)}"/>'
        if self.radius:
            size = numbers([self.radius])
            sizes = "".join(f'<geom type="sphere" size="{size}" pos="{numbers(corner)}"/>' for corner in self.corners())
        return f"""<mujoco><option gravity="{numbers([0, 0, -self.gravity])}">{option}</option><default><geom {geom}/></default><worldbody>
          <geom type="plane" size="5 5 1" pos="{numbers([0, 0, self.offset])}"/><body name="cube"><freejoint/>
          <inertial pos="0 0 0" mass="{MASS}" diaginertia="{INERTIA} {INERTIA} {INERTIA}"/>{sizes}</body></worldbody></mujoco>"""


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

    Attributes:
        engine: The engine.
    """

    engine: Any = None

    def poses(self, values: dict[str, float], table: Table, tosses: Sequence[Toss], substeps: int) -> Array:
        """Simulated poses at the sample times, (tosses, samples, 7); see `TossEngine.poses`."""
        geom, option = f'friction="{values["friction"]!r} 0.001 0.001"', ""
        if "stiffness" in values:
            reference, impedance = numbers([-values["stiffness"], -values["damping"]]), numbers([values["impedance"]] * 2)
            geom += f' solref="{reference}" solimp="{impedance} 0.001 0.5 2"'
            option = '<flag refsafe="disable"/>'
        world = self.engine.start(table.mjcf(geom, option), PERIOD / substeps, len(tosses), restitution=values.get("restitution"))
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
class Compliant(TossEngine):
    """stepper with surfaces that are springs with dampers, as the table is in Bullet and Drake."""

    def poses(self, values: dict[str, float], table: Table, tosses: Sequence[Toss], substeps: int) -> Array:
        """Simulated poses at the sample times, (tosses, samples, 7); see `TossEngine.poses`."""
        model = stepper.load(table.mjcf(f'friction="{values["friction"]!r} 0 0"'))
        # Only the table is compliant.
        rest = np.ones(model.ngeom - 1)
        model = model.replace(geom_stiffness=np.r_[values["stiffness"], rest * np.inf], geom_damping=np.r_[values["damping"], 0.0 * rest])
        sim = stepper.Stepper(model, len(tosses), options=stepper.Options(timestep=PERIOD / substeps))
        sim.set_state(*states(tosses))
        made = [sim.qpos.copy()]
        for _ in range(max(len(toss.pose) for toss in tosses) - 1):
            sim.step(nstep=substeps)
            made.append(sim.qpos.copy())
        return np.stack(made, axis=1)


@dataclass(frozen=True)
class Bullet(TossEngine):
    """Engine Bullet (PyPI's pybullet), with compliant contact as in the published comparison: stiffness and damping of the table."""

    @cached_property
    def client(self) -> Any:
        """The module `pybullet`, connected to a simulation without a window."""
        import pybullet  # noqa: PLC0415  (optional)

        pybullet.connect(pybullet.DIRECT)
        return pybullet

    def poses(self, values: dict[str, float], table: Table, tosses: Sequence[Toss], substeps: int) -> Array:
        """Simulated poses at the sample times, (tosses, samples, 7); see `TossEngine.poses`."""
        p = self.client
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
        p.changeDynamics(
            plane, -1, lateralFriction=values["friction"], contactStiffness=values["stiffness"], contactDamping=values["damping"]
        )
        made = np.zeros((len(tosses), max(len(toss.pose) for toss in tosses), 7))
        for toss, rows in zip(tosses, made, strict=True):
            w, *v = toss.start[3:7]
            spin = np.asarray(p.multiplyTransforms([0, 0, 0], [*v, w], toss.start[10:].tolist(), [0, 0, 0, 1])[0])
            p.resetBasePositionAndOrientation(cube, toss.start[:3], [*v, w])
            p.resetBaseVelocity(cube, toss.start[7:10], spin)
            for number in range(len(toss.pose)):
                for _ in range(substeps if number else 0):
                    p.stepSimulation()
                place, (x, y, z, w) = p.getBasePositionAndOrientation(cube)
                rows[number] = [*place, w, x, y, z]
        return made


@dataclass(frozen=True)
class Drake(TossEngine):
    """Engine Drake (PyPI's drake), discrete with point contact and the approximation "similar" to Coulomb's law."""

    def poses(self, values: dict[str, float], table: Table, tosses: Sequence[Toss], substeps: int) -> Array:
        """Simulated poses at the sample times, (tosses, samples, 7); see `TossEngine.poses`."""
        from pydrake.all import (  # noqa: PLC0415  (optional)
            AddMultibodyPlant,
            CoulombFriction,
            DiagramBuilder,
            HalfSpace,
            MultibodyPlantConfig,
            RigidTransform,
            Simulator,
            SpatialInertia,
            Sphere,
            UnitInertia,
        )
        from pydrake.geometry import AddContactMaterial, ProximityProperties  # noqa: PLC0415  (optional)

        builder = DiagramBuilder()
        config = MultibodyPlantConfig(time_step=PERIOD / substeps, contact_model="point", discrete_contact_approximation="similar")
        plant, _ = AddMultibodyPlant(config, builder)
        plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, -table.gravity])
        body = plant.AddRigidBody("cube", SpatialInertia(MASS, [0, 0, 0], UnitInertia(*[INERTIA / MASS] * 3)))
        properties = ProximityProperties()
        AddContactMaterial(
            properties=properties,
            dissipation=values["dissipation"],
            point_stiffness=values["stiffness"],
            friction=CoulombFriction(values["friction"], values["friction"]),
        )
        plant.RegisterCollisionGeometry(plant.world_body(), RigidTransform([0, 0, table.offset]), HalfSpace(), "table", properties)
        # A box has one contact point with a half space in Drake, so the cube has small balls in its corners.
        rounded = replace(table, radius=table.radius or 1e-4)
        for k, corner in enumerate(rounded.corners()):
            plant.RegisterCollisionGeometry(body, RigidTransform(corner), Sphere(rounded.radius), f"corner{k}", properties)
        plant.Finalize()
        simulator = Simulator(builder.Build())
        context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
        made = np.zeros((len(tosses), max(len(toss.pose) for toss in tosses), 7))
        turned = stepper_axes(np.array([toss.start for toss in tosses]))
        for toss, spin, rows in zip(tosses, turned, made, strict=True):
            plant.SetPositions(context, np.r_[toss.start[3:7] / np.linalg.norm(toss.start[3:7]), toss.start[:3]])
            plant.SetVelocities(context, np.r_[spin, toss.start[7:10]])
            simulator.get_mutable_context().SetTime(0.0)
            simulator.Initialize()
            for number in range(len(toss.pose)):
                if number:
                    simulator.AdvanceTo(number * PERIOD)
                q = plant.GetPositions(context)
                rows[number] = np.r_[q[4:], q[:4]]
        return made


def states(tosses: Sequence[Toss]) -> tuple[Array, Array]:
    """Initial qpos, (tosses, nq), and qvel, (tosses, nq - 1), m, rad, m/s and rad/s; the only quaternion is that of a free joint."""
    start = np.array([toss.start for toss in tosses])
    nq = (start.shape[1] + 1) // 2
    return start[:, :nq], start[:, nq:]


def stepper_axes(starts: Array) -> Array:
    """Angular velocities in world axes, (n, 3), rad/s, of states (n, 13), whose angular velocities are in body axes."""
    w, v, spin = starts[:, 3:4], starts[:, 4:7], starts[:, 10:]
    twice = 2.0 * np.cross(v, spin)
    return np.asarray(spin + w * twice + np.cross(v, twice))


SOFT = {"log stiffness": (2.5, 5.5), "log damping": (0.7, 2.7)}
"""Bounds of MuJoCo's contact stiffness and damping, by name."""
_COMPLIANT = {"friction": (0.08, 0.35), "log stiffness": (2.5, 4.5), "log damping": (0.3, 2.5)}
_RIGID = {"friction": (0.08, 0.35), "restitution": (0.0, 0.4)}


def engines() -> list[TossEngine]:
    """All engines of the comparison whose packages are installed."""
    fitted = {"friction": (0.08, 0.45), **SOFT, "impedance": (0.5, 0.98)}
    made: list[TossEngine] = [
        OfAtlas("stepper", _RIGID, engine=Stepper("stepper")),
        Compliant("stepper, compliant table", _COMPLIANT),
        OfAtlas("MuJoCo, pyramidal cone", fitted, 2, Mujoco("MuJoCo", MujocoEngine("pyramidal", DEFAULTS))),
        OfAtlas("MuJoCo, elliptic cone", fitted, 2, Mujoco("MuJoCo", MujocoEngine("elliptic", DEFAULTS | {"cone": "elliptic"}))),
    ]
    for module, engine in (
        ("rapier3d", OfAtlas("rapier", _RIGID, 6, Rapier("rapier"))),
        ("pybullet", Bullet("Bullet", _COMPLIANT | {"friction": (0.1, 0.9)})),
        ("pydrake", Drake("Drake", {"friction": (0.05, 0.4), "log stiffness": (3.0, 5.5), "dissipation": (0.0, 2.0)}, 6)),
    ):
        try:
            __import__(module)
        except ModuleNotFoundError:
            continue
        made.append(engine)
    return made
