//! Results of a reconstruction: `/api/v1/reconstructions/{id}/maps` and `pixel`.

use super::heavy::{Heavy, Plane};
use super::problem::{Answer, Problem};
use super::reconstructions::Place;
use super::{App, At, Params, blocking, files, map_list, maps, tiles};
use axum::Json;
use axum::extract::State;
use axum::http::{HeaderMap, header};
use axum::response::{IntoResponse, Response};
use nacre_frames::load;
use nacre_image::encode_png8;
use nacre_polarimetry::{AppliedCorrections, Point, probe};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::sync::{Arc, OnceLock};
use utoipa::{IntoParams, ToSchema};

/// Pixels of a map from which pictures of the whole are made from every n-th row and column.
const THINNED: usize = 16 << 20;

/// Region of a map in pixels, and the picture's width.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct Region {
    /// Most pixels per row of the picture.
    #[param(minimum = 1, maximum = 16384)]
    width: Option<usize>,
    #[param(maximum = 65535)]
    x: Option<u16>,
    #[param(maximum = 65535)]
    y: Option<u16>,
    #[param(maximum = 65535)]
    w: Option<u16>,
    #[param(maximum = 65535)]
    h: Option<u16>,
}

/// A file of a result.
#[derive(Debug, Serialize, ToSchema)]
pub struct ResultFile {
    /// Name of the file.
    name: String,
    /// Size in bytes.
    bytes: u64,
}

/// Lists the files of a reconstruction.
#[utoipa::path(get, path = "/api/v1/reconstructions/{id}/files", tag = "reconstructions", operation_id = "result_files",
    params(("id" = String, Path)), responses((status = 200, body = Vec<ResultFile>), (status = 404, body = Problem)))]
pub async fn list(State(app): State<Arc<App>>, At(id): At<String>) -> Answer<Json<Vec<ResultFile>>> {
    let folder = app.place(&id).await?.results;
    let files = blocking(move || Ok(files::list(&folder))).await?;
    Ok(Json(files.into_iter().map(|(name, bytes)| ResultFile { name, bytes }).collect()))
}

/// Downloads a file of a reconstruction.
#[utoipa::path(get, path = "/api/v1/reconstructions/{id}/files/{file}", tag = "reconstructions",
    operation_id = "result_file", params(("id" = String, Path), ("file" = String, Path, description = "For instance hdr.png")),
    responses((status = 200, content(([u8] = "image/png"), ([u8] = "application/octet-stream"))),
        (status = 404, body = Problem)))]
pub async fn file(
    State(app): State<Arc<App>>,
    At((id, name)): At<(String, String)>,
    wishes: HeaderMap,
) -> Answer<Response> {
    let folder = app.place(&id).await?.results;
    let kind = if name.ends_with(".png") { "image/png" } else { files::BYTES };
    files::send(&files::inside(&folder, &name)?, kind, &wishes).await
}

/// Coordinates of a pixel.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct PixelQuery {
    #[param(maximum = 100000, example = 3)]
    x: usize,
    #[param(maximum = 100000, example = 4)]
    y: usize,
}

/// Measured values of one pixel, and the fitted sinusoid.
#[derive(Debug, Serialize, ToSchema)]
pub struct Pixel {
    x: usize,
    y: usize,
    /// `{analyser_deg, value, file}` for each photograph, after all corrections of the reconstruction.
    #[schema(value_type = Vec<Object>)]
    points: Vec<Point>,
    s0: f64,
    s1: f64,
    s2: f64,
    /// Points of the fitted curve.
    fit: Vec<FitPoint>,
    residual_rms: f64,
    /// Orientation in degrees; null where masked, and for the model `plain`.
    orientation_deg: Option<f64>,
    /// Angle of linear polarization in degrees; null where masked.
    aolp_deg: Option<f64>,
    sigma_deg: Option<f64>,
    dolp: Option<f64>,
    /// Period in µm; null where masked, and without a map of periods.
    period_um: Option<f64>,
    /// Standard deviation of the period in µm, from noise alone; null for heuristic periods.
    period_sigma_um: Option<f64>,
    masked: bool,
    saturated: bool,
}

/// A point of the fitted curve.
#[derive(Debug, Serialize, ToSchema)]
pub struct FitPoint {
    analyser_deg: f64,
    value: f64,
}

/// A map: `NAME.png` for a picture (of a region), `NAME.exr`, `NAME.csv` or `NAME.npy` for its numbers. `maps` lists
/// the names, such as orientation, sigma and period.
#[utoipa::path(get, path = "/api/v1/reconstructions/{id}/maps/{file}", tag = "reconstructions", operation_id = "map",
    params(("id" = String, Path), ("file" = String, Path, description = "For instance orientation.png"), Region),
    responses((status = 200, content(([u8] = "image/png"), ([u8] = "application/octet-stream"), (String = "text/csv"))),
        (status = 400, body = Problem), (status = 404, body = Problem)))]
pub async fn map(
    State(app): State<Arc<App>>,
    At((id, file)): At<(String, String)>,
    Params(region): Params<Region>,
    wishes: HeaderMap,
) -> Answer<Response> {
    let folder = app.place(&id).await?.results;
    let missing = || Problem::not_found(format!("map {file:?}"));
    let (name, kind) = file.rsplit_once('.').ok_or_else(missing)?;
    let (exr, _) = maps::source(&folder, name).ok_or_else(missing)?;
    let (name, kind) = (name.to_owned(), kind.to_owned());
    match kind.as_str() {
        "exr" => return files::send(&files::inside(&folder, &exr)?, files::BYTES, &wishes).await,
        "png" | "csv" | "npy" => {}
        _ => return Err(missing()),
    }
    let width = super::picture_width(region.width, 1024)?;
    let attached = format!("attachment; filename=\"{file}\"");
    let table = |content: &str| [(header::CONTENT_TYPE, content.to_owned()), (header::CONTENT_DISPOSITION, attached)];
    match kind.as_str() {
        "csv" => {
            let of = (folder.clone(), name.clone());
            let head = move |_: &Plane| {
                let unit = map_list::locate(&of.0, &of.1).map(|map| map.unit).unwrap_or_default();
                nacre_image::csv_head(&of.1, &unit)
            };
            let body = app.heavy.table(folder, name, head, maps::csv_rows).await?;
            Ok((table("text/csv"), body).into_response())
        }
        "npy" => {
            let body = app
                .heavy
                .table(folder, name, |plane| nacre_image::npy_head([plane.width, plane.height()]), maps::npy_rows)
                .await?;
            Ok((table(files::BYTES), body).into_response())
        }
        _ => picture(&app, folder, name, width, &region).await,
    }
}

/// Picture of a map, or of a region of it.
async fn picture(app: &App, folder: PathBuf, name: String, width: usize, region: &Region) -> Answer<Response> {
    let palette = maps::palette(&folder);
    let view = maps::View {
        width,
        palette,
        region: match (region.x, region.y, region.w, region.h) {
            (None, None, None, None) => None,
            (x, y, w, h) => {
                let region = [x.unwrap_or(0), y.unwrap_or(0), w.unwrap_or(u16::MAX), h.unwrap_or(u16::MAX)];
                Some(region.map(usize::from))
            }
        },
    };
    let (heavy, range) = (app.heavy.clone(), Arc::new(OnceLock::new()));
    let found = range.clone();
    let response = app.heavy.answer(move || {
        let map = map_list::locate(&folder, &name)?;
        let whole = view.region.is_none() && map.size[0] * map.size[1] > THINNED;
        let plane = if whole { Arc::new(tiles::thinned(&map, view.width)?) } else { heavy.plane(&folder, &name)? };
        let _ = found.set(maps::range_header(&name, &plane.values));
        maps::picture(&name, &plane.values, plane.width, &view, &encode_png8).map_err(Problem::bad)
    });
    let response = response.await?;
    let kind = [(header::CONTENT_TYPE, "image/png")];
    Ok((kind, range.get().cloned().map(|range| [range]), [maps::palette_header(palette)], response).into_response())
}

/// Reads one pixel: its measured points, the fit, and the values of the maps.
#[utoipa::path(get, path = "/api/v1/reconstructions/{id}/pixel", tag = "reconstructions", operation_id = "pixel",
    params(("id" = String, Path), PixelQuery),
    responses((status = 200, body = Pixel), (status = 400, body = Problem), (status = 404, body = Problem)))]
pub async fn pixel(
    State(app): State<Arc<App>>,
    At(id): At<String>,
    Params(query): Params<PixelQuery>,
) -> Answer<Json<Pixel>> {
    let place = app.place(&id).await?;
    let heavy = app.heavy.clone();
    Ok(Json(app.heavy.work(move || read_pixel(&heavy, &place, query.x, query.y)).await?))
}

fn read_pixel(heavy: &Heavy, place: &Place, x: usize, y: usize) -> Answer<Pixel> {
    let value = |name: &str| -> Answer<Option<f64>> {
        let plane = heavy.plane(&place.results, name)?;
        if x >= plane.width || y >= plane.height() {
            return Err(Problem::bad(format!("pixel {x}, {y} lies outside")));
        }
        let v = plane.values[y * plane.width + x];
        Ok(v.is_finite().then_some(f64::from(v)))
    };
    let (aolp, sigma, dolp) = (value("aolp")?, value("sigma")?, value("dolp")?);
    let masked = value("mask")? != Some(1.0);
    let of = |file: &str, name: &str| if place.results.join(file).exists() { value(name) } else { Ok(None) };
    let orientation = of("orientation.exr", "orientation")?;
    let (period_um, period_sigma_um) = (of("period.exr", "period")?, of("period.exr", "period_sigma")?);
    let found = probe(&load(&place.input)?, [x, y], &AppliedCorrections::read(&place.results)?)?;
    let curve = |k: u32| {
        let deg = 2.0 * f64::from(k);
        let (sin, cos) = (2.0 * deg.to_radians()).sin_cos();
        FitPoint { analyser_deg: deg, value: 0.5 * (found.s0 + found.s1 * cos + found.s2 * sin) }
    };
    Ok(Pixel {
        x,
        y,
        fit: (0..=90).map(curve).collect(),
        s0: found.s0,
        s1: found.s1,
        s2: found.s2,
        residual_rms: found.residual_rms,
        saturated: found.saturated,
        points: found.points,
        orientation_deg: orientation.map(f64::to_degrees),
        aolp_deg: aolp.filter(|_| !masked).map(f64::to_degrees),
        sigma_deg: sigma.map(f64::to_degrees),
        dolp,
        period_um,
        period_sigma_um,
        masked,
    })
}
