//! `nacre calibrate panel`.

use crate::commands::bench::BenchArgs;
use crate::commands::manual::with_controller;
use crate::console::Console;
use nacre_base::{Error, vacant};
use nacre_capture::Failure;
use nacre_capture::engine::{BenchController, LEVELS, drawn_by, measure_panel};
use nacre_capture::rig::{Use, Uses};
use nacre_drivers::display::POWER_LAW;
use nacre_image::write_whole;
use std::path::PathBuf;

/// Arguments of `nacre calibrate panel`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre calibrate panel --sim --out panel.json
  nacre calibrate panel --config nacre.toml --levels 52 --out panel.json

Shows uniform grey levels from black to white and back, then switches between black and white. Put white paper in the
place of the sample, so that the camera sees the panel's light, and exclude other light. The camera must be linear
(`nacre init` measures that). Prints the settings for nacre.toml and for plans.")]
pub struct Panel {
    #[command(flatten)]
    bench: BenchArgs,
    /// Number of grey levels: 6, 16, 18, 52 or 86, whose codes are integers.
    #[arg(long, default_value_t = 16, value_parser = levels)]
    levels: usize,
    /// Measured tone curve and timing (JSON).
    #[arg(long, value_name = "FILE.json")]
    out: PathBuf,
    /// Replace an existing file.
    #[arg(long)]
    force: bool,
}

fn levels(text: &str) -> Result<usize, String> {
    let known = text.parse().ok().filter(|n| LEVELS.contains(n));
    known.ok_or_else(|| format!("{text:?} levels have no whole codes; give 6, 16, 18, 52 or 86"))
}

impl Panel {
    /// Measures tone curve and timing, and writes them.
    pub fn run(&self, console: &Console) -> Result<(), Failure> {
        vacant(std::slice::from_ref(&self.out), self.force)?;
        let place = self.bench.place()?;
        let display = place.section.display.as_ref();
        let drawn = display.and_then(drawn_by);
        let work =
            async |controller: &mut BenchController<'_>| measure_panel(controller, self.levels, drawn, console).await;
        let uses = Uses { camera: Use::Always, display: Use::Always, ..Uses::NONE };
        let found = with_controller(&place, uses, console, work)?;
        let (tone, advice) = (found.tone(), found.advice(display));
        let mut json = serde_json::to_value(&found).map_err(|e| Error::output(&self.out, e.into()))?;
        json["tone"] = serde_json::to_value(&tone).map_err(|e| Error::output(&self.out, e.into()))?;
        json["advice"] = advice.as_slice().into();
        write_whole(&self.out, format!("{json:#}\n").as_bytes())?;
        let law = &found.law;
        let fits = if law.deviation <= POWER_LAW { "" } else { ": no power law" };
        let mut text = format!(
            "panel     luminance grows with the code to the power {:.4} ± {:.4}, within {:.2} % of white{fits}\nblack     {:.2} % of white; \
             drift {:.2} %\nseen      by {} pixels, exposure {:.2} ms\n",
            law.gamma,
            law.gamma_sigma,
            100.0 * law.deviation,
            100.0 * law.black,
            100.0 * found.drift,
            found.pixels,
            found.exposure_ms
        );
        advice.iter().for_each(|line| text += &format!("advice    {line}\n"));
        text += &format!("wrote     {}", self.out.display());
        console.result(&text, &json);
        Ok(())
    }
}
