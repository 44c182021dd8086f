"""Names of sensor types in the Rust crate (crates/model/src/sensor.rs), by MuJoCo's name, in one table per kind of sensor."""

from __future__ import annotations

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
