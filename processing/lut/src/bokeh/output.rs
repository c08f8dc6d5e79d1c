//! Maps, pictures and tables of a bokeh photograph.

use super::outcome::Outcome;
use nacre_base::Result;
use nacre_image::{Attribute, OutputFolder, scalar_picture, write_exr};

/// Writes `deconvolved.exr`, `height.exr`, their pictures, `slice.csv`, and `calibration.json` if a calibration was
/// made.
///
/// Pictures have a scale bar if the pixel size is known.
pub(super) fn write(folder: &OutputFolder, outcome: &Outcome, scale_bar: bool) -> Result<()> {
    let map = &outcome.map;
    let height = outcome.height();
    let unit = if outcome.calibration.is_some() { "µm" } else { "relative, 0 to 1" };
    let heights: Vec<f32> = map.values.iter().map(|v| height(f64::from(*v)) as f32).collect();
    let maps = [
        ("deconvolved", "Y", "linear light, white is 1", &map.values, "light"),
        (
            "height",
            "height",
            unit,
            &heights,
            if outcome.calibration.is_some() { "height (µm)" } else { "relative height" },
        ),
    ];
    for (name, channel, units, values, label) in maps {
        let mut attributes = vec![("units", Attribute::Text(units.into()))];
        attributes.extend(outcome.scale.pixel_um.map(|um| ("pixel_um", Attribute::Number(um))));
        let file = format!("{name}.exr");
        write_exr(&folder.path(&file), map.width, map.height, &[channel], &attributes, &|_, y, row| {
            row.copy_from_slice(&values[y * map.width..][..map.width]);
        })?;
        folder.sync(&file)?;
        let [low, high] = super::height::ends(values);
        let value = |x: usize, y: usize| Some(values[y * map.width + x]);
        let (size, range) = ([map.width, map.height], [low as f32, high as f32]);
        let bar_um = outcome.scale.pixel_um.filter(|_| scale_bar);
        let picture = scalar_picture(size, &value, range, label, "Bokeh photograph", bar_um);
        picture.save_png(&folder.path(&format!("{name}.png")))?;
    }
    if let Some(slice) = &outcome.slice {
        let column = if outcome.calibration.is_some() { "height_um" } else { "height_relative" };
        folder.write("slice.csv", slice.csv(outcome.scale.pixel_um, column, &height).as_bytes())?;
    }
    if let Some(calibration) = outcome.calibration.as_ref().filter(|c| c.grating.is_some()) {
        folder.write_json("calibration.json", calibration)?;
    }
    Ok(())
}
