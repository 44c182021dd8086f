//! Builder of an equality.

use crate::builder::find;
use crate::{Description, ElementKind, Equality, EqualityKind, ModelError, Softness};

/// Builder of an equality between elements, which are given by name.
#[derive(Clone, Debug)]
pub struct EqualityBuilder {
    equality: Equality,
    first: String,
    second: Option<String>,
}

impl EqualityBuilder {
    fn new(name: &str, kind: EqualityKind, first: &str, second: Option<&str>) -> Self {
        let (name, softness) = (name.into(), Softness::default());
        let equality = Equality { name, kind, active: true, stiffness: f64::INFINITY, damping: 0.0, softness };
        Self { equality, first: first.into(), second: second.map(Into::into) }
    }

    /// Creates a builder of an equality like [`EqualityBuilder::connect`] that also fixes the relative orientation of the bodies. `relpose`
    /// is the orientation of the second body in the frame of the first body, a quaternion (w, x, y, z).
    pub fn weld(name: &str, bodies: [&str; 2], anchors: [[f64; 3]; 2], relpose: [f64; 4]) -> Self {
        let kind = EqualityKind::Weld { bodies: [0; 2], anchors, relpose, torquescale: 1.0 };
        Self::new(name, kind, bodies[0], Some(bodies[1]))
    }

    /// Sets the weight of a weld's rotation error relative to its position error, m/rad.
    pub fn torquescale(mut self, scale: f64) -> Self {
        if let EqualityKind::Weld { torquescale, .. } = &mut self.equality.kind {
            *torquescale = scale;
        }
        self
    }

    pub(super) fn resolve(&self, model: &Description) -> Result<Equality, ModelError> {
        let mut equality = self.equality.clone();
        let place = format!("equality {:?}", equality.name);
        let object = match equality.kind {
            EqualityKind::Connect { .. } | EqualityKind::Weld { .. } => ElementKind::Body,
            EqualityKind::Joint { .. } => ElementKind::Joint,
            EqualityKind::Tendon { .. } => ElementKind::Tendon,
        };
        let index = |name: &String| find(model, object, name, &place);
        let (first, second) = (index(&self.first)?, self.second.as_ref().map(index).transpose()?);
        match &mut equality.kind {
            EqualityKind::Connect { bodies, .. } | EqualityKind::Weld { bodies, .. } => *bodies = [first, second.unwrap_or_default()],
            EqualityKind::Joint { joint, other, .. } => (*joint, *other) = (first, second),
            EqualityKind::Tendon { tendon, other, .. } => (*tendon, *other) = (first, second),
        }
        Ok(equality)
    }
}

constructors! { EqualityBuilder
    /// Creates a builder of an equality that makes a point of one body coincide with a point of another. `bodies` has the names of the two
    /// bodies, where "world" selects the world. `anchors` has the position of the point in the frame of each body, m.
    connect(bodies: [&str; 2], anchors: [[f64; 3]; 2]) { EqualityKind::Connect { bodies: [0; 2], anchors }, bodies[0], Some(bodies[1]) }
    /// Creates a builder of an equality that couples the hinge or slide `joint` to a second one, `other`, by a polynomial; see
    /// [`EqualityKind::Joint`]. Joints are given by name.
    ///
    /// `polycoef` has the coefficients of the powers 0 to 4. If `other` is `None`, the joint is fixed at the distance `polycoef[0]` from
    /// its position in `qpos0`.
    joint(joint: &str, other: Option<&str>, polycoef: [f64; 5]) { EqualityKind::Joint { joint: 0, other: None, polycoef }, joint, other }
    /// Creates a builder of an equality that couples the length of the fixed tendon `tendon` to the length of a second one, `other`, by a
    /// polynomial; see [`EqualityKind::Tendon`].
    ///
    /// `polycoef` has the coefficients of the powers 0 to 4. If `other` is `None`, the length is fixed at the distance `polycoef[0]` from
    /// its value in `qpos0`.
    tendon(tendon: &str, other: Option<&str>, polycoef: [f64; 5]) { EqualityKind::Tendon { tendon: 0, other: None, polycoef }, tendon, other }
}

setters! { EqualityBuilder
    /// Makes the equality a spring with a damper instead of a hard constraint. `stiffness` is in N/m (or N m/rad), `damping` in N s/m (or N
    /// m s/rad).
    soft(stiffness: f64, damping: f64) { equality.stiffness = stiffness; equality.damping = damping }
    /// Disables the equality by default (`eq_active0`).
    inactive() { equality.active = false }
}
