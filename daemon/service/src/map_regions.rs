//! Statistics of regions of a map, and values along lines: `/api/v1/reconstructions/{id}/statistics` and `profile`.

use super::map_list::{Located, MapKind, locate};
use super::problem::{Answer, Problem};
use super::{App, At, Params};
use axum::Json;
use axum::extract::State;
use nacre_image::read_exr_rows;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::ops::Range;
use std::sync::Arc;
use utoipa::{IntoParams, ToSchema};

/// About the maximum number of values that statistics are made of: 4 MiB. Of larger regions, every n-th row and column
/// counts.
const MOST_VALUES: usize = 1 << 20;

/// Maximum number of corners of a polygon.
const MOST_CORNERS: usize = 64;

/// Maximum number of points of a profile.
const MOST_POINTS: usize = 4096;

/// Usual number of bins of a histogram.
const BINS: usize = 128;

/// Percentiles that are reported.
const PERCENTS: [f64; 9] = [0.1, 1.0, 5.0, 25.0, 50.0, 75.0, 95.0, 99.0, 99.9];

/// Histograms without `low` and `high` leave out this part in percent at each end.
const TAIL: f64 = 0.1;

/// A region of a map, in pixels: a rectangle, a polygon, or the whole map.
#[derive(Debug, Default, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct RegionQuery {
    /// Left column of a rectangle.
    #[param(maximum = 65535)]
    x: Option<u16>,
    /// Top row.
    #[param(maximum = 65535)]
    y: Option<u16>,
    /// Columns.
    #[param(minimum = 1, maximum = 65535)]
    w: Option<u16>,
    /// Rows.
    #[param(minimum = 1, maximum = 65535)]
    h: Option<u16>,
    /// Corners of a polygon, 3 to 64: x and y of each, separated by commas. Pixels count whose centre lies inside.
    #[param(max_length = 2000, example = "0,0,20,0,10,15")]
    polygon: Option<String>,
    /// Number of bins of the histogram.
    #[param(minimum = 2, maximum = 512)]
    bins: Option<usize>,
}

/// Values of a region. Angles are those of lines: mean and standard deviation are circular.
#[derive(Debug, Serialize, ToSchema)]
pub struct MapStatistics {
    /// Pixels of the region.
    pixels: u64,
    /// Every n-th row and column was read.
    step: usize,
    /// Values that were read.
    read: u64,
    /// Those of them that are not masked.
    valid: u64,
    min: Option<f64>,
    max: Option<f64>,
    mean: Option<f64>,
    /// Standard deviation of the values.
    sd: Option<f64>,
    /// None for angles.
    percentiles: Vec<MapPercentile>,
    /// None without a valid value.
    histogram: Option<MapHistogram>,
}

/// A value that a share of all values lies below.
#[derive(Debug, Serialize, ToSchema)]
pub struct MapPercentile {
    percent: f64,
    value: f64,
}

/// Number of values in bins of equal width from `low` to `high`: from the 0.1st to the 99.9th percentile, and from 0 to
/// π for angles.
#[derive(Debug, Serialize, ToSchema)]
pub struct MapHistogram {
    low: f64,
    high: f64,
    counts: Vec<u64>,
}

/// Ends of a line, in pixels; integers are centres of pixels.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct LineQuery {
    #[param(minimum = 0, maximum = 65535, example = 0)]
    x0: f64,
    #[param(minimum = 0, maximum = 65535, example = 0)]
    y0: f64,
    #[param(minimum = 0, maximum = 65535, example = 3)]
    x1: f64,
    #[param(minimum = 0, maximum = 65535, example = 4)]
    y1: f64,
}

/// Values of the nearest pixels along a line, evenly spaced and at most 4096; null where masked.
#[derive(Debug, Serialize, ToSchema)]
pub struct MapProfile {
    /// Length of the line in pixels.
    length_px: f64,
    /// Columns of the pixels.
    x: Vec<usize>,
    /// Rows of the pixels.
    y: Vec<usize>,
    value: Vec<Option<f32>>,
    /// Standard deviations; none for maps without.
    sigma: Option<Vec<Option<f32>>>,
}

/// Statistics and histogram of a region of a map, or of the whole map.
#[utoipa::path(get, path = "/api/v1/reconstructions/{id}/statistics/{map}", tag = "reconstructions",
    operation_id = "map_statistics",
    params(("id" = String, Path), ("map" = String, Path, description = "A name of `maps`"), RegionQuery),
    responses((status = 200, body = MapStatistics), (status = 400, body = Problem), (status = 404, body = Problem)))]
pub async fn statistics(
    State(app): State<Arc<App>>,
    At((id, map)): At<(String, String)>,
    Params(query): Params<RegionQuery>,
) -> Answer<Json<MapStatistics>> {
    let folder = app.place(&id).await?.results;
    let bins = query.bins.unwrap_or(BINS);
    if !(2..=512).contains(&bins) {
        return Err(Problem::bad(format!("bins is {bins}; give 2 to 512")));
    }
    let work = move || {
        let map = locate(&folder, &map)?;
        let region = Region::new(&query, map.size)?;
        statistics_of(&map, &region, bins)
    };
    Ok(Json(app.heavy.work(work).await?))
}

/// Values of a map along a line, with their standard deviations.
#[utoipa::path(get, path = "/api/v1/reconstructions/{id}/profile/{map}", tag = "reconstructions",
    operation_id = "map_profile",
    params(("id" = String, Path), ("map" = String, Path, description = "A name of `maps`"), LineQuery),
    responses((status = 200, body = MapProfile), (status = 400, body = Problem), (status = 404, body = Problem)))]
pub async fn profile(
    State(app): State<Arc<App>>,
    At((id, map)): At<(String, String)>,
    Params(line): Params<LineQuery>,
) -> Answer<Json<MapProfile>> {
    let folder = app.place(&id).await?.results;
    let work = move || {
        let map = locate(&folder, &map)?;
        let points = points(&line, map.size)?;
        let value = along(&map, &points)?;
        let sigma = map.sigma.as_deref().map(|name| along(&locate(&folder, name)?, &points)).transpose()?;
        let (x, y) = points.into_iter().map(|[x, y]| (x, y)).unzip();
        Ok(MapProfile { length_px: (line.x1 - line.x0).hypot(line.y1 - line.y0), x, y, value, sigma })
    };
    Ok(Json(app.heavy.work(work).await?))
}

/// Pixels of a map, as columns of each row.
#[derive(Debug)]
struct Region {
    columns: Range<usize>,
    rows: Range<usize>,
    /// Corners of a polygon within columns and rows; empty for a rectangle.
    corners: Vec<[f64; 2]>,
}

impl Region {
    fn new(query: &RegionQuery, [width, height]: [usize; 2]) -> Answer<Self> {
        let rectangle = [query.x, query.y, query.w, query.h];
        let Some(polygon) = &query.polygon else {
            let [x, y, w, h] = rectangle.map(|v| v.map(usize::from));
            let range = |from: Option<usize>, count: Option<usize>, size: usize| {
                let from = from.unwrap_or(0).min(size);
                from..from.saturating_add(count.unwrap_or(size)).min(size)
            };
            let (columns, rows) = (range(x, w, width), range(y, h, height));
            if columns.is_empty() || rows.is_empty() {
                return Err(Problem::bad(format!(
                    "the rectangle holds no pixel of the map, which is {width} × {height}"
                ))
                .remedy("give x, y, w and h within the map"));
            }
            return Ok(Self { columns, rows, corners: vec![] });
        };
        if rectangle.iter().any(Option::is_some) {
            return Err(Problem::bad("polygon is given together with x, y, w or h; give one of them"));
        }
        let corners = corners(polygon)?;
        let reach = |k: usize, size: usize| {
            let [low, high] = ends(corners.iter().map(|c| c[k]));
            (low.ceil().max(0.0) as usize).min(size)..((high.floor() + 1.0).max(0.0) as usize).min(size)
        };
        Ok(Self { columns: reach(0, width), rows: reach(1, height), corners })
    }

    /// Columns of a row that belong to the region. Of a polygon, its even-odd interior.
    fn spans(&self, y: usize) -> Vec<Range<usize>> {
        if self.corners.is_empty() {
            return vec![self.columns.clone()];
        }
        let at = y as f64;
        let edges = self.corners.iter().zip(self.corners.iter().cycle().skip(1));
        let crossed = edges.filter(|(a, b)| (a[1] <= at) != (b[1] <= at));
        let mut columns: Vec<f64> = crossed.map(|(a, b)| a[0] + (at - a[1]) * (b[0] - a[0]) / (b[1] - a[1])).collect();
        columns.sort_by(f64::total_cmp);
        let inside = |v: f64| (v.ceil().max(0.0) as usize).clamp(self.columns.start, self.columns.end);
        columns.chunks_exact(2).map(|pair| inside(pair[0])..inside(pair[1])).filter(|span| !span.is_empty()).collect()
    }

    fn pixels(&self) -> usize {
        if self.corners.is_empty() {
            return self.columns.len() * self.rows.len();
        }
        self.rows.clone().map(|y| self.spans(y).iter().map(Range::len).sum::<usize>()).sum()
    }
}

fn ends(values: impl Iterator<Item = f64>) -> [f64; 2] {
    values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
}

fn corners(text: &str) -> Answer<Vec<[f64; 2]>> {
    let limit = 2.0 * f64::from(u16::MAX);
    let numbers: Option<Vec<f64>> =
        text.split(',').map(|n| n.trim().parse().ok().filter(|v: &f64| v.abs() <= limit)).collect();
    let numbers = numbers.filter(|n| n.len() % 2 == 0 && (3..=MOST_CORNERS).contains(&(n.len() / 2)));
    let refused = || {
        Problem::bad("polygon is not a list of 3 to 64 corners")
            .remedy("give x and y of each corner, as in 0,0,20,0,10,15")
    };
    Ok(numbers.ok_or_else(refused)?.as_chunks::<2>().0.to_vec())
}

/// Statistics of the valid values of a region; rows that do not count are not read.
fn statistics_of(map: &Located, region: &Region, bins: usize) -> Answer<MapStatistics> {
    let pixels = region.pixels();
    let step = ((pixels as f64 / MOST_VALUES as f64).sqrt().ceil() as usize).max(1);
    let wanted = |y: usize| region.rows.contains(&y) && (y - region.rows.start).is_multiple_of(step);
    let mut values: Vec<f32> = vec![];
    let mut read = 0;
    read_exr_rows(&map.path, &map.channel, &wanted, |y, x, piece| {
        for span in region.spans(y) {
            let seen = span.start.max(x)..span.end.min(x + piece.len());
            let first = seen.start + (step - seen.start % step) % step;
            let chosen = (first..seen.end).step_by(step).map(|column| piece[column - x]);
            values.extend(chosen.inspect(|_| read += 1).filter(|v| v.is_finite()));
        }
    })?;
    let mut found = match map.kind {
        MapKind::Direction => directions(&values, bins),
        _ => numbers(&mut values, bins),
    };
    (found.pixels, found.step, found.read) = (pixels as u64, step, read);
    Ok(found)
}

fn numbers(values: &mut [f32], bins: usize) -> MapStatistics {
    values.sort_unstable_by(f32::total_cmp);
    let count = values.len() as f64;
    let mean = values.iter().map(|v| f64::from(*v)).sum::<f64>() / count;
    let variance = values.iter().map(|v| (f64::from(*v) - mean).powi(2)).sum::<f64>() / count;
    let at = |percent: f64| {
        let place = percent / 100.0 * (count - 1.0).max(0.0);
        let [low, high] = [place.floor(), place.ceil()].map(|k| values.get(k as usize).map(|v| f64::from(*v)));
        Some(low? + (high? - low?) * place.fract())
    };
    let percentiles =
        PERCENTS.iter().filter_map(|percent| Some(MapPercentile { percent: *percent, value: at(*percent)? }));
    let histogram = at(TAIL).zip(at(100.0 - TAIL)).map(|(low, high)| histogram(values, low, high, bins));
    MapStatistics {
        pixels: 0,
        step: 1,
        read: 0,
        valid: values.len() as u64,
        min: at(0.0),
        max: at(100.0),
        mean: Some(mean).filter(|m| m.is_finite()),
        sd: Some(variance.sqrt()).filter(|s| s.is_finite()),
        percentiles: percentiles.collect(),
        histogram,
    }
}

/// Statistics of angles of lines, on the circle of twice the angle (Mardia and Jupp, "Directional Statistics", 2.3.1).
fn directions(values: &[f32], bins: usize) -> MapStatistics {
    let count = values.len() as f64;
    let [cos, sin] = values.iter().fold([0.0, 0.0], |[c, s], v| {
        let (sin, cos) = (2.0 * f64::from(*v)).sin_cos();
        [c + cos, s + sin]
    });
    let length = (cos.hypot(sin) / count).min(1.0);
    let known = |v: f64| Some(v).filter(|v| v.is_finite() && count > 0.0);
    let [min, max] = ends(values.iter().map(|v| f64::from(*v)));
    MapStatistics {
        pixels: 0,
        step: 1,
        read: 0,
        valid: values.len() as u64,
        min: known(min),
        max: known(max),
        mean: known((0.5 * sin.atan2(cos)).rem_euclid(PI)),
        sd: known(0.5 * (-2.0 * length.ln()).max(0.0).sqrt()),
        percentiles: vec![],
        histogram: known(0.0).map(|low| histogram(values, low, PI, bins)),
    }
}

fn histogram(values: &[f32], low: f64, high: f64, bins: usize) -> MapHistogram {
    let mut counts = vec![0; bins];
    let scale = if high > low { bins as f64 / (high - low) } else { 0.0 };
    for value in values.iter().map(|v| f64::from(*v)).filter(|v| (low..=high).contains(v)) {
        counts[(((value - low) * scale) as usize).min(bins - 1)] += 1;
    }
    MapHistogram { low, high, counts }
}

/// Pixels along a line.
fn points(line: &LineQuery, [width, height]: [usize; 2]) -> Answer<Vec<[usize; 2]>> {
    let inside = |v: f64, size: usize| v > -0.5 && v < size as f64 - 0.5;
    for (name, value, size) in
        [("x0", line.x0, width), ("y0", line.y0, height), ("x1", line.x1, width), ("y1", line.y1, height)]
    {
        if !inside(value, size) {
            let problem = format!("{name} is {value}, outside of the map, which is {width} × {height}");
            return Err(Problem::bad(problem).remedy(format!("give 0 to {}", size - 1)));
        }
    }
    let [dx, dy] = [line.x1 - line.x0, line.y1 - line.y0];
    let steps = (dx.abs().max(dy.abs()).round() as usize).clamp(1, MOST_POINTS - 1);
    let point = |k: usize| {
        let t = k as f64 / steps as f64;
        let near = |v: f64, size: usize| (v.round().max(0.0) as usize).min(size - 1);
        [near(line.x0 + t * dx, width), near(line.y0 + t * dy, height)]
    };
    Ok((0..=steps).map(point).collect())
}

/// Values at pixels; rows without a pixel are not read.
fn along(map: &Located, points: &[[usize; 2]]) -> Answer<Vec<Option<f32>>> {
    let mut of_row: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (k, [_, y]) in points.iter().enumerate() {
        of_row.entry(*y).or_default().push(k);
    }
    let mut values = vec![None; points.len()];
    let wanted = |y: usize| of_row.contains_key(&y);
    read_exr_rows(&map.path, &map.channel, &wanted, |y, x, piece| {
        for &k in of_row.get(&y).into_iter().flatten() {
            let value = points[k][0].checked_sub(x).and_then(|column| piece.get(column));
            values[k] = value.copied().filter(|v| v.is_finite()).or(values[k]);
        }
    })?;
    Ok(values)
}

#[cfg(test)]
#[path = "map_regions_tests.rs"]
mod tests;
