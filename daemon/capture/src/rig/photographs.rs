//! Reads photographs of still cameras for the drivers, with the program's decoders and their limits.

use super::Stop;
use super::terminal::Terminal;
use nacre_drivers::Prompt;
use nacre_drivers::camera::photograph::{Channel, Photograph, PhotographReader, Photography, Shot, Taken};
use nacre_image::{EXTENSIONS, Raster, Samples, details, exposure, origin, read};
use std::fs;
use std::path::Path;
use std::sync::Arc;

/// File extensions of photographs that are not raw files, in lower case.
const DEVELOPED: [&str; 2] = ["jpg", "jpeg"];
/// File extensions of raw files, in lower case, whether or not this build reads them.
const RAW: [&str; 17] = [
    "dng", "cr2", "cr3", "nef", "nrw", "arw", "raf", "orf", "rw2", "rwl", "pef", "srw", "3fr", "erf", "mef", "dcr",
    "kdc",
];

/// Services of the program for still cameras. The operator is asked at the terminal.
pub fn photography(stop: &Stop) -> Photography {
    let stop = stop.clone();
    let prompt = move || Box::new(Terminal { stop: stop.clone() }) as Box<dyn Prompt>;
    Photography { reader: Arc::new(Reader), prompt: Arc::new(prompt) }
}

/// The program's decoders.
struct Reader;

impl PhotographReader for Reader {
    fn kind(&self, name: &str) -> Option<bool> {
        let extension = Path::new(name).extension()?.to_str()?.to_ascii_lowercase();
        let developed = DEVELOPED.contains(&extension.as_str()) && EXTENSIONS.contains(&extension.as_str());
        if developed { Some(false) } else { RAW.contains(&extension.as_str()).then_some(true) }
    }

    fn shot(&self, file: &Path) -> Result<Shot, String> {
        let (origin, exposure) = (origin(file).unwrap_or_default(), exposure(file));
        Ok(Shot {
            raw: self.kind(&file.to_string_lossy()) == Some(true),
            taken: origin.seconds.map(|seconds| Taken { seconds, resolution_s: origin.resolution_s }),
            exposure_s: exposure.and_then(|e| e.seconds),
            iso: exposure.and_then(|e| e.iso),
            aperture: exposure.and_then(|e| e.f_number),
            model: origin.model,
            serial: origin.serial,
        })
    }

    fn read(&self, file: &Path, channel: Channel) -> Result<Photograph, String> {
        let stated = details(file).map_err(|e| e.to_string())?;
        let mut shot = self.shot(file)?;
        // The name of a file may be wrong.
        shot.raw = stated.black.is_some();
        // A damaged end of a file may be one that is still being written.
        if let Some(note) = stated.notes.iter().find(|note| note.contains("end marker")) {
            return Err(note.clone());
        }
        let raster = read(file).map_err(|e| e.to_string())?;
        let full = f64::from(raster.info().depth.full_scale());
        let level = |value: Option<f64>, default: f64| value.unwrap_or(default).round().clamp(0.0, 65_535.0) as u16;
        let (black, white) = (level(stated.black, 0.0), level(stated.white, full));
        let (width, height) = (raster.width, raster.height);
        Ok(Photograph { shot, width, height, codes: codes(raster, channel)?, black, white })
    }

    fn read_bytes(&self, name: &str, bytes: &[u8], channel: Channel) -> Result<Photograph, String> {
        // The extension of a name from a camera, not its folders.
        let extension = Path::new(name).extension().and_then(|e| e.to_str()).unwrap_or_default();
        let plain: String = extension.chars().filter(char::is_ascii_alphanumeric).take(8).collect();
        let folder = tempfile::tempdir().map_err(|e| format!("cannot be stored: {e}; free some disk space"))?;
        let file = folder.path().join(format!("photograph.{plain}"));
        fs::write(&file, bytes).map_err(|e| format!("cannot be stored: {e}; free some disk space"))?;
        self.read(&file, channel)
    }
}

/// Codes of one channel.
fn codes(raster: Raster, channel: Channel) -> Result<Vec<u16>, String> {
    let place = match channel {
        _ if raster.channels == 1 => 0,
        Channel::Red => 0,
        Channel::Green => 1,
        Channel::Blue => 2,
    };
    let step = raster.channels;
    match raster.samples {
        Samples::U8(samples) => Ok(samples.into_iter().skip(place).step_by(step).map(u16::from).collect()),
        Samples::U16(samples) => Ok(samples.into_iter().skip(place).step_by(step).collect()),
        Samples::F32(_) => Err("has floating-point values; record camera raw or JPEG files".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_tell_raw_files_from_jpeg_and_others() {
        for (name, kind) in [
            ("DSC_0001.NEF", Some(true)),
            ("a.cr3", Some(true)),
            ("IMG.JPG", Some(false)),
            ("a.jpeg", Some(false)),
            ("a.cr2.part", None),
            ("a.png", None),
            ("jpg", None),
            (".jpg", None),
        ] {
            assert_eq!(Reader.kind(name), kind, "{name}");
        }
    }

    #[test]
    fn a_photograph_is_read_from_memory_by_channel_and_damage_is_an_error() {
        let mut jpeg = vec![];
        let picture = image::RgbImage::from_fn(16, 8, |x, _| image::Rgb([10, if x < 8 { 60 } else { 200 }, 10]));
        let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut jpeg, 100);
        picture.write_with_encoder(encoder).unwrap();
        let read = |bytes: &[u8], channel| Reader.read_bytes("/store/A.JPG", bytes, channel);
        let photograph = read(&jpeg, Channel::Green).unwrap();
        assert_eq!((photograph.width, photograph.height, photograph.white), (16, 8, 255));
        assert!(!photograph.shot.raw && photograph.shot.exposure_s.is_none());
        assert!(photograph.codes[0].abs_diff(60) < 6 && photograph.codes[15].abs_diff(200) < 6);
        assert!(read(&jpeg, Channel::Red).unwrap().codes[15].abs_diff(10) < 6);
        for end in [0, 2, 20, jpeg.len() / 2, jpeg.len() - 2] {
            assert!(read(&jpeg[..end], Channel::Green).is_err(), "{end}");
        }
        assert!(read(b"no picture at all", Channel::Green).is_err());
    }
}
