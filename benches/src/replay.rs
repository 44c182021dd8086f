//! Reader of recordings by `Stepper.record`, so that their steps can be repeated. python/stepper/recording/format.py describes the format.

use std::path::Path;
use std::sync::{Arc, LazyLock};

use serde::de::Error as _;
use serde::{Deserialize, Deserializer};
use stepper_core::model::Model;
use stepper_core::{
    AppliedInput, ContactLaw, Episode, Error, Integrator, Options, Precision, SavedState, Simulation, Solver, Stabilization,
};
use stepper_core::{StateRows, StepInputs};

use crate::npz::{Array, Npz};

/// Definition of the recording format. The recorder in Python reads the same file.
static DEFINITION: LazyLock<Definition> = LazyLock::new(|| {
    serde_json::from_str(include_str!("../../python/stepper/recording/format.json")).expect("format.json has the fields of a Definition")
});
/// Size of the header of a block of rows, bytes: length of the archive, numbers of rows and of calls of step, and digest.
const BLOCK_HEADER: usize = 3 * 8 + 32;

/// Version, file names and kinds of rows of the recording format.
#[derive(Deserialize)]
struct Definition {
    /// Version of the format.
    format: u32,
    /// Name of the file with the header.
    header: String,
    /// Name of the file with the model.
    model: String,
    /// Name of the file with the rows.
    rows: String,
    /// Names of the kinds of calls. A recording stores each kind as its index in this list.
    kinds: Vec<String>,
}

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
        let (header, rows) = (place(&DEFINITION.header), place(&DEFINITION.rows));
        let text = std::fs::read_to_string(&header).map_err(|e| format!("{header}: {e}; give the folder that Stepper.record wrote"))?;
        // The version comes first, because a header of another version may have other fields.
        let version: Version = serde_json::from_str(&text).map_err(|e| format!("{header}: {e}"))?;
        version.check(&header)?;
        let head: Header = serde_json::from_str(&text).map_err(|e| format!("{header}: {e}"))?;
        head.check(&header)?;
        let model = Arc::new(Model::load(place(&DEFINITION.model)).map_err(|e| e.to_string())?);
        let num_envs = head.num_envs.unwrap_or(1);
        let (mut start, mut calls, mut end) = (None, vec![], vec![]);
        for archive in blocks(&std::fs::read(&rows).map_err(|e| format!("{rows}: {e}"))?, &rows)? {
            let mut file = Npz::from_bytes(rows.clone(), archive)?;
            let kinds = file.array("kind")?.values;
            let mut steps = vec![].into_iter();
            if kinds.iter().any(|kind| DEFINITION.kinds.get(*kind as usize).is_some_and(|name| name == "step")) {
                steps = steps_of(&file.array("ctrl")?, &file.array("nstep")?).into_iter();
                let qpos = file.array("qpos")?;
                end = qpos.row(qpos.shape[0] - 1).to_vec();
            }
            for (row, kind) in kinds.iter().enumerate() {
                let refuse = |what: &str| format!("{rows}, row {row} of its block: {what}");
                let kind = DEFINITION.kinds.get(*kind as usize).ok_or_else(|| refuse(&format!("{kind} is no kind of row")))?;
                let mut arguments = Arguments::of(&mut file, row)?;
                match kind.as_str() {
                    "start" => {
                        start = arguments.take("state").map(|state| state.values.iter().map(|&byte| byte as u8).collect::<Vec<u8>>())
                    }
                    "step" => calls.push(steps.next().ok_or_else(|| refuse("a step that has no numbers"))?),
                    "applied" => {
                        let inputs = AppliedInput::ALL.map(|input| Some((input, arguments.take(input.name())?.values)));
                        calls.push(Call::Apply(inputs.into_iter().flatten().collect()));
                    }
                    "reset" => calls.push(arguments.reset(num_envs)),
                    other => return Err(refuse(&format!("{other} is not repeated here; record an episode without it"))),
                }
                if let Some((name, _)) = arguments.0.first() {
                    return Err(refuse(&format!("{name} of {kind} is not repeated here; record an episode without it")));
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
            start: SavedState::from_bytes(&start).map_err(|e| format!("{rows}: {e}"))?,
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

/// Archives of all blocks of a file of rows, in order. `place` names the file in error messages.
fn blocks(mut bytes: &[u8], place: &str) -> Result<Vec<Vec<u8>>, String> {
    let mut archives = vec![];
    while !bytes.is_empty() {
        let cut = || format!("{place}: the last block is cut off; record anew");
        let (header, rest) = bytes.split_at_checked(BLOCK_HEADER).ok_or_else(cut)?;
        let length = u64::from_le_bytes(header[..8].try_into().expect("eight bytes"));
        let (archive, rest) = usize::try_from(length).ok().and_then(|length| rest.split_at_checked(length)).ok_or_else(cut)?;
        archives.push(archive.to_vec());
        bytes = rest;
    }
    Ok(archives)
}

fn steps_of(ctrl: &Array, nstep: &Array) -> Vec<Call> {
    (0..nstep.values.len()).map(|k| Call::Step { ctrl: ctrl.row(k).to_vec(), nstep: nstep.values[k] as usize }).collect()
}

/// Recorded arguments of a call other than `step`, by name.
struct Arguments(Vec<(String, Array)>);

impl Arguments {
    /// Reads the arguments of a row of a block.
    fn of(file: &mut Npz, row: usize) -> Result<Self, String> {
        let prefix = format!("{row}/");
        let names: Vec<String> = file.names().filter_map(|name| name.strip_prefix(&prefix).map(String::from)).collect();
        let arrays = names.into_iter().map(|name| Ok((name.clone(), file.array(&format!("{prefix}{name}"))?)));
        Ok(Self(arrays.collect::<Result<_, String>>()?))
    }

    /// Removes an argument from the list and returns it, if the call has it.
    fn take(&mut self, name: &str) -> Option<Array> {
        let place = self.0.iter().position(|(own, _)| own == name)?;
        Some(self.0.swap_remove(place).1)
    }

    /// Reset of a batch of `num_envs` environments with these arguments.
    ///
    /// `envs` is a mask or has indices. With indices, states have one row per index. A state without rows is that of all environments. The
    /// seed concerns random errors of sensors alone, and is removed.
    fn reset(&mut self, num_envs: usize) -> Call {
        self.take("seed");
        let order: Vec<usize> = match self.take("envs") {
            None => (0..num_envs).collect(),
            Some(mask) if mask.is_mask => (0..num_envs).filter(|&env| mask.values[env] != 0.0).collect(),
            Some(indices) => indices.values.iter().map(|&index| index.rem_euclid(num_envs as f64) as usize).collect(),
        };
        let mut rows = |name: &str| {
            let given = self.take(name)?;
            let size = *given.shape.last().unwrap_or(&1);
            let mut all = vec![0.0; num_envs * size];
            for (k, &env) in order.iter().enumerate() {
                let row = match given.shape.len() {
                    0 | 1 => 0,
                    _ if given.shape[0] == num_envs => env,
                    _ => k,
                };
                all[env * size..(env + 1) * size].copy_from_slice(&given.values[row * size..(row + 1) * size]);
            }
            Some(all)
        };
        let (qpos, qvel) = (rows("qpos"), rows("qvel"));
        let mut envs = order;
        envs.sort_unstable();
        Call::Reset { envs, qpos, qvel }
    }
}

/// Version in a recording's run.json.
#[derive(Deserialize)]
struct Version {
    format: u32,
}

impl Version {
    fn check(&self, place: &str) -> Result<(), String> {
        let read = DEFINITION.format;
        if self.format == read {
            Ok(())
        } else {
            Err(format!("{place}: format {} of recordings, this program reads {read}: record anew", self.format))
        }
    }
}

/// Fields of a recording's run.json that this program uses.
#[derive(Deserialize)]
struct Header {
    closed: bool,
    note: String,
    #[serde(with = "PythonOptions")]
    options: Options,
    num_envs: Option<usize>,
    precision: String,
    actuators: Option<serde_json::Value>,
    sensors: Option<serde_json::Value>,
}

impl Header {
    fn check(&self, place: &str) -> Result<(), String> {
        if !self.closed {
            return Err(format!("{place}: the recording was not closed, its end may be missing; record anew"));
        }
        if self.actuators.is_some() || self.sensors.is_some() {
            return Err(format!("{place}: models of sensors and actuators are not repeated here; record an episode without them"));
        }
        Ok(())
    }
}

/// Fields of `stepper.Options` in the JSON file run.json, from which serde reads [`Options`].
#[derive(Deserialize)]
#[serde(remote = "Options", deny_unknown_fields)]
struct PythonOptions {
    timestep: Option<f64>,
    #[serde(with = "ContactLawName")]
    contact: ContactLaw,
    #[serde(deserialize_with = "integrator")]
    integrator: Option<Integrator>,
    error: Option<f64>,
    #[serde(with = "SolverName")]
    solver: Solver,
    iterations: u32,
    tolerance: Option<f64>,
    rtol: f64,
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
    let found = Integrator::ALL.into_iter().find(|integrator| integrator.name() == name);
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

    /// Episode that tests/helpers/bench_episode.py recorded, which a test in Python compares with a new recording.
    const EPISODE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/episode");
    const HEADER: &str = r#"{"format": 0, "closed": true, "note": "", "num_envs": 2, "precision": "f32", "actuators": null, "sensors": null,
        "options": {"timestep": null, "contact": "hard", "integrator": "rk4", "error": null, "solver": "pgs", "iterations": 7, "tolerance": 1e-5, "rtol": 1e-3, "stabilization": "none",
            "baumgarte": 0.2, "slop": 1e-5, "max_correction_speed": 1.0, "restitution_threshold": 0.01, "max_contacts": null}}"#;

    #[test]
    fn an_episode_in_the_current_format_is_read_and_repeated() {
        let replay = Replay::load(Path::new(EPISODE)).unwrap();
        assert_eq!((replay.name.as_str(), replay.num_envs, replay.end.len()), ("pendulums", 2, 2));
        assert_eq!(replay.calls.iter().map(Call::steps).collect::<Vec<_>>(), [1, 2, 0, 1, 0, 3, 0, 1]);
        let resets: Vec<_> = replay.calls.iter().filter(|call| matches!(call, Call::Reset { .. })).collect();
        assert!(
            matches!(resets[0], Call::Reset { envs, qpos: Some(qpos), qvel: None } if envs == &[1] && qpos == &[0.0, 0.4]),
            "{resets:?}"
        );
        assert!(matches!(resets[1], Call::Reset { envs, qpos: None, qvel: Some(v) } if envs == &[0, 1] && v == &[0.1, 0.1]), "{resets:?}");
        let mut simulation = replay.simulation().unwrap();
        replay.calls.iter().for_each(|call| call.run(&mut simulation).unwrap());
    }

    #[test]
    fn options_that_this_program_does_not_know_are_refused() {
        let text = HEADER.replace("\"slop\"", "\"viscosity\": 1.0, \"slop\"");
        let error = serde_json::from_str::<Header>(&text).err().unwrap().to_string();
        assert!(error.contains("viscosity"), "{error}");
    }

    #[test]
    fn a_file_of_rows_that_is_cut_is_refused() {
        let bytes = std::fs::read(Path::new(EPISODE).join("rows.bin")).unwrap();
        assert!(blocks(&bytes, "rows.bin").is_ok_and(|archives| !archives.is_empty()));
        for length in [1, BLOCK_HEADER, bytes.len() - 1] {
            assert!(blocks(&bytes[..length], "rows.bin").is_err_and(|error| error.contains("rows.bin")));
        }
    }

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
        for (of, other, word) in
            [("\"closed\": true", "\"closed\": false", "not closed"), ("\"sensors\": null", "\"sensors\": {}", "sensors")]
        {
            let head: Header = serde_json::from_str(&HEADER.replace(of, other)).unwrap();
            let error = head.check("out/run.json").unwrap_err();
            assert!(error.contains("out/run.json") && error.contains(word), "{error}");
        }
        let error = Version { format: 0 }.check("out/run.json").unwrap_err();
        assert!(error.contains("out/run.json") && error.contains("format 0"), "{error}");
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
