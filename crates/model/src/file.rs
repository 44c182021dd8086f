//! Files of models. Reading a file gives the same bits as were written; any other content is an error.
//!
//! | bytes | what |
//! |---|---|
//! | 8 | [`MAGIC`] |
//! | 4 | [`FORMAT_VERSION`], little endian |
//! | 32 | SHA-256 of the payload |
//! | rest | payload in postcard's encoding (numbers as their IEEE 754 bits, little endian) |
//!
//! The payload has these parts:
//!
//! - the [`Description`],
//! - for every mesh the triangles of its convex hull, or no triangles if no geom collides as this hull,
//! - the [`NoSlip`], from version 13 on,
//! - the `Added` fields, from version 14 on,
//! - the [`ForceModel`] of every actuator, from version 15 on,
//! - the [`PathsAndMuscles`], from version 16 on,
//! - the [`Early`] activations, from version 17 on.

use std::borrow::Cow;
use std::path::Path;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::hulls::{Source, Surfaces};
use crate::{Description, ForceModel, Model, ModelError, Muscle, NoSlip, Overlap, PathElement};

/// First bytes of every saved model. The last byte is invalid in UTF-8, so that no text file begins with them.
const MAGIC: [u8; 8] = *b"stepper\xff";

/// Version of the format of saved models. It increases when the payload of a saved model changes.
pub const FORMAT_VERSION: u32 = 17;
/// Last version of the format without [`Early`].
const WITHOUT_EARLY: u32 = 16;
/// Last version of the format without [`PathsAndMuscles`].
const WITHOUT_PATHS: u32 = 15;
/// Last version of the format without force models. From a file of this or an earlier version, each actuator gets the force model of
/// [`ForceModel::of_parameters`].
const WITHOUT_FORCE_MODELS: u32 = 14;
/// Last version of the format without [`Added`] fields.
const WITHOUT_ADDED: u32 = 13;
/// Last version of the format without noslip iterations. It is the oldest version that can be read.
const WITHOUT_NOSLIP: u32 = 12;

const HEADER: usize = 8 + 4 + 32;
const MEMORY: &str = "saved model";

/// Fields of the description that were added after version 13 of the format. A saved model contains them after the description.
#[derive(Default, PartialEq, Serialize, Deserialize)]
struct Added {
    /// Speed limits of all joints, m/s or rad/s. The list is empty if no joint has a speed limit.
    velocity_limits: Vec<Option<f64>>,
    excluded_overlaps: Vec<Overlap>,
}

impl Added {
    fn of(model: &Description) -> Self {
        let velocity_limits = unless_all_default(model.joints.iter().map(|joint| joint.velocity_limit));
        Self { velocity_limits, excluded_overlaps: model.excluded_overlaps.clone() }
    }
}

/// Paths of all tendons, and muscle parameters of all actuators. A list is empty if no element has such values.
#[derive(Default, PartialEq, Serialize, Deserialize)]
struct PathsAndMuscles {
    paths: Vec<Vec<PathElement>>,
    muscles: Vec<Muscle>,
}

impl PathsAndMuscles {
    fn of(model: &Description) -> Self {
        let paths = unless_all_default(model.tendons.iter().map(|tendon| tendon.path.clone()));
        Self { paths, muscles: unless_all_default(model.actuators.iter().map(|actuator| actuator.muscle)) }
    }
}

/// Whether the activation of each actuator is early. The list is empty if none is.
#[derive(Default, PartialEq, Serialize, Deserialize)]
struct Early(Vec<bool>);

impl Early {
    fn of(model: &Description) -> Self {
        Self(unless_all_default(model.actuators.iter().map(|actuator| actuator.early)))
    }
}

/// Force models of all actuators. The list is empty if every actuator has the force model that follows from its gain and bias
/// ([`ForceModel::of_parameters`]).
#[derive(Default, PartialEq, Serialize, Deserialize)]
struct ForceModels(Vec<ForceModel>);

impl ForceModels {
    fn of(model: &Description) -> Self {
        let usual = model.actuators.iter().all(|a| a.force_model == ForceModel::of_parameters(&a.gain, &a.bias));
        Self(if usual { vec![] } else { model.actuators.iter().map(|a| a.force_model).collect() })
    }
}

/// Description in which all actuators have the gain and bias parameters of the equivalent affine force.
fn with_affine_forces(description: &Description) -> Cow<'_, Description> {
    let mut affine = Cow::Borrowed(description);
    for (i, actuator) in description.actuators.iter().enumerate() {
        let (gain, bias) = actuator.affine_force();
        if (gain, bias) != (actuator.gain, actuator.bias) {
            let own = &mut affine.to_mut().actuators[i];
            (own.gain, own.bias) = (gain, bias);
        }
    }
    affine
}

impl Model {
    /// SHA-256 of the description, including all names. Equal models have equal digests on every machine.
    ///
    /// Of each actuator, only the affine force counts ([`Actuator::affine_force`](crate::Actuator::affine_force)). Models whose actuators
    /// have different [`ForceModel`]s but equal affine forces have equal digests.
    pub fn digest(&self) -> [u8; 32] {
        let description = with_affine_forces(&self.description);
        // Without noslip iterations and added fields, the digest must equal that of older stepper versions, which had no such fields.
        let (noslip, added, paths) = (self.soft.noslip, Added::of(self), PathsAndMuscles::of(self));
        let early = Early::of(self);
        if early != Early::default() {
            let held = encoded(&(&self.description, noslip, added, paths, ForceModels::of(self), early));
            return Sha256::digest(held).into();
        }
        let held = match (noslip == NoSlip::default(), added == Added::default(), paths == PathsAndMuscles::default()) {
            (true, true, true) => encoded(&*description),
            (false, true, true) => encoded(&(&*description, noslip)),
            (_, false, true) => encoded(&(&*description, noslip, added)),
            // Muscles have no affine force, so that the types of gain and bias count.
            (_, _, false) => encoded(&(&self.description, noslip, added, paths, ForceModels::of(self))),
        };
        Sha256::digest(held).into()
    }

    /// Converts the model to bytes, see [`Model::from_bytes`].
    pub fn to_bytes(&self) -> Vec<u8> {
        let (added, forces, paths) = (Added::of(self), ForceModels::of(self), PathsAndMuscles::of(self));
        sealed(FORMAT_VERSION, &(&self.description, self.hulls.surfaces(), self.soft.noslip, added, forces, paths, Early::of(self)))
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

/// List of the values, or an empty list if each of them is the default.
fn unless_all_default<T: Default + PartialEq>(values: impl Iterator<Item = T>) -> Vec<T> {
    let values: Vec<T> = values.collect();
    if values.iter().all(|value| *value == T::default()) { vec![] } else { values }
}

/// Bytes of a file: the header with the format version `version`, then the encoded payload `data`.
fn sealed(version: u32, data: &impl Serialize) -> Vec<u8> {
    let payload = encoded(data);
    [&MAGIC[..], &version.to_le_bytes(), &Sha256::digest(&payload), &payload].concat()
}

fn encoded(data: &impl Serialize) -> Vec<u8> {
    postcard::to_stdvec(data).expect("a model is plain data in memory: numbers, strings and sequences of known length")
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
    if !(WITHOUT_NOSLIP..=FORMAT_VERSION).contains(&version) {
        return refuse(
            format!("format version {version}, this stepper reads {FORMAT_VERSION}"),
            "load the original description and save it again with this version of stepper, or use the version that saved it",
        );
    }
    let (digest, payload) = (&bytes[12..HEADER], &bytes[HEADER..]);
    if digest != &Sha256::digest(payload)[..] {
        return refuse("damaged: the contents do not match their SHA-256".into(), "copy the file again, or save the model again");
    }
    match read(payload, version) {
        Some((model, surfaces)) => model.check(Source::Kept(&surfaces)),
        None => refuse(
            "not readable by this version of stepper, although its SHA-256 is right".into(),
            "save the model again with this version of stepper",
        ),
    }
}

/// Reads the description and the surfaces of its hulls from the payload of a file with this version of the format. Returns `None` for any
/// other payload.
fn read(mut payload: &[u8], version: u32) -> Option<(Description, Surfaces)> {
    let (mut model, surfaces): (Description, Surfaces) = take(&mut payload, true)?;
    model.soft.noslip = take(&mut payload, version > WITHOUT_NOSLIP)?;
    let added: Added = take(&mut payload, version > WITHOUT_ADDED)?;
    assign(&mut model.joints, added.velocity_limits, |joint, limit| joint.velocity_limit = limit)?;
    model.excluded_overlaps = added.excluded_overlaps;
    let ForceModels(force_models) = take(&mut payload, version > WITHOUT_FORCE_MODELS)?;
    model.actuators.iter_mut().for_each(|a| a.force_model = ForceModel::of_parameters(&a.gain, &a.bias));
    assign(&mut model.actuators, force_models, |actuator, force_model| actuator.force_model = force_model)?;
    let PathsAndMuscles { paths, muscles } = take(&mut payload, version > WITHOUT_PATHS)?;
    assign(&mut model.tendons, paths, |tendon, path| tendon.path = path)?;
    assign(&mut model.actuators, muscles, |actuator, muscle| actuator.muscle = muscle)?;
    let Early(early) = take(&mut payload, version > WITHOUT_EARLY)?;
    assign(&mut model.actuators, early, |actuator, early| actuator.early = early)?;
    payload.is_empty().then_some((model, surfaces))
}

/// Reads a value from the front of the payload, or returns the default if the payload has no such value.
fn take<T: DeserializeOwned + Default>(payload: &mut &[u8], is_present: bool) -> Option<T> {
    if !is_present {
        return Some(T::default());
    }
    let (value, rest) = postcard::take_from_bytes(payload).ok()?;
    *payload = rest;
    Some(value)
}

/// Sets one value in each element. An empty list leaves the elements unchanged. Returns `None` for a list of another length.
fn assign<E, V>(elements: &mut [E], values: Vec<V>, set: fn(&mut E, V)) -> Option<()> {
    if !values.is_empty() && values.len() != elements.len() {
        return None;
    }
    elements.iter_mut().zip(values).for_each(|(element, value)| set(element, value));
    Some(())
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::finish::tests::rich_model;
    use super::super::{BodyBuilder, GainType, GeomBuilder, JointBuilder, WORLD};
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
    fn a_file_of_the_version_before_is_read_without_noslip_sweeps() {
        let mut model = rich_model();
        let old = sealed(WITHOUT_NOSLIP, &(&model.description, model.hulls.surfaces()));
        assert_eq!(Model::from_bytes(&old).unwrap(), model);
        let before = model.digest();
        model.description.soft.noslip = NoSlip { iterations: 7, tolerance: 1e-9 };
        let back = Model::from_bytes(&model.to_bytes()).unwrap();
        assert_eq!(back, model);
        assert_ne!(back.digest(), before);
    }

    #[test]
    fn added_fields_are_kept_and_older_files_have_none() {
        let mut model = rich_model();
        let old = sealed(WITHOUT_ADDED, &(&model.description, model.hulls.surfaces(), model.soft.noslip));
        assert_eq!(Model::from_bytes(&old).unwrap(), model);
        let before = model.digest();
        model.description.joints[1].velocity_limit = Some(3.0);
        let limited = model.digest();
        model.description.excluded_overlaps.push(Overlap { geoms: [0, 1], depth: 0.1 });
        let back = Model::from_bytes(&model.to_bytes()).unwrap();
        assert_eq!(back, model);
        assert!(before != limited && limited != back.digest());
    }

    #[test]
    fn force_models_are_kept_and_older_files_have_those_of_the_parameters() {
        let mut model = rich_model();
        let old = sealed(WITHOUT_FORCE_MODELS, &(&model.description, model.hulls.surfaces(), model.soft.noslip, Added::of(&model)));
        assert_eq!(Model::from_bytes(&old).unwrap(), model);
        let before = model.digest();
        model.description.actuators[1].force_model.gain = GainType::Affine;
        assert_eq!(Model::from_bytes(&model.to_bytes()).unwrap(), model);
        assert_eq!(model.digest(), before);
        model.description.actuators[1].force_model.disabled = true;
        assert_ne!(model.digest(), before);
        let few = ForceModels(vec![ForceModel::default()]);
        let misfit = sealed(WITHOUT_PATHS, &(&model.description, model.hulls.surfaces(), model.soft.noslip, Added::of(&model), few));
        assert!(Model::from_bytes(&misfit).unwrap_err().to_string().contains("save the model again"));
    }

    #[test]
    fn early_activations_are_kept_and_older_files_have_none() {
        let mut model = rich_model();
        let (added, forces, paths) = (Added::of(&model), ForceModels::of(&model), PathsAndMuscles::of(&model));
        let old = sealed(WITHOUT_EARLY, &(&model.description, model.hulls.surfaces(), model.soft.noslip, added, forces, paths));
        assert_eq!(Model::from_bytes(&old).unwrap(), model);
        let before = model.digest();
        model.description.actuators[0].early = true;
        assert_eq!(Model::from_bytes(&model.to_bytes()).unwrap(), model);
        assert_ne!(model.digest(), before);
    }

    #[test]
    fn added_fields_that_do_not_fit_are_refused() {
        let model = rich_model();
        let refused = |added: Added| {
            let file =
                sealed(WITHOUT_PATHS, &(&model.description, model.hulls.surfaces(), model.soft.noslip, added, ForceModels::default()));
            Model::from_bytes(&file).unwrap_err().to_string()
        };
        assert!(refused(Added { velocity_limits: vec![None], ..Added::default() }).contains("save the model again"));
        let far = vec![Overlap { geoms: [0, 777], depth: 0.1 }];
        assert!(refused(Added { excluded_overlaps: far, ..Added::default() }).contains("777"));
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

    /// Bytes of a saved model, in which `change` has edited the triangles of the hulls.
    fn with_surface(model: &Model, change: impl FnOnce(&mut Surfaces)) -> Vec<u8> {
        let mut surfaces = model.hulls.surfaces();
        change(&mut surfaces);
        let (added, forces, paths) = (Added::of(model), ForceModels::of(model), PathsAndMuscles::of(model));
        sealed(FORMAT_VERSION, &(&model.description, surfaces, model.soft.noslip, added, forces, paths, Early::default()))
    }

    #[test]
    fn hulls_are_kept_and_shared() {
        let model = stones();
        let hull = |model: &Model| model.hull_of(&model.geoms[1].shape).unwrap().clone();
        let surfaces = model.hulls.surfaces();
        assert!(surfaces[0].is_none() && surfaces[1].as_ref().unwrap().len() == 12);
        assert!(Arc::ptr_eq(&hull(&model), model.hull_of(&model.geoms[2].shape).unwrap()), "one hull for both geoms");
        assert!(Arc::ptr_eq(&hull(&model), &hull(&model.replace("timestep", &[0.001]).unwrap())), "other numbers, the same hull");
        let back = Model::from_bytes(&model.to_bytes()).unwrap();
        assert_eq!(back, model);
        assert_eq!(back.to_bytes(), model.to_bytes());
        // The triangles are in the order of the file. A recomputed hull would have another order.
        let turned = Model::from_bytes(&with_surface(&model, |s| s[1].as_mut().unwrap().reverse())).unwrap();
        let mut triangles = hull(&turned).triangles().to_vec();
        assert_ne!(triangles, hull(&model).triangles());
        triangles.reverse();
        assert_eq!(triangles, hull(&model).triangles());
        // Hulls that the file does not have are computed from the vertices.
        assert_eq!(Model::from_bytes(&with_surface(&model, Vec::clear)).unwrap(), model);
        assert_eq!(turned.digest(), model.digest());
    }

    #[test]
    fn another_hull_in_a_sound_file_is_refused() {
        let model = stones();
        let refused = |change: &dyn Fn(&mut Vec<[u32; 3]>)| {
            let error = Model::from_bytes(&with_surface(&model, |s| change(s[1].as_mut().unwrap()))).unwrap_err().to_string();
            assert!(error.contains("mesh \"stone\"") && error.contains("hull") && error.contains("save the model again"), "{error}");
        };
        refused(&|s| s[0][0] = 77);
        refused(&|s| s.truncate(s.len() - 1));
        refused(&|s| s.iter_mut().flatten().for_each(|v| *v = if *v == 7 { 8 } else { *v }));
        refused(&|s| *s = vec![[0, 2, 1], [0, 1, 4], [1, 2, 4], [2, 0, 4]]);
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
