//! Stage 6 of MuJoCo's integrators Euler, implicitfast and implicit, with their implicit terms.

use stepper_real::{Mask, Real, kernel};

use crate::actuation::forces::ForceState;
use crate::compile::{CompiledTendon, LaneModel, PathLengths, Spring};
use crate::constraints::soft::SoftSystem;
use crate::dynamics::implicit_weights::ImplicitWeights;
use crate::dynamics::kinematics::{Kinematics, advance, select_into};
use crate::integrators::evaluate::free_motion::{FreeMotion, Scratch};
use crate::integrators::mujoco::unsymmetric::{Unsymmetric, solve_dense};
use crate::integrators::step_input::StepInput;
use crate::math::spatial::*;
use crate::model::JointKind;
use crate::options::Integrator;
use crate::stages::s01_actuate::set_added_inertia_by_damping;

/// Computes the velocity after the step: v+ = v + h (M + h D)^-1 M a.
///
/// With Euler's rule, D is the damping of the joints. The other rules add the damping of tendons, actuators and the surrounding fluid.
/// ImplicitFast also adds the derivative of the gyroscopic force of a single body on a free joint, in a separate system. Implicit adds the
/// derivative of all Coriolis forces.
///
/// D has the sparsity of MuJoCo's matrix. Tendons and actuators contribute only entries between dofs on one branch. ImplicitFast has no
/// entries between the dofs of a simple body, because MuJoCo's mass matrix has none.
pub(super) fn integrate_velocity<R: Real>(
    input: StepInput<'_, R>,
    kinematics: &Kinematics<R>,
    free: &mut FreeMotion<R>,
    system: &mut SoftSystem<R>,
    unsymmetric: &mut Option<Unsymmetric<R>>,
    v_next: &mut [R],
) {
    let StepInput { compiled, options, state, inputs, .. } = input;
    let (all, h) = (options.integrator != Integrator::Euler, R::of(options.timestep));
    // Lanes whose joints have implicit damping. With Euler's rule, the other lanes need no solve, and get the bits of an undamped model.
    let damped = kernel!(R, || {
        let mut damped = R::Mask::splat(false);
        if !all && !compiled.explicit_damping {
            for dof in compiled.params.dofs() {
                damped = damped.or(dof[0].gt(R::zero()));
            }
        }
        damped
    });
    let (FreeMotion { smooth, actuator_forces, scratch, .. }, v) = (free, &state.v);
    let Scratch { velocity_by_impulses: work, impulse: alone, .. } = scratch;
    if !all && damped.none() {
        advance(v, &system.acceleration, h, v_next);
        return;
    }
    kernel!(R, || {
        system.multiply_mass(compiled, &smooth.mass, work);
        smooth.mass.entries.copy_from_slice(&system.mass);
        smooth.mass.add_joints(compiled, ImplicitWeights { damping: h, stiffness: R::zero(), late_step: R::zero() }, &mut []);
    });
    if all {
        let at = ForceState::state([&state.q, v, &state.act], h, &inputs.ctrl, &inputs.actuator_dynamics);
        set_added_inertia_by_damping(compiled, &at, h, actuator_forces);
        smooth.add_implicit_terms(compiled, kinematics, [&actuator_forces.added_inertia, &actuator_forces.arms], v, h);
        add_along_tendons(compiled, &kinematics.paths, h, |spring| spring.damping, &mut smooth.mass.entries);
    }
    if let Some(matrix) = unsymmetric {
        matrix.solve(compiled, kinematics, &smooth.mass.entries, v, h, work);
        advance(v, work, h, v_next);
        return;
    }
    kernel!(R, || {
        if all {
            alone.copy_from_slice(work);
            for single in compiled.single_bodies.iter().filter(|single| single.kind == JointKind::Free) {
                let mat = &kinematics.mat[single.link + 1];
                solve_alone(compiled, (kinematics, mat), [&system.mass, &smooth.mass.entries], v, h, single.dof, alone);
            }
            for dof in compiled.dofs.iter().filter(|dof| dof.is_simple) {
                let others = dof.chain + 1..dof.chain + dof.depth;
                smooth.mass.entries[others.clone()].copy_from_slice(&system.mass[others]);
            }
        }
        smooth.mass.factor(compiled);
        smooth.mass.solve(compiled, work);
        if all {
            for single in compiled.single_bodies.iter().filter(|single| single.kind == JointKind::Free) {
                let dofs = single.dof..single.dof + 6;
                work[dofs.clone()].copy_from_slice(&alone[dofs]);
            }
        }
    });
    if !all {
        select_into(work, &system.acceleration, damped.not());
    }
    advance(v, work, h, v_next);
}

/// Adds `factor` w J^T J of every tendon with a spring to the entries of the mass matrix, with the moment arms J and w = `weight`(spring).
/// Pairs of dofs without an entry in the matrix are left out, as in MuJoCo: those on different branches.
pub(super) fn add_along_tendons<R: Real>(
    compiled: &LaneModel<R>,
    paths: &PathLengths<R>,
    factor: R,
    weight: impl Fn(&Spring<R::Scalar>) -> R::Scalar,
    entries: &mut [R],
) {
    for tendon in &compiled.tendons {
        let CompiledTendon { length, spring: Some((spring, _)), .. } = tendon else { continue };
        let weight = weight(spring);
        if weight <= R::Scalar::default() {
            continue;
        }
        kernel!(R, || {
            let weight = factor * R::splat(weight);
            length.for_each_arm(
                paths,
                #[inline(always)]
                |dof, arm| {
                    let (row, chain) = (&compiled.dofs[dof], compiled.chain_of(dof));
                    length.for_each_arm(
                        paths,
                        #[inline(always)]
                        |other, other_arm| {
                            if let Some(k) = chain.iter().position(|&above| above as usize == other) {
                                entries[row.chain + k] += weight * arm * other_arm;
                            }
                        },
                    );
                },
            );
        });
    }
}

/// Solves the six equations of a single body on a free joint, including the derivative of its gyroscopic force.
///
/// The matrix is unsymmetric, so that the factors of the mass matrix cannot represent it (MuJoCo's `mjd_freeMhat`). `entries` has the
/// entries of M, then the entries of M + h D. `x` is the right side at degrees of freedom `first` to `first` + 5, and receives the
/// solution.
#[inline(always)]
fn solve_alone<R: Real>(
    compiled: &LaneModel<R>,
    (kinematics, mat): (&Kinematics<R>, &M3<R>),
    entries: [&[R]; 2],
    v: &[R],
    h: R,
    first: usize,
    x: &mut [R],
) {
    let mut a = [[R::zero(); 6]; 6];
    let mut m = [[R::zero(); 6]; 6];
    for i in 0..6 {
        let start = compiled.dofs[first + i].chain;
        for j in 0..=i {
            m[i][j] = entries[0][start + i - j];
            m[j][i] = m[i][j];
            a[i][j] = entries[1][start + i - j];
            a[j][i] = a[i][j];
        }
        m[i][i] -= compiled.params.dof(first + i).armature;
    }
    // The inertia of tendons is no part of the body.
    for tendon in &compiled.tendons {
        let CompiledTendon { length, spring: Some((spring, _)), .. } = tendon else { continue };
        let mut arms = [R::zero(); 6];
        length.for_each_arm(
            &kinematics.paths,
            #[inline(always)]
            |dof, arm| {
                if let Some(own) = dof.checked_sub(first).and_then(|i| arms.get_mut(i)) {
                    *own += arm;
                }
            },
        );
        for i in 0..6 {
            for j in 0..6 {
                m[i][j] -= R::splat(spring.inertia) * arms[i] * arms[j];
            }
        }
    }
    let omega = [v[first + 3], v[first + 4], v[first + 5]];
    let world = rotate(mat, omega);
    let column_of = |rows: usize, c: usize| [m[rows][3 + c], m[rows + 1][3 + c], m[rows + 2][3 + c]];
    let mut momentum = [zero(), zero()];
    for c in 0..3 {
        momentum = [add_scaled(momentum[0], column_of(0, c), omega[c]), add_scaled(momentum[1], column_of(3, c), omega[c])];
    }
    // The bias force is (R w) x (P w) in world axes, and w x (I w) in the body's axes.
    for c in 0..3 {
        let mut unit = zero();
        unit[c] = R::one();
        let linear = add(cross(column(mat, c), momentum[0]), cross(world, column_of(0, c)));
        let angular = add(cross(unit, momentum[1]), cross(omega, column_of(3, c)));
        for i in 0..3 {
            a[i][3 + c] += h * linear[i];
            a[3 + i][3 + c] += h * angular[i];
        }
    }
    solve_dense(a.as_flattened_mut(), &mut x[first..first + 6]);
}
