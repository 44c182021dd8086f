//! Collision geometry: where geoms are fixed, and the pairs that can touch.

use stepper_real::Scalar;

use super::merge::{Merged, matrix, quaternion, vector};
use super::scalars;
use crate::model::{Kernel, Model, Shape};

/// A geom that takes part in collision.
#[derive(Clone, Debug)]
pub struct GeomPlan<S> {
    /// Its index in the model.
    pub index: usize,
    /// The frame that it is fixed to.
    pub frame: usize,
    /// Its origin in the frame, m.
    pub pos: [S; 3],
    /// Its orientation in the frame.
    pub mat: [S; 9],
    /// Whether any pair reads more of its orientation than its z axis.
    pub full_orientation: bool,
    /// radius, half length (capsule) or half sizes (box), m.
    pub size: [S; 3],
    /// Radius of a ball about its origin that holds it; infinite for a plane, m.
    pub bound: S,
}

/// Two geoms that can touch.
#[derive(Clone, Debug)]
pub struct PairPlan<S> {
    /// Indices into the plan's geoms.
    pub geoms: [usize; 2],
    /// Narrow phase.
    pub kernel: Kernel,
    /// Sliding friction; 0 for a frictionless contact.
    pub mu: S,
    /// Coefficient of restitution.
    pub restitution: S,
    /// Distance at which the contact pushes, m.
    pub margin: S,
    /// Sum of the bounding radii; of the second geom alone when the first is a plane, m.
    pub reach: S,
}

pub(crate) fn compile<S: Scalar>(model: &Model, merged: &Merged) -> (Vec<GeomPlan<S>>, Vec<PairPlan<S>>) {
    let mut slot = vec![None; model.geoms.len()];
    let mut geoms: Vec<GeomPlan<S>> = Vec::new();
    let mut pairs = Vec::new();
    for pair in model.collision_pairs() {
        let shapes = pair.geoms.map(|g| &model.geoms[g].shape);
        let Some(kernel) = Kernel::of(shapes[0], shapes[1]) else { continue };
        let [a, b] = pair.geoms.map(|g| {
            *slot[g].get_or_insert_with(|| {
                geoms.push(geom(model, merged, g));
                geoms.len() - 1
            })
        });
        let reach = if kernel == Kernel::Segments { bound(shapes[0]) } else { 0.0 } + bound(shapes[1]);
        pairs.push(PairPlan {
            geoms: [a, b],
            kernel,
            mu: S::from_f64(if pair.condim == 1 { 0.0 } else { pair.friction[0] }),
            restitution: S::from_f64(pair.restitution),
            margin: S::from_f64(pair.margin),
            reach: S::from_f64(reach),
        });
    }
    (geoms, pairs)
}

fn geom<S: Scalar>(model: &Model, merged: &Merged, index: usize) -> GeomPlan<S> {
    let g = &model.geoms[index];
    let (bp, bq) = (merged.pos[g.body], merged.quat[g.body]);
    let pos = bp + bq * vector(g.pos);
    let quat = bq * quaternion(g.quat);
    let size = match g.shape {
        Shape::Sphere { radius } => [radius, 0.0, 0.0],
        Shape::Capsule { radius, half_length } => [radius, half_length, 0.0],
        Shape::Box { half } => half,
        _ => [0.0; 3],
    };
    GeomPlan {
        index,
        frame: merged.frame[g.body],
        pos: scalars(pos.into()),
        mat: matrix(&quat),
        full_orientation: matches!(g.shape, Shape::Box { .. }),
        size: scalars(size),
        bound: S::from_f64(bound(&g.shape)),
    }
}

/// Radius of a ball about the geom's origin that holds it.
fn bound(shape: &Shape) -> f64 {
    match *shape {
        Shape::Plane | Shape::HeightField { .. } => f64::INFINITY,
        Shape::Sphere { radius } | Shape::Mesh { radius, .. } => radius,
        Shape::Capsule { radius, half_length } => radius + half_length,
        Shape::Cylinder { radius, half_length } => radius.hypot(half_length),
        Shape::Ellipsoid { radii } => radii.into_iter().fold(0.0, f64::max),
        Shape::Box { half } => vector(half).norm(),
    }
}
