//! Options that say which bench a command works on.

use crate::Failure;
use crate::rig::Place;
use nacre_processing::Error;
use nacre_sim::BenchConfig;
use std::path::PathBuf;
use tokio::runtime::Runtime;

/// Which bench.
#[derive(clap::Args, Clone)]
pub struct BenchArgs {
    /// Use the simulated bench.
    #[arg(long)]
    sim: bool,
    /// Description of the simulated bench (TOML); its defaults are used without it.
    #[arg(long, conflicts_with = "socket")]
    pub bench: Option<PathBuf>,
    /// Use the simulated bench that `nacre sim bench --socket` runs in a process of its own.
    #[arg(long, value_name = "SOCKET")]
    pub socket: Option<PathBuf>,
}

impl BenchArgs {
    /// Where the bench is that is to be driven.
    pub fn place(&self) -> Result<Place, Failure> {
        if self.sim {
            return self.described();
        }
        Err(Error::input("bench", "no real device can be driven yet", "give --sim for the simulated bench").into())
    }

    /// Where the bench is that plans are compared with: the simulated one also without `--sim`.
    pub fn described(&self) -> Result<Place, Failure> {
        Ok(match &self.socket {
            Some(path) => Place::Socket(path.clone()),
            None => Place::here(read_bench(self.bench.as_ref())?),
        })
    }
}

/// Reads a bench.toml; the default bench without one.
pub fn read_bench(path: Option<&PathBuf>) -> Result<BenchConfig, Failure> {
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

/// Runs the device calls of a command.
pub fn runtime() -> Result<Runtime, Failure> {
    let built = tokio::runtime::Builder::new_current_thread().enable_all().build();
    Ok(built.map_err(|e| Error::input("tokio", format!("cannot start: {e}"), "free some memory"))?)
}
