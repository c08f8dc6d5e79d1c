//! Averages of successive exposures of one scene.

/// Sum of the codes of one or more exposures.
pub struct Averaging {
    width: usize,
    sums: Vec<u32>,
    count: u32,
}

impl Averaging {
    /// Starts with a first exposure in rows of `width` codes.
    pub fn new(width: usize, codes: &[u16]) -> Self {
        Self { width, sums: codes.iter().map(|&code| code.into()).collect(), count: 1 }
    }

    /// Adds an exposure of the same size; at most 65,536 fit.
    pub fn add(&mut self, codes: &[u16]) {
        // Frames of another size are refused when the camera delivers them.
        debug_assert_eq!(codes.len(), self.sums.len(), "exposures of one size");
        self.count += 1;
        self.sums.iter_mut().zip(codes).for_each(|(sum, &code)| *sum += u32::from(code));
    }

    /// Width, height and mean codes of a region (left, top, width, height; default all). Means are multiplied by
    /// `factor`, rounded, and limited to 65535.
    pub fn means(&self, part: Option<[usize; 4]>, factor: u32) -> (usize, usize, Vec<u16>) {
        let all = [0, 0, self.width, self.sums.len() / self.width.max(1)];
        let [left, top, width, height] = part.unwrap_or(all);
        let half = self.count / 2;
        // Prevents overflow; larger sums give 65535 in any case.
        let most = (u32::MAX - half) / factor.max(1);
        let mean = |sum: &u32| ((sum.min(&most) * factor + half) / self.count).min(u16::MAX.into()) as u16;
        let rows = self.sums.chunks(self.width.max(1)).skip(top).take(height);
        (width, height, rows.flat_map(|row| row[left..left + width].iter().map(mean)).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::Averaging;

    #[test]
    fn means_are_rounded_and_cut_out() {
        let mut sum = Averaging::new(3, &[1, 2, 3, 4, 5, 6]);
        assert_eq!(sum.means(None, 1), (3, 2, vec![1, 2, 3, 4, 5, 6]));
        sum.add(&[2, 2, 4, 5, 7, 7]);
        assert_eq!(sum.means(None, 1), (3, 2, vec![2, 2, 4, 5, 6, 7]), "halves go up");
        assert_eq!(sum.means(Some([1, 1, 2, 1]), 2), (2, 1, vec![12, 13]), "more levels keep the halves");
    }

    /// Codes above the camera's stated white are saturated, not dark.
    #[test]
    fn what_is_too_much_is_white() {
        let mut sum = Averaging::new(2, &[u16::MAX, 1]);
        (0..15).for_each(|_| sum.add(&[u16::MAX, 1]));
        for factor in [1, 16, 4369, 65535] {
            assert_eq!(sum.means(None, factor).2, [u16::MAX, factor as u16], "factor {factor}");
        }
    }
}
