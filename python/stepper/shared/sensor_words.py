"""Names of sensor types in the Rust crate (crates/model/src/sensor.rs), by MuJoCo's name, in one table per kind of sensor.

And the texts of `Model.omitted` on sensors without readings.
"""

from __future__ import annotations

from collections.abc import Iterable

JOINTS = {
    "jointpos": "JointPos",
    "jointvel": "JointVel",
    "jointactfrc": "JointActuatorForce",
    "jointlimitpos": "JointLimitPos",
    "jointlimitvel": "JointLimitVel",
    "jointlimitfrc": "JointLimitForce",
    "ballquat": "BallQuat",
    "ballangvel": "BallAngVel",
}
TENDONS = {
    "tendonpos": "TendonPos",
    "tendonvel": "TendonVel",
    "tendonactfrc": "TendonActuatorForce",
    "tendonlimitpos": "TendonLimitPos",
    "tendonlimitvel": "TendonLimitVel",
    "tendonlimitfrc": "TendonLimitForce",
}
ACTUATORS = {"actuatorpos": "ActuatorPos", "actuatorvel": "ActuatorVel", "actuatorfrc": "ActuatorForce"}
SITES = {
    "magnetometer": "Magnetometer",
    "velocimeter": "Velocimeter",
    "gyro": "Gyro",
    "accelerometer": "Accelerometer",
    "force": "Force",
    "torque": "Torque",
    "touch": "Touch",
}
FRAMES = {
    "framepos": "Pos",
    "framequat": "Quat",
    "framexaxis": "XAxis",
    "frameyaxis": "YAxis",
    "framezaxis": "ZAxis",
    "framelinvel": "LinVel",
    "frameangvel": "AngVel",
    "framelinacc": "LinAcc",
    "frameangacc": "AngAcc",
}
SUBTREES = {"subtreecom": "SubtreeCom", "subtreelinvel": "SubtreeLinVel", "subtreeangmom": "SubtreeAngMom"}
PROXIMITIES = {"geomdist": "Distance", "geomnormal": "Normal", "geomfromto": "FromTo"}
SCENE = {"e_potential": "PotentialEnergy", "e_kinetic": "KineticEnergy", "clock": "Clock"}

_NOT_READ = "not read: "
_SHORTER = "; nsensordata is smaller"


def not_read(reason: object) -> str:
    """Text in `Model.omitted` on a sensor without readings. `reason` is why it has none."""
    return f"{_NOT_READ}{reason}{_SHORTER}"


def unread(omitted: Iterable[tuple[str, str, str]]) -> list[str]:
    """Lines on the sensors without readings in `Model.omitted`: type, name and reason."""
    return [
        f"{kind.removeprefix('sensor ')} {label}: {text.removeprefix(_NOT_READ).removesuffix(_SHORTER)}"
        for kind, label, text in omitted
        if text.startswith(_NOT_READ)
    ]
