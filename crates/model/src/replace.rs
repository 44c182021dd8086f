//! Fields of a model that can be read and replaced, as a table.

use crate::actuator_fields::{self, GEAR, PARAMETERS};
use crate::overridden_geom_fields::OverriddenGeomFields;
use crate::{Actuator, Description, Geom, Model, ModelError, Shape};

/// Function that calls a visitor for every value of a field, in order. The visitor may change the value.
type Visit = fn(&mut Description, &mut dyn FnMut(&mut f64));

/// Part of a description with one or more numbers, which a visitor can read and change.
trait Visited {
    /// Calls `f` for each value, in order.
    fn visit(&mut self, f: &mut dyn FnMut(&mut f64));
}

impl Visited for f64 {
    fn visit(&mut self, f: &mut dyn FnMut(&mut f64)) {
        f(self);
    }
}

impl Visited for [f64] {
    fn visit(&mut self, f: &mut dyn FnMut(&mut f64)) {
        self.iter_mut().for_each(f);
    }
}

/// Range, whose values are its ends. A missing range has the ends -inf and inf.
impl Visited for Option<[f64; 2]> {
    fn visit(&mut self, f: &mut dyn FnMut(&mut f64)) {
        const NONE: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];
        let mut ends = self.unwrap_or(NONE);
        ends.visit(f);
        *self = (ends != NONE).then_some(ends);
    }
}

/// Calls `f` with the number `x` that stands for a value. Returns the number, which `f` may have changed.
fn visited(mut x: f64, f: &mut dyn FnMut(&mut f64)) -> f64 {
    f(&mut x);
    x
}

/// Limit. A missing limit is infinity.
impl Visited for Option<f64> {
    fn visit(&mut self, f: &mut dyn FnMut(&mut f64)) {
        let value = visited(self.unwrap_or(f64::INFINITY), f);
        *self = (value != f64::INFINITY).then_some(value);
    }
}

/// Flag as the number 0 or 1. Any new value other than 0 sets the flag.
impl Visited for bool {
    fn visit(&mut self, f: &mut dyn FnMut(&mut f64)) {
        *self = visited(f64::from(u8::from(*self)), f) != 0.0;
    }
}

/// Integer. A new value is truncated to an integer, and clamped to the range of the integer type.
impl Visited for u8 {
    fn visit(&mut self, f: &mut dyn FnMut(&mut f64)) {
        *self = visited(f64::from(*self), f) as Self;
    }
}

/// Integer. A new value is truncated to an integer, and clamped to the range of the integer type.
impl Visited for u32 {
    fn visit(&mut self, f: &mut dyn FnMut(&mut f64)) {
        *self = visited(f64::from(*self), f) as Self;
    }
}

/// Visit of one field of the description, such as `only!(medium.wind)`.
macro_rules! only {
    ($($field:ident).+) => {
        |m, f| m.$($field).+.visit(f)
    };
}

/// Visit of one field of each element in a list of the description, such as `each!(geoms, softness.solref)`.
macro_rules! each {
    ($list:ident, $($field:ident).+) => {
        |m, f| m.$list.iter_mut().for_each(|element| element.$($field).+.visit(f))
    };
}

/// Visit of one field of each joint, once for each degree of freedom of the joint. The field has one value for the whole joint: the value
/// that the visitor writes for the last degree of freedom remains.
macro_rules! each_dof {
    ($($field:ident).+) => {
        |m, f| {
            for joint in &mut m.joints {
                let now = joint.$($field).+;
                for _ in 0..joint.kind.nv() {
                    joint.$($field).+ = now;
                    joint.$($field).+.visit(f);
                }
            }
        }
    };
}

/// Field of a model: a named array of values, which can be read and replaced.
#[derive(Clone, Copy, Debug)]
pub struct Field {
    /// Name of the field: MuJoCo's name, if MuJoCo has such a field.
    pub name: &'static str,
    /// Name of the quantity, such as "mass".
    pub what: &'static str,
    /// Unit of the values. The text is empty if the values have no unit, or if their units differ.
    pub unit: &'static str,
    /// Number of values per element; `None` for a scalar field.
    width: Option<usize>,
    visit: Visit,
}

const fn scalar(name: &'static str, what: &'static str, unit: &'static str, visit: Visit) -> Field {
    Field { name, what, unit, width: None, visit }
}

const fn rows(name: &'static str, width: usize, what: &'static str, unit: &'static str, visit: Visit) -> Field {
    Field { name, what, unit, width: Some(width), visit }
}

/// Table of all fields that [`Model::replace`] writes and [`Model::field`] reads.
pub const REPLACEABLE: &[Field] = &[
    rows("gravity", 1, "gravitational acceleration", "m/s^2", only!(gravity)),
    scalar("timestep", "default time step", "s", only!(timestep)),
    rows("qpos0", 1, "configuration at reset", "m or rad", only!(qpos0)),
    rows("qpos_spring", 1, "configuration in which springs rest", "m or rad", only!(qpos_spring)),
    scalar("density", "density of the medium", "kg/m^3", only!(medium.density)),
    scalar("viscosity", "viscosity of the medium", "Pa s", only!(medium.viscosity)),
    rows("wind", 1, "velocity of the medium", "m/s", only!(medium.wind)),
    rows("body_gravcomp", 1, "fraction of the body's weight that is compensated", "", each!(bodies, gravcomp)),
    rows("geom_surfacevel", 6, "velocity of the surface", "m/s and rad/s", each!(geoms, surface_velocity)),
    rows("body_mass", 1, "mass", "kg", each!(bodies, mass)),
    rows("body_inertia", 3, "principal moments of inertia", "kg m^2", each!(bodies, inertia)),
    rows("body_ipos", 3, "centre of mass in the body's frame", "m", each!(bodies, ipos)),
    rows("body_iquat", 4, "orientation of the principal axes", "", each!(bodies, iquat)),
    rows("body_pos", 3, "position in the parent's frame", "m", each!(bodies, pos)),
    rows("body_quat", 4, "orientation in the parent's frame", "", each!(bodies, quat)),
    rows("geom_friction", 3, "sliding (1), torsional (m), rolling (m) friction", "1, m, m", each!(geoms, friction)),
    rows("geom_restitution", 1, "coefficient of restitution", "", each!(geoms, restitution)),
    rows("geom_margin", 1, "distance below which a contact pushes", "m", each!(geoms, margin)),
    rows("geom_gap", 1, "additional distance up to which contacts without force are listed", "m", each!(geoms, gap)),
    rows("geom_solref", 2, "reference acceleration of contacts by MuJoCo's law", "", each!(geoms, softness.solref)),
    rows("geom_solimp", 5, "impedance of contacts by MuJoCo's law", "", each!(geoms, softness.solimp)),
    rows("geom_solmix", 1, "weight of the geom's solref and solimp in a pair", "", each!(geoms, solmix)),
    rows("geom_stiffness", 1, "stiffness of the surface; infinity is rigid", "N/m", each!(geoms, spring.stiffness)),
    rows("geom_damping", 1, "damping of the surface", "N s/m", each!(geoms, spring.damping)),
    rows("pair_dim", 1, "rows of an explicit pair's contacts", "", each!(pairs, condim)),
    rows("pair_friction", 3, "sliding (1), torsional (m), rolling (m) friction of an explicit pair", "1, m, m", each!(pairs, friction)),
    rows(
        "pair_anisotropy",
        2,
        "ratio of the friction along the second tangent to that along the first, for sliding and rolling, by MuJoCo's law",
        "",
        each!(pairs, anisotropy),
    ),
    rows("pair_restitution", 1, "coefficient of restitution of an explicit pair", "", each!(pairs, restitution)),
    rows("pair_margin", 1, "distance below which a contact of an explicit pair pushes", "m", each!(pairs, margin)),
    rows("pair_gap", 1, "additional distance up to which contacts of an explicit pair without force are listed", "m", each!(pairs, gap)),
    rows("pair_solref", 2, "reference acceleration of an explicit pair's contacts by MuJoCo's law", "", each!(pairs, softness.solref)),
    rows(
        "pair_solreffriction",
        2,
        "solreffriction of an explicit pair by MuJoCo's law; zeros use solref",
        "",
        each!(pairs, solref_friction),
    ),
    rows("pair_solimp", 5, "impedance of an explicit pair's contacts by MuJoCo's law", "", each!(pairs, softness.solimp)),
    rows("pair_stiffness", 1, "stiffness of an explicit pair's contacts; infinity is rigid", "N/m", each!(pairs, spring.stiffness)),
    rows("pair_damping", 1, "damping of an explicit pair's contacts", "N s/m", each!(pairs, spring.damping)),
    rows("geom_size", 3, "radius, half length; or half sizes; or semi-axes; 0 where the shape has no number", "m", |m, f| {
        m.geoms.iter_mut().for_each(|g| size(g, f))
    }),
    rows("geom_pos", 3, "position in the body's frame", "m", each!(geoms, pos)),
    rows("geom_quat", 4, "orientation in the body's frame", "", each!(geoms, quat)),
    rows("geom_condim", 1, "rows of a contact", "", each!(geoms, condim)),
    rows("geom_concave", 1, "whether a mesh collides as its triangles (1) or as its convex hull (0)", "", |m, f| {
        m.geoms.iter_mut().for_each(|g| match &mut g.shape {
            Shape::Mesh { concave, .. } => concave.visit(f),
            _ => false.visit(f),
        });
    }),
    rows("jnt_stiffness", 1, "spring stiffness", "N/m or N m/rad", each!(joints, stiffness)),
    rows("jnt_range", 2, "lowest and highest position", "m or rad", each!(joints, range)),
    rows(
        "jnt_actfrcrange",
        2,
        "limits of the sum of actuator forces on a joint (actuatorfrcrange)",
        "N or N m",
        each!(joints, actuator_force_range),
    ),
    rows(
        "jnt_velocity_limit",
        1,
        "speed limit of the source, not enforced; infinity without a limit",
        "rad/s or m/s",
        each!(joints, velocity_limit),
    ),
    rows("jnt_solref", 2, "reference acceleration of limits by MuJoCo's law", "", each!(joints, limit_softness.solref)),
    rows("jnt_solimp", 5, "impedance of limits by MuJoCo's law", "", each!(joints, limit_softness.solimp)),
    rows("dof_damping", 1, "viscous damping", "N s/m or N m s/rad", each_dof!(damping)),
    rows("dof_armature", 1, "added inertia", "kg or kg m^2", each_dof!(armature)),
    rows("dof_frictionloss", 1, "dry friction", "N or N m", each_dof!(frictionloss)),
    rows("dof_solref", 2, "reference acceleration of dry friction by MuJoCo's law", "", each_dof!(friction_softness.solref)),
    rows("dof_solimp", 5, "impedance of dry friction by MuJoCo's law", "", each_dof!(friction_softness.solimp)),
    rows("tendon_range", 2, "lowest and highest length", "", each!(tendons, range)),
    rows("tendon_stiffness", 1, "spring stiffness", "", each!(tendons, stiffness)),
    rows("tendon_lengthspring", 2, "lengths between which the spring is slack", "", each!(tendons, spring_length)),
    rows("tendon_damping", 1, "viscous damping", "", each!(tendons, damping)),
    rows("tendon_armature", 1, "added inertia", "", each!(tendons, armature)),
    rows("tendon_frictionloss", 1, "dry friction", "N", each!(tendons, frictionloss)),
    rows("eq_active0", 1, "1 for an active equality, 0 for an inactive one", "", each!(equalities, active)),
    rows("eq_data", 11, "anchors, relative pose and torquescale, or polynomial, in the layout of MuJoCo's eq_data", "", |m, f| {
        m.equalities.iter_mut().for_each(|equality| equality.visit_data(f))
    }),
    rows("eq_solref", 2, "reference acceleration of equalities by MuJoCo's law", "", each!(equalities, softness.solref)),
    rows("eq_solimp", 5, "impedance of equalities by MuJoCo's law", "", each!(equalities, softness.solimp)),
    rows("eq_stiffness", 1, "stiffness of a soft equality; infinity for a hard one", "", each!(equalities, stiffness)),
    rows("eq_damping", 1, "damping of a soft equality", "", each!(equalities, damping)),
    scalar("impratio", "ratio of the impedance of friction to that of normal forces by MuJoCo's law", "", only!(soft.impratio)),
    scalar(
        "noslip_iterations",
        "largest number of noslip iterations of MuJoCo's law, which reduce the slip of friction",
        "",
        only!(soft.noslip.iterations),
    ),
    scalar("noslip_tolerance", "relative improvement at which the noslip iterations stop", "", only!(soft.noslip.tolerance)),
    rows(
        "actuator_gear",
        GEAR,
        "gear: scale of length, velocity and force in column 0; on a site, the direction of force and torque",
        "",
        actuator_fields::gear,
    ),
    rows("actuator_gainprm", PARAMETERS, "parameters of the gain: constant, per length, per velocity; others are 0", "", |m, f| {
        actuator_fields::parameters(m, f, Actuator::gain_parameters)
    }),
    rows("actuator_biasprm", PARAMETERS, "parameters of the bias: constant, per length, per velocity; others are 0", "", |m, f| {
        actuator_fields::parameters(m, f, Actuator::bias_parameters)
    }),
    rows("actuator_ctrlrange", 2, "bounds of the control", "", each!(actuators, ctrl_range)),
    rows("actuator_forcerange", 2, "bounds of the force", "N or N m", each!(actuators, force_range)),
];

/// Fields that change the inverse weights of MuJoCo's contact law, which must then be recomputed.
const MOVES_WEIGHTS: [&str; 8] = ["qpos0", "body_mass", "body_inertia", "body_ipos", "body_iquat", "body_pos", "body_quat", "dof_armature"];

/// Calls `f` for each of the three sizes of a geom, which `f` may change. If a size changes, the semi-axes of the geom's fluid model change
/// too.
fn size(geom: &mut Geom, f: &mut dyn FnMut(&mut f64)) {
    let before = geom.semi_axes();
    let [mut x, mut y, mut z] = [0.0; 3];
    let numbers: [&mut f64; 3] = match &mut geom.shape {
        Shape::Sphere { radius } => [radius, &mut y, &mut z],
        Shape::Capsule { radius, half_length } | Shape::Cylinder { radius, half_length } => [radius, half_length, &mut z],
        Shape::Ellipsoid { radii: [a, b, c] } | Shape::Box { half: [a, b, c] } => [a, b, c],
        Shape::Plane | Shape::Mesh { .. } | Shape::HeightField { .. } => [&mut x, &mut y, &mut z],
    };
    numbers.into_iter().for_each(f);
    let after = geom.semi_axes();
    if let (Some(medium), Some(axes), true) = (&mut geom.fluid, after, before != after) {
        medium.axes = axes;
    }
}

impl Field {
    /// Quantity and unit as text, such as "mass, kg".
    pub fn meaning(&self) -> String {
        // The text `what` already contains the units if there are several.
        match self.unit {
            "" | "1, m, m" => self.what.to_owned(),
            unit => format!("{}, {unit}", self.what),
        }
    }

    /// Shape of the array as text, such as "(ngeom, 3)"; an empty text for a scalar field.
    pub fn axes(&self) -> String {
        let width = match self.width {
            None => return String::new(),
            Some(1) => String::new(),
            Some(width) => format!(" {width}"),
        };
        let count = match self.name.split_once('_').map_or(self.name, |(kind, _)| kind) {
            "body" => "nbody",
            "geom" => "ngeom",
            "jnt" => "njnt",
            "dof" => "nv",
            "tendon" => "ntendon",
            "eq" => "neq",
            "pair" => "npair",
            "actuator" => "nu",
            "qpos0" | "qpos" => "nq",
            _ => "3",
        };
        format!("({count},{width})")
    }

    /// Shape of the field in a model in which it has `count` values: `[]` for a scalar, `[n]`, or `[n, width]`.
    fn shape(&self, count: usize) -> Vec<usize> {
        match self.width {
            None => vec![],
            Some(1) => vec![count],
            Some(width) => vec![count / width, width],
        }
    }

    /// Values of the field. The model is mutable only to avoid a copy; it does not change.
    fn read(&self, model: &mut Description) -> Vec<f64> {
        let mut values = vec![];
        (self.visit)(model, &mut |x| values.push(*x));
        values
    }

    fn place(&self) -> String {
        format!("field {:?}", self.name)
    }
}

pub(super) fn find(name: &str) -> Result<&'static Field, ModelError> {
    REPLACEABLE.iter().find(|f| f.name == name).ok_or_else(|| {
        let known: Vec<&str> = REPLACEABLE.iter().map(|f| f.name).collect();
        ModelError::invalid(format!("field {name:?}"), "there is no such field", format!("choose one of: {}", known.join(", ")))
    })
}

impl Model {
    /// Shape and values of a field, row-major; `None` if [`REPLACEABLE`] has no such field. A missing range reads as -inf to inf.
    pub fn field(&self, name: &str) -> Option<(Vec<usize>, Vec<f64>)> {
        let field = find(name).ok()?;
        let values = field.read(&mut self.description.clone());
        Some((field.shape(values.len()), values))
    }

    /// Checks that the magnitude of every finite value of all fields is at most `most`.
    ///
    /// # Errors
    /// [`ModelError::Invalid`] for the first larger number.
    pub fn check_range(&self, most: f64) -> Result<(), ModelError> {
        let mut model = self.description.clone();
        for field in REPLACEABLE {
            let values = field.read(&mut model);
            if let Some(k) = values.iter().position(|x| x.is_finite() && x.abs() > most) {
                let what = format!("number {k} is {:e}, which is too large for 32 bits", values[k]);
                return Err(ModelError::invalid(field.place(), what, format!("give at most {most:e}, or use precision 64 bits")));
            }
        }
        Ok(())
    }

    /// Copy of the model with new values in one field, checked like any other model, see [`REPLACEABLE`].
    ///
    /// If the new values need a feature that stepper does not simulate, the result is an error. If the model already omits an element that
    /// changes the motion, the copy omits the affected elements instead.
    ///
    /// # Errors
    /// [`ModelError::Invalid`] if there is no such field, for a wrong number of values (the message has both shapes), for invalid values,
    /// and for values of a geom that an explicit pair overrides. Also the errors of [`Description::finish`].
    pub fn replace(&self, name: &str, values: &[f64]) -> Result<Self, ModelError> {
        self.replace_all(&[(name, values)])
    }

    /// Copy of the model with new values in several fields at once. Only the resulting model must be valid, not each change alone.
    ///
    /// Contacts of an explicit pair use the values of the pair and ignore the values of its geoms. If `geom_friction` changes for a geom of
    /// a pair, the call must also contain `pair_friction`, with new or unchanged values. The same holds for other fields of geoms and
    /// pairs.
    ///
    /// # Errors
    /// Those of [`Model::replace`].
    pub fn replace_all(&self, fields: &[(&str, &[f64])]) -> Result<Self, ModelError> {
        let mut model = self.description.clone();
        for &(name, values) in fields {
            write(&mut model, find(name)?, values)?;
            if MOVES_WEIGHTS.contains(&name) {
                model.soft.inverse_weights = None;
            }
        }
        OverriddenGeomFields::new(self, fields.iter().map(|field| field.0)).check(fields)?;
        let strict = !self.omitted.iter().any(|o| o.changes_motion);
        // No field changes the vertices of a mesh, so that the hulls can be reused.
        model.finish_with(strict, &self.hulls)
    }
}

pub(super) fn write(model: &mut Description, field: &Field, values: &[f64]) -> Result<(), ModelError> {
    let count = field.read(model).len();
    if values.len() != count {
        let shape = field.shape(count);
        let what = format!("got {} numbers for shape {shape:?}", values.len());
        return Err(ModelError::invalid(field.place(), what, format!("give {count} numbers, {}", field.meaning())));
    }
    let mut next = values.iter();
    (field.visit)(model, &mut |x| *x = *next.next().expect("as many as were counted"));
    let held = field.read(model);
    // A zero may be stored with the other sign, because nothing depends on the sign of a zero.
    let wrong = (0..count).find(|&k| held[k] != values[k] && held[k].to_bits() != values[k].to_bits());
    let Some(k) = wrong else { return Ok(()) };
    let remedy = match field.name {
        "eq_data" => "give 0 where the kind of equality has no number",
        name if name.starts_with("dof_") => "give all degrees of freedom of a ball or free joint the same value",
        "geom_concave" => "give 0 or 1, and 1 only to meshes",
        "geom_size" => "give 0 where the shape has no number: to planes, meshes and height fields, and beyond a ball's radius",
        _ => "give whole numbers in range",
    };
    let what = format!("number {k} is {}, which the model would store as {}", values[k], held[k]);
    let unread = actuator_fields::unread(model, field.name, k, values[k]);
    Err(unread.unwrap_or_else(|| ModelError::invalid(field.place(), what, remedy)))
}

#[cfg(test)]
mod tests {
    use super::super::finish::tests::{hollow, rich_model};
    use super::*;

    #[test]
    fn every_field_reads_back_what_is_written() {
        let model = rich_model();
        for field in REPLACEABLE {
            let (shape, values) = model.field(field.name).unwrap();
            assert_eq!(shape.iter().product::<usize>(), values.len(), "{}", field.name);
            assert!(!values.is_empty(), "{} is not in the test's model", field.name);
            assert_eq!(model.replace(field.name, &values).unwrap(), model, "{}", field.name);
        }
    }

    #[test]
    fn shapes_are_those_of_the_elements() {
        let model = rich_model();
        let shape = |name: &str| model.field(name).unwrap().0;
        assert_eq!(shape("timestep"), []);
        assert_eq!(shape("gravity"), [3]);
        assert_eq!(shape("qpos0"), [model.nq()]);
        assert_eq!(shape("body_mass"), [model.bodies.len()]);
        assert_eq!(shape("geom_friction"), [model.geoms.len(), 3]);
        assert_eq!(shape("jnt_range"), [model.joints.len(), 2]);
        assert_eq!(shape("dof_damping"), [model.nv()]);
        assert_eq!(shape("actuator_ctrlrange"), [model.nu(), 2]);
    }

    #[test]
    fn values_arrive_at_their_elements() {
        let model = rich_model();
        let geom = (0..model.geoms.len()).find(|g| model.pairs.iter().all(|pair| !pair.geoms.contains(g))).unwrap();
        let mut friction = model.field("geom_friction").unwrap().1;
        friction[3 * geom] = 0.25;
        assert_eq!(model.replace("geom_friction", &friction).unwrap().geoms[geom].friction[0], 0.25);
        let mut range = model.field("actuator_ctrlrange").unwrap().1;
        assert_eq!(range, [-1.0, 1.0, f64::NEG_INFINITY, f64::INFINITY]);
        range[..2].copy_from_slice(&[f64::NEG_INFINITY, f64::INFINITY]);
        assert_eq!(model.replace("actuator_ctrlrange", &range).unwrap().actuators[0].ctrl_range, None);
        let mut damping = model.field("dof_damping").unwrap().1;
        damping[..6].fill(0.7);
        assert_eq!(model.replace("dof_damping", &damping).unwrap().joints[0].damping, 0.7);
    }

    #[test]
    fn errors_name_field_shapes_and_remedy() {
        let text = |name: &str, values: &[f64]| rich_model().replace(name, values).unwrap_err().to_string();
        let error = text("geom_friction", &[1.0; 4]);
        assert!(error.contains("field \"geom_friction\"") && error.contains("4 numbers") && error.contains("[7, 3]"), "{error}");
        assert!(text("colour", &[]).contains("body_mass"));
        let mut damping = rich_model().field("dof_damping").unwrap().1;
        damping[0] = 5.0;
        assert!(text("dof_damping", &damping).contains("same value"));
        assert!(text("geom_condim", &[3.5; 7]).contains("whole numbers"));
        assert!(text("body_mass", &[-1.0; 7]).contains("mass is -1 kg"));
        assert!(text("timestep", &[f64::NAN]).contains("timestep is NaN"));
    }

    #[test]
    fn a_model_with_omissions_can_be_replaced() {
        let loose = hollow().finish(false).unwrap();
        assert!(!loose.omitted.is_empty());
        let gravity = [0.0, 0.0, -1.62];
        assert_eq!(loose.replace("gravity", &gravity).unwrap().omitted, loose.omitted);
    }

    #[test]
    fn numbers_that_a_kind_of_equality_lacks_are_refused() {
        let model = rich_model();
        let mut data = model.field("eq_data").unwrap().1;
        data[0] = 0.25;
        assert_eq!(model.replace("eq_data", &data).unwrap().equalities[0].data()[0], 0.25);
        data[10] = 1.0;
        let error = model.replace("eq_data", &data).unwrap_err().to_string();
        assert!(error.contains("number 10 is 1") && error.contains("give 0"), "{error}");
    }

    #[test]
    fn sizes_are_those_of_the_shape_and_the_medium_sees_them() {
        let mut model = rich_model();
        model.description.geoms[1].fluid = Some(crate::Ellipsoid {
            share: 1.0,
            blunt_drag: 0.5,
            slender_drag: 0.25,
            angular_drag: 1.5,
            kutta_lift: 1.0,
            magnus_lift: 1.0,
            virtual_mass: [1e-3; 3],
            virtual_inertia: [1e-5; 3],
            axes: [0.1; 3],
        });
        let mut sizes = model.field("geom_size").unwrap().1;
        assert_eq!(sizes[..9], [0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.05, 0.3, 0.0]);
        sizes[3] = 0.2;
        let larger = model.replace("geom_size", &sizes).unwrap();
        assert_eq!(larger.geoms[1].shape, Shape::Sphere { radius: 0.2 });
        assert_eq!(larger.geoms[1].fluid.unwrap().axes, [0.2; 3]);
        sizes[5] = 0.2;
        let error = model.replace("geom_size", &sizes).unwrap_err().to_string();
        assert!(error.contains("number 5 is 0.2") && error.contains("beyond a ball's radius"), "{error}");
    }

    #[test]
    fn several_fields_need_only_fit_together() {
        let model = rich_model();
        let mut inertia = model.field("body_inertia").unwrap().1;
        inertia[6..9].copy_from_slice(&[1.0, 1.0, 2.0]);
        let mass = vec![1.0; model.bodies.len()];
        let both = model.replace_all(&[("body_inertia", &inertia), ("body_mass", &mass)]).unwrap();
        assert_eq!((both.bodies[2].mass, both.bodies[2].inertia), (1.0, [1.0, 1.0, 2.0]));
    }
}
