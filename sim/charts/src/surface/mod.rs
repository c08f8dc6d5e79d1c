//! BRDFs of height fields: which expansion, how many wavelengths, and where scalar theory, approximations and methods fail.

mod coherence;
mod expansions;
mod stress;
mod sums;

use nacre_studies::{Effort, Study};

/// All of them.
pub(super) fn studies(effort: Effort) -> Vec<Study> {
    let mut all = vec![expansions::study(effort)];
    all.extend(stress::studies(effort));
    all
}
