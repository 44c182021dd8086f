//! Stage 4: contacts, limits and dry friction become the constraint problem.
//!
//! Every row is carried through half a solve, y = D^-1/2 L^-T J^T, which touches only the ancestors of the bodies it joins; the Delassus
//! matrix is then Y^T Y. The bias of a row says what velocity it demands at the end of the step:
//!
//! ```text
//! apart (phi > 0):                v_n+ >= -phi / h             it may just close
//! touching:                       v_n+ >= 0
//! overlapping, Baumgarte:         v_n+ >= min(beta (overlap - slop) / h, cap)
//! bouncing:                       v_n+ >= -e v_n-              Newton's law, and no other bias
//! ```

use stepper_real::{Mask, Real};

use crate::constraints::{Constraints, Moment};
use crate::contacts::{Contacts, Slot};
use crate::inertia::MassMatrix;
use crate::kinematics::Kinematics;
use crate::options::{Integrator, Options, Stabilization};
use crate::plan::Plan;
use crate::spatial::*;

/// How far a joint limit is looked ahead beyond what the free velocity closes, rad or m: impulses of contacts can turn a joint towards its
/// limit in the same step.
const LIMIT_SLACK: f64 = 0.01;

impl<R: Real> Constraints<R> {
    /// Builds all rows and their warm start.
    pub fn assemble(
        &mut self,
        plan: &Plan<R::Scalar>,
        options: &Options,
        kinematics: &Kinematics<R>,
        mass: &MassMatrix<R>,
        moment: &Moment<'_, R>,
        contacts: &mut Contacts<R>,
    ) {
        R::vectorize(
            #[inline(always)]
            || {
                self.problem.clear();
                self.iterate.clear();
                self.owners.clear();
                self.position_bias.clear();
                self.constrained = R::Mask::splat(false);
                self.needs_position_solve = R::Mask::splat(false);
                self.add_frictions(plan, mass, moment);
                self.add_limits(plan, options, mass, moment);
                for k in 0..contacts.slots() {
                    let lanes = contacts.lanes_of(k);
                    self.gather_support(plan, contacts, k, lanes);
                    self.add_contact(plan, options, kinematics, mass, moment, &contacts.data[k], lanes);
                }
                self.iterate.start(&self.problem);
            },
        )
    }

    /// The velocity change that the warm start alone would make, left in `out`.
    pub fn warm_change(&self, plan: &Plan<R::Scalar>, mass: &MassMatrix<R>, out: &mut [R]) {
        R::vectorize(
            #[inline(always)]
            || {
                out.copy_from_slice(&self.iterate.w);
                mass.unscale(plan, out);
            },
        )
    }

    /// Takes up a change of the free velocity after the rows were made. `change` is used up.
    pub fn shift(&mut self, plan: &Plan<R::Scalar>, mass: &MassMatrix<R>, change: &mut [R]) {
        R::vectorize(
            #[inline(always)]
            || {
                mass.scale(plan, change);
                let (scalars, contacts) = self.position_bias.split_at_mut(self.problem.scalars.len());
                for (i, position) in scalars.iter_mut().enumerate() {
                    let row = &self.problem.scalars[i];
                    let g = self.problem.scalar_velocity(row, change);
                    *position += g - row.g;
                    self.problem.scalars[i].g = g;
                }
                for (i, position) in contacts.iter_mut().enumerate() {
                    let block = &self.problem.contacts[i];
                    let g = self.problem.contact_velocity(block, change);
                    *position += g[0] - block.g[0];
                    self.problem.contacts[i].g = g;
                }
            },
        )
    }

    /// Dry friction: |lambda| <= h f.
    #[inline(always)]
    fn add_frictions(&mut self, plan: &Plan<R::Scalar>, mass: &MassMatrix<R>, moment: &Moment<'_, R>) {
        for (i, friction) in plan.frictions.iter().enumerate() {
            let most = R::splat(friction.loss) * moment.h;
            let g = moment.v_free[friction.dof];
            self.position_bias.push(g);
            self.add_scalar(plan, mass, friction.dof, plan.limits.len() + i, R::one(), moment.alive, g, [-most, most]);
        }
    }

    /// Limits: the nearer end of each range, where it can be reached within the step.
    #[inline(always)]
    fn add_limits(&mut self, plan: &Plan<R::Scalar>, options: &Options, mass: &MassMatrix<R>, moment: &Moment<'_, R>) {
        let bounds = [R::zero(), R::of(f64::INFINITY)];
        for (i, limit) in plan.limits.iter().enumerate() {
            let q = moment.q[limit.q];
            let (below, above) = (q - R::splat(limit.low), R::splat(limit.high) - q);
            let low = below.le(above);
            let sign = R::select(low, R::one(), -R::one());
            let phi = R::select(low, below, above);
            let v = moment.v_free[limit.dof] * sign;
            let closing = (-v).max(R::zero()) * (moment.h + moment.h);
            let active = moment.alive.and(phi.le(closing + R::of(LIMIT_SLACK)));
            if active.none() {
                self.scalar_impulse[i] = R::zero();
                continue;
            }
            let (bias, position) = self.biases(options, phi, moment.h, active);
            self.position_bias.push(v + position);
            self.add_scalar(plan, mass, limit.dof, i, sign, active, v + bias, bounds);
        }
    }

    /// The bias of a row at distance `phi`: in the velocities, and when positions are solved apart.
    #[inline(always)]
    fn biases(&mut self, options: &Options, phi: R, h: R, active: R::Mask) -> (R, R) {
        let apart = phi.ge(R::zero());
        let overlap = (-phi - R::of(options.slop)).max(R::zero());
        let correction = (overlap * R::of(options.baumgarte) / h).min(R::of(options.max_correction_speed));
        let position = R::select(apart, phi / h, -correction);
        let velocity = match options.stabilization {
            Stabilization::Baumgarte => position,
            Stabilization::Split | Stabilization::None => R::select(apart, phi / h, R::zero()),
        };
        if options.stabilization == Stabilization::Split {
            let corrected = active.and(overlap.gt(R::zero()));
            self.needs_position_solve = self.needs_position_solve.or(corrected);
        }
        let position = if options.stabilization == Stabilization::None { velocity } else { position };
        (velocity, position)
    }

    #[inline(always)]
    #[expect(clippy::too_many_arguments, reason = "one row, every part of it named at the call")]
    fn add_scalar(
        &mut self,
        plan: &Plan<R::Scalar>,
        mass: &MassMatrix<R>,
        dof: usize,
        owner: usize,
        sign: R,
        active: R::Mask,
        g: R,
        bounds: [R; 2],
    ) {
        self.support.clear();
        for &d in plan.chain_of(dof).iter().rev() {
            self.support.push(d);
            self.column[d as usize][0] = R::zero();
        }
        self.column[dof][0] = R::one();
        for &d in plan.chain_of(dof) {
            let d = d as usize;
            let row = &plan.dofs[d];
            let x = self.column[d][0];
            for (&l, &a) in mass.entries[row.chain..row.chain + row.depth].iter().zip(plan.chain_of(d)).skip(1) {
                self.column[a as usize][0] -= l * x;
            }
        }
        let column = &self.column;
        self.problem.push_scalar(
            &self.support,
            #[inline(always)]
            |d| column[d][0] * mass.sqrt_inv_d[d],
            sign,
            active,
            g,
            bounds,
        );
        self.iterate.scalars.push(R::select(active, self.scalar_impulse[owner], R::zero()));
        self.owners.push(owner);
        self.constrained = self.constrained.or(active);
    }

    /// The dofs that move slot k in any of its lanes, ascending, and in which lanes each moves the second and the first geom.
    #[inline(always)]
    fn gather_support(&mut self, plan: &Plan<R::Scalar>, contacts: &Contacts<R>, k: usize, lanes: u32) {
        self.words.fill(0);
        let frames = |l: usize| plan.pairs[contacts.ids[k][l].pair()].geoms.map(|g| plan.geoms[g].frame);
        let mut rest = lanes;
        while rest != 0 {
            let [a, b] = frames(rest.trailing_zeros() as usize);
            rest &= rest - 1;
            for (w, word) in self.words.iter_mut().enumerate() {
                *word |= plan.movers[a][w] | plan.movers[b][w];
            }
        }
        self.support.clear();
        for (w, &word) in self.words.iter().enumerate() {
            let mut bits = word;
            while bits != 0 {
                let d = 64 * w as u32 + bits.trailing_zeros();
                bits &= bits - 1;
                self.support.push(d);
                self.plus[d as usize] = 0;
                self.minus[d as usize] = 0;
            }
        }
        let mut rest = lanes;
        while rest != 0 {
            let l = rest.trailing_zeros();
            rest &= rest - 1;
            let [a, b] = frames(l as usize);
            mark(&plan.movers[b], 1 << l, &mut self.plus);
            mark(&plan.movers[a], 1 << l, &mut self.minus);
        }
    }

    #[inline(always)]
    #[expect(clippy::too_many_arguments, reason = "one contact, every part of it named at the call")]
    fn add_contact(
        &mut self,
        plan: &Plan<R::Scalar>,
        options: &Options,
        kinematics: &Kinematics<R>,
        mass: &MassMatrix<R>,
        moment: &Moment<'_, R>,
        slot: &Slot<R>,
        lanes: u32,
    ) {
        let active = R::Mask::from_bits(lanes);
        let n = slot.point.normal;
        let axes = [n, slot.tangent, cross(n, slot.tangent)];
        let (mut free, mut before) = ([R::zero(); 3], R::zero());
        let (mut arm, mut tree) = (zero(), usize::MAX);
        for &d in &self.support {
            let d = d as usize;
            if plan.dofs[d].tree != tree {
                tree = plan.dofs[d].tree;
                arm = sub(slot.point.pos, kinematics.origin[tree]);
            }
            let sign = R::select(R::Mask::from_bits(self.plus[d]), R::one(), R::zero())
                - R::select(R::Mask::from_bits(self.minus[d]), R::one(), R::zero());
            let motion = velocity_at(&kinematics.axes[d], arm);
            // Adding zero turns -0 into 0, so that a lane's bits do not depend on what its neighbours touch.
            let j =
                [dot(axes[0], motion) * sign + R::zero(), dot(axes[1], motion) * sign + R::zero(), dot(axes[2], motion) * sign + R::zero()];
            free = add_scaled(free, j, moment.v_free[d]);
            before += j[0] * moment.v[d];
            self.column[d] = j;
        }
        for &d in self.support.iter().rev() {
            let d = d as usize;
            let row = &plan.dofs[d];
            let x = self.column[d];
            for (&l, &a) in mass.entries[row.chain..row.chain + row.depth].iter().zip(plan.chain_of(d)).skip(1) {
                let target = &mut self.column[a as usize];
                *target = sub(*target, scale(x, l));
            }
        }
        let (bias, position) = self.biases(options, slot.point.distance, moment.h, active);
        let normal = self.bounce(options, slot, moment, active, [free[0], before], bias);
        let column = &self.column;
        self.problem.push_contact(
            &self.support,
            #[inline(always)]
            |d| scale(column[d], mass.sqrt_inv_d[d]),
            active,
            slot.mu,
            [normal, free[1], free[2]],
        );
        self.position_bias.push(free[0] + position);
        self.iterate.contacts.push(select(active, slot.impulse, zero()));
        self.constrained = self.constrained.or(active);
    }

    /// g of a normal row: its free velocity with the bias, or with Newton's law where the contact bounces.
    ///
    /// The law is taken between the velocities before and after the step by the midpoint rule, which then conserves energy, and on the
    /// free velocity by Euler's, which is the textbook's recursion. A contact that rests (touching, and slower than the threshold before
    /// the step) does not bounce from the velocity that gravity gave it within the step.
    #[inline(always)]
    fn bounce(&mut self, options: &Options, slot: &Slot<R>, moment: &Moment<'_, R>, active: R::Mask, velocity: [R; 2], bias: R) -> R {
        let [free, before] = velocity;
        let e = slot.restitution;
        if active.and(e.gt(R::zero())).none() {
            return free + bias;
        }
        let threshold = R::of(options.restitution_threshold);
        let euler = options.integrator == Integrator::Euler;
        let approach = if euler { free } else { before };
        let phi = slot.point.distance;
        let hits = (phi + moment.h * free).lt(R::zero()).and((-approach).gt(threshold));
        let rests = before.abs().le(threshold).and(phi.le(R::of(options.slop)));
        let bounces = active.and(hits).and(e.gt(R::zero())).and_not(rests);
        if euler {
            self.needs_position_solve = self.needs_position_solve.or(bounces);
        }
        free + R::select(bounces, e * approach, bias)
    }
}

/// Sets `bit` in the entries named by a bit set.
#[inline(always)]
fn mark(set: &[u64], bit: u32, out: &mut [u32]) {
    for (w, &word) in set.iter().enumerate() {
        let mut bits = word;
        while bits != 0 {
            out[64 * w + bits.trailing_zeros() as usize] |= bit;
            bits &= bits - 1;
        }
    }
}
