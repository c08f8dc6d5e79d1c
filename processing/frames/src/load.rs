//! Reading and validation of `frames.json`, which may come from any source and is not trusted.

use super::{
    Calibration, Channel, Distances, FILE_NAME, FrameSet, Fringes, Kind, Layout, SESSION_FILE, Spot, Transfer,
};
use super::{linear::is_relative, stated::Stated};
use nacre_base::text::{from_json, read_text};
use nacre_base::{Error, Result};
use nacre_image::{Info, Raster, Samples, details, read};
use std::path::{Component, Path, PathBuf};

/// Maximum size of a `frames.json`; 10,000 frames need about 1 MiB.
const MAX_BYTES: u64 = 16 << 20;

/// A validated set: all files exist inside the folder and share size, depth and number of channels.
#[derive(Clone, Debug)]
pub struct LoadedFrames {
    /// The `frames.json` itself, for messages.
    pub path: PathBuf,
    /// Folder to which file names are relative.
    pub folder: PathBuf,
    /// Validated contents.
    pub set: FrameSet,
    /// Properties common to all photographs.
    pub info: Info,
    /// Warnings for the report: contradictions between description and files, and unread parts of files.
    pub warnings: Vec<String>,
    /// True for photographs from a capture session: a grating lit by the panel, behind a motorised or hand-rotated
    /// analyser.
    pub from_session: bool,
}

impl LoadedFrames {
    /// Path of one of the set's files.
    pub fn file(&self, name: &Path) -> PathBuf {
        self.folder.join(name)
    }
}

/// Reads and validates a session folder, a folder with a `frames.json`, or a `frames.json`.
///
/// # Errors
/// `Input`, naming the file or key; pixels are not decoded.
pub fn load(input: &Path) -> Result<LoadedFrames> {
    let path = if input.is_dir() { input.join(FILE_NAME) } else { input.to_path_buf() };
    let set = parse(&path)?;
    complete(path, set, By::File)
}

/// Validates a set whose `frames.json` will be at `path`. The set stems from options, so messages name flags rather
/// than keys.
///
/// # Errors
/// As [`load`].
pub fn check(path: PathBuf, set: FrameSet) -> Result<LoadedFrames> {
    complete(path, set, By::Options)
}

fn complete(path: PathBuf, mut set: FrameSet, by: By) -> Result<LoadedFrames> {
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent.to_path_buf(),
        _ => PathBuf::from("."),
    };
    check_values(&path, &set, by)?;
    let (info, stated) = check_files(&path, &folder, &set)?;
    let mut warnings = stated.complete(&mut set);
    warnings.extend(check_channels(&folder.join(&set.frames[0].file), &mut set, &info, by)?);
    let from_session = folder.join(SESSION_FILE).is_file();
    Ok(LoadedFrames { path, folder, set, info, warnings, from_session })
}

/// A set of photographs that a session still captures into `folder`; `info` gives their common properties.
///
/// # Errors
/// `Input` for invalid values; files are not checked.
pub fn planned(folder: &Path, set: FrameSet, info: Info) -> Result<LoadedFrames> {
    let path = folder.join(FILE_NAME);
    check_values(&path, &set, By::File)?;
    Ok(LoadedFrames { path, folder: folder.to_path_buf(), set, info, warnings: vec![], from_session: true })
}

/// Source of a description, which determines the terms in messages.
#[derive(Clone, Copy)]
enum By {
    /// A `frames.json`, with keys.
    File,
    /// Options of a command, with flags.
    Options,
}

impl By {
    /// Key of the set, or its flag.
    fn name(self, key: &str) -> String {
        let option = key.split('.').next().unwrap_or(key);
        match self {
            Self::File => key.to_owned(),
            Self::Options => format!("--{}", option.replace('_', "-")),
        }
    }

    /// Key of a frame, or its photograph.
    fn of_frame(self, set: &FrameSet, i: usize, key: &str) -> String {
        match (self, set.frames.get(i)) {
            (Self::Options, Some(frame)) => {
                format!("{}: {}", frame.file.display(), key.replace("_deg", " angle").replace("_s", ""))
            }
            _ => format!("frames[{i}].{key}"),
        }
    }

    fn refuse(self, path: &Path, name: &str, problem: String, remedy: &str) -> Error {
        match self {
            Self::File => Error::file(path, format!("{name}: {problem}"), remedy),
            Self::Options => Error::input(name, problem, remedy),
        }
    }
}

/// Text of a `frames.json`, one frame per line.
pub fn save(set: &FrameSet) -> String {
    // Serialising plain data with string keys cannot fail.
    let mut value = serde_json::to_value(set).unwrap_or_default();
    let frames = value.as_object_mut().and_then(|o| o.remove("frames")).unwrap_or_default();
    let lines: Vec<String> = frames.as_array().into_iter().flatten().map(|f| format!("    {f}")).collect();
    let head: Vec<String> =
        value.as_object().into_iter().flatten().map(|(k, v)| format!("  \"{k}\": {v},\n")).collect();
    format!("{{\n{}  \"frames\": [\n{}\n  ]\n}}\n", head.concat(), lines.join(",\n"))
}

fn parse(path: &Path) -> Result<FrameSet> {
    let remedy = format!("give a session folder, a {FILE_NAME} or a folder holding one (`nacre import` makes one)");
    let text = read_text(path, MAX_BYTES, &remedy)?;
    from_json(&text)
        .map_err(|problem| Error::file(path, problem, "correct it; `nacre schema frames` prints what is allowed"))
}

fn check_values(path: &Path, set: &FrameSet, by: By) -> Result<()> {
    let bad_part = |name: &str, problem: String, remedy: &str| Err(by.refuse(path, name, problem, remedy));
    let bad = |key: &str, problem: String, remedy: &str| bad_part(&by.name(key), problem, remedy);
    if set.frames.is_empty() {
        return bad("frames", "holds no frame".into(), "list at least one photograph");
    }
    if let Some((key, problem)) = set.transfer.problem() {
        return bad(key, problem, "correct it, such as {\"gamma\": 2.2}");
    }
    if set.transfer == Transfer::Recover && set.kind != Kind::Exposures {
        let remedy =
            "say how the files encode light, or recover it with `nacre reconstruct hdr` from exposures of one view";
        return bad("transfer", "recover is for kind exposures".into(), remedy);
    }
    if let (Some(black), Some(white)) = (set.black, set.white)
        && black >= white
    {
        return bad(
            "black",
            format!("{black} is not below white ({white})"),
            "give the file values of no and of full light",
        );
    }
    let positive_part = |name: &str, value: Option<f64>| match value {
        Some(v) if !(v.is_finite() && v > 0.0) => bad_part(name, format!("{v} is not above 0"), "correct the number"),
        _ => Ok(()),
    };
    let positive = |key: &str, value: Option<f64>| positive_part(&by.name(key), value);
    for (i, frame) in set.frames.iter().enumerate() {
        let name = |key: &str| by.of_frame(set, i, key);
        positive_part(&name("exposure_s"), frame.exposure_s)?;
        positive_part(&name("gain"), frame.gain)?;
        if !frame.scale().is_finite() || frame.scale() == 0.0 {
            return bad_part(&name("exposure_s · gain"), "is out of range".into(), "correct the numbers");
        }
        let angle = name("analyser_deg");
        match (set.kind, frame.analyser_deg) {
            (Kind::Polarization, None) => return bad_part(&angle, "is missing".into(), "give the analyser's angle"),
            (Kind::DivisionOfFocalPlane, Some(_)) => {
                return bad_part(&angle, "does not belong to this kind".into(), "remove it or change kind");
            }
            (_, Some(a)) if !a.is_finite() || a.abs() > 1e6 => {
                return bad_part(&angle, format!("{a} is no angle in degrees"), "correct it");
            }
            _ => {}
        }
    }
    if let Some((key, problem)) = set.calibration.as_ref().and_then(Calibration::problem) {
        return bad(key, problem, "correct it, or remove it to do without this calibration");
    }
    check_light(&bad, set)?;
    positive("wavelength_nm", set.wavelength_nm)?;
    positive("band_nm", set.band_nm)?;
    positive("noise.full_scale_e", set.noise.map(|n| n.full_scale_e))?;
    if let Some(n) = set.noise
        && n.read_noise_e < 0.0
    {
        return bad("noise.read_noise_e", format!("{} is negative", n.read_noise_e), "correct the number");
    }
    if let Some(sigma) = set.angle_sigma_deg.filter(|v| !(0.0..=45.0).contains(v)) {
        return bad("angle_sigma_deg", format!("{sigma} is no accuracy"), "give degrees from 0 to 45, or leave it out");
    }
    if let Some(Distances { distance_mm, baseline_mm, pixel_um, camera_px }) = set.geometry {
        positive("geometry.distance_mm", Some(distance_mm))?;
        positive("geometry.pixel_um", pixel_um)?;
        let near = |v: f64| v.abs() <= 1e6;
        if !near(baseline_mm) || !camera_px.is_none_or(|at| at.into_iter().all(near)) {
            return bad("geometry", format!("{baseline_mm} mm, {camera_px:?} is no place"), "correct the numbers");
        }
    }
    if let Some([w, h]) = set.panel_mm.filter(|s| !s.iter().all(|mm| (1.0..=1e5).contains(mm))) {
        return bad("panel_mm", format!("{w} × {h} mm is no panel"), "give its width and height in mm");
    }
    if let Some(problem) = set.material.and_then(|m| m.problem()) {
        return bad("material", problem.into(), "correct the numbers");
    }
    check_layout(&bad, set)
}

/// Validates the keys of polarization sensors: `layout`, `colour` and `channel`.
fn check_layout(bad: &impl Fn(&str, String, &str) -> Result<()>, set: &FrameSet) -> Result<()> {
    let of_sensor = set.kind == Kind::DivisionOfFocalPlane;
    let key = if set.layout.is_some() { "layout" } else { "colour" };
    if !of_sensor && (set.layout.is_some() || set.colour.is_some()) {
        return bad(key, "belongs to kind division_of_focal_plane only".into(), "remove it or change kind");
    }
    match set.layout {
        None if of_sensor => {
            let remedy = "give the sensor's name, such as sony, or the angles of the 2×2 block, [[90,45],[135,0]] for many sensors";
            return bad("layout", "is missing".into(), remedy);
        }
        Some(Layout::Named(_)) if set.colour.is_some() => {
            return bad("colour", "is given beside a layout with a name, which states it".into(), "remove it");
        }
        Some(Layout::Angles(angles)) if !angles.as_flattened().iter().all(|a| a.abs() <= 1e6) => {
            return bad("layout", format!("{angles:?} are no angles in degrees"), "correct them");
        }
        _ => {}
    }
    if set.channel == Some(Channel::Luminance) && set.filters().is_none_or(|f| f.colour.is_none()) {
        let remedy = "give r, g or b, or the layout of a colour sensor";
        return bad("channel", "luminance is of colour polarization sensors".into(), remedy);
    }
    Ok(())
}

/// Validates keys specific to some kinds of set, and the values of spots.
fn check_light(bad: &impl Fn(&str, String, &str) -> Result<()>, set: &FrameSet) -> Result<()> {
    let by_frame = matches!(set.kind, Kind::Exposures | Kind::Flash | Kind::Spots | Kind::Free);
    for (i, frame) in set.frames.iter().enumerate() {
        let key = |name: &str| format!("frames[{i}].{name}");
        let present = [
            ("spot", frame.spot.is_some()),
            ("fringes", frame.fringes.is_some()),
            ("flash", frame.flash.is_some()),
            ("light_mm", frame.light_mm.is_some()),
        ];
        if let Some((name, _)) = present.iter().find(|p| p.1 && !by_frame) {
            return bad(&key(name), "does not belong to this kind".into(), "remove it or change kind");
        }
        if let Some(Fringes { cycles_per_mm, phase }) = frame.fringes
            && !(cycles_per_mm.iter().all(|f| f.abs() <= 100.0) && phase.abs() <= 1e6)
        {
            return bad(&key("fringes"), format!("{cycles_per_mm:?} at phase {phase} are no fringes"), "correct it");
        }
        if let Some(at) = frame.light_mm.filter(|at| !(at[2] > 0.0 && at.iter().all(|v| v.abs() <= 1e6))) {
            let remedy = "give mm right and up of the sample's middle, and above it";
            return bad(&key("light_mm"), format!("{at:?} is no place above the sample"), remedy);
        }
        match frame.spot {
            Some(_) if frame.fringes.is_some() => {
                return bad(
                    &key("spot"),
                    "is given beside fringes".into(),
                    "a panel shows one of them; remove the other",
                );
            }
            None if frame.fringes.is_some() => {}
            None if set.kind == Kind::Spots => return bad(&key("spot"), "is missing".into(), "say where the spot was"),
            Some(Spot { center_mm, diameter_mm })
                if !(center_mm.iter().all(|c| c.abs() <= 1e5) && diameter_mm > 0.0 && diameter_mm <= 1e5) =>
            {
                return bad(&key("spot"), format!("{center_mm:?}, {diameter_mm} is no disc in mm"), "correct it");
            }
            _ => {}
        }
    }
    Ok(())
}

fn check_files(path: &Path, folder: &Path, set: &FrameSet) -> Result<(Info, Stated)> {
    let extra = [("dark", &set.dark), ("flat", &set.flat)];
    let extra = extra.into_iter().filter_map(|(key, file)| Some((key.to_owned(), file.as_ref()?)));
    let indexed = || set.frames.iter().enumerate();
    let frames = indexed().map(|(i, f)| (format!("frames[{i}].file"), &f.file));
    let darks = indexed().filter_map(|(i, f)| Some((format!("frames[{i}].dark"), f.dark.as_ref()?)));
    let mut common: Option<(PathBuf, Info)> = None;
    let mut stated = Stated::default();
    for (key, name) in frames.chain(darks).chain(extra) {
        let file = inside(path, folder, &key, name)?;
        let details = details(&file)?;
        let found = details.info;
        if key == "flat" && common.as_ref().is_some_and(|(_, wanted)| is_relative(found, *wanted)) {
            continue;
        }
        stated.add(file.clone(), details);
        match &common {
            None => common = Some((file, found)),
            Some((first, wanted)) if *wanted != found => {
                return Err(Error::file(
                    &file,
                    format!("is {found}, but {} is {wanted}", first.display()),
                    "all photographs of a set must have one size, depth and number of channels",
                ));
            }
            Some(_) => {}
        }
    }
    stated.check()?;
    let Some((_, info)) = common else { return Err(Error::file(path, "holds no frame", "list a photograph")) };
    Ok((info, stated))
}

/// Accepts only relative paths inside the folder: no absolute path, no `..`, and no link that leads outside.
fn inside(path: &Path, folder: &Path, key: &str, name: &Path) -> Result<PathBuf> {
    let plain = name.components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir));
    let file = folder.join(name);
    let leaves = || {
        let problem = format!("{key}: {} leaves the folder of {FILE_NAME}", name.display());
        Error::file(path, problem, "put the photographs beside or below it")
    };
    if !plain || name.as_os_str().is_empty() {
        return Err(leaves());
    }
    let missing =
        |e| Error::file(&file, format!("cannot be read: {e}"), format!("{key} in {} names it", path.display()));
    let (real, base) = (file.canonicalize().map_err(missing)?, folder.canonicalize().map_err(missing)?);
    if real.starts_with(base) { Ok(file) } else { Err(leaves()) }
}

/// Rejects photographs whose channels do not fit the set. Selects a channel of colour photographs if the description
/// leaves it open, and returns a warning about that.
fn check_channels(file: &Path, set: &mut FrameSet, info: &Info, by: By) -> Result<Option<String>> {
    let channel = by.name("channel");
    let chosen = match (info.channels, set.channel) {
        _ if set.layout.is_some() => check_sensor(file, set, info, &channel)?,
        (1, Some(_)) => return Err(without_channels(file, &channel)),
        (3, None) if set.kind != Kind::Exposures => Some(nearest_channel("colour photographs", set, &channel)),
        _ => None,
    };
    let (black, white) = (set.black.unwrap_or(0.0), set.white.unwrap_or(info.depth.full_scale().into()));
    if black < white {
        return Ok(chosen);
    }
    let remedy = format!("correct {} and {}", by.name("black"), by.name("white"));
    Err(Error::file(file, format!("black ({black}) is not below white ({white})"), remedy))
}

/// As [`check_channels`] for polarization sensors, whose raw frames have one channel, or three equal ones.
fn check_sensor(file: &Path, set: &mut FrameSet, info: &Info, channel: &str) -> Result<Option<String>> {
    let Some(filters) = set.filters() else { return Ok(None) };
    let side = filters.block();
    if info.width % side + info.height % side > 0 || info.channels == 3 && !is_grey(&read(file)?) {
        let problem =
            format!("is {info}; a raw frame of this sensor is grey, with width and height that {side} divides");
        return Err(Error::file(file, problem, "give the camera's raw, not demosaicked frame"));
    }
    let equal = (info.channels == 3).then_some("red, green and blue are equal: taken as grey");
    Ok(match (filters.colour, set.channel) {
        (None, Some(_)) if equal.is_none() => return Err(without_channels(file, channel)),
        (Some(_), None) => Some(nearest_channel("colour polarization sensor", set, channel)),
        (Some(_), Some(_)) => None,
        (None, _) => {
            set.channel = None;
            equal.map(str::to_owned)
        }
    })
}

fn without_channels(file: &Path, channel: &str) -> Error {
    Error::file(file, "is grey, so it has no channels to choose from", format!("leave out {channel}"))
}

/// Selects the channel of `what` closest to the set's wavelength, and returns a sentence about it.
fn nearest_channel(what: &str, set: &mut FrameSet, channel: &str) -> String {
    let nearest = set.wavelength_nm.map_or(Channel::G, Channel::nearest);
    set.channel = Some(nearest);
    let reason = set.wavelength_nm.map_or(String::new(), |nm| format!(", the nearest to {nm} nm,"));
    format!("{what}: the {} channel{reason} is used; {channel} chooses another", nearest.name())
}

/// True if red, green and blue are equal in all pixels.
fn is_grey(raster: &Raster) -> bool {
    fn equal<T: PartialEq>(values: &[T]) -> bool {
        values.chunks_exact(3).all(|p| p[0] == p[1] && p[1] == p[2])
    }
    match &raster.samples {
        Samples::U8(v) => equal(v),
        Samples::U16(v) => equal(v),
        Samples::F32(v) => equal(v),
    }
}
