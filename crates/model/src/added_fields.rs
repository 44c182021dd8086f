//! Serialization of those fields of a description that version 12 of the format of saved models does not have.
//!
//! In text formats, these fields are serialized as usual. In the binary format, which has no field names, `crate::file` writes them after
//! the description. So a description in which these fields have their default values has the same bytes and digest as in version 12.

use serde::{Deserialize, Deserializer, Serialize, Serializer};

pub(super) fn serialize<T: Serialize, S: Serializer>(value: &T, serializer: S) -> Result<S::Ok, S::Error> {
    if serializer.is_human_readable() { value.serialize(serializer) } else { serializer.serialize_unit() }
}

pub(super) fn deserialize<'de, T: Deserialize<'de> + Default, D: Deserializer<'de>>(deserializer: D) -> Result<T, D::Error> {
    if deserializer.is_human_readable() { T::deserialize(deserializer) } else { <()>::deserialize(deserializer).map(|()| T::default()) }
}
