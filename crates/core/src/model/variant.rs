//! Variants of a model: other numbers, the same structure. What environments of one batch may differ in.

use super::replace::{find, write};
use super::{Actuator, Body, Field, Geom, Joint, Model, ModelError, label};

/// Names of the fields of [`REPLACEABLE`](super::REPLACEABLE) that environments may each have for themselves.
pub const RANDOMIZABLE: &[&str] = &[
    "gravity",
    "body_mass",
    "body_ipos",
    "body_inertia",
    "geom_friction",
    "geom_restitution",
    "geom_size",
    "geom_pos",
    "jnt_stiffness",
    "jnt_range",
    "dof_damping",
    "dof_armature",
    "dof_frictionloss",
    "actuator_gain",
    "actuator_bias",
];

/// Models that differ from one in the numbers of some fields, made one after the other in the same place: assets are copied once.
pub(crate) struct Variants<'a> {
    base: &'a Model,
    model: Model,
    fields: Vec<&'static Field>,
}

impl<'a> Variants<'a> {
    /// Variants in these fields.
    pub(crate) fn new<'n>(base: &'a Model, names: impl IntoIterator<Item = &'n str>) -> Result<Self, ModelError> {
        let fields = names.into_iter().map(randomizable).collect::<Result<_, _>>()?;
        Ok(Self { base, model: base.clone(), fields })
    }

    /// The variant with these numbers, field by field.
    ///
    /// # Errors
    /// As [`Model::replace`], and [`ModelError::Invalid`] where a number would give the model rows or terms that the base does not have.
    pub(crate) fn with<'v>(&mut self, values: impl IntoIterator<Item = &'v [f64]>) -> Result<&Model, ModelError> {
        for (field, values) in self.fields.iter().zip(values) {
            write(&mut self.model, field, values)?;
        }
        self.model.check_parameters()?;
        same_structure(self.base, &self.model)?;
        self.model.check_inertia()?;
        Ok(&self.model)
    }
}

/// The field of that name.
///
/// # Errors
/// [`ModelError::Invalid`] when there is none, or when it is the same in all environments.
pub(crate) fn randomizable(name: &str) -> Result<&'static Field, ModelError> {
    let field = find(name)?;
    if RANDOMIZABLE.contains(&name) {
        return Ok(field);
    }
    let what = "it is the same in all environments of a Stepper";
    let remedy = format!("choose one of: {}; or make a Stepper of model.replace({name}=...)", RANDOMIZABLE.join(", "));
    Err(ModelError::invalid(format!("field {name:?}"), what, remedy))
}

/// What a plan leaves out of a model because of its numbers must be left out of its variants too.
fn same_structure(base: &Model, model: &Model) -> Checked {
    base.joints.iter().zip(&model.joints).enumerate().try_for_each(|(i, (old, new))| joint(i, old, new))?;
    base.bodies.iter().zip(&model.bodies).enumerate().try_for_each(|(i, (old, new))| body(i, old, new))?;
    base.geoms.iter().zip(&model.geoms).enumerate().try_for_each(|(i, (old, new))| geom(i, old, new))?;
    base.actuators.iter().zip(&model.actuators).enumerate().try_for_each(|(i, (old, new))| actuator(i, old, new))
}

type Checked = Result<(), ModelError>;

/// `field` of the element `place` is `new`, which asks for something that the model lacks.
fn lacks(place: String, field: &str, new: &str, lack: &str, first: &str) -> Checked {
    let remedy = format!("give the model {first} there first, with model.replace({field}=...), and make the Stepper of that");
    Err(ModelError::invalid(place, format!("{field} is {new}, and the model has {lack}"), remedy))
}

fn joint(i: usize, old: &Joint, new: &Joint) -> Checked {
    let place = || format!("joint {:?}", label(&new.name, i));
    if new.frictionloss > 0.0 && old.frictionloss == 0.0 {
        return lacks(place(), "dof_frictionloss", &new.frictionloss.to_string(), "no dry friction there", "some");
    }
    if new.stiffness != 0.0 && old.stiffness == 0.0 {
        return lacks(place(), "jnt_stiffness", &new.stiffness.to_string(), "no spring there", "one");
    }
    match (old.range, new.range) {
        (None, Some(range)) => lacks(place(), "jnt_range", &format!("{range:?}"), "no limit there", "one"),
        (Some(range), None) => {
            let what = format!("jnt_range is no limit, and the model has one of {range:?} there");
            Err(ModelError::invalid(place(), what, "give a range that is never reached"))
        }
        _ => Ok(()),
    }
}

fn body(i: usize, old: &Body, new: &Body) -> Checked {
    if (old.mass > 0.0) == (new.mass > 0.0) {
        return Ok(());
    }
    let what = format!("body_mass is {} kg, and the model's is {} kg", new.mass, old.mass);
    let remedy = "give every body that has mass in the model some, however little, and the others none";
    Err(ModelError::invalid(format!("body {:?}", label(&new.name, i)), what, remedy))
}

fn geom(i: usize, old: &Geom, new: &Geom) -> Checked {
    if old.shape == new.shape || new.fluid.is_none() {
        return Ok(());
    }
    let what = "geom_size differs from the model's, and the medium acts on the geom as an ellipsoid, whose forces would not follow";
    let remedy = "leave its size as it is, or take fluidshape=\"ellipsoid\" from it";
    Err(ModelError::invalid(format!("geom {:?}", label(&new.name, i)), what, remedy))
}

fn actuator(i: usize, old: &Actuator, new: &Actuator) -> Checked {
    let moves = |a: &Actuator| [a.gain[1], a.gain[2], a.bias[1], a.bias[2]].iter().any(|&x| x != 0.0);
    if !moves(new) || moves(old) {
        return Ok(());
    }
    let (place, new) = (format!("actuator {:?}", label(&new.name, i)), format!("{:?}", new.bias));
    let lack = "an actuator there whose force does not depend on its length or velocity";
    lacks(place, "actuator_bias", &new, lack, "a small number in place of a 0")
}
