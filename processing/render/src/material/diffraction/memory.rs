//! Scratch memory of one thread for diffracted light.

use crate::material::diffraction::grating::Scratch;
use nacre_brdf::Workspace;

/// Number of wave-number intervals between which powers are interpolated linearly.
pub(super) const NODES: usize = 64;

/// Scratch memory of one thread.
#[derive(Default)]
pub(crate) struct Memory {
    pub scratch: Scratch,
    pub kept: Kept,
    pub workspace: Workspace,
}

/// Powers of the orders from a point towards its view, at equidistant wave numbers; shared by all lights.
pub(crate) struct Kept {
    pub(super) known: [bool; NODES + 1],
    pub(super) nodes: [Vec<(i32, f64)>; NODES + 1],
}

impl Default for Kept {
    fn default() -> Self {
        Self { known: [false; NODES + 1], nodes: [const { vec![] }; NODES + 1] }
    }
}

impl Kept {
    /// Discards the cached powers before another point or view.
    pub(crate) fn forget(&mut self) {
        self.known.fill(false);
    }
}
