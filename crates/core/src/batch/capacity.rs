//! Capacity of a batch: number of contacts per environment, and check of the available memory.

use stepper_real::Level;

use crate::batch::call::{Call, Part, Schedule};
use crate::batch::inputs::StepInputs;
use crate::batch::parameter_overrides::ParameterOverrides;
use crate::batch::state::Group;
use crate::batch::worker::{GroupPosition, LaneScalar, WorkerSpec};
use crate::compile::CompiledModel;
use crate::error::Error;
use crate::model::Model;
use crate::options::{Options, Solver, Stabilization, StepSettings};
use crate::stages::s10_record::Status;

/// Memory that the state of one environment takes in a batch, bytes.
pub(super) fn bytes_per_env<S: LaneScalar>(compiled: &CompiledModel<S>, max_contacts: usize) -> usize {
    let group = Group::new(compiled, &vec![S::default(); compiled.nq], S::SAVED_LANES, 0, 0, max_contacts);
    group.bytes().div_ceil(S::SAVED_LANES)
}

/// Memory of an environment in addition to its state, bytes: indices, and the bookkeeping of lists.
const BESIDES: usize = 64;

/// Checks that there is enough memory for `num_envs` environments of `bytes_per_env` bytes each.
///
/// The function allocates the whole memory in one block and frees it. Without the check, a failed allocation of one of the many blocks
/// would end the process.
pub(super) fn check_memory(num_envs: usize, bytes_per_env: usize) -> Result<(), Error> {
    let fails = |all: usize| Vec::<u8>::new().try_reserve_exact(all).is_err();
    match num_envs > 1 && num_envs.checked_mul(bytes_per_env + BESIDES).is_none_or(fails) {
        true => Err(Error::Memory { num_envs, bytes_per_env }),
        false => Ok(()),
    }
}

/// Contact capacity of an environment: the number in the options if it is set, otherwise an estimate.
///
/// The estimate is the number of contacts that can exist, limited by an upper bound. The bound is the larger of two numbers:
///
/// * 16 plus a sum over all links: 4 for a link of a robot, 6 for a free ball, and 12 for another free body. 6 is half of the twelve balls
///   that fit around a ball. 12 is half of the contacts of a box with four on each of its six faces.
/// * twice the number of contacts in the model's reset state and keyframes. Mechanisms whose parts lie on one another (a puzzle, a
///   gripper of many meshes) need this number.
pub(super) fn contact_capacity<S: LaneScalar>(model: &Model, compiled: &CompiledModel<S>, settings: &StepSettings, level: Level) -> usize {
    if let Some(n) = settings.max_contacts {
        return (n as usize).min(compiled.contact_points);
    }
    let mut links_of_tree = vec![0; compiled.ntree];
    compiled.links.iter().for_each(|l| links_of_tree[l.tree] += 1);
    let mut is_ball = vec![true; compiled.nframe()];
    let long = |g: &usize| compiled.params.geom(*g).rotation_reach != S::ZERO;
    (0..compiled.geoms.len()).filter(long).for_each(|g| is_ball[compiled.geoms[g].frame] = false);
    let capacity = compiled.links.iter().enumerate().map(|(l, link)| match is_ball[l + 1] {
        _ if links_of_tree[link.tree] > 1 => 4,
        true => 6,
        false => 12,
    });
    let capacity = 16 + capacity.sum::<usize>();
    if compiled.contact_points <= capacity {
        return compiled.contact_points;
    }
    capacity.max(2 * contacts_at_start(model, compiled, settings, capacity, level)).min(compiled.contact_points)
}

/// Largest number of contacts that a first step from the reset state or from a keyframe finds. The function begins with the contact
/// capacity `capacity`, and doubles it until all contacts fit.
fn contacts_at_start<S: LaneScalar>(
    model: &Model,
    compiled: &CompiledModel<S>,
    settings: &StepSettings,
    mut capacity: usize,
    level: Level,
) -> usize {
    let options = Options { solver: Solver::Pgs, iterations: 1, stabilization: Stabilization::None, ..settings.options };
    let settings = StepSettings { options, ..*settings };
    let lanes = S::lanes(1, level);
    let make = |capacity: usize| S::worker(&WorkerSpec { compiled, settings: &settings, max_contacts: capacity }, lanes, level);
    let overrides = ParameterOverrides::default();
    let call = Call {
        compiled,
        settings: &settings,
        num_envs: 1,
        schedule: Schedule { controls: 1, nstep: 1 },
        inputs: StepInputs::default(),
        part: Part::whole(1),
        sensor_errors: None,
        pipelines: None,
        overrides: &overrides,
    };
    let still = vec![0.0; compiled.nv];
    let keyframes = model.keyframes.iter().map(|k| [&k.qpos, &k.qvel]);
    let mut worker = make(capacity);
    let mut most = 0;
    for [q, v] in std::iter::once([&model.qpos0, &still]).chain(keyframes) {
        let q: Vec<S> = q.iter().map(|&x| S::from_f64(x)).collect();
        loop {
            let mut group = Group::new(compiled, &q, lanes, 1, 0, capacity);
            group.v.iter_mut().step_by(lanes).zip(v).for_each(|(to, &x)| *to = S::from_f64(x));
            worker.forget_state();
            worker.run(&call, &mut group, GroupPosition { first: 0, chunk_first: 0, recording: None });
            most = most.max(group.contact_count[0] as usize);
            if group.status[0] & Status::CONTACTS_FULL.bits() == 0 || capacity == compiled.contact_points {
                break;
            }
            // The full buffer also has contacts that the reduction of redundant contacts removes later.
            most = most.max(capacity);
            capacity = (2 * capacity).min(compiled.contact_points);
            worker = make(capacity);
        }
    }
    most
}
