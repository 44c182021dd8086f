//! Stage 4: contacts, equalities, limits, springs of tendons and dry friction become the constraint problem.
//!
//! Every row is carried through half a solve, y = D^-1/2 L^-T J^T, which touches only the ancestors of the bodies it joins; the Delassus
//! matrix is then Y^T Y. The bias of a row says what velocity it demands at the end of the step:
//!
//! ```text
//! apart (phi > 0):                v_n+ >= -c phi / h           it may just close (c = 1)
//! touching:                       v_n+ >= 0
//! overlapping, Baumgarte:         v_n+ >= min(beta (overlap - slop) / h, cap)
//! closed and fast, e > 0:         v_n+ >= -e v_n-              Newton's law (Moreau 1988), and no other bias
//! ```
//!
//! A contact with e > 0 that is neither closed nor about to rest has no row: to stop it at the surface would take the energy that it is to
//! bounce with.

mod equality;
mod hyperstatic;
mod tendon;
mod wide;

use stepper_real::{Mask, Real};

use self::equality::Site;
use self::wide::wide_lanes;
use crate::constraints::{Constraints, Moment};
use crate::contacts::{Contacts, Slot};
use crate::inertia::{MassMatrix, is_above};
use crate::kinematics::Kinematics;
use crate::options::{Options, Stabilization};
use crate::plan::LanePlan;
use crate::spatial::*;
use crate::surfaces;

/// How far a joint limit is looked ahead beyond what the free velocity closes, rad or m: impulses of contacts can turn a joint towards its
/// limit in the same step.
const LIMIT_SLACK: f64 = 0.01;

impl<R: Real> Constraints<R> {
    /// Builds all rows and their warm start.
    pub fn assemble(
        &mut self,
        plan: &LanePlan<R>,
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
                self.slots.clear();
                self.wide_slots.clear();
                self.constrained = R::Mask::splat(false);
                self.needs_position_solve = R::Mask::splat(false);
                self.add_frictions(plan, mass, moment);
                self.add_limits(plan, options, mass, moment);
                let site = Site { plan, options, kinematics, mass, moment };
                self.add_ball_limits(site);
                self.add_tendons(site);
                self.add_equalities(site);
                for k in 0..contacts.slots() {
                    let lanes = contacts.lanes_of(k);
                    let narrow = lanes & !wide_lanes(plan, &contacts.ids[k], lanes);
                    if narrow != 0 {
                        self.gather_support(plan, contacts, k, narrow);
                        self.add_contact(site, contacts, k, narrow);
                    }
                }
                if plan.wide {
                    for k in 0..contacts.slots() {
                        let wide = wide_lanes(plan, &contacts.ids[k], contacts.lanes_of(k));
                        if wide != 0 {
                            self.gather_support(plan, contacts, k, wide);
                            self.add_wide(site, contacts, k, wide);
                        }
                    }
                }
                self.problem.hyperstatic = hyperstatic::lanes(plan, contacts);
                self.iterate.start(&self.problem);
            },
        )
    }

    /// The velocity change that the warm start alone would make, left in `out`.
    pub fn warm_change(&self, plan: &LanePlan<R>, mass: &MassMatrix<R>, out: &mut [R]) {
        R::vectorize(
            #[inline(always)]
            || {
                out.copy_from_slice(&self.iterate.w);
                if self.iterate.moves() {
                    mass.unscale(plan, out);
                }
            },
        )
    }

    /// Takes up a change of the free velocity of the lanes `lanes` after the rows were made. `change` is used up.
    pub fn shift(&mut self, plan: &LanePlan<R>, mass: &MassMatrix<R>, change: &mut [R], lanes: R::Mask) {
        if self.problem.is_empty() {
            return;
        }
        R::vectorize(
            #[inline(always)]
            || {
                mass.scale(plan, change);
                let (scalars, contacts) = self.position_bias.split_at_mut(self.problem.scalars.len());
                for (i, position) in scalars.iter_mut().enumerate() {
                    let row = &self.problem.scalars[i];
                    let g = R::select(lanes, self.problem.scalar_velocity(row, change), row.g);
                    *position = R::select(lanes, *position + (g - row.g), *position);
                    self.problem.scalars[i].g = g;
                }
                let (contacts, wide) = contacts.split_at_mut(self.problem.contacts.len());
                for (i, position) in wide.iter_mut().enumerate() {
                    let block = &self.problem.wide[i];
                    let mut g = self.problem.wide_velocity(block, change);
                    (0..6).for_each(|k| g[k] = R::select(lanes, g[k], block.g[k]));
                    *position = R::select(lanes, *position + (g[0] - block.g[0]), *position);
                    self.problem.wide[i].g = g;
                }
                for (i, position) in contacts.iter_mut().enumerate() {
                    let block = &self.problem.contacts[i];
                    let g = select(lanes, self.problem.contact_velocity(block, change), block.g);
                    *position = R::select(lanes, *position + (g[0] - block.g[0]), *position);
                    self.problem.contacts[i].g = g;
                }
            },
        )
    }

    /// Dry friction: |lambda| <= h f, and what drive trains lose, which depends on the direction.
    #[inline(always)]
    fn add_frictions(&mut self, plan: &LanePlan<R>, mass: &MassMatrix<R>, moment: &Moment<'_, R>) {
        for (i, friction) in plan.frictions.iter().enumerate() {
            let most = plan.params.friction(i) * moment.h;
            let mut bounds = [-most, most];
            if friction.driven {
                let [forwards, backwards] = moment.losses[i];
                bounds = [bounds[0] - forwards * moment.h, bounds[1] + backwards * moment.h];
            }
            let g = moment.v_free[friction.dof];
            self.position_bias.push(g);
            self.add_scalar(plan, mass, friction.dof, plan.limits.len() + i, R::one(), moment.alive, g, bounds);
        }
    }

    /// Limits: the nearer end of each range, where it can be reached within the step.
    #[inline(always)]
    fn add_limits(&mut self, plan: &LanePlan<R>, options: &Options, mass: &MassMatrix<R>, moment: &Moment<'_, R>) {
        let bounds = [R::zero(), R::of(f64::INFINITY)];
        for (i, limit) in plan.limits.iter().enumerate() {
            let q = moment.q[limit.q];
            let [lowest, highest] = plan.params.limit(i);
            let (below, above) = (q - lowest, highest - q);
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
        plan: &LanePlan<R>,
        mass: &MassMatrix<R>,
        dof: usize,
        owner: usize,
        sign: R,
        active: R::Mask,
        g: R,
        bounds: [R; 2],
    ) {
        self.unit_column(plan, mass, dof);
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

    /// L^-T times a unit vector, left in the first component of `column` on `support`, the chain of `dof`.
    #[inline(always)]
    fn unit_column(&mut self, plan: &LanePlan<R>, mass: &MassMatrix<R>, dof: usize) {
        let chain = plan.chain_of(dof);
        self.support.clear();
        self.support.extend(chain.iter().rev());
        let path = &mut self.path[..chain.len()];
        path.fill(R::zero());
        path[0] = R::one();
        let mut rest = &mut path[..];
        // Row k of the chain has the entries of all that follow it, so that those of two rows meet one after the other without an index.
        for pair in chain.chunks(2) {
            let [x, y, tail @ ..] = rest else { break };
            let ((row, _), (above, _)) = (mass.row(plan, pair[0] as usize), mass.row(plan, pair[1] as usize));
            *y -= row[1] * *x;
            for ((target, &l), &m) in tail.iter_mut().zip(&row[2..]).zip(&above[1..]) {
                *target = (*target - l * *x) - m * *y;
            }
            rest = tail;
        }
        for (&a, &x) in chain.iter().zip(&self.path) {
            self.column[a as usize][0] = x;
        }
    }

    /// `column` <- L^-T `column`, on `support` with all its ancestors, in the first `N` components.
    #[inline(always)]
    fn half_solve<const N: usize>(&mut self, plan: &LanePlan<R>, mass: &MassMatrix<R>) {
        let (mut rest, column) = (&self.support[..], &mut self.column);
        while let [before @ .., d] = rest {
            rest = before;
            let d = *d as usize;
            let ((row, chain), x) = (mass.row(plan, d), column[d]);
            if !is_above(d, chain) {
                for (&l, &a) in row[1..].iter().zip(&chain[1..]) {
                    let target = &mut column[a as usize];
                    for k in 0..N {
                        target[k] -= x[k] * l;
                    }
                }
                continue;
            }
            // The parent is the dof before and has the same ancestors: both at once.
            rest = &before[..before.len() - 1];
            let ((above, chain), mut parent) = (mass.row(plan, d - 1), column[d - 1]);
            for k in 0..N {
                parent[k] -= x[k] * row[1];
            }
            column[d - 1] = parent;
            for ((&l, &m), &a) in row[2..].iter().zip(&above[1..]).zip(&chain[1..]) {
                let target = &mut column[a as usize];
                for k in 0..N {
                    target[k] = (target[k] - x[k] * l) - parent[k] * m;
                }
            }
        }
    }

    /// The dofs that move slot k in any of its lanes, ascending, and in which lanes each moves the second and the first geom.
    #[inline(always)]
    fn gather_support(&mut self, plan: &LanePlan<R>, contacts: &Contacts<R>, k: usize, lanes: u32) {
        let ids = &contacts.ids[k];
        self.words.fill(0);
        let mut rest = lanes;
        while rest != 0 {
            // All lanes of one pair at once: there are fewer pairs than lanes.
            let pair = ids[rest.trailing_zeros() as usize].pair();
            let mut same = 0;
            for (l, id) in ids[..R::LANES].iter().enumerate() {
                same |= u32::from(id.pair() == pair) << l;
            }
            same &= rest;
            rest &= !same;
            let [a, b] = plan.pair_geoms(pair).expect("made from this plan");
            let (first, second) = (&plan.movers[plan.geoms[a].frame], &plan.movers[plan.geoms[b].frame]);
            for (w, ((&first, &second), word)) in first.iter().zip(second).zip(&mut self.words).enumerate() {
                let old = *word;
                *word |= first | second;
                let mut bits = first | second;
                while bits != 0 {
                    let i = bits.trailing_zeros();
                    bits &= bits - 1;
                    // All ones where the dof is in the set.
                    let lanes_of = |set: u64| ((set >> i & 1) as u32).wrapping_neg();
                    let sign = &mut self.signs[64 * w + i as usize];
                    let [plus, minus] = sign.map(|bits| bits & lanes_of(old));
                    *sign = [plus | same & lanes_of(second), minus | same & lanes_of(first)];
                }
            }
        }
        self.support.clear();
        for (w, &word) in self.words.iter().enumerate() {
            let mut bits = word;
            while bits != 0 {
                self.support.push(64 * w as u32 + bits.trailing_zeros());
                bits &= bits - 1;
            }
        }
    }

    /// 1 in the lanes in which a dof moves the second geom of the gathered slot, -1 where it moves the first.
    #[inline(always)]
    fn sign_of(&self, d: usize) -> R {
        let [plus, minus] = self.signs[d];
        R::select(R::Mask::from_bits(plus), R::one(), R::zero()) - R::select(R::Mask::from_bits(minus), R::one(), R::zero())
    }

    /// J of a contact's rows (n, t1, t2), left in `column`; returns its velocities, free and before the step. `surface` is the velocity that
    /// the surfaces have of themselves, the second's against the first's.
    #[inline(always)]
    fn contact_columns(&mut self, site: Site<'_, R>, contacts: &Contacts<R>, k: usize, lanes: u32) -> [V3<R>; 2] {
        let Site { plan, kinematics, moment, .. } = site;
        let slot = &contacts.data[k];
        let n = slot.point.normal;
        let axes = [n, slot.tangent, cross(n, slot.tangent)];
        let carried = linear(&surfaces::motion(plan, kinematics, contacts, k, lanes));
        // Not `map`: what the library's function inlines, it inlines with baseline instructions.
        let mut free = [dot(axes[0], carried), dot(axes[1], carried), dot(axes[2], carried)];
        let mut before = free[0];
        let (mut arm, mut tree) = (zero(), usize::MAX);
        for &d in &self.support {
            let d = d as usize;
            if plan.dofs[d].tree != tree {
                tree = plan.dofs[d].tree;
                arm = sub(slot.point.pos, kinematics.origin[tree]);
            }
            let sign = self.sign_of(d);
            let motion = velocity_at(&kinematics.axes[d], arm);
            // Adding zero turns -0 into 0, so that a lane's bits do not depend on what its neighbours touch.
            let j =
                [dot(axes[0], motion) * sign + R::zero(), dot(axes[1], motion) * sign + R::zero(), dot(axes[2], motion) * sign + R::zero()];
            free = add_scaled(free, j, moment.v_free[d]);
            before += j[0] * moment.v[d];
            self.column[d] = j;
        }
        [free, [before, R::zero(), R::zero()]]
    }

    /// Adds slot `k` in the lanes `lanes`, in which it has sliding friction at the most; `support` is gathered.
    #[inline(always)]
    fn add_contact(&mut self, site: Site<'_, R>, contacts: &Contacts<R>, k: usize, lanes: u32) {
        let Site { plan, options, mass, moment, .. } = site;
        let (slot, active) = (&contacts.data[k], R::Mask::from_bits(lanes));
        let [free, before] = self.contact_columns(site, contacts, k, lanes);
        self.half_solve::<3>(plan, mass);
        let (bias, position) = self.biases(options, moment.gap(slot.point.distance), moment.h, active);
        let (normal, active) = self.bounce(plan, options, slot, moment, active, [free[0], before[0]], bias);
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
        self.slots.push((k, R::Mask::from_bits(lanes)));
        self.constrained = self.constrained.or(active);
    }

    /// g of a normal row, and the lanes that have the row: its free velocity with the bias, or with Newton's law where the contact bounces.
    ///
    /// All closed contacts share an impact: 0 <= lambda, complementary to v+ + e v- >= 0, also where v- parts. With e = 1 the work of the
    /// impulses, lambda (v+ + v-) / 2, is then zero contact by contact, so that energy is conserved however many strike at once. The law is
    /// taken between the velocities before and after the step by the midpoint rule, which conserves energy with it, and on the free
    /// velocity by Euler's, which is the textbook's recursion. A contact slower than the threshold before the step rests: it does not bounce
    /// from the velocity that gravity gives it within the step.
    #[inline(always)]
    #[expect(clippy::too_many_arguments, reason = "one contact, every part of it named at the call")]
    fn bounce(
        &mut self,
        plan: &LanePlan<R>,
        options: &Options,
        slot: &Slot<R>,
        moment: &Moment<'_, R>,
        active: R::Mask,
        [free, before]: [R; 2],
        bias: R,
    ) -> (R, R::Mask) {
        let e = slot.restitution;
        let elastic = active.and(e.gt(R::zero()));
        if elastic.none() {
            return (free + bias, active);
        }
        let (h, phi, threshold) = (moment.h, slot.point.distance, R::of(options.restitution_threshold));
        let euler = !options.integrator.in_the_middle();
        let approach = if euler { free } else { before };
        // What a slow contact and gravity close within the step.
        let near = phi.le(h * (threshold + h * norm(plan.params.gravity())) + R::of(options.slop));
        let rests = before.abs().le(threshold).and(near);
        let closed = phi.le(R::of(options.slop)).or((phi + h * free).lt(R::zero()));
        let bounces = elastic.and(closed).and(approach.abs().gt(threshold)).and_not(rests);
        if euler {
            self.needs_position_solve = self.needs_position_solve.or(bounces);
        }
        let stays = active.and_not(elastic).or(bounces).or(elastic.and(rests));
        (free + R::select(bounces, e * approach, bias), stays)
    }
}
