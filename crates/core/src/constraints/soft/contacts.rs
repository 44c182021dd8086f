//! Rows of contacts with MuJoCo's contact law.

use stepper_real::{Mask, Real, kernel};
use stepper_solve::soft::{Cone, ContactVisit};

use crate::collision::contact_set::Contacts;
use crate::collision::surface_velocity;
use crate::compile::{LaneModel, MIN_FRICTION, SoftContactLaw, SoftLaw};
use crate::constraints::soft::assembly::{SoftAssembler, SoftInput};
use crate::math::spatial::*;

/// Parameters of MuJoCo's contact law for the contacts in one slot (one contact per lane).
struct ContactLaw<R: Real> {
    /// Stiffness K times impedance d, 1/s^2, and damping B, 1/s, of the normal row.
    spring: [R; 2],
    /// Impedance d of the normal row, between 0 and 1.
    impedance: R,
    /// Approximate inverse inertia along the normal, 1/kg.
    inverse_inertia: R,
    /// Regularisation of the normal force of a contact spring, 1/kg; 0 for contacts without a spring.
    spring_regularisation: R,
    /// Damping B of the friction rows, 1/s.
    friction_damping: R,
    /// Coefficients of friction: sliding twice, torsional, rolling twice.
    friction: [R; 5],
    /// Number of friction rows of each contact: condim - 1.
    frictions: R,
}

impl<R: Real> ContactLaw<R> {
    #[inline(always)]
    fn gather(input: SoftInput<'_, R>, contacts: &Contacts<R>, k: usize, lanes: u32) -> Self {
        let (compiled, slot) = (input.state.compiled, &contacts.data[k]);
        let z = R::zero();
        let mut law = Self {
            spring: [z; 2],
            impedance: R::of(0.5),
            inverse_inertia: z,
            spring_regularisation: z,
            friction_damping: z,
            friction: [R::one(); 5],
            frictions: z,
        };
        for (pair, lanes) in contacts.pairs(k, lanes) {
            let there = R::Mask::from_bits(lanes);
            let own: SoftContactLaw<R::Scalar> = compiled.soft_contact(input.softness, pair);
            let params = compiled.contact(pair);
            let impedance = own.normal.impedance(slot.point.distance);
            let least = |x: R| x.max(R::of(MIN_FRICTION));
            let [slide, roll] = own.anisotropy.map(R::splat);
            let friction =
                [least(params.mu), least(params.mu * slide), least(params.torsion), least(params.rolling), least(params.rolling * roll)];
            law.impedance = R::select(there, impedance, law.impedance);
            let spring = [R::splat(own.normal.stiffness) * impedance, R::splat(own.normal.damping)];
            let friction_damping = R::splat(own.friction_damping);
            law.spring = [R::select(there, spring[0], law.spring[0]), R::select(there, spring[1], law.spring[1])];
            law.inverse_inertia = R::select(there, R::splat(own.normal.weight), law.inverse_inertia);
            law.spring_regularisation = R::select(there, R::splat(own.spring), law.spring_regularisation);
            law.friction_damping = R::select(there, friction_damping, law.friction_damping);
            for i in 0..5 {
                law.friction[i] = R::select(there, friction[i], law.friction[i]);
            }
            law.frictions = R::select(there, R::of(f64::from(own.condim) - 1.0), law.frictions);
        }
        law
    }

    /// Reference accelerations, weights D = 1 / R and scales of `N` rows of the contacts in the lanes `active`; see
    /// [`stepper_solve::soft::SoftContact`].
    ///
    /// `distance` is the distance of the contacts, m, and `v` the velocities of the rows.
    #[inline(always)]
    fn rows<const N: usize>(&self, (cone, impratio): (Cone, R), distance: R, v: [R; N], active: R::Mask) -> [[R; N]; 3] {
        let mut reference = [R::zero(); N];
        reference[0] = -(self.spring[1] * v[0]) - self.spring[0] * distance;
        // The edges of a pyramid have the damping of the normal row.
        let damping = if cone == Cone::Elliptic { self.friction_damping } else { self.spring[1] };
        for i in 1..N {
            reference[i] = -(damping * v[i]);
        }
        let [weight, scale] = self.weights(cone, impratio, active);
        [reference, weight, scale]
    }

    /// Weights D = 1 / R and scales of `N` rows of a contact in the lanes `active`; see [`stepper_solve::soft::SoftContact`].
    #[inline(always)]
    fn weights<const N: usize>(&self, cone: Cone, impratio: R, active: R::Mask) -> [[R; N]; 2] {
        let (zero, one) = (R::zero(), R::one());
        let (mut weight, mut scale) = ([zero; N], [zero; N]);
        let mu = self.friction[0];
        let rubs = self.frictions.gt(zero);
        let cone_mu = mu / impratio.sqrt();
        let diagonal = match cone {
            Cone::Elliptic => self.inverse_inertia,
            Cone::Pyramidal => R::select(rubs, self.inverse_inertia + mu * mu * self.inverse_inertia, self.inverse_inertia),
        };
        let normal = SoftLaw::<R::Scalar>::regularisation(self.impedance, diagonal);
        scale[0] = R::select(rubs, cone_mu, one);
        weight[0] = R::select(active, one / normal, zero);
        // Without friction, the two edges of a pyramid both are the normal.
        let edge = R::select(rubs, R::of(2.0) * cone_mu * cone_mu * normal, normal + normal);
        // All edges of the pyramid together carry the load of the spring.
        let edges = R::of(2.0) * self.frictions.max(one);
        let edge = R::select(self.spring_regularisation.gt(zero), edges * self.spring_regularisation, edge);
        for i in 1..N {
            let exists = active.and(R::of(i as f64).le(self.frictions));
            scale[i] = R::select(exists, self.friction[i - 1], zero);
            weight[i] = match cone {
                Cone::Elliptic => {
                    let ratio = mu / self.friction[i - 1];
                    R::select(exists, impratio / normal / (ratio * ratio), zero)
                }
                Cone::Pyramidal => {
                    let first = active.and_not(rubs).and(R::Mask::splat(i == 1));
                    R::select(exists.or(first), one / edge, zero)
                }
            };
        }
        [weight, scale]
    }
}

impl<R: Real> SoftAssembler<'_, R> {
    /// Adds the rows of contacts that are closer than their margin, slot by slot.
    ///
    /// In different lanes, a slot may have contacts between different trees. The function adds one contact of the problem for all lanes in
    /// which the trees are the same. No row then connects trees that do not touch in its lanes.
    pub(super) fn add_contacts(&mut self, contacts: &Contacts<R>) {
        let SoftInput { state, softness, .. } = self.input;
        let compiled = state.compiled;
        for k in 0..contacts.slots() {
            let distance = state.solved_overlaps.map_or(contacts.data[k].point.distance, |solved| solved.distance(contacts, k));
            let near = R::Mask::from_bits(contacts.lanes_of(k)).and(distance.lt(R::zero())).bits();
            let mut rolling = 0;
            if compiled.has_rolling_friction {
                for (pair, lanes) in contacts.pairs(k, near) {
                    rolling |= if compiled.soft_contact(softness, pair).condim > 3 { lanes } else { 0 };
                }
            }
            for (rolls, mut rest) in [(false, near & !rolling), (true, rolling)] {
                while rest != 0 {
                    let lanes = lanes_of_same_trees(compiled, contacts, k, rest);
                    rest &= !lanes;
                    kernel!(R, || self.add_contact(contacts, (k, lanes), rolls));
                }
            }
        }
    }

    /// Adds the contact in slot `k`, in the lanes `lanes` (bits). It has three rows, or six rows if it `rolls` (has torsional or rolling
    /// friction).
    #[inline(always)]
    fn add_contact(&mut self, contacts: &Contacts<R>, (k, lanes): (usize, u32), rolls: bool) {
        let Self { input, builder, system } = self;
        let (state, active, slot) = (&input.state, R::Mask::from_bits(lanes), &contacts.data[k]);
        builder.gather_dofs(state, contacts, k, lanes);
        let [[n, a, b], _] = builder.contact_columns(state, contacts, k, lanes);
        for &d in &builder.dofs {
            let d = d as usize;
            builder.column[d] = select(active, builder.column[d], zero());
        }
        let law = ContactLaw::gather(*input, contacts, k, lanes);
        let (cone, distance) = ((system.problem.cone, R::splat(input.softness.impratio)), slot.point.distance);
        if rolls {
            builder.keep_sliding_rows();
            let normal = slot.point.normal;
            let axes = [normal, slot.tangent, cross(normal, slot.tangent)];
            let surface_rotation = angular(&surface_velocity::motion(state.compiled, state.kinematics, contacts, k, lanes));
            let turning = [dot(normal, surface_rotation), R::zero(), R::zero()];
            let [spin, roll_a, roll_b] = builder.rotation_columns(state, &axes, [R::one(); 3], turning);
            let (linear, rotation) = (&builder.linear, &builder.column);
            let [reference, weight, scales] = law.rows(cone, distance, [n, a, b, spin, roll_a, roll_b], active);
            system.problem.rolling_contacts.push(
                &builder.dofs,
                #[inline(always)]
                |d| {
                    let ([a, b, c], [x, y, z]) = (linear[d], select(active, rotation[d], zero()));
                    [a, b, c, x, y, z]
                },
                reference,
                weight,
                scales,
            );
        } else {
            let column = &builder.column;
            let [reference, weight, scales] = law.rows(cone, distance, [n, a, b], active);
            system.problem.contacts.push(
                &builder.dofs,
                #[inline(always)]
                |d| column[d],
                reference,
                weight,
                scales,
            );
        }
        let [sliding, rolling] = [system.problem.contacts.items.len(), system.problem.rolling_contacts.items.len()];
        system.contacts.push((k, ContactVisit { rolling: rolls, index: if rolls { rolling } else { sliding } - 1, lanes: active }));
        system.constrained = system.constrained.or(active);
    }
}

/// Lanes of `lanes` (bits) in which the contact in slot `k` connects the same trees as in the first of these lanes.
fn lanes_of_same_trees<R: Real>(compiled: &LaneModel<R>, contacts: &Contacts<R>, k: usize, lanes: u32) -> u32 {
    if compiled.ntree < 2 {
        return lanes;
    }
    let (mut first, mut same) = (None, 0);
    for (pair, lanes) in contacts.pairs(k, lanes) {
        let [a, b] =
            compiled.pair_geoms(pair).expect("a pair index of this compiled model").map(|g| compiled.tree_of(compiled.geoms[g].frame));
        let trees = [a.min(b), a.max(b)];
        if *first.get_or_insert(trees) == trees {
            same |= lanes;
        }
    }
    same
}
