//! One step of a group of environments, stage by stage.

use stepper_real::Real;

use crate::compile::LaneModel;
use crate::integrators::acceptance::accept;
use crate::integrators::devices::Devices;
use crate::integrators::evaluation::{assemble_rows, evaluate};
use crate::integrators::mujoco;
use crate::integrators::observation::{observe, pass_controls};
use crate::integrators::scheme;
use crate::integrators::solution::{Solution, correct_positions, guard_energy, integrate_positions, record, solve_velocities};
use crate::integrators::workspace::Workspace;
use crate::options::{ContactLaw, StepSettings};
use crate::probe::{Counter, Probe, Span};
use crate::stages::s10_record::Record;

/// Advances a group of environments by `options.timestep` seconds: state and inputs to next state, observation and record.
///
/// Each stage is a kernel, compiled once for every lane type and CPU level. The code between the stages is compiled into this kernel,
/// because lane masks are vectors too. Outside a kernel every operation on them is a function call.
pub fn step<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    s: &mut Workspace<R>,
    devices: &mut Devices<'_, R::Scalar>,
    probe: impl Probe,
) -> Record<R> {
    R::vectorize(
        #[inline(always)]
        || run_stages(compiled, options, s, devices, probe),
    )
}

/// Runs stages 1 to 10, and accepts the next state before stage 9.
#[inline(always)]
fn run_stages<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    s: &mut Workspace<R>,
    devices: &mut Devices<'_, R::Scalar>,
    probe: impl Probe,
) -> Record<R> {
    probe.count(Counter::GroupSteps, || 1.0);
    if options.poison {
        s.poison();
    }
    s.poses.begin();
    // 1 actuate: controls pass through the actuators' pipelines.
    probe.span(Span::ActuatorPipelines, || pass_controls(compiled, options, s, devices));
    let (solution, tunnelled) = match options.contact {
        ContactLaw::Hard => solve_step(compiled, options, s, probe),
        // Stages 1 to 7 with MuJoCo's contact law. It needs no stage 8, because remaining depth and loop errors are its softness.
        ContactLaw::Mujoco => mujoco::solve_step(compiled, options, s, probe),
    };
    let finite = probe.span(Span::Accept, || accept(compiled, s, options.timestep));
    // 9 sense
    probe.span(Span::Sense, || observe(compiled, options, s, devices));
    // 10 record
    let record = probe.span(Span::Record, || record(compiled, options, s, &solution, [finite, tunnelled]));
    s.constraints.remove_deferred(&mut s.state.contacts);
    record
}

/// Stages 1 to 8 with hard contact. Returns the solution and the lanes in which a geom may have passed through a thin one.
#[inline(always)]
fn solve_step<R: Real>(compiled: &LaneModel<R>, options: &StepSettings, s: &mut Workspace<R>, probe: impl Probe) -> (Solution<R>, R::Mask) {
    let mut scheme = scheme(options);
    // 1 actuate, 2 smooth dynamics, 3 detect: at the configuration at which the scheme evaluates the step.
    let evaluated_at_start = evaluate(compiled, options, &mut scheme, s, probe);
    // 4 assemble; 1 and 2 again for forces that depend on the velocity after the step.
    assemble_rows(compiled, options, &scheme, s, evaluated_at_start, probe);
    // 5 solve, 6 integrate velocity; both again where impacts change the velocity. With Baumgarte's method its bias is limited here.
    let mut solution = solve_velocities(compiled, options, &scheme, s, probe);
    // 7 integrate position
    let tunnelled = integrate_positions(compiled, &scheme, s, &solution, probe);
    // 8 stabilise
    correct_positions(compiled, options, &scheme, s, &mut solution, probe);
    probe.span(Span::GuardEnergy, || guard_energy(compiled, s, &solution));
    (solution, tunnelled)
}
