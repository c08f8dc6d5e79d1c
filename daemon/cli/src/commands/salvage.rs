//! `nacre salvage`.

use crate::console::Console;
use nacre_capture::Failure;
use nacre_capture::session::{DamagedLine, Journal, Salvage, salvage};
use std::fmt::Write;
use std::path::PathBuf;

/// Maximum number of damaged lines printed; `--json` lists all.
const MAX_PRINTED: usize = 20;

/// Arguments of `nacre salvage`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre salvage session --dry-run     list lost lines and frames
  nacre salvage session               rebuild the journal from its undamaged lines
  nacre capture --resume session      then capture the lost frames

For sessions that `nacre check` refuses because of their journal. Keeps the damaged journal in the
session folder as journal.damaged and changes no frame. A frame with a lost entry stays on the disk
but cannot be verified: a resumed capture replaces it.")]
pub struct Args {
    /// Session folder.
    session: PathBuf,
    /// Report recoverable and lost frames without writing.
    #[arg(long)]
    dry_run: bool,
}

/// Rebuilds a readable session from the undamaged lines.
pub fn run(args: &Args, console: &Console) -> Result<(), Failure> {
    let salvage = salvage(&args.session, !args.dry_run)?;
    console.result(&text(&salvage, args), &salvage);
    Ok(())
}

fn text(salvage: &Salvage, args: &Args) -> String {
    let (salvaged, condition) = (&salvage.salvaged, &salvage.condition);
    let mut text = format!("kept      {} entries; at least {} lost\n", salvaged.kept, salvaged.lost);
    for line in salvage.lines.iter().take(MAX_PRINTED) {
        let _ = writeln!(text, "damaged   {}", described(line));
    }
    if salvaged.damaged > MAX_PRINTED {
        let _ = writeln!(text, "damaged   {} further lines", salvaged.damaged - MAX_PRINTED);
    }
    let _ = writeln!(text, "frames    {} of {} verified", condition.intact, condition.planned);
    for trouble in &condition.trouble {
        let _ = writeln!(text, "          {}: {}", trouble.file, trouble.problem);
    }
    if !condition.unverified.is_empty() {
        let _ = writeln!(text, "          no checksum is left of {}", condition.unverified.join(", "));
    }
    let session = args.session.display();
    if args.dry_run {
        let _ = writeln!(text, "next      nacre salvage {session}");
    } else {
        let _ = writeln!(text, "journal   {session}/{}; damaged {}", Journal::NAME, salvaged.damaged_journal);
        let _ = writeln!(text, "next      nacre check {session}");
    }
    text
}

fn described(line: &DamagedLine) -> String {
    let mut text = format!("line {} ({} bytes) {}", line.line, line.bytes, line.problem);
    if let Some(entry) = line.entry {
        let _ = write!(text, "; it still reads `{entry}`");
    }
    if let Some(file) = &line.file {
        let _ = write!(text, "; it still names {file}");
    }
    text
}
