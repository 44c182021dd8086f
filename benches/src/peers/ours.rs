//! stepper on the courses.

use std::sync::Arc;

use stepper_core::internals::dynamics::kinematics::Kinematics;
use stepper_core::model::{BodyBuilder, GeomBuilder, JointBuilder, Model, WORLD};
use stepper_core::{Field, Integrator, Level, Options, Precision, SavedState, Simulation, StepInputs};

use super::{BOX_FRICTION, BOX_HALF, BOX_SPEED, Course, Engine};
use crate::clock::Run;
use crate::scenes::chain;

/// Environments of a course, all alike.
pub struct Ours {
    simulation: Simulation,
    start: SavedState,
    steps: usize,
}

impl Ours {
    /// `count` environments at the start of the course, stepped on this thread.
    pub fn new(course: Course, dt: f64, integrator: Integrator, precision: Precision, count: usize, level: Level) -> Self {
        let model = match course {
            Course::Chain(links) => chain(links),
            Course::Box => sliding_box(),
        };
        let options = Options { timestep: Some(dt), integrator, ..Options::default() };
        let mut simulation = Simulation::at_level(model, options, Some(count), precision, 1, level);
        if course == Course::Box {
            let push = [BOX_SPEED, 0.0, 0.0, 0.0, 0.0, 0.0];
            (0..count).for_each(|env| simulation.set(Field::Qvel, env, &push).expect("a valid velocity"));
        }
        let start = simulation.save_state();
        Self { simulation, start, steps: (course.duration() / dt).round() as usize }
    }
}

impl Run for Ours {
    fn rewind(&mut self) {
        self.simulation.restore_state(&self.start).expect("its own state");
    }

    fn run(&mut self) {
        self.advance(self.steps);
    }

    fn environment_steps(&self) -> u64 {
        (self.steps * self.simulation.num_envs()) as u64
    }
}

impl Engine for Ours {
    fn advance(&mut self, steps: usize) {
        self.simulation.step(&StepInputs::default(), steps).expect("no inputs");
    }

    fn centres(&self) -> Vec<[f64; 3]> {
        let compiled = self.simulation.compiled();
        let mut q = vec![0.0; compiled.nq];
        self.simulation.get(Field::Qpos, 0, &mut q).expect("nq numbers");
        let mut kinematics = Kinematics::new(compiled);
        kinematics.update(compiled, &q);
        (0..compiled.links.len()).map(|l| kinematics.point(l + 1, compiled.params.inertial(l).com)).collect()
    }

    fn energy(&self) -> f64 {
        let (potential, kinetic) = self.simulation.snapshot(0, &StepInputs::default()).expect("no inputs").energy();
        potential + kinetic
    }

    fn steps(&self) -> usize {
        self.steps
    }
}

fn sliding_box() -> Arc<Model> {
    let mut scene = Model::builder("sliding box");
    let friction = [BOX_FRICTION, 0.0, 0.0];
    scene.geom(WORLD, GeomBuilder::plane("floor").friction(friction));
    let body = BodyBuilder::new("box").pos([0.0, 0.0, BOX_HALF[2]]).joint(JointBuilder::free("root"));
    scene.body(WORLD, body.geom(GeomBuilder::cuboid("box", BOX_HALF).mass(1.0).friction(friction)));
    Arc::new(scene.finish().expect("the box is a valid model"))
}
