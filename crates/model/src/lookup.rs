//! Lookup of elements by name.

use std::ops::Range;

use crate::{Description, ModelError, label};

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

/// Declares [`ElementKind`] from its variants, each with the name of the kind and the list of its elements. Also declares functions of
/// [`Description`] for each kind: the lookup by name, and the label of an element.
macro_rules! element_kinds {
    ($($(#[$doc:meta])* $kind:ident = $word:literal in $list:ident: $lookup:ident, $label:ident;)*) => {
        named! {
            /// Kind of the elements of a model that have names.
            pub enum ElementKind {
                $(#[doc = concat!("Elements in [`Description::", stringify!($list), "`].")] $kind = $word,)*
            }
        }

        impl ElementKind {
            /// Names of all elements of this kind, in order. The name of an unnamed element is empty.
            pub fn names(self, model: &Description) -> Vec<&str> {
                match self {
                    $(Self::$kind => model.$list.iter().map(|element| element.name.as_str()).collect(),)*
                }
            }
        }

        impl Description {
            $(
                $(#[$doc])*
                ///
                /// # Errors
                /// [`ModelError::NoSuchName`] if no element of this kind has the name.
                pub fn $lookup(&self, name: &str) -> Result<usize, ModelError> {
                    index_of(self, ElementKind::$kind, name)
                }

                #[doc = concat!("Label of ", $word, " `i`: its name, or \"#3\" for an element without a name or an index out of range.")]
                pub fn $label(&self, i: usize) -> String {
                    label(self.$list.get(i).map_or("", |element| &element.name), i)
                }
            )*
        }
    };
}

element_kinds! {
    /// Index of the body with the name `name`.
    Body = "body" in bodies: body, body_label;
    /// Index of the joint with the name `name`.
    Joint = "joint" in joints: joint_index, joint_label;
    /// Index of the geom with the name `name`.
    Geom = "geom" in geoms: geom, geom_label;
    /// Index of the explicit pair with the name `name`.
    Pair = "pair" in pairs: pair, pair_label;
    /// Index of the site with the name `name`.
    Site = "site" in sites: site, site_label;
    /// Index of the actuator with the name `name`. It is also its index in the controls.
    Actuator = "actuator" in actuators: actuator, actuator_label;
    /// Index of the sensor with the name `name`.
    Sensor = "sensor" in sensors: sensor_index, sensor_label;
    /// Index of the fixed tendon with the name `name`.
    Tendon = "tendon" in tendons: tendon, tendon_label;
    /// Index of the equality with the name `name`.
    Equality = "equality" in equalities: equality, equality_label;
    /// Index of the keyframe with the name `name`.
    Keyframe = "keyframe" in keyframes: keyframe, keyframe_label;
}

impl Description {
    /// Index of the joint with the name `name`, and its ranges in configurations and velocities.
    ///
    /// # Errors
    /// [`ModelError::NoSuchName`] if no joint has the name.
    pub fn joint(&self, name: &str) -> Result<JointPlace, ModelError> {
        let index = self.joint_index(name)?;
        let ((q, v), kind) = (self.joint_addresses()[index], self.joints[index].kind);
        Ok(JointPlace { index, qpos: q..q + kind.nq(), qvel: v..v + kind.nv() })
    }

    /// Index of the sensor with the name `name`, and its range in the readings.
    ///
    /// # Errors
    /// [`ModelError::NoSuchName`] if no sensor has the name.
    pub fn sensor(&self, name: &str) -> Result<SensorPlace, ModelError> {
        let index = self.sensor_index(name)?;
        let first = self.sensor_addresses()[index];
        Ok(SensorPlace { index, readings: first..first + self.sensors[index].dim(&self.sensors) })
    }
}

/// Index of the first element of the kind `kind` with the name `name`. Elements without a name are never found.
fn index_of(model: &Description, kind: ElementKind, name: &str) -> Result<usize, ModelError> {
    let names = kind.names(model);
    names.iter().position(|known| *known == name && !name.is_empty()).ok_or_else(|| {
        let mut known: Vec<String> = names.into_iter().filter(|known| !known.is_empty()).take(LISTED + 1).map(str::to_owned).collect();
        if known.len() > LISTED {
            known[LISTED] = "...".into();
        }
        ModelError::NoSuchName { kind: kind.name(), name: name.into(), known }
    })
}
