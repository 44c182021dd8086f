//! What is fixed during a solve ([`Problem`]) and what varies ([`Iterate`]).

use std::ops::Range;

use crate::anderson::History;
use crate::aside::{Aside, Order};
use crate::cone::keep;
use crate::entries::Entries;
use crate::{ContactBlock, WideBlock};
use stepper_real::{Mask, Real, Scalar};

/// A bounded scalar row: an equality (any lambda), a limit (`0 <= lambda`), or dry friction (`|lambda| <= h f`).
#[derive(Clone, Debug)]
pub struct ScalarRow<R: Real> {
    pub(crate) support: Range<usize>,
    pub(crate) y: usize,
    /// Lanes in which the row exists.
    pub active: R::Mask,
    /// Velocity of the row before any impulse, with its bias, m/s or rad/s.
    pub g: R,
    /// Least impulse.
    pub lo: R,
    /// Greatest impulse.
    pub hi: R,
    /// Compliance R, at least 0: the velocity that the row gives way by per unit of impulse, on top of what the bodies do. 0 is hard.
    pub compliance: R,
    /// Diagonal entry of G, compliance included.
    pub(crate) diagonal: R,
    /// Its inverse; 1 where the row does not exist or cannot move.
    pub(crate) inv_diagonal: R,
    /// So many times what is left of it the diagonal entry was before separate rows were taken out.
    pub(crate) whole: R,
    /// Mobility that the damping of its demand is relative to; 0 for a row that is soft by its own law.
    pub(crate) mobility: R,
    /// What damping took from the demand already, m/s: see [`ScalarRow::damp_correction`].
    pub(crate) lack: R,
    /// Lanes in which there is a row that nothing can move.
    pub(crate) held: R::Mask,
}

/// How much a problem and its iterate reserve, so that filling them allocates nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Capacity {
    /// Coordinates of w.
    pub dimension: usize,
    /// Scalar rows.
    pub scalars: usize,
    /// Entries of all scalar rows together.
    pub scalar_entries: usize,
    /// Contacts.
    pub contacts: usize,
    /// Contacts with six rows.
    pub wide: usize,
    /// Coordinates that one contact can touch in any of its lanes.
    pub contact_support: usize,
}

/// The constraint problem of one step, for every lane.
///
/// Rows are stored sparse: a row's `support` names the coordinates of w that any lane's row touches, ascending; lanes that do not
/// touch one have a zero there.
#[derive(Clone, Debug)]
pub struct Problem<R: Real> {
    dimension: usize,
    support: Vec<u32>,
    pub(crate) y: Entries<R>,
    y3: Entries<[R; 3]>,
    y6: Entries<[R; 6]>,
    /// Equalities, limits and dry friction, swept first.
    pub scalars: Vec<ScalarRow<R>>,
    /// The first so many of them are separate, see [`Problem::separate`].
    pub(crate) separate: usize,
    /// Contacts.
    pub contacts: Vec<ContactBlock<R>>,
    /// Contacts with torsional or rolling friction, swept last.
    pub wide: Vec<WideBlock<R>>,
    /// Lanes in which the rows leave it open how a load is shared.
    pub hyperstatic: R::Mask,
    /// Mobility along a contact's normal below which nothing moves, 1/kg; of the contacts that are pushed from now on.
    pub least_mobility: R,
    /// Whether rows have been given compliance, see [`Problem::damp`].
    pub(crate) damped: bool,
}

impl<R: Real> Problem<R> {
    /// An empty problem in `dimension` coordinates, with room for so many rows that may touch every coordinate.
    pub fn with_capacity(dimension: usize, scalars: usize, contacts: usize) -> Self {
        Self::new(&Capacity { dimension, scalars, scalar_entries: scalars * dimension, contacts, wide: 0, contact_support: dimension })
    }

    /// An empty problem with that room.
    pub fn new(room: &Capacity) -> Self {
        let contact_entries = room.contacts * room.contact_support;
        Self {
            dimension: room.dimension,
            support: Vec::with_capacity(room.scalar_entries + contact_entries + room.wide * room.contact_support),
            y: Entries::with_capacity(room.scalar_entries),
            y3: Entries::with_capacity(contact_entries),
            y6: Entries::with_capacity(room.wide * room.contact_support),
            scalars: Vec::with_capacity(room.scalars),
            separate: 0,
            contacts: Vec::with_capacity(room.contacts),
            wide: Vec::with_capacity(room.wide),
            hyperstatic: R::Mask::splat(false),
            least_mobility: R::zero(),
            damped: false,
        }
    }

    /// Forgets every row.
    #[inline(always)]
    pub fn clear(&mut self) {
        self.support.clear();
        self.y.clear();
        self.y3.clear();
        self.scalars.clear();
        self.separate = 0;
        self.contacts.clear();
        self.y6.clear();
        self.wide.clear();
        self.hyperstatic = R::Mask::splat(false);
        self.damped = false;
    }

    /// The part of some lanes.
    #[inline(always)]
    pub(crate) fn pick(&self, order: &Order, out: &mut Problem<R::Half>) {
        out.support.clear();
        out.support.extend_from_slice(&self.support);
        out.y.copy_from(
            &self.y,
            #[inline(always)]
            |&y| order.pick(y),
        );
        out.y3.copy_from(
            &self.y3,
            #[inline(always)]
            |y| order.pick_each(y),
        );
        out.y6.copy_from(
            &self.y6,
            #[inline(always)]
            |y| order.pick_each(y),
        );
        out.separate = self.separate;
        out.damped = self.damped;
        out.scalars.clear();
        for row in &self.scalars {
            out.scalars.push(ScalarRow {
                support: row.support.clone(),
                y: row.y,
                active: order.pick_mask::<R>(row.active),
                g: order.pick(row.g),
                lo: order.pick(row.lo),
                hi: order.pick(row.hi),
                compliance: order.pick(row.compliance),
                diagonal: order.pick(row.diagonal),
                inv_diagonal: order.pick(row.inv_diagonal),
                whole: order.pick(row.whole),
                mobility: order.pick(row.mobility),
                lack: order.pick(row.lack),
                held: order.pick_mask::<R>(row.held),
            });
        }
        out.contacts.clear();
        for block in &self.contacts {
            out.contacts.push(block.pick(order));
        }
        out.wide.clear();
        for block in &self.wide {
            out.wide.push(block.pick(order));
        }
    }

    /// Number of coordinates of w.
    #[inline(always)]
    pub fn dimension(&self) -> usize {
        self.dimension
    }

    /// Whether there is no row at all.
    #[inline(always)]
    pub fn is_empty(&self) -> bool {
        self.scalars.is_empty() && self.contacts.is_empty() && self.wide.is_empty()
    }

    /// Adds a scalar row with the entries `y` at the coordinates `support` (ascending).
    ///
    /// `sign` (1 or -1 per lane) multiplies the row. Lanes outside `active` do not have it.
    #[inline(always)]
    pub fn push_scalar(&mut self, support: &[u32], y: impl Fn(usize) -> R, sign: R, active: R::Mask, g: R, bounds: [R; 2]) {
        let (s0, y0) = (self.support.len(), self.y.len());
        let mut diagonal = R::zero();
        self.support.extend_from_slice(support);
        for (entry, &c) in self.y.add(support.len()).iter_mut().zip(support) {
            let value = R::select(active, y(c as usize) * sign, R::zero());
            *entry = value;
            diagonal += value * value;
        }
        let movable = diagonal.gt(R::zero());
        self.scalars.push(ScalarRow {
            support: s0..s0 + support.len(),
            y: y0,
            active: active.and(movable),
            g,
            lo: bounds[0],
            hi: bounds[1],
            compliance: R::zero(),
            diagonal,
            inv_diagonal: R::one() / R::select(movable, diagonal, R::one()),
            whole: R::one(),
            mobility: diagonal,
            lack: R::zero(),
            held: R::Mask::splat(false),
        });
    }

    /// Gives the scalar row that was pushed last the compliance R >= 0.
    #[inline(always)]
    pub fn soften(&mut self, compliance: R) {
        if let Some(row) = self.scalars.last_mut() {
            row.compliance = compliance;
            row.mobility = R::select(compliance.gt(R::zero()), R::zero(), row.mobility);
            row.diagonal += compliance;
            row.inv_diagonal = R::one() / R::select(row.diagonal.gt(R::zero()), row.diagonal, R::one());
        }
    }

    /// Adds a contact whose rows (n, t1, t2) have the entries `y` at the coordinates `support` (ascending).
    #[inline(always)]
    pub fn push_contact(&mut self, support: &[u32], y: impl Fn(usize) -> [R; 3], active: R::Mask, mu: R, g: [R; 3]) {
        let (s0, y0) = (self.support.len(), self.y3.len());
        let mut gram = [R::zero(); 6];
        self.support.extend_from_slice(support);
        for (entry, &c) in self.y3.add(support.len()).iter_mut().zip(support) {
            let [n, a, b] = y(c as usize);
            *entry = [n, a, b];
            let products = [n * n, n * a, n * b, a * a, a * b, b * b];
            for i in 0..6 {
                gram[i] += products[i];
            }
        }
        self.contacts.push(ContactBlock::new(s0..s0 + support.len(), y0, gram, active, mu, g, self.least_mobility));
    }

    /// Adds a contact whose rows (n, t1, t2, spin, roll1, roll2), scaled so that their friction is `mu` in all, have the entries `y` at the
    /// coordinates `support` (ascending).
    #[inline(always)]
    pub fn push_wide(&mut self, support: &[u32], y: impl Fn(usize) -> [R; 6], active: R::Mask, mu: R, g: [R; 6]) {
        let (s0, y0) = (self.support.len(), self.y6.len());
        let mut gram = [[R::zero(); 6]; 6];
        self.support.extend_from_slice(support);
        for (entry, &c) in self.y6.add(support.len()).iter_mut().zip(support) {
            let y = y(c as usize);
            *entry = y;
            for i in 0..6 {
                for j in i..6 {
                    gram[i][j] += y[i] * y[j];
                }
            }
        }
        self.wide.push(WideBlock::new(s0..s0 + support.len(), y0, &gram, active, mu, g, self.least_mobility));
    }

    /// Coordinates and entries of a scalar row.
    #[inline(always)]
    pub fn scalar_entries(&self, row: &ScalarRow<R>) -> (&[u32], &[R]) {
        let support = &self.support[row.support.clone()];
        (support, self.y.row(row.y, support.len()))
    }

    /// Calls `f` for every row or contact that a lane has with the coordinates that it touches there, ascending.
    pub fn for_each_support(&self, lane: usize, mut f: impl FnMut(&mut dyn Iterator<Item = u32>)) {
        let exists = |mask: R::Mask| mask.bits() >> lane & 1 == 1;
        let there = |y: R| y.lane(lane).to_f64() != 0.0;
        for row in self.scalars.iter().filter(|row| exists(row.active)) {
            let (support, y) = self.scalar_entries(row);
            f(&mut support.iter().zip(y).filter(|(_, y)| there(**y)).map(|(c, _)| *c));
        }
        for block in self.contacts.iter().filter(|block| exists(block.active)) {
            let (support, y) = self.contact_entries(block);
            f(&mut support.iter().zip(y).filter(|(_, y)| y.iter().any(|&y| there(y))).map(|(c, _)| *c));
        }
        for block in self.wide.iter().filter(|block| exists(block.active)) {
            let (support, y) = self.wide_entries(block);
            f(&mut support.iter().zip(y).filter(|(_, y)| y.iter().any(|&y| there(y))).map(|(c, _)| *c));
        }
    }

    /// Coordinates and entries of a contact.
    #[inline(always)]
    pub(crate) fn contact_entries(&self, block: &ContactBlock<R>) -> (&[u32], &[[R; 3]]) {
        let support = &self.support[block.support.clone()];
        (support, self.y3.row(block.y, support.len()))
    }

    /// Velocity of a scalar row for the scaled velocity change w, but for what its compliance gives way.
    #[inline(always)]
    pub fn scalar_velocity(&self, row: &ScalarRow<R>, w: &[R]) -> R {
        let (support, y) = self.scalar_entries(row);
        // Two partial sums, each waiting for itself alone. A row's support is that of all lanes, so that the order is everybody's.
        let mut v = [R::zero(); 2];
        let (pairs, last) = support.as_chunks::<2>();
        let (y, y_last) = y.as_chunks::<2>();
        for (c, y) in pairs.iter().zip(y) {
            for k in 0..2 {
                v[k] += y[k] * w[c[k] as usize];
            }
        }
        for (&c, &y) in last.iter().zip(y_last) {
            v[0] += y * w[c as usize];
        }
        (v[0] + v[1]) + row.g
    }

    /// Velocity of a contact for the scaled velocity change w and the impulse `lambda`, with what its compliance gives way.
    #[inline(always)]
    pub(crate) fn contact_velocity_under(&self, block: &ContactBlock<R>, w: &[R], lambda: &[R; 3]) -> [R; 3] {
        let mut v = self.contact_velocity(block, w);
        if self.damped {
            for k in 0..3 {
                v[k] += block.compliance * lambda[k];
            }
        }
        v
    }

    /// The same of a contact with six rows.
    #[inline(always)]
    pub(crate) fn wide_velocity_under(&self, block: &WideBlock<R>, w: &[R], lambda: &[R; 6]) -> [R; 6] {
        let mut v = self.wide_velocity(block, w);
        if self.damped {
            for k in 0..6 {
                v[k] += block.compliance * lambda[k];
            }
        }
        v
    }

    /// Velocity (n, t1, t2) of a contact for the scaled velocity change w.
    #[inline(always)]
    pub fn contact_velocity(&self, block: &ContactBlock<R>, w: &[R]) -> [R; 3] {
        let (support, y) = self.contact_entries(block);
        let mut v = [R::zero(); 3];
        for (&c, y) in support.iter().zip(y) {
            let w = w[c as usize];
            v[0] += y[0] * w;
            v[1] += y[1] * w;
            v[2] += y[2] * w;
        }
        [v[0] + block.g[0], v[1] + block.g[1], v[2] + block.g[2]]
    }

    /// Coordinates and entries of a contact with six rows.
    #[inline(always)]
    pub(crate) fn wide_entries(&self, block: &WideBlock<R>) -> (&[u32], &[[R; 6]]) {
        let support = &self.support[block.support.clone()];
        (support, self.y6.row(block.y, support.len()))
    }

    /// Velocity of a contact with six rows for the scaled velocity change w.
    #[inline(always)]
    pub fn wide_velocity(&self, block: &WideBlock<R>, w: &[R]) -> [R; 6] {
        let (support, y) = self.wide_entries(block);
        let mut v = [R::zero(); 6];
        for (&c, y) in support.iter().zip(y) {
            let w = w[c as usize];
            for k in 0..6 {
                v[k] += y[k] * w;
            }
        }
        for k in 0..6 {
            v[k] += block.g[k];
        }
        v
    }

    /// w += Y d for a contact with six rows.
    #[inline(always)]
    pub fn add_wide(&self, block: &WideBlock<R>, d: [R; 6], w: &mut [R]) {
        let (support, y) = self.wide_entries(block);
        for (&c, y) in support.iter().zip(y) {
            let mut sum = y[0] * d[0];
            for k in 1..6 {
                sum += y[k] * d[k];
            }
            w[c as usize] += sum;
        }
    }

    /// w += y d for a scalar row.
    #[inline(always)]
    pub(crate) fn add_scalar(&self, row: &ScalarRow<R>, d: R, w: &mut [R]) {
        let (support, y) = self.scalar_entries(row);
        for (&c, &y) in support.iter().zip(y) {
            w[c as usize] += y * d;
        }
    }

    /// w += Y d for a contact.
    #[inline(always)]
    pub fn add_contact(&self, block: &ContactBlock<R>, d: [R; 3], w: &mut [R]) {
        let (support, y) = self.contact_entries(block);
        for (&c, y) in support.iter().zip(y) {
            w[c as usize] += y[0] * d[0] + y[1] * d[1] + y[2] * d[2];
        }
    }
}

/// The unknowns: impulses, and the scaled velocity change that they make.
#[derive(Clone, Debug)]
pub struct Iterate<R: Real> {
    /// w = sum_i y_i lambda_i.
    pub w: Vec<R>,
    /// Impulses of the scalar rows, N s or N m s.
    pub scalars: Vec<R>,
    /// Impulses of the contacts in their frames (n, t1, t2), N s.
    pub contacts: Vec<[R; 3]>,
    /// Impulses of the contacts with six rows, as those are scaled, N s.
    pub wide: Vec<[R; 6]>,
    /// Multiplier of the friction disc in each contact, the starting point of the next local solve; 0 while it sticks.
    pub(crate) slip: Vec<R>,
    pub(crate) wide_slip: Vec<R>,
    pub(crate) history: History<R>,
    pub(crate) aside: Option<Box<Aside<R::Half>>>,
    /// What a further pass may not make worse.
    pub(crate) kept: Saved<R>,
}

/// Impulses and w that are put aside for a while.
#[derive(Clone, Debug, Default)]
pub struct Saved<R> {
    w: Vec<R>,
    scalars: Vec<R>,
    contacts: Vec<[R; 3]>,
    wide: Vec<[R; 6]>,
}

impl<R: Real> Saved<R> {
    /// Room for the unknowns of a problem with that room.
    pub fn new(room: &Capacity) -> Self {
        Self {
            w: Vec::with_capacity(room.dimension),
            scalars: Vec::with_capacity(room.scalars),
            contacts: Vec::with_capacity(room.contacts),
            wide: Vec::with_capacity(room.wide),
        }
    }

    /// Keeps what an iterate has, if any lane of `lanes` will want it back.
    pub fn keep(&mut self, iterate: &Iterate<R>, lanes: R::Mask) {
        if lanes.any() {
            self.w.clone_from(&iterate.w);
            self.scalars.clone_from(&iterate.scalars);
            self.contacts.clone_from(&iterate.contacts);
            self.wide.clone_from(&iterate.wide);
        }
    }

    /// Gives it back to the lanes `lanes`.
    pub fn give(&self, iterate: &mut Iterate<R>, lanes: R::Mask) {
        if lanes.any() {
            R::vectorize(
                #[inline(always)]
                || iterate.copy_lanes(self, lanes),
            );
        }
    }
}

impl<R: Real> Iterate<R> {
    /// Room for the unknowns of a problem with so many rows.
    pub fn with_capacity(dimension: usize, scalars: usize, contacts: usize) -> Self {
        Self::new(&Capacity { dimension, scalars, contacts, ..Capacity::default() })
    }

    /// Room for the unknowns of a problem with that room.
    pub fn new(room: &Capacity) -> Self {
        Self {
            w: vec![R::zero(); room.dimension],
            scalars: Vec::with_capacity(room.scalars),
            contacts: Vec::with_capacity(room.contacts),
            wide: Vec::with_capacity(room.wide),
            slip: Vec::with_capacity(room.contacts),
            wide_slip: Vec::with_capacity(room.wide),
            history: History::new(room),
            aside: Aside::new::<R>(room),
            kept: Saved::new(room),
        }
    }

    /// The part of some lanes.
    #[inline(always)]
    pub(crate) fn pick(&self, order: &Order, out: &mut Iterate<R::Half>) {
        let lists = [(&self.w, &mut out.w), (&self.scalars, &mut out.scalars), (&self.slip, &mut out.slip)];
        for (from, to) in lists.into_iter().chain([(&self.wide_slip, &mut out.wide_slip)]) {
            order.pick_numbers(from, to);
        }
        order.pick_all(&self.contacts, &mut out.contacts);
        order.pick_all(&self.wide, &mut out.wide);
        self.history.pick(order, &mut out.history);
    }

    /// Copies impulses and w of the lanes `lanes`.
    #[inline(always)]
    fn copy_lanes(&mut self, from: &Saved<R>, lanes: R::Mask) {
        let Saved { w, scalars, contacts, wide } = from;
        for (to, from) in [(&mut self.w, w), (&mut self.scalars, scalars)] {
            for (to, &from) in to.iter_mut().zip(from) {
                *to = R::select(lanes, from, *to);
            }
        }
        for (to, from) in [(self.contacts.as_flattened_mut(), contacts.as_flattened()), (self.wide.as_flattened_mut(), wide.as_flattened())]
        {
            for (to, &from) in to.iter_mut().zip(from) {
                *to = R::select(lanes, from, *to);
            }
        }
    }

    /// Forgets all impulses; the caller pushes a warm start (or zeros) for every row, then calls [`Iterate::start`].
    #[inline(always)]
    pub fn clear(&mut self) {
        self.scalars.clear();
        self.contacts.clear();
        self.slip.clear();
        self.wide.clear();
        self.wide_slip.clear();
    }

    /// Whether the impulses change any velocity.
    #[inline(always)]
    pub fn moves(&self) -> bool {
        self.w.iter().any(
            #[inline(always)]
            |w| !w.eq(R::zero()).all(),
        )
    }

    /// Solves the separate rows in the lanes `lanes`.
    #[inline(always)]
    pub(crate) fn meet(&mut self, problem: &Problem<R>, lanes: R::Mask) {
        for (row, lambda) in problem.scalars.iter().zip(&mut self.scalars).take(problem.separate) {
            let v = problem.scalar_velocity(row, &self.w);
            let d = keep(lanes.and(row.active), -(v * row.inv_diagonal));
            *lambda += d;
            problem.add_scalar(row, d, &mut self.w);
        }
    }

    /// Makes w consistent with the impulses.
    #[inline(always)]
    pub fn start(&mut self, problem: &Problem<R>) {
        self.w.fill(R::zero());
        for (row, &lambda) in problem.scalars.iter().zip(&self.scalars) {
            problem.add_scalar(row, lambda, &mut self.w);
        }
        for (block, &lambda) in problem.contacts.iter().zip(&self.contacts) {
            problem.add_contact(block, lambda, &mut self.w);
        }
        for (block, &lambda) in problem.wide.iter().zip(&self.wide) {
            problem.add_wide(block, lambda, &mut self.w);
        }
        self.slip.resize(problem.contacts.len(), R::zero());
        self.wide_slip.resize(problem.wide.len(), R::zero());
    }
}
