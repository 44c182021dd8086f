//! Lane compaction: the last lanes of a group continue to sweep in half of the registers.
//!
//! The lanes of a group need different numbers of sweeps. Once the remaining lanes fit into half of the registers, their part of the
//! problem is gathered there, with all results of the previous sweeps. The next sweeps have the same bits at half the cost.

use crate::gauss_seidel::sweep::Progress;
use crate::iterate::{Compacted, Iterate};
use crate::lane_map::LaneMap;
use crate::problem::System;
use stepper_real::{Mask, Real, kernel};

/// Gathers the running lanes into registers of half the width, if they fit there, and makes sweeps (Gauss-Seidel iterations) until all
/// running lanes have paused. Returns false, and does nothing, if the lanes do not fit.
#[inline(always)]
pub(super) fn sweep_compacted<R: Real>(system: System<'_, R>, iterate: &mut Iterate<R>, progress: &mut Progress<R>) -> bool {
    if R::LANES == R::Half::LANES {
        return false;
    }
    let running = progress.running.bits();
    if running.count_ones() as usize > R::Half::LANES {
        return false;
    }
    let map = LaneMap::of(running);
    let Some(mut compacted) = iterate.compacted.take() else { return false };
    let Compacted { problem: part, iterate: own } = &mut *compacted;
    system.gather(&map, part);
    iterate.gather(&map, own);
    let mut half = Progress::<R::Half> {
        running: <R::Half as Real>::Mask::from_bits(map.gathered_bits()),
        threshold: map.gather(progress.threshold),
        sweeps: map.gather(progress.sweeps),
        most_sweeps: progress.most_sweeps,
        extrapolated: map.gather_mask::<R>(progress.extrapolated),
    };
    kernel!(R::Half, || {
        while half.running.any() {
            half.sweep((&*part).into(), own);
        }
    });
    iterate.scatter(&map, own);
    map.scatter(half.sweeps, &mut progress.sweeps);
    map.scatter_mask::<R>(half.extrapolated, &mut progress.extrapolated);
    progress.running = R::Mask::splat(false);
    iterate.compacted = Some(compacted);
    true
}
