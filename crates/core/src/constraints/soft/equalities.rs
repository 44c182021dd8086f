//! Rows of equalities with MuJoCo's contact law.

use stepper_real::{Mask, Real, kernel};

use crate::compile::{CompiledEquality, EqualityRows, SoftLaw};
use crate::constraints::equality::{angular_of_frame, moves};
use crate::constraints::rows::unbounded;
use crate::constraints::soft::assembly::{SoftAssembler, SoftInput};
use crate::math::spatial::*;

impl<R: Real> SoftAssembler<'_, R> {
    /// Adds the rows of all active equalities. All position errors of an equality share one impedance.
    #[inline(always)]
    pub(super) fn add_equalities(&mut self) {
        let state = self.input.state;
        for (k, block) in state.compiled.equalities.iter().enumerate() {
            if state.active_equalities.has_rows(k) {
                for equality in &block.equalities {
                    // Compiled separately, because few models have equalities.
                    kernel!(R, || self.add_equality(equality));
                }
            }
        }
    }

    #[inline(always)]
    fn add_equality(&mut self, equality: &CompiledEquality<R::Scalar>) {
        let input = self.input;
        let [law, rotation_law] = &input.softness.equalities[equality.index];
        self.builder.use_dofs(&equality.dofs);
        let numbers = input.state.compiled.params.equality(equality.index);
        match &equality.rows {
            EqualityRows::Points { frames, turn, .. } => {
                let turned = turn.map(|turn| (Turn::of(input, *frames, &[numbers.orientation, splat(turn)]), numbers.weight));
                let points = self.builder.connect_points(&input.state, *frames, [numbers.first, numbers.second], false);
                let mut square = dot(points.error, points.error);
                if let Some((turn, weight)) = &turned {
                    let error = scale(turn.error, *weight);
                    square += dot(error, error);
                }
                let impedance = law.impedance(square.sqrt());
                self.push_triple((equality, 0), law, impedance, [points.error, points.kappa]);
                if let Some((turn, weight)) = turned {
                    for &d in &equality.dofs {
                        let (d, mut j) = (d as usize, zero());
                        let axis = angular(&input.state.kinematics.axes[d]);
                        for side in 0..2 {
                            if moves(input.state.compiled, frames[side], d) {
                                j = if side == 0 { add(j, axis) } else { sub(j, axis) };
                            }
                        }
                        self.builder.column[d] = scale(turn.rate(j), weight);
                    }
                    let errors = [scale(turn.error, weight), scale(turn.kappa, weight)];
                    self.push_triple((equality, 3), rotation_law, impedance, errors);
                }
            }
            EqualityRows::Coupling { first, second } => {
                let rows = self.builder.couple_joints(&input.state, first, second.as_ref(), numbers.polynomial);
                let mut rate = R::zero();
                for &d in &equality.dofs {
                    rate += self.builder.column[d as usize][0] * input.state.v_free[d as usize];
                }
                let active = input.state.alive.and(input.state.active_equalities.lanes(equality));
                // MuJoCo neglects the acceleration J' v of couplings.
                let law = law.row(rows.error[0], rate, active);
                self.push_row(law, unbounded(), active, equality.impulse_index);
            }
        }
    }

    /// Appends three rows to the problem, from their position errors and their velocity-dependent accelerations J' v.
    ///
    /// Their Jacobians are in `column` on the dofs of the equality. `first` is the number of earlier rows of the equality, from which the
    /// indices of the impulses follow.
    #[inline(always)]
    fn push_triple(
        &mut self,
        (equality, first): (&CompiledEquality<R::Scalar>, usize),
        law: &SoftLaw<R::Scalar>,
        impedance: R,
        [error, kappa]: [V3<R>; 2],
    ) {
        let (state, mut rate) = (self.input.state, zero());
        let active = state.alive.and(state.active_equalities.lanes(equality));
        for &d in &equality.dofs {
            rate = add_scaled(rate, self.builder.column[d as usize], state.v_free[d as usize]);
        }
        for k in 0..3 {
            let [reference, weight] = law.row_at(impedance, error[k], rate[k], active);
            let law = [reference - kappa[k], weight];
            self.push_row(law, unbounded(), active, equality.impulse_index + first + k);
            for &d in &equality.dofs {
                let [_, b, c] = self.builder.column[d as usize];
                self.builder.column[d as usize] = [b, c, R::zero()];
            }
        }
    }
}

/// Relative orientation of the two frames of a weld. MuJoCo's error is the vector part of the quaternion q1^-1 q0, in the second frame's
/// axes.
struct Turn<R: Real> {
    /// Scalar part of the quaternion q1^-1 q0 from the second frame to the first.
    scalar: R,
    /// Vector part of the quaternion q1^-1 q0, which is the orientation error.
    error: V3<R>,
    /// Second time derivative of the orientation error if no joint accelerates, 1/s^2.
    kappa: V3<R>,
    /// Rotation matrix from the second frame to the world.
    second: M3<R>,
}

impl<R: Real> Turn<R> {
    #[inline(always)]
    fn of(input: SoftInput<'_, R>, frames: [usize; 2], mats: &[M3<R>; 2]) -> Self {
        let kinematics = input.state.kinematics;
        let first = mat_mul(&kinematics.mat[frames[0]], &mats[0]);
        let second = mat_mul(&kinematics.mat[frames[1]], &mats[1]);
        let [scalar, x, y, z] = mat_to_quat(&mat_mul_transposed(&first, &second));
        let mut turn = Self { scalar, error: rotate_back(&second, [x, y, z]), kappa: zero(), second };
        let motion = input.state.motion;
        let (a, b) = (angular_of_frame(&motion.velocity, frames[0]), angular_of_frame(&motion.velocity, frames[1]));
        let relative = sub(a, b);
        let acceleration = sub(angular_of_frame(&motion.acceleration, frames[0]), angular_of_frame(&motion.acceleration, frames[1]));
        // With w = R1^T (w0 - w1): e' = (s w + w x e) / 2 and s' = -w . e / 2.
        let w = rotate_back(&second, relative);
        let change = rotate_back(&second, sub(acceleration, cross(b, relative)));
        let half = R::of(0.5);
        let (rate, fall) = (turn.rate(relative), -(dot(w, turn.error) * half));
        let product = add(add(scale(change, scalar), cross(change, turn.error)), add(scale(w, fall), cross(w, rate)));
        turn.kappa = scale(product, half);
        turn
    }

    /// Time derivative of the orientation error, 1/s, for the relative angular velocity `relative` in world axes, rad/s.
    #[inline(always)]
    fn rate(&self, relative: V3<R>) -> V3<R> {
        let w = rotate_back(&self.second, relative);
        scale(add(scale(w, self.scalar), cross(w, self.error)), R::of(0.5))
    }
}
