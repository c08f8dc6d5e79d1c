//! `/api/v1/devices/camera/preview`: the newest frame, as a picture and in numbers.

use super::bench::{Owner, Picture};
use super::problem::{Answer, Problem};
use super::{App, Params, png};
use axum::Json;
use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use nacre_image::encode_png8;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use utoipa::{IntoParams, ToSchema};

/// Smallest range of levels that the preview stretches, so that the noise of a dark frame stays dark.
const LEAST_CONTRAST: f32 = 0.1;

/// Number of pixels that determine the stretch of the preview.
const SAMPLED: usize = 50_000;

/// Picture of the newest frame.
#[derive(Clone, Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct PreviewPicture {
    /// Most pixels per row.
    #[param(minimum = 1, maximum = 16384)]
    width: Option<usize>,
    /// Whether to show the levels of `stretch` as black and white.
    #[serde(default)]
    stretch: bool,
}

/// Statistics of the newest frame.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct Preview {
    sequence: u64,
    width: usize,
    height: usize,
    /// Number of pixels in each of 256 equal steps from black to white.
    histogram: Vec<u32>,
    /// Fraction of saturated pixels.
    saturated: f64,
    /// Mean between black (0) and white (1).
    mean: f64,
    /// Levels that 0.5 % of the pixels are below and above, between black (0) and white (1).
    stretch: [f64; 2],
    analyser_deg: Option<f64>,
}

/// The newest frame as a grey picture with a display's gamma.
#[utoipa::path(get, path = "/api/v1/devices/camera/preview.png", tag = "devices", operation_id = "preview_picture",
    params(PreviewPicture),
    responses((status = 200, content_type = "image/png", body = [u8]), (status = 400, body = Problem),
        (status = 409, body = Problem)))]
pub async fn preview_picture(State(app): State<Arc<App>>, Params(query): Params<PreviewPicture>) -> Answer<Response> {
    let picture = app.bench.work(Owner::preview).await?;
    let tag = format!("\"{}\"", picture.sequence);
    let width = super::picture_width(query.width, 1024)?;
    let body = super::blocking(move || png(grey(&picture, width, query.stretch))).await?;
    Ok(([(header::ETAG, tag)], body).into_response())
}

/// Histogram, saturation and mean of the newest frame.
#[utoipa::path(get, path = "/api/v1/devices/camera/preview", tag = "devices", operation_id = "preview",
    responses((status = 200, body = Preview), (status = 409, body = Problem)))]
pub async fn preview(State(app): State<Arc<App>>) -> Answer<Json<Preview>> {
    let (picture, analyser_deg) = app.bench.work(|owner| Ok((owner.preview()?, owner.analyser_deg))).await?;
    let mut histogram = vec![0_u32; 256];
    let (mut sum, mut saturated) = (0.0, 0_u32);
    for code in &picture.codes {
        let level = picture.level(*code);
        histogram[((255.0 * level) as usize).min(255)] += 1;
        sum += f64::from(level);
        saturated += u32::from(*code >= picture.range[1]);
    }
    let pixels = picture.codes.len().max(1) as f64;
    Ok(Json(Preview {
        sequence: picture.sequence,
        width: picture.width,
        height: picture.height,
        histogram,
        saturated: f64::from(saturated) / pixels,
        mean: sum / pixels,
        stretch: picture.percentiles().map(f64::from),
        analyser_deg,
    }))
}

impl Picture {
    /// Level of a code between black (0) and white (1).
    fn level(&self, code: u16) -> f32 {
        let [black, white] = self.range.map(f32::from);
        ((f32::from(code) - black) / (white - black)).clamp(0.0, 1.0)
    }

    /// Levels that 0.5 % of the pixels are below and above, at least [`LEAST_CONTRAST`] apart.
    fn percentiles(&self) -> [f32; 2] {
        let step = self.codes.len().div_ceil(SAMPLED).max(1);
        let mut codes: Vec<u16> = self.codes.iter().copied().step_by(step).collect();
        codes.sort_unstable();
        let outside = codes.len() / 200;
        let at = |k: usize| codes.get(k).map_or(0.0, |code| self.level(*code));
        let [low, high] = [at(outside), at(codes.len().saturating_sub(outside + 1))];
        let low = low.min(1.0 - LEAST_CONTRAST);
        [low, high.max(low + LEAST_CONTRAST)]
    }
}

/// PNG of at most `width` pixels per row.
fn grey(picture: &Picture, width: usize, stretch: bool) -> std::io::Result<Vec<u8>> {
    let [low, high] = if stretch { picture.percentiles() } else { [0.0, 1.0] };
    let level = |i: usize| ((picture.level(picture.codes[i]) - low) / (high - low)).clamp(0.0, 1.0);
    super::maps::grey(picture.width, picture.height, width, &level, &encode_png8)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Instant;

    fn percentiles(codes: Vec<u16>) -> [f32; 2] {
        Picture { sequence: 1, width: codes.len(), height: 1, codes, range: [100, 1100], taken: Instant::now() }
            .percentiles()
    }

    #[test]
    fn few_pixels_do_not_decide_the_contrast() {
        let mut codes = vec![300; 500];
        codes.extend(vec![700; 500]);
        codes[..4].fill(100);
        codes[996..].fill(1100);
        // Noise stays dark, and a uniform bright frame bright.
        for (codes, wanted) in
            [(codes, [0.2, 0.6]), (vec![101; 10], [0.001, 0.101]), (vec![1100; 10], [0.9, 1.0]), (vec![], [0.0, 0.1])]
        {
            let found = percentiles(codes);
            assert!(found.iter().zip(wanted).all(|(f, w)| (f - w).abs() < 1e-6), "{found:?} {wanted:?}");
        }
    }
}
