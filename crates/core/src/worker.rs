//! A worker steps groups of environments on one thread; one kind per lane type, one instantiation per CPU level.

use std::any::Any;

use stepper_real::{Level, Mask, Real, Scalar, at_level};

use crate::options::Options;
use crate::plan::Plan;
use crate::spatial::*;
use crate::state::Group;
use crate::step::{Scratch, step};

/// One call of `step` for all environments: what every group needs to know. Arrays are environment-major.
#[derive(Clone, Copy, Debug)]
pub struct Call<'a, S: Scalar> {
    /// The compiled model.
    pub plan: &'a Plan<S>,
    /// Settings.
    pub options: &'a Options,
    /// Number of environments.
    pub num_envs: usize,
    /// Steps to make.
    pub nstep: usize,
    /// Controls, held for all steps: (num_envs, nu), or (nu) for all, or empty for zero.
    pub ctrl: &'a [f64],
    /// (num_envs, nv), or empty for none.
    pub qfrc: &'a [f64],
    /// (num_envs, nbody, 6), or empty for none.
    pub xfrc: &'a [f64],
    /// (num_envs, nmocap, 3) and (num_envs, nmocap, 4), or empty for the model's.
    pub mocap: [&'a [f64]; 2],
}

/// A thread's room to work, and the step compiled for its lanes and CPU level.
pub struct Worker {
    level: Level,
    lanes: usize,
    room: Box<dyn Any + Send>,
}

/// How to make a worker.
#[derive(Clone, Copy)]
pub struct Site<'a, S: Scalar> {
    /// The compiled model.
    pub plan: &'a Plan<S>,
    /// Settings.
    pub options: &'a Options,
    /// Contacts an environment has room for.
    pub max_contacts: usize,
}

/// A scalar type with the lanes that step it.
pub trait Stepped: Scalar {
    /// Lanes of a group of many environments.
    const LANES: usize;
    /// Lanes of a single environment.
    const SINGLE: usize;
    /// Room for groups of `lanes` lanes at a CPU level that this machine has.
    fn room(site: &Site<'_, Self>, lanes: usize, level: Level) -> Box<dyn Any + Send>;
    /// Makes the steps of `call` in one group, whose first environment is `first`.
    fn run(call: &Call<'_, Self>, group: &mut Group<Self>, first: usize, level: Level, room: &mut (dyn Any + Send));
}

impl Worker {
    /// A worker for groups of `lanes` lanes.
    pub fn new<S: Stepped>(site: &Site<'_, S>, lanes: usize, level: Level) -> Self {
        Self { level, lanes, room: S::room(site, lanes, level) }
    }

    /// Makes the steps of `call` in one group, whose first environment is `first`.
    pub fn run<S: Stepped>(&mut self, call: &Call<'_, S>, group: &mut Group<S>, first: usize) {
        assert_eq!(group.lanes, self.lanes, "a worker steps groups of its own width");
        S::run(call, group, first, self.level, &mut *self.room);
    }
}

impl Stepped for f64 {
    const LANES: usize = 8;
    const SINGLE: usize = 1;

    fn room(site: &Site<'_, f64>, lanes: usize, level: Level) -> Box<dyn Any + Send> {
        if lanes == 1 { make_room::<f64>(site) } else { at_level!(level, F64x8, make_room(site)) }
    }

    fn run(call: &Call<'_, f64>, group: &mut Group<f64>, first: usize, level: Level, room: &mut (dyn Any + Send)) {
        // The scalar instantiation is the reference that every lane agrees with to the bit.
        if group.lanes == 1 {
            run_group::<f64>(call, group, first, room)
        } else {
            at_level!(level, F64x8, run_group(call, group, first, room))
        }
    }
}

impl Stepped for f32 {
    const LANES: usize = 16;
    const SINGLE: usize = 16;

    fn room(site: &Site<'_, f32>, _lanes: usize, level: Level) -> Box<dyn Any + Send> {
        at_level!(level, F32x16, make_room(site))
    }

    fn run(call: &Call<'_, f32>, group: &mut Group<f32>, first: usize, level: Level, room: &mut (dyn Any + Send)) {
        at_level!(level, F32x16, run_group(call, group, first, room));
    }
}

fn make_room<R: Real>(site: &Site<'_, R::Scalar>) -> Box<dyn Any + Send> {
    Box::new(Scratch::<R>::new(site.plan, site.options, site.max_contacts))
}

/// All steps of a call for one group.
fn run_group<R: Real>(call: &Call<'_, R::Scalar>, group: &mut Group<R::Scalar>, first: usize, room: &mut (dyn Any + Send)) {
    let s = room.downcast_mut::<Scratch<R>>().expect("room of another lane type");
    load(call, group, first, s);
    let h = call.options.timestep;
    let lanes = R::LANES;
    group.status.fill(0);
    for _ in 0..call.nstep {
        let record = step(call.plan, call.options, s);
        let kept = record.non_finite.bits();
        for l in 0..lanes {
            group.status[l] |= record.status(l).0;
            if kept >> l & 1 == 0 {
                group.time[l] += h;
            }
        }
        record.residual.store(&mut group.residual);
        record.iterations.store(&mut group.iterations);
    }
    store(group, s);
}

fn store<R: Real>(group: &mut Group<R::Scalar>, s: &Scratch<R>) {
    R::vectorize(
        #[inline(always)]
        || {
            let state = [(&s.q, &mut group.q), (&s.v, &mut group.v), (&s.act, &mut group.act)];
            for (x, out) in state.into_iter().chain([(&s.constraints.scalar_impulse, &mut group.scalar_impulse)]) {
                for (x, out) in x.iter().zip(out.chunks_exact_mut(R::LANES)) {
                    x.store(out);
                }
            }
            group.store_contacts(&s.contacts);
        },
    )
}

fn load<R: Real>(call: &Call<'_, R::Scalar>, group: &Group<R::Scalar>, first: usize, s: &mut Scratch<R>) {
    R::vectorize(
        #[inline(always)]
        || {
            let lanes = R::LANES;
            s.alive = R::Mask::from_bits(group.alive);
            for (x, from) in [
                (&mut s.q, &group.q),
                (&mut s.v, &group.v),
                (&mut s.act, &group.act),
                (&mut s.constraints.scalar_impulse, &group.scalar_impulse),
            ] {
                for (x, from) in x.iter_mut().zip(from.chunks_exact(lanes)) {
                    *x = R::load(from);
                }
            }
            group.load_contacts(&mut s.contacts);
            let used = (call.num_envs - first).min(lanes);
            gather(call.ctrl, call.plan.actuators.len(), first, used, &mut s.inputs.ctrl);
            resize(&mut s.inputs.qfrc, call.qfrc, call.plan.nv);
            gather(call.qfrc, call.plan.nv, first, used, &mut s.inputs.qfrc);
            resize(&mut s.inputs.xfrc, call.xfrc, 6 * call.plan.bodies.len());
            gather(call.xfrc, 6 * call.plan.bodies.len(), first, used, &mut s.inputs.xfrc);
            if !call.mocap[0].is_empty() {
                for (k, m) in call.plan.mocap.iter().enumerate() {
                    let n = call.plan.mocap.len();
                    let (mut pos, mut quat): (V3<R>, [R; 4]) = (splat(m.pos), splat(m.quat));
                    for l in 0..used {
                        let at = (first + l) * n + k;
                        (0..3).for_each(|i| pos[i].set_lane(l, Scalar::from_f64(call.mocap[0][3 * at + i])));
                        (0..4).for_each(|i| quat[i].set_lane(l, Scalar::from_f64(call.mocap[1][4 * at + i])));
                    }
                    s.kinematics.pos[m.frame] = pos;
                    s.kinematics.mat[m.frame] = quat_to_mat(quat_normalize(quat));
                }
            }
        },
    )
}

/// Empty when the user gives none.
#[inline(always)]
fn resize<R: Real>(out: &mut Vec<R>, given: &[f64], n: usize) {
    out.resize(if given.is_empty() { 0 } else { n }, R::zero());
}

/// Rows `first..first + used` of an array with `n` columns, one per lane; a single row is everybody's, an empty array is zero.
#[inline(always)]
fn gather<R: Real>(rows: &[f64], n: usize, first: usize, used: usize, out: &mut [R]) {
    if n == 0 || out.is_empty() {
        return;
    }
    let shared = rows.len() == n;
    for (i, x) in out.iter_mut().enumerate() {
        *x = R::zero();
        if rows.is_empty() {
            continue;
        }
        for l in 0..used {
            let row = if shared { 0 } else { first + l };
            x.set_lane(l, Scalar::from_f64(rows[row * n + i]));
        }
    }
}
