//! The entries of rows, one row after the other.

/// A list that every step fills anew, a row at a time.
///
/// Whether there is room is asked once for a row: a push asks for every entry, and what could be in registers across a row is not, because
/// they would not outlive the call that makes room.
#[derive(Clone, Debug)]
pub(crate) struct Entries<T> {
    /// Those in use, and after them what earlier steps left.
    items: Vec<T>,
    len: usize,
}

impl<T: Copy + Default> Entries<T> {
    /// None, with room for so many.
    pub(crate) fn with_capacity(room: usize) -> Self {
        Self { items: Vec::with_capacity(room), len: 0 }
    }

    /// How many there are.
    #[inline(always)]
    pub(crate) fn len(&self) -> usize {
        self.len
    }

    /// Forgets all.
    #[inline(always)]
    pub(crate) fn clear(&mut self) {
        self.len = 0;
    }

    /// Adds `n` entries, which the caller sets: they hold anything.
    #[inline(always)]
    pub(crate) fn add(&mut self, n: usize) -> &mut [T] {
        let start = self.len;
        self.len += n;
        if self.len > self.items.len() {
            self.grow();
        }
        &mut self.items[start..self.len]
    }

    #[cold]
    #[inline(never)]
    fn grow(&mut self) {
        self.items.resize(self.len, T::default());
    }

    /// Takes what `of` makes of each of the others, and forgets its own.
    #[inline(always)]
    pub(crate) fn copy_from<U>(&mut self, others: &Entries<U>, of: impl Fn(&U) -> T) {
        self.clear();
        for (to, from) in self.add(others.len).iter_mut().zip(&others.items) {
            *to = of(from);
        }
    }

    /// `n` entries from the `start`-th on.
    #[inline(always)]
    pub(crate) fn row(&self, start: usize, n: usize) -> &[T] {
        &self.items[start..start + n]
    }

    /// The same, to be changed.
    #[inline(always)]
    pub(crate) fn row_mut(&mut self, start: usize, n: usize) -> &mut [T] {
        &mut self.items[start..start + n]
    }

    /// `n` entries from each of the two, the first before the second; the second to be changed.
    #[inline(always)]
    pub(crate) fn two_rows(&mut self, first: usize, second: usize, n: usize) -> (&[T], &mut [T]) {
        let (before, rest) = self.items.split_at_mut(second);
        (&before[first..first + n], &mut rest[..n])
    }
}
