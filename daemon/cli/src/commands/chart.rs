//! `nacre chart`.

use crate::console::Console;
use nacre_base::Error;
use nacre_capture::Failure;
use nacre_studies::{ChartFormat, Charted, Effort, Picture, Plan, Request, Study, Width, chart, gpu, polarimetry};
use serde::Serialize;
use sha2::{Digest, Sha256};
use std::fmt::Write;
use std::path::PathBuf;

/// Arguments of `nacre chart`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre chart --list                             list the charts
  nacre chart all --out charts                   all charts; open charts/index.html
  nacre chart polarimetry stress --out charts    two groups
  nacre chart frames --out charts --quick        quick check of one study
  nacre chart frames --out charts --width single --no-titles    for a journal column

Every chart gets a subfolder with raw.jsonl (every measurement), CSV, JSON, SVG, PDF and PNG.
Ctrl-C loses nothing: the same command resumes where it stopped.")]
pub struct Args {
    /// Names of charts or chart groups, or `all`; --list shows them.
    #[arg(default_value = "all")]
    names: Vec<String>,
    /// Folder for the charts; other charts in it are kept.
    #[arg(long, required_unless_present = "list")]
    out: Option<PathBuf>,
    /// Random seed of all scenes.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Measurements per setting and scene (at least 5, or 3 with --quick).
    #[arg(long)]
    runs: Option<usize>,
    /// Use small scenes and few runs: a functional check, not a result.
    #[arg(long)]
    quick: bool,
    /// Chart width: page (1280 px), single (85 mm, one journal column, panels stacked) or double (178 mm, two columns).
    /// Redraws without measuring.
    #[arg(long, value_name = "page|single|double", default_value = "page")]
    width: Width,
    /// Omit chart titles, for figures with a caption.
    #[arg(long)]
    no_titles: bool,
    /// List names and titles.
    #[arg(long)]
    list: bool,
    /// Repeat measurements that the folder already holds.
    #[arg(long)]
    force: bool,
}

/// One line of the list.
#[derive(Serialize)]
struct Listed {
    name: String,
    group: String,
    title: String,
}

/// Lists the charts, or measures and draws them.
pub fn run(args: &Args, console: &Console) -> Result<(), Failure> {
    let effort = if args.quick { Effort::Quick } else { Effort::Full };
    let (mut studies, mut pictures) = (polarimetry::studies(effort), polarimetry::pictures());
    studies.extend(nacre_sim_charts::studies(effort));
    studies.extend(gpu::studies(effort));
    pictures.extend(gpu::pictures());
    let listed = list(&studies, &pictures);
    if args.list {
        console.result(&text_of(&listed), &listed);
        return Ok(());
    }
    check_names(&args.names, &listed)?;
    let wanted = |name: &str, group: &str| args.names.iter().any(|n| n == "all" || n == name || n == group);
    studies.retain(|s| wanted(s.name, s.group));
    pictures.retain(|p| wanted(p.name, p.group));
    let least = effort.pick(5, 3);
    let runs = args.runs.unwrap_or(least);
    if runs < least {
        return Err(Error::input(
            "--runs",
            format!("{runs} measurements give no quartiles"),
            format!("give at least {least}"),
        )
        .into());
    }
    let Some(out) = args.out.as_deref() else {
        return Err(Error::input("--out", "is missing", "name a folder").into());
    };
    let plan = Plan { seed: args.seed, runs, effort, version: version() };
    let format = ChartFormat { titles: !args.no_titles, width: args.width };
    let request = Request { out, force: args.force, plan, format, studies: &studies, pictures: &pictures };
    let charted = chart(&request, console)?;
    let drawn: Vec<&str> = studies.iter().map(|s| s.name).chain(pictures.iter().map(|p| p.name)).collect();
    console.result(&summary(&charted, &drawn, out), &charted);
    Ok(())
}

fn list(studies: &[Study], pictures: &[Picture]) -> Vec<Listed> {
    let studies = studies.iter().map(|s| (s.name, s.group, s.title.as_str()));
    let all = studies.chain(pictures.iter().map(|p| (p.name, p.group, p.title)));
    all.map(|(name, group, title)| Listed { name: name.into(), group: group.into(), title: title.into() }).collect()
}

fn text_of(listed: &[Listed]) -> String {
    listed.iter().fold(format!("{:24} {:12} TITLE\n", "NAME", "GROUP"), |mut text, l| {
        let _ = writeln!(text, "{:24} {:12} {}", l.name, l.group, l.title);
        text
    })
}

fn check_names(names: &[String], listed: &[Listed]) -> Result<(), Failure> {
    let known = |name: &str| name == "all" || listed.iter().any(|l| l.name == name || l.group == name);
    let Some(unknown) = names.iter().find(|n| !known(n)) else { return Ok(()) };
    let near = listed
        .iter()
        .max_by(|a, b| strsim::jaro_winkler(&a.name, unknown).total_cmp(&strsim::jaro_winkler(&b.name, unknown)));
    let hint = near.map_or(String::new(), |l| format!("did you mean {}? ", l.name));
    Err(Error::input(unknown, "is no chart", format!("{hint}`nacre chart --list` names them all")).into())
}

/// Release and a hash of the executable, because two builds of one release may differ.
fn version() -> String {
    let release = env!("CARGO_PKG_VERSION");
    let bytes = std::env::current_exe().and_then(std::fs::read);
    bytes.map_or(release.to_owned(), |bytes| {
        let digest = Sha256::digest(&bytes);
        let start: String = digest.iter().take(6).map(|b| format!("{b:02x}")).collect();
        format!("{release}, build {start}")
    })
}

fn summary(charted: &Charted, drawn: &[&str], out: &std::path::Path) -> String {
    let mut text = String::new();
    for chart in charted.charts.iter().filter(|c| drawn.contains(&c.name.as_str())) {
        let _ = writeln!(text, "{:20} {}", chart.name, out.join(&chart.files[0]).display());
    }
    let _ = write!(text, "all together         {}", out.join("index.html").display());
    text
}
