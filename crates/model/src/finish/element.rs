//! Elements of a model with the names that errors use, and common checks of their values.

use std::fmt::Display;

use crate::description::{Description, JointKind, label};
use crate::error::ModelError;
use crate::softness::{ContactSpring, Softness};

pub(crate) type Checked = Result<(), ModelError>;

/// Dimensions that a contact may have: frictionless, sliding, torsional, rolling.
const DIMENSIONS: [u8; 4] = [1, 3, 4, 6];

/// Element of a model, represented by its label in errors, such as `body "torso"`.
pub(crate) struct Element(pub(crate) String);

/// Elements of a list, each with its label for errors. `name` returns the name of an element.
pub(crate) fn elements<'a, T>(kind: &'a str, list: &'a [T], name: fn(&T) -> &str) -> impl Iterator<Item = (Element, &'a T)> {
    list.iter().enumerate().map(move |(i, element)| (Element::new(kind, name(element), i), element))
}

impl Element {
    pub(crate) fn new(kind: &str, name: &str, index: usize) -> Self {
        Self(format!("{kind} {:?}", label(name, index)))
    }

    pub(crate) fn fail(&self, what: impl Into<String>, remedy: impl Into<String>) -> Checked {
        Err(ModelError::invalid(&self.0, what, remedy))
    }

    /// Fails if `wrong` is true. `what` and `remedy` are formatted only then, see [`format_args`].
    pub(crate) fn fail_if(&self, wrong: bool, what: impl Display, remedy: impl Display) -> Checked {
        if wrong { self.fail(what.to_string(), remedy.to_string()) } else { Ok(()) }
    }

    pub(crate) fn finite(&self, what: &str, x: &[f64]) -> Checked {
        self.fail_if(x.iter().any(|v| !v.is_finite()), format_args!("{what} is {x:?}"), "give finite numbers")
    }

    /// Checks that all values are finite and at least 0. An error contains the name `what` of the quantity, and its unit.
    pub(crate) fn size(&self, what: &str, x: &[f64], unit: &str) -> Checked {
        let wrong = x.iter().find(|v| !v.is_finite() || **v < 0.0);
        wrong.map_or(Ok(()), |v| self.fail(format!("{what} is {v}{unit}"), "give a finite number of at least 0"))
    }

    /// Checks that all values are finite and above 0. An error contains the name `what` of the quantity, and its unit.
    pub(crate) fn positive(&self, what: &str, x: &[f64], unit: &str) -> Checked {
        let wrong = x.iter().find(|v| !v.is_finite() || **v <= 0.0);
        wrong.map_or(Ok(()), |v| self.fail(format!("{what} is {v}{unit}"), "give a finite number greater than 0"))
    }

    /// Checks that the lower end of a range is not above the upper end. Infinite ends are allowed. An error contains the name `what` of the
    /// range.
    pub(crate) fn range(&self, what: &str, range: Option<[f64; 2]>) -> Checked {
        let Some([low, high]) = range else { return Ok(()) };
        let (wrong, remedy) = if low.is_nan() || high.is_nan() {
            ("", "give numbers")
        } else if low > high {
            (", with the lower bound above the upper bound", "give the lower bound first, or no range")
        } else if low == f64::INFINITY || high == f64::NEG_INFINITY {
            (", which contains no number", "give finite bounds, or -inf as the lower and inf as the upper one")
        } else {
            return Ok(());
        };
        self.fail(format!("{what} is [{low}, {high}]{wrong}"), remedy)
    }

    pub(crate) fn index(&self, what: &str, index: usize, count: usize) -> Checked {
        let remedy = format_args!("give the index of a {what} of this model, counted from 0");
        self.fail_if(index >= count, format_args!("refers to {what} {index} of {count}"), remedy)
    }

    /// Checks that the indices of two elements of the kind `kind` differ. `label` returns the label of such an element.
    pub(crate) fn distinct(&self, kind: &str, [a, b]: [usize; 2], label: impl Fn(usize) -> String, remedy: &str) -> Checked {
        if a == b { self.fail(format!("both elements are {kind} {:?}", label(a)), remedy) } else { Ok(()) }
    }

    pub(crate) fn length(&self, what: &str, x: &[f64], expected: usize, sum: &str) -> Checked {
        if x.len() == expected {
            return self.finite(what, x);
        }
        self.fail(format!("{what} has length {}", x.len()), format!("give {expected} numbers: {sum}"))
    }

    /// Checks that the joint with index `joint` is a hinge or slide.
    pub(crate) fn scalar_joint(&self, model: &Description, joint: usize) -> Checked {
        self.index("joint", joint, model.joints.len())?;
        let kind = model.joints[joint].kind;
        if matches!(kind, JointKind::Slide | JointKind::Hinge) {
            return Ok(());
        }
        let what = format!("refers to joint {:?}, a {} joint", model.joint_label(joint), kind.name());
        self.fail(what, "refer to a hinge or slide")
    }

    /// Checks a softness in MuJoCo's contact law.
    pub(crate) fn softness(&self, softness: &Softness) -> Checked {
        self.finite("solref", &softness.solref)?;
        self.finite("solimp", &softness.solimp)
    }

    /// Checks stiffness and damping of a compliant contact.
    pub(crate) fn spring(&self, spring: ContactSpring) -> Checked {
        let ContactSpring { stiffness, damping } = spring;
        let remedy = "give a number above 0, infinity for a rigid surface";
        self.fail_if(stiffness.is_nan() || stiffness <= 0.0, format_args!("stiffness is {stiffness} N/m"), remedy)?;
        self.size("damping", &[damping], " N s/m")?;
        let what = format_args!("damping is {damping} N s/m, but the surface is rigid");
        self.fail_if(spring.is_rigid() && damping > 0.0, what, "give a finite stiffness too")
    }

    pub(crate) fn contact(&self, condim: u8, friction: &[f64], restitution: f64, margin: f64, gap: f64) -> Checked {
        let remedy = "give 1 (frictionless), 3 (sliding), 4 (torsional) or 6 (rolling)";
        self.fail_if(!DIMENSIONS.contains(&condim), format_args!("condim is {condim}"), remedy)?;
        self.size("friction", friction, "")?;
        let remedy = "give a number from 0 (no bounce) to 1 (elastic)";
        self.fail_if(!(0.0..=1.0).contains(&restitution), format_args!("restitution is {restitution}"), remedy)?;
        self.finite("margin", &[margin])?;
        self.size("gap", &[gap], " m")
    }
}
