//! Counts of the ignored parts of a mesh file.

use std::collections::BTreeMap;

/// Ignored parts of a mesh file, and faces with an ambiguous surface.
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

    /// Counts a self-intersecting face.
    pub(super) fn add_crossing(&mut self) {
        self.crossing += 1;
    }

    /// The counts as text, such as "3 lines, 1 point"; empty if nothing was ignored.
    pub(crate) fn words(&self) -> String {
        let word = |(name, count): (&String, &usize)| match (name.split_once(' '), count) {
            (_, 1) => format!("1 {name}"),
            (Some((noun, rest)), _) => format!("{count} {noun}s {rest}"),
            (None, _) => format!("{count} {name}s"),
        };
        self.counts.iter().map(word).collect::<Vec<_>>().join(", ")
    }

    /// Warnings for a report, without the file's name.
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
