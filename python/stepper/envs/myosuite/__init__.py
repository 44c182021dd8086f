"""Tasks of MyoSuite, whose models are moved by muscles."""

from typing import Any

from stepper.envs.myosuite.pose import NUMERALS, MyoPose

_FIST = "0 0 0 .0824475 -.0904 -.681555 -.514888 0 -.013964 -.0458132 0 .67553 -.020944 .76979 .65982 0 0 0 0 .479155 -.099484 .95831 0"
_LEAST, _MOST = (tuple(map(end, zip(*NUMERALS, strict=True))) for end in (min, max))

MYOSUITE: dict[str, tuple[type[MyoPose], dict[str, Any]]] = {
    "ElbowPose1D6MFixed": (MyoPose, {"limb": "elbow", "target": (2.0,), "near": 0.175, "random_start": True}),
    "ElbowPose1D6MRandom": (MyoPose, {"limb": "elbow", "target": (0.0,), "highest": (2.27,), "near": 0.175, "random_start": True}),
    "HandPoseFixed": (MyoPose, {"limb": "hand", "target": tuple(map(float, _FIST.split())), "near": 0.7}),
    **{f"HandPose{k}Fixed": (MyoPose, {"limb": "hand", "target": pose, "near": 0.7}) for k, pose in enumerate(NUMERALS)},
    "HandPoseRandom": (MyoPose, {"limb": "hand", "target": _LEAST, "highest": _MOST, "near": 0.7, "random_start": True}),
}
"""Class and arguments of each task, by MyoSuite's names without "myo" and version."""

__all__ = ["MYOSUITE", "MyoPose"]
