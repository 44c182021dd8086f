//! Methods that read, set, save and restore the state of the environments.

use std::collections::BTreeMap;

use numpy::PyUntypedArrayMethods;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyList, PyTuple};
use stepper_core::{Episode, Field, SavedState, StateRows};

use crate::arguments::{Env, Flag, no_others, required};
use crate::array::{array, check_shape, float64_array, read_only, seeds};
use crate::error::value_error;
use crate::getters::getters;
use crate::selection::{Numbers, Selection, indices};
use crate::state::State;
use crate::stepper::recording::notify;
use crate::stepper::{Reading, Stepper, Writing};

/// Numbers of an array argument that may be None.
type Given<'py> = Option<Numbers<'py>>;

fn numbers<'a>(given: &'a Given<'_>) -> PyResult<Option<&'a [f64]>> {
    given.as_ref().map(Numbers::as_slice).transpose()
}

/// One state for all selected environments, or one state for each of them.
pub(super) enum States<'py> {
    One(Bound<'py, State>),
    Each(Vec<Bound<'py, State>>),
}

/// States from an argument that is a `State`, or a list or tuple of `State` objects. The result is None for other arguments.
pub(super) fn states_of<'py>(given: &Bound<'py, PyAny>) -> Option<States<'py>> {
    if let Ok(state) = given.cast::<State>() {
        return Some(States::One(state.clone()));
    }
    let listed: Vec<Bound<'py, PyAny>> = match given.cast::<PyList>() {
        Ok(list) => list.iter().collect(),
        Err(_) => given.cast::<PyTuple>().ok()?.iter().collect(),
    };
    let states: Vec<_> = listed.iter().map_while(|item| item.cast::<State>().ok().cloned()).collect();
    (!states.is_empty() && states.len() == listed.len()).then_some(States::Each(states))
}

impl Stepper {
    fn gather<'py>(&self, py: Python<'py>, field: Field) -> PyResult<Bound<'py, PyAny>> {
        let width = field.width(self.simulation.model());
        let mut data = vec![0.0; self.n() * width];
        for (env, row) in data.chunks_exact_mut(width.max(1)).enumerate() {
            self.simulation.get(field, env, row).expect("a row of an environment");
        }
        read_only(array(py, &self.shape(&[width]), data, self.simulation.precision())?)
    }

    /// Values of a state field, such as qpos, for the selected environments, from an optional array argument. Without the argument, the
    /// result is None.
    fn field_rows<'py>(&self, field: Field, given: Option<&Bound<'py, PyAny>>, selection: &Selection) -> PyResult<Given<'py>> {
        given.map(|given| self.selected_rows(given, field.name(), &[field.width(self.simulation.model())], true, selection)).transpose()
    }

    /// Times from the optional argument `time`, s: one for each selected environment, or a single one for all.
    fn times<'py>(&self, given: Option<&Bound<'py, PyAny>>, selection: &Selection) -> PyResult<Given<'py>> {
        let Some(given) = given else { return Ok(None) };
        let times = float64_array(given, "time")?;
        if times.len() == 1 {
            return Ok(Some(Numbers::Given(times)));
        }
        check_shape("time", times.shape(), &[&[selection.rows(self.n())], &[]])?;
        Ok(Some(Numbers::Scattered(selection.scattered(times.as_slice()?, self.n()))))
    }

    /// Restores one state in all selected environments, or one state in each of them. If any restore fails, no environment changes.
    pub(super) fn take_states(&mut self, py: Python<'_>, states: &States<'_>, selection: &Selection) -> PyResult<()> {
        self.apply(py)?;
        self.restore_states(states, selection)?;
        self.refresh_eq_active(py)
    }

    fn restore_states(&mut self, states: &States<'_>, selection: &Selection) -> PyResult<()> {
        let states = match states {
            States::One(state) => {
                return self.simulation.restore_state_in(&state.get().saved, &selection.ascending()).map_err(value_error);
            }
            States::Each(states) => states,
        };
        if states.len() != selection.envs.len() {
            let (found, must) = (states.len(), selection.envs.len());
            let message = format!("there are {found} states, must be {must}: one for each environment of envs, or a single state for all");
            return Err(PyValueError::new_err(message));
        }
        let before = self.simulation.save_state();
        for (k, (state, &env)) in states.iter().zip(&selection.envs).enumerate() {
            if let Err(error) = self.simulation.restore_state_in(&state.get().saved, &[env]) {
                self.simulation.restore_state(&before).map_err(value_error)?;
                return Err(PyValueError::new_err(format!("state {k}, of environment {env}: {error}")));
            }
        }
        Ok(())
    }
}

#[pymethods]
impl Stepper {
    /// Starts a new episode in all environments, or in the environments `envs`. The previous episode has no influence on the new one.
    ///
    /// Applied forces become zero, and mocap bodies return to the poses of the model. Controls become zero, or the controls of the
    /// keyframe, until the next `step` with controls. Parameters of `randomize` are kept.
    ///
    /// Args:
    ///     envs: Environments: a boolean mask (num_envs,), or unique integer indices (k,). None selects all environments. With a mask,
    ///         arrays have a row for each environment of the batch, and rows of unselected environments are ignored. With indices, arrays
    ///         have a row for each index, in order.
    ///     qpos: Initial positions, (num_envs, nq) or (nq,). None uses the reference configuration. Quaternions are normalised.
    ///     qvel: Initial velocities, (num_envs, nv) or (nv,). None uses zero velocities.
    ///     seed: New seed of the sensor errors, or seeds (num_envs,). None keeps the old seeds.
    ///     keyframe: Name or index of a keyframe with the initial qpos, qvel, act, ctrl and time.
    ///
    /// Raises:
    ///     TypeError: A seed or an index is no integer.
    ///     IndexError: An index is out of range.
    ///     ValueError: A shape is wrong, a number is not finite, a quaternion is zero, or a seed is negative. No environment changes.
    ///     KeyError: The model has no such keyframe.
    #[pyo3(signature = (envs=None, *, qpos=None, qvel=None, seed=None, keyframe=None, **others), text_signature = "($self, envs=None, *, qpos=None, qvel=None, seed=None, keyframe=None)")]
    fn reset(
        slf: &Bound<'_, Self>,
        envs: Option<Bound<'_, PyAny>>,
        qpos: Option<Bound<'_, PyAny>>,
        qvel: Option<Bound<'_, PyAny>>,
        seed: Option<Bound<'_, PyAny>>,
        keyframe: Option<Bound<'_, PyAny>>,
        others: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<()> {
        no_others("Stepper.reset", others, &["envs", "qpos", "qvel", "seed", "keyframe"])?;
        let mut this = Writing::try_from(slf)?;
        let selection = this.selection(envs.as_ref())?;
        let new_seeds = seed.as_ref().map(|seed| seeds(seed, selection.rows(this.n()))).transpose()?;
        let new_seeds = new_seeds.map(|seeds| if seeds.len() == 1 { seeds } else { selection.scattered(&seeds, this.n()) });
        let (q, v) = (this.field_rows(Field::Qpos, qpos.as_ref(), &selection)?, this.field_rows(Field::Qvel, qvel.as_ref(), &selection)?);
        if selection.envs.is_empty() {
            return Ok(());
        }
        let chosen = selection.ascending();
        let key = keyframe.as_ref().map(|name| this.model.get().find_keyframe(name)).transpose()?;
        let rows = StateRows { qpos: numbers(&q)?, qvel: numbers(&v)?, ..StateRows::default() };
        this.simulation
            .start_episodes(&chosen, &Episode { seed: new_seeds.as_deref(), keyframe: key.as_ref(), rows })
            .map_err(value_error)?;
        if let Some(&[one]) = new_seeds.as_deref() {
            this.seed = one;
        }
        this.reset_applied(slf.py(), &chosen)?;
        notify(slf, this, "reset", &[("envs", envs), ("qpos", qpos), ("qvel", qvel), ("seed", seed), ("keyframe", keyframe)])
    }

    /// Sets positions, velocities, activations or time, or restores a complete `State`.
    ///
    /// The next state depends on `qpos`, `qvel`, `act` and the controls; the solver's warm start changes velocities by about 1e-7 m/s only
    /// (docs/development/decisions/visible_state.md). Drives (delay lines, lags, integrals) and sensors (bias, drift, delay lines, held
    /// samples) have further memory.
    ///
    /// Args:
    ///     qpos: Positions, (num_envs, nq) or (nq,). A state from `get_state` is also possible: the state of a batch of the same size
    ///         restores each environment, and the state of a single environment is copied to all. A list has one state of a single
    ///         environment for each of `envs`. A simulation repeats its motion from a restored state, bit for bit. Copies of a single state
    ///         have independent random sensor errors.
    ///     qvel: Velocities, (num_envs, nv) or (nv,).
    ///     envs: Environments, as in `reset`. `set_state(get_state(env=3), envs=[5, 6])` copies environment 3 to environments 5 and 6.
    ///     act: Activations, (num_envs, na) or (na,).
    ///     time: Times, (num_envs,) or one for all, s.
    ///     keep_warmstart: Whether to keep the solver's warm start, contacts, flags, and the memory of drives and sensors. Use it in state
    ///         estimators that correct a running environment. False clears all of these, and the next control and reading fill the delay
    ///         lines, so that the motion depends on the new state alone.
    ///
    /// Raises:
    ///     TypeError: `keep_warmstart` is not True or False.
    ///     ValueError: A shape is wrong, a number is not finite, a quaternion is zero, or a state belongs to another model. No environment
    ///         changes.
    #[pyo3(signature = (qpos=None, qvel=None, envs=None, *, act=None, time=None, keep_warmstart=Flag::Value(false), **others), text_signature = "($self, qpos=None, qvel=None, envs=None, *, act=None, time=None, keep_warmstart=False)")]
    #[expect(clippy::too_many_arguments, reason = "each has a name of its own")]
    fn set_state(
        slf: &Bound<'_, Self>,
        qpos: Option<Bound<'_, PyAny>>,
        qvel: Option<Bound<'_, PyAny>>,
        envs: Option<Bound<'_, PyAny>>,
        act: Option<Bound<'_, PyAny>>,
        time: Option<Bound<'_, PyAny>>,
        keep_warmstart: Flag<'_>,
        others: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<()> {
        no_others("Stepper.set_state", others, &["qpos", "qvel", "envs", "act", "time", "keep_warmstart"])?;
        let keep_warmstart = keep_warmstart.from("keep_warmstart")?;
        let mut this = Writing::try_from(slf)?;
        let selection = this.selection(envs.as_ref())?;
        if let Some(states) = qpos.as_ref().and_then(states_of) {
            if qvel.is_some() || act.is_some() || time.is_some() || keep_warmstart {
                let message =
                    "set_state(state) accepts only envs as a further argument: the State contains positions, velocities and the rest";
                return Err(PyValueError::new_err(message));
            }
            if selection.envs.is_empty() {
                return Ok(());
            }
            this.take_states(slf.py(), &states, &selection)?;
            return notify(slf, this, "set_state", &[("state", qpos)]);
        }
        let q = this.field_rows(Field::Qpos, qpos.as_ref(), &selection)?;
        let v = this.field_rows(Field::Qvel, qvel.as_ref(), &selection)?;
        let (a, t) = (this.field_rows(Field::Act, act.as_ref(), &selection)?, this.times(time.as_ref(), &selection)?);
        if selection.envs.is_empty() {
            return Ok(());
        }
        let rows = StateRows { qpos: numbers(&q)?, qvel: numbers(&v)?, act: numbers(&a)?, time: numbers(&t)? };
        this.simulation.set_rows(&selection.ascending(), &rows, !keep_warmstart).map_err(value_error)?;
        let kept = keep_warmstart.then(|| PyBool::new(slf.py(), true).to_owned().into_any());
        let given = [("envs", envs), ("qpos", qpos), ("qvel", qvel), ("act", act), ("time", time), ("keep_warmstart", kept)];
        notify(slf, this, "set_state", &given)
    }

    /// Complete state, including the current controls and the active equalities.
    ///
    /// Applied inputs (`qfrc_applied`, `xfrc_applied`, mocap poses) and parameters of `randomize` are not part of the state.
    ///
    /// Args:
    ///     env: Index of an environment. None saves all environments.
    #[pyo3(signature = (env=None, **others), text_signature = "($self, env=None)")]
    fn get_state(slf: &Bound<'_, Self>, env: Option<Env>, others: Option<&Bound<'_, PyDict>>) -> PyResult<State> {
        no_others("Stepper.get_state", others, &["env"])?;
        let mut this = Writing::try_from(slf)?;
        this.apply(slf.py())?;
        let saved = match env {
            Some(env) => this.simulation.save_state_of(this.env(env)?),
            None => this.simulation.save_state(),
        };
        Ok(State { saved })
    }

    /// Copies states between environments: environment `envs[k]` gets the state of environment `sources[k]`; see `get_state`.
    ///
    /// All states are read before any is changed. The copies have independent random sensor errors.
    ///
    /// Args:
    ///     sources: Indices of the source environments: one for each environment in `envs`, or a single integer for all of them. Indices
    ///         may repeat.
    ///     envs: Target environments, as in `reset`.
    ///
    /// Raises:
    ///     TypeError: An index is no integer.
    ///     ValueError: The number of sources differs from the number of environments.
    ///     IndexError: An index is out of range.
    #[pyo3(signature = (sources=None, envs=None, **others), text_signature = "($self, sources, envs=None)")]
    fn copy_state<'py>(
        slf: &Bound<'py, Self>,
        sources: Option<Bound<'py, PyAny>>,
        envs: Option<Bound<'_, PyAny>>,
        others: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<()> {
        no_others("Stepper.copy_state", others, &["sources", "envs"])?;
        let sources = required("Stepper.copy_state", "sources", sources)?;
        let mut this = Writing::try_from(slf)?;
        let targets = this.selection(envs.as_ref())?.envs;
        let from = slf.py().import("numpy")?.call_method1("asarray", (&sources,))?;
        let single = from.getattr("ndim")?.extract::<usize>()? == 0;
        let mut from = indices(&from, this.n(), "sources")?;
        if single {
            from = vec![from[0]; targets.len()];
        }
        if from.len() != targets.len() {
            let (found, must) = (from.len(), targets.len());
            let message = format!("sources has {found} environments, must have {must}: one for each environment of envs, or one for all");
            return Err(PyValueError::new_err(message));
        }
        this.apply(slf.py())?;
        let mut moved: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (&source, &target) in from.iter().zip(&targets).filter(|(source, target)| source != target) {
            moved.entry(source).or_default().push(target);
        }
        if moved.is_empty() {
            return Ok(());
        }
        let states: Vec<(SavedState, Vec<usize>)> =
            moved.into_iter().map(|(source, targets)| (this.simulation.save_state_of(source), targets)).collect();
        for (state, mut targets) in states {
            targets.sort_unstable();
            this.simulation.restore_state_in(&state, &targets).map_err(value_error)?;
        }
        this.refresh_eq_active(slf.py())?;
        notify(slf, this, "set_state", &[("state", Some(sources))])
    }
}

getters! { Stepper, |slf, py| (Reading<'_>) -> PyResult<Bound<'py, PyAny>>;
    /// Positions, (num_envs, nq), m, rad and quaternions. `set_state(qpos=...)` sets them.
    qpos: slf.gather(py, Field::Qpos),
    /// Velocities, (num_envs, nv), m/s and rad/s. `set_state(qvel=...)` sets them.
    qvel: slf.gather(py, Field::Qvel),
    /// Activations of actuators, (num_envs, na). `set_state(act=...)` sets them.
    act: slf.gather(py, Field::Act),
    /// Current controls, (num_envs, nu): the controls of the last step. After a reset, the controls are those of the keyframe, or zero
    /// without a keyframe.
    ctrl: read_only(array(py, &slf.shape(&[slf.simulation.model().nu()]), slf.simulation.ctrl().to_vec(), slf.simulation.precision())?),
    /// Simulated time, (num_envs,), s. `set_state(time=...)` sets it.
    time: slf.per_env(py, |env| slf.simulation.time(env)),
}
