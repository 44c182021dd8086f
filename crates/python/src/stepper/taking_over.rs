//! Methods that copy saved states to environments, and states between environments.

use std::collections::BTreeMap;

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyTuple};
use stepper_core::SavedState;

use crate::arguments::{no_others, required};
use crate::error::value_error;
use crate::selection::{Selection, indices};
use crate::state::State;
use crate::stepper::recording::notify;
use crate::stepper::{Stepper, borrow};

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
            return Err(PyValueError::new_err(format!(
                "there are {found} states, must be {must}: one for each environment of envs, or a single state for all"
            )));
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
        let mut this = borrow(slf)?;
        let targets = this.selection(envs.as_ref())?.envs;
        let from = slf.py().import("numpy")?.call_method1("asarray", (&sources,))?;
        let single = from.getattr("ndim")?.extract::<usize>()? == 0;
        let mut from = indices(&from, this.n(), "sources")?;
        if single {
            from = vec![from[0]; targets.len()];
        }
        if from.len() != targets.len() {
            let (found, must) = (from.len(), targets.len());
            return Err(PyValueError::new_err(format!(
                "sources has {found} environments, must have {must}: one for each environment of envs, or one for all"
            )));
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
