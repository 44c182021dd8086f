//! Moment arms of actuators that pull on the contacts of a body (adhesion, suction).

use stepper_real::{Mask, Real, kernel};

use crate::collision::contact_set::Contacts;
use crate::compile::{ADHESION_REACH, CompiledAdhesion, LaneModel, VariableMoment};
use crate::dynamics::kinematics::Kinematics;
use crate::math::spatial::*;

/// Computes the moment arms of all actuators on contacts into their parts of `arms`, the list of all variable moment arms. Computes the
/// number of contacts that each of these actuators pulls into `pulled`.
pub(crate) fn set_adhesive_arms<R: Real>(
    compiled: &LaneModel<R>,
    kinematics: &Kinematics<R>,
    contacts: &Contacts<R>,
    [arms, pulled]: [&mut [R]; 2],
) {
    let Some(adhesion) = &compiled.adhesion else { return };
    kernel!(R, || {
        for ((body, moment), pulled) in compiled.adhesive_actuators().zip(pulled) {
            *pulled = set_arms(compiled, kinematics, (contacts, adhesion), body, moment, &mut arms[moment.arms..]);
        }
    })
}

/// Computes the moment arms of the actuator on the contacts of body `body` into `arms`: minus the mean of the normal rows of its contacts,
/// as MuJoCo's `mjTRN_BODY`. Returns the number of these contacts.
///
/// A contact counts within margin + gap. With hard contact, whose gaps close to zero up to rounding, it counts up to [`ADHESION_REACH`]
/// beyond.
#[inline(always)]
fn set_arms<R: Real>(
    compiled: &LaneModel<R>,
    kinematics: &Kinematics<R>,
    (contacts, adhesion): (&Contacts<R>, &CompiledAdhesion<R::Scalar>),
    body: usize,
    moment: &VariableMoment<R::Scalar>,
    arms: &mut [R],
) -> R {
    let arms = &mut arms[..moment.dofs.len()];
    arms.fill(R::zero());
    let tolerance = if compiled.softness.is_some() { 0.0 } else { ADHESION_REACH };
    let mut count = R::zero();
    for k in 0..contacts.slots() {
        for (pair, lanes) in contacts.pairs(k, contacts.lanes_of(k)) {
            let geoms = compiled.pair_geoms(pair).expect("a contact belongs to a pair");
            if geoms.iter().all(|&g| compiled.sensing.geom_body[compiled.geoms[g].index] != body) {
                continue;
            }
            let point = &contacts.data[k].point;
            let pulls = R::Mask::from_bits(lanes).and(point.distance.lt(R::of(adhesion.gap(pair, geoms) + tolerance)));
            count += R::select(pulls, R::one(), R::zero());
            let [first, second] = geoms.map(|g| &compiled.moved_dofs[compiled.geoms[g].frame]);
            for (&(dof, _), arm) in moment.dofs.iter().zip(&mut *arms) {
                let moves = |set: &[u64]| set[dof / 64] >> (dof % 64) & 1 == 1;
                let (away, towards) = (moves(second), moves(first));
                if away == towards {
                    continue;
                }
                let motion = velocity_at(&kinematics.axes[dof], sub(point.pos, kinematics.origin[compiled.dofs[dof].tree]));
                let along = R::select(pulls, dot(point.normal, motion), R::zero());
                *arm += if away { along } else { -along };
            }
        }
    }
    let share = -(R::one() / count.max(R::one()));
    for arm in arms {
        *arm *= share;
    }
    count
}
