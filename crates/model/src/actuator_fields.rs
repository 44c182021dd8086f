//! Fields of an actuator in MuJoCo's shapes: gear, gain parameters and bias parameters.

use crate::{Actuator, BiasType, Description, ForceModel, GainType, ModelError, Transmission};

/// Number of values of one actuator in the field `actuator_gear`.
pub(crate) const GEAR: usize = 6;
/// Number of values of one actuator in the fields `actuator_gainprm` and `actuator_biasprm`.
pub(crate) const PARAMETERS: usize = 10;

/// Coefficients of an affine actuator force: first those of the gain, then those of the bias. Each array has the constant, the factor of
/// the length, and the factor of the velocity.
pub type AffineForce = ([f64; 3], [f64; 3]);

impl Actuator {
    /// Whether the actuator's force depends on its length or velocity.
    pub fn force_depends_on_motion(&self) -> bool {
        let (gain, bias) = self.affine_force();
        self.is_muscle() || [gain[1], gain[2], bias[1], bias[2]].iter().any(|&x| x != 0.0)
    }

    /// Whether the active or the passive force is that of a muscle, and the actuator is not disabled.
    pub fn is_muscle(&self) -> bool {
        let ForceModel { gain, bias, disabled } = self.force_model;
        !disabled && (gain == GainType::Muscle || bias == BiasType::Muscle)
    }

    /// Parameters of the gain that the actuator uses.
    pub fn gain_parameters(&mut self) -> &mut [f64] {
        match self.force_model.gain {
            GainType::Muscle => &mut self.muscle.gain,
            gain => &mut self.gain[..gain.width()],
        }
    }

    /// Parameters of the bias that the actuator uses.
    pub fn bias_parameters(&mut self) -> &mut [f64] {
        match self.force_model.bias {
            BiasType::Muscle => &mut self.muscle.bias,
            bias => &mut self.bias[..bias.width()],
        }
    }

    /// Coefficients of the affine force that equals the actuator's force, for any type of gain and bias but those of muscles, which
    /// contribute nothing. They are zero for a disabled actuator.
    pub fn affine_force(&self) -> AffineForce {
        const ZERO: [f64; 3] = [0.0; 3];
        let ForceModel { gain, bias, disabled } = self.force_model;
        if disabled {
            return (ZERO, ZERO);
        }
        let factors = match gain {
            GainType::Fixed => [self.gain[0], 0.0, 0.0],
            GainType::Affine => self.gain,
            GainType::DcMotor => {
                let [resistance, constant, _] = self.gain;
                return ([constant / resistance, 0.0, 0.0], [0.0, 0.0, -(constant * constant) / resistance]);
            }
            GainType::PidPosition => [-self.bias[1], 0.0, 0.0],
            GainType::PidVelocity => [-self.bias[2], 0.0, 0.0],
            GainType::Muscle => ZERO,
        };
        (factors, if bias == BiasType::Affine { self.bias } else { ZERO })
    }

    /// Values of this actuator in the field `actuator_gear`. For an actuator on a site, the values are force and torque per unit of
    /// actuator force. For other transmissions, the first value scales length, velocity and force, and the other values are 0.
    pub fn gear_row(&self) -> [f64; GEAR] {
        match self.transmission {
            Transmission::Site { wrench, .. } | Transmission::JointWrench { wrench, .. } => wrench.map(|x| x * self.gear),
            _ => [self.gear, 0.0, 0.0, 0.0, 0.0, 0.0],
        }
    }

    /// Values of this actuator in the field `actuator_gainprm` or `actuator_biasprm`, padded with zeros. `read` returns the parameters:
    /// [`Actuator::gain_parameters`] or [`Actuator::bias_parameters`].
    pub fn parameter_row(&self, read: fn(&mut Self) -> &mut [f64]) -> [f64; PARAMETERS] {
        let mut actuator = self.clone();
        let parameters = read(&mut actuator);
        std::array::from_fn(|k| parameters.get(k).copied().unwrap_or(0.0))
    }

    /// Property of the actuator that determines how many columns of `field` it uses, and this number of columns. The property is a text
    /// such as "it acts on a joint".
    fn reads(&self, field: &str) -> (String, usize) {
        match (field, self.transmission) {
            ("actuator_gainprm", _) => (format!("its gaintype is {:?}", self.force_model.gain.name()), self.force_model.gain.width()),
            ("actuator_biasprm", _) => (format!("its biastype is {:?}", self.force_model.bias.name()), self.force_model.bias.width()),
            (_, Transmission::Joint(_)) => ("it acts on a joint".into(), 1),
            (_, Transmission::Tendon(_)) => ("it acts on a tendon".into(), 1),
            (_, Transmission::SliderCrank { .. }) => ("it acts on a slider-crank".into(), 1),
            (_, Transmission::Body(_)) => ("it acts on the contacts of a body".into(), 0),
            (_, Transmission::JointWrench { .. }) => ("it acts on a ball or free joint".into(), GEAR),
            (_, Transmission::Site { .. }) => ("it acts on a site".into(), GEAR),
        }
    }
}

/// Calls `f` for each of the [`GEAR`] columns of every actuator in the field `actuator_gear`. `f` may change all columns of an actuator on
/// a site, and the first column of other actuators. A change of other columns has no effect.
pub(crate) fn gear(model: &mut Description, f: &mut dyn FnMut(&mut f64)) {
    for actuator in &mut model.actuators {
        let before = actuator.gear_row();
        let mut row = before;
        row.iter_mut().for_each(&mut *f);
        match &mut actuator.transmission {
            Transmission::Joint(_) | Transmission::Tendon(_) | Transmission::SliderCrank { .. } => actuator.gear = row[0],
            Transmission::Site { wrench, .. } | Transmission::JointWrench { wrench, .. }
                if row.map(f64::to_bits) != before.map(f64::to_bits) =>
            {
                (*wrench, actuator.gear) = (row, 1.0);
            }
            Transmission::Site { .. } | Transmission::JointWrench { .. } | Transmission::Body(_) => {}
        }
    }
}

/// Calls `f` for each of the [`PARAMETERS`] columns of every actuator. `read` returns the values that the actuator uses, which are the
/// first columns, and which `f` may change. For each remaining column, `f` gets a zero, whose change has no effect.
pub(crate) fn parameters(model: &mut Description, f: &mut dyn FnMut(&mut f64), read: fn(&mut Actuator) -> &mut [f64]) {
    for values in model.actuators.iter_mut().map(read) {
        let others = PARAMETERS - values.len();
        values.iter_mut().for_each(&mut *f);
        (0..others).for_each(|_| f(&mut 0.0));
    }
}

/// Error for a new value in a column of `field` that the actuator does not use. `value` is the new value and `k` its index in the flat
/// array. The result is `None` for fields other than the gear, gain parameters and bias parameters of actuators.
pub(crate) fn unread(model: &Description, field: &str, k: usize, value: f64) -> Option<ModelError> {
    let width = match field {
        "actuator_gear" => GEAR,
        "actuator_gainprm" | "actuator_biasprm" => PARAMETERS,
        _ => return None,
    };
    let (i, column) = (k / width, k % width);
    let actuator = &model.actuators[i];
    let (reason, read) = actuator.reads(field);
    let columns = match read {
        0 => "no column".to_owned(),
        1 => "column 0 alone".to_owned(),
        _ => format!("columns 0 to {}", read - 1),
    };
    let what = format!("{field} is {value} in column {column}, which the actuator does not read: {reason}, which reads {columns}");
    let remedy = match (field, read) {
        ("actuator_biasprm", 0) => "give 0 there, or load a model whose actuator has biastype=\"affine\"",
        ("actuator_gainprm", 1) => "give 0 there, or load a model whose actuator has gaintype=\"affine\"",
        _ => "give 0 there",
    };
    Some(ModelError::invalid(format!("actuator {:?}", model.actuator_label(i)), what, remedy))
}
