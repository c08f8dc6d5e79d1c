//! `nacre serve`, `nacre init` and `nacre token`.

use super::bench::place;
use crate::console::Console;
use nacre_base::Error;
use nacre_capture::Failure;
use nacre_capture::session::sha256;
use nacre_capture::setup::BenchSection;
use nacre_service::config::{Config, Role, Source, default_path};
use nacre_service::serve;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// Polling interval for signals.
const SIGNALS: Duration = Duration::from_millis(20);

/// Time for an orderly shutdown after the first signal.
const IN_ORDER: Duration = Duration::from_secs(4);

/// Time for threads to end after that, or after a second signal.
const AT_ONCE: Duration = Duration::from_millis(500);

/// Arguments of `nacre serve`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre serve --sim                         then open http://127.0.0.1:8465/
  nacre serve --config nacre.toml
  NACRE_SERVE_LISTEN=127.0.0.1:9000 nacre serve --sim

By default, listens on this machine only. Access from other machines needs a token (`nacre token`).
Ctrl-C or SIGTERM stops the service in order within 5 s: the light is off, and a session in
progress can be resumed. A second signal stops it at once.")]
pub struct Args {
    /// Use the simulated bench at the pace of a real one.
    #[arg(long)]
    sim: bool,
    /// Description of the simulated bench (TOML; default: built-in values).
    #[arg(long)]
    bench: Option<PathBuf>,
    /// Configuration (default: nacre.toml, if it exists).
    #[arg(long)]
    config: Option<PathBuf>,
    /// Address and port to listen on.
    #[arg(long)]
    listen: Option<SocketAddr>,
    /// Folder for sessions, results, catalogue and jobs.
    #[arg(long)]
    data: Option<PathBuf>,
}

/// Arguments of `nacre token`.
#[derive(clap::Args)]
#[command(after_help = "\
Example:
  nacre token anna --role operate >> nacre.toml

Prints the token once, on standard error. The configuration stores only its hash.")]
pub struct Token {
    /// Name of the token's owner.
    name: String,
    /// Role of the owner.
    #[arg(long, value_enum, default_value_t = Role::Operate)]
    role: Role,
}

/// Runs the service until Ctrl-C.
pub fn run(args: &Args, console: &Console) -> Result<(), Failure> {
    let path = args.config.clone().or_else(|| Some(default_path()).filter(|p| p.exists()));
    let mut config = Config::read(path.as_deref())?;
    let file = path.unwrap_or_else(default_path);
    let source = Source { file: std::path::absolute(&file).unwrap_or(file), read: config.clone() };
    config.listen = args.listen.unwrap_or(config.listen);
    config.data = args.data.clone().unwrap_or(config.data);
    if args.sim && !config.bench.sim {
        // `--sim` must move no real device, whatever the configuration describes.
        config.bench = BenchSection { sim: true, ..BenchSection::default() };
    }
    config.bench.file = args.bench.clone().or(config.bench.file);
    let wrong = |problem| Error::input("bench", problem, "`nacre schema config` lists all keys");
    config.bench.check().map_err(wrong)?;
    if config.bench.by_hand() && !std::io::IsTerminal::is_terminal(&std::io::stdin()) {
        let remedy = "start the service in a terminal, where Enter says that it is turned";
        return Err(Error::input("bench.stage", "is turned by hand, but nobody can be asked", remedy).into());
    }
    config.check_access()?;
    let place = place(&config.bench, true)?;
    let built = tokio::runtime::Builder::new_multi_thread().enable_all().build();
    let runtime = built.map_err(|e| Error::input("tokio", format!("cannot start: {e}"), "free some memory"))?;
    let interrupted = console.interrupted();
    let asked = async |times| {
        while interrupted.load(Ordering::Relaxed) < times {
            tokio::time::sleep(SIGNALS).await;
        }
    };
    let ready = |address, problems: &[String]| {
        console.note(&format!("Nacre is at http://{address}/  (Ctrl-C ends it)"));
        problems.iter().for_each(|problem| console.note(&format!("warning: {problem}")));
    };
    let result = runtime.block_on(async {
        let cut = async {
            asked(1).await;
            // Leaves the command that switches the light off enough time before the runtime is stopped.
            tokio::time::sleep(2 * SIGNALS).await;
            let _ = tokio::time::timeout(IN_ORDER, asked(2)).await;
        };
        tokio::select! {
            biased;
            result = serve(config, source, place, ready, asked(1)) => result,
            () = cut => Ok(()),
        }
    });
    // The command that switches the light off may still run; all other tasks end with the process.
    runtime.shutdown_timeout(AT_ONCE);
    result
}

/// Generates a token.
pub fn token(args: &Token, console: &Console) -> Result<(), Failure> {
    let mut bytes = [0_u8; 32];
    let random = std::fs::File::open("/dev/urandom").and_then(|mut f| std::io::Read::read_exact(&mut f, &mut bytes));
    random.map_err(|e| Error::input("/dev/urandom", e, "make random numbers available"))?;
    let token: String = bytes.iter().map(|b| format!("{b:02x}")).collect();
    let (role, hash) = (nacre_capture::plan::word(args.role), sha256(token.as_bytes()));
    let name = args.name.replace(['"', '\\'], "").replace(char::is_control, "");
    console.note(&format!("the token, which is not kept anywhere: {token}"));
    let text = format!("\n[[tokens]]\nname = \"{name}\"\nrole = \"{role}\"\nsha256 = \"{hash}\"");
    console.result(&text, &serde_json::json!({ "name": name, "role": role, "sha256": hash }));
    Ok(())
}
