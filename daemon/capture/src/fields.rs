//! Names of options in requests and plans. Messages of the processing crates name command-line flags.

/// Flags whose field differs from the flag with `_` for `-`.
const FIELDS: [(&str, &str); 13] = [
    ("clamp", "clamp_um"),
    ("distance-m", "lens.distance_m"),
    ("f-number", "lens.f_number"),
    ("highlight", "highlights"),
    ("known-depth-um", "known.depth_um"),
    ("known-shape", "known.shape"),
    ("lens-focal-mm", "lens.focal_mm"),
    ("lines", "scale.lines.count"),
    ("lines-per-mm", "scale.lines.per_mm"),
    ("psf-sigma", "psf.sigma"),
    ("rotate", "rotate_deg"),
    ("sample-corners", "sample_corners_px"),
    ("wavelength", "wavelength_nm"),
];

/// Replaces flags in a message by fields: `give --size-mm` becomes `give size_mm`. Commands in backticks are unchanged.
pub fn fields(message: &str) -> String {
    let outside = |(k, part): (usize, &str)| match k % 2 {
        0 => part.split_inclusive(' ').map(|word| renamed(word).unwrap_or_else(|| word.to_owned())).collect(),
        _ => format!("`{part}`"),
    };
    message.split('`').enumerate().map(outside).collect()
}

/// Field for a word that is a flag, with the surrounding punctuation; `None` for other words.
fn renamed(word: &str) -> Option<String> {
    let (open, rest) = word.split_once("--").filter(|(open, _)| ["", "(", "\""].contains(open))?;
    let end = rest.find(|c: char| !(c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-')).unwrap_or(rest.len());
    let (flag, after) = rest.split_at(end);
    let whole = flag.starts_with(|c: char| c.is_ascii_lowercase()) && !flag.ends_with('-');
    // File names may look like flags.
    let ends = after.trim_end().chars().all(|c| ",;:)\"".contains(c));
    let field = FIELDS.iter().find(|(name, _)| *name == flag).map(|(_, field)| (*field).to_owned());
    (whole && ends).then(|| format!("{open}{}{after}", field.unwrap_or_else(|| flag.replace('-', "_"))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flags_become_fields_and_all_else_stays() {
        for (flags, named) in [
            ("--size-mm: is not known; give it, or --reference-px", "size_mm: is not known; give it, or reference_px"),
            ("say --transfer linear, srgb or gamma=2.2", "say transfer linear, srgb or gamma=2.2"),
            ("--corners-px, --camera-mm: do not go", "corners_px, camera_mm: do not go"),
            ("photo.png: give --wavelength (--channel)", "photo.png: give wavelength_nm (channel)"),
            (
                "run `nacre calibrate geometry --highlight`, or give --center",
                "run `nacre calibrate geometry --highlight`, or give center",
            ),
            ("my --a.png and x--y.png -- both", "my --a.png and x--y.png -- both"),
            ("", ""),
        ] {
            assert_eq!(fields(flags), named);
        }
    }
}
