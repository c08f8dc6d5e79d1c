//! The operation on map files: edited maps, a comparison picture and a report in a new folder.

use super::asset::Maps;
use super::edit::{Options, edit};
use super::picture::before_and_after;
use nacre_base::estimate::Work;
use nacre_base::operation::{Input, Operation, Summary, lines};
use nacre_base::progress::Progress;
use nacre_base::{OutputFolder, Result};
use nacre_image::Palette;
use schemars::JsonSchema;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// Summary of maps.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct About {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Summary of each map, by name.
    pub maps: BTreeMap<&'static str, Held>,
}

/// Summary of one map.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct Held {
    /// Number of unmasked pixels.
    pub known_pixels: usize,
    /// Minimum and maximum value; `None` if all pixels are masked.
    pub range: Option<[f32; 2]>,
}

/// Report of an edit.
#[derive(Clone, Debug, Serialize, JsonSchema)]
#[schemars(rename = "MapReport")]
pub struct Report {
    /// `map`.
    pub method: &'static str,
    /// The edits.
    pub edits: Options,
    /// Colour map of angles in the picture.
    pub palette: Palette,
    /// Maps before the edit.
    pub before: About,
    /// Maps after the edit.
    pub after: About,
    /// Limitations of the result.
    pub warnings: Vec<String>,
}

impl About {
    /// Summarises maps.
    pub fn of(maps: &Maps) -> Self {
        let held = maps.maps.iter().map(|(kind, map)| {
            let values = map.value.iter().filter(|v| v.is_finite());
            let (low, high) = values.fold((f32::MAX, f32::MIN), |(a, b), v| (a.min(*v), b.max(*v)));
            (kind.name(), Held { known_pixels: map.known(), range: (low <= high).then_some([low, high]) })
        });
        Self { width: maps.width, height: maps.height, maps: held.collect() }
    }
}

impl Operation for Options {
    const NAME: &'static str = "map";
    const TITLE: &'static str = "Edited maps of orientation and period";
    const INPUT: Input = Input::Maps;
    type Report = Report;

    fn check(&self, input: &Path) -> Result<Work> {
        let before = Maps::read(input)?;
        self.check(&before)?;
        Ok(self.work(&before))
    }

    /// Writes the maps and `before-after.png`.
    fn run(&self, input: &Path, out: &OutputFolder, progress: &dyn Progress) -> Result<Report> {
        progress.stage("editing", 1);
        let before = Maps::read(input)?;
        progress.check()?;
        let after = edit(&before, self)?;
        progress.check()?;
        after.write(out)?;
        let picture = before_and_after(&before, &after, self.palette, !self.no_scale_bar);
        picture.save_png(&out.path("before-after.png"))?;
        let (edits, palette, warnings) = (self.clone(), self.palette, vec![]);
        let (of_before, of_after) = (About::of(&before), About::of(&after));
        progress.step();
        Ok(Report { method: "map", edits, palette, before: of_before, after: of_after, warnings })
    }
}

impl Summary for Report {
    fn summary(&self) -> String {
        let about = |of: &About| {
            let maps = of.maps.iter().map(|(name, held)| {
                let range = held.range.map_or(String::new(), |[low, high]| format!(" {low:.3} to {high:.3}"));
                format!("{name}{range}")
            });
            format!("{} × {} pixels, {}", of.width, of.height, maps.collect::<Vec<_>>().join(", "))
        };
        let text = format!("before    {}\nafter     {}\n", about(&self.before), about(&self.after));
        (text + &lines(&[], &self.warnings)).trim_end().to_owned()
    }

    fn warnings(&self) -> &[String] {
        &self.warnings
    }
}
