//! Grouping of photographs: exposures at one analyser angle, and the angles within one photograph.

use crate::fit::demosaic::{Demosaic, FullSize};
use nacre_base::{Error, Result};
use nacre_frames::{Frame, Kind, LinearFrame, LoadedFrames};

/// Maximum number of exposures merged into one; they are decoded simultaneously.
pub const MAX_BRACKET: usize = 16;

/// Largest difference of angles that count as equal, in degrees, because files round them.
const SAME_ANGLE_DEG: f64 = 1e-6;

/// Relative difference of exposures that count as equal.
const SAME_EXPOSURE: f64 = 1e-6;

/// One intensity image at one analyser angle: the exposures taken there, or the pixels of a sensor with this angle.
pub(crate) struct View {
    /// Index of its exposures in the [`brackets`].
    pub(crate) bracket: usize,
    /// Pixels of a super-pixel, `(x, y)`, whose light is averaged.
    pub(crate) pixels: Vec<[usize; 2]>,
    /// Side of a super-pixel; 1 for cameras without a polarizer mosaic.
    pub(crate) block: usize,
    /// Photograph pixels along the side of a map pixel: the side of a super-pixel, or 1 for interpolated images.
    pub(crate) step: usize,
    /// Analyser angle in rad, as stated or as estimated from residuals.
    pub(crate) angle: f64,
    /// Stated analyser angle in rad.
    pub(crate) stated: f64,
}

/// Indices of the frames taken at one analyser angle with different exposures, in the order of the first of each. A
/// second frame with the same exposure is a new observation.
pub(crate) fn brackets(frames: &[Frame]) -> Vec<Vec<usize>> {
    let mut all: Vec<Vec<usize>> = vec![];
    for (i, frame) in frames.iter().enumerate() {
        let joins = |bracket: &&mut Vec<usize>| {
            let alike = |k: &usize| same_angle(&frames[*k], frame);
            let another = |k: &usize| (frames[*k].scale() / frame.scale() - 1.0).abs() > SAME_EXPOSURE;
            bracket.len() < MAX_BRACKET && bracket.iter().all(|k| alike(k) && another(k))
        };
        match all.iter_mut().find(joins) {
            Some(bracket) => bracket.push(i),
            None => all.push(vec![i]),
        }
    }
    all
}

fn same_angle(a: &Frame, b: &Frame) -> bool {
    match (a.analyser_deg, b.analyser_deg) {
        (Some(a), Some(b)) => (a - b).abs() < SAME_ANGLE_DEG,
        (a, b) => a == b,
    }
}

/// A decoded photograph, and the images behind its polarizers if they are interpolated.
pub(crate) struct Photograph<'a> {
    pub(crate) frame: LinearFrame<'a>,
    pub(crate) full: Option<FullSize>,
}

impl Photograph<'_> {
    /// Row `y` of a view in map pixels: its light, with `bad[x]` set to 1 where it is unusable.
    pub(crate) fn row(&self, view: &View, y: usize, light: &mut [f32], bad: &mut [u8]) {
        if let Some(full) = &self.full {
            return full.row(view, y, light, bad);
        }
        let mut strided = |[x, top]: [usize; 2], light: &mut [f32]| {
            self.frame.strided(y * view.block + top, x, view.block, light, bad);
        };
        let [first, rest @ ..] = &view.pixels[..] else { return };
        strided(*first, light);
        if rest.is_empty() {
            return;
        }
        let mut other = vec![0.0; light.len()];
        for pixel in rest {
            strided(*pixel, &mut other);
            light.iter_mut().zip(&other).for_each(|(sum, v)| *sum += v);
        }
        let share = 1.0 / view.pixels.len() as f32;
        light.iter_mut().for_each(|v| *v *= share);
    }
}

/// Views of the photographs, bracket by bracket.
pub(crate) fn views(frames: &LoadedFrames, brackets: &[Vec<usize>], demosaic: Demosaic) -> Result<Vec<View>> {
    let set = &frames.set;
    let indexed = brackets.iter().enumerate().filter_map(|(i, b)| Some((i, set.frames.get(*b.first()?)?)));
    Ok(match (set.kind, set.filters()) {
        (Kind::Polarization, _) => indexed
            .map(|(bracket, f)| {
                let angle = set.analyser_axis(f);
                View { bracket, pixels: vec![[0, 0]], block: 1, step: 1, angle, stated: angle }
            })
            .collect(),
        (Kind::DivisionOfFocalPlane, Some(filters)) => indexed
            .flat_map(|(bracket, _)| (0..4).map(move |k| (bracket, k)))
            .map(|(bracket, k)| {
                let (angle, block) = (filters.angles[k].to_radians(), filters.block());
                let step = if demosaic == Demosaic::None { block } else { 1 };
                View { bracket, pixels: filters.pixels(k, set.channel), block, step, angle, stated: angle }
            })
            .collect(),
        _ => {
            let problem = "holds photographs of another kind than polarization or division_of_focal_plane";
            return Err(Error::file(&frames.path, problem, "give the analyser angles, see `nacre schema frames`"));
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grouped(frames: &[(f64, f64)]) -> Vec<Vec<usize>> {
        let frame = |(angle, exposure): &(f64, f64)| Frame {
            analyser_deg: Some(*angle),
            exposure_s: Some(*exposure),
            ..Frame::new("a.png")
        };
        brackets(&frames.iter().map(frame).collect::<Vec<_>>())
    }

    #[test]
    fn exposures_at_one_angle_belong_together_in_any_order_and_repeats_do_not() {
        let by_angle = [(0.0, 1.0), (0.0, 8.0), (60.0, 1.0), (60.0, 8.0)];
        assert_eq!(grouped(&by_angle), [[0, 1], [2, 3]]);
        let by_exposure = [(0.0, 1.0), (60.0, 1.0), (0.0, 8.0), (60.0, 8.0)];
        assert_eq!(grouped(&by_exposure), [[0, 2], [1, 3]]);
        assert_eq!(grouped(&[(0.0, 1.0), (0.0, 1.0), (30.0, 1.0)]).len(), 3);
        // A second bracket at an angle that already has one.
        let again = [(0.0, 1.0), (0.0, 8.0), (9.0, 1.0), (9.0, 8.0), (0.0, 1.0), (0.0, 8.0)];
        assert_eq!(grouped(&again), [[0, 1], [2, 3], [4, 5]]);
    }

    #[test]
    fn a_bracket_holds_a_bounded_number_of_photographs() {
        let many: Vec<_> = (0..40).map(|k| (0.0, 1.0 + f64::from(k))).collect();
        assert_eq!(grouped(&many).iter().map(Vec::len).collect::<Vec<_>>(), [16, 16, 8]);
    }
}
