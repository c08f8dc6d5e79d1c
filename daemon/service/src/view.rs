//! Results as data of the viewer: `/api/v1/reconstructions/{id}/view`.

use super::problem::{Answer, Problem};
use super::{App, At, Params, files, maps};
use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use nacre_base::Version;
use nacre_base::progress::Silent;
use nacre_brdf::Reflectance;
use nacre_brdf::height::Profile;
use nacre_optics::color::{Illuminant, Observer};
use nacre_render::gpu::Prepared;
use nacre_render::{
    Base, Blend, Camera, Color, Coverage, Diffraction, Light, Material, Relief, Scene, Shape, Spectrum, Turn,
};
use serde::Deserialize;
use std::path::Path;
use std::sync::Arc;
use utoipa::{IntoParams, ToSchema};

/// Longest side of a map in pixels, a texture size that every browser supports.
const MOST: usize = 2048;

/// Longer side of the sample in mm if the request does not give it; results do not contain it.
const SIDE_MM: f64 = 100.0;

/// Half the field of view in degrees around a sample of [`SIDE_MM`].
const FOV_DEG: f64 = 7.0;

/// Smallest error of the sums over orders and wavelengths.
const ERROR: f64 = 1e-3;

/// Longest state of a view in characters.
const STATE: usize = 1000;

/// Assumed surface and illumination of the sample.
#[derive(Debug, Default, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct Look {
    /// Peak-to-peak depth of the grating in µm (default 0.1).
    #[param(minimum = 0, maximum = 5)]
    depth_um: Option<f64>,
    /// Period of the grating in µm, where no map gives it (default 1).
    #[param(minimum = 0.05, maximum = 200)]
    period_um: Option<f64>,
    /// Cross-section of the grooves (default `sinusoid`).
    #[param(inline)]
    profile: Option<Section>,
    /// Reflectance: `perfect`, `schlick=R0`, or a metal (default `aluminium`).
    #[param(example = "aluminium")]
    reflectance: Option<String>,
    /// Name of the spectrum of the light (default `D65`).
    #[param(example = "D65")]
    spectrum: Option<String>,
    /// Standard deviation of the light's size in mm (default 10).
    #[param(minimum = 0, maximum = 100)]
    light_sigma_mm: Option<f64>,
    /// Longer side of the sample in mm (default 100).
    #[param(minimum = 10, maximum = 500)]
    side_mm: Option<f64>,
    /// Query string of a view link, which the exported file opens with.
    #[param(max_length = 1000)]
    state: Option<String>,
}

/// Cross-section by name.
#[derive(Clone, Copy, Debug, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Section {
    /// Sinusoidal grooves.
    Sinusoid,
    /// Sawtooth grooves.
    Blazed,
    /// Ridges as wide as the grooves.
    Rectangular,
}

/// A result as uniforms and textures of the viewer's shaders.
///
/// Format: length of the header (32 bits, little-endian), header (JSON), and 32-bit floats. Results with an
/// orientation map or a lookup table have a view.
#[utoipa::path(get, path = "/api/v1/reconstructions/{id}/view", tag = "reconstructions", operation_id = "view",
    params(("id" = String, Path), Look),
    responses((status = 200, content(([u8] = "application/octet-stream"))),
        (status = 400, body = Problem), (status = 404, body = Problem)))]
pub async fn view(State(app): State<Arc<App>>, At(id): At<String>, Params(look): Params<Look>) -> Answer<Response> {
    let folder = app.place(&id).await?.results;
    let bytes = app.heavy.answer_alone(move || bytes(&folder, &look)).await?;
    Ok(([(header::CONTENT_TYPE, files::BYTES)], bytes).into_response())
}

/// The view and the viewer as one HTML file that opens from disk.
#[utoipa::path(get, path = "/api/v1/reconstructions/{id}/view.html", tag = "reconstructions", operation_id = "view_file",
    params(("id" = String, Path), Look),
    responses((status = 200, content((String = "text/html"))), (status = 400, body = Problem), (status = 404, body = Problem)))]
pub async fn file(State(app): State<Arc<App>>, At(id): At<String>, Params(look): Params<Look>) -> Answer<Response> {
    let folder = app.place(&id).await?.results;
    let name = format!("attachment; filename=\"{id}-view.html\"");
    let page = app.heavy.answer_alone(move || page(&id, &folder, &look)).await?;
    let headers = [(header::CONTENT_TYPE, "text/html; charset=utf-8".to_owned()), (header::CONTENT_DISPOSITION, name)];
    Ok((headers, page).into_response())
}

/// A result folder as one HTML file that opens from disk.
///
/// # Errors
/// Results that the viewer does not support.
pub fn page(title: &str, folder: &Path, look: &Look) -> Answer<Vec<u8>> {
    let bytes = bytes(folder, look)?;
    let state = look.state.as_deref().unwrap_or_default();
    nacre_web::standalone(title, &bytes, state).map_err(|e| Problem::bad(e.to_string()))
}

fn bytes(folder: &Path, look: &Look) -> Answer<Vec<u8>> {
    check(look)?;
    let scene = scene(folder, look)?;
    Ok(Prepared::new(&scene, folder, ERROR, MOST, &Silent)?.bytes())
}

/// Checks that numbers are in the ranges of the OpenAPI document.
fn check(look: &Look) -> Answer<()> {
    if look.state.as_ref().is_some_and(|state| state.chars().count() > STATE) {
        return Err(Problem::bad(format!("state is longer than {STATE} characters")));
    }
    let ranges = [
        ("depth_um", look.depth_um, 0.0..=5.0),
        ("period_um", look.period_um, 0.05..=200.0),
        ("light_sigma_mm", look.light_sigma_mm, 0.0..=100.0),
        ("side_mm", look.side_mm, 10.0..=500.0),
    ];
    for (name, value, range) in ranges {
        if let Some(value) = value.filter(|v| !range.contains(v)) {
            return Err(Problem::bad(format!("{name} is {value}, not {} to {}", range.start(), range.end())));
        }
    }
    Ok(())
}

/// A result as a scene: a plane of its aspect ratio under a point light.
fn scene(folder: &Path, look: &Look) -> Answer<Scene> {
    let longer = look.side_mm.unwrap_or(SIDE_MM);
    let (diffraction, size) = match files::inside(folder, "orientation.exr") {
        Ok(_) => {
            let (values, columns) = maps::plane(folder, "orientation")?;
            let [width, height] = [columns, values.len() / columns.max(1)].map(|n| n as f64);
            let side = longer / width.max(height);
            (grating(folder, look)?, [width * side, height * side])
        }
        Err(_) => {
            files::inside(folder, "lut.exr").map_err(|_| Problem::not_found("orientation or table in this result"))?;
            (Diffraction::Table { file: "lut.exr".into(), albedo: 1.0, lossless: false, factors: None }, [longer; 2])
        }
    };
    let spectrum = look.spectrum.as_deref().unwrap_or("D65");
    if Illuminant::named(spectrum).is_none() {
        return Err(Problem::bad(format!(
            "spectrum {spectrum:?} is none of E, A, A-inverse, D65, FL1 to FL12, LED-B1, LED-B3"
        )));
    }
    let camera = Camera {
        position: [0.0, 0.0, 500.0],
        target: [0.0; 3],
        up: [0.0, 1.0, 0.0],
        // The sample fills the picture, whatever its size.
        fov_deg: 2.0 * (FOV_DEG.to_radians().tan() * longer / SIDE_MM).atan().to_degrees(),
        width: 512,
        height: 512,
        aperture_mm: 0.0,
        focus_mm: None,
    };
    let light = Light::Point {
        position: [0.0, 260.0, 420.0],
        illuminance: 1.0,
        sigma_mm: look.light_sigma_mm.unwrap_or(10.0),
        spectrum: Spectrum::Named(spectrum.into()),
    };
    let material = Material {
        base: Some(Base { albedo: Color::Rgb([0.02; 3]), ..Base::default() }),
        diffraction: Some(diffraction),
        coverage: Coverage::Number(0.97),
        blend: Blend::Mix,
        normals: None,
    };
    let shape = Shape::Plane {
        center: [0.0; 3],
        normal: [0.0, 0.0, 1.0],
        up: [0.0, 1.0, 0.0],
        size,
        material: "sample".into(),
    };
    Ok(Scene {
        version: Version,
        camera,
        shape: vec![shape],
        light: vec![light],
        material: [("sample".to_owned(), material)].into(),
        turn: Turn::default(),
        observer: Observer::default(),
        exposure: None,
        hints: vec![],
    })
}

/// Whether the report marks the periods as heuristic: an ordering without scale.
fn heuristic(folder: &Path) -> bool {
    let report = files::report(folder).unwrap_or_default();
    let report: serde_json::Value = serde_json::from_slice(&report).unwrap_or_default();
    report["period"]["heuristic"] == true
}

/// The maps as a grating. Heuristic periods have no scale, so they are replaced by an assumed period.
fn grating(folder: &Path, look: &Look) -> Answer<Diffraction> {
    let periods = files::inside(folder, "period.exr").is_ok() && look.period_um.is_none() && !heuristic(folder);
    let reflectance: Reflectance =
        look.reflectance.as_deref().unwrap_or("aluminium").parse().map_err(|e: String| Problem::bad(e))?;
    let profile = match look.profile.unwrap_or(Section::Sinusoid) {
        Section::Sinusoid => Profile::Sinusoid,
        Section::Blazed => Profile::Blazed,
        Section::Rectangular => Profile::Rectangular { duty: 0.5 },
    };
    Ok(Diffraction::Grating {
        relief: Relief { profile, depth_um: look.depth_um.unwrap_or(0.1) },
        period_um: (!periods).then(|| look.period_um.unwrap_or(1.0)),
        orientation_deg: None,
        maps: Some(if periods { "." } else { "orientation.exr" }.into()),
        repeat: [1.0; 2],
        coherence_um: 65.0,
        reflectance,
    })
}
