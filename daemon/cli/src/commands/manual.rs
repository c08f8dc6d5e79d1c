//! Manual control of single devices: `nacre stage`, `snap`, `flash`, `show`; and the guardian of the flash. Each
//! command opens only the devices that it needs.

use super::bench::BenchArgs;
use super::care;
use crate::console::Console;
use clap::Subcommand;
use nacre_base::progress::Progress;
use nacre_base::{Error, vacant};
use nacre_capture::Failure;
use nacre_capture::engine::{BenchController, Control, Input, guarded};
use nacre_capture::guardian::Guarded;
use nacre_capture::rig::{Place, Rig, Use, Uses, runtime};
use nacre_drivers::{DeviceError, Pattern};
use nacre_image::write_png16_gray;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// Commands of the analyser's stage.
#[derive(Subcommand)]
pub enum Stage {
    /// Rotate the analyser to an angle, approaching from below to avoid backlash.
    #[command(after_help = "Example:\n  nacre stage move 45 --sim --socket /tmp/bench")]
    Move {
        /// Analyser angle in degrees.
        #[arg(allow_negative_numbers = true)]
        angle_deg: f64,
        /// Bench.
        #[command(flatten)]
        bench: BenchArgs,
    },
    /// Find the mechanical zero of the stage.
    #[command(after_help = "Example:\n  nacre stage home --sim --socket /tmp/bench")]
    Home(BenchArgs),
    /// Search the best motor frequencies of an Elliptec stage, after a change of load or when it gets stuck. Moves the
    /// stage.
    #[command(after_help = "Example:\n  nacre stage search-frequency --config nacre.toml")]
    SearchFrequency(BenchArgs),
    /// Run the cleaning cycle of an Elliptec stage. Takes minutes and moves over the full turn.
    #[command(after_help = "Example:\n  nacre stage clean --config nacre.toml")]
    Clean(BenchArgs),
    /// Print the analyser angle.
    #[command(after_help = "Example:\n  nacre stage where --sim --socket /tmp/bench --json")]
    Where(BenchArgs),
}

/// Arguments of `nacre snap`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre snap --sim --out look.png
  nacre snap --sim --out look.png --show disc:60@100,0 --exposure-ms 20 --analyser-deg 30")]
pub struct Snap {
    #[command(flatten)]
    bench: BenchArgs,
    /// Picture (16-bit PNG).
    #[arg(long)]
    out: PathBuf,
    /// Exposure time in ms.
    #[arg(long, default_value_t = 10.0)]
    exposure_ms: f64,
    /// Camera gain.
    #[arg(long, default_value_t = 1.0)]
    gain: f64,
    /// Panel pattern during the exposure: black, disc:DIAMETER or disc:DIAMETER@X,Y in mm (default with a panel:
    /// disc:180).
    #[arg(long, value_parser = pattern)]
    show: Option<Pattern>,
    /// Rotate the analyser to this angle in degrees first.
    #[arg(long, allow_negative_numbers = true)]
    analyser_deg: Option<f64>,
    /// Switch the flash on during the exposure.
    #[arg(long)]
    flash: bool,
    /// Replace an existing picture.
    #[arg(long)]
    force: bool,
}

/// Commands of the flash.
#[derive(Subcommand)]
pub enum FlashCommand {
    /// Switch the flash on until Ctrl-C, at most for its maximum on time.
    #[command(after_help = "Example:\n  nacre flash on --seconds 2 --sim --socket /tmp/bench")]
    On {
        /// Switch off after this time in seconds.
        #[arg(long)]
        seconds: Option<f64>,
        /// Bench.
        #[command(flatten)]
        bench: BenchArgs,
    },
    /// Switch the flash off and verify its state.
    #[command(after_help = "Example:\n  nacre flash off --sim --socket /tmp/bench")]
    Off(BenchArgs),
    /// Switch the flash on and off, reading its state back each time.
    #[command(after_help = "Example:\n  nacre flash test --sim")]
    Test(BenchArgs),
}

/// Arguments of `nacre show`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre show disc:180 --sim --socket /tmp/bench
  nacre show disc:30@-100,50 --seconds 5 --sim --socket /tmp/bench")]
pub struct Show {
    /// Pattern: black, disc:DIAMETER or disc:DIAMETER@X,Y in mm from the panel's centre.
    #[arg(value_parser = pattern)]
    pattern: Pattern,
    /// Return to black after this time in seconds.
    #[arg(long)]
    seconds: Option<f64>,
    #[command(flatten)]
    bench: BenchArgs,
}

/// Arguments of the guardian.
#[derive(clap::Args)]
pub struct Guardian {
    /// Flash driver (JSON).
    flash: String,
}

fn pattern(text: &str) -> Result<Pattern, String> {
    let expected = || format!("{text:?} is no pattern; give black, disc:DIAMETER or disc:DIAMETER@X,Y in mm");
    if text == "black" {
        return Ok(Pattern::Black);
    }
    let disc = text.strip_prefix("disc:").ok_or_else(expected)?;
    let (diameter, center) = disc.split_once('@').unwrap_or((disc, "0,0"));
    let (x, y) = center.split_once(',').ok_or_else(expected)?;
    let number = |text: &str| text.trim().parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(expected);
    let (diameter_mm, center_mm) = (number(diameter)?, [number(x)?, number(y)?]);
    if diameter_mm > 0.0 { Ok(Pattern::Disc { center_mm, diameter_mm }) } else { Err(expected()) }
}

/// Opens the devices in `uses`, runs `work` while the interlocks hold, and leaves their light off.
pub(super) fn with_controller<T>(
    place: &Place,
    uses: Uses,
    console: &Console,
    work: impl AsyncFnOnce(&mut BenchController<'_>) -> Result<T, Failure>,
) -> Result<T, Failure> {
    let (runtime, control) = (runtime()?, Control::default());
    let mut rig = Rig::open(&runtime, place, uses, console, &console.interrupted())?;
    let mut controller = BenchController::new(&mut rig.devices);
    let _ = control.send(Input::Start);
    runtime.block_on(async {
        let interrupted = async {
            hold(console, f64::INFINITY).await;
            // Devices get one second to finish in order; a hanging one is then abandoned.
            tokio::time::sleep(Duration::from_secs(1)).await;
            Err(Error::Cancelled.into())
        };
        let result = tokio::select! {
            biased;
            stopped = interrupted => stopped,
            result = guarded(&rig.watch, &control, work(&mut controller)) => result,
        };
        let dark = controller.dark().await;
        let value = result?;
        dark?;
        Ok(value)
    })
}

/// Moves or queries the stage.
pub fn stage(command: &Stage, console: &Console) -> Result<(), Failure> {
    let bench = match command {
        Stage::SearchFrequency(bench) | Stage::Clean(bench) => return care::run(command, bench, console),
        Stage::Move { bench, .. } | Stage::Home(bench) | Stage::Where(bench) => bench,
    };
    let uses = Uses { stage: Use::Always, ..Uses::NONE };
    let angle = with_controller(&bench.place()?, uses, console, async |controller| {
        match command {
            Stage::Move { angle_deg, .. } => {
                let [low, high] = controller.limits().stage.limits_deg;
                if !(low..=high).contains(angle_deg) {
                    let expected = format!("an angle from {low}° to {high}°");
                    return Err(DeviceError::new(
                        &controller.limits().stage.id,
                        "move",
                        expected,
                        format!("{angle_deg}°"),
                    )
                    .class(nacre_drivers::Class::Setup)
                    .into());
                }
                controller.find().await?;
                controller.turn(*angle_deg).await?;
            }
            Stage::Home(_) => controller.prepare(true).await?,
            _ => {}
        }
        Ok(controller.position().await?)
    })?;
    console.result(&format!("the analyser stands at {angle:.3}°"), &serde_json::json!({ "analyser_deg": angle }));
    Ok(())
}

/// Default panel pattern of a picture.
const WHITE: Pattern = Pattern::Disc { center_mm: [0.0, 0.0], diameter_mm: 180.0 };

/// Captures one frame exposed after all settings have taken effect.
pub fn snap(args: &Snap, console: &Console) -> Result<(), Failure> {
    vacant(std::slice::from_ref(&args.out), args.force)?;
    let place = args.bench.place()?;
    let pattern = args.show.or_else(|| place.has_display().then_some(WHITE));
    let used = |used: bool| if used { Use::Always } else { Use::Never };
    let uses = Uses {
        stage: used(args.analyser_deg.is_some()),
        camera: Use::Always,
        display: used(pattern.is_some()),
        flash: used(args.flash),
    };
    let (frame, dropped, white) = with_controller(&place, uses, console, async |controller| {
        let camera = controller.limits().camera.clone();
        let seconds = args.exposure_ms / 1000.0;
        if !(camera.exposure_s[0]..=camera.exposure_s[1]).contains(&seconds)
            || !(camera.gain[0]..=camera.gain[1]).contains(&args.gain)
        {
            let (expected, got) = (
                format!(
                    "{} to {} s, gain {} to {}",
                    camera.exposure_s[0], camera.exposure_s[1], camera.gain[0], camera.gain[1]
                ),
                format!("{seconds} s, gain {}", args.gain),
            );
            return Err(DeviceError::new(&camera.id, "expose", expected, got).remedy("choose others").into());
        }
        controller.expose(Duration::from_secs_f64(seconds), args.gain).await?;
        controller.cover(false).await?;
        if let Some(pattern) = pattern {
            controller.show(pattern).await?;
        }
        if let Some(angle) = args.analyser_deg {
            controller.find().await?;
            controller.turn(angle).await?;
        }
        if args.flash {
            controller.switch(true).await?;
        }
        let (frame, dropped) = controller.fresh().await?;
        if args.flash {
            controller.flash_still_on().await?;
        }
        Ok((frame, dropped, camera.white))
    })?;
    write_png16_gray(&args.out, frame.width, frame.height, &frame.codes)?;
    let (low, high) = frame.codes.iter().fold((u16::MAX, 0), |(l, h), c| (l.min(*c), h.max(*c)));
    let saturated = frame.codes.iter().filter(|c| **c >= white).count();
    let text = format!(
        "picture   {} ({} × {} pixels, codes {low} to {high}, {saturated} saturated at {white}; {dropped} stale frames dropped)",
        args.out.display(),
        frame.width,
        frame.height
    );
    let json = serde_json::json!({
        "picture": args.out, "width": frame.width, "height": frame.height, "lowest": low, "highest": high,
        "white": white, "saturated": saturated, "stale_frames_dropped": dropped,
    });
    console.result(&text, &json);
    Ok(())
}

/// Switches the flash.
pub fn flash(command: &FlashCommand, console: &Console) -> Result<(), Failure> {
    let (FlashCommand::On { bench, .. } | FlashCommand::Off(bench) | FlashCommand::Test(bench)) = command;
    let uses = Uses { flash: Use::Always, ..Uses::NONE };
    let mut place = bench.place()?;
    if matches!(command, FlashCommand::Off(_)) {
        // An open or missing interlock must not keep the light on.
        place.section.interlocks.clear();
    }
    let text = with_controller(&place, uses, console, async |controller| {
        let longest = controller.limits().flash.as_ref().map_or(0.0, |f| f.max_on_s);
        match command {
            FlashCommand::Off(_) => {
                controller.switch(false).await?;
                Ok("the flash is off".to_owned())
            }
            FlashCommand::Test(_) => {
                for on in [false, true, false] {
                    controller.switch(on).await?;
                    if controller.is_lit().await? != on {
                        let (expected, got) = if on { ("on", "off") } else { ("off", "on") };
                        return Err(DeviceError::new("flash", "report its state", expected, got).into());
                    }
                }
                Ok("the flash goes on and off as it is told".to_owned())
            }
            FlashCommand::On { seconds, .. } => {
                let wanted = seconds.unwrap_or(longest);
                if !(wanted > 0.0 && wanted <= longest) {
                    let problem = format!("--seconds is {wanted}, but the flash may be on for up to {longest} s");
                    return Err(Error::input("flash", problem, "choose a shorter time").into());
                }
                controller.switch(true).await?;
                console.note(&format!("the flash is on for {wanted} s; Ctrl-C ends it"));
                // Slightly below the maximum on time, so that this command ends the light before the flash's own limit
                // does.
                hold(console, wanted.min(longest - 0.1).max(0.0)).await;
                controller.flash_still_on().await?;
                controller.switch(false).await?;
                Ok("the flash is off again".to_owned())
            }
        }
    })?;
    console.result(&text, &serde_json::json!({ "flash": text }));
    Ok(())
}

/// Shows a pattern until Ctrl-C or the time limit.
pub fn show(args: &Show, console: &Console) -> Result<(), Failure> {
    let uses = Uses { display: Use::Always, ..Uses::NONE };
    with_controller(&args.bench.place()?, uses, console, async |controller| {
        let size = controller.limits().display.size_mm;
        let reach = args.pattern.reach_mm();
        if reach.iter().zip(size).any(|(r, s)| *r > 0.5 * s) {
            let problem = format!(
                "it reaches {} × {} mm from the middle of a panel of {} × {} mm",
                reach[0], reach[1], size[0], size[1]
            );
            return Err(Error::input("pattern", problem, "choose a smaller one").into());
        }
        controller.show(args.pattern).await?;
        if args.pattern != Pattern::Black {
            console.note("the pattern is shown; Ctrl-C ends it");
            hold(console, args.seconds.unwrap_or(f64::INFINITY)).await;
        }
        Ok(())
    })?;
    console.result("the panel is black", &serde_json::json!({ "panel": "black" }));
    Ok(())
}

/// Waits for `seconds`, or until Ctrl-C, which is the regular end and no failure.
pub(super) async fn hold(console: &Console, seconds: f64) {
    let begun = Instant::now();
    while begun.elapsed().as_secs_f64() < seconds && !console.cancelled() {
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

/// Runs the guardian on standard input and output.
pub fn guardian(args: &Guardian) -> ExitCode {
    let guarded = serde_json::from_str::<Guarded>(&args.flash)
        .map_err(|e| DeviceError::new("flash guardian", "start", "the description of a flash", e.to_string()));
    match guarded.and_then(|guarded| nacre_capture::guardian::run(|| guarded.open())) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            use std::io::Write;
            let _ = writeln!(std::io::stderr().lock(), "nacre: flash guardian: {error}");
            ExitCode::FAILURE
        }
    }
}
