//! Mass matrix, bias force and smooth acceleration as people ask for them outside a step, over lanes.

use nalgebra::{DMatrix, DVector};
use stepper_real::{Real, Scalar};

use crate::actuation::forces::{ActuatorForces, ForceState, Implicit};
use crate::compile::LaneModel;
use crate::dynamics::inertia::{MassMatrix, NewtonEuler, bias_force};
use crate::dynamics::kinematics::Kinematics;
use crate::integrators::inputs::Inputs;
use crate::math::spatial::*;
use crate::stages::s01_actuate::actuate;
use crate::stages::s02_smooth::Smooth;

/// Room of what is asked of the smooth dynamics of some environments, one a lane.
#[derive(Clone, Debug)]
pub(crate) struct SmoothDynamics<R: Real> {
    mass: MassMatrix<R>,
    composite: Vec<Inertia<R>>,
    newton_euler: NewtonEuler<R>,
    smooth: Smooth<R>,
    actuator_forces: ActuatorForces<R>,
    applied: Vec<R>,
    full: Vec<R>,
}

impl<R: Real> SmoothDynamics<R> {
    /// Room for a compiled model.
    pub(crate) fn new(compiled: &LaneModel<R>) -> Self {
        Self {
            mass: MassMatrix::new(compiled),
            composite: vec![zero(); compiled.links.len()],
            newton_euler: NewtonEuler::new(compiled),
            smooth: Smooth::new(compiled),
            actuator_forces: ActuatorForces::new(compiled),
            applied: vec![R::zero(); compiled.nv],
            full: vec![R::zero(); compiled.nv * compiled.nv],
        }
    }

    /// The mass matrix, row by row, (nv, nv), armature and the inertia of tendons included.
    pub(crate) fn mass_matrix(&mut self, compiled: &LaneModel<R>, kinematics: &Kinematics<R>) -> &[R] {
        let Self { mass, composite, full, .. } = self;
        R::vectorize(
            #[inline(always)]
            || {
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
                    for &(_, i, a) in &tendon.length.terms {
                        for &(_, j, b) in &tendon.length.terms {
                            full[i * compiled.nv + j] += R::splat(spring.inertia) * R::splat(a) * R::splat(b);
                        }
                    }
                }
            },
        );
        full
    }

    /// Coriolis, centrifugal and gravitational forces, (nv,).
    pub(crate) fn bias_force(&mut self, compiled: &LaneModel<R>, kinematics: &Kinematics<R>, v: &[R], out: &mut [R]) {
        let work = &mut self.newton_euler;
        R::vectorize(
            #[inline(always)]
            || bias_force(compiled, kinematics, v, work, out),
        );
    }

    /// Acceleration without constraints at a state [q, v, act], (nv,).
    pub(crate) fn acceleration(
        &mut self,
        compiled: &LaneModel<R>,
        kinematics: &Kinematics<R>,
        [q, v, act]: [&[R]; 3],
        inputs: &Inputs<R>,
    ) -> &[R] {
        let Self { smooth, actuator_forces, applied, .. } = self;
        smooth.factor_mass(compiled, kinematics, Implicit::none());
        smooth.apply(compiled, kinematics, [&inputs.qfrc, &inputs.xfrc], applied);
        actuator_forces.transmit(compiled, kinematics, v, R::zero());
        actuate(compiled, &ForceState::state(q, v, act, &inputs.ctrl, &inputs.actuator_dynamics), None, actuator_forces);
        pull_tendons(compiled, q, v, &mut actuator_forces.tau);
        smooth.acceleration(compiled, kinematics, [&actuator_forces.tau, applied], v, v);
        if compiled.tendons.iter().any(|t| t.spring.as_ref().is_some_and(|(s, _)| s.inertia > <R::Scalar as Default>::default())) {
            self.add_tendon_inertia(compiled, kinematics);
        }
        &self.smooth.acc
    }

    /// Gives the acceleration the inertia of tendons, which the factors of the mass matrix leave to rows of the constraint problem: lane by
    /// lane, as few models have it.
    #[cold]
    fn add_tendon_inertia(&mut self, compiled: &LaneModel<R>, kinematics: &Kinematics<R>) {
        self.mass_matrix(compiled, kinematics);
        let nv = compiled.nv;
        for lane in 0..R::LANES {
            let number = |x: &R| x.lane(lane).to_f64();
            let full = DMatrix::from_row_iterator(nv, nv, self.full.iter().map(number));
            // What the joints' forces are, from the acceleration that they give without that inertia.
            let free = DVector::from_iterator(nv, self.smooth.acc.iter().map(number));
            let mut force = &full * &free;
            for tendon in &compiled.tendons {
                let Some((spring, _)) = &tendon.spring else { continue };
                let terms = || tendon.length.terms.iter().map(|&(_, dof, c)| (dof, c.to_f64()));
                let along = spring.inertia.to_f64() * terms().map(|(dof, c)| c * free[dof]).sum::<f64>();
                terms().for_each(|(dof, c)| force[dof] -= c * along);
            }
            // A lane that no environment is in may have no numbers.
            let Some(factors) = full.cholesky() else { continue };
            for (x, solved) in self.smooth.acc.iter_mut().zip(factors.solve(&force).iter()) {
                x.set_lane(lane, Scalar::from_f64(*solved));
            }
        }
    }
}

/// Adds what springs and dampers of tendons do to the forces of the joints.
fn pull_tendons<R: Real>(compiled: &LaneModel<R>, q: &[R], v: &[R], tau: &mut [R]) {
    R::vectorize(
        #[inline(always)]
        || {
            for tendon in &compiled.tendons {
                let Some((spring, [low, high])) = &tendon.spring else { continue };
                let length = tendon.length.value(q);
                let stretch = length - length.max(R::splat(*low)).min(R::splat(*high));
                let pull = R::splat(spring.stiffness) * stretch + R::splat(spring.damping) * tendon.length.rate(v);
                for &(_, dof, c) in &tendon.length.terms {
                    tau[dof] -= R::splat(c) * pull;
                }
            }
        },
    )
}
