//! Orientation and absolute period of gratings from fringes on a panel.
//!
//! The panel displays phase-shifted stripes. The response of each pixel reveals the panel positions that it sees: in
//! the mirror direction and, at known angles on both sides of it, through its grating's orders. A dozen frequencies
//! distinguish these positions. With the exact geometry, they determine the grating vector in µm. No other light
//! position and no mechanical scan are needed. `solve.rs` describes the model, which is original (section 4 of the 2018
//! paper uses one flash).

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
pub use discs::DiscVerification;
pub use optics::{Landing, Optics, Place, carrier};
pub use polarization::{Orientations, PolarizationVerification};
pub use reconstruct::{reachable, reconstruct};
pub use report::{Counts, Report, Seconds};
pub use response::Response;
pub use scan::{Found, Points, aperture, scan};
pub use settings::Settings;
pub use signals::{Carrier, Signals, carriers};
pub use solve::{MAX_CARRIERS, Solver};
pub use survey::{DecisionCounts, Survey};
