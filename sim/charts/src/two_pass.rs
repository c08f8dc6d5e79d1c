//! Study of pictures rendered from lookup tables in a room: two passes at several ranks, against sampling.

use super::environment::{EXTENT, Last, Pattern, room};
use super::render::{broken, outcome};
use nacre_base::Result;
use nacre_base::progress::Silent;
use nacre_image::{Attribute, write_exr};
use nacre_optics::color::xyz_of_linear_srgb;
use nacre_render::{Method, Picture, Scene, Settings, render};
use nacre_studies::{Axis, Effort, Outcome, Scene as Stress, Setting, Study};
use std::fmt::Write;
use std::path::Path;
use tempfile::TempDir;

/// Ranks of the factorised table, as in the 2017 CVMP paper.
const RANKS: [usize; 4] = [1, 3, 10, 21];

/// Target errors of the sampling methods.
const ASKED: [f64; 3] = [0.3, 0.1, 0.03];

/// Ratio of the smallest target error to that of the reference picture.
const TRUTH: f64 = 3.0;

/// Entries along a side of the table, width of its streaks and size of the lamps.
const ENTRIES: usize = 128;
const STREAK: f64 = 0.03;
const LAMP_DEG: f64 = 6.0;

/// Names and shapes.
const SHAPES: [(&str, &str); 4] = [
    ("plane", "type = \"plane\"\nsize = [100, 100]\nnormal = [0.2, 0.1, 1]"),
    (
        "rolled sheet",
        "type = \"cylinder\"\ncenter = [0, 0, -150]\naxis = [0, 1, 0]\nstart = [0, 0, 1]\nradius = 150\nlength = 90\narc_deg = [-18, 18]",
    ),
    ("bowl", "type = \"mesh\"\nfile = \"bowl.obj\""),
    ("sphere", "type = \"sphere\"\ncenter = [0, 0, 0]\nradius = 50\naxis = [0, 1, 0]\nstart = [0, 0, 1]"),
];

/// Files of a scene, and its reference picture.
struct Sample {
    folder: TempDir,
    scene: Scene,
    truth: Picture,
}

impl Sample {
    fn new(shape: &str, side: usize, seed: u64) -> Result<Self> {
        let folder = tempfile::tempdir().map_err(|e| broken("temporary folder", e))?;
        files(folder.path(), seed)?;
        let text = format!(
            "[camera]\nposition = [40, 60, 600]\ntarget = [0, 0, 0]\nfov_deg = 10\nwidth = {side}\nheight = {side}\n[[shape]]\n{shape}\n\
             material = \"m\"\n[[light]]\ntype = \"environment\"\nfile = \"room.exr\"\nvisible = false\n[material.m.diffraction]\n\
             type = \"table\"\nfile = \"lut.exr\"\n"
        );
        let scene = toml::from_str(&text).map_err(|e| broken("scene", e))?;
        let mut sample = Self { folder, scene, truth: Picture::default() };
        let finest = ASKED.iter().copied().fold(1.0, f64::min);
        sample.truth = sample.picture(Method::Samples, finest / TRUTH, None)?.0;
        Ok(sample)
    }

    /// A picture, its computing time in s, and the error in its report.
    fn picture(&self, method: Method, max_error: f64, rank: Option<usize>) -> Result<(Picture, f64, f64)> {
        let settings = Settings { method, max_error, rank, samples: 1 << 16, ..Settings::default() };
        let (picture, report) = render(&self.scene, self.folder.path(), &settings, &Silent)?;
        Ok((picture, report.seconds, report.noise.hypot(report.predicted_model_error)))
    }
}

/// Writes an environment, a table of two crossed streaks, and a bowl curved in both directions.
fn files(folder: &Path, seed: u64) -> Result<()> {
    let room = room(256, LAMP_DEG, seed)?;
    write_exr(&folder.join("room.exr"), room.width, room.height, &["R", "G", "B"], &[], &|c, y, row| {
        row.iter_mut().zip(&room.rgb[y * room.width..]).for_each(|(out, rgb)| *out = rgb[c]);
    })?;
    let table = Pattern::Streaks(&[45.0, 135.0]).table(ENTRIES, STREAK)?;
    let xyz: Vec<[f32; 3]> = table.rgb.iter().map(|rgb| xyz_of_linear_srgb(*rgb)).collect();
    let extent = EXTENT.to_string();
    let light = [("extent", extent.as_str()), ("warp", "1"), ("illuminant", "D65")];
    let light = light.map(|(name, value)| (name, Attribute::Text(value.into())));
    write_exr(&folder.join("lut.exr"), ENTRIES, ENTRIES, &["X", "Y", "Z"], &light, &|c, y, row| {
        row.iter_mut().zip(&xyz[y * ENTRIES..]).for_each(|(out, xyz)| *out = xyz[c]);
    })?;
    let n = 32;
    let mut text = String::new();
    for i in 0..(n + 1) * (n + 1) {
        let [u, v] = [i % (n + 1), i / (n + 1)].map(|k| k as f64 / n as f64);
        let [x, y] = [u, v].map(|w| 100.0 * (w - 0.5));
        let z = -0.0012 * x * x - 0.0008 * y * y;
        let _ = writeln!(text, "v {x} {y} {z}\nvt {u} {v}\nvn {} {} 1", 0.0024 * x, 0.0016 * y);
    }
    for i in 0..n * n {
        let a = i / n * (n + 1) + i % n + 1;
        let [a, b, c, d] = [a, a + 1, a + n + 2, a + n + 1].map(|k| format!("{k}/{k}/{k}"));
        let _ = writeln!(text, "f {a} {b} {c} {d}");
    }
    std::fs::write(folder.join("bowl.obj"), text).map_err(|e| broken("bowl.obj", e))
}

pub(super) fn study(effort: Effort) -> Study {
    let side = effort.pick(96, 32);
    let ranks = RANKS.map(|r| {
        let setting = Setting::new("two passes", format!("rank {r}"), r as f64);
        if r == 3 { setting.as_default() } else { setting }
    });
    let asked = |name: &'static str| {
        ASKED.map(|e| {
            let setting = Setting::new(name, format!("{:.0} %", 100.0 * e), 100.0 * e);
            if e == 0.1 { setting } else { setting.without_sweep() }
        })
    };
    let last = Last::new();
    Study {
        name: "render-two-pass",
        group: "render",
        title: "Tables in a room by two passes".into(),
        question: format!(
            "Pictures of {side} × {side} pixels of a table of two crossed streaks in a room with lamps of {LAMP_DEG}°, on a plane, a rolled sheet, a bowl (a \
             mesh) and a sphere: by lookups in environments that two passes filter at several ranks; by samples of the whole integral to several errors; \
             or as the program chooses at these. The error is the root mean square of differences from a picture by samples that is {TRUTH} times as exact as the \
             finest, over its mean; times are of everything."
        ),
        knob: Axis::log("rank, or error asked for in %", ""),
        stress: Axis::names("shape"),
        error: Axis::log("error of the picture", ""),
        time: Axis::log("time", "s"),
        predicted: "noise and measured error, as the report has them",
        settings: ranks.into_iter().chain(asked("samples")).chain(asked("as it chooses")).collect(),
        scenes: SHAPES.iter().enumerate().map(|(k, s)| Stress::named(k, s.0)).collect(),
        reference: 1,
        run: Box::new(move |setting, at, seed| {
            let sample = last.get(at, seed, || Sample::new(SHAPES[at].1, side, seed))?;
            let finest = ASKED.iter().copied().fold(1.0, f64::min);
            let (found, seconds, predicted) = match setting.checked_sub(RANKS.len()) {
                None => sample.picture(Method::TwoPass, finest, Some(RANKS[setting]))?,
                Some(k) if k < ASKED.len() => sample.picture(Method::Samples, ASKED[k], None)?,
                Some(k) => sample.picture(Method::Auto, ASKED[k - ASKED.len()], None)?,
            };
            Ok(Outcome { predicted: Some(predicted), ..outcome(&found, &sample.truth, seconds) })
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A higher rank approaches the full integral, and the reported error matches that of the picture.
    #[test]
    fn ranks_approach_the_integral() {
        let study = study(Effort::Quick);
        let [one, ten] = [0, 2].map(|setting| (study.run)(setting, 1, 5).unwrap());
        let [one, ten, said] = [one.error, ten.error, ten.predicted].map(Option::unwrap);
        assert!(ten < 0.8 * one && ten < 1.3 * said, "{one} {ten} {said}");
    }
}
