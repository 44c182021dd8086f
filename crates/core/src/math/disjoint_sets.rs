//! Disjoint sets of the integers 0 to n - 1 (union-find with path halving; Tarjan & van Leeuwen 1984).

/// Disjoint sets. Each set is named after its smallest member, its root.
#[derive(Clone, Debug)]
pub(crate) struct DisjointSets {
    /// For each member, a smaller member of its set, or the member itself if it is the root.
    above: Vec<u32>,
}

impl DisjointSets {
    /// Sets with one member each, for the members 0 to `count` - 1.
    pub(crate) fn new(count: usize) -> Self {
        Self { above: (0..count as u32).collect() }
    }

    /// Separates all members, so that each set has one member again.
    pub(crate) fn separate(&mut self) {
        for (member, above) in self.above.iter_mut().enumerate() {
            *above = member as u32;
        }
    }

    /// Root of the set of `member`.
    pub(crate) fn root(&mut self, mut member: usize) -> usize {
        while self.above[member] as usize != member {
            let next = self.above[self.above[member] as usize];
            self.above[member] = next;
            member = next as usize;
        }
        member
    }

    /// Joins the sets of two members.
    pub(crate) fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        self.above[a.max(b)] = a.min(b) as u32;
    }

    /// Joins the sets of all `members`.
    pub(crate) fn join_all(&mut self, members: impl IntoIterator<Item = usize>) {
        let mut members = members.into_iter();
        if let Some(first) = members.next() {
            members.for_each(|member| self.join(first, member));
        }
    }
}
