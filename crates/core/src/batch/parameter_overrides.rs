//! Parameters of the compiled model that differ between environments, as a batch stores them for its workers.

use stepper_real::Scalar;

use crate::batch::randomization::Differences;
use crate::compile::Params;

/// Per-environment parameters of the compiled model: their indices, and their values for every lane of every group of environments.
#[derive(Clone, Debug, Default)]
pub struct ParameterOverrides<S> {
    /// Indices of the overridden parameters in [`Params`], ascending. All groups have the same indices.
    pub indices: Vec<u32>,
    /// Values of the overridden parameters: for every group, an array with one row per index in `indices`, and one column per lane. The
    /// list is empty without overrides.
    pub numbers: Vec<Vec<S>>,
}

impl<S: Scalar> ParameterOverrides<S> {
    /// Replaces the overrides of the environments `envs` by `differences`. `groups` is the number of groups, and `lanes` the number of
    /// lanes of each.
    pub fn store_differences(&mut self, shared: &Params<S>, groups: usize, lanes: usize, envs: &[usize], differences: &[Differences]) {
        self.add_indices(shared, groups, lanes, differences);
        if self.indices.is_empty() {
            return;
        }
        for (&env, differences) in envs.iter().zip(differences) {
            let (numbers, lane) = (&mut self.numbers[env / lanes], env % lanes);
            let mut rest = differences.iter().peekable();
            for (k, &index) in self.indices.iter().enumerate() {
                let difference = rest.next_if(|(at, _)| *at == index);
                numbers[k * lanes + lane] = difference.map_or(shared.numbers()[index as usize], |&(_, x)| S::from_f64(x));
            }
        }
    }

    /// Adds the parameters of `differences` that are not overridden yet to the overrides, with the shared value in all environments.
    fn add_indices(&mut self, shared: &Params<S>, groups: usize, lanes: usize, differences: &[Differences]) {
        let mut indices: Vec<u32> = differences.iter().flatten().map(|d| d.0).chain(self.indices.iter().copied()).collect();
        indices.sort_unstable();
        indices.dedup();
        if indices == self.indices {
            return;
        }
        let old = std::mem::replace(self, Self { indices, numbers: Vec::new() });
        let from: Vec<Option<usize>> = self.indices.iter().map(|index| old.indices.binary_search(index).ok()).collect();
        let moved = |g: usize| {
            let row = |(&index, from): (&u32, &Option<usize>)| match from {
                Some(k) => old.numbers[g][k * lanes..(k + 1) * lanes].to_vec(),
                None => vec![shared.numbers()[index as usize]; lanes],
            };
            self.indices.iter().zip(&from).flat_map(row).collect()
        };
        self.numbers = (0..groups).map(moved).collect();
    }

    /// Memory of the overrides, bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.indices[..]) + self.numbers.iter().map(|n| size_of_val(&n[..])).sum::<usize>()
    }
}
