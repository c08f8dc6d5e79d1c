//! Safe forms of the library's results, strings and settings.

use super::context::Messages;
use super::ffi;
use crate::camera::gphoto2::node::{Cause, Failure, NodeResult};
use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::ptr;

/// Largest number of choices of a setting; some cameras list some hundred.
const MAX_CHOICES: i32 = 1000;

/// Runs a function that returns a result code; codes below zero are errors.
pub(super) fn checked(messages: &Messages, run: impl FnOnce() -> c_int) -> NodeResult<c_int> {
    drop(messages.take());
    let code = run();
    if code >= ffi::OK {
        return Ok(code);
    }
    // SAFETY: the library returns a constant string for every code.
    let meaning = text(unsafe { ffi::gp_result_as_string(code) });
    Err(Failure::of(code, &meaning, &messages.take()))
}

/// A string of the library; empty for none.
pub(super) fn text(string: *const c_char) -> String {
    if string.is_null() {
        return String::new();
    }
    // SAFETY: strings of the library end with zero and live at least until the next call.
    unsafe { CStr::from_ptr(string) }.to_string_lossy().into_owned()
}

/// A string in an array of fixed size, which may lack its final zero.
pub(super) fn text_in(array: &[c_char]) -> String {
    let bytes: Vec<u8> = array.iter().take_while(|c| **c != 0).map(|c| c.cast_unsigned()).collect();
    String::from_utf8_lossy(&bytes).into_owned()
}

/// A string for the library.
pub(super) fn c_string(string: &str) -> NodeResult<CString> {
    CString::new(string).map_err(|_| Failure::new(Cause::Unsupported, "a name with a zero byte"))
}

/// A setting of a camera, released when dropped.
pub(super) struct Setting(pub *mut ffi::Widget);

impl Drop for Setting {
    fn drop(&mut self) {
        // SAFETY: the setting is valid and released once.
        unsafe { ffi::gp_widget_unref(self.0) };
    }
}

impl Setting {
    /// Type of the setting.
    fn kind(&self) -> c_int {
        let mut kind = -1;
        // SAFETY: the setting is valid as long as `self`.
        unsafe { ffi::gp_widget_get_type(self.0, &raw mut kind) };
        kind
    }

    fn has_text(kind: c_int) -> bool {
        matches!(kind, ffi::WIDGET_TEXT | ffi::WIDGET_RADIO | ffi::WIDGET_MENU)
    }

    /// Value in force: text, or 0 and 1 for switches; empty for other kinds.
    pub(super) fn value(&self) -> String {
        let kind = self.kind();
        if Self::has_text(kind) {
            let mut value: *const c_char = ptr::null();
            // SAFETY: for these kinds, the library stores the address of a string, which is copied at once.
            unsafe { ffi::gp_widget_get_value(self.0, (&raw mut value).cast()) };
            return text(value);
        }
        if kind == ffi::WIDGET_TOGGLE {
            let mut value: c_int = 0;
            // SAFETY: for this kind, the library stores an integer.
            unsafe { ffi::gp_widget_get_value(self.0, (&raw mut value).cast()) };
            return value.to_string();
        }
        String::new()
    }

    /// Labels of the choices.
    pub(super) fn choices(&self) -> Vec<String> {
        if !matches!(self.kind(), ffi::WIDGET_RADIO | ffi::WIDGET_MENU) {
            return vec![];
        }
        // SAFETY: the setting is valid and has choices; each string is copied at once.
        unsafe {
            let count = ffi::gp_widget_count_choices(self.0).min(MAX_CHOICES);
            let choice = |index| {
                let mut choice = ptr::null();
                ffi::gp_widget_get_choice(self.0, index, &raw mut choice);
                text(choice)
            };
            (0..count).map(choice).collect()
        }
    }

    pub(super) fn is_read_only(&self) -> bool {
        let mut read_only = 0;
        // SAFETY: the setting is valid as long as `self`.
        unsafe { ffi::gp_widget_get_readonly(self.0, &raw mut read_only) };
        read_only != 0
    }

    /// Sets the value: a label, or 0 and 1 for switches.
    pub(super) fn set(&self, messages: &Messages, value: &str) -> NodeResult<()> {
        let kind = self.kind();
        if Self::has_text(kind) {
            let value = c_string(value)?;
            // SAFETY: for these kinds, the library copies the string.
            checked(messages, || unsafe { ffi::gp_widget_set_value(self.0, value.as_ptr().cast::<c_void>()) })?;
            return Ok(());
        }
        let switch = value.parse::<c_int>().ok().filter(|_| kind == ffi::WIDGET_TOGGLE);
        let switch = switch.ok_or_else(|| Failure::new(Cause::Unsupported, "a setting of another kind"))?;
        // SAFETY: for this kind, the library copies an integer.
        checked(messages, || unsafe { ffi::gp_widget_set_value(self.0, (&raw const switch).cast()) })?;
        Ok(())
    }
}
