//! The state of the environments: read, set, saved and restored.

use numpy::PyUntypedArrayMethods;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict};
use stepper_core::{Episode, Field, StateRows};

use crate::arguments::{Env, no_others};
use crate::array::{array, check_shape, read_only, readonly, seeds};
use crate::error::value_error;
use crate::selection::{Numbers, Selection};
use crate::state::State;
use crate::stepper::recording::{notify, recorder_of};
use crate::stepper::taking_over::states_of;
use crate::stepper::{Reading, Stepper, borrow};

/// An array that may have been given.
type Given<'py> = Option<Numbers<'py>>;

fn numbers<'a>(given: &'a Given<'_>) -> PyResult<Option<&'a [f64]>> {
    given.as_ref().map(Numbers::as_slice).transpose()
}

impl Stepper {
    fn gather<'py>(&self, py: Python<'py>, field: Field) -> PyResult<Bound<'py, PyAny>> {
        let width = field.width(self.simulation.model());
        let mut data = vec![0.0; self.n() * width];
        if width > 0 {
            data.chunks_exact_mut(width)
                .enumerate()
                .for_each(|(env, row)| self.simulation.get(field, env, row).expect("a row of an environment"));
        }
        read_only(array(py, &self.shape(&[width]), data, self.simulation.precision())?, field.name())
    }

    /// Rows of a field of the state.
    fn field_rows<'py>(&self, field: Field, given: Option<&Bound<'py, PyAny>>, selection: &Selection) -> PyResult<Given<'py>> {
        given.map(|given| self.selected_rows(given, field.name(), field.width(self.simulation.model()), selection)).transpose()
    }

    /// A time for every selected environment, or one for all, s.
    fn times<'py>(&self, given: Option<&Bound<'py, PyAny>>, selection: &Selection) -> PyResult<Given<'py>> {
        let Some(given) = given else { return Ok(None) };
        let times = readonly(given, "time")?;
        if times.len() == 1 {
            return Ok(Some(Numbers::Given(times)));
        }
        check_shape("time", times.shape(), &[&[selection.rows(self.n())], &[]])?;
        Ok(Some(Numbers::Scattered(selection.scattered(times.as_slice()?, self.n()))))
    }
}

#[pymethods]
impl Stepper {
    /// Starts a new episode in all environments, or in those of `envs`. Nothing of the old one remains.
    ///
    /// Forces that are applied end, mocap bodies go back to where the model has them, and controls in force are zero, or the
    /// keyframe's, until `step` takes others. Parameters of `randomize` stay.
    ///
    /// Args:
    ///     envs: Which environments: a boolean mask (num_envs,), or integer indices (k,), each once; None is all, and none of them does
    ///         nothing. With a mask, arrays have rows of all environments, and those of the others are not read. With indices, arrays
    ///         have a row for each index, in their order.
    ///     qpos: Where they start, (num_envs, nq) or (nq,); None is the model's reference. Quaternions are normalised.
    ///     qvel: How fast, (num_envs, nv) or (nv,); None is at rest.
    ///     seed: A new seed of the errors of sensors, or (num_envs,) one for each environment; None keeps the old ones.
    ///     keyframe: Name or index of a keyframe to start from: its qpos, qvel, act, ctrl and time.
    ///
    /// Raises:
    ///     TypeError: A seed or an index that is no whole number.
    ///     IndexError: No environment of that index.
    ///     ValueError: A wrong shape, a number that is not finite, a quaternion of zeros, a negative seed. Nothing is changed then.
    ///     KeyError: No such keyframe.
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
        let mut this = borrow(slf)?;
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
        let recorder = recorder_of(slf.py(), this);
        notify(slf, recorder, "reset", &[("envs", envs), ("qpos", qpos), ("qvel", qvel), ("seed", seed), ("keyframe", keyframe)])
    }

    /// Sets configuration, velocity, activations or time; or, given a `State`, everything that survives a step.
    ///
    /// The next state is a function of `qpos`, `qvel`, `act` and the controls; what the solver starts from moves it by some 1e-7 of a
    /// velocity (docs/development/decisions/visible_state.md). The other memory of an environment is that of its drives (delay lines, lags,
    /// integrals) and sensors (bias, drift, delay lines, samples held).
    ///
    /// Args:
    ///     qpos: (num_envs, nq) or (nq,). Or what `get_state` returned: of a batch of the same size each environment takes its own
    ///         part, of a single environment all take the same. Or a list of states of single environments, one for each of `envs`.
    ///         Continuing from a `State` repeats the same bits; where a state of one is given to a batch, each environment's sensors
    ///         draw random numbers of their own from then on.
    ///     qvel: (num_envs, nv) or (nv,).
    ///     envs: Which environments, as of `reset`. `set_state(get_state(env=3), envs=[5, 6])` copies environment 3 to others.
    ///     act: (num_envs, na) or (na,).
    ///     time: s, (num_envs,) or one for all.
    ///     keep_warmstart: Whether to keep all memory where qpos, qvel or act are set, to correct the state of an environment that
    ///         goes on, as an observer does: the solver's warm start, contacts, flags, drives (delay lines, lags, integrals) and
    ///         sensors (bias, drift, delay lines, held samples). False clears all of these, and the next control and reading fill
    ///         the delay lines: what follows depends on the new state alone.
    ///
    /// Raises:
    ///     ValueError: A wrong shape, a number that is not finite, a quaternion of zeros, a state of another model. Nothing is
    ///         changed then.
    #[pyo3(signature = (qpos=None, qvel=None, envs=None, *, act=None, time=None, keep_warmstart=false, **others), text_signature = "($self, qpos=None, qvel=None, envs=None, *, act=None, time=None, keep_warmstart=False)")]
    #[expect(clippy::too_many_arguments, reason = "each has a name of its own")]
    fn set_state(
        slf: &Bound<'_, Self>,
        qpos: Option<Bound<'_, PyAny>>,
        qvel: Option<Bound<'_, PyAny>>,
        envs: Option<Bound<'_, PyAny>>,
        act: Option<Bound<'_, PyAny>>,
        time: Option<Bound<'_, PyAny>>,
        keep_warmstart: bool,
        others: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<()> {
        no_others("Stepper.set_state", others, &["qpos", "qvel", "envs", "act", "time", "keep_warmstart"])?;
        let mut this = borrow(slf)?;
        let selection = this.selection(envs.as_ref())?;
        if let Some(states) = qpos.as_ref().and_then(states_of) {
            if qvel.is_some() || act.is_some() || time.is_some() || keep_warmstart {
                return Err(PyValueError::new_err("set_state(state) takes envs and nothing else: a State has all the rest"));
            }
            if selection.envs.is_empty() {
                return Ok(());
            }
            this.take_states(&states, &selection)?;
            let recorder = recorder_of(slf.py(), this);
            return notify(slf, recorder, "set_state", &[("state", qpos)]);
        }
        let q = this.field_rows(Field::Qpos, qpos.as_ref(), &selection)?;
        let v = this.field_rows(Field::Qvel, qvel.as_ref(), &selection)?;
        let (a, t) = (this.field_rows(Field::Act, act.as_ref(), &selection)?, this.times(time.as_ref(), &selection)?);
        if selection.envs.is_empty() {
            return Ok(());
        }
        let rows = StateRows { qpos: numbers(&q)?, qvel: numbers(&v)?, act: numbers(&a)?, time: numbers(&t)? };
        this.simulation.set_rows(&selection.ascending(), &rows, !keep_warmstart).map_err(value_error)?;
        let recorder = recorder_of(slf.py(), this);
        let kept = keep_warmstart.then(|| PyBool::new(slf.py(), true).to_owned().into_any());
        let given = [("envs", envs), ("qpos", qpos), ("qvel", qvel), ("act", act), ("time", time), ("keep_warmstart", kept)];
        notify(slf, recorder, "set_state", &given)
    }

    /// Everything that survives a step, the controls in force included.
    ///
    /// What is applied (`qfrc_applied` and the like) and parameters of `randomize` are not part of it.
    ///
    /// Args:
    ///     env: An environment; None is all of them.
    #[pyo3(signature = (env=None, **others), text_signature = "($self, env=None)")]
    fn get_state(slf: Reading<'_>, env: Option<Env>, others: Option<&Bound<'_, PyDict>>) -> PyResult<State> {
        no_others("Stepper.get_state", others, &["env"])?;
        let saved = match env {
            Some(env) => slf.simulation.save_state_of(slf.env(env)?),
            None => slf.simulation.save_state(),
        };
        Ok(State { saved })
    }

    /// Configuration: (num_envs, nq), m and quaternions and rad. `set_state(qpos=...)` sets it.
    #[getter]
    fn qpos<'py>(slf: Reading<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        slf.gather(py, Field::Qpos)
    }

    /// Velocity: (num_envs, nv), m/s and rad/s. `set_state(qvel=...)` sets it.
    #[getter]
    fn qvel<'py>(slf: Reading<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        slf.gather(py, Field::Qvel)
    }

    /// Activations of actuators: (num_envs, na). `set_state(act=...)` sets them.
    #[getter]
    fn act<'py>(slf: Reading<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        slf.gather(py, Field::Act)
    }

    /// Controls in force: (num_envs, nu). Those of the last step or the keyframe that an episode began with, zero after any other
    /// reset.
    #[getter]
    fn ctrl<'py>(slf: Reading<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let held = array(py, &slf.shape(&[slf.simulation.model().nu()]), slf.simulation.ctrl().to_vec(), slf.simulation.precision())?;
        read_only(held, "ctrl")
    }

    /// Simulated time in s: (num_envs,). `set_state(time=...)` sets it.
    #[getter]
    fn time<'py>(slf: Reading<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        slf.per_env(py, "time", |env| slf.simulation.time(env))
    }
}
