//! Vectors and matrices of a simulation in nalgebra's types, with the feature `nalgebra`.

use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Point3, Quaternion, UnitQuaternion, Vector3};

use crate::batch::inputs::{Field, StepInputs};
use crate::batch::simulation::{BodyPose, Contact, Simulation};

impl Simulation {
    /// State field of one environment: nq, nv or na numbers. [`Simulation::set`] accepts its `as_slice()`.
    ///
    /// # Panics
    /// When there is no such environment.
    #[track_caller]
    pub fn vector(&self, field: Field, env: usize) -> DVector<f64> {
        self.assert_env(env);
        self.values(field, env).into()
    }

    /// State field of all environments, one column per environment: (nq, num_envs), (nv, num_envs) or (na, num_envs).
    pub fn matrix(&self, field: Field) -> DMatrix<f64> {
        let mut all = DMatrix::zeros(field.width(self.model()), self.num_envs());
        for (env, mut column) in all.column_iter_mut().enumerate() {
            column.copy_from_slice(&self.values(field, env));
        }
        all
    }

    /// Mass matrix of one environment at its present configuration, (nv, nv): kg, kg m and kg m^2.
    ///
    /// It includes armature, and no terms that depend on the time step. Mocap bodies have the poses that the user set.
    ///
    /// # Panics
    /// When there is no such environment.
    #[track_caller]
    pub fn mass_matrix(&self, env: usize) -> DMatrix<f64> {
        self.assert_env(env);
        let snapshot = self.snapshot(env, &StepInputs::default()).expect("the environment exists, and there are no inputs");
        let nv = self.model().nv();
        DMatrix::from_row_slice(nv, nv, &snapshot.mass_matrix())
    }
}

impl BodyPose {
    /// Transform from the body's frame to the world frame.
    pub fn isometry(&self) -> Isometry3<f64> {
        let [w, x, y, z] = self.quat;
        // The quaternion has length 1 within rounding. Without normalisation its bits stay the same.
        Isometry3::from_parts(self.pos.into(), UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z)))
    }
}

impl Contact {
    /// Position of the contact in the world frame, m.
    pub fn point(&self) -> Point3<f64> {
        self.pos.into()
    }

    /// Rotation from the contact's axes to world axes. Its columns are the normal and the two tangents.
    pub fn rotation(&self) -> Matrix3<f64> {
        Matrix3::from_columns(&self.frame().map(Vector3::from))
    }

    /// Force on the second geom in world axes, N.
    pub fn world_force(&self) -> Vector3<f64> {
        self.rotation() * Vector3::from(self.force)
    }

    /// Torque on the second geom about the contact's position in world axes, N m.
    pub fn world_torque(&self) -> Vector3<f64> {
        self.rotation() * Vector3::from(self.torque)
    }
}
