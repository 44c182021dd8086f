//! Mass matrix, bias force and smooth acceleration outside a step, over lanes.

use nalgebra::{DMatrix, DVector};
use stepper_real::{Real, Scalar, kernel};

use crate::actuation::forces::{ActuatorForces, ForceState, Implicit};
use crate::collision::adhesion::set_adhesive_arms;
use crate::collision::contact_set::Contacts;
use crate::compile::{LaneModel, PathLengths};
use crate::dynamics::inertia::{MassMatrix, NewtonEuler, bias_force};
use crate::dynamics::kinematics::Kinematics;
use crate::dynamics::path_lengths::add_path_bias;
use crate::integrators::inputs::Inputs;
use crate::integrators::mujoco::acceleration::add_tendon_springs;
use crate::math::spatial::*;
use crate::stages::s01_actuate::actuate;
use crate::stages::s02_smooth::Smooth;

/// Smooth dynamics (without constraints) of some environments outside a step, one environment per lane. Each workspace is allocated when it
/// is first used.
#[derive(Clone, Debug, Default)]
pub(crate) struct SmoothDynamics<R: Real> {
    inertia: Option<FullMass<R>>,
    newton_euler: Option<NewtonEuler<R>>,
    motion: Option<FreeMotion<R>>,
}

impl<R: Real> SmoothDynamics<R> {
    /// Mass matrix with armature and the inertia of tendons, (nv, nv), row-major.
    pub(crate) fn mass_matrix(&mut self, compiled: &LaneModel<R>, kinematics: &Kinematics<R>) -> &[R] {
        self.inertia.get_or_insert_with(|| FullMass::new(compiled)).assemble(compiled, kinematics)
    }

    /// Computes Coriolis, centrifugal and gravitational forces, with those of the inertia of tendons, (nv,), into `out`.
    pub(crate) fn bias_force(&mut self, compiled: &LaneModel<R>, kinematics: &Kinematics<R>, v: &[R], out: &mut [R]) {
        let work = self.newton_euler.get_or_insert_with(|| NewtonEuler::new(compiled));
        kernel!(R, || {
            bias_force(compiled, kinematics, v, work, out);
            add_path_bias(compiled, kinematics, work, out);
        });
    }

    /// Acceleration without constraints at the state [q, v, act], (nv,), in a step of `h` seconds.
    pub(crate) fn acceleration(
        &mut self,
        compiled: &LaneModel<R>,
        kinematics: &Kinematics<R>,
        [q, v, act]: [&[R]; 3],
        (inputs, contacts, h): (&Inputs<R>, Option<&Contacts<R>>, R),
    ) -> &[R] {
        let FreeMotion { smooth, actuator_forces, applied } = self.motion.get_or_insert_with(|| FreeMotion {
            smooth: Smooth::new(compiled),
            actuator_forces: ActuatorForces::new(compiled),
            applied: vec![R::zero(); compiled.nv],
        });
        smooth.factor_mass(compiled, kinematics, Implicit::none());
        smooth.apply(compiled, kinematics, [&inputs.qfrc, &inputs.xfrc], applied);
        actuator_forces.transmit(compiled, (kinematics, q), (v, R::zero()));
        if let Some(contacts) = contacts {
            set_adhesive_arms(compiled, kinematics, contacts, actuator_forces.adhesive_arms());
        }
        actuate(compiled, &ForceState::state([q, v, act], h, &inputs.ctrl, &inputs.actuator_dynamics), None, actuator_forces);
        add_tendon_springs(compiled, &kinematics.paths, q, v, &mut actuator_forces.tau);
        smooth.acceleration(compiled, kinematics, [&actuator_forces.tau, applied], v, v);
        if compiled.tendons.iter().any(|t| t.spring.as_ref().is_some_and(|(s, _)| s.inertia > <R::Scalar as Default>::default())) {
            let matrix = self.inertia.get_or_insert_with(|| FullMass::new(compiled)).assemble(compiled, kinematics);
            add_tendon_inertia(compiled, &kinematics.paths, matrix, &mut smooth.acc);
        }
        &smooth.acc
    }
}

/// Dense mass matrix that includes the inertia of tendons, with its workspace.
#[derive(Clone, Debug)]
struct FullMass<R: Real> {
    /// Sparse mass matrix, without the inertia of tendons.
    mass: MassMatrix<R>,
    /// Workspace: inertia of every link with its descendants.
    composite: Vec<Inertia<R>>,
    /// Dense mass matrix, (nv, nv), row-major.
    full: Vec<R>,
}

impl<R: Real> FullMass<R> {
    fn new(compiled: &LaneModel<R>) -> Self {
        Self {
            mass: MassMatrix::new(compiled),
            composite: vec![zero(); compiled.links.len()],
            full: vec![R::zero(); compiled.nv * compiled.nv],
        }
    }

    /// Computes the dense mass matrix, (nv, nv), row-major.
    fn assemble(&mut self, compiled: &LaneModel<R>, kinematics: &Kinematics<R>) -> &[R] {
        let Self { mass, composite, full } = self;
        kernel!(R, || {
            mass.assemble(compiled, kinematics, composite);
            full.fill(R::zero());
            for i in 0..compiled.nv {
                let dof = &compiled.dofs[i];
                for (&a, &m) in compiled.chain_of(i).iter().zip(&mass.entries[dof.chain..]) {
                    full[i * compiled.nv + a as usize] = m;
                    full[a as usize * compiled.nv + i] = m;
                }
            }
            for tendon in &compiled.tendons {
                let Some((spring, _)) = &tendon.spring else { continue };
                let (length, inertia, paths) = (&tendon.length, R::splat(spring.inertia), &kinematics.paths);
                length.for_each_arm(
                    paths,
                    #[inline(always)]
                    |i, a| {
                        length.for_each_arm(
                            paths,
                            #[inline(always)]
                            |j, b| full[i * compiled.nv + j] += inertia * a * b,
                        );
                    },
                );
            }
        });
        full
    }
}

/// Workspace for the acceleration without constraints.
#[derive(Clone, Debug)]
struct FreeMotion<R: Real> {
    smooth: Smooth<R>,
    actuator_forces: ActuatorForces<R>,
    applied: Vec<R>,
}

/// Adds the effect of tendon inertia to the acceleration. The factored mass matrix of a step excludes this inertia, because a step
/// represents it by constraint rows.
///
/// `matrix` is the dense mass matrix with tendon inertia. The function works lane by lane, because few models need it.
#[cold]
fn add_tendon_inertia<R: Real>(compiled: &LaneModel<R>, paths: &PathLengths<R>, matrix: &[R], acceleration: &mut [R]) {
    let nv = compiled.nv;
    for lane in 0..R::LANES {
        let number = |x: &R| x.lane(lane).to_f64();
        let full = DMatrix::from_row_iterator(nv, nv, matrix.iter().map(number));
        // Generalized forces, from the acceleration that they cause without tendon inertia.
        let free = DVector::from_iterator(nv, acceleration.iter().map(number));
        let mut force = &full * &free;
        for tendon in &compiled.tendons {
            let Some((spring, _)) = &tendon.spring else { continue };
            let mut along = 0.0;
            tendon.length.for_each_arm(paths, |dof, arm| along += spring.inertia.to_f64() * number(&arm) * free[dof]);
            tendon.length.for_each_arm(paths, |dof, arm| force[dof] -= number(&arm) * along);
        }
        // An unused lane may contain NaN.
        let Some(factors) = full.cholesky() else { continue };
        for (x, solved) in acceleration.iter_mut().zip(factors.solve(&force).iter()) {
            x.set_lane(lane, Scalar::from_f64(*solved));
        }
    }
}
