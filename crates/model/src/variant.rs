//! Variants of a model for the environments of a batch: models with the same structure and other values.

use std::str::FromStr;

use crate::finish::{Checked, Element, check_inertia, check_parameters, normalise_welds};
use crate::overridden_geom_fields::OverriddenGeomFields;
use crate::replace::{find, write};
use crate::{Actuator, Body, Field, Geom, Joint, Model, ModelError};

named! {
    /// Field of [`REPLACEABLE`](crate::REPLACEABLE) that can differ between environments, see `Simulation::randomize`.
    ///
    /// `"body_mass".parse()` returns the parameter for the field with this name.
    #[derive(Hash)]
    #[non_exhaustive]
    pub enum Parameter {
        /// Gravitational acceleration in the world frame, m/s^2: (num_envs, 3).
        Gravity = "gravity",
        /// Masses of the bodies, kg: (num_envs, nbody). Their inertia does not change.
        BodyMass = "body_mass",
        /// Centres of mass of the bodies in their frames, m: (num_envs, nbody, 3).
        BodyIpos = "body_ipos",
        /// Principal moments of inertia of the bodies, kg m^2: (num_envs, nbody, 3).
        BodyInertia = "body_inertia",
        /// Sliding, torsional (m) and rolling (m) friction coefficients of the geoms: (num_envs, ngeom, 3).
        GeomFriction = "geom_friction",
        /// Coefficients of restitution of the geoms: (num_envs, ngeom).
        GeomRestitution = "geom_restitution",
        /// Sliding, torsional (m) and rolling (m) friction coefficients of explicit pairs: (num_envs, npair, 3).
        PairFriction = "pair_friction",
        /// Coefficients of restitution of explicit pairs: (num_envs, npair).
        PairRestitution = "pair_restitution",
        /// Sizes of the geoms in the order of `geom_size`, m: (num_envs, ngeom, 3). Masses do not change.
        GeomSize = "geom_size",
        /// Positions of the geoms in their bodies' frames, m: (num_envs, ngeom, 3). Masses do not change.
        GeomPos = "geom_pos",
        /// Spring stiffness of the joints, N/m or N m/rad: (num_envs, njnt).
        JointStiffness = "jnt_stiffness",
        /// Lowest and highest positions of the joints, m or rad: (num_envs, njnt, 2).
        JointRange = "jnt_range",
        /// Viscous damping of the degrees of freedom, N s/m or N m s/rad: (num_envs, nv).
        DofDamping = "dof_damping",
        /// Armature of the degrees of freedom, which is added to the diagonal of the mass matrix, kg or kg m^2: (num_envs, nv).
        DofArmature = "dof_armature",
        /// Dry friction of the degrees of freedom, N or N m: (num_envs, nv).
        DofFrictionLoss = "dof_frictionloss",
        /// Numbers of the equalities in the layout of MuJoCo's `eq_data`: (num_envs, neq, 11).
        EqualityData = "eq_data",
        /// Gain parameters of the actuators: (num_envs, nu, 10).
        ActuatorGain = "actuator_gainprm",
        /// Bias parameters of the actuators: (num_envs, nu, 10).
        ActuatorBias = "actuator_biasprm",
    }
}

impl FromStr for Parameter {
    type Err = ModelError;

    /// Parameter for the model field with the name `name`.
    ///
    /// # Errors
    /// [`ModelError::Invalid`] if no field has this name, or if the field cannot differ between environments.
    fn from_str(name: &str) -> Result<Self, ModelError> {
        find(name)?;
        Self::ALL.into_iter().find(|parameter| parameter.name() == name).ok_or_else(|| {
            let what = "it is the same in all environments of a simulation";
            let known = Self::ALL.map(Self::name).join(", ");
            let remedy = format!("choose one of: {known}; or make a simulation of model.replace({name:?}, ..)");
            ModelError::invalid(format!("field {name:?}"), what, remedy)
        })
    }
}

/// Factory of variants of a model that differ in the values of some fields. All variants use the same copy of the model, so that assets are
/// copied only once.
pub struct Variants<'a> {
    base: &'a Model,
    model: Model,
    fields: Vec<&'static Field>,
    /// Check of new values of geom fields: for a geom whose explicit pair overrides the field, a new value is an error.
    overridden_fields: OverriddenGeomFields<'a>,
}

impl<'a> Variants<'a> {
    /// Prepares variants of `base` in which the fields `names` change.
    ///
    /// # Errors
    /// [`ModelError::Invalid`] for a name that is not a field.
    pub fn new<'n>(base: &'a Model, names: impl IntoIterator<Item = &'n str>) -> Result<Self, ModelError> {
        let fields: Vec<&'static Field> = names.into_iter().map(find).collect::<Result<_, _>>()?;
        let overridden_fields = OverriddenGeomFields::new(base, fields.iter().map(|field| field.name));
        Ok(Self { base, model: base.clone(), fields, overridden_fields })
    }

    /// Variant of the model with new values. `values` has the new values of each field, in the order of the names in [`Variants::new`].
    ///
    /// A field with `None` in `values` gets the values of the base model. `base_values` has these values for each field, in the same order.
    ///
    /// # Errors
    /// Those of [`Model::replace`]. [`ModelError::Invalid`] also if the structure of the compiled base model does not fit. For example, a
    /// value needs a constraint row or a force that the base model does not have, or removes a joint limit.
    pub fn with(&mut self, values: &[Option<&[f64]>], base_values: &[Vec<f64>]) -> Result<&Model, ModelError> {
        let mut given = Vec::with_capacity(values.len());
        for ((field, values), base_values) in self.fields.iter().zip(values).zip(base_values) {
            write(&mut self.model.description, field, values.unwrap_or(base_values))?;
            given.extend(values.map(|values| (field.name, values)));
        }
        self.overridden_fields.check(&given)?;
        normalise_welds(&mut self.model.description)?;
        check_parameters(&self.model)?;
        same_structure(self.base, &self.model)?;
        check_inertia(&self.model)?;
        Ok(&self.model)
    }
}

/// Checks that the structure compiled from `base` fits the variant `model`. The same joints must have limits, and the same bodies mass.
/// Geoms with fluid forces must keep their sizes. No dry friction, spring or servo may be new.
fn same_structure(base: &Model, model: &Model) -> Checked {
    base.joints.iter().zip(&model.joints).enumerate().try_for_each(|(i, (old, new))| joint(i, old, new))?;
    base.bodies.iter().zip(&model.bodies).enumerate().try_for_each(|(i, (old, new))| body(i, old, new))?;
    base.geoms.iter().zip(&model.geoms).enumerate().try_for_each(|(i, (old, new))| geom(i, old, new))?;
    base.actuators.iter().zip(&model.actuators).enumerate().try_for_each(|(i, (old, new))| actuator(i, old, new))
}

/// Error for a new value of a variant that needs a feature that the base model lacks.
///
/// `at` is the element, and `new` the new value of its field `field`. `lack` describes the missing feature, such as "no
/// spring there". `first` completes the remedy "first give the model ...".
fn lacks(at: Element, field: &str, new: &str, lack: &str, first: &str) -> Checked {
    let remedy = format!("first give the model {first}, with model.replace({field:?}, ..), and create the simulation of that model");
    at.fail(format!("{field} is {new}, and the model has {lack}"), remedy)
}

fn joint(i: usize, old: &Joint, new: &Joint) -> Checked {
    let at = || Element::new("joint", &new.name, i);
    if new.frictionloss > 0.0 && old.frictionloss == 0.0 {
        return lacks(at(), "dof_frictionloss", &new.frictionloss.to_string(), "no dry friction there", "some dry friction");
    }
    if new.stiffness != 0.0 && old.stiffness == 0.0 {
        return lacks(at(), "jnt_stiffness", &new.stiffness.to_string(), "no spring there", "a spring");
    }
    match (old.range, new.range) {
        (None, Some(range)) => lacks(at(), "jnt_range", &format!("{range:?}"), "no limit there", "a limit"),
        (Some(range), None) => {
            let what = format!("jnt_range is infinite, but the model limits this joint to {range:?}");
            at().fail(what, "give a finite range that the joint never reaches")
        }
        _ => Ok(()),
    }
}

fn body(i: usize, old: &Body, new: &Body) -> Checked {
    if (old.mass > 0.0) == (new.mass > 0.0) {
        return Ok(());
    }
    let what = format!("body_mass is {} kg, and {} kg in the model", new.mass, old.mass);
    let remedy = "give a mass above 0 to each body that has mass in the model, and 0 to all others";
    Element::new("body", &new.name, i).fail(what, remedy)
}

fn geom(i: usize, old: &Geom, new: &Geom) -> Checked {
    if old.shape == new.shape || new.fluid.is_none() {
        return Ok(());
    }
    let what = "geom_size differs from the model's, but the geom has fluidshape=\"ellipsoid\", and its fluid forces would not change";
    let remedy = "keep its size, or remove fluidshape=\"ellipsoid\"";
    Element::new("geom", &new.name, i).fail(what, remedy)
}

fn actuator(i: usize, old: &Actuator, new: &Actuator) -> Checked {
    let at = || Element::new("actuator", &new.name, i);
    if old.muscle != new.muscle {
        let what =
            "actuator_gainprm or actuator_biasprm differs from the model's, but the parameters of muscles are the same in all environments";
        return at().fail(what, "change them for all by model.replace");
    }
    if !new.force_depends_on_motion() || old.force_depends_on_motion() {
        return Ok(());
    }
    let (field, row) = if new.gain == old.gain { ("actuator_biasprm", new.bias) } else { ("actuator_gainprm", new.gain) };
    let lack = "an actuator there whose force does not depend on its length or velocity";
    lacks(at(), field, &format!("{row:?}"), lack, "a small number in place of a 0")
}
