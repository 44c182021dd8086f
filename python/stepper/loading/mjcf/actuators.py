"""Description of the actuators of a compiled `mujoco.MjModel` (the Rust type is in crates/model/src/description.rs)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from stepper.loading.mjcf.source import Source

Description = dict[str, Any]

# Values of MuJoCo's enumerations (mjtype.h); a test compares them with the installed version.
TRN_JOINT, TRN_JOINT_IN_PARENT, TRN_SLIDER_CRANK, TRN_TENDON, TRN_SITE, TRN_BODY = range(6)
DYN_NONE, DYN_INTEGRATOR, DYN_FILTER, DYN_FILTER_EXACT, DYN_MUSCLE = range(5)
SIMULATED = (DYN_NONE, DYN_INTEGRATOR, DYN_FILTER, DYN_FILTER_EXACT, DYN_MUSCLE)
GAIN_FIXED, GAIN_AFFINE, GAIN_MUSCLE, GAIN_DCMOTOR, GAIN_PID = 0, 1, 2, 3, 5
BIAS_NONE, BIAS_AFFINE, BIAS_MUSCLE, BIAS_DCMOTOR = range(4)
GAIN_TYPES = {GAIN_FIXED: "Fixed", GAIN_AFFINE: "Affine", GAIN_MUSCLE: "Muscle"}
BIAS_TYPES = {BIAS_NONE: "None", BIAS_AFFINE: "Affine", BIAS_MUSCLE: "Muscle"}
INPUT_POS, INPUT_VEL, INPUT_VOLTAGE = 1, 2, 8
MUSCLE_PARAMETERS = 9
"""Number of parameters of the gain or bias of a muscle."""
PREVIOUS, LINEAR, CUBIC = range(3)
"""MuJoCo's values of the MJCF attribute `interp` (zoh, linear, cubic): interpolation between samples of a delayed control or reading."""


def reasons_to_omit(source: Source, a: int) -> list[str]:
    """Reasons why stepper cannot simulate an actuator, one text each; an empty list if it can. `a` is the index in MuJoCo's model."""
    m, mj = source.m, source.mujoco
    transmission, force = int(m.actuator_trntype[a]), force_of(source, a)

    def name_in(enum: str, value: int) -> str:
        return str(getattr(mj, enum)(value).name).split("_", 1)[1].lower()

    reasons = []
    if transmission > TRN_BODY:
        reasons.append(f"transmission {name_in('mjtTrn', transmission)}")
    elif transmission == TRN_BODY and _depends_on_motion(force):
        reasons.append("transmission body with a force that depends on its length or velocity")
    if force is None:
        if m.actuator_dyntype[a] not in SIMULATED:
            reasons.append(f"dynamics {name_in('mjtDyn', m.actuator_dyntype[a])}")
        if m.actuator_gaintype[a] not in GAIN_TYPES:
            reasons.append(f"gain {name_in('mjtGain', m.actuator_gaintype[a])}")
        if m.actuator_biastype[a] not in BIAS_TYPES:
            reasons.append(f"bias {name_in('mjtBias', m.actuator_biastype[a])}")
    if m.actuator_ctrlnum[a] != 1:
        reasons.append(f"{m.actuator_ctrlnum[a]} controls")
    if m.actuator_plugin[a] >= 0:
        reasons.append("a plugin")
    return reasons


def force_of(source: Source, a: int) -> Description | None:
    """Gain and bias of an actuator as a dictionary for the Rust library; None if stepper does not support the actuator."""
    m = source.m
    kinds = int(m.actuator_gaintype[a]), int(m.actuator_biastype[a])
    gain, bias, inputs = m.actuator_gainprm[a], m.actuator_biasprm[a], int(m.actuator_ctrlspec[a])
    if kinds == (GAIN_DCMOTOR, BIAS_DCMOTOR):
        # Torque K (u - K w) / R. The voltage limit (dynprm[1]) only concerns controllers. Other parameters (circuit, heat, cogging,
        # friction) are not supported.
        more = np.any(gain[2:]) or np.any(bias) or np.any(np.delete(m.actuator_dynprm[a], 1)) or m.actuator_actnum[a]
        return None if more or inputs != INPUT_VOLTAGE else _force([*gain[:2].tolist(), 0.0], [0.0, 0.0, 0.0], "DcMotor", "DcMotor")
    if m.actuator_dyntype[a] not in SIMULATED:
        return None
    if kinds == (GAIN_PID, BIAS_AFFINE) and m.actuator_dyntype[a] == DYN_NONE and inputs in (INPUT_POS, INPUT_VEL):
        return _force([0.0, 0.0, 0.0], bias[:3].tolist(), "PidPosition" if inputs == INPUT_POS else "PidVelocity", "Affine")
    if kinds[0] not in GAIN_TYPES or kinds[1] not in BIAS_TYPES:
        return None
    nothing = [0.0, 0.0, 0.0]
    factors = {GAIN_FIXED: [float(gain[0]), 0.0, 0.0], GAIN_AFFINE: gain[:3].tolist()}.get(kinds[0], nothing)
    offsets = bias[:3].tolist() if kinds[1] == BIAS_AFFINE else nothing
    force = _force(factors, offsets, GAIN_TYPES[kinds[0]], BIAS_TYPES[kinds[1]])
    if GAIN_MUSCLE in kinds[:1] or BIAS_MUSCLE in kinds[1:]:
        output = int(m.actuator_outadr[a])
        force["muscle"] = {
            "length_range": m.actuator_lengthrange[output].tolist(),
            "acceleration": float(m.actuator_acc0[output]),
            "gain": gain[:MUSCLE_PARAMETERS].tolist() if kinds[0] == GAIN_MUSCLE else [0.0] * MUSCLE_PARAMETERS,
            "bias": bias[:MUSCLE_PARAMETERS].tolist() if kinds[1] == BIAS_MUSCLE else [0.0] * MUSCLE_PARAMETERS,
        }
    return force


def _depends_on_motion(force: Description | None) -> bool:
    """Whether the force of an actuator depends on its length or velocity. `force` is the result of `force_of`."""
    return force is not None and ("muscle" in force or any(force["gain"][1:] + force["bias"][1:]))


def _force(gain: list[float], bias: list[float], gain_type: str, bias_type: str) -> Description:
    """Gain and bias of an actuator as a dictionary for the Rust library."""
    return {"gain": gain, "bias": bias, "force_model": {"gain": gain_type, "bias": bias_type, "disabled": False}}


def delay(source: Source, a: int) -> tuple[float, int]:
    """Delay of an actuator's control, s, and its interpolation: `PREVIOUS`, `LINEAR` or `CUBIC`.

    `a` is the index of the actuator in MuJoCo's model.
    """
    samples, between = (int(x) for x in source.m.actuator_history[a])
    step = float(source.m.opt.timestep)
    return delay_in_buffer(float(source.m.actuator_delay[a]), samples, step, step), between


def delay_in_buffer(delay: float, samples: int, interval: float, step: float) -> float:
    """Delay of a value that is read from a buffer of MuJoCo, s.

    The buffer has the values of earlier steps only. A delay is therefore at least one step, and at most the age of the oldest value.

    Args:
        delay: Nominal delay, s; 0 if the value is not delayed.
        samples: Number of values in the buffer.
        interval: Time between two values, s.
        step: Time step, s.
    """
    return min(max(delay, step), (samples - 1) * interval + step) if delay and samples else 0.0


def is_whole(time: float, step: float) -> bool:
    """Whether a time is a whole number of time steps, apart from rounding; both in s."""
    return abs(time / step - round(time / step)) < 1e-9 * (1 + time / step)


def actuator(source: Source, i: int) -> Description:
    """Actuator as a dictionary for the Rust library.

    Args:
        source: The compiled model.
        i: Index of the actuator in MuJoCo's model, one of `source.actuators`.
    """
    m = source.m
    ctrl, transmission = int(m.actuator_ctrladr[i]), _transmission(source, i)
    has_wrench = bool({"Site", "JointWrench"} & transmission.keys())
    group = int(m.actuator_group[i])
    disabled = source.off("actuation") or (0 <= group < 31 and bool(int(m.opt.disableactuator) >> group & 1))
    force = force_of(source, i)
    assert force is not None
    force["force_model"]["disabled"] = disabled
    clamps = bool(m.actuator_ctrllimited[ctrl]) and not source.off("clampctrl")
    late, between = delay(source, i)
    dynamics = activation(source, i)
    return {
        "name": source.name("ACTUATOR", i),
        "transmission": transmission,
        "gear": 1.0 if has_wrench else source.gear(i),
        "delay": late,
        "delay_holds": between == PREVIOUS,
        "ctrl_range": m.actuator_ctrlrange[ctrl].tolist() if clamps else None,
        "force_range": m.actuator_forcerange[i].tolist() if m.actuator_forcelimited[i] else None,
        "act_range": m.actuator_actrange[i].tolist() if m.actuator_actlimited[i] else None,
        "activation": dynamics,
        "early": bool(m.actuator_actearly[i]) and dynamics != "None",
        **force,
    }


def _transmission(source: Source, i: int) -> Description:
    """Transmission of an actuator (joint, tendon, site, body or slider-crank) as a dictionary for the Rust library."""
    m, kind = source.m, int(source.m.actuator_trntype[i])
    target, reference = m.actuator_trnid[i].tolist()
    wrench = m.actuator_gear[m.actuator_outadr[i]].tolist()
    if kind == TRN_SITE:
        return {"Site": {"site": target, "reference": reference if reference >= 0 else None, "wrench": wrench}}
    if kind in (TRN_JOINT, TRN_JOINT_IN_PARENT) and not source.is_hinge_or_slide(target):
        return {"JointWrench": {"joint": target, "in_parent": kind == TRN_JOINT_IN_PARENT, "wrench": wrench}}
    if kind == TRN_SLIDER_CRANK:
        return {"SliderCrank": {"crank": target, "slider": reference, "rod": float(m.actuator_cranklength[i])}}
    return {{TRN_TENDON: "Tendon", TRN_BODY: "Body"}.get(kind, "Joint"): target}


def activation(source: Source, i: int) -> str | Description:
    """Activation dynamics of an actuator, as a name or dictionary for the Rust library; time constants of filters are in s."""
    kind, (tau, fall, smoothing) = int(source.m.actuator_dyntype[i]), source.m.actuator_dynprm[i, :3].tolist()
    if kind == DYN_MUSCLE:
        return {"Muscle": {"rise": tau, "fall": fall, "smoothing": smoothing}}
    if kind == DYN_FILTER:
        return {"Filter": tau}
    if kind == DYN_FILTER_EXACT:
        return {"FilterExact": tau}
    return "Integrator" if kind == DYN_INTEGRATOR else "None"
