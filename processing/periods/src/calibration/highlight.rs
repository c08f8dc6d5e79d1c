//! Detection of the light's mirror image in a photograph.

use nacre_base::{Error, Result};
use nacre_image::Gray;
use nacre_image::lobe;
use nacre_image::{Depth, info};
use std::path::Path;

/// Detected mirror image of the light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// Position in pixels from the left and the top.
    pub pixel: [f64; 2],
    /// Standard deviation of either coordinate.
    pub sigma_px: f64,
}

/// Finds the light's mirror image: the brightest lobe of a photograph. If its centre is saturated, the flanks determine
/// its position.
///
/// # Errors
/// `Input` for a file that is no photograph, and for photographs without a lobe or with two lobes of similar
/// brightness.
pub fn find_highlight(path: &Path) -> Result<Found> {
    let remedy = "give a photograph in which the light's mirror image is the only bright thing, or its place in pixels: --highlight X,Y";
    let white = match info(path)?.depth {
        Depth::U8 => 255.0,
        Depth::U16 => 65535.0,
        Depth::F32 => f32::INFINITY,
    };
    let gray = Gray::read(path)?;
    let (width, height) = (gray.width, gray.height);
    let light: Vec<f32> = gray.values.iter().map(|v| if *v >= white { f32::NAN } else { *v }).collect();
    let lobe = lobe::find(&light, width, height, None).map_err(|problem| Error::file(path, problem, remedy))?;
    if let Some(([x, y], share)) = lobe.rival(&gray.values, width, height) {
        let percent = 100.0 * share.min(1.0);
        let problem = format!("has another light at {x:.0}, {y:.0}, {percent:.0} % as bright as the brightest");
        return Err(Error::file(path, problem, remedy));
    }
    Ok(Found { pixel: lobe.center, sigma_px: lobe.sigma_px })
}
