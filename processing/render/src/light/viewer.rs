//! Spectral response of a picture: an observer, or narrow bands of a spectrum.

use nacre_brdf::RANGE_NM;
use nacre_optics::color::{Observer, linear_srgb};

/// Smallest and largest visible wave number in 1/µm.
pub(crate) const RANGE: [f64; 2] = [1e3 / RANGE_NM[1], 1e3 / RANGE_NM[0]];

/// Three responses per wavelength: an observer's X, Y, Z, or three adjacent bands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Viewer {
    /// Observer whose Y is the unit of a light.
    pub observer: Observer,
    pub bands: Option<Bands>,
}

/// Three bands. Each is a triangle over wavelengths that ends at the peaks of its neighbours, so the sum of all bands
/// is constant over wavelength. A band's value is the weighted mean of a spectrum. For a spectrum that is linear
/// between peaks it is the value at the peak.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bands {
    /// Wavelength of the first peak in nm.
    pub first_nm: f64,
    /// Spacing of the peaks in nm.
    pub step_nm: f64,
}

impl From<Observer> for Viewer {
    fn from(observer: Observer) -> Self {
        Self { observer, bands: None }
    }
}

impl Viewer {
    /// The three responses at a wavelength; those of bands are per nm.
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

    /// Smallest and largest wave number of the response in 1/µm.
    pub(crate) fn range(self) -> [f64; 2] {
        match self.bands {
            None => RANGE,
            Some(Bands { first_nm, step_nm }) => {
                let to = (first_nm + 3.0 * step_nm).min(RANGE_NM[1]);
                [1e3 / to, 1e3 / (first_nm - step_nm).max(RANGE_NM[0])]
            }
        }
    }

    /// Stored values of a pixel and its brightness: linear sRGB and Y, or the bands and their mean.
    pub(crate) fn kept(self, seen: [f64; 3]) -> ([f64; 3], f64) {
        match self.bands {
            None => (linear_srgb(seen.map(|v| v as f32)).map(f64::from), seen[1]),
            Some(_) => (seen, seen.iter().sum::<f64>() / 3.0),
        }
    }
}
