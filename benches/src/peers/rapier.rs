//! rapier3d-f64 as an engine of the comparison. The chain has multibody joints, and the other scenes have rigid bodies on a half space.

use rapier3d_f64::prelude::*;

use super::bodies::{Bodies, Pose, Shape, Solid};
use super::{Course, Engine, GRAVITY};
use crate::clock::Run;
use crate::scenes::{LINK_LENGTH, LINK_MASS, LINK_MOMENTS, chain_axis};

/// Settings of rapier in the comparison.
#[derive(Clone, Copy, Debug)]
pub struct Setting {
    /// Time step, s.
    pub dt: f64,
    /// `num_solver_iterations`, the number of substeps per step.
    pub substeps: usize,
    /// Whether every contact point has a friction constraint. Rapier's documentation calls this more accurate than the default.
    pub coulomb: bool,
}

/// Scene simulated by rapier.
pub struct Rapier {
    course: Course,
    setting: Setting,
    world: PhysicsWorld,
    moving: Vec<RigidBodyHandle>,
    steps: usize,
    timed: usize,
}

impl Rapier {
    /// Scene at its start. Sleeping is disabled, because stepper does not have it.
    pub fn new(course: Course, setting: Setting) -> Self {
        let (world, moving) = build(course, setting);
        let [steps, timed] = [course.duration(), course.timed()].map(|time| (time / setting.dt).round() as usize);
        Self { course, setting, world, moving, steps, timed }
    }
}

fn build(course: Course, setting: Setting) -> (PhysicsWorld, Vec<RigidBodyHandle>) {
    let mut world = PhysicsWorld::new();
    world.gravity = Vector::new(0.0, 0.0, -GRAVITY);
    world.integration_parameters.dt = setting.dt;
    world.integration_parameters.num_solver_iterations = setting.substeps;
    if setting.coulomb {
        world.integration_parameters.friction_model = FrictionModel::Coulomb;
    }
    let moving = match course {
        Course::Chain(links) => chain(&mut world, links),
        _ => free(&mut world, &course.bodies().expect("all but chains are free bodies")),
    };
    (world, moving)
}

fn chain(world: &mut PhysicsWorld, links: usize) -> Vec<RigidBodyHandle> {
    let mut parent = world.insert_body(RigidBodyBuilder::fixed());
    let rod = MassProperties::new(Vector::new(0.5 * LINK_LENGTH, 0.0, 0.0), LINK_MASS, Vector::from(LINK_MOMENTS));
    let mut last = None;
    let mut link = |i: usize| {
        let place = Vector::new(i as f64 * LINK_LENGTH, 0.0, 0.0);
        let body = world.insert_body(RigidBodyBuilder::dynamic().translation(place).additional_mass_properties(rod).can_sleep(false));
        let anchor = Vector::new(if i == 0 { 0.0 } else { LINK_LENGTH }, 0.0, 0.0);
        let hinge = RevoluteJointBuilder::new(Vector::from(chain_axis(i))).local_anchor1(anchor);
        last = world.insert_multibody_joint(parent, body, hinge);
        parent = body;
        body
    };
    let bodies = (0..links).map(&mut link).collect();
    let (multibody, _) = world.multibody_joints.get_mut(last.expect("a chain has no loops")).expect("just made");
    // Rapier's default damping of a hinge is 0.1 N m s.
    multibody.damping_mut().fill(0.0);
    bodies
}

fn free(world: &mut PhysicsWorld, bodies: &Bodies) -> Vec<RigidBodyHandle> {
    let rough = |shape: ColliderBuilder, friction: f64| shape.friction(friction).friction_combine_rule(CoefficientCombineRule::Max);
    let floor = rough(ColliderBuilder::new(SharedShape::halfspace(Vector::Z)), bodies.friction);
    world.insert(RigidBodyBuilder::fixed(), floor);
    for &([x, y, z], pos) in &bodies.walls {
        world.insert(RigidBodyBuilder::fixed().translation(Vector::from(pos)), rough(ColliderBuilder::cuboid(x, y, z), bodies.friction));
    }
    let solid = |solid: &Solid| {
        let (pos, [w, x, y, z]) = solid.pose;
        let pose = Pose3::from_parts(Vector::from(pos), Rotation::from_xyzw(x, y, z, w));
        let body = RigidBodyBuilder::dynamic().pose(pose).linvel(Vector::from(solid.velocity)).can_sleep(false);
        let shape = match solid.shape {
            Shape::Ball(radius) => ColliderBuilder::ball(radius),
            Shape::Box([x, y, z]) => ColliderBuilder::cuboid(x, y, z),
        };
        world.insert(body, rough(shape.mass(solid.mass), solid.friction)).0
    };
    let moving: Vec<RigidBodyHandle> = bodies.solids.iter().map(solid).collect();
    world.bodies[moving[0]].add_force(Vector::from(bodies.push), true);
    moving
}

impl Run for Rapier {
    fn rewind(&mut self) {
        (self.world, self.moving) = build(self.course, self.setting);
    }

    fn run(&mut self) {
        self.advance(self.timed);
    }

    fn environment_steps(&self) -> u64 {
        self.timed as u64
    }
}

impl Engine for Rapier {
    fn advance(&mut self, steps: usize) {
        for _ in 0..steps {
            self.world.step();
        }
    }

    fn centres(&self) -> Vec<[f64; 3]> {
        let centre = |&h: &RigidBodyHandle| {
            let body = &self.world.bodies[h];
            let c = body.mass_properties().local_mprops.world_com(body.position());
            [c.x, c.y, c.z]
        };
        self.moving.iter().map(centre).collect()
    }

    fn poses(&self) -> Vec<Pose> {
        let pose = |&h: &RigidBodyHandle| {
            let (p, q) = (self.world.bodies[h].translation(), self.world.bodies[h].rotation());
            ([p.x, p.y, p.z], [q.w, q.x, q.y, q.z])
        };
        self.moving.iter().map(pose).collect()
    }

    fn energy(&self) -> f64 {
        let heights = self.centres();
        let each = self.moving.iter().zip(heights).map(|(&h, centre)| {
            let body = &self.world.bodies[h];
            body.kinetic_energy() + body.mass() * GRAVITY * centre[2]
        });
        each.sum()
    }

    fn steps(&self) -> usize {
        self.steps
    }
}
