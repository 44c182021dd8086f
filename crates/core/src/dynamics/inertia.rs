//! Mass matrix and bias force: composite rigid bodies, sparse factorisation, and recursive Newton-Euler.

use stepper_real::Real;

use crate::compile::{Descendant, Dof, DofParams, LaneModel, ModelStructure};
use crate::dynamics::implicit_weights::ImplicitWeights;
use crate::dynamics::kinematics::Kinematics;
use crate::math::spatial::*;
use crate::model::JointKind;

/// Mass matrix M of all kinematic trees, and its factors M = L^T D L (Featherstone 2008, section 6.5).
///
/// Row i has entries for dof i and its ancestors, towards the root. All other entries are zero. M includes the implicit terms (added
/// inertia) that the step adds to it.
#[derive(Clone, Debug)]
pub struct MassMatrix<R: Real> {
    /// Entries of M before [`MassMatrix::factor`]; afterwards entries of L, with D on the diagonal.
    pub entries: Vec<R>,
    /// Inverse of each diagonal entry of D, in the factorisation M = L^T D L.
    pub inv_d: Vec<R>,
    /// Square root of the inverse of each diagonal entry of D, in the factorisation M = L^T D L.
    pub sqrt_inv_d: Vec<R>,
    /// Square root of each diagonal entry of D, in the factorisation M = L^T D L.
    pub sqrt_d: Vec<R>,
}

impl<R: Real> MassMatrix<R> {
    /// Allocates the mass matrix of a compiled model.
    pub fn new(compiled: &ModelStructure<R::Scalar>) -> Self {
        Self {
            entries: vec![R::zero(); compiled.merged.chain.len()],
            inv_d: vec![R::zero(); compiled.nv],
            sqrt_inv_d: vec![R::zero(); compiled.nv],
            sqrt_d: vec![R::zero(); compiled.nv],
        }
    }

    /// Assembles M by the composite rigid body algorithm, including armature.
    #[inline(always)]
    pub fn assemble(&mut self, compiled: &LaneModel<R>, kinematics: &Kinematics<R>, composite: &mut [Inertia<R>]) {
        composite.copy_from_slice(&kinematics.inertia);
        for l in (0..compiled.links.len()).rev() {
            let link = &compiled.links[l];
            if !link.is_root {
                composite[link.parent - 1] = add(composite[link.parent - 1], composite[l]);
            }
            for d in link.dofs.clone() {
                let momentum = apply_inertia(&composite[l], &kinematics.axes[d]);
                let dof = &compiled.dofs[d];
                let row = &mut self.entries[dof.chain..dof.chain + dof.depth];
                for (entry, &a) in row.iter_mut().zip(compiled.chain_of(d)) {
                    *entry = dot6(kinematics.axes[a as usize], momentum);
                }
                row[0] += compiled.params.dof(d).armature;
            }
        }
    }

    /// Adds the implicit terms of joint damping and stiffness to the diagonal of M.
    ///
    /// Writes the additional damping of springs with a damper (see [`crate::actuation::forces`]) to `spring_damping`. If this list is
    /// empty, the function leaves out the additional damping.
    #[inline(always)]
    pub fn add_joints(&mut self, compiled: &LaneModel<R>, weights: ImplicitWeights<R>, spring_damping: &mut [R]) {
        for (d, dof) in compiled.dofs.iter().enumerate() {
            let DofParams { damping, stiffness, .. } = compiled.params.dof(d);
            let entry = &mut self.entries[dof.chain];
            // Undamped dofs have a late fraction of zero. Most dofs of robots are undamped.
            let late = match weights.has_late_fraction(damping) {
                true => weights.late_fraction(damping / *entry),
                false => R::zero(),
            };
            *entry += weights.damping * (R::one() + late) * damping + weights.stiffness * stiffness;
            if let Some(spring_damping) = spring_damping.get_mut(d) {
                *spring_damping = weights.spring_damping(late, stiffness);
                *entry += weights.late_step * *spring_damping;
            }
        }
    }

    /// Adds to M, for each servo with the moment a, its added inertia times a a^T. A moment may act on several kinematic branches. If
    /// `uses_diagonal_bound` is true, the function then adds a diagonal upper bound of this matrix instead. Otherwise it leaves out entries
    /// whose two degrees of freedom are on different branches.
    #[inline(always)]
    pub fn add_servos(&mut self, compiled: &LaneModel<R>, added_inertias: &[R], arms: &[R], uses_diagonal_bound: bool) {
        for (servo, &added_inertia) in compiled.servos.iter().zip(added_inertias) {
            let entries = if servo.diagonal_bound.is_empty() || !uses_diagonal_bound { &servo.entries } else { &servo.diagonal_bound };
            for &(entry, coefficient) in entries {
                self.entries[entry] += R::splat(coefficient) * added_inertia;
            }
            if servo.diagonal_bound_arms.is_empty() || !uses_diagonal_bound {
                for &(entry, [a, b]) in &servo.products {
                    self.entries[entry] += arms[a] * arms[b] * added_inertia;
                }
            } else {
                let total = servo.diagonal_bound_arms.iter().fold(
                    R::zero(),
                    #[inline(always)]
                    |sum, &(_, arm)| sum + arms[arm].abs(),
                );
                for &(entry, arm) in &servo.diagonal_bound_arms {
                    self.entries[entry] += arms[arm].abs() * total * added_inertia;
                }
            }
        }
    }

    /// Replaces the entries of M by the entries of its factors L and D.
    ///
    /// The loop proceeds from the leaves, row by row, with up to eight columns at a time. It sums the subtractions of all rows below in
    /// registers.
    #[inline(always)]
    pub fn factor(&mut self, compiled: &LaneModel<R>) {
        let Self { entries, inv_d, .. } = self;
        for i in (0..compiled.nv).rev() {
            let (dof, below) = (&compiled.dofs[i], compiled.descendants(i));
            subtract_columns(entries, inv_d, dof, 0, below);
            for k in (8..dof.depth).step_by(8) {
                subtract_columns(entries, inv_d, dof, k, below);
            }
            let inv = R::one() / entries[dof.chain];
            let root = inv.sqrt();
            inv_d[i] = inv;
            self.sqrt_inv_d[i] = root;
            self.sqrt_d[i] = entries[dof.chain] * root;
        }
    }

    /// Row `i` of the factors, and the dofs to which its entries belong: first the diagonal entry of D, then the entries of L.
    #[inline(always)]
    pub(crate) fn row<'a>(&'a self, compiled: &'a LaneModel<R>, i: usize) -> (&'a [R], &'a [u32]) {
        let dof = &compiled.dofs[i];
        (&self.entries[dof.chain..dof.chain + dof.depth], compiled.chain_of(i))
    }

    /// Solves x <- L^-T x with the factor L of the mass matrix L^T D L.
    #[inline(always)]
    pub fn solve_lower_transposed(&self, compiled: &LaneModel<R>, x: &mut [R]) {
        let mut i = compiled.nv;
        while i > 0 {
            i -= 1;
            let ((row, chain), xi) = (self.row(compiled, i), x[i]);
            if !is_above(i, chain) {
                for (&l, &a) in row[1..].iter().zip(&chain[1..]) {
                    x[a as usize] -= l * xi;
                }
                continue;
            }
            // The parent is the previous row and has the same ancestors, so that both are computed together.
            i -= 1;
            let ((above, chain), parent) = (self.row(compiled, i), x[i] - row[1] * xi);
            x[i] = parent;
            for ((&l, &m), &a) in row[2..].iter().zip(&above[1..]).zip(&chain[1..]) {
                x[a as usize] = (x[a as usize] - l * xi) - m * parent;
            }
        }
    }

    /// Solves x <- L^-1 x with the factor L of the mass matrix L^T D L.
    #[inline(always)]
    pub fn solve_lower(&self, compiled: &LaneModel<R>, x: &mut [R]) {
        let mut i = 0;
        while i < compiled.nv {
            // The entries are summed towards the leaves. The newest value, the parent's, comes last, so that the other terms need not wait
            // for it.
            let ((row, chain), mut sum) = (self.row(compiled, i), x[i]);
            if i + 1 == compiled.nv || !is_above(i + 1, compiled.chain_of(i + 1)) {
                for (&l, &a) in row[1..].iter().zip(&chain[1..]).rev() {
                    sum -= l * x[a as usize];
                }
                x[i] = sum;
                i += 1;
                continue;
            }
            // The next row is a child and has the same ancestors, so that both are computed together.
            let ((below, _), mut child) = (self.row(compiled, i + 1), x[i + 1]);
            for ((&l, &m), &a) in row[1..].iter().zip(&below[2..]).zip(&chain[1..]).rev() {
                sum -= l * x[a as usize];
                child -= m * x[a as usize];
            }
            x[i] = sum;
            x[i + 1] = child - below[1] * sum;
            i += 2;
        }
    }

    /// Converts a scaled velocity change `w`, in coordinates in which the mass matrix is the identity, to a velocity change: w <- L^-1
    /// D^-1/2 w.
    #[inline(always)]
    pub fn unscale(&self, compiled: &LaneModel<R>, w: &mut [R]) {
        for (w, &scale) in w.iter_mut().zip(&self.sqrt_inv_d) {
            *w *= scale;
        }
        self.solve_lower(compiled, w);
    }

    /// Converts a velocity change `x` to scaled coordinates, in which the mass matrix is the identity: x <- D^1/2 L x.
    #[inline(always)]
    pub fn scale(&self, compiled: &LaneModel<R>, x: &mut [R]) {
        // From the leaves, so that ancestors are still unscaled.
        for i in (0..compiled.nv).rev() {
            let (row, chain) = self.row(compiled, i);
            let mut sum = x[i];
            for (&l, &a) in row[1..].iter().zip(&chain[1..]) {
                sum += l * x[a as usize];
            }
            x[i] = sum * self.sqrt_d[i];
        }
    }

    /// Converts a scaled velocity change `w`, in coordinates in which the mass matrix is the identity, to generalized momentum: w <- L^T
    /// D^1/2 w.
    #[inline(always)]
    pub fn momentum(&self, compiled: &LaneModel<R>, w: &mut [R]) {
        // From the root, so that descendants add to scaled entries.
        for i in 0..compiled.nv {
            let (row, chain) = self.row(compiled, i);
            let xi = w[i] * self.sqrt_d[i];
            w[i] = xi;
            for (&l, &a) in row[1..].iter().zip(&chain[1..]) {
                w[a as usize] += l * xi;
            }
        }
    }

    /// Kinetic energy v . M v / 2 at the generalized velocity `v`, J. Overwrites `scaled`.
    ///
    /// The implicit terms in M count as inertia, in contrast to [`crate::dynamics::kinematics::kinetic_energy`].
    #[inline(always)]
    pub fn kinetic_energy(&self, compiled: &LaneModel<R>, v: &[R], scaled: &mut [R]) -> R {
        scaled.copy_from_slice(v);
        self.scale(compiled, scaled);
        scaled.iter().fold(R::zero(), |sum, v| sum + v.square()) * R::of(0.5)
    }

    /// Sum of D_i speed^2 / 2 over all degrees of freedom, J. D_i is the diagonal entry of the factor D of the mass matrix.
    ///
    /// The sum estimates the kinetic energy of a motion with this speed in every degree of freedom. D_i is the inertia of the degree of
    /// freedom if its descendants move freely.
    #[inline(always)]
    pub fn energy_at(&self, speed: R) -> R {
        let mut inertia = R::zero();
        for &root in &self.sqrt_d {
            inertia += root * root;
        }
        inertia * (speed * speed * R::of(0.5))
    }

    /// Solves x <- M^-1 x.
    #[inline(always)]
    pub fn solve(&self, compiled: &LaneModel<R>, x: &mut [R]) {
        self.solve_lower_transposed(compiled, x);
        for (x, &inv) in x.iter_mut().zip(&self.inv_d) {
            *x *= inv;
        }
        self.solve_lower(compiled, x);
    }
}

/// Whether the dof before dof `i` is its parent. `chain` is the chain of dof `i`: the dof itself and its ancestors.
#[inline(always)]
pub(crate) fn is_above(i: usize, chain: &[u32]) -> bool {
    chain.len() > 1 && chain[1] as usize + 1 == i
}

/// Step of the factorisation of the mass matrix: updates up to eight entries in the row of `dof`, from column `k` on. It subtracts the
/// terms of the rows of all descendants, `below`.
#[inline(always)]
fn subtract_columns<R: Real>(entries: &mut [R], inv_d: &[R], dof: &Dof, k: usize, below: &[Descendant]) {
    match dof.depth - k {
        1 => subtract::<R, 1>(entries, inv_d, dof.chain, k, below),
        2 => subtract::<R, 2>(entries, inv_d, dof.chain, k, below),
        3 => subtract::<R, 3>(entries, inv_d, dof.chain, k, below),
        4 => subtract::<R, 4>(entries, inv_d, dof.chain, k, below),
        5 => subtract::<R, 5>(entries, inv_d, dof.chain, k, below),
        6 => subtract::<R, 6>(entries, inv_d, dof.chain, k, below),
        7 => subtract::<R, 7>(entries, inv_d, dof.chain, k, below),
        _ => subtract::<R, 8>(entries, inv_d, dof.chain, k, below),
    }
}

/// Step of the factorisation of the mass matrix: updates the entries `k..k + N` of the row that starts at the index `row`. It subtracts the
/// terms of the rows of all descendants, `below`.
///
/// The call with `k` = 0 also replaces an entry of M in each row of a descendant by the entry of the factor L.
#[inline(always)]
fn subtract<R: Real, const N: usize>(entries: &mut [R], inv_d: &[R], row: usize, k: usize, below: &[Descendant]) {
    let (mut sum, mut other) = ([R::zero(); N], [R::zero(); N]);
    sum.copy_from_slice(&entries[row + k..row + k + N]);
    for d in below {
        let at = d.entry as usize;
        other.copy_from_slice(&entries[at + k..at + k + N]);
        let share = if k == 0 { other[0] * inv_d[d.dof as usize] } else { entries[at] };
        for j in 0..N {
            sum[j] -= share * other[j];
        }
        if k == 0 {
            entries[at] = share;
        }
    }
    entries[row + k..row + k + N].copy_from_slice(&sum);
}

/// Computes Coriolis, centrifugal and gravitational forces into `out`, by recursive Newton-Euler with zero joint acceleration, in world
/// axes, without the inertia of tendons.
#[inline(always)]
pub fn bias_force<R: Real>(compiled: &LaneModel<R>, kinematics: &Kinematics<R>, v: &[R], work: &mut NewtonEuler<R>, out: &mut [R]) {
    link_forces(compiled, kinematics, v, work);
    project_forces(compiled, kinematics, &mut work.force, out);
}

/// Forward pass of [`bias_force`]: computes the velocity of every link, and the force that this motion requires if no joint accelerates.
#[inline(always)]
pub fn link_forces<R: Real>(compiled: &LaneModel<R>, kinematics: &Kinematics<R>, v: &[R], work: &mut NewtonEuler<R>) {
    // Gravity is represented as an upward acceleration of the world.
    let ground = spatial(zero(), scale(compiled.params.gravity(), -R::one()));
    for (l, link) in compiled.links.iter().enumerate() {
        let (mut motion, mut change) =
            if link.is_root { (zero(), ground) } else { (work.velocity[link.parent - 1], work.acceleration[link.parent - 1]) };
        for joint in &compiled.joints[link.joints.clone()] {
            let mut rotations = joint.v..joint.v + joint.kind.nv();
            if joint.kind == JointKind::Free {
                // The translation axes of a free joint are world axes, which do not rotate with the body.
                for d in joint.v..joint.v + 3 {
                    motion = add_scaled(motion, kinematics.axes[d], v[d]);
                }
                rotations.start += 3;
            }
            let mut own = zero();
            for d in rotations {
                own = add_scaled(own, kinematics.axes[d], v[d]);
            }
            change = add(change, cross_motion(&motion, &own));
            motion = add(motion, own);
        }
        let inertia = &kinematics.inertia[l];
        let momentum = apply_inertia(inertia, &motion);
        work.force[l] = add(apply_inertia(inertia, &change), cross_force(&motion, &momentum));
        work.velocity[l] = motion;
        work.acceleration[l] = change;
    }
}

/// Projects the forces on the links to generalized forces: out = sum over links of J^T f. Overwrites `force`.
#[inline(always)]
pub fn project_forces<R: Real>(compiled: &LaneModel<R>, kinematics: &Kinematics<R>, force: &mut [V6<R>], out: &mut [R]) {
    for l in (0..compiled.links.len()).rev() {
        let link = &compiled.links[l];
        for d in link.dofs.clone() {
            out[d] = dot6(kinematics.axes[d], force[l]);
        }
        if !link.is_root {
            force[link.parent - 1] = add(force[link.parent - 1], force[l]);
        }
    }
}

/// Workspace of the recursive Newton-Euler algorithm.
#[derive(Clone, Debug)]
pub struct NewtonEuler<R: Real> {
    /// Spatial velocity of every link at the reference point of its kinematic tree.
    pub velocity: Vec<V6<R>>,
    /// Spatial acceleration of every link at the reference point of its kinematic tree if no joint accelerates, minus gravity.
    pub acceleration: Vec<V6<R>>,
    /// Spatial force on every link at the reference point of its kinematic tree.
    pub force: Vec<V6<R>>,
}

impl<R: Real> NewtonEuler<R> {
    /// Creates the workspace for a compiled model.
    pub fn new(compiled: &ModelStructure<R::Scalar>) -> Self {
        let n = compiled.links.len();
        Self { velocity: vec![zero(); n], acceleration: vec![zero(); n], force: vec![zero(); n] }
    }

    /// Velocity (m/s), and acceleration (m/s^2) if no joint accelerates, of the point `p` of a frame, world axes. Both are zero for the
    /// world and for mocap bodies.
    #[inline(always)]
    pub(crate) fn of_point(&self, compiled: &LaneModel<R>, kinematics: &Kinematics<R>, frame: usize, p: V3<R>) -> [V3<R>; 2] {
        if frame == 0 || frame > compiled.links.len() {
            return [zero(); 2];
        }
        let l = frame - 1;
        let (motion, change) = (&self.velocity[l], &self.acceleration[l]);
        let arm = sub(p, kinematics.origin[compiled.links[l].tree]);
        // The recursion represents gravity as an upward acceleration of the world. Adding gravity removes it.
        let change = spatial(angular(change), add(linear(change), compiled.params.gravity()));
        let velocity = velocity_at(motion, arm);
        [velocity, add(velocity_at(&change, arm), cross(angular(motion), velocity))]
    }
}
