//! `nacre serve`, `nacre init` and `nacre token`.

use super::bench::{place, runtime};
use crate::Failure;
use crate::console::Console;
use crate::engine::Hands;
use crate::rig::{BenchSection, Rig};
use crate::service::config::{Config, Role, default_path};
use crate::service::serve;
use crate::session::sha256;
use nacre_processing::Error;
use nacre_processing::image::encode_png16_gray;
use nacre_processing::progress::Progress;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

/// Arguments of `nacre serve`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre serve --sim                         then open http://127.0.0.1:8465/
  nacre serve --config nacre.toml
  NACRE_SERVE_LISTEN=127.0.0.1:9000 nacre serve --sim

Listens on this machine only unless the configuration says otherwise, which needs a token
(`nacre token`). Ctrl-C ends it in order: a session in progress can be resumed, light is off.")]
pub struct Args {
    /// Use the simulated bench, at the pace of a real one.
    #[arg(long)]
    sim: bool,
    /// Description of the simulated bench (TOML).
    #[arg(long)]
    bench: Option<PathBuf>,
    /// Configuration (default: nacre.toml, where there is one).
    #[arg(long)]
    config: Option<PathBuf>,
    /// Address to listen on.
    #[arg(long)]
    listen: Option<SocketAddr>,
    /// Folder for sessions, results, catalogue and jobs.
    #[arg(long)]
    data: Option<PathBuf>,
}

/// Arguments of `nacre init`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre init --sim
  nacre init --sim --out /etc/nacre.toml")]
pub struct Init {
    /// Use the simulated bench.
    #[arg(long)]
    sim: bool,
    /// Where to write the configuration.
    #[arg(long, default_value = "nacre.toml")]
    out: PathBuf,
    /// Replace a configuration that is already there.
    #[arg(long)]
    force: bool,
}

/// Arguments of `nacre token`.
#[derive(clap::Args)]
#[command(after_help = "\
Example:
  nacre token anna --role operate >> nacre.toml

The token itself is printed once, on standard error; the configuration keeps its hash only.")]
pub struct Token {
    /// Whose it is.
    name: String,
    /// What it allows.
    #[arg(long, value_enum, default_value_t = Role::Operate)]
    role: Role,
}

/// Runs the service until Ctrl-C.
pub fn run(args: &Args, console: &Console) -> Result<(), Failure> {
    let path = args.config.clone().or_else(|| Some(default_path()).filter(|p| p.exists()));
    let mut config = Config::read(path.as_deref())?;
    config.listen = args.listen.unwrap_or(config.listen);
    config.data = args.data.clone().unwrap_or(config.data);
    config.bench.sim |= args.sim;
    config.bench.file = args.bench.clone().or(config.bench.file);
    config.check_access()?;
    let place = place(&config.bench, true)?;
    let built = tokio::runtime::Builder::new_multi_thread().enable_all().build();
    let runtime = built.map_err(|e| Error::input("tokio", format!("cannot start: {e}"), "free some memory"))?;
    let interrupted = console.interrupted();
    let stop = async move {
        while interrupted.load(std::sync::atomic::Ordering::Relaxed) == 0 {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    let ready = |address| console.note(&format!("Nacre is at http://{address}/  (Ctrl-C ends it)"));
    runtime.block_on(serve(config, place, ready, stop))
}

/// Finds the devices, takes one trial frame and writes a configuration.
pub fn init(args: &Init, console: &Console) -> Result<(), Failure> {
    if args.out.exists() && !args.force {
        return Err(Error::file(&args.out, "is already there", "choose another --out, or --force").into());
    }
    let config = Config { bench: BenchSection { sim: args.sim, ..BenchSection::default() }, ..Config::default() };
    let place = place(&config.bench, true)?;
    let runtime = runtime()?;
    let mut rig = Rig::open(&runtime, &place, console, &console.interrupted())?;
    let ids = rig.ids.join(", ");
    let mut hands = Hands::new(&mut rig.devices);
    let frame = runtime.block_on(async {
        hands.expose(Duration::from_millis(10), 1.0).await?;
        hands.fresh().await
    })?;
    console.check()?;
    let png = encode_png16_gray(frame.0.width, frame.0.height, &frame.0.codes);
    let trial = args.out.with_extension("trial.png");
    png.and_then(|png| std::fs::write(&trial, png)).map_err(|e| Error::output(&trial, e))?;
    let text = toml::to_string(&config).map_err(|e| Error::input("configuration", e, "report this"))?;
    let text = format!("# Configuration of `nacre serve`; `nacre schema config` lists all keys.\n{text}");
    std::fs::write(&args.out, text).map_err(|e| Error::output(&args.out, e))?;
    let message = format!(
        "devices   {ids}\nframe     {} ({} × {} pixels)\nwrote     {}\nnext      nacre serve --config {}",
        trial.display(),
        frame.0.width,
        frame.0.height,
        args.out.display(),
        args.out.display()
    );
    console.result(&message, &serde_json::json!({ "devices": rig.ids, "trial": trial, "config": args.out }));
    Ok(())
}

/// Makes a token.
pub fn token(args: &Token, console: &Console) -> Result<(), Failure> {
    let mut bytes = [0_u8; 32];
    let random = std::fs::File::open("/dev/urandom").and_then(|mut f| std::io::Read::read_exact(&mut f, &mut bytes));
    random.map_err(|e| Error::input("/dev/urandom", e, "make random numbers available"))?;
    let token: String = bytes.iter().map(|b| format!("{b:02x}")).collect();
    let (role, hash) = (crate::plan::word(args.role), sha256(token.as_bytes()));
    let name = args.name.replace(['"', '\\'], "").replace(char::is_control, "");
    console.note(&format!("the token, which is not kept anywhere: {token}"));
    let text = format!("\n[[tokens]]\nname = \"{name}\"\nrole = \"{role}\"\nsha256 = \"{hash}\"");
    console.result(&text, &serde_json::json!({ "name": name, "role": role, "sha256": hash }));
    Ok(())
}
