//! A series photographed on the simulated bench and reconstructed from files to files, as a user would.

use crate::shots::{metered, photograph};
use nacre_base::progress::Silent;
use nacre_base::{Error, Result};
use nacre_image::read_exr;
use nacre_polarimetry::{Options, reconstruct};
use nacre_sim::{Bench, BenchConfig};
use nacre_studies::Outcome;
use nacre_studies::polarimetry::judge;
use std::time::Instant;

/// Simulates the photographs in a temporary folder, reconstructs and evaluates the orientation map. The time is that of
/// the reconstruction, file access included.
pub(super) fn outcome(config: &BenchConfig, options: &Options) -> Result<Outcome> {
    let folder = tempfile::tempdir().map_err(|e| Error::output(&std::env::temp_dir(), e))?;
    let bench = Bench::new(config, &Silent)?;
    let (input, out) = (folder.path(), folder.path().join("result"));
    // A wedge shifts the image without changing its brightness, so the bench without wedge is rendered only once.
    let mut straight = config.clone();
    (straight.analyser.wedge_px, straight.analyser.jitter_px) = (0.0, 0.0);
    let exposure_s = metered(Bench::new(&straight, &Silent)?);
    let truth = photograph(bench, exposure_s, input)?;
    let begun = Instant::now();
    reconstruct(input, &out, options, &Silent)?;
    let seconds = begun.elapsed().as_secs_f64();
    let path = out.join("orientation.exr");
    let mut map = read_exr(&path)?;
    let (orientation, sigma) = (map.take("orientation", &path)?, map.take("sigma", &path)?);
    // Pixels without a grating have no true orientation and are excluded.
    let known: Vec<usize> = (0..truth.len()).filter(|i| truth[*i].is_finite()).collect();
    let of = |plane: &[f32]| -> Vec<f32> { known.iter().map(|i| plane[*i]).collect() };
    Ok(judge(&of(&orientation), &of(&sigma), &of(&truth), seconds))
}
