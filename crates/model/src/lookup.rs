//! Elements of a model by name.

use std::ops::Range;

use crate::{Description, ModelError};

/// Joint of a model: its index and its coordinates.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct JointPlace {
    /// Index in [`Description::joints`].
    pub index: usize,
    /// Range of its coordinates in a configuration.
    pub qpos: Range<usize>,
    /// Range of its degrees of freedom in a velocity.
    pub qvel: Range<usize>,
}

/// Sensor of a model: its index and its readings.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct SensorPlace {
    /// Index in [`Description::sensors`].
    pub index: usize,
    /// Range of its numbers in the readings of all sensors.
    pub readings: Range<usize>,
}

/// Largest number of names that an error lists.
const LISTED: usize = 12;

/// Declares a lookup for a kind of element, from the first sentence of its documentation, its name, and the searched list.
macro_rules! lookups {
    ($($(#[$doc:meta])* $kind:ident: $list:ident;)*) => {
        impl Description {
            $(
                $(#[$doc])*
                ///
                /// # Errors
                /// [`ModelError::NoSuchName`] when there is none of this name.
                pub fn $kind(&self, name: &str) -> Result<usize, ModelError> {
                    index_of(self.$list.iter().map(|element| &element.name[..]), stringify!($kind), name)
                }
            )*
        }
    };
}

lookups! {
    /// Index of a body by its name.
    body: bodies;
    /// Index of a geom by its name.
    geom: geoms;
    /// Index of an explicit pair of geoms by its name.
    pair: pairs;
    /// Index of a site by its name.
    site: sites;
    /// Index of an actuator by its name, which is its index in the controls.
    actuator: actuators;
    /// Index of a fixed tendon by its name.
    tendon: tendons;
    /// Index of an equality by its name.
    equality: equalities;
    /// Index of a keyframe by its name.
    keyframe: keyframes;
}

impl Description {
    /// Index of a joint by its name, and its ranges in configurations and velocities.
    ///
    /// # Errors
    /// [`ModelError::NoSuchName`] when there is none of this name.
    pub fn joint(&self, name: &str) -> Result<JointPlace, ModelError> {
        let index = index_of(self.joints.iter().map(|joint| &joint.name[..]), "joint", name)?;
        let ((q, v), kind) = (self.joint_addresses()[index], self.joints[index].kind);
        Ok(JointPlace { index, qpos: q..q + kind.nq(), qvel: v..v + kind.nv() })
    }

    /// Index of a sensor by its name, and its range in the readings.
    ///
    /// # Errors
    /// [`ModelError::NoSuchName`] when there is none of this name.
    pub fn sensor(&self, name: &str) -> Result<SensorPlace, ModelError> {
        let index = index_of(self.sensors.iter().map(|sensor| &sensor.name[..]), "sensor", name)?;
        let first = self.sensor_addresses()[index];
        Ok(SensorPlace { index, readings: first..first + self.sensors[index].dim(&self.sensors) })
    }
}

/// Index of the first element with a name. Elements without a name are never found.
fn index_of<'a>(names: impl Iterator<Item = &'a str> + Clone, kind: &'static str, name: &str) -> Result<usize, ModelError> {
    names.clone().position(|known| known == name && !name.is_empty()).ok_or_else(|| {
        let mut known: Vec<String> = names.filter(|known| !known.is_empty()).take(LISTED + 1).map(str::to_owned).collect();
        if known.len() > LISTED {
            known[LISTED] = "...".into();
        }
        ModelError::NoSuchName { kind, name: name.into(), known }
    })
}
