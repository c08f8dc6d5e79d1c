//! Cameras through the library libgphoto2.
#![allow(unsafe_code, reason = "the library is written in C")]

mod context;
mod ffi;
mod list;
mod safe;

pub use ffi::load;
pub use list::Detected;

use super::node::{CameraFile, Cause, Control, Failure, Node, NodeResult, Storage};
use crate::discovery::{Access, Root, check};
use context::Messages;
use safe::{Setting, c_string, checked, text_in};
use std::path::Path;
use std::ptr::{self, NonNull};
use std::sync::{Mutex, PoisonError, TryLockError};

/// Largest number of memory cards.
const MAX_STORAGES: usize = 16;

/// Held while cameras are detected or opened: the library's loader of drivers is not thread-safe.
static LOADER: Mutex<()> = Mutex::new(());

/// Cameras at USB ports; none without the library, or while a camera is being opened.
pub fn cameras() -> Vec<Detected> {
    if load().is_err() {
        return vec![];
    }
    let _loader = match LOADER.try_lock() {
        Ok(lock) => lock,
        Err(TryLockError::Poisoned(lock)) => lock.into_inner(),
        Err(TryLockError::WouldBlock) => return vec![],
    };
    list::detect().unwrap_or_default()
}

/// A camera of the library.
pub struct GphotoNode {
    camera: NonNull<ffi::Camera>,
    messages: Messages,
    detected: Detected,
}

// SAFETY: one thread at a time uses the camera, and the library binds no object to the thread that made it.
unsafe impl Send for GphotoNode {}

impl GphotoNode {
    /// Opens a camera by its model or port, by default the only one; `serial` distinguishes cameras of one model.
    ///
    /// # Errors
    /// `Library` without the library, `Missing` or `Several` if not exactly one camera fits, `Held` if another program
    /// uses it.
    pub fn open(device: Option<&str>, serial: Option<&str>) -> NodeResult<Self> {
        load().map_err(|problem| Failure::new(Cause::Library, problem))?;
        let _loader = LOADER.lock().unwrap_or_else(PoisonError::into_inner);
        let all = list::detect()?;
        let named = |camera: &&Detected| {
            device.is_none_or(|name| camera.port == name || camera.model.eq_ignore_ascii_case(name.trim()))
        };
        let fitting: Vec<&Detected> = all.iter().filter(named).collect();
        let Some(serial) = serial else {
            return match fitting[..] {
                [one] => Self::at(one),
                [] => Err(missing(device, &all)),
                _ => Err(Failure::new(Cause::Several, words(&fitting))),
            };
        };
        let mut failed = None;
        for camera in &fitting {
            match Self::at(camera).map(|mut node| (node.serial(), node)) {
                Ok((found, node)) if found.as_deref() == Some(serial) => return Ok(node),
                Ok(_) => {}
                Err(failure) => failed = Some(failure),
            }
        }
        Err(failed.unwrap_or_else(|| missing(Some(&format!("serial number {serial}")), &all)))
    }

    /// Opens the camera at a port.
    fn at(detected: &Detected) -> NodeResult<Self> {
        let messages = Messages::new();
        let mut camera = ptr::null_mut();
        // SAFETY: the pointer lives through the call.
        checked(&messages, || unsafe { ffi::gp_camera_new(&raw mut camera) })?;
        let camera = NonNull::new(camera).ok_or_else(|| Failure::new(Cause::Other, "no memory"))?;
        let node = Self { camera, messages, detected: detected.clone() };
        node.choose_port(&detected.port)?;
        // SAFETY: the camera is valid, and its port was chosen.
        let opened = node.call(|camera, context| unsafe { ffi::gp_camera_init(camera, context) });
        opened.map_err(|failure| match denied(&detected.port) {
            true => Failure::new(Cause::Denied, format!("no permission for {}", detected.port)),
            false => failure,
        })?;
        Ok(node)
    }

    fn choose_port(&self, port: &str) -> NodeResult<()> {
        let port = c_string(port)?;
        let mut ports = ptr::null_mut();
        // SAFETY: the list is valid until it is released, once, at the end; the camera copies the entry.
        unsafe {
            checked(&self.messages, || ffi::gp_port_info_list_new(&raw mut ports))?;
            let chosen = checked(&self.messages, || ffi::gp_port_info_list_load(ports))
                .and_then(|_| checked(&self.messages, || ffi::gp_port_info_list_lookup_path(ports, port.as_ptr())))
                .and_then(|index| {
                    let mut info = ptr::null_mut();
                    checked(&self.messages, || ffi::gp_port_info_list_get_info(ports, index, &raw mut info))?;
                    checked(&self.messages, || ffi::gp_camera_set_port_info(self.camera.as_ptr(), info))
                });
            ffi::gp_port_info_list_free(ports);
            chosen.map(drop)
        }
    }

    /// Runs a function of the camera.
    fn call(&self, run: impl FnOnce(*mut ffi::Camera, *mut ffi::Context) -> i32) -> NodeResult<()> {
        checked(&self.messages, || run(self.camera.as_ptr(), self.messages.context())).map(drop)
    }

    fn setting(&self, name: &str) -> NodeResult<Option<Setting>> {
        let name = c_string(name)?;
        let mut widget = ptr::null_mut();
        // SAFETY: name and pointer live through the call; the setting belongs to this process.
        let got = self.call(|camera, context| unsafe {
            ffi::gp_camera_get_single_config(camera, name.as_ptr(), &raw mut widget, context)
        });
        match got {
            Ok(()) if widget.is_null() => Ok(None),
            Ok(()) => Ok(Some(Setting(widget))),
            Err(failure) if failure.cause == Cause::Unsupported => Ok(None),
            Err(failure) => Err(failure),
        }
    }

    fn serial(&mut self) -> Option<String> {
        let serial = ["eosserialnumber", "serialnumber"].iter().find_map(|name| self.setting(name).ok().flatten());
        serial.map(|serial| serial.value().trim().to_owned())
    }
}

/// Whether this user may not open the USB device at a port such as `usb:001,005`.
fn denied(port: &str) -> bool {
    let node = port.strip_prefix("usb:").and_then(|place| place.split_once(','));
    node.is_some_and(|(bus, device)| {
        let node = format!("/dev/bus/usb/{bus}/{device}");
        matches!(check(&Root::default(), Path::new(&node)), Access::Denied { .. })
    })
}

/// Error for a camera that is not connected. Its message lists the connected cameras.
fn missing(device: Option<&str>, all: &[Detected]) -> Failure {
    let all: Vec<&Detected> = all.iter().collect();
    let text = match (device, all.is_empty()) {
        (_, true) => "none".to_owned(),
        (Some(device), _) => format!("no {device}, but {}", words(&all)),
        (None, _) => words(&all),
    };
    Failure::new(Cause::Missing, text)
}

fn words(cameras: &[&Detected]) -> String {
    cameras.iter().map(|c| format!("{} ({})", c.model, c.port)).collect::<Vec<_>>().join(", ")
}

impl Node for GphotoNode {
    fn model(&mut self) -> String {
        self.detected.model.clone()
    }

    fn control(&mut self, name: &'static str) -> NodeResult<Option<Control>> {
        let control = |setting: Setting| Control {
            name,
            value: setting.value().trim().to_owned(),
            choices: setting.choices(),
            read_only: setting.is_read_only(),
        };
        Ok(self.setting(name)?.map(control))
    }

    fn set(&mut self, name: &'static str, value: &str) -> NodeResult<()> {
        let setting = self.setting(name)?;
        let setting = setting.ok_or_else(|| Failure::new(Cause::Unsupported, format!("a camera without {name}")))?;
        setting.set(&self.messages, value)?;
        let name = c_string(name)?;
        // SAFETY: name and setting live through the call.
        self.call(|camera, context| unsafe {
            ffi::gp_camera_set_single_config(camera, name.as_ptr(), setting.0, context)
        })
    }

    fn capture(&mut self) -> NodeResult<CameraFile> {
        let mut path = ffi::FilePath { name: [0; 128], folder: [0; 1024] };
        // SAFETY: the path lives through the call.
        self.call(|camera, context| unsafe {
            ffi::gp_camera_capture(camera, ffi::CAPTURE_IMAGE, &raw mut path, context)
        })?;
        Ok(CameraFile { folder: text_in(&path.folder), name: text_in(&path.name) })
    }

    fn fetch(&mut self, file: &CameraFile, limit: u64) -> NodeResult<Vec<u8>> {
        let (folder, name) = (c_string(&file.folder)?, c_string(&file.name)?);
        // SAFETY: a structure of numbers may be zero.
        let mut info: ffi::FileInfo = unsafe { std::mem::zeroed() };
        // SAFETY: strings and structure live through the call.
        self.call(|camera, context| unsafe {
            ffi::gp_camera_file_get_info(camera, folder.as_ptr(), name.as_ptr(), &raw mut info, context)
        })?;
        let too_large = |size: u64| Failure::new(Cause::TooLarge, format!("{} with {size} bytes", file.name));
        if info.file.fields & ffi::INFO_SIZE != 0 && info.file.size > limit {
            return Err(too_large(info.file.size));
        }
        let mut fetched = ptr::null_mut();
        // SAFETY: the pointer lives through the call.
        checked(&self.messages, || unsafe { ffi::gp_file_new(&raw mut fetched) })?;
        // SAFETY: strings and file live through the call.
        let got = self.call(|camera, context| unsafe {
            let kind = ffi::FILE_NORMAL;
            ffi::gp_camera_file_get(camera, folder.as_ptr(), name.as_ptr(), kind, fetched, context)
        });
        let (mut data, mut size) = (ptr::null(), 0);
        let got = got.and_then(|()| {
            // SAFETY: the file is valid, and the pointers live through the call.
            checked(&self.messages, || unsafe { ffi::gp_file_get_data_and_size(fetched, &raw mut data, &raw mut size) })
        });
        let length = usize::try_from(size).unwrap_or(usize::MAX);
        let bytes = got.and_then(|_| match length as u64 {
            _ if data.is_null() => Ok(vec![]),
            size if size > limit => Err(too_large(size)),
            // SAFETY: the file has `length` bytes, which are copied before it is released.
            _ => Ok(unsafe { std::slice::from_raw_parts(data.cast::<u8>(), length) }.to_vec()),
        });
        // SAFETY: the file is released once, after its last use.
        unsafe { ffi::gp_file_unref(fetched) };
        bytes
    }

    fn delete(&mut self, file: &CameraFile) -> NodeResult<()> {
        let (folder, name) = (c_string(&file.folder)?, c_string(&file.name)?);
        // SAFETY: the strings live through the call.
        self.call(|camera, context| unsafe {
            ffi::gp_camera_file_delete(camera, folder.as_ptr(), name.as_ptr(), context)
        })
    }

    fn storages(&mut self) -> NodeResult<Vec<Storage>> {
        let (mut list, mut count) = (ptr::null_mut(), 0);
        // SAFETY: both live through the call.
        self.call(|camera, context| unsafe {
            ffi::gp_camera_get_storageinfo(camera, &raw mut list, &raw mut count, context)
        })?;
        if list.is_null() {
            return Ok(vec![]);
        }
        let count = usize::try_from(count).unwrap_or(0).min(MAX_STORAGES);
        // SAFETY: the list has `count` entries and is freed once, after its last use.
        unsafe {
            let storages = std::slice::from_raw_parts(list, count).iter().map(|s| Storage {
                writable: s.fields & ffi::STORAGE_ACCESS == 0 || s.access == 0,
                free_kib: (s.fields & ffi::STORAGE_FREE != 0).then_some(s.free_kib),
            });
            let storages = storages.collect();
            ffi::free(list.cast());
            Ok(storages)
        }
    }
}

impl Drop for GphotoNode {
    fn drop(&mut self) {
        // SAFETY: the camera is closed and released once.
        unsafe {
            ffi::gp_camera_exit(self.camera.as_ptr(), self.messages.context());
            ffi::gp_camera_unref(self.camera.as_ptr());
        }
    }
}
