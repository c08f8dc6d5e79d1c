//! Fringe patterns, and the panel positions that are searched.

use super::optics::Optics;
use std::f64::consts::{PI, TAU};

/// Spatial frequencies in cycles per mm of `count` fringes; the finest has the period `finest_mm`.
///
/// Directions advance by the golden angle, and frequencies are uniformly distributed over a disc. No two positions of
/// the panel then have the same response to all fringes, for any leading subset of them.
pub fn frequencies(count: usize, finest_mm: f64) -> Vec<[f64; 2]> {
    let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
    (0..count)
        .map(|j| {
            let (sin, cos) = (PI * ((j as f64) * golden).fract()).sin_cos();
            // Halton sequence in base 2: every leading subset is uniformly distributed.
            let f = (0.15 + 0.85 * radical(j as u32 + 1)).sqrt() / finest_mm;
            [f * cos, f * sin]
        })
        .collect()
}

/// Radical inverse in base 2.
fn radical(number: u32) -> f64 {
    f64::from(number.reverse_bits()) / 4_294_967_296.0
}

/// Panel positions and their responses.
pub struct Search {
    columns: usize,
    rows: usize,
    step_mm: [f64; 2],
    size_mm: [f64; 2],
    /// cos and sin for each fringe, by position, row by row.
    table: Vec<f32>,
    components: usize,
}

impl Search {
    /// Positions so dense that the phase of the finest fringe changes by less than a sixth of a period between them.
    pub fn new(optics: &Optics, carriers: &[[f64; 2]]) -> Self {
        let finest = carriers.iter().map(|k| k[0].hypot(k[1])).fold(1e-3, f64::max);
        let step = TAU / finest / 6.0;
        let [columns, rows] = optics.panel_size_mm.map(|side| ((side / step).ceil() as usize + 1).clamp(2, 400));
        let step_mm = [optics.panel_size_mm[0] / (columns - 1) as f64, optics.panel_size_mm[1] / (rows - 1) as f64];
        let mut new = Self {
            columns,
            rows,
            step_mm,
            size_mm: optics.panel_size_mm,
            table: Vec::new(),
            components: 2 * carriers.len(),
        };
        new.table = (0..columns * rows)
            .flat_map(|i| {
                let [x, y] = new.at(i % columns, i / columns);
                carriers.iter().flat_map(move |k| {
                    let (sin, cos) = (k[0] * x + k[1] * y).sin_cos();
                    [cos as f32, sin as f32]
                })
            })
            .collect();
        new
    }

    /// Number of positions.
    pub fn places(&self) -> usize {
        self.columns * self.rows
    }

    fn at(&self, column: usize, row: usize) -> [f64; 2] {
        [column as f64 * self.step_mm[0] - 0.5 * self.size_mm[0], row as f64 * self.step_mm[1] - 0.5 * self.size_mm[1]]
    }

    /// Correlates the responses of `N` pixels with all positions; `out` is ordered by position.
    pub fn correlate<const N: usize>(&self, answers: &[[f32; N]], out: &mut Vec<[f32; N]>) {
        out.clear();
        for row in self.table.chunks_exact(self.components) {
            let mut sum = [0.0_f32; N];
            for (factor, values) in row.iter().zip(answers) {
                for (s, v) in sum.iter_mut().zip(values) {
                    *s += factor * v;
                }
            }
            out.push(sum);
        }
    }

    /// The `N` highest peaks of a correlation, refined between positions.
    pub fn peaks<const N: usize>(&self, response: &[f32]) -> Vec<[f64; 2]> {
        let mut peaks: Vec<(f32, [f64; 2])> = Vec::with_capacity(4 * N);
        let value = |c: usize, r: usize| response[r * self.columns + c];
        for row in 0..self.rows {
            for column in 0..self.columns {
                let here = value(column, row);
                if here <= 0.0 {
                    continue;
                }
                let (left, right) = (column.saturating_sub(1), (column + 1).min(self.columns - 1));
                let (low, high) = (row.saturating_sub(1), (row + 1).min(self.rows - 1));
                let is_peak = (low..=high).all(|r| (left..=right).all(|c| value(c, r) <= here));
                if !is_peak {
                    continue;
                }
                let vertex = |a: f32, b: f32| {
                    let bend = 2.0 * here - a - b;
                    if bend > 0.0 { f64::from(0.5 * (b - a) / bend).clamp(-0.5, 0.5) } else { 0.0 }
                };
                let [x, y] = self.at(column, row);
                let dx = vertex(value(left, row), value(right, row)) * self.step_mm[0];
                let dy = vertex(value(column, low), value(column, high)) * self.step_mm[1];
                peaks.push((here, [x + dx, y + dy]));
            }
        }
        peaks.sort_by(|a, b| b.0.total_cmp(&a.0));
        peaks.into_iter().take(N).map(|p| p.1).collect()
    }
}
