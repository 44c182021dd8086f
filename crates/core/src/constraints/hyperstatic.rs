//! Which environments have a load that can be shared in many ways.

use stepper_real::{Mask, Real};

use crate::collision::contact_set::Contacts;
use crate::compile::ModelStructure;

/// Number of contacts between two bodies from which on their forces are not determined: three contacts have nine unknown force components,
/// a rigid body gives six equations.
const MIN_SHARED_CONTACTS: usize = 3;

/// Lanes in which a loose body touches another one at so many points.
///
/// As long as all points stick, the motion is one whatever the forces are. When they slip, friction's torque depends on how the load is
/// shared: forces left by sweeps, which load the points that they visit first, turn a box that two fingers hold.
pub(crate) fn lanes<R: Real>(compiled: &ModelStructure<R::Scalar>, contacts: &Contacts<R>) -> R::Mask {
    if compiled.floating.is_empty() {
        return R::Mask::splat(false);
    }
    let shares = |l: usize| {
        let (mut last, mut count) = ([0; 2], 0);
        (0..contacts.count[l]).any(|k| {
            let geoms = compiled.pair_geoms(contacts.ids[k][l].pair()).expect("made from this compiled");
            let frames = geoms.map(|g| compiled.geoms[g].frame);
            count = if frames == last { count + 1 } else { 1 };
            last = frames;
            count >= MIN_SHARED_CONTACTS && frames.iter().any(|&f| f > 0 && compiled.floating.get(f - 1) == Some(&true))
        })
    };
    R::Mask::from_bits((0..R::LANES).fold(0, |bits, l| bits | u32::from(shares(l)) << l))
}
