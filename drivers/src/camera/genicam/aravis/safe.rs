//! Safe forms of the library's errors, strings and lists.

use super::ffi::{self, GError};
use crate::camera::genicam::node::{Cause, Failure, NodeResult};
use std::ffi::{CStr, CString, c_char, c_uint};
use std::ptr;

/// Maximum number of names in a list.
const MAX_NAMES: usize = 4096;

/// Runs a function that stores its error.
pub fn checked<T>(run: impl FnOnce(ffi::Errors) -> T) -> NodeResult<T> {
    let mut error: *mut GError = ptr::null_mut();
    let value = run(&raw mut error);
    match failure(error) {
        Some(failure) => Err(failure),
        None => Ok(value),
    }
}

/// Converts and frees an error.
fn failure(error: *mut GError) -> Option<Failure> {
    if error.is_null() {
        return None;
    }
    // SAFETY: the library returned a valid error, which this function owns; its message and the name of its domain are
    // strings that end with zero.
    let (domain, code, message) = unsafe {
        let found = &*error;
        let told = (text(ffi::g_quark_to_string(found.domain)), found.code, text(found.message));
        ffi::g_error_free(error);
        told
    };
    // `ArvDeviceError`.
    let cause = match (domain.as_str(), code) {
        ("arv-device-error-quark", 6) => Cause::Missing,
        ("arv-device-error-quark", 10 | 17) => Cause::Held,
        ("arv-device-error-quark", 2 | 4 | 5) => Cause::Gone,
        ("arv-device-error-quark", 0 | 1 | 7 | 12 | 13 | 15) => Cause::Unsupported,
        // A feature that the camera's description lacks, or a value that it refuses.
        ("arv-gc-error-quark", _) => Cause::Unsupported,
        _ => Cause::Other,
    };
    Some(Failure::new(cause, message))
}

/// A string of the library; empty for none.
pub fn text(string: *const c_char) -> String {
    if string.is_null() {
        return String::new();
    }
    // SAFETY: strings of the library end with zero and live at least until the next call.
    unsafe { CStr::from_ptr(string) }.to_string_lossy().into_owned()
}

/// A string for the library.
pub fn c_string(string: &str) -> NodeResult<CString> {
    CString::new(string).map_err(|_| Failure::new(Cause::Unsupported, "a name with a zero byte"))
}

/// A list of names, whose memory belongs to the caller and whose strings belong to the library.
pub fn names(run: impl FnOnce(*mut c_uint, ffi::Errors) -> *mut *const c_char) -> NodeResult<Vec<String>> {
    let mut count: c_uint = 0;
    let list = checked(|error| run(&raw mut count, error))?;
    if list.is_null() {
        return Ok(vec![]);
    }
    let count = usize::try_from(count).unwrap_or(0).min(MAX_NAMES);
    // SAFETY: the list has `count` strings; it is freed once, after its last use.
    unsafe {
        let names = std::slice::from_raw_parts(list, count).iter().map(|name| text(*name)).collect();
        ffi::g_free(list.cast());
        Ok(names)
    }
}
