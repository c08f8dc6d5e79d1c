//! The pattern page `/display`: a browser in full screen on the LCD, as a panel of the bench.

mod link;
mod panel;

pub use link::{DisplayState, Link, NotShown, OtherPage, PagePattern};
pub(crate) use panel::PagePanel;
