//! Builder of an equality.

use crate::builder::{find, find_joint};
use crate::{Description, Equality, EqualityKind, ModelError, Softness};

/// Equality between elements by name.
#[derive(Clone, Debug)]
pub struct EqualityBuilder {
    equality: Equality,
    names: [Option<String>; 2],
}

impl EqualityBuilder {
    fn new(name: &str, kind: EqualityKind, first: &str, second: Option<&str>) -> Self {
        let equality =
            Equality { name: name.into(), kind, active: true, stiffness: f64::INFINITY, damping: 0.0, softness: Softness::default() };
        Self { equality, names: [Some(first.into()), second.map(Into::into)] }
    }

    /// Equality that connects a point of one body with a point of another ("world" is the world), each in its body's frame, m.
    pub fn connect(name: &str, bodies: [&str; 2], anchors: [[f64; 3]; 2]) -> Self {
        Self::new(name, EqualityKind::Connect { bodies: [0; 2], anchors }, bodies[0], Some(bodies[1]))
    }

    /// Equality like [`EqualityBuilder::connect`], which also keeps the second body's orientation in the first one's frame at `relpose` (w,
    /// x, y, z).
    pub fn weld(name: &str, bodies: [&str; 2], anchors: [[f64; 3]; 2], relpose: [f64; 4]) -> Self {
        let kind = EqualityKind::Weld { bodies: [0; 2], anchors, relpose, torquescale: 1.0 };
        Self::new(name, kind, bodies[0], Some(bodies[1]))
    }

    /// Equality of a hinge or slide with a polynomial of another one. Without another one it is held at `polycoef[0]` from its reference.
    pub fn joint(name: &str, joint: &str, other: Option<&str>, polycoef: [f64; 5]) -> Self {
        Self::new(name, EqualityKind::Joint { joint: 0, other: None, polycoef }, joint, other)
    }

    /// Equality of the length of a fixed tendon with a polynomial of another one's length, or with a constant.
    pub fn tendon(name: &str, tendon: &str, other: Option<&str>, polycoef: [f64; 5]) -> Self {
        Self::new(name, EqualityKind::Tendon { tendon: 0, other: None, polycoef }, tendon, other)
    }

    /// Sets the weight of a weld's rotation relative to its displacement, m per rad.
    pub fn torquescale(mut self, scale: f64) -> Self {
        if let EqualityKind::Weld { torquescale, .. } = &mut self.equality.kind {
            *torquescale = scale;
        }
        self
    }

    /// Replaces the hard constraint by a spring and a damper.
    pub fn soft(mut self, stiffness: f64, damping: f64) -> Self {
        (self.equality.stiffness, self.equality.damping) = (stiffness, damping);
        self
    }

    /// Disables the equality until a model has another `eq_active0`.
    pub fn inactive(mut self) -> Self {
        self.equality.active = false;
        self
    }

    pub(super) fn resolve(&self, model: &Description) -> Result<Equality, ModelError> {
        let mut equality = self.equality.clone();
        let place = format!("equality {:?}", equality.name);
        let index = |name: &Option<String>, kind: &str| -> Result<Option<usize>, ModelError> {
            let Some(name) = name else { return Ok(None) };
            match kind {
                "body" => find(model.bodies.iter().map(|b| &b.name), name, kind, &place),
                "tendon" => find(model.tendons.iter().map(|t| &t.name), name, kind, &place),
                _ => find_joint(model, name, &place),
            }
            .map(Some)
        };
        let kind = match equality.kind {
            EqualityKind::Connect { .. } | EqualityKind::Weld { .. } => "body",
            EqualityKind::Joint { .. } => "joint",
            EqualityKind::Tendon { .. } => "tendon",
        };
        let (first, second) = (index(&self.names[0], kind)?.unwrap_or_default(), index(&self.names[1], kind)?);
        match &mut equality.kind {
            EqualityKind::Connect { bodies, .. } | EqualityKind::Weld { bodies, .. } => *bodies = [first, second.unwrap_or_default()],
            EqualityKind::Joint { joint, other, .. } => (*joint, *other) = (first, second),
            EqualityKind::Tendon { tendon, other, .. } => (*tendon, *other) = (first, second),
        }
        Ok(equality)
    }
}
