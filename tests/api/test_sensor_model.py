"""`stepper.SensorModel`: what it takes, what it refuses, and that readings are the last step's, whoever reads them and how often."""

import json

import numpy as np
import pytest
import stepper
from checks import raises
from models import mjcf, simulate
from stepper import SensorModel, Transfer
from stepper.sensors import Combination, RayFan, SensorSpec, devices

SCENE = mjcf("imu_on_a_pendulum")
ALL = Transfer(
    scale_std=0.01, misalignment_std=0.01, bias_std=0.1, drift_std=0.3, drift_time=0.5, noise_std=0.02, quantum=1e-4, limits=(-50, 50),
    period=0.004, delay=0.005, jitter=0.003, dropout=0.1,
)  # fmt: skip
SEEN = """
<mujoco><worldbody>
  <geom name="floor" type="plane" size="1 1 1"/><geom name="wall" type="box" size=".1 5 5" pos="3 0 5"/>
  <body name="head" pos="0 0 2"><joint name="tilt" axis="0 1 0"/><geom name="skull" size=".3"/><site name="eye" pos=".1 0 0"/></body>
</worldbody><sensor><jointpos name="angle" joint="tilt"/><gyro name="gyro" site="eye"/>
<accelerometer name="feel" site="eye"/></sensor></mujoco>"""
MODEL = stepper.load(SCENE)


def noisy(model: stepper.Model, num_envs: int | None = None, **settings) -> stepper.Stepper:
    sensors = SensorModel({"attitude": Transfer(bias_std=0.1, noise_std=0.05, delay=0.005)}, default=ALL)
    return stepper.Stepper(model, num_envs, sensors=sensors, **settings)


def episode(sim: stepper.Stepper, calls: int = 20) -> np.ndarray:
    rows = [sim.sensordata]
    for k in range(calls):
        sim.step(np.full(sim.model.nu, np.sin(0.3 * k)), nstep=1 + k % 3)
        rows.append(sim.sensordata)
    return np.array(rows)


def test_shapes_and_addresses():
    assert MODEL.nsensordata == 1 + 1 + 3 + 3 + 4 + 1
    assert MODEL.sensor_names == ["angle", "rate", "gyro", "acceleration", "attitude", "clock"]
    assert [(s["type"], s["adr"], s["dim"]) for s in MODEL.sensors][2:5] == [("gyro", 2, 3), ("accelerometer", 5, 3), ("framequat", 8, 4)]
    assert stepper.Stepper(MODEL).sensordata.shape == (13,)
    assert stepper.Stepper(MODEL, 3).sensordata.shape == (3, 13)
    assert stepper.Stepper(MODEL, 3, precision="f32").sensordata_ideal.dtype == np.float32


def test_without_a_model_of_errors_the_truth_is_observed():
    sim = stepper.Stepper(MODEL, 5)
    sim.step(1.0 * np.ones(1), nstep=10)
    np.testing.assert_array_equal(sim.sensordata, sim.sensordata_ideal)
    np.testing.assert_array_equal(sim.sensordata[:, 0], sim.qpos[:, 0])
    np.testing.assert_array_equal(sim.sensordata[:, 12], sim.time)


def test_reading_twice_gives_the_same_and_reading_changes_nothing():
    read, unread = noisy(MODEL, 11, seed=3), noisy(MODEL, 11, seed=3)
    for k in range(15):
        for sim in (read, unread):
            sim.step(np.array([np.sin(k)]))
        first = read.sensordata
        read.sensordata_ideal  # noqa: B018  (reading is what is tested)
        np.testing.assert_array_equal(read.sensordata, first)
    np.testing.assert_array_equal(read.sensordata, unread.sensordata)
    assert read.get_state() == unread.get_state()


def test_observe_fills_an_array():
    sim = noisy(MODEL, 4)
    out = np.empty((4, MODEL.nsensordata))
    assert sim.observe(out=out) is out
    np.testing.assert_array_equal(out, sim.sensordata)
    single = np.empty((4, MODEL.nsensordata), dtype=np.float32)
    np.testing.assert_array_equal(sim.observe(out=single), sim.sensordata.astype(np.float32))
    raises(ValueError, r"out has shape \(4,\), must be \(4, 13\)", sim.observe, out=np.empty(4))


def test_seeds_episodes_and_environments_differ():
    sim = noisy(MODEL, 3, seed=1)
    first = episode(sim)
    assert len({row.tobytes() for row in first[-1]}) == 3
    sim.reset()
    second = episode(sim)
    # Multiples of 1e-4 of numbers that scatter by 0.3: each of 63 is the same with probability 1e-4, and is held for two steps.
    assert np.count_nonzero(first[:, :, 0] == second[:, :, 0]) <= 4
    sim.reset(seed=1)
    np.testing.assert_array_equal(episode(sim), first)
    sim.reset(seed=2)
    assert not np.array_equal(episode(sim), first)


def test_delay_lines_begin_with_the_first_reading():
    sim = stepper.Stepper(MODEL, 2, sensors=SensorModel({"angle": Transfer(delay=0.01)}))
    sim.reset(qpos=np.array([[0.5], [-0.25]]))
    np.testing.assert_array_equal(sim.sensordata[:, 0], [0.5, -0.25])
    truth = [sim.sensordata_ideal[:, 0]]
    for k in range(12):
        sim.step()
        truth.append(sim.sensordata_ideal[:, 0])
        np.testing.assert_array_equal(sim.sensordata[:, 0], truth[max(0, k + 1 - 5)])


def reading(**transfer):
    return stepper.Stepper(stepper.load(SCENE), 4, sensors=SensorModel({"angle": Transfer(**transfer)}))


def observing(sensors=None):
    return stepper.Stepper(stepper.load(SCENE), sensors=sensors)


@pytest.mark.parametrize(("call", "error", "match"), [
    (lambda: reading(noise_std=-1), ValueError, 'sensor "angle": noise_std is -1'),
    (lambda: reading(limits=(1, -1)), ValueError, r"limits are \(1, -1\)"),
    (lambda: reading(dropout=1.5), ValueError, "dropout is 1.5"),
    (lambda: reading(delay=1e9), ValueError, "must be at most"),
    (lambda: reading(drift_time=0), ValueError, "drift_time is 0"),
    (lambda: reading(bias_std=np.nan), ValueError, "bias_std is NaN"),
    (lambda: reading(noise_std=[1, 2, 3]), ValueError, r"noise_std has shape \(3,\), must be \(\) or \(4,\)"),
    (lambda: reading(scale=np.eye(2)), ValueError, r"must be \(1, 1\)"),
    (lambda: reading(noise="pink"), ValueError, "noise is 'pink'"),
    (lambda: reading(noise_std="loud"), TypeError, "must be a number"),
    (lambda: observing(SensorModel({"angel": ALL})), ValueError, "no sensor fits 'angel', there are: angle, rate"),
    (lambda: observing(SensorModel({"attitude": Transfer(scale=2.0)})), ValueError,
     r"attitude.*scale and misalignment are set, but the sensor reads a unit vector or quaternion"),
    (lambda: observing("noise"), TypeError, r"sensors is 'noise'.*SensorModel"),
    (lambda: Transfer(noise_std=None), TypeError, "noise_std is None, must be a number"),
    (lambda: Transfer(limits=3), ValueError, r"limits is 3, must be \(low, high\)"),
    (lambda: Transfer(limits=("a", 1)), TypeError, r"limits\[0\] is 'a'"),
    (lambda: SensorModel([ALL]), TypeError, "transfers is .* must be a mapping of names to stepper.Transfer"),
    (lambda: SensorModel.from_dict({"sensors": [1]}), ValueError, "sensors: sensors is"),
    (lambda: SensorModel.from_dict({"sensors": {"gyro": {"limits": 1}}}), ValueError, "sensor 'gyro': limits is 1"),
    (lambda: observing().observe(out=np.zeros(13, int)), TypeError, "out has dtype int64"),
    (lambda: observing().observe(out=[0.0] * 13), TypeError, "out is .* must be a NumPy array"),
    (lambda: devices.encoder("12"), TypeError, "bits is '12', must be a whole number from 1 to 40"),
    (lambda: devices.encoder(12, turn=None), TypeError, "turn is None, must be a number"),
    (lambda: devices.encoder_velocity(12, -0.01), ValueError, "period is -0.01, must be a finite number above 0"),
    (lambda: devices.find([]), ValueError, r"there is no device \[\]; the devices are: adis16470_accelerometer"),
])  # fmt: skip
def test_what_is_refused_is_named(call, error, match):
    raises(error, match, call)


def test_numbers_may_differ_between_environments():
    delay = np.array([0.0, 0.002, 0.006, 0.008])
    sim = simulate(MODEL, 4, sensors=SensorModel({"clock": Transfer(delay=delay, scale=[1, 2, 3, 4])}), steps=10)
    np.testing.assert_allclose(sim.sensordata[:, 12], (0.02 - delay) * [1, 2, 3, 4], rtol=1e-12)


def test_names_patterns_and_default():
    sensors = SensorModel({"a*": Transfer(scale=2.0), "angle": Transfer(scale=3.0), "attitude": Transfer()}, default=Transfer(scale=5.0))
    sim = stepper.Stepper(MODEL, sensors=sensors)
    sim.reset(qpos=[1.0], qvel=[1.0])
    ratio = sim.sensordata[[0, 1, 5]] / sim.sensordata_ideal[[0, 1, 5]]
    np.testing.assert_allclose(ratio, [3, 5, 2], rtol=1e-12)


def test_mjcf_declares_noise_and_cutoff():
    sensors = SensorModel.from_mjcf(MODEL)
    assert sensors == SensorModel({"angle": Transfer(noise_std=0.01), "rate": Transfer(limits=(-0.5, 0.5))})
    sim = stepper.Stepper(MODEL, sensors=sensors)
    sim.reset(qvel=[3.0])
    assert sim.sensordata[1] == 0.5
    assert 0 < abs(sim.sensordata[0]) < 0.06


@pytest.mark.parametrize(("history", "what"), [
    ('delay=".025" nsample="8" interp="cubic"', "cubic"),
    ('delay=".02" interval=".03" nsample="8" interp="linear"', "the previous sample"),
    ('interval=".03 -.01" nsample="8"', "at the reset"),
    ('delay=".04" interval=".015" nsample="2"', "a sample too late"),
    ('delay=".04" interval=".015" nsample="2" interp="linear"', "a sample too late"),
])  # fmt: skip
def test_what_mjcf_declares_and_is_read_otherwise_is_listed(history, what):
    loaded = stepper.load(f'<mujoco><option timestep=".01"/><sensor><clock name="watch" {history}/></sensor></mujoco>')
    assert any("watch" in line and what in line for line in loaded.explain().splitlines())


def test_fans_of_rays_and_combinations_are_added(tmp_path):
    """Distances to a floor and a wall by hand; the sensor's own body is not in the way; files and transfer functions know them."""
    directions = [[1.0, 0, 0], [0, 0, -2.0], [1, 0, -1], [-1, 0, 0]]
    fan = RayFan("eye", directions)
    grown = stepper.load(SEEN).with_sensors({
        "fan": fan,
        "down": RayFan("eye", directions[1:2], geoms=["floor"], data=("distance", "point")),
        "mixed": Combination({"gyro": 2.0, "feel": -0.5}),
        "twice": Combination({"mixed": 2.0}),
    })  # fmt: skip
    assert grown.sensor_names == ["angle", "gyro", "feel", "fan", "down", "mixed", "twice"]
    grown.save(tmp_path / "grown.stepper")
    assert stepper.load(tmp_path / "grown.stepper") == grown
    sim = simulate(grown, 9, sensors=SensorModel({"fan": Transfer(delay=0.01)}), steps=3)
    x = sim.sensordata_ideal
    sim.reset(qvel=np.full((9, 1), 0.3))
    x = sim.sensordata_ideal
    # The eye stands at (0.1, 0, 2), the wall's face at x = 2.9.
    np.testing.assert_allclose(x[:, 7:11], np.tile([2.8, 2.0, 2 * np.sqrt(2), -1.0], (9, 1)), atol=1e-12)
    np.testing.assert_allclose(x[:, 11:15], np.tile([2.0, 0.1, 0.0, 0.0], (9, 1)), atol=1e-12)
    np.testing.assert_allclose(x[:, 15:18], 2.0 * x[:, 1:4] - 0.5 * x[:, 4:7], atol=1e-14)
    np.testing.assert_allclose(x[:, 18:21], 2 * x[:, 15:18], atol=1e-14)
    np.testing.assert_array_equal(sim.sensordata[:, 7:11], x[:, 7:11])


@pytest.mark.parametrize(("sensors", "error", "match"), [
    ({"fan": RayFan("ear", [[1, 0, 0]])}, ValueError, r"sensor 'fan': there is no site 'ear'; the names are: eye"),
    ({"fan": RayFan("eye", [1, 0, 0])}, ValueError, r"sensor 'fan': rays has shape \(3,\), must be \(n, 3\)"),
    ({"fan": RayFan("eye", [[1, 0, 0], [0, 0, 0]])}, ValueError, r"sensor 'fan': ray 1 is \[0.0, 0.0, 0.0\]"),
    ({"fan": RayFan("eye", [[1, 0, 0]], geoms=["door"])}, ValueError, r"sensor 'fan': there is no geom 'door'; the names are: floor"),
    ({"fan": RayFan("eye", [[1, 0, 0]], data=("normal",))}, ValueError, r"data has \['normal'\], must be one of: distance"),
    ({"fan": RayFan("eye", [[1, 0, 0]], data=())}, stepper.ModelError, r'sensor "fan".*fields'),
    ({"sum": Combination({"gyr": 1.0})}, ValueError, r"sensor 'sum': there is no sensor 'gyr'; the names are: angle, gyro"),
    ({"sum": Combination({"gyro": 1.0, "angle": 1.0})}, stepper.ModelError, r'"gyro" of dimension 3 with "angle"'),
    ({"sum": Combination({})}, stepper.ModelError, r"its terms are empty"),
    ({"gyro": Combination({"angle": 1.0})}, stepper.ModelError, r'gyro'),
    ({"fan": RayFan("eye", "up")}, ValueError, r"sensor 'fan': rays is 'up', must be an array"),
    ({"fan": RayFan("eye", [[1, 0, 0], [1]])}, ValueError, r"sensor 'fan': rays is .* must be an array"),
    ({"fan": RayFan("eye", [[1, 0, 0]], data="distance")}, TypeError, r"sensor 'fan': data is 'distance', must be a sequence"),
    ({"fan": RayFan("eye", [[1, 0, 0]], geoms=3)}, TypeError, r"sensor 'fan': geoms is 3, must be a sequence of strings"),
    ({"fan": SensorSpec(type=[], site="eye")}, ValueError, r"sensor 'fan': there is no type \[\]; the types are: jointpos"),
    ({"sum": Combination(["gyro"])}, TypeError, r"sensor 'sum': terms is \['gyro'\], must be a mapping"),
    ({"sum": Combination({"gyro": None})}, TypeError, r"sensor 'sum': the coefficient of 'gyro' is None, must be a number"),
    ({3: Combination({"gyro": 1.0})}, TypeError, r"sensor 3: its name must be a string"),
    ({"sum": {"gyro": 1.0}}, TypeError, r"sensor 'sum' is .* must be a stepper.sensors.SensorSpec, RayFan or Combination"),
    ([Combination({"gyro": 1.0})], TypeError, r"must be a mapping of names"),
])  # fmt: skip
def test_what_cannot_be_added_is_named(sensors, error, match):
    raises(error, match, lambda: stepper.load(SEEN).with_sensors(sensors))


def test_files(tmp_path):
    toml = tmp_path / "sensors.toml"
    toml.write_text(
        '[default]\nnoise_std = 0.5\n[sensors.gyro]\ndevice = "mpu6050_gyro"\nperiod = 0.01\n[sensors."an*"]\nlimits = [-1, 1]\n'
    )
    read = SensorModel.from_file(toml)
    assert read.default == Transfer(noise_std=0.5)
    assert read.named["an*"].limits == (-1, 1)
    assert read.named["gyro"].period == 0.01
    assert read.named["gyro"].noise_density == devices.find("mpu6050_gyro").noise_density
    file = tmp_path / "sensors.json"
    file.write_text(json.dumps(read.to_dict()))
    assert SensorModel.from_file(file) == read
    file.write_text("[]")
    raises(ValueError, r"sensors.json holds a list, must hold tables by name", SensorModel.from_file, file)
    toml.write_text("[sensors.gyro]\nnoize = 1\n")
    raises(ValueError, r"sensors.toml: sensor 'gyro': unknown entries \['noize'\]", SensorModel.from_file, toml)
    toml.write_text('[sensors.gyro]\ndevice = "abacus"\n')
    raises(ValueError, r"sensor 'gyro': there is no device 'abacus'; the devices are: .*hg1700_gyro", SensorModel.from_file, toml)


@pytest.mark.parametrize("name", sorted(devices.DEVICES))
def test_every_device_works(name):
    sim = simulate(MODEL, 2, sensors=SensorModel({"gyro": devices.find(name)}), steps=3)
    assert np.all(np.isfinite(sim.sensordata))


def test_each_environment_has_the_seed_that_it_was_given():
    """One call with a seed for each is as many calls with one seed, whichever environments start."""
    seeds = np.array([5, 2**64 - 1, 7, 5, 0], dtype=np.uint64)
    together, alone = noisy(MODEL, 5, seed=1), noisy(MODEL, 5, seed=1)
    episode(together), episode(alone)
    for mask in (np.ones(5, bool), np.array([True, False, True, True, False])):
        together.reset(mask, seed=seeds)
        for env in np.flatnonzero(mask):
            alone.reset(np.arange(5) == env, seed=int(seeds[env]))
        np.testing.assert_array_equal(episode(together), episode(alone))
    signed = noisy(MODEL, 5, seed=1)
    signed.reset(seed=[3, 1, 4, 1, 5])
    assert signed.seed == 1
    rows = episode(signed)
    # Two environments with one seed draw numbers of their own.
    assert not np.array_equal(rows[-1, 1], rows[-1, 3])


@pytest.mark.parametrize(("seed", "error", "words"), [
    ([1, 2], ValueError, r"seed has shape \(2,\), must be \(5,\) or \(\)"),
    ([1, 2, 3, -4, 5], ValueError, "the seed of environment 3 is negative"),
    ([1.0] * 5, TypeError, "seed has type float64, must be whole numbers from 0 to 2"),
    (2**64, ValueError, "seed is 18446744073709551616"),
])  # fmt: skip
def test_a_wrong_seed_is_named_and_nothing_starts(seed, error, words):
    sim = noisy(MODEL, 5, seed=1)
    sim.step(nstep=3)
    raises(error, words, sim.reset, seed=seed)
    assert (sim.time > 0).all()


@pytest.mark.parametrize("change", ["randomize", "set_state"])
def test_a_reading_before_the_first_step_changes_no_later_reading(tmp_path, change):
    """The delay line is filled with the reading of the first step, whether or not somebody read the sensor before."""
    scene = """<mujoco><worldbody><body name="b" pos="0 0 1"><joint name="j" axis="0 1 0"/>
    <geom type="capsule" size=".05" fromto="0 0 0 .5 0 0" mass="1"/><site name="s" pos=".5 0 0"/></body></worldbody>
    <sensor><accelerometer site="s"/><jointpos joint="j"/></sensor></mujoco>"""
    model, found = stepper.load(scene), []
    for read in (False, True):
        sim = stepper.Stepper(model, 1, sensors=SensorModel(default=Transfer(delay=0.01, noise_std=0.1)), seed=3)
        with sim.record(tmp_path / f"{read}"):
            sim.reset()
            if read:
                assert np.array_equal(sim.sensordata, sim.sensordata)
            if change == "randomize":
                sim.randomize(gravity=[[0, 0, -5.0]])
            else:
                sim.set_state(qpos=[[0.5]], keep_warmstart=True)
            sim.step(nstep=2)
        found.append(sim.sensordata.copy())
        assert stepper.recording.verify(tmp_path / f"{read}")
    assert np.array_equal(*found)
