//! Functions of libgphoto2 2.5 and of libgphoto2_port below it, as declared in their headers.
//!
//! The library is loaded when a camera of it is first looked for. Programs need it neither to be built nor to start.

use crate::camera::library::library;
use std::ffi::{c_char, c_int, c_uint, c_ulong, c_void};

/// Opaque `Camera`.
#[repr(C)]
pub struct Camera(c_void);
/// Opaque `GPContext`.
#[repr(C)]
pub struct Context(c_void);
/// Opaque `CameraList`.
#[repr(C)]
pub struct List(c_void);
/// Opaque `CameraWidget`.
#[repr(C)]
pub struct Widget(c_void);
/// Opaque `CameraFile`.
#[repr(C)]
pub struct File(c_void);
/// Opaque `GPPortInfoList`.
#[repr(C)]
pub struct PortInfoList(c_void);
/// `GPPortInfo`, a pointer to an opaque structure.
pub type PortInfo = *mut c_void;

/// `CameraFilePath`.
#[repr(C)]
pub struct FilePath {
    pub name: [c_char; 128],
    pub folder: [c_char; 1024],
}

/// `CameraFileInfo`.
#[repr(C)]
pub struct FileInfo {
    pub preview: PreviewInfo,
    pub file: PlainInfo,
    pub audio: AudioInfo,
}

/// `CameraFileInfoPreview`.
#[repr(C)]
pub struct PreviewInfo {
    pub fields: c_uint,
    pub status: c_uint,
    pub size: u64,
    pub kind: [c_char; 64],
    pub width: u32,
    pub height: u32,
}

/// `CameraFileInfoFile`.
#[repr(C)]
pub struct PlainInfo {
    pub fields: c_uint,
    pub status: c_uint,
    pub size: u64,
    pub kind: [c_char; 64],
    pub width: u32,
    pub height: u32,
    pub permissions: c_uint,
    /// `time_t`.
    pub mtime: i64,
}

/// `CameraFileInfoAudio`.
#[repr(C)]
pub struct AudioInfo {
    pub fields: c_uint,
    pub status: c_uint,
    pub size: u64,
    pub kind: [c_char; 64],
}

/// `CameraStorageInformation`.
#[repr(C)]
pub struct StorageInfo {
    pub fields: c_uint,
    pub folder: [c_char; 256],
    pub label: [c_char; 256],
    pub description: [c_char; 256],
    pub kind: c_uint,
    pub file_system: c_uint,
    pub access: c_uint,
    pub capacity_kib: u64,
    pub free_kib: u64,
    pub free_images: u64,
}

/// Called with the library's messages.
pub type Message = extern "C" fn(*mut Context, *const c_char, *mut c_void);

/// `GP_OK`.
pub const OK: c_int = 0;
/// `GP_CAPTURE_IMAGE`.
pub const CAPTURE_IMAGE: c_int = 0;
/// `GP_FILE_TYPE_NORMAL`.
pub const FILE_NORMAL: c_int = 1;
/// `GP_FILE_INFO_SIZE`.
pub const INFO_SIZE: c_uint = 1 << 2;
/// `GP_STORAGEINFO_ACCESS`.
pub const STORAGE_ACCESS: c_uint = 1 << 3;
/// `GP_STORAGEINFO_FREESPACEKBYTES`.
pub const STORAGE_FREE: c_uint = 1 << 7;
/// `GP_WIDGET_TEXT`.
pub const WIDGET_TEXT: c_int = 2;
/// `GP_WIDGET_TOGGLE`.
pub const WIDGET_TOGGLE: c_int = 4;
/// `GP_WIDGET_RADIO`.
pub const WIDGET_RADIO: c_int = 5;
/// `GP_WIDGET_MENU`.
pub const WIDGET_MENU: c_int = 6;

library! {
    "libgphoto2.so.6";
    fn gp_result_as_string(result: c_int) -> *const c_char;

    fn gp_context_new() -> *mut Context;
    fn gp_context_unref(context: *mut Context);
    fn gp_context_set_error_func(context: *mut Context, message: Message, data: *mut c_void);

    fn gp_list_new(list: *mut *mut List) -> c_int;
    fn gp_list_unref(list: *mut List) -> c_int;
    fn gp_list_count(list: *mut List) -> c_int;
    fn gp_list_get_name(list: *mut List, index: c_int, name: *mut *const c_char) -> c_int;
    fn gp_list_get_value(list: *mut List, index: c_int, value: *mut *const c_char) -> c_int;

    fn gp_port_info_list_new(list: *mut *mut PortInfoList) -> c_int;
    fn gp_port_info_list_free(list: *mut PortInfoList) -> c_int;
    fn gp_port_info_list_load(list: *mut PortInfoList) -> c_int;
    fn gp_port_info_list_lookup_path(list: *mut PortInfoList, path: *const c_char) -> c_int;
    fn gp_port_info_list_get_info(list: *mut PortInfoList, index: c_int, info: *mut PortInfo) -> c_int;

    fn gp_camera_autodetect(list: *mut List, context: *mut Context) -> c_int;
    fn gp_camera_new(camera: *mut *mut Camera) -> c_int;
    fn gp_camera_unref(camera: *mut Camera) -> c_int;
    fn gp_camera_set_port_info(camera: *mut Camera, info: PortInfo) -> c_int;
    fn gp_camera_init(camera: *mut Camera, context: *mut Context) -> c_int;
    fn gp_camera_exit(camera: *mut Camera, context: *mut Context) -> c_int;
    fn gp_camera_get_single_config(
        camera: *mut Camera,
        name: *const c_char,
        widget: *mut *mut Widget,
        context: *mut Context,
    ) -> c_int;
    fn gp_camera_set_single_config(
        camera: *mut Camera,
        name: *const c_char,
        widget: *mut Widget,
        context: *mut Context,
    ) -> c_int;
    fn gp_camera_capture(camera: *mut Camera, kind: c_int, path: *mut FilePath, context: *mut Context) -> c_int;
    fn gp_camera_file_get_info(
        camera: *mut Camera,
        folder: *const c_char,
        name: *const c_char,
        info: *mut FileInfo,
        context: *mut Context,
    ) -> c_int;
    fn gp_camera_file_get(
        camera: *mut Camera,
        folder: *const c_char,
        name: *const c_char,
        kind: c_int,
        file: *mut File,
        context: *mut Context,
    ) -> c_int;
    fn gp_camera_file_delete(
        camera: *mut Camera,
        folder: *const c_char,
        name: *const c_char,
        context: *mut Context,
    ) -> c_int;
    fn gp_camera_get_storageinfo(
        camera: *mut Camera,
        storages: *mut *mut StorageInfo,
        count: *mut c_int,
        context: *mut Context,
    ) -> c_int;

    fn gp_widget_unref(widget: *mut Widget) -> c_int;
    fn gp_widget_get_type(widget: *mut Widget, kind: *mut c_int) -> c_int;
    fn gp_widget_get_readonly(widget: *mut Widget, read_only: *mut c_int) -> c_int;
    fn gp_widget_get_value(widget: *mut Widget, value: *mut c_void) -> c_int;
    fn gp_widget_set_value(widget: *mut Widget, value: *const c_void) -> c_int;
    fn gp_widget_count_choices(widget: *mut Widget) -> c_int;
    fn gp_widget_get_choice(widget: *mut Widget, index: c_int, choice: *mut *const c_char) -> c_int;

    fn gp_file_new(file: *mut *mut File) -> c_int;
    fn gp_file_unref(file: *mut File) -> c_int;
    fn gp_file_get_data_and_size(file: *mut File, data: *mut *const c_char, size: *mut c_ulong) -> c_int;
}

unsafe extern "C" {
    /// The C library's function, which frees lists that the library allocates.
    pub fn free(memory: *mut c_void);
}

#[cfg(all(test, target_pointer_width = "64"))]
mod tests {
    use super::*;

    /// Sizes of the structures on 64-bit Linux, from the headers.
    #[test]
    fn structures_have_the_sizes_of_the_headers() {
        assert_eq!(size_of::<FilePath>(), 1152);
        assert_eq!(size_of::<FileInfo>(), 88 + 104 + 80);
        assert_eq!(size_of::<StorageInfo>(), 808);
    }
}
