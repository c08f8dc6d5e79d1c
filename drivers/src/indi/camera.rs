//! Cameras of INDI servers.

use super::client::{Client, New, misconfigured};
use super::fits;
use super::property::{Blob, State};
use super::rotator::localhost;
use crate::alpaca::camera::{answer_ms, check_common, download_s};
use crate::camera::commanded::{CommandedCamera, Exposer, Facts, GainUnit, Picture};
use crate::camera::measure::refresh_multiples;
use crate::{Camera, Class, Clock, DeviceError, DeviceResult};
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use flate2::read::ZlibDecoder;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::io::Read;
use std::sync::Arc;
use std::time::Duration;

const EXPOSURE: &str = "CCD_EXPOSURE";
const EXPOSURE_VALUE: &str = "CCD_EXPOSURE_VALUE";
const INFO: &str = "CCD_INFO";
const FRAME: &str = "CCD_FRAME";
const FRAME_TYPE: &str = "CCD_FRAME_TYPE";
const BINNING: &str = "CCD_BINNING";
const ABORT: &str = "CCD_ABORT_EXPOSURE";
const PICTURE: &str = "CCD1";
/// Properties and elements that hold the gain, and those that hold the offset.
const GAINS: [[&str; 2]; 2] = [["CCD_GAIN", "GAIN"], ["CCD_CONTROLS", "Gain"]];
const OFFSETS: [[&str; 2]; 2] = [["CCD_OFFSET", "OFFSET"], ["CCD_CONTROLS", "Offset"]];
/// Limits of exposures in s where a camera states none.
const EXPOSURES_S: [f64; 2] = [1e-6, 3600.0];
/// Longest side of a picture in pixels.
const MAX_SIDE: f64 = 32_768.0;

/// A camera of an INDI server.
///
/// Each exposure starts by command; pictures arrive as FITS. Colour cameras deliver the mosaic of their sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Host of the server, or host and port; the default port is 7624.
    #[serde(default = "localhost")]
    pub address: String,
    /// Name of the camera on the server.
    pub device: String,
    /// Element of `CCD_CAPTURE_FORMAT`, such as `INDI_RAW`; default: as set in the server.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub format: Option<String>,
    /// Region on the sensor in pixels: left, top, width, height; default: the whole sensor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub region: Option<[u32; 4]>,
    /// Unit of the gain control.
    #[serde(default)]
    pub gain: GainUnit,
    /// Offset in the camera's unit; default: as set in the server.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub offset: Option<f64>,
    /// Code of black; default: 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub black: Option<u16>,
    /// Code of a saturated pixel; default: the largest of the stated bits per pixel. Cameras of 12 or 14 bits may state
    /// 16.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub white: Option<u16>,
    /// Whether the camera has a shutter, for dark frames. INDI does not state it.
    #[serde(default)]
    pub shutter: bool,
    /// Refresh rate of the display in Hz: exposures should be multiples of its period.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub panel_refresh_hz: Option<f64>,
    /// Maximum time for an answer of the server, in ms.
    #[serde(default = "answer_ms")]
    pub answer_ms: u64,
    /// Maximum time between the end of an exposure and the picture, in s.
    #[serde(default = "download_s")]
    pub download_s: f64,
}

/// Opens a camera.
///
/// # Errors
/// `Setup` if the server or the camera cannot be reached, or is not usable as configured.
pub fn open(settings: &Settings, clock: &Arc<dyn Clock>) -> DeviceResult<Box<dyn Camera>> {
    let checked = check_common(settings.answer_ms, settings.download_s, settings.region);
    checked.map_err(|wrong| misconfigured(&settings.device, wrong))?;
    let limit = Duration::from_millis(settings.answer_ms);
    let client = Client::open(&settings.address, &settings.device, limit, &[EXPOSURE, INFO, FRAME, PICTURE])?;
    let camera = IndiCamera::new(client, settings).map_err(|e| e.class(Class::Setup))?;
    Ok(Box::new(CommandedCamera::new(camera, clock.clone())))
}

struct IndiCamera {
    client: Client,
    facts: Facts,
    gain: Option<[&'static str; 2]>,
    /// Largest file of a picture in bytes.
    most: usize,
}

const OPEN: &str = "open";

impl IndiCamera {
    fn new(mut client: Client, settings: &Settings) -> DeviceResult<Self> {
        set_format(&mut client, settings)?;
        let [width, height] = set_region(&mut client, settings.region)?;
        let found = |client: &Client, places: [[&'static str; 2]; 2]| {
            places.into_iter().find(|[property, element]| client.known.number(property, element).is_some())
        };
        if let Some(offset) = settings.offset {
            let place = found(&client, OFFSETS).ok_or_else(|| {
                client.error(OPEN, "an offset control", "none").remedy("leave out `offset` in the camera's settings")
            })?;
            client.set("set the offset", place[0], &[New::Number(place[1], offset)])?;
        }
        let gain = found(&client, GAINS);
        let gains = gain.and_then(|[property, element]| client.known.number(property, element)).map(|(_, range)| range);
        let exposure_s = exposures(&client);
        let bits = client.known.number(INFO, "CCD_BITSPERPIXEL").map_or(16.0, |(bits, _)| bits);
        let white = if (1.0..16.0).contains(&bits) { (1_u16 << bits as u32) - 1 } else { u16::MAX };
        let facts = Facts {
            id: client.id().to_owned(),
            width,
            height,
            exposure_s,
            exposure_step_s: 0.0,
            gains: gains.filter(|[low, high]| high > low),
            gain_unit: settings.gain,
            black: settings.black.unwrap_or(0),
            white: settings.white.unwrap_or(white),
            shutter: settings.shutter && client.known.switch(FRAME_TYPE, "FRAME_DARK").is_some(),
            steady_exposures_s: settings.panel_refresh_hz.map_or(vec![], |hz| refresh_multiples(hz, exposure_s)),
            download: Duration::from_secs_f64(settings.download_s),
            warnings: vec![],
        };
        let most = fits::most(width, height);
        client.want_pictures(PICTURE, most)?;
        Ok(Self { client, facts, gain, most })
    }
}

/// Asks for uncompressed FITS files of raw pixels, sent to this client.
fn set_format(client: &mut Client, settings: &Settings) -> DeviceResult<()> {
    const WHAT: &str = "set the format";
    for (property, element) in [
        ("UPLOAD_MODE", "UPLOAD_CLIENT"),
        ("CCD_TRANSFER_FORMAT", "FORMAT_FITS"),
        ("CCD_COMPRESSION", "INDI_DISABLED"),
        // Its name in older versions.
        ("CCD_COMPRESSION", "CCD_RAW"),
        (FRAME_TYPE, "FRAME_LIGHT"),
    ] {
        if client.known.switch(property, element).is_some() {
            client.choose(WHAT, property, element)?;
        }
    }
    match &settings.format {
        Some(format) => client.choose(WHAT, "CCD_CAPTURE_FORMAT", format),
        None => Ok(()),
    }
}

/// Sets the region without binning; returns its width and height.
fn set_region(client: &mut Client, region: Option<[u32; 4]>) -> DeviceResult<[usize; 2]> {
    const WHAT: &str = "set the region";
    let binned = |axis: &str| client.known.number(BINNING, axis).is_some_and(|(bin, _)| bin != 1.0);
    if binned("HOR_BIN") || binned("VER_BIN") {
        let one = [New::Number("HOR_BIN", 1.0), New::Number("VER_BIN", 1.0)];
        client.set("switch binning off", BINNING, &one)?;
    }
    let size = |axis: &str| client.known.number(INFO, axis).map_or(0.0, |(size, _)| size);
    let [columns, rows] = [size("CCD_MAX_X"), size("CCD_MAX_Y")];
    let [left, top, width, height] = region.map_or([0.0, 0.0, columns, rows], |region| region.map(f64::from));
    let fits = |start: f64, size: f64, all: f64| (1.0..=MAX_SIDE).contains(&size) && start + size <= all;
    if !fits(left, width, columns) || !fits(top, height, rows) {
        let expected = format!("a region within {columns} × {rows} pixels");
        let error = client.error(WHAT, expected, format!("{:?}", [left, top, width, height]));
        return Err(error.remedy("correct `region` in the camera's settings"));
    }
    let wanted = [("X", left), ("Y", top), ("WIDTH", width), ("HEIGHT", height)];
    let now = |client: &Client, name: &str| client.known.number(FRAME, name).map_or(-1.0, |(value, _)| value);
    if wanted.iter().any(|(name, value)| now(client, name) != *value) {
        client.set(WHAT, FRAME, &wanted.map(|(name, value)| New::Number(name, value)))?;
    }
    if let Some((name, value)) = wanted.iter().find(|(name, value)| now(client, name) != *value) {
        let error = client.error(WHAT, format!("{name} {value}"), now(client, name).to_string());
        return Err(error.remedy("give a region in the camera's steps"));
    }
    Ok([width as usize, height as usize])
}

fn exposures(client: &Client) -> [f64; 2] {
    let [low, high] = client.known.number(EXPOSURE, EXPOSURE_VALUE).map_or([0.0; 2], |(_, range)| range);
    let low = low.clamp(EXPOSURES_S[0], EXPOSURES_S[1]);
    [low, if high > low { high.min(EXPOSURES_S[1]) } else { EXPOSURES_S[1] }]
}

/// Reads a picture that a camera sent. `most` is the largest file in bytes.
///
/// # Errors
/// A description of the defect.
pub fn decode(blob: &Blob, most: usize) -> Result<fits::Image, String> {
    if blob.size > most {
        return Err(format!("a picture of {} bytes, more than {most}", blob.size));
    }
    let text: Vec<u8> = blob.base64.iter().copied().filter(|b| !b.is_ascii_whitespace()).collect();
    let file = BASE64_STANDARD.decode(text).map_err(|e| format!("a picture that is not base64 ({e})"))?;
    match blob.format.as_str() {
        ".fits" => fits::read(&file),
        ".fits.z" => {
            let mut plain = vec![];
            let read = ZlibDecoder::new(&*file).take(most as u64 + 1).read_to_end(&mut plain);
            read.map_err(|e| format!("a picture that cannot be decompressed ({e})"))?;
            if plain.len() > most {
                return Err(format!("a picture of more than {most} bytes"));
            }
            fits::read(&plain)
        }
        other => Err(format!("a picture in the format {:?}", other.chars().take(20).collect::<String>())),
    }
}

impl Exposer for IndiCamera {
    fn facts(&self) -> &Facts {
        &self.facts
    }

    fn set_gain(&mut self, value: f64) -> DeviceResult<f64> {
        let Some([property, element]) = self.gain else { return Ok(value) };
        if self.client.known.number(property, element).is_none_or(|(now, _)| now != value) {
            self.client.set("set the gain", property, &[New::Number(element, value)])?;
        }
        Ok(self.client.known.number(property, element).map_or(value, |(now, _)| now))
    }

    fn start(&mut self, exposure_s: f64, dark: bool) -> DeviceResult<()> {
        if self.facts.shutter {
            self.client.choose(
                "choose the type of frame",
                FRAME_TYPE,
                if dark { "FRAME_DARK" } else { "FRAME_LIGHT" },
            )?;
        }
        self.client.catch_up("start an exposure")?;
        self.client.known.blob = None;
        self.client.command("start an exposure", EXPOSURE, &[New::Number(EXPOSURE_VALUE, exposure_s)]).map(drop)
    }

    fn is_ready(&mut self, limit: Duration) -> DeviceResult<bool> {
        const WHAT: &str = "take a frame";
        self.client.receive(WHAT, limit)?;
        match self.client.known.get(EXPOSURE).map(|p| p.state) {
            Some(State::Alert) => Err(self
                .client
                .error(WHAT, "a picture", self.client.complaint("the state `Alert`"))
                .remedy("see the camera in a client of INDI, then resume the session")
                .class(Class::Retry)),
            None => Err(self
                .client
                .error(WHAT, "a picture", "a camera that was disconnected")
                .remedy("check its power and cable, then resume the session")
                .class(Class::Lost)),
            Some(_) => Ok(self.client.known.blob.as_ref().is_some_and(|blob| blob.property == PICTURE)),
        }
    }

    fn fetch(&mut self) -> DeviceResult<Picture> {
        const WHAT: &str = "take a frame";
        let blob = self.client.take_picture(PICTURE);
        let blob = blob.ok_or_else(|| self.client.error(WHAT, "a picture", "none").class(Class::Retry))?;
        match decode(&blob, self.most) {
            Ok(fits::Image { width, height, codes, exposure_s }) => Ok(Picture { width, height, codes, exposure_s }),
            Err(wrong) => Err(self.unreadable(WHAT, wrong)),
        }
    }

    fn abort(&mut self) -> DeviceResult<()> {
        const WHAT: &str = "end an exposure";
        self.client.catch_up(WHAT)?;
        let busy = |client: &Client| client.known.get(EXPOSURE).is_some_and(|p| p.state == State::Busy);
        if busy(&self.client) && self.client.known.get(ABORT).is_some() {
            self.client.command(WHAT, ABORT, &[New::Switch("ABORT", true)])?;
        }
        let limit = self.facts.download;
        let rests = |known: &super::property::Properties| {
            known.get(EXPOSURE).is_none_or(|p| p.state != State::Busy).then_some(())
        };
        if self.client.wait_for(WHAT, limit, rests)?.is_none() {
            let error = self.client.error(WHAT, "an idle camera", "one that is still busy");
            return Err(error
                .remedy("end the exposure in a client of INDI, then resume the session")
                .class(Class::Retry));
        }
        self.client.known.blob = None;
        Ok(())
    }
}

impl IndiCamera {
    fn unreadable(&self, what: &str, wrong: String) -> DeviceError {
        self.client
            .error(what, "a FITS file of one plane with 8 or 16 bits", wrong)
            .remedy("choose the raw format of the camera (`format`), without compression")
            .class(Class::Retry)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::Compression;
    use flate2::write::ZlibEncoder;
    use proptest::prelude::*;
    use std::io::Write;

    fn blob(format: &str, file: &[u8]) -> Blob {
        let mut base64 = BASE64_STANDARD.encode(file).into_bytes();
        base64.insert(base64.len() / 2, b'\n');
        Blob { property: PICTURE.into(), size: file.len(), format: format.into(), base64 }
    }

    fn file() -> Vec<u8> {
        let cards = ["SIMPLE  = T", "BITPIX  = 8", "NAXIS   = 2", "NAXIS1  = 2", "NAXIS2  = 1", "END"];
        let mut bytes: Vec<u8> = cards.iter().flat_map(|c| format!("{c:<80}").into_bytes()).collect();
        bytes[8] = b'=';
        bytes.resize(2880, b' ');
        bytes.extend([7, 9]);
        bytes
    }

    #[test]
    fn pictures_may_be_compressed() {
        let most = fits::most(2, 1);
        let plain = file();
        assert_eq!(decode(&blob(".fits", &plain), most).unwrap().codes, [7, 9]);
        let mut packed = ZlibEncoder::new(vec![], Compression::fast());
        packed.write_all(&plain).unwrap();
        assert_eq!(decode(&blob(".fits.z", &packed.finish().unwrap()), most).unwrap().codes, [7, 9]);
        // A small file that grows without end.
        let mut bomb = ZlibEncoder::new(vec![], Compression::best());
        bomb.write_all(&vec![0; 2 * most]).unwrap();
        assert!(decode(&blob(".fits.z", &bomb.finish().unwrap()), most).unwrap_err().contains("more than"));
        assert!(decode(&Blob { size: usize::MAX, ..blob(".fits", &plain) }, most).unwrap_err().contains("more than"));
        assert!(decode(&blob(".cr2", &plain), most).unwrap_err().contains(".cr2"));
        let broken = Blob { base64: b"a=b".to_vec(), ..blob(".fits", &plain) };
        assert!(decode(&broken, most).unwrap_err().contains("base64"));
    }

    proptest! {
        #[test]
        fn any_picture_is_read_or_refused(base64: Vec<u8>, packed: bool, size in 0..4000_usize) {
            let format = if packed { ".fits.z" } else { ".fits" }.to_owned();
            let _ = decode(&Blob { property: PICTURE.into(), size, format, base64 }, 3000);
        }
    }
}
