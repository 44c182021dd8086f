//! Lane model: compiled model whose parameters have one value per lane.

use stepper_real::Real;

use crate::compile::compiled_model::CompiledModel;
use crate::compile::parameters::*;
use crate::compile::softness::{CompiledSoftness, SoftContactLaw};

/// Compiled model of a group of lanes (one environment per lane): structure that all environments share, and parameters of each lane.
///
/// In a worker, they are the parameters of the group that the worker steps. `LaneModel<f64>` has one lane, with the parameters of the model
/// or of one environment.
pub type LaneModel<R> = CompiledModel<<R as Real>::Scalar, R>;

impl<R: Real> LaneModel<R> {
    /// Contact parameters of the pair with index `pair`: friction and restitution. Listed pairs have a row in the table of parameters.
    /// Dynamic pairs, whose indices follow, combine the parameters of their two geoms (`compile/collision.rs`).
    #[inline(always)]
    pub fn contact(&self, pair: usize) -> ContactParams<R> {
        match self.structure.dynamic_pairs.as_ref() {
            Some(dynamic_pairs) if pair >= self.structure.pairs.len() => dynamic_pairs.contact(pair, &self.params),
            _ => self.params.listed_contact(pair),
        }
    }

    /// MuJoCo's contact law for the pair with index `pair`.
    #[inline(always)]
    pub fn soft_contact(&self, softness: &CompiledSoftness<R::Scalar>, pair: usize) -> SoftContactLaw<R::Scalar> {
        match softness.pairs.get(pair) {
            Some(law) => *law,
            None => self.unlisted_soft_contact(softness, pair),
        }
    }

    #[cold]
    #[inline(never)]
    fn unlisted_soft_contact(&self, softness: &CompiledSoftness<R::Scalar>, pair: usize) -> SoftContactLaw<R::Scalar> {
        let pair =
            self.dynamic_pairs.as_ref().and_then(|dynamic_pairs| dynamic_pairs.geom_pair(pair)).expect("a contact belongs to a pair");
        softness.maker.contact(&pair, softness.geom_weights[pair.geoms[0]] + softness.geom_weights[pair.geoms[1]])
    }

    /// Inverse mass of the body of a frame, as if it were free, 1/kg; 0 for the world and mocap bodies.
    #[inline(always)]
    pub fn mobility(&self, frame: usize) -> R {
        if frame == 0 || frame > self.links.len() {
            return R::zero();
        }
        let mass = self.params.inertial(frame - 1).mass;
        let heavy = mass.gt(R::zero());
        R::select(heavy, R::one() / R::select(heavy, mass, R::one()), R::zero())
    }

    /// Total mass of all links, kg.
    #[inline(always)]
    pub fn moving_mass(&self) -> R {
        let mut sum = R::zero();
        for link in 0..self.links.len() {
            sum += self.params.inertial(link).mass;
        }
        sum
    }

    /// Sum of the bounding radii of two geoms, m. If the first geom is a plane, the bounding radius of the second.
    #[inline(always)]
    pub fn reach(&self, [a, b]: [usize; 2]) -> R {
        let second = self.params.geom(b).bounding_radius;
        if self.structure.geoms[a].is_plane { second } else { self.params.geom(a).bounding_radius + second }
    }

    /// Tunnelling distance of a pair of geoms, m: largest relative displacement after which contacts still push the geoms back to the side
    /// from which they came.
    ///
    /// The distance is half the sum of the geoms' inscribed radii; infinite if one of them is a plane.
    #[inline(always)]
    pub fn tunnelling_distance(&self, [a, b]: [usize; 2]) -> R {
        R::of(0.5) * (self.params.geom(a).inscribed_radius + self.params.geom(b).inscribed_radius)
    }
}
