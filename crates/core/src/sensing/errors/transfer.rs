//! Parameters of a sensor's transfer function, with their checks.

use serde::{Deserialize, Serialize};

use crate::model::actuator_spec::any_nonzero;
use crate::model::{DeviceError, Quantity};

/// Transfer function of one sensor. Every list has one value for all environments, or one value for each.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Transfer {
    /// Factor by which all channels are multiplied.
    pub scale: Vec<f64>,
    /// Matrix that multiplies the channels before the factor `scale`, (dim, dim), row-major. Empty for the identity.
    pub matrix: Vec<f64>,
    /// Standard deviation of each channel's relative scale error, which is drawn at reset.
    pub scale_std: Vec<f64>,
    /// Standard deviation of the misalignment of two channels, drawn at reset, rad: fraction of one channel that is added to another
    /// channel.
    pub misalignment_std: Vec<f64>,
    /// Constant bias of all channels, in the sensor's unit.
    pub bias: Vec<f64>,
    /// Standard deviation of an additional bias that is drawn at reset.
    pub bias_std: Vec<f64>,
    /// Random walk density of the drift, in the sensor's unit per sqrt(s).
    pub drift_std: Vec<f64>,
    /// Correlation time of the drift, s; infinite for a random walk.
    pub drift_time: Vec<f64>,
    /// Standard deviation of a sample's noise, in the sensor's unit. Half width if the noise is uniform.
    pub noise_std: Vec<f64>,
    /// Whether the noise is uniform instead of Gaussian.
    pub uniform: bool,
    /// Density of Gaussian white noise, in the sensor's unit per sqrt(Hz); 0 if the noise is uniform.
    pub noise_density: Vec<f64>,
    /// Quantisation step of the readings; 0 for none.
    pub quantum: Vec<f64>,
    /// Lowest reading, in the sensor's unit. Lower readings are clipped to it.
    pub low: Vec<f64>,
    /// Highest reading, in the sensor's unit. Higher readings are clipped to it.
    pub high: Vec<f64>,
    /// Sampling period, s; 0 for a sample in every step.
    pub period: Vec<f64>,
    /// Delay of the readings, s.
    pub delay: Vec<f64>,
    /// Half width of the random variation of the delay from step to step, s.
    pub jitter: Vec<f64>,
    /// Probability that a sample is lost, so that the reading repeats the previous sample.
    pub dropout: Vec<f64>,
}

/// Longest delay that the check allows, in steps.
const LONGEST: f64 = 100_000.0;

impl Transfer {
    fn fields(&self) -> [(&'static str, &[f64]); 16] {
        [
            ("scale", &self.scale),
            ("scale_std", &self.scale_std),
            ("misalignment_std", &self.misalignment_std),
            ("bias", &self.bias),
            ("bias_std", &self.bias_std),
            ("drift_std", &self.drift_std),
            ("drift_time", &self.drift_time),
            ("noise_std", &self.noise_std),
            ("noise_density", &self.noise_density),
            ("quantum", &self.quantum),
            ("limits", &self.low),
            ("limits", &self.high),
            ("period", &self.period),
            ("delay", &self.delay),
            ("jitter", &self.jitter),
            ("dropout", &self.dropout),
        ]
    }

    /// Whether all environments have the same parameters.
    pub(super) fn is_shared(&self) -> bool {
        self.fields().iter().all(|(_, x)| x.len() == 1)
    }

    /// Checks the ranges of all parameters. The error names the first one that is out of range. `dim` is the number of channels, `h` the
    /// time step, s.
    pub(super) fn check(&self, dim: usize, quantity: Quantity, num_envs: usize, h: f64) -> Result<(), DeviceError> {
        for (name, x) in self.fields() {
            if x.len() != 1 && x.len() != num_envs {
                return Err(DeviceError::Count { name, found: x.len(), num_envs });
            }
            let signed = matches!(name, "scale" | "bias" | "limits");
            let open = matches!(name, "limits" | "drift_time");
            if let Some(v) = x.iter().find(|v| v.is_nan() || (!signed && **v < 0.0) || (!open && v.is_infinite())) {
                let must = if signed { "a number" } else { "a finite number of at least 0" };
                return Err(DeviceError::Range { name, found: *v, must });
            }
        }
        let each = |x: &[f64], env: usize| x[env % x.len()];
        for env in 0..num_envs {
            let (low, high) = (each(&self.low, env), each(&self.high, env));
            if low > high {
                return Err(DeviceError::Limits { low, high });
            }
            let (dropout, drift_time) = (each(&self.dropout, env), each(&self.drift_time, env));
            if dropout > 1.0 {
                return Err(DeviceError::Range { name: "dropout", found: dropout, must: "a probability from 0 to 1" });
            }
            if drift_time == 0.0 {
                return Err(DeviceError::Range { name: "drift_time", found: 0.0, must: "above 0 s, or None for a random walk" });
            }
            let steps = (each(&self.delay, env) + each(&self.jitter, env)) / h;
            if steps > LONGEST {
                return Err(DeviceError::TooLong { name: "delay and jitter", steps, timestep: h, longest: LONGEST });
            }
        }
        if let Some(density) = self.noise_density.iter().find(|x| self.uniform && **x != 0.0) {
            // With uniform noise `noise_std` is a half width, to which no density can be added.
            return Err(DeviceError::Range { name: "noise_density", found: *density, must: "0 with uniform noise" });
        }
        if !self.matrix.is_empty() && (self.matrix.len() != dim * dim || !self.matrix.iter().all(|x| x.is_finite())) {
            return Err(DeviceError::Matrix { found: self.matrix.len(), dim });
        }
        let scaled = self.scale.iter().any(|&x| x != 1.0) || [&self.scale_std, &self.misalignment_std].iter().any(|x| any_nonzero(x));
        if matches!(quantity, Quantity::Axis | Quantity::Quaternion) && (scaled || !self.matrix.is_empty()) {
            return Err(DeviceError::ScaledDirection);
        }
        Ok(())
    }
}
