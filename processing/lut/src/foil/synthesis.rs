//! The operation `synthesize`: maps of new foil from a measured distribution.

use super::distribution::Distribution;
use super::synthesize::{Dots, Made, Shape, synthesize};
use nacre_base::estimate::Work;
use nacre_base::operation::{Input, Operation, Summary, lines};
use nacre_base::progress::Progress;
use nacre_base::{OutputFolder, Result};
use nacre_image::{Gray, Palette, orientation_picture};
use nacre_maps::Kind;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Shape of a dot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Dot {
    /// Adjacent squares with this side in pixels.
    #[schemars(extend("x-flag" = "square-px", "x-bare" = 3))]
    Square(usize),
    /// Randomly placed discs with this diameter in pixels.
    #[schemars(extend("x-flag" = "disc-px", "x-bare" = 7.5))]
    Disc(f64),
    /// Randomly placed copies of the bright part of a picture.
    #[schemars(extend("x-file" = true, "x-flag" = "mask", "x-placeholder" = "IMAGE"))]
    Mask(PathBuf),
}

/// Draw maps of new foil from a measured distribution of orientations and periods.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "SynthesizeOptions", extend(
    "x-input" = "Results of `nacre reconstruct foil`, or their histogram.exr",
    "x-examples" = "\
Examples:
  nacre synthesize spiral --size 1024x1024 --pixel-um 25 --square-px 3 --out new
  nacre synthesize spiral/histogram.exr --size 800x600 --pixel-um 25 --disc-px 7.5 --seed 2 --out discs
  nacre synthesize spiral --size 800x600 --pixel-um 25 --mask star.png --out stars

Writes orientation.exr and period.exr of dots drawn from the distribution, orientation.png, and report.json with
the distance of the map from the distribution."
))]
pub struct Options {
    /// Width and height of the maps in pixels.
    #[schemars(extend("x-placeholder" = "WxH"))]
    pub size: [usize; 2],
    /// Size of a pixel in µm.
    pub pixel_um: f64,
    /// Shape of the dots.
    #[schemars(extend("x-expand" = true))]
    pub dot: Dot,
    /// Seed of the random numbers; the same seed gives the same maps.
    #[serde(default = "one")]
    pub seed: u64,
    /// Colour map of angles in the picture: cyclic (even steps, also for colour-blind readers) or hsv.
    #[serde(default)]
    #[schemars(extend("x-advanced" = true))]
    pub palette: Palette,
    /// Leave the scale bar out of the picture.
    #[serde(default)]
    #[schemars(extend("x-advanced" = true))]
    pub no_scale_bar: bool,
}

fn one() -> u64 {
    1
}

/// Report of synthesized maps.
#[derive(Clone, Debug, Serialize, JsonSchema)]
#[schemars(rename = "SynthesizeReport")]
pub struct SynthesisReport {
    #[serde(flatten)]
    made: Made,
    /// Colour map of the picture.
    palette: Palette,
}

impl Operation for Options {
    const NAME: &'static str = "synthesize";
    const TITLE: &'static str = "Maps of new foil, drawn from a measured distribution of random dots";
    const INPUT: Input = Input::Files;
    type Report = SynthesisReport;

    fn check(&self, input: &Path) -> Result<Work> {
        Distribution::read(&histogram_in(input))?;
        self.dots()?.work()
    }

    fn run(&self, input: &Path, out: &OutputFolder, progress: &dyn Progress) -> Result<SynthesisReport> {
        let from = Distribution::read(&histogram_in(input))?;
        progress.stage("drawing dots", 1);
        let made = synthesize(&from, &self.dots()?)?;
        progress.check()?;
        made.maps.write(out)?;
        if let Some(map) = made.maps.maps.get(&Kind::Orientation) {
            let bar_um = (!self.no_scale_bar).then_some(self.pixel_um);
            let width = made.maps.width;
            let value = |x: usize, y: usize| Some(map.value[y * width + x]);
            let title = "Orientation of the dots";
            let picture = orientation_picture([width, made.maps.height], &value, title, self.palette, bar_um);
            picture.save_png(&out.path("orientation.png"))?;
        }
        Ok(SynthesisReport { made: made.report, palette: self.palette })
    }
}

fn histogram_in(input: &Path) -> PathBuf {
    if input.is_dir() { input.join("histogram.exr") } else { input.to_owned() }
}

impl Options {
    fn dots(&self) -> Result<Dots> {
        let shape = match &self.dot {
            Dot::Square(side) => Shape::Square(*side),
            Dot::Disc(diameter) => Shape::Disc(*diameter),
            Dot::Mask(path) => {
                let picture = Gray::read(path)?;
                let (low, high) = picture.values.iter().fold((f32::MAX, f32::MIN), |(a, b), v| (a.min(*v), b.max(*v)));
                let lit = picture.values.iter().map(|v| low < high && *v > 0.5 * (low + high)).collect();
                Shape::Mask(picture.width, lit)
            }
        };
        Ok(Dots { size: self.size, pixel_um: self.pixel_um, shape, seed: self.seed })
    }
}

impl Summary for SynthesisReport {
    fn summary(&self) -> String {
        let made = &self.made;
        let [orientation, period] = made.total_variation.map(|v| 100.0 * v);
        let [wanted_orientation, wanted_period] = made.expected.map(|v| 100.0 * v);
        let text = format!(
            "dots      {}; {:.1} % of the map is bare\noff       {orientation:.2} % in orientation, {period:.2} % in period (total \
             variation; {wanted_orientation:.2} and {wanted_period:.2} expected)\n{}",
            made.dots,
            100.0 * made.bare,
            lines(&[], &made.warnings)
        );
        text.trim_end().to_owned()
    }

    fn warnings(&self) -> &[String] {
        &self.made.warnings
    }
}
