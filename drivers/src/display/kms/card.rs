//! A kernel graphics output (DRM) with double buffering.

use super::{Geometry, ROWS_APART, Screen, Settings, failure, setup};
use crate::display::edid;
use crate::{Class, DeviceError, DeviceResult};
use drm::Device;
use drm::buffer::{Buffer, DrmFourcc};
use drm::control::dumbbuffer::DumbBuffer;
use drm::control::{Device as ControlDevice, Event, Mode, ModeTypeFlags, PageFlipFlags, connector, crtc, framebuffer};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::fs::{File, OpenOptions};
use std::io;
use std::os::fd::{AsFd, BorrowedFd};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Time limit of a page flip: a later one never happens.
const FLIP_LIMIT: Timespec = Timespec { tv_sec: 2, tv_nsec: 0 };

/// A graphics card.
struct Card(File);

impl AsFd for Card {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}
impl Device for Card {}
impl ControlDevice for Card {}

/// A frame buffer in the card's memory.
struct Picture {
    memory: DumbBuffer,
    handle: framebuffer::Handle,
}

/// A graphics output.
pub struct Output {
    card: Card,
    crtc: crtc::Handle,
    connector: connector::Handle,
    mode: Mode,
    pictures: [Picture; 2],
    /// Index of the visible buffer; `None` before the first picture.
    seen: Option<usize>,
    geometry: Geometry,
}

/// Opens the output at its native resolution; also returns the display's identity.
pub(super) fn open(settings: &Settings) -> DeviceResult<(Output, String)> {
    let name = &settings.output;
    let (path, card, connector) = find(settings)?;
    let failed = |e: io::Error| failure(name, "open", &e);
    // The first process to open a card becomes its master; under a desktop this fails.
    card.acquire_master_lock().map_err(failed)?;
    let mode = own_mode(&connector)
        .ok_or_else(|| setup(name, "a panel with a resolution", "none").remedy("plug the panel in and switch it on"))?;
    let crtc = free_crtc(&card, &connector).map_err(failed)?;
    let panel = read_edid(&path, name);
    let from_edid = panel.as_ref().and_then(|e| e.size_mm);
    let from_kernel = connector.size().map(|(w, h)| [f64::from(w), f64::from(h)]).filter(|s| s[0] > 0.0 && s[1] > 0.0);
    let Some(size_mm) = settings.size_mm.or(from_edid).or(from_kernel) else {
        let error = setup(name, "a panel that tells its size", "one that does not");
        return Err(error.remedy("measure the picture and give its width and height as `size_mm`"));
    };
    let (w, h) = mode.size();
    let pictures = [0, 1].map(|_| picture(&card, (u32::from(w), u32::from(h))));
    let [Ok(first), Ok(second)] = pictures else {
        return Err(setup(name, "two pictures in the card's memory", "less memory").remedy("use another graphics card"));
    };
    let geometry = Geometry { pixels: [w.into(), h.into()], size_mm };
    let id = panel.map_or_else(|| format!("panel on {name}"), |e| e.id());
    let (connector, seen) = (connector.handle(), None);
    Ok((Output { card, crtc, connector, mode, pictures: [first, second], seen, geometry }, id))
}

/// The card that has the output, and its connector.
fn find(settings: &Settings) -> DeviceResult<(PathBuf, Card, connector::Info)> {
    let name = &settings.output;
    let mut seen = Vec::new();
    for path in cards(settings) {
        let card = match OpenOptions::new().read(true).write(true).open(&path) {
            Ok(file) => Card(file),
            Err(e) => return Err(failure(name, &format!("open {}", path.display()), &e)),
        };
        let Ok(resources) = card.resource_handles() else { continue };
        for handle in resources.connectors().iter().take(64) {
            let Ok(connector) = card.get_connector(*handle, true) else { continue };
            let plugged = connector.state() == connector::State::Connected;
            if connector.to_string() == *name && plugged {
                return Ok((path, card, connector));
            }
            seen.push(format!("{connector} {}", if plugged { "with a panel" } else { "without a panel" }));
        }
    }
    let got = if seen.is_empty() { "no graphics card with outputs".to_owned() } else { seen.join(", ") };
    let remedy = "plug the panel in and switch it on, or give another output";
    Err(DeviceError::new(name, "open", "this output with a panel", got).remedy(remedy).class(Class::Setup))
}

fn cards(settings: &Settings) -> Vec<PathBuf> {
    if let Some(card) = &settings.card {
        return vec![card.into()];
    }
    let mut found: Vec<PathBuf> = std::fs::read_dir("/dev/dri")
        .into_iter()
        .flatten()
        .flatten()
        .filter(|entry| entry.file_name().to_string_lossy().starts_with("card"))
        .map(|entry| entry.path())
        .take(64)
        .collect();
    found.sort();
    found
}

fn own_mode(connector: &connector::Info) -> Option<Mode> {
    let modes = connector.modes();
    modes.iter().find(|m| m.mode_type().contains(ModeTypeFlags::PREFERRED)).or(modes.first()).copied()
}

/// A CRTC for the connector: its current one, or an unused one.
fn free_crtc(card: &Card, connector: &connector::Info) -> io::Result<crtc::Handle> {
    let resources = card.resource_handles()?;
    let encoder = |handle| card.get_encoder(handle);
    if let Some(mine) = connector.current_encoder().and_then(|e| encoder(e).ok()?.crtc()) {
        return Ok(mine);
    }
    let used: Vec<_> = resources.encoders().iter().filter_map(|e| encoder(*e).ok()?.crtc()).collect();
    let possible = connector.encoders().iter().filter_map(|e| Some(encoder(*e).ok()?.possible_crtcs()));
    possible
        .flat_map(|filter| resources.filter_crtcs(filter))
        .find(|crtc| !used.contains(crtc))
        .ok_or_else(|| io::Error::from(io::ErrorKind::ResourceBusy))
}

fn read_edid(card: &Path, output: &str) -> Option<edid::Edid> {
    let name = format!("{}-{output}", card.canonicalize().ok()?.file_name()?.to_string_lossy());
    edid::parse(&std::fs::read(Path::new("/sys/class/drm").join(name).join("edid")).ok()?).ok()
}

fn picture(card: &Card, size: (u32, u32)) -> io::Result<Picture> {
    let memory = card.create_dumb_buffer(size, DrmFourcc::Xrgb8888, 32)?;
    let handle = card.add_framebuffer(&memory, 24, 32)?;
    Ok(Picture { memory, handle })
}

impl Output {
    /// Waits until the page flip is complete.
    fn flipped(&self) -> io::Result<()> {
        loop {
            let mut fds = [PollFd::new(&self.card, PollFlags::IN)];
            match poll(&mut fds, Some(&FLIP_LIMIT)) {
                Ok(0) => return Err(io::ErrorKind::TimedOut.into()),
                Err(rustix::io::Errno::INTR) => continue,
                ready => ready?,
            };
            if self.card.receive_events()?.any(|event| matches!(event, Event::PageFlip(_))) {
                return Ok(());
            }
        }
    }
}

impl Screen for Output {
    fn geometry(&self) -> Geometry {
        self.geometry
    }

    fn refresh(&self) -> Duration {
        Duration::from_secs_f64(1.0 / f64::from(self.mode.vrefresh().clamp(1, 1000)))
    }

    fn flip(&mut self, pixels: &[u32]) -> io::Result<()> {
        let next = self.seen.map_or(0, |seen| 1 - seen);
        let picture = &mut self.pictures[next];
        let pitch = picture.memory.pitch() as usize;
        let mut mapping = self.card.map_dumb_buffer(&mut picture.memory)?;
        for (row, from) in mapping.as_mut().chunks_mut(pitch).zip(pixels.chunks(self.geometry.pixels[0])) {
            for (to, pixel) in row.as_chunks_mut::<4>().0.iter_mut().zip(from) {
                *to = pixel.to_le_bytes();
            }
        }
        drop(mapping);
        let handle = picture.handle;
        match self.seen {
            None => self.card.set_crtc(self.crtc, Some(handle), (0, 0), &[self.connector], Some(self.mode))?,
            Some(_) => {
                // If the flip fails, the visible buffer is unknown and the next picture sets the mode again.
                let before = self.seen.take();
                self.card
                    .page_flip(self.crtc, handle, PageFlipFlags::EVENT, None)
                    .inspect_err(|_| self.seen = before)?;
                self.flipped()?;
            }
        }
        self.seen = Some(next);
        Ok(())
    }

    fn shown(&mut self) -> io::Result<Vec<u32>> {
        let shown = self.card.get_crtc(self.crtc)?.framebuffer();
        let [width, height] = self.geometry.pixels;
        let Some(picture) = self.pictures.iter_mut().find(|p| Some(p.handle) == shown) else { return Ok(Vec::new()) };
        let pitch = picture.memory.pitch() as usize;
        let mapping = self.card.map_dumb_buffer(&mut picture.memory)?;
        let rows = mapping.chunks(pitch).take(height).step_by(ROWS_APART);
        // The fourth byte of a pixel is unused.
        let pixel = |bytes: &[u8; 4]| u32::from_le_bytes(*bytes) & 0xFF_FFFF;
        Ok(rows.flat_map(|row| row.as_chunks::<4>().0.iter().take(width).map(pixel)).collect())
    }
}

impl Drop for Output {
    fn drop(&mut self) {
        // The kernel frees the remaining resources when the card is closed.
        let _ = self.card.set_crtc(self.crtc, None, (0, 0), &[], None);
        for picture in &self.pictures {
            let _ = self.card.destroy_framebuffer(picture.handle);
            let _ = self.card.destroy_dumb_buffer(picture.memory);
        }
    }
}
