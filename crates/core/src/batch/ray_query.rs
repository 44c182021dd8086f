//! Ray queries for many environments in one call.

use stepper_real::{Real, Scalar, kernel};

use crate::batch::exchange::gather;
use crate::compile::LaneModel;
use crate::compile::sensing::Target;
use crate::dynamics::kinematics::Kinematics;
use crate::math::spatial::*;
use crate::sensing::{Placed, nearest};

/// Rays of all environments, for [`Simulation::cast_rays`](crate::Simulation::cast_rays). Each array is (num_envs, count, 3), or (count, 3)
/// to share the rays among all environments.
#[derive(Clone, Copy, Debug)]
pub struct RayCast<'a> {
    /// Origins of the rays, world axes, m.
    pub points: &'a [f64],
    /// Directions of the rays in world axes, of any length above 0.
    pub directions: &'a [f64],
    /// Number of rays per environment.
    pub count: usize,
    /// Geoms that the rays can hit, as indices in the model.
    pub geoms: &'a [usize],
}

/// Ray query of a group of environments: rays, and the geoms that they can hit.
#[derive(Clone, Copy, Debug)]
pub struct RayQuery<'a, S> {
    /// Rays of the query, with directions of unit length.
    pub rays: RayCast<'a>,
    /// Geoms that the rays can hit: index in the model, and ray target.
    pub targets: &'a [(usize, Target<S>)],
}

impl<S: Scalar> RayQuery<'_, S> {
    /// Casts the rays of the environments from `first` on, one environment per lane. Writes the distances, m, and geoms of the first hits,
    /// one row per environment. Both are -1 for a ray without a hit.
    pub(super) fn cast<R: Real<Scalar = S>>(
        &self,
        compiled: &LaneModel<R>,
        kinematics: &Kinematics<R>,
        first: usize,
        distances: &mut [S],
        geoms: &mut [i32],
    ) {
        let count = self.rays.count;
        let used = distances.len() / count;
        let lanes = (u64::MAX >> (64 - used)) as u32;
        let placed: Vec<_> =
            kernel!(R, || self.targets.iter().map(|(geom, target)| (*geom, Placed::new(compiled, kinematics, target))).collect());
        for ray in 0..count {
            let [origin, direction] = [self.rays.points, self.rays.directions].map(|rows| {
                let mut x = zero::<R, 3>();
                gather(&rows[3 * ray..], 3 * count, first, used, &mut x);
                x
            });
            let (distance, geom) = nearest::<R>(compiled, &placed, lanes, origin, direction);
            for lane in 0..used {
                distances[lane * count + ray] = distance.lane(lane);
                geoms[lane * count + ray] = geom.lane(lane).to_f64() as i32;
            }
        }
    }
}
