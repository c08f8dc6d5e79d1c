//! Reproducible pseudo-random numbers.

/// Mixes bits (SplitMix64, Steele et al. 2014).
pub fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A sequence of numbers from 0 to 1.
pub struct Stream {
    state: u64,
    strata: Option<Strata>,
}

/// Stratification of one of several sequences.
struct Strata {
    /// Index of the sequence, and number of sequences: a power of two.
    index: u64,
    count: u64,
    /// Common seed of the sequences.
    key: u64,
    /// Number of values drawn so far.
    dimension: u64,
}

impl Strata {
    /// Stratum of the next number. Numbers at even and odd positions are the two coordinates of a net. It consists of
    /// the first two Sobol dimensions, with points permuted and both coordinates scrambled by exclusive or, which
    /// preserves the net.
    fn next(&mut self) -> u64 {
        let pair = mix(self.key ^ mix(self.dimension / 2));
        // An odd factor is invertible modulo a power of two, so this is a permutation.
        let point = ((self.index ^ pair).wrapping_mul((pair >> 16) | 1) ^ (pair >> 32)) & (self.count - 1);
        let bits = self.count.trailing_zeros();
        let first = self.dimension.is_multiple_of(2);
        let mut column = self.count >> 1;
        let mut place = 0;
        for bit in 0..bits {
            place ^= if point >> bit & 1 == 1 { column } else { 0 };
            column = if first { column >> 1 } else { column ^ (column >> 1) };
        }
        let shift = mix(pair ^ if first { 1 } else { 2 });
        self.dimension += 1;
        (place ^ shift) & (self.count - 1)
    }
}

impl Stream {
    /// Sequence of a seed.
    pub fn of(seed: u64) -> Self {
        Self { state: seed, strata: None }
    }

    /// Sequence of a pixel and a pass; those of neighbours are uncorrelated.
    pub fn new(pixel: usize, pass: usize) -> Self {
        Self::of(mix(mix(pixel as u64 ^ 0x9e37_79b9_7f4a_7c15) ^ (pass as u64).wrapping_mul(0xd1b5_4a32_d192_ed03)))
    }

    /// One of `count` stratified sequences of a pixel and a pass. Of the n-th numbers of all sequences, one lies in
    /// each of `count` equal parts of [0, 1). Pairs from [`Self::numbers`] form a net (Sobol 1967): they lie in
    /// different cells of every division of the square into `count` cells of halved sides. Each single sequence is
    /// uniformly distributed. `count` is rounded up to a power of two.
    pub fn stratified(pixel: usize, pass: usize, index: usize, count: usize) -> Self {
        let key = Self::new(pixel, pass).state;
        let strata = Strata { index: index as u64, count: count.next_power_of_two() as u64, key, dimension: 0 };
        Self { state: mix(key ^ mix(index as u64)), strata: Some(strata) }
    }

    /// The next number, in `[0, 1)`.
    #[expect(clippy::should_implement_trait, reason = "the stream never ends, so that an Option would be in the way")]
    pub fn next(&mut self) -> f64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let number = (mix(self.state) >> 11) as f64 / (1_u64 << 53) as f64;
        match &mut self.strata {
            // Rounding must not yield 1.
            Some(strata) => ((strata.next() as f64 + number) / strata.count as f64).min(1.0 - f64::EPSILON),
            None => number,
        }
    }

    /// The next `N` numbers; stratified sequences form pairs.
    pub fn numbers<const N: usize>(&mut self) -> [f64; N] {
        if let Some(strata) = self.strata.as_mut().filter(|_| N > 1) {
            strata.dimension += strata.dimension % 2;
        }
        std::array::from_fn(|_| self.next())
    }

    /// An integer below `n`, which is above 0.
    pub fn below(&mut self, n: usize) -> usize {
        ((self.next() * n as f64) as usize).min(n - 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of 16 pairs, one lies in each of 16 × 1, 8 × 2, 4 × 4, 2 × 8 and 1 × 16 cells, also after a single number.
    #[test]
    fn pairs_of_stratified_numbers_are_a_net() {
        for pass in 0..50 {
            let pair = |k: usize| {
                let mut stream = Stream::stratified(3, pass, k, 16);
                let [_, _] = stream.numbers();
                stream.next();
                stream.numbers::<2>()
            };
            let pairs: Vec<[f64; 2]> = (0..16).map(pair).collect();
            for across in [1, 2, 4, 8, 16] {
                let cell =
                    |[x, y]: &[f64; 2]| (x * f64::from(across)) as usize * 16 + (y * f64::from(16 / across)) as usize;
                let mut cells: Vec<usize> = pairs.iter().map(cell).collect();
                cells.sort_unstable();
                cells.dedup();
                assert_eq!(cells.len(), 16, "{pass} {across}");
            }
        }
    }

    #[test]
    fn stratified_streams_fill_each_part_once_and_are_even_alone() {
        for count in [4_usize, 16] {
            let mut sums = vec![0.0; count];
            let passes = 4000;
            for pass in 0..passes {
                let mut streams: Vec<Stream> = (0..count).map(|k| Stream::stratified(7, pass, k, count)).collect();
                for dimension in 0..5 {
                    let mut seen = vec![false; count];
                    for (k, stream) in streams.iter_mut().enumerate() {
                        let number = stream.next();
                        assert!((0.0..1.0).contains(&number));
                        seen[(number * count as f64) as usize] = true;
                        sums[k] += if dimension == 3 { number } else { 0.0 };
                    }
                    assert!(seen.iter().all(|s| *s), "{count} {pass} {dimension}");
                }
            }
            // The mean of uniform numbers has a standard error of 0.0046.
            assert!(sums.iter().all(|s| (s / passes as f64 - 0.5).abs() < 0.02), "{sums:?}");
        }
    }
}
