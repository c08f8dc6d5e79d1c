//! Maps of orientation and period as assets: editing, exchange as pictures, comparison.
//!
//! A folder holds `orientation.exr` (channels `orientation` in [0, π) rad, `sigma`, `mask`), `period.exr` (`period` in
//! µm, `sigma`, `mask`), or both, of equal size. All attributes are preserved; further channels are preserved unless an
//! edit moves pixels. Masked values are NaN and remain masked through all edits.

mod asset;
mod compare;
mod curve;
mod edit;
mod job;
mod layout;
mod pack;
mod picture;
pub mod recommend;
mod segment;
#[cfg(test)]
mod tests;

pub use asset::{Kind, Map, Maps};
pub use compare::{Agreement, Compared, Comparison, compare};
pub use curve::Curve;
pub use edit::{Options, edit};
pub use job::{About, Report};
pub use layout::Layout;
pub use pack::{Encoding, PACK, export, import};
pub use picture::{before_and_after, side_by_side};
pub use segment::{SegmentReport, Segmented, segment};
