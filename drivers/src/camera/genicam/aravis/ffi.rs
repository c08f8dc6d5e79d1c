//! Functions of aravis 0.8 and of GLib below it, as declared in their headers.
//!
//! The library is loaded when a GenICam camera is first looked for. Programs need it neither to be built nor to start,
//! and those that use other cameras do not pay for its 20 libraries.

use crate::camera::library::library;
use std::ffi::{c_char, c_double, c_int, c_uint, c_void};

/// Opaque `ArvCamera`.
#[repr(C)]
pub struct ArvCamera(c_void);
/// Opaque `ArvDevice`.
#[repr(C)]
pub struct ArvDevice(c_void);
/// Opaque `ArvStream`.
#[repr(C)]
pub struct ArvStream(c_void);
/// Opaque `ArvBuffer`.
#[repr(C)]
pub struct ArvBuffer(c_void);
/// Opaque `ArvGcNode`.
#[repr(C)]
pub struct ArvGcNode(c_void);

/// `GError`.
#[repr(C)]
pub struct GError {
    pub domain: u32,
    pub code: c_int,
    pub message: *const c_char,
}

/// Where a function stores its error.
pub type Errors = *mut *mut GError;

/// Called on the thread that receives packets. The second argument is an `ArvStreamCallbackType`.
pub type StreamCallback = extern "C" fn(*mut c_void, c_int, *mut ArvBuffer);
/// Frees the user data of a buffer.
pub type Destroy = extern "C" fn(*mut c_void);

/// `ARV_STREAM_CALLBACK_TYPE_START_BUFFER`.
pub const START_BUFFER: c_int = 2;
/// `ARV_BUFFER_PAYLOAD_TYPE_IMAGE`.
pub const PAYLOAD_IMAGE: c_int = 1;
/// `ARV_AUTO_OFF`.
pub const AUTO_OFF: c_int = 0;
/// `ARV_ACQUISITION_MODE_CONTINUOUS`.
pub const CONTINUOUS: c_int = 0;
/// `ARV_GV_PACKET_SIZE_ADJUSTMENT_NEVER`.
pub const ADJUST_NEVER: c_int = 0;

library! {
    "libaravis-0.8.so.0";
    fn arv_enable_interface(id: *const c_char);
    fn arv_disable_interface(id: *const c_char);
    fn arv_update_device_list();
    fn arv_get_n_devices() -> c_uint;
    fn arv_get_device_id(index: c_uint) -> *const c_char;
    fn arv_get_device_address(index: c_uint) -> *const c_char;
    fn arv_get_device_vendor(index: c_uint) -> *const c_char;
    fn arv_get_device_model(index: c_uint) -> *const c_char;
    fn arv_get_device_serial_nbr(index: c_uint) -> *const c_char;
    fn arv_get_device_protocol(index: c_uint) -> *const c_char;

    fn arv_camera_new(name: *const c_char, error: Errors) -> *mut ArvCamera;
    fn arv_camera_get_device(camera: *mut ArvCamera) -> *mut ArvDevice;
    fn arv_camera_create_stream(
        camera: *mut ArvCamera,
        callback: Option<StreamCallback>,
        data: *mut c_void,
        error: Errors,
    ) -> *mut ArvStream;
    fn arv_camera_get_vendor_name(camera: *mut ArvCamera, error: Errors) -> *const c_char;
    fn arv_camera_get_model_name(camera: *mut ArvCamera, error: Errors) -> *const c_char;
    fn arv_camera_get_device_serial_number(camera: *mut ArvCamera, error: Errors) -> *const c_char;
    fn arv_camera_get_device_id(camera: *mut ArvCamera, error: Errors) -> *const c_char;
    fn arv_camera_dup_available_pixel_formats_as_strings(
        camera: *mut ArvCamera,
        count: *mut c_uint,
        error: Errors,
    ) -> *mut *const c_char;
    fn arv_camera_set_pixel_format_from_string(camera: *mut ArvCamera, name: *const c_char, error: Errors);
    fn arv_camera_get_pixel_format(camera: *mut ArvCamera, error: Errors) -> u32;
    fn arv_camera_is_region_offset_available(camera: *mut ArvCamera, error: Errors) -> c_int;
    fn arv_camera_get_width_bounds(camera: *mut ArvCamera, low: *mut c_int, high: *mut c_int, error: Errors);
    fn arv_camera_get_height_bounds(camera: *mut ArvCamera, low: *mut c_int, high: *mut c_int, error: Errors);
    fn arv_camera_set_region(
        camera: *mut ArvCamera,
        x: c_int,
        y: c_int,
        width: c_int,
        height: c_int,
        error: Errors,
    );
    fn arv_camera_get_region(
        camera: *mut ArvCamera,
        x: *mut c_int,
        y: *mut c_int,
        width: *mut c_int,
        height: *mut c_int,
        error: Errors,
    );
    fn arv_camera_is_exposure_time_available(camera: *mut ArvCamera, error: Errors) -> c_int;
    fn arv_camera_is_exposure_auto_available(camera: *mut ArvCamera, error: Errors) -> c_int;
    fn arv_camera_set_exposure_time_auto(camera: *mut ArvCamera, mode: c_int, error: Errors);
    fn arv_camera_get_exposure_time_auto(camera: *mut ArvCamera, error: Errors) -> c_int;
    fn arv_camera_get_exposure_time_bounds(
        camera: *mut ArvCamera,
        low: *mut c_double,
        high: *mut c_double,
        error: Errors,
    );
    fn arv_camera_set_exposure_time(camera: *mut ArvCamera, us: c_double, error: Errors);
    fn arv_camera_get_exposure_time(camera: *mut ArvCamera, error: Errors) -> c_double;
    fn arv_camera_is_gain_available(camera: *mut ArvCamera, error: Errors) -> c_int;
    fn arv_camera_is_gain_auto_available(camera: *mut ArvCamera, error: Errors) -> c_int;
    fn arv_camera_set_gain_auto(camera: *mut ArvCamera, mode: c_int, error: Errors);
    fn arv_camera_get_gain_auto(camera: *mut ArvCamera, error: Errors) -> c_int;
    fn arv_camera_get_gain_bounds(camera: *mut ArvCamera, low: *mut c_double, high: *mut c_double, error: Errors);
    fn arv_camera_set_gain(camera: *mut ArvCamera, gain: c_double, error: Errors);
    fn arv_camera_get_gain(camera: *mut ArvCamera, error: Errors) -> c_double;
    fn arv_camera_is_black_level_auto_available(camera: *mut ArvCamera, error: Errors) -> c_int;
    fn arv_camera_set_black_level_auto(camera: *mut ArvCamera, mode: c_int, error: Errors);
    fn arv_camera_get_black_level_auto(camera: *mut ArvCamera, error: Errors) -> c_int;
    fn arv_camera_set_black_level(camera: *mut ArvCamera, level: c_double, error: Errors);
    fn arv_camera_get_black_level(camera: *mut ArvCamera, error: Errors) -> c_double;
    fn arv_camera_is_frame_rate_available(camera: *mut ArvCamera, error: Errors) -> c_int;
    fn arv_camera_set_frame_rate(camera: *mut ArvCamera, hz: c_double, error: Errors);
    fn arv_camera_get_frame_rate(camera: *mut ArvCamera, error: Errors) -> c_double;
    fn arv_camera_set_trigger(camera: *mut ArvCamera, source: *const c_char, error: Errors);
    fn arv_camera_clear_triggers(camera: *mut ArvCamera, error: Errors);
    fn arv_camera_software_trigger(camera: *mut ArvCamera, error: Errors);
    fn arv_camera_is_feature_available(camera: *mut ArvCamera, name: *const c_char, error: Errors) -> c_int;
    fn arv_camera_set_string(camera: *mut ArvCamera, name: *const c_char, value: *const c_char, error: Errors);
    fn arv_camera_get_string(camera: *mut ArvCamera, name: *const c_char, error: Errors) -> *const c_char;
    fn arv_camera_set_acquisition_mode(camera: *mut ArvCamera, mode: c_int, error: Errors);
    fn arv_camera_start_acquisition(camera: *mut ArvCamera, error: Errors);
    fn arv_camera_stop_acquisition(camera: *mut ArvCamera, error: Errors);
    fn arv_camera_get_payload(camera: *mut ArvCamera, error: Errors) -> c_uint;
    fn arv_camera_is_gv_device(camera: *mut ArvCamera) -> c_int;
    fn arv_camera_gv_set_packet_size(camera: *mut ArvCamera, bytes: c_int, error: Errors);
    fn arv_camera_gv_auto_packet_size(camera: *mut ArvCamera, error: Errors) -> c_uint;
    fn arv_camera_gv_get_packet_size(camera: *mut ArvCamera, error: Errors) -> c_uint;
    fn arv_camera_gv_set_packet_size_adjustment(camera: *mut ArvCamera, adjustment: c_int);

    fn arv_gv_device_is_controller(device: *mut ArvDevice) -> c_int;
    fn arv_gv_device_take_control(device: *mut ArvDevice, error: Errors) -> c_int;
    fn arv_device_read_register(device: *mut ArvDevice, address: u64, value: *mut u32, error: Errors) -> c_int;
    fn arv_device_get_feature(device: *mut ArvDevice, name: *const c_char) -> *mut ArvGcNode;
    fn arv_gc_float_get_type() -> usize;
    fn arv_gc_float_get_unit(node: *mut ArvGcNode) -> *const c_char;

    fn arv_stream_push_buffer(stream: *mut ArvStream, buffer: *mut ArvBuffer);
    fn arv_stream_timeout_pop_buffer(stream: *mut ArvStream, us: u64) -> *mut ArvBuffer;
    fn arv_stream_get_statistics(
        stream: *mut ArvStream,
        completed: *mut u64,
        failures: *mut u64,
        underruns: *mut u64,
    );
    fn arv_stream_get_info_uint64_by_name(stream: *mut ArvStream, name: *const c_char) -> u64;

    fn arv_buffer_new_full(
        size: usize,
        preallocated: *mut c_void,
        data: *mut c_void,
        destroy: Option<Destroy>,
    ) -> *mut ArvBuffer;
    fn arv_buffer_get_user_data(buffer: *mut ArvBuffer) -> *const c_void;
    fn arv_buffer_get_status(buffer: *mut ArvBuffer) -> c_int;
    fn arv_buffer_get_payload_type(buffer: *mut ArvBuffer) -> c_int;
    fn arv_buffer_get_timestamp(buffer: *mut ArvBuffer) -> u64;
    fn arv_buffer_get_frame_id(buffer: *mut ArvBuffer) -> u64;
    fn arv_buffer_get_image_data(buffer: *mut ArvBuffer, size: *mut usize) -> *const u8;
    fn arv_buffer_get_image_pixel_format(buffer: *mut ArvBuffer) -> u32;
    fn arv_buffer_get_image_width(buffer: *mut ArvBuffer) -> c_int;
    fn arv_buffer_get_image_height(buffer: *mut ArvBuffer) -> c_int;
    fn arv_buffer_get_image_padding(buffer: *mut ArvBuffer, x: *mut c_int, y: *mut c_int);

    fn g_object_unref(object: *mut c_void);
    fn g_type_check_instance_is_a(instance: *mut c_void, kind: usize) -> c_int;

    fn g_error_free(error: *mut GError);
    fn g_free(memory: *mut c_void);
    fn g_quark_to_string(quark: u32) -> *const c_char;
}
