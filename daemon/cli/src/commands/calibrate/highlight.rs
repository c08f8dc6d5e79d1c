//! `--highlight`: position of the light's mirror image, or a photograph of it.

use crate::commands::values::numbers;
use nacre_base::{Error, Result};
use nacre_periods::calibration::{Highlight, find_highlight};
use std::path::PathBuf;

/// Highlight as given on the command line.
#[derive(Clone, Debug)]
pub enum Given {
    /// Pixel position.
    At(Highlight),
    /// Photograph of a mirror with known height and tilt; the highlight is detected in it.
    In(PathBuf, Highlight),
}

/// `X,Y[,Z[,TX,TY]]`, or `PHOTO[,Z[,TX,TY]]`.
pub fn parse(text: &str) -> std::result::Result<Given, String> {
    let wanted = "X,Y in pixels, or a photograph; then the mirror's height Z, and its tilt TX,TY";
    if let Some(at) = places(text) {
        return Ok(Given::At(at));
    }
    // File names may contain commas, so the longest numeric tail that parses is taken as Z or Z,TX,TY.
    let splits = text.match_indices(',').map(|(i, _)| i);
    let named = splits.filter_map(|i| Some((&text[..i], mirror(&text[i + 1..])?))).next();
    let (path, mirror) = named.unwrap_or((text, Highlight { pixel: [0.0; 2], height_mm: 0.0, tilt_deg: [0.0; 2] }));
    if path.is_empty() || path.split(',').all(|part| part.trim().parse::<f64>().is_ok()) {
        return Err(wanted.into());
    }
    Ok(Given::In(path.into(), mirror))
}

fn places(text: &str) -> Option<Highlight> {
    let [x, y] = numbers::<f64, 2>(text.splitn(3, ',').take(2).collect::<Vec<_>>().join(",").as_str(), "").ok()?;
    let rest = text.splitn(3, ',').nth(2);
    let mirror = rest.map_or(Some(Highlight { pixel: [0.0; 2], height_mm: 0.0, tilt_deg: [0.0; 2] }), mirror)?;
    Some(Highlight { pixel: [x, y], ..mirror })
}

/// `Z[,TX,TY]`.
fn mirror(text: &str) -> Option<Highlight> {
    let all = numbers::<f64, 3>(text, "").or_else(|_| numbers::<f64, 1>(text, "").map(|[z]| [z, 0.0, 0.0]));
    all.ok().map(|[z, tx, ty]| Highlight { pixel: [0.0; 2], height_mm: z, tilt_deg: [tx, ty] })
}

/// Pixel positions of all highlights, and their standard deviation in pixels: `sigma_px`, or that of a detected
/// highlight if larger.
///
/// # Errors
/// `Input` for photographs without a highlight.
pub fn found(given: &[Given], sigma_px: f64) -> Result<(Vec<Highlight>, f64)> {
    let mut sigma = sigma_px;
    let mut all = Vec::with_capacity(given.len());
    for one in given {
        all.push(match one {
            Given::At(highlight) => *highlight,
            Given::In(path, mirror) => {
                let found = find_highlight(path)?;
                sigma = sigma.max(found.sigma_px);
                Highlight { pixel: found.pixel, ..*mirror }
            }
        });
    }
    if !sigma.is_finite() {
        return Err(Error::input("highlight", "is not sharp enough to be placed", "give its place in pixels"));
    }
    Ok((all, sigma))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_and_photographs_are_told_apart() {
        let Given::At(at) = parse("330.5,250,40,0.1,-0.2").unwrap() else { panic!("no place") };
        assert_eq!((at.pixel, at.height_mm, at.tilt_deg), ([330.5, 250.0], 40.0, [0.1, -0.2]));
        for (text, path, height) in
            [("a b.png", "a b.png", 0.0), ("x,1.png,40", "x,1.png", 40.0), ("m.jpg,-3,1,2", "m.jpg", -3.0)]
        {
            let Given::In(found, mirror) = parse(text).unwrap() else { panic!("{text}") };
            assert_eq!((found, mirror.height_mm), (path.into(), height), "{text}");
        }
        for wrong in ["", "1", "1,2,3,4", "1,2,3,4,5,6", ",3"] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }
}
