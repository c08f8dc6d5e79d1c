//! `nacre capture`.

use super::bench::BenchArgs;
use crate::console::Console;
use nacre_base::Error;
use nacre_capture::Failure;
use nacre_capture::engine::Control;
use nacre_capture::plan::{Plan, Role, Step};
use nacre_capture::rig::{Place, Rig, Uses, runtime};
use nacre_capture::run::{Capture, Taken, cannot_resume, check_limits, complete, steer};
use nacre_capture::session::{Ending, MortalDisk, SESSION_FILE, SessionFile, is_vacant};
use nacre_drivers::Pattern;
use nacre_drivers::stage::{Mounting, StageConfig, StageDriver};
use nacre_store::catalogue::note_session;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Arguments of `nacre capture`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre capture plan.toml --sim --out session
  nacre capture plan.toml --sim --bench bench.toml --out session --dry-run
  nacre capture plan.toml --sim --socket /tmp/bench --out session
  nacre capture --sim --resume session           resume after a stop, a crash or a kill
  nacre capture plan.toml --out session          use the devices of nacre.toml

Ctrl-C stops after the frames in progress, a second Ctrl-C at once. SIGUSR1 pauses, SIGUSR2 resumes.
The light is always switched off at the end.")]
pub struct Args {
    /// Plan (TOML, or JSON by file extension); `nacre schema plan` lists its keys.
    #[arg(required_unless_present = "resume")]
    plan: Option<PathBuf>,
    #[command(flatten)]
    bench: BenchArgs,
    /// Rotate the analyser by hand; prompts for each angle.
    #[arg(long)]
    hand: bool,
    /// New folder for the session.
    #[arg(long, required_unless_present_any = ["resume", "dry_run"])]
    out: Option<PathBuf>,
    /// Resume a stopped session in this folder. Uses the session's bench unless another is given.
    #[arg(long, value_name = "SESSION", conflicts_with_all = ["plan", "out", "dry_run"])]
    resume: Option<PathBuf>,
    /// Folder of calibrations, which the session uses and to which one of kind calibration adds (default: calibrations
    /// in the data folder of nacre.toml, if that describes the bench).
    #[arg(long, value_name = "DIR")]
    calibrations: Option<PathBuf>,
    /// Check the plan and list its steps without capturing.
    #[arg(long)]
    dry_run: bool,
}

/// Captures a session, or the missing frames of one.
pub fn run(args: &Args, console: &Console) -> Result<(), Failure> {
    if let Some((folder, frames)) = args.resume.as_ref().and_then(|folder| Some((folder, complete(folder)?))) {
        let value = serde_json::json!({ "session": folder, "frames": frames, "complete": true });
        console.result(&format!("session is complete: {frames} frames"), &value);
        return Ok(());
    }
    let plan = args.plan.as_ref().map(|path| Plan::read(path).map(|plan| (plan, path))).transpose()?;
    let mut place = match &args.resume {
        Some(folder) => bench_of(args, folder)?,
        None => args.bench.place()?,
    };
    if args.hand {
        place.section.stage = Some(StageConfig { driver: StageDriver::Hand {}, mounting: Mounting::default() });
    }
    let by_hand = place.section.by_hand();
    if place.section.has_page() && !args.dry_run {
        let remedy = "take the session through `nacre serve`, or describe a panel of kind kms";
        return Err(Error::input("bench.display", "is the pattern page, which only the service has", remedy).into());
    }
    if let Some((plan, path)) = &plan {
        check_limits(plan, path, &place.limits()?)?;
        if args.dry_run {
            return dry_run(plan, console);
        }
        if let Some(out) = args.out.as_ref().filter(|out| !is_vacant(out)) {
            return Err(Error::file(out, "is already there", "choose another --out, or --resume it").into());
        }
    }
    let (runtime, control) = (runtime()?, Arc::new(Control::default()));
    let mut rig = Rig::open(&runtime, &place, Uses::SESSION, console, &console.interrupted())?;
    steer(&runtime, &control, console.interrupted(), by_hand)
        .map_err(|e| Error::input("signals", format!("cannot be caught: {e}"), "report this"))?;
    for warning in rig.devices.camera.describe().warnings {
        console.note(&format!("warning: {warning}"));
    }
    let calibrations = args.bench.calibrations(args.calibrations.as_deref())?;
    let mut capture =
        Capture { runtime: &runtime, rig: &mut rig, control, observer: console, elsewhere: None, calibrations };
    let taken = match (plan, &args.out, &args.resume) {
        (Some((plan, _)), Some(out), _) => capture.begin(plan, out, MortalDisk::default()),
        (_, _, Some(folder)) => capture.resume(folder, MortalDisk::default()),
        // clap requires plan and --out unless --resume is given.
        _ => Err(Error::input("capture", "has no plan", "give a plan and --out, or --resume").into()),
    };
    if let Some(folder) = args.out.as_ref().or(args.resume.as_ref()).filter(|f| f.join(SESSION_FILE).exists()) {
        // The catalogue can be rebuilt, so its failure must not fail a captured session.
        note_session(folder).unwrap_or_else(|e| console.note(&format!("warning: not catalogued: {e}")));
    }
    report(&taken?, console);
    Ok(())
}

/// The bench to resume a session on: the given one, or the one that the session began on.
fn bench_of(args: &Args, folder: &Path) -> Result<Place, Failure> {
    let description = SessionFile::read(folder).map_err(|e| cannot_resume(folder, &e))?;
    if args.bench.is_given() {
        return args.bench.place();
    }
    if let Some(section) = &description.section {
        if args.bench.sim && section.has_real_device() {
            let problem = "was captured with devices that are not simulated";
            return Err(Error::file(folder, problem, "resume it without --sim").into());
        }
        section.check().map_err(|problem| Error::file(folder, problem, "`nacre schema config` lists all keys"))?;
        return super::bench::place(section, false);
    }
    args.bench.place()?;
    let Some(config) = description.bench else {
        let remedy = "resume it on its own devices";
        return Err(Error::file(folder, "was not captured on the simulated bench", remedy).into());
    };
    // The file may have been edited since, so it is validated like a new one before anything changes.
    config.validate().map_err(|problem| Error::file(folder, problem, "`nacre schema bench` lists all keys"))?;
    check_limits(&description.plan, folder, &Place::here(config.clone()).limits()?)?;
    Ok(Place::here(config))
}

fn dry_run(plan: &Plan, console: &Console) -> Result<(), Failure> {
    let (steps, most) = (plan.steps(), plan.most_steps());
    let mut text: Vec<String> = steps.iter().map(line).collect();
    let mut value: Vec<_> = steps.iter().map(|step| serde_json::json!(step)).collect();
    let more = most.len() - steps.len();
    let until_sigma = plan.until_sigma().map(|until| {
        let wanted = until.until_sigma_deg;
        format!("up to {more} more, each angle where it helps most, until σ is {wanted}° for 90 % of the pixels with an orientation")
    });
    let until_decided = plan.until_decided().map(|until| {
        let wanted = 100.0 * until.undecided;
        format!("up to {more} more, with more fringes, until at most {wanted} % of the pixels with a first order are undecided")
    });
    let crossed = plan.crossed_offsets_deg();
    let crossed = (!crossed.is_empty()).then(|| format!("{more} more, around the crossed direction"));
    if let Some(until) = until_sigma.or(until_decided).or(crossed) {
        text.push(until);
        value.extend(most[steps.len()..].iter().map(|s| serde_json::json!({ "file": s.file, "if_needed": true })));
    }
    console.result(&text.join("\n"), &value);
    Ok(())
}

/// One step as a line of text.
fn line(step: &Step) -> String {
    let state = &step.state;
    let angle = state.analyser_deg.map_or_else(|| "as it is".to_owned(), |a| format!("{a:.3}°"));
    let light = match (state.pattern, state.flash, state.covered) {
        (_, _, true) => "shutter closed".to_owned(),
        (Pattern::Black, false, _) => "no light".to_owned(),
        (Pattern::Black, true, _) => "flash".to_owned(),
        (Pattern::Disc { center_mm: [x, y], diameter_mm }, flash, _) => {
            let with = if flash { " and flash" } else { "" };
            format!("disc of {diameter_mm} mm at {x}, {y}{with}")
        }
        (Pattern::Fringes { cycles_per_mm: [fx, fy], phase, .. }, ..) => match fx.hypot(fy) {
            0.0 => format!("even light, {:.0} %", 50.0 + 50.0 * (std::f64::consts::TAU * phase).cos()),
            f => format!("fringes of {:.1} mm, phase {phase:.3}", 1.0 / f),
        },
    };
    let exposure = state.exposure_ms.map_or_else(String::new, |ms| format!("{ms} ms"));
    let what = if step.role == Role::Series { "" } else { "  (besides)" };
    format!("{:28}  analyser {angle:>9}  {light:32}  {exposure}{what}", step.file).trim_end().to_owned()
}

fn report(taken: &Taken, console: &Console) {
    let (folder, t) = (taken.session.display(), &taken.timing);
    let mut text = format!(
        "frames    {} ({:.1} ms unless the plan says otherwise); {} stale ones dropped\ntime      {:.1} s of the devices' time",
        taken.frames,
        1000.0 * taken.exposure_s,
        taken.stale_frames_dropped,
        t.device_s,
    );
    if let Some(metering) = taken.metering {
        let _ = write!(text, " ({:.1} s of it metering)", metering.device_s);
    }
    let _ = write!(text, ", {:.2} s of the engine's", t.engine_s);
    // A plan without frames needs no device time.
    if t.device_s > 0.0 {
        let _ = write!(text, " ({:.1} %)", 100.0 * t.engine_s / t.device_s);
    }
    let _ = write!(text, "\nsession   {folder}\n");
    match (&taken.results, taken.results_after_s) {
        (Some(results), Some(after)) => {
            let _ = write!(text, "results   {}, {after:.2} s after the last frame", results.display());
        }
        _ if taken.session.join("frames.json").exists() => {
            let _ = write!(text, "next      nacre check {folder}");
        }
        _ => {}
    }
    if let Some(ended) = &taken.ended {
        let _ = write!(text, "\nseries    {}", ended.text());
        if ended.why != Ending::Met {
            console.note(&format!("warning: {}", ended.text()));
        }
    }
    if let Some(kept) = &taken.kept {
        let _ = write!(text, "\nkept      as calibration {}", kept.id);
    }
    for warning in taken.warnings.iter().chain(taken.report.iter().flat_map(|done| &done.warnings)) {
        console.note(&format!("warning: {warning}"));
    }
    console.result(&text, taken);
}
