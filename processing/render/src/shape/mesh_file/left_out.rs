//! Counts of the parts of a mesh file that are not rendered.

use std::collections::BTreeMap;

/// Parts of a mesh file that are not rendered, and faces that are rendered with reserve.
#[derive(Clone, Debug, Default)]
pub(crate) struct LeftOut {
    counts: BTreeMap<String, usize>,
    crossing: usize,
}

impl LeftOut {
    /// Counts parts by their name in the singular.
    pub(crate) fn add(&mut self, name: &str, count: usize) {
        if count > 0 {
            *self.counts.entry(name.to_owned()).or_default() += count;
        }
    }

    /// Counts a face whose outline crosses itself.
    pub(super) fn add_crossing(&mut self) {
        self.crossing += 1;
    }

    /// The counts in words, as in "3 lines, 1 point"; empty where nothing was left out.
    pub(crate) fn words(&self) -> String {
        let word = |(name, count): (&String, &usize)| match (name.split_once(' '), count) {
            (_, 1) => format!("1 {name}"),
            (Some((noun, rest)), _) => format!("{count} {noun}s {rest}"),
            (None, _) => format!("{count} {name}s"),
        };
        self.counts.iter().map(word).collect::<Vec<_>>().join(", ")
    }

    /// Warnings of a report, without the file's name.
    pub(crate) fn warnings(&self) -> Vec<String> {
        let mut warnings = vec![];
        if !self.counts.is_empty() {
            warnings.push(format!("left out: {}", self.words()));
        }
        match self.crossing {
            0 => {}
            1 => warnings.push("1 face crosses itself: its triangles may overlap or leave gaps".into()),
            n => warnings.push(format!("{n} faces cross themselves: their triangles may overlap or leave gaps")),
        }
        warnings
    }
}
