//! Maps of a result with size, unit and uncertainty: `/api/v1/reconstructions/{id}/maps`.

use super::problem::{Answer, Problem};
use super::tiles::levels;
use super::{App, At, files, maps};
use axum::Json;
use axum::extract::State;
use nacre_image::{ExrHeader, read_exr_header};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use utoipa::ToSchema;

/// Maximum number of files that are listed.
const MOST_FILES: usize = 64;

/// Values that a map holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum MapKind {
    /// Angles of lines in radians, which repeat after π.
    Direction,
    /// 1 where valid, 0 where masked.
    Mask,
    /// Numbers.
    Number,
}

/// A map of a result.
#[derive(Debug, Serialize, ToSchema)]
pub struct MapInfo {
    /// Its name in paths: `orientation`, or file and channel as in `hdr.R`.
    name: String,
    /// Pixels per row.
    width: usize,
    /// Rows.
    height: usize,
    kind: MapKind,
    /// Unit of its values, such as `rad` or `um`; empty without one.
    unit: String,
    /// Name of the map of its standard deviations, in the same unit.
    sigma: Option<String>,
    /// Pixel pitch on the sample in µm.
    pixel_um: Option<f64>,
    /// Number of levels of tiles. Level 0 has full resolution, and each further level half of it.
    levels: u32,
}

/// A map that was found.
#[derive(Clone, Debug, PartialEq)]
pub struct Located {
    /// Its file.
    pub path: PathBuf,
    /// Its channel.
    pub channel: String,
    /// Width and height in pixels.
    pub size: [usize; 2],
    /// Values that it holds.
    pub kind: MapKind,
    /// Unit, possibly with a remark; empty without one.
    pub unit: String,
    /// Name of the map of its standard deviations.
    pub sigma: Option<String>,
}

/// Finds a map by its name.
///
/// # Errors
/// `not-found` if there is none of that name.
pub fn locate(folder: &Path, name: &str) -> Answer<Located> {
    let missing = || maps::missing(name);
    let (file, channel) = maps::source(folder, name).ok_or_else(missing)?;
    let path = files::inside(folder, &file).map_err(|_| missing())?;
    let header = read_exr_header(&path)?;
    if !header.channels.contains(&channel) {
        return Err(missing());
    }
    let (size, kind) = ([header.width, header.height], kind_of(&channel));
    let sigma = sigma_of(folder, &file, &channel, &header.channels);
    let unit = unit_of(&header.attributes, &channel);
    Ok(Located { path, channel, size, kind, unit, sigma })
}

/// The maps of a result: names, sizes, units, and the maps of their standard deviations.
#[utoipa::path(get, path = "/api/v1/reconstructions/{id}/maps", tag = "reconstructions", operation_id = "maps",
    params(("id" = String, Path)), responses((status = 200, body = Vec<MapInfo>), (status = 404, body = Problem)))]
pub async fn list(State(app): State<Arc<App>>, At(id): At<String>) -> Answer<Json<Vec<MapInfo>>> {
    let folder = app.place(&id).await?.results;
    Ok(Json(app.heavy.work(move || Ok(all(&folder))).await?))
}

fn all(folder: &Path) -> Vec<MapInfo> {
    let names = files::list(folder).into_iter().map(|(name, _)| name);
    let names = names.filter(|name| name.ends_with(".exr") && !name.contains('/')).take(MOST_FILES);
    let headers = names.filter_map(|name| Some((read_exr_header(&folder.join(&name)).ok()?, name)));
    headers.flat_map(|(header, name)| of_file(folder, &name, &header)).collect()
}

fn of_file(folder: &Path, file: &str, header: &ExrHeader) -> Vec<MapInfo> {
    let info = |channel: &String| MapInfo {
        name: maps::name_of(folder, file, channel),
        width: header.width,
        height: header.height,
        kind: kind_of(channel),
        unit: unit_of(&header.attributes, channel),
        sigma: sigma_of(folder, file, channel, &header.channels),
        pixel_um: header.attributes.get("pixel_um").and_then(|text| text.parse().ok()),
        levels: levels([header.width, header.height]),
    };
    header.channels.iter().map(info).collect()
}

fn kind_of(channel: &str) -> MapKind {
    match channel {
        "orientation" | "aolp" => MapKind::Direction,
        "mask" => MapKind::Mask,
        _ => MapKind::Number,
    }
}

/// `sigma_dolp` is the standard deviation of `dolp`; `sigma` is that of the channel that the file is named after.
fn sigma_of(folder: &Path, file: &str, channel: &str, channels: &[String]) -> Option<String> {
    let own = format!("sigma_{channel}");
    let is_main = file.trim_end_matches(".exr") == channel;
    let found = channels.iter().find(|c| **c == own || (is_main && *c == "sigma"));
    found.map(|sigma| maps::name_of(folder, file, sigma))
}

/// Unit of a channel by the attribute `units`, as in `period, sigma: um (relative); mask: 1 measured, 0 masked`.
fn unit_of(attributes: &BTreeMap<String, String>, channel: &str) -> String {
    let units = attributes.get("units").map(String::as_str).unwrap_or_default();
    let parts = units.split(';').filter_map(|part| part.split_once(':'));
    let mut of_channel = parts.filter(|(names, _)| names.split(',').any(|name| name.trim() == channel));
    let unit = of_channel.next().map(|(_, unit)| unit.trim()).unwrap_or_default();
    if unit.starts_with(|c: char| c.is_ascii_digit()) { String::new() } else { unit.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nacre_image::{Attribute, write_exr};

    #[test]
    fn maps_have_names_units_and_uncertainties() {
        let folder = tempfile::tempdir().unwrap();
        let write = |file: &str, channels: &[&str], units: &str| {
            let attributes = [("units", Attribute::Text(units.into())), ("pixel_um", Attribute::Number(12.5))];
            write_exr(&folder.path().join(file), 300, 4, channels, &attributes, &|_, _, row| row.fill(1.0)).unwrap();
        };
        write(
            "aolp.exr",
            &["aolp", "dolp", "sigma", "sigma_dolp", "mask"],
            "aolp, sigma: rad; dolp, sigma_dolp: 0 to 1",
        );
        write("period.exr", &["period", "sigma"], "period, sigma: um (relative); mask: 1 measured, 0 masked");
        write("hdr.exr", &["R"], "radiance");
        let found = all(folder.path());
        let said = |m: &MapInfo| format!("{} {} {} {:?}", m.name, m.unit, m.sigma.as_deref().unwrap_or("-"), m.kind);
        assert_eq!(
            found.iter().map(said).collect::<Vec<_>>(),
            [
                "aolp rad sigma Direction",
                "dolp  sigma_dolp Number",
                "mask  - Mask",
                "sigma rad - Number",
                "sigma_dolp  - Number",
                "hdr.R  - Number",
                "period um (relative) period_sigma Number",
                "period_sigma um (relative) - Number",
            ]
        );
        assert!(found.iter().all(|m| m.pixel_um == Some(12.5) && m.levels == 2 && m.width == 300));
        for m in &found {
            assert_eq!(locate(folder.path(), &m.name).unwrap().kind, m.kind, "{}", m.name);
        }
        for name in ["orientation", "hdr.G", "../hdr.R", "hdr", ".R", "hdr."] {
            assert!(locate(folder.path(), name).is_err(), "{name}");
        }
    }
}
