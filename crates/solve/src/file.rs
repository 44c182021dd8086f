//! Files of saved problems, so that a hard problem becomes a test.
//!
//! A file has one lane of a problem, with the initial impulses and the limits of its solve.
//!
//! | bytes | content |
//! |---|---|
//! | 8 | [`MAGIC`] |
//! | 4 | [`FORMAT_VERSION`], little endian |
//! | 32 | SHA-256 of the payload |
//! | rest | payload in postcard's encoding (numbers as their IEEE 754 bits, little endian): the lane's scalar rows, then its contacts |

use std::fmt;
use std::path::Path;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::capacity::Capacity;
use crate::constraints::constraint_set::{SavedConstraint, has_lane, number_of};
use crate::iterate::Iterate;
use crate::problem::{Problem, System};
use crate::solver::Settings;
use stepper_real::{Mask, Real};

/// First bytes of every saved problem. The last byte is not valid UTF-8, so that no text file begins like this.
const MAGIC: [u8; 8] = *b"problem\xff";

/// Version of the format of saved problems. It changes whenever the payload changes.
pub const FORMAT_VERSION: u32 = 3;

/// Number of bytes of a saved problem before its payload.
const HEADER: usize = 8 + 4 + 32;

/// Largest number of coordinates of a loaded problem. It bounds the memory that is reserved before anything is solved.
const MOST_COORDINATES: usize = 1 << 20;

/// Payload of a file: one lane of a problem, and the limits of its solve.
#[derive(Debug, Serialize, Deserialize)]
struct Payload {
    dimension: usize,
    redundant: bool,
    settings: Settings<f64>,
    scalars: Vec<SavedConstraint>,
    contacts: Vec<SavedConstraint>,
}

/// Error of a saved problem that cannot be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FileError {
    /// Path of the file, or "saved problem" for bytes in memory.
    place: String,
    /// Description of the error, with its remedy.
    what: String,
}

impl fmt::Display for FileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.place, self.what)
    }
}

impl std::error::Error for FileError {}

/// Problem read from a file, with the initial impulses and the limits of its solve.
#[derive(Clone, Debug)]
pub struct LoadedProblem<R: Real> {
    /// Problem of the file, the same in every lane.
    pub problem: Problem<R>,
    /// Initial impulses, with their scaled velocity change w.
    pub iterate: Iterate<R>,
    /// Limits of the solve of the problem.
    pub settings: Settings<R>,
}

impl<R: Real> System<'_, R> {
    /// Bytes of a saved problem: the rows of the lane `lane`, the impulses of `iterate` and the limits `settings` of a solve.
    /// [`Problem::from_bytes`] reads them.
    pub fn to_bytes(&self, iterate: &Iterate<R>, settings: &Settings<R>, lane: usize) -> Vec<u8> {
        let (dimension, redundant) = (self.problem.dimension, has_lane::<R>(self.problem.newly_loaded, lane));
        let settings = settings.map(|x| number_of(x, lane));
        let scalars = self.problem.scalars.save(self.scalars, &iterate.scalars, lane);
        let contacts = self.problem.contacts.save(self.contacts, &iterate.contacts, lane);
        let payload = Payload { dimension, redundant, settings, scalars, contacts };
        let payload = postcard::to_stdvec(&payload).expect("a problem is plain data in memory: numbers and sequences of known length");
        let digest: [u8; 32] = Sha256::digest(&payload).into();
        [&MAGIC[..], &FORMAT_VERSION.to_le_bytes(), &digest, &payload].concat()
    }
}

impl<R: Real> Problem<R> {
    /// Reads a problem from the bytes of [`System::to_bytes`] into every lane. The solution of this problem has the same bits as that of
    /// the saved one.
    ///
    /// # Errors
    /// [`FileError`] if the bytes are not a saved problem, have another format version, are damaged, or contain invalid rows.
    pub fn from_bytes(bytes: &[u8]) -> Result<LoadedProblem<R>, FileError> {
        parse(bytes).map_err(|what| FileError { place: "saved problem".into(), what })
    }

    /// Reads a problem from a file into every lane.
    ///
    /// # Errors
    /// [`FileError`] as for [`Problem::from_bytes`], and if the file cannot be read.
    pub fn load(path: impl AsRef<Path>) -> Result<LoadedProblem<R>, FileError> {
        let read = std::fs::read(path.as_ref()).map_err(|e| format!("cannot be read ({e}): check the path"));
        read.and_then(|bytes| parse(&bytes)).map_err(|what| FileError { place: path.as_ref().display().to_string(), what })
    }
}

/// Reads a problem from bytes. The error is a description of the fault and of the remedy.
fn parse<R: Real>(bytes: &[u8]) -> Result<LoadedProblem<R>, String> {
    /// Remedy for a damaged file.
    const AGAIN: &str = "copy the file again, or save the problem again";
    if !bytes.starts_with(&MAGIC) {
        return Err("not a saved problem: sim.save_problem(env, path) writes them".into());
    }
    if bytes.len() < HEADER {
        return Err(format!("cut off after {} bytes: {AGAIN}", bytes.len()));
    }
    let version = u32::from_le_bytes(bytes[8..12].try_into().expect("4 bytes"));
    if version != FORMAT_VERSION {
        return Err(format!("format version {version}, this stepper reads {FORMAT_VERSION}: save the problem again with this version"));
    }
    let (digest, payload) = (&bytes[12..HEADER], &bytes[HEADER..]);
    if digest != &Sha256::digest(payload)[..] {
        return Err(format!("damaged, the contents do not match their SHA-256: {AGAIN}"));
    }
    match postcard::take_from_bytes::<Payload>(payload) {
        Ok((payload, [])) => payload.problem(),
        _ => Err("not readable by this version of stepper, although its SHA-256 is right: save the problem again with this version".into()),
    }
}

impl Payload {
    /// Problem with the numbers of the payload in every lane of `R`.
    fn problem<R: Real>(&self) -> Result<LoadedProblem<R>, String> {
        let Self { dimension, redundant, settings, .. } = *self;
        let (tolerance, limits) = (settings.tolerance, [settings.newton_threshold, settings.accepted_residual]);
        if dimension > MOST_COORDINATES || !(tolerance >= 0.0 && limits.iter().all(|&limit| limit >= tolerance)) {
            return Err(format!("{dimension} coordinates, tolerance {tolerance}, limits {limits:?}: not of a problem"));
        }
        let mut capacity = Capacity::of_coordinates(dimension);
        capacity.scalars = self.scalars.len();
        let (mut problem, mut iterate) = (Problem::<R>::new(&capacity), Iterate::<R>::new(&capacity));
        for (what, list, rows) in [("scalar row", &self.scalars, &[1][..]), ("contact", &self.contacts, &[3, 4, 6])] {
            if let Some(i) = list.iter().position(|saved| !saved.is_sound(dimension, rows)) {
                return Err(format!("{what} {i} has numbers that no {what} has"));
            }
        }
        for saved in &self.scalars {
            problem.scalars.load(saved);
            iterate.scalars.extend(saved.impulse.iter().map(|&x| R::of(x)));
        }
        for saved in &self.contacts {
            problem.contacts.load(saved);
            iterate.contacts.extend(saved.impulse.iter().map(|&x| R::of(x)));
        }
        problem.newly_loaded = R::Mask::splat(redundant);
        iterate.compute_w(&problem);
        Ok(LoadedProblem { problem, iterate, settings: settings.map(R::of) })
    }
}
