//! List of entries of rows, one row after the other.

use std::ops::Range;

/// List of entries that every step refills, a row at a time.
///
/// It checks its capacity once per row. `Vec::push` checks it for every entry, and its call to the allocator would force values out of
/// registers.
#[derive(Clone, Debug)]
pub(crate) struct Entries<T> {
    /// Entries in use, followed by those of earlier steps.
    items: Vec<T>,
    /// Number of entries in use.
    len: usize,
    /// Value of entries that were never set.
    blank: T,
}

impl<T: Copy> Entries<T> {
    /// Empty list with capacity for `capacity` entries.
    pub(crate) fn with_capacity(capacity: usize, blank: T) -> Self {
        Self { items: Vec::with_capacity(capacity), len: 0, blank }
    }

    /// Number of entries in use.
    #[inline(always)]
    pub(crate) fn len(&self) -> usize {
        self.len
    }

    /// Removes all entries.
    #[inline(always)]
    pub(crate) fn clear(&mut self) {
        self.len = 0;
    }

    /// Shortens the list to its first `len` entries, like `Vec::truncate`. `len` must not exceed the length.
    pub(crate) fn truncate(&mut self, len: usize) {
        self.len = len;
    }

    /// Appends `n` entries, which the caller must set, and returns them.
    #[inline(always)]
    pub(crate) fn extend_by(&mut self, n: usize) -> &mut [T] {
        let start = self.len;
        self.len += n;
        if self.len > self.items.len() {
            self.grow();
        }
        &mut self.items[start..self.len]
    }

    /// Enlarges the buffer to the entries in use.
    #[cold]
    #[inline(never)]
    fn grow(&mut self) {
        self.items.resize(self.len, self.blank);
    }

    /// Entries with the indices `range`.
    #[inline(always)]
    pub(crate) fn range(&self, range: Range<usize>) -> &[T] {
        &self.items[range]
    }

    /// Entries with the indices `range`, mutable.
    #[inline(always)]
    pub(crate) fn range_mut(&mut self, range: Range<usize>) -> &mut [T] {
        &mut self.items[range]
    }

    /// Entries of two ranges. The first range is before the second, whose entries are mutable.
    #[inline(always)]
    pub(crate) fn two_ranges(&mut self, first: Range<usize>, second: Range<usize>) -> (&[T], &mut [T]) {
        let (before, rest) = self.items.split_at_mut(second.start);
        (&before[first], &mut rest[..second.len()])
    }
}
