//! Pseudo-random numbers that are the same in every run.

/// Mixes bits (SplitMix64, Steele et al. 2014).
pub fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A stream of numbers from 0 to 1.
pub struct Stream(u64);

impl Stream {
    /// The stream of a seed.
    pub fn of(seed: u64) -> Self {
        Self(seed)
    }

    /// That of a pixel, a pass, and the like: streams of neighbours have nothing in common.
    pub fn new(pixel: usize, pass: usize) -> Self {
        Self(mix(mix(pixel as u64 ^ 0x9e37_79b9_7f4a_7c15) ^ (pass as u64).wrapping_mul(0xd1b5_4a32_d192_ed03)))
    }

    /// The next number, in `[0, 1)`.
    #[expect(clippy::should_implement_trait, reason = "the stream never ends, so that an Option would be in the way")]
    pub fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        (mix(self.0) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// The next `N` numbers.
    pub fn numbers<const N: usize>(&mut self) -> [f64; N] {
        std::array::from_fn(|_| self.next())
    }

    /// A whole number below `n`, which is above 0.
    pub fn below(&mut self, n: usize) -> usize {
        ((self.next() * n as f64) as usize).min(n - 1)
    }
}
