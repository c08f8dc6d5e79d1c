//! Options that say which bench a command works on.

use nacre_base::Error;
use nacre_base::text::read_text;
use nacre_capture::Failure;
use nacre_capture::rig::{Place, SimulatedBench};
use nacre_capture::setup::BenchSection;
use nacre_service::config::{Config, default_path};
use nacre_sim::BenchConfig;
use std::path::PathBuf;

/// Which bench.
#[derive(clap::Args, Clone)]
pub struct BenchArgs {
    /// Use the simulated bench.
    #[arg(long)]
    pub sim: bool,
    /// Description of the simulated bench (TOML); its defaults are used without it.
    #[arg(long, conflicts_with = "socket")]
    pub bench: Option<PathBuf>,
    /// Use the simulated bench that `nacre sim bench --socket` runs in a process of its own.
    #[arg(long, value_name = "SOCKET")]
    pub socket: Option<PathBuf>,
    /// Configuration whose [bench] describes the devices (default without --sim: nacre.toml).
    #[arg(long, conflicts_with_all = ["sim", "bench", "socket"])]
    pub config: Option<PathBuf>,
}

impl BenchArgs {
    /// Where the bench is that is to be driven.
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

    /// Where the bench is that plans are compared with: without a configuration the simulated one, also without `--sim`.
    pub fn described(&self) -> Result<Place, Failure> {
        if self.sim || self.configuration().is_none() { self.simulated() } else { self.place() }
    }

    /// Whether it says which bench, and not only that it is simulated.
    pub fn is_given(&self) -> bool {
        self.socket.is_some() || self.bench.is_some() || self.config.is_some()
    }

    /// The configuration's file, if there is one.
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

/// Where the bench of a configuration is. A simulated one in this process is at the pace of a real one on request.
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

/// Reads a bench.toml; the default bench without one.
pub fn read_bench(path: Option<&PathBuf>) -> Result<BenchConfig, Failure> {
    let Some(path) = path else { return Ok(BenchConfig::default()) };
    let remedy = "give a bench.toml; `nacre schema bench` lists its keys";
    let text = read_text(path, super::MAX_BYTES, remedy)?;
    Ok(BenchConfig::from_toml(&text).map_err(|problem| Error::file(path, problem, remedy))?)
}
