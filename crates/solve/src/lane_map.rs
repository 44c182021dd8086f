//! Map between the lanes of a group and the lanes of registers of half the width, into which some lanes of the group are gathered.

use stepper_real::{Mask, Real};

/// Map of lanes that are gathered into registers of half the width. Lane i of the half-width registers gets the numbers of lane
/// `sources[i]` of the full-width registers.
#[derive(Clone, Copy, Debug)]
pub struct LaneMap {
    /// For each lane of the half-width registers, the lane of the full-width registers from which it is gathered. Unused lanes copy lane 0,
    /// and the copy is never read.
    sources: [u32; 16],
    /// For each lane of the full-width registers, the lane of the half-width registers to which it is gathered; 0 if it is not gathered.
    places: [u32; 32],
    /// Lanes of the full-width registers that are gathered, as bits.
    lanes: u32,
}

impl LaneMap {
    /// Map that gathers the lanes whose bits are set in `lanes`, in ascending order.
    #[inline(always)]
    pub(crate) fn of(lanes: u32) -> Self {
        let mut map = Self { sources: [0; 16], places: [0; 32], lanes };
        let mut rest = lanes;
        for place in 0..lanes.count_ones() {
            let lane = rest.trailing_zeros();
            map.sources[place as usize] = lane;
            map.places[lane as usize] = place;
            rest &= rest - 1;
        }
        map
    }

    /// Lanes of the half-width registers that are in use, as bits.
    #[inline(always)]
    pub(crate) fn gathered_bits(&self) -> u32 {
        (1 << self.lanes.count_ones()) - 1
    }

    /// One number with the gathered lanes of `x`.
    #[inline(always)]
    pub(crate) fn gather<R: Real>(&self, x: R) -> R::Half {
        x.gather_lanes(&self.sources)
    }

    /// Array with the gathered lanes of each number of `x`.
    #[inline(always)]
    pub(crate) fn gather_array<R: Real, const N: usize>(&self, x: &[R; N]) -> [R::Half; N] {
        let mut gathered = [R::Half::zero(); N];
        self.gather_into(x, &mut gathered);
        gathered
    }

    /// Writes the gathered lanes of the numbers `from` to `to`. If the lengths differ, it writes as many numbers as the shorter list has.
    #[inline(always)]
    pub(crate) fn gather_into<R: Real>(&self, from: &[R], to: &mut [R::Half]) {
        for (to, &from) in to.iter_mut().zip(from) {
            *to = self.gather(from);
        }
    }

    /// Replaces `to` by the gathered lanes of the numbers `from`. The list `to` must have enough capacity.
    #[inline(always)]
    pub(crate) fn gather_slice<R: Real>(&self, from: &[R], to: &mut Vec<R::Half>) {
        to.resize(from.len(), R::Half::zero());
        self.gather_into(from, to);
    }

    /// Mask with the gathered lanes of `m`, for registers of half the width.
    #[inline(always)]
    pub(crate) fn gather_mask<R: Real>(&self, m: R::Mask) -> <R::Half as Real>::Mask {
        self.gather(R::select(m, R::one(), R::zero())).gt(R::Half::zero())
    }

    /// Copies the lanes of the gathered number `from` back to their source lanes in `to`. The other lanes of `to` remain.
    #[inline(always)]
    pub(crate) fn scatter<R: Real>(&self, from: R::Half, to: &mut R) {
        *to = to.replace_lanes(from, &self.places, R::Mask::from_bits(self.lanes));
    }

    /// Copies the lanes of the gathered numbers `from` back to their source lanes in `to`. The other lanes of `to` remain.
    #[inline(always)]
    pub(crate) fn scatter_slice<R: Real>(&self, from: &[R::Half], to: &mut [R]) {
        for (to, &from) in to.iter_mut().zip(from) {
            self.scatter(from, to);
        }
    }

    /// Copies the lanes of the gathered mask `from` back to their source lanes in `to`. The other lanes of `to` remain.
    #[inline(always)]
    pub(crate) fn scatter_mask<R: Real>(&self, from: <R::Half as Real>::Mask, to: &mut R::Mask) {
        let mut numbers = R::select(*to, R::one(), R::zero());
        self.scatter(R::Half::select(from, R::Half::one(), R::Half::zero()), &mut numbers);
        *to = numbers.gt(R::zero());
    }
}
