//! Numbers of a group of lanes, interleaved (entry i of lane l is at `i * lanes + l`), and sets of lanes, one bit each.

/// Largest number of lanes of a group.
pub const MAX_LANES: usize = 32;

/// Lanes `first` to `first + n` of lane-interleaved numbers.
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

/// Destination lanes in a group of lanes, to which the columns (numbers of one lane each) of another group are copied.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Target {
    /// Consecutive lanes from this index on, one for each copied column.
    From(usize),
    /// All lanes of this set (bits), each with a copy of the first column.
    Each(u32),
}

/// Writes `n` columns to some lanes of lane-interleaved numbers.
pub(crate) fn set_columns<T: Copy>(rows: &mut [T], lanes: usize, to: Target, n: usize, columns: &[T]) {
    for (row, column) in rows.chunks_exact_mut(lanes).zip(columns.chunks_exact(n)) {
        match to {
            Target::From(first) => row[first..first + n].copy_from_slice(column),
            Target::Each(set) => each_of(set).for_each(|lane| row[lane] = column[0]),
        }
    }
}

/// Bits `first` to `first + n` of a set of lanes.
pub(crate) fn lane_bits(set: u32, first: usize, n: usize) -> u32 {
    (u64::from(set) >> first) as u32 & ((1u64 << n) - 1) as u32
}

/// Replaces the bits of some lanes of a set of lanes by those of `n` others.
pub(crate) fn set_lane_bits(set: &mut u32, to: Target, n: usize, bits: u32) {
    let (there, bits) = match to {
        Target::From(first) => ((((1u64 << n) - 1) as u32) << first, bits << first),
        Target::Each(lanes) => (lanes, if bits & 1 == 1 { lanes } else { 0 }),
    };
    *set = *set & !there | bits;
}

/// Lanes of a set, ascending.
#[inline(always)]
pub(crate) fn each_of(mut set: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lane = set.trailing_zeros() as usize;
        set &= set.wrapping_sub(1);
        (lane < u32::BITS as usize).then_some(lane)
    })
}

/// Adds one in the lanes of a set.
#[inline(always)]
pub(crate) fn count(set: u32, counts: &mut [u32]) {
    for lane in each_of(set) {
        counts[lane] += 1;
    }
}

/// Ring of samples among the numbers of an environment: sample k of `width` numbers is at `at + k * width`.
#[derive(Clone, Copy, Debug)]
pub struct DelayLine {
    /// Address of the line's first number.
    pub at: usize,
    /// Number of samples; 0 without a line.
    pub samples: usize,
    /// Length of a sample.
    pub width: usize,
}

impl DelayLine {
    /// Rotates the line of one environment, so that its newest sample moves from number `newest` to number `place`.
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
