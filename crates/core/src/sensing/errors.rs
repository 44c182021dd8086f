//! Transfer function of real sensors:
//!
//! ```text
//! truth -> scale and misalignment -> + bias + drift + noise -> quantisation -> clip -> sample and hold -> delay -> observation
//! ```
//!
//! Bias, scale error and misalignment are drawn at reset. Drift d is a random walk with `drift_std` per sqrt(s). With a correlation time
//! tau it is the Gauss-Markov process with the same driving noise: d+ = e^(-h/tau) d + drift_std sqrt(tau/2 (1 - e^(-2h/tau))) n. Here h is
//! the time step, and n a standard normal number (Brown and Hwang 2012, section 5.5).
//!
//! A noise density N per sqrt(Hz) is white noise of N / sqrt(T) at a sampling time of T. The Allan deviation at 1 s is therefore N for any
//! time step (IEEE 952). For unit vectors and quaternions, the sum of bias, drift and noise is a rotation vector.

mod delay;
mod draws;
mod observe;
mod transfer;

use stepper_real::{Real, Scalar};

use crate::math::lanes::DelayLine;
use crate::model::actuator_spec::any_nonzero;
use crate::model::{Model, Quantity, SensorError};
pub use crate::sensing::errors::observe::Work;
pub use crate::sensing::errors::transfer::Transfer;

/// Parameter of a sensor's transfer function that may differ between environments. The variants are in the order of the parameter table.
#[derive(Clone, Copy)]
enum Number {
    Scale,
    ScaleStd,
    MisalignmentStd,
    Bias,
    BiasStd,
    /// Factor by which the drift decays in one step; 1 for a random walk.
    Decay,
    /// Standard deviation of the random change of the drift in one step.
    Kick,
    /// Standard deviation of the noise of a sample, from `noise_std` and `noise_density`. Half width if the noise is uniform.
    Noise,
    Quantum,
    Low,
    High,
    Period,
    /// Delay of the readings, in steps.
    Delay,
    /// Half width of the random variation of the delay, in steps.
    Jitter,
    Dropout,
}

const NUMBERS: usize = 15;

/// Sensor with a transfer function: sizes, options, and addresses of its stored values.
#[derive(Clone, Debug)]
struct Imperfect<S> {
    /// Index of the sensor in the model.
    sensor: usize,
    /// Address of the sensor's first reading among the readings of all sensors.
    at: usize,
    /// Number of channels.
    dim: usize,
    /// Number of components of bias, drift and noise: three if the error is a rotation, otherwise the number of channels.
    freedom: usize,
    quantity: Quantity,
    /// Matrix that multiplies the channels, (dim, dim), row-major. Empty for the identity.
    matrix: Vec<S>,
    /// Whether the noise is uniform instead of Gaussian.
    uniform: bool,
    /// Whether the sensor stores a scale and misalignment matrix, which is constant in an episode.
    mixed: bool,
    /// Whether a factor `scale` other than 1 multiplies all channels.
    scaled: bool,
    biased: bool,
    drifts: bool,
    noisy: bool,
    quantised: bool,
    clipped: bool,
    /// Whether the sensor has a sampling period.
    sampled: bool,
    /// Whether samples may be lost (dropout).
    lossy: bool,
    /// Whether the delay varies randomly from step to step.
    jittery: bool,
    /// Address of the first value that this sensor stores between steps, in the memory of all sensors.
    ///
    /// The stored values are, in this order: scale and misalignment matrix, bias, drift, time since the last sample, and the delay line. A
    /// sensor without delay stores the previous sample instead of a delay line.
    memory: usize,
    /// Offset of this sensor's random numbers in the list of random numbers that a step draws for all sensors.
    draws: usize,
    /// Length of the delay line in samples; 0 without a delay.
    line: usize,
    /// Whether delayed readings are interpolated between two samples. It is false for sensors with a sampling period, and for readings that
    /// are only valid above 0 ([`Quantity::Positive`]).
    smooth: bool,
}

/// Transfer functions of a model's sensors, for all environments of a batch.
#[derive(Clone, Debug)]
pub struct Errors<S> {
    sensors: Vec<Imperfect<S>>,
    /// Addresses of the readings of ideal sensors. These readings are copied without change.
    ideal: Vec<usize>,
    /// Parameters of every sensor. There is one table for every group of lanes, or one table for all environments.
    tables: Vec<Vec<S>>,
    /// Number of values of each parameter in a table of `tables`: 1 if all environments have the same value, otherwise the number of lanes.
    lanes: usize,
    /// Number of stored values per lane that persist between steps.
    pub memory: usize,
    /// Number of delay lines.
    pub lines: usize,
    /// Number of random numbers that a step draws per lane.
    draws: usize,
}

/// Table of transfer function parameters for a group of lanes: of all sensors, or of one sensor.
struct Numbers<'a, S> {
    /// Parameters: by sensor, then in the order of [`Number`], then by lane.
    rows: &'a [S],
    /// Number of values of each parameter: 1 if all environments have the same value, otherwise the number of lanes.
    lanes: usize,
}

impl<S: Scalar> Numbers<'_, S> {
    /// Table that begins with the parameters of one sensor. The index `sensor` counts only sensors that have errors.
    #[inline(always)]
    fn of(&self, sensor: usize) -> Self {
        Numbers { rows: &self.rows[sensor * NUMBERS * self.lanes..], lanes: self.lanes }
    }

    #[inline(always)]
    fn number<R: Real<Scalar = S>>(&self, n: Number) -> R {
        if self.lanes == 1 { R::splat(self.rows[n as usize]) } else { R::load(&self.rows[n as usize * R::LANES..]) }
    }
}

impl<S: Scalar> Errors<S> {
    /// Position of each sensor's delay line in the stored values, for all sensors that have errors. A sensor without delay has an empty
    /// line.
    pub fn delay_lines(&self) -> impl Iterator<Item = DelayLine> {
        self.sensors.iter().map(|s| DelayLine { at: s.line_at(), samples: s.line, width: s.dim })
    }

    /// Creates the transfer functions from `transfers`, with one entry for every sensor of the model. `None` makes a sensor ideal (without
    /// errors).
    ///
    /// # Errors
    /// [`SensorError`] for the first number that is out of its range, with the sensor's name.
    pub fn new(model: &Model, transfers: &[Option<Transfer>], num_envs: usize, lanes: usize, h: f64) -> Result<Self, SensorError> {
        let addresses = model.sensor_addresses();
        let shared = transfers.iter().flatten().all(Transfer::is_shared);
        let tables = vec![vec![]; if shared { 1 } else { num_envs.div_ceil(lanes) }];
        let lanes = if shared { 1 } else { lanes };
        let mut errors = Self { sensors: vec![], ideal: vec![], tables, lanes, memory: 0, lines: 0, draws: 0 };
        for (i, (sensor, transfer)) in model.sensors.iter().zip(transfers).enumerate() {
            let (dim, quantity) = (sensor.dim(&model.sensors), sensor.quantity());
            let Some(t) = transfer else {
                errors.ideal.extend(addresses[i]..addresses[i] + dim);
                continue;
            };
            t.check(dim, quantity, num_envs, h).map_err(|error| SensorError { sensor: model.sensor_label(i), error })?;
            let placed = Imperfect::new(t, i, addresses[i], dim, quantity, h, [errors.memory, errors.draws]);
            errors.memory += placed.size();
            errors.draws += placed.draws_of(true).1;
            errors.lines += 1;
            errors.sensors.push(placed);
            for (g, table) in errors.tables.iter_mut().enumerate() {
                let rows: Vec<[f64; NUMBERS]> = (0..lanes).map(|l| numbers(t, (g * lanes + l).min(num_envs - 1), h)).collect();
                table.extend((0..NUMBERS).flat_map(|n| rows.iter().map(move |row| S::from_f64(row[n]))));
            }
        }
        Ok(errors)
    }

    /// Parameters of all sensors for the group with index `group`.
    fn table(&self, group: usize) -> Numbers<'_, S> {
        Numbers { rows: &self.tables[if self.tables.len() == 1 { 0 } else { group }], lanes: self.lanes }
    }

    /// Indices in the model of the sensors with errors.
    pub fn sensors(&self) -> impl Iterator<Item = usize> {
        self.sensors.iter().map(|s| s.sensor)
    }

    /// Whether every sensor is ideal.
    pub fn is_empty(&self) -> bool {
        self.sensors.is_empty()
    }
}

/// Row of the parameter table for environment `env`. `h` is the time step, s.
fn numbers(t: &Transfer, env: usize, h: f64) -> [f64; NUMBERS] {
    let of = |x: &[f64]| x[env % x.len()];
    let (drift, tau) = (of(&t.drift_std), of(&t.drift_time));
    let period = of(&t.period);
    let (decay, kick) = match tau.is_finite() {
        true => ((-h / tau).exp(), drift * (0.5 * tau * -(-2.0 * h / tau).exp_m1()).sqrt()),
        false => (1.0, drift * h.sqrt()),
    };
    let density = of(&t.noise_density) / period.max(h).sqrt();
    [
        of(&t.scale),
        of(&t.scale_std),
        of(&t.misalignment_std),
        of(&t.bias),
        of(&t.bias_std),
        decay,
        kick,
        of(&t.noise_std).hypot(density),
        of(&t.quantum),
        of(&t.low),
        of(&t.high),
        period,
        of(&t.delay) / h,
        of(&t.jitter) / h,
        of(&t.dropout),
    ]
}

impl<S: Scalar> Imperfect<S> {
    fn new(t: &Transfer, sensor: usize, at: usize, dim: usize, quantity: Quantity, h: f64, [memory, draws]: [usize; 2]) -> Self {
        let turned = matches!(quantity, Quantity::Axis | Quantity::Quaternion);
        let longest = |x: &[f64]| x.iter().fold(0.0, |a: f64, &b| a.max(b)) / h;
        let delay = longest(&t.delay) + longest(&t.jitter);
        Self {
            sensor,
            at,
            dim,
            freedom: if turned { 3 } else { dim },
            quantity,
            matrix: t.matrix.iter().map(|&x| S::from_f64(x)).collect(),
            uniform: t.uniform,
            mixed: !t.matrix.is_empty() || any_nonzero(&t.scale_std) || any_nonzero(&t.misalignment_std),
            scaled: t.scale.iter().any(|&x| x != 1.0),
            biased: any_nonzero(&t.bias) || any_nonzero(&t.bias_std),
            drifts: any_nonzero(&t.drift_std),
            noisy: any_nonzero(&t.noise_std) || any_nonzero(&t.noise_density),
            quantised: any_nonzero(&t.quantum),
            clipped: t.low.iter().chain(&t.high).any(|x| x.is_finite()),
            sampled: any_nonzero(&t.period),
            lossy: any_nonzero(&t.dropout),
            jittery: any_nonzero(&t.jitter),
            memory,
            draws,
            // Number of samples from the newest one to the oldest one that a delayed reading needs.
            line: if delay > 0.0 { delay.ceil() as usize + 1 } else { 0 },
            smooth: !any_nonzero(&t.period) && quantity != Quantity::Positive,
        }
    }

    /// Number of normally distributed random numbers that the sensor needs in a step, and number of all its random numbers.
    ///
    /// The normal numbers come first: those for the drift, then those for Gaussian noise. Two uniform numbers for dropout and jitter
    /// follow, then those for uniform noise. If `sampling` is false, the sensor takes no sample in this step and needs no numbers for
    /// noise.
    #[inline(always)]
    fn draws_of(&self, sampling: bool) -> (usize, usize) {
        let drift = self.noise_at();
        let noise = if self.noisy { self.freedom } else { 0 };
        match (sampling, self.jittery) {
            (true, _) if self.uniform => (drift, self.uniform_at() + noise),
            (true, _) => (drift + noise, self.uniform_at()),
            (false, true) => (drift, self.uniform_at()),
            (false, false) => (drift, drift),
        }
    }

    /// Offset of the numbers for Gaussian noise among the sensor's random numbers of a step.
    #[inline(always)]
    fn noise_at(&self) -> usize {
        if self.drifts { self.freedom } else { 0 }
    }

    /// Offset of the two numbers for dropout and jitter among the sensor's random numbers. It is even, because normal numbers are drawn in
    /// pairs.
    #[inline(always)]
    fn timing_at(&self) -> usize {
        (self.noise_at() + if self.noisy && !self.uniform { self.freedom } else { 0 }).next_multiple_of(2)
    }

    /// Offset of the numbers for uniform noise among the sensor's random numbers of a step.
    #[inline(always)]
    fn uniform_at(&self) -> usize {
        self.timing_at() + if self.lossy || self.jittery { 2 } else { 0 }
    }

    fn size(&self) -> usize {
        self.line_at() - self.memory + self.line.max(1) * self.dim
    }

    fn matrix_at(&self) -> usize {
        self.memory
    }

    fn bias_at(&self) -> usize {
        self.memory + if self.mixed { self.dim * self.dim } else { 0 }
    }

    fn drift_at(&self) -> usize {
        self.bias_at() + if self.biased { self.freedom } else { 0 }
    }

    fn phase_at(&self) -> usize {
        self.drift_at() + if self.drifts { self.freedom } else { 0 }
    }

    /// Address of the sensor's delay line, or of its previous sample without a delay.
    fn line_at(&self) -> usize {
        self.phase_at() + usize::from(self.sampled)
    }
}
