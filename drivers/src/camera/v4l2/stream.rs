//! Streams of cameras: buffers of the kernel, mapped into memory, for both interfaces of V4L2. With the multi-planar
//! one a buffer consists of planes, of which the first holds all codes of the formats that Nacre reads.
#![allow(unsafe_code, reason = "calls and memory of the kernel")]

use super::node::{Buffer, plane_payload};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};
use std::ffi::c_void;
use std::io;
use std::os::fd::BorrowedFd;
use std::sync::Arc;
use std::time::Duration;
use v4l::buffer::Flags;
use v4l::device::Handle;
use v4l::v4l_sys::{
    v4l2_buf_type, v4l2_buf_type_V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE as MULTI_PLANAR, v4l2_buffer,
    v4l2_memory_V4L2_MEMORY_MMAP as MAPPED, v4l2_plane, v4l2_requestbuffers,
};
use v4l::v4l2::vidioc;

/// Maximum number of planes of a buffer.
const MAX_PLANES: usize = 8;

/// Calls the kernel.
///
/// # Safety
/// `request` must read and write a `T`. Pointers in `argument` must be valid for it.
pub(super) unsafe fn ioctl<T>(device: &Handle, request: vidioc::_IOC_TYPE, argument: &mut T) -> io::Result<()> {
    // SAFETY: `argument` lives through the call; the caller promises the rest.
    unsafe { v4l::v4l2::ioctl(device.fd(), request, std::ptr::from_mut(argument).cast()) }
}

/// A running stream.
pub(super) struct Stream {
    device: Arc<Handle>,
    kind: v4l2_buf_type,
    buffers: Vec<Mapping>,
    /// The buffer with the last frame, which the next call returns to the kernel.
    lent: Option<u32>,
    /// Whether the flag for the start of exposure is reliable.
    starts: bool,
}

impl Stream {
    /// Starts a stream with about `count` buffers.
    ///
    /// # Errors
    /// As the kernel.
    pub fn start(device: Arc<Handle>, kind: v4l2_buf_type, count: u32, starts: bool) -> io::Result<Self> {
        // An early return stops the stream and frees its buffers.
        let mut stream = Self { device, kind, buffers: Vec::new(), lent: None, starts };
        let count = stream.request(count)?;
        for index in 0..count {
            let mapping = stream.map(index)?;
            stream.buffers.push(mapping);
        }
        for index in 0..count {
            stream.transfer(vidioc::VIDIOC_QBUF, index)?;
        }
        stream.switch(vidioc::VIDIOC_STREAMON)?;
        Ok(stream)
    }

    /// The oldest frame in the queue; `None` if the queue stayed empty for `timeout`.
    ///
    /// # Errors
    /// As the kernel.
    pub fn dequeue(&mut self, timeout: Duration) -> io::Result<Option<Buffer<'_>>> {
        if let Some(index) = self.lent.take() {
            self.transfer(vidioc::VIDIOC_QBUF, index)?;
        }
        if !self.wait(timeout)? {
            return Ok(None);
        }
        let (buffer, plane) = match self.transfer(vidioc::VIDIOC_DQBUF, 0) {
            Err(e) if e.kind() == io::ErrorKind::WouldBlock => return Ok(None),
            found => found?,
        };
        let Some(memory) = usize::try_from(buffer.index).ok().and_then(|index| self.buffers.get(index)) else {
            return Err(io::Error::other(format!("a frame in buffer {}, which does not exist", buffer.index)));
        };
        self.lent = Some(buffer.index);
        let flags = Flags::from_bits_truncate(buffer.flags);
        let micros = u32::try_from(buffer.timestamp.tv_usec).unwrap_or(0).min(999_999);
        Ok(Some(Buffer {
            bytes: plane_payload(memory.bytes(), plane.bytesused, plane.data_offset),
            sequence: buffer.sequence,
            timestamp: Duration::new(u64::try_from(buffer.timestamp.tv_sec).unwrap_or(0), micros * 1000),
            monotonic: flags & Flags::TIMESTAMP_MASK == Flags::TIMESTAMP_MONOTONIC,
            start_of_exposure: self.starts && flags & Flags::TSTAMP_SRC_MASK == Flags::TSTAMP_SRC_SOE,
            error: flags.contains(Flags::ERROR),
        }))
    }

    /// Waits for a frame, or for an error that the next call reports: a device that is gone is ready at once.
    fn wait(&self, timeout: Duration) -> io::Result<bool> {
        // SAFETY: the device keeps the descriptor open until it is dropped, which is after this.
        let descriptor = unsafe { BorrowedFd::borrow_raw(self.device.fd()) };
        let timeout = Timespec::try_from(timeout).map_err(|_| io::ErrorKind::InvalidInput)?;
        Ok(poll(&mut [PollFd::new(&descriptor, PollFlags::IN)], Some(&timeout))? > 0)
    }

    /// Allocates buffers; returns their number. None frees them.
    fn request(&self, count: u32) -> io::Result<u32> {
        let mut request = v4l2_requestbuffers { count, type_: self.kind, memory: MAPPED, ..Default::default() };
        // SAFETY: this is the structure of the request, without pointers.
        unsafe { ioctl(&self.device, vidioc::VIDIOC_REQBUFS, &mut request)? };
        Ok(request.count)
    }

    fn switch(&self, request: vidioc::_IOC_TYPE) -> io::Result<()> {
        let mut kind = self.kind;
        // SAFETY: both requests read an integer.
        unsafe { ioctl(&self.device, request, &mut kind) }
    }

    /// Queries, queues or dequeues a buffer; returns it and its first plane.
    fn transfer(&self, request: vidioc::_IOC_TYPE, index: u32) -> io::Result<(v4l2_buffer, v4l2_plane)> {
        let mut planes = [v4l2_plane::default(); MAX_PLANES];
        let mut buffer = v4l2_buffer { index, type_: self.kind, memory: MAPPED, ..Default::default() };
        if self.kind == MULTI_PLANAR {
            buffer.m.planes = planes.as_mut_ptr();
            buffer.length = MAX_PLANES as u32;
        }
        // SAFETY: this is the structure of the three requests. The pointer is to as many planes as `length` says, which
        // live through the call.
        unsafe { ioctl(&self.device, request, &mut buffer)? };
        let mut plane = planes[0];
        if self.kind != MULTI_PLANAR {
            (plane.bytesused, plane.length) = (buffer.bytesused, buffer.length);
            // SAFETY: with this kind of buffer the kernel sets this member, and every value is valid.
            plane.m.mem_offset = unsafe { buffer.m.offset };
        }
        Ok((buffer, plane))
    }

    /// Maps the first plane of a buffer.
    fn map(&self, index: u32) -> io::Result<Mapping> {
        let (_, plane) = self.transfer(vidioc::VIDIOC_QUERYBUF, index)?;
        let length = usize::try_from(plane.length).unwrap_or(0);
        // SAFETY: mapped memory has an offset, and every value is valid.
        let offset = unsafe { plane.m.mem_offset };
        // SAFETY: the device keeps the descriptor open until it is dropped. The kernel chooses an unused address.
        let start = unsafe {
            let descriptor = BorrowedFd::borrow_raw(self.device.fd());
            mmap(std::ptr::null_mut(), length, ProtFlags::READ, MapFlags::SHARED, descriptor, u64::from(offset))?
        };
        Ok(Mapping { start, length })
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        // These fail if the device is gone, which frees the buffers, too. Mapped buffers cannot be freed.
        let _ = self.switch(vidioc::VIDIOC_STREAMOFF);
        self.buffers.clear();
        let _ = self.request(0);
    }
}

/// Memory of the kernel.
struct Mapping {
    start: *mut c_void,
    length: usize,
}

// SAFETY: the memory belongs to the process, not to a thread.
unsafe impl Send for Mapping {}

impl Mapping {
    fn bytes(&self) -> &[u8] {
        // SAFETY: the memory is mapped while `self` lives. The kernel does not write to a buffer that it has lent.
        unsafe { std::slice::from_raw_parts(self.start.cast(), self.length) }
    }
}

impl Drop for Mapping {
    fn drop(&mut self) {
        // SAFETY: this is the mapping that was made, and no slice of it is left.
        let _ = unsafe { munmap(self.start, self.length) };
    }
}
