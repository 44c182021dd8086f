//! Removal of curvature terms ([`crate::constraints::contact::curvature`]) from the offsets of friction rows.
//!
//! A curvature term assumes the free motion. If contacts hold a body from several sides (a jam), this motion does not occur. The terms can
//! then be target velocities that no impulses reach.

use stepper_real::{Mask, Real};
use stepper_solve::System;

use crate::collision::contact_set::Contacts;
use crate::compile::ModelStructure;
use crate::constraints::constraint_problem::{ConstraintProblem, CurvatureTerms};
use crate::constraints::velocity_solution::VelocitySolution;
use crate::math::lanes::each_of;

impl<R: Real> ConstraintProblem<R> {
    /// Removes the curvature terms of islands with a residual above `tolerance`, m/s, in the lanes `lanes`. Returns the lanes in which an
    /// offset changed. `velocity` has the present solution.
    #[cold]
    #[inline(never)]
    pub(crate) fn remove_unsolved_curvature(
        &mut self,
        compiled: &ModelStructure<R::Scalar>,
        contacts: &Contacts<R>,
        velocity: &mut VelocitySolution<R>,
        lanes: R::Mask,
        tolerance: f64,
    ) -> R::Mask {
        let VelocitySolution { impulses, islands, .. } = velocity;
        let mut changed = R::Mask::splat(false);
        for lane in each_of(lanes.bits()) {
            islands.find(compiled, System::from(&self.rows), lane);
            islands.add_loads(compiled, System::from(&self.rows), impulses, lane);
            for i in 0..self.curvature_terms.len() {
                let k = self.contact_slots[self.curvature_terms[i].contact].slot;
                if k >= contacts.count[lane] {
                    continue;
                }
                let geoms = compiled.pair_geoms(contacts.ids[k][lane].pair()).expect("a pair index of this compiled model");
                let mut trees = geoms.into_iter().filter_map(|geom| compiled.tree_of(compiled.geoms[geom].frame));
                if trees.any(|tree| islands.of_tree(tree).load.residual > tolerance) {
                    changed = changed.or(self.remove_curvature(i, R::Mask::from_bits(1 << lane)));
                }
            }
        }
        changed
    }

    /// Removes stored term number `i` from the offsets of its contact in the lanes `lanes`. Returns the lanes in which an offset changed.
    pub(crate) fn remove_curvature(&mut self, i: usize, lanes: R::Mask) -> R::Mask {
        let (Self { rows, curvature_terms, .. }, mut changed) = (self, R::Mask::splat(false));
        let CurvatureTerms { contact, terms } = &mut curvature_terms[i];
        for (g, term) in rows.contacts.offsets_mut(*contact)[1..3].iter_mut().zip(terms) {
            let dropped = R::select(lanes, *term, R::zero());
            changed = changed.or(dropped.abs().gt(R::zero()));
            *g -= dropped;
            *term -= dropped;
        }
        changed
    }
}
