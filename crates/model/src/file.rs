//! Files of models. Reading a file gives the same bits as were written; any other content is an error.
//!
//! | bytes | what |
//! |---|---|
//! | 8 | [`MAGIC`] |
//! | 4 | [`FORMAT_VERSION`], little endian |
//! | 32 | SHA-256 of the payload |
//! | rest | payload in postcard's encoding (numbers as their IEEE 754 bits, little endian) |
//!
//! The payload is the [`Description`].

use std::path::Path;

use sha2::{Digest, Sha256};

use crate::hulls::Hulls;
use crate::{Description, Model, ModelError};

/// First bytes of every saved model. The last byte is invalid in UTF-8, so that no text file begins with them.
const MAGIC: [u8; 8] = *b"stepper\xff";

/// Version of the format of saved models. It increases when the payload of a saved model changes.
pub const FORMAT_VERSION: u32 = 18;

const HEADER: usize = 8 + 4 + 32;
const MEMORY: &str = "saved model";

impl Model {
    /// SHA-256 of the description, including all names. Equal models have equal digests on every machine. A saved model has it in its
    /// header.
    pub fn digest(&self) -> [u8; 32] {
        Sha256::digest(self.encoded()).into()
    }

    /// Converts the model to bytes, see [`Model::from_bytes`].
    pub fn to_bytes(&self) -> Vec<u8> {
        let payload = self.encoded();
        [&MAGIC[..], &FORMAT_VERSION.to_le_bytes(), &Sha256::digest(&payload), &payload].concat()
    }

    fn encoded(&self) -> Vec<u8> {
        postcard::to_stdvec(&self.description).expect("a model is plain data in memory: numbers, strings and sequences of known length")
    }

    /// Reads a model from the bytes of [`Model::to_bytes`], bit for bit.
    ///
    /// # Errors
    /// [`ModelError::File`] if the bytes are not a saved model, have another format version, or are damaged. [`ModelError::Invalid`] if
    /// [`Description::finish`] rejects the model.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, ModelError> {
        parse(bytes, MEMORY)
    }

    /// Writes the model to a file atomically: a reader sees the old file or the new one.
    ///
    /// # Errors
    /// [`ModelError::File`] if the file cannot be written.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), ModelError> {
        let path = path.as_ref();
        write_whole(path, &self.to_bytes()).map_err(|e| {
            ModelError::file(path.to_string_lossy(), format!("cannot be written ({e})"), "choose a folder that exists and can be written")
        })
    }

    /// Reads a model from a file that [`Model::save`] wrote, bit for bit.
    ///
    /// # Errors
    /// [`ModelError::File`] if the file cannot be read, and the errors of [`Model::from_bytes`].
    pub fn load(path: impl AsRef<Path>) -> Result<Self, ModelError> {
        let shown = path.as_ref().to_string_lossy();
        let read = std::fs::read(path.as_ref());
        let bytes = read.map_err(|e| ModelError::file(shown.clone(), format!("cannot be read ({e})"), "check the path"))?;
        parse(&bytes, &shown)
    }
}

/// Writes a file atomically: a reader sees the old file or the new one.
///
/// # Errors
/// The error of the file system. No partial file remains.
pub fn write_whole(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let name = path.file_name().map_or_else(Default::default, |n| n.to_string_lossy().into_owned());
    let partial = path.with_file_name(format!(".{name}.{}.part", std::process::id()));
    let written = std::fs::write(&partial, bytes).and_then(|()| std::fs::rename(&partial, path));
    written.inspect_err(|_| {
        let _ = std::fs::remove_file(&partial);
    })
}

fn parse(bytes: &[u8], path: &str) -> Result<Model, ModelError> {
    let refuse = |what: String, remedy: &str| Err(ModelError::file(path, what, remedy));
    if bytes.len() < MAGIC.len() || bytes[..MAGIC.len()] != MAGIC {
        return refuse(
            "not a saved stepper model".into(),
            "save one with model.save(path); MJCF and URDF are read by stepper.load in Python",
        );
    }
    if bytes.len() < HEADER {
        return refuse(format!("cut off after {} bytes", bytes.len()), "copy the file again, or save the model again");
    }
    let version = u32::from_le_bytes(bytes[8..12].try_into().expect("4 bytes"));
    if version != FORMAT_VERSION {
        return refuse(
            format!("format version {version}, this stepper reads {FORMAT_VERSION}"),
            "load the original description and save it again with this version of stepper, or use the version that saved it",
        );
    }
    let (digest, payload) = (&bytes[12..HEADER], &bytes[HEADER..]);
    if digest != &Sha256::digest(payload)[..] {
        return refuse("damaged: the contents do not match their SHA-256".into(), "copy the file again, or save the model again");
    }
    match postcard::take_from_bytes::<Description>(payload) {
        Ok((description, [])) => description.check(&Hulls::default()),
        _ => refuse(
            "not readable by this version of stepper, although its SHA-256 is right".into(),
            "save the model again with this version of stepper",
        ),
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::finish::tests::rich_model;
    use super::super::{BodyBuilder, GainType, GeomBuilder, JointBuilder, NoSlip, Overlap, WORLD};
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn round_trip_is_bit_for_bit() {
        let mut model = rich_model();
        model.description.actuators[0].force_range = Some([f64::NEG_INFINITY, 0.1 + 0.2]);
        model.description.gravity = [-0.0, 5e-324, -9.81];
        let back = Model::from_bytes(&model.to_bytes()).unwrap();
        assert_eq!(back, model);
        assert_eq!(back.to_bytes(), model.to_bytes());
        assert_eq!(back.digest(), model.digest());
        assert!(back.gravity[0].is_sign_negative());
    }

    #[test]
    fn every_change_of_a_model_is_kept_and_changes_the_digest() {
        let first = rich_model();
        let mut digests = vec![first.digest()];
        let changes: [fn(&mut Description); 6] = [
            |model| model.soft.noslip = NoSlip { iterations: 7, tolerance: 1e-9 },
            |model| model.joints[1].velocity_limit = Some(3.0),
            |model| model.excluded_overlaps.push(Overlap { geoms: [0, 1], depth: 0.1 }),
            |model| model.actuators[1].force_model.gain = GainType::Affine,
            |model| model.actuators[1].force_model.disabled = true,
            |model| model.actuators[0].early = true,
        ];
        for change in changes {
            let mut model = first.clone();
            change(&mut model.description);
            assert_eq!(Model::from_bytes(&model.to_bytes()).unwrap(), model);
            assert!(!digests.contains(&model.digest()));
            digests.push(model.digest());
        }
        let mut far = first;
        far.description.excluded_overlaps.push(Overlap { geoms: [0, 777], depth: 0.1 });
        assert!(Model::from_bytes(&far.to_bytes()).unwrap_err().to_string().contains("777"));
    }

    #[test]
    fn files_round_trip_and_replace_one_another() {
        let path = std::env::temp_dir().join(format!("stepper-file-test-{}.stepper", std::process::id()));
        rich_model().save(&path).unwrap();
        rich_model().save(&path).unwrap();
        assert_eq!(Model::load(&path).unwrap(), rich_model());
        std::fs::remove_file(&path).unwrap();
        let error = Model::load(&path).unwrap_err().to_string();
        assert!(error.contains("stepper-file-test") && error.contains("check the path"), "{error}");
        let error = rich_model().save("/no/such/folder/a.stepper").unwrap_err().to_string();
        assert!(error.contains("/no/such/folder/a.stepper") && error.contains("folder"), "{error}");
    }

    #[test]
    fn refusals_say_what_and_what_to_do() {
        let text = |bytes: &[u8]| Model::from_bytes(bytes).unwrap_err().to_string();
        assert!(text(b"<mujoco/>").contains("not a saved stepper model"));
        let mut other = rich_model().to_bytes();
        other[8] = 77;
        assert!(
            text(&other).contains(&format!("format version 77, this stepper reads {FORMAT_VERSION}"))
                && text(&other).contains("save it again")
        );
        let mut damaged = rich_model().to_bytes();
        *damaged.last_mut().unwrap() ^= 1;
        assert!(text(&damaged).contains("damaged"));
    }

    #[test]
    fn an_invalid_model_in_a_sound_file_is_refused() {
        let mut model = rich_model();
        model.description.bodies[1].mass = -1.0;
        assert!(matches!(Model::from_bytes(&model.to_bytes()), Err(ModelError::Invalid { .. })));
    }

    /// Scene with a floor and two free bodies, both with the mesh "stone". No geom uses its other mesh, "drawn".
    fn stones() -> Model {
        let mut scene = Model::builder("stones");
        scene.geom(WORLD, GeomBuilder::plane("floor"));
        let corners: Vec<[f64; 3]> = (0..8).map(|k| std::array::from_fn(|i| if k >> i & 1 == 1 { 0.1 } else { -0.1 })).collect();
        scene.mesh("drawn", &corners[..3], &[]).mesh("stone", &[&corners[..], &[[0.0, 0.01, 0.0]]].concat(), &[]);
        for name in ["left", "right"] {
            scene.body(WORLD, BodyBuilder::new(name).joint(JointBuilder::free(name)).geom(GeomBuilder::mesh(name, "stone")));
        }
        scene.finish().unwrap()
    }

    #[test]
    fn hulls_are_shared() {
        let model = stones();
        let hull = |model: &Model| model.hull_of(&model.geoms[1].shape).unwrap().clone();
        assert!(Arc::ptr_eq(&hull(&model), model.hull_of(&model.geoms[2].shape).unwrap()), "one hull for both geoms");
        assert!(Arc::ptr_eq(&hull(&model), &hull(&model.replace("timestep", &[0.001]).unwrap())), "other numbers, the same hull");
        // A loaded model computes its hulls again, with the same bits.
        assert_eq!(Model::from_bytes(&model.to_bytes()).unwrap(), model);
    }

    #[test]
    fn every_truncation_is_refused() {
        let bytes = rich_model().to_bytes();
        (0..bytes.len()).for_each(|n| assert!(Model::from_bytes(&bytes[..n]).is_err(), "{n} bytes"));
        assert!(Model::from_bytes(&[&bytes[..], &[0]].concat()).is_err());
    }

    proptest! {
        #[test]
        fn every_bit_flip_is_refused(at in 0..rich_model().to_bytes().len(), bit in 0..8_u8) {
            let mut bytes = rich_model().to_bytes();
            bytes[at] ^= 1 << bit;
            prop_assert!(Model::from_bytes(&bytes).is_err());
        }

        #[test]
        fn any_numbers_survive(x in any::<[f64; 3]>().prop_filter("finite", |x| x.iter().all(|v| v.is_finite()))) {
            let mut model = rich_model();
            model.description.gravity = x;
            let back = Model::from_bytes(&model.to_bytes()).unwrap();
            prop_assert_eq!(back.gravity.map(f64::to_bits), x.map(f64::to_bits));
        }
    }
}
