//! Studies of lookup tables: summation methods for wide and subpixel orders, and the errors caused by violated
//! assumptions about the photographs.

mod job;
mod stress;

use job::{Job, Pattern};
use nacre_base::Result;
use nacre_lut::{MethodChoice, Settings};
use nacre_studies::{Axis, Effort, Outcome, Scene, Setting, Study};

/// Standard deviations of an order in pixels.
const WIDTHS_PX: [f64; 6] = [4.0, 2.5, 2.0, 1.5, 1.0, 0.6];
const REFERENCE: usize = 2;

/// Spacing of the orders in pixels, and wavelength of the photograph in nm.
const PITCH_PX: f64 = 32.0;
const BAND_NM: f64 = 680.0;

const METHODS: [(&str, &str, f64, MethodChoice); 11] = [
    ("auto", "auto, 1 %", 1.0, MethodChoice::Auto),
    ("auto", "auto, 0.1 %", 0.5, MethodChoice::Auto),
    ("rays", "rays 2 px", 2.0, MethodChoice::Rays(2.0)),
    ("rays", "rays 1 px", 1.0, MethodChoice::Rays(1.0)),
    ("rays", "rays 0.5 px", 0.5, MethodChoice::Rays(0.5)),
    ("single entries", "single 1 px", 1.0, MethodChoice::Single(1.0)),
    ("single entries", "single 0.5 px", 0.5, MethodChoice::Single(0.5)),
    ("fixed steps (paper)", "20 nm", 20.0, MethodChoice::Fixed(20.0)),
    ("fixed steps (paper)", "10 nm", 10.0, MethodChoice::Fixed(10.0)),
    ("fixed steps (paper)", "5 nm", 5.0, MethodChoice::Fixed(5.0)),
    ("fixed steps (paper)", "1 nm", 1.0, MethodChoice::Fixed(1.0)),
];

/// All studies of lookup tables.
pub(super) fn studies(effort: Effort) -> Vec<Study> {
    let mut all = vec![adding_up(effort)];
    all.extend(stress::studies(effort));
    all
}

/// Summation methods against the sharpness of the orders.
fn adding_up(effort: Effort) -> Study {
    let [pixels, entries] = effort.pick([1000, 512], [300, 128]);
    let setting = |(k, (family, name, knob, _)): (usize, &(&str, &str, f64, MethodChoice))| {
        let setting = Setting::new(family, *name, *knob);
        if k == 0 { setting.as_default() } else { setting }
    };
    Study {
        name: "lut",
        group: "lut",
        title: "Adding up a lookup table".into(),
        question: format!(
            "How fine must wavelengths or rays be? A photograph of {pixels} × {pixels} pixels with Gaussian orders {PITCH_PX} pixels apart, \
             and tables of {entries} × {entries} entries under equal energy, whose truth is summed up from the orders themselves. The \
             error is the root mean square of Y at the rim (beyond 0.6 of the extent), over the table's own there. A table counts as \
             confidently wrong when it is off by more than five times what it says."
        ),
        knob: Axis::log("step", "px or nm"),
        stress: Axis::log("standard deviation of an order", "px"),
        error: Axis::log("relative error at the rim", ""),
        time: Axis::log("time per table", "s"),
        predicted: "the error that the table says it has",
        settings: METHODS.iter().enumerate().map(setting).collect(),
        scenes: WIDTHS_PX.map(Scene::new).to_vec(),
        reference: REFERENCE,
        run: Box::new(move |setting, scene, seed| run(setting, WIDTHS_PX[scene], pixels, entries, seed)),
    }
}

fn run(setting: usize, sigma: f64, pixels: usize, entries: usize, seed: u64) -> Result<Outcome> {
    let job = Job::new(Pattern { sigma_px: sigma, ..Pattern::shallow(seed) }, pixels, seed);
    let max_error = if setting == 1 { 0.001 } else { 0.01 };
    let method = METHODS[setting].3;
    job.outcome(&Settings { size: entries, max_error, method, ..job.settings() }, None)
}
