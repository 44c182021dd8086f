//! Stage 5: the constraint problem becomes impulses, with the residual that certifies them.

use stepper_real::{Real, Scalar};
use stepper_solve::{Outcome, Settings};

use crate::constraints::Constraints;
use crate::contacts::Contacts;
use crate::options::Options;
use crate::spatial::*;

/// Solves the lanes `lanes` to the tolerance and leaves the impulses where the next step finds its warm start.
///
/// What moves slowly is solved more tightly, to a part of its own speed `v`: else a robot at rest would creep at the speed of the tolerance.
pub fn solve<R: Real>(
    options: &Options,
    v: &[R],
    lanes: R::Mask,
    constraints: &mut Constraints<R>,
    contacts: &mut Contacts<R>,
) -> Outcome<R> {
    let [sweeps, newton] = options.effort();
    let tolerance = tolerance(options, v);
    let settings = Settings { sweeps, newton, tolerance, rough: tolerance };
    let Constraints { problem, iterate, newton, scalar_impulse, owners, slots, wide_slots, .. } = constraints;
    let outcome = stepper_solve::solve(problem, iterate, settings, lanes, newton);
    R::vectorize(
        #[inline(always)]
        || {
            for (&owner, &lambda) in owners.iter().zip(&iterate.scalars) {
                scalar_impulse[owner] = lambda;
            }
            for (&(k, lanes), &lambda) in slots.iter().zip(&iterate.contacts) {
                contacts.data[k].impulse = select(lanes, lambda, contacts.data[k].impulse);
            }
            for (&(k, lanes, scale), &[n, a, b, spin, roll, other]) in wide_slots.iter().zip(&iterate.wide) {
                contacts.data[k].impulse = select(lanes, [n, a, b], contacts.data[k].impulse);
                contacts.torque[k] = select(lanes, [spin * scale[0], roll * scale[1], other * scale[2]], contacts.torque[k]);
            }
        },
    );
    outcome
}

/// Residual relative to the speed of the fastest degree of freedom. A residual of r moves joints at up to some 60 r (measured on ants at rest),
/// so that this lets what creeps decay.
const RELATIVE: f64 = 1e-3;

/// Residual at which each lane stops, m/s; never below what rounding leaves of velocities of order one.
fn tolerance<R: Real>(options: &Options, v: &[R]) -> R {
    R::vectorize(
        #[inline(always)]
        || {
            let mut fastest = R::zero();
            for &v in v {
                fastest = fastest.max(v.abs());
            }
            let rounding = R::of(<R::Scalar as Scalar>::EPSILON.to_f64() * 1e4);
            let most = R::of(options.tolerance);
            (fastest * R::of(RELATIVE)).max(rounding).min(most)
        },
    )
}
