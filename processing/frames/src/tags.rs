//! Exposures of photographs from Exif tags.

use nacre_base::{Error, Result};
use nacre_image::exposure;
use std::path::{Path, PathBuf};

/// ISO sensitivity of gain 1.
const BASE_ISO: f64 = 100.0;

/// Tolerance for rounded f-numbers, as a fraction of a third of a stop: f/5.6 represents 2^(5/2) = 5.657.
const ROUNDED: f64 = 0.03;

/// Exposure of a photograph.
#[derive(Clone, Debug, PartialEq)]
pub struct Tagged {
    /// Exposure time in s.
    pub seconds: Option<f64>,
    /// Sensitivity relative to ISO 100, times the aperture area relative to that of the first photograph.
    pub gain: Option<f64>,
}

/// Reads the exposure of each photograph. Different apertures count by their area; the second value is then a warning.
///
/// # Errors
/// `Input` if apertures differ and one is missing.
pub fn exposures(folder: &Path, files: &[PathBuf]) -> Result<(Vec<Tagged>, Option<String>)> {
    let tags: Vec<_> = files.iter().map(|file| exposure(&folder.join(file))).collect();
    let apertures: Vec<Option<f64>> = tags.iter().map(|t| t.and_then(|t| t.f_number).map(exact)).collect();
    let first = apertures.iter().copied().flatten().next();
    let other = apertures.iter().position(|n| n.is_some() && *n != first);
    let mut areas = vec![1.0; files.len()];
    let mut warning = None;
    if let (Some(first), Some(other)) = (first, other) {
        for (k, aperture) in apertures.iter().enumerate() {
            let Some(n) = aperture else {
                let path = folder.join(&files[k]);
                let problem = "does not say its f-number (Exif), and those of the other photographs differ";
                return Err(Error::file(&path, problem, "take all photographs at one aperture, or leave this one out"));
            };
            areas[k] = (first / n).powi(2);
        }
        warning = Some(format!(
            "apertures differ (f/{:.3} and, in {}, f/{:.3}): exposures count by the aperture's area, but vignetting and sharpness differ as well",
            first,
            files[other].display(),
            apertures[other].unwrap_or(first),
        ));
    }
    let gain = |(iso, area): (Option<f64>, f64)| match (iso, area) {
        (None, 1.0) => None,
        (iso, area) => Some(iso.map_or(1.0, |iso| iso / BASE_ISO) * area),
    };
    let isos = tags.iter().map(|t| t.and_then(|t| t.iso));
    let gains = isos.zip(areas).map(gain);
    let times = tags.iter().map(|t| t.and_then(|t| t.seconds));
    Ok((times.zip(gains).map(|(seconds, gain)| Tagged { seconds, gain }).collect(), warning))
}

/// Exact f-number of a rounded one.
fn exact(n: f64) -> f64 {
    let thirds = (6.0 * n.log2()).round();
    let near = (thirds / 6.0).exp2();
    if (n / near - 1.0).abs() < ROUNDED { near } else { n }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file with tags only: a TIFF with Exif entries of rational numbers.
    fn tagged(path: &Path, tags: &[(u16, [u32; 2])]) {
        let mut file = b"II\x2a\0\x08\0\0\0".to_vec();
        let entry = |tag: u16, kind: u16, value: u32| {
            [&tag.to_le_bytes()[..], &kind.to_le_bytes(), &1_u32.to_le_bytes(), &value.to_le_bytes()].concat()
        };
        // The first directory points to the Exif directory that follows it.
        file.extend(1_u16.to_le_bytes());
        file.extend(entry(0x8769, 4, 26));
        file.extend([0; 4]);
        file.extend((tags.len() as u16).to_le_bytes());
        let data = 26 + 2 + 12 * tags.len() as u32 + 4;
        for (k, (tag, _)) in tags.iter().enumerate() {
            // ShutterSpeedValue is signed.
            file.extend(entry(*tag, if *tag == 0x9201 { 10 } else { 5 }, data + 8 * k as u32));
        }
        file.extend([0; 4]);
        tags.iter().for_each(|(_, v)| v.iter().for_each(|v| file.extend(v.to_le_bytes())));
        std::fs::write(path, file).unwrap();
    }

    #[test]
    fn apertures_count_by_their_area() {
        let dir = tempfile::tempdir().unwrap();
        let files: Vec<PathBuf> = ["a.tif", "b.tif", "c.tif"].map(PathBuf::from).to_vec();
        let write = |k: usize, tags: &[(u16, [u32; 2])]| tagged(&dir.path().join(&files[k]), tags);
        write(0, &[(0x829a, [1, 50]), (0x829d, [56, 10])]);
        write(1, &[(0x829a, [1, 50]), (0x829d, [8, 1])]);
        // APEX: 1/64 s, f/4.
        write(2, &[(0x9201, [6, 1]), (0x9202, [4, 1])]);
        let (all, warning) = exposures(dir.path(), &files).unwrap();
        let gains: Vec<f64> = all.iter().map(|t| t.gain.unwrap_or(1.0)).collect();
        assert!((gains[1] - 0.5).abs() < 1e-9 && (gains[2] - 2.0).abs() < 1e-9, "{gains:?}");
        assert_eq!(all[0].seconds, Some(0.02));
        assert_eq!(all[2].seconds, Some(1.0 / 64.0));
        let warning = warning.unwrap();
        assert!(warning.contains("f/5.657") && warning.contains("b.tif"), "{warning}");
        // A file without an aperture.
        write(2, &[(0x829a, [1, 50])]);
        let error = exposures(dir.path(), &files).unwrap_err().to_string();
        assert!(error.contains("c.tif") && error.contains("f-number"), "{error}");
        // A single aperture for all photographs is ignored.
        let (same, warning) = exposures(dir.path(), &files[..1]).unwrap();
        assert_eq!((same[0].gain, warning), (None, None));
    }

    #[test]
    fn rounded_f_numbers_are_thirds_of_stops() {
        for (said, meant) in [(5.6, 32_f64.sqrt()), (3.5, (11.0_f64 / 6.0 * 2_f64.ln()).exp()), (22.0, 512_f64.sqrt())]
        {
            assert!((exact(said) / meant - 1.0).abs() < 1e-9, "{said}");
        }
    }
}
