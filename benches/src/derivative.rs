//! Benchmark run of the derivatives of a step with respect to the state and the controls.

use stepper_core::{Level, Precision, Simulation};
use stepper_derivative::{DerivativeQuery, DerivativeRows, StatePart, differentiate};

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
    /// Result: derivatives, (num_envs, 2 nv + na, columns).
    slopes: Vec<f64>,
    /// Result: flags of the kinks of each column, (num_envs, columns).
    causes: Vec<u32>,
    /// Two result arrays, each with one number per environment. The first has the distance to the nearest kink (a change, such as of
    /// contacts or limits, at which the step has no derivative). The second has the solver residual, m/s.
    numbers: [Vec<f64>; 2],
    /// Result: 1 for each environment with a valid derivative, otherwise 0.
    sound: Vec<u8>,
    /// Result: status flags of the step in each environment.
    status: Vec<u32>,
    /// Result: qpos, qvel and act after the step.
    state: [Vec<f64>; 3],
}

impl Derivatives {
    /// Benchmark run with the first `count` environments of a scene, in their states after the scene's warm-up steps.
    pub fn new(scene: &Scene, count: usize, level: Level) -> Self {
        let simulation = Episode::new(scene, 0, count, Precision::F64, level).into_simulation();
        let model = simulation.model();
        let [nq, nv, na, nu] = [model.nq(), model.nv(), model.na(), model.nu()];
        let columns = 2 * nv + nu;
        let offsets = (0..count).flat_map(|_| OFFSETS).flat_map(|offset| std::iter::repeat_n(offset, columns)).collect();
        Self {
            ctrl: simulation.ctrl().to_vec(),
            offsets,
            slopes: vec![0.0; count * (2 * nv + na) * columns],
            causes: vec![0; count * columns],
            numbers: [(); 2].map(|()| vec![0.0; count]),
            sound: vec![0; count],
            status: vec![0; count],
            state: [nq, nv, na].map(|width| vec![0.0; count * width]),
            simulation,
        }
    }

    /// Whether the last run found a valid derivative in every environment ([`DerivativeRows::sound`]).
    pub fn are_sound(&self) -> bool {
        self.sound.iter().all(|&sound| sound == 1)
    }
}

impl Run for Derivatives {
    /// Does nothing, because the run does not change the simulation's state.
    fn rewind(&mut self) {}

    fn run(&mut self) {
        let Self { simulation, ctrl, offsets, slopes, causes, numbers: [distance, residual], sound, status, state } = self;
        let query = DerivativeQuery { parts: &PARTS, offsets, points: OFFSETS.len(), tolerance: TOLERANCE };
        let state = state.each_mut().map(|part| &mut part[..]);
        let rows = DerivativeRows { slopes, causes, distance, sound, residual, status, state };
        differentiate(simulation, ctrl, &query, rows).expect("arrays of the right lengths");
    }

    fn environment_steps(&self) -> u64 {
        self.simulation.num_envs() as u64
    }
}
