//! Exposure settings and orientation from Exif tags.

use std::io::{BufReader, Read};
use std::path::Path;

use super::raster::MAX_BYTES;
use super::read::taken;
use exif::{In, Reader, Tag, Value};
use nacre_base::guard::guarded;
use nacre_base::input;

/// Number of bytes of a file that are searched for tags.
const SEARCHED: u64 = 256 << 20;

/// Exposure settings; `None` where the tag is absent or invalid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exposure {
    /// Exposure time in s.
    pub seconds: Option<f64>,
    /// Sensitivity (ISO).
    pub iso: Option<f64>,
    /// f-number.
    pub f_number: Option<f64>,
}

/// Exposure settings of a photograph; `None` if the file cannot be read or has no Exif tags.
pub fn exposure(path: &Path) -> Option<Exposure> {
    tags(path, |tags| {
        let field = |tag| tags.get_field(tag, In::PRIMARY).map(|field| &field.value);
        let number = |tag| field(tag).and_then(positive);
        // APEX units: time is 2^-value s, f-number 2^(value/2).
        let apex = |tag, per: f64| field(tag).and_then(any).map(|value| (value * per).exp2());
        Some(Exposure {
            seconds: number(Tag::ExposureTime).or_else(|| apex(Tag::ShutterSpeedValue, -1.0)),
            iso: [
                Tag::PhotographicSensitivity,
                Tag::ISOSpeed,
                Tag::RecommendedExposureIndex,
                Tag::StandardOutputSensitivity,
            ]
            .into_iter()
            .find_map(number),
            f_number: number(Tag::FNumber).or_else(|| apex(Tag::ApertureValue, 0.5)),
        })
    })
    // Camera raw files that are not TIFF files.
    .or_else(|| taken(path).map(|t| Exposure { seconds: t.seconds, iso: t.iso, f_number: t.aperture }))
}

/// Reads the Exif tags of a file and applies a function to them.
fn tags<T>(path: &Path, take: impl FnOnce(&exif::Exif) -> Option<T>) -> Option<T> {
    let file = input::open(path, MAX_BYTES).ok()?;
    let decode = || take(&Reader::new().read_from_container(&mut BufReader::new(file.take(SEARCHED))).ok()?);
    // Unreadable tags count as absent.
    guarded(decode).ok().flatten()
}

/// Orientation tag of a JPEG: 1 as stored, 2 to 8 rotated or mirrored; `None` without one.
pub(super) fn orientation(path: &Path) -> Option<u16> {
    tags(path, turned)
}

/// Orientation in a block of Exif tags.
pub(super) fn orientation_in(tags: Vec<u8>) -> Option<u16> {
    guarded(|| turned(&Reader::new().read_raw(tags).ok()?)).ok().flatten()
}

fn turned(tags: &exif::Exif) -> Option<u16> {
    let value = tags.get_field(Tag::Orientation, In::PRIMARY)?.value.get_uint(0)?;
    u16::try_from(value).ok().filter(|o| ORIENTATIONS.contains(o))
}

/// Valid values of the orientation tag.
pub(super) const ORIENTATIONS: std::ops::RangeInclusive<u16> = 1..=8;

/// Finite positive number.
fn positive(value: &Value) -> Option<f64> {
    any(value).filter(|x| *x > 0.0)
}

/// Finite number. The crate's conversions to integers and `f32` would be inexact for 1/3 s and others.
fn any(value: &Value) -> Option<f64> {
    let number = match value {
        Value::Rational(v) => v.first().map(|r| f64::from(r.num) / f64::from(r.denom)),
        Value::SRational(v) => v.first().map(|r| f64::from(r.num) / f64::from(r.denom)),
        _ => value.get_uint(0).map(f64::from),
    };
    number.filter(|x| x.is_finite())
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;

    #[test]
    fn times_of_a_real_bracket() {
        let default = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
        let data = std::env::var_os("NACRE_TEST_DATA").map_or(default, PathBuf::from).join("hdr");
        if !data.is_dir() {
            println!("skipped: no test data");
            return;
        }
        let mut times: Vec<f64> = (0..7)
            .map(|i| exposure(&data.join(format!("stack_room_exp_{i}.jpg"))).and_then(|e| e.seconds).unwrap())
            .collect();
        times.sort_by(f64::total_cmp);
        println!("{times:?}");
        assert_eq!(times.last(), Some(&2.0));
        assert_eq!(times.first(), Some(&(1.0 / 4000.0)));
        assert!(times.contains(&(1.0 / 8.0)));
    }

    #[test]
    fn anything_else_is_none() {
        let dir = tempfile::tempdir().unwrap();
        assert_eq!(exposure(dir.path()), None);
        assert_eq!(exposure(&dir.path().join("missing")), None);
        let path = dir.path().join("garbage.jpg");
        std::fs::write(&path, b"\xff\xd8\xff\xe1\xff\xffExif\0\0MM\0*\xff\xff\xff\xff").unwrap();
        assert_eq!(exposure(&path), None);
        assert_eq!(positive(&Value::Rational(vec![exif::Rational { num: 1, denom: 0 }])), None);
        assert_eq!(positive(&Value::Rational(vec![])), None);
    }
}
