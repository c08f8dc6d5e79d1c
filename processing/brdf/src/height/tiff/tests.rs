//! Height maps of microscopes and ImageJ.

use super::super::{HeightField, Scale, read};
use std::path::Path;
use tiff::encoder::colortype::{self, ColorType};
use tiff::encoder::{Rational, TiffEncoder, TiffValue};
use tiff::tags::{ResolutionUnit, Tag};

const W: usize = 3;
const H: usize = 2;

/// Tags of a TIFF that state its scale.
#[derive(Clone, Copy, Default)]
struct Says<'a> {
    text: Option<&'a str>,
    /// Pixels per unit across and down.
    per: Option<[(u32, u32); 2]>,
    unit: Option<ResolutionUnit>,
}

fn write<C: ColorType>(path: &Path, samples: &[C::Inner], says: Says)
where
    [C::Inner]: TiffValue,
{
    let mut file = TiffEncoder::new(std::fs::File::create(path).unwrap()).unwrap();
    let mut image = file.new_image::<C>(W as u32, H as u32).unwrap();
    let ratio = |(n, d)| Rational { n, d };
    if let Some([x, y]) = says.per {
        image.encoder().write_tag(Tag::XResolution, ratio(x)).unwrap();
        image.encoder().write_tag(Tag::YResolution, ratio(y)).unwrap();
    }
    if let Some(unit) = says.unit {
        image.resolution_unit(unit);
    }
    if let Some(text) = says.text {
        image.encoder().write_tag(Tag::ImageDescription, text).unwrap();
    }
    image.write_data(samples).unwrap();
}

fn made<C: ColorType>(
    samples: &[C::Inner],
    says: Says,
    pixel_um: Option<f64>,
    range_um: Option<f64>,
) -> nacre_base::Result<HeightField>
where
    [C::Inner]: TiffValue,
{
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.tif");
    write::<C>(&path, samples, says);
    read(&path, &Scale { pixel_um, range_um, ..Scale::default() })
}

fn close(found: &[f64], wanted: &[f64]) {
    assert!(found.len() == wanted.len() && found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-7), "{found:?}");
}

fn problem(result: nacre_base::Result<HeightField>) -> String {
    result.unwrap_err().to_string()
}

#[test]
fn signed_wide_and_float_samples_are_heights() {
    let levels = [-200, -100, 0, 50, 100, 300];
    let wanted: Vec<f64> = levels.iter().map(|v| f64::from(*v) * 1e-3).collect();
    let with = |field: nacre_base::Result<HeightField>| {
        let field = field.unwrap();
        assert_eq!((field.width, field.height, field.pixel_um), (W, H, 0.3));
        let low = field.ends_um()[0];
        close(&field.um.iter().map(|v| v - low - 0.2).collect::<Vec<_>>(), &wanted);
        field
    };
    let plain = Says::default();
    let short = with(made::<colortype::GrayI16>(&levels.map(|v| v as i16), plain, Some(0.3), Some(0.5)));
    assert!((short.step_um.unwrap() - 1e-3).abs() < 1e-12 && short.notes[0].contains("signed 16-bit"));
    with(made::<colortype::GrayI32>(&levels.map(|v| v * 1000), plain, Some(0.3), Some(0.5)));
    with(made::<colortype::Gray32>(&levels.map(|v| (v + 200) as u32 * 7), plain, Some(0.3), Some(0.5)));
    // Floats in nm, µm or m: a range is from the lowest to the highest point in any unit.
    for unit in [1.0_f32, 1e-3, 1e-9] {
        let field = with(made::<colortype::Gray32Float>(&levels.map(|v| v as f32 * unit), plain, Some(0.3), Some(0.5)));
        assert!(field.step_um.is_none());
    }
    let gap = [0.0, 1.0, f32::NAN, 2.0, 3.0, 4.0];
    assert!(problem(made::<colortype::Gray32Float>(&gap, plain, Some(0.3), Some(0.5))).contains("column 2, row 0"));
    assert!(problem(made::<colortype::GrayI16>(&[0; 6], plain, Some(0.3), None)).contains("--range-um"));
    // Unsigned integers are from black to white.
    let grey = made::<colortype::Gray16>(&[0, 13_107, 26_214, 0, 0, 0], plain, Some(0.3), Some(0.5)).unwrap();
    close(&grey.um[..3], &[0.0, 0.1, 0.2]);
}

#[test]
fn imagej_states_pitch_and_unit() {
    let grey = [0, 100, 200, 300, 400, 65_535];
    let per = Some([(8, 1), (8, 1)]);
    for unit in ["um", "micron", "microns", "\\u00B5m", "micrometer"] {
        let text = format!("ImageJ=1.54f\nimages=1\nunit={unit}\nloop=false\n");
        let says = Says { text: Some(&text), per, unit: Some(ResolutionUnit::None) };
        let field = made::<colortype::Gray16>(&grey, says, None, Some(0.4)).unwrap();
        assert!((field.pixel_um - 0.125).abs() < 1e-9, "{unit}: {}", field.pixel_um);
        assert!(problem(made::<colortype::Gray16>(&grey, says, Some(0.2), Some(0.4))).contains("--pixel-um says 0.2"));
    }
    let in_unit = |unit: &str, per: [(u32, u32); 2]| {
        let text = format!("ImageJ=1.54f\nunit={unit}\n");
        made::<colortype::Gray16>(
            &grey,
            Says { text: Some(&text), per: Some(per), unit: Some(ResolutionUnit::None) },
            None,
            Some(0.4),
        )
    };
    assert!((in_unit("nm", [(1, 125), (1, 125)]).unwrap().pixel_um - 0.125).abs() < 1e-9);
    assert!((in_unit("cm", [(80_000, 1), (80_000, 1)]).unwrap().pixel_um - 0.125).abs() < 1e-9);
    assert!(problem(in_unit("um", [(8, 1), (1, 1)])).contains("4 : 1"));
    assert!(problem(in_unit("pixel", [(8, 1), (8, 1)])).contains("--pixel-um"));
    // Calibration of the values.
    let text = "ImageJ=1.54f\nunit=um\ncf=0\nc0=-5.0\nc1=0.01\nvunit=nm\n";
    let says = Says { text: Some(text), per, unit: Some(ResolutionUnit::None) };
    let field = made::<colortype::Gray16>(&grey, says, None, None).unwrap();
    assert!((field.um[5] - field.um[0] - 0.655_35).abs() < 1e-9);
}

#[test]
fn ome_and_resolutions_state_a_pitch() {
    let grey = [0, 100, 200, 300, 400, 65_535];
    let xml = "<?xml version=\"1.0\"?><OME xmlns=\"http://www.openmicroscopy.org/Schemas/OME/2016-06\"><Image ID=\"Image:0\"><Pixels ID=\"Pixels:0\" \
               PhysicalSizeX=\"150\" PhysicalSizeXUnit=\"nm\" PhysicalSizeY=\"0.15\" SizeX=\"3\" SizeY=\"2\"/></Image></OME>";
    let field = made::<colortype::Gray16>(&grey, Says { text: Some(xml), ..Says::default() }, None, Some(0.4)).unwrap();
    assert!((field.pixel_um - 0.15).abs() < 1e-9);
    let dots = |n: u32, unit| {
        made::<colortype::Gray16>(&grey, Says { per: Some([(n, 1); 2]), unit: Some(unit), text: None }, None, Some(0.4))
    };
    let fine = dots(40_000, ResolutionUnit::Centimeter).unwrap();
    assert!((fine.pixel_um - 0.25).abs() < 1e-9 && fine.notes[0].contains("40000 pixels per cm"), "{:?}", fine.notes);
    assert!((dots(127_000, ResolutionUnit::Inch).unwrap().pixel_um - 0.2).abs() < 1e-9);
    // 300 dots per inch is a default, not a measurement.
    for n in [72, 96, 300, 1200] {
        assert!(problem(dots(n, ResolutionUnit::Inch)).contains("--pixel-um"), "{n}");
    }
    let said = made::<colortype::Gray16>(
        &grey,
        Says { per: Some([(300, 1); 2]), unit: Some(ResolutionUnit::Inch), text: None },
        Some(0.1),
        Some(0.4),
    );
    assert_eq!(said.unwrap().pixel_um, 0.1);
}

#[test]
fn damaged_height_maps_never_panic() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.tif");
    let text = "ImageJ=1.54f\nunit=um\n";
    write::<colortype::GrayI16>(
        &path,
        &[-9, 5, 7, 100, -200, 3],
        Says { text: Some(text), per: Some([(8, 1); 2]), unit: None },
    );
    let whole = std::fs::read(&path).unwrap();
    let rounds = std::env::var("NACRE_FUZZ_ROUNDS").ok().and_then(|n| n.parse().ok()).unwrap_or(1500);
    let mut state = 5_u64;
    let mut dice = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize
    };
    for round in 0..rounds {
        let mut copy = whole.clone();
        for _ in 0..=dice() % 3 {
            let at = dice() % copy.len();
            copy[at] = if dice() % 3 == 0 { 0xff } else { dice() as u8 };
        }
        if round % 6 == 0 {
            copy.truncate(dice() % whole.len());
        }
        std::fs::write(&path, &copy).unwrap();
        _ = read(&path, &Scale { pixel_um: None, range_um: Some(0.5), ..Scale::default() });
    }
}
