//! `nacre factor`.

use crate::commands::Estimating;
use crate::commands::values::numbers;
use crate::console::Console;
use nacre_base::operation::lines;
use nacre_capture::Failure;
use nacre_render::environment::factor::{Job, Kind, Settings, factor};
use std::fmt::Write;
use std::path::PathBuf;

/// Arguments of `nacre factor`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre factor lut/lut.exr --max-error 0.05 --out factors
  nacre factor lut/lut.exr --rank 8 --environment studio.exr --out factors
  nacre factor lut/lut.exr --directions-deg 12,97 --kind nonnegative --out factors
  nacre factor tv/lut.exr --parts 2 --out factors

Takes the lut.exr of `nacre reconstruct lut`, finds the two main directions of the pattern, straightens it and splits it into sums of
products of two curves, with which two passes over a lat-long environment make what the surface reflects. Writes the curves
(part-N-across.exr, part-N-along.exr), factors.png (the table, and beside it the sum of its terms) and report.json, which says whether the
table separates at all, and what to use if not. `nacre render` takes the folder as `factors` of a material's table (nacre schema scene).")]
pub struct Args {
    /// The table.
    table: PathBuf,
    /// Folder for the results.
    #[arg(long)]
    out: PathBuf,
    /// Terms per channel and part; as many as the error needs if not said.
    #[arg(long, value_name = "R", conflicts_with = "max_error")]
    rank: Option<usize>,
    /// Largest error of the table, root mean square over its own.
    #[arg(long, value_name = "REL", default_value_t = 0.05, allow_negative_numbers = true)]
    max_error: f64,
    /// The two directions, anticlockwise from the right, instead of those that are found; the second will lie along the meridians.
    #[arg(long, value_name = "A,B", value_parser = |t: &str| numbers::<f64, 2>(t, "two angles: 0,90"), allow_hyphen_values = true)]
    directions_deg: Option<[f64; 2]>,
    /// Least angle between the two directions.
    #[arg(long, value_name = "DEG", default_value_t = 60.0, allow_negative_numbers = true)]
    min_angle_deg: f64,
    /// Split the table into so many parts, one along each main direction.
    #[arg(long, value_name = "N", default_value_t = 1)]
    parts: usize,
    /// Which factorisation.
    #[arg(long, value_enum, default_value_t = KindArg::Singular)]
    kind: KindArg,
    /// Measure the picture's error in this lat-long environment (EXR or HDR).
    #[arg(long, value_name = "FILE")]
    environment: Option<PathBuf>,
    /// Layer, view or part of an OpenEXR environment that has several pictures.
    #[arg(long, value_name = "NAME", requires = "environment")]
    layer: Option<String>,
    /// Replace results that are already in the folder.
    #[arg(long, visible_alias = "overwrite")]
    force: bool,
    #[command(flatten)]
    estimating: Estimating,
}

/// Kinds of factorisation.
#[derive(Clone, Copy, clap::ValueEnum)]
enum KindArg {
    /// Singular vectors: the least error.
    Singular,
    /// No negative light anywhere.
    Nonnegative,
    /// One curve along the first direction: gratings and discs.
    Line,
}

/// Factorises.
pub fn run(args: &Args, console: &Console) -> Result<(), Failure> {
    let settings = Settings {
        rank: args.rank,
        max_error: args.max_error,
        apart: args.min_angle_deg.to_radians(),
        directions: args.directions_deg.map(|pair| pair.map(f64::to_radians)),
        parts: args.parts,
        kind: match args.kind {
            KindArg::Singular => Kind::Singular,
            KindArg::Nonnegative => Kind::Nonnegative,
            KindArg::Line => Kind::Line,
        },
    };
    let job = Job {
        table: &args.table,
        environment: args.environment.as_deref(),
        layer: args.layer.as_deref(),
        out: &args.out,
        settings,
        overwrite: args.force,
    };
    let report = factor(&job, console)?;
    let mut text = format!("pattern   {}, contrast {:.1}", report.pattern, report.contrast);
    for part in &report.parts {
        let [across, along] = part.directions_deg;
        let _ = write!(text, "\npart      {} terms along {across:.1}° and {along:.1}°", part.rank);
    }
    let _ = write!(
        text,
        "\nerror     {:.2} % of the table (measured on what is written), at most {:.1} % of a picture (one light that is a point)",
        100.0 * report.error,
        100.0 * report.picture_error_point
    );
    if let Some(error) = report.picture_error {
        let _ = write!(text, "\npicture   {:.2} % in this environment", 100.0 * error);
    }
    let _ = write!(text, "\nmethod    {}", report.advice);
    let _ = write!(
        text,
        "\n{}time      {:.2} s\nresults   {}",
        lines(&[], &report.warnings),
        report.seconds,
        args.out.display()
    );
    console.result(&text, &report);
    Ok(())
}
