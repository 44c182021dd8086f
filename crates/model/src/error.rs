//! Errors of models. Each has the reason, the place in the model, and the remedy.

use thiserror::Error;

use crate::Omission;

/// Error of a model that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum ModelError {
    /// Invalid value.
    #[error("{place}: {what}; {remedy}")]
    Invalid {
        /// Reason, with the invalid value.
        what: String,
        /// Kind and name of the element, such as `body "torso"`.
        place: String,
        /// Remedy, such as "give a mass of at least 0".
        remedy: String,
    },
    /// Elements of a scene that stepper does not simulate yet and that would change the motion.
    #[error("{}", list(.0))]
    Unsupported(
        /// All elements that are not simulated and would change the motion.
        Vec<Omission>,
    ),
    /// Name that no element of the given kind has.
    #[error("there is no {kind} {name:?} in the model; {}", there_are(known))]
    NoSuchName {
        /// Kind of element, such as "joint".
        kind: &'static str,
        /// Name that was given.
        name: String,
        /// Names of the existing elements of this kind. If there are many, the list has only the first names, and then "...".
        known: Vec<String>,
    },
    /// File that cannot be read or written. Or a file, or bytes in memory, that are not a model of a supported version.
    #[error("{path}: {what}; {remedy}")]
    File {
        /// Reason, such as "cut off after 12 bytes".
        what: String,
        /// Path of the file, or "saved model" for bytes in memory.
        path: String,
        /// Remedy, such as "copy the file again".
        remedy: String,
    },
}

impl ModelError {
    pub(super) fn invalid(place: impl Into<String>, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::Invalid { what: what.into(), place: place.into(), remedy: remedy.into() }
    }

    /// Adds the text `whole` in front of the element's label in an error of the variant `Invalid`, for example `environment 3: body
    /// "torso"`. Other errors are returned unchanged.
    pub fn of(self, whole: &str) -> Self {
        match self {
            Self::Invalid { what, place, remedy } => Self::Invalid { what, place: format!("{whole}: {place}"), remedy },
            other => other,
        }
    }

    pub(super) fn file(path: impl Into<String>, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::File { what: what.into(), path: path.into(), remedy: remedy.into() }
    }
}

fn list(omissions: &[Omission]) -> String {
    let lines: String = omissions.iter().map(|o| format!("\n  {} {}: {}", o.kind, o.name, o.reason)).collect();
    let (n, noun) = (omissions.len(), if omissions.len() == 1 { "element" } else { "elements" });
    format!("the model uses {n} {noun} that stepper does not simulate yet:{lines}\nremove them, or leave them out with finish(false)")
}

fn there_are(known: &[String]) -> String {
    if known.is_empty() { "none has a name".into() } else { format!("there are: {}", known.join(", ")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invalid_tells_where_what_and_remedy() {
        let text = ModelError::invalid("body \"arm\"", "mass is -1 kg", "give a mass of at least 0").to_string();
        assert_eq!(text, "body \"arm\": mass is -1 kg; give a mass of at least 0");
    }

    #[test]
    fn unsupported_lists_every_element() {
        let omission = |kind: &str, name: &str| Omission {
            kind: kind.into(),
            name: name.into(),
            reason: "it is not simulated yet".into(),
            changes_motion: true,
        };
        let text = ModelError::Unsupported(vec![omission("equality weld", "grip"), omission("joint limit", "#3")]).to_string();
        for part in ["2 elements", "equality weld grip", "joint limit #3", "finish(false)"] {
            assert!(text.contains(part), "{part} in {text}");
        }
    }
}
