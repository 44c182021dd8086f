//! The parameters of a model, laid out for a compiled model.

use nalgebra::Vector3;
use stepper_real::Scalar;

use crate::compile::collision::{bulk, size};
use crate::compile::compiled_model::CompiledModel;
use crate::compile::limits::is_scalar;
use crate::compile::merging::{combined, vector};
use crate::compile::parameters::{Params, Tables};
use crate::compile::passive::{FluidShape, inertia_box};
use crate::model::{Body, Filter, GeomPair, Joint, JointKind, Model, Object};

impl<S: Scalar> CompiledModel<S> {
    /// The parameters of a model that has this compiled model's structure: the one that it was made from, or one with other numbers.
    pub fn params_of(&self, model: &Model) -> Params<f64> {
        let source = Source { compiled: self, model };
        let mut numbers = Vec::new();
        let mut table = |rows: &mut dyn Iterator<Item = f64>| {
            let start = numbers.len();
            numbers.extend(rows);
            start
        };
        let at = Tables {
            gravity: table(&mut model.gravity.into_iter()),
            inertials: table(&mut source.inertials()),
            totals: table(&mut source.totals()),
            dofs: table(&mut model.joints.iter().flat_map(dofs)),
            springs: table(&mut model.joints.iter().map(|j| j.stiffness)),
            limits: table(&mut model.joints.iter().filter(|j| is_scalar(j)).filter_map(|j| j.range).flatten()),
            ball_limits: table(&mut model.joints.iter().filter(|j| j.kind == JointKind::Ball).filter_map(|j| j.range).map(widest)),
            frictions: table(&mut self.frictions.iter().map(|f| model.joints[f.joint].frictionloss)),
            actuators: table(&mut model.actuators.iter().flat_map(|a| a.gain.into_iter().chain(a.bias))),
            geoms: table(&mut self.geoms.iter().flat_map(|g| source.geom(g.index))),
            pairs: table(&mut source.pairs()),
            members: table(&mut source.members()),
            bodies: table(&mut (0..model.bodies.len()).flat_map(|b| source.place(Object::Body(b)))),
            holds: table(&mut self.compensation.iter().flat_map(|hold| source.hold(hold.body))),
            fluid: table(&mut self.fluid.iter().flat_map(|f| source.fluid(f.object, &f.shape))),
            places: table(&mut self.sensing.places.iter().flat_map(|&object| source.place(object))),
            sizes: table(&mut self.sensing.shapes.iter().flat_map(|&object| source.size(object))),
        };
        Params { numbers, at }
    }
}

fn widest([low, high]: [f64; 2]) -> f64 {
    low.max(high)
}

fn dofs(joint: &Joint) -> impl Iterator<Item = f64> {
    std::iter::repeat_n([joint.damping, joint.stiffness.max(0.0), joint.armature], joint.kind.nv()).flatten()
}

/// What the numbers are taken from, and where they go.
struct Source<'a, S: Scalar> {
    compiled: &'a CompiledModel<S>,
    model: &'a Model,
}

impl<S: Scalar> Source<'_, S> {
    /// Links, then the parts that sensors read.
    fn inertials(&self) -> impl Iterator<Item = f64> {
        let merged = &self.compiled.merged;
        let links = (1..=self.compiled.links.len()).map(move |frame| combined(self.model, merged, |b| merged.frame[b] == frame));
        let parts = self.compiled.sensing.subtrees.iter().flat_map(move |tree| {
            tree.parts.iter().map(move |part| combined(self.model, merged, |b| tree.bodies[b] && merged.frame[b] == part.frame))
        });
        links.chain(parts).flat_map(|(mass, com, inertia)| [mass].into_iter().chain(xyz(com)).chain(inertia))
    }

    /// Masses of the subtrees that sensors read.
    fn totals(&self) -> impl Iterator<Item = f64> {
        let bodies = &self.model.bodies;
        self.compiled.sensing.subtrees.iter().map(|tree| bodies.iter().zip(&tree.bodies).filter(|b| *b.1).map(|b| b.0.mass).sum())
    }

    fn geom(&self, geom: usize) -> impl Iterator<Item = f64> + use<S> {
        let bulk = bulk(self.model, geom);
        let rotation_reach = if bulk.bounding_radius.is_finite() { bulk.bounding_radius - bulk.inscribed_radius } else { 0.0 };
        let (pos, size) = (self.place(Object::Geom(geom)), size(&self.model.geoms[geom].shape));
        pos.into_iter().chain(size).chain([bulk.bounding_radius, bulk.inscribed_radius, rotation_reach])
    }

    fn pairs(&self) -> impl Iterator<Item = f64> {
        let filter = Filter::new(self.model);
        let index = |g: usize| self.compiled.geoms[g].index;
        let surface = move |p: GeomPair| {
            let [mu, torsion, rolling] = p.friction;
            let more = |least: u8, x: f64| if p.condim > least { x } else { 0.0 };
            [more(1, mu), more(3, torsion), more(4, rolling), p.restitution]
        };
        let listed = self.compiled.pairs.iter().map(move |p| filter.pair(p.geoms.map(index)).expect("a pair of the compiled collides"));
        listed.flat_map(surface)
    }

    /// What every geom brings into a contact, where there is a crowd.
    fn members(&self) -> impl Iterator<Item = f64> {
        let geoms = if self.compiled.crowd.is_some() { &self.model.geoms[..] } else { &[] };
        geoms.iter().flat_map(|g| g.friction.into_iter().chain([g.restitution]))
    }

    /// Where a force against gravity acts, and the force.
    fn hold(&self, body: usize) -> impl Iterator<Item = f64> + use<S> {
        let Body { mass, gravcomp, .. } = self.model.bodies[body];
        let force = vector(self.model.gravity) * -(mass * gravcomp);
        self.place(Object::Body(body)).into_iter().chain(xyz(force))
    }

    fn fluid(&self, object: Object, shape: &FluidShape<S>) -> impl Iterator<Item = f64> + use<S> {
        let drag = match (object, shape) {
            (Object::Body(b), FluidShape::Box) => inertia_box(&self.model.bodies[b], &self.model.medium),
            _ => [[0.0; 6]; 2],
        };
        self.place(object).into_iter().chain(drag.into_iter().flatten())
    }

    /// Position of an object in its frame.
    fn place(&self, object: Object) -> [f64; 3] {
        let (body, pos) = match object {
            Object::XBody(b) => (b, [0.0; 3]),
            Object::Body(b) => (b, self.model.bodies[b].ipos),
            Object::Geom(g) => (self.model.geoms[g].body, self.model.geoms[g].pos),
            Object::Site(s) => (self.model.sites[s].body, self.model.sites[s].pos),
        };
        (self.compiled.merged.pos[body] + self.compiled.merged.quat[body] * vector(pos)).into()
    }

    fn size(&self, object: Object) -> [f64; 3] {
        match object {
            Object::Geom(g) => size(&self.model.geoms[g].shape),
            Object::Site(s) => size(&self.model.sites[s].shape),
            Object::XBody(_) | Object::Body(_) => unreachable!("bodies have no shape of their own"),
        }
    }
}

fn xyz(x: Vector3<f64>) -> [f64; 3] {
    x.into()
}
