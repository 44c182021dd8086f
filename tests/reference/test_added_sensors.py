"""Sensors that are added to a loaded model read, bit for bit, what those of its file read."""

import mujoco
import numpy as np
import pytest
import stepper
from reference.test_mujoco_sensors import instrumented
from stepper.shared.sensor_words import ACTUATORS, FRAMES, JOINTS, SCENE, SITES, SUBTREES, TENDONS

OBJECTS = mujoco.mjtObj
NAMED = {
    OBJECTS.mjOBJ_JOINT: "joint",
    OBJECTS.mjOBJ_TENDON: "tendon",
    OBJECTS.mjOBJ_ACTUATOR: "actuator",
    OBJECTS.mjOBJ_SITE: "site",
    OBJECTS.mjOBJ_XBODY: "body",
    OBJECTS.mjOBJ_GEOM: "geom",
}


def written_again(m):
    """Every sensor of a compiled model as a `SensorSpec`, by the word of its type; without those that have no word there."""
    known = {**JOINTS, **TENDONS, **ACTUATORS, **SITES, **SUBTREES, **FRAMES, **SCENE}
    readings = {}
    for i in range(m.nsensor):
        word = mujoco.mjtSensor(int(m.sensor_type[i])).name.removeprefix("mjSENS_").lower()
        if word not in known:
            continue
        of = {}
        for prefix, objtype, index in (
            ("", m.sensor_objtype[i], m.sensor_objid[i]),
            ("reference_", m.sensor_reftype[i], m.sensor_refid[i]),
        ):
            if index >= 0 and objtype != OBJECTS.mjOBJ_UNKNOWN and not (prefix and word not in FRAMES):
                kind = OBJECTS(int(objtype))
                name = mujoco.mj_id2name(m, OBJECTS.mjOBJ_BODY if kind == OBJECTS.mjOBJ_XBODY else kind, index)
                what = "inertial" if kind == OBJECTS.mjOBJ_BODY and word in FRAMES else NAMED.get(kind, "body")
                of[f"{prefix}{what}"] = name
        readings[mujoco.mj_id2name(m, OBJECTS.mjOBJ_SENSOR, i)] = stepper.sensors.SensorSpec(type=word, **of)
    return readings


@pytest.mark.parametrize("name", ["assorted", "gymnasium/humanoid", "dm_control/quadruped", "dm_control/manipulator"])
def test_what_is_added_reads_what_the_file_has(name):
    m = instrumented(name)
    model = stepper.load(m, strict=False)
    readings = written_again(m)
    readings = {name: reading for name, reading in readings.items() if name in model.sensor_names}
    more = model.with_sensors({f"added {name}": reading for name, reading in readings.items()})
    sim = stepper.Stepper(more, 4)
    rng = np.random.default_rng(0)
    for _ in range(5):
        sim.set_state(qvel=rng.normal(size=(4, model.nv)))
        sim.step(rng.uniform(-1, 1, (4, model.nu)), nstep=3)
        for sensor in readings:
            file, added = (sim.read("sensordata_ideal", which) for which in (sensor, f"added {sensor}"))
            np.testing.assert_array_equal(added, file, f"{sensor}: {readings[sensor]}")
    assert len({reading.type for reading in readings.values()}) > 20


HAND = """<mujoco><worldbody><body name="arm"><joint name="hinge"/><geom name="link" size=".1" pos=".3 0 0"/><site name="tip" pos=".4 0 0"/>
  </body></worldbody><actuator><motor name="motor" joint="hinge"/></actuator><sensor><clock name="now"/></sensor></mujoco>"""


@pytest.mark.parametrize(("reading", "said"), [
    ({"type": "framepose", "site": "tip"}, "sensor 'new': there is no type 'framepose'; the types are: jointpos"),
    ({"type": "framepos"}, "type framepos needs one of body, inertial, geom, site, and none is given"),
    ({"type": "framepos", "site": "tip", "body": "arm"}, "type framepos needs one of body, inertial, geom, site, and site, body is given"),
    ({"type": "gyro", "body": "arm"}, "type gyro needs site, and body is given"),
    ({"type": "clock", "body": "arm"}, "type clock needs no element, and body is given"),
    ({"type": "gyro", "site": "top"}, "there is no site 'top'; the names are: tip"),
    ({"type": "jointpos", "joint": "hinge", "reference_site": "tip"}, "type jointpos has no reference, and reference_site is given"),
    ({"type": "framelinacc", "site": "tip", "reference_body": "arm"}, "type framelinacc has no reference"),
    ({"type": "framepos", "site": "tip", "reference_body": "arm", "reference_geom": "link"}, "type framepos has at most one reference"),
    ({"type": "framepos", "site": "tip", "reference_body": "hand"}, "there is no body 'hand'; the names are: world, arm"),
])  # fmt: skip
def test_what_is_wrong_is_said(reading, said):
    with pytest.raises(ValueError, match=said):
        stepper.load(HAND).with_sensors({"new": stepper.sensors.SensorSpec(**reading)})


def test_what_is_added_has_errors_of_its_own():
    model = stepper.load(HAND).with_sensors({"hand": stepper.sensors.SensorSpec(type="framepos", site="tip")})
    sim = stepper.Stepper(model, 2, sensors=stepper.SensorModel({"hand": stepper.Transfer(bias=0.5)}))
    np.testing.assert_array_equal(sim.read("sensordata_ideal", "hand"), [[0.4, 0, 0]] * 2)
    np.testing.assert_array_equal(sim.read("sensordata", "hand"), [[0.9, 0.5, 0.5]] * 2)
