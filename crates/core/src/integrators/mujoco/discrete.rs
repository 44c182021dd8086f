//! Stages 1, 2 and 6 of `discrete`: springs, dampers, servos and drag at the end of the step, in the matrix of the constraint solve.
//!
//! ```text
//! (M + h D + h^2 K) a = f(q, v) - h K v + J^T f_c,    v+ = v + h a,    q+ = q (+) h v+
//! ```
//!
//! D is the damping and K the stiffness of joints, tendons, actuators and drag (MuJoCo's documentation, computation chapter,
//! "Integrators"). Only terms that dissipate energy or restore the configuration are included. For a single body on a free joint without
//! contacts, the matrix also contains the derivative of its gyroscopic force.

use stepper_real::{Mask, Real, kernel};

use crate::constraints::soft::{EffectiveMass, SoftSystem};
use crate::dynamics::implicit_weights::ImplicitWeights;
use crate::dynamics::kinematics::{Kinematics, advance};
use crate::integrators::evaluate::free_motion::FreeMotion;
use crate::integrators::mujoco::implicit::solve_alone;
use crate::integrators::mujoco::workspace::StageState;
use crate::integrators::step_input::StepInput;
use crate::model::JointKind;
use crate::stages::s01_actuate::servo_stiffness_and_damping;

/// Computes the effective mass matrix of the step from the mass matrix, and adds the forces -h K v to the applied forces. Actuator forces
/// must be computed before.
pub(super) fn assemble_effective_mass<R: Real>(
    input: StepInput<'_, R>,
    stage: &StageState<R>,
    kinematics: &Kinematics<R>,
    free: &mut FreeMotion<R>,
    system: &mut SoftSystem<R>,
    effective: &mut Option<EffectiveMass<R>>,
) {
    let StepInput { compiled, options, inputs, .. } = input;
    let (Some(effective), h, v) = (effective, R::of(options.timestep), &stage.v) else { unreachable!("made for this integrator") };
    let (smooth, forces, applied) = (&mut free.smooth, &mut free.actuator_forces, &mut free.applied);
    kernel!(R, || {
        effective.begin(compiled, &smooth.mass.entries, h);
        smooth.mass.add_joints(compiled, ImplicitWeights { damping: h, stiffness: h * h, late_step: R::zero() }, &mut []);
        let entries = &mut smooth.mass.entries;
        for (d, (applied, &v)) in applied.iter_mut().zip(v).enumerate() {
            *applied -= h * compiled.params.dof(d).stiffness * v;
        }
        for tendon in &compiled.tendons {
            let Some((spring, rest)) = &tendon.spring else { continue };
            let paths = &kinematics.paths;
            let length = tendon.length.value(&stage.q, paths);
            let taut = length.lt(R::splat(rest[0])).or(length.gt(R::splat(rest[1])));
            let stiffness = R::select(taut, R::splat(spring.stiffness), R::zero());
            let push = h * stiffness * tendon.length.rate(v, paths);
            for (dof, arm) in tendon.length.arms(paths) {
                applied[dof] -= push * arm;
            }
            effective.add(compiled, tendon.length.arms(paths), h * (R::splat(spring.damping) + h * stiffness), entries);
        }
        let at = stage.forces(inputs, h);
        for (k, servo) in compiled.servos.iter().enumerate() {
            let actuator = &compiled.actuators[servo.actuator];
            let [stiffness, damping] = servo_stiffness_and_damping(compiled, &at, servo.actuator, forces);
            let push = h * stiffness * forces.project(actuator, v);
            let on_site =
                actuator.variable_moment.iter().flat_map(|w| w.dofs.iter().zip(&forces.arms[w.arms..]).map(|(&(dof, _), &arm)| (dof, arm)));
            let parts = || actuator.moment.iter().map(|&(_, dof, arm)| (dof, R::splat(arm))).chain(on_site.clone());
            for (dof, arm) in parts() {
                applied[dof] -= push * arm;
            }
            forces.added_inertia[k] = h * (damping + h * stiffness);
            effective.add(compiled, parts(), forces.added_inertia[k], entries);
        }
    });
    smooth.add_implicit_terms(compiled, kinematics, [&[], &[]], v, h);
    kernel!(R, || {
        effective.finish(compiled, &smooth.mass.entries);
        system.mass.copy_from_slice(&smooth.mass.entries);
        smooth.mass.factor(compiled);
    });
}

/// Computes the velocity after the step by the discrete rule (stage 6), v+ = v + h a, into `v_next`.
pub(super) fn integrate_velocity<R: Real>(
    input: StepInput<'_, R>,
    kinematics: &Kinematics<R>,
    free: &mut FreeMotion<R>,
    system: &mut SoftSystem<R>,
    effective: Option<&EffectiveMass<R>>,
    v_next: &mut [R],
) {
    let StepInput { compiled, options, state, .. } = input;
    let h = R::of(options.timestep);
    if let Some(effective) = effective {
        for single in compiled.single_bodies.iter().filter(|single| single.kind == JointKind::Free) {
            let dofs = single.dof..single.dof + 6;
            let touched = system.problem.touches(dofs.start as u32..dofs.end as u32);
            let (acceleration, mat) = (&free.smooth.acc, &kinematics.mat[single.link + 1]);
            let work = &mut free.scratch.impulse;
            kernel!(R, || {
                // Forces that the acceleration without constraints contains.
                for i in 0..6 {
                    let mut sum = R::zero();
                    for j in 0..6 {
                        let (row, column) = (single.dof + i.max(j), i.abs_diff(j));
                        sum += system.mass[compiled.dofs[row].chain + column] * acceleration[single.dof + j];
                    }
                    work[single.dof + i] = sum;
                }
                solve_alone(compiled, (kinematics, mat), [&effective.mass, &system.mass], &state.v, h, single.dof, work);
                for d in dofs {
                    system.acceleration[d] = R::select(touched, system.acceleration[d], work[d]);
                }
            });
        }
    }
    advance(&state.v, &system.acceleration, h, v_next);
}
