//! Conversion of a model's parameters to the list of numbers that a compiled model stores. The list consists of tables.

use stepper_real::Scalar;

use crate::compile::collision::{CompiledGeom, Radii, radii_of, size};
use crate::compile::compiled_model::ModelStructure;
use crate::compile::merging::{combined, matrix, vector};
use crate::compile::parameters::{
    ActuatorParams, CompensationParams, ContactParams, DofParams, EqualityParams, FluidParams, GeomParams, Inertial, ParameterRows, Params,
};
use crate::compile::passive::{FluidShape, inertia_box};
use crate::model::{Body, EqualityKind, Filter, Joint, Model, Object, Pair};

impl<S: Scalar> ModelStructure<S> {
    /// Parameters of `model`, in the tables and order of this structure. `model` must be the model that was compiled, or a variant of it
    /// with other values.
    pub fn params_of(&self, model: &Model) -> Params<f64> {
        let source = Source { structure: self, model };
        let joints = model.joints.iter();
        let rows = ParameterRows {
            gravity: vec![model.gravity],
            inertials: source.inertials().collect(),
            totals: source.totals().collect(),
            dofs: joints.clone().flat_map(dofs).collect(),
            springs: joints.map(|j| j.stiffness).collect(),
            limits: self.limits.iter().filter_map(|l| model.joints[l.joint].range).collect(),
            ball_limits: self.ball_limits.iter().filter_map(|l| model.joints[l.joint].range).map(|[low, high]| low.max(high)).collect(),
            frictions: self.frictions.iter().map(|f| model.joints[f.joint].frictionloss).collect(),
            actuators: model.actuators.iter().map(|a| a.affine_force()).map(|(gain, bias)| ActuatorParams { gain, bias }).collect(),
            geoms: self.geoms.iter().map(|g| source.geom(g)).collect(),
            pairs: source.pairs().collect(),
            geom_contacts: source.geom_contacts().collect(),
            bodies: (0..model.bodies.len()).map(|b| source.position(Object::Body(b))).collect(),
            masses: model.bodies.iter().map(|b| b.mass).collect(),
            moments: (0..model.bodies.len()).map(|b| combined(model, &self.merged, [b]).2).collect(),
            equalities: model.equalities.iter().map(|e| source.equality(&e.kind)).collect(),
            compensations: self.compensation.iter().map(|compensated| source.compensation(compensated.body)).collect(),
            fluid: self.fluid.iter().map(|f| source.fluid(f.object, &f.shape)).collect(),
            places: self.sensing.places.iter().map(|&object| source.position(object)).collect(),
            sizes: self.sensing.shapes.iter().map(|&object| source.size(object)).collect(),
        };
        rows.into()
    }
}

fn dofs(joint: &Joint) -> impl Iterator<Item = DofParams<f64>> {
    let Joint { damping, stiffness, armature, .. } = *joint;
    std::iter::repeat_n(DofParams { damping, stiffness: stiffness.max(0.0), armature }, joint.kind.nv())
}

/// Model from which parameters are read, and structure of the compiled model, which defines their layout.
struct Source<'a, S: Scalar> {
    structure: &'a ModelStructure<S>,
    model: &'a Model,
}

impl<S: Scalar> Source<'_, S> {
    /// Mass, centre of mass and inertia of all links, followed by those of all subtree parts. A subtree part consists of the bodies of a
    /// sensor's subtree that are fixed to one frame.
    fn inertials(&self) -> impl Iterator<Item = Inertial<f64>> {
        let merged = &self.structure.merged;
        let mut bodies = vec![vec![]; self.structure.nframe()];
        merged.frame.iter().enumerate().for_each(|(body, &frame)| bodies[frame].push(body));
        let parts = self.structure.sensing.subtrees.iter().flat_map(|tree| tree.parts.iter().map(move |part| (tree, part)));
        let parts = parts.map(|(tree, part)| bodies[part.frame].iter().copied().filter(|&b| tree.bodies[b]).collect());
        let parts: Vec<Vec<usize>> = parts.collect();
        bodies.truncate(1 + self.structure.links.len());
        bodies.into_iter().skip(1).chain(parts).map(|bodies| combined(self.model, merged, bodies)).map(|(mass, com, inertia)| Inertial {
            mass,
            com: com.into(),
            inertia,
        })
    }

    /// Total masses of the subtrees whose mass sensors read, kg.
    fn totals(&self) -> impl Iterator<Item = f64> {
        let bodies = &self.model.bodies;
        self.structure.sensing.subtrees.iter().map(|tree| bodies.iter().zip(&tree.bodies).filter(|b| *b.1).map(|b| b.0.mass).sum())
    }

    /// Position and sizes of a geom that takes part in collision.
    fn geom(&self, geom: &CompiledGeom<S>) -> GeomParams<f64> {
        let Radii { bounding_radius, inscribed_radius } = geom.fixed_radii.unwrap_or_else(|| radii_of(self.model, geom.index));
        let rotation_reach = if bounding_radius.is_finite() { bounding_radius - inscribed_radius } else { 0.0 };
        let (pos, size) = (self.position(Object::Geom(geom.index)), size(&self.model.geoms[geom.index].shape));
        GeomParams { pos, size, bounding_radius, inscribed_radius, rotation_reach }
    }

    /// Contact parameters of every listed pair. Coefficients that a contact of its dimension (condim) does not have are 0.
    fn pairs(&self) -> impl Iterator<Item = ContactParams<f64>> {
        let filter = Filter::new(self.model);
        let index = |g: usize| self.structure.geoms[g].index;
        let contact = move |p: Pair| {
            let [mu, torsion, rolling] = p.friction;
            let coefficient = |least_condim: u8, x: f64| if p.condim >= least_condim { x } else { 0.0 };
            ContactParams {
                mu: coefficient(3, mu),
                torsion: coefficient(4, torsion),
                rolling: coefficient(6, rolling),
                restitution: p.restitution,
            }
        };
        let listed =
            self.structure.pairs.iter().map(move |p| filter.pair(p.geoms.map(index)).expect("a pair of the compiled model collides"));
        listed.map(contact)
    }

    /// Contact parameters of every geom. The result is empty if the model has no dynamic pairs.
    fn geom_contacts(&self) -> impl Iterator<Item = ContactParams<f64>> {
        let geoms = if self.structure.dynamic_pairs.is_some() { &self.model.geoms[..] } else { &[] };
        geoms.iter().map(|g| {
            let [mu, torsion, rolling] = g.friction;
            ContactParams { mu, torsion, rolling, restitution: g.restitution }
        })
    }

    fn equality(&self, kind: &EqualityKind) -> EqualityParams<f64> {
        let none = EqualityParams { first: [0.0; 3], second: [0.0; 3], orientation: [0.0; 9], weight: 0.0, polynomial: [0.0; 5] };
        let merged = &self.structure.merged;
        match *kind {
            EqualityKind::Connect { bodies, anchors } => {
                let [first, second] = std::array::from_fn(|side| merged.point(bodies[side], anchors[side]).into());
                EqualityParams { first, second, ..none }
            }
            EqualityKind::Weld { bodies, anchors, relpose, torquescale } => {
                let [first, second] = std::array::from_fn(|side| merged.point(bodies[side], anchors[side]).into());
                let orientation = matrix(&merged.rotation(bodies[0], relpose));
                EqualityParams { first, second, orientation, weight: torquescale, ..none }
            }
            EqualityKind::Joint { polycoef, .. } | EqualityKind::Tendon { polycoef, .. } => EqualityParams { polynomial: polycoef, ..none },
        }
    }

    fn compensation(&self, body: usize) -> CompensationParams<f64> {
        let Body { mass, gravcomp, .. } = self.model.bodies[body];
        let force = vector(self.model.gravity) * -(mass * gravcomp);
        CompensationParams { pos: self.position(Object::Body(body)), force: force.into() }
    }

    fn fluid(&self, object: Object, shape: &FluidShape<S>) -> FluidParams<f64> {
        let [viscous, quadratic] = match (object, shape) {
            (Object::Body(b), FluidShape::Box) => inertia_box(&self.model.bodies[b], &self.model.medium),
            _ => [[0.0; 6]; 2],
        };
        FluidParams { pos: self.position(object), viscous, quadratic }
    }

    /// Position of an object (body, geom or site) in the frame to which it is fixed, m.
    fn position(&self, object: Object) -> [f64; 3] {
        self.structure.merged.pose(self.model, object).pos.into()
    }

    fn size(&self, object: Object) -> [f64; 3] {
        match object {
            Object::Geom(g) => size(&self.model.geoms[g].shape),
            Object::Site(s) => size(&self.model.sites[s].shape),
            Object::XBody(_) | Object::Body(_) => unreachable!("bodies have no shape of their own"),
        }
    }
}
