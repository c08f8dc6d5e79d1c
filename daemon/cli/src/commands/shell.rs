//! `nacre completions` and `nacre man`.

use crate::console::Console;
use clap::Command;
use clap_complete::Shell;
use nacre_base::Error;
use nacre_capture::Failure;
use nacre_image::OutputFolder;
use std::io::Write;
use std::path::PathBuf;

/// Arguments of `nacre completions`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre completions bash > ~/.local/share/bash-completion/completions/nacre
  nacre completions zsh > ~/.zfunc/_nacre
  nacre completions fish > ~/.config/fish/completions/nacre.fish")]
pub struct Completions {
    /// The shell.
    shell: Shell,
}

/// Arguments of `nacre man`.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  nacre man --out ~/.local/share/man/man1 && man nacre-capture")]
pub struct Man {
    /// Folder for the pages.
    #[arg(long)]
    out: PathBuf,
    /// Replace existing pages in the folder.
    #[arg(long)]
    force: bool,
}

/// Prints the completion script.
pub fn completions(args: &Completions, mut command: Command) -> Result<(), Failure> {
    let mut script = vec![];
    clap_complete::generate(args.shell, &mut command, "nacre", &mut script);
    // A closed pipe is not a failure of the command.
    let _ = std::io::stdout().lock().write_all(&script);
    Ok(())
}

/// Writes the manual pages.
pub fn man(args: &Man, mut command: Command, console: &Console) -> Result<(), Failure> {
    command.build();
    let folder = OutputFolder::begin(&args.out, args.force)?;
    let mut pages = vec![];
    write_pages(&command, "nacre", &folder, &mut pages)?;
    folder.commit()?;
    let text = format!("wrote     {} pages to {}", pages.len(), args.out.display());
    console.result(&text, &serde_json::json!({ "pages": pages }));
    Ok(())
}

/// Writes the page of a command and those of its subcommands.
fn write_pages(command: &Command, name: &str, folder: &OutputFolder, pages: &mut Vec<String>) -> Result<(), Error> {
    let file = format!("{name}.1");
    let mut page = vec![];
    let named = command.clone().name(name.to_owned()).display_name(name.to_owned());
    clap_mangen::Man::new(named).render(&mut page).map_err(|e| Error::output(&folder.path(&file), e))?;
    folder.write(&file, &page)?;
    pages.push(file);
    for inner in command.get_subcommands().filter(|c| !c.is_hide_set() && c.get_name() != "help") {
        write_pages(inner, &format!("{name}-{}", inner.get_name()), folder, pages)?;
    }
    Ok(())
}
