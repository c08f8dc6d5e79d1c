//! The whole job: edited maps, both side by side, and a report in a new folder.

use super::asset::Maps;
use super::edit::{Edits, edit};
use super::picture::before_and_after;
use nacre_base::Result;
use nacre_base::progress::Progress;
use nacre_image::{OutputFolder, Palette};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// What maps hold.
#[derive(Clone, Debug, Serialize)]
pub struct About {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Each map, by its name.
    pub maps: BTreeMap<&'static str, Held>,
}

/// What one map holds.
#[derive(Clone, Debug, Serialize)]
pub struct Held {
    /// Pixels that have a value.
    pub known_pixels: usize,
    /// Least and most value; none where there is none.
    pub range: Option<[f32; 2]>,
}

/// What was done.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// `map`.
    pub method: &'static str,
    /// The edits.
    pub edits: Edits,
    /// Colours of angles in the picture.
    pub palette: Palette,
    /// Maps before.
    pub before: About,
    /// And after.
    pub after: About,
    /// What was in doubt.
    pub warnings: Vec<String>,
}

impl About {
    /// Of maps.
    pub fn of(maps: &Maps) -> Self {
        let held = maps.maps.iter().map(|(kind, map)| {
            let values = map.value.iter().filter(|v| v.is_finite());
            let (low, high) = values.fold((f32::MAX, f32::MIN), |(a, b), v| (a.min(*v), b.max(*v)));
            (kind.name(), Held { known_pixels: map.known(), range: (low <= high).then_some([low, high]) })
        });
        Self { width: maps.width, height: maps.height, maps: held.collect() }
    }
}

/// Reads the maps that `input` is or holds, edits them, and writes them into the new folder `out` with `before-after.png` and `report.json`.
///
/// # Errors
/// `Input` for what is no map and for edits that make no sense, before anything is written; `Output`; `Cancelled`.
pub fn edit_folder(
    input: &Path,
    out: &Path,
    edits: &Edits,
    overwrite: bool,
    progress: &dyn Progress,
) -> Result<(Maps, Report)> {
    progress.stage("editing", 1);
    let before = Maps::read(input)?;
    progress.check()?;
    edits.check(&before)?;
    progress.expect(&edits.work(&before))?;
    let after = edit(&before, edits)?;
    progress.check()?;
    let folder = OutputFolder::begin(out, overwrite)?;
    after.write(&folder)?;
    before_and_after(&before, &after, edits.palette, !edits.no_scale_bar).save_png(&folder.path("before-after.png"))?;
    let (edits, palette, warnings) = (edits.clone(), edits.palette, vec![]);
    let (of_before, of_after) = (About::of(&before), About::of(&after));
    let report = Report { method: "map", edits, palette, before: of_before, after: of_after, warnings };
    folder.write_json("report.json", &report)?;
    folder.commit()?;
    progress.step();
    Ok((after, report))
}
