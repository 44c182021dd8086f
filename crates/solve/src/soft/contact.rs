//! Soft contact, with the inputs of its force.

use std::ops::Range;

use stepper_real::Real;

use crate::constraints::constraint_set::is_nonzero;

/// Contact with `N` rows: normal, two tangents and, of six, spin and two axes of rolling.
#[derive(Clone, Debug)]
pub struct SoftContact<R: Real, const N: usize> {
    /// Range of the contact in the lists of coordinates and Jacobian entries, which hold all contacts with `N` rows.
    pub(super) entries: Range<usize>,
    /// Reference acceleration of every row.
    pub reference: [R; N],
    /// Inverse regularisation of every row of an elliptic cone, or of the two edges along each friction row of a pyramid.
    ///
    /// The first entry of a pyramid is unused. All are 0 in lanes without the contact.
    pub weight: [R; N],
    /// Friction of the regularised cone, then the coefficient of friction of every other row; (1, 0, ...) without friction.
    pub scale: [R; N],
    /// Whether the contact does not roll in any lane, so that the last two of six rows are empty.
    pub(super) spins: bool,
    /// Weight of the cone's surface, D_n / (mu^2 (1 + mu^2)).
    pub(super) cone_weight: R,
}

impl<R: Real, const N: usize> SoftContact<R, N> {
    /// Contact with the range `entries` of the lists of all contacts with `N` rows.
    #[inline(always)]
    pub(super) fn new(entries: Range<usize>, reference: [R; N], weight: [R; N], scale: [R; N]) -> Self {
        let mu = scale[0] * scale[0];
        let spins = N == 6 && !is_nonzero(weight[N - 2]) && !is_nonzero(weight[N - 1]);
        Self { entries, reference, weight, scale, spins, cone_weight: weight[0] / (mu * (R::one() + mu)) }
    }
}
