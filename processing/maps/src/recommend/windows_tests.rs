//! Sheets with margins, on a dark table and in oblique view, and pictures without repetition.

use super::super::tests::{chance, photograph, polygon};
use super::super::{Advice, Need, Report, recommend};
use nacre_image::Palette;

const SIZE: [f64; 2] = [600.0, 440.0];

/// A picture of a sheet with 10 × 8 tiles.
#[derive(Clone, Copy)]
struct Sheet {
    seed: u64,
    /// Width of margin and of table around the sheet, relative to the picture's sides.
    margin: f64,
    table: f64,
    /// Grey levels of margin and table.
    grey: [f64; 2],
    /// Perspective: difference of distance between lower and upper end, and between right and left end, relative to the
    /// mean distance.
    askew: [f64; 2],
    /// Rotation in degrees.
    turn: f64,
}

const PLAIN: Sheet = Sheet { seed: 1, margin: 0.05, table: 0.0, grey: [0.95, 0.03], askew: [0.0; 2], turn: 0.0 };

impl Sheet {
    fn tile(self) -> [f64; 2] {
        let inner = 1.0 - 2.0 * (self.margin + self.table);
        [SIZE[0] * inner / 10.0, SIZE[1] * inner / 8.0]
    }

    fn grey_at(self, x: f64, y: f64) -> f64 {
        let [u, v] = [(x - 0.5 * SIZE[0]) / SIZE[0], (y - 0.5 * SIZE[1]) / SIZE[1]];
        // The same step in the picture spans less of the sheet towards the nearer end.
        let nearer = 1.0 + self.askew[1] * u + self.askew[0] * v;
        let (sin, cos) = self.turn.to_radians().sin_cos();
        let [a, b] = [(x - 0.5 * SIZE[0]) / nearer, (y - 0.5 * SIZE[1]) / nearer];
        let [a, b] = [a * cos + b * sin, b * cos - a * sin];
        let half = [0, 1].map(|k| 0.5 * SIZE[k] * (1.0 - 2.0 * self.table));
        if a.abs() > half[0] || b.abs() > half[1] {
            return self.grey[1];
        }
        let tile = self.tile();
        let print = [5.0 * tile[0], 4.0 * tile[1]];
        if a.abs() > print[0] || b.abs() > print[1] {
            return self.grey[0];
        }
        let at = [(a + print[0]).rem_euclid(tile[0]), (b + print[1]).rem_euclid(tile[1])];
        0.2 + 0.6 * chance(polygon(at, tile, self.seed), 3, self.seed)
    }

    fn recommended(self) -> Report {
        let home = photograph([SIZE[0] as usize, SIZE[1] as usize], &|x, y| self.grey_at(x, y));
        recommend(&home.path().join("a.png"), Need::Period, Palette::Cyclic).unwrap().0
    }

    /// Asserts that the detected tile is that of the sheet within a fraction of its size, and that this fraction of the
    /// 80 copies is found.
    fn is_found(self, within: f64, share: f64) {
        let report = self.recommended();
        let found = report.repeats.unwrap_or_else(|| panic!("{:?} {report:?}", self.askew));
        assert!(self.fits(&report, within), "{found:?} of {:?}", self.tile());
        assert!((80.0 * share..110.0).contains(&found.copies), "{found:?}");
        assert_eq!(report.advice, Advice::Flash, "{report:?}");
    }

    fn fits(self, report: &Report, within: f64) -> bool {
        let tile = self.tile();
        let (sin, cos) = self.turn.to_radians().sin_cos();
        let sides = [[tile[0] * cos, tile[0] * sin], [-tile[1] * sin, tile[1] * cos]];
        report.repeats.is_some_and(|r| {
            (0..2).all(|k| (r.sides_px[k][0] - sides[k][0]).hypot(r.sides_px[k][1] - sides[k][1]) < within * tile[k])
        })
    }
}

#[test]
fn margins_and_dark_tables_do_not_hide_a_tile() {
    for seed in [1, 2] {
        for margin in [0.02, 0.05, 0.1] {
            for grey in [[0.95, 0.03], [0.1, 0.95], [0.5, 0.02]] {
                Sheet { seed, margin, grey, ..PLAIN }.is_found(0.03, 0.55);
            }
            Sheet { seed, margin, table: 0.08, ..PLAIN }.is_found(0.03, 0.55);
        }
        Sheet { seed, margin: 0.0, table: 0.15, ..PLAIN }.is_found(0.03, 0.55);
    }
}

#[test]
fn sheets_are_seen_by_hand() {
    for (seed, askew, turn) in
        [(1, [0.1, 0.0], 0.0), (2, [0.0, 0.15], 3.0), (3, [0.15, -0.1], -8.0), (4, [0.25, 0.0], 5.0)]
    {
        Sheet { seed, askew, turn, table: 0.08, ..PLAIN }.is_found(0.1, 0.5);
    }
}

/// Steeper views reduce the number of copies found, but never yield a wrong tile.
#[test]
fn steep_views_fail_without_a_claim() {
    let mut found = 0;
    for k in 0..10 {
        let sheet = Sheet { askew: [0.1 * f64::from(k), 0.0], table: 0.05, ..PLAIN };
        let report = sheet.recommended();
        assert!(report.repeats.is_none() || sheet.fits(&report, 0.2), "{k}: {report:?}");
        found += usize::from(report.repeats.is_some());
    }
    assert!(found >= 3, "{found}");
}

#[test]
fn a_margin_around_a_single_motif_makes_no_tile() {
    for seed in 1..6 {
        let once = |x: f64, y: f64| {
            let inside = (30.0..570.0).contains(&x) && (25.0..415.0).contains(&y);
            if inside { 0.2 + 0.6 * chance(polygon([x, y], SIZE, seed), 3, seed) } else { 0.95 }
        };
        let home = photograph([600, 440], &once);
        let (report, _) = recommend(&home.path().join("a.png"), Need::Period, Palette::Cyclic).unwrap();
        assert!(report.repeats.is_none(), "{seed}: {report:?}");
        // Noise of several grain sizes.
        let grain = 1.0 + 3.0 * seed as f64;
        let noise = |x: f64, y: f64| chance((x / grain) as usize, (y / grain) as usize, seed);
        let home = photograph([600, 440], &noise);
        let (report, _) = recommend(&home.path().join("a.png"), Need::Period, Palette::Cyclic).unwrap();
        assert!(report.repeats.is_none(), "{seed}: {report:?}");
    }
}

#[test]
fn photographs_of_rooms_and_fields_repeat_nothing() {
    let data = std::env::var_os("NACRE_TEST_DATA").map_or_else(
        || std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"),
        std::path::PathBuf::from,
    );
    for name in
        ["hdr/stack_room_exp_3.jpg", "hdr/stack_room_exp_5.jpg", "envmaps/esplanade_zip.exr", "envmaps/studio_zip.exr"]
    {
        let path = data.join(name);
        if !path.exists() {
            println!("skipped: {} is not there", path.display());
            continue;
        }
        let (report, _) = recommend(&path, Need::Period, Palette::Cyclic).unwrap();
        assert!(report.repeats.is_none_or(|r| r.copies < 4.0) && report.advice != Advice::Flash, "{name}: {report:?}");
    }
}
