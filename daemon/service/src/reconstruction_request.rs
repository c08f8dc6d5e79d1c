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

/// What to reconstruct.
#[derive(Debug, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Request {
    /// Name of the reconstruction, at most 200 characters. Default: its result and the name of its input.
    #[schema(max_length = 200)]
    name: Option<String>,
    /// A session.
    pub session: Option<String>,
    /// Or uploaded photographs.
    pub upload: Option<String>,
    /// Of `lut`: photographs of the mirror image of a light that is no point, uploaded by themselves; the table is spread with it.
    pub light: Option<LightUpload>,
    /// Name of an operation (default: polarization); `/api/v1/operations` lists them.
    #[schema(value_type = Option<String>, example = "polarization")]
    pub method: Option<Method>,
    /// Options of the operation; those that are left out have their defaults. `/api/v1/operations` has their schemas. What follows are options of
    /// polarization, which may also stand here.
    #[schema(value_type = Option<Object>)]
    options: Option<Map<String, Value>>,
    /// `plain` (Stokes, angle and degree of linear polarization), or a model of gratings: `auto`, `sinusoid`, `prenormalized`, `circle` or
    /// `curve`. Default: `auto` for sessions, `plain` for uploads.
    model: Option<String>,
    /// Whether what oblique incidence does to polarization is taken out: `off` (the default), or `auto`, where the photographs say
    /// where the camera stood and the points are likelier then.
    #[schema(value_type = Option<String>, example = "off")]
    oblique: Option<Oblique>,
    /// Whether photographs that are shifted against each other are moved back: `auto`, where that is worth it (the default of models of
    /// gratings), or `off` (the default of the model plain).
    #[schema(value_type = Option<String>, example = "auto")]
    align: Option<Align>,
    /// Maps of a monochrome polarization sensor in full size: how images behind each polarizer are interpolated, `bilinear` or `edge-aware`
    /// (model plain). Default: `none`, one pixel per super-pixel.
    #[schema(value_type = Option<String>, example = "none")]
    demosaic: Option<Demosaic>,
    /// Added to every orientation.
    offset_deg: Option<f64>,
    /// Smoothing of orientations in pictures and in the map `smoothed`: `none`, `light` (default), `strong` or a number of rounds.
    #[schema(value_type = Option<String>, example = "light")]
    smooth: Option<Smoothing>,
    /// Smooth the map itself and its σ as well.
    smooth_maps: Option<bool>,
    /// Also make the map `smoothed`: the smoothed orientations at full size (default: false).
    smoothed_exr: Option<bool>,
    /// Makes a map of periods: `{"from": "brightness", "range_um": [0.7, 2.0]}` (heuristic), or `{"from": "contrast",
    /// "range_um": [1.2, 3.0], "depth_um": 0.1, "metal": "aluminium", "index_above": 1, "wavelength_nm": 560}` (for an assumed
    /// surface; the last three can be left out).
    #[schema(value_type = Option<Object>)]
    period: Option<PeriodMethod>,
    /// Colours of angles in pictures: `cyclic` (the default) or `hsv`. Of `spots`, `flash` and `map` it is one of the options.
    #[schema(value_type = Option<String>, example = "cyclic")]
    palette: Option<Palette>,
    /// Leave the scale bar out of pictures (default: false). They have one where the pixel size on the sample is known.
    no_scale_bar: Option<bool>,
}

impl Request {
    /// The job that it asks for, still without a name.
    ///
    /// # Errors
    /// `bad-request` where it names no input, two of them, or something that is no id.
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
            id: String::new(),
            name: asked(self.name)?,
            operation,
            options,
            session: self.session,
            upload: self.upload,
            light: self.light,
        })
    }

    /// Options of polarization that stand beside the method.
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

/// Refuses a request that names no input or two, and texts that are not ids.
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
