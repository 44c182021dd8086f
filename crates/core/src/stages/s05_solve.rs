//! Stage 5: the constraint problem becomes impulses, with the residual that certifies them.

use stepper_real::Real;
use stepper_solve::pgs::{self, Outcome, Settings};

use crate::constraints::Constraints;
use crate::contacts::Contacts;
use crate::options::Options;

/// Solves to the tolerance and leaves the impulses where the next step finds its warm start.
pub fn solve<R: Real>(options: &Options, constraints: &mut Constraints<R>, contacts: &mut Contacts<R>) -> Outcome<R> {
    let settings = Settings { sweeps: options.iterations, tolerance: options.tolerance };
    let Constraints { problem, iterate, constrained, scalar_impulse, owners, .. } = constraints;
    let outcome = pgs::solve(problem, iterate, settings, *constrained);
    for (&owner, &lambda) in owners.iter().zip(&iterate.scalars) {
        scalar_impulse[owner] = lambda;
    }
    for (slot, &lambda) in contacts.data.iter_mut().zip(&iterate.contacts) {
        slot.impulse = lambda;
    }
    outcome
}
