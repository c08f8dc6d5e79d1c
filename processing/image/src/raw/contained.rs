//! Decoding of camera raw files in a separate process, where the program provides one (`nacre_base::contained`).
//!
//! A damaged file can make the third-party decoder allocate without limit, abort, or never end. Other programs decode
//! in their own process.

use std::collections::HashMap;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::{LazyLock, Mutex, PoisonError};

use nacre_base::contained::{Death, Ended, Limits, Part, registered, run};
use nacre_base::progress::Silent;
use nacre_base::{Error, Result};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::budget;
use crate::fault::{Decoded, Fault, RENEW};
use crate::raster::{Depth, Info, Raster, Samples};
use crate::read::{Format, sniff};
use crate::source::{Source, decode, open};

use super::recognise::Kind;
use super::{Taken, decode as decoder};

/// Largest processor time of a decoder in s; the largest files take a few.
const PROCESSOR_S: u64 = 120;

/// Request to decode a camera raw file in another process.
#[derive(Debug, Serialize, Deserialize)]
pub struct Decoding {
    file: PathBuf,
    part: Wanted,
}

#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Wanted {
    Statements,
    Pixels,
}

/// All statements of a file besides its pixels. One process reads them together, because starting a process takes
/// longer.
#[derive(Clone, Serialize, Deserialize)]
struct Statements {
    header: Header,
    levels: Decoded<Option<[f64; 2]>>,
    exposure: Option<Taken>,
}

/// Serialised [`Info`]; samples have 16 bits or are floats.
#[derive(Clone, Serialize, Deserialize)]
struct Header {
    size: [usize; 2],
    channels: usize,
    float: bool,
}

impl From<Info> for Header {
    fn from(info: Info) -> Self {
        Self { size: [info.width, info.height], channels: info.channels, float: info.depth == Depth::F32 }
    }
}

impl Header {
    fn info(self) -> Decoded<Info> {
        let depth = if self.float { Depth::F32 } else { Depth::U16 };
        let stored = self.channels as u64;
        Info::checked(self.size.map(|side| side as u64), self.channels, depth, stored, depth.bytes() as u64)
    }
}

impl Decoding {
    /// Decodes the file in this process.
    ///
    /// # Errors
    /// `Input`, naming the file.
    pub fn perform(&self) -> Result<Part> {
        misbehave();
        decode(&self.file, || {
            let mut source = open(&self.file)?;
            let Format::Raw(kind) = sniff(&mut source)? else { return Err(Fault::unusable("has changed", RENEW)) };
            match self.part {
                Wanted::Statements => {
                    // Decoders keep the file that they are given.
                    let header = decoder::info(source, kind)?.into();
                    let exposure = decoder::exposure(open(&self.file)?, kind);
                    let levels = decoder::levels(open(&self.file)?, kind);
                    Ok(Part { value: json!(Statements { header, levels, exposure }), bytes: vec![] })
                }
                Wanted::Pixels => {
                    let raster = decoder::read(source, kind)?;
                    let value = json!(Header::from(raster.info()));
                    let bytes = match raster.samples {
                        Samples::U8(samples) => samples,
                        Samples::U16(samples) => bytemuck::cast_slice(&samples).to_vec(),
                        Samples::F32(samples) => bytemuck::cast_slice(&samples).to_vec(),
                    };
                    Ok(Part { value, bytes })
                }
            }
        })
    }
}

/// Aborts or hangs as with a damaged file if `NACRE_DECODER` is `abort` or `loop`; for tests, not in release builds.
fn misbehave() {
    if cfg!(debug_assertions) {
        match std::env::var("NACRE_DECODER").as_deref() {
            Ok("abort") => std::process::abort(),
            Ok("loop") => loop {
                std::hint::spin_loop();
            },
            _ => {}
        }
    }
}

/// Lets another process decode a part of a file.
fn ask(file: &Path, part: Wanted) -> Decoded<Part> {
    let decoding = Decoding { file: std::path::absolute(file)?, part };
    let limits = Limits { memory: budget::allowed(), processor_s: Some(PROCESSOR_S), background: false };
    run(json!({ "decode": decoding }), limits, &Silent, &mut |_| ()).map_err(|ended| match ended {
        Ended::Error(Error::Input { problem, remedy, .. }) => Fault::unusable(problem, remedy),
        Ended::Error(error) => Fault::unusable(format!("cannot be decoded: {error}"), RENEW),
        Ended::Died(death) => {
            let remedy = match death {
                Death::Memory(_) | Death::Killed => {
                    "convert it to a linear 16-bit TIFF with another program, or raise the memory limit"
                }
                Death::Time(_) | Death::Crashed(_) => RENEW,
                Death::NotStarted(_) => "free some memory",
            };
            Fault::unusable(format!("cannot be decoded: its decoder {death}"), remedy)
        }
    })
}

fn value<T: DeserializeOwned>(part: Part) -> Decoded<T> {
    serde_json::from_value(part.value).map_err(|e| Fault::damaged(format!("its decoder answers {e}")))
}

/// Number of files whose statements are cached.
const MOST_KNOWN: usize = 1024;

/// Device, inode, length, and times of the last changes of contents and inode: a replaced or modified file has another
/// identity.
type Identity = ([u64; 3], [i64; 4]);

static KNOWN: LazyLock<Mutex<HashMap<Identity, Statements>>> = LazyLock::new(Mutex::default);

/// Statements of a file, from the cache or another process.
fn statements(path: &Path, source: &Source) -> Decoded<Statements> {
    let found = source.get_ref().metadata()?;
    let identity = (
        [found.dev(), found.ino(), found.len()],
        [found.mtime(), found.mtime_nsec(), found.ctime(), found.ctime_nsec()],
    );
    let known = || KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(statements) = known().get(&identity) {
        return Ok(statements.clone());
    }
    let statements: Statements = value(ask(path, Wanted::Statements)?)?;
    let mut known = known();
    if known.len() >= MOST_KNOWN {
        known.clear();
    }
    known.insert(identity, statements.clone());
    Ok(statements)
}

pub(crate) fn info(path: &Path, source: Source, kind: Kind) -> Decoded<Info> {
    if registered() { statements(path, &source)?.header.info() } else { decoder::info(source, kind) }
}

pub(crate) fn read(path: &Path, source: Source, kind: Kind) -> Decoded<Raster> {
    if !registered() {
        return decoder::read(source, kind);
    }
    let Part { value: header, bytes } = ask(path, Wanted::Pixels)?;
    let info = value::<Header>(Part { value: header, bytes: vec![] })?.info()?;
    if bytes.len() != info.len() * info.depth.bytes() {
        return Err(Fault::damaged("its decoder delivers another number of pixels than it says"));
    }
    info.raster(match info.depth {
        Depth::U8 => Samples::U8(bytes),
        Depth::U16 => Samples::U16(bytemuck::pod_collect_to_vec(&bytes)),
        Depth::F32 => Samples::F32(bytemuck::pod_collect_to_vec(&bytes)),
    })
}

pub(crate) fn levels(path: &Path, source: Source, kind: Kind) -> Decoded<Option<[f64; 2]>> {
    if registered() { statements(path, &source)?.levels } else { decoder::levels(source, kind) }
}

pub(crate) fn exposure(path: &Path, source: Source, kind: Kind) -> Option<Taken> {
    if registered() { statements(path, &source).ok()?.exposure } else { decoder::exposure(source, kind) }
}
