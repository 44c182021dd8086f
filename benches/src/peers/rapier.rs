//! rapier3d-f64 on the courses: multibody joints for the chain, a rigid body on a half space for the box.

use rapier3d_f64::prelude::*;

use super::{BOX_FRICTION, BOX_HALF, BOX_SPEED, Course, Engine, GRAVITY};
use crate::clock::Run;
use crate::scenes::{LINK_LENGTH, LINK_MASS, LINK_MOMENTS, chain_axis};

/// Rapier's choices.
#[derive(Clone, Copy, Debug)]
pub struct Setting {
    /// Time step, s.
    pub dt: f64,
    /// `num_solver_iterations`: parts that a step is made of.
    pub substeps: usize,
    /// A friction constraint for every contact point, more accurate than the default by its documentation.
    pub coulomb: bool,
}

/// One world of a course.
pub struct Rapier {
    course: Course,
    setting: Setting,
    world: PhysicsWorld,
    moving: Vec<RigidBodyHandle>,
    steps: usize,
}

impl Rapier {
    /// A world at the start of the course. Nothing in it can sleep, since stepper's does not.
    pub fn new(course: Course, setting: Setting) -> Self {
        let (world, moving) = build(course, setting);
        Self { course, setting, world, moving, steps: (course.duration() / setting.dt).round() as usize }
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
        Course::Box => vec![sliding_box(&mut world)],
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
    // Rapier gives every hinge a damping of 0.1 N m s unless told otherwise.
    multibody.damping_mut().fill(0.0);
    bodies
}

fn sliding_box(world: &mut PhysicsWorld) -> RigidBodyHandle {
    let floor = ColliderBuilder::new(SharedShape::halfspace(Vector::Z)).friction(BOX_FRICTION);
    world.insert(RigidBodyBuilder::fixed(), floor);
    let [x, y, z] = BOX_HALF;
    let body = RigidBodyBuilder::dynamic().translation(Vector::new(0.0, 0.0, z)).linvel(Vector::new(BOX_SPEED, 0.0, 0.0));
    world.insert(body.can_sleep(false), ColliderBuilder::cuboid(x, y, z).mass(1.0).friction(BOX_FRICTION)).0
}

impl Run for Rapier {
    fn rewind(&mut self) {
        (self.world, self.moving) = build(self.course, self.setting);
    }

    fn run(&mut self) {
        self.advance(self.steps);
    }

    fn environment_steps(&self) -> u64 {
        self.steps as u64
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
