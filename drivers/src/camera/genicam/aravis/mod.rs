//! GenICam cameras through the library aravis.
#![allow(unsafe_code, reason = "the library is written in C")]

mod automatic;
mod ffi;
pub mod list;
mod safe;
mod stream;

use super::node::{Buffer, Cause, Failure, Gains, Identity, Node, NodeResult, Packets};
use ffi::ArvCamera;
pub use ffi::load;
use safe::{c_string, checked, names, text};
use std::ffi::{c_char, c_double, c_int};
use std::ptr::NonNull;
use std::time::{Duration, Instant};
use stream::Stream;

/// Time in which a camera releases the control of a program that has crashed: its heartbeat timeout of 3 s, and slack.
const RELEASED: Duration = Duration::from_secs(5);
/// Pause between attempts to take control.
const PAUSE: Duration = Duration::from_millis(200);

/// A camera of the library.
pub struct AravisNode {
    camera: NonNull<ArvCamera>,
    stream: Option<Stream>,
    /// Whether the camera has stopped answering. Each further command would wait for seconds.
    gone: bool,
}

// SAFETY: one thread at a time uses the camera, and the library binds no object to the thread that made it.
unsafe impl Send for AravisNode {}

impl AravisNode {
    /// Opens a camera by its identifier or network address.
    ///
    /// # Errors
    /// `Library` without aravis, `Missing` if no camera answers, `Held` if another program controls it.
    pub fn open(device: &str) -> NodeResult<Self> {
        load().map_err(|problem| Failure::new(Cause::Library, problem))?;
        list::choose_interfaces();
        let name = c_string(device)?;
        // SAFETY: the name ends with zero and lives through the call.
        let opened = checked(|error| unsafe { ffi::arv_camera_new(name.as_ptr(), error) });
        let camera = opened.map_err(|failure| match failure.cause {
            Cause::Missing => Failure::new(Cause::Missing, missing(device)),
            _ => failure,
        })?;
        let camera = NonNull::new(camera).ok_or_else(|| Failure::new(Cause::Missing, missing(device)))?;
        let node = Self { camera, stream: None, gone: false };
        node.take_control()?;
        Ok(node)
    }

    fn is_network(&self) -> bool {
        // SAFETY: the camera lives as long as `self`.
        unsafe { ffi::arv_camera_is_gv_device(self.camera.as_ptr()) != 0 }
    }

    /// Waits until a camera on the network gives control to this process. Only one program at a time has it.
    fn take_control(&self) -> NodeResult<()> {
        if !self.is_network() {
            return Ok(());
        }
        let begun = Instant::now();
        loop {
            // SAFETY: the device belongs to the camera, which lives as long as `self`, and is one on a network.
            let taken = unsafe {
                let device = ffi::arv_camera_get_device(self.camera.as_ptr());
                ffi::arv_gv_device_is_controller(device) != 0
                    || checked(|error| ffi::arv_gv_device_take_control(device, error)).is_ok_and(|taken| taken != 0)
            };
            if taken {
                return Ok(());
            }
            if begun.elapsed() > RELEASED {
                return Err(Failure::new(Cause::Held, "one that another program controls"));
            }
            std::thread::sleep(PAUSE);
        }
    }

    /// Runs a function of the camera.
    fn call<T>(&self, run: impl FnOnce(*mut ArvCamera, ffi::Errors) -> T) -> NodeResult<T> {
        checked(|error| run(self.camera.as_ptr(), error))
    }

    /// Whether a feature exists; a failed query means that it does not.
    fn has(&self, ask: unsafe extern "C" fn(*mut ArvCamera, ffi::Errors) -> c_int) -> bool {
        // SAFETY: the camera lives as long as `self`.
        self.call(|camera, error| unsafe { ask(camera, error) }).is_ok_and(|there| there != 0)
    }

    /// Lowest and highest value of a control.
    fn bounds(
        &self,
        read: unsafe extern "C" fn(*mut ArvCamera, *mut c_double, *mut c_double, ffi::Errors),
    ) -> NodeResult<[f64; 2]> {
        let (mut low, mut high) = (0.0, 0.0);
        // SAFETY: both values live through the call.
        self.call(|camera, error| unsafe { read(camera, &raw mut low, &raw mut high, error) })?;
        Ok([low, high])
    }

    /// Highest value of a size.
    fn most(
        &self,
        read: unsafe extern "C" fn(*mut ArvCamera, *mut c_int, *mut c_int, ffi::Errors),
    ) -> NodeResult<c_int> {
        let (mut low, mut high) = (0, 0);
        // SAFETY: both values live through the call.
        self.call(|camera, error| unsafe { read(camera, &raw mut low, &raw mut high, error) })?;
        Ok(high)
    }

    fn read_text(
        &self,
        read: unsafe extern "C" fn(*mut ArvCamera, ffi::Errors) -> *const c_char,
    ) -> NodeResult<String> {
        // SAFETY: the camera lives as long as `self`; the string is copied at once.
        self.call(|camera, error| text(unsafe { read(camera, error) }))
    }

    /// Size of network packets in force.
    fn packet_size_now(&self) -> NodeResult<Option<u32>> {
        // SAFETY: the camera lives as long as `self` and is on a network.
        self.call(|camera, error| unsafe { ffi::arv_camera_gv_get_packet_size(camera, error) }).map(Some)
    }

    /// Whether the camera states that its gain is in dB.
    fn gain_is_decibel(&self) -> bool {
        // SAFETY: the node belongs to the device, and its type is checked before its unit is read.
        unsafe {
            let device = ffi::arv_camera_get_device(self.camera.as_ptr());
            let node = ffi::arv_device_get_feature(device, c"Gain".as_ptr());
            !node.is_null()
                && ffi::g_type_check_instance_is_a(node.cast(), ffi::arv_gc_float_get_type()) != 0
                && text(ffi::arv_gc_float_get_unit(node)).eq_ignore_ascii_case("dB")
        }
    }
}

/// Words for a camera that does not answer, with those that do.
fn missing(device: &str) -> String {
    let found: Vec<String> = list::cameras().into_iter().map(|c| format!("{} ({})", c.id, c.address)).collect();
    match found.is_empty() {
        true => format!("no answer from {device}, nor from any other camera"),
        false => format!("no answer from {device}, but from {}", found.join(", ")),
    }
}

impl Node for AravisNode {
    fn identity(&mut self) -> NodeResult<Identity> {
        let vendor = self.read_text(ffi::arv_camera_get_vendor_name)?;
        let model = self.read_text(ffi::arv_camera_get_model_name)?;
        let serial = self.read_text(ffi::arv_camera_get_device_serial_number).unwrap_or_default();
        let serial =
            if serial.is_empty() { self.read_text(ffi::arv_camera_get_device_id).unwrap_or_default() } else { serial };
        Ok(Identity { vendor, model, serial })
    }

    fn formats(&mut self) -> NodeResult<Vec<String>> {
        let camera = self.camera.as_ptr();
        // SAFETY: the camera lives as long as `self`; the count lives through the call.
        names(|count, error| unsafe { ffi::arv_camera_dup_available_pixel_formats_as_strings(camera, count, error) })
    }

    fn set_format(&mut self, name: &str) -> NodeResult<u32> {
        let name = c_string(name)?;
        // SAFETY: the name ends with zero and lives through the call.
        self.call(|camera, error| unsafe {
            ffi::arv_camera_set_pixel_format_from_string(camera, name.as_ptr(), error);
        })?;
        // SAFETY: the camera lives as long as `self`.
        self.call(|camera, error| unsafe { ffi::arv_camera_get_pixel_format(camera, error) })
    }

    fn set_region(&mut self, region: Option<[u32; 4]>) -> NodeResult<[u32; 4]> {
        let set = |[x, y, width, height]: [c_int; 4]| {
            // SAFETY: the camera lives as long as `self`.
            self.call(|camera, error| unsafe { ffi::arv_camera_set_region(camera, x, y, width, height, error) })
        };
        let wanted = match region {
            Some(region) => region.map(|v| c_int::try_from(v).unwrap_or(c_int::MAX)),
            None => {
                // The largest size depends on the offset. A negative size leaves it as it is.
                if self.has(ffi::arv_camera_is_region_offset_available) {
                    set([0, 0, -1, -1])?;
                }
                let width = self.most(ffi::arv_camera_get_width_bounds)?;
                [0, 0, width, self.most(ffi::arv_camera_get_height_bounds)?]
            }
        };
        let refused = set(wanted);
        refused.or_else(|e| if e.cause == Cause::Gone { Err(e) } else { Ok(()) })?;
        let mut got = [0; 4];
        let [x, y, width, height] = &mut got;
        // SAFETY: the four values live through the call.
        self.call(|camera, error| unsafe { ffi::arv_camera_get_region(camera, x, y, width, height, error) })?;
        Ok(got.map(|v| u32::try_from(v).unwrap_or(0)))
    }

    fn all_manual(&mut self) -> NodeResult<Vec<String>> {
        self.disable_automatic()
    }

    fn exposures(&mut self) -> NodeResult<Option<[f64; 2]>> {
        if !self.has(ffi::arv_camera_is_exposure_time_available) {
            return Ok(None);
        }
        let [low, high] = self.bounds(ffi::arv_camera_get_exposure_time_bounds)?.map(|us| us / 1e6);
        // An exposure of 0 is invalid, even if the camera's range includes it.
        Ok(Some([low.max(1e-6), high.clamp(1e-6, 3600.0)]))
    }

    fn exposure(&mut self, set: Option<Duration>) -> NodeResult<Duration> {
        if let Some(exposure) = set {
            let us = exposure.as_secs_f64() * 1e6;
            // SAFETY: the camera lives as long as `self`.
            self.call(|camera, error| unsafe { ffi::arv_camera_set_exposure_time(camera, us, error) })?;
        }
        // SAFETY: as above.
        let us = self.call(|camera, error| unsafe { ffi::arv_camera_get_exposure_time(camera, error) })?;
        Ok(Duration::try_from_secs_f64(us / 1e6).unwrap_or_default())
    }

    fn gains(&mut self) -> NodeResult<Option<Gains>> {
        if !self.has(ffi::arv_camera_is_gain_available) {
            return Ok(None);
        }
        let [low, high] = self.bounds(ffi::arv_camera_get_gain_bounds)?;
        Ok(Some(Gains { low, high, decibel: self.gain_is_decibel() }).filter(|g| g.high >= g.low))
    }

    fn gain(&mut self, set: Option<f64>) -> NodeResult<f64> {
        if let Some(gain) = set {
            // SAFETY: the camera lives as long as `self`.
            self.call(|camera, error| unsafe { ffi::arv_camera_set_gain(camera, gain, error) })?;
        }
        // SAFETY: as above.
        self.call(|camera, error| unsafe { ffi::arv_camera_get_gain(camera, error) })
    }

    fn set_black_level(&mut self, level: f64) -> NodeResult<f64> {
        // SAFETY: the camera lives as long as `self`.
        self.call(|camera, error| unsafe { ffi::arv_camera_set_black_level(camera, level, error) })?;
        // SAFETY: as above.
        self.call(|camera, error| unsafe { ffi::arv_camera_get_black_level(camera, error) })
    }

    fn frame_rate(&mut self, set: Option<f64>) -> NodeResult<Option<f64>> {
        if !self.has(ffi::arv_camera_is_frame_rate_available) {
            return Ok(None);
        }
        if let Some(hz) = set {
            // SAFETY: the camera lives as long as `self`.
            self.call(|camera, error| unsafe { ffi::arv_camera_set_frame_rate(camera, hz, error) })?;
        }
        // SAFETY: as above.
        let hz = self.call(|camera, error| unsafe { ffi::arv_camera_get_frame_rate(camera, error) });
        hz.map(Some).or_else(|e| if e.cause == Cause::Gone { Err(e) } else { Ok(None) })
    }

    fn set_software_trigger(&mut self, on: bool) -> NodeResult<()> {
        // SAFETY: the camera lives as long as `self`; the name ends with zero.
        let set = self.call(|camera, error| unsafe {
            match on {
                true => ffi::arv_camera_set_trigger(camera, c"Software".as_ptr(), error),
                false => ffi::arv_camera_clear_triggers(camera, error),
            }
        });
        // A camera without triggers runs freely.
        set.or_else(|e| if on || e.cause == Cause::Gone { Err(e) } else { Ok(()) })
    }

    fn trigger(&mut self) -> NodeResult<()> {
        // SAFETY: the camera lives as long as `self`.
        self.call(|camera, error| unsafe { ffi::arv_camera_software_trigger(camera, error) })
    }

    fn packet_size(&mut self, set: Option<u32>) -> NodeResult<Option<u32>> {
        if !self.is_network() {
            return Ok(None);
        }
        let Some(bytes) = set else {
            // A camera that sends no test packets keeps its size.
            // SAFETY: the camera lives as long as `self` and is on a network.
            let _ = self.call(|camera, error| unsafe { ffi::arv_camera_gv_auto_packet_size(camera, error) });
            return self.packet_size_now();
        };
        let bytes = c_int::try_from(bytes).unwrap_or(c_int::MAX);
        // SAFETY: as above.
        self.call(|camera, error| unsafe {
            ffi::arv_camera_gv_set_packet_size_adjustment(camera, ffi::ADJUST_NEVER);
            ffi::arv_camera_gv_set_packet_size(camera, bytes, error);
        })?;
        self.packet_size_now()
    }

    fn start(&mut self, buffers: u32) -> NodeResult<()> {
        self.stop();
        self.stream = Some(Stream::start(self.camera, buffers)?);
        Ok(())
    }

    fn stop(&mut self) {
        let Some(stream) = self.stream.take() else { return };
        if !self.gone {
            // The next command reports the error of a camera that is gone.
            // SAFETY: the camera lives as long as `self`.
            let _ = self.call(|camera, error| unsafe { ffi::arv_camera_stop_acquisition(camera, error) });
        }
        drop(stream);
    }

    fn dequeue(&mut self, timeout: Duration) -> Option<Buffer<'_>> {
        match &mut self.stream {
            Some(stream) => stream.dequeue(timeout),
            None => {
                std::thread::sleep(timeout);
                None
            }
        }
    }

    fn packets(&mut self) -> Packets {
        self.stream.as_ref().map(Stream::packets).unwrap_or_default()
    }

    fn answers(&mut self) -> bool {
        let network = self.is_network();
        // Address 0 holds the version of the standard on GigE Vision and USB3 Vision. The library does not cache it.
        let mut version = 0;
        // SAFETY: the device belongs to the camera, which lives as long as `self`, and is asked for control only on a
        // network; the value lives through the call.
        let read = checked(|error| unsafe {
            let device = ffi::arv_camera_get_device(self.camera.as_ptr());
            // The library's heartbeat has noticed the loss.
            if network && ffi::arv_gv_device_is_controller(device) == 0 {
                return 0;
            }
            ffi::arv_device_read_register(device, 0, &raw mut version, error)
        });
        self.gone = self.gone || !read.is_ok_and(|read| read != 0);
        !self.gone
    }
}

impl Drop for AravisNode {
    fn drop(&mut self) {
        self.stop();
        // SAFETY: this is the only reference to the camera; its stream has been freed.
        unsafe { ffi::g_object_unref(self.camera.as_ptr().cast()) };
    }
}
