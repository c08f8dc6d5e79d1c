//! Studies of height-field BRDFs: choice of expansion, number of wavelengths, and limits of scalar theory,
//! approximations and methods.

mod coherence;
mod expansions;
mod stress;
mod sums;

use nacre_studies::{Effort, Study};

/// All studies of height-field BRDFs.
pub(super) fn studies(effort: Effort) -> Vec<Study> {
    let mut all = vec![expansions::study(effort)];
    all.extend(stress::studies(effort));
    all
}
