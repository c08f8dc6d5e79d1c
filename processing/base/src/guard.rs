//! Isolation of third-party decoders: a panic in a decoder becomes an error of its input.

use std::any::Any;
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::sync::Once;

thread_local! {
    /// True while this thread runs a guarded decoder.
    static GUARDED: Cell<bool> = const { Cell::new(false) };
}

/// Runs a decoder on untrusted input. A panic is caught without being printed, and returned as a phrase that completes
/// "the file".
pub fn guarded<T>(decode: impl FnOnce() -> T) -> Result<T, String> {
    silence_guarded_panics();
    let outer = GUARDED.replace(true);
    let outcome = catch_unwind(AssertUnwindSafe(decode));
    GUARDED.set(outer);
    outcome.map_err(|panic| format!("makes its decoder fail ({})", message(&*panic)))
}

/// Marks this thread as belonging to a guarded decoder, so that its panics are not printed. For threads used only by
/// decoders.
pub fn guard_thread() {
    silence_guarded_panics();
    GUARDED.set(true);
}

/// Suppresses the report of guarded panics on standard error; all other panics are reported.
fn silence_guarded_panics() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let report = take_hook();
        set_hook(Box::new(move |panic| {
            if !GUARDED.get() {
                report(panic);
            }
        }));
    });
}

fn message(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<&str>().copied();
    text.or_else(|| panic.downcast_ref::<String>().map(String::as_str)).unwrap_or("without a message")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_becomes_an_error_with_its_message() {
        let empty: Vec<u8> = vec![];
        let said = guarded(|| empty[empty.len()]).unwrap_err();
        assert!(said.contains("index out of bounds"), "{said}");
        assert!(guarded(|| -> u8 { panic!("at byte {}", 7) }).unwrap_err().contains("at byte 7"));
        assert_eq!(guarded(|| 7), Ok(7));
    }

    #[test]
    fn guards_nest_and_end_with_the_decoder() {
        let inside = || (guarded(|| GUARDED.get()), GUARDED.get());
        assert_eq!(guarded(inside), Ok((Ok(true), true)));
        assert_eq!(
            guarded(|| guarded(|| panic!("x"))),
            Ok(Err("makes its decoder fail (x)".into())) as Result<Result<(), _>, _>
        );
        assert!(!GUARDED.get());
    }
}
