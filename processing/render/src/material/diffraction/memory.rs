//! Memory of one thread for the light that diffracts.

use crate::material::diffraction::grating::Scratch;
use nacre_brdf::Workspace;

/// Steps of wave numbers between which powers are linear.
pub(super) const NODES: usize = 64;

/// Memory of one thread.
#[derive(Default)]
pub(crate) struct Memory {
    pub scratch: Scratch,
    pub kept: Kept,
    pub workspace: Workspace,
}

/// Powers of the orders that a place sends towards its view, at even wave numbers: all lights share them.
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
    /// Another place or view follows.
    pub(crate) fn forget(&mut self) {
        self.known.fill(false);
    }
}
