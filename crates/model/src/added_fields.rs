//! Serialization of fields that came after version 12 of saved models.
//!
//! In text they are fields of the description like any other. In binary, where fields have no names, they are no part of it:
//! `crate::file` writes them behind it. So the bytes and the digest of a description without them stay what they were.

use serde::{Deserialize, Deserializer, Serialize, Serializer};

pub(super) fn serialize<T: Serialize, S: Serializer>(value: &T, serializer: S) -> Result<S::Ok, S::Error> {
    if serializer.is_human_readable() { value.serialize(serializer) } else { serializer.serialize_unit() }
}

pub(super) fn deserialize<'de, T: Deserialize<'de> + Default, D: Deserializer<'de>>(deserializer: D) -> Result<T, D::Error> {
    if deserializer.is_human_readable() { T::deserialize(deserializer) } else { <()>::deserialize(deserializer).map(|()| T::default()) }
}
