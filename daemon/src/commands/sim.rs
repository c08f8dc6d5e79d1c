//! `nacre sim`.

use crate::Failure;
use crate::console::Console;
use clap::Subcommand;
use nacre_processing::Error;
use nacre_processing::image::OutputFolder;
use nacre_sim::surface::SampleKind;
use nacre_sim::{Bench, BenchConfig, write_session};
use std::path::PathBuf;

/// Commands of the simulated bench.
#[derive(Subcommand)]
pub enum Sim {
    /// Render a polarization session's photographs and the truth into a folder.
    Render(Render),
}

/// Arguments of `nacre sim render`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre sim render --sample cd --out cd
  nacre sim render --bench bench.toml --angles-deg 0,45,90,135 --out session
  nacre sim render --sample logo --retardance-deg 10 --out filmed

Samples: kinematic, stars, polygons, circles, fireworks, logo, emblem, cd, stochastic.
Writes frames/, frames.json, truth.exr (orientation, period, purity) and bench.toml;
`nacre schema bench` lists all knobs.")]
pub struct Render {
    /// Description of the bench (TOML); its defaults are used without it.
    #[arg(long)]
    bench: Option<PathBuf>,
    #[command(flatten)]
    options: BenchOptions,
    /// Folder for the session.
    #[arg(long)]
    out: PathBuf,
    /// Replace a session that is already in the folder.
    #[arg(long)]
    force: bool,
}

/// The knobs of the bench that are most often turned; they override the bench file.
#[derive(clap::Args, Clone)]
pub struct BenchOptions {
    /// Sample on the table.
    #[arg(long, value_parser = sample)]
    sample: Option<SampleKind>,
    /// Seed of sample, defects and noise.
    #[arg(long)]
    pub seed: Option<u64>,
    /// Pixels per side of the photographs.
    #[arg(long)]
    size: Option<u32>,
    /// Retardance of the film over the grating in degrees.
    #[arg(long)]
    retardance_deg: Option<f64>,
    /// Analyser angles in degrees.
    #[arg(
        long,
        value_delimiter = ',',
        default_value = "0,15,30,45,60,75,90,105,120,135,150,165",
        allow_negative_numbers = true
    )]
    pub angles_deg: Vec<f64>,
}

fn sample(name: &str) -> Result<SampleKind, String> {
    let known = SampleKind::ALL;
    known
        .into_iter()
        .find(|k| k.name() == name)
        .ok_or_else(|| format!("no such sample; choose one of {}", known.map(|k| k.name()).join(", ")))
}

/// Runs a command of the simulated bench.
pub fn run(command: &Sim, console: &Console) -> Result<(), Failure> {
    let Sim::Render(args) = command;
    let config = args.options.apply(read_bench(args.bench.as_ref())?)?;
    let folder = OutputFolder::begin(&args.out, args.force)?;
    let mut bench = Bench::new(&config, console)?;
    let stale = write_session(&mut bench, &args.options.angles_deg, &folder, console)?;
    folder.commit()?;
    let frames = args.options.angles_deg.len();
    let text = format!(
        "{frames} photographs of the sample {} ({stale} stale frames dropped)\nsession   {}\nnext      nacre reconstruct \
         polarization {} --out result",
        config.sample.kind.name(),
        args.out.display(),
        args.out.display()
    );
    console.result(&text, &serde_json::json!({ "frames": frames, "stale_frames_dropped": stale, "out": args.out }));
    Ok(())
}

pub(super) fn read_bench(path: Option<&PathBuf>) -> Result<BenchConfig, Failure> {
    const LIMIT: u64 = 1 << 20;
    let Some(path) = path else { return Ok(BenchConfig::default()) };
    let remedy = "give a bench.toml; `nacre schema bench` lists its keys";
    let bad = |problem: String| Error::file(path, problem, remedy);
    let size = std::fs::metadata(path).map_err(|e| bad(format!("cannot be read: {e}")))?.len();
    if size > LIMIT {
        return Err(bad(format!("has {size} bytes, at most {LIMIT} are read")).into());
    }
    let text = std::fs::read_to_string(path).map_err(|e| bad(format!("cannot be read: {e}")))?;
    Ok(BenchConfig::from_toml(&text).map_err(bad)?)
}

impl BenchOptions {
    /// The bench with these options in place, checked.
    pub fn apply(&self, mut bench: BenchConfig) -> Result<BenchConfig, Failure> {
        if let Some(kind) = self.sample {
            bench.sample.kind = kind;
        }
        bench.seed = self.seed.unwrap_or(bench.seed);
        bench.film.retardance_deg = self.retardance_deg.unwrap_or(bench.film.retardance_deg);
        if let Some(size) = self.size {
            (bench.camera.width, bench.camera.height) = (size, size);
        }
        let check =
            bench.validate().and_then(|()| match self.angles_deg.iter().find(|a| !a.is_finite() || a.abs() > 1e6) {
                Some(bad) => Err(format!("angles-deg holds {bad}; give finite degrees")),
                None => Ok(()),
            });
        check.map_err(|problem| Error::input("bench", problem, "`nacre schema bench` lists all keys"))?;
        Ok(bench)
    }
}
