//! Random-dot foil: the distribution of grating orientation and period from one photograph, and synthesis of new maps
//! from it (2018 paper, section 4.5).
//!
//! Each pixel of the photograph integrates many dots. Dots with grating vector `k = (cos θ, sin θ)/a` diffract their
//! first order at the half vector `h = ±λ k`. After correction for irradiance and diffraction efficiency, radiance over
//! half vectors is therefore the density `q(k)` of dots over grating vectors, with `q(k) = p(θ, a) a³` for the
//! distribution `p(θ, a)`.

mod compare;
mod distribution;
mod input;
mod measure;
mod output;
mod report;
mod synthesis;
mod synthesize;
#[cfg(test)]
mod tests;

pub use compare::{Marginals, total_variation};
pub use distribution::Distribution;
pub use measure::{Light, Settings, measure};
pub use output::picture;
pub use report::Report;
pub use synthesis::{Dot, Options as SynthesizeOptions, SynthesisReport};
pub use synthesize::{Dots, Made, Shape, Synthesis, synthesize};

use nacre_base::estimate::Work;
use nacre_base::operation::{Operation, perform};
use nacre_base::progress::Progress;
use nacre_base::{Error, OutputFolder, Result};
use nacre_frames::hdr::Source;
use nacre_image::budget;
use nacre_optics::geometry::{self, Geometry};
use std::path::Path;

impl Operation for Settings {
    const NAME: &'static str = "foil";
    const TITLE: &'static str =
        "Distribution of orientations and periods of a foil's random dots, from one photograph under a flash";
    type Report = Report;

    fn check_options(&self) -> Result<()> {
        self.check()
    }

    fn check(&self, input: &Path) -> Result<Work> {
        Self::check(self)?;
        geometry_of(input, self)?;
        Source::check(input, budget::Operation::Foil)
    }

    fn run(&self, input: &Path, out: &OutputFolder, progress: &dyn Progress) -> Result<Report> {
        measure_into(out, input, self, progress)
    }
}

/// The given geometry, or the one beside the photograph.
fn geometry_of(input: &Path, settings: &Settings) -> Result<Geometry> {
    let folder = if input.is_dir() { input } else { input.parent().unwrap_or(input) };
    if let Some(given) = &settings.geometry {
        return Ok(given.clone());
    }
    geometry::beside(folder)?.ok_or_else(|| {
        Error::file(folder, "has no geometry.json", "give one (`nacre calibrate geometry` makes it), or put it there")
    })
}

/// Measures the distribution from a photograph (a file, merged exposures, or a series of exposures to merge first) and
/// writes it into the new folder `out`.
///
/// # Errors
/// `Input` for an invalid photograph, geometry or option, before anything is written; `Output`; `Cancelled`.
pub fn reconstruct(input: &Path, out: &Path, settings: &Settings, progress: &dyn Progress) -> Result<Report> {
    perform(settings, input, out, false, progress)
}

fn measure_into(folder: &OutputFolder, input: &Path, settings: &Settings, progress: &dyn Progress) -> Result<Report> {
    let begun = std::time::Instant::now();
    let geometry = &geometry_of(input, settings)?;
    let (light, of_files) = input::read(input, geometry, progress)?;
    progress.check()?;
    progress.stage("sorting light by orientation and period", 0);
    let (distribution, mut report) = measure(&light, geometry, settings)?;
    report.warnings.splice(0..0, of_files);
    progress.check()?;
    distribution.write(&folder.path("histogram.exr"))?;
    let picture = picture(&distribution, geometry.relative);
    picture.save_png(&folder.path("histogram.png"))?;
    report.seconds = begun.elapsed().as_secs_f64();
    Ok(report)
}
