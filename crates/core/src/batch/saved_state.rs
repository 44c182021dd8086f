//! Saved states: the state of environments as bytes. Steps after a restore give the same bits as steps after the save. A restore of other
//! bytes fails with an error.
//!
//! | bytes | content |
//! |---|---|
//! | 8 | magic bytes of a saved state |
//! | 4 | [`FORMAT_VERSION`], little endian |
//! | 1 | size of the floating-point numbers, bytes: 8 or 4 |
//! | 32 | SHA-256 of the model, see [`Model::digest`](crate::Model::digest) |
//! | 32 | SHA-256 of all other bytes, before and after it |
//! | rest | payload: environments, controls in force and active equalities, in postcard's encoding |

use sha2::{Digest, Sha256};

use crate::error::Error;
use crate::math::precision::Precision;

/// First bytes of every saved state. The last byte is invalid in UTF-8, and differs from the last of a saved model's magic bytes.
const MAGIC: [u8; 8] = *b"stepper\xfe";

/// Version of the format of saved states. It must increase when the content of a state changes.
pub const FORMAT_VERSION: u32 = 8;

/// Offset of the model's digest in a saved state, bytes.
const MODEL: usize = 13;
/// Offset of the checksum in a saved state, bytes. The checksum covers all other bytes.
const CHECK: usize = MODEL + 32;
/// Offset of the payload in a saved state, bytes.
const PAYLOAD: usize = CHECK + 32;

/// Saved state of some environments of a model: everything that a step hands over to the next step.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SavedState {
    model: [u8; 32],
    precision: Precision,
    /// Payload: environments and controls in force, in postcard's encoding.
    pub(crate) payload: Vec<u8>,
}

impl SavedState {
    pub(crate) fn new(model: [u8; 32], precision: Precision, payload: Vec<u8>) -> Self {
        Self { model, precision, payload }
    }

    /// SHA-256 of the model to which the state belongs.
    pub fn model(&self) -> [u8; 32] {
        self.model
    }

    /// Scalar type of the simulation that saved the state.
    pub fn precision(&self) -> Precision {
        self.precision
    }

    /// Length of the result of [`SavedState::to_bytes`], bytes.
    pub fn nbytes(&self) -> usize {
        PAYLOAD + self.payload.len()
    }

    /// Bytes before the checksum: magic bytes, format version, precision and digest of the model.
    fn head(&self) -> [u8; CHECK] {
        let mut head = [0; CHECK];
        head[..8].copy_from_slice(&MAGIC);
        head[8..12].copy_from_slice(&FORMAT_VERSION.to_le_bytes());
        head[12] = size(self.precision);
        head[MODEL..].copy_from_slice(&self.model);
        head
    }

    /// Converts the state to bytes with a checksum, see [`SavedState::from_bytes`].
    pub fn to_bytes(&self) -> Vec<u8> {
        let head = self.head();
        [&head[..], &checksum(&head, &self.payload), &self.payload].concat()
    }

    /// Reads a state that [`SavedState::to_bytes`] wrote. The restoring function checks whether the state fits the simulation.
    ///
    /// # Errors
    /// [`Error::NotAState`] when the bytes are no state, of another format version, or damaged.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, Error> {
        let refuse = |what: String| Err(Error::NotAState(what));
        if !bytes.starts_with(&MAGIC) {
            return refuse("the bytes do not begin as those of a state do; give the bytes of what Simulation::save_state gave".into());
        }
        if bytes.len() < PAYLOAD {
            return refuse(format!("cut off after {} bytes; copy it again", bytes.len()));
        }
        let version = u32::from_le_bytes(bytes[8..12].try_into().expect("4 bytes"));
        if version != FORMAT_VERSION {
            return refuse(format!("format version {version}, this stepper reads {FORMAT_VERSION}; use the version that saved it"));
        }
        let (head, payload) = (&bytes[..CHECK], &bytes[PAYLOAD..]);
        if bytes[CHECK..PAYLOAD] != checksum(head, payload) {
            return refuse(format!("damaged: {} bytes do not match their SHA-256; copy it again", bytes.len()));
        }
        let precision = [Precision::F64, Precision::F32].into_iter().find(|p| size(*p) == head[12]);
        match precision {
            Some(precision) => Ok(Self::new(head[MODEL..].try_into().expect("32 bytes"), precision, payload.to_vec())),
            None => refuse(format!("numbers of {} bytes, must be 8 or 4", head[12])),
        }
    }
}

fn size(precision: Precision) -> u8 {
    match precision {
        Precision::F64 => 8,
        Precision::F32 => 4,
    }
}

fn checksum(head: &[u8], payload: &[u8]) -> [u8; 32] {
    Sha256::new().chain_update(head).chain_update(payload).finalize().into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_state_survives_its_bytes_and_nothing_else_does() {
        let state = SavedState::new([7; 32], Precision::F32, vec![1, 2, 3]);
        let bytes = state.to_bytes();
        assert_eq!(SavedState::from_bytes(&bytes).unwrap(), state);
        assert_eq!(bytes.len(), state.nbytes());
        (0..bytes.len()).for_each(|n| assert!(SavedState::from_bytes(&bytes[..n]).is_err(), "{n} bytes"));
        assert!(SavedState::from_bytes(&[&bytes[..], &[0]].concat()).is_err());
        for at in 0..8 * bytes.len() {
            let mut other = bytes.clone();
            other[at / 8] ^= 1 << (at % 8);
            assert!(SavedState::from_bytes(&other).is_err(), "bit {at}");
        }
    }
}
