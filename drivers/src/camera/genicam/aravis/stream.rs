//! A stream of frames.

use super::ffi::{self, ArvBuffer, ArvCamera, ArvStream};
use super::safe::checked;
use crate::camera::genicam::node::{Buffer, Cause, Failure, NodeResult, Packets, Status};
use crate::{Clock, SystemClock};
use std::ffi::{c_int, c_void};
use std::ptr::{self, NonNull};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Largest payload of a frame in bytes.
const MAX_PAYLOAD: usize = 1 << 30;

/// A stream of a camera, with its buffers.
pub struct Stream {
    stream: NonNull<ArvStream>,
    /// Buffer of the frame in use, which is queued again before the next frame is taken.
    held: Option<NonNull<ArvBuffer>>,
}

/// Stores the time at which a frame begins to arrive. The library's own time is that of the wall clock.
extern "C" fn on_frame(_: *mut c_void, event: c_int, buffer: *mut ArvBuffer) {
    if event == ffi::START_BUFFER && !buffer.is_null() {
        // SAFETY: the library passes a valid buffer with this event. Its user data, if any, is the number that
        // `Stream::start` attached, which lives as long as the buffer.
        unsafe {
            if let Some(arrival) = ffi::arv_buffer_get_user_data(buffer).cast::<AtomicU64>().as_ref() {
                arrival.store(now_ns(), Ordering::Release);
            }
        }
    }
}

/// Frees the user data of a buffer.
extern "C" fn free_arrival(arrival: *mut c_void) {
    // SAFETY: the library calls this once for each buffer, with the pointer from `Box::into_raw` in `Stream::start`.
    drop(unsafe { Box::from_raw(arrival.cast::<AtomicU64>()) });
}

fn now_ns() -> u64 {
    u64::try_from(SystemClock.now().as_nanos()).unwrap_or(u64::MAX)
}

impl Stream {
    /// Starts a stream with this many buffers.
    pub fn start(camera: NonNull<ArvCamera>, buffers: u32) -> NodeResult<Self> {
        let camera = camera.as_ptr();
        // SAFETY: the caller's camera lives through this function.
        let payload = checked(|error| unsafe { ffi::arv_camera_get_payload(camera, error) })?;
        let payload = usize::try_from(payload).unwrap_or(usize::MAX);
        if !(1..=MAX_PAYLOAD).contains(&payload) {
            return Err(Failure::new(Cause::Unsupported, format!("frames of {payload} bytes")));
        }
        // SAFETY: the callback is a function that lives for ever and does not use its data.
        let stream =
            checked(|error| unsafe { ffi::arv_camera_create_stream(camera, Some(on_frame), ptr::null_mut(), error) })?;
        let stream = NonNull::new(stream).ok_or_else(|| Failure::new(Cause::Other, "no stream"))?;
        let started = Self { stream, held: None };
        for _ in 0..buffers {
            let arrival = Box::into_raw(Box::new(AtomicU64::new(0)));
            // SAFETY: the library allocates the payload, owns the user data and frees it by the given function. The
            // stream takes the buffer.
            unsafe {
                let buffer = ffi::arv_buffer_new_full(payload, ptr::null_mut(), arrival.cast(), Some(free_arrival));
                ffi::arv_stream_push_buffer(stream.as_ptr(), buffer);
            }
        }
        // SAFETY: as above. Cameras without acquisition modes run continuously.
        let mode = checked(|error| unsafe { ffi::arv_camera_set_acquisition_mode(camera, ffi::CONTINUOUS, error) });
        mode.or_else(|e| if e.cause == Cause::Gone { Err(e) } else { Ok(()) })?;
        // SAFETY: as above.
        checked(|error| unsafe { ffi::arv_camera_start_acquisition(camera, error) })?;
        Ok(started)
    }

    /// Queues the held buffer again.
    fn release(&mut self) {
        if let Some(buffer) = self.held.take() {
            // SAFETY: the buffer was taken from this stream and no frame refers to it any more, because `dequeue`
            // borrows the stream for as long as its frame is in use.
            unsafe {
                let arrival = ffi::arv_buffer_get_user_data(buffer.as_ptr()).cast::<AtomicU64>();
                if let Some(arrival) = arrival.as_ref() {
                    arrival.store(0, Ordering::Release);
                }
                ffi::arv_stream_push_buffer(self.stream.as_ptr(), buffer.as_ptr());
            }
        }
    }

    /// The oldest frame; `None` if none arrived within `timeout`.
    pub fn dequeue(&mut self, timeout: Duration) -> Option<Buffer<'_>> {
        self.release();
        let us = u64::try_from(timeout.as_micros()).unwrap_or(u64::MAX);
        // SAFETY: the stream lives as long as `self`.
        let buffer = NonNull::new(unsafe { ffi::arv_stream_timeout_pop_buffer(self.stream.as_ptr(), us) })?;
        self.held = Some(buffer);
        let raw = buffer.as_ptr();
        // SAFETY: the buffer belongs to this process until it is queued again, and its user data lives as long.
        let (frame_id, device_ns, arrival, status) = unsafe {
            let arrival = ffi::arv_buffer_get_user_data(raw).cast::<AtomicU64>().as_ref();
            let arrival = arrival.map_or(0, |arrival| arrival.load(Ordering::Acquire));
            (ffi::arv_buffer_get_frame_id(raw), ffi::arv_buffer_get_timestamp(raw), arrival, status(raw))
        };
        // A frame without its first packet counts as arriving now.
        let arrival = if arrival == 0 { SystemClock.now() } else { Duration::from_nanos(arrival) };
        let nothing =
            Buffer { bytes: &[], frame_id, arrival, device_ns, status, width: 0, height: 0, padding: 0, format: 0 };
        // The library describes complete pictures only.
        if status != Status::Complete {
            return Some(nothing);
        }
        let (mut size, mut padding, mut below) = (0, 0, 0);
        let natural = |v: c_int| usize::try_from(v).unwrap_or(0);
        // SAFETY: as above; the numbers live through the calls. The bytes live until the buffer is queued again, which
        // the borrow of `self` prevents while the frame is in use.
        unsafe {
            let data = ffi::arv_buffer_get_image_data(raw, &raw mut size);
            ffi::arv_buffer_get_image_padding(raw, &raw mut padding, &raw mut below);
            let bytes = if data.is_null() { &[] } else { std::slice::from_raw_parts(data, size) };
            Some(Buffer {
                bytes,
                width: natural(ffi::arv_buffer_get_image_width(raw)),
                height: natural(ffi::arv_buffer_get_image_height(raw)),
                padding: natural(padding),
                format: ffi::arv_buffer_get_image_pixel_format(raw),
                ..nothing
            })
        }
    }

    /// Packets so far.
    pub fn packets(&self) -> Packets {
        let (mut completed, mut failures, mut underruns) = (0, 0, 0);
        let stream = self.stream.as_ptr();
        // SAFETY: the stream lives as long as `self`, the numbers through the call; the names end with zero. An unknown
        // name gives 0.
        unsafe {
            ffi::arv_stream_get_statistics(stream, &raw mut completed, &raw mut failures, &raw mut underruns);
            let count = |name: &std::ffi::CStr| ffi::arv_stream_get_info_uint64_by_name(stream, name.as_ptr());
            Packets { received: count(c"n_received_packets"), missing: count(c"n_missing_packets"), underruns }
        }
    }
}

/// Completeness of a frame.
///
/// # Safety
/// The buffer must be valid.
unsafe fn status(buffer: *mut ArvBuffer) -> Status {
    // SAFETY: the caller's promise.
    let (status, payload) = unsafe { (ffi::arv_buffer_get_status(buffer), ffi::arv_buffer_get_payload_type(buffer)) };
    // `ArvBufferStatus`.
    match status {
        0 if payload == ffi::PAYLOAD_IMAGE => Status::Complete,
        0 => Status::NoPicture,
        2 => Status::Timeout,
        3 => Status::MissingPackets,
        4 => Status::WrongPacket,
        5 => Status::WrongSize,
        _ => Status::Aborted,
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        self.release();
        // SAFETY: this is the only reference to the stream, which frees its buffers.
        unsafe { ffi::g_object_unref(self.stream.as_ptr().cast()) };
    }
}
