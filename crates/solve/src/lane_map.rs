//! Map of the lanes of a group that are gathered into half of the registers, and scattered back.

use stepper_real::{Mask, Real};

/// Map of the lanes that are gathered into half of the registers: lane i of the half gets the numbers of lane `sources[i]` of the whole.
#[derive(Clone, Copy, Debug)]
pub struct LaneMap {
    /// For each lane of the halved registers, the lane of the group from which it is gathered. Unused lanes copy lane 0, and the copy is
    /// never read.
    sources: [u32; 16],
    /// For each lane of the group, the lane of the halved registers to which it is gathered; 0 if it is not gathered.
    places: [u32; 32],
    /// Lanes of the group that are gathered, as bits.
    lanes: u32,
}

impl LaneMap {
    /// Map that gathers the lanes whose bits are set, in ascending order.
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

    /// Lanes of the half that are in use, as bits.
    #[inline(always)]
    pub(crate) fn gathered_bits(&self) -> u32 {
        (1 << self.lanes.count_ones()) - 1
    }

    /// Gathers the lanes of one number.
    #[inline(always)]
    pub(crate) fn gather<R: Real>(&self, x: R) -> R::Half {
        x.gather_lanes(&self.sources)
    }

    /// Gathers the lanes of each number of an array.
    #[inline(always)]
    pub(crate) fn gather_array<R: Real, const N: usize>(&self, x: &[R; N]) -> [R::Half; N] {
        let mut gathered = [R::Half::zero(); N];
        self.gather_into(x, &mut gathered);
        gathered
    }

    /// Gathers the lanes of the numbers `from` into `to`, as many as both have.
    #[inline(always)]
    pub(crate) fn gather_into<R: Real>(&self, from: &[R], to: &mut [R::Half]) {
        for (to, &from) in to.iter_mut().zip(from) {
            *to = self.gather(from);
        }
    }

    /// Gathers the lanes of the numbers `from` into `to`, which must have enough capacity.
    #[inline(always)]
    pub(crate) fn gather_slice<R: Real>(&self, from: &[R], to: &mut Vec<R::Half>) {
        to.resize(from.len(), R::Half::zero());
        self.gather_into(from, to);
    }

    /// Gathers the lanes of a mask into a mask with half of the lanes.
    #[inline(always)]
    pub(crate) fn gather_mask<R: Real>(&self, m: R::Mask) -> <R::Half as Real>::Mask {
        self.gather(R::select(m, R::one(), R::zero())).gt(R::Half::zero())
    }

    /// Copies the lanes of one gathered number back to their source lanes in `to`.
    #[inline(always)]
    pub(crate) fn scatter<R: Real>(&self, from: R::Half, to: &mut R) {
        *to = to.replace_lanes(from, &self.places, R::Mask::from_bits(self.lanes));
    }

    /// Copies the lanes of gathered numbers back to their source lanes in `to`.
    #[inline(always)]
    pub(crate) fn scatter_slice<R: Real>(&self, from: &[R::Half], to: &mut [R]) {
        for (to, &from) in to.iter_mut().zip(from) {
            self.scatter(from, to);
        }
    }

    /// Copies the lanes of a gathered mask back to their source lanes in `to`.
    #[inline(always)]
    pub(crate) fn scatter_mask<R: Real>(&self, from: <R::Half as Real>::Mask, to: &mut R::Mask) {
        let mut numbers = R::select(*to, R::one(), R::zero());
        self.scatter(R::Half::select(from, R::Half::one(), R::Half::zero()), &mut numbers);
        *to = numbers.gt(R::zero());
    }
}
