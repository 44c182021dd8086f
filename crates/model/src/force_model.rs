//! Types of an actuator's gain and bias. A type determines the parameters on which the gain or bias depends.

use serde::{Deserialize, Serialize};

use crate::muscle::MUSCLE_PARAMETERS;

named! {
    /// Gain type (MuJoCo's gaintype), which determines the parameters of the gain.
    #[derive(Default, Serialize, Deserialize)]
    pub enum GainType {
        /// Constant gain.
        Fixed = "fixed",
        /// Affine gain with three parameters: constant, factor of length, factor of velocity.
        #[default]
        Affine = "affine",
        /// Gain of a DC motor: the parameters are resistance and motor constant, and the control is the voltage.
        DcMotor = "dcmotor",
        /// Gain of the target position in a PID controller without integral term. It is `-bias[1]`, with the bias parameters of the
        /// actuator.
        PidPosition = "pid",
        /// Gain of the target velocity in a PID controller without integral term. It is `-bias[2]`, with the bias parameters of the
        /// actuator.
        PidVelocity = "pid",
        /// Active force of a muscle ([`Muscle::gain`](crate::Muscle::gain)).
        Muscle = "muscle",
    }
}

named! {
    /// Bias type (MuJoCo's biastype), which determines the parameters of the bias.
    #[derive(Default, Serialize, Deserialize)]
    pub enum BiasType {
        /// No bias.
        None = "none",
        /// Affine bias with three parameters: constant, factor of length, factor of velocity.
        #[default]
        Affine = "affine",
        /// Back-EMF of a DC motor, with the parameters of the gain.
        DcMotor = "dcmotor",
        /// Passive force of a muscle ([`Muscle::bias`](crate::Muscle::bias)).
        Muscle = "muscle",
    }
}

/// Types of an actuator's gain and bias, which define how the actuator's force follows from its parameters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct ForceModel {
    /// Type of the gain.
    pub gain: GainType,
    /// Type of the bias.
    pub bias: BiasType,
    /// Whether the source file disables the actuator, so that its force is 0.
    pub disabled: bool,
}

impl GainType {
    /// Number of parameters of the gain type.
    pub const fn width(self) -> usize {
        match self {
            Self::Fixed => 1,
            Self::Affine => 3,
            Self::DcMotor => 2,
            Self::PidPosition | Self::PidVelocity => 0,
            Self::Muscle => MUSCLE_PARAMETERS,
        }
    }
}

impl BiasType {
    /// Number of parameters of the bias type.
    pub const fn width(self) -> usize {
        match self {
            Self::Affine => 3,
            Self::None | Self::DcMotor => 0,
            Self::Muscle => MUSCLE_PARAMETERS,
        }
    }
}

impl ForceModel {
    /// Simplest force model that uses all nonzero parameters in `gain` and `bias`.
    pub fn of_parameters(gain: &[f64; 3], bias: &[f64; 3]) -> Self {
        let zero = |x: &[f64]| x.iter().all(|&x| x == 0.0);
        let gain = if zero(&gain[1..]) { GainType::Fixed } else { GainType::Affine };
        Self { gain, bias: if zero(bias) { BiasType::None } else { BiasType::Affine }, disabled: false }
    }
}
