//! The transfer function of real sensors:
//!
//! ```text
//! truth -> scale and misalignment -> + bias + drift + noise -> quantisation -> clip -> sample and hold -> delay -> observation
//! ```
//!
//! Bias, scale error and misalignment are drawn at reset. Drift d is a random walk with `drift_std` per sqrt(s), or with a correlation time tau
//! the Gauss-Markov process that the same driving noise makes: d+ = e^(-h/tau) d + drift_std sqrt(tau/2 (1 - e^(-2h/tau))) n (Brown and Hwang
//! 2012, section 5.5). A noise density N per sqrt(Hz) is white noise of N / sqrt(T) at a sampling time of T, so that the Allan deviation
//! at 1 s is N whatever the time step (IEEE 952). Unit vectors and quaternions are turned by bias, drift and noise as a rotation vector.

mod delay;
mod draws;
mod observe;
mod transfer;

use stepper_real::Scalar;

use crate::model::{Model, Quantity};
pub use draws::Keys;
pub use observe::{Slots, Work};
pub use transfer::Transfer;
use transfer::any;

/// Numbers of a sensor that may differ between environments, in the order of the table.
#[derive(Clone, Copy)]
enum Number {
    Scale,
    ScaleStd,
    MisalignmentStd,
    BiasStd,
    Decay,
    Kick,
    Noise,
    Quantum,
    Low,
    High,
    Period,
    Delay,
    Jitter,
    Dropout,
}

const NUMBERS: usize = 14;

/// One sensor that is not ideal.
#[derive(Clone, Debug)]
struct Imperfect<S> {
    sensor: usize,
    at: usize,
    dim: usize,
    /// Numbers that bias, drift and noise have: three where they are a rotation.
    freedom: usize,
    quantity: Quantity,
    matrix: Vec<S>,
    uniform: bool,
    mixed: bool,
    scaled: bool,
    biased: bool,
    drifts: bool,
    noisy: bool,
    quantised: bool,
    clipped: bool,
    sampled: bool,
    lossy: bool,
    jittery: bool,
    /// Address of its numbers in the memory: matrix, bias, drift, phase and held sample, delay line.
    memory: usize,
    /// Samples of the delay line; 0 without one.
    line: usize,
    /// Address of its place in the table.
    table: usize,
}

/// The transfer functions of a model's sensors in a batch.
#[derive(Clone, Debug)]
pub struct Errors<S> {
    sensors: Vec<Imperfect<S>>,
    /// The numbers of every sensor, lane-interleaved: for every group of lanes, or once where they are the same in all environments, so that
    /// they stay in cache from group to group.
    tables: Vec<Vec<S>>,
    /// Numbers that survive a step, per lane.
    pub memory: usize,
    /// Delay lines.
    pub lines: usize,
}

impl<S: Scalar> Errors<S> {
    /// `transfers` has an entry for every sensor of the model, `None` for ideal ones.
    ///
    /// # Errors
    /// The first number out of its range, with the sensor's name.
    pub fn new(model: &Model, transfers: &[Option<Transfer>], num_envs: usize, lanes: usize, h: f64) -> Result<Self, String> {
        let addresses = model.sensor_addresses();
        let shared = transfers.iter().flatten().all(Transfer::is_shared);
        let tables = vec![vec![]; if shared { 1 } else { num_envs.div_ceil(lanes) }];
        let mut errors = Self { sensors: vec![], tables, memory: 0, lines: 0 };
        for (i, (sensor, transfer)) in model.sensors.iter().zip(transfers).enumerate() {
            let Some(t) = transfer else { continue };
            let (dim, quantity) = (sensor.dim(&model.sensors), sensor.quantity());
            t.check(dim, quantity, num_envs, h).map_err(|e| format!("transfer of sensor {:?}: {e}", model.sensor_label(i)))?;
            let placed = Imperfect::new(t, i, addresses[i], dim, quantity, h, errors.memory, errors.sensors.len() * NUMBERS);
            errors.memory += placed.size();
            errors.lines += 1;
            errors.sensors.push(placed);
            for (g, table) in errors.tables.iter_mut().enumerate() {
                let rows: Vec<[f64; NUMBERS]> = (0..lanes).map(|l| numbers(t, (g * lanes + l).min(num_envs - 1), h)).collect();
                table.extend((0..NUMBERS).flat_map(|n| rows.iter().map(move |row| S::from_f64(row[n]))));
            }
        }
        Ok(errors)
    }

    /// The numbers of a group of lanes.
    fn table(&self, group: usize) -> &[S] {
        &self.tables[if self.tables.len() == 1 { 0 } else { group }]
    }

    /// Sensors that are not ideal, by their numbers in the model.
    pub fn sensors(&self) -> impl Iterator<Item = usize> {
        self.sensors.iter().map(|s| s.sensor)
    }

    /// Whether every sensor is ideal.
    pub fn is_empty(&self) -> bool {
        self.sensors.is_empty()
    }
}

/// The table's row of one environment.
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
    #[expect(clippy::too_many_arguments, reason = "where a sensor is in every list")]
    fn new(t: &Transfer, sensor: usize, at: usize, dim: usize, quantity: Quantity, h: f64, memory: usize, table: usize) -> Self {
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
            mixed: !t.matrix.is_empty() || any(&t.scale_std) || any(&t.misalignment_std),
            scaled: t.scale.iter().any(|&x| x != 1.0),
            biased: any(&t.bias_std),
            drifts: any(&t.drift_std),
            noisy: any(&t.noise_std) || any(&t.noise_density),
            quantised: any(&t.quantum),
            clipped: t.low.iter().chain(&t.high).any(|x| x.is_finite()),
            sampled: any(&t.period),
            lossy: any(&t.dropout),
            jittery: any(&t.jitter),
            memory,
            line: if delay > 0.0 { delay.ceil() as usize + 2 } else { 0 },
            table,
        }
    }

    /// Where the noise begins among the numbers drawn in a step: Gaussian noise comes in one draw with the drift and after it.
    fn noise_at(&self) -> usize {
        if self.drifts && self.noisy && !self.uniform { self.freedom } else { 0 }
    }

    fn size(&self) -> usize {
        self.line_at() - self.memory + self.line * self.dim
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

    fn held_at(&self) -> usize {
        self.phase_at() + usize::from(self.sampled)
    }

    fn line_at(&self) -> usize {
        self.held_at() + self.dim
    }
}
