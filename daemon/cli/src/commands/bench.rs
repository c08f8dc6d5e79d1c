//! Options that select the bench.

use nacre_base::Error;
use nacre_base::text::read_text;
use nacre_capture::Failure;
use nacre_capture::calibrations::{Calibrations, Choice, MAX_AGE_DAYS};
use nacre_capture::rig::{Place, SimulatedBench};
use nacre_capture::setup::BenchSection;
use nacre_service::config::{Config, default_path};
use nacre_sim::BenchConfig;
use std::path::{Path, PathBuf};

/// Selection of the bench: configured devices or the simulated bench.
#[derive(clap::Args, Clone)]
pub struct BenchArgs {
    /// Use the simulated bench.
    #[arg(long)]
    pub sim: bool,
    /// Description of the simulated bench (TOML; default: built-in values).
    #[arg(long, conflicts_with = "socket")]
    pub bench: Option<PathBuf>,
    /// Use the simulated bench of a running `nacre sim bench --socket`.
    #[arg(long, value_name = "SOCKET")]
    pub socket: Option<PathBuf>,
    /// Configuration whose [bench] section describes the devices (default without --sim: nacre.toml).
    #[arg(long, conflicts_with_all = ["sim", "bench", "socket"])]
    pub config: Option<PathBuf>,
}

impl BenchArgs {
    /// Location of the bench to drive.
    pub fn place(&self) -> Result<Place, Failure> {
        if self.sim {
            return self.simulated();
        }
        match self.configuration() {
            Some(path) => place(&Config::read(Some(&path))?.bench, false),
            None => {
                Err(Error::input("bench", "is not described", "make a nacre.toml with `nacre init`, or give --sim")
                    .into())
            }
        }
    }

    /// Location of the bench whose limits a plan is checked against. Without a configuration this is the simulated
    /// bench, with or without `--sim`.
    pub fn described(&self) -> Result<Place, Failure> {
        if self.sim || self.configuration().is_none() { self.simulated() } else { self.place() }
    }

    /// True if `--socket`, `--bench` or `--config` is given; `--sim` alone does not count.
    pub fn is_given(&self) -> bool {
        self.socket.is_some() || self.bench.is_some() || self.config.is_some()
    }

    /// Calibrations for sessions: those of this folder, or those in the data folder of the configuration that describes
    /// the bench.
    pub fn calibrations(&self, folder: Option<&Path>) -> Result<Option<Choice>, Failure> {
        let config = self.configuration().map(|path| Config::read(Some(&path))).transpose()?;
        let max_age_days = config.as_ref().map_or(MAX_AGE_DAYS, |config| config.calibration.max_age_days);
        let of_data = config.map(|config| Calibrations::of_data(&config.data));
        let calibrations = folder.map(Calibrations::new).or(of_data);
        Ok(calibrations.map(|calibrations| Choice { calibrations, max_age_days }))
    }

    /// Path of the configuration file, if one is given or `nacre.toml` exists.
    fn configuration(&self) -> Option<PathBuf> {
        let simulated = self.sim || self.bench.is_some() || self.socket.is_some();
        self.config.clone().or_else(|| Some(default_path()).filter(|p| !simulated && p.exists()))
    }

    fn simulated(&self) -> Result<Place, Failure> {
        Ok(match &self.socket {
            Some(path) => SimulatedBench::Socket(path.clone()).into(),
            None => Place::here(read_bench(self.bench.as_ref())?),
        })
    }
}

/// Location of a configured bench. `real_time` makes a simulated bench in this process run at the pace of a real one.
pub fn place(section: &BenchSection, real_time: bool) -> Result<Place, Failure> {
    let simulated = match (section.sim, &section.socket) {
        (true, Some(socket)) => Some(SimulatedBench::Socket(socket.clone())),
        (true, None) => Some(SimulatedBench::Here { config: Box::new(read_bench(section.file.as_ref())?), real_time }),
        (false, _) if section.has_real_device() => None,
        (false, _) => {
            let remedy = "describe its devices under [bench] (`nacre devices` shows what there is), or give --sim";
            return Err(Error::input("bench", "has no devices", remedy).into());
        }
    };
    Ok(Place { simulated, section: section.clone(), page: None })
}

/// Reads a bench.toml; without a path, returns the default bench.
pub fn read_bench(path: Option<&PathBuf>) -> Result<BenchConfig, Failure> {
    let Some(path) = path else { return Ok(BenchConfig::default()) };
    let remedy = "give a bench.toml; `nacre schema bench` lists its keys";
    let text = read_text(path, super::MAX_BYTES, remedy)?;
    Ok(BenchConfig::from_toml(&text).map_err(|problem| Error::file(path, problem, remedy))?)
}
