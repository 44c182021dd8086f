//! Compiled adhesion: gaps up to which actuators on the contacts of a body pull.

use stepper_real::Scalar;

use crate::compile::collision::{CompiledGeom, CompiledPair, DynamicPairs};
use crate::compile::tree::scalars;
use crate::model::{Actuator, Filter, Model, Transmission};

/// Distance beyond margin + gap up to which adhesion pulls with hard contact, m. Evidence: gaps at rest are below 1e-9 m, and below 1e-6 m
/// in 32 bits; with 0, a hanging box falls as soon as rounding opens its gap.
pub(crate) const ADHESION_REACH: f64 = 1e-5;

/// Gaps of contacts in a model with actuators on the contacts of a body. Such an actuator pulls contacts within margin + gap.
#[derive(Clone, Debug)]
pub struct CompiledAdhesion<S> {
    /// Gap of each listed pair, m.
    pairs: Vec<S>,
    /// Gap of each geom of the compiled model, m. The gap of a dynamic pair is the sum of the gaps of its geoms.
    geoms: Vec<S>,
    /// Largest gap of a contact on which an actuator pulls, m.
    pub largest: S,
}

impl<S: Scalar> CompiledAdhesion<S> {
    /// Compiles the gaps; `None` for a model without actuators on the contacts of a body.
    pub(super) fn new(
        model: &Model,
        geoms: &[CompiledGeom<S>],
        pairs: &[CompiledPair<S>],
        dynamic_pairs: Option<&DynamicPairs<S>>,
    ) -> Option<Self> {
        let body = |a: &Actuator| if let Transmission::Body(body) = a.transmission { Some(body) } else { None };
        let bodies: Vec<usize> = model.actuators.iter().filter_map(body).collect();
        if bodies.is_empty() {
            return None;
        }
        let filter = Filter::new(model);
        let is_adhesive = |g: usize| bodies.contains(&model.geoms[g].body);
        let gap = |g: usize| model.geoms[g].gap;
        let (mut of_pairs, mut largest) = (vec![], 0.0_f64);
        for pair in pairs {
            let [a, b] = pair.geoms.map(|g| geoms[g].index);
            let gap = filter.pair([a, b]).map_or(0.0, |pair| pair.gap);
            of_pairs.push(S::from_f64(gap));
            largest = if is_adhesive(a) || is_adhesive(b) { largest.max(gap) } else { largest };
        }
        if dynamic_pairs.is_some() {
            let all = (0..model.geoms.len()).map(gap).fold(0.0, f64::max);
            let adhesive = (0..model.geoms.len()).filter(|&g| is_adhesive(g)).map(gap).fold(0.0, f64::max);
            largest = largest.max(all + adhesive);
        }
        let of_geoms = geoms.iter().map(|g| S::from_f64(gap(g.index))).collect();
        let [largest] = scalars([largest]);
        Some(Self { pairs: of_pairs, geoms: of_geoms, largest })
    }

    /// Gap of the pair with index `pair`, whose geoms are `geoms`, m.
    pub fn gap(&self, pair: usize, geoms: [usize; 2]) -> f64 {
        match self.pairs.get(pair) {
            Some(gap) => gap.to_f64(),
            None => self.geoms[geoms[0]].to_f64() + self.geoms[geoms[1]].to_f64(),
        }
    }
}
