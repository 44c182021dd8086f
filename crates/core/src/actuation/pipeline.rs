//! Actuator pipelines: before every step they convert the user's controls to those of the step. A pipeline has up to three parts in this
//! order: delay, servo, and first-order lag. The other parts of an actuator model act within the step: motor and force limits
//! (`actuation/force_limits.rs`), friction (`actuation/losses.rs`), and the length and velocity terms of a continuous servo
//! (`stages/s01_actuate.rs`).
//!
//! The output of a servo is called its effort. It is a force or, for a motor with voltage control, a fraction of
//! the nominal voltage.

use stepper_real::{Mask, Real, Scalar, kernel};

use crate::actuation::affine_force::{ActuatorDynamics, bounded, within};
use crate::actuation::memory::Memory;
use crate::compile::{CompiledActuator, ModelStructure};
use crate::math::lanes::{DelayLine, get, put, split_delay};
use crate::model::actuator_spec::{ActuatorSpec, any_nonzero};

/// Parameter of an actuator model that may differ between environments. The variants have the order of the rows in the parameter table.
#[derive(Clone, Copy)]
enum PipelineParameter {
    /// Delay of the control, in steps.
    Delay,
    /// Fraction of the difference between the lag's output and its input that remains at the end of a step. `Mean` is the mean of this
    /// fraction over the step.
    Decay,
    Mean,
    MinForce,
    MaxForce,
    Kp,
    /// Integral gain of the servo times the time between two updates of the integral: the sampling period, but at least the time step.
    Ki,
    Kd,
    /// Largest magnitude of the integral, in units of the effort.
    IntegralLimit,
    /// Sampling period of the servo; the time step for a continuous servo.
    Period,
    /// Lower bound of a servo's effort. While the unbounded effort is below it, the servo's integral does not decrease. `MaxEffort` is
    /// the upper bound.
    MinEffort,
    MaxEffort,
    /// Stall torque of the motor, after the gear.
    Stall,
    /// Torque lost to the motor's back-EMF after the gear, per unit of velocity.
    BackEmf,
    Efficiency,
    Friction,
    StribeckFriction,
    StribeckVelocity,
}

/// Number of variants of [`PipelineParameter`].
const PARAMETERS: usize = 18;

/// Kind of servo in an actuator's pipeline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ServoKind {
    None,
    Continuous,
    Sampled,
}

/// Pipeline of one actuator: its parts, and the addresses of its stored values and parameters.
#[derive(Clone, Debug)]
struct ActuatorPipeline {
    actuator: usize,
    servo: ServoKind,
    lagged: bool,
    /// Length of the delay line in samples; 0 without a delay.
    delay_samples: usize,
    /// Whole and fractional part of the delay in steps, if it is the same in all environments; otherwise `None`.
    delay: Option<(usize, f64)>,
    /// Address of the pipeline's stored values in the memory: delay line, output and input of the lag, integral, phase, held effort.
    memory_start: usize,
    /// Index of the pipeline's delay line among all delay lines.
    line_index: usize,
    /// Address of the pipeline's parameters in the table.
    table_start: usize,
}

/// Inputs of one pipeline at the beginning of a step.
#[derive(Clone, Copy)]
struct PipelineInput<'a, R: Real> {
    /// Parameters of the pipeline, for a group of lanes.
    table: &'a [R::Scalar],
    actuator: &'a CompiledActuator<R::Scalar>,
    /// Configuration and velocity.
    state: [&'a [R]; 2],
    /// Lanes whose controls are all finite.
    valid: R::Mask,
    /// Lanes that get their first control since a reset.
    start: R::Mask,
    /// Time step, s.
    h: f64,
}

/// Pipelines of the actuators with an actuator model, for all environments of a batch.
#[derive(Clone, Debug)]
pub struct ActuatorPipelines<S> {
    pipelines: Vec<ActuatorPipeline>,
    /// Parameters of every pipeline. Each group of lanes has one table, in which a parameter has one value per lane.
    tables: Vec<Vec<S>>,
    lanes: usize,
    num_envs: usize,
    /// Number of stored values per lane that persist between steps.
    pub memory: usize,
    /// Number of delay lines.
    pub lines: usize,
}

impl<S: Scalar> ActuatorPipelines<S> {
    /// Creates the pipelines of the actuator models `specs`. This list is a result of [`ActuatorSpec::combine`], and has one entry for
    /// every actuator of the model. `h` is the time step, s.
    pub fn new(specs: &[Option<ActuatorSpec>], num_envs: usize, lanes: usize, h: f64) -> Self {
        let mut all = Self { pipelines: vec![], tables: vec![], lanes, num_envs, memory: 0, lines: 0 };
        for (actuator, spec) in specs.iter().enumerate() {
            let Some(spec) = spec else { continue };
            let longest = spec.longest(num_envs, h);
            let servo = match &spec.servo {
                None => ServoKind::None,
                Some(s) if s.period.is_empty() => ServoKind::Continuous,
                Some(_) => ServoKind::Sampled,
            };
            let line = if longest > 0 { longest + 2 } else { 0 };
            let (memory_start, table_start, lagged) = (all.memory, all.pipelines.len() * PARAMETERS, any_nonzero(&spec.lag));
            let pipeline = ActuatorPipeline {
                actuator,
                servo,
                lagged,
                delay_samples: line,
                delay: None,
                memory_start,
                line_index: all.lines,
                table_start,
            };
            all.memory += line + 2 * usize::from(lagged) + [0, 1, 3][servo as usize];
            all.lines += usize::from(line > 0);
            all.pipelines.push(pipeline);
        }
        all.tables = vec![vec![S::default(); all.pipelines.len() * PARAMETERS * lanes]; num_envs.div_ceil(lanes)];
        all.set_parameters(specs, &(0..num_envs).collect::<Vec<_>>(), h);
        all
    }

    /// Position of each delay line in the stored values, and number of its samples, each of which has one value.
    pub fn delay_lines(&self) -> impl Iterator<Item = DelayLine> {
        self.pipelines.iter().filter(|c| c.delay_samples > 0).map(|c| DelayLine { at: c.memory_start, samples: c.delay_samples, width: 1 })
    }

    /// Sets the parameters of the environments `envs` from `specs`. Each list of numbers in a spec has one number for all of `envs`, or
    /// one for each.
    ///
    /// Actuators without an entry keep their parameters. The stored values do not change.
    pub fn set_parameters(&mut self, specs: &[Option<ActuatorSpec>], envs: &[usize], h: f64) {
        let lanes = self.lanes;
        for pipeline in &mut self.pipelines {
            let Some(spec) = &specs[pipeline.actuator] else { continue };
            for (k, &env) in envs.iter().enumerate() {
                let (table, lane) = (&mut self.tables[env / lanes][pipeline.table_start * lanes..], env % lanes);
                // Unused lanes have the parameters of the last environment.
                let alike = if env + 1 == self.num_envs { lane..lanes } else { lane..lane + 1 };
                for (row, x) in table.chunks_exact_mut(lanes).zip(parameters_of(spec, k, h)) {
                    row[alike.clone()].fill(S::from_f64(x));
                }
            }
            let at = (pipeline.table_start + PipelineParameter::Delay as usize) * lanes;
            let first = self.tables[0][at];
            let shared = self.tables.iter().all(|table| table[at..at + lanes].iter().all(|x| *x == first));
            pipeline.delay = shared.then(|| pipeline.whole_and_rest(first));
        }
    }

    /// Memory of the parameters, bytes.
    pub fn bytes(&self) -> usize {
        self.tables.iter().map(|table| size_of_val(&table[..])).sum()
    }

    /// Whether no actuator has a pipeline.
    pub fn is_empty(&self) -> bool {
        self.pipelines.is_empty()
    }

    /// Loads the parameters of a group's actuator dynamics into `actuator_dynamics`: force limits, torque-speed curve, friction losses, and
    /// gains of continuous servos.
    ///
    /// A lag after a continuous servo passes on only a fraction of a change of the servo's output in the same step. The gains of the servo
    /// are therefore multiplied by this fraction. The fraction grows during a step: this function uses its value at the end of a step, for
    /// readings between steps, and [`Self::advance`] its mean over the step.
    pub fn load<R: Real<Scalar = S>>(&self, compiled: &ModelStructure<S>, group: usize, actuator_dynamics: &mut [ActuatorDynamics<R>]) {
        kernel!(R, || {
            for pipeline in &self.pipelines {
                let Some(dynamics) = compiled.actuators[pipeline.actuator].dynamics else { continue };
                let table = &self.tables[group][pipeline.table_start * R::LANES..];
                actuator_dynamics[dynamics.index] = dynamics_of(
                    [R::zero(); 2],
                    #[inline(always)]
                    |n| get(table, n as usize),
                );
                if dynamics.continuous_servo {
                    pipeline.set_gains(table, PipelineParameter::Decay, &mut actuator_dynamics[dynamics.index]);
                }
            }
        })
    }

    /// Parameters of the actuator dynamics of all actuators in one lane. Gains are those at the end of a step, as in [`Self::load`].
    pub fn read(&self, compiled: &ModelStructure<S>, group: usize, lane: usize) -> Vec<ActuatorDynamics<f64>> {
        let mut actuator_dynamics = vec![ActuatorDynamics::default(); compiled.num_actuator_dynamics];
        for pipeline in &self.pipelines {
            let Some(dynamics) = compiled.actuators[pipeline.actuator].dynamics else { continue };
            let number = |n: PipelineParameter| self.tables[group][(pipeline.table_start + n as usize) * self.lanes + lane].to_f64();
            let share = if dynamics.continuous_servo { 1.0 - number(PipelineParameter::Decay) } else { 0.0 };
            actuator_dynamics[dynamics.index] =
                dynamics_of([-share * number(PipelineParameter::Kp), -share * number(PipelineParameter::Kd)], number);
        }
        actuator_dynamics
    }

    /// Advances the pipelines at the beginning of a step, whose state is (q, v). Converts the user's controls `given` to the step's
    /// controls. Also sets the gains of lagged continuous servos to their means over the step.
    ///
    /// If any control of a lane is not finite, the delay lines of the lane repeat their last sample, and its other stored values stay. The
    /// lane's outputs become NaN, so that its step is rejected.
    #[expect(clippy::too_many_arguments, reason = "inputs, parameters, memory and outputs are separate buffers")]
    pub fn advance<R: Real<Scalar = S>>(
        &self,
        compiled: &ModelStructure<S>,
        group: usize,
        given: &[R],
        state: [&[R]; 2],
        alive: R::Mask,
        h: f64,
        memory: &mut Memory<S>,
        (ctrl, actuator_dynamics): (&mut [R], &mut [ActuatorDynamics<R>]),
    ) {
        kernel!(R, || {
            let mut valid = alive;
            for &u in given {
                valid = valid.and(u.is_finite());
            }
            // Lanes that get their first control since a reset. This control fills their delay lines and lags.
            let start = valid.and(R::Mask::from_bits(memory.waiting));
            memory.waiting &= !valid.bits();
            ctrl.copy_from_slice(given);
            for pipeline in &self.pipelines {
                let table = &self.tables[group][pipeline.table_start * R::LANES..];
                let actuator = &compiled.actuators[pipeline.actuator];
                let input = PipelineInput { table, actuator, state, valid, start, h };
                let mut u = within(given[pipeline.actuator], actuator.ctrl_range);
                if pipeline.delay_samples > 0 {
                    u = pipeline.delayed(input, u, memory);
                }
                if pipeline.servo != ServoKind::None {
                    u = pipeline.follow(input, u, &mut memory.numbers);
                }
                if pipeline.lagged {
                    u = pipeline.lag(input, u, &mut memory.numbers);
                    if let (ServoKind::Continuous, Some(dynamics)) = (pipeline.servo, actuator.dynamics) {
                        pipeline.set_gains(table, PipelineParameter::Mean, &mut actuator_dynamics[dynamics.index]);
                    }
                }
                ctrl[pipeline.actuator] = R::select(valid, u, R::of(f64::NAN));
            }
        })
    }

    /// Writes the outputs that the pipelines have at the end of a step to `ctrl` and `actuator_dynamics`, and stores the controls in the
    /// memory. During the step a lag has its mean output instead.
    pub fn write_outputs_after_step<R: Real<Scalar = S>>(
        &self,
        compiled: &ModelStructure<S>,
        group: usize,
        memory: &mut Memory<S>,
        (ctrl, actuator_dynamics): (&mut [R], &mut [ActuatorDynamics<R>]),
    ) {
        kernel!(R, || {
            for pipeline in self.pipelines.iter().filter(|c| c.lagged) {
                let table = &self.tables[group][pipeline.table_start * R::LANES..];
                let effort: R = get(&memory.numbers, pipeline.lag_at());
                ctrl[pipeline.actuator] = effort;
                // With a continuous servo, the stored output of the lag is the one at the beginning of the step. During the step it
                // decays towards the stored input.
                if let (ServoKind::Continuous, Some(dynamics)) = (pipeline.servo, compiled.actuators[pipeline.actuator].dynamics) {
                    let (goal, decay): (R, R) =
                        (get(&memory.numbers, pipeline.lag_at() + 1), get(table, PipelineParameter::Decay as usize));
                    ctrl[pipeline.actuator] = goal + (effort - goal) * decay;
                    pipeline.set_gains(table, PipelineParameter::Decay, &mut actuator_dynamics[dynamics.index]);
                }
            }
            for (i, u) in ctrl.iter().enumerate() {
                u.store(&mut memory.applied[i * R::LANES..]);
            }
        })
    }
}

/// Parameters of an actuator's dynamics with the gains `slope` and `rate`, from the parameter table that `number` reads.
#[inline(always)]
fn dynamics_of<T>([slope, rate]: [T; 2], number: impl Fn(PipelineParameter) -> T) -> ActuatorDynamics<T> {
    ActuatorDynamics {
        slope,
        rate,
        limits: [number(PipelineParameter::MinForce), number(PipelineParameter::MaxForce)],
        stall: number(PipelineParameter::Stall),
        back_emf: number(PipelineParameter::BackEmf),
        efficiency: number(PipelineParameter::Efficiency),
        friction: number(PipelineParameter::Friction),
        stribeck_friction: number(PipelineParameter::StribeckFriction),
        stribeck_velocity: number(PipelineParameter::StribeckVelocity),
    }
}

/// Parameters of one environment, in the order of [`PipelineParameter`]: the numbers at the position `k` of each list of a spec. A list of
/// one number has the same number at all positions. `h` is the time step, s.
fn parameters_of(t: &ActuatorSpec, k: usize, h: f64) -> [f64; PARAMETERS] {
    let of = |x: &[f64]| x[k % x.len()];
    let (low, high, lag) = (of(&t.low), of(&t.high), of(&t.lag));
    // e^(-h/lag), and the mean of e^(-t/lag) over the step.
    let (decay, mean) = if lag > 0.0 { ((-h / lag).exp(), -lag / h * (-h / lag).exp_m1()) } else { (0.0, 0.0) };
    let mut parameters = [0.0; PARAMETERS];
    let mut set = |n: PipelineParameter, x: f64| parameters[n as usize] = x;
    set(PipelineParameter::Delay, t.steps(k, h));
    set(PipelineParameter::Decay, decay);
    set(PipelineParameter::Mean, mean);
    set(PipelineParameter::MinForce, low);
    set(PipelineParameter::MaxForce, high);
    set(PipelineParameter::Friction, of(&t.friction));
    set(PipelineParameter::StribeckFriction, of(&t.stribeck_friction));
    set(PipelineParameter::StribeckVelocity, of(&t.stribeck_velocity));
    let (mut least, mut most) = (low, high);
    set(PipelineParameter::Efficiency, t.motor.as_ref().map_or(1.0, |m| of(&m.efficiency)));
    if let Some(m) = t.motor.as_ref().filter(|m| !m.stall_torque.is_empty()) {
        let stall = of(&m.stall_torque) * m.gear;
        set(PipelineParameter::Stall, stall);
        set(PipelineParameter::BackEmf, stall * m.gear / of(&m.no_load_speed));
        (least, most) = if m.voltage { (-1.0, 1.0) } else { (low, high) };
    }
    set(PipelineParameter::MinEffort, least);
    set(PipelineParameter::MaxEffort, most);
    if let Some(s) = &t.servo {
        let period = if s.period.is_empty() { h } else { of(&s.period) };
        set(PipelineParameter::Kp, of(&s.kp));
        set(PipelineParameter::Ki, of(&s.ki) * period.max(h));
        set(PipelineParameter::Kd, of(&s.kd));
        set(PipelineParameter::IntegralLimit, of(&s.integral_limit));
        set(PipelineParameter::Period, period);
    }
    parameters
}

impl<R: Real> PipelineInput<'_, R> {
    /// Length and velocity of the actuator, which acts on a joint or tendon.
    #[inline(always)]
    fn motion(&self) -> [R; 2] {
        let ([q, v], mut length, mut velocity) = (self.state, R::zero(), R::zero());
        for &(at, dof, arm) in &self.actuator.moment {
            length += R::splat(arm) * q[at];
            velocity += R::splat(arm) * v[dof];
        }
        [length, velocity]
    }
}

impl ActuatorPipeline {
    /// Address of the stored values of the lag; those of the servo follow.
    fn lag_at(&self) -> usize {
        self.memory_start + self.delay_samples
    }

    /// Whole and fractional part of a delay in steps. For sampled servos, the delay is rounded up to whole steps.
    #[inline(always)]
    fn whole_and_rest<S: Scalar>(&self, steps: S) -> (usize, f64) {
        let (whole, rest) = split_delay(steps.to_f64(), self.servo != ServoKind::Sampled);
        (whole as usize, rest)
    }

    /// Sets the gains of a continuous servo. A lag multiplies them by one minus the parameter `left`, which is [`PipelineParameter::Decay`]
    /// or its mean over the step.
    #[inline(always)]
    fn set_gains<R: Real>(&self, table: &[R::Scalar], left: PipelineParameter, dynamics: &mut ActuatorDynamics<R>) {
        let share: R = if self.lagged { R::one() - get::<R>(table, left as usize) } else { R::one() };
        dynamics.slope = -(share * get::<R>(table, PipelineParameter::Kp as usize));
        dynamics.rate = -(share * get::<R>(table, PipelineParameter::Kd as usize));
    }

    /// Appends the control `u` to the delay line, and returns the control after the delay. A fractional delay interpolates between two
    /// samples.
    #[inline(always)]
    fn delayed<R: Real>(&self, input: PipelineInput<'_, R>, u: R, memory: &mut Memory<R::Scalar>) -> R {
        let PipelineInput { table, valid, start, .. } = input;
        let line = self.delay_samples;
        let last = memory.cursors[self.line_index] as usize;
        let cursor = (last + 1) % line;
        memory.cursors[self.line_index] = cursor as u32;
        let numbers = &mut memory.numbers;
        // Lanes without a valid control repeat the last one.
        let held = get::<R>(numbers, self.memory_start + last);
        put(numbers, self.memory_start + cursor, R::Mask::splat(true), R::select(valid, u, held));
        if start.any() {
            (0..line).for_each(
                #[inline(always)]
                |s| put(numbers, self.memory_start + s, start, u),
            );
        }
        let slot = |back: usize| self.memory_start + (cursor + line - back.min(line - 1)) % line;
        let (mut new, mut old, mut part);
        if let Some((whole, rest)) = self.delay {
            (new, part) = (get::<R>(numbers, slot(whole)), R::of(rest));
            old = if rest > 0.0 { get(numbers, slot(whole + 1)) } else { new };
        } else {
            (new, old, part) = (R::zero(), R::zero(), R::zero());
            for l in 0..R::LANES {
                let (whole, rest) = self.whole_and_rest(get::<R>(table, PipelineParameter::Delay as usize).lane(l));
                new.set_lane(l, numbers[slot(whole) * R::LANES + l]);
                old.set_lane(l, numbers[slot(whole + 1) * R::LANES + l]);
                part.set_lane(l, Scalar::from_f64(rest));
            }
        }
        R::select(part.gt(R::zero()), new + (old - new) * part, new)
    }

    /// Effort of a servo for the setpoint `u`.
    ///
    /// The effort of a sampled servo is constant between samples. For a continuous servo, the result has no terms of length
    /// and velocity, because stage 1 adds them (-kp length - kd velocity).
    #[inline(always)]
    fn follow<R: Real>(&self, input: PipelineInput<'_, R>, u: R, numbers: &mut [R::Scalar]) -> R {
        let PipelineInput { table, valid, start, h, .. } = input;
        let number = |n: PipelineParameter| get::<R>(table, n as usize);
        let at = self.lag_at() + 2 * usize::from(self.lagged);
        // Lanes in which the servo computes a new effort.
        let mut due = valid;
        if self.servo == ServoKind::Sampled {
            let (phase, period) = (get::<R>(numbers, at + 1) + R::of(h), number(PipelineParameter::Period));
            // The phase is a sum of time steps, so that the comparison allows for rounding.
            let is_due = phase.ge(period - R::of(1e-6 * h));
            let rest = R::select(is_due, (phase - period).min(R::of(h)), phase);
            put(numbers, at + 1, valid, R::select(start, R::zero(), rest));
            due = valid.and(is_due.or(start));
            if due.none() {
                return get(numbers, at + 2);
            }
        }
        let [length, velocity] = input.motion();
        let (error, kp, most) = (u - length, number(PipelineParameter::Kp), number(PipelineParameter::IntegralLimit));
        let before = R::select(start, R::zero(), get(numbers, at));
        let after = (before + number(PipelineParameter::Ki) * error).clamp(-most, most);
        let without_integral = kp * error - number(PipelineParameter::Kd) * velocity;
        // Conditional integration (Astrom & Hagglund 2006, section 3.5): while the effort exceeds a bound, the integral does not change
        // in the direction of this bound.
        let effort = without_integral + after;
        let winds_up = effort
            .gt(number(PipelineParameter::MaxEffort))
            .and(after.gt(before))
            .or(effort.lt(number(PipelineParameter::MinEffort)).and(after.lt(before)));
        let integral = R::select(winds_up, before, after);
        put(numbers, at, due, integral);
        if self.servo == ServoKind::Continuous {
            return kp * u + integral;
        }
        put(
            numbers,
            at + 2,
            due,
            bounded(without_integral + integral, [number(PipelineParameter::MinEffort), number(PipelineParameter::MaxEffort)]),
        );
        get(numbers, at + 2)
    }

    /// Mean output of the lag over the step, for the input `u`.
    ///
    /// Without a continuous servo, the function also stores the output at the end of the step, from which the next call continues.
    ///
    /// After a continuous servo, that output depends on the motion within the step. The function therefore stores the output at the
    /// beginning of the step, and `u`. From these the next call computes the output at the end. Terms of the servo that depend on the
    /// motion in this step are not in `u` and not in the result: stage 1 adds them.
    #[inline(always)]
    fn lag<R: Real>(&self, input: PipelineInput<'_, R>, u: R, numbers: &mut [R::Scalar]) -> R {
        let PipelineInput { table, valid, start, .. } = input;
        let at = self.lag_at();
        let (decay, mean): (R, R) = (get(table, PipelineParameter::Decay as usize), get(table, PipelineParameter::Mean as usize));
        let effort = get::<R>(numbers, at);
        if self.servo == ServoKind::Continuous {
            let [length, velocity] = input.motion();
            // Part of the effort that depends on the motion. `u`, and the stored input of the last step, exclude it.
            let pull =
                get::<R>(table, PipelineParameter::Kp as usize) * length + get::<R>(table, PipelineParameter::Kd as usize) * velocity;
            let bounds = [get::<R>(table, PipelineParameter::MinEffort as usize), get(table, PipelineParameter::MaxEffort as usize)];
            let goal = bounded(R::select(start, u, get(numbers, at + 1)) - pull, bounds);
            let effort = R::select(start, goal, goal + (effort - goal) * decay);
            put(numbers, at, valid, effort);
            put(numbers, at + 1, valid, u);
            return u + (effort - u) * mean;
        }
        let before = R::select(start, u, effort);
        put(numbers, at, valid, u + (before - u) * decay);
        u + (before - u) * mean
    }
}
