//! Rows of the soft problem: the inputs of their forces.

use std::ops::Range;

use stepper_real::{Mask, Real, Scalar};

use crate::constraints::constraint_set::{add_transposed, multiply};
use crate::soft::cone::Cone;
use crate::soft::contact::SoftContact;

/// Largest product of the weight and the inverse inertia of a row, in double precision.
///
/// The limit changes a force by the inverse of this number, relative to the force. Rounding changes it by this number times the rounding
/// unit. Rows of ordinary contacts have a product of up to 1e4.
const MAX_WEIGHT: f64 = 1e8;

/// [`MAX_WEIGHT`] for contacts with an elliptic cone. Newton's method needs many steps on a curved cone with a large weight: of random
/// contacts with a product of 1e8, 6 % do not converge in 100 steps. With 1e7 all do.
const MAX_WEIGHT_ELLIPTIC: f64 = 1e7;

/// [`MAX_WEIGHT`] in single precision, for all rows.
const MAX_WEIGHT_SINGLE: f64 = 1e5;

/// Metric of the accelerations: the joint-space mass matrix M of each lane.
pub trait Metric<R: Real> {
    /// Number of degrees of freedom.
    fn dimension(&self) -> usize;
    /// Row `i` of the lower triangle of the mass matrix: columns of its entries, the diagonal first and then descending, and the entries.
    fn row(&self, i: usize) -> (&[u32], &[R]);
    /// Replaces the vector `x` by M^-1 x.
    fn solve(&self, x: &mut [R]);
    /// Multiplies the mass matrix M by the vector `x`, and writes M x to `out`.
    #[inline(always)]
    fn multiply(&self, x: &[R], out: &mut [R]) {
        out.fill(R::zero());
        for i in 0..self.dimension() {
            let (columns, entries) = self.row(i);
            let mut sum = entries[0] * x[i];
            for (&c, &entry) in columns[1..].iter().zip(&entries[1..]) {
                sum += entry * x[c as usize];
                out[c as usize] += entry * x[i];
            }
            out[i] += sum;
        }
    }
}

/// Scalar row with the force -D u between two bounds, where D is its weight. Here u = J a - r is its acceleration J a relative to its
/// reference acceleration r. An equality has no bounds, a limit one, dry friction two.
#[derive(Clone, Debug)]
pub struct SoftRow<R: Real> {
    /// Range of the row in the lists of coordinates and Jacobian entries of all scalar rows.
    pub(super) entries: Range<usize>,
    /// Reference acceleration r of the row, m/s^2 or rad/s^2.
    pub reference: R,
    /// Weight D = 1 / R of the row, the inverse of its regularisation R, kg or kg m^2. It is 0 in lanes without the row.
    pub weight: R,
    /// Least and largest force of the row, N or N m.
    pub bounds: [R; 2],
}

impl<R: Real> SoftRow<R> {
    /// Force of the row at the relative acceleration `u`, N or N m.
    #[inline(always)]
    pub(super) fn force(&self, u: R) -> R {
        (-self.weight * u).max(self.bounds[0]).min(self.bounds[1])
    }

    /// Minus the derivative of the force with respect to the relative acceleration `u`, kg or kg m^2.
    #[inline(always)]
    pub(super) fn curvature(&self, u: R) -> R {
        let free = -self.weight * u;
        R::select(self.bounds[0].lt(free), R::select(free.lt(self.bounds[1]), self.weight, R::zero()), R::zero())
    }
}

/// Soft contacts with `N` rows each, stored sparse.
#[derive(Clone, Debug)]
pub struct SoftContacts<R: Real, const N: usize> {
    /// Contacts of the list, with the inputs of their forces.
    pub items: Vec<SoftContact<R, N>>,
    /// Coordinates at which the contacts have entries, one contact after the other.
    pub(super) columns: Vec<u32>,
    /// Jacobian entries of all rows of a contact at the coordinates in `columns`.
    pub(super) jacobian: Vec<[R; N]>,
}

impl<R: Real, const N: usize> SoftContacts<R, N> {
    /// Empty list with memory for `contacts` contacts with `columns` coordinates each.
    fn with_capacity(contacts: usize, columns: usize) -> Self {
        let entries = contacts * columns;
        Self { items: Vec::with_capacity(contacts), columns: Vec::with_capacity(entries), jacobian: Vec::with_capacity(entries) }
    }

    /// Removes all contacts.
    #[inline(always)]
    fn clear(&mut self) {
        self.items.clear();
        self.columns.clear();
        self.jacobian.clear();
    }

    /// Appends a contact whose rows have the entries `jacobian` at the coordinates `columns`, ascending. The other arguments are the fields
    /// of [`SoftContact`] with these names.
    #[inline(always)]
    pub fn push(&mut self, columns: &[u32], jacobian: impl Fn(usize) -> [R; N], reference: [R; N], weight: [R; N], scale: [R; N]) {
        let start = self.columns.len();
        self.columns.extend_from_slice(columns);
        for &d in columns {
            self.jacobian.push(jacobian(d as usize));
        }
        self.items.push(SoftContact::new(start..self.columns.len(), reference, weight, scale));
    }

    /// Appends the contacts of `from` that exist in the lane `lane`. Appends their indices in `from` to `places`.
    pub(super) fn gather<L: Real<Single = R>>(&mut self, from: &SoftContacts<L, N>, lane: usize, places: &mut Vec<u32>) {
        for (i, contact) in from.items.iter().enumerate() {
            let weight = contact.weight.map(|weight| weight.single_lane(lane));
            if weight.iter().all(|weight| weight.eq(R::zero()).all()) {
                continue;
            }
            places.push(i as u32);
            let (columns, jacobian) = from.entries(contact);
            let start = self.columns.len();
            self.columns.extend_from_slice(columns);
            self.jacobian.extend(jacobian.iter().map(|j| j.map(|j| j.single_lane(lane))));
            let [reference, scale] = [contact.reference, contact.scale].map(|numbers| numbers.map(|x| x.single_lane(lane)));
            self.items.push(SoftContact::new(start..self.columns.len(), reference, weight, scale));
        }
    }

    /// Coordinates of a contact, and the Jacobian entries of its rows at each.
    #[inline(always)]
    pub(super) fn entries(&self, contact: &SoftContact<R, N>) -> (&[u32], &[[R; N]]) {
        (&self.columns[contact.entries.clone()], &self.jacobian[contact.entries.clone()])
    }

    /// Reduces the weights of contacts that are too large, see [`SoftProblem::limit_weights`].
    #[inline(always)]
    fn limit_weights(&mut self, cone: Cone, metric: &impl Metric<R>, limit: R, buffer: &mut [R]) {
        for contact in &mut self.items {
            let mut weights = contact.weight;
            if cone == Cone::Pyramidal {
                // The edges of a pyramid along a friction row are u_n + mu u_t and u_n - mu u_t, with the same weight.
                weights[0] = weights[1..].iter().fold(R::zero(), |most, &weight| most.max(weight));
                for k in 1..N {
                    weights[k] *= contact.scale[k].square();
                }
            }
            let entries = contact.entries.clone();
            if let Some(factor) =
                weight_factor(metric, weights, limit, &self.columns[entries.clone()], &self.jacobian[entries.clone()], buffer)
            {
                *contact = SoftContact::new(entries, contact.reference, contact.weight.map(|weight| weight * factor), contact.scale);
            }
        }
    }

    /// Multiplies the Jacobian J of all contacts by the vector `x`, and writes J x to `out`. If `relative`, it writes J x minus the
    /// reference accelerations.
    #[inline(always)]
    pub(super) fn multiply(&self, x: &[R], relative: bool, out: &mut Vec<[R; N]>) {
        out.clear();
        for contact in &self.items {
            let (columns, jacobian) = self.entries(contact);
            let mut u = multiply(columns, jacobian, x);
            if relative {
                for k in 0..N {
                    u[k] -= contact.reference[k];
                }
            }
            out.push(u);
        }
    }

    /// Adds the generalized forces J^T f of all contacts at the relative accelerations `u` to `out`.
    #[inline(always)]
    pub(super) fn add_forces(&self, cone: Cone, u: &[[R; N]], out: &mut [R]) {
        for (contact, u) in self.items.iter().zip(u) {
            let force = cone.force(contact, u);
            let (columns, jacobian) = self.entries(contact);
            add_transposed(columns, jacobian, force, out);
        }
    }

    /// Adds the generalized forces J^T f of all contacts to `out`. The row forces f are `forces`.
    #[inline(always)]
    pub(super) fn add(&self, forces: &[[R; N]], out: &mut [R]) {
        for (contact, force) in self.items.iter().zip(forces) {
            let (columns, jacobian) = self.entries(contact);
            add_transposed(columns, jacobian, *force, out);
        }
    }

    /// Sum of `slope` and the derivatives of all contacts' convex functions along `du`, after a step of length `step` from the relative
    /// accelerations `u`. The derivative of one contact is -f(u + step du) . du, where f is the force.
    #[inline(always)]
    pub(super) fn add_slopes(&self, cone: Cone, u: &[[R; N]], du: &[[R; N]], step: R, mut slope: R) -> R {
        for ((contact, u), du) in self.items.iter().zip(u).zip(du) {
            let force = cone.force(contact, &moved(u, du, step));
            for k in 0..N {
                slope -= force[k] * du[k];
            }
        }
        slope
    }

    /// Sum of `sum` and the second derivatives of all contacts' convex functions along `du`, after a step of length `step` from the
    /// relative accelerations `u`.
    #[inline(always)]
    pub(super) fn add_curvatures(&self, cone: Cone, u: &[[R; N]], du: &[[R; N]], step: R, mut sum: R) -> R {
        for ((contact, u), du) in self.items.iter().zip(u).zip(du) {
            sum += cone.curvature_along(contact, &moved(u, du, step), du);
        }
        sum
    }
}

/// Factor, at most 1, by which the weights of a constraint must be reduced: see [`SoftProblem::limit_weights`]. `None` if it is 1 in all
/// lanes. Rows have the weights `weights`, and the entries `jacobian` at the coordinates `columns`. `limit` is the largest product of a
/// row's weight and inverse inertia. Overwrites `buffer`.
#[inline(always)]
fn weight_factor<R: Real, const N: usize>(
    metric: &impl Metric<R>,
    weights: [R; N],
    limit: R,
    columns: &[u32],
    jacobian: &[[R; N]],
    buffer: &mut [R],
) -> Option<R> {
    // A row's inverse inertia J M^-1 J^T is at least J_d^2 / M_dd, for every coordinate d.
    let mut exceeds = R::Mask::splat(false);
    for (&d, j) in columns.iter().zip(jacobian) {
        let mut added = R::zero();
        for k in 0..N {
            added += weights[k] * j[k].square();
        }
        exceeds = exceeds.or(added.gt(limit * metric.row(d as usize).1[0]));
    }
    exceeds.any().then(|| {
        let mut most = limit;
        for k in 0..N {
            buffer.fill(R::zero());
            columns.iter().zip(jacobian).for_each(|(&d, j)| buffer[d as usize] = j[k]);
            metric.solve(buffer);
            let inverse_inertia = columns.iter().zip(jacobian).fold(R::zero(), |sum, (&d, j)| sum + j[k] * buffer[d as usize]);
            most = most.max(weights[k] * inverse_inertia);
        }
        R::select(exceeds, limit / most, R::one())
    })
}

/// Relative acceleration u + step du, from the relative acceleration `u` of a contact, after a step of length `step` along `du`.
#[inline(always)]
fn moved<R: Real, const N: usize>(u: &[R; N], du: &[R; N], step: R) -> [R; N] {
    let mut at = *u;
    for k in 0..N {
        at[k] += step * du[k];
    }
    at
}

/// Soft constraint problem of one step, for every lane.
#[derive(Clone, Debug)]
pub struct SoftProblem<R: Real> {
    /// Shape of the friction cones of all contacts.
    pub cone: Cone,
    /// Scalar rows: equalities, dry friction, limits.
    pub rows: Vec<SoftRow<R>>,
    /// Coordinates at which the scalar rows have entries, one row after the other.
    pub(super) columns: Vec<u32>,
    /// Jacobian entries of the scalar rows at the coordinates in `columns`.
    pub(super) jacobian: Vec<R>,
    /// Contacts with sliding friction or none.
    pub contacts: SoftContacts<R, 3>,
    /// Contacts with torsional or rolling friction.
    pub rolling_contacts: SoftContacts<R, 6>,
}

impl<R: Real> SoftProblem<R> {
    /// Empty problem with memory for `rows` scalar rows, for `entries` Jacobian entries of these rows together, and for `contacts` contacts
    /// with three rows.
    ///
    /// Each contact may have entries at `columns_per_contact` coordinates. If `rolls`, there is also memory for `contacts` contacts with
    /// rolling friction.
    pub fn new(cone: Cone, rows: usize, entries: usize, contacts: usize, columns_per_contact: usize, rolls: bool) -> Self {
        Self {
            cone,
            rows: Vec::with_capacity(rows),
            columns: Vec::with_capacity(entries),
            jacobian: Vec::with_capacity(entries),
            contacts: SoftContacts::with_capacity(contacts, columns_per_contact),
            rolling_contacts: SoftContacts::with_capacity(if rolls { contacts } else { 0 }, columns_per_contact),
        }
    }

    /// Removes all rows.
    #[inline(always)]
    pub fn clear(&mut self) {
        self.rows.clear();
        self.columns.clear();
        self.jacobian.clear();
        self.contacts.clear();
        self.rolling_contacts.clear();
    }

    /// Whether the problem has no rows.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty() && self.contacts.items.is_empty() && self.rolling_contacts.items.is_empty()
    }

    /// Appends a scalar row with the entries `jacobian` at the coordinates `columns`, ascending. The other arguments are the fields of
    /// [`SoftRow`] with these names.
    #[inline(always)]
    pub fn push_row(&mut self, columns: &[u32], jacobian: impl Fn(usize) -> R, reference: R, weight: R, bounds: [R; 2]) {
        self.push_entries(columns, columns.iter().map(|&d| jacobian(d as usize)), reference, weight, bounds);
    }

    /// Appends a scalar row with the given entries at the coordinates `columns`, ascending. The other arguments are the fields of
    /// [`SoftRow`] with these names.
    #[inline(always)]
    pub(super) fn push_entries(&mut self, columns: &[u32], entries: impl Iterator<Item = R>, reference: R, weight: R, bounds: [R; 2]) {
        let start = self.columns.len();
        self.columns.extend_from_slice(columns);
        self.jacobian.extend(entries);
        self.rows.push(SoftRow { entries: start..self.columns.len(), reference, weight, bounds });
    }

    /// Reduces the weights of rows so much that rounding spoils neither the Hessian nor the forces. `metric` is the mass matrix M.
    /// Overwrites `buffer`, which has an entry for each coordinate.
    ///
    /// Contacts of a body that turns about its centre of mass have enormous weights, because MuJoCo's approximation of their inverse
    /// inertia is 0. If the product of weight and J_d^2 / M_dd exceeds the limit at any coordinate d, the rows are scaled. The product
    /// of weight and inverse inertia J M^-1 J^T is then the limit: [`MAX_WEIGHT`], [`MAX_WEIGHT_ELLIPTIC`] or [`MAX_WEIGHT_SINGLE`].
    #[inline(always)]
    pub(super) fn limit_weights(&mut self, metric: &impl Metric<R>, buffer: &mut [R]) {
        let is_single = <R::Scalar as Scalar>::EPSILON.to_f64() > f64::EPSILON;
        let limit_of = |limit: f64| R::of(if is_single { MAX_WEIGHT_SINGLE } else { limit });
        let limit = limit_of(MAX_WEIGHT);
        for row in &mut self.rows {
            let entries = row.entries.clone();
            let jacobian = self.jacobian[entries.clone()].as_chunks::<1>().0;
            if let Some(factor) = weight_factor(metric, [row.weight], limit, &self.columns[entries], jacobian, buffer) {
                row.weight *= factor;
            }
        }
        let limit = limit_of(if self.cone == Cone::Elliptic { MAX_WEIGHT_ELLIPTIC } else { MAX_WEIGHT });
        self.contacts.limit_weights(self.cone, metric, limit, buffer);
        self.rolling_contacts.limit_weights(self.cone, metric, limit, buffer);
    }

    /// Coordinates of a scalar row, and its Jacobian entry at each.
    #[inline(always)]
    pub(super) fn entries(&self, row: &SoftRow<R>) -> (&[u32], &[R]) {
        (&self.columns[row.entries.clone()], &self.jacobian[row.entries.clone()])
    }

    /// Multiplies the Jacobian J of the scalar rows by the vector `x`, and writes J x to `out`. If `relative`, it writes J x minus the
    /// reference accelerations.
    #[inline(always)]
    pub(super) fn multiply_rows(&self, x: &[R], relative: bool, out: &mut Vec<R>) {
        out.clear();
        for row in &self.rows {
            let (columns, jacobian) = self.entries(row);
            let mut u = R::zero();
            for (&d, &j) in columns.iter().zip(jacobian) {
                u += j * x[d as usize];
            }
            out.push(if relative { u - row.reference } else { u });
        }
    }
}
