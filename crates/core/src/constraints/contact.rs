//! Contacts with sliding friction: three rows each.

use stepper_real::{Mask, Real, Scalar};

use crate::collision::contact_set::Contacts;
use crate::constraints::constraint_set::{Approaching, Constraints};
use crate::constraints::elimination::Lengths;
use crate::constraints::equality::RowInput;
use crate::math::spatial::*;

/// Least mobility along a contact's normal, as a fraction of that of all moving mass as one body. Below it the lever arm with which a hinge
/// moves along the normal is rounding: less than 1e-7 of its length in 64 bits, 3e-5 in 32.
pub(crate) fn least_mobility<R: Real>() -> f64 {
    1e-14_f64.max((256.0 * <R::Scalar as Scalar>::EPSILON.to_f64()).powi(2))
}

/// Rows of a slot along the normal and the tangents; their columns are in [`Constraints::column`].
pub(crate) struct SlidingRows<R: Real> {
    /// What each row demands of velocities and of positions, m/s.
    pub(crate) demands: [[R; 2]; 3],
    /// Squared lengths of the rows, where equalities are taken out of them.
    pub(crate) lengths: Option<Lengths<R, 3>>,
    /// Lanes in which the contact can push, now or once it is activated.
    pub(crate) active: R::Mask,
    /// Those in which its rows wait; without contact, slot and impulse, which the caller knows.
    pub(crate) approaching: Approaching<R>,
    /// Compliance of the normal row, 1/kg, where surfaces of the model give way.
    pub(crate) compliance: Option<R>,
}

impl<R: Real> Constraints<R> {
    /// Adds slot `k` in the lanes `lanes`, in which it has sliding friction at the most; `support` is gathered.
    #[inline(always)]
    pub(crate) fn add_contact(&mut self, input: RowInput<'_, R>, contacts: &Contacts<R>, k: usize, lanes: u32) {
        let (slot, mass) = (&contacts.data[k], input.mass);
        let SlidingRows { demands: g, lengths, active, approaching, compliance } = self.sliding_rows(input, contacts, k, lanes);
        let (column, contact) = (&self.column, self.problem.contacts.len());
        self.problem.push_contact(
            &self.support,
            #[inline(always)]
            |d| scale(column[d], mass.sqrt_inv_d[d]),
            active,
            slot.mu,
            [g[0][0], g[1][0], g[2][0]],
        );
        if let Some(lengths) = lengths {
            self.problem.contacts.set_trace_ratio(lengths.times());
        }
        if let Some(compliance) = compliance {
            self.problem.contacts.set_compliance(compliance);
        }
        self.problem.contacts.set_position_demand([g[0][1], g[1][1] - g[1][0], g[2][1] - g[2][0]]);
        let solved = active.and_not(approaching.lanes);
        if approaching.lanes.any() {
            self.problem.contacts.defer(approaching.lanes);
            let [n, a, b] = slot.impulse;
            let impulse = [n, a, b, R::zero(), R::zero(), R::zero()];
            self.approaching.push(Approaching { contact, slot: k, impulse, ..approaching });
        }
        self.iterate.contacts.push(select(solved, slot.impulse, zero()));
        self.slots.push((k, R::Mask::from_bits(lanes)));
        self.constrained = self.constrained.or(solved);
    }

    /// The rows of slot `k` in the lanes `lanes` along its normal and its tangents; `support` is gathered.
    #[inline(always)]
    pub(crate) fn sliding_rows(&mut self, input: RowInput<'_, R>, contacts: &Contacts<R>, k: usize, lanes: u32) -> SlidingRows<R> {
        let RowInput { compiled, options, mass, assembly, .. } = input;
        let (slot, active) = (&contacts.data[k], R::Mask::from_bits(lanes));
        let [free, before] = self.contact_columns(input, contacts, k, lanes);
        let curves = assembly.in_the_middle && self.moving != 0;
        let change = if self.has_impacts || curves { self.free_change(assembly) } else { zero() };
        self.half_solve::<3>(compiled, mass);
        let springs = compiled.has_contact_springs.then(|| self.give_way(input, contacts, k, lanes, [free[0], before[0]]));
        let rigid = springs.as_ref().map_or(active, |row| active.and_not(row.lanes));
        let (mut bias, mut position) = self.biases(options, assembly.gap(slot.point.distance), assembly.h, rigid);
        if let Some(row) = &springs {
            // Its position is the spring's, and nothing corrects it.
            [bias, position] = [bias, position].map(|x| R::select(row.lanes, row.bias, x));
        }
        let (bias, mut active) = self.bounce(compiled, options, slot, assembly, active, [free[0], before[0]], bias);
        let mut demands = [[free[0] + bias, free[0] + position], [free[1]; 2], [free[2]; 2]];
        let lengths = self.eliminate(mass, &mut demands);
        let held = demands[0][0] - bias;
        if self.has_impacts {
            active = self.bounce_within(input, slot, active, [free, change], bias, &mut demands);
        }
        let bounces = self.impacts.last().map_or(R::Mask::splat(false), |impact| impact.lanes);
        let lanes = self.approaching_lanes(input, slot, active.and(rigid), [before[0], held]);
        let impulse = [R::zero(); 6];
        let approaching = Approaching { contact: 0, slot: k, lanes, bounces, bias: demands[0][0] - held, impulse };
        if curves {
            self.add_curve(input, contacts, k, active, [free, change], &mut demands);
        }
        SlidingRows { demands, lengths, active, approaching, compliance: springs.map(|row| row.compliance) }
    }
}
