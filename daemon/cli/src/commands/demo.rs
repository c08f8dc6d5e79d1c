//! `nacre demo`: simulates, captures and reconstructs a session, then compares the maps with the truth.

use super::sim::{BenchOptions, simulate};
use crate::commands::Estimating;
use crate::console::Console;
use nacre_base::Error;
use nacre_base::estimate::Work;
use nacre_base::operation::Summary;
use nacre_base::progress::Progress;
use nacre_capture::Failure;
use nacre_image::{Canvas, OutputFolder, Palette, orientation_picture, read, read_exr, scalar_picture};
use nacre_polarimetry::{Comparison, Options, Report, compare, reconstruct};
use nacre_service::view::Look;
use nacre_sim::{BenchConfig, Truth};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

/// Upper bound of the demo's mean orientation error in degrees.
const BOUND_DEG: f64 = 0.5;

/// Purity (fraction of a pixel covered by its main orientation) above which a pixel counts as pure. Other pixels
/// straddle an edge.
const PURE: f32 = 0.999;

/// Arguments of `nacre demo`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre demo
  nacre demo --sample logo --seed 3 --out logo
  nacre demo --open                    view the sample under a movable light in the browser
  nacre demo --retardance-deg 10      a birefringent film, which requires the curve model

Exits with code 1 if the mean orientation error is 0.5° or more.")]
pub struct Args {
    #[command(flatten)]
    options: BenchOptions,
    /// Colour scale of angles in pictures: cyclic (perceptually even, safe for colour-blind readers) or hsv.
    #[arg(long, default_value = "cyclic", value_name = "cyclic|hsv")]
    palette: Palette,
    /// New folder for session, results and pictures (default: nacre-demo, or the next free nacre-demo-N).
    #[arg(long)]
    out: Option<PathBuf>,
    /// Open result/view.html in the browser: the sample under a movable light. Needs no service.
    #[arg(long)]
    open: bool,
    #[command(flatten)]
    estimating: Estimating,
}

#[derive(Serialize)]
struct Outcome {
    out: PathBuf,
    sample: &'static str,
    seed: u64,
    bound_deg: f64,
    within_bound: bool,
    /// Orientation error over all measured pixels that have a true orientation.
    error: Option<Comparison>,
    /// Orientation error over pure pixels.
    error_pure: Option<Comparison>,
    /// Number of pixels with a measured orientation but no true one.
    invented: usize,
    stale_frames_dropped: u64,
    seconds: Seconds,
    report: Report,
}

#[derive(Serialize)]
struct Seconds {
    capture: f64,
    reconstruct: f64,
    judge: f64,
    total: f64,
}

/// Renders, captures and reconstructs a session, then evaluates it.
pub fn run(args: &Args, console: &Console) -> Result<(), Failure> {
    let start = Instant::now();
    let config = args.options.apply(BenchConfig::default())?;
    console.expect(&work(&config, args.options.angles_deg.len()))?;
    let out = args.out.clone().unwrap_or_else(free_name);
    let (session, result) = (out.join("session"), out.join("result"));
    let folder = OutputFolder::begin(&session, false)?;
    let (taken, bench) = simulate(&config, &args.options.angles_deg, &folder, console)?;
    folder.commit()?;
    let captured = start.elapsed().as_secs_f64();
    let report = reconstruct(&session, &result, &Options { palette: args.palette, ..Options::default() }, console)?;
    let reconstructed = start.elapsed().as_secs_f64();

    let judged = bench.look(|bench| -> Result<Judged, Failure> {
        let judged = judge(&result, bench.truth())?;
        overview(&session, &judged, bench.truth(), args.palette)?.save_png(&result.join("overview.png"))?;
        Ok(judged)
    })?;
    let within_bound = judged.error.is_some_and(|e| e.mean_deg < BOUND_DEG);
    let total = start.elapsed().as_secs_f64();
    let outcome = Outcome {
        sample: config.sample.kind.name(),
        seed: config.seed,
        bound_deg: BOUND_DEG,
        within_bound,
        error: judged.error,
        error_pure: judged.error_pure,
        invented: judged.invented,
        stale_frames_dropped: taken.stale_frames_dropped,
        seconds: Seconds {
            capture: captured,
            reconstruct: reconstructed - captured,
            judge: total - reconstructed,
            total,
        },
        report,
        out,
    };
    let view = args.open.then(|| view(&result)).transpose()?;
    let mut said = text(&outcome);
    if let Some(file) = &view {
        said += &format!("\nview      {}{}", file.display(), if opened(file) { "" } else { ": open it in a browser" });
    }
    console.result(&said, &outcome);
    if within_bound {
        return Ok(());
    }
    let mean = judged.error.map_or("unknown".to_owned(), |e| format!("{:.2}°", e.mean_deg));
    Err(Failure::Bound(format!("the mean orientation error is {mean}, the demo's bound is {BOUND_DEG}°")))
}

/// Time, memory and disk of the demo; coefficients were measured at 0.02 to 1 Mpixel.
fn work(config: &BenchConfig, photographs: usize) -> Work {
    let size = [config.camera.width, config.camera.height].map(|side| side as usize);
    let pixels = (size[0] * size[1]) as f64;
    let results = nacre_polarimetry::work_of(photographs, size, true);
    // The bench renders every photograph, and the truth is compared at the end.
    let seconds = results.seconds + 0.1 + 1e-6 * pixels * (0.5 + 0.3 * photographs as f64);
    let memory_bytes = results.memory_bytes + (60.0 * pixels) as u64;
    let disk_bytes = results.disk_bytes + (1.9 * pixels) as u64 * photographs as u64;
    Work { operation: "demo".into(), seconds, memory_bytes, disk_bytes, ..Work::default() }
}

/// Writes view.html: the sample under a light, in a single file.
fn view(result: &Path) -> Result<PathBuf, Failure> {
    let file = result.join("view.html");
    let page = nacre_service::view::page("A simulated sample", result, &Look::default());
    let page = page.map_err(|problem| Error::file(result, problem, "report this"))?;
    nacre_image::write_whole(&file, &page)?;
    Ok(file)
}

/// Opens a file with the desktop's default program; returns whether that succeeded.
fn opened(file: &Path) -> bool {
    let program = if cfg!(target_os = "macos") { "open" } else { "xdg-open" };
    let quiet = std::process::Stdio::null;
    Command::new(program).arg(file).stdin(quiet()).stdout(quiet()).stderr(quiet()).spawn().is_ok()
}

struct Judged {
    width: usize,
    height: usize,
    orientation: Vec<f32>,
    pixel_um: Option<f64>,
    error: Option<Comparison>,
    error_pure: Option<Comparison>,
    invented: usize,
}

/// Reads the written maps back and compares them with the true sample.
fn judge(result: &Path, truth: &Truth) -> Result<Judged, Failure> {
    let path = result.join("orientation.exr");
    let mut map = read_exr(&path)?;
    let (orientation, sigma) = (map.take("orientation", &path)?, map.take("sigma", &path)?);
    let error = compare(&orientation, &sigma, &truth.orientation, |_| true);
    let error_pure = compare(&orientation, &sigma, &truth.orientation, |i| truth.purity[i] > PURE);
    let invented = orientation.iter().zip(&truth.orientation).filter(|(m, t)| m.is_finite() && !t.is_finite()).count();
    let pixel_um = map.attributes.get("pixel_um").and_then(|um| um.parse().ok());
    Ok(Judged { width: map.width, height: map.height, orientation, pixel_um, error, error_pure, invented })
}

/// Photograph, measured map, truth and error side by side.
fn overview(session: &Path, judged: &Judged, truth: &Truth, palette: Palette) -> Result<Canvas, Failure> {
    const SIDE: usize = 520;
    let step = judged.width.max(judged.height).div_ceil(SIDE).max(1);
    let (width, height) = (judged.width / step, judged.height / step);
    let at = |x: usize, y: usize| y * step * judged.width + x * step;
    let offset = judged.error.map_or(0.0, |e| e.offset_deg.to_radians()) as f32;
    let gauge = |t: f32| t.is_finite().then(|| (t - offset).rem_euclid(std::f32::consts::PI));

    let frame = read(&session.join("frames/0000.png"))?;
    let nacre_image::Samples::U16(codes) = frame.samples else {
        return Err(Error::input("frames/0000.png", "is not 16-bit", "report this").into());
    };
    let top = codes.iter().copied().max().unwrap_or(1).max(1);
    let mut photo = Canvas::new(width, height, [0, 0, 0]);
    for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
        // Display gamma 2.2, which brightens dark regions.
        let grey = (255.0 * (f32::from(codes[at(x, y)]) / f32::from(top)).powf(1.0 / 2.2)) as u8;
        photo.set(x, y, [grey; 3]);
    }
    let size = [width, height];
    let mut photograph = orientation_picture(size, &|_, _| None, "One of the photographs", palette, None);
    photograph.fill([250, 250, 250]);
    photograph.blit(&photo, 0, 0);
    photograph.text(width as f32 + 16.0, 16.0, 15.0, [30, 30, 30], "One of the photographs");
    let error = |x: usize, y: usize| {
        let (measured, known) = (gauge(judged.orientation[at(x, y)])?, truth.orientation[at(x, y)]);
        let difference = nacre_polarimetry::angle_difference(measured.into(), known.into());
        known.is_finite().then(|| difference.abs().to_degrees() as f32)
    };
    let measured = |x: usize, y: usize| gauge(judged.orientation[at(x, y)]);
    let known = |x: usize, y: usize| gauge(truth.orientation[at(x, y)] + offset);
    let bar_um = judged.pixel_um.map(|um| um * step as f64);
    let panels = [
        photograph,
        orientation_picture(size, &measured, "Measured orientation", palette, bar_um),
        orientation_picture(size, &known, "True orientation", palette, bar_um),
        scalar_picture(size, &error, [0.0, 2.0], "error (°)", "Difference", bar_um),
    ];
    let (w, h) = panels.iter().fold((0, 0), |(w, h), p| (w.max(p.width), h.max(p.height)));
    let gap = 12;
    let mut canvas = Canvas::new(2 * w + 3 * gap, 2 * h + 3 * gap, [18, 18, 20]);
    for (i, panel) in panels.iter().enumerate() {
        canvas.blit(panel, gap + (i % 2) * (w + gap), gap + (i / 2) * (h + gap));
    }
    Ok(canvas)
}

fn text(outcome: &Outcome) -> String {
    let line = |name: &str, c: &Option<Comparison>| match c {
        Some(c) => format!(
            "{name} mean {:.3}°, median {:.3}°, 95 % under {:.3}°; {:.2} % of {} pixels beyond 3σ\n",
            c.mean_deg,
            c.median_deg,
            c.p95_deg,
            100.0 * c.beyond_3_sigma,
            c.pixels
        ),
        None => format!("{name} no pixel to compare\n"),
    };
    let s = &outcome.seconds;
    format!(
        "{}\n{}{}         against the sample's truth, with one offset removed; {} pixels without grating were given an \
         orientation\ntotal     {:.1} s: simulating and capturing {:.1}, reconstructing {:.1}, judging {:.1}\nbound     mean \
         error under {}°: {}\nfiles     {}: session/, result/ (look at result/overview.png and result/orientation.png)",
        outcome.report.summary(),
        line("error    ", &outcome.error),
        line("one dot  ", &outcome.error_pure),
        outcome.invented,
        s.total,
        s.capture,
        s.reconstruct,
        s.judge,
        outcome.bound_deg,
        if outcome.within_bound { "met" } else { "MISSED" },
        outcome.out.display()
    )
}

/// `nacre-demo`, or the first free `nacre-demo-N`.
fn free_name() -> PathBuf {
    let names = (1..).map(|n| if n == 1 { "nacre-demo".to_owned() } else { format!("nacre-demo-{n}") });
    names.map(PathBuf::from).find(|p| !p.exists()).unwrap_or_else(|| PathBuf::from("nacre-demo"))
}
