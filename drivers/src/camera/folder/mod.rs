//! Photographs that a camera's own program, or a memory card with a radio, puts into a folder.
//!
//! The operator or a switched shutter cable triggers each photograph. Its file is matched by time: it appears after the
//! trigger, and its Exif time is not earlier. Files are read, never moved or deleted.

mod driver;
mod matching;
mod settings;
#[cfg(test)]
mod tests;
mod trigger;
mod watch;

pub use driver::{FolderCamera, open};
pub use settings::{Settings, Trigger};
