//! `nacre check`.

use crate::console::Console;
use nacre_capture::Failure;
use nacre_capture::session::check;
use std::path::PathBuf;

/// Arguments of `nacre check`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre check session
  nacre check session --json

Exits with code 1 if a frame is missing, or if a frame, session.json or frames.json differs from its
recorded checksum. `nacre salvage` recovers the undamaged lines of a damaged journal.")]
pub struct Args {
    /// Session folder.
    folder: PathBuf,
}

/// Verifies the checksums and reports missing frames.
pub fn run(args: &Args, console: &Console) -> Result<(), Failure> {
    let condition = check(&args.folder)?;
    let mut text = format!("{} of {} frames are whole", condition.intact, condition.planned);
    for trouble in &condition.trouble {
        text += &format!("\n{}: {}", trouble.file, trouble.problem);
    }
    if !condition.unverified.is_empty() {
        let why =
            if condition.salvaged.is_some() { "their checksums are lost" } else { "older versions recorded none" };
        text += &format!("\nno checksum ({why}): {}", condition.unverified.join(", "));
    }
    if let Some(salvaged) = &condition.salvaged {
        let [kept, lost] = [salvaged.kept, salvaged.lost];
        text += &format!("\nsalvaged journal: {kept} entries kept, at least {lost} lost");
    }
    console.result(&text, &condition);
    if condition.finished && condition.trouble.is_empty() {
        return Ok(());
    }
    let folder = args.folder.display();
    Err(Failure::Bound(match condition.changed() {
        Some(file) => format!("{folder}: {file} was changed; put an undamaged copy back"),
        None => format!("{folder}: not complete; `nacre capture --resume {folder} --sim` takes what is missing"),
    }))
}
