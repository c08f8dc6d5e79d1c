//! `nacre recommend`.

use crate::console::Console;
use nacre_base::operation::lines;
use nacre_base::progress::Progress;
use nacre_capture::Failure;
use nacre_image::{OutputFolder, Palette};
use nacre_maps::recommend::{Advice, Need, Report, recommend};
use std::fmt::Write;
use std::path::PathBuf;

/// Arguments of `nacre recommend`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre recommend sheet.jpg                                  photograph by room light, showing the whole sample
  nacre recommend result --need orientation                  folder with orientation.exr
  nacre recommend sheet.jpg --out advice                     write report.json and tile.png (the detected tile)

Searches for a repeated tile and for uniform areas. Samples with both suit a flash at several positions (reconstruct
flash). Other samples suit fringes on the panel (spots), or polarization if periods are not needed.")]
pub struct Recommend {
    /// Photograph of the sample, or its orientation map.
    input: PathBuf,
    /// Required result: period (orientations and absolute periods) or orientation alone.
    #[arg(long, default_value = "period", value_name = "period|orientation")]
    need: Need,
    /// Colour scale of angles in tile.png of a map: cyclic (perceptually even, safe for colour-blind readers) or hsv.
    #[arg(long, default_value = "cyclic", value_name = "cyclic|hsv")]
    palette: Palette,
    /// Folder for report.json and tile.png.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Replace existing files in the folder.
    #[arg(long)]
    force: bool,
}

/// Analyses the picture and recommends a method.
pub fn run(args: &Recommend, console: &Console) -> Result<(), Failure> {
    console.stage("looking", 1);
    let folder = args.out.as_deref().map(|out| OutputFolder::begin(out, args.force)).transpose()?;
    let (report, picture) = recommend(&args.input, args.need, args.palette)?;
    console.check()?;
    let mut text = summary(&report);
    if let (Some(folder), Some(out)) = (folder, &args.out) {
        picture.save_png(&folder.path("tile.png"))?;
        folder.write_report(&report)?;
        folder.commit()?;
        let _ = write!(text, "\nwrote     {}", out.display());
    }
    console.result(&text, &report);
    Ok(())
}

fn summary(report: &Report) -> String {
    let mut text = match &report.repeats {
        None => "tile      none is repeated\n".to_owned(),
        Some(r) => {
            // Adding 0.0 turns -0.0 into 0.0, which prints without a sign.
            let [a, b] = r.sides_px.map(|v| v.map(|d| (10.0 * d).round() / 10.0 + 0.0));
            format!(
                "tile      sides of ({:.1}, {:.1}) and ({:.1}, {:.1}) pixels, room for {:.0} copies, {:.0} % alike\n",
                a[0],
                a[1],
                b[0],
                b[1],
                r.copies,
                100.0 * r.likeness
            )
        }
    };
    let even = if report.discrete { "even areas with sharp edges" } else { "no even areas" };
    let _ = writeln!(text, "areas     {even} (unevenness of slopes {:.1})", report.unevenness);
    text += &lines(&[], &report.warnings);
    let _ = writeln!(text, "advice    {}: {}", name(report.advice), report.why);
    let _ = writeln!(text, "else      {}", report.otherwise);
    let _ = write!(text, "next      {}", next(report.advice));
    text
}

fn name(advice: Advice) -> &'static str {
    match advice {
        Advice::Flash => "flash",
        Advice::Spots => "spots",
        Advice::Polarization => "polarization",
    }
}

/// Command to continue with.
fn next(advice: Advice) -> &'static str {
    match advice {
        Advice::Flash => "nacre reconstruct flash --help; try it first with nacre sim photograph tiles",
        Advice::Spots => {
            "nacre plan check PLAN, with kind = \"spots\" and spots = { fringes = { count = 12, phases = 4 } }"
        }
        Advice::Polarization => {
            "nacre capture PLAN, with kind = \"polarization\"; nacre reconstruct polarization --help"
        }
    }
}
