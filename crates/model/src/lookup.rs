//! Lookup of elements by name.

use std::ops::Range;

use crate::{Description, ModelError};

/// Joint that was found by name: its index, and its ranges in qpos and qvel.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct JointPlace {
    /// Index in [`Description::joints`].
    pub index: usize,
    /// Range of the joint's coordinates in a configuration (qpos).
    pub qpos: Range<usize>,
    /// Range of the joint's degrees of freedom in a velocity (qvel).
    pub qvel: Range<usize>,
}

/// Sensor that was found by name: its index, and the range of its values in the readings of all sensors.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct SensorPlace {
    /// Index in [`Description::sensors`].
    pub index: usize,
    /// Range of the sensor's values in the readings of all sensors.
    pub readings: Range<usize>,
}

/// Largest number of names that an error lists.
const LISTED: usize = 12;

/// Declares one lookup function per kind of element, from the function's documentation and name, and the list that it searches.
macro_rules! lookups {
    ($($(#[$doc:meta])* $kind:ident: $list:ident;)*) => {
        impl Description {
            $(
                $(#[$doc])*
                ///
                /// # Errors
                /// [`ModelError::NoSuchName`] if no element of this kind has the name.
                pub fn $kind(&self, name: &str) -> Result<usize, ModelError> {
                    index_of(self.$list.iter().map(|element| &element.name[..]), stringify!($kind), name)
                }
            )*
        }
    };
}

lookups! {
    /// Index of the body with the name `name`.
    body: bodies;
    /// Index of the geom with the name `name`.
    geom: geoms;
    /// Index of the explicit pair with the name `name`.
    pair: pairs;
    /// Index of the site with the name `name`.
    site: sites;
    /// Index of the actuator with the name `name`. It is also its index in the controls.
    actuator: actuators;
    /// Index of the fixed tendon with the name `name`.
    tendon: tendons;
    /// Index of the equality with the name `name`.
    equality: equalities;
    /// Index of the keyframe with the name `name`.
    keyframe: keyframes;
}

impl Description {
    /// Index of the joint with the name `name`, and its ranges in configurations and velocities.
    ///
    /// # Errors
    /// [`ModelError::NoSuchName`] if no joint has the name.
    pub fn joint(&self, name: &str) -> Result<JointPlace, ModelError> {
        let index = index_of(self.joints.iter().map(|joint| &joint.name[..]), "joint", name)?;
        let ((q, v), kind) = (self.joint_addresses()[index], self.joints[index].kind);
        Ok(JointPlace { index, qpos: q..q + kind.nq(), qvel: v..v + kind.nv() })
    }

    /// Index of the sensor with the name `name`, and its range in the readings.
    ///
    /// # Errors
    /// [`ModelError::NoSuchName`] if no sensor has the name.
    pub fn sensor(&self, name: &str) -> Result<SensorPlace, ModelError> {
        let index = index_of(self.sensors.iter().map(|sensor| &sensor.name[..]), "sensor", name)?;
        let first = self.sensor_addresses()[index];
        Ok(SensorPlace { index, readings: first..first + self.sensors[index].dim(&self.sensors) })
    }
}

/// Index of the first element with the name `name`. Elements without a name are never found. `kind` is the kind of element, for the error.
fn index_of<'a>(names: impl Iterator<Item = &'a str> + Clone, kind: &'static str, name: &str) -> Result<usize, ModelError> {
    names.clone().position(|known| known == name && !name.is_empty()).ok_or_else(|| {
        let mut known: Vec<String> = names.filter(|known| !known.is_empty()).take(LISTED + 1).map(str::to_owned).collect();
        if known.len() > LISTED {
            known[LISTED] = "...".into();
        }
        ModelError::NoSuchName { kind, name: name.into(), known }
    })
}
