//! Benchmark run of the derivatives of a step with respect to the state and the controls.

use stepper_core::{Level, Precision, Simulation};
use stepper_derivative::{Derivative, DerivativeQuery, StatePart, differentiate};

use crate::clock::Run;
use crate::episode::Episode;
use crate::scenes::Scene;

/// Inputs with respect to which the step is differentiated. Their coordinates are the columns of the derivatives.
const PARTS: [StatePart; 3] = [StatePart::Qpos, StatePart::Qvel, StatePart::Ctrl];
/// Displacements of a coordinate for central differences, in SI units.
const OFFSETS: [f64; 2] = [1e-6, -1e-6];
/// Residual at which the solver stops, m/s. Python's `linearize` has the smaller default 1e-13.
const TOLERANCE: f64 = 1e-12;

/// Benchmark run that computes the derivatives of one step for a batch of environments.
pub struct Derivatives {
    simulation: Simulation,
    /// Controls of the step, (num_envs, nu).
    ctrl: Vec<f64>,
    /// Displacements of each coordinate, (num_envs, 2, columns), in SI units.
    offsets: Vec<f64>,
    /// Results of the last run, one for each environment.
    derivatives: Vec<Derivative>,
}

impl Derivatives {
    /// Benchmark run with the first `count` environments of a scene, in their states after the scene's warm-up steps.
    pub fn new(scene: &Scene, count: usize, level: Level) -> Self {
        let simulation = Episode::new(scene, 0, count, Precision::F64, level).into_simulation();
        let model = simulation.model();
        let columns = 2 * model.nv() + model.nu();
        let offsets = (0..count).flat_map(|_| OFFSETS).flat_map(|offset| std::iter::repeat_n(offset, columns)).collect();
        Self { ctrl: simulation.ctrl().to_vec(), offsets, derivatives: vec![], simulation }
    }

    /// Whether the last run found a valid derivative in every environment ([`Derivative::sound`]).
    pub fn are_sound(&self) -> bool {
        !self.derivatives.is_empty() && self.derivatives.iter().all(|derivative| derivative.sound)
    }
}

impl Run for Derivatives {
    /// Does nothing, because the run does not change the simulation's state.
    fn rewind(&mut self) {}

    fn run(&mut self) {
        let Self { simulation, ctrl, offsets, derivatives } = self;
        let query = DerivativeQuery { parts: &PARTS, offsets, points: OFFSETS.len(), tolerance: TOLERANCE };
        *derivatives = differentiate(simulation, ctrl, &query).expect("arrays of the right lengths");
    }

    fn environment_steps(&self) -> u64 {
        self.simulation.num_envs() as u64
    }
}
