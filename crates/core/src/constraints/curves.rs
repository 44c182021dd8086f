//! Curvature terms in the targets of friction rows ([`crate::constraints::curvature`]), which the solver can remove.
//!
//! A term is that of the free motion. Contacts that hold each other, as in a jam, stop this motion. No impulse then meets the terms, unless
//! they are a motion of the joints.

use stepper_real::{Mask, Real};

use crate::constraints::constraint_problem::{ConstraintProblem, Curve};

impl<R: Real> ConstraintProblem<R> {
    /// Stores the terms that the targets of contact `contact` have, m/s.
    pub(crate) fn store_curve(&mut self, contact: usize, terms: [R; 2]) {
        self.curves.push(Curve { contact, terms });
    }

    /// Removes term `i` from the targets of its contact in the lanes `lanes`. Returns the lanes in which this changes a target.
    pub(crate) fn drop_curve(&mut self, i: usize, lanes: R::Mask) -> R::Mask {
        let (Self { rows, curves, .. }, mut changed) = (self, R::Mask::splat(false));
        let Curve { contact, terms } = &mut curves[i];
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

    /// Removes all terms in the lanes `lanes`. Returns the lanes in which this changes a target.
    pub(crate) fn drop_curves(&mut self, lanes: R::Mask) -> R::Mask {
        (0..self.curves.len()).fold(R::Mask::splat(false), |changed, i| changed.or(self.drop_curve(i, lanes)))
    }
}
