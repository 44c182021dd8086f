//! Removal of curvature terms ([`crate::constraints::curvature`]) from the offsets of friction rows.
//!
//! A curvature term assumes the free motion. If contacts hold a body from several sides (a jam), this motion does not occur. The terms can
//! then be target velocities that no impulses reach.

use stepper_real::{Mask, Real};

use crate::constraints::constraint_problem::{ConstraintProblem, CurvatureTerms};

impl<R: Real> ConstraintProblem<R> {
    /// Removes stored term number `i` from the offsets of its contact in the lanes `lanes`. Returns the lanes in which an offset changed.
    pub(crate) fn remove_curvature(&mut self, i: usize, lanes: R::Mask) -> R::Mask {
        let (Self { rows, curvature_terms, .. }, mut changed) = (self, R::Mask::splat(false));
        let CurvatureTerms { contact, terms } = &mut curvature_terms[i];
        let g = match contact.checked_sub(rows.contacts.len()) {
            None => &mut rows.contacts[*contact].g[1..3],
            Some(rolling) => &mut rows.rolling_contacts[rolling].g[1..3],
        };
        for (g, term) in g.iter_mut().zip(terms) {
            let dropped = R::select(lanes, *term, R::zero());
            changed = changed.or(dropped.abs().gt(R::zero()));
            *g -= dropped;
            *term -= dropped;
        }
        changed
    }
}
