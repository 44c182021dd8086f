//! Soft contact: the inputs of its force.

use std::ops::Range;

use stepper_real::Real;

use crate::constraints::constraint_set::is_nonzero;

/// Soft contact with `N` rows: normal and two tangents; with six rows also spin and two axes of rolling.
#[derive(Clone, Debug)]
pub struct SoftContact<R: Real, const N: usize> {
    /// Range of the contact in the lists of coordinates and Jacobian entries of all contacts with `N` rows.
    pub(super) entries: Range<usize>,
    /// Reference acceleration of each row of the contact, m/s^2 or rad/s^2.
    pub reference: [R; N],
    /// Inverse 1 / R of the regularisation of each row of an elliptic cone, or of the two edges along each friction row of a pyramid.
    ///
    /// The first entry of a pyramid is unused. All entries are 0 in lanes without the contact.
    pub weight: [R; N],
    /// Scale factors of the rows, which make the friction cone circular. The first is the normal row's: mu of MuJoCo's solver, the first
    /// friction coefficient divided by the square root of `impratio`. The others are the friction coefficients of their rows. Without
    /// friction, the factors are (1, 0, ...).
    pub scale: [R; N],
    /// Whether the contact has no rolling friction in any lane, so that the last two of six rows are empty.
    pub(super) does_not_roll: bool,
    /// Weight D_n / (mu^2 (1 + mu^2)) of the friction cone's surface, where D_n is the weight of the normal row.
    pub(super) cone_weight: R,
}

impl<R: Real, const N: usize> SoftContact<R, N> {
    /// Contact with the range `entries` in the lists of all contacts with `N` rows. The other arguments are the fields of [`SoftContact`]
    /// with these names.
    #[inline(always)]
    pub(super) fn new(entries: Range<usize>, reference: [R; N], weight: [R; N], scale: [R; N]) -> Self {
        let mu = scale[0] * scale[0];
        let does_not_roll = N == 6 && !is_nonzero(weight[N - 2]) && !is_nonzero(weight[N - 1]);
        Self { entries, reference, weight, scale, does_not_roll, cone_weight: weight[0] / (mu * (R::one() + mu)) }
    }
}
