"""What readings obey: Newton's law, and the statistics of the errors that were asked for.

Bounds of statistics are five standard deviations of the estimator, which the seed's own draw stays within, once and for all.
"""

import numpy as np
import pytest
import stepper
from hypothesis import given, settings, strategies as st
from models import mjcf, samples
from scipy import stats
from stepper import SensorModel, Transfer
from stepper.sensors import devices

STILL = """
<mujoco>
  <option timestep="{dt}" gravity="0 0 0"/>
  <worldbody><body><joint name="pivot" type="hinge" axis="0 1 0"/><geom size="0.1"/><site name="imu"/></body></worldbody>
  <sensor><gyro name="gyro" site="imu"/><jointpos name="angle" joint="pivot"/><framezaxis name="axis" objtype="site" objname="imu"/>
  <framequat name="attitude" objtype="site" objname="imu"/></sensor>
</mujoco>
"""
GYRO, ANGLE, AXIS, ATTITUDE = slice(0, 3), 3, slice(4, 7), slice(7, 11)
TRAY = mjcf("tray")


def errors(steps: int, num_envs: int, dt: float = 0.01, seed: int = 0, **transfers: Transfer) -> np.ndarray:
    """Readings of sensors at rest, (steps + 1, num_envs, nsensordata)."""
    sim = stepper.Stepper(stepper.load(STILL.format(dt=dt)), num_envs, sensors=SensorModel(transfers), seed=seed)
    return np.concatenate([[sim.sensordata], samples(sim, steps, lambda: sim.sensordata)])


@pytest.mark.parametrize(("kind", "kurtosis"), [("gaussian", 3.0), ("uniform", 1.8)])
def test_noise_has_its_moments(kind, kurtosis):
    x = errors(200, 256, gyro=Transfer(noise_std=0.3, noise=kind))[:, :, GYRO].ravel()
    n = x.size
    assert abs(x.mean()) < 5 * 0.3 / np.sqrt(n)
    assert abs(x.var() / 0.09 - 1) < 5 * np.sqrt((kurtosis - 1) / n)
    assert abs(stats.skew(x)) < 5 * np.sqrt(6 / n)
    assert abs(stats.kurtosis(x, fisher=False) - kurtosis) < 5 * np.sqrt(24 / n)
    # Beyond three standard deviations there are 0.27 % of a normal distribution, and nothing beyond sqrt(3) of a uniform one.
    tail = 0.0027 if kind == "gaussian" else 0.0
    assert abs(np.mean(np.abs(x) > 0.9) - tail) <= 5 * np.sqrt(tail / n)
    assert kind == "gaussian" or np.abs(x).max() <= 0.3 * np.sqrt(3)


@settings(max_examples=20, deadline=None)
@given(st.sampled_from(["gaussian", "uniform"]), st.floats(1e-3, 10.0), st.integers(0, 2**20))
def test_noise_of_every_kind_has_the_standard_deviation_that_it_claims(kind, std, seed):
    """The estimator's own deviation is at most std / sqrt(2 n), that of Gaussian noise; six of them, since seeds are many."""
    x = errors(20, 256, seed=seed, angle=Transfer(noise_std=std, noise=kind))[:, :, ANGLE]
    assert abs(x.std() / std - 1) < 6 / np.sqrt(2 * x.size)


def test_noise_is_white():
    """Means of the periodogram over its lower and upper half agree, and no neighbours in time are correlated."""
    x = errors(2047, 32, angle=Transfer(noise_std=1.0))[:, :, ANGLE]
    power = np.abs(np.fft.rfft(x, axis=0)[1:-1]) ** 2 / len(x)
    low, high = power[: len(power) // 2], power[len(power) // 2 :]
    assert abs(low.mean() - high.mean()) < 5 * np.sqrt(2 / low.size)
    for lag in (1, 2, 7):
        assert abs(np.mean(x[lag:] * x[:-lag])) < 5 / np.sqrt(x.size)


def test_environments_sensors_axes_and_episodes_are_independent():
    x = errors(4000, 16, gyro=Transfer(noise_std=1.0), angle=Transfer(noise_std=1.0))[:, :, :4]
    columns = x.reshape(len(x), -1)
    correlation = np.corrcoef(columns.T) - np.eye(columns.shape[1])
    # The largest of 2,016 correlations of normal numbers stays below 5 standard deviations.
    assert np.abs(correlation).max() < 5 / np.sqrt(len(x))
    other = errors(4000, 16, seed=1, gyro=Transfer(noise_std=1.0), angle=Transfer(noise_std=1.0))[:, :, :4].reshape(len(x), -1)
    assert np.abs(np.mean(columns * other, axis=0)).max() < 5 / np.sqrt(len(x))


def test_a_fixed_bias_is_the_same_in_every_episode_and_what_is_drawn_is_about_it():
    model = stepper.load(STILL.format(dt=0.01))
    fixed = stepper.Stepper(model, 3, sensors=SensorModel({"gyro": Transfer(bias=[0.1, -0.2, 0.0])}))
    for _ in range(3):
        fixed.step(nstep=2)
        errors = (fixed.sensordata - fixed.sensordata_ideal)[:, GYRO]
        np.testing.assert_allclose(errors, np.tile([[0.1], [-0.2], [0.0]], 3), atol=1e-15)
        fixed.reset()
    drawn = stepper.Stepper(model, 4096, sensors=SensorModel({"gyro": Transfer(bias=0.1, bias_std=0.2)}))
    errors = (drawn.sensordata - drawn.sensordata_ideal)[:, GYRO].ravel()
    assert abs(errors.mean() - 0.1) < 5 * 0.2 / np.sqrt(errors.size)
    assert abs(errors.std() - 0.2) < 5 * 0.2 / np.sqrt(2 * errors.size)


def test_bias_is_drawn_once_an_episode():
    sim = stepper.Stepper(stepper.load(STILL.format(dt=0.01)), 4096, sensors=SensorModel({"gyro": Transfer(bias_std=0.2)}))
    first = sim.sensordata[:, GYRO]
    sim.step(nstep=10)
    np.testing.assert_array_equal(sim.sensordata[:, GYRO], first)
    sim.reset()
    second = sim.sensordata[:, GYRO]
    n = first.size
    assert abs(np.std(first) / 0.2 - 1) < 5 / np.sqrt(2 * n)
    assert abs(np.mean(first * second)) < 5 * 0.04 / np.sqrt(n)


def allan(x: np.ndarray, dt: float, tau: float) -> float:
    """Allan deviation at tau of rates (time, ...), from the differences of neighbouring means over tau."""
    m = round(tau / dt)
    means = x[: len(x) // m * m].reshape(len(x) // m, m, -1).mean(axis=1)
    return float(np.sqrt(0.5 * np.mean(np.diff(means, axis=0) ** 2)))


def test_the_allan_deviation_of_a_whole_imu_has_its_drift():
    """Of the industrial gyro: white noise N^2 / tau and the Gauss-Markov drift (IEEE 952, annex C) with its in-run stability and 100 s."""
    # sigma^2 = s^2 2 T/tau (1 - T / (2 tau) (3 - 4 e^(-tau/T) + e^(-2 tau/T))) for a drift of standard deviation s and correlation time T.
    dt, envs, seconds, T = 0.25, 96, 2000.0, 100.0
    density, stability = np.deg2rad(0.008), np.deg2rad(8 / 3600)
    # The drift begins at 0: five correlation times are left out.
    x = errors(round((5 * T + seconds) / dt), envs, dt, gyro=devices.find("adis16470_gyro"))[round(5 * T / dt) :, :, GYRO]
    for tau in (1.0, 10.0, 100.0, 250.0):
        ratio = T / tau
        drift = 2 * stability**2 * ratio * (1 - ratio / 2 * (3 - 4 * np.exp(-1 / ratio) + np.exp(-2 / ratio)))
        expected = np.sqrt(density**2 / tau + drift)
        # Half of the differences of means are independent, of a drift those 100 s apart.
        count = seconds / max(tau, T if drift > 0.1 * expected**2 else 0.0) * envs * 3 / 2
        assert abs(allan(x, dt, tau) / expected - 1) < 5 / np.sqrt(2 * count)


def test_drift_and_noise_are_independent():
    """Differences of neighbours d_k + n_k - n_(k-1) have the variance d^2 + 2 n^2, -n^2 with the next one, and nothing with other axes'."""
    n, d = 0.3, 0.2
    step = np.diff(errors(400, 512, 0.01, gyro=Transfer(noise_std=n, drift_std=d / np.sqrt(0.01)))[:, :, GYRO], axis=0)
    var = d**2 + 2 * n**2
    # Five standard deviations of a mean of products of two numbers of that variance; neighbours that are correlated count half.
    bound = 5 * np.sqrt(2 * 2) * var / np.sqrt(step.size)
    assert abs(np.mean(step**2) - var) < bound
    assert abs(np.mean(step[1:] * step[:-1]) + n**2) < bound
    assert abs(np.mean(step[2:] * step[:-2])) < bound
    assert abs(np.mean(step * np.roll(step, 1, axis=2))) < bound
    assert abs(np.mean(step * np.roll(step, 1, axis=1))) < bound


def test_the_spectrum_of_a_gauss_markov_drift_is_its_own():
    """Power at frequency f in proportion to 1 / (1 + a^2 - 2 a cos(2 pi f dt)), a = e^(-dt / T): its knee is at 1 / (2 pi T)."""
    dt, T, kick = 0.01, 0.1, 0.5
    a = np.exp(-dt / T)
    # 25 correlation times until it is stationary; a window, so that the knee does not leak into what lies far above it.
    x = errors(4096 + 250, 64, dt, gyro=Transfer(drift_std=kick, drift_time=T))[-4096:, :, GYRO].reshape(4096, -1)
    window = np.hanning(4096)[:, None]
    power = np.mean(np.abs(np.fft.rfft(x * window, axis=0)) ** 2, axis=1) / np.sum(window**2)
    f = np.fft.rfftfreq(4096, dt)
    expected = kick**2 * T / 2 * (1 - a**2) / (1 + a**2 - 2 * a * np.cos(2 * np.pi * f * dt))
    for low, high in ((0.2, 0.5), (1.0, 2.0), (5.0, 10.0), (20.0, 49.0)):
        band = (f >= low) & (f < high)
        # A power is chi^2 of two degrees of freedom; of neighbours, which the window mixes, every second is independent.
        count = band.sum() * x.shape[1] / 2
        assert abs(np.mean(power[band] / expected[band]) - 1) < 5 / np.sqrt(count)


def test_a_random_walk_grows_with_the_root_of_time():
    x = errors(100, 2048, 0.01, gyro=Transfer(drift_std=0.4))[:, :, GYRO]
    assert np.all(x[0] == 0)
    n = x[0].size
    for k in (1, 25, 100):
        assert abs(np.std(x[k]) / (0.4 * np.sqrt(0.01 * k)) - 1) < 5 / np.sqrt(2 * n)


def test_quantum_and_limits():
    x = errors(50, 64, angle=Transfer(noise_std=1.0, quantum=0.25, limits=(-1.0, 1.5)))[:, :, ANGLE]
    # Every multiple between the limits, and nothing else.
    np.testing.assert_array_equal(np.unique(x), np.arange(-1.0, 1.51, 0.25))


def test_samples_are_held_for_their_period():
    changed = np.any(np.diff(errors(60, 8, 0.01, angle=Transfer(noise_std=1.0, period=0.05))[:, :, ANGLE], axis=0) != 0, axis=1)
    np.testing.assert_array_equal(np.flatnonzero(changed) + 1, np.arange(5, 61, 5))


def test_a_period_that_is_no_multiple_of_the_step_is_kept_on_average():
    x = errors(1000, 1, 0.01, angle=Transfer(noise_std=1.0, period=0.025))[:, :, ANGLE]
    assert abs(np.count_nonzero(np.diff(x, axis=0)) - 400) <= 1


def test_dropout_holds_the_last_sample():
    held = np.mean(np.diff(errors(400, 64, angle=Transfer(noise_std=1.0, dropout=0.3))[:, :, ANGLE], axis=0) == 0)
    assert abs(held - 0.3) < 5 * np.sqrt(0.21 / (400 * 64))


def test_jitter_scatters_the_delay():
    model = stepper.load(STILL.replace("<framequat", '<clock name="clock"/><framequat').format(dt=0.01))
    sim = stepper.Stepper(model, 64, sensors=SensorModel({"clock": Transfer(delay=0.05, jitter=0.02)}))
    sim.step(nstep=20)
    late = samples(sim, 200, lambda: sim.time - sim.sensordata[:, 7])
    assert late.min() >= 0.03 - 1e-12
    assert late.max() <= 0.07 + 1e-12
    assert abs(late.mean() - 0.05) < 5 * 0.04 / np.sqrt(12 * late.size)
    assert abs(late.std() / (0.04 / np.sqrt(12)) - 1) < 0.02


def test_unit_vectors_and_quaternions_stay_unit_and_turn_by_the_error():
    x = errors(100, 64, axis=Transfer(noise_std=0.1), attitude=Transfer(noise_std=0.1, delay=0.015))
    np.testing.assert_allclose(np.linalg.norm(x[:, :, AXIS], axis=-1), 1, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(x[:, :, ATTITUDE], axis=-1), 1, atol=1e-12)
    # Rotation vectors of three components of 0.1 rad have the mean square 0.03; the middle of two has half of it.
    angles = 2 * np.arccos(np.clip(np.abs(x[20:, :, ATTITUDE.start]), 0, 1))
    assert abs(np.mean(angles**2) / 0.015 - 1) < 0.05


def test_misalignment_mixes_the_axes():
    model = stepper.load(STILL.format(dt=0.01))
    matrix = np.array([[1.0, 0.1, 0.0], [0.0, 2.0, 0.0], [0.0, -0.2, 1.0]])
    sim = stepper.Stepper(model, sensors=SensorModel({"gyro": Transfer(scale=matrix)}))
    sim.reset(qvel=[3.0])
    np.testing.assert_allclose(sim.sensordata[GYRO], matrix @ sim.sensordata_ideal[GYRO], rtol=1e-14)
    np.testing.assert_allclose(sim.sensordata_ideal[GYRO], [0, 3, 0], atol=1e-14)


def test_a_wrist_carries_weight_inertia_and_what_lies_on_the_tray():
    """Force on the tray = m (a - g) - contacts, in any motion: Newton's law to rounding, and to 1e-8 as was asked for."""
    sim = stepper.Stepper(stepper.load(TRAY))
    struck = 0
    for k in range(600):
        sim.step([0.1 * np.sin(0.02 * k), 0.05 * np.cos(0.03 * k), 0.3 * np.sin(0.05 * k)])
        x = sim.sensordata_ideal
        axes = x[-9:].reshape(3, 3).T
        contact = sum((c["force"] @ c["frame"] for c in sim.contacts() if c["body"][1] == 3), np.zeros(3))
        found = axes @ x[:3]
        # framelinacc is less gravity already; the ball's push is on the ball.
        np.testing.assert_allclose(found, 1.5 * x[6:9] + contact, rtol=0, atol=1e-8)
        struck += bool(np.any(contact))
        np.testing.assert_allclose(x[14:17], contact, atol=1e-10)
        assert x[13] == len([c for c in sim.contacts() if c["body"][1] == 3])
    assert 0 < struck < 600


def test_a_robot_at_rest_weighs_what_it_weighs():
    """On a floor an accelerometer reads gravity upwards, the touch sensor the weight; at reset too, before any step."""
    text = """
    <mujoco><worldbody><geom type="plane" size="1 1 1"/>
      <body name="box" pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" mass="3"/><site name="imu"/>
      <site name="sole" pos="0 0 -.1" type="box" size=".2 .2 .01"/></body></worldbody>
      <sensor><accelerometer site="imu"/><touch site="sole"/><contact subtree1="box" data="found" num="8"/></sensor></mujoco>"""
    sim = stepper.Stepper(stepper.load(text))
    for _ in range(2):
        x = sim.sensordata_ideal
        np.testing.assert_allclose(x[:3], [0, 0, 9.81], atol=1e-4)
        np.testing.assert_allclose(x[3], 3 * 9.81, rtol=1e-4)
        assert np.array_equal(x[4:], [4, 4, 4, 4, 0, 0, 0, 0])
        sim.step(nstep=200)
    sim.xfrc_applied[1, 2] = 5.0
    sim.step(nstep=100)
    np.testing.assert_allclose(sim.sensordata_ideal[3], 3 * 9.81 - 5.0, rtol=1e-4)
