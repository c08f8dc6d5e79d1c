//! Messages that the library gives with its errors.

use super::ffi;
use super::safe::text;
use std::ffi::{c_char, c_void};
use std::sync::{Mutex, PoisonError};

/// Longest kept text of messages in bytes.
const MAX_TEXT: usize = 1000;

/// A context of the library, which collects messages.
pub(super) struct Messages {
    context: *mut ffi::Context,
    /// On the heap, since the library keeps its address.
    texts: Box<Mutex<String>>,
}

// SAFETY: one thread at a time uses the context, and the texts are behind a lock.
unsafe impl Send for Messages {}

extern "C" fn collect(_: *mut ffi::Context, message: *const c_char, data: *mut c_void) {
    // SAFETY: `data` is the address given below, whose owner outlives the context.
    let texts = unsafe { &*data.cast::<Mutex<String>>() };
    let mut texts = texts.lock().unwrap_or_else(PoisonError::into_inner);
    if texts.len() < MAX_TEXT {
        let message = text(message);
        let separator = if texts.is_empty() { "" } else { "; " };
        texts.push_str(separator);
        texts.extend(message.trim().chars().filter(|c| !c.is_control()).take(MAX_TEXT));
    }
}

impl Messages {
    /// A new context. The library must be loaded.
    pub(super) fn new() -> Self {
        let mut texts = Box::new(Mutex::new(String::new()));
        let data: *mut Mutex<String> = &raw mut *texts;
        // SAFETY: the texts live on the heap as long as the context.
        let context = unsafe {
            let context = ffi::gp_context_new();
            ffi::gp_context_set_error_func(context, collect, data.cast());
            context
        };
        Self { context, texts }
    }

    pub(super) fn context(&self) -> *mut ffi::Context {
        self.context
    }

    /// Messages since the last call.
    pub(super) fn take(&self) -> String {
        std::mem::take(&mut self.texts.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Drop for Messages {
    fn drop(&mut self) {
        // SAFETY: the context is released once, before the texts.
        unsafe { ffi::gp_context_unref(self.context) };
    }
}
