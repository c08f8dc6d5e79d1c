//! Round trips of each format, and errors for damaged files.

mod damage;
mod gwyddion;
mod igor;
mod nanoscope;
mod others;
mod sdf;
mod x3p;

use super::super::{HeightField, Scale, read};

/// Heights in nm of a patch with four different corners, row 0 on top.
const W: usize = 5;
const H: usize = 4;
const NM: [f64; W * H] =
    [11., 12., 14., 18., 26., 31., 37., 41., 43., 47., 53., 59., 61., 67., 71., 73., 79., 83., 89., 97.];
/// Pitch in µm.
const PITCH: f64 = 0.2;

/// Rows from the lowest to the highest.
fn lowest_first() -> Vec<f64> {
    NM.chunks(W).rev().flatten().copied().collect()
}

fn file(bytes: &[u8], scale: &Scale) -> nacre_base::Result<HeightField> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("measured");
    std::fs::write(&path, bytes).unwrap();
    read(&path, scale)
}

/// Reads the bytes and compares them with the patch.
fn holds(bytes: &[u8], name: &str) -> HeightField {
    let field = file(bytes, &Scale::default()).unwrap_or_else(|e| panic!("{name}: {e}"));
    assert_eq!((field.width, field.height), (W, H), "{name}");
    assert!((field.pixel_um - PITCH).abs() < 1e-9, "{name}: {}", field.pixel_um);
    let [low, _] = field.ends_um();
    for (found, nm) in field.um.iter().zip(NM) {
        assert!((found - low - 1e-3 * (nm - NM[0])).abs() < 1e-8, "{name}: {:?}", field.um);
    }
    field
}

fn refused(bytes: &[u8], words: &[&str]) {
    let problem = file(bytes, &Scale::default()).unwrap_err().to_string();
    assert!(words.iter().all(|w| problem.contains(w)), "{words:?}: {problem}");
}

fn le<const N: usize>(values: &[f64], number: impl Fn(f64) -> [u8; N]) -> Vec<u8> {
    values.iter().flat_map(|v| number(*v)).collect()
}

#[test]
fn flags_that_contradict_a_file_are_refused() {
    let bytes = gwyddion::sample();
    let with =
        |pixel_um: Option<f64>, range_um: Option<f64>| file(&bytes, &Scale { pixel_um, range_um, ..Scale::default() });
    assert!(with(Some(0.2005), Some(0.088)).is_ok());
    let problem = |result: nacre_base::Result<HeightField>| result.unwrap_err().to_string();
    let pitch = problem(with(Some(0.21), None));
    assert!(pitch.contains("pixels of 0.2") && pitch.contains("--pixel-um says 0.21"), "{pitch}");
    let range = problem(with(None, Some(0.15)));
    assert!(range.contains("spans 0.086") && range.contains("--range-um says 0.15"), "{range}");
}
