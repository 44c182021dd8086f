"""Sensors against MuJoCo's, where the physics is the same: smooth states, without contacts and limits.

Accelerations and forces are those of a step, (v+ - v) / h; a step of Euler's rule without joint damping has exactly MuJoCo's acceleration,
up to the rounding of v, 1e-16 |v| / h = 1e-12 at the time steps of these models.
"""

from pathlib import Path

import mujoco
import numpy as np
import pytest
import stepper
from checks import every, raises
from models import SOURCES, forward, mjcf, random_quaternion, random_state, simulate
from stepper.loading.mjcf.sensors import MISSING
from stepper.shared.sensor_words import ACTUATORS, FRAMES, JOINTS, PROXIMITIES, SCENE, SITES, SUBTREES, TENDONS

BOUND = 1e-9  # Asked for by issue 4.
OBJECTS = ("body", "xbody", "geom", "site")
FRAME = ("framepos", "framequat", "framexaxis", "frameyaxis", "framezaxis", "framelinvel", "frameangvel")
ASSORTED = mjcf("assorted_sensors")

CHOSEN = [
    "assorted",
    "gymnasium/humanoid", "gymnasium/ant", "gymnasium/pusher_v5", "gymnasium/reacher", "gymnasium/half_cheetah",
    "dm_control/humanoid", "dm_control/dog", "dm_control/quadruped", "dm_control/manipulator", "dm_control/swimmer", "dm_control/cartpole",
]  # fmt: skip
LIMITED = """
<mujoco><option timestep="0.001"/><worldbody><body><joint name="lift" type="slide" axis="0 0 1" limited="true" range="-.2 .3"/>
  <geom size=".1" mass="2"/>
  <body pos="1 0 0"><joint name="other" type="slide" axis="0 0 1"/><geom size=".1" mass="3"/></body></body></worldbody>
<tendon><fixed name="rope" limited="true" range="-.5 .4"><joint joint="lift" coef="2"/><joint joint="other" coef="-1"/></fixed></tendon>
<sensor><jointlimitpos joint="lift"/><jointlimitvel joint="lift"/><jointlimitfrc joint="lift"/>
  <tendonlimitpos tendon="rope"/><tendonlimitvel tendon="rope"/><tendonlimitfrc tendon="rope"/></sensor></mujoco>"""
HAND = """<mujoco><worldbody><body name="arm"><joint name="hinge"/><geom name="link" size=".1" pos=".3 0 0"/><site name="tip" pos=".4 0 0"/>
  </body></worldbody><actuator><motor name="motor" joint="hinge"/></actuator><sensor><clock name="now"/></sensor></mujoco>"""
SHAPES = """
<mujoco><worldbody>
  <geom name="plane" type="plane" size="0 0 1" pos="0 0 -1" euler="10 5 0"/>
  <body name="eye" pos="0 0 .5"><freejoint/><geom name="eye" size=".05" mass="1" contype="0" conaffinity="0"/>
    <site name="eye" pos=".1 0 0" euler="10 0 0"/></body>
  <body pos="1 0 0"><freejoint/><geom name="capsule" type="capsule" size=".2 .3" contype="0" conaffinity="0"/></body>
  <body pos="0 1 0"><freejoint/><geom name="box" type="box" size=".3 .2 .1" contype="0" conaffinity="0"/></body>
  <body pos="-1 0 0"><freejoint/><geom name="cylinder" type="cylinder" size=".2 .3" contype="0" conaffinity="0"/></body>
  <body pos="0 -1 0"><freejoint/><geom name="ellipsoid" type="ellipsoid" size=".3 .2 .1" contype="0" conaffinity="0"/></body>
  <body pos="0 0 1"><freejoint/><geom name="sphere" type="sphere" size=".2" contype="0" conaffinity="0"/></body>
  <geom name="unseen" type="sphere" size="3" rgba="0 0 0 0" contype="0" conaffinity="0"/>
</worldbody><sensor>
  <rangefinder site="eye" data="dist dir origin point"/>
  {proximity}
</sensor></mujoco>"""


def instrumented(name: str) -> mujoco.MjModel:  # noqa: PLR0912  (a list of sensors)
    """A robot afloat with one of every smooth sensor on everything that it fits."""
    spec = mujoco.MjSpec.from_string(ASSORTED) if name == "assorted" else mujoco.MjSpec.from_file(str(SOURCES[name]))
    for sensor in list(spec.sensors):
        spec.delete(sensor)
    kinds, objects = mujoco.mjtSensor, mujoco.mjtObj
    rng = np.random.default_rng(7)
    bodies = [b for b in spec.bodies if b.name != "world"]
    for k, body in enumerate(bodies):
        body.name = body.name or f"body{k}"
        body.add_site(name=f"probe{k}", pos=rng.normal(size=3) * 0.1, quat=random_quaternion(rng), size=[0.3, 0.2, 0.1])
        # A body that is welded, with mass: a force sensor between it and its parent.
        extra = body.add_body(name=f"pod{k}", pos=rng.normal(size=3) * 0.1, quat=random_quaternion(rng))
        extra.add_geom(name=f"podgeom{k}", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.03, 0, 0], fromto=[np.nan] * 6,
                       contype=0, conaffinity=0, mass=0.1)  # fmt: skip
        extra.add_site(name=f"podsite{k}", pos=rng.normal(size=3) * 0.1, quat=random_quaternion(rng))

    def add(kind: str, objtype, objname: str, reference: tuple[object, str] | None = None) -> None:
        sensor = spec.add_sensor(
            name=f"s{len(spec.sensors)}", type=getattr(kinds, f"mjSENS_{kind.upper()}"), objtype=objtype, objname=objname
        )
        if reference:
            sensor.reftype, sensor.refname = reference

    for joint in spec.joints:
        joint.name = joint.name or f"joint{len(spec.sensors)}"
        if joint.type in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
            for kind in ("jointpos", "jointvel", "jointactfrc"):
                add(kind, objects.mjOBJ_JOINT, joint.name)
        elif joint.type == mujoco.mjtJoint.mjJNT_BALL:
            for kind in ("ballquat", "ballangvel"):
                add(kind, objects.mjOBJ_JOINT, joint.name)
    for k, body in enumerate(bodies):
        for kind in ("magnetometer", "velocimeter", "gyro", "accelerometer", "force", "torque"):
            add(kind, objects.mjOBJ_SITE, f"probe{k}")
            add(kind, objects.mjOBJ_SITE, f"podsite{k}")
        named = [(objects.mjOBJ_BODY, body.name), (objects.mjOBJ_XBODY, body.name), (objects.mjOBJ_SITE, f"probe{k}"),
                 (objects.mjOBJ_GEOM, f"podgeom{k}")]  # fmt: skip
        other = bodies[(k * 5 + 3) % len(bodies)]
        references = [None, (objects.mjOBJ_XBODY, other.name), (objects.mjOBJ_BODY, other.name), (objects.mjOBJ_SITE, "podsite0")]
        for i, kind in enumerate(FRAME):
            add(kind, *named[(k + i) % 4], references[(k // 4 + i) % 4])
            add(kind, *named[(k + i) % 4], references[(k // 4 + i + 1) % 4])
        for kind in ("framelinacc", "frameangacc"):
            add(kind, *named[k % 4])
        for kind in ("subtreecom", "subtreelinvel", "subtreeangmom"):
            add(kind, objects.mjOBJ_BODY, body.name)
        sensor = spec.add_sensor(name=f"inside{k}", type=kinds.mjSENS_INSIDESITE, objtype=objects.mjOBJ_XBODY, objname=other.name)
        sensor.reftype, sensor.refname = objects.mjOBJ_SITE, f"probe{k}"
    for actuator in spec.actuators:
        actuator.name = actuator.name or f"actuator{len(spec.sensors)}"
        for kind in ("actuatorpos", "actuatorvel", "actuatorfrc"):
            add(kind, objects.mjOBJ_ACTUATOR, actuator.name)
    for tendon in spec.tendons:
        for kind in ("tendonpos", "tendonvel", "tendonactfrc"):
            add(kind, objects.mjOBJ_TENDON, tendon.name)
    for kind in ("e_potential", "e_kinetic", "clock"):
        add(kind, objects.mjOBJ_UNKNOWN, "")
    model = spec.compile()
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS | mujoco.mjtDisableBit.mjDSBL_DAMPER)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
    model.opt.magnetic[:] = [0.2, -0.5, 0.3]
    return model


def readings(mujoco_model, model, data) -> tuple[np.ndarray, list[str]]:
    """MuJoCo's readings of the sensors that stepper has, and the type of each number."""
    kept, words = [], []
    left_out = {name for kind, name, _ in model.omitted if kind.startswith("sensor ")}
    for i in range(mujoco_model.nsensor):
        name = mujoco.mj_id2name(mujoco_model, mujoco.mjtObj.mjOBJ_SENSOR, i) or f"#{i}"
        if name in left_out:
            continue
        at, dim = mujoco_model.sensor_adr[i], mujoco_model.sensor_dim[i]
        kept.append(data.sensordata[at : at + dim])
        words += [mujoco.mjtSensor(int(mujoco_model.sensor_type[i])).name[7:].lower()] * dim
    return np.concatenate(kept), words


@pytest.mark.parametrize("name", CHOSEN)
def test_every_smooth_sensor_reads_what_mujocos_does(name):
    compiled = instrumented(name)
    compiled.opt.density = compiled.opt.viscosity = 0
    model = stepper.load(compiled, strict=False)
    sim = simulate(model, integrator="euler")
    rng = np.random.default_rng(list(name.encode()))
    for _ in range(3):
        state = random_state(compiled, rng)
        xfrc = rng.normal(size=(compiled.nbody, 6))
        sim.reset()
        sim.set_state(*state)
        sim.xfrc_applied[:] = xfrc
        # The step that would be made is under no control: servos act all the same.
        expected, words = readings(compiled, model, forward(compiled, *state, xfrc=xfrc))
        found = sim.sensordata_ideal
        assert found.shape == expected.shape == (model.nsensordata,)
        assert len(set(words)) > 20
        scale = {word: max(1.0, *(abs(x) for x, w in zip(expected, words, strict=True) if w == word)) for word in set(words)}
        errors = {
            word: max(abs(a - b) for a, b, w in zip(found, expected, words, strict=True) if w == word) / scale[word] for word in scale
        }
        assert {word: error for word, error in errors.items() if not error < BOUND} == {}


def parity() -> dict[str, tuple[str, str]]:
    """The table of docs/reference/sensors.md: verdict and remark by type."""
    text = (Path(__file__).parents[2] / "docs/reference/sensors.md").read_text()
    start = text.index("| MuJoCo's type |")
    rows = [[cell.strip() for cell in line.split("|")[1:4]] for line in text[start : text.index("\n\n", start)].splitlines()[2:]]
    return {word: (verdict, remark) for word, verdict, remark in rows}


def types(compiled: mujoco.MjModel) -> list[str]:
    """Type of every sensor of a model."""
    return [mujoco.mjtSensor(int(kind)).name.removeprefix("mjSENS_").lower() for kind in compiled.sensor_type]


def test_the_table_of_parity_has_every_type_of_the_installed_mujoco():
    table = {word: verdict for word, (verdict, _) in parity().items()}
    words = {name.removeprefix("mjSENS_").lower() for name in mujoco.mjtSensor.__members__}
    assert set(table) == words
    assert set(table.values()) == {"same", "different", "not simulated"}
    assert {word for word, verdict in table.items() if verdict == "not simulated"} == set(MISSING)
    known = {**JOINTS, **TENDONS, **ACTUATORS, **SITES, **FRAMES, **SUBTREES, **PROXIMITIES, **SCENE}
    assert {word for word, verdict in table.items() if verdict != "not simulated"} == {*known, "rangefinder", "insidesite", "contact"}
    said = (Path(__file__).parents[2] / "README.md").read_text()
    assert f"{len(table) - len(MISSING)} of MuJoCo's {len(table)} sensor types" in said


def test_what_the_table_calls_the_same_is_compared():
    """Every type of which the table says so is among the readings that the tests of this file hold to 1e-9; no type that is not."""
    compared = set()
    for name in CHOSEN:
        compiled = instrumented(name)
        compared |= set(readings(compiled, stepper.load(compiled, strict=False), mujoco.MjData(compiled))[1])
    compared |= set(types(proximities()))
    table = parity()
    assert {word for word, (verdict, _) in table.items() if verdict == "same"} == compared - {"rangefinder"}
    assert table["rangefinder"][0] == "different"


def test_what_the_table_calls_not_simulated_is_left_out_with_its_reason():
    assert {word: remark for word, (verdict, remark) in parity().items() if verdict == "not simulated"} == MISSING
    source = """<mujoco><worldbody><camera name="eye"/><body><freejoint/><geom size=".1"/><site name="imu"/></body></worldbody>
      <sensor><camprojection site="imu" camera="eye"/><user name="own" dim="2"/><gyro site="imu"/></sensor></mujoco>"""
    with pytest.warns(
        stepper.ModelWarning, match=r"sensordata` is shorter than MuJoCo's:\n  camprojection #0: cameras.*\n  user own: callbacks"
    ):
        model = stepper.load(source)
    assert {(kind, reason) for kind, _, reason in model.omitted if kind.startswith("sensor ")} == {
        (f"sensor {word} without reading", MISSING[word]) for word in ("camprojection", "user")
    }
    assert model.nsensordata == 3


def test_limits_are_overlaps_as_mujocos_and_forces_as_statics_has_them():
    compiled = mujoco.MjModel.from_xml_string(LIMITED)
    sim, rng = simulate(stepper.load(compiled)), np.random.default_rng(2)
    beyond = 0
    for _ in range(200):
        qpos, qvel = rng.uniform(-0.5, 0.5, 2), rng.normal(size=2)
        sim.reset(qpos=qpos, qvel=qvel)
        expected = forward(compiled, qpos, qvel).sensordata
        np.testing.assert_allclose(sim.sensordata_ideal[[0, 1, 3, 4]], expected[[0, 1, 3, 4]], rtol=0, atol=1e-15)
        beyond += np.count_nonzero(expected[[0, 3]])
    assert 50 < beyond < 350
    # At rest the second mass hangs on the rope, 3 g, which draws the first one down twice as much; that lies in its own limit, which
    # bears (2 + 3) g + 2 x 3 g.
    sim = simulate(stepper.load(compiled), tolerance=1e-6, steps=3000)
    assert sim.status == 0
    # Rows are solved to 1e-6 m/s in a step of 1 ms, for 2 kg and more: 1e-2 N.
    np.testing.assert_allclose(sim.sensordata_ideal[[2, 5]], [11 * 9.81, 3 * 9.81], atol=1e-2)
    np.testing.assert_allclose(sim.sensordata_ideal[[1, 4]], 0, atol=1e-6)


def test_rays_see_planes_without_end():
    """What the table names as the difference: MuJoCo's rays miss a plane beyond its size."""
    compiled = mujoco.MjModel.from_xml_string("""<mujoco><worldbody><geom type="plane" size="1 1 1"/>
      <body pos="3 0 1"><freejoint/><geom size=".1"/><site name="eye" euler="180 0 0"/></body></worldbody>
      <sensor><rangefinder site="eye"/></sensor></mujoco>""")
    assert forward(compiled, compiled.qpos0, np.zeros(6)).sensordata == [-1]
    np.testing.assert_allclose(stepper.Stepper(stepper.load(compiled)).sensordata_ideal, [1.0], atol=1e-12)


def proximities() -> mujoco.MjModel:
    """A scene with a ray and the distances of all pairs that the table has."""
    pairs = [("plane", s) for s in ("capsule", "box", "cylinder", "ellipsoid", "sphere")] + [("sphere", "capsule"), ("capsule", "plane"),
             ("sphere", "eye")]  # fmt: skip
    kinds = ("distance", "normal", "fromto")
    proximity = "".join(f'<{k} geom1="{a}" geom2="{b}" cutoff="1.2"/>' for a, b in pairs for k in kinds)
    return mujoco.MjModel.from_xml_string(SHAPES.format(proximity=proximity))


def test_rays_and_distances_are_mujocos():
    compiled = proximities()
    sim, rng = simulate(stepper.load(compiled)), np.random.default_rng(5)
    hits = 0
    for _ in range(300):
        qpos = np.concatenate([np.r_[rng.uniform(-0.7, 0.7, 3), random_quaternion(rng)] for _ in range(compiled.nbody - 1)])
        sim.reset(qpos=qpos)
        expected = forward(compiled, qpos, np.zeros(compiled.nv)).sensordata
        # Of two points of parallel edges either is nearest: no random state has them.
        np.testing.assert_allclose(sim.sensordata_ideal, expected, rtol=0, atol=BOUND)
        hits += expected[0] > 0
    assert 50 < hits < 300


@every(interp=["zoh", "linear"], samples=[0, 1, 2, 5], interval=[0, 1, 1.5, 2.5, 3], delay=[0, 0.3, 0.5, 1, 1.5, 3, 4])
def test_readings_are_as_late_as_mujocos(delay, interval, samples, interp):
    """Delays below a step, buffers that are too short for the delay, and intervals without a buffer. Times in steps."""
    # A power of two: sums of time steps have no rounding error, which could delay MuJoCo's samples by a step.
    h = 1 / 256
    scene = f"""<mujoco><option timestep="{h}" gravity="0 0 0"/>
    <worldbody><body><joint name="j" type="slide"/><geom size=".1" mass="1"/></body></worldbody>
    <sensor><jointpos joint="j" delay="{delay * h}" interval="{interval * h}" nsample="{samples}" interp="{interp}"/></sensor>
    </mujoco>"""
    try:
        compiled = mujoco.MjModel.from_xml_string(scene)
    except ValueError:
        pytest.skip("MuJoCo refuses a delay without samples")
    model = stepper.load(compiled, strict=False)
    if model.omitted:
        assert any(part in model.omitted[0][0] for part in ("interpolation", "buffer"))
        pytest.skip("listed as an omission")
    data = mujoco.MjData(compiled)
    sim = stepper.Stepper(model, sensors=stepper.SensorModel.from_mjcf(model), options=stepper.Options.from_model(model))
    data.qvel[:] = 1
    sim.set_state(qvel=[1.0])
    theirs, ours = [], []
    for _ in range(24):
        mujoco.mj_step(compiled, data)
        theirs.append(data.sensordata[0] / h)
        ours.append(float(sim.sensordata[0]) / h)
        sim.step()
    # At unit speed, a position in steps is the time of the sample. MuJoCo's reading after a step is that of the state before it.
    assert np.allclose(ours, theirs, atol=1e-9)


# Sensors that are added to a loaded model read, bit for bit, what those of its file read.

OBJECT_KINDS = mujoco.mjtObj
NAMED = {
    OBJECT_KINDS.mjOBJ_JOINT: "joint",
    OBJECT_KINDS.mjOBJ_TENDON: "tendon",
    OBJECT_KINDS.mjOBJ_ACTUATOR: "actuator",
    OBJECT_KINDS.mjOBJ_SITE: "site",
    OBJECT_KINDS.mjOBJ_XBODY: "body",
    OBJECT_KINDS.mjOBJ_GEOM: "geom",
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
            if index >= 0 and objtype != OBJECT_KINDS.mjOBJ_UNKNOWN and not (prefix and word not in FRAMES):
                kind = OBJECT_KINDS(int(objtype))
                name = mujoco.mj_id2name(m, OBJECT_KINDS.mjOBJ_BODY if kind == OBJECT_KINDS.mjOBJ_XBODY else kind, index)
                what = "inertial" if kind == OBJECT_KINDS.mjOBJ_BODY and word in FRAMES else NAMED.get(kind, "body")
                of[f"{prefix}{what}"] = name
        readings[mujoco.mj_id2name(m, OBJECT_KINDS.mjOBJ_SENSOR, i)] = stepper.sensors.SensorSpec(type=word, **of)
    return readings


@pytest.mark.parametrize("name", ["assorted", "gymnasium/humanoid", "dm_control/quadruped", "dm_control/manipulator"])
def test_what_is_added_reads_what_the_file_has(name):
    m = instrumented(name)
    model = stepper.load(m, strict=False)
    readings = written_again(m)
    readings = {name: reading for name, reading in readings.items() if name in model.sensor_names}
    sim = stepper.Stepper(model.with_sensors({f"added {name}": reading for name, reading in readings.items()}), 4)
    rng = np.random.default_rng(0)
    for _ in range(5):
        sim.set_state(qvel=rng.normal(size=(4, model.nv)))
        sim.step(rng.uniform(-1, 1, (4, model.nu)), nstep=3)
        for sensor in readings:
            file, added = (sim.read("sensordata_ideal", which) for which in (sensor, f"added {sensor}"))
            np.testing.assert_array_equal(added, file, f"{sensor}: {readings[sensor]}")
    assert len({reading.type for reading in readings.values()}) > 20


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
    raises(ValueError, said, lambda: stepper.load(HAND).with_sensors({"new": stepper.sensors.SensorSpec(**reading)}))


def test_what_is_added_has_errors_of_its_own():
    model = stepper.load(HAND).with_sensors({"hand": stepper.sensors.SensorSpec(type="framepos", site="tip")})
    sim = stepper.Stepper(model, 2, sensors=stepper.SensorModel({"hand": stepper.Transfer(bias=0.5)}))
    np.testing.assert_array_equal(sim.read("sensordata_ideal", "hand"), [[0.4, 0, 0]] * 2)
    np.testing.assert_array_equal(sim.read("sensordata", "hand"), [[0.9, 0.5, 0.5]] * 2)
