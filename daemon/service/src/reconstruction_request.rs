//! The body of `POST /api/v1/reconstructions`.

use super::naming::asked;
use super::problem::{Answer, Problem};
use nacre_base::operation::Input;
use nacre_capture::plan::Method;
use nacre_image::Palette;
use nacre_polarimetry::{Align, Demosaic, Oblique, PeriodMethod, Smoothing};
use nacre_store::jobs::{LightUpload, Spec, polarization_options};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use utoipa::ToSchema;

/// Input, operation and options of a reconstruction.
#[derive(Debug, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Request {
    /// Name of the reconstruction, at most 200 characters. Default: its result and the name of its input.
    #[schema(max_length = 200)]
    name: Option<String>,
    /// Id of a session.
    pub session: Option<String>,
    /// Or the id of an upload.
    pub upload: Option<String>,
    /// For `lut`: an upload with photographs of the mirror image of an extended source, with which the table is
    /// convolved.
    pub light: Option<LightUpload>,
    /// Name of an operation (default: polarization); `/api/v1/operations` lists them.
    #[schema(value_type = Option<String>, example = "polarization")]
    pub method: Option<Method>,
    /// Options of the operation by key; keys left out have their defaults. `/api/v1/operations` has their schemas.
    /// Options of polarization may also stand here, beside `operation`:
    #[schema(value_type = Option<Object>)]
    options: Option<Map<String, Value>>,
    /// `plain` (Stokes parameters, angle and degree of linear polarization), or a grating model: `auto`, `sinusoid`,
    /// `prenormalized`, `circle` or `curve`. Default: `auto` for sessions, `plain` for uploads.
    model: Option<String>,
    /// Correction of oblique incidence: `off` (the default) or `auto`. `auto` corrects if the camera geometry is known
    /// and the corrected points are more likely.
    #[schema(value_type = Option<String>, example = "off")]
    oblique: Option<Oblique>,
    /// Registration of the photographs: `auto` aligns them if a shift is significant (default of grating models),
    /// `off` never does (default of `plain`).
    #[schema(value_type = Option<String>, example = "auto")]
    align: Option<Align>,
    /// Demosaicking of a monochrome polarization sensor to full resolution, for the model `plain`: `bilinear` or
    /// `edge-aware`. Default: `none`, one pixel per super-pixel.
    #[schema(value_type = Option<String>, example = "none")]
    demosaic: Option<Demosaic>,
    /// Offset in degrees that is added to all orientations.
    offset_deg: Option<f64>,
    /// Smoothing of orientations in pictures and in the map `smoothed`: `none`, `light` (default), `strong` or a
    /// number of iterations.
    #[schema(value_type = Option<String>, example = "light")]
    smooth: Option<Smoothing>,
    /// Smooth the orientation map and its σ as well (default: false).
    smooth_maps: Option<bool>,
    /// Also write the map `smoothed`: the smoothed orientations at full resolution (default: false).
    smoothed_exr: Option<bool>,
    /// Map of periods. `{"from": "brightness", "range_um": [0.7, 2.0]}` is heuristic. `{"from": "contrast",
    /// "range_um": [1.2, 3.0], "depth_um": 0.1, "metal": "aluminium", "index_above": 1, "wavelength_nm": 560}` assumes
    /// a surface; the last three keys are optional.
    #[schema(value_type = Option<Object>)]
    period: Option<PeriodMethod>,
    /// Colour map of angles in pictures: `cyclic` (the default) or `hsv`. For `spots`, `flash` and `map` it is one of
    /// the options.
    #[schema(value_type = Option<String>, example = "cyclic")]
    palette: Option<Palette>,
    /// Omit the scale bar in pictures (default: false). Pictures have one if the pixel size on the sample is known.
    no_scale_bar: Option<bool>,
}

impl Request {
    /// The job of this request, still without a name.
    ///
    /// # Errors
    /// `bad-request` if it names no input or two of them, or an invalid id.
    pub fn spec(self) -> Answer<Spec> {
        let (given, operation) = (self.beside(), self.method.unwrap_or_default());
        check_input(operation, [self.session.as_ref(), self.upload.as_ref()], self.light.as_ref())?;
        let first = given.keys().next().cloned();
        let options = match (self.options, first) {
            (None, Some(_)) if operation.is("polarization") => polarization_options(given).map_err(Problem::bad)?,
            (options, None) => options.unwrap_or_default(),
            (_, Some(key)) => {
                let problem = format!("{key} stands beside method for polarization only, and not with options");
                return Err(Problem::bad(problem).remedy(format!("give it as options.{key}")));
            }
        };
        Ok(Spec {
            name: asked(self.name)?,
            operation,
            options,
            session: self.session,
            upload: self.upload,
            light: self.light,
            ..Spec::default()
        })
    }

    /// Options of polarization that stand beside `operation`.
    fn beside(&self) -> Map<String, Value> {
        let mut all = match serde_json::to_value(self) {
            Ok(Value::Object(all)) => all,
            _ => Map::new(),
        };
        all.retain(|key, value| {
            !value.is_null() && !["name", "session", "upload", "light", "method", "options"].contains(&key.as_str())
        });
        all
    }
}

/// Refuses requests with no input or two, and invalid ids.
///
/// # Errors
/// `bad-request`.
pub fn check_input(method: Method, [session, upload]: [Option<&String>; 2], light: Option<&LightUpload>) -> Answer<()> {
    let nothing = session.is_none() && upload.is_none() && method.operation().input() == Input::FilesOrNothing;
    if session.is_some() == upload.is_some() && !nothing {
        return Err(Problem::bad("give either a session or an upload"));
    }
    let light = light.map(|light| &light.upload);
    session.into_iter().chain(upload).chain(light).try_for_each(|id| super::check_id(id).map(drop))
}
