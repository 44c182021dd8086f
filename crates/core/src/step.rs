//! One step of a group of environments, read aloud.

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

/// One step of `options.timestep` seconds: state and inputs in, next state, observation and record out.
///
/// Each stage is a kernel that is compiled once for every lane type and CPU level. What stands between them is compiled into this one,
/// since sets of lanes are vectors, too: a function that does not know the CPU calls another for each operation on them.
pub fn step<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    s: &mut Workspace<R>,
    devices: &mut Devices<'_, R::Scalar>,
    probe: impl Probe,
) -> Record<R> {
    R::vectorize(
        #[inline(always)]
        || stages(compiled, options, s, devices, probe),
    )
}

/// The ten stages.
#[inline(always)]
fn stages<R: Real>(
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
        // 1 to 7 with MuJoCo's law, which needs no 8: what is left of a depth or of a loop's error is softness.
        ContactLaw::Mujoco => mujoco::solve_step(compiled, options, s, probe),
    };
    let finite = probe.span(Span::Accept, || accept(compiled, s, options.timestep));
    // 9 sense
    probe.span(Span::Sense, || observe(compiled, options, s, devices));
    // 10 record
    let record = probe.span(Span::Record, || record(compiled, options, s, &solution, [finite, tunnelled]));
    s.constraints.remove_missed(&mut s.state.contacts);
    record
}

/// Stages 1 to 8 with hard contact. Returns the lanes in which something may have passed through something thin, too.
#[inline(always)]
fn solve_step<R: Real>(compiled: &LaneModel<R>, options: &StepSettings, s: &mut Workspace<R>, probe: impl Probe) -> (Solution<R>, R::Mask) {
    let mut scheme = scheme(options);
    // 1 actuate, 2 smooth dynamics, 3 detect: at the configuration where the scheme takes the step.
    let at_beginning = evaluate(compiled, options, &mut scheme, s, probe);
    // 4 assemble; 1 and 2 again for forces that depend on the velocity to come.
    assemble_rows(compiled, options, &scheme, s, at_beginning, probe);
    // 5 solve, 6 integrate velocity; again where impacts make the velocity jump; with Baumgarte's method, what stage 8 says of its
    // velocities.
    let mut solution = solve_velocities(compiled, options, &scheme, s, probe);
    // 7 integrate position
    let tunnelled = integrate_positions(compiled, &scheme, s, &solution, probe);
    // 8 stabilise
    correct_positions(compiled, options, &scheme, s, &mut solution, probe);
    probe.span(Span::GuardEnergy, || guard_energy(compiled, s, &solution));
    (solution, tunnelled)
}
