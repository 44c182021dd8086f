//! Elements that a model can describe, but that stepper does not simulate yet.

use std::collections::BTreeMap;

use crate::{Description, Filter, Kernel, Omission, Shape};

/// [`Omission::kind`] of collisions that stepper does not simulate.
const COLLISION: &str = "collision";

/// Whether this module added the omission to a model. Other omissions come from the reader of a source file.
pub(super) fn is_own(omission: &Omission) -> bool {
    omission.kind == COLLISION
}

/// Omissions for geoms that pass through other geoms, because stepper has no collision function for the two shapes. The reason in an
/// omission names these other geoms.
///
/// Of each such pair of geoms, one geom is omitted: the height field if the pair has one, otherwise the second geom.
pub(super) fn not_simulated(model: &Description) -> Vec<Omission> {
    let mut partners: BTreeMap<usize, BTreeMap<&str, Vec<usize>>> = BTreeMap::new();
    // Two planes or height fields never collide. Every other pair without a collision function consists of two surfaces.
    let filter = Filter::new(model);
    for [a, b] in filter.colliding(|g| model.geoms[g].shape.is_surface()) {
        let (first, second) = (&model.geoms[a].shape, &model.geoms[b].shape);
        if Kernel::of(first, second).is_none() {
            let (cause, partner) = if matches!(first, Shape::HeightField { .. }) { (a, b) } else { (b, a) };
            partners.entry(cause).or_default().entry(model.geoms[partner].shape.name()).or_default().push(partner);
        }
    }
    let count = |(shape, geoms): (&str, Vec<usize>)| match geoms[..] {
        [one] => format!("{shape} {:?}", model.geom_label(one)),
        _ => format!("{} {shape} geoms", geoms.len()),
    };
    let omission = |(geom, met): (usize, BTreeMap<&'static str, Vec<usize>>)| {
        let (shape, met) = (model.geoms[geom].shape.name(), met.into_iter().map(count).collect::<Vec<_>>().join(", "));
        let reason = format!("this {shape} would pass through {met}, because contact between these shapes is not simulated yet");
        Omission { kind: COLLISION.into(), name: model.geom_label(geom), reason, changes_motion: true }
    };
    partners.into_iter().map(omission).collect()
}
