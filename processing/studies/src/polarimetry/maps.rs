//! Intensity over the analyser angle and the grating angle (2018 paper, Fig. 14 and 15).

use super::scene::ratio;
use crate::{Drawn, Picture};
use nacre_base::{Error, Result};
use nacre_image::{encode_png8, viridis};
use nacre_plot::style::{INK, SOFT};
use nacre_plot::svg::{Anchor, Area, Axes, Ruler, Svg, fill};
use nacre_polarimetry::synthetic::{Source, Synthetic};
use std::f64::consts::PI;

/// r, ζ and Δn in degrees, and the light.
const CASES: [(f64, f64, f64, Source); 8] = [
    (1.1, 45.0, 0.0, Source::Circular),
    (1.2, 150.0, 10.0, Source::Circular),
    (1.001, 164.0, 3.0, Source::Circular),
    (1.001, 172.0, 3.0, Source::Circular),
    (1.001, 176.0, 3.0, Source::Circular),
    (1e-3, 90.0, 10.0, Source::Circular),
    (1.2, 150.0, 0.0, Source::Linear(0.0)),
    (1.2, 150.0, 10.0, Source::Linear(0.0)),
];

/// Steps over 180° of both angles.
const STEPS: usize = 90;
const SIDE: f64 = 200.0;

/// The maps, each as photographed and after subtraction of the mean over the orientations.
pub(super) fn picture() -> Picture {
    Picture {
        name: "maps",
        group: "polarimetry",
        title: "Intensity over analyser and grating angle",
        text: "Fig. 14 and 15 of the 2018 paper, computed. Each row of a map is what a pixel shows while the analyser turns, \
               normalised; red dots mark its maximum. Where the dots run along the white line (the slope +1 of the model, its \
               offset fitted), the phase is the orientation. Upper of each pair: as photographed; lower: with the mean over all \
               orientations taken out first, which mends a film's effect where the orientations in view are spread evenly.",
        draw,
    }
}

fn draw() -> Result<Drawn> {
    let pitch = [SIDE + 86.0, SIDE + 84.0];
    let columns = 4;
    let mut svg = Svg::new(44.0 + columns as f64 * pitch[0], 104.0 + 4.0 * pitch[1] + 20.0);
    svg.text([28.0, 34.0], picture().title, 20.0, Anchor::Start, "font-weight=\"bold\"");
    signs(&mut svg);
    for (i, case) in CASES.iter().enumerate() {
        let raw = intensities(case);
        for (row, values) in [normalised(&raw), normalised(&without_mean(&raw))].iter().enumerate() {
            let corner = [84.0 + (i % columns) as f64 * pitch[0], 104.0 + (2 * (i / columns) + row) as f64 * pitch[1]];
            panel(&mut svg, Area::new(corner[0], corner[1], SIDE, SIDE), values, &title(case, row))?;
        }
    }
    Ok(Drawn::from(svg.finish(picture().title)))
}

/// Legend of colours, dots and lines.
pub(super) fn signs(svg: &mut Svg) {
    svg.text([28.0, 60.0], "Normalised intensity, dark to bright:", 12.5, Anchor::Start, &fill(SOFT));
    for k in 0..60 {
        let [r, g, b] = viridis(k as f32 / 59.0);
        svg.rect(Area::new(240.0 + 2.0 * f64::from(k), 49.0, 2.4, 13.0), &format!("fill=\"#{r:02x}{g:02x}{b:02x}\""));
    }
    svg.circle([386.0, 56.0], 3.0, "fill=\"#e0102f\"");
    svg.text([395.0, 60.0], "maximum of a row", 12.5, Anchor::Start, &fill(SOFT));
    svg.line([512.0, 56.0], [538.0, 56.0], &format!("stroke=\"{INK}\" stroke-width=\"4\""));
    svg.line([512.0, 56.0], [538.0, 56.0], "stroke=\"#ffffff\" stroke-width=\"2\"");
    svg.text([546.0, 60.0], "slope +1, the model without a film", 12.5, Anchor::Start, &fill(SOFT));
}

fn title(&(r, zeta, film, source): &(f64, f64, f64, Source), row: usize) -> [String; 2] {
    let light = if source == Source::Circular { "" } else { ", linear light" };
    let first = format!("r {}, ζ {zeta}°, Δn {film}°{light}", r);
    [first, if row == 0 { "as photographed".into() } else { "mean over orientations removed".into() }]
}

/// Intensities: rows are orientations, columns analyser angles.
fn intensities(&(r, zeta, film, source): &(f64, f64, f64, Source)) -> Vec<Vec<f64>> {
    let scene = Synthetic { ratio: ratio(r, zeta), retardance: film.to_radians(), source, ..Synthetic::default() };
    let angle = |k: usize| PI * k as f64 / STEPS as f64;
    (0..STEPS).map(|t| (0..STEPS).map(|p| scene.intensity(angle(t), angle(p))).collect()).collect()
}

/// Each row scaled to the range -1 to 1.
pub(super) fn normalised(rows: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let row = |row: &Vec<f64>| {
        let (low, high) = row.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
        let half = (0.5 * (high - low)).max(f64::MIN_POSITIVE);
        row.iter().map(|v| (v - 0.5 * (high + low)) / half).collect()
    };
    rows.iter().map(row).collect()
}

/// Subtracts the mean of each column, a photograph of all orientations (the paper's pre-normalisation).
pub(super) fn without_mean(rows: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let mean: Vec<f64> = (0..STEPS).map(|p| rows.iter().map(|r| r[p]).sum::<f64>() / STEPS as f64).collect();
    rows.iter().map(|row| row.iter().zip(&mean).map(|(v, m)| v - m).collect()).collect()
}

pub(super) fn panel(svg: &mut Svg, area: Area, rows: &[Vec<f64>], title: &[String; 2]) -> Result<()> {
    let x = Ruler::exact(0.0, 180.0, area.x, area.x + area.w);
    let y = Ruler::exact(0.0, 180.0, area.y + area.h, area.y);
    let axes = Axes { area, x, y, names: &[], x_title: "analyser ψ (°)", y_title: "grating θ (°)", percent: false };
    axes.draw(svg);
    // Row 0 of the picture is at the top and shows the largest angle.
    let bright = |v: &f64| viridis((0.5 + 0.5 * v) as f32);
    let rgb: Vec<u8> = rows.iter().rev().flatten().flat_map(bright).collect();
    let png = encode_png8(STEPS, STEPS, 3, &rgb).map_err(|e| Error::input("map", e, "report this"))?;
    svg.image(area, &png);
    let peaks: Vec<usize> = rows.iter().map(|row| peak(row)).collect();
    let step = 180.0 / STEPS as f64;
    expected(svg, &peaks, x, y);
    for (t, p) in peaks.iter().enumerate().step_by(2) {
        svg.circle([x.at((*p as f64 + 0.5) * step), y.at((t as f64 + 0.5) * step)], 1.9, "fill=\"#e0102f\"");
    }
    svg.text([area.x, area.y - 20.0], &title[0], 12.5, Anchor::Start, "font-weight=\"bold\"");
    svg.text([area.x, area.y - 6.0], &title[1], 12.0, Anchor::Start, &fill(SOFT));
    Ok(())
}

fn peak(row: &[f64]) -> usize {
    (0..row.len()).max_by(|a, b| row[*a].total_cmp(&row[*b])).unwrap_or(0)
}

/// The line ψ = θ + offset that fits the peaks best, in pieces as it wraps.
fn expected(svg: &mut Svg, peaks: &[usize], x: Ruler, y: Ruler) {
    let turn = |steps: f64| 2.0 * PI * steps / STEPS as f64;
    let (sin, cos) = peaks.iter().enumerate().fold((0.0, 0.0), |(s, c), (t, p)| {
        let d = turn(*p as f64 - t as f64);
        (s + d.sin(), c + d.cos())
    });
    let offset = (90.0 * f64::atan2(sin, cos) / PI).rem_euclid(180.0);
    for (from, to) in [(0.0, 180.0 - offset), (180.0 - offset, 180.0)] {
        let wrap = if from > 0.0 || offset == 180.0 { 180.0 } else { 0.0 };
        let ends = [[x.at(from + offset - wrap), y.at(from)], [x.at(to + offset - wrap), y.at(to)]];
        svg.line(ends[0], ends[1], "stroke=\"#000000\" stroke-opacity=\"0.45\" stroke-width=\"3.2\"");
        svg.line(ends[0], ends[1], "stroke=\"#ffffff\" stroke-width=\"1.6\"");
    }
}
