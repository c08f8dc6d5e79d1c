//! Photographs of even light or of darkness, grouped by exposure time.

use nacre_base::progress::Progress;
use nacre_base::{Error, Result};
use nacre_frames::{FILE_NAME, Frame, Tagged, exposures, load};
use nacre_image::{Depth, Info, Samples, info, photographs, read};
use std::path::{Path, PathBuf};

/// Smallest number of photographs of one exposure: their differences hold noise alone.
const LEAST: usize = 2;

/// Photographs of equal exposure.
#[derive(Clone, Debug)]
pub struct Group {
    /// Exposure time in s.
    pub exposure_s: f64,
    /// Their files.
    pub files: Vec<PathBuf>,
}

/// A folder of photographs.
#[derive(Clone, Debug)]
pub struct Series {
    /// The folder.
    pub folder: PathBuf,
    /// Groups by rising exposure, of at least two photographs each.
    pub groups: Vec<Group>,
    /// Size, channels and depth of all.
    pub info: Info,
    /// Gain of all photographs relative to the camera's base, as in a `frames.json`.
    pub gain: f64,
    /// Value of a saturated pixel in DN, if a `frames.json` states it.
    pub white: Option<f64>,
    /// Groups that were left out.
    pub warnings: Vec<String>,
}

impl Series {
    /// Lists a folder with a `frames.json`, or photographs that state their exposures (Exif).
    ///
    /// # Errors
    /// `Input` if exposures are unknown, gains or sizes differ, or no exposure has two photographs.
    pub fn list(folder: &Path) -> Result<Self> {
        if !folder.join(FILE_NAME).is_file() {
            return Self::grouped(folder, tagged(folder)?, None);
        }
        let frames = load(folder)?;
        let file = |frame: &Frame| frames.file(&frame.file);
        Self::grouped(folder, described(&frames.set.frames, &file)?, frames.set.white)
    }

    /// Lists the dark photographs that the frames of a `frames.json` name.
    ///
    /// # Errors
    /// As [`Series::list`]; without a `frames.json`, or with frames that name none.
    pub fn darks_of(folder: &Path) -> Result<Self> {
        let without = || Error::input("darks", "are not given", "give a folder of photographs with the lens covered");
        if !folder.join(FILE_NAME).is_file() {
            return Err(without());
        }
        let frames = load(folder)?;
        let mut named: Vec<Frame> = vec![];
        for frame in &frames.set.frames {
            if frame.dark.is_some() && !named.iter().any(|other| other.dark == frame.dark) {
                named.push(frame.clone());
            }
        }
        if named.is_empty() {
            return Err(without());
        }
        let file = |frame: &Frame| frames.file(frame.dark.as_deref().unwrap_or(&frame.file));
        Self::grouped(folder, described(&named, &file)?, frames.set.white)
    }

    fn grouped(folder: &Path, all: Described, white: Option<f64>) -> Result<Self> {
        let Described { gain, photographs } = all;
        let mut groups: Vec<Group> = vec![];
        for (file, exposure_s) in photographs {
            match groups.iter_mut().find(|g| (g.exposure_s - exposure_s).abs() <= 1e-6 * exposure_s) {
                Some(group) => group.files.push(file),
                None => groups.push(Group { exposure_s, files: vec![file] }),
            }
        }
        let (enough, few): (Vec<Group>, Vec<Group>) = groups.into_iter().partition(|g| g.files.len() >= LEAST);
        let few: Vec<String> = few.iter().map(|g| format!("{} s", g.exposure_s)).collect();
        let warnings = if few.is_empty() {
            vec![]
        } else {
            vec![format!("{}: one photograph alone at {}, left out", folder.display(), few.join(", "))]
        };
        let mut groups = enough;
        groups.sort_by(|a, b| a.exposure_s.total_cmp(&b.exposure_s));
        let Some(first) = groups.first() else {
            let remedy = "take each exposure twice or more, without changing anything in between";
            return Err(Error::file(folder, "has no two photographs of one exposure", remedy));
        };
        let info = info(&first.files[0])?;
        for file in groups.iter().flat_map(|g| &g.files) {
            same(file, info)?;
        }
        Ok(Self { folder: folder.to_owned(), groups, info, gain, white, warnings })
    }

    /// Number of photographs.
    pub fn count(&self) -> usize {
        self.groups.iter().map(|g| g.files.len()).sum()
    }

    /// The group with the exposure nearest to this one.
    pub fn nearest(&self, exposure_s: f64) -> &Group {
        let distance = |g: &&Group| (g.exposure_s / exposure_s).ln().abs();
        // A series has at least one group.
        self.groups.iter().min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(&self.groups[0])
    }
}

/// Refuses a photograph of another size or depth.
fn same(file: &Path, wanted: Info) -> Result<()> {
    let found = info(file)?;
    let alike = |i: Info| (i.width, i.height, i.channels, i.depth);
    if alike(found) == alike(wanted) {
        return Ok(());
    }
    let problem = format!(
        "is {} × {} with {} channels, the first photograph {} × {} with {}",
        found.width, found.height, found.channels, wanted.width, wanted.height, wanted.channels
    );
    Err(Error::file(file, problem, "give photographs of one camera and one setting"))
}

/// Photographs of one gain with their exposure times in s.
struct Described {
    gain: f64,
    photographs: Vec<(PathBuf, f64)>,
}

fn described(frames: &[Frame], file: &dyn Fn(&Frame) -> PathBuf) -> Result<Described> {
    let gain_of = |frame: &Frame| frame.gain.unwrap_or(1.0);
    let gain = frames.first().map_or(1.0, gain_of);
    let one = |frame: &Frame| {
        if (gain_of(frame) - gain).abs() > 1e-6 * gain {
            let remedy = "calibrate each gain with a folder of its own";
            return Err(Error::file(&file(frame), "has another gain than the first one", remedy));
        }
        Ok((file(frame), frame.exposure_s.unwrap_or(1.0)))
    };
    Ok(Described { gain, photographs: frames.iter().map(one).collect::<Result<_>>()? })
}

fn tagged(folder: &Path) -> Result<Described> {
    let files = photographs(folder)?;
    let (tags, _) = exposures(folder, &files)?;
    let one = |(file, tag): (&PathBuf, &Tagged)| {
        let path = folder.join(file);
        if tag.gain != tags[0].gain {
            let problem = "has another sensitivity or aperture than the first one (Exif)";
            return Err(Error::file(&path, problem, "calibrate each sensitivity with a folder of its own"));
        }
        let unknown = || {
            let remedy = "write a frames.json with \"exposure_s\" of each, or keep the camera's Exif tags";
            Error::file(&path, "does not state its exposure time", remedy)
        };
        Ok((path.clone(), tag.seconds.filter(|s| *s > 0.0).ok_or_else(unknown)?))
    };
    let gain = tags.first().and_then(|tag| tag.gain).unwrap_or(1.0);
    Ok(Described { gain, photographs: files.iter().zip(&tags).map(one).collect::<Result<_>>()? })
}

/// Values of one channel of a photograph in file units (DN).
///
/// # Errors
/// `Input` for a file that cannot be read.
pub fn values(file: &Path, channel: usize, progress: &dyn Progress) -> Result<Vec<f32>> {
    progress.check()?;
    let raster = read(file)?;
    let n = raster.channels;
    let every = |count: usize, value: &dyn Fn(usize) -> f32| (channel..count).step_by(n).map(value).collect();
    Ok(match &raster.samples {
        Samples::U8(v) => every(v.len(), &|i| v[i].into()),
        Samples::U16(v) => every(v.len(), &|i| v[i].into()),
        Samples::F32(v) => every(v.len(), &|i| v[i]),
    })
}

/// Largest value of a depth, in DN.
pub fn largest(depth: Depth) -> f64 {
    match depth {
        Depth::U8 => 255.0,
        Depth::U16 => 65_535.0,
        Depth::F32 => 1.0,
    }
}
