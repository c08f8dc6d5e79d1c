//! `nacre catalogue`.

use crate::console::Console;
use clap::Subcommand;
use nacre_base::calendar::iso;
use nacre_base::{Error, input};
use nacre_capture::Failure;
use nacre_capture::plan::PlanKind;
use nacre_store::catalogue::{Cursor, Page, Query, SessionRow, State, default_path, with_catalogue};
use std::path::{Path, PathBuf};

/// Arguments of `nacre catalogue`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre catalogue rebuild ~/sessions             find all sessions
  nacre catalogue list tile --state finished     finished sessions that mention `tile`
  nacre catalogue add session

The session folders hold all data: the catalogue can be deleted and rebuilt at any time.")]
pub struct Args {
    /// Catalogue file [default: $NACRE_CATALOGUE, else nacre/catalogue.db in $XDG_DATA_HOME or ~/.local/share].
    #[arg(long, global = true, value_name = "FILE")]
    catalogue: Option<PathBuf>,
    #[command(subcommand)]
    command: CatalogueCommand,
}

/// Commands on the catalogue.
#[derive(Subcommand)]
enum CatalogueCommand {
    /// Replace the catalogue by the sessions in these folders.
    Rebuild(RebuildArgs),
    /// List sessions, newest first.
    List(ListArgs),
    /// Add a session, or update its entry.
    Add(AddArgs),
}

#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre catalogue rebuild ~/sessions
  nacre catalogue rebuild /data/2025 /data/2026 --json

Searches eight levels deep and does not follow symbolic links. Removes sessions outside of these folders
from the catalogue, not from the disk.")]
struct RebuildArgs {
    /// Folders to search.
    #[arg(required = true, value_name = "DIR")]
    folders: Vec<PathBuf>,
}

#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre catalogue list
  nacre catalogue list kinematic tile --state unfinished
  nacre catalogue list --limit 10 --json")]
struct ListArgs {
    /// Words that must all occur in the session's name, sample, operator, notes or folder.
    text: Vec<String>,
    /// List only sessions of this kind of plan.
    #[arg(long, value_parser = plan_kind)]
    kind: Option<PlanKind>,
    /// List only sessions in this state.
    #[arg(long)]
    state: Option<State>,
    /// Maximum number of sessions (1 to 1000).
    #[arg(long, default_value_t = 50, value_parser = clap::value_parser!(u32).range(1..=1000))]
    limit: u32,
    /// Continue after an earlier list, given its `next`.
    #[arg(long, value_name = "NEXT")]
    after: Option<Cursor>,
}

#[derive(clap::Args)]
#[command(after_help = "Example:\n  nacre catalogue add session")]
struct AddArgs {
    /// Session folder.
    session: PathBuf,
}

/// Parses through the plan's own enum, so that every kind of plan is accepted here.
fn plan_kind(text: &str) -> Result<PlanKind, serde_json::Error> {
    serde_json::from_value(text.into())
}

/// Runs a command on the catalogue.
pub fn run(args: &Args, console: &Console) -> Result<(), Failure> {
    let path = args.catalogue.clone().map_or_else(default_path, Ok)?;
    if path.exists() {
        // Opened as a regular file first: the database would wait forever for the writer of a pipe.
        input::open(&path, u64::MAX).map_err(|e| Error::file(&path, e, "give another --catalogue"))?;
    }
    match &args.command {
        CatalogueCommand::Rebuild(args) => rebuild(&path, args, console),
        CatalogueCommand::List(args) => list(&path, args, console),
        CatalogueCommand::Add(args) => add(&path, args, console),
    }
}

fn rebuild(path: &Path, args: &RebuildArgs, console: &Console) -> Result<(), Failure> {
    let rebuilt = with_catalogue(path, async |c| c.rebuild(&args.folders, console).await)?;
    for warning in &rebuilt.warnings {
        console.note(&format!("warning: {warning}"));
    }
    console.result(&format!("{} sessions are in {}", rebuilt.sessions, path.display()), &rebuilt);
    Ok(())
}

fn list(path: &Path, args: &ListArgs, console: &Console) -> Result<(), Failure> {
    let query = Query {
        text: args.text.join(" "),
        kind: args.kind,
        state: args.state,
        limit: args.limit,
        after: args.after.clone(),
    };
    let page = with_catalogue(path, async |c| c.search(&query).await)?;
    console.result(&text(&page), &page);
    Ok(())
}

fn add(path: &Path, args: &AddArgs, console: &Console) -> Result<(), Failure> {
    let row = SessionRow::read(&args.session)?;
    with_catalogue(path, async |c| c.put(&row).await)?;
    console.result(&format!("{} is in {}", row.folder, path.display()), &row);
    Ok(())
}

/// A page of the list as a table with aligned columns.
fn text(page: &Page) -> String {
    if page.sessions.is_empty() {
        return "no sessions; `nacre catalogue rebuild DIR` looks for them".into();
    }
    let mut lines = vec![["STATE", "FRAMES", "BEGUN", "NAME", "FOLDER"].map(String::from)];
    lines.extend(page.sessions.iter().map(cells));
    let width = |column: usize| lines.iter().map(|l| l[column].chars().count()).max().unwrap_or_default();
    let [state, frames, begun, name] = [0, 1, 2, 3].map(width);
    let mut text = String::new();
    for [a, b, c, d, e] in &lines {
        text += &format!("{a:state$}  {b:>frames$}  {c:begun$}  {d:name$}  {e}\n");
    }
    match &page.next {
        Some(next) => text + &format!("more: --after {next}"),
        None => text,
    }
}

fn cells(row: &SessionRow) -> [String; 5] {
    // Control characters in a name must not reach the terminal.
    let plain = |text: &str| text.replace(char::is_control, " ");
    [
        format!("{:?}", row.state).to_lowercase(),
        format!("{}/{}", row.frames_committed, row.frames_planned),
        iso(row.created),
        if row.name.is_empty() { "-".into() } else { plain(&row.name) },
        plain(&row.folder),
    ]
}
