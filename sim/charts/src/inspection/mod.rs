//! Inspection of simulated sheets with planted defects: recall, precision and false alarms.

pub mod study;

use crate::shots::{metered, photograph};
use nacre_base::progress::Silent;
use nacre_base::{Error, Result};
use nacre_inspect::{Class, Inspection, Parameters, Sheet, inspect};
use nacre_polarimetry::{Model, Options, reconstruct};
use nacre_sim::random::{key, uniform};
use nacre_sim::surface::{DefectClass, PlantedDefect, Planting, Sample, SampleKind, Surface};
use nacre_sim::{Bench, BenchConfig};
use std::path::Path;
use std::time::Instant;

/// Sheets, used in turn.
pub const KINDS: [SampleKind; 8] = [
    SampleKind::Kinematic,
    SampleKind::Stars,
    SampleKind::Polygons,
    SampleKind::Circles,
    SampleKind::Fireworks,
    SampleKind::Mosaic,
    SampleKind::Logo,
    SampleKind::Emblem,
];

/// Rays per pixel along each axis.
const SUBSAMPLES: u32 = 8;

/// Distance in pixels up to which a region belongs to a planted defect: blur and registration.
const NEAR_PX: f64 = 2.0;

/// One sheet: its capture and its defects.
#[derive(Clone, Debug)]
pub struct Trial {
    /// Pattern of the sheet.
    pub kind: SampleKind,
    /// Side of the photographs in pixels.
    pub pixels: u32,
    /// Full well of the camera in electrons.
    pub well_e: f64,
    /// Area of each defect in pixels.
    pub area_px: f64,
    /// Number of defects.
    pub count: usize,
    /// Turn of the sample in degrees.
    pub turn_deg: f64,
    /// Shift of the sample in mm.
    pub shift_mm: [f64; 2],
    /// Seed of sheet, noise and defects.
    pub seed: u64,
}

/// Result of a trial.
#[derive(Clone, Debug)]
pub struct Judged {
    /// Planted class, and the class found; `None` for a defect that was not found.
    pub planted: Vec<(PlantedDefect, Option<Class>)>,
    /// Regions where nothing is planted.
    pub false_alarms: usize,
    /// Regions at planted defects.
    pub hits: usize,
    /// Largest statistic outside planted defects, and the threshold.
    pub largest: [f64; 2],
    /// Time of the inspection in s.
    pub seconds: f64,
    /// Error of turn (degrees) and shift (pixels) of the registration.
    pub misplaced: [f64; 2],
}

impl Trial {
    /// The `k`-th sheet of a series, turned by up to 3° and shifted by up to 5 mm.
    pub fn of(k: usize, seed: u64) -> Self {
        let random = |i: u64| 2.0 * uniform(key(&[seed, k as u64, i])) - 1.0;
        Self {
            kind: KINDS[k % KINDS.len()],
            pixels: 256,
            well_e: 20_000.0,
            area_px: 10.0,
            count: 10,
            turn_deg: 3.0 * random(1),
            shift_mm: [3.5 * random(2), 3.5 * random(3)],
            seed: key(&[seed, k as u64]),
        }
    }

    /// The bench with the clean sheet at rest.
    fn bench(&self) -> BenchConfig {
        let mut bench = BenchConfig { seed: key(&[self.seed, 1]), ..BenchConfig::default() };
        (bench.camera.width, bench.camera.height) = (self.pixels, self.pixels);
        // Pixels of cameras integrate: with fewer rays, edges have stairs that no camera shows.
        bench.camera.subsamples = SUBSAMPLES;
        bench.camera.well_e = self.well_e;
        (bench.sample.kind, bench.sample.seed) = (self.kind, Some(self.seed));
        bench
    }

    /// Side of a pixel on the sheet in mm.
    pub fn pixel_mm(&self) -> f64 {
        self.bench().sample.field_mm() / f64::from(self.pixels)
    }

    /// Defects that both captures show: those of gratings on gratings, the others on anything that reflects.
    fn planted(&self, bench: &BenchConfig) -> Vec<PlantedDefect> {
        let sample = Sample::new(&bench.sample, self.seed);
        let pixel_mm = sample.field_mm() / f64::from(self.pixels);
        let edge = 0.5 * sample.field_mm() - 6.0 * pixel_mm;
        let (sin, cos) = self.turn_deg.to_radians().sin_cos();
        let fits = |defect: &PlantedDefect| {
            let half = 0.5 * (defect.length_mm + defect.width_mm);
            let (s, c) = defect.direction_deg.to_radians().sin_cos();
            (-4..=4).all(|k| {
                let t = half * f64::from(k) / 4.0;
                let across = if k % 2 == 0 { 0.0 } else { 0.5 * defect.width_mm };
                let [x, y] = [defect.at_mm[0] + t * c - across * s, defect.at_mm[1] + t * s + across * c];
                let seen = [self.shift_mm[0] + x * cos - y * sin, self.shift_mm[1] + x * sin + y * cos];
                let surface = sample.at(x, y).surface;
                let fit = match defect.class {
                    DefectClass::Scratch | DefectClass::Dirt => surface != Surface::Nothing,
                    _ => matches!(surface, Surface::Grating { .. }),
                };
                fit && seen.iter().all(|v| v.abs() < edge)
            })
        };
        let planting = Planting {
            classes: DefectClass::ALL.to_vec(),
            count: self.count,
            area_mm2: self.area_px * pixel_mm * pixel_mm,
            scratch_mm: 0.7 * pixel_mm,
            half_mm: edge,
            gap_mm: 8.0 * pixel_mm,
        };
        planting.draw(self.seed, &fits)
    }

    /// Captures reference and sample into subfolders and reconstructs them; returns the planted defects.
    ///
    /// # Errors
    /// Those of capture and reconstruction.
    pub fn captured(&self, folder: &Path) -> Result<Vec<PlantedDefect>> {
        let reference = self.bench();
        let mut moved = reference.clone();
        moved.seed = key(&[self.seed, 2]);
        (moved.sample.turn_deg, moved.sample.shift_mm) = (self.turn_deg, self.shift_mm);
        moved.sample.planted = self.planted(&reference);
        if folder.join("sample").is_dir() {
            return Ok(moved.sample.planted);
        }
        let exposure_s = metered(Bench::new(&reference, &Silent)?);
        for (name, bench) in [("reference", &reference), ("sample", &moved)] {
            let input = folder.join(format!("{name}-photographs"));
            std::fs::create_dir_all(&input).map_err(|e| Error::output(&input, e))?;
            photograph(Bench::new(bench, &Silent)?, exposure_s, &input)?;
            let options = Options { model: Some(Model::Auto), ..Options::default() };
            reconstruct(&input, &folder.join(name), &options, &Silent)?;
        }
        Ok(moved.sample.planted)
    }

    /// Captures reference and sample, unless the folder holds them, and inspects the sample.
    ///
    /// # Errors
    /// Those of capture, reconstruction and inspection.
    pub fn judged(&self, folder: &Path, parameters: &Parameters) -> Result<(Judged, Inspection)> {
        let planted = self.captured(folder)?;
        let begun = Instant::now();
        let [reference, sample] = ["reference", "sample"].map(|name| Sheet::read(&folder.join(name)));
        let found = inspect(&reference?, &sample?, parameters, &Silent)?;
        let seconds = begun.elapsed().as_secs_f64();
        Ok((self.judge(&found, &planted, seconds), found))
    }

    fn judge(&self, found: &Inspection, planted: &[PlantedDefect], seconds: f64) -> Judged {
        let pixel_mm = self.pixel_mm();
        let (width, half) = (self.pixels as usize, 0.5 * f64::from(self.pixels) - 0.5);
        let distance_px = |defect: &PlantedDefect, i: usize| {
            let [x, y] = [(i % width) as f64 - half, half - (i / width) as f64].map(|v| v * pixel_mm);
            defect.distance_mm(x, y) / pixel_mm
        };
        let mut hit: Vec<bool> = vec![false; found.regions.defects.len()];
        let mut classes: Vec<Option<Class>> = vec![None; planted.len()];
        let mut largest = 0.0_f64;
        for (i, label) in found.regions.labels.iter().enumerate() {
            let mut near = false;
            for (defect, class) in planted.iter().zip(&mut classes) {
                let distance = distance_px(defect, i);
                near |= distance < 2.0 * NEAR_PX;
                if distance < NEAR_PX && *label > 0 {
                    hit[*label as usize - 1] = true;
                    *class = class.or(Some(found.regions.defects[*label as usize - 1].class));
                }
            }
            if !near {
                largest = largest.max(found.differences.statistic[i].into());
            }
        }
        let registration = &found.registration;
        let shift = [self.shift_mm[0] / pixel_mm, -self.shift_mm[1] / pixel_mm];
        let off = [0, 1].map(|k| registration.shift_px[k] - shift[k]);
        Judged {
            planted: planted.iter().cloned().zip(classes).collect(),
            false_alarms: hit.iter().filter(|h| !**h).count(),
            hits: hit.iter().filter(|h| **h).count(),
            largest: [largest, found.threshold],
            seconds,
            misplaced: [registration.turn_deg - self.turn_deg, off[0].hypot(off[1])],
        }
    }
}
