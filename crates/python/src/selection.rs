//! Environments that an argument `envs` selects: a boolean mask, or integer indices.

use numpy::{PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::{PyIndexError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyInt};

use crate::array::{check_shape, check_shape_of, float64_array, is_single_number, shape_text};

/// Selection of environments by an argument `envs`: indices of the environments, in the order of the argument.
pub(crate) struct Selection {
    pub(crate) envs: Vec<usize>,
    /// Whether the argument `envs` has indices; false for a mask and for None. With indices, the other array arguments of the method have a
    /// row for each index, in the same order.
    pub(crate) by_index: bool,
}

impl Selection {
    /// Selection by an argument `envs`, a mask or indices, in a batch of `n` environments. None selects all.
    pub(crate) fn of(given: Option<&Bound<'_, PyAny>>, n: usize) -> PyResult<Self> {
        let Some(given) = given else { return Ok(Self { envs: (0..n).collect(), by_index: false }) };
        let array = given.py().import("numpy")?.call_method1("asarray", (given,))?;
        if kind_of(&array)? == "b" {
            check_shape("envs", &shape_of(&array)?, &[&[n]])?;
            let mask = array.cast::<PyArrayDyn<bool>>()?.try_readonly()?;
            let chosen = mask.as_array().iter().enumerate().filter(|(_, chosen)| **chosen).map(|(env, _)| env).collect();
            return Ok(Self { envs: chosen, by_index: false });
        }
        let envs = indices(&array, n, "envs")?;
        let mut seen = vec![false; n];
        for &env in &envs {
            if std::mem::replace(&mut seen[env], true) {
                return Err(PyValueError::new_err(format!("envs has environment {env} more than once: give each index once")));
            }
        }
        Ok(Self { envs, by_index: true })
    }

    /// Selected environments in ascending order.
    pub(crate) fn ascending(&self) -> Vec<usize> {
        let mut envs = self.envs.clone();
        envs.sort_unstable();
        envs
    }

    /// Mask of a batch of `n` environments: whether each environment is selected.
    pub(crate) fn mask(&self, n: usize) -> Vec<bool> {
        let mut mask = vec![false; n];
        self.envs.iter().for_each(|&env| mask[env] = true);
        mask
    }

    /// Number of rows that the array arguments of the call must have. It is the number of indices if environments were selected by indices,
    /// otherwise `n`, the number of environments.
    pub(crate) fn rows(&self, n: usize) -> usize {
        if self.by_index { self.envs.len() } else { n }
    }

    /// Rows of an array for all `n` environments of the batch, from the rows of an array argument.
    ///
    /// If the environments were selected by indices, the argument has one row for each index, and the other environments get zeros. If they
    /// were not selected by indices, the argument already has a row for each environment.
    pub(crate) fn scattered<T: Copy + Default>(&self, rows: &[T], n: usize) -> Vec<T> {
        if !self.by_index {
            return rows.to_vec();
        }
        let width = rows.len().checked_div(self.envs.len()).unwrap_or(0);
        let mut all = vec![T::default(); n * width];
        for (row, &env) in rows.chunks_exact(width.max(1)).zip(&self.envs) {
            all[env * width..(env + 1) * width].copy_from_slice(row);
        }
        all
    }

    /// Numbers of the array argument `name`, with a row for each environment.
    ///
    /// The shape of the argument must be `full`, (num_envs, ...). If the environments were selected by indices, the argument must have a
    /// row for each index instead. `shared` is the shape of a single row for all environments, if such an argument is allowed too. The
    /// result is then this row.
    pub(crate) fn numbers<'py>(
        &self,
        given: &Bound<'py, PyAny>,
        name: &str,
        full: &[usize],
        shared: Option<&[usize]>,
    ) -> PyResult<Numbers<'py>> {
        let numbers = float64_array(given, name)?;
        let mut selected = full.to_vec();
        if self.by_index {
            selected[0] = self.envs.len();
        }
        let allowed: Vec<&[usize]> = std::iter::once(&selected[..]).chain(shared).collect();
        let found = numbers.shape();
        if let Err(error) = check_shape_of(given, name, found, &allowed) {
            let is_one_row = !found.is_empty() && full.get(1..) == Some(found) && !is_single_number(given, found)?;
            let remedy = format!("; np.broadcast_to(value, {}) gives all environments the same", shape_text(&selected));
            return Err(if is_one_row { PyValueError::new_err(format!("{}{remedy}", error.value(given.py()))) } else { error });
        }
        if !self.by_index || shared == Some(found) {
            return Ok(Numbers::Given(numbers));
        }
        Ok(Numbers::Scattered(self.scattered(numbers.as_slice()?, full[0])))
    }
}

/// Numbers of an array argument: the argument itself, or a copy of its rows in an array with a row for each environment.
pub(crate) enum Numbers<'py> {
    Given(PyReadonlyArrayDyn<'py, f64>),
    Scattered(Vec<f64>),
}

impl Numbers<'_> {
    pub(crate) fn as_slice(&self) -> PyResult<&[f64]> {
        match self {
            Self::Given(numbers) => Ok(numbers.as_slice()?),
            Self::Scattered(numbers) => Ok(numbers),
        }
    }
}

/// Indices of environments from the array argument `name`; a scalar is one index. Indices must be from 0 to `n` - 1, for `n` environments.
pub(crate) fn indices(array: &Bound<'_, PyAny>, n: usize, name: &str) -> PyResult<Vec<usize>> {
    let shape = shape_of(array)?;
    if shape.len() > 1 {
        let shape = shape_text(&shape);
        let message = format!("{name} has shape {shape}, must be a mask ({n},) of bool, or indices of environments (k,)");
        return Err(PyValueError::new_err(message));
    }
    let listed: Vec<Bound<'_, PyAny>> = array.call_method0("ravel")?.call_method0("tolist")?.extract()?;
    // NumPy stores integers of more than 64 bits as objects.
    let large = |index: &Bound<'_, PyAny>| index.is_instance_of::<PyInt>() && !index.is_instance_of::<PyBool>();
    if !listed.is_empty() && !matches!(kind_of(array)?.as_str(), "i" | "u") && !listed.iter().all(large) {
        let (first, dtype) = (listed[0].repr()?, array.getattr("dtype")?);
        return Err(PyTypeError::new_err(format!(
            "{name} has {first}, of type {dtype}: give a mask ({n},) of bool, or indices of environments, which are integers"
        )));
    }
    listed
        .iter()
        .map(|index| match index.extract::<usize>() {
            Ok(env) if env < n => Ok(env),
            _ => Err(PyIndexError::new_err(format!("{name} has {index}, there are environments 0 to {}", n - 1))),
        })
        .collect()
}

fn kind_of(array: &Bound<'_, PyAny>) -> PyResult<String> {
    array.getattr("dtype")?.getattr("kind")?.extract()
}

fn shape_of(array: &Bound<'_, PyAny>) -> PyResult<Vec<usize>> {
    array.getattr("shape")?.extract()
}
