//! Fringes on the panel.

use nacre_drivers::Pattern;

/// Largest code of the panel: 8 bits.
const LARGEST_CODE: f64 = 255.0;

/// Number of intervals of the target luminance, 0 to 1, in a [`Tone`]. One in fifty contains a step between two codes.
const INTERVALS: usize = 8192;

/// Fringes on the panel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fringes {
    /// Spatial frequency to the right and up in cycles per mm.
    pub cycles_per_mm: [f64; 2],
    /// Phase at the panel's centre in cycles.
    pub phase: f64,
    /// Exponent that the driver assumes for the panel.
    pub gamma: f64,
}

impl Fringes {
    /// Whether they are uniform light.
    pub(crate) fn even(&self) -> bool {
        self.cycles_per_mm == [0.0; 2]
    }
}

/// Luminance of a panel under fringes.
///
/// A panel has few codes, so a table holds the exact luminance of most intervals. Intervals with a step between two
/// codes are computed at each point.
pub(crate) struct Tone {
    fringes: Fringes,
    /// True exponent of the panel.
    gamma: f64,
    /// Luminance of each interval; NaN if it contains a step.
    table: Vec<f64>,
}

impl Tone {
    /// Tabulates the luminance of a panel with this exponent.
    pub(crate) fn new(fringes: Fringes, gamma: f64) -> Self {
        let edges: Vec<f64> =
            (0..=INTERVALS).map(|k| luminance(k as f64 / INTERVALS as f64, fringes.gamma, gamma)).collect();
        let table = edges.windows(2).map(|e| if e[0] == e[1] { e[0] } else { f64::NAN }).collect();
        Self { fringes, gamma, table }
    }

    /// Its fringes.
    pub(crate) fn fringes(&self) -> &Fringes {
        &self.fringes
    }

    /// Luminance at a point in mm relative to the panel's centre.
    pub(crate) fn at(&self, place_mm: [f64; 2]) -> f64 {
        self.of(Pattern::fringe(self.fringes.cycles_per_mm, self.fringes.phase, place_mm))
    }

    /// Luminance for a target luminance, 0 to 1.
    fn of(&self, asked: f64) -> f64 {
        let tabulated = self.table[((asked * INTERVALS as f64) as usize).min(INTERVALS - 1)];
        if tabulated.is_nan() { luminance(asked, self.fringes.gamma, self.gamma) } else { tabulated }
    }
}

/// Luminance of a panel with the exponent `gamma`, driven for the exponent `assumed`.
fn luminance(asked: f64, assumed: f64, gamma: f64) -> f64 {
    let code = (LARGEST_CODE * asked.powf(1.0 / assumed)).round();
    (code / LARGEST_CODE).powf(gamma)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_hold_what_the_panel_shows() {
        for (assumed, gamma) in [(2.2, 2.2), (1.0, 2.2), (5.0, 1.0), (0.2, 3.0)] {
            let tone = Tone::new(Fringes { cycles_per_mm: [0.0; 2], phase: 0.0, gamma: assumed }, gamma);
            for k in 0..=1_000_003 {
                let asked = f64::from(k) / 1_000_003.0;
                assert_eq!(tone.of(asked), luminance(asked, assumed, gamma), "{asked} {assumed} {gamma}");
            }
        }
    }
}
