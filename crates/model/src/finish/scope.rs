//! Elements that a model can describe, but that stepper does not simulate yet.

use std::collections::BTreeMap;

use crate::{Description, GeomPair, Kernel, Omission, Shape};

/// Element that needs a feature that stepper does not simulate: its name, and the reason for its omission.
type User = (String, String);

/// Function that finds the elements of a model that need a feature that stepper does not simulate.
type Users = fn(&Description, &[GeomPair]) -> Vec<User>;

/// Features that stepper does not simulate. Each has a name for [`Omission::kind`], and a function that finds the affected elements of a
/// model.
const MISSING: [(&str, Users); 1] = [("collision", pairs_without_kernel)];

/// Omissions for all elements of a model that need a feature that stepper does not simulate.
pub(super) fn not_simulated(model: &Description) -> Vec<Omission> {
    let pairs = model.collision_pairs();
    let rows = MISSING.iter().flat_map(|(kind, users)| users(model, &pairs).into_iter().map(move |user| (kind, user)));
    rows.map(|(kind, (name, reason))| Omission { kind: (*kind).into(), name, reason, changes_motion: true }).collect()
}

/// Whether this module added the omission to a model. Other omissions come from the reader of a source file.
pub(super) fn is_own(omission: &Omission) -> bool {
    MISSING.iter().any(|(kind, _)| *kind == omission.kind)
}

/// Geoms that pass through other geoms, because stepper has no collision function for the two shapes. The reason of each geom names these
/// other geoms.
///
/// The result has one geom of each such pair: the height field if the pair has one, otherwise the second geom.
fn pairs_without_kernel(model: &Description, pairs: &[GeomPair]) -> Vec<User> {
    let mut partners: BTreeMap<usize, BTreeMap<&str, Vec<usize>>> = BTreeMap::new();
    for [a, b] in pairs.iter().map(|p| p.geoms) {
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
    let describe = |(geom, met): (usize, BTreeMap<&'static str, Vec<usize>>)| {
        let met: Vec<String> = met.into_iter().map(count).collect();
        let shape = model.geoms[geom].shape.name();
        (
            model.geom_label(geom),
            format!("this {shape} passes through {}: contact between these shapes is not simulated yet", met.join(", ")),
        )
    };
    partners.into_iter().map(|(g, met)| describe((g, met))).collect()
}
