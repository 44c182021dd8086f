//! Finished model: a description that was checked and cannot be edited.

use std::ops::Deref;
use std::sync::Arc;

use stepper_geometry::Hull;

use crate::description::{Description, Overlap};
use crate::hulls::Hulls;
use crate::shape::Shape;

/// Finished model: a [`Description`] that was checked and cannot be edited, so that every model is valid.
///
/// The fields of the description can be read, such as `model.timestep` and `model.bodies[1].mass`. [`Model::replace`] makes a model with
/// other values. For other edits, convert the model to a description, edit the description, and finish it again:
///
/// ```
/// use stepper_model::{BodyBuilder, GeomBuilder, JointBuilder, Model, WORLD};
///
/// let mut scene = Model::builder("pendulum");
/// let rod = BodyBuilder::new("rod").joint(JointBuilder::hinge("pivot", [0.0, 1.0, 0.0]));
/// scene.body(WORLD, rod.geom(GeomBuilder::capsule("rod", 0.02, 0.2).pos([0.0, 0.0, -0.2])));
/// let model = scene.finish()?;
///
/// let mut description = model.into_description();
/// description.timestep = 0.001;
/// let model = description.finish(true)?;
/// assert_eq!(model.timestep, 0.001);
///
/// let mut description = model.into_description();
/// description.timestep = -0.001;
/// assert!(description.finish(true).is_err());
/// # Ok::<(), stepper_model::ModelError>(())
/// ```
///
/// The fields of a model cannot be assigned:
///
/// ```compile_fail,E0594
/// # use stepper_model::Model;
/// fn spoil(model: &mut Model) {
///     model.timestep = -0.001; // cannot assign to data in dereference of `Model`
/// }
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// Description. It may only be changed so that the model is still valid.
    pub(super) description: Description,
    /// Convex hulls of the meshes. Changes of the description do not update them.
    pub(super) hulls: Hulls,
}

impl Deref for Model {
    type Target = Description;

    fn deref(&self) -> &Description {
        &self.description
    }
}

impl Model {
    /// Converts the model to its description, which can be edited and finished again.
    pub fn into_description(self) -> Description {
        self.description
    }

    /// Disables collisions between the bodies of overlapping geoms. If one of the bodies is the world, only collisions between the two
    /// geoms are disabled.
    ///
    /// # Panics
    /// If an overlap has the index of a geom that the model does not have.
    pub fn exclude_overlaps(&mut self, overlaps: impl IntoIterator<Item = Overlap>) {
        let count = self.geoms.len();
        self.description
            .excluded_overlaps
            .extend(overlaps.into_iter().inspect(|o| assert!(o.geoms.iter().all(|&g| g < count), "no geom {o:?}")));
    }

    /// Copy of the model without delays in its actuators.
    pub fn without_actuator_delays(&self) -> Self {
        let mut model = self.clone();
        model.description.actuators.iter_mut().for_each(|actuator| actuator.delay = 0.0);
        model
    }

    /// Convex hull of the mesh to which the shape refers. The model only stores hulls that are the collision shape of a geom that can touch
    /// other geoms; otherwise the result is `None`.
    pub fn hull_of(&self, shape: &Shape) -> Option<&Arc<Hull>> {
        self.hulls.0.get(self.mesh_index(shape)?)?.as_ref()
    }
}
