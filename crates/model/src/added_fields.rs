//! Serialization of description fields that were added after version 12 of saved models.
//!
//! In text formats they are ordinary fields of the description. The binary format has no field names; there `crate::file` writes them after
//! the description. The bytes and the digest of a description without these fields are therefore the same as before.

use serde::{Deserialize, Deserializer, Serialize, Serializer};

pub(super) fn serialize<T: Serialize, S: Serializer>(value: &T, serializer: S) -> Result<S::Ok, S::Error> {
    if serializer.is_human_readable() { value.serialize(serializer) } else { serializer.serialize_unit() }
}

pub(super) fn deserialize<'de, T: Deserialize<'de> + Default, D: Deserializer<'de>>(deserializer: D) -> Result<T, D::Error> {
    if deserializer.is_human_readable() { T::deserialize(deserializer) } else { <()>::deserialize(deserializer).map(|()| T::default()) }
}
