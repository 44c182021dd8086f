//! Stiffness and damping of a model's soft contacts in SI units.

use crate::analysis::inverse_weights::inverse_weights;
use crate::compile::{CompiledModel, CompiledPair, SoftContactLaw, SoftLaw};
use crate::model::Model;

/// Spring and damper that are equivalent to the contacts of two geoms with MuJoCo's contact law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EquivalentSpring {
    /// Indices of the geoms in the model, the simpler shape first.
    pub geoms: [usize; 2],
    /// Normal force per depth at rest, N/m, at two depths: at first touch, and at the depth at which the impedance reaches its final value.
    pub stiffness: [f64; 2],
    /// Normal force per velocity, N s/m, at two depths: at first touch, and at the depth at which the impedance reaches its final value.
    pub damping: [f64; 2],
}

/// Computes the equivalent spring and damper of the contacts of every pair in the compiled model's list of pairs. The inputs are the pair's
/// solref and solimp and the model's time step.
pub fn equivalent_springs(model: &Model) -> Vec<EquivalentSpring> {
    let mut compiled = CompiledModel::<f64>::new(model);
    let weights = model.soft.inverse_weights.clone().unwrap_or_else(|| inverse_weights(model));
    compiled.soften(model, &weights, model.timestep);
    let structure = compiled.structure;
    let laws = structure.softness.expect("it was just added").pairs;
    let spring = |(pair, law): (&CompiledPair<f64>, &SoftContactLaw<f64>)| {
        let [start, most] = [0.0, f64::MAX].map(|depth: f64| law.normal.impedance(depth));
        let per = |impedance: f64| SoftLaw::<f64>::regularisation(impedance, law.normal.weight).recip();
        EquivalentSpring {
            geoms: pair.geoms.map(|g| structure.geoms[g].index),
            stiffness: [start, most].map(|d| law.normal.stiffness * d * per(d)),
            damping: [start, most].map(|d| law.normal.damping * per(d)),
        }
    };
    structure.pairs.iter().zip(&laws).map(spring).collect()
}
