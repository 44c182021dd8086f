//! Search for elements of a model by name or index.

use pyo3::exceptions::{PyIndexError, PyKeyError, PyTypeError};
use pyo3::prelude::*;
use stepper_core::model::Model as Core;

use crate::array::described;

/// Kinds of elements that have names.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Body,
    Joint,
    Geom,
    Pair,
    Site,
    Actuator,
    Sensor,
    Tendon,
    Keyframe,
}

impl Kind {
    const fn word(self) -> &'static str {
        match self {
            Self::Body => "body",
            Self::Joint => "joint",
            Self::Geom => "geom",
            Self::Pair => "pair",
            Self::Site => "site",
            Self::Actuator => "actuator",
            Self::Sensor => "sensor",
            Self::Tendon => "tendon",
            Self::Keyframe => "keyframe",
        }
    }

    /// Names of all elements of this kind, in order. The name of an unnamed element is empty.
    pub(crate) fn names(self, model: &Core) -> Vec<&str> {
        match self {
            Self::Body => model.bodies.iter().map(|x| x.name.as_str()).collect(),
            Self::Joint => model.joints.iter().map(|x| x.name.as_str()).collect(),
            Self::Geom => model.geoms.iter().map(|x| x.name.as_str()).collect(),
            Self::Pair => model.pairs.iter().map(|x| x.name.as_str()).collect(),
            Self::Site => model.sites.iter().map(|x| x.name.as_str()).collect(),
            Self::Actuator => model.actuators.iter().map(|x| x.name.as_str()).collect(),
            Self::Sensor => model.sensors.iter().map(|x| x.name.as_str()).collect(),
            Self::Tendon => model.tendons.iter().map(|x| x.name.as_str()).collect(),
            Self::Keyframe => model.keyframes.iter().map(|x| x.name.as_str()).collect(),
        }
    }

    /// Index of the element of this kind that a name or an index selects. Negative indices count from the end.
    pub(crate) fn find(self, model: &Core, given: &Bound<'_, PyAny>) -> PyResult<usize> {
        let (word, names) = (self.word(), self.names(model));
        if let Ok(name) = given.extract::<String>() {
            let found = names.iter().position(|known| *known == name && !name.is_empty());
            return match found {
                Some(index) => Ok(index),
                None => {
                    let text: String = given.py().import("stepper._hints")?.call_method1("unknown", (word, name, names))?.extract()?;
                    Err(PyKeyError::new_err(text))
                }
            };
        }
        let index = given.py().import("operator")?.call_method1("index", (given,));
        let index = index
            .map_err(|_| PyTypeError::new_err(format!("{word}, if it is no name, is {}, must be a whole number", described(given))))?;
        let n = names.len() as isize;
        let at = index.extract::<isize>().ok().map(|i| if i < 0 { i.saturating_add(n) } else { i });
        match at {
            Some(at) if (0..n).contains(&at) => Ok(at as usize),
            _ => Err(PyIndexError::new_err(format!("{word} is {index}, must be below {n}"))),
        }
    }
}
