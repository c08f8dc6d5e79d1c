//! Labels of data points, placed without overlap.

use super::svg::{Anchor, Area, Svg, bold_width, text_width};

/// Places labels beside their points.
pub struct Labels {
    taken: Vec<Area>,
    bounds: Area,
}

impl Labels {
    /// Creates a layout whose labels stay within `bounds` and keep off `points`.
    pub fn new(bounds: Area, points: &[[f64; 2]]) -> Self {
        let around = |p: &[f64; 2]| Area::new(p[0] - 6.0, p[1] - 6.0, 12.0, 12.0);
        Self { taken: points.iter().map(around).collect(), bounds }
    }

    /// Makes labels keep off a horizontal or vertical line, where possible.
    pub fn avoid(&mut self, from: [f64; 2], to: [f64; 2]) {
        let corner = [from[0].min(to[0]) - 1.0, from[1].min(to[1]) - 1.0];
        self.taken.push(Area::new(corner[0], corner[1], (from[0] - to[0]).abs() + 2.0, (from[1] - to[1]).abs() + 2.0));
    }

    /// Draws a label at the position around `point` with the least overlap, with a leader line if it is far away.
    pub fn place(&mut self, svg: &mut Svg, point: [f64; 2], text: &str, size: f64, bold: bool, style: &str) {
        let (width, weight) =
            if bold { (bold_width(text, size), " font-weight=\"bold\"") } else { (text_width(text, size), "") };
        let (w, h) = (width, 1.15 * size);
        let mut best: Option<(f64, Area)> = None;
        for ring in 0..6 {
            let gap = 10.0 + 14.0 * f64::from(ring);
            for (dx, dy) in
                [(1.0, 0.0), (0.7, -0.7), (0.7, 0.7), (-1.0, 0.0), (0.0, -1.0), (0.0, 1.0), (-0.7, -0.7), (-0.7, 0.7)]
            {
                let x = point[0] + gap * dx + w * (dx.signum() * f64::from(dx != 0.0) - 1.0) / 2.0;
                let y = point[1] + gap * dy + h * (dy - 1.0) / 2.0;
                let area = Area::new(x, y, w, h);
                let covered: f64 = self.taken.iter().map(|t| area.overlap(t)).sum();
                let outside = w * h - area.overlap(&self.bounds);
                let cost = covered + 4.0 * outside + 25.0 * f64::from(ring);
                if best.is_none_or(|(least, _)| cost < least - 1e-9) {
                    best = Some((cost, area));
                }
            }
        }
        if let Some((_, area)) = best {
            self.taken.push(area);
            let middle = [area.x + w / 2.0, area.y + h / 2.0];
            if (middle[0] - point[0]).hypot(middle[1] - point[1]) > 22.0 + w / 2.0 {
                svg.line(point, [middle[0].clamp(area.x, area.x + w), middle[1]], "stroke=\"#c3cad3\"");
            }
            svg.text_on_lines([area.x, area.y + 0.82 * h], text, size, Anchor::Start, &format!("{style}{weight}"));
        }
    }
}

/// Moves positions apart to a distance of at least `gap`, within `low` and `high`, without changing their order.
pub fn spread_out(wanted: &[f64], gap: f64, low: f64, high: f64) -> Vec<f64> {
    let mut order: Vec<usize> = (0..wanted.len()).collect();
    order.sort_by(|&a, &b| wanted[a].total_cmp(&wanted[b]));
    let mut places = wanted.to_vec();
    let mut least = low;
    for &i in &order {
        places[i] = places[i].max(least);
        least = places[i] + gap;
    }
    let mut most = high;
    for &i in order.iter().rev() {
        places[i] = places[i].min(most);
        most = places[i] - gap;
    }
    places
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_keep_their_distance_and_order() {
        let places = spread_out(&[10.0, 11.0, 90.0, 10.5], 10.0, 0.0, 95.0);
        assert_eq!(places, [10.0, 30.0, 90.0, 20.0]);
        assert_eq!(spread_out(&[94.0, 95.0], 10.0, 0.0, 95.0), [85.0, 95.0]);
    }

    #[test]
    fn labels_do_not_cover_each_other() {
        let mut svg = Svg::new(400.0, 300.0);
        let points = [[100.0, 100.0], [103.0, 101.0], [106.0, 99.0]];
        let mut labels = Labels::new(Area::new(0.0, 0.0, 400.0, 300.0), &points);
        points.iter().for_each(|p| labels.place(&mut svg, *p, "12 frames", 12.0, true, ""));
        let placed = &labels.taken[3..];
        for (i, a) in placed.iter().enumerate() {
            assert!(placed[i + 1..].iter().all(|b| a.overlap(b) < 1.0), "{placed:?}");
        }
    }
}
