//! Displacements of configurations: the configuration after a displacement, and the displacement between two configurations.
//!
//! A displacement has the coordinates of velocities, (nv,). For ball and free joints it has the rotation vector in the body's frame. The
//! functions are MuJoCo's `mj_integratePos` and `mj_differentiatePos` over a time of 1.

use crate::dynamics::kinematics::quat_at;
use crate::error::{Error, check_length};
use crate::math::spatial::*;
use crate::model::{JointKind, Model};

/// Norm of a quaternion below which it defines no orientation.
const NO_LENGTH: f64 = 1e-10;

/// Index of the first joint whose quaternion in the configuration `q`, (nq,), is zero or not finite; `None` if there is none.
///
/// # Errors
/// [`Error::Length`] when `q` has more or fewer numbers.
pub fn joint_without_orientation(model: &Model, q: &[f64]) -> Result<Option<usize>, Error> {
    check_length("q", q.len(), model.nq())?;
    let has_no_length = |at: usize| {
        let norm = quat_at(q, at).iter().map(|x| x * x).sum::<f64>().sqrt();
        norm < NO_LENGTH || !norm.is_finite()
    };
    Ok(quaternions(model).find(|&(_, [at, _])| has_no_length(at)).map(|(joint, _)| joint))
}

/// Configuration q (+) d, (nq,), after a displacement `d`, (nv,), from the configuration `q`, (nq,). Quaternions are normalised.
///
/// # Errors
/// [`Error::Length`] when `q` or `d` has more or fewer numbers.
pub fn integrate(model: &Model, q: &[f64], d: &[f64]) -> Result<Vec<f64>, Error> {
    check_length("q", q.len(), model.nq())?;
    check_length("d", d.len(), model.nv())?;
    let mut out = q.to_vec();
    for (i, j) in scalars(model) {
        out[i] += d[j];
    }
    for (_, [at, v]) in quaternions(model) {
        let turned = quat_mul(quat_normalize(quat_at(q, at)), quat_exp([d[v], d[v + 1], d[v + 2]]));
        out[at..at + 4].copy_from_slice(&quat_normalize(turned));
    }
    Ok(out)
}

/// Shortest displacement d, (nv,), with `from` (+) d = `to`, between two configurations, (nq,).
///
/// # Errors
/// [`Error::Length`] when `from` or `to` has more or fewer numbers.
pub fn differentiate(model: &Model, from: &[f64], to: &[f64]) -> Result<Vec<f64>, Error> {
    check_length("from", from.len(), model.nq())?;
    check_length("to", to.len(), model.nq())?;
    let mut out = vec![0.0; model.nv()];
    for (i, j) in scalars(model) {
        out[j] = to[i] - from[i];
    }
    for (_, [at, v]) in quaternions(model) {
        let turn = quat_log(quat_between(quat_normalize(quat_at(from, at)), quat_normalize(quat_at(to, at))));
        out[v..v + 3].copy_from_slice(&turn);
    }
    Ok(out)
}

/// Addresses in q and v of all scalar coordinates: hinges, slides, and translations of free joints.
fn scalars(model: &Model) -> impl Iterator<Item = (usize, usize)> {
    model.joints.iter().zip(model.joint_addresses()).flat_map(|(joint, (q, v))| {
        let n = match joint.kind {
            JointKind::Free => 3,
            JointKind::Ball => 0,
            JointKind::Slide | JointKind::Hinge => 1,
        };
        (0..n).map(move |k| (q + k, v + k))
    })
}

/// Joints with an orientation (ball and free joints): index, and addresses of the orientation in q and v.
pub(crate) fn quaternions(model: &Model) -> impl Iterator<Item = (usize, [usize; 2])> {
    model.joints.iter().zip(model.joint_addresses()).enumerate().filter_map(|(i, (joint, (q, v)))| match joint.kind {
        JointKind::Free => Some((i, [q + 3, v + 3])),
        JointKind::Ball => Some((i, [q, v])),
        JointKind::Slide | JointKind::Hinge => None,
    })
}
