//! Types of an actuator's gain and bias: which of its parameters they read.

use serde::{Deserialize, Serialize};

/// MuJoCo's gaintype: which parameters the gain of an actuator reads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum GainType {
    /// A constant.
    Fixed,
    /// Constant, per length, per velocity.
    #[default]
    Affine,
    /// DC motor: its parameters are resistance and motor constant, and the control is the voltage.
    DcMotor,
    /// Position target of a PID controller without integral term; its gain is `-bias[1]`.
    PidPosition,
    /// Velocity target of a PID controller without integral term; its gain is `-bias[2]`.
    PidVelocity,
}

/// MuJoCo's biastype: which parameters the bias of an actuator reads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum BiasType {
    /// None.
    None,
    /// Constant, per length, per velocity.
    #[default]
    Affine,
    /// Back electromotive force of a DC motor: the gain has its parameters.
    DcMotor,
}

/// Formula by which an actuator's force follows from its parameters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct ForceModel {
    /// Type of the gain.
    pub gain: GainType,
    /// Type of the bias.
    pub bias: BiasType,
    /// Whether the source disables the actuator, so that its force is 0.
    pub disabled: bool,
}

impl GainType {
    /// MuJoCo's word.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Fixed => "fixed",
            Self::Affine => "affine",
            Self::DcMotor => "dcmotor",
            Self::PidPosition | Self::PidVelocity => "pid",
        }
    }

    /// Number of parameters that it reads.
    pub const fn width(self) -> usize {
        match self {
            Self::Fixed => 1,
            Self::Affine => 3,
            Self::DcMotor => 2,
            Self::PidPosition | Self::PidVelocity => 0,
        }
    }
}

impl BiasType {
    /// MuJoCo's word.
    pub const fn word(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Affine => "affine",
            Self::DcMotor => "dcmotor",
        }
    }

    /// Number of parameters that it reads.
    pub const fn width(self) -> usize {
        match self {
            Self::Affine => 3,
            Self::None | Self::DcMotor => 0,
        }
    }
}

impl ForceModel {
    /// Narrowest force model that reads all parameters that are not 0.
    pub fn of_parameters(gain: &[f64; 3], bias: &[f64; 3]) -> Self {
        let zero = |x: &[f64]| x.iter().all(|&x| x == 0.0);
        let gain = if zero(&gain[1..]) { GainType::Fixed } else { GainType::Affine };
        Self { gain, bias: if zero(bias) { BiasType::None } else { BiasType::Affine }, disabled: false }
    }
}
