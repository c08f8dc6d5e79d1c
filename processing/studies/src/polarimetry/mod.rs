//! Studies of polarization imaging (2018 paper, section 5): number of frames, numerical precision, choice of the model,
//! and stress tests of each. Scenes are synthetic series with known truth.

mod demosaic;
mod frames;
mod illumination;
mod maps;
mod metals;
mod models;
mod noise;
mod precision;
mod registration;
mod scene;
mod smooth;
mod stress;
mod subsampling;

use super::{Effort, Picture, Study};
pub use scene::judge;

/// All measured studies, in the order of the page.
pub fn studies(effort: Effort) -> Vec<Study> {
    let mut all = vec![
        frames::study(effort),
        precision::study(effort),
        models::study(effort),
        subsampling::study(effort),
        noise::study(effort),
        illumination::study(effort),
    ];
    all.extend(stress::studies(effort));
    all.extend(demosaic::studies(effort));
    all.extend(smooth::studies(effort));
    all.extend(registration::studies(effort));
    all
}

/// All computed pictures.
pub fn pictures() -> Vec<Picture> {
    vec![maps::picture(), metals::picture()]
}
