//! Edits of maps, in one fixed order.

use super::asset::{Kind, MOST_PIXELS, Map, Maps};
use super::curve::Curve;
use super::layout::{Layout, wrapped};
use nacre_base::estimate::Work;
use nacre_base::{Error, Result};
use nacre_image::budget::Operation;
use nacre_image::{Depth, Info, Palette};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Edit maps of orientation and period, in the order of these options.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(extend(
    "x-input" = "Folder with orientation.exr, period.exr or both, or one of the files",
    "x-examples" = "\
Examples:
  nacre map edit result --period quadratic=0.8,1.6 --out blend
  nacre map edit result --period sine-squared=0.8,1.6 --out waves
  nacre map edit result --rotate-deg 30 --tile 4x3 --layout mirror --out wrap
  nacre map edit result --scale 1.05 --offset-um -0.02 --clamp-um 0.7:2 --out corrected

Edits are done in the order of the options above. Writes orientation.exr, period.exr (those that there are), before-after.png and
report.json."
))]
#[schemars(rename = "MapOptions")]
pub struct Options {
    /// Rotation of image and orientations in degrees, anticlockwise; multiples of 90 are exact.
    #[schemars(extend("x-aliases" = ["rotate"]))]
    pub rotate_deg: Option<f64>,
    /// Scale factor of the number of pixels along each axis.
    #[schemars(extend("x-advanced" = true))]
    pub resample: Option<f64>,
    /// Number of copies along a row and a column.
    #[schemars(extend("x-placeholder" = "NxM"))]
    pub tile: Option<[usize; 2]>,
    /// Width and height in pixels; crops, or fills with further copies.
    #[schemars(extend("x-placeholder" = "WxH"))]
    pub size: Option<[usize; 2]>,
    /// Arrangement of copies.
    pub layout: Layout,
    /// Rotation of orientations alone in degrees, anticlockwise.
    #[schemars(extend("x-aliases" = ["orientation-offset"]))]
    pub orientation_offset_deg: Option<f64>,
    /// Periods as a function of orientation: from the first at 0° to the second at 180° in µm, or rows of
    /// orientation_deg,period_um. Replaces existing periods.
    #[schemars(extend("x-table" = "table", "x-placeholder" = "quadratic=MIN,MAX|sine-squared=MIN,MAX|FILE.csv"))]
    pub period: Option<Curve>,
    /// Scale factor of periods.
    pub scale: Option<f64>,
    /// Offset of periods in µm.
    pub offset_um: Option<f64>,
    /// Minimum and maximum period in µm; other values are clamped.
    #[schemars(extend("x-advanced" = true, "x-placeholder" = "MIN:MAX", "x-aliases" = ["clamp"]))]
    pub clamp_um: Option<[f64; 2]>,
    /// Colour map of angles in the picture: cyclic (even steps, also for colour-blind readers) or hsv.
    #[serde(skip_serializing)]
    #[schemars(extend("x-advanced" = true))]
    pub palette: Palette,
    /// Leave the scale bar out of the picture. It has one where the maps have `pixel_um`.
    #[serde(skip_serializing)]
    #[schemars(extend("x-advanced" = true))]
    pub no_scale_bar: bool,
}

/// Applies the edits.
///
/// # Errors
/// `Input` for invalid edits, and for edits of a missing map.
pub fn edit(maps: &Maps, edits: &Options) -> Result<Maps> {
    edits.check(maps)?;
    let mut new = maps.clone();
    if let Some(deg) = edits.rotate_deg {
        new = new.rotated(deg)?;
    }
    if let Some(factor) = edits.resample {
        new = new.resampled(factor)?;
    }
    if let Some(copies) = edits.tile {
        let size = [new.width.saturating_mul(copies[0]), new.height.saturating_mul(copies[1])];
        new = new.laid_out(size, edits.layout)?;
    }
    if let Some(size) = edits.size {
        new = new.laid_out(size, edits.layout)?;
    }
    if let (Some(deg), Some(map)) = (edits.orientation_offset_deg, new.maps.get_mut(&Kind::Orientation)) {
        let turn = deg.to_radians();
        map.value.iter_mut().filter(|v| v.is_finite()).for_each(|v| *v = wrapped(f64::from(*v) + turn));
    }
    if let (Some(curve), Some(orientation)) = (&edits.period, new.maps.get(&Kind::Orientation)) {
        let period = of_curve(orientation, curve);
        new.maps.insert(Kind::Period, period);
    }
    if let Some(map) = new.maps.get_mut(&Kind::Period) {
        rescale(map, edits);
    }
    Ok(new)
}

impl Options {
    /// Predicted time, memory and disk space, from the largest intermediate map.
    pub fn work(&self, maps: &Maps) -> Work {
        let factor = self.resample.unwrap_or(1.0);
        let resampled = [maps.width, maps.height].map(|n| (n as f64 * factor).ceil().max(1.0) as usize);
        let tile = self.tile.unwrap_or([1, 1]);
        let tiled = [0, 1].map(|side| resampled[side].saturating_mul(tile[side]));
        let sizes = [[maps.width, maps.height], resampled, tiled, self.size.unwrap_or(tiled)];
        // Larger maps are rejected by the edit itself.
        let allowed = sizes.into_iter().filter(|[w, h]| w.saturating_mul(*h) <= MOST_PIXELS);
        let [width, height] = allowed.max_by_key(|[w, h]| w * h).unwrap_or_default();
        let info = Info { width, height, channels: 3, depth: Depth::F32 };
        Operation::Maps(maps.maps.len() + usize::from(self.period.is_some())).work(info)
    }

    /// Rejects invalid edits, and edits of a missing map.
    ///
    /// # Errors
    /// `Input`, naming the edit.
    pub fn check(&self, maps: &Maps) -> Result<()> {
        if let Some(curve) = &self.period {
            curve.clone().checked()?;
        }
        let bad = |what: &str, problem: String, remedy: &str| Err(Error::input(what, problem, remedy));
        let drawn = Options { palette: self.palette, no_scale_bar: self.no_scale_bar, ..Options::default() };
        if *self == (Options { layout: self.layout, ..drawn }) {
            return bad("edit", "changes nothing".into(), "say what to do; see --help");
        }
        let orientation = maps.maps.contains_key(&Kind::Orientation);
        if !orientation && (self.period.is_some() || self.orientation_offset_deg.is_some()) {
            return bad("orientation", "is not among the maps".into(), "give a folder with orientation.exr");
        }
        let scaled = self.scale.is_some() || self.offset_um.is_some() || self.clamp_um.is_some();
        if scaled && self.period.is_none() && !maps.maps.contains_key(&Kind::Period) {
            return bad(
                "period",
                "is not among the maps".into(),
                "give a folder with period.exr, or a curve (--period)",
            );
        }
        if let Some(copies) = self.tile.filter(|c| !c.iter().all(|n| (1..=10_000).contains(n))) {
            return bad("tile", format!("is {copies:?}"), "give 1 to 10000 copies along each side");
        }
        match self.orientation_offset_deg {
            Some(deg) if deg.is_nan() || deg.abs() > 1e6 => {
                return bad("orientation offset", format!("is {deg}"), "give degrees");
            }
            _ => {}
        }
        match self.scale {
            Some(f) if !(1e-6..=1e6).contains(&f) => {
                return bad("scale", format!("is {f}"), "give 0.000001 to 1000000");
            }
            _ => {}
        }
        match self.offset_um {
            Some(um) if um.is_nan() || um.abs() > 1e4 => {
                return bad("offset", format!("is {um}"), "give at most 10000 µm");
            }
            _ => {}
        }
        match self.clamp_um {
            Some([a, b]) if !(a > 0.0 && a <= b && b <= 1e4) => {
                bad("clamp", format!("is {a} to {b}"), "give the least and the most, above 0 and at most 10000 µm")
            }
            _ => Ok(()),
        }
    }
}

/// Periods from orientations. σ follows from the curve's slope; pixels without orientation or outside of the curve are
/// masked.
fn of_curve(orientation: &Map, curve: &Curve) -> Map {
    let count = orientation.value.len();
    let mut map = Map {
        value: vec![f32::NAN; count],
        sigma: vec![f32::NAN; count],
        mask: vec![0.0; count],
        more: Default::default(),
        attributes: orientation.attributes.clone(),
    };
    map.attributes.insert("units".into(), "µm".into());
    map.attributes.insert("made".into(), "designed: a function of the orientation, not measured".into());
    for i in (0..count).filter(|i| orientation.mask[*i] > 0.0) {
        if let Some([um, slope]) = curve.at(f64::from(orientation.value[i])) {
            map.value[i] = um as f32;
            map.sigma[i] = (slope.abs() * f64::from(orientation.sigma[i])) as f32;
            map.mask[i] = 1.0;
        }
    }
    map
}

/// Scales, shifts and clamps periods; results of 0 or less are masked.
fn rescale(map: &mut Map, edits: &Options) {
    if edits.scale.is_none() && edits.offset_um.is_none() && edits.clamp_um.is_none() {
        return;
    }
    let (scale, offset) = (edits.scale.unwrap_or(1.0), edits.offset_um.unwrap_or(0.0));
    let [low, high] = edits.clamp_um.unwrap_or([f64::MIN_POSITIVE, f64::MAX]);
    for i in 0..map.value.len() {
        if map.mask[i] == 0.0 {
            continue;
        }
        let um = f64::from(map.value[i]) * scale + offset;
        map.sigma[i] = (f64::from(map.sigma[i]) * scale) as f32;
        if um <= 0.0 && edits.clamp_um.is_none() {
            map.hide(i);
        } else {
            map.value[i] = um.clamp(low, high) as f32;
        }
    }
    map.attributes.insert("made".into(), "edited: not as measured".into());
}
