//! Functions of structs that have the state of several lanes.

/// Implements functions for a struct with the state of several lanes. Each does the same with every field: it copies lanes, sets lanes, or
/// compares and reports sizes. The lists have the names of the fields:
///
/// * `arrays`: lane-interleaved arrays.
/// * `sets`: sets of lanes (bits).
/// * `shared`: arrays that all lanes share. A copy of lanes has all of their entries.
/// * `parts`: structs with the same functions.
macro_rules! lane_arrays {
    ($state:ident { arrays: [$($array:ident)*], sets: [$($set:ident)*], shared: [$($shared:ident)*], parts: [$($part:ident)*] }) => {
        impl<S: Scalar> $state<S> {
            /// Copy of the lanes `first` to `first + n`, exclusive. Fields that are in none of the lists have their default values.
            #[allow(clippy::needless_update, reason = "some structs have only fields of the lists")]
            pub(crate) fn copy_lanes(&self, lanes: usize, first: usize, n: usize) -> Self {
                Self {
                    $($array: $crate::math::lanes::columns(&self.$array, lanes, first, n),)*
                    $($set: $crate::math::lanes::lane_bits(self.$set, first, n),)*
                    $($shared: self.$shared.clone(),)*
                    $($part: self.$part.copy_lanes(lanes, first, n),)*
                    ..Self::default()
                }
            }

            /// Copies the lanes of `from`, which has `n` lanes, to the lanes `target`.
            pub(crate) fn set_lanes(&mut self, lanes: usize, target: $crate::math::lanes::DestinationLanes, n: usize, from: &Self) {
                $($crate::math::lanes::set_columns(&mut self.$array, lanes, target, n, &from.$array);)*
                $($crate::math::lanes::set_lane_bits(&mut self.$set, target, n, from.$set);)*
                $(self.$shared.copy_from_slice(&from.$shared);)*
                $(self.$part.set_lanes(lanes, target, n, &from.$part);)*
            }

            /// Memory of the arrays, bytes.
            pub(crate) fn bytes_of_arrays(&self) -> usize {
                0 $(+ size_of_val(&self.$array[..]))* $(+ size_of_val(&self.$shared[..]))* $(+ self.$part.bytes_of_arrays())*
            }

            /// Whether `other` has arrays of the same lengths, in the lists.
            pub(crate) fn fits(&self, other: &Self) -> bool {
                true $(&& self.$array.len() == other.$array.len())*
                    $(&& self.$shared.len() == other.$shared.len())*
                    $(&& self.$part.fits(&other.$part))*
            }
        }
    };
}

pub(crate) use lane_arrays;

/// Sets the values of one lane of a lane-interleaved array to zero, from index `first` on. To clear all values of a lane, `first` is the
/// index of the lane.
pub(crate) fn clear_column<T: Default>(rows: &mut [T], lanes: usize, first: usize) {
    rows.iter_mut().skip(first).step_by(lanes).for_each(|x| *x = T::default());
}
