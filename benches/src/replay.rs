//! Reader of recordings by `Stepper.record`, so that their steps can be repeated. python/stepper/recording/format.py describes the format.

use std::path::Path;
use std::sync::Arc;

use serde::de::Error as _;
use serde::{Deserialize, Deserializer};
use stepper_core::model::Model;
use stepper_core::{
    AppliedInput, ContactLaw, Episode, Error, Integrator, Options, Precision, SavedState, Simulation, Solver, Stabilization,
};
use stepper_core::{StateRows, StepInputs};

use crate::npz::{Array, Npz};

/// Version of the recording format that this program reads.
const FORMAT: u32 = 4;
/// Names of the kinds of calls in a recording. The files of a recording store each kind as its index in this array.
const KINDS: [&str; 6] = ["start", "step", "reset", "set_state", "applied", "randomize"];

/// Recording of a batch: model, options, initial state and calls.
pub struct Replay {
    /// Note of the recording, or the name of its folder if the note is empty.
    pub name: String,
    /// Model of the batch.
    pub model: Arc<Model>,
    /// Options of the step.
    pub options: Options,
    /// Floating-point precision of the batch.
    pub precision: Precision,
    /// Number of environments.
    pub num_envs: usize,
    /// Initial state of all environments.
    pub start: SavedState,
    /// Calls after the initial state, in order.
    pub calls: Vec<Call>,
    /// Configurations of all environments after the last step, (num_envs, nq).
    pub end: Vec<f64>,
}

/// Recorded call on a batch of environments. The environments are the first axis of all arrays.
#[derive(Clone, Debug)]
pub enum Call {
    /// Recorded call of `Stepper.step`, whose controls are constant for all its steps.
    Step {
        /// Controls, (num_envs, nu).
        ctrl: Vec<f64>,
        /// Number of steps of the call.
        nstep: usize,
    },
    /// Recorded change of inputs that stay applied, such as external forces: new values for all environments.
    Apply(Vec<(AppliedInput, Vec<f64>)>),
    /// Recorded reset of some environments to given or default states.
    Reset {
        /// Indices of the environments, ascending.
        envs: Vec<usize>,
        /// Configurations of all environments, (num_envs, nq). `None` sets the reference configuration of the model.
        qpos: Option<Vec<f64>>,
        /// Velocities of all environments, (num_envs, nv). `None` sets zero velocities.
        qvel: Option<Vec<f64>>,
    },
}

impl Call {
    /// Repeats the recorded call on a batch of environments.
    ///
    /// # Errors
    /// If the call does not fit the batch.
    pub fn run(&self, simulation: &mut Simulation) -> Result<(), Error> {
        match self {
            Self::Step { ctrl, nstep } => simulation.step(&StepInputs { ctrl, ..StepInputs::default() }, *nstep),
            Self::Apply(inputs) => inputs.iter().try_for_each(|(input, values)| simulation.apply(*input, values)),
            Self::Reset { envs, qpos, qvel } => {
                let rows = StateRows { qpos: qpos.as_deref(), qvel: qvel.as_deref(), ..StateRows::default() };
                simulation.start_episodes(envs, &Episode { rows, ..Episode::default() })
            }
        }
    }

    /// Copy of the call for a single environment: keeps only the inputs of environment `env` of the `num_envs` recorded environments.
    pub fn of_one(&self, env: usize, num_envs: usize) -> Self {
        let part = |all: &Vec<f64>| {
            let size = all.len() / num_envs;
            all[env * size..(env + 1) * size].to_vec()
        };
        match self {
            Self::Step { ctrl, nstep } => Self::Step { ctrl: part(ctrl), nstep: *nstep },
            Self::Apply(inputs) => Self::Apply(inputs.iter().map(|(input, values)| (*input, part(values))).collect()),
            Self::Reset { envs, qpos, qvel } => {
                let envs = if envs.contains(&env) { vec![0] } else { vec![] };
                Self::Reset { envs, qpos: qpos.as_ref().map(part), qvel: qvel.as_ref().map(part) }
            }
        }
    }

    /// Number of simulation steps of the recorded call; 0 for calls other than `step`.
    pub fn steps(&self) -> usize {
        if let Self::Step { nstep, .. } = self { *nstep } else { 0 }
    }
}

impl Replay {
    /// Reads a recording from its folder.
    ///
    /// # Errors
    /// If the recording cannot be read, was not closed, or cannot be repeated by this program. The program cannot repeat models of sensors
    /// or actuators, randomised parameters, and calls of `set_state`.
    pub fn load(folder: &Path) -> Result<Self, String> {
        let place = |name: &str| folder.join(name).display().to_string();
        let header = place("run.json");
        let text = std::fs::read_to_string(&header).map_err(|e| format!("{header}: {e}; give the folder that Stepper.record wrote"))?;
        let head: Header = serde_json::from_str(&text).map_err(|e| format!("{header}: {e}"))?;
        head.check(&header)?;
        let model = Arc::new(Model::load(place("model.stepper")).map_err(|e| e.to_string())?);
        let num_envs = head.num_envs.unwrap_or(1);
        let (mut start, mut calls, mut end) = (None, vec![], vec![]);
        for entry in &head.files {
            let path = folder.join(&entry.name);
            let refuse = |row: usize, what: &str| format!("{}, row {row}: {what}", path.display());
            let mut file = Npz::open(&path)?;
            let mut steps = vec![].into_iter();
            if let Some(last) = entry.steps.checked_sub(1) {
                steps = steps_of(&file.array("ctrl")?, &file.array("nstep")?).into_iter();
                end = file.array("qpos")?.row(last).to_vec();
            }
            for (row, kind) in file.array("kind")?.values.iter().enumerate() {
                let mut given = |name: &str| Ok::<_, String>(file.get(&format!("{row}/{name}"))?.map(|array| array.values));
                match KINDS.get(*kind as usize) {
                    Some(&"start") => start = given("state")?.map(|bytes| bytes.iter().map(|&byte| byte as u8).collect::<Vec<u8>>()),
                    Some(&"step") => calls.push(steps.next().ok_or_else(|| refuse(row, "a step that has no numbers"))?),
                    Some(&"applied") => {
                        let inputs = AppliedInput::ALL.map(|input| Ok(given(input.name())?.map(|values| (input, values))));
                        calls.push(Call::Apply(inputs.into_iter().filter_map(Result::transpose).collect::<Result<_, String>>()?));
                    }
                    Some(&"reset") => {
                        let chosen = given("mask")?.unwrap_or_else(|| vec![1.0; num_envs]);
                        let envs = chosen.iter().enumerate().filter(|(_, on)| **on != 0.0).map(|(env, _)| env).collect();
                        calls.push(Call::Reset { envs, qpos: given("qpos")?, qvel: given("qvel")? });
                    }
                    Some(other) => return Err(refuse(row, &format!("{other} is not repeated here; record an episode without it"))),
                    None => return Err(refuse(row, &format!("{kind} is no kind of row"))),
                }
            }
        }
        // Calls after the last step affect no step, but would change the final configurations.
        calls.truncate(calls.iter().rposition(|call| call.steps() > 0).map_or(0, |last| last + 1));
        let start = start.ok_or_else(|| format!("{header}: the recording has no start"))?;
        Ok(Self {
            name: if head.note.is_empty() { folder.file_name().unwrap_or_default().to_string_lossy().into() } else { head.note },
            model,
            options: head.options,
            precision: if head.precision == "f32" { Precision::F32 } else { Precision::F64 },
            num_envs,
            start: SavedState::from_bytes(&start).map_err(|e| format!("{}: {e}", place("00000.npz")))?,
            calls,
            end,
        })
    }

    /// Creates a batch of environments in the initial state of the recording. The calling thread steps the batch.
    ///
    /// # Errors
    /// Returns the errors of [`Simulation::new`], and an error if the state belongs to another batch.
    pub fn simulation(&self) -> Result<Simulation, Error> {
        let mut simulation = Simulation::new(self.model.clone(), self.options, Some(self.num_envs), self.precision, 1)?;
        simulation.restore_state(&self.start)?;
        Ok(simulation)
    }
}

fn steps_of(ctrl: &Array, nstep: &Array) -> Vec<Call> {
    (0..nstep.values.len()).map(|k| Call::Step { ctrl: ctrl.row(k).to_vec(), nstep: nstep.values[k] as usize }).collect()
}

/// Fields of a recording's run.json that this program uses.
#[derive(Deserialize)]
struct Header {
    format: u32,
    closed: bool,
    note: String,
    #[serde(with = "PythonOptions")]
    options: Options,
    num_envs: Option<usize>,
    precision: String,
    actuators: Option<serde_json::Value>,
    sensors: Option<serde_json::Value>,
    files: Vec<Entry>,
}

impl Header {
    fn check(&self, place: &str) -> Result<(), String> {
        if self.format != FORMAT {
            return Err(format!("{place}: format {} of recordings, this program reads {FORMAT}: record anew", self.format));
        }
        if !self.closed {
            return Err(format!("{place}: the recording was not closed, its end may be missing; record anew"));
        }
        if self.actuators.is_some() || self.sensors.is_some() {
            return Err(format!("{place}: models of sensors and actuators are not repeated here; record an episode without them"));
        }
        Ok(())
    }
}

/// Element of the list `files` in run.json: name of a data file, and the number of recorded steps in the file.
#[derive(Deserialize)]
struct Entry {
    name: String,
    steps: usize,
}

/// Fields of `stepper.Options` in the JSON file run.json, from which serde reads [`Options`].
#[derive(Deserialize)]
#[serde(remote = "Options")]
struct PythonOptions {
    timestep: Option<f64>,
    #[serde(with = "ContactLawName")]
    contact: ContactLaw,
    #[serde(deserialize_with = "integrator")]
    integrator: Option<Integrator>,
    #[serde(with = "SolverName")]
    solver: Solver,
    iterations: u32,
    tolerance: Option<f64>,
    #[serde(with = "StabilizationName")]
    stabilization: Stabilization,
    baumgarte: f64,
    slop: f64,
    max_correction_speed: f64,
    restitution_threshold: f64,
    max_contacts: Option<u32>,
}

/// Contact laws by their Python names in run.json, from which serde reads a [`ContactLaw`].
#[derive(Deserialize)]
#[serde(remote = "ContactLaw", rename_all = "lowercase")]
enum ContactLawName {
    Hard,
    Mujoco,
}

/// Reads an integrator by its Python name; `None` if the value is null.
fn integrator<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Integrator>, D::Error> {
    let Some(name) = Option::<String>::deserialize(from)? else { return Ok(None) };
    let all = [Integrator::Euler, Integrator::Midpoint, Integrator::Implicit, Integrator::ImplicitFast, Integrator::Rk4];
    let found = all.into_iter().find(|integrator| integrator.name() == name);
    found.map(Some).ok_or_else(|| D::Error::custom(format!("integrator {name}, which this program does not have")))
}

/// Solvers by their Python names in run.json, from which serde reads a [`Solver`].
#[derive(Deserialize)]
#[serde(remote = "Solver", rename_all = "lowercase")]
enum SolverName {
    Auto,
    Pgs,
    Newton,
}

/// Stabilization methods by their Python names in run.json, from which serde reads a [`Stabilization`].
#[derive(Deserialize)]
#[serde(remote = "Stabilization", rename_all = "lowercase")]
enum StabilizationName {
    Baumgarte,
    Split,
    None,
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = r#"{"format": 4, "closed": true, "note": "", "num_envs": 2, "precision": "f32", "actuators": null, "sensors": null,
        "options": {"timestep": null, "contact": "hard", "integrator": "rk4", "solver": "pgs", "iterations": 7, "tolerance": 1e-5, "stabilization": "none",
            "baumgarte": 0.2, "slop": 1e-5, "max_correction_speed": 1.0, "restitution_threshold": 0.01, "max_contacts": null},
        "files": [{"name": "00000.npz", "rows": 1, "steps": 0, "sha256": ""}]}"#;

    #[test]
    fn options_are_read_by_their_names_in_python() {
        let head: Header = serde_json::from_str(HEADER).unwrap();
        head.check("run.json").unwrap();
        let options = head.options;
        assert_eq!((options.integrator, options.solver, options.stabilization), (Some(Integrator::Rk4), Solver::Pgs, Stabilization::None));
        assert_eq!((options.iterations, options.tolerance, options.timestep), (7, Some(1e-5), None));
    }

    #[test]
    fn what_cannot_be_repeated_is_refused() {
        for (of, other, word) in [
            ("\"format\": 4", "\"format\": 3", "format 3"),
            ("\"closed\": true", "\"closed\": false", "not closed"),
            ("\"sensors\": null", "\"sensors\": {}", "sensors"),
        ] {
            let head: Header = serde_json::from_str(&HEADER.replace(of, other)).unwrap();
            let error = head.check("out/run.json").unwrap_err();
            assert!(error.contains("out/run.json") && error.contains(word), "{error}");
        }
        let error = Replay::load(Path::new("no/such/folder")).err().unwrap();
        assert!(error.contains("no/such/folder") && error.contains("Stepper.record"), "{error}");
    }

    #[test]
    fn a_call_for_one_environment_has_its_part() {
        let step = Call::Step { ctrl: vec![1.0, 2.0, 3.0, 4.0], nstep: 3 };
        assert!(matches!(step.of_one(1, 2), Call::Step { ctrl, nstep: 3 } if ctrl == [3.0, 4.0]));
        let reset = Call::Reset { envs: vec![1], qpos: Some(vec![5.0, 6.0]), qvel: None };
        assert!(matches!(reset.of_one(0, 2), Call::Reset { envs, .. } if envs.is_empty()));
        assert!(matches!(reset.of_one(1, 2), Call::Reset { envs, qpos, qvel: None } if envs == [0] && qpos == Some(vec![6.0])));
    }
}
