"""Robots that others wrote, random states of them, and their MuJoCo counterparts; scenes of tests, which are files in tests/scenes."""

import functools
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import mujoco
import numpy as np
import stepper

FREE, BALL = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL)
STATE = [
    "qpos",
    "qvel",
    "act",
    "time",
    "ctrl",
    "status",
    "residual",
    "iterations",
    "max_penetration",
    "max_limit_violation",
    "max_equality_violation",
    "sensordata",
    "sensordata_ideal",
]
"""What a `Stepper` says of where it is and of its last call."""


def _package(name: str) -> Path:
    return Path(find_spec(name).submodule_search_locations[0])


def _sources() -> dict[str, Path]:
    folders = {"gymnasium": _package("gymnasium") / "envs/mujoco/assets", "dm_control": _package("dm_control") / "suite"}
    return {f"{package}/{file.stem}": file for package, folder in folders.items() for file in sorted(folder.glob("*.xml"))}


SOURCES = _sources()
"""Every MJCF of gymnasium and of the dm_control suite, as "package/name"."""


def mjcf(name: str) -> str:
    """Text of a scene."""
    return (Path(__file__).parents[1] / "scenes" / f"{name}.xml").read_text(encoding="utf-8")


@functools.cache
def mujoco_model(name: str) -> mujoco.MjModel:
    """The compiled model of a source; shared, so not to be written to."""
    return mujoco.MjModel.from_xml_path(str(SOURCES[name]))


@functools.cache
def stepper_model(name: str, *, strict: bool = True) -> stepper.Model:
    """The same in stepper."""
    return stepper.load(str(SOURCES[name]), strict=strict)


def simulate(
    model: stepper.Model | mujoco.MjModel | str, num_envs: int | None = None, *, precision="f64", qpos=None, qvel=None, steps=0, **settings
):
    """Stepper of a model, a compiled MuJoCo model or MJCF text, `steps` steps after a state; `settings`: fields of `Options`, threads."""
    if not isinstance(model, stepper.Model):
        model = stepper.load(model)
    options = {name: settings.pop(name) for name in set(settings) - {"threads", "seed", "sensors", "actuators"}}
    sim = stepper.Stepper(model, num_envs, options=stepper.Options(**options), precision=precision, **settings)
    if qpos is not None or qvel is not None:
        sim.set_state(qpos, qvel)
    if steps:
        sim.step(nstep=steps)
    return sim


def samples(sim: stepper.Stepper, steps: int, read: Callable, ctrl=None) -> np.ndarray:
    """What `read` returns after each of `steps` steps."""
    rows = []
    for _ in range(steps):
        sim.step(ctrl)
        rows.append(read())
    return np.array(rows)


def flags_of(sim: stepper.Stepper, steps: int) -> stepper.Status:
    """Flags of `steps` steps together."""
    found = stepper.Status.OK
    for _ in range(steps):
        sim.step()
        found |= stepper.Status(int(sim.status))
    return found


def afloat(name: str, *, gravity: bool = True) -> mujoco.MjModel:
    """A robot that nothing can touch: its contacts, its joint limits and, if asked, gravity are switched off."""
    model = mujoco.MjModel.from_xml_path(str(SOURCES[name]))
    model.geom_contype[:] = 0
    model.geom_conaffinity[:] = 0
    model.jnt_limited[:] = 0
    if not gravity:
        model.opt.gravity[:] = 0
    return model


def random_quaternion(rng: np.random.Generator) -> np.ndarray:
    """Uniform over rotations."""
    q = rng.normal(size=4)
    return q / np.linalg.norm(q)


def random_state(model: mujoco.MjModel, rng: np.random.Generator, speed: float = 2.0) -> tuple[np.ndarray, np.ndarray]:
    """Joint positions within their range or +-pi, uniform orientations, normal velocities."""
    qpos = np.zeros(model.nq)
    for j in range(model.njnt):
        at, kind = model.jnt_qposadr[j], model.jnt_type[j]
        if kind == FREE:
            qpos[at : at + 3] = rng.uniform(-1, 1, 3)
            qpos[at + 3 : at + 7] = random_quaternion(rng)
        elif kind == BALL:
            qpos[at : at + 4] = random_quaternion(rng)
        else:
            qpos[at] = rng.uniform(*(model.jnt_range[j] if model.jnt_limited[j] else (-np.pi, np.pi)))
    return qpos, rng.normal(scale=speed, size=model.nv)


def forward(model: mujoco.MjModel, qpos, qvel, ctrl=None, *, act=None, qfrc=None, xfrc=None, data=None) -> mujoco.MjData:
    """MuJoCo's data at a state; `data` of the same model is used again, because its memory takes longer than a step."""
    if data is None:
        data = mujoco.MjData(model)
    else:
        mujoco.mj_resetData(model, data)
    data.qpos[:], data.qvel[:] = qpos, qvel
    for target, given in [(data.ctrl, ctrl), (data.act, act), (data.qfrc_applied, qfrc), (data.xfrc_applied, xfrc)]:
        if given is not None:
            target[:] = given
    mujoco.mj_forward(model, data)
    return data


def full_mass_matrix(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """MuJoCo's mass matrix, dense."""
    out = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, out)
    return out


def force_of_world(contacts: np.ndarray) -> np.ndarray:
    """Sum of the contact forces of the world's geoms on others, in world axes. A normal points from the first body to the second."""
    sign = np.where(contacts["body"][:, 0] == 0, 1.0, -1.0) * (contacts["body"] == 0).any(axis=1)
    return np.einsum("k,ki,kij->j", sign, contacts["force"], contacts["frame"])


def contact_bits(contacts: np.ndarray) -> bytes:
    """Bits of contacts, whichever environment has them."""
    return b"".join(contacts[name].tobytes() for name in contacts.dtype.names if name != "env")
