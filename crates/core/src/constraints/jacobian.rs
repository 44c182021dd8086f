//! Jacobians of rows: J^T of a row at the degrees of freedom on which it acts (`dofs`), and the half solve L^-T J^T with the factor L
//! of the mass matrix.

use stepper_real::{Mask, Real};

use crate::collision::contact_set::Contacts;
use crate::collision::surface_velocity;
use crate::compile::LaneModel;
use crate::constraints::assembler::RowState;
use crate::constraints::row_builder::RowBuilder;
use crate::dynamics::inertia::{MassMatrix, is_above};
use crate::math::spatial::*;

impl<R: Real> RowBuilder<R> {
    /// Writes the half-solved row of one degree of freedom, L^-T e, to the first component of `column`. e is the unit vector of `dof`.
    ///
    /// `dofs` becomes the chain of `dof`: the dof and its ancestors.
    #[inline(always)]
    pub(crate) fn unit_column(&mut self, compiled: &LaneModel<R>, mass: &MassMatrix<R>, dof: usize) {
        let chain = compiled.chain_of(dof);
        self.dofs.clear();
        self.dofs.extend(chain.iter().rev());
        let path = &mut self.path[..chain.len()];
        path.fill(R::zero());
        path[0] = R::one();
        let mut rest = &mut path[..];
        // Row k of L has an entry for each later degree of freedom of the chain, in the order of `path`. The loop takes two rows at a time.
        for pair in chain.chunks(2) {
            let [x, y, tail @ ..] = rest else { break };
            let ((row, _), (above, _)) = (mass.row(compiled, pair[0] as usize), mass.row(compiled, pair[1] as usize));
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

    /// Half solve: multiplies the first `N` components of `column` by L^-T on `dofs`, where L^T D L is the mass matrix. `dofs` must
    /// contain all ancestors of its degrees of freedom.
    #[inline(always)]
    pub(crate) fn half_solve<const N: usize>(&mut self, compiled: &LaneModel<R>, mass: &MassMatrix<R>) {
        let (mut rest, column) = (&self.dofs[..], &mut self.column);
        while let [before @ .., d] = rest {
            rest = before;
            let d = *d as usize;
            let ((row, chain), x) = (mass.row(compiled, d), column[d]);
            if !is_above(d, chain) {
                for (&l, &a) in row[1..].iter().zip(&chain[1..]) {
                    let target = &mut column[a as usize];
                    for k in 0..N {
                        target[k] -= x[k] * l;
                    }
                }
                continue;
            }
            // The parent is the previous degree of freedom and has the same ancestors, so that both are computed together.
            rest = &before[..before.len() - 1];
            let ((above, chain), mut parent) = (mass.row(compiled, d - 1), column[d - 1]);
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

    /// Sets `dofs` to the degrees of freedom, ascending, that move a geom of the contacts in slot `k` (one contact per lane). Degrees of
    /// freedom that eliminated equalities couple to them are included.
    ///
    /// For each degree of freedom, `signs` gets the lanes in which it moves the second geom, and the lanes in which it moves the first. The
    /// function also sets `both_move`, `flat` and `coupled`.
    #[inline(always)]
    pub(crate) fn gather_dofs(&mut self, state: &RowState<'_, R>, contacts: &Contacts<R>, k: usize, lanes: u32) {
        let compiled = state.compiled;
        self.words.fill(0);
        self.both_move = 0;
        self.flat = 0;
        for (pair, same) in contacts.pairs(k, lanes) {
            let [a, b] = compiled.pair_geoms(pair).expect("a pair index of this compiled model");
            self.flat |= if compiled.geoms[a].is_plane { same } else { 0 };
            self.both_move |= if compiled.geoms[a].frame != 0 && compiled.geoms[b].frame != 0 { same } else { 0 };
            let (first, second) = (&compiled.moved_dofs[compiled.geoms[a].frame], &compiled.moved_dofs[compiled.geoms[b].frame]);
            for (w, ((&first, &second), word)) in first.iter().zip(second).zip(&mut self.words).enumerate() {
                let old = *word;
                *word |= first | second;
                let mut bits = first | second;
                while bits != 0 {
                    let i = bits.trailing_zeros();
                    bits &= bits - 1;
                    // All ones if the degree of freedom is in the set.
                    let lanes_of = |set: u64| ((set >> i & 1) as u32).wrapping_neg();
                    let sign = &mut self.signs[64 * w + i as usize];
                    let [plus, minus] = sign.map(|bits| bits & lanes_of(old));
                    *sign = [plus | same & lanes_of(second), minus | same & lanes_of(first)];
                }
            }
        }
        // Conveyors and surfaces of mocap bodies move without degrees of freedom.
        if !compiled.surfaces.is_empty() {
            self.both_move = lanes;
        }
        self.find_coupled(state);
        self.list_dofs();
    }

    /// Sets the list `dofs` to the degrees of freedom in the bit set `words`, ascending.
    #[inline(always)]
    pub(crate) fn list_dofs(&mut self) {
        self.dofs.clear();
        for (w, &word) in self.words.iter().enumerate() {
            let mut bits = word;
            while bits != 0 {
                self.dofs.push(64 * w as u32 + bits.trailing_zeros());
                bits &= bits - 1;
            }
        }
    }

    /// Sign of degree of freedom `d` in the Jacobian of the contact. It is 1 in lanes in which `d` moves the second geom, -1 for the first
    /// geom, and 0 for both or none.
    #[inline(always)]
    pub(crate) fn sign_of(&self, d: usize) -> R {
        let [plus, minus] = self.signs[d];
        R::select(R::Mask::from_bits(plus), R::one(), R::zero()) - R::select(R::Mask::from_bits(minus), R::one(), R::zero())
    }

    /// Computes the Jacobian rows of a contact along normal and tangents into `column`.
    ///
    /// The first result is the free velocity of the second surface relative to the first along the three axes, m/s. The second result is
    /// the velocity before the step along the normal, with zeros for the tangents. Both include the motion of the surfaces themselves
    /// (conveyor belts).
    #[inline(always)]
    pub(crate) fn contact_columns(&mut self, input: &RowState<'_, R>, contacts: &Contacts<R>, k: usize, lanes: u32) -> [V3<R>; 2] {
        let RowState { compiled, kinematics, .. } = *input;
        let slot = &contacts.data[k];
        let n = slot.point.normal;
        let axes = [n, slot.tangent, cross(n, slot.tangent)];
        let surface_velocity = linear(&surface_velocity::motion(compiled, kinematics, contacts, k, lanes));
        // `map` of an array would not be inlined with the instructions of this CPU level.
        let mut free = [dot(axes[0], surface_velocity), dot(axes[1], surface_velocity), dot(axes[2], surface_velocity)];
        let mut before = free[0];
        let (mut arm, mut tree) = (zero(), usize::MAX);
        for &d in &self.dofs {
            let d = d as usize;
            if compiled.dofs[d].tree != tree {
                tree = compiled.dofs[d].tree;
                arm = sub(slot.point.pos, kinematics.origin[tree]);
            }
            let sign = self.sign_of(d);
            let motion = velocity_at(&kinematics.axes[d], arm);
            // Degrees of freedom that move the contact only in other lanes have the sign 0 here, and their entries could be -0. Adding
            // zero makes them 0, so that the bits of a lane do not depend on other lanes.
            let j =
                [dot(axes[0], motion) * sign + R::zero(), dot(axes[1], motion) * sign + R::zero(), dot(axes[2], motion) * sign + R::zero()];
            free = add_scaled(free, j, input.v_free[d]);
            before += j[0] * input.v[d];
            self.column[d] = j;
        }
        [free, [before, R::zero(), R::zero()]]
    }
}
