//! Inverse weights: mean inverse inertias at the reference configuration, which scale the regularisation of MuJoCo's contact law.

use crate::actuation::forces::Implicit;
use crate::analysis::quantities::kinematics_at;
use crate::compile::{CompiledModel, LaneModel};
use crate::dynamics::inertia::MassMatrix;
use crate::math::spatial::*;
use crate::model::{InverseWeights, Model};
use crate::stages::s02_smooth::Smooth;

/// Computes the inverse weights of a model, as MuJoCo's compiler does (`mj_setConst`), 1/kg or 1/(kg m^2).
///
/// M is the mass matrix. For a body, the inverse weight is the mean of the diagonal entries of J M^-1 J^T, with the Jacobian J of its
/// centre of mass. For a degree of freedom it is the diagonal entry of M^-1, averaged over the translations or the rotations of its joint.
/// For a tendon it is J M^-1 J^T, with the Jacobian J of its length.
pub fn inverse_weights(model: &Model) -> InverseWeights {
    let compiled = CompiledModel::<f64>::new(model);
    let kinematics = kinematics_at(&compiled, &model.qpos0, compiled.mocap.iter().map(|m| (m.pos, m.quat)));
    let mut smooth = Smooth::new(&compiled);
    smooth.factor_mass(&compiled, &kinematics, Implicit::none());
    let quadratic = |row: &[f64]| quadratic(&compiled, &smooth.mass, row);
    let body = |b: usize| -> [f64; 2] {
        let frame = compiled.bodies[b].frame;
        if frame == 0 || frame > compiled.links.len() {
            return [0.0; 2];
        }
        let point = kinematics.point(frame, compiled.params.body_com(b));
        std::array::from_fn(|rotation| {
            let along = |axis: usize| {
                let moved = |d: usize| compiled.moved_dofs[frame][d / 64] >> (d % 64) & 1 == 1;
                let entry = |d: usize| {
                    let motion = &kinematics.axes[d];
                    let arm = sub(point, kinematics.origin[compiled.dofs[d].tree]);
                    let column = if rotation == 1 { angular(motion) } else { velocity_at(motion, arm) };
                    if moved(d) { column[axis] } else { 0.0 }
                };
                quadratic(&(0..compiled.nv).map(entry).collect::<Vec<_>>())
            };
            (0..3).map(along).sum::<f64>() / 3.0
        })
    };
    let unit = |d: usize| quadratic(&(0..compiled.nv).map(|k| if k == d { 1.0 } else { 0.0 }).collect::<Vec<_>>());
    let mut dofs: Vec<f64> = (0..compiled.nv).map(unit).collect();
    for (joint, (_, dof)) in model.joints.iter().zip(model.joint_addresses()) {
        for block in dofs[dof..dof + joint.kind.nv()].chunks_mut(3) {
            block.fill(block.iter().sum::<f64>() / block.len() as f64);
        }
    }
    let addresses = model.joint_addresses();
    // The paths of spatial tendons have the order of the tendons.
    let mut paths = compiled.paths.iter();
    let tendon = |t: &crate::model::Tendon| {
        let mut row = vec![0.0; compiled.nv];
        t.joints.iter().for_each(|&(j, c)| row[addresses[j].1] += c);
        if let Some(path) = if t.path.is_empty() { None } else { paths.next() } {
            path.dofs.iter().zip(&kinematics.paths.arms[path.arms..]).for_each(|(&dof, arm)| row[dof as usize] += arm);
        }
        quadratic(&row)
    };
    InverseWeights { bodies: (0..model.bodies.len()).map(body).collect(), dofs, tendons: model.tendons.iter().map(tendon).collect() }
}

/// Product J M^-1 J^T for one row J of a Jacobian and the mass matrix M.
fn quadratic(compiled: &LaneModel<f64>, mass: &MassMatrix<f64>, row: &[f64]) -> f64 {
    let mut x = row.to_vec();
    mass.solve(compiled, &mut x);
    row.iter().zip(&x).map(|(a, b)| a * b).sum()
}
