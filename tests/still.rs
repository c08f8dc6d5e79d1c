//! Photographs of a still camera, as files with Exif tags.

#![allow(clippy::unwrap_used)]

use nacre_tests::http::Service;
use serde_json::Value;
use std::time::SystemTime;

/// Exif tags of a photograph.
#[derive(Clone)]
pub(crate) struct Tags {
    pub(crate) exposure: [u32; 2],
    pub(crate) iso: u16,
    /// `2024:02:29 23:59:59`.
    pub(crate) taken: String,
    pub(crate) serial: &'static str,
}

/// Time on the clock of a camera that is wrong by years, as an Exif tag.
pub(crate) fn camera_time(shift_s: i64) -> String {
    let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap().as_secs();
    let seconds = i64::try_from(now).unwrap() - 300_000_000 + shift_s;
    let (mut day, mut year) = (seconds.div_euclid(86_400), 1970);
    let leap = |year: i64| i64::from(year % 4 == 0 && (year % 100 != 0 || year % 400 == 0));
    while day >= 365 + leap(year) {
        day -= 365 + leap(year);
        year += 1;
    }
    let mut month = 1;
    for length in [31, 28 + leap(year), 31, 30, 31, 30, 31, 31, 30, 31, 30] {
        if day < length {
            break;
        }
        day -= length;
        month += 1;
    }
    let second = seconds.rem_euclid(86_400);
    let [hour, minute, second] = [second / 3600, second / 60 % 60, second % 60];
    format!("{year:04}:{month:02}:{:02} {hour:02}:{minute:02}:{second:02}", day + 1)
}

/// Waits until a session has ended with all its frames.
pub(crate) fn completed(service: &Service, id: &str) -> Value {
    let done = service.until(&format!("/api/v1/sessions/{id}"), |s| s["state"] == "finished" || s["error"].is_string());
    assert!(done["error"].is_null(), "{done}");
    done
}

/// Entry of a TIFF directory: tag, type, count and bytes, in little-endian order.
type Entry = (u16, u16, u32, Vec<u8>);

fn text(tag: u16, text: &str) -> Entry {
    (tag, 2, text.len() as u32 + 1, [text.as_bytes(), &[0]].concat())
}

fn short(tag: u16, values: &[u16]) -> Entry {
    (tag, 3, values.len() as u32, values.iter().flat_map(|v| v.to_le_bytes()).collect())
}

fn long(tag: u16, value: u32) -> Entry {
    (tag, 4, 1, value.to_le_bytes().to_vec())
}

fn exif(tags: &Tags) -> Vec<Entry> {
    let ratio = tags.exposure.iter().flat_map(|v| v.to_le_bytes()).collect();
    vec![(33_434, 5, 1, ratio), short(34_855, &[tags.iso]), text(36_867, &tags.taken), text(42_033, tags.serial)]
}

/// TIFF file of a directory, with Exif tags and data.
fn tiff(mut entries: Vec<Entry>, tags: &Tags, data: &[u8]) -> Vec<u8> {
    let mut file = [b"II*\0\0\0\0\0", data].concat();
    let mut directory = |mut entries: Vec<Entry>| {
        entries.sort_by_key(|entry| entry.0);
        let mut out = (entries.len() as u16).to_le_bytes().to_vec();
        for (tag, kind, count, mut bytes) in entries {
            out.extend([tag.to_le_bytes(), kind.to_le_bytes()].concat());
            out.extend(count.to_le_bytes());
            if bytes.len() > 4 {
                file.resize(file.len().next_multiple_of(2), 0);
                out.extend((file.len() as u32).to_le_bytes());
                file.extend(bytes);
            } else {
                bytes.resize(4, 0);
                out.extend(bytes);
            }
        }
        file.resize(file.len().next_multiple_of(2), 0);
        let at = file.len() as u32;
        file.extend(out);
        file.extend([0; 4]);
        at
    };
    let exif = directory(exif(tags));
    entries.extend([text(271, "Acme"), text(272, "Acme Eye"), long(34_665, exif)]);
    let first = directory(entries);
    file[4..8].copy_from_slice(&first.to_le_bytes());
    file
}

/// A DNG of this size, all of whose green pixels have one code; red and blue ones are darker.
pub(crate) fn dng(width: u16, height: u16, green: u16, tags: &Tags) -> Vec<u8> {
    let at = |x: u16, y: u16| if (x + y) % 2 == 1 { green } else { 600 };
    let codes = (0..height).flat_map(|y| (0..width).map(move |x| at(x, y)));
    let data: Vec<u8> = codes.flat_map(|code| code.to_le_bytes()).collect();
    let entries = vec![
        long(254, 0),
        long(256, width.into()),
        long(257, height.into()),
        short(258, &[16]),
        short(259, &[1]),
        short(262, &[32_803]),
        long(273, 8),
        short(277, &[1]),
        long(278, height.into()),
        long(279, data.len() as u32),
        short(33_421, &[2, 2]),
        (33_422, 1, 4, vec![0, 1, 1, 2]),
        (50_706, 1, 4, vec![1, 4, 0, 0]),
        short(50_714, &[512]),
        short(50_717, &[4095]),
    ];
    tiff(entries, tags, &data)
}

/// A JPEG of this size whose green is a ramp, with Exif tags if given.
pub(crate) fn jpeg(width: u32, height: u32, tags: Option<&Tags>) -> Vec<u8> {
    let picture = image::RgbImage::from_fn(width, height, |x, y| image::Rgb([20, (2 * x + y) as u8, 20]));
    let mut jpeg = vec![];
    let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut jpeg, 95);
    picture.write_with_encoder(encoder).unwrap();
    let Some(tags) = tags else { return jpeg };
    let segment = [b"Exif\0\0".as_slice(), &tiff(vec![], tags, &[])].concat();
    let length = (segment.len() as u16 + 2).to_be_bytes();
    [&jpeg[..2], b"\xff\xe1", &length, &segment, &jpeg[2..]].concat()
}
