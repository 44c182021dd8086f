//! Curvature terms in the offsets of friction rows ([`crate::constraints::curvature`]), which the solver can remove.
//!
//! A term is computed for the free motion. In a jam contacts stop this motion, and no impulse meets rows with the terms.

use stepper_real::{Mask, Real};

use crate::constraints::constraint_problem::{ConstraintProblem, CurvatureTerms};

impl<R: Real> ConstraintProblem<R> {
    /// Stores the terms (m/s) that were added to the offsets of contact `contact`, so that they can be removed.
    pub(crate) fn store_curvature(&mut self, contact: usize, terms: [R; 2]) {
        self.curvature_terms.push(CurvatureTerms { contact, terms });
    }

    /// Removes term `i` from the offsets of its contact in the lanes `lanes`. Returns the lanes in which this changes an offset.
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

    /// Removes all terms in the lanes `lanes`. Returns the lanes in which this changes an offset.
    pub(crate) fn remove_all_curvature(&mut self, lanes: R::Mask) -> R::Mask {
        (0..self.curvature_terms.len()).fold(R::Mask::splat(false), |changed, i| changed.or(self.remove_curvature(i, lanes)))
    }
}
