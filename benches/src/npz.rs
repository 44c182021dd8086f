//! Reader of arrays of numbers in NumPy's file formats .npy and .npz.

use std::io::{Cursor, Read};

use zip::ZipArchive;
use zip::result::ZipError;

/// Array of numbers in C order.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// Length of each axis.
    pub shape: Vec<usize>,
    /// All numbers of the array. Booleans are 0 and 1.
    pub values: Vec<f64>,
    /// Whether the numbers are booleans, such as those of a mask.
    pub is_mask: bool,
}

impl Array {
    /// Numbers at index `k` of the first axis.
    ///
    /// # Panics
    /// If the index is out of range.
    pub fn row(&self, k: usize) -> &[f64] {
        let size = self.shape[1..].iter().product::<usize>();
        &self.values[k * size..(k + 1) * size]
    }
}

/// Archive of `numpy.savez` in memory, from which arrays are read by name.
pub struct Npz {
    place: String,
    archive: ZipArchive<Cursor<Vec<u8>>>,
}

impl Npz {
    /// Opens the bytes of a file of `numpy.savez`. `place` names them in error messages.
    ///
    /// # Errors
    /// If the bytes are not those of a file of `numpy.savez`.
    pub fn from_bytes(place: String, bytes: Vec<u8>) -> Result<Self, String> {
        let archive = ZipArchive::new(Cursor::new(bytes)).map_err(|e| format!("{place}: {e}; give an archive of numpy.savez"))?;
        Ok(Self { place, archive })
    }

    /// Names of all arrays. Names that are no text are left out.
    pub fn names(&self) -> impl Iterator<Item = String> {
        self.archive.file_names().filter_map(|name| Some(name.ok()?.strip_suffix(".npy")?.to_string()))
    }

    /// Array with the given name, or `None` if the file has no such array.
    ///
    /// # Errors
    /// If the array is damaged or does not contain numbers.
    pub fn get(&mut self, name: &str) -> Result<Option<Array>, String> {
        let place = format!("{}: {name}", self.place);
        let mut bytes = Vec::new();
        match self.archive.by_name(&format!("{name}.npy")) {
            Err(ZipError::FileNotFound) => return Ok(None),
            Err(e) => return Err(format!("{place}: {e}")),
            Ok(mut member) => member.read_to_end(&mut bytes).map_err(|e| format!("{place}: {e}"))?,
        };
        let array = parse(&bytes).ok_or_else(|| format!("{place} is no array of numbers, row by row, in little endian"))?;
        Ok(Some(array))
    }

    /// Array with the given name, which must exist.
    ///
    /// # Errors
    /// Returns the errors of [`Npz::get`], and an error if there is no such array.
    pub fn array(&mut self, name: &str) -> Result<Array, String> {
        self.get(name)?.ok_or_else(|| format!("{}: {name} is missing", self.place))
    }
}

/// Array from the bytes of a .npy file, or `None` if they are invalid.
///
/// The format is: 6 bytes of identification, version, length of the header, header, numbers. The header is a dictionary in Python's syntax.
fn parse(bytes: &[u8]) -> Option<Array> {
    let version = *bytes.strip_prefix(b"\x93NUMPY")?.first()?;
    let start = if version == 1 { 10 } else { 12 };
    let length = bytes.get(8..start)?.iter().rev().fold(0, |sum, &byte| sum << 8 | usize::from(byte));
    let header = std::str::from_utf8(bytes.get(start..start + length)?).ok()?;
    if !header.contains("'fortran_order': False") {
        return None;
    }
    let between = |from: &str, to: char| Some(header.split_once(from)?.1.split_once(to)?.0);
    let sizes = between("'shape': (", ')')?.split(',').map(str::trim).filter(|size| !size.is_empty());
    let shape = sizes.map(|size| size.parse().ok()).collect::<Option<Vec<usize>>>()?;
    let data = &bytes[start + length..];
    let kind = between("'descr': '", '\'')?;
    let values: Vec<f64> = match kind {
        "<f8" => numbers(data, f64::from_le_bytes),
        "<f4" => numbers(data, |b| f32::from_le_bytes(b).into()),
        "<i8" => numbers(data, |b| i64::from_le_bytes(b) as f64),
        "<i4" => numbers(data, |b| i32::from_le_bytes(b).into()),
        "<u4" => numbers(data, |b| u32::from_le_bytes(b).into()),
        "|u1" | "|b1" => numbers(data, |[byte]: [u8; 1]| byte.into()),
        _ => return None,
    };
    (values.len() == shape.iter().product::<usize>()).then_some(Array { shape, values, is_mask: kind == "|b1" })
}

fn numbers<const N: usize>(data: &[u8], read: impl Fn([u8; N]) -> f64) -> Vec<f64> {
    data.as_chunks().0.iter().map(|&bytes| read(bytes)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bytes of a .npy file as `numpy.save` writes it.
    fn saved(descr: &str, shape: &str, data: &[u8]) -> Vec<u8> {
        let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}\n");
        [b"\x93NUMPY\x01\x00", &(header.len() as u16).to_le_bytes()[..], header.as_bytes(), data].concat()
    }

    #[test]
    fn arrays_are_read_row_by_row() {
        let data: Vec<u8> = [1.0, 2.0, 3.0, 4.0_f32].iter().flat_map(|x| x.to_le_bytes()).collect();
        let array = parse(&saved("<f4", "(2, 2)", &data)).unwrap();
        assert_eq!((array.shape.as_slice(), array.row(1)), (&[2, 2][..], &[3.0, 4.0][..]));
        let mask = parse(&saved("|b1", "(3,)", &[1, 0, 1])).unwrap();
        assert_eq!((mask.values.as_slice(), mask.is_mask, array.is_mask), (&[1.0, 0.0, 1.0][..], true, false));
        assert_eq!(parse(&saved("<i8", "()", &7_i64.to_le_bytes())).unwrap().values, [7.0]);
    }

    #[test]
    fn other_bytes_are_refused() {
        for bytes in [saved("<U3", "(1,)", &[0; 12]), saved("<f8", "(2,)", &[0; 8]), saved(">f8", "(1,)", &[0; 8]), b"PK".to_vec()] {
            assert_eq!(parse(&bytes), None);
        }
    }
}
