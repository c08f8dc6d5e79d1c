//! Orientation and absolute period of gratings from fringes on a panel.
//!
//! The panel shows stripes that move; each pixel answers with the places of the panel that it sees: in the mirror direction and, a known angle
//! to both sides of it, through the orders of its grating. A dozen frequencies tell these places apart, and with the exact geometry the
//! grating's vector follows, in µm: no other light position is needed, and nothing is scanned. `solve.rs` has the model (an own method; the
//! 2018 paper's section 4 uses one flash).

mod answer;
mod carriers;
mod choose;
mod discs;
mod input;
mod optics;
mod output;
mod polarization;
mod pose;
mod reconstruct;
mod report;
mod response;
mod scan;
mod settings;
mod signals;
mod solve;
mod survey;
#[cfg(test)]
mod tests;

pub use answer::{Answer, Demands, Grating, Solution, Verdict};
pub use carriers::{Search, frequencies};
pub use choose::{LEAST_FRINGES, Prediction, Request, Setting, cheapest, predict};
pub use discs::Told;
pub use optics::{Landing, Optics, Place, carrier};
pub use polarization::{Helped, Orientations};
pub use reconstruct::{reachable, reconstruct};
pub use report::{Counts, Report, Seconds};
pub use response::Response;
pub use scan::{Found, Points, aperture, scan};
pub use settings::Settings;
pub use signals::{Carrier, Signals, carriers};
pub use solve::{MAX_CARRIERS, Solver};
pub use survey::{Decided, Survey};
