//! `nacre render`.

use super::flags::Flags;
use crate::console::Console;
use nacre_base::estimate::{Machine, Work};
use nacre_base::operation::Summary;
use nacre_base::progress::Progress;
use nacre_base::{Error, input, vacant, writable};
use nacre_brdf::height::{self, Scale};
use nacre_capture::Failure;
use nacre_image::OutputFolder;
use nacre_render::{
    Method, Options, Report, Scene, Settings, exposure, gallery, gallery_scene, gallery_skin, render, write_picture,
    write_png,
};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Arguments of `nacre render`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre render cd.toml --out cd.exr
  nacre render cd.toml --out cd.exr --max-error 0.003 --samples 4096
  nacre render foil.toml --out foil.exr --keep foil.state.exr          stop with Ctrl-C, continue with --resume
  nacre render foil.toml --out turning --frames 36 --turn light       a folder of 36 pictures
  nacre render cd.toml --out cd.exr --spectral-nm 10                     41 bands from 380 to 780 nm
  nacre render phone.toml --out phone.exr --method two-pass --rank 3   lookup table in a room, prefiltered environment
  nacre render --gallery gallery                                       write and render example scenes
  nacre render --gallery gallery --scenes cd,cd-room                   only these scenes
  nacre render --gallery gallery --skin elaphe.png --pixel-um 0.08 --range-um 0.43

A scene (nacre schema scene):
  [camera]
  position = [0, 0, 500]
  target = [0, 0, 0]
  fov_deg = 16
  width = 480
  height = 480
  [[shape]]
  type = \"plane\"
  size = [100, 100]
  material = \"foil\"
  [[light]]
  type = \"point\"
  position = [0, 300, 400]
  sigma_mm = 2
  [material.foil.diffraction]
  type = \"grating\"
  relief = { depth_um = 0.15 }
  maps = \"orientation.exr\"        # from nacre reconstruct polarization
  period_um = 1.5
  reflectance = \"aluminium\"

Writes FILE.png and FILE.exr: R G B (linear sRGB), the standard error of the luminance, and spectra with --spectral-nm.")]
pub struct Args {
    /// Scene (TOML). Relative paths in it start from its folder.
    #[arg(required_unless_present = "gallery")]
    scene: Option<PathBuf>,
    /// Picture (EXR); a PNG is written beside it. With --frames: a folder.
    #[arg(long, value_name = "FILE.exr", required_unless_present = "gallery")]
    out: Option<PathBuf>,
    /// Write example scenes into this folder and render them.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["scene", "out", "frames", "keep"])]
    gallery: Option<PathBuf>,
    /// With --gallery: only these scenes, such as cd,cd-room.
    #[arg(long, value_name = "NAMES", value_delimiter = ',', requires = "gallery")]
    scenes: Vec<String>,
    /// With --gallery: also render the snake with the skin in this height field (image, EXR or text, as for nacre brdf
    /// map).
    #[arg(long, value_name = "FILE", requires = "gallery")]
    skin: Option<PathBuf>,
    /// Pixel pitch of --skin in µm (default: as stated in the file).
    #[arg(long, value_name = "UM", requires = "skin")]
    pixel_um: Option<f64>,
    /// Height range of --skin in µm, from black to white (default: as stated in the file).
    #[arg(long, value_name = "UM", requires = "skin")]
    range_um: Option<f64>,
    #[command(flatten)]
    options: Flags<Options>,
    /// Save progress to this file every ten seconds and at the end.
    #[arg(long, value_name = "FILE.exr")]
    keep: Option<PathBuf>,
    /// Resume from the file of --keep.
    #[arg(long, requires = "keep")]
    resume: bool,
    /// Number of frames of a full turn (at most 10000).
    #[arg(long, value_name = "N", requires = "turn")]
    frames: Option<usize>,
    /// Part of the scene to rotate about the z axis.
    #[arg(long, value_enum, requires = "frames")]
    turn: Option<Turning>,
    /// Render on a graphics card. Falls back to the processor without a suitable card, or for unsupported scenes.
    #[arg(long)]
    gpu: bool,
    /// Alias of --method samples.
    #[arg(long, conflicts_with = "method")]
    by_chance: bool,
    /// Replace existing files.
    #[arg(long)]
    force: bool,
    /// Render a few passes, then only print the predicted time, memory and disk space.
    #[arg(long, conflicts_with = "gallery")]
    estimate: bool,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum Turning {
    /// The lights.
    Light,
    /// The camera.
    View,
    /// The shapes.
    Sample,
}

/// Maximum number of frames of an animation.
const MOST_FRAMES: usize = 10_000;

/// Renders a scene, an animation or the gallery.
pub fn run(args: &Args, console: &Console) -> Result<(), Failure> {
    if let Some(folder) = &args.gallery {
        return render_gallery(args, folder, console);
    }
    let (Some(scene), Some(out)) = (&args.scene, &args.out) else {
        return Err(Error::input("scene", "is none", "give a scene and --out FILE.exr").into());
    };
    let folder = scene.parent().unwrap_or(Path::new("")).to_path_buf();
    let scene = Scene::read(scene)?;
    // Registered before they are read, so that an output that would overwrite an input is refused before rendering.
    input::remember(scene.files().into_iter().map(|(_, file)| folder.join(file)));
    if let Some(keep) = args.keep.as_ref().filter(|_| !args.resume) {
        writable(keep)?;
    }
    match (args.frames, args.turn) {
        (Some(frames), Some(turning)) => animation(args, (scene, &folder), out, (frames, turning), console),
        _ => single(args, &scene, &folder, out, console),
    }
}

impl Args {
    fn settings(&self) -> Result<Settings, Failure> {
        let options = self.options.options()?;
        if options.spectral_nm.is_some()
            && (self.keep.is_some() || self.frames.is_some() || self.gallery.is_some() || self.gpu)
        {
            let problem = "does not go with --keep, --frames, --gallery and --gpu";
            return Err(Error::input("--spectral-nm", problem, "leave one of them out").into());
        }
        let method = if self.by_chance { Method::Samples } else { options.method };
        let (keep, resume, gpu) = (self.keep.clone(), self.resume, self.gpu);
        Ok(Settings { method, keep, resume, gpu, ..options.settings() })
    }

    /// Fails if the noise or the two-pass error exceeds the requested bound.
    fn judge(&self, (noise, two_passes): (f64, f64)) -> Result<(), Failure> {
        let wanted = self.options.options()?.max_error;
        match self.options.is_given("max_error") {
            true if two_passes > wanted => Err(Failure::Bound(format!(
                "two passes are off by {two_passes:.2e} of the mean (measured), more than the {wanted} asked for: leave out --method, or allow a larger --max-error"
            ))),
            true if noise > wanted => Err(Failure::Bound(format!(
                "the noise is {noise:.2e} of the mean, more than the {wanted} asked for: allow more --samples"
            ))),
            _ => Ok(()),
        }
    }
}

fn single(args: &Args, scene: &Scene, folder: &Path, out: &Path, console: &Console) -> Result<(), Failure> {
    let png = out.with_extension("png");
    vacant(&[out.to_path_buf(), png.clone()], args.force)?;
    let (picture, mut report) = render(scene, folder, &args.settings()?, console)?;
    write_picture(out, &picture)?;
    write_png(&png, &picture, scene.exposure.unwrap_or_else(|| exposure(&picture)))?;
    report.files = vec![out.to_path_buf(), png];
    console.result(&report.summary(), &report);
    args.judge((report.noise, two_passes(&report)))
}

/// Renders a full turn into a folder; all frames use the exposure of the first.
fn animation(
    args: &Args,
    (mut scene, folder): (Scene, &Path),
    out: &Path,
    (frames, turning): (usize, Turning),
    console: &Console,
) -> Result<(), Failure> {
    if !(1..=MOST_FRAMES).contains(&frames) {
        let problem = format!("are {frames}");
        return Err(Error::input("frames", problem, format!("give 1 to {MOST_FRAMES}")).into());
    }
    if args.keep.is_some() {
        return Err(Error::input("keep", "is for one picture", "leave it out").into());
    }
    let target = OutputFolder::begin(out, args.force)?;
    let (start, mut reports, mut worst) = (scene.turn, vec![], (0.0_f64, 0.0_f64));
    for k in 0..frames {
        let turn = 360.0 * k as f64 / frames as f64;
        scene.turn = start;
        match turning {
            Turning::Light => scene.turn.light_deg += turn,
            Turning::View => scene.turn.view_deg += turn,
            Turning::Sample => scene.turn.sample_deg += turn,
        }
        let (picture, report) = render(&scene, folder, &args.settings()?, &OneOf { console, frames })?;
        let name = |ending: &str| format!("frame_{k:04}.{ending}");
        write_picture(&target.path(&name("exr")), &picture)?;
        let shown = *scene.exposure.get_or_insert_with(|| exposure(&picture));
        write_png(&target.path(&name("png")), &picture, shown)?;
        worst = (worst.0.max(report.noise), worst.1.max(two_passes(&report)));
        reports.push(report);
    }
    target.write_json("report.json", &reports)?;
    target.commit()?;
    let noise = worst.0;
    let text = format!("frames    {frames} in {}\nquality   noise {noise:.2e} of the mean or less", out.display());
    console.result(&text, &reports);
    args.judge(worst)
}

/// Progress of one frame of several. Every frame is expected to take as long as the first.
struct OneOf<'a> {
    console: &'a Console,
    frames: usize,
}

impl Progress for OneOf<'_> {
    fn expect(&self, work: &Work) -> Result<(), Error> {
        let (frames, speed) = (self.frames as f64, Machine::here().speed);
        let others = (frames - 1.0) * (work.seconds + work.taken_s * speed);
        let disk_bytes = self.frames as u64 * work.disk_bytes;
        self.console.expect(&Work { seconds: work.seconds + others, disk_bytes, ..work.clone() })
    }

    fn stage(&self, name: &str, steps: u64) {
        self.console.stage(name, steps);
    }

    fn step(&self) {
        self.console.step();
    }

    fn cancelled(&self) -> bool {
        self.console.cancelled()
    }
}

fn render_gallery(args: &Args, folder: &Path, console: &Console) -> Result<(), Failure> {
    let scale = Scale { pixel_um: args.pixel_um, range_um: args.range_um, ..Scale::default() };
    let skin = args.skin.as_ref().map(|path| height::read(path, &scale)).transpose()?;
    let target = OutputFolder::begin(folder, args.force)?;
    let measured = skin.map(|skin| gallery_skin(&target, &skin)).transpose()?;
    let measured = measured.iter().flatten().map(|name| (*name).to_owned());
    let scenes: Vec<String> = if args.scenes.is_empty() {
        // The measured skin comes first, so that a height field that is too coarse is refused before other scenes are
        // rendered.
        measured.chain(gallery(&target)?).collect()
    } else {
        let measured: Vec<String> = measured.collect();
        for name in args.scenes.iter().filter(|name| !measured.contains(name)) {
            gallery_scene(&target, name)?;
        }
        args.scenes.clone()
    };
    let (mut reports, mut text, mut worst) = (vec![], String::new(), (0.0_f64, 0.0_f64));
    for name in scenes {
        let path = target.path(&format!("{name}.toml"));
        let scene = Scene::read(&path)?;
        let (picture, report) = render(&scene, &target.path(""), &args.settings()?, console)?;
        write_picture(&target.path(&format!("{name}.exr")), &picture)?;
        let shown = scene.exposure.unwrap_or_else(|| exposure(&picture));
        write_png(&target.path(&format!("{name}.png")), &picture, shown)?;
        let _ =
            writeln!(text, "{name:24} {} samples, noise {:.2e}, {:.1} s", report.samples, report.noise, report.seconds);
        worst = (worst.0.max(report.noise), worst.1.max(two_passes(&report)));
        reports.push(serde_json::json!({ "scene": name, "report": report }));
    }
    target.write_json("report.json", &reports)?;
    target.commit()?;
    let _ = write!(text, "results   {}", folder.display());
    console.result(&text, &reports);
    args.judge(worst)
}

/// Largest error among the shapes rendered by the two-pass method.
fn two_passes(report: &Report) -> f64 {
    let used = report.environments.iter().filter(|e| e.method == "two-pass");
    used.map(|e| e.measured_error).fold(0.0, f64::hypot)
}
