//! Copies between the input arrays of a call, the state of a group, and the workspace of a worker.

use stepper_real::{Mask, Real, Scalar, kernel};

use crate::batch::call::Call;
use crate::batch::state::Group;
use crate::dynamics::mocap::MocapTrajectory;
use crate::integrators::workspace::Workspace;
use crate::math::spatial::*;

/// Copies the state after the steps of a call from the workspace to the group.
pub(super) fn store_state<R: Real>(group: &mut Group<R::Scalar>, s: &Workspace<R>) {
    kernel!(R, || {
        // There is one call per field. A loop over an array of (source, target) pairs would copy the references through memory.
        R::store_all(&s.state.q, &mut group.q);
        R::store_all(&s.state.v, &mut group.v);
        R::store_all(&s.state.act, &mut group.act);
        R::store_all(&s.velocity.scalar_impulse, &mut group.scalar_impulse);
        R::store_all(&s.state.impulse, &mut group.impulse);
        group.time.copy_from_slice(&s.state.time);
        group.store_contacts(&s.state.contacts);
    })
}

/// Stores the poses of the mocap bodies at the end of the call in the group. If the call stopped early, these are the poses that the mocap
/// bodies have reached.
pub(super) fn store_mocap_poses<R: Real>(call: &Call<'_, R::Scalar>, group: &mut Group<R::Scalar>, s: &Workspace<R>) {
    if s.inputs.mocap_trajectories.is_empty() {
        return;
    }
    let arrived = call.part.to == call.schedule.steps();
    kernel!(R, || {
        for (trajectory, out) in s.inputs.mocap_trajectories.iter().zip(group.mocap.chunks_exact_mut(7 * R::LANES)) {
            R::store_all(&if arrived { trajectory.end() } else { trajectory.pose_at(R::of(s.state.elapsed)) }, out);
        }
    })
}

/// Loads positions, velocities, activations, the generalized constraint impulse, and the impulses of scalar rows of a group into the
/// workspace. If `contacts` is true, also loads times, and contacts with their impulses.
pub(super) fn load_state<R: Real>(group: &Group<R::Scalar>, s: &mut Workspace<R>, contacts: bool) {
    kernel!(R, || {
        s.alive = R::Mask::from_bits(group.alive);
        R::load_all(&group.q, &mut s.state.q);
        R::load_all(&group.v, &mut s.state.v);
        R::load_all(&group.act, &mut s.state.act);
        R::load_all(&group.scalar_impulse, &mut s.velocity.scalar_impulse);
        R::load_all(&group.impulse, &mut s.state.impulse);
        if contacts {
            s.state.time.copy_from_slice(&group.time);
            group.load_contacts(&mut s.state.contacts);
        }
    })
}

/// Loads the inputs of a call, except the controls: applied forces, active equalities, trajectories of mocap bodies, and parameters of
/// actuator dynamics. If a lag follows a continuous servo, the actuator pipelines replace the servo's gains in every step (`advance` in
/// `actuation/pipeline.rs`).
pub(super) fn load_inputs<R: Real>(call: &Call<'_, R::Scalar>, group: &Group<R::Scalar>, first: usize, s: &mut Workspace<R>) {
    if let Some(pipelines) = call.pipelines {
        pipelines.load(call.compiled, first / R::LANES, &mut s.inputs.actuator_dynamics);
    }
    let used = (call.num_envs - first).min(R::LANES);
    for (rows, n, out) in
        [(call.inputs.qfrc, call.compiled.nv, &mut s.inputs.qfrc), (call.inputs.xfrc, 6 * call.compiled.bodies.len(), &mut s.inputs.xfrc)]
    {
        out.clear();
        if !rows.is_empty() {
            out.resize(n, R::zero());
            gather(rows, n, first, used, out);
        }
    }
    if !call.compiled.equalities.is_empty() {
        s.inputs.active_equalities.load(call.compiled, call.inputs.eq_active, first, used);
    }
    if !call.compiled.mocap.is_empty() {
        find_mocap_trajectories(call, group, first, used, s);
    }
}

/// Computes the trajectories of the mocap bodies during the call: from their last poses to those that the user gives. If the user gives no
/// poses, those of the model are the targets.
fn find_mocap_trajectories<R: Real>(call: &Call<'_, R::Scalar>, group: &Group<R::Scalar>, first: usize, used: usize, s: &mut Workspace<R>) {
    kernel!(R, || {
        let seconds = R::of(call.schedule.steps().max(1) as f64 * call.settings.timestep);
        let given = !call.inputs.mocap_pos.is_empty();
        s.state.elapsed = call.part.elapsed;
        for (k, m) in call.compiled.mocap.iter().enumerate() {
            let n = call.compiled.mocap.len();
            let (mut pos, mut quat): (V3<R>, [R; 4]) = (splat(m.pos), splat(m.quat));
            for l in 0..if given { used } else { 0 } {
                let at = (first + l) * n + k;
                (0..3).for_each(|i| pos[i].set_lane(l, Scalar::from_f64(call.inputs.mocap_pos[3 * at + i])));
                (0..4).for_each(|i| quat[i].set_lane(l, Scalar::from_f64(call.inputs.mocap_quat[4 * at + i])));
            }
            let last = std::array::from_fn(|i| R::load(&group.mocap[(7 * k + i) * R::LANES..]));
            s.inputs.mocap_trajectories[k] = MocapTrajectory::new(last, pos, quat, seconds);
        }
    })
}

/// Loads control number `control` of the call for the group whose first environment is `first`.
pub(super) fn load_control<R: Real>(call: &Call<'_, R::Scalar>, control: usize, first: usize, s: &mut Workspace<R>) {
    let row = call.inputs.ctrl.len() / call.schedule.controls;
    let used = (call.num_envs - first).min(R::LANES);
    // Actuator pipelines compute `inputs.ctrl` from the user's controls at the beginning of every step.
    let out = if call.pipelines.is_some() { &mut s.user_controls } else { &mut s.inputs.ctrl };
    gather(&call.inputs.ctrl[control * row..(control + 1) * row], call.compiled.actuators.len(), first, used, out);
}

/// Loads the rows `first..first + used` of an array with `n` columns into `out`, one row per lane. `out` may have fewer columns. An array
/// of one row gives this row to all `used` lanes, and an empty array gives zeros. Lanes after the first `used` get zeros.
pub(super) fn gather<R: Real>(rows: &[f64], n: usize, first: usize, used: usize, out: &mut [R]) {
    kernel!(R, || {
        if n == 0 || out.is_empty() {
            return;
        }
        let shared = rows.len() <= n;
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
    })
}
