"""Identification with `mujoco.sysid`, to compare it with stepper, from readings of motion that MuJoCo simulates.

The residual function has the samples and the noise of each sensor, so that both libraries minimise the same sum of squares. One setting has
MuJoCo's own optimizer (the default of `mujoco.sysid`), the other one SciPy's. Both use the default difference step, and `x_scale="jac"`,
which the documentation of `mujoco.sysid` advises for parameters of different sizes. Intervals come from `calculate_intervals`. Each search
has one initial value.
"""

from __future__ import annotations

import contextlib
import io
from typing import Any

import mujoco
import numpy as np
from mujoco import rollout
from stepper.shared.machine import require

from identification.repetitions import Answer, Readings
from identification.scenes import Scene

SETTINGS: dict[str, dict[str, Any]] = {
    "default": {"optimizer": "mujoco", "x_scale": "jac"},
    "SciPy": {"optimizer": "scipy", "x_scale": "jac"},
}
HOW = 'pip install "mujoco[sysid]"'


def available() -> str:
    """Reason why `mujoco.sysid` is not available. The text is empty if it is available."""
    try:
        module = require("mujoco.sysid", "to compare with it")
    except ImportError as error:
        return str(error)
    return "" if hasattr(module, "optimize") else f"packages that mujoco.sysid needs are missing: {HOW}"


def readings(scene: Scene) -> Readings:
    """Sensor readings by channel, (T, dim) each, of MuJoCo's simulation of a scene, at the end of each of the T control periods."""
    model = mujoco.MjModel.from_xml_string(scene.text(*scene.truth))
    data = mujoco.MjData(model)
    state = np.zeros(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    nstep = round(scene.period / model.opt.timestep)
    states, sensors = rollout.rollout(model, data, state[None], np.repeat(scene.ctrl, nstep, axis=0)[None])
    return {name: _of_sensor(model, name, states[0], sensors[0])[nstep - 1 :: nstep] for name in scene.noise}


def _of_sensor(model: Any, name: str, states: Any, sensors: Any) -> Any:
    """Readings of a sensor, (steps, dim), from MuJoCo's states and from the readings of all sensors, a row for each step."""
    sensor = model.sensor(name)
    if sensor.type[0] == mujoco.mjtSensor.mjSENS_JOINTPOS:
        # Position sensors lag by one step: the reading for the end of a step is in the next step.
        return states[:, 1 + model.jnt_qposadr[sensor.objid[0]]][:, None]
    return sensors[:, sensor.adr[0] : sensor.adr[0] + sensor.dim[0]]


def identified(scene: Scene, start: tuple[float, float], given: Readings, settings: dict[str, Any]) -> Answer:
    """Result of one identification by `mujoco.sysid`.

    Args:
        scene: The scene.
        start: Initial values of both parameters.
        given: Readings by channel.
        settings: Arguments of `mujoco.sysid.optimize`.
    """
    sysid = require("mujoco.sysid", "to compare with it")
    spec = mujoco.MjSpec.from_string(scene.text(*start))
    model = spec.compile()
    data = mujoco.MjData(model)
    nstep = round(scene.period / model.opt.timestep)
    times = (1 + np.arange(len(scene.ctrl) * nstep)) * model.opt.timestep
    geoms = scene.parameters[1].partition("[")[2].partition("]")[0].split(",")

    def set_mass(spec: Any, parameter: Any) -> None:
        spec.geom("box").mass = float(parameter.value[0])

    def set_friction(spec: Any, parameter: Any) -> None:
        for name in geoms:
            spec.geom(name).friction[0] = float(parameter.value[0])

    parameters = sysid.ParameterDict()
    for name, value, modifier in (("mass", start[0], set_mass), ("friction", start[1], set_friction)):
        parameters.add(sysid.Parameter(name, value, value / 20, value * 20, modifier=modifier))
    control = sysid.TimeSeries(times - model.opt.timestep, np.repeat(scene.ctrl, nstep, axis=0))
    sensors = sysid.TimeSeries.from_names(times, np.zeros((len(times), model.nsensordata)), model)
    initial = sysid.create_initial_state(model, data.qpos, data.qvel, data.act)
    sequences = sysid.ModelSequences("scene", spec, "measured", initial, control, sensors)
    sigma = np.concatenate([np.full(rows.shape[1], scene.noise[name]) for name, rows in given.items()])
    measured = np.concatenate(list(given.values()), axis=1)

    def compare(_: Any, predicted: Any, _measured: Any, model: Any, *_args: Any, state: Any, **_more: Any) -> tuple[Any, Any, Any]:
        columns = [_of_sensor(model, name, state, predicted.data) for name in given]
        rows = np.concatenate(columns, axis=1)[nstep - 1 :: nstep][: len(measured)]
        return (rows - measured[: len(rows)]) / sigma, predicted, predicted

    residual = sysid.build_residual_fn(models_sequences=[sequences], modify_residual=compare, resample_true=False)
    with contextlib.redirect_stdout(io.StringIO()):  # The optimizers print each iteration, even without `verbose`.
        best, result = sysid.optimize(parameters, residual, verbose=False, **settings)
    left, _, _ = residual(result.x, best)
    flat = np.concatenate([np.ravel(r) for r in left])
    _, half = sysid.calculate_intervals([flat], np.asarray(result.jac).reshape(len(flat), -1))
    values = np.array([best["mass"].value[0], best["friction"].value[0]])
    return values, values - half, values + half
