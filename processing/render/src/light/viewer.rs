//! Who looks at a picture: an observer, or narrow bands of a spectrum.

use nacre_brdf::RANGE_NM;
use nacre_optics::color::{Observer, linear_srgb};

/// Least and most wave number that is seen, in 1/µm.
pub(crate) const RANGE: [f64; 2] = [1e3 / RANGE_NM[1], 1e3 / RANGE_NM[0]];

/// Three numbers per wavelength: an observer's X, Y, Z, or three bands that lie side by side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Viewer {
    /// Whose Y is the unit of a light.
    pub observer: Observer,
    pub bands: Option<Bands>,
}

/// Three bands: each is a triangle over wavelengths that ends where its neighbours have their peaks, so that all bands together see every
/// wavelength alike. What a band sees is the mean of a spectrum, and a spectrum that is straight between peaks has those values there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bands {
    /// Wavelength of the first peak.
    pub first_nm: f64,
    /// Distance of two peaks.
    pub step_nm: f64,
}

impl From<Observer> for Viewer {
    fn from(observer: Observer) -> Self {
        Self { observer, bands: None }
    }
}

impl Viewer {
    /// Its three numbers at a wavelength; those of bands per nm.
    pub(crate) fn at(self, nm: f64) -> [f64; 3] {
        let Some(Bands { first_nm, step_nm }) = self.bands else { return self.observer.at(nm) };
        [0.0, 1.0, 2.0].map(|k| {
            let peak = first_nm + k * step_nm;
            let high = (1.0 - (nm - peak).abs() / step_nm).max(0.0);
            // A band at the end of the spectrum has half of its triangle.
            let sides = [peak > RANGE_NM[0] + 1e-6, peak < RANGE_NM[1] - 1e-6];
            let area = 0.5 * step_nm * f64::from(u8::from(sides[0]) + u8::from(sides[1]));
            if area > 0.0 && (RANGE_NM[0]..=RANGE_NM[1]).contains(&nm) { high / area } else { 0.0 }
        })
    }

    /// Least and most wave number that it sees, in 1/µm.
    pub(crate) fn range(self) -> [f64; 2] {
        match self.bands {
            None => RANGE,
            Some(Bands { first_nm, step_nm }) => {
                let to = (first_nm + 3.0 * step_nm).min(RANGE_NM[1]);
                [1e3 / to, 1e3 / (first_nm - step_nm).max(RANGE_NM[0])]
            }
        }
    }

    /// What a pixel keeps of the three numbers, and what stands for its brightness: linear sRGB and Y, or the bands and their mean.
    pub(crate) fn kept(self, seen: [f64; 3]) -> ([f64; 3], f64) {
        match self.bands {
            None => (linear_srgb(seen.map(|v| v as f32)).map(f64::from), seen[1]),
            Some(_) => (seen, seen.iter().sum::<f64>() / 3.0),
        }
    }
}
