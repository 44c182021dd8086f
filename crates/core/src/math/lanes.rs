//! Lane-interleaved values (entry i of lane l is at `i * lanes + l`), and sets of lanes as bits.

use stepper_real::{Real, Scalar};

/// Largest number of lanes of a group.
pub const MAX_LANES: usize = 16;

/// Number of bits that hold the index of a lane.
const LANE_BITS: u32 = MAX_LANES.ilog2();

/// Number that holds a key and the index of a lane. Such numbers sort by key first. The key has at most 59 bits.
pub(crate) fn with_lane(key: u64, lane: u64) -> u64 {
    key << LANE_BITS | lane
}

/// Writes one entry to `pairs` for each key in `found`, a sorted list of numbers from [`with_lane`]. An entry is the result of `number` for
/// the key, and the set of its lanes (bits).
pub(crate) fn merge_lanes(found: &[u64], number: impl Fn(u64) -> u32, pairs: &mut Vec<(u32, u32)>) {
    pairs.clear();
    for &x in found {
        let (number, lane) = (number(x >> LANE_BITS), x & ((1 << LANE_BITS) - 1));
        match pairs.last_mut() {
            Some(last) if last.0 == number => last.1 |= 1 << lane,
            _ => pairs.push((number, 1 << lane)),
        }
    }
}

/// Copies the lanes `first` to `first + n`, exclusive, of lane-interleaved values.
pub(crate) fn columns<T: Copy>(rows: &[T], lanes: usize, first: usize, n: usize) -> Vec<T> {
    if n == lanes {
        return rows.to_vec();
    }
    let mut out = Vec::with_capacity(rows.len() / lanes * n);
    for row in rows.chunks_exact(lanes) {
        out.extend_from_slice(&row[first..first + n]);
    }
    out
}

/// Destination lanes in a group, to which the columns (the values of one lane each) of another group are copied.
#[derive(Clone, Copy, Debug)]
pub(crate) enum DestinationLanes {
    /// Consecutive lanes from this index on, one for each copied column.
    StartingAt(usize),
    /// All lanes of this set (bits). Each gets a copy of the first column.
    Each(u32),
}

/// Writes `n` columns to the destination lanes of lane-interleaved values.
pub(crate) fn set_columns<T: Copy>(rows: &mut [T], lanes: usize, to: DestinationLanes, n: usize, columns: &[T]) {
    for (row, column) in rows.chunks_exact_mut(lanes).zip(columns.chunks_exact(n)) {
        match to {
            DestinationLanes::StartingAt(first) => row[first..first + n].copy_from_slice(column),
            DestinationLanes::Each(set) => each_of(set).for_each(|lane| row[lane] = column[0]),
        }
    }
}

/// Bits `first` to `first + n`, exclusive, of a set of lanes.
pub(crate) fn lane_bits(set: u32, first: usize, n: usize) -> u32 {
    (u64::from(set) >> first) as u32 & ((1u64 << n) - 1) as u32
}

/// Replaces the bits of the destination lanes in a set of lanes by the `n` lowest bits of `bits`. With [`DestinationLanes::Each`], all
/// these lanes get the lowest bit.
pub(crate) fn set_lane_bits(set: &mut u32, to: DestinationLanes, n: usize, bits: u32) {
    let (there, bits) = match to {
        DestinationLanes::StartingAt(first) => ((((1u64 << n) - 1) as u32) << first, bits << first),
        DestinationLanes::Each(lanes) => (lanes, if bits & 1 == 1 { lanes } else { 0 }),
    };
    *set = *set & !there | bits;
}

/// Indices of the lanes in a set (bits), ascending.
#[inline(always)]
pub(crate) fn each_of(mut set: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lane = set.trailing_zeros() as usize;
        set &= set.wrapping_sub(1);
        (lane < u32::BITS as usize).then_some(lane)
    })
}

/// Adds one to the counts of the lanes in a set (bits).
#[inline(always)]
pub(crate) fn count(set: u32, counts: &mut [u32]) {
    for lane in each_of(set) {
        counts[lane] += 1;
    }
}

/// Value at address `at` of the lane-interleaved list `numbers`.
#[inline(always)]
pub(crate) fn get<R: Real>(numbers: &[R::Scalar], at: usize) -> R {
    R::load(&numbers[at * R::LANES..])
}

/// Writes the value `x` to address `at` of the lane-interleaved list `numbers`, in the lanes `lanes`.
#[inline(always)]
pub(crate) fn put<R: Real>(numbers: &mut [R::Scalar], at: usize, lanes: R::Mask, x: R) {
    let old = get::<R>(numbers, at);
    R::select(lanes, x, old).store(&mut numbers[at * R::LANES..]);
}

/// Integer and fractional part of a delay, both in steps. Without interpolation (`smooth` is false) the delay is rounded up, and the
/// fraction is 0.
#[inline(always)]
pub(crate) fn split_delay<R: Real>(steps: R, smooth: bool) -> (R, R) {
    let steps = steps.max(R::zero());
    // A delay within rounding of a whole number of steps counts as that number.
    let rounding = R::of(1e-9f64.max(4.0 * R::Scalar::EPSILON.to_f64()));
    let near = steps.round_even();
    let steps = R::select((steps - near).abs().lt(rounding * (R::one() + near)), near, steps);
    if smooth {
        let whole = R::select(near.gt(steps), near - R::one(), near);
        (whole, steps - whole)
    } else {
        (R::select(near.lt(steps), near + R::one(), near), R::zero())
    }
}

/// Delay line: ring buffer of samples in the stored values of an environment. Each sample has `width` values, and sample k begins at index
/// `at + k * width`.
#[derive(Clone, Copy, Debug)]
pub struct DelayLine {
    /// Address of the line's first value.
    pub at: usize,
    /// Number of samples; 0 without a delay line.
    pub samples: usize,
    /// Number of values in a sample.
    pub width: usize,
}

impl DelayLine {
    /// Rotates the samples in the ring buffer of one environment, so that the newest sample moves from index `newest` to index `place`.
    /// `numbers` has the stored values of the environment.
    pub(crate) fn turn<T>(&self, numbers: &mut [T], newest: u32, place: u32) {
        if self.samples > 0 {
            let by = (place as usize + self.samples - newest as usize) % self.samples;
            numbers[self.at..self.at + self.samples * self.width].rotate_right(by * self.width);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turned_line_has_its_samples_in_the_same_order() {
        let line = DelayLine { at: 1, samples: 3, width: 2 };
        let mut numbers = [-1, 10, 11, 20, 21, 30, 31, -2];
        line.turn(&mut numbers, 0, 2);
        assert_eq!(numbers, [-1, 20, 21, 30, 31, 10, 11, -2]);
        line.turn(&mut numbers, 2, 0);
        assert_eq!(numbers, [-1, 10, 11, 20, 21, 30, 31, -2]);
    }
}
