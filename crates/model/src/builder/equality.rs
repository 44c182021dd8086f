//! An equality.

use crate::builder::{find, find_joint};
use crate::{Description, Equality, EqualityKind, ModelError, Softness};

/// An equality between elements that are named.
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

    /// Joins a point of one body with a point of another ("world" is the world), each in its body's frame, m.
    pub fn connect(name: &str, bodies: [&str; 2], anchors: [[f64; 3]; 2]) -> Self {
        Self::new(name, EqualityKind::Connect { bodies: [0; 2], anchors }, bodies[0], Some(bodies[1]))
    }

    /// As [`EqualityBuilder::connect`], and keeps the second body's orientation in the first's at `relpose` (w, x, y, z).
    pub fn weld(name: &str, bodies: [&str; 2], anchors: [[f64; 3]; 2], relpose: [f64; 4]) -> Self {
        let kind = EqualityKind::Weld { bodies: [0; 2], anchors, relpose, torquescale: 1.0 };
        Self::new(name, kind, bodies[0], Some(bodies[1]))
    }

    /// Couples a hinge or slide with another by a polynomial, or holds it at `polycoef[0]` from its reference.
    pub fn joint(name: &str, joint: &str, other: Option<&str>, polycoef: [f64; 5]) -> Self {
        Self::new(name, EqualityKind::Joint { joint: 0, other: None, polycoef }, joint, other)
    }

    /// Couples the lengths of two fixed tendons by a polynomial, or holds one.
    pub fn tendon(name: &str, tendon: &str, other: Option<&str>, polycoef: [f64; 5]) -> Self {
        Self::new(name, EqualityKind::Tendon { tendon: 0, other: None, polycoef }, tendon, other)
    }

    /// Weighs a weld's turning against its displacement, m per rad.
    pub fn torquescale(mut self, scale: f64) -> Self {
        if let EqualityKind::Weld { torquescale, .. } = &mut self.equality.kind {
            *torquescale = scale;
        }
        self
    }

    /// Makes a spring and damper of it.
    pub fn soft(mut self, stiffness: f64, damping: f64) -> Self {
        (self.equality.stiffness, self.equality.damping) = (stiffness, damping);
        self
    }

    /// Leaves it out until a model with another `eq_active0` is made.
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
