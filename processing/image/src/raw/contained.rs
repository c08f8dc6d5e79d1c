//! Decodes camera raw files in a process of its own where the program allows it (`nacre_base::contained`): a damaged file can make the
//! third-party decoder ask for any amount of memory, abort or never end. In other programs it is decoded here.

use std::path::{Path, PathBuf};

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

/// Most processor time of a decoder, in s; the largest files take a few.
const PROCESSOR_S: u64 = 120;

/// A camera raw file to be decoded by another process.
#[derive(Debug, Serialize, Deserialize)]
pub struct Decoding {
    file: PathBuf,
    part: Wanted,
}

#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Wanted {
    Info,
    Pixels,
    Levels,
    Exposure,
}

/// An [`Info`] on its way; samples have 16 bits or are floats.
#[derive(Serialize, Deserialize)]
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
        decode(&self.file, || {
            let mut source = open(&self.file)?;
            let Format::Raw(kind) = sniff(&mut source)? else { return Err(Fault::unusable("has changed", RENEW)) };
            let value = match self.part {
                Wanted::Info => json!(Header::from(decoder::info(source, kind)?)),
                Wanted::Levels => json!(decoder::levels(source, kind)?),
                Wanted::Exposure => json!(decoder::exposure(source, kind)),
                Wanted::Pixels => {
                    let raster = decoder::read(source, kind)?;
                    let value = json!(Header::from(raster.info()));
                    let bytes = match raster.samples {
                        Samples::U8(samples) => samples,
                        Samples::U16(samples) => bytemuck::cast_slice(&samples).to_vec(),
                        Samples::F32(samples) => bytemuck::cast_slice(&samples).to_vec(),
                    };
                    return Ok(Part { value, bytes });
                }
            };
            Ok(Part { value, bytes: vec![] })
        })
    }
}

/// Has a process decode a part of a file.
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

pub(crate) fn info(path: &Path, source: Source, kind: Kind) -> Decoded<Info> {
    if !registered() {
        return decoder::info(source, kind);
    }
    value::<Header>(ask(path, Wanted::Info)?)?.info()
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
    if registered() { value(ask(path, Wanted::Levels)?) } else { decoder::levels(source, kind) }
}

pub(crate) fn exposure(path: &Path, source: Source, kind: Kind) -> Option<Taken> {
    if registered() { value(ask(path, Wanted::Exposure).ok()?).ok()? } else { decoder::exposure(source, kind) }
}
