//! Primaries of colour spaces, and their conversion to Rec. 709.

use nalgebra::{Matrix3, Vector3};

/// CIE chromaticities (x, y) of red, green, blue and white.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Primaries([[f64; 2]; 4]);

const D65: [f64; 2] = [0.3127, 0.3290];
const D50: [f64; 2] = [0.3457, 0.3585];
/// White point of ACES.
const ACES: [f64; 2] = [0.321_68, 0.337_67];
/// White point of cinema projectors (DCI).
const DCI: [f64; 2] = [0.314, 0.351];
/// White point of equal energy.
const E: [f64; 2] = [1.0 / 3.0, 1.0 / 3.0];

const P3: [[f64; 2]; 3] = [[0.680, 0.320], [0.265, 0.690], [0.150, 0.060]];

/// Primaries with a name.
const NAMED: [(&str, Primaries); 9] = [
    ("Rec. 709", Primaries::REC709),
    ("CIE XYZ", Primaries::XYZ),
    ("Rec. 2020", of([[0.708, 0.292], [0.170, 0.797], [0.131, 0.046]], D65)),
    ("P3 D65", of(P3, D65)),
    ("DCI P3", of(P3, DCI)),
    ("ACES AP0", of([[0.7347, 0.2653], [0.0, 1.0], [0.0001, -0.0770]], ACES)),
    ("ACES AP1", of([[0.713, 0.293], [0.165, 0.830], [0.128, 0.044]], ACES)),
    ("Adobe RGB", of([[0.640, 0.330], [0.210, 0.710], [0.150, 0.060]], D65)),
    ("ProPhoto RGB", of([[0.7347, 0.2653], [0.1596, 0.8404], [0.0366, 0.0001]], D50)),
];

/// Names of linear colour spaces (OpenColorIO, OpenImageIO, Color Interop Forum) in lower case, letters and digits
/// only.
const SPACES: [(&str, &[&str]); 6] = [
    (
        "Rec. 709",
        &[
            "linear",
            "scenelinear",
            "linrec709",
            "linrec709scene",
            "linearrec709",
            "linearrec709srgb",
            "linsrgb",
            "linearsrgb",
            "linearbt709",
            "srgblinear",
            "utilitylinearsrgb",
            "utilitylinearrec709",
        ],
    ),
    ("ACES AP1", &["acescg", "linap1", "linap1scene", "acesacescg", "linearacescg"]),
    ("ACES AP0", &["aces", "aces20651", "linap0", "linap0scene", "acesaces20651"]),
    ("Rec. 2020", &["linrec2020", "linrec2020scene", "linearrec2020", "linearbt2020", "utilitylinearrec2020"]),
    ("P3 D65", &["linp3d65", "linp3d65scene", "linearp3d65", "lineardisplayp3", "utilitylinearp3d65"]),
    ("CIE XYZ", &["linciexyzd65", "linciexyzd65scene", "linearciexyzd65", "ciexyzd65", "xyz"]),
];

const fn of([red, green, blue]: [[f64; 2]; 3], white: [f64; 2]) -> Primaries {
    Primaries([red, green, blue, white])
}

/// Tolerance of chromaticities, for the rounding in files.
const ROUNDING: f64 = 1.5e-3;

impl Primaries {
    /// Primaries of linear sRGB.
    pub(super) const REC709: Self = of([[0.640, 0.330], [0.300, 0.600], [0.150, 0.060]], D65);

    /// Primaries of CIE XYZ: pixels are X, Y and Z.
    pub(super) const XYZ: Self = of([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]], E);

    /// Primaries of the attribute `chromaticities` of OpenEXR.
    pub(super) fn from_exr(of: exr::meta::attribute::Chromaticities) -> Self {
        Self([of.red, of.green, of.blue, of.white].map(|c| [f64::from(c.0), f64::from(c.1)]))
    }

    /// Primaries of a linear colour space by one of its usual names.
    pub(super) fn of_space(name: &str) -> Option<Self> {
        let plain: String = name.to_ascii_lowercase().chars().filter(char::is_ascii_alphanumeric).collect();
        let known = SPACES.iter().find(|(_, names)| names.contains(&plain.as_str()))?.0;
        NAMED.iter().find(|(name, _)| *name == known).map(|(_, primaries)| *primaries)
    }

    /// Primaries of eight numbers: x and y of red, green, blue and white.
    pub(super) fn from_numbers(numbers: [f64; 8]) -> Self {
        Self(std::array::from_fn(|k| [numbers[2 * k], numbers[2 * k + 1]]))
    }

    fn is_near(&self, other: &Self) -> bool {
        self.0.as_flattened().iter().zip(other.0.as_flattened()).all(|(a, b)| (a - b).abs() < ROUNDING)
    }

    /// Name, or else the chromaticities.
    pub(super) fn name(&self) -> String {
        match NAMED.iter().find(|(_, known)| self.is_near(known)) {
            Some((name, _)) => (*name).into(),
            None => {
                let [r, g, b, w] = self.0.map(|[x, y]| format!("({x:.4}, {y:.4})"));
                format!("R {r}, G {g}, B {b}, white {w}")
            }
        }
    }

    /// Matrix from linear RGB to X, Y, Z with Y = 1 for white; `None` for collinear primaries.
    fn to_xyz(self) -> Option<Matrix3<f64>> {
        let [r, g, b, [x, y]] = self.0;
        if self.0.as_flattened().iter().any(|v| !v.is_finite() || v.abs() > 10.0) || y <= 0.0 {
            return None;
        }
        // Columns are scaled to X + Y + Z = 1, because primaries may have y = 0.
        let column = |[x, y]: [f64; 2]| Vector3::new(x, y, 1.0 - x - y);
        let columns = Matrix3::from_columns(&[r, g, b].map(column));
        let white = Vector3::new(x / y, 1.0, (1.0 - x - y) / y);
        let strengths = columns.try_inverse()? * white;
        let matrix = columns * Matrix3::from_diagonal(&strengths);
        (strengths.iter().all(|s| s.is_finite() && *s > 0.0) && matrix.try_inverse().is_some()).then_some(matrix)
    }

    /// Luminance coefficients of R, G and B; `None` for collinear primaries.
    pub(super) fn luminance(self) -> Option<[f64; 3]> {
        let matrix = self.to_xyz()?;
        Some([0, 1, 2].map(|c| matrix[(1, c)]))
    }

    /// Rows of the matrix to linear Rec. 709; `None` for Rec. 709 itself, `Err` for collinear primaries.
    ///
    /// White stays white by Bradford's chromatic adaptation, as is usual between RGB spaces. X, Y and Z are converted
    /// without adaptation.
    pub(super) fn to_rec709(self) -> Result<Option<[[f64; 3]; 3]>, ()> {
        if self.is_near(&Self::REC709) {
            return Ok(None);
        }
        let xyz = self.to_xyz().ok_or(())?;
        let back = Self::REC709.to_xyz().and_then(|m| m.try_inverse()).ok_or(())?;
        let adapted = if self.is_near(&Self::XYZ) { Matrix3::identity() } else { bradford(self.0[3], D65).ok_or(())? };
        let matrix = back * adapted * xyz;
        Ok(Some([0, 1, 2].map(|r| [0, 1, 2].map(|c| matrix[(r, c)]))))
    }
}

/// Bradford's chromatic adaptation of X, Y, Z from one white point to another.
fn bradford(from: [f64; 2], to: [f64; 2]) -> Option<Matrix3<f64>> {
    let cones = Matrix3::new(0.8951, 0.2664, -0.1614, -0.7502, 1.7135, 0.0367, 0.0389, -0.0685, 1.0296);
    let response = |[x, y]: [f64; 2]| cones * Vector3::new(x / y, 1.0, (1.0 - x - y) / y);
    let ratio = response(to).component_div(&response(from));
    Some(cones.try_inverse()? * Matrix3::from_diagonal(&ratio) * cones)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_matrices() {
        let near = |a: [[f64; 3]; 3], b: [[f64; 3]; 3], tolerance: f64| {
            a.as_flattened().iter().zip(b.as_flattened()).all(|(a, b)| (a - b).abs() < tolerance)
        };
        // Rec. 2020: inverse of ITU-R BT.2087. ACEScg to linear sRGB with Bradford, as in the ACES documents.
        let rec2020 = [[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]];
        let ap1 =
            [[1.705_05, -0.621_79, -0.083_26], [-0.130_26, 1.140_80, -0.010_55], [-0.024_00, -0.128_97, 1.152_97]];
        let xyz = [[3.2410, -1.5374, -0.4986], [-0.9692, 1.8760, 0.0416], [0.0556, -0.2040, 1.0570]];
        for (name, expected) in [("Rec. 2020", rec2020), ("ACES AP1", ap1), ("CIE XYZ", xyz)] {
            let (_, primaries) = NAMED.iter().find(|(known, _)| *known == name).unwrap();
            let found = primaries.to_rec709().unwrap().unwrap();
            assert!(near(found, expected, 1e-3), "{name}: {found:?}");
        }
        assert_eq!(Primaries::REC709.to_rec709(), Ok(None));
    }

    #[test]
    fn spaces_by_name() {
        for (name, expected) in [
            ("ACEScg", "ACES AP1"),
            ("lin_ap1_scene", "ACES AP1"),
            ("ACES2065-1", "ACES AP0"),
            ("Linear Rec.2020", "Rec. 2020"),
            ("lin_rec709", "Rec. 709"),
            ("scene_linear", "Rec. 709"),
        ] {
            assert_eq!(Primaries::of_space(name).unwrap().name(), expected);
        }
        for name in ["sRGB", "srgb_texture", "Raw", "g22_rec709", ""] {
            assert_eq!(Primaries::of_space(name), None, "{name}");
        }
    }

    #[test]
    fn white_stays_white_and_lines_are_refused() {
        for (name, primaries) in NAMED {
            let Ok(Some(matrix)) = primaries.to_rec709() else { continue };
            if name != "CIE XYZ" {
                assert!(matrix.iter().all(|row| (row.iter().sum::<f64>() - 1.0).abs() < 1e-9), "{name}: {matrix:?}");
            }
            assert_eq!(primaries.name(), name);
        }
        let luminance = Primaries::REC709.luminance().unwrap();
        assert!((luminance[1] - 0.7152).abs() < 1e-3 && (luminance.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        let line = Primaries::from_numbers([0.1, 0.1, 0.2, 0.2, 0.3, 0.3, 0.3, 0.3]);
        assert_eq!(line.to_rec709(), Err(()));
        assert_eq!(Primaries::from_numbers([f64::NAN; 8]).to_rec709(), Err(()));
        assert!(line.name().contains("(0.2000, 0.2000)"));
    }
}
