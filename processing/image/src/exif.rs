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

/// Camera and time of a photograph; `None` where the tag is absent or invalid.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Origin {
    /// Start of the exposure on the camera's clock, in seconds since 1970, in an unknown time zone.
    pub seconds: Option<f64>,
    /// Resolution of that time in s: 1 without a tag for parts of a second.
    pub resolution_s: f64,
    /// Model of the camera.
    pub model: Option<String>,
    /// Serial number of the camera.
    pub serial: Option<String>,
}

/// Longest accepted text of a tag in bytes.
const MAX_TEXT: usize = 200;

/// Camera and time of a photograph, from its Exif tags; `None` if the file cannot be read or has no Exif tags.
pub fn origin(path: &Path) -> Option<Origin> {
    tags(path, |tags| {
        let bytes = |tag| match tags.get_field(tag, In::PRIMARY).map(|field| &field.value) {
            Some(Value::Ascii(lines)) => lines.first().filter(|line| line.len() <= MAX_TEXT).cloned(),
            _ => None,
        };
        let text = |tag| bytes(tag).and_then(|line| words(&line));
        let date = bytes(Tag::DateTimeOriginal).or_else(|| bytes(Tag::DateTime));
        let parts = bytes(Tag::SubSecTimeOriginal).and_then(|digits| part(&digits));
        let [part, resolution_s] = parts.unwrap_or([0.0, 1.0]);
        Some(Origin {
            seconds: date.and_then(|date| seconds(&date)).map(|s| s + part),
            resolution_s,
            model: text(Tag::Model),
            serial: text(Tag::BodySerialNumber),
        })
    })
}

/// Printable text without surrounding blanks; `None` if nothing remains.
fn words(bytes: &[u8]) -> Option<String> {
    let text: String = String::from_utf8_lossy(bytes).chars().filter(|c| !c.is_control()).collect();
    Some(text.trim().to_owned()).filter(|text| !text.is_empty())
}

/// Seconds since 1970 of a date such as `2024:02:29 23:59:59`.
fn seconds(date: &[u8]) -> Option<f64> {
    let date = exif::DateTime::from_ascii(date).ok()?;
    let valid = (1..=12).contains(&date.month) && (1..=31).contains(&date.day) && date.year >= 1900;
    if !valid || date.hour > 23 || date.minute > 59 || date.second > 60 {
        return None;
    }
    let days = nacre_base::calendar::days(date.year.into(), date.month.into(), date.day.into());
    let time = 3600 * i64::from(date.hour) + 60 * i64::from(date.minute) + i64::from(date.second);
    Some((days * 86_400 + time) as f64)
}

/// Part of a second and its resolution, from decimal digits.
fn part(digits: &[u8]) -> Option<[f64; 2]> {
    let text = std::str::from_utf8(digits).ok()?.trim();
    let valid = (1..=9).contains(&text.len()) && text.bytes().all(|b| b.is_ascii_digit());
    let scale = 10_f64.powi(i32::try_from(text.len()).ok()?);
    text.parse::<f64>().ok().filter(|_| valid).map(|number| [number / scale, 1.0 / scale])
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
    fn dates_and_parts_of_seconds_are_read() {
        assert_eq!(seconds(b"1970:01:02 00:00:01"), Some(86_401.0));
        assert_eq!(seconds(b"2024:03:01 00:00:00"), Some(1_709_251_200.0));
        for wrong in ["", "    :  :     :  :  ", "2024:13:01 00:00:00", "2024:00:10 00:00:00", "0000:00:00 00:00:00"] {
            assert_eq!(seconds(wrong.as_bytes()), None, "{wrong}");
        }
        assert_eq!(part(b"25"), Some([0.25, 0.01]));
        assert_eq!([part(b""), part(b"x"), part(b"12345678901"), part(b"-1")], [None; 4]);
        assert_eq!(words(b" Acme\0\x07 Eye "), Some("Acme Eye".into()));
        assert_eq!(words(b" \0"), None);
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
